%% Whole runs of path planning in an abstract world, whose oracle shares no code with the plan: every
%% line is painted, tubes are disjoint at every step, and wherever robots stand, one can leave.
-module(starl_dpp_plan_run_tests).
-include_lib("eunit/include/eunit.hrl").

-define(R, 215.0).
-define(WORLD, {12000.0, 12000.0}).

config(Segments, N) ->
    #{segments => Segments, world => ?WORLD, robots => lists:seq(1, N), tube_radius => ?R}.

new(Segments, N) ->
    {ok, Plan} = starl_dpp_plan:new(config(Segments, N)),
    Plan.

line() -> {{3000.0, 6000.0}, {5000.0, 6000.0}}.

%%% Whole runs: every line is painted, tubes are disjoint at every step, retreats are bounded

complete_test_() ->
    [
        {
            lists:concat([Name, ", ", N, " robots, seed ", Seed]),
            {timeout, 60, fun() -> complete(Name, N, Seed, #{}) end}
        }
     || Name <- starl_dpp_pictures:names(), N <- [1, 2, 4, 8, 16], Seed <- seeds(N)
    ].

seeds(16) -> [1];
seeds(N) -> [N, N + 100].

without_making_way_test_() ->
    [
        {
            lists:concat([Name, ", 8 robots, seed ", Seed]),
            {timeout, 60, fun() -> complete(Name, 8, Seed, #{make_way => false}) end}
        }
     || Name <- [text, star, spiral], Seed <- [1, 2]
    ].

%% Robots stop anywhere, off their line by up to the slack, and ask again.
interrupted_test_() ->
    [
        {
            lists:concat([Name, ", ", N, " robots, seed ", Seed]),
            {timeout, 60, fun() -> complete(Name, N, Seed, #{interrupt => 0.05, slack => 40.0}) end}
        }
     || Name <- [lines, grid, text, star, circles], N <- [3, 10], Seed <- [1, 2]
    ].

complete(Name, N, Seed, Options) ->
    Figures = run(Name, N, Seed, Options),
    ?assertMatch(#{free := 0, assigned := 0}, maps:get(counts, Figures)),
    ?assertEqual(0, maps:get(stuck, Figures, 0)).

run(Name, N, Seed, Options) ->
    Config = config(starl_dpp_pictures:picture(Name, Seed), N),
    Slack = maps:get(slack, Options, 0.0),
    starl_dpp_world:run(
        maps:merge(
            #{
                plan => Config#{seed => Seed, slack => Slack},
                seed => Seed,
                make_way => true
            },
            Options
        )
    ).

%% Robots die at any time: the others finish all they can, and the end is honest.
deaths_test_() ->
    [
        {lists:concat([Name, " seed ", Seed]), {timeout, 60, fun() -> deaths(Name, Seed) end}}
     || Name <- [lines, text, grid, star], Seed <- [1, 2, 3]
    ].

deaths(Name, Seed) ->
    Deaths = [{10.0 + Seed, 2}, {20.0 + 3 * Seed, 5}],
    Figures = run(Name, 6, Seed, #{deaths => Deaths}),
    #{counts := #{free := Free}, plan := Plan, live := Live} = Figures,
    ?assertEqual([1, 3, 4, 6], Live),
    ?assert(Free =:= 0 orelse not starl_dpp_assign:reachable(Live, Plan)).

%% Equal input, equal run.
deterministic_test() ->
    F = fun() -> maps:with([makespan, counts, retreats], run(text, 5, 3, #{})) end,
    ?assertEqual(F(), F()).

%%% Deadlock: wherever robots stand, at least one can always leave

%% However robots stand, more than 2R apart, retreats end with all but one parked at most.
drain_test_() ->
    [
        {
            lists:concat([Kind, " ", N, " robots, seed ", Seed]),
            {timeout, 30, fun() -> drain(Kind, N, Seed) end}
        }
     || Kind <- [cluster, ring, corridor, scattered], N <- [3, 8, 16], Seed <- lists:seq(1, 12)
    ].

drain(Kind, N, Seed) ->
    Plan0 = new([line()], N),
    Plan1 = crowd(Kind, lists:seq(1, N), [], {rand:seed_s(exsss, Seed), 0}, Plan0),
    Plan2 = drained(lists:seq(1, N), 2 * N, Plan1),
    Away = [Id || Id <- lists:seq(1, N), not starl_dpp_plan:parked(Id, Plan2)],
    ?assertEqual({[], starl_dpp_plan:unsafe(Plan1)}, {Away, starl_dpp_plan:unsafe(Plan1)}).

drained(_Robots, 0, Plan) ->
    Plan;
drained(Robots, Rounds, Plan0) ->
    Plan1 = lists:foldl(fun retreat_now/2, Plan0, Robots),
    case Plan1 of
        Plan0 -> Plan0;
        _ -> drained(Robots, Rounds - 1, Plan1)
    end.

%% The way is checked against all others and driven at once.
retreat_now(Id, Plan0) ->
    case starl_dpp_assign:retreat(Id, Plan0) of
        {none, _} ->
            Plan0;
        {{assign, Path}, Plan1} ->
            starl_dpp_world:disjoint(starl_dpp_plan:unsafe(Plan1), Plan1),
            {P, up} = lists:last(Path),
            starl_dpp_plan:standing(Id, P, Plan1)
    end.

%% Requests and resolutions from crowded places never come to rest before the picture is done.
crowded_run_test_() ->
    [
        {
            lists:concat([Kind, " ", N, " robots, seed ", Seed]),
            {timeout, 60, fun() -> crowded_run(Kind, N, Seed) end}
        }
     || Kind <- [cluster, ring, corridor, scattered], N <- [4, 12], Seed <- lists:seq(1, 4)
    ].

crowded_run(Kind, N, Seed) ->
    Plan0 = new([line()], N),
    Plan1 = crowd(Kind, lists:seq(1, N), [], {rand:seed_s(exsss, Seed), 0}, Plan0),
    At = maps:from_list([{Id, P} || {Id, [{P, _}]} <- starl_dpp_plan:unsafe(Plan1)]),
    Config = config(starl_dpp_pictures:picture(star, Seed), N),
    Figures = starl_dpp_world:run(#{plan => Config, at => At, seed => Seed, make_way => true}),
    ?assertMatch(#{free := 0, assigned := 0}, maps:get(counts, Figures)).

crowd(_Kind, [], _Taken, _Rand, Plan) ->
    Plan;
crowd(Kind, [Id | Ids], Taken, {Rand0, Tries}, Plan) ->
    {P, Rand1} = place(Kind, Rand0, Tries),
    case lists:all(fun(Q) -> starl_geometry:distance(P, Q) >= 2.0 * ?R end, Taken) of
        true ->
            crowd(Kind, Ids, [P | Taken], {Rand1, 0}, starl_dpp_plan:standing(Id, P, Plan));
        false ->
            crowd(Kind, [Id | Ids], Taken, {Rand1, Tries + 1}, Plan)
    end.

%% A dense heap near a corner of the area; near the ring road; between it and the wall; anywhere.
%% After many misses the heap grows.
place(Kind, Rand0, Tries) ->
    {X, Rand1} = rand:uniform_s(Rand0),
    {Y, Rand2} = rand:uniform_s(Rand1),
    {place_at(Kind, X, Y, 1.0 + Tries / 40), Rand2}.

place_at(cluster, X, Y, Grow) -> {900.0 + 900.0 * Grow * X, 900.0 + 900.0 * Grow * Y};
place_at(ring, X, Y, Grow) -> {700.0 + 3000.0 * Grow * X, 500.0 + 350.0 * Y};
place_at(corridor, X, Y, Grow) -> {?R + 5000.0 * Grow * X, ?R + 450.0 * Y};
place_at(scattered, X, Y, _) -> {?R + 11500.0 * X, ?R + 11500.0 * Y}.
