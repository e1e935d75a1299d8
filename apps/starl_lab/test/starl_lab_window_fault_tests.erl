-module(starl_lab_window_fault_tests).
-include_lib("eunit/include/eunit.hrl").

where() ->
    #{from_ms => 1000, until_ms => 60000, robots => 3, machines => [app, sap], faults => []}.

fault(Command) -> starl_lab_window_fault:faults(Command, 1, where()).

command(Kind, Target) -> #{<<"kind">> => Kind, <<"target">> => Target}.

kinds_test_() ->
    [
        ?_assertEqual({ok, [Fault]}, fault(Command))
     || {Fault, Command} <- [
            {{manual_1, 1000, 1000, kill_robot, 2, #{}}, command(<<"kill_robot">>, 2)},
            {{manual_1, 1000, 60000, isolate, 3, #{}}, command(<<"isolate">>, 3)},
            {{manual_1, 1000, 3500, reboot, 3, #{}}, (command(<<"reboot">>, 3))#{
                <<"seconds">> => 2.5
            }},
            {
                {manual_1, 1000, 1000, kill_machine, {1, sap}, #{}},
                command(<<"kill_machine">>, [1, <<"sap">>])
            },
            {{manual_1, 1000, 60000, partition, [1, 3], #{}}, command(<<"partition">>, [3, 1, 1])},
            {
                {manual_1, 1000, 60000, location_swap, {1, 3}, #{}},
                command(<<"location_swap">>, [1, 3])
            },
            {{manual_1, 1000, 60000, wheel_stuck, 1, #{wheel => left}}, (command(
                <<"wheel_stuck">>, 1
            ))#{
                <<"params">> => #{<<"wheel">> => <<"left">>}
            }}
        ]
    ].

%% Both ways, and each fault has a name of its own.
cut_test() ->
    ?assertMatch(
        {ok, [
            {manual_1, _, _, loss, {1, 2}, #{part := 1.0}},
            {manual_1_back, _, _, loss, {2, 1}, #{part := 1.0}}
        ]},
        fault(command(<<"cut">>, [1, 2]))
    ).

%% A name that the scenario has is not taken again, and no word of the page becomes an atom.
names_test() ->
    Taken = (where())#{faults => [{manual_1, 0, 1, isolate, 1, #{}}]},
    ?assertMatch(
        {ok, [{manual_2, _, _, _, _, _}]},
        starl_lab_window_fault:faults(command(<<"isolate">>, 1), 1, Taken)
    ),
    _ = fault(command(<<"a_kind_that_nobody_has_written">>, 1)),
    ?assertError(badarg, binary_to_existing_atom(<<"a_kind_that_nobody_has_", "written">>)).

%% A refusal tells what the field takes, for a target of each kind.
possible_targets_test_() ->
    [
        ?_assertMatch({Kind, {match, _}}, {Kind, re:run(refusal(command(Kind, 99)), Possible)})
     || {Kind, Possible} <- [
            {<<"loss">>, "a robot from 1 to 3, a link as 1,2, or all$"},
            {<<"kill_robot">>, "a robot from 1 to 3$"},
            {<<"location_frozen">>, "a robot from 1 to 3, or all$"},
            {<<"kill_machine">>, "a machine as 1 sap$"},
            {<<"location_swap">>, "two robots as 1,2$"},
            {<<"partition">>, "robots from 1 to 3 as 1,2,3$"}
        ]
    ].

refusal(Command) ->
    {error, Why} = fault(Command),
    unicode:characters_to_list(Why).

refused_test_() ->
    [
        ?_assertMatch({error, _}, fault(Command))
     || Command <- [
            #{},
            command(<<"kill_robot">>, 4),
            command(<<"clock_freeze">>, 1),
            command(<<"cut">>, [1, 1]),
            command(<<"loss">>, 1),
            (command(<<"loss">>, 1))#{<<"params">> => #{<<"part">> => 1.5}},
            command(<<"kill_machine">>, [1, <<"none">>]),
            command(<<"partition">>, [])
        ]
    ].

limit_test() ->
    ?assertMatch(
        {error, _}, starl_lab_window_fault:faults(command(<<"isolate">>, 1), 1001, where())
    ).

healed_test() ->
    Lasts = {a, 0, 9000, isolate, 1, #{}},
    Over = {b, 0, 500, isolate, 1, #{}},
    Later = {c, 5000, 9000, isolate, 1, #{}},
    Clock = {d, 0, 9000, clock_freeze, 1, #{}},
    All = [Lasts, Over, Later, Clock],
    Healed = [setelement(3, Lasts, 1000), Over, Later, Clock],
    ?assertEqual({ok, Healed}, starl_lab_window_fault:healed(<<"a">>, 1000, All)),
    ?assertEqual({ok, Healed}, starl_lab_window_fault:healed(<<"all">>, 1000, All)),
    ?assertMatch({error, _}, starl_lab_window_fault:healed(<<"b">>, 1000, All)),
    ?assertMatch({error, _}, starl_lab_window_fault:healed(<<"c">>, 1000, All)).
