%% @doc The conditions that faults break ({@link starl_guarantee}): what a team in which such a fault may
%% happen can rely on no more, as long as it lasts.
-module(starl_run_condition).

-export([broken/1, breakers/2]).

%% @doc The conditions that a kind of fault may break, whatever its parameters.
-spec broken(starl_run_fault:kind()) -> [starl_guarantee:condition()].
broken(loss) -> [no_loss];
broken(burst_loss) -> [no_loss];
broken(drop) -> [no_loss];
broken(corrupt) -> [no_loss];
broken(duplicate) -> [];
broken(reorder) -> [quick];
broken(delay) -> [quick];
broken(babble) -> [];
broken(partition) -> [delivery, no_loss];
broken(one_way_partition) -> [delivery, no_loss];
broken(isolate) -> [delivery, no_loss];
broken(ring) -> [delivery, no_loss];
broken(range) -> [delivery, no_loss];
broken(clock_offset) -> [clock_set, clock_jump, clock_forward, clock_near, quick];
broken(clock_step) -> [clock_set, clock_jump, clock_forward, clock_near, quick];
broken(clock_drift) -> [clock_rate, clock_near];
broken(clock_freeze) -> [clock_rate, clock_near, quick];
broken(kill_machine) -> [no_restart];
broken(kill_robot) -> [alive, no_loss];
broken(reboot) -> [no_restart, no_loss];
broken(pause) -> [prompt, quick];
broken(stand_still) -> [prompt, quick];
broken(slow) -> [prompt, quick];
broken(location_dropout) -> [];
broken(location_frozen) -> [positions];
broken(location_noise) -> [positions];
broken(location_bias) -> [positions];
broken(location_swap) -> [positions];
broken(wheel_stuck) -> [devices];
broken(wheel_slow) -> [devices];
broken(command_lost) -> [devices];
broken(slip) -> [grip];
broken(actuator_lost) -> [devices];
broken(actuator_stuck) -> [devices];
broken(serial_garbage) -> [devices];
broken(serial_split) -> [devices];
broken(serial_gone) -> [devices];
broken(store_full) -> [store, no_restart];
broken(store_damaged) -> [store];
broken(store_lost) -> [store, no_restart, no_loss];
broken(store_set_back) -> [store, no_restart, no_loss];
broken(sense_gone) -> [senses];
broken(sense_frozen) -> [senses];
broken(sense_noisy) -> [senses];
broken(sense_wrong) -> [senses];
broken(closed) -> [ways];
broken(obstacle) -> [ways].

%% @doc Those of the kinds that break a condition.
-spec breakers(starl_guarantee:condition(), [starl_run_fault:kind()]) -> [starl_run_fault:kind()].
breakers(Condition, Kinds) -> [Kind || Kind <- Kinds, lists:member(Condition, broken(Kind))].
