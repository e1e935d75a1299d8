%% The contract of the barrier once more: teams of three, several names, who broke it and when, and
%% what is counted.
-module(starl_barrier_contract_tests).
-include_lib("eunit/include/eunit.hrl").

run(Events, End, Extra) ->
    {Found, Results} = told([trace(Event) || Event <- Events], End, Extra),
    {[What || {What, _, _, _} <- Found], Results}.

%% Each violation as it is told, and the results.
told(Events, End, Extra) ->
    Start = starl_barrier_monitor:init(maps:merge(#{robots => [1, 2]}, Extra)),
    {Met, Fed} = lists:foldl(
        fun(Event, {Found, State}) ->
            case starl_barrier_monitor:step(Event, State) of
                {ok, Next} -> {Found, Next};
                {violation, V, Next} -> {Found ++ [V], Next}
            end
        end,
        {[], Start},
        Events
    ),
    {Verdict, Results} = starl_barrier_monitor:finish(End, Fed),
    Late =
        case Verdict of
            ok -> [];
            {violation, Vs} -> Vs
        end,
    {[facts(V) || V <- Met ++ Late], Results}.

facts(#{contract := barrier, what := What, at_us := T, robots := Robots, details := Details}) ->
    {What, T, Robots, Details}.

trace({T, R, died}) -> {T, R, robot, {died, killed}};
trace({T, R, crashed}) -> {T, R, barrier, crashed};
trace({T, R, damaged}) -> {T, R, barrier, store_damaged};
trace({T, R, failed, K}) -> {T, R, barrier, {failed, b, K, timeout}};
trace({T, R, Event, K}) -> {T, R, barrier, {Event, b, K}}.

all_reach() -> [{1, 1, reached, 1}, {2, 2, reached, 1}].

%% A violation names the robot that has broken the contract, the round and the moment.
whose_test() ->
    Broken = fun(Events, Extra) ->
        element(1, told([trace(Event) || Event <- Events], 0, Extra))
    end,
    ?assertEqual(
        [{passed_early, 3, [2], #{name => b, round => 1, absent => [1]}}],
        Broken([{2, 2, reached, 1}, {3, 2, passed, 1}], #{})
    ),
    ?assertEqual(
        [{passed_out_of_order, 4, [2], #{name => b, round => 1, last => 1}}],
        Broken(all_reach() ++ [{3, 2, passed, 1}, {4, 2, passed, 1}], #{})
    ),
    ?assertEqual(
        [{reached_out_of_order, 3, [2], #{name => b, round => 3, passed => 0}}],
        Broken([{3, 2, reached, 3}], #{})
    ),
    ?assertEqual(
        [{late_pass, 16, [2], #{name => b, round => 1, after_us => 11}}],
        Broken(all_reach() ++ [{5, 1, passed, 1}, {16, 2, passed, 1}], #{delta_us => 10})
    ).

%% -- teams of three ---------------------------------------------------------------------------

three(Events) -> three(Events, 0, #{}).

three(Events, End, Extra) -> run(Events, End, Extra#{robots => [1, 2, 3]}).

reach_all(T, K) -> [{T, R, reached, K} || R <- [1, 2, 3]].

pass_all(T, K) -> [{T + 10 * (R - 1), R, passed, K} || R <- [1, 2, 3]].

%% A round is passed when all have passed it; δ is from the first pass to the last.
results_test() ->
    Rounds =
        reach_all(1, 1) ++ pass_all(5, 1) ++ reach_all(40, 2) ++
            [{50, 3, passed, 2}, {52, 1, passed, 2}, {56, 2, passed, 2}],
    {[], Results} = three(Rounds, 90, #{}),
    ?assertMatch(#{rounds := 2, passed := 6, failed := 0, longest_delta_us := 20}, Results),
    ?assertEqual(13.0, maps:get(mean_delta_us, Results)),
    %% that of one round is its own
    {[], One} = three(lists:sublist(Rounds, 6), 90, #{}),
    ?assertEqual({20, 20.0}, {maps:get(longest_delta_us, One), maps:get(mean_delta_us, One)}),
    {[], Part} = three(reach_all(1, 1) ++ [{5, 1, passed, 1}, {6, 2, passed, 1}]),
    ?assertMatch(#{rounds := 0, passed := 2, longest_delta_us := 0}, Part),
    {[], Failed} = three([
        {1, 1, reached, 1}, {2, 1, failed, 1}, {3, 1, reached, 1}, {4, 1, failed, 1}
    ]),
    ?assertMatch(#{rounds := 0, passed := 0, failed := 2}, Failed).

%% One of three is missing, whoever it is; who has passed excuses nobody.
absent_test() ->
    [
        ?assertMatch(
            {[passed_early], _},
            three((reach_all(1, 1) -- [{1, R, reached, 1}]) ++ [{5, P, passed, 1}])
        )
     || {R, P} <- [{1, 2}, {2, 3}, {3, 1}]
    ],
    [
        ?assertMatch(
            {[passed_early], _},
            three(
                reach_all(1, 1) ++ pass_all(5, 1) ++ reach_all(40, 2) ++
                    pass_all(50, 2) ++ [{80, R, reached, 3} || R <- Two] ++
                    [{90, hd(Two), passed, 3}]
            )
        )
     || Two <- [[1, 2], [2, 3], [3, 1]]
    ].

%% δ counts from the first of three, for each that follows.
late_of_three_test() ->
    Late = fun(Second, Third) ->
        element(
            1,
            three(
                reach_all(1, 1) ++
                    [{5, 1, passed, 1}, {Second, 2, passed, 1}, {Third, 3, passed, 1}],
                90,
                #{delta_us => 10}
            )
        )
    end,
    ?assertEqual([], Late(10, 15)),
    ?assertEqual([late_pass], Late(10, 16)),
    ?assertEqual([late_pass, late_pass], Late(16, 17)).

%% Who has failed, crashed or died may take longer; nobody else may on its account.
excused_test() ->
    Delta = #{delta_us => 10},
    Bound = #{bound_us => 10},
    [
        begin
            Trace = fun
                (R) when What =:= failed -> [{2, R, failed, 1}];
                (R) -> [{2, R, What}]
            end,
            All = fun(R) -> reach_all(1, 1) ++ Trace(R) ++ [{5, 1, passed, 1}] end,
            ?assertMatch({[], _}, three(All(2) ++ [{16, 2, passed, 1}], 20, Delta)),
            ?assertMatch({[late_pass], _}, three(All(3) ++ [{16, 2, passed, 1}], 20, Delta)),
            %% the bound counts from a crash, and is none if a robot has died
            Last = #{failed => 11, crashed => 12, died => infinity},
            [
                ?assertMatch({Not, _}, three(All(2), End, Bound))
             || Due <- [maps:get(What, Last)],
                {End, Not} <- [{min(Due, 900), []}] ++ [{Due + 1, [not_passed]} || is_integer(Due)]
            ],
            ?assertMatch({[], _}, three(All(2) ++ Trace(3), 900, Bound)),
            ?assertMatch({[], _}, three(All(2) ++ [{6, 3, passed, 1}], 900, Bound))
        end
     || What <- [failed, crashed, died]
    ].

%% An excuse ends with the next round that the robot reaches.
excused_once_test() ->
    Before = reach_all(1, 1) ++ [{2, 2, crashed}] ++ [{3, R, passed, 1} || R <- [1, 2, 3]],
    Trace = Before ++ reach_all(20, 2) ++ [{23, R, passed, 2} || R <- [1, 3]],
    ?assertMatch({[not_passed], _}, three(Trace, 40, #{bound_us => 10})).

%% Who passes too late has not passed in time; faults of that time, and no others, are excuses.
late_and_excused_by_faults_test() ->
    Late = fun(Faults) ->
        Trace = reach_all(1, 1) ++ [{16, R, passed, 1} || R <- [1, 2, 3]],
        {Found, _} = three(Trace, 90, #{bound_us => 10, faults => Faults}),
        Found
    end,
    ?assertEqual([not_passed, not_passed, not_passed], Late([])),
    ?assertEqual([], Late([{2, 3, 7, fault}])),
    ?assertEqual([not_passed, not_passed, not_passed], Late([{2, 14, 17, fault}])),
    ?assertEqual([not_passed, not_passed, not_passed], Late([{2, 0, 0, fault}])).

%% The bound counts from when the last has reached the round, not from when it says so again.
bound_test() ->
    Bound = #{bound_us => 10},
    All = [{1, 1, reached, 1}, {3, 2, reached, 1}, {7, 3, reached, 1}],
    ?assertMatch({[], _}, three(All, 17, Bound)),
    ?assertMatch({[not_passed], _}, three(All, 18, Bound)),
    ?assertMatch(
        {[not_passed], _}, three(All ++ [{9, 1, reached, 1}, {9, 3, reached, 1}], 18, Bound)
    ),
    ?assertMatch({[not_passed], _}, three(All ++ [{8, 2, passed, 1}], 18, Bound)),
    ?assertMatch({[], _}, three(All ++ [{8, R, passed, 1} || R <- [1, 2, 3]], 900, Bound)),
    ?assertMatch({[], _}, three(All, 900, #{})).

%% Of what is overdue it says which round of which name, when and who waits.
overdue_test() ->
    Events =
        [{T, R, barrier, {reached, Name, 1}} || {T, Name} <- [{1, b}, {2, a}], R <- [1, 2]] ++
            [{5, 2, barrier, {passed, a, 1}}],
    ?assertEqual(
        [
            {not_passed, 11, [1, 2], #{name => b, round => 1}},
            {not_passed, 12, [1], #{name => a, round => 1}}
        ],
        lists:sort(element(1, told(Events, 90, #{bound_us => 10})))
    ).

%% Where nobody's store is whole, a robot may go on at the latest with the round after the last that
%% it has reached.
lost_test() ->
    Far =
        all_reach() ++ [{3, R, passed, 1} || R <- [1, 2]] ++ [{4, R, reached, 2} || R <- [1, 2]] ++
            [{5, R, damaged} || R <- [1, 2]],
    [
        ?assertEqual({K, Found}, {K, element(1, run(Far ++ [{6, 1, reached, K}], 9, #{}))})
     || {K, Found} <- [{1, []}, {2, []}, {3, []}, {4, [reached_out_of_order]}]
    ].

%% A round that comes again, as all stores were damaged, is another one.
again_test() ->
    Passed = all_reach() ++ [{3, 1, passed, 1}, {4, 2, passed, 1}],
    Again =
        [{5, R, damaged} || R <- [1, 2]] ++ [{16, R, reached, 1} || R <- [1, 2]] ++
            [{17, 1, passed, 1}, {18, 2, passed, 1}],
    {[], Results} = run(Passed ++ Again, 90, #{delta_us => 10, bound_us => 10}),
    ?assertMatch(#{rounds := 2, passed := 4, longest_delta_us := 1}, Results).

%% However many are overdue, they are told in the order of names and rounds.
order_test() ->
    Names = lists:seq(1, 40),
    Events = [{1, R, barrier, {reached, Name, 1}} || Name <- Names, R <- [1, 2]],
    Late = element(1, told(Events, 90, #{bound_us => 10})),
    ?assertEqual(Names, [Name || {not_passed, _, _, #{name := Name}} <- Late]).

%% -- several names ----------------------------------------------------------------------------

%% Each name has rounds of its own.
names_test() ->
    Of = fun(Name, Events) -> [{T, R, barrier, {What, Name, K}} || {T, R, What, K} <- Events] end,
    Judge = fun judge_all/1,
    ?assertEqual(
        [passed_early], Judge(Of(a, all_reach()) ++ Of(b, [{3, 1, reached, 1}, {4, 1, passed, 1}]))
    ),
    ?assertEqual(
        [],
        Judge(
            Of(a, all_reach()) ++ Of(b, all_reach()) ++ Of(b, [{4, 1, passed, 1}]) ++
                Of(a, [{5, 1, passed, 1}])
        )
    ),
    %% all stores are damaged: of each name that a robot has reached
    Far = Of(
        a, all_reach() ++ [{3, R, passed, 1} || R <- [1, 2]] ++ [{4, R, reached, 2} || R <- [1, 2]]
    ),
    Down = [{5, R, barrier, store_damaged} || R <- [1, 2]],
    ?assertEqual(
        [], Judge(Far ++ Of(b, [{4, 1, reached, 1}]) ++ Down ++ Of(a, [{6, 2, reached, 1}]))
    ),
    ?assertEqual(
        [reached_out_of_order],
        Judge(Far ++ Of(b, [{4, 1, reached, 1}]) ++ tl(Down) ++ Of(a, [{6, 2, reached, 1}]))
    ).

judge_all(Events) -> [W || {W, _, _, _} <- element(1, told(Events, 0, #{}))].

%% What other machines, and a barrier, say besides means nothing.
others_test() ->
    ?assertEqual(
        [],
        judge_all([
            {1, 1, mutex, {passed, b, 1}},
            {1, 1, robot, {passed, b, 1}},
            {1, 1, barrier, {unknown_event, cast, what}},
            {2, 1, robot, born}
        ])
    ).

%% What is to be judged while no time passes: how far each robot has come, not when.
timeless_test() ->
    At = fun(Delay, Events) ->
        lists:foldl(
            fun({T, R, B, E}, M) ->
                {ok, Next} = starl_barrier_monitor:step({T + Delay, R, B, E}, M),
                Next
            end,
            starl_barrier_monitor:init(#{robots => [1, 2]}),
            [trace(Event) || Event <- Events]
        )
    end,
    Timeless = fun(Events) -> starl_barrier_monitor:timeless(At(0, Events)) end,
    Base = Timeless(all_reach()),
    ?assertEqual(Base, starl_barrier_monitor:timeless(At(9, all_reach()))),
    %% no store is damaged there: so a crash makes no difference, but damage would
    ?assertEqual(Base, Timeless(all_reach() ++ [{3, 1, crashed}])),
    [
        ?assertNotEqual(Base, Timeless(Events))
     || Events <- [
            [{1, 1, reached, 1}],
            all_reach() ++ [{3, 1, damaged}],
            all_reach() ++ [{5, 1, passed, 1}]
        ]
    ].

%% Robots that begin again with an earlier round, since their stores are damaged, do not wait for the
%% one they had reached, and that one is complete when they all reach it anew.
no_progress_is_owed_for_what_was_forgotten_test() ->
    Damaged = [{T, R, What} || R <- [1, 2, 3], {T, What} <- [{3, crashed}, {4, damaged}]],
    Before = reach_all(1, 5) ++ Damaged ++ reach_all(40, 1),
    Again = Before ++ [{41, R, passed, 1} || R <- [1, 2, 3]] ++ reach_all(90, 5),
    Found = fun(Trace, End) ->
        {Whats, _} = three(lists:keysort(1, Trace), End, #{bound_us => 10}),
        lists:member(not_passed, Whats)
    end,
    ?assertNot(Found(Before ++ [{41, R, passed, 1} || R <- [1, 2, 3]], 900)),
    ?assertNot(Found(Again, 100)),
    ?assert(Found(Again, 101)).
