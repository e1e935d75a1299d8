%% What the checker finds, and that its reductions hide nothing.
%%
%% Holds: No order of events breaks the mutex while robots stand still in the middle of any step
%% Red: fe7bec7: no such fault; the mutex without latest moments has two holders after 14 steps
%% (`starl_check_tests`)
-module(starl_check_tests).
-include_lib("eunit/include/eunit.hrl").

-define(SLOW(Body), {timeout, 600, fun() -> Body end}).

on() -> {fun(_Figures, State) -> {continue, State} end, none}.

check(Block, Robots, Faults, More) ->
    starl_check:run(Block, More#{robots => Robots, faults => Faults}, on()).

%% -- planted bugs: the way there, without reductions and with them, is as short ----------------

%% Block, robots, faults, the planted machine, how the contract breaks, in how many steps.
planted() ->
    [
        {barrier, 2, #{crash => 1}, {starl_barrier_planted, #{variant => forgetful}},
            reached_out_of_order, 7},
        {barrier, 2, #{loss => 1}, {starl_barrier_planted, #{variant => recreated}}, passed_early,
            7},
        {mutex, 3, #{}, {starl_mutex_planted, #{variant => impatient_home}}, two_holders, 15},
        {mutex, 3, #{crash => 1}, {starl_mutex_planted, #{variant => forgetful_home}},
            grant_not_larger, 9},
        {mutex, 3, #{loss => 1}, {starl_mutex_planted, #{variant => trusting}}, never_granted, 3},
        {mutex, 3, #{loss => 1}, {starl_mutex_planted, #{variant => overstaying}}, two_holders, 13},
        {mutex, 3, #{still => 1}, {starl_mutex_planted, #{variant => untimely}}, two_holders, 14},
        {election, 3, #{}, {starl_election_bug, #{bug => incomplete}}, different_leaders, 5},
        {bully, 3, #{loss => 1}, {starl_election_bug, #{bug => fickle}}, two_leaders_at_one_robot,
            4},
        {sap, 2, #{crash => 1}, {starl_check_sap_planted, #{variant => same_incarnation}},
            message_id_used_twice, 3},
        {sap, 2, #{}, {starl_check_sap_planted, #{variant => careless}}, duplicate_delivery, 5},
        {terms, 2, #{reboot => 1}, {starl_check_planted, #{variant => unread}}, term_goes_back, 27},
        {terms, 2, #{still => 1}, {dpp_coordinator, starl_check_planted, #{variant => untimely}},
            term_goes_back, 20},
        {registers, 2, #{crash => 1}, {starl_registers_bug, #{bug => restart}}, stamp_goes_back, 3},
        {registers, 2, #{}, {starl_registers_bug, #{bug => last_heard}}, read_goes_back, 5},
        {geocast, 2, #{crash => 1}, {starl_geocast_bug, #{bug => restart}}, delivered_twice, 12},
        {geocast, 2, #{late => 2}, {starl_geocast_bug, #{bug => trusts}}, too_late, 21},
        {geocast, 2, #{late => 1}, {starl_geocast_bug, #{bug => forgets}}, delivered_twice, 25}
    ].

planted_test_() ->
    [
        {
            lists:flatten(io_lib:format("~p ~p", [element(tuple_size(Machine), Machine), Way])),
            ?SLOW(
                begin
                    {violated, #{violation := #{what := Found}, steps := Needed}} =
                        check(Block, Robots, Faults, Options#{machine => Machine}),
                    ?assertEqual({What, Steps}, {Found, Needed})
                end
            )
        }
     || {Block, Robots, Faults, Machine, What, Steps} <- planted(),
        {Way, Options} <- ways()
    ].

ways() -> [{reduced, #{}}, {plain, plain()}].

plain() -> #{reduce => false, symmetry => false, leave_out => false, workers => 1}.

%% -- the real machines -------------------------------------------------------------------------

%% Both searches cover everything, the reduced one with fewer states.
sound_test_() ->
    [
        {
            lists:flatten(io_lib:format("~p ~p", [Block, Faults])),
            ?SLOW(
                begin
                    {holds, complete, #{states := Few}} = check(Block, Robots, Faults, #{}),
                    {holds, complete, #{states := Many}} = check(Block, Robots, Faults, plain()),
                    ?assert(Few < Many)
                end
            )
        }
     || {Block, Robots, Faults} <- [
            {sap, 2, #{crash => 1}},
            {sap, 2, #{dup => 1}},
            {election, 2, #{loss => 1, crash => 1}},
            {election, 3, #{late => 1}},
            {bully, 2, #{loss => 1, crash => 1, sap => 1}},
            {mutex, 2, #{loss => 1}},
            {mutex, 2, #{crash => 1}},
            {mutex, 2, #{still => 1}},
            {barrier, 2, #{loss => 1}},
            {barrier, 2, #{timeout => 1}},
            {barrier, 2, #{sap => 1}},
            {terms, 2, #{loss => 1}},
            {terms, 2, #{reboot => 1}},
            {registers, 2, #{crash => 1}},
            {geocast, 2, #{crash => 1}},
            {geocast, 2, #{loss => 1}}
        ]
    ].

%% Two robots, one of which stands still within a step: what rests on votes leaves in time.
standing_coordinator_test_() ->
    ?SLOW(?assertMatch({holds, complete, #{}}, check(terms, 2, #{still => 1}, #{}))).

%% Clocks at both bounds of drift are no reason for another term: without a fault none is claimed.
one_term_without_faults_test() ->
    [One, Two] = [
        check(terms, 3, #{}, #{terms => Terms, workers => 1})
     || Terms <- [1, 2]
    ],
    {holds, complete, Figures} = One,
    ?assertEqual({holds, complete, Figures#{bounds := "up to term 2"}}, Two).

%% With three robots, too, a coordinator's words that leave late are found.
untimely_of_three_test_() ->
    ?SLOW(begin
        Untimely = #{machine => {dpp_coordinator, starl_check_planted, #{variant => untimely}}},
        {violated, #{violation := #{what := What}, steps := Steps}} =
            check(terms, 3, #{still => 1}, Untimely),
        ?assertEqual({two_coordinators, 29}, {What, Steps})
    end).

%% Several processes find exactly what one finds, however fast each is.
spread_test_() ->
    Many = #{workers => 3, spread => 0},
    [
        {
            lists:flatten(io_lib:format("~p ~p", [Block, Faults])),
            ?SLOW(
                begin
                    {holds, complete, Alone} = check(Block, Robots, Faults, #{workers => 1}),
                    ?assertEqual({holds, complete, Alone}, check(Block, Robots, Faults, Many))
                end
            )
        }
     || {Block, Robots, Faults} <- [
            {mutex, 3, #{}},
            {mutex, 3, #{still => 1}},
            {mutex, 2, #{loss => 1, crash => 1}},
            {election, 3, #{late => 1}},
            {barrier, 2, #{timeout => 1}},
            {sap, 2, #{dup => 1}}
        ]
    ].

%% The way to a violation is the same in every run.
spread_violation_test() ->
    Machine = {starl_mutex_planted, #{variant => impatient_home}},
    Alone = check(mutex, 3, #{}, #{machine => Machine, workers => 1}),
    {violated, _} = Alone,
    Many = #{machine => Machine, workers => 3, spread => 0},
    ?assertEqual(Alone, check(mutex, 3, #{}, Many)).

%% A time that is over is over: telling how long makes more states and no difference.
past_test() ->
    {holds, complete, #{states := Few}} = check(mutex, 2, #{crash => 1}, #{}),
    Told = #{past_us => 8000000, waits => [1, 2]},
    {holds, complete, #{states := Many}} = check(mutex, 2, #{crash => 1}, Told),
    ?assert(Few < Many).

%% -- robots that are not alike -----------------------------------------------------------------

%% A bug of one robot's is missed where it is taken for another one; that it is not like the others
%% is seen, and the bug is found.
unlike_test_() ->
    ?SLOW(begin
        Partial = #{machine => {starl_check_planted, #{variant => partial}}, workers => 1},
        {violated, Found} = check(barrier, 2, #{crash => 1}, Partial),
        #{violation := #{what := What}, figures := #{unlike := Unlike}} = Found,
        ?assertEqual(reached_out_of_order, What),
        {violated, Told} = check(barrier, 2, #{crash => 1}, Partial#{symmetry => false}),
        ?assertMatch(#{violation := #{what := What}, figures := #{unlike := none}}, Told),
        ?assertEqual(maps:with([steps, chart], Told), maps:with([steps, chart], Found)),
        Words = unicode:characters_to_list(starl_check:format_unlike(Unlike)),
        ?assertNotEqual(nomatch, string:find(Words, "with robot 1 as 2, 2 as 1"))
    end).

%% A machine may look at its robot's number, which is 1 or 2: what it does then is seen, and searched as it
%% happens in a run. No robot of a search has another number where none changes its place.
%% Holds: The checker numbers robots otherwise than they run
%% Red: 1946faf; told by 790fb0b
numbered_test_() ->
    ?SLOW(begin
        Numbered = #{machine => {starl_check_planted, #{variant => numbered}}, workers => 1},
        {violated, Found} = check(barrier, 2, #{crash => 1}, Numbered),
        ?assertMatch(
            #{violation := #{what := reached_out_of_order}, figures := #{unlike := {number, 2}}},
            Found
        ),
        {violated, Told} = check(barrier, 2, #{crash => 1}, Numbered#{symmetry => false}),
        ?assertMatch(#{figures := #{unlike := none}}, Told),
        ?assertEqual(maps:with([steps, chart], Told), maps:with([steps, chart], Found)),
        Words = starl_check:format_unlike({number, 2}),
        ?assertEqual("robot 2 does something else under its own number", lists:flatten(Words))
    end).

%% What is sent to a number arrives at that robot, if the team has it.
calling_test_() ->
    ?SLOW(begin
        Calling = #{machine => {starl_check_planted, #{variant => calling}}},
        States = fun(More) ->
            {holds, complete, #{states := States}} = check(counter, 2, #{}, More),
            States
        end,
        ?assertEqual(States(Calling), States(Calling#{symmetry => false})),
        ?assert(States(Calling) > States(#{}))
    end).

%% Of those that are alike no difference is seen.
alike_test_() ->
    [
        {
            atom_to_list(Block),
            ?SLOW(
                begin
                    {holds, complete, Figures} = check(Block, 3, Faults, #{workers => 1}),
                    ?assertMatch(#{unlike := none}, Figures)
                end
            )
        }
     || {Block, Faults} <- [
            {election, #{late => 1}}, {mutex, #{}}, {barrier, #{loss => 1}}
        ]
    ].

%% -- clients that wait for ever ----------------------------------------------------------------

%% Though a timer always runs: from the beginning, or once the machine has crashed.
waits_for_ever_test_() ->
    [
        {
            atom_to_list(Variant),
            ?SLOW(
                begin
                    Patient = #{machine => {starl_check_planted, #{variant => Variant}}},
                    {violated, #{violation := #{what := What}, steps := Steps}} =
                        check(election, 2, Faults, maps:merge(Patient, Options)),
                    ?assertEqual({calls_never_end, Needed}, {What, Steps})
                end
            )
        }
     || {Variant, Faults, Needed} <- [{patient, #{}, 0}, {weary, #{crash => 1}, 1}],
        Options <- [#{}, plain(), #{workers => 3, spread => 0}]
    ].

%% -- limits ------------------------------------------------------------------------------------

depth_is_told_test() ->
    {holds, depth, #{depth := Depth, waiting := _}} = check(mutex, 3, #{}, #{depth => 12}),
    ?assert(Depth =< 12).

%% A search without an end says so.
endless_is_told_test_() ->
    ?SLOW(begin
        Counting = #{machine => {starl_check_planted, #{variant => counting}}, workers => 1},
        {holds, endless, #{depth := Depth}} = check(election, 1, #{}, Counting),
        ?assertEqual(4095, Depth),
        {holds, depth, #{}} = check(election, 1, #{}, Counting#{depth => 100})
    end).

memory_is_told_test() ->
    {holds, memory, #{}} = check(mutex, 3, #{}, #{memory => 1}).

interrupted_test() ->
    Stop = {fun(_Figures, State) -> {stop, State} end, none},
    {holds, interrupted, #{states := 1}} = starl_check:run(mutex, #{}, Stop).

%% -- the chart ---------------------------------------------------------------------------------

chart_test() ->
    Machine = {starl_election_bug, #{bug => incomplete}},
    {violated, #{chart := Chart}} = check(election, 3, #{}, #{machine => Machine}),
    Lines = string:lexemes(unicode:characters_to_list(Chart), "\n"),
    ?assertEqual("       robot 1     robot 2     robot 3", string:trim(hd(Lines), trailing)),
    [Arrow] = [Line || "    2" ++ _ = Line <- Lines],
    ?assertMatch("    2   |---------->o           |           ballot" ++ _, Arrow),
    Last = lists:last(Lines),
    ?assertNotEqual(nomatch, string:find(Last, "3 election: {elected,first,3,all_ballots}")).

%% -- words -------------------------------------------------------------------------------------

faults_test() ->
    {ok, Faults} = starl_check:parse_faults("loss:2,crash"),
    ?assertMatch(#{loss := 2, crash := 1, dup := 0, sap := 0}, Faults),
    ?assertEqual({error, {unknown_fault, "flood"}}, starl_check:parse_faults("flood:1")),
    ?assertEqual({error, {bad_count, "loss:x"}}, starl_check:parse_faults("loss:x")),
    ?assertEqual({error, {twice, loss}}, starl_check:parse_faults("loss:1,loss:2")).

%% -- crashes -----------------------------------------------------------------------------------

%% A machine that crashes by itself breaks its contract, however it does, with the place in its
%% code; also when it starts.
own_crash_test_() ->
    [
        {atom_to_list(How), fun() ->
            Machine = {starl_check_crash_planted, #{how => How}},
            {violated, #{violation := Violation}} = check(barrier, 2, #{}, #{machine => Machine}),
            ?assertMatch(
                #{contract := barrier, what := crashed, details := #{reason := Reason}},
                Violation
            ),
            #{details := #{stack := Stack}} = Violation,
            ?assertMatch(
                {match, _},
                re:run(
                    Stack,
                    "starl_check_crash_planted:[a-z_]+/[15] "
                    "\\(starl_check_crash_planted.erl:[0-9]+\\)"
                )
            )
        end}
     || {How, Reason} <- [
            {error, "oops"},
            {exit, "exit with oops"},
            {throw, "thrown and not caught: oops"},
            {start, "oops"}
        ]
    ].

%% An event that no vocabulary knows is a violation, as in a simulation.
unknown_event_test() ->
    Machine = {starl_check_crash_planted, #{how => renamed}},
    {violated, #{violation := Violation}} = check(barrier, 2, #{}, #{machine => Machine}),
    ?assertMatch(
        #{contract := barrier, what := unknown_event, details := #{event := {came, gate, 1}}},
        Violation
    ).
