%% The promises of blocks on a radio that is slow, or loses packets all the time: they are bound by what
%% the radio does, neither broken by it nor switched off.
-module(starl_exercise_radio_tests).
-include_lib("eunit/include/eunit.hrl").

slow_test_() ->
    [
        {
            atom_to_list(Block),
            {timeout, 120, fun() ->
                ?assertEqual([], played(Block, #{delay => {1000, 6000}}))
            end}
        }
     || Block <- starl_block_catalogue:able(exercise)
    ].

a_little_loss_breaks_no_promise_test_() ->
    [
        {
            atom_to_list(Block),
            {timeout, 120, fun() ->
                ?assertEqual([], played(Block, #{loss => 0.01, delay => {5, 200}}))
            end}
        }
     || Block <- starl_block_catalogue:able(exercise)
    ].

%% Promises hold from the end of all faults on, also if the radio loses some packets at all times.
a_little_loss_switches_no_promise_off_test() ->
    Healed = fun(Block, Loss) ->
        {ok, {_, _, #{monitors := Monitors}}} = starl_sim:plan(
            #{app => starl_exercise, block => Block, loss => Loss}, #{}
        ),
        [
            {Block, Monitor, maps:get(healed_us, Config)}
         || {Monitor, Config} <- Monitors,
            is_map_key(healed_us, Config),
            Monitor =/= starl_geocast_monitor
        ]
    end,
    [
        ?assertEqual(Healed(Block, 0.0), Healed(Block, 0.01))
     || Block <- starl_block_catalogue:able(exercise)
    ],
    %% what SAP gives up and nobody sends again is not promised
    ?assertMatch([{sap, _, never}], Healed(sap, 0.4)),
    ?assertMatch([{barrier, _, 0}], Healed(barrier, 0.4)).

played(Block, Radio) ->
    Given = #{
        app => starl_exercise, block => Block, robots => 4, seed => 3, final => 2, work => 10
    },
    {ok, Sim} = starl_sim:start(maps:merge(Given, Radio)),
    _ = starl_sim:run(Sim),
    {#{violations := Violations}, _} = starl_sim:finish(Sim),
    Violations.
