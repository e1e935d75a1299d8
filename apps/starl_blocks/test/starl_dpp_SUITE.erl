%% The contract of DPP (DESIGN section 3) held by its machines: reservations are pairwise
%% disjoint whatever is lost, doubled or late; a lost assignment keeps its reservation until the
%% next request clears it or its leave ends; a late Clear frees nothing; crashes of the coordinator
%% and of participants keep all that robots hold; who has no quorum assigns nothing.
-module(starl_dpp_SUITE).
-include_lib("stdlib/include/assert.hrl").
-include_lib("proper/include/proper.hrl").

-export([suite/0, all/0, groups/0, init_per_suite/1, end_per_suite/1]).
-export([
    request_certifies_the_place/1, request_without_coordinator/1, answer_is_taken_once/1,
    stale_answers_are_refused/1, lost_answer_is_asked_for_again/1, lost_pose_is_asked_for_again/1,
    ids_ascend_over_a_crash/1, recover_while_standing/1, recover_while_moving/1,
    recover_while_asking/1, crash_stops_the_robot/1, crashed_robot_does_not_vote/1,
    earlier_term_is_refused/1, vote_is_kept/1, leader_is_followed_without_vote/1,
    leave_ends_for_good/1, beats_prolong_leave/1, late_assignment_is_void/1,
    missing_coordinator_is_replaced/1, painted_goes_with_the_next_request/1,
    passed_is_told_now_and_then/1,
    nothing_is_assigned_before_all_are_known/1, nothing_is_assigned_without_votes/1,
    votes_run_out/1, each_request_is_answered_once/1,
    old_request_is_ignored/1, late_clear_frees_nothing/1, clear_frees_what_is_behind/1,
    lost_assignment_stays_reserved/1, other_terms_are_ignored/1,
    recovered_reservation_is_kept/1, silent_robot_keeps_all_until_its_leave_ends/1,
    late_report_of_a_silent_robot/1, unreachable_unknown_robot_ends/1,
    coordinator_crashes_while_robots_move/1, participant_crashes_while_robots_move/1,
    crashes_at_random/1
]).

-define(CONFIG, #{
    segments => [{{3000.0, 3000.0}, {7000.0, 3000.0}}, {{3000.0, 7000.0}, {7000.0, 7000.0}}],
    world => {10000.0, 10000.0}, tube_radius => 220.0, slack => 10.0, horizon => 2000.0,
    seed => 1
}).
-define(S, 1000000).

suite() -> [{timetrap, {minutes, 2}}].

all() -> [{group, participant}, {group, coordinator}, {group, simulated}].

groups() ->
    [
        {participant, [], [
            request_certifies_the_place, request_without_coordinator, answer_is_taken_once,
            stale_answers_are_refused, lost_answer_is_asked_for_again,
            lost_pose_is_asked_for_again, ids_ascend_over_a_crash, recover_while_standing,
            recover_while_moving, recover_while_asking, crash_stops_the_robot,
            crashed_robot_does_not_vote, earlier_term_is_refused, vote_is_kept,
            leader_is_followed_without_vote, leave_ends_for_good, beats_prolong_leave,
            late_assignment_is_void, missing_coordinator_is_replaced,
            painted_goes_with_the_next_request, passed_is_told_now_and_then
        ]},
        {coordinator, [], [
            nothing_is_assigned_before_all_are_known, nothing_is_assigned_without_votes,
            votes_run_out, each_request_is_answered_once,
            old_request_is_ignored, late_clear_frees_nothing, clear_frees_what_is_behind,
            lost_assignment_stays_reserved, other_terms_are_ignored,
            recovered_reservation_is_kept, silent_robot_keeps_all_until_its_leave_ends,
            late_report_of_a_silent_robot, unreachable_unknown_robot_ends
        ]},
        {simulated, [], [
            coordinator_crashes_while_robots_move, participant_crashes_while_robots_move,
            crashes_at_random
        ]}
    ].

init_per_suite(Config) -> starl_platform_ct:without_log(Config).

end_per_suite(Config) -> starl_platform_ct:with_log(Config).

%% -- the participant ------------------------------------------------------------------------

