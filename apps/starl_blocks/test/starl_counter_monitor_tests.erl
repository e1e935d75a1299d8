%% The contract of the shared counter: traces that keep it and traces that do not.
-module(starl_counter_monitor_tests).
-include_lib("eunit/include/eunit.hrl").

judge(Events) -> judge(Events, #{}).

judge(Events, Config) ->
    Monitor = starl_monitor:new([
        {starl_counter_monitor, maps:merge(#{robots => [1, 2, 3]}, Config)}
    ]),
    {Found, Last} = lists:foldl(fun fed/2, {[], Monitor}, Events),
    {Late, _} = starl_monitor:finish(100, Last),
    [{What, At} || #{what := What, at_us := At} <- Found ++ Late].

fed(Event, {Found, Monitor}) ->
    case starl_monitor:step(Event, Monitor) of
        {ok, Next} -> {Found, Next};
        {violation, Violation, Next} -> {Found ++ [Violation], Next}
    end.

count(T, Robot, Value) -> {T, Robot, counter, {incremented, Value}}.
holds(T, Robot, Value) -> {T, Robot, counter, {holds, Value}}.
reads(T, Robot, Value) -> {T, Robot, counter, {read, Value}}.

%% One value back is a violation, the same value is none, and none after a crash.
goes_back_test() ->
    Two = [count(1, 1, 1), count(2, 1, 2)],
    ?assertEqual([], judge(Two ++ [reads(3, 1, 2)])),
    ?assertEqual([{goes_back, 3}], judge(Two ++ [reads(3, 1, 1)])),
    ?assertEqual([{goes_back, 3}], judge(Two ++ [holds(3, 1, 1)])),
    ?assertEqual([], judge(Two ++ [{3, 1, counter, crashed}, reads(3, 1, 1)])),
    ?assertEqual([{goes_back, 3}], judge(Two ++ [{3, 2, counter, crashed}, reads(3, 1, 1)])).

%% An increment counts at once where it is made.
%% Holds: A counter that always shows 0, or counts anew in the entry of an earlier life
%% Red: 7ff787b; told by 26477e4
not_counted_test() ->
    ?assertEqual([{not_counted, 1}], judge([count(1, 1, 0)])),
    Two = [count(1, 1, 1), holds(2, 2, 1)],
    ?assertEqual([{not_counted, 3}], judge(Two ++ [count(3, 2, 1)])),
    ?assertEqual([], judge(Two ++ [count(3, 2, 2)])),
    ?assertEqual([], judge(Two ++ [{3, 2, counter, crashed}, count(4, 2, 1)])).

%% Those alive agree on no less than what one of them knew at the last crash or death, and what has been
%% counted since.
increments_lost_test() ->
    Bound = #{within_us => 10},
    All = fun(T, Value) -> [holds(T, Robot, Value) || Robot <- [1, 2, 3]] end,
    Crash = {4, 1, counter, crashed},
    Judge = fun(Events) ->
        judge([count(1, 1, 1), count(2, 1, 2), holds(3, 2, 2)] ++ Events, Bound)
    end,
    ?assertEqual([], Judge([Crash] ++ All(5, 2))),
    %% its old count and its new one do not add up
    ?assertEqual([{increments_lost, 15}], Judge([Crash, count(5, 1, 1)] ++ All(6, 2))),
    ?assertEqual([], Judge([Crash, count(5, 1, 1)] ++ All(6, 3))),
    %% what nobody else had heard is lost with who has counted it
    ?assertEqual([], Judge([count(4, 1, 3), Crash, count(5, 1, 1)] ++ All(6, 3))),
    Died = {4, 1, robot, {died, killed}},
    ?assertEqual([], Judge([Died, count(5, 2, 3), holds(6, 3, 3)])),
    ?assertEqual([], Judge([count(3, 1, 3), Died, count(5, 2, 3), holds(6, 3, 3)])),
    %% nobody has heard anything of anybody
    Two = [count(1, 1, 1), count(1, 2, 1), holds(2, 3, 1)],
    ?assertEqual([{increments_lost, 11}], judge(Two, Bound)),
    ?assertEqual([], judge(Two, #{})),
    %% one alone knew what another had counted that has died, and has crashed since
    Heir = [count(1, 3, 1), holds(2, 1, 1), {3, 3, robot, {died, killed}}],
    ?assertEqual([], judge(Heir ++ [{4, 1, counter, crashed}], Bound)),
    %% what a robot still has counts, though one that had heard of all has crashed
    Sum = [count(1, 2, 1), count(2, 1, 1), holds(3, 3, 2)],
    ?assertEqual(
        [{increments_lost, 15}],
        judge(Sum ++ [{4, 4, robot, {died, killed}}, {5, 3, counter, crashed} | All(6, 1)], Bound)
    ).

a_value_above_the_increments_is_told_test() ->
    ?assertEqual([], judge([count(1, 1, 1), holds(2, 2, 1)])),
    ?assertEqual([{exceeds, 2}], judge([count(1, 1, 1), holds(2, 2, 2)])),
    ?assertEqual([{exceeds, 1}], judge([count(1, 1, 2)])).

%% So long after the last increment, crash or death, and after the heal, those alive agree.
those_alive_agree_in_time_test() ->
    Bound = #{within_us => 10},
    One = [count(1, 1, 1), holds(2, 2, 1)],
    ?assertEqual([{no_agreement, 11}], judge(One, Bound)),
    ?assertEqual([{no_agreement, 10}], judge([count(0, 1, 1)], Bound)),
    ?assertEqual([], judge([{5, Robot, robot, {died, killed}} || Robot <- [1, 2, 3]], Bound)),
    ?assertEqual([], judge(One)),
    ?assertEqual([], judge(One ++ [holds(11, 3, 1)], Bound)),
    ?assertEqual([{no_agreement, 11}], judge(One ++ [holds(12, 3, 1)], Bound)),
    ?assertEqual([], judge(One ++ [{5, 3, robot, {died, killed}}], Bound)),
    ?assertEqual([{no_agreement, 15}], judge(One ++ [{5, 2, counter, crashed}], Bound)),
    ?assertEqual([{no_agreement, 30}], judge(One, Bound#{healed_us => 20})),
    ?assertEqual([], judge(One, Bound#{healed_us => never})),
    Known = #{broken => [], healed_us => 20, delay_us => 1, slack_us => 5},
    ?assertEqual([{no_agreement, 30}], judge(One, starl_counter_monitor:context(Known, Bound))).

%% The last message that all wait for may be lost as often as it may be in 10^9 messages, and be sent
%% again in the next turn.
longer_with_loss_test() ->
    Sap = #{},
    Known = #{healed_us => 0, sap => Sap, loss => 0.2, delay_us => 1000},
    Longer = starl_counter_monitor:context(Known, #{within_us => 10, turn_us => 5}),
    Reach = starl_sap_schedule:reach_us(Sap, 0.2, 1000, 5),
    ?assertEqual(#{within_us => 10 + Reach, turn_us => 5, healed_us => 0}, Longer).

%% A fault that is known only when it has happened has its time to heal; without an increment nothing
%% is due.
broken_later_test() ->
    Start = starl_counter_monitor:init(#{robots => [1, 2], within_us => 10}),
    Finished = fun(Events, End) ->
        Last = lists:foldl(
            fun
                ({broken, To}, State) ->
                    starl_counter_monitor:broken({1, 0, To, pause}, State);
                (Event, State) ->
                    element(2, starl_counter_monitor:step(Event, State))
            end,
            Start,
            Events
        ),
        {Verdict, #{agreed := Agreed}} = starl_counter_monitor:finish(End, Last),
        ?assertEqual(0, Agreed),
        Verdict
    end,
    One = count(1, 1, 1),
    ?assertMatch({violation, [#{at_us := 11}]}, Finished([One], 50)),
    ?assertMatch({violation, [#{at_us := 30}]}, Finished([One, {broken, 20}], 50)),
    ?assertMatch({violation, [#{at_us := 30}]}, Finished([{broken, 20}, One], 50)),
    ?assertMatch({violation, [#{at_us := 30}]}, Finished([One, {broken, 20}, {broken, 5}], 50)),
    ?assertEqual(ok, Finished([{broken, 20}, reads(1, 1, 0)], 50)).

%% Who is accused of an increment that does not count is named; the first one of a robot that is not
%% known counts.
not_counted_details_test() ->
    State = starl_counter_monitor:init(#{robots => [1]}),
    {violation, Found, _} = starl_counter_monitor:step(count(1, 1, 0), State),
    ?assertMatch(#{robots := [1], details := #{value := 0}}, Found),
    ?assertMatch({ok, _}, starl_counter_monitor:step(count(1, 7, 1), State)),
    %% it has counted three times since the crash of another, who knew of nothing
    Bound = #{within_us => 10},
    Thrice = [{1, 2, counter, crashed}, count(2, 1, 1), count(3, 1, 2), count(4, 1, 3)],
    All = fun(Value) -> [holds(5, Robot, Value) || Robot <- [2, 3]] end,
    ?assertEqual([], judge(Thrice ++ All(3), Bound)),
    ?assertEqual(
        [{increments_lost, 14}],
        judge(Thrice ++ [reads(5, 1, 2) | All(2)], Bound) -- [{goes_back, 5}]
    ).

results_count_increments_test() ->
    State = starl_counter_monitor:init(#{robots => [1], within_us => 1}),
    {ok, Next} = starl_counter_monitor:step(count(1, 1, 1), State),
    ?assertEqual(
        {ok, #{increments => 1, agreed => 1}}, starl_counter_monitor:finish(9, Next)
    ),
    ?assertEqual({1, #{1 => 1}}, starl_counter_monitor:timeless(Next)).

%% A violation says who has which value, in the order of the robots.
a_violation_says_who_has_which_value_test() ->
    State = starl_counter_monitor:init(#{robots => lists:seq(40, 1, -1), within_us => 1}),
    {ok, Next} = starl_counter_monitor:step(count(1, 40, 1), State),
    {{violation, [Violation]}, #{agreed := 0}} = starl_counter_monitor:finish(9, Next),
    ?assertMatch(#{contract := counter, details := #{values := [0, 1]}}, Violation),
    ?assertEqual(lists:seq(1, 40), maps:get(robots, Violation)),
    {violation, Back, _} = starl_counter_monitor:step(reads(2, 40, 0), Next),
    ?assertMatch(#{robots := [40], details := #{from := 1, to := 0}}, Back),
    {violation, More, _} = starl_counter_monitor:step(reads(2, 7, 5), Next),
    ?assertMatch(#{robots := [7], details := #{value := 5, made := 1}}, More).

%% It is told once, and agreement is judged once, each time that it is due.
judged_once_test() ->
    Bound = #{within_us => 10},
    Two = [count(1, 1, 1), holds(12, 2, 0), holds(30, 2, 0)],
    ?assertEqual([{no_agreement, 11}], judge(Two, Bound)),
    State = starl_counter_monitor:init(Bound#{robots => [1]}),
    Agreed = fun(Events) ->
        Last = lists:foldl(
            fun(Event, S) -> element(2, starl_counter_monitor:step(Event, S)) end, State, Events
        ),
        element(2, starl_counter_monitor:finish(100, Last))
    end,
    ?assertEqual(#{increments => 0, agreed => 0}, Agreed([])),
    ?assertEqual(
        #{increments => 2, agreed => 1}, Agreed([count(1, 1, 1), count(11, 1, 2)])
    ),
    ?assertEqual(
        #{increments => 1, agreed => 1},
        Agreed([count(1, 1, 1)] ++ [reads(T, 1, 1) || T <- [20, 21, 22]])
    ),
    ?assertEqual(
        #{increments => 2, agreed => 2}, Agreed([count(1, 1, 1), count(12, 1, 2)])
    ).

%% After a crash it begins at nothing; of one that is dead nothing is known.
begins_at_nothing_test() ->
    One = [count(1, 1, 1)],
    ?assertEqual([], judge(One ++ [{2, 1, counter, crashed}, reads(3, 1, 0)])),
    ?assertEqual([], judge(One ++ [{2, 1, robot, {died, killed}}, reads(3, 1, 0)])),
    ?assertEqual([], judge(One ++ [{2, 1, robot, up}, reads(3, 1, 1)])).

the_monitor_asks_for_the_counters_events_test() ->
    ?assertEqual([counter, robot], starl_counter_monitor:interests()),
    ?assertEqual(
        #{counter => [{incremented, 1}, {holds, 1}, {read, 1}]}, starl_counter_monitor:vocabulary()
    ).

%% Values that differ when a run ends before the bound are not judged, which is said; a slow wheel prolongs nothing.
not_yet_is_said_test() ->
    Unjudged = fun(End) ->
        M0 = starl_counter_monitor:init(#{robots => [1, 2], within_us => 1000}),
        {ok, M} = starl_counter_monitor:step({5, 1, counter, {incremented, 1}}, M0),
        {Verdict, Results} = starl_counter_monitor:finish(End, M),
        {Verdict =:= ok, length(maps:get(unjudged, Results, []))}
    end,
    ?assertEqual({true, 1}, Unjudged(900)),
    ?assertEqual({false, 0}, Unjudged(1900)),
    Known = #{healed_us => 70, ends => #{actuation => 70, network => 8}},
    ?assertMatch(#{healed_us := 8}, starl_counter_monitor:context(Known, #{robots => [1]})).
