-module(starl_obligations_tests).
-include_lib("eunit/include/eunit.hrl").

-define(NONE, starl_assumption:new([], 0)).

%% Robot 1 owes something from 10 on for 5 us, robot 2 from 12 on.
two(Rule) ->
    One = starl_obligations:owe(one, 1, 10, 5, starl_obligations:new(Rule)),
    starl_obligations:owe(two, 2, 12, 5, One).

overdue(T, Owed) -> overdue(T, [], Owed).

overdue(T, Windows, Owed) ->
    case starl_obligations:overdue(T, starl_assumption:new(Windows, 0), Owed) of
        none -> [];
        {Late, _} -> Late
    end.

what_is_not_paid_is_overdue_after_it_is_due_test_() ->
    [
        {atom_to_list(Name), [
            ?_assertEqual([], overdue(15, two(Rule))),
            ?_assertEqual([{15, one}], overdue(16, two(Rule))),
            ?_assertEqual([{15, one}], overdue(17, two(Rule))),
            ?_assertEqual([{15, one}, {17, two}], overdue(99, two(Rule)))
        ]}
     || {Name, Rule} <- [{exact, exact}, {anew, anew}, {delayed, {delayed, 1}}]
    ].

what_is_paid_or_dropped_is_not_overdue_test() ->
    ?assertEqual([{17, two}], overdue(99, starl_obligations:paid(one, two(exact)))),
    Dropped = starl_obligations:dropped(fun(Key) -> Key =:= two end, two(exact)),
    ?assertEqual([{15, one}], overdue(99, Dropped)),
    ?assertEqual(two(exact), starl_obligations:paid(other, two(exact))).

what_is_owed_anew_counts_from_then_test() ->
    Again = starl_obligations:owe(one, 1, 14, 5, two(exact)),
    ?assertEqual([{17, two}, {19, one}], overdue(99, Again)),
    Kept = starl_obligations:owe_once(one, 1, 14, 5, two(exact)),
    ?assertEqual([{15, one}, {17, two}], overdue(99, Kept)),
    ?assertEqual(
        Again, starl_obligations:owe_once(one, 1, 14, 5, starl_obligations:paid(one, Again))
    ),
    ?assertEqual(14, starl_obligations:since(one, Again)),
    ?assertEqual(none, starl_obligations:since(other, Again)),
    ?assertEqual(#{one => 14, two => 12}, starl_obligations:sinces(Again)).

each_is_reported_once_test() ->
    {[{15, one}], Left} = starl_obligations:overdue(16, ?NONE, two(exact)),
    ?assertEqual(none, starl_obligations:since(one, Left)),
    ?assertEqual(none, starl_obligations:overdue(17, ?NONE, Left)),
    {[{17, two}], Empty} = starl_obligations:overdue(18, ?NONE, Left),
    ?assertEqual(none, starl_obligations:overdue(1000000, ?NONE, Empty)).

%% A pause of robot 1, from 12 to 20, in which another robot is as prompt as ever.
a_window_excuses_by_its_rule_test() ->
    Pause = [{1, 12, 20, pause}],
    ?assertEqual([{15, one}, {17, two}], overdue(99, Pause, two(exact))),
    ?assertEqual([{17, two}, {25, one}], overdue(99, Pause, two(anew))),
    ?assertEqual([{17, two}, {23, one}], overdue(99, Pause, two({delayed, 1}))),
    Team = starl_obligations:owe(all, team, 12, 5, starl_obligations:new(anew)),
    ?assertEqual([{25, all}], overdue(99, Pause, Team)).

%% Nothing is asked twice before it can be overdue; a window that comes to light meanwhile excuses.
a_window_that_is_known_later_excuses_test() ->
    {[], Excused} = starl_obligations:overdue(
        16, starl_assumption:new([{1, 12, 20, pause}], 0), two(anew)
    ),
    ?assertEqual(none, starl_obligations:overdue(17, ?NONE, Excused)),
    Later = [{1, 12, 20, pause}, {1, 21, 30, pause}, {2, 12, 20, pause}],
    ?assertEqual([{25, two}], overdue(34, Later, Excused)),
    ?assertEqual([{25, two}, {35, one}], overdue(99, Later, Excused)).