%% A request says where the robot stands: it is stopped first, then located.
request_certifies_the_place(_) ->
    {Stop, P1} = step({call, {app, 1}}, request, joined()),
    [{call, motion, stop, {halted, N}}] = [A || {call, motion, _, _} = A <- Stop],
    {Look, P2} = step({reply, {halted, N}}, ok, P1),
    ?assertEqual([{call, location, {pose, 1}, {pose, N}}], Look),
    {Ask, _} = step({reply, {pose, N}}, {ok, {1.0, 2.0, 0.0}}, P2),
    ?assertMatch([{4, {{0, 0}, {1, _}, {1.0, 2.0}, [], 0}}], sent(dpp_request, Ask)).

request_without_coordinator(_) ->
    {Actions, _} = step({call, {app, 1}}, request, participant(1)),
    ?assertEqual([{reply, {app, 1}, {error, no_coordinator}}], Actions).

answer_is_taken_once(_) ->
    {Id, P} = asking(led()),
    {Actions, Moving} = answer(4, {1, 4}, Id, P),
    ?assertEqual([{reply, {app, 1}, {ok, {Id, path()}}}], replies(Actions)),
    {Again, _} = answer(4, {1, 4}, Id, Moving),
    ?assertEqual([{trace, {stale_answer, 4, {1, 4}, Id}}], Again).

%% Answers to another request, of another term or of another robot are dropped, and traced.
stale_answers_are_refused(_) ->
    {{I, N} = Id, P} = asking(led()),
    [
        ?assertMatch({[{trace, {stale_answer, _, _, _}}], _}, answer(Source, Term, Which, P))
     || {Source, Term, Which} <- [
            {4, {1, 4}, {I, N - 1}}, {4, {1, 4}, {I, N + 1}}, {4, {0, 4}, Id}, {3, {2, 3}, Id},
            {3, {1, 4}, Id}, {4, {1, 4}, {I + 1, N}}
        ]
    ].

lost_answer_is_asked_for_again(_) ->
    {First, P} = asking(led()),
    {Actions, Again} = step({timeout, again}, request, P),
    [{4, {_, Second, {1.0, 2.0}, [], _}}] = sent(dpp_request, Actions),
    ?assert(Second > First),
    ?assertMatch({[{trace, {stale_answer, _, _, First}}], _}, answer(4, {1, 4}, First, Again)),
    {Taken, _} = answer(4, {1, 4}, Second, Again),
    ?assertMatch([_], replies(Taken)).

lost_pose_is_asked_for_again(_) ->
    {_, P1} = step({call, {app, 1}}, request, joined()),
    {Actions, _} = step({timeout, look}, look, P1),
    ?assertMatch([{call, motion, stop, {halted, _}}, {{timeout, look}, _, look}], Actions).

ids_ascend_over_a_crash(_) ->
    {First, _} = asking(joined()),
    {Second, _} = asking(joined(2)),
    ?assert(Second > First).

%% A coordinator that begins is told where the robot stands, once it is stopped and seen; once.
recover_while_standing(_) ->
    {Stop, P1} = recover(3, {1, 3}, participant(1)),
    {Told, P2} = located(Stop, P1),
    ?assertMatch([{3, {{1, 3}, _, {standing, {1.0, 2.0}}, [], {7, 0, true}}}],
                 sent(dpp_state, Told)),
    [{call, motion, stop, {halted, N}}] = [A || {call, motion, _, _} = A <- Stop],
    {Twice, _} = step({reply, {pose, N}}, {ok, {1.0, 2.0, 0.0}}, P2),
    ?assertEqual([], sent(dpp_state, Twice)).

%% Or what of its path is before it.
recover_while_moving(_) ->
    {Id, Moving} = moving(),
    {_, Passed} = drive(Id, 1, Moving),
    {Told, _} = recover(4, {2, 4}, Passed),
    [{First, _} | Rest] = path(),
    ?assertEqual([{4, {{2, 4}, Id, {moving, 1, First, Rest}, [7], {7, 0, true}}}],
                 sent(dpp_state, Told)).

%% A robot that asks tells its place and asks anew; an answer of the term before is refused.
recover_while_asking(_) ->
    {Id, P} = asking(led()),
    {Told, Aware} = recover(4, {2, 4}, P),
    ?assertMatch([{4, {{2, 4}, Id, {standing, {1.0, 2.0}}, [], _}}], sent(dpp_state, Told)),
    ?assertMatch([_], [A || {{timeout, again}, _, _} = A <- Told]),
    ?assertMatch({[{trace, {stale_answer, _, _, _}}], _}, answer(4, {1, 4}, Id, Aware)).

