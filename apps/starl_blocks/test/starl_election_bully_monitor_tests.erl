%% The contract of the bully election, clause by clause.
-module(starl_election_bully_monitor_tests).
-include_lib("eunit/include/eunit.hrl").

judge(Events) -> judge(Events, false).

judge(Events, Lossless) ->
    Config = #{robots => [1, 2, 3], bound_us => 1000, lossless => Lossless},
    M0 = starl_monitor:new([{starl_election_bully_monitor, Config}]),
    {Found, M} = lists:foldl(
        fun({T, Robot, What}, {Acc, Monitor}) ->
            Machine =
                case What of
                    {died, _} -> robot;
                    _ -> election
                end,
            case starl_monitor:step({T, Robot, Machine, What}, Monitor) of
                {ok, Next} -> {Acc, Next};
                {violation, V, Next} -> {Acc ++ [V], Next}
            end
        end,
        {[], M0},
        Events
    ),
    {Late, _} = starl_monitor:finish(9000, M),
    [What || #{what := What} <- Found ++ Late].

%% When each was broken, by which robots, and in which election; and the results.
in_full(Events, Lossless) -> in_full(Events, Lossless, 9000).

in_full(Events, Lossless, End) ->
    Config = #{robots => [1, 2, 3], bound_us => 1000, lossless => Lossless},
    M0 = starl_monitor:new([{starl_election_bully_monitor, Config}]),
    {Found, M} = lists:foldl(
        fun({T, Robot, What}, {Acc, Monitor}) ->
            Machine =
                case What of
                    {died, _} -> robot;
                    _ -> election
                end,
            case starl_monitor:step({T, Robot, Machine, What}, Monitor) of
                {ok, Next} -> {Acc, Next};
                {violation, V, Next} -> {Acc ++ [V], Next}
            end
        end,
        {[], M0},
        Events
    ),
    {Late, #{starl_election_bully_monitor := Results}} = starl_monitor:finish(End, M),
    {
        [
            {What, T, R}
         || #{
                contract := election,
                what := What,
                at_us := T,
                robots := R,
                details := #{election := e}
            } <- Found ++ Late
        ],
        maps:remove(sometimes, Results)
    }.

two_leaders_at_one_robot_are_told_test() ->
    Told = fun(Events, Lossless) -> element(1, in_full(Events, Lossless)) end,
    ?assertEqual(
        [{two_leaders_at_one_robot, 3, [1]}],
        Told([elected(2, 1, 3, announcement), elected(3, 1, 2, announcement)], false)
    ),
    ?assertEqual(
        [{no_result, 1001, [1]}, {no_result, 1002, [2]}],
        Told([entered(1, 1), entered(2, 2)], false)
    ),
    ?assertEqual(
        [{no_result, 1001, [2]}, {no_result, 1002, [1]}],
        Told([entered(1, 2), entered(2, 1)], false)
    ),
    ?assertEqual(
        [{failed_without_loss, 9, [1]}],
        Told([entered(1, 1), {9, 1, {failed, e, timeout}}], true)
    ),
    ?assertEqual([{not_a_robot, 2, [1]}], Told([elected(2, 1, 7, announcement)], false)),
    ?assertEqual([{not_itself, 2, [1]}], Told([elected(2, 1, 2, highest)], false)),
    ?assertEqual([{not_the_highest, 2, [1, 2, 3]}], Told([elected(2, 1, 1, highest)], true)),
    ?assertEqual(
        [{dead_leader, 2, [2]}],
        Told([{1, 3, {died, k}}, elected(2, 2, 3, announcement)], true)
    ),
    ?assertEqual(
        [{different_leaders, 4, [1]}],
        Told(
            [
                entered(1, 1),
                elected(2, 2, 3, known),
                {3, 3, crashed},
                elected(4, 1, 2, known)
            ],
            true
        )
    ).

results_count_elections_test() ->
    ?assertEqual(
        {[], #{elections => 0, elected => 0, failed => 0, leaders => []}},
        in_full([], false)
    ),
    Events = [
        entered(1, 1),
        entered(1, 2),
        elected(2, 1, 3, known),
        elected(3, 1, 3, known),
        {4, 2, {failed, e, timeout}},
        {5, 3, {failed, e, timeout}},
        elected(6, 3, 2, known),
        {7, 3, {elected, f, 1, known}}
    ],
    ?assertEqual(
        {[], #{
            elections => 2,
            elected => 3,
            failed => 2,
            leaders => [{e, [2, 3]}, {f, [1]}]
        }},
        in_full(Events, false)
    ).

%% Elections come in their order, however many there are.
elections_come_in_their_order_test() ->
    Many = lists:seq(1, 40),
    {_, #{leaders := Leaders}} = in_full([{1, 1, {elected, E, 1, known}} || E <- Many], false),
    ?assertEqual([{E, [1]} || E <- Many], Leaders).

%% At the bound it is in time; a robot that is the highest from the beginning on counts, one whose
%% machine crashed when it began or later does not.
a_result_at_the_bound_is_in_time_test() ->
    ?assertMatch({[], _}, in_full([entered(1, 1)], false, 1001)),
    ?assertMatch({[{no_result, 1001, [1]}], _}, in_full([entered(1, 1)], false, 1002)),
    Crash = fun(T) -> judge([{T, 3, crashed}, entered(5, 2), elected(9, 2, 2, highest)], true) end,
    ?assertEqual([not_the_highest], Crash(4)),
    ?assertEqual([], Crash(5)),
    Died = fun(T) -> judge([{T, 3, {died, k}}, entered(5, 2), elected(9, 2, 3, known)], true) end,
    ?assertEqual([dead_leader], Died(4)),
    ?assertEqual([], Died(5)).

entered(T, Robot) -> {T, Robot, {entered, e}}.
elected(T, Robot, Leader, How) -> {T, Robot, {elected, e, Leader, How}}.

an_election_that_keeps_the_contract_test() ->
    ?assertEqual(
        [],
        judge(
            [
                entered(1, 1),
                elected(2, 3, 3, highest),
                elected(3, 1, 3, announcement),
                elected(4, 1, 3, known)
            ],
            true
        )
    ).

two_leaders_test() ->
    ?assertEqual(
        [two_leaders_at_one_robot],
        judge([elected(2, 1, 3, announcement), elected(3, 1, 2, announcement)])
    ).
a_crash_begins_a_term_test() ->
    ?assertEqual(
        [],
        judge([
            elected(2, 1, 3, announcement),
            {3, 1, crashed},
            elected(4, 1, 2, announcement)
        ])
    ).
no_result_test() -> ?assertEqual([no_result], judge([entered(1, 1), elected(1002, 1, 3, known)])).
%% What is overdue is told once.
told_once_test() ->
    ?assertEqual([no_result], judge([entered(1, 1), {2000, 2, crashed}, {2001, 2, crashed}])).
failed_in_time_test() -> ?assertEqual([], judge([entered(1, 1), {1001, 1, {failed, e, timeout}}])).
failed_without_loss_test() ->
    ?assertEqual([failed_without_loss], judge([entered(1, 1), {9, 1, {failed, e, timeout}}], true)).
dead_owe_nothing_test() ->
    ?assertEqual([], judge([entered(1, 1), entered(1, 2), {5, 1, {died, k}}, {6, 2, crashed}])).
the_others_owe_it_still_test() ->
    [
        ?assertMatch(
            {[{no_result, 1001, [2]}], _},
            in_full([entered(1, 1), entered(1, 2), {5, 1, End}], false)
        )
     || End <- [{died, k}, crashed]
    ].
not_a_robot_test() -> ?assertEqual([not_a_robot], judge([elected(2, 1, 7, announcement)])).
not_itself_test() -> ?assertEqual([not_itself], judge([elected(2, 1, 2, highest)])).
not_the_highest_test() -> ?assertEqual([not_the_highest], judge([elected(2, 2, 2, highest)], true)).
the_highest_is_dead_test() ->
    ?assertEqual([], judge([{1, 3, {died, k}}, elected(2, 2, 2, highest)], true)).
dead_leader_test() ->
    ?assertEqual([dead_leader], judge([{1, 3, {died, k}}, elected(2, 2, 3, announcement)], true)).
different_leaders_test() ->
    ?assertEqual(
        [different_leaders],
        judge(
            [
                entered(1, 1),
                elected(2, 2, 3, known),
                {3, 3, crashed},
                elected(4, 1, 2, known)
            ],
            true
        )
    ),
    ?assertEqual([], judge([elected(2, 2, 3, known), elected(4, 1, 2, known)])),
    %% a leader that has died binds nobody who has not elected it
    Dies = [entered(1, 1), elected(2, 2, 3, known), {3, 3, {died, k}}, elected(4, 1, 2, known)],
    ?assertEqual([], judge(Dies, true)).

%% In a run whose radio is sound each election is judged as lossless that no fault has met.
%% Holds: Bully: an election that no fault has met, on a sound radio, elects the highest robot
%% alive, in every run
%% Red: 957e2b0: judged in no run
calm_elections_test() ->
    Known = #{
        broken => [],
        faults => [{2, 5000, 6000, fault}],
        loss => 0.0,
        delay_us => 20000,
        sap => #{},
        slack_us => 0
    },
    Config = #{robots => [1, 2, 3], bound_us => 31000000, answer_us => 500000},
    Told = fun(Changes) ->
        starl_election_bully_monitor:context(maps:merge(Known, Changes), Config)
    end,
    #{lossless := {calm, Us}} = Calm = Told(#{}),
    ?assertEqual(starl_sap_schedule:bound_us(#{}), Us),
    Found = fun(At) ->
        New = starl_election_bully_monitor:init(Calm),
        {ok, Entered} = starl_election_bully_monitor:step({At, 1, election, {entered, a}}, New),
        Elects = {At + 1, 1, election, {elected, a, 1, highest}},
        case starl_election_bully_monitor:step(Elects, Entered) of
            {ok, _} -> none;
            {violation, #{what := What}, _} -> What
        end
    end,
    ?assertEqual(none, Found(4999)),
    ?assertEqual(none, Found(6000 + Us)),
    ?assertEqual(not_the_highest, Found(6001 + Us)),
    [
        ?assertMatch(#{lossless := false}, Told(Changes))
     || Changes <- [#{loss => 0.01}, #{delay_us => 250000}, #{slack_us => 1}]
    ],
    ?assertMatch(
        #{lossless := false},
        starl_election_bully_monitor:context(Known, Config#{bound_us := 1900000})
    ),
    %% what a scene says stays
    ?assertMatch(
        #{lossless := true}, starl_election_bully_monitor:context(Known, Config#{lossless => true})
    ).
