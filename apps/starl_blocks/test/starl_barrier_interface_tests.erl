%% What the barrier's interface asks its machine, and what it makes of the answers.
-module(starl_barrier_interface_tests).
-include_lib("eunit/include/eunit.hrl").

-import(starl_blocks_driver, [play/2]).

%% Which round is next: with half a minute's patience, or so much.
round_test() ->
    Round = fun(R) -> starl_barrier:round(R, gate) end,
    Asked = {barrier, {round, gate}, 30000000},
    ?assertEqual({[Asked], {ok, 3}}, play(Round, [{answer, {3, 2}}])),
    ?assertEqual({[Asked], {error, timeout}}, play(Round, [timeout])),
    ?assertEqual({[Asked], {error, restarted}}, play(Round, [restarted])),
    ?assertEqual(
        {[{barrier, {round, gate}, 7000}], {ok, 3}},
        play(fun(R) -> starl_barrier:round(R, gate, 7) end, [{answer, {3, 2}}])
    ).

%% It waits for the round that is next; the machine knows how long.
sync_test() ->
    Sync = fun(R) -> starl_barrier:sync(R, gate) end,
    Asked = [
        {barrier, {round, gate}, 30000000}, {barrier, {sync, gate, {3, 2}, 30000000}, infinity}
    ],
    [
        ?assertEqual({Asked, Answer}, play(Sync, [{answer, {3, 2}}, {answer, Answer}]))
     || Answer <- [ok, {error, timeout}]
    ],
    ?assertEqual({[hd(Asked)], {error, timeout}}, play(Sync, [timeout])),
    ?assertEqual(
        {[{barrier, {round, gate}, 7000}, {barrier, {sync, gate, {3, 2}, 7000}, infinity}], ok},
        play(fun(R) -> starl_barrier:sync(R, gate, 7) end, [{answer, {3, 2}}, {answer, ok}])
    ).

%% The timeout is that of the whole call: what has passed until the round was known is gone.
timeout_of_the_whole_call_test() ->
    Sync = fun(R) -> starl_barrier:sync(R, gate, 7000) end,
    Waited = fun(Us) -> [{at, Us, {answer, {3, 2}}}, {answer, {error, timeout}}] end,
    Asked = fun(Us) ->
        [{barrier, {round, gate}, 7000000}, {barrier, {sync, gate, {3, 2}, Us}, infinity}]
    end,
    [
        ?assertEqual({Asked(Left), {error, timeout}}, play(Sync, Waited(Us)))
     || {Us, Left} <- [
            {0, 7000000}, {5000000, 2000000}, {6999000, 1000}, {7000000, 0}, {9000000, 0}
        ]
    ].

%% A new machine is told which round was not passed, as often as need be: a round that was passed
%% just before the crash is not taken for this one.
restarted_test() ->
    Resume = {barrier, {resume, gate, {3, 2}}, infinity},
    {Asked, Answer} = play(
        fun(R) -> starl_barrier:sync(R, gate) end,
        [{answer, {3, 2}}, restarted, restarted, {answer, ok}]
    ),
    ?assertEqual({error, restarted}, Answer),
    ?assertEqual([Resume, Resume], lists:nthtail(2, Asked)).

%% The mistake in a call is told with the function that was called.
mistake_test() ->
    Robot = starl:robot(1, [1, 2]),
    ?assertError(
        {bad_argument, #{function := {starl_barrier, sync, 3}, argument := 'Ms', given := 0}},
        starl_barrier:sync(Robot, gate, 0)
    ).

blocks_test() ->
    ?assertEqual([{barrier, starl_barrier_rounds, #{}}], starl_barrier:machines(#{})),
    Options = #{retry_ms => 7},
    ?assertEqual([{barrier, starl_barrier_rounds, Options}], starl_barrier:machines(Options)).