%% Pitfall: a participant that has crashed does not know whether its robot drives: it stops it.
crash_stops_the_robot(_) ->
    ?assertEqual([], [A || {cast, motion, stop} = A <- started(1)]),
    ?assertMatch([_], [A || {cast, motion, stop} = A <- started(2)]).

%% Pitfall: it has forgotten its vote, too, and must not give a second one while that lasts.
crashed_robot_does_not_vote(_) ->
    {Refused, P} = recover(3, {1, 3}, participant(2)),
    ?assertEqual([{3, {0, 0}}], sent(dpp_refused, Refused)),
    {Stop, P1} = at(10 * ?S, cast, {message, 3, dpp_recover, {{1, 3}, 9, false}}, P),
    {Told, _} = located(10 * ?S, Stop, P1),
    ?assertMatch([{3, {_, _, _, _, {9, _, true}}}], sent(dpp_state, Told)).

earlier_term_is_refused(_) ->
    {Actions, P} = recover(3, {0, 3}, led()),
    ?assertEqual([{3, {1, 4}}], sent(dpp_refused, Actions)),
    {Beat, _} = step(cast, {message, 3, dpp_beat, {{0, 3}, 1, [{1, 5}]}}, P),
    ?assertEqual([{3, {1, 4}}], sent(dpp_refused, Beat)).

%% It has voted for robot 4 for ten seconds: before they are over robot 3 gets no vote.
vote_is_kept(_) ->
    {Early, P} = at(9 * ?S, cast, {message, 3, dpp_recover, {{2, 3}, 7, false}}, led()),
    ?assertEqual([{3, {1, 4}}], sent(dpp_refused, Early)),
    {Late, P1} = at(10 * ?S, cast, {message, 3, dpp_recover, {{2, 3}, 8, false}}, P),
    {Told, _} = located(10 * ?S, Late, P1),
    ?assertMatch([{3, {{2, 3}, _, _, _, {8, _, true}}}], sent(dpp_state, Told)).

%% One that leads is followed at once, but has no vote while it is promised to another.
leader_is_followed_without_vote(_) ->
    {Stop, P} = step(cast, {message, 3, dpp_beat, {{2, 3}, 5, []}}, led()),
    {Told, _} = located(Stop, P),
    ?assertMatch([{3, {{2, 3}, _, _, _, {5, 0, false}}}], sent(dpp_state, Told)).

%% At the end of its leave the robot stops; a beat that comes later does not bring it back.
leave_ends_for_good(_) ->
    {Id, Moving} = moving(),
    {Go, Driving} = step({call, {app, 2}}, {drive, Id, 1}, Moving),
    ?assertEqual([{call, motion, {go_to, {100.0, 2.0}}, {driven, Id, 1}}], Go),
    {Early, _} = at(9 * ?S, {timeout, leave}, leave, Driving),
    ?assertMatch([{{timeout, leave}, _, leave}], Early),
    {Late, Void} = at(10 * ?S, {timeout, leave}, leave, Driving),
    ?assert(lists:member({cast, motion, stop}, Late)),
    ?assertEqual([{reply, {app, 2}, {error, void}}], replies(Late)),
    {_, Told} = at(10 * ?S, cast, {message, 4, dpp_beat, {{1, 4}, 9, [{1, 9 * ?S}]}}, Void),
    {Refused, _} = at(10 * ?S, {call, {app, 3}}, {drive, Id, 1}, Told),
    ?assertEqual([{reply, {app, 3}, {error, void}}], Refused).

beats_prolong_leave(_) ->
    {Id, Moving} = moving(),
    {_, Driving} = step({call, {app, 2}}, {drive, Id, 1}, Moving),
    {_, Beaten} = at(6 * ?S, cast, {message, 4, dpp_beat, {{1, 4}, 9, [{1, 5 * ?S}]}}, Driving),
    {Still, _} = at(14 * ?S, {timeout, leave}, leave, Beaten),
    ?assertMatch([{{timeout, leave}, _, leave}], Still),
    {Over, _} = at(15 * ?S, {timeout, leave}, leave, Beaten),
    ?assert(lists:member({cast, motion, stop}, Over)).

