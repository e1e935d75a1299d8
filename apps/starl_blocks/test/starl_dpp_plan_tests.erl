-module(starl_dpp_plan_tests).
-include_lib("eunit/include/eunit.hrl").

-define(R, 215.0).
-define(WORLD, {12000.0, 12000.0}).

config(Segments, N) ->
    #{segments => Segments, world => ?WORLD, robots => lists:seq(1, N), tube_radius => ?R}.

new(Segments, N) ->
    {ok, Plan} = starl_dpp_plan:new(config(Segments, N)),
    Plan.

parked(Segments, N) -> park_all(lists:seq(1, N), new(Segments, N)).

park_all(Robots, Plan) ->
    lists:foldl(
        fun(Id, P) -> starl_dpp_plan:standing(Id, starl_dpp_plan:spot(Id, P), P) end,
        Plan,
        Robots
    ).

line() -> {{3000.0, 6000.0}, {5000.0, 6000.0}}.

pens(Path) -> [E || {_, {down, E}} <- Path].

%%% Single steps

empty_picture_is_complete_test() ->
    ?assertMatch({complete, _}, starl_dpp_assign:request(1, parked([], 1))).

nothing_before_all_places_are_known_test() ->
    Plan = park_all([1], new([line()], 2)),
    ?assertEqual([2], starl_dpp_plan:unknown(Plan)),
    ?assertMatch({none, _}, starl_dpp_assign:request(1, Plan)),
    ?assertMatch({[], _}, starl_dpp_assign:resolve([1], Plan)).

