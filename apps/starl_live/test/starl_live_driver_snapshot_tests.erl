%% What a live robot tells so that its run can be gone on with: snapshots, and after each all that comes.
-module(starl_live_driver_snapshot_tests).
-include_lib("eunit/include/eunit.hrl").

-import(starl_live_driver_ct, [with_driver/2, sent/0, does/2]).

-define(SCRIPT, {starl_chassis_holonomic, [{100.0, 0.0, 1000}]}).

%% From the first snapshot on all that comes is told, too. A snapshot has what the machines stored, the last
%% script, and the timers that still run; one that failed is followed by no inputs.
what_comes_after_a_snapshot_is_told_test() ->
    with_driver(#{snapshots_us => 1000}, fun(Driver0, _) ->
        ?assertMatch(#{snapshots := true}, starl_live_driver:base(sap, 1, Driver0)),
        {ok, Driver1} = starl_live_driver:store(app, kept, Driver0),
        {_, [], Driver2} = does([{drive, ?SCRIPT, 5}], starl_live_driver:input(acts, Driver1)),
        {0, Driver3} = starl_live_driver:plan(app, gone, 10, x, Driver2),
        {1, Driver} = starl_live_driver:plan(app, wake, 20, hello, Driver3),
        [{timer, _, _}, {timer, _, _}] = sent(),
        Parts = #{timers => [{app, wake, 1}]},
        {[], Told} = starl_live_driver:flush(
            starl_live_driver:snapshot({ok, {machines, Parts}}, Driver)
        ),
        [{starl_traced, 1, _, {_, 0, [{0, 1, snapshot, {ok, Bytes}}]}}] = sent(),
        {ok, {live, Snapshot}} = starl_snapshot:of_term(binary_to_term(Bytes)),
        ?assertEqual(
            #{
                at_us => 0,
                machines => machines,
                parts => Parts,
                dues => #{1 => {20, app, wake, hello}},
                marks => 2,
                stored => #{app => kept},
                script => {0, ?SCRIPT, {app, 5}},
                result => running
            },
            Snapshot
        ),
        Inputs = fun(B) ->
            {[], _} = starl_live_driver:flush(starl_live_driver:input(acts, B)),
            [
                Input
             || {starl_traced, 1, _, {_, _, Facts}} <- sent(), {0, 1, snapshot, Input} <- Facts
            ]
        end,
        ?assertEqual([{input, {0, acts}}], Inputs(Told)),
        {[], Failed} = starl_live_driver:flush(starl_live_driver:snapshot({error, at_work}, Told)),
        ?assertMatch([{starl_traced, 1, _, {_, 0, [{0, 1, snapshot, {error, at_work}}]}}], sent()),
        ?assertEqual([], Inputs(Failed)),
        ok
    end),
    with_driver(#{}, fun(Driver, _) ->
        ?assertMatch(#{snapshots := false}, starl_live_driver:base(sap, 1, Driver)),
        ?assertEqual(Driver, starl_live_driver:input(acts, Driver)),
        ok
    end).

%% What a simulation needs of a step: a machine that starts is something else; others have handled an event.
a_step_is_an_input_test() ->
    with_driver(#{snapshots_us => 1000}, fun(Driver, _) ->
        Kept = starl_live_driver:snapshot({ok, {machines, #{timers => []}}}, Driver),
        {[], Told} = starl_live_driver:flush(Kept),
        _ = sent(),
        Inputs = fun(Name, Type, Content) ->
            Next = starl_live_driver:handles(Name, Type, Content, Told),
            {[], _} = starl_live_driver:flush(Next),
            [{starl_traced, 1, _, {_, _, Facts}}] = sent(),
            [Input || {0, 1, snapshot, {input, {0, Input}}} <- Facts]
        end,
        ?assertEqual([{other, boot}], Inputs(app, boot, x)),
        ?assertEqual([now], Inputs(app, info, {sensed, bump})),
        ?assertEqual([now], Inputs(sap, packet, x)),
        ok
    end).