%% An assignment that was long on its way: its leave has ended, the robot asks anew.
late_assignment_is_void(_) ->
    {Id, P} = asking(led()),
    {Actions, _} =
        at(10 * ?S, cast, {message, 4, dpp_answer, {{1, 4}, Id, assignment(), []}}, P),
    ?assertEqual([], replies(Actions)),
    ?assertMatch([{4, {_, _, _, _, _}}], sent(dpp_request, Actions)).

missing_coordinator_is_replaced(_) ->
    {Actions, _} = at(30 * ?S, {timeout, missing}, missing, led()),
    ?assert(lists:member({cast, dpp_coordinator, {lead, 1}}, Actions)).

painted_goes_with_the_next_request(_) ->
    {Id, Moving} = moving(),
    {_, Passed} = drive(Id, 1, Moving),
    {Stop, P1} = step({call, {app, 2}}, request, Passed),
    {Ask, _} = located(Stop, P1),
    ?assertMatch([{4, {_, _, _, [7], _}}], sent(dpp_request, Ask)).

passed_is_told_now_and_then(_) ->
    {Id, Moving} = moving(),
    {Near, P1} = drive(Id, 1, Moving),
    ?assertEqual([], sent(dpp_passed, Near)),
    {_, P2} = drive(Id, 2, P1),
    {Far, _} = drive(Id, 3, P2),
    ?assertEqual([{4, {{1, 4}, Id, 3}}], sent(dpp_passed, Far)).

