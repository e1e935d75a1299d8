%% @doc The conditions that faults break ({@link starl_guarantee}): what a team in which such a fault may
%% happen can rely on no more, as long as it lasts.
-module(starl_run_condition).

-export([broken/1, breakers/2]).

%% @doc The conditions that a kind of fault may break, whatever its parameters.
-spec broken(starl_run_fault:kind()) -> [starl_guarantee:condition()].
broken(Kind) ->
    [Conditions] = [Broken || {Broken, Kinds} <- table(), lists:member(Kind, Kinds)],
    Conditions.

table() ->
    [
        {[], [duplicate, babble, location_dropout]},
        {[no_loss], [loss, burst_loss, drop, corrupt]},
        {[quick], [reorder, delay]},
        {[delivery, no_loss], [partition, one_way_partition, isolate, ring, range]},
        {[clock_set, clock_jump, clock_forward, clock_near, quick], [clock_offset, clock_step]},
        {[clock_rate, clock_near], [clock_drift]},
        {[clock_rate, clock_near, quick], [clock_freeze]},
        {[no_restart], [kill_machine]},
        {[alive, no_loss], [kill_robot]},
        {[no_restart, no_loss], [reboot]},
        {[prompt, quick], [pause, stand_still, slow]},
        {[positions], [location_frozen, location_noise, location_bias, location_swap]},
        {[devices], [wheel_stuck, wheel_slow, command_lost, actuator_lost, actuator_stuck]},
        {[devices], [serial_garbage, serial_split, serial_gone]},
        {[grip], [slip]},
        {[store, no_restart], [store_full]},
        {[store], [store_damaged]},
        {[store, no_restart, no_loss], [store_lost, store_set_back]},
        {[senses], [sense_gone, sense_frozen, sense_noisy, sense_wrong]},
        {[ways], [closed, obstacle]}
    ].

%% @doc Those of the kinds that break a condition.
-spec breakers(starl_guarantee:condition(), [starl_run_fault:kind()]) -> [starl_run_fault:kind()].
breakers(Condition, Kinds) -> [Kind || Kind <- Kinds, lists:member(Condition, broken(Kind))].
