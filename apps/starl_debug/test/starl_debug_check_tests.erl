%% Answers for recordings that are made here: who held a token when, by whose clock.
-module(starl_debug_check_tests).

-include_lib("eunit/include/eunit.hrl").

-define(END, 10000000).

%% A recording of robots that held token `t' at these times (us).
recording(Holds) ->
    Events = fun(Times) ->
        lists:append([[{A, {acquired, t, 1}}, {B, {released, t, 1}}] || {A, B} <- Times])
    end,
    States = maps:from_list([
        {R, starl_debug_state:new(R, #{mutex => Events(Times)}, {0, ?END}, exact)}
     || {R, Times} <- Holds
    ]),
    starl_debug_truth:recording({0, ?END}, States, #{}).

answer(Text, Holds, Options) ->
    Recording = recording(Holds),
    {ok, Predicate} = starl_debug:predicate(Text),
    {ok, Formula} = starl_debug:formula(Predicate, Recording),
    {Formula, Recording,
        starl_debug_check:run(Formula, Recording, Options, fun(_) -> continue end)}.

verdict(Text, Holds, Sigma) ->
    {_, _, #{verdict := Verdict}} = answer(Text, Holds, #{sigma => Sigma}),
    Verdict.

%% Two owners for 30 ms.
-define(TWO, [{1, [{1000000, 3030000}]}, {2, [{3000000, 5000000}]}]).

two_owners_are_certain_within_their_overlap_test() ->
    ?assertEqual(certainly, verdict("two_owners", ?TWO, 5000)),
    ?assertEqual(certainly, verdict("two_owners", ?TWO, 29000)),
    ?assertEqual(possibly, verdict("two_owners", ?TWO, 50000)).

the_error_at_which_it_changes_is_the_overlap_test() ->
    {Formula, Recording, #{verdict := possibly}} = answer("two_owners", ?TWO, #{sigma => 50000}),
    #{smaller := {until, certainly, Us}, perfect_clocks := certainly} =
        starl_debug_sigma:explain(Formula, Recording, #{sigma => 50000}, possibly),
    ?assert(abs(Us - 30000) < 1500).

owners_with_a_gap_are_possible_beyond_it_test() ->
    Gap = [{1, [{1000000, 3000000}]}, {2, [{3020000, 5000000}]}],
    ?assertEqual(never, verdict("two_owners", Gap, 15000)),
    ?assertEqual(possibly, verdict("two_owners", Gap, 50000)).

%% One of the two holds of robot 2 meets that of robot 1, whatever the clocks, but none always does.
several_moments_together_are_certain_test() ->
    Holds = [{1, [{4990000, 5020000}]}, {2, [{4000000, 5000000}, {5010000, 6000000}]}],
    ?assertEqual(certainly, verdict("two_owners", Holds, 100000)),
    Wider = [{1, [{5001000, 5009000}]}, {2, [{4000000, 5000000}, {5010000, 6000000}]}],
    ?assertEqual(possibly, verdict("two_owners", Wider, 100000)).

a_count_of_three_test() ->
    Holds = [{R, [{1000000 * R, 4000000}]} || R <- [1, 2, 3]],
    ?assertEqual(certainly, verdict("count(r: owner(r, t)) >= 3", Holds, 50000)),
    ?assertEqual(never, verdict("count(r: owner(r, t)) > 3", Holds, 50000)).

what_lasts_test() ->
    ?assertEqual(certainly, verdict("(owner(r1, t) and owner(r2, t)) for 20 ms", ?TWO, 1000)),
    ?assertEqual(never, verdict("(owner(r1, t) and owner(r2, t)) for 40 ms", ?TWO, 1000)).

a_stopped_check_says_until_when_test() ->
    Recording = recording(?TWO),
    {ok, Predicate} = starl_debug:predicate("two_owners"),
    {ok, Formula} = starl_debug:formula(Predicate, Recording),
    Look = fun
        (Done) when Done > 0.15 -> stop;
        (_) -> continue
    end,
    #{verdict := never, is_whole := false, until := Until} =
        starl_debug_check:run(Formula, Recording, #{sigma => 5000}, Look),
    ?assert(Until < 3000000).

only_the_time_that_is_asked_for_test() ->
    {_, _, #{verdict := never, is_whole := true}} =
        answer("two_owners", ?TWO, #{sigma => 5000, from => 4000000}).

a_robot_that_tells_does_not_know_when_it_died_test() ->
    Events = #{mutex => [{1000000, {acquired, t, 1}}], robot => [{2000000, down}, {6000000, up}]},
    State = starl_debug_state:new(1, Events, {0, ?END}, told),
    {May, Must} = starl_debug_state:times({owner, any}, State),
    ?assertEqual([{1000000, 5999999}], May),
    ?assertEqual([{1000000, 1999999}], Must).

messages_bound_the_clocks_test() ->
    %% robot 2's clock is 100 ms ahead; packets take 5 ms
    Packets = lists:append([
        [{packet, 1, 2, T, T + 105000}, {packet, 2, 1, T + 100000, T + 5000}]
     || T <- lists:seq(0, ?END - 200000, 500000)
    ]),
    Recording = (recording(?TWO))#{packets := Packets},
    {ok, Bounds} = starl_debug_envelope:from_packets(Recording, 10),
    [
        begin
            {Least, Most} = starl_debug_envelope:offset(1, 2, Slice, Bounds),
            ?assert(Least =< 100000 andalso Least >= 94000),
            ?assert(Most >= 100000 andalso Most =< 106000)
        end
     || %% what is looked at may begin before the recording and end behind it
        Slice <- [{2000000, 2999999}, {-5000000, 999999}, {9500000, ?END + 1200000}]
    ].

messages_that_contradict_are_told_test() ->
    Recording = (recording(?TWO))#{
        packets := [{packet, 1, 2, 1000, 500}, {packet, 2, 1, 1000, 600}]
    },
    {error, Line} = starl_debug_envelope:from_packets(Recording, 10),
    ?assertMatch({match, _}, re:run(Line, "robots 1, 2 contradict")).