participant(Life) ->
    {_, P} = starl_machine:new(starl_dpp_participant, #{}, base(1, dpp, Life, [1, 2, 3, 4])),
    P.

started(Life) ->
    {Actions, _} = starl_machine:new(starl_dpp_participant, #{}, base(1, dpp, Life, [1, 2, 3, 4])),
    Actions.

joined() -> joined(1).

joined(Life) ->
    {Joined, P} = step({call, {app, 0}}, {join, 4}, participant(Life)),
    [{reply, _, ok}] = replies(Joined),
    P.

%% A participant that has voted for robot 4.
led() ->
    {Stop, P} = recover(4, {1, 4}, joined()),
    {_, Led} = located(Stop, P),
    Led.

recover(Source, Term, P) -> step(cast, {message, Source, dpp_recover, {Term, 7, false}}, P).

%% The robot is stopped and seen.
located(Stop, P) -> located(0, Stop, P).

located(Now, Stop, P) ->
    [{call, motion, stop, {halted, N}}] = [A || {call, motion, _, _} = A <- Stop],
    {_, P2} = at(Now, {reply, {halted, N}}, ok, P),
    at(Now, {reply, {pose, N}}, {ok, {1.0, 2.0, 0.0}}, P2).

%% A participant that waits for an answer, and its request.
asking(P0) ->
    {Stop, P1} = step({call, {app, 1}}, request, P0),
    {Ask, P2} = located(Stop, P1),
    [{4, {_, Id, _, _, _}}] = sent(dpp_request, Ask),
    {Id, P2}.

moving() ->
    {Id, P} = asking(led()),
    {_, Moving} = answer(4, {1, 4}, Id, P),
    {Id, Moving}.

drive(Id, N, P) ->
    {_, Driving} = step({call, {app, drive}}, {drive, Id, N}, P),
    step({reply, {driven, Id, N}}, ok, Driving).

answer(Source, Term, Id, P) ->
    step(cast, {message, Source, dpp_answer, {Term, Id, assignment(), []}}, P).

assignment() -> {assign, {1.0, 2.0}, path()}.

path() -> [{{100.0, 2.0}, {down, 7}}, {{300.0, 2.0}, up}, {{900.0, 2.0}, {down, 8}}].

replies(Actions) -> [A || {reply, _, _} = A <- Actions].

%% The messages of a type, to whom and what.
sent(Type, Actions) ->
    [{To, Body} || {cast, sap, {send, To, T, Body}} <- Actions, T =:= Type] ++
        [{To, Body} || {call, sap, {send, To, T, Body}, _} <- Actions, T =:= Type].

%% -- the coordinator ------------------------------------------------------------------------

%% A team of two, whose first robot is a quorum.
nothing_is_assigned_before_all_are_known(_) ->
    {First, C1} = claimed([1, 2]),
    ?assertMatch([{{1, 1}, _, false}], [B || {cast, sap, {broadcast, dpp_recover, B}} <- First]),
    {_, C2} = state(1, {standing, spot(1)}, C1),
    {Asked, C3} = ask(1, 1, spot(1), C2),
    ?assertEqual([], answers(Asked)),
    {Known, C4} = state(2, {standing, spot(2)}, C3),
    ?assert(lists:member({trace, {coordinator, {1, 1}}}, Known)),
    {Second, _} = ask(2, 1, spot(2), C4),
    ?assertMatch([{2, {assign, _, _}} | _], answers(Second)).

%% All robots are known, but not enough of them vote.
nothing_is_assigned_without_votes(_) ->
    {_, C1} = claimed([1, 2, 3]),
    C2 = lists:foldl(
        fun(R, C) ->
            {_, Next} = state(R, {standing, spot(R)}, {1, 0, R =:= 2}, C),
            Next
        end,
        C1, [2, 3, 1]
    ),
    {Actions, C3} = ask(1, 1, spot(1), C2),
    ?assertEqual([], answers(Actions)),
    {Won, _} = step(cast, {message, 3, dpp_here, {{1, 1}, {1, 1, true}}}, C3),
    ?assert(lists:member({trace, {leads, {1, 1}}}, Won)).

%% Votes last for ten seconds from the beat that they answer. Then nothing is assigned.
votes_run_out(_) ->
    C = open(),
    {Early, _} = at(9 * ?S, cast, asks(2, 1, spot(2)), C),
    ?assertMatch([{2, {assign, _, _}} | _], answers(Early)),
    {Late, _} = at(10 * ?S, cast, asks(2, 1, spot(2)), C),
    ?assertEqual([], answers(Late)),
    ?assert(lists:member({trace, {stepped_down, {1, 1}}}, Late)).

%% Each request gets one answer; a doubled request gets no second one.
each_request_is_answered_once(_) ->
    {_, Id, _, C} = assigned(),
    {Again, _} = request(2, Id, spot(2), C),
    ?assertEqual([], Again).

old_request_is_ignored(_) ->
    {_, {I, N}, Held, C} = assigned(),
    {Old, C1} = request(2, {I, N - 1}, spot(2), C),
    ?assertEqual([], Old),
    ?assertEqual(Held, held(2, C1)).

%% Pitfall: a late or doubled Clear of an earlier path frees space of the present one.
late_clear_frees_nothing(_) ->
    {_, {I, N}, Held, C} = assigned(),
    {Late, C1} = step(cast, {message, 2, dpp_passed, {{1, 1}, {I, N - 1}, 1}}, C),
    ?assertEqual([], Late),
    ?assertEqual(Held, held(2, C1)).

clear_frees_what_is_behind(_) ->
    {_, Id, Held, C} = assigned(),
    {_, C1} = step(cast, {message, 2, dpp_passed, {{1, 1}, Id, 1}}, C),
    Left = held(2, C1),
    ?assertNotEqual(Held, Left),
    {_, C2} = step(cast, {message, 2, dpp_passed, {{1, 1}, Id, 1}}, C1),
    ?assertEqual(Left, held(2, C2)).

%% Pitfall: the assignment is lost, the reservation stays; the robot's next request clears it.
lost_assignment_stays_reserved(_) ->
    {_, {I, N}, Held, C} = assigned(),
    {_, C1} = step({reply, {answered, {1, 1}, 2}}, {error, lost}, C),
    ?assertEqual(Held, held(2, C1)),
    {Next, C2} = request(2, {I, N + 5}, spot(2), C1),
    ?assertMatch([{2, {assign, _, _}} | _], answers(Next)),
    ?assertMatch([_ | _], held(2, C2)).

%% What was said before this term says nothing of what another coordinator has assigned since:
%% the robot is told of the term. A later term begins a new claim.
other_terms_are_ignored(_) ->
    C = open(),
    Early = {message, 2, dpp_request, {{0, 0}, {1, 9}, spot(1), [], 0}},
    {Told, C1} = step(cast, Early, C),
    ?assertEqual([], answers(Told)),
    ?assertMatch([{2, {{1, 1}, _, true}}], sent(dpp_recover, Told)),
    ?assertEqual([{spot(2), spot(2)}], held(2, C1)),
    {Higher, _} = step(cast, {message, 2, dpp_refused, {4, 2}}, C1),
    ?assert(lists:member({trace, {claims, {5, 1}}}, Higher)).

%% What a robot says that it holds is its reservation with the new coordinator, too.
recovered_reservation_is_kept(_) ->
    {[{2, {assign, From, Path}} | _], _, Held, _} = assigned(),
    {_, C1} = claimed([1, 2]),
    {_, C2} = state(1, {standing, spot(1)}, C1),
    {_, C3} = state(2, {moving, 0, From, Path}, C2),
    ?assertEqual(Held, held(2, C3)),
    %% and a doubled report changes nothing
    {Twice, _} = state(2, {moving, 0, From, Path}, C3),
    ?assertEqual([], sent(dpp_answer, Twice)).

%% Robot 2 has an assignment and is not heard again: before its leave has surely ended it keeps
%% everything; then it is looked for, and holds the place where it stands.
silent_robot_keeps_all_until_its_leave_ends(_) ->
    {_, _, Held, C} = assigned(),
    C1 = at_beats(lists:seq(1, 10), C),
    ?assertEqual(Held, held(2, C1)),
    {Looks, C2} = at(11 * ?S, {timeout, beat}, beat, voted(10, C1)),
    ?assert(lists:member({call, location, {pose, 2}, {rest, {1, 1}, 2}}, Looks)),
    ?assertEqual(Held, held(2, C2)),
    {X, Y} = spot(2),
    {Found, C3} = at(11 * ?S, {reply, {rest, {1, 1}, 2}}, {ok, {X, Y, 0.0}}, C2),
    ?assert(lists:member({trace, {silent, 2}}, Found)),
    ?assertEqual([{spot(2), spot(2)}], held(2, C3)).

%% Pitfall: a report of a moving robot that was so long on its way that the robot has been found
%% standing meanwhile gives it nothing back.
late_report_of_a_silent_robot(_) ->
    {[{2, {assign, From, Path}} | _], _, _, _} = assigned(),
    {_, C1} = claimed([1, 2]),
    {_, C2} = state(1, {standing, spot(1)}, C1),
    C3 = at_beats(lists:seq(1, 10), C2),
    {_, C4} = at(11 * ?S, {timeout, beat}, beat, voted(10, C3)),
    {X, Y} = spot(2),
    {_, C5} = at(11 * ?S, {reply, {rest, {1, 1}, 2}}, {ok, {X, Y, 0.0}}, C4),
    Late = {{1, 1}, {1, 5}, {moving, 0, From, Path}, [], {1, 0, true}},
    {_, C6} = at(11 * ?S, cast, {message, 2, dpp_state, Late}, C5),
    ?assertEqual([{spot(2), spot(2)}], held(2, C6)).

%% Beats every second, which only the own participant answers.
at_beats(Seconds, C) ->
    lists:foldl(
        fun(T, C0) ->
            {_, C1} = at(T * ?S, {timeout, beat}, beat, C0),
            voted(T, C1)
        end,
        C, Seconds
    ).

voted(T, C) ->
    #{seq := Seq} = beats(C),
    {_, Voted} = at(T * ?S, cast, {message, 1, dpp_here, {{1, 1}, {Seq, T * ?S, true}}}, C),
    Voted.

%% The number of the next beat, by having one sent and thrown away.
beats(C) ->
    {Actions, _} = at(0, {timeout, beat}, beat, C),
    [Seq] = [S || {cast, sap, {shout, dpp_beat, {_, S, _}}} <- Actions],
    #{seq => Seq - 1}.

%% A robot that nobody finds does not stop the others for ever: who waits gets an answer in
%% bounded time.
unreachable_unknown_robot_ends(_) ->
    {_, C1} = claimed([1, 2]),
    {_, C2} = state(1, {standing, spot(1)}, C1),
    {Asked, C3} = ask(1, 1, spot(1), C2),
    [{_, Us, give_up}] = [A || {{timeout, give_up}, _, _} = A <- Asked],
    C4 = at_beats(lists:seq(1, Us div ?S), C3),
    {Ended, _} = at(Us, {timeout, give_up}, give_up, C4),
    ?assertEqual([{1, incomplete}], answers(Ended)).

%% A coordinator that was asked for a path and claims a term.
claimed(Team) ->
    {_, C} = starl_machine:new(
        starl_dpp_coordinator, ?CONFIG, base(1, dpp_coordinator, 1, Team)
    ),
    step(cast, {message, 1, dpp_request, {{0, 0}, {1, 0}, spot(1), [], 0}}, C).

state(Robot, Place, C) -> state(Robot, Place, {1, 0, true}, C).

state(Robot, Place, Ballot, C) ->
    step(cast, {message, Robot, dpp_state, {{1, 1}, {1, 0}, Place, [], Ballot}}, C).

%% It leads, and both robots are known.
open() ->
    {_, C1} = claimed([1, 2]),
    {_, C2} = state(1, {standing, spot(1)}, C1),
    {_, C3} = state(2, {standing, spot(2)}, C2),
    C3.

%% Robot 2 has an assignment: the answers, its request, what it holds.
assigned() ->
    {Actions, C} = ask(2, 5, spot(2), open()),
    [{2, {assign, _, _}} | _] = Answers = answers(Actions),
    {Answers, {1, 5}, held(2, C), C}.

ask(Robot, N, At, C) -> request(Robot, {1, N}, At, C).

request(Robot, Id, At, C) -> step(cast, asks(Robot, element(2, Id), At), C).

asks(Robot, N, At) -> {message, Robot, dpp_request, {{1, 1}, {1, N}, At, [], 0}}.

answers(Actions) ->
    [{R, A} || {call, sap, {send, R, dpp_answer, {_, _, A, _}}, _} <- Actions].

%% What the plan inside the coordinator holds for a robot.
held(Robot, C) ->
    [Serve] = records(serve, starl_machine:data(C)),
    [Plan] = records(plan, Serve),
    starl_dpp_plan:held(Robot, Plan).

records(Tag, Record) ->
    [R || R <- tuple_to_list(Record), is_tuple(R), R =/= {}, element(1, R) =:= Tag,
          tuple_size(R) > 5].

spot(Robot) ->
    {ok, Plan} = starl_dpp_plan:new((?CONFIG)#{robots => [1, 2]}),
    starl_dpp_plan:spot((Robot - 1) rem 2 + 1, Plan).

base(Robot, Name, Life, Team) ->
    #{
        robot => Robot, participants => Team, name => Name, incarnation => Life,
        random => rand:seed_s(exsss, 1), now => 0
    }.

step(Type, Content, M) -> at(0, Type, Content, M).

at(Now, Type, Content, M) -> starl_machine:step(Type, Content, #{now => Now, robot => 1}, M).

%% -- in the simulator: the monitors judge ---------------------------------------------------

%% The coordinator of every robot is killed at every three seconds of a run with loss.
coordinator_crashes_while_robots_move(_) ->
    [
        paints(Seed, 0.3, [{T + Seed * 500, R, dpp_coordinator} || T <- lists:seq(2000, 90000, 6000),
                                                        R <- [1, 2, 3, 4]])
     || Seed <- [1, 2, 3]
    ].

%% Likewise the participants, while their applications drive on.
participant_crashes_while_robots_move(_) ->
    [
        paints(Seed, 0.3, [{T + 700 * R, R, dpp} || T <- lists:seq(2000, 90000, 7000), R <- [1, 2, 3, 4]])
     || Seed <- [1, 2, 3]
    ].

crashes_at_random(_) ->
    Prop = ?FORALL(
        {Seed, Loss, Kills},
        {oneof(lists:seq(1, 1000)), oneof([0.0, 0.2, 0.4]),
         resize(30, list({oneof(lists:seq(0, 90000, 17)), oneof([1, 2, 3, 4]),
                          oneof([dpp, dpp_coordinator])}))},
        starl_platform_ct:safely(fun() -> paints(Seed, Loss, Kills) end)
    ),
    starl_platform_ct:property(Prop, 20).

paints(Seed, Loss, Kills) ->
    Faults = [
        {starl_platform_ct:fault_id(fault, K), T, T, kill_machine, {R, M}, #{}}
     || {K, {T, R, M}} <- lists:zip(lists:seq(1, length(Kills)), Kills)
    ],
    {ok, Sim} = starl_sim:start(#{
        app => starl_painting, robots => 4, picture => "house", seed => Seed, loss => Loss,
        duplicate => 0.2, delay => {5, 80}, faults => Faults, time => 5000
    }),
    #{ending := Ending} = starl_sim:run(Sim),
    {#{violations := Violations, robots := Robots}, #{figures := Figures}} = starl_sim:finish(Sim),
    ?assertEqual(
        {[], done, 1.0, [{done, complete}]},
        {Violations, Ending, proplists:get_value(ink_covered, Figures),
         lists:usort([S || {_, #{result := S}} <- Robots])},
        {Seed, Loss, Kills}
    ),
    true.
