%% Timers as machines know them: one of a name at a time, and none that was cancelled.
-module(starl_robot_timers_tests).
-include_lib("eunit/include/eunit.hrl").

%% A timer expires once, by the number of its event.
expires_once_test() ->
    Running = starl_robot_timers:start(sap, retry, 7, starl_robot_timers:new()),
    {ok, Left} = starl_robot_timers:expire(sap, retry, 7, Running),
    ?assertEqual(stale, starl_robot_timers:expire(sap, retry, 7, Left)).

%% Started anew, only its latest event counts, and cancelled none.
started_anew_and_cancelled_test() ->
    Twice = starl_robot_timers:start(
        a, t, 2, starl_robot_timers:start(a, t, 1, starl_robot_timers:new())
    ),
    ?assertEqual(stale, starl_robot_timers:expire(a, t, 1, Twice)),
    ?assertMatch({ok, _}, starl_robot_timers:expire(a, t, 2, Twice)),
    ?assertEqual(stale, starl_robot_timers:expire(a, t, 2, starl_robot_timers:cancel(a, t, Twice))),
    ?assertEqual(Twice, starl_robot_timers:cancel(a, other, Twice)).

%% Timers of one name belong to their machines; those of a crashed one are forgotten.
machines_have_their_own_test() ->
    Start = fun(Machine, Timers) -> starl_robot_timers:start(Machine, t, 1, Timers) end,
    Both = starl_robot_timers:forget(a, lists:foldl(Start, starl_robot_timers:new(), [a, b])),
    ?assertEqual(stale, starl_robot_timers:expire(a, t, 1, Both)),
    ?assertMatch({ok, _}, starl_robot_timers:expire(b, t, 1, Both)).

%% Whatever happens to one timer, the others run on; a timer that was never started is not known.
others_run_on_test() ->
    Keys = [{a, t}, {a, u}, {b, t}],
    New = starl_robot_timers:new(),
    ?assertEqual(
        [stale, stale, stale], [
            starl_robot_timers:expire(Machine, T, 0, New)
         || {Machine, T} <- Keys
        ]
    ),
    Start = fun({Machine, T}, Timers) -> starl_robot_timers:start(Machine, T, 1, Timers) end,
    All = lists:foldl(Start, New, Keys),
    {ok, Expired} = starl_robot_timers:expire(a, t, 1, All),
    [
        ?assertMatch({ok, _}, starl_robot_timers:expire(Machine, T, 1, Timers))
     || Timers <- [Expired, starl_robot_timers:cancel(a, t, All)], {Machine, T} <- [{a, u}, {b, t}]
    ].

%% A machine hears of them in gen_statem's words.
told_as_gen_statem_does_test() ->
    ?assertEqual(state_timeout, starl_robot_timers:event_type(state_timeout)),
    ?assertEqual({timeout, {retransmit, 3}}, starl_robot_timers:event_type({retransmit, 3})).
