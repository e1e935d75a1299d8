%% What is checked of path planning: the service that stands for the planner, what the checker is
%% told, and its monitor by traces that keep the contract and traces that do not.
-module(starl_dpp_model_monitor_tests).
-include_lib("eunit/include/eunit.hrl").

-define(M, starl_dpp_model_monitor).
-define(V, starl_dpp_model_service).
-define(TERM, {1, 2, 1}).

%% -- the monitor ----------------------------------------------------------------------------

new() -> ?M:init(#{tube_radius => 200.0, r_s => 330.0}).

%% What is found in these events of robot 3's coordinator.
found(Events) ->
    {Found, _} = lists:foldl(
        fun(Event, {Acc, State}) ->
            case ?M:step({7, 3, dpp_coordinator, Event}, State) of
                {ok, Next} -> {Acc, Next};
                {violation, #{contract := dpp} = V, Next} -> {Acc ++ [V], Next}
            end
        end,
        {[], new()},
        Events
    ),
    [
        {What, Robots, Details}
     || #{what := What, at_us := 7, robots := Robots, details := Details} <- Found
    ].

%% Who acts does so in the latest term that was won, or later.
acts_test() ->
    ?assertEqual([], found([{acts, ?TERM}, {leads, ?TERM}, {acts, ?TERM}, {acts, {1, 3, 1}}])),
    ?assertEqual(
        [{two_coordinators, [2, 3], #{term => ?TERM}}], found([{leads, ?TERM}, {acts, {1, 1, 1}}])
    ),
    ?assertEqual(
        [{two_coordinators, [3], #{term => {1, 3, 1}}}], found([{leads, {1, 3, 1}}, {acts, ?TERM}])
    ).

%% Terms are won in their order, each once.
leads_test() ->
    ?assertEqual([], found([{leads, ?TERM}, {leads, {1, 3, 1}}])),
    ?assertEqual(
        [{term_goes_back, [2, 3], #{term => ?TERM}}], found([{leads, ?TERM}, {leads, ?TERM}])
    ),
    ?assertEqual(
        [{term_goes_back, [2, 3], #{term => ?TERM}}], found([{leads, ?TERM}, {leads, {1, 1, 9}}])
    ),
    %% what is refused changes nothing
    ?assertMatch([_, _], found([{leads, ?TERM}, {leads, {1, 1, 9}}, {leads, ?TERM}])).

%% All else is path planning's own contract.
planning_test() ->
    Holds = fun(Robot, X) -> {reserved, Robot, [{{X, 0.0}, {X, 0.0}}]} end,
    ?assertEqual([], found([Holds(1, 0.0), Holds(2, 400.0)])),
    Crossed = [Holds(1, 0.0), Holds(2, 300.0)],
    ?assertMatch([_], found(Crossed)),
    %% what broke it is held from then on, and acts are nothing to it
    ?assertMatch([_, _], found(Crossed ++ [Holds(3, 600.0)])),
    ?assertEqual([], found([{leads, ?TERM}, {acts, ?TERM}, Holds(1, 0.0)])),
    ?assertMatch({ok, _}, ?M:finish(9, new())).

%% It takes what path planning's own takes, and `acts'.
vocabulary_test() ->
    Own = starl_dpp_monitor:vocabulary(),
    Told = ?M:vocabulary(),
    ?assertEqual(
        [{acts, 1}], maps:get(dpp_coordinator, Told) -- maps:get(dpp_coordinator, Own)
    ),
    ?assertEqual(maps:remove(dpp_coordinator, Own), maps:remove(dpp_coordinator, Told)),
    ?assertEqual(starl_dpp_monitor:interests(), ?M:interests()).

%% States that differ in the term that was won last are two.
timeless_test() ->
    {ok, Led} = ?M:step({7, 2, dpp_coordinator, {leads, ?TERM}}, new()),
    ?assertNotEqual(?M:timeless(new()), ?M:timeless(Led)),
    ?assertEqual(?TERM, element(2, ?M:timeless(Led))).

%% -- the service ----------------------------------------------------------------------------

service() -> ?V:new(?V:prepare(#{robots => [1, 2]}), ?TERM).

reported(Robot, S) -> ?V:reported(Robot, {1, 0}, {{standing, {0.0, 0.0}}, []}, S).

requested(Robot, N, S) -> ?V:requested(Robot, {1, N}, {{0.0, 0.0}, []}, S).

%% It leads, and both robots are known.
open() ->
    {S1, _} = ?V:lead(service()),
    {S2, []} = reported(1, S1),
    {S3, _} = reported(2, S2),
    S3.

complete(Robot, N) ->
    starl_sap:send(Robot, dpp_answer, {?TERM, {1, N}, complete, []}, {answered, ?TERM, Robot}).

%% A robot is known by whatever it says, or by being seen to stand.
known_test() ->
    ?assertEqual([1, 2], ?V:unknown(service())),
    {S1, []} = reported(2, service()),
    ?assertEqual({[1], false, true}, {?V:unknown(S1), ?V:knows(1, S1), ?V:knows(2, S1)}),
    {S2, []} = requested(1, 1, S1),
    ?assertEqual([], ?V:unknown(S2)),
    {S3, Actions} = ?V:rests(1, {0.0, 0.0}, S1),
    ?assertEqual({[], [{trace, {silent, 1}}]}, {?V:unknown(S3), Actions}),
    ?assertEqual({true, false}, {?V:silent(1, S3), ?V:silent(2, S3)}),
    {S4, []} = reported(1, S3),
    ?assertNot(?V:silent(1, S4)),
    {Twice, _} = ?V:rests(1, {0.0, 0.0}, S3),
    {Back, []} = requested(1, 1, Twice),
    ?assertNot(?V:silent(1, Back)).

%% It is open once it leads and all are known, whichever comes last.
open_test() ->
    {Led, Actions} = ?V:lead(service()),
    ?assertEqual([{{timeout, serve}, 0, serve}], Actions),
    {One, []} = reported(1, Led),
    {Both, Opened} = reported(2, One),
    ?assertEqual([{trace, {coordinator, ?TERM}}], Opened),
    ?assertMatch({Both, []}, reported(2, Both)),
    {A, []} = reported(1, service()),
    {B, []} = reported(2, A),
    ?assertEqual(
        {Both, [{trace, {coordinator, ?TERM}}, {{timeout, serve}, 0, serve}]}, ?V:lead(B)
    ),
    {_, Seen} = ?V:rests(2, {0.0, 0.0}, One),
    ?assertEqual([{trace, {silent, 2}}, {trace, {coordinator, ?TERM}}], Seen).

%% Whoever asks is told that there is nothing to do, once all are known; the latest request counts.
answers_test() ->
    ?assertMatch({_, []}, requested(1, 1, service())),
    {_, Now} = requested(1, 1, open()),
    ?assertEqual([complete(1, 1)], Now),
    {S1, _} = ?V:lead(service()),
    {S2, []} = requested(1, 1, S1),
    {S3, []} = requested(1, 2, S2),
    {S4, Both} = requested(2, 1, S3),
    ?assertEqual([{trace, {coordinator, ?TERM}}, complete(1, 2), complete(2, 1)], Both),
    ?assertEqual({S4, []}, reported(1, S4)).

%% What is reported last opens it, and answers those who wait.
report_answers_test() ->
    {S1, _} = ?V:lead(service()),
    {S2, []} = requested(1, 3, S1),
    {_, Actions} = reported(2, S2),
    ?assertEqual([{trace, {coordinator, ?TERM}}, complete(1, 3)], Actions).

%% Who is silent waits no longer.
silent_test() ->
    {S1, _} = ?V:lead(service()),
    {S2, []} = requested(1, 1, S1),
    {S3, _} = ?V:rests(1, {0.0, 0.0}, S2),
    ?assertMatch({_, [{trace, {coordinator, ?TERM}}]}, reported(2, S3)).

%% It acts at every moment, and assigns once all are known.
serve_test() ->
    Again = {{timeout, serve}, 0, serve},
    ?assertEqual({service(), [{trace, {acts, ?TERM}}, Again]}, ?V:serve(service())),
    S = open(),
    Place = {2000.0, 0.0},
    ?assertEqual(
        {S, [{trace, {acts, ?TERM}}, {trace, {assigned, 2, {1, 1}, [{Place, Place}]}}, Again]},
        ?V:serve(S)
    ).

%% What else a coordinator asks of it changes nothing.
nothing_else_test() ->
    S = open(),
    ?assertEqual(
        [{S, []}, {S, []}, S, S],
        [?V:passed(1, {1, 1}, 1, S), ?V:give_up(S), ?V:answered(1, ok, S), ?V:answered(1, lost, S)]
    ).

%% -- what the checker is told ---------------------------------------------------------------

%% The last robot is named first, its clock is the slow one; terms above the bound are beyond.
model_test() ->
    #{
        rates := Rates,
        script := Script,
        fixed := Fixed,
        beyond := Beyond,
        blocks := Blocks,
        monitor := {?M, _},
        horizon_us := Horizon,
        past_us := Past
    } = starl_dpp:model(#{robots => [4, 5, 9], terms => 2}),
    ?assertEqual({{1010000, 1010000, 990000}, [1, 2, 3]}, {Rates, Fixed}),
    ?assertEqual([{start, dpp, {join, 9}, {join, 4}}], Script(4)),
    Claims = fun(N) -> Beyond({0, 1, dpp_coordinator, {claims, {N, 1, 1}}}) end,
    ?assertEqual([false, false, true], [Claims(N) || N <- [1, 2, 3]]),
    ?assertNot(Beyond({0, 1, dpp_coordinator, {leads, {3, 1, 1}}})),
    {_, starl_dpp_coordinator, #{serve := ?V, lease_ms := Ms, jump_ms := 0} = Config} =
        lists:keyfind(dpp_coordinator, 1, Blocks),
    {_, starl_dpp_participant, Part} = lists:keyfind(dpp, 1, Blocks),
    ?assertEqual(Part, maps:remove(serve, Config)),
    ?assertEqual({4000, 4000001, 4000001}, {Ms, Horizon, Past}).

%% What may happen in a search: all that the two machines wait for, and crashes of both; a robot
%% that stands, and acts, in the place of each. Lengths are such that neighbours are a metre apart.
happenings_test() ->
    Model = starl_dpp:model(#{robots => [1, 2], terms => 2}),
    ?assertEqual(
        #{
            timed => [again, beat, claim, leave, look, missing, recover],
            steps => [serve],
            crash => [dpp, dpp_coordinator],
            stands => [location, motion],
            grain => 1
        },
        maps:map(
            fun
                (_, What) when is_list(What) -> lists:sort(What);
                (_, What) -> What
            end,
            maps:with([timed, steps, crash, stands, grain], Model)
        )
    ),
    {?M, #{tube_radius := R, r_s := Apart}} = maps:get(monitor, Model),
    ?assertEqual({200.0, 330.0}, {R, Apart}).
