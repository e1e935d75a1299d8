-module(starl_run_condition_tests).
-include_lib("eunit/include/eunit.hrl").

kinds() -> [Kind || {Kind, _, _, _, _} <- starl_run_fault:kinds()].

each_kind_names_known_conditions_test() ->
    Known = [Condition || {Condition, _} <- starl_guarantee:conditions()],
    [?assertEqual([], starl_run_condition:broken(Kind) -- Known) || Kind <- kinds()].

each_condition_is_broken_by_some_kind_test() ->
    [
        ?assertNotEqual([], starl_run_condition:breakers(Condition, kinds()))
     || {Condition, _} <- starl_guarantee:conditions()
    ].

%% The monitors excuse what happens in the windows in which a fault breaks an assumption. Such a fault must
%% break a condition of the same matter, or a guarantee that nobody judges would be said to hold; and the
%% other way round.
what_monitors_excuse_is_a_broken_condition_test_() ->
    [
        {atom_to_list(Kind), fun() ->
            Excused = lists:usort([
                matter(Broken)
             || Fault <- faults(Kind),
                {_, _, _, Broken} <- starl_run_assumption:broken([Fault], true)
            ]),
            Named = lists:usort([
                Matter
             || Condition <- starl_run_condition:broken(Kind), Matter <- matters(Condition)
            ]),
            ?assertEqual(Excused, Named)
        end}
     || Kind <- kinds(), Kind =/= location_noise, Kind =/= location_bias
    ].

matter({clock, _}) -> clock;
matter(pause) -> prompt;
matter(still) -> prompt;
matter({slow, _}) -> prompt;
matter(position) -> position.

matters(clock_rate) -> [clock];
matters(clock_set) -> [clock];
matters(prompt) -> [prompt];
matters(positions) -> [position];
matters(_) -> [].

%% Faults of a kind with large parameters.
faults(Kind) ->
    {_, _, Shape, Params, _} = lists:keyfind(Kind, 1, starl_run_fault:kinds()),
    Values = maps:from_list([{Key, large(Key, Type)} || {Key, Type, _} <- Params]),
    [{f, 1000, 9000, Kind, target(Shape), Values}].

large(_Key, {one_of, [First | _]}) -> First;
large(_Key, {_, _, High}) -> High.

target(robots) -> all;
target(floor) -> all;
target(robot) -> 1;
target(machine) -> {1, sap};
target(link) -> all;
target(group) -> [1];
target(two) -> {1, 2}.