%% The answer contains a free edge; the whole line, longer than the longest edge, gets painted.
long_line_is_divided_and_assigned_test() ->
    Plan0 = parked([line()], 1),
    #{total := 4, free := 4} = starl_dpp_plan:counts(Plan0),
    {{assign, Path}, Plan1} = starl_dpp_assign:request(1, Plan0),
    ?assertEqual([1, 2, 3, 4], lists:sort(pens(Path))),
    ?assertMatch(#{free := 0, assigned := 4, painted := 0}, starl_dpp_plan:counts(Plan1)),
    Plan2 = starl_dpp_plan:passed(1, length(Path), Plan1),
    ?assertEqual([1, 2, 3, 4], starl_dpp_plan:painted_since(0, Plan2)),
    {End, _} = lists:last(Path),
    ?assertMatch(
        {complete, _}, starl_dpp_assign:request(1, starl_dpp_plan:standing(1, End, Plan2))
    ).

%% Forgetting one's own tube when checking: a robot that stands on the only line, all of it inside
%% its disk, still gets it.
own_reservation_does_not_block_test() ->
    Short = {{6000.0, 6000.0}, {6100.0, 6000.0}},
    Plan = starl_dpp_plan:standing(1, {6050.0, 6010.0}, new([Short], 1)),
    ?assertMatch({{assign, [_ | _]}, _}, starl_dpp_assign:request(1, Plan)).

passed_is_monotone_and_idempotent_test() ->
    {{assign, Path}, Plan0} = starl_dpp_assign:request(1, parked([line()], 1)),
    N = length(Path),
    Plan1 = starl_dpp_plan:passed(1, N - 1, Plan0),
    ?assertEqual(Plan1, starl_dpp_plan:passed(1, N - 1, Plan1)),
    ?assertEqual(Plan1, starl_dpp_plan:passed(1, 1, Plan1)),
    ?assertEqual(3, length(starl_dpp_plan:painted_since(0, Plan1))),
    [{1, Held0}] = starl_dpp_plan:unsafe(Plan0),
    [{1, Held1}] = starl_dpp_plan:unsafe(Plan1),
    ?assertEqual([lists:last(Held0)], Held1),
    Plan2 = starl_dpp_plan:passed(1, N, Plan1),
    ?assertEqual(Plan2, starl_dpp_plan:passed(1, N + 7, Plan2)).

%% A lost or late report of a robot that stands does not free space it is in.
late_passed_of_a_standing_robot_is_ignored_test() ->
    {{assign, [{P, _} | _] = Path}, Plan0} = starl_dpp_assign:request(1, parked([line()], 1)),
    Plan1 = starl_dpp_plan:standing(1, P, Plan0),
    ?assertEqual(Plan1, starl_dpp_plan:passed(1, length(Path), Plan1)),
    ?assertEqual([{1, [{P, P}]}], starl_dpp_plan:unsafe(Plan1)).

%% The robot stays where it is after a lost assignment; its edges come back.
standing_frees_what_is_not_painted_test() ->
    Plan0 = parked([line()], 1),
    {{assign, Path}, Plan1} = starl_dpp_assign:request(1, Plan0),
    Plan2 = starl_dpp_plan:passed(1, length(Path) - 2, Plan1),
    {P, _} = lists:nth(length(Path) - 2, Path),
    Plan3 = starl_dpp_plan:standing(1, P, Plan2),
    ?assertMatch(#{free := 2, assigned := 0, painted := 2}, starl_dpp_plan:counts(Plan3)),
    ?assertMatch({{assign, [_, _]}, _}, starl_dpp_assign:request(1, Plan3)).

moving_robot_gets_nothing_test() ->
    {_, Plan} = starl_dpp_assign:request(1, parked([line()], 1)),
    ?assertMatch({none, _}, starl_dpp_assign:request(1, Plan)),
    ?assertMatch({none, _}, starl_dpp_assign:retreat(1, Plan)).

parked_robot_does_not_retreat_test() ->
    ?assertMatch({none, _}, starl_dpp_assign:retreat(1, parked([line()], 3))).

retreat_ends_on_a_spot_test() ->
    Plan0 = starl_dpp_plan:standing(2, {6000.0, 6000.0}, park_all([1], new([line()], 2))),
    {{assign, Path}, Plan1} = starl_dpp_assign:retreat(2, Plan0),
    {P, up} = lists:last(Path),
    ?assert(starl_dpp_plan:parked(2, starl_dpp_plan:standing(2, P, Plan1))).

%% The nearest spot whose owner is away is as good as the own one, and the two exchange them; both
%% by a retreat and by standing there.
spots_are_exchanged_test() ->
    Plan0 = new([line()], 2),
    Own = starl_dpp_plan:spot(1, Plan0),
    {X, Y} = Other = starl_dpp_plan:spot(2, Plan0),
    Away = starl_dpp_plan:standing(2, {6000.0, 6000.0}, Plan0),
    Near = starl_dpp_plan:standing(1, {(3 * X + 6000.0) / 4, (3 * Y + 6000.0) / 4}, Away),
    {{assign, Path}, Plan1} = starl_dpp_assign:retreat(1, Near),
    ?assertMatch({Other, up}, lists:last(Path)),
    ?assertEqual({Other, Own}, {starl_dpp_plan:spot(1, Plan1), starl_dpp_plan:spot(2, Plan1)}),
    Plan2 = starl_dpp_plan:standing(1, Other, Away),
    ?assert(starl_dpp_plan:parked(1, Plan2)),
    ?assertEqual(Own, starl_dpp_plan:spot(2, Plan2)).

%% A robot beside its line by less than the slack counts as on it, so that its disk does not leave
%% the tube that it had.
standing_beside_the_path_test() ->
    {ok, Plan0} = starl_dpp_plan:new((config([line()], 1))#{slack => 40.0}),
    {{assign, _}, Plan1} = starl_dpp_assign:request(1, park_all([1], Plan0)),
    [{1, Segments}] = starl_dpp_plan:unsafe(Plan1),
    {A, B} = lists:last(Segments),
    {X, Y} = starl_geometry:interpolate(A, B, 0.5),
    [{1, [{Q, Q}]}] = starl_dpp_plan:unsafe(starl_dpp_plan:standing(1, {X, Y + 30.0}, Plan1)),
    ?assert(starl_geometry:distance(Q, {X, Y}) < 1.0e-6),
    [{1, [{F, F}]}] = starl_dpp_plan:unsafe(starl_dpp_plan:standing(1, {X, Y + 50.0}, Plan1)),
    ?assertEqual({X, Y + 50.0}, F).

errors_say_what_to_do_test() ->
    Cases = [
        {no_robots, config([line()], 0)},
        {world_too_small, (config([line()], 4))#{world => {2000.0, 2000.0}}},
        {outside_area, config([{{100.0, 100.0}, {5000.0, 5000.0}}], 1)},
        {too_many_edges, (config([line()], 1))#{edge_length => 0.045}}
    ],
    [
        begin
            {error, Reason} = starl_dpp_plan:new(Config),
            ?assertEqual(Kind, kind(Reason)),
            ?assert(iolist_size(starl_dpp_plan:format_error(Reason)) > 20)
        end
     || {Kind, Config} <- Cases
    ].

kind(Reason) when is_tuple(Reason) -> element(1, Reason);
kind(Reason) -> Reason.

%% A robot that died on the only line keeps its reservation, and that is reported honestly.
dead_robot_makes_unreachable_test() ->
    Short = {{6000.0, 6000.0}, {6100.0, 6000.0}},
    Plan = starl_dpp_plan:standing(2, {6050.0, 6010.0}, park_all([1, 3], new([Short], 3))),
    ?assertNot(starl_dpp_assign:reachable([1, 3], Plan)),
    ?assert(starl_dpp_assign:reachable([1, 2], Plan)),
    ?assertMatch({none, _}, starl_dpp_assign:request(1, Plan)),
    ?assertMatch({[], _}, starl_dpp_assign:resolve([1, 3], Plan)).

%% A deadlock: the one that may paint is shut in by those that wait.
resolve_opens_the_way_test() ->
    Short = {{6000.0, 6000.0}, {6100.0, 6000.0}},
    Plan0 = starl_dpp_plan:standing(1, {6050.0, 6010.0}, park_all([2], new([Short], 2))),
    %% Robot 1 is dead on the line in the first test; here it only waits.
    ?assertMatch({none, _}, starl_dpp_assign:request(2, Plan0)),
    {[{1, Path}], _} = starl_dpp_assign:resolve([1, 2], Plan0),
    ?assertMatch([_ | _], Path).

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

%% A new coordinator with the same input that learns what is painted and what is held carries on.
rebuilt_plan_carries_on_test_() ->
    [{lists:concat(["seed ", Seed]), {timeout, 60, fun() -> rebuilt(Seed) end}} || Seed <- [1, 2]].

rebuilt(Seed) ->
    Segments = starl_dpp_pictures:picture(lines, Seed),
    Plan0 = parked(Segments, 3),
    {{assign, Path1}, Plan1} = starl_dpp_assign:request(1, Plan0),
    {{assign, Path2}, Plan2} = starl_dpp_assign:request(2, Plan1),
    From1 = starl_dpp_plan:spot(1, Plan0),
    From2 = starl_dpp_plan:spot(2, Plan0),
    [Done | _] = lists:reverse(pens(Path1)),
    New0 = starl_dpp_plan:mark_painted([Done], park_all([3], new(Segments, 3))),
    New1 = starl_dpp_plan:adopt(1, From1, Path1, New0),
    Held = proplists:get_value(2, starl_dpp_plan:unsafe(Plan2)),
    New2 = starl_dpp_plan:adopt(2, From2, [{Q, up} || {_, Q} <- Held], New1),
    ?assertEqual(starl_dpp_plan:unsafe(Plan2), starl_dpp_plan:unsafe(New2)),
    ?assertEqual([Done], starl_dpp_plan:painted_since(0, New2)),
    #{assigned := Assigned} = starl_dpp_plan:counts(New2),
    ?assertEqual(length(pens(Path1)) - 1, Assigned),
    {Answer, New3} = starl_dpp_assign:request(3, New2),
    starl_dpp_world:disjoint(starl_dpp_plan:unsafe(New3), New3),
    ?assertMatch({assign, _}, Answer),
    %% Held by nobody else: robot 2's line was not given away.
    {assign, Path3} = Answer,
    ?assertEqual([], [E || E <- pens(Path3), lists:member(E, pens(Path2))]),
    New4 = starl_dpp_plan:standing(2, From2, New3),
    ?assertMatch(#{assigned := _}, starl_dpp_plan:counts(New4)).

%% Robots that tell a new coordinator where they are may be some mm off the places that they held:
%% their reservations are moved apart, within the slack, and those that are apart stay.
standing_robots_are_moved_apart_test() ->
    Put = fun({Id, P}, Plan) -> starl_dpp_plan:standing(Id, P, Plan) end,
    Places = [{1, {5000.0, 5000.0}}, {2, {5000.0 + 2 * ?R - 9.0, 5000.0}}, {3, {5200.0, 5400.0}}],
    Plan = lists:foldl(Put, new([line()], 3), Places),
    ?assertError(
        {tubes_overlap, _, _, _, _, _},
        starl_dpp_world:disjoint(starl_dpp_plan:unsafe(Plan), Plan)
    ),
    Apart = starl_dpp_plan:apart(Plan),
    starl_dpp_world:disjoint(starl_dpp_plan:unsafe(Apart), Apart),
    [
        begin
            {Reserved, P} = starl_dpp_plan:stands(Id, Apart),
            ?assert(starl_geometry:distance(Reserved, P) < 15.0)
        end
     || {Id, P} <- Places
    ],
    ?assertEqual(Apart, starl_dpp_plan:apart(Apart)).

%% What was painted is known in the order in which it was told, each edge once.
painted_since_test() ->
    Tell = fun starl_dpp_plan:mark_painted/2,
    Plan = lists:foldl(Tell, new([line()], 1), [[3, 2], [2], [1], [3], [4]]),
    ?assertEqual([1, 2, 3, 4], starl_dpp_plan:painted_since(0, Plan)),
    Since = [starl_dpp_plan:painted_since(Known, Plan) || Known <- [0, 2, 3, 4]],
    ?assertEqual([[1, 2, 3, 4], [1, 4], [4], []], Since).

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

%% Who has made way aside, and stands in the way of free edges again, parks.
idle_robot_makes_way_twice_test() ->
    {ok, Plan0} = starl_dpp_plan:new(config([{{5000.0, 6000.0}, {7000.0, 6000.0}}], 2)),
    Plan1 = starl_dpp_plan:standing(2, starl_dpp_plan:spot(2, Plan0), Plan0),
    Plan2 = starl_dpp_plan:standing(1, {6000.0, 6300.0}, Plan1),
    {{assign, Aside}, Plan3} = starl_dpp_assign:make_way(1, Plan2),
    {End, up} = lists:last(Aside),
    ?assertNot(is_spot(End, Plan3)),
    Plan4 = starl_dpp_plan:standing(1, End, Plan3),
    ?assertMatch({none, _}, starl_dpp_assign:make_way(1, Plan4)),
    Plan5 = starl_dpp_plan:standing(1, {6000.0, 5700.0}, Plan4),
    {{assign, Away}, Plan6} = starl_dpp_assign:make_way(1, Plan5),
    ?assert(is_spot(element(1, lists:last(Away)), Plan6)).

is_spot(Point, Plan) ->
    lists:any(
        fun(Robot) -> starl_geometry:distance(Point, starl_dpp_plan:spot(Robot, Plan)) < 1.0 end, [
            1, 2
        ]
    ).
