%% The contract of DPP (README), the part that its participants keep: a request certifies where the
%% robot stands; an answer is taken once, and only the present one's; a path is void for ever once
%% its lease has ended; a vote is given once; a crash stops the robot. The machine is stepped by
%% hand. The coordinator: starl_dpp_coordinator_SUITE; both in runs: starl_dpp_crash_SUITE.
-module(starl_dpp_participant_SUITE).
-include_lib("stdlib/include/assert.hrl").
-import(starl_dpp_ct, [base/4, base/5, step/3, at/4, sent/2]).

-export([suite/0, all/0]).
-export([
    request_certifies_the_place/1,
    request_without_coordinator/1,
    waiting_on_is_no_new_request/1,
    a_late_answer_is_not_lost/1,
    answer_is_taken_once/1,
    stale_answers_are_refused/1,
    answer_in_no_time/1,
    asked_to_ask_again/1,
    asked_to_count_above/1,
    lost_answer_is_asked_for_again/1,
    lost_pose_is_asked_for_again/1,
    ids_ascend_over_a_crash/1,
    recover_while_standing/1,
    recover_while_moving/1,
    recover_while_asking/1,
    crash_stops_the_robot/1,
    crashed_robot_does_not_vote/1,
    earlier_term_is_refused/1,
    vote_is_kept/1,
    leader_is_followed_without_vote/1,
    lease_ends_for_good/1,
    paused_past_its_lease/1,
    stands_still_past_its_lease/1,
    claim_shows_that_the_clock_stood_still/1,
    stamps_from_before_the_clock_stood_still_are_void/1,
    faces_only_by_lease/1,
    failed_drive_is_told_once/1,
    faced_is_told_once/1,
    answers_tell_of_paint/1,
    beats_prolong_lease/1,
    late_assignment_is_void/1,
    missing_coordinator_is_replaced/1,
    painted_goes_with_the_next_request/1,
    passed_is_told_now_and_then/1,
    term_is_stored_first/1,
    reboot_forgets_no_term/1,
    reboot_tells_its_place/1,
    damaged_term_is_the_highest/1,
    wrong_clock_is_told/1,
    what_is_in_the_way_is_told/1,
    short_lease_is_answered_more_often/1,
    own_coordinator_hears_of_each_term/1,
    no_answer_at_all/1,
    no_answer_though_the_coordinator_is_heard/1,
    deaf_robot_does_not_ask/1,
    unsent_request_is_sent_again/1,
    crashed_sap_is_told_who_listens/1,
    crashed_motion_is_told_to_go_on/1,
    late_timers_mean_nothing/1,
    only_known_events_count/1,
    on_its_path_by_the_slack_alone/1,
    request_ends_the_drive/1,
    timers_while_it_asks/1,
    place_is_looked_for_first/1,
    late_look_ends_the_looking/1,
    lease_is_over_at_its_end/1,
    drives_its_own_lines_only/1,
    told_of_each_way_once/1,
    recover_before_it_is_seen/1
]).

-define(S, 1000000).
%% An answer comes over the air.
-define(AIR_US, 30000).

suite() -> [{timetrap, {minutes, 2}}].

all() ->
    [
        request_certifies_the_place,
        request_without_coordinator,
        waiting_on_is_no_new_request,
        a_late_answer_is_not_lost,
        answer_is_taken_once,
        stale_answers_are_refused,
        answer_in_no_time,
        asked_to_ask_again,
        asked_to_count_above,
        lost_answer_is_asked_for_again,
        lost_pose_is_asked_for_again,
        ids_ascend_over_a_crash,
        recover_while_standing,
        recover_while_moving,
        recover_while_asking,
        crash_stops_the_robot,
        crashed_robot_does_not_vote,
        term_is_stored_first,
        reboot_forgets_no_term,
        reboot_tells_its_place,
        damaged_term_is_the_highest,
        wrong_clock_is_told,
        what_is_in_the_way_is_told,
        short_lease_is_answered_more_often,
        earlier_term_is_refused,
        vote_is_kept,
        leader_is_followed_without_vote,
        lease_ends_for_good,
        paused_past_its_lease,
        stands_still_past_its_lease,
        claim_shows_that_the_clock_stood_still,
        stamps_from_before_the_clock_stood_still_are_void,
        faces_only_by_lease,
        failed_drive_is_told_once,
        faced_is_told_once,
        answers_tell_of_paint,
        beats_prolong_lease,
        late_assignment_is_void,
        missing_coordinator_is_replaced,
        painted_goes_with_the_next_request,
        passed_is_told_now_and_then,
        own_coordinator_hears_of_each_term,
        no_answer_at_all,
        no_answer_though_the_coordinator_is_heard,
        deaf_robot_does_not_ask,
        unsent_request_is_sent_again,
        crashed_sap_is_told_who_listens,
        crashed_motion_is_told_to_go_on,
        late_timers_mean_nothing,
        only_known_events_count,
        on_its_path_by_the_slack_alone,
        request_ends_the_drive,
        timers_while_it_asks,
        place_is_looked_for_first,
        late_look_ends_the_looking,
        lease_is_over_at_its_end,
        drives_its_own_lines_only,
        told_of_each_way_once,
        recover_before_it_is_seen
    ].

%% A request says where the robot stands: it is stopped first, then located.
request_certifies_the_place(_) ->
    {Stop, P1} = step({call, {app, 1}}, request, joined()),
    [{call, motion, stop, {halted, N}}] = [A || {call, motion, _, _} = A <- Stop],
    {Look, P2} = step({reply, {halted, N}}, ok, P1),
    ?assertEqual([{call, location, {pose, 1}, {pose, N}}], Look),
    {Ask, _} = step({reply, {pose, N}}, {ok, {1.0, 2.0, 0.0}}, P2),
    ?assertMatch([{4, {{0, 0, 0}, {1, _}, {1.0, 2.0}, [], 0}}], sent(dpp_request, Ask)).

request_without_coordinator(_) ->
    {Actions, _} = step({call, {app, 1}}, request, participant(1)),
    ?assertEqual([{reply, {app, 1}, {error, no_coordinator}}], Actions).

%% The one that waits now gets the answer; nothing is sent, and no time begins anew.
waiting_on_is_no_new_request(_) ->
    {Id, P} = asking(led()),
    {[], Waiting} = step({call, {app, 2}}, wait, P),
    {Actions, _} = answer(4, {1, 4, 1}, Id, Waiting),
    ?assertEqual([{reply, {app, 2}, {ok, {Id, {1.0, 2.0}, path()}}}], replies(Actions)).

%% A path that came after its caller had gone is given to the next one, unless it is driven already.
a_late_answer_is_not_lost(_) ->
    {Id, Moving} = moving(),
    {Actions, _} = step({call, {app, 2}}, wait, Moving),
    ?assertEqual([{reply, {app, 2}, {ok, {Id, {1.0, 2.0}, path()}}}], Actions),
    {_, Driven} = drive(Id, 1, Moving),
    {Asks, _} = step({call, {app, 2}}, wait, Driven),
    ?assertMatch([{call, motion, stop, _}], [A || {call, motion, _, _} = A <- Asks]),
    ?assertEqual([], replies(Asks)).

answer_is_taken_once(_) ->
    {Id, P} = asking(led()),
    {Actions, Moving} = answer(4, {1, 4, 1}, Id, P),
    ?assertEqual([{reply, {app, 1}, {ok, {Id, {1.0, 2.0}, path()}}}], replies(Actions)),
    {Again, _} = answer(4, {1, 4, 1}, Id, Moving),
    ?assertEqual([{trace, {stale_answer, 4, {1, 4, 1}, Id}}], Again).

%% Answers to another request, of another term or of another robot are dropped, and traced.
stale_answers_are_refused(_) ->
    {{I, N} = Id, P} = asking(led()),
    [
        ?assertMatch({[{trace, {stale_answer, _, _, _}}], _}, answer(Source, Term, Which, P))
     || {Source, Term, Which} <- [
            {4, {1, 4, 1}, {I, N - 1}},
            {4, {1, 4, 1}, {I, N + 1}},
            {4, {0, 4, 1}, Id},
            {3, {2, 3, 1}, Id},
            {3, {1, 4, 1}, Id},
            {4, {1, 4, 1}, {I + 1, N}}
        ]
    ].

%% By a clock that stands still, or was set back, nobody knows when the lease ends: the path is not
%% taken. The coordinator's own robot is answered at once.
answer_in_no_time(_) ->
    {Id, P} = asking(led()),
    Answer = {message, 4, dpp_answer, {{1, 4, 1}, Id, assignment(), []}},
    [
        begin
            {Actions, _} = at(Us, cast, Answer, P),
            ?assertMatch({[], [{{timeout, again}, _, request}]}, {replies(Actions), Actions})
        end
     || Us <- [0, -2 * ?S]
    ],
    {Taken, _} = at(1, cast, Answer, P),
    ?assertMatch([_], replies(Taken)).

%% The coordinator knows this stamp for a lease: it has to be another.
asked_to_ask_again(_) ->
    {Id, P} = asking(led()),
    {Actions, Told} = at(?AIR_US, cast, {message, 4, dpp_answer, {{1, 4, 1}, Id, again, []}}, P),
    ?assertMatch([{{timeout, again}, _, request}], Actions),
    {Ask, _} = at(?S, {timeout, again}, request, Told),
    ?assertMatch([{4, {_, _, {1.0, 2.0}, [], ?S}}], sent(dpp_request, Ask)).

%% The next request has a number above the one that the coordinator has heard of. An answer to that
%% one is a stale one.
asked_to_count_above(_) ->
    {Id, P} = asking(led()),
    Above = {{1, 4, 1}, Id, {above, {9, 9}}, []},
    {_, Told} = at(?AIR_US, cast, {message, 4, dpp_answer, Above}, P),
    Forged = {{1, 4, 1}, {9, 9}, complete, []},
    {Stale, _} = at(?AIR_US, cast, {message, 4, dpp_answer, Forged}, Told),
    ?assertEqual([{trace, {stale_answer, 4, {1, 4, 1}, {9, 9}}}], Stale),
    {Ask, _} = at(?S, {timeout, again}, request, Told),
    ?assertMatch([{4, {_, {9, N}, {1.0, 2.0}, [], ?S}}] when N > 9, sent(dpp_request, Ask)).

lost_answer_is_asked_for_again(_) ->
    {First, P} = asking(led()),
    {Actions, Again} = step({timeout, again}, request, P),
    [{4, {_, Second, {1.0, 2.0}, [], _}}] = sent(dpp_request, Actions),
    ?assert(Second > First),
    ?assertMatch({[{trace, {stale_answer, _, _, First}}], _}, answer(4, {1, 4, 1}, First, Again)),
    {Taken, _} = answer(4, {1, 4, 1}, Second, Again),
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
    {Stop, P1} = recover(3, {1, 3, 1}, participant(1)),
    {Told, P2} = located(Stop, P1),
    ?assertMatch(
        [{3, {{1, 3, 1}, _, {standing, {1.0, 2.0}}, [], {7, 0, true}}}],
        sent(dpp_state, Told)
    ),
    [{call, motion, stop, {halted, N}}] = [A || {call, motion, _, _} = A <- Stop],
    {Twice, _} = step({reply, {pose, N}}, {ok, {1.0, 2.0, 0.0}}, P2),
    ?assertEqual([], sent(dpp_state, Twice)).

%% Or what of its path is before it.
recover_while_moving(_) ->
    {Id, Moving} = moving(),
    {_, Passed} = drive(Id, 1, Moving),
    {Told, _} = recover(4, {2, 4, 1}, Passed),
    [{First, _} | Rest] = path(),
    ?assertEqual(
        [{4, {{2, 4, 1}, Id, {moving, 1, First, Rest}, [7], {7, 0, true}}}],
        sent(dpp_state, Told)
    ).

%% One that asks, and has not been seen yet, is seen first: then it tells its place, and asks.
recover_before_it_is_seen(_) ->
    {_, P1} = step({call, {app, 1}}, request, led()),
    {Stop, P2} = recover(4, {2, 4, 1}, P1),
    ?assertEqual([], sent(dpp_state, Stop)),
    {Told, _} = located(Stop, P2),
    ?assertMatch([{4, {{2, 4, 1}, _, {standing, {1.0, 2.0}}, [], _}}], sent(dpp_state, Told)),
    ?assertMatch([{4, {{2, 4, 1}, _, {1.0, 2.0}, [], _}}], sent(dpp_request, Told)).

%% A robot that asks tells its place and asks anew; an answer of the term before is refused.
recover_while_asking(_) ->
    {Id, P} = asking(led()),
    {Told, Aware} = recover(4, {2, 4, 1}, P),
    ?assertMatch([{4, {{2, 4, 1}, Id, {standing, {1.0, 2.0}}, [], _}}], sent(dpp_state, Told)),
    ?assertMatch([_], [A || {{timeout, again}, _, _} = A <- Told]),
    ?assertMatch({[{trace, {stale_answer, _, _, _}}], _}, answer(4, {1, 4, 1}, Id, Aware)).

%% Pitfall: a participant that has crashed does not know whether its robot drives: it stops it.
crash_stops_the_robot(_) ->
    Types = [dpp_answer, dpp_recover, dpp_beat, dpp_prevote],
    Listens = [{cast, sap, {listen, Type, dpp}} || Type <- Types],
    ?assertEqual(Listens, started(1)),
    ?assertEqual(Listens ++ [{cast, motion, stop}], started(2)).

%% Pitfall: it has forgotten its vote, too, and must not give a second one while that lasts.
crashed_robot_does_not_vote(_) ->
    {Refused, P} = recover(3, {2, 3, 1}, restarted({stored, {1, 4, 1}})),
    ?assertEqual([{3, {1, 4, 1}}], sent(dpp_refused, Refused)),
    {Stop, P1} = at(10 * ?S, cast, {message, 3, dpp_recover, {{2, 3, 1}, 9, false}}, P),
    {Told, _} = located(10 * ?S, Stop, P1),
    ?assertMatch([{3, {_, _, _, _, {9, _, true}}}], sent(dpp_state, Told)).

%% Nothing is said in a term before that is stored, and it is stored once.
term_is_stored_first(_) ->
    {[First | Stop], P} = recover(4, {1, 4, 1}, joined()),
    ?assertEqual({store, {1, 4, 1}}, First),
    {_, P1} = located(Stop, P),
    {Beat, _} = step(cast, {message, 4, dpp_beat, {{1, 4, 1}, 8, []}}, P1),
    ?assertEqual([], [A || {store, _} = A <- Beat]),
    {[Next | _], _} = step(cast, {message, 3, dpp_beat, {{2, 3, 1}, 8, []}}, P1),
    ?assertEqual({store, {2, 3, 1}}, Next).

%% After a crash or a reboot it knows the term that it followed and whom: it takes none that is
%% lower, and waits no longer for that coordinator than others do.
reboot_forgets_no_term(_) ->
    P = restarted({stored, {2, 4, 1}}),
    ?assertMatch({[{reply, _, 4}], _}, step({call, {app, 1}}, coordinator, P)),
    {Refused, _} = at(20 * ?S, cast, {message, 3, dpp_recover, {{1, 3, 9}, 7, false}}, P),
    ?assertEqual([{3, {2, 4, 1}}], sent(dpp_refused, Refused)),
    Missing = [Us || {{timeout, missing}, Us, _} <- started(2, {stored, {2, 4, 1}})],
    {Beat, _} = step(cast, {message, 4, dpp_beat, {{2, 4, 1}, 8, []}}, P),
    ?assertEqual([Us || {{timeout, missing}, Us, _} <- Beat], Missing),
    ?assertMatch([_], Missing),
    ?assertEqual([], [T || {{timeout, missing}, _, _} = T <- started(1)]).

%% Its coordinator, in the same term, is told where it stands now before it is answered otherwise.
reboot_tells_its_place(_) ->
    {Stop, P} = step(
        cast, {message, 4, dpp_beat, {{2, 4, 1}, 8, []}}, restarted({stored, {2, 4, 1}})
    ),
    ?assertEqual([], sent(dpp_here, Stop)),
    {Told, P1} = located(Stop, P),
    ?assertMatch(
        [{4, {{2, 4, 1}, {2, _}, {standing, {1.0, 2.0}}, [], {8, 0, false}}}],
        sent(dpp_state, Told)
    ),
    {Here, _} = at(3 * ?S, cast, {message, 4, dpp_beat, {{2, 4, 1}, 9, []}}, P1),
    ?assertMatch([{4, {{2, 4, 1}, {9, _, false}}}], sent(dpp_here, Here)).

%% What it cannot read may have been any term, of this life's or of any earlier one's time: the one
%% that claims has to go above that, and it votes for nobody for a lease.
damaged_term_is_the_highest(_) ->
    P = restarted(damaged),
    {Refused, _} = at(20 * ?S, cast, {message, 3, dpp_recover, {{1000000, 3, 7}, 7, true}}, P),
    [{3, {N, _, _} = Highest}] = sent(dpp_refused, Refused),
    ?assert(N > 1000000),
    Claim = {message, 3, dpp_recover, {{N + 1, 3, 7}, 7, false}},
    ?assertMatch({[{cast, sap, {send, 3, dpp_refused, Highest}}], _}, step(cast, Claim, P)),
    {[First | _], _} = at(20 * ?S, cast, Claim, P),
    ?assertEqual({store, {N + 1, 3, 7}}, First),
    {[{reply, _, ok} | _], Joined} = step({call, {app, 0}}, {join, 4}, P),
    ?assertMatch({[{reply, _, 4}], _}, step({call, {app, 1}}, coordinator, Joined)).

%% What the chassis shows of the robot's clock the own coordinator must know, whether the robot was
%% stopped or was to drive.
wrong_clock_is_told(_) ->
    Told = fun(Actions) -> [told || {cast, dpp_coordinator, out_of_time} <- Actions] end,
    {Stop, P1} = step({call, {app, 1}}, request, led()),
    [{call, motion, stop, {halted, N}}] = [A || {call, motion, _, _} = A <- Stop],
    {Right, _} = step({reply, {halted, N}}, ok, P1),
    {Wrong, _} = step({reply, {halted, N}}, {error, out_of_time}, P1),
    ?assertEqual({[], [told]}, {Told(Right), Told(Wrong)}),
    ?assertEqual(Right, Wrong -- [{cast, dpp_coordinator, out_of_time}]),
    {Id, Moving} = moving(),
    {_, Driving} = step({call, {app, 2}}, {drive, Id, 1}, Moving),
    [
        begin
            {Actions, _} = step({reply, {driven, drive, Id, 1}}, {error, Why}, Driving),
            ?assertEqual({Why, Expected}, {Why, Told(Actions)})
        end
     || {Why, Expected} <- [{out_of_time, [told]}, {stopped, []}]
    ].

%% The path is void, and the next request says on which line something was in the way; the one after it
%% does not.
%% Holds: What is in a robot's way is told once, with its next request
%% Red: 073438b3: the request had no such word
what_is_in_the_way_is_told(_) ->
    {Id, Moving} = moving(),
    {_, Driving} = step({call, {app, 2}}, {drive, Id, 1}, Moving),
    {Void, Blocked} = step({reply, {driven, drive, Id, 1}}, {error, blocked}, Driving),
    [{trace, {blocked, Towards}}, {reply, {app, 2}, {error, void}}] = Void,
    {Stop, Asking} = step({call, {app, 3}}, request, Blocked),
    {Ask, Asked} = located(Stop, Asking),
    [{4, Request}] = sent(dpp_request, Ask),
    ?assertMatch({_, _, _, _, _, Towards}, Request),
    ?assert(starl_dpp_message:accepts(dpp_request, Request)),
    Answer = {message, 4, dpp_answer, {{1, 4, 1}, element(2, Request), incomplete, []}},
    {_, Standing} = step(cast, Answer, Asked),
    {Stop2, Again} = step({call, {app, 4}}, request, Standing),
    {Ask2, _} = located(Stop2, Again),
    [{4, Request2}] = sent(dpp_request, Ask2),
    ?assertEqual(5, tuple_size(Request2)).

%% A beat is answered when the last answer is two beats old, however long those are.
short_lease_is_answered_more_often(_) ->
    Answers = fun(Config) ->
        {_, P0} = starl_machine:new(
            starl_dpp_participant, Config, base(1, dpp, 2, [1, 2, 3, 4], {stored, {1, 4, 1}})
        ),
        {Stop, P1} = step(cast, {message, 4, dpp_beat, {{1, 4, 1}, 0, []}}, P0),
        {_, P2} = located(Stop, P1),
        Two = 2 * starl_dpp_lease:beat_us(Config),
        Here = fun(Us) ->
            {Actions, _} = at(Us, cast, {message, 4, dpp_beat, {{1, 4, 1}, Us, []}}, P2),
            length(sent(dpp_here, Actions))
        end,
        {Two, Here(Two - 1), Here(Two)}
    end,
    ?assertEqual({2 * ?S, 0, 1}, Answers(#{lease_ms => 12000})),
    ?assertMatch({Us, 0, 1} when Us < ?S, Answers(#{lease_ms => 3000, jump_ms => 100})).

earlier_term_is_refused(_) ->
    {Actions, P} = recover(3, {0, 3, 1}, led()),
    ?assertEqual([{3, {1, 4, 1}}], sent(dpp_refused, Actions)),
    {Beat, _} = step(cast, {message, 3, dpp_beat, {{0, 3, 1}, 1, [{1, 5}]}}, P),
    ?assertEqual([{3, {1, 4, 1}}], sent(dpp_refused, Beat)).

%% It has voted for robot 4 for ten seconds: before they are over robot 3 gets no vote.
vote_is_kept(_) ->
    {Early, P} = at(9 * ?S, cast, {message, 3, dpp_recover, {{2, 3, 1}, 7, false}}, led()),
    ?assertEqual([{3, {1, 4, 1}}], sent(dpp_refused, Early)),
    {Late, P1} = at(10 * ?S, cast, {message, 3, dpp_recover, {{2, 3, 1}, 8, false}}, P),
    {Told, _} = located(10 * ?S, Late, P1),
    ?assertMatch([{3, {{2, 3, 1}, _, _, _, {8, _, true}}}], sent(dpp_state, Told)).

%% One that leads is followed at once, but has no vote while it is promised to another.
leader_is_followed_without_vote(_) ->
    {Stop, P} = step(cast, {message, 3, dpp_beat, {{2, 3, 1}, 5, []}}, led()),
    {Told, _} = located(Stop, P),
    ?assertMatch([{3, {{2, 3, 1}, _, _, _, {5, 0, false}}}], sent(dpp_state, Told)).

%% At the end of its lease the robot stops; a beat that comes later does not bring it back.
lease_ends_for_good(_) ->
    {Id, Moving} = moving(),
    {Go, Driving} = step({call, {app, 2}}, {drive, Id, 1}, Moving),
    ?assertEqual(
        [{call, motion, {go_along, {{1.0, 2.0}, {100.0, 2.0}}}, {driven, drive, Id, 1}}], Go
    ),
    {Early, _} = at(5 * ?S, {timeout, leave}, leave, Driving),
    ?assertMatch([{{timeout, leave}, _, leave}], Early),
    {Late, Void} = at(6 * ?S, {timeout, leave}, leave, Driving),
    ?assert(lists:member({cast, motion, stop}, Late)),
    ?assertEqual([{reply, {app, 2}, {error, void}}], replies(Late)),
    {_, Told} = at(10 * ?S, cast, {message, 4, dpp_beat, {{1, 4, 1}, 9, [{1, 9 * ?S}]}}, Void),
    {Refused, _} = at(10 * ?S, {call, {app, 3}}, {drive, Id, 1}, Told),
    ?assertEqual([{reply, {app, 3}, {error, void}}], Refused).

%% A robot that was paused until its lease was over may hear of a new term, or be sent on its way, before
%% it notices: its path is void for both, and it is seen before it tells its place.
paused_past_its_lease(_) ->
    End = starl_dpp_lease:short_us(#{}),
    {Id, Moving} = moving(),
    New = {message, 4, dpp_recover, {{2, 4, 1}, 7, false}},
    {InTime, _} = at(End - 1, cast, New, Moving),
    ?assertMatch([{4, {{2, 4, 1}, Id, {moving, 0, _, _}, _, _}}], sent(dpp_state, InTime)),
    {Late, Void} = at(End, cast, New, Moving),
    ?assertEqual([], sent(dpp_state, Late)),
    ?assert(lists:member({trace, {void, Id}}, Late)),
    {Told, _} = located(End, Late, Void),
    ?assertMatch([{4, {{2, 4, 1}, _, {standing, {1.0, 2.0}}, _, _}}], sent(dpp_state, Told)),
    Drive = {drive, Id, 1},
    ?assertMatch({[{call, motion, _, _}], _}, at(End - 1, {call, {app, 2}}, Drive, Moving)),
    {Refused, _} = at(End, {call, {app, 2}}, Drive, Moving),
    ?assertEqual([{reply, {app, 2}, {error, void}}], replies(Refused)),
    ?assertEqual([], [Call || {call, motion, _, _} = Call <- Refused]).

%% A coordinator's clock that has gone on by more than the own one, and more than drift and jumps explain,
%% shows that the lease may be over: the path is void, and stamps from before prolong nothing.
stands_still_past_its_lease(_) ->
    {Id, Moving} = moving(),
    {Jump, _} = starl_dpp_lease:bounds(#{}),
    Beat = fun(Term, Seq, P) ->
        at(?S, cast, {message, 4, dpp_beat, {Term, Seq, [{1, ?S}]}}, P)
    end,
    {_, Heard} = Beat({1, 4, 1}, 5 * ?S, Moving),
    {Agrees, _} = Beat({1, 4, 1}, 5 * ?S + Jump, Heard),
    ?assertNot(lists:member({trace, {void, Id}}, Agrees)),
    {Lags, Void} = Beat({1, 4, 1}, 5 * ?S + Jump + 1, Heard),
    ?assert(lists:member({trace, {void, Id}}, Lags)),
    ?assert(lists:member({cast, motion, stop}, Lags)),
    {_, Later} = Beat({1, 4, 1}, 5 * ?S + Jump + 2, Void),
    {Refused, _} = at(?S, {call, {app, 2}}, {drive, Id, 1}, Later),
    ?assertEqual([{reply, {app, 2}, {error, void}}], replies(Refused)),
    {Stop, P} = Beat({2, 4, 1}, 5 * ?S + Jump + 1, Heard),
    ?assertEqual([], sent(dpp_state, Stop)),
    {Told, _} = located(?S, Stop, P),
    ?assertMatch([{4, {{2, 4, 1}, _, {standing, {1.0, 2.0}}, _, _}}], sent(dpp_state, Told)),
    %% another's clock shows nothing
    {Other, _} = at(?S, cast, {message, 3, dpp_recover, {{2, 3, 1}, 99 * ?S, true}}, Heard),
    ?assertMatch([{3, {_, Id, {moving, 0, _, _}, _, _}}], sent(dpp_state, Other)).

%% A claim shows it as well as a beat does: the robot is stopped, and seen before it tells its place.
claim_shows_that_the_clock_stood_still(_) ->
    {Id, Moving} = moving(),
    {Jump, _} = starl_dpp_lease:bounds(#{}),
    Beat = {message, 4, dpp_beat, {{1, 4, 1}, 5 * ?S, [{1, ?S}]}},
    {_, Heard} = at(?S, cast, Beat, Moving),
    Claim = fun(Seq) -> at(?S, cast, {message, 4, dpp_recover, {{2, 4, 1}, Seq, false}}, Heard) end,
    {Agrees, _} = Claim(5 * ?S + Jump),
    ?assertNot(lists:member({cast, motion, stop}, Agrees)),
    {Lags, Void} = Claim(5 * ?S + Jump + 1),
    ?assert(lists:member({cast, motion, stop}, Lags)),
    ?assert(lists:member({trace, {void, Id}}, Lags)),
    ?assertEqual([], sent(dpp_state, Lags)),
    {Told, _} = located(?S, Lags, Void),
    ?assertMatch([{4, {{2, 4, 1}, _, {standing, {1.0, 2.0}}, _, _}}], sent(dpp_state, Told)).

%% What the robot said before its clock stood still gives no lease, though a beat brings it back: the
%% answer to its request then is old, and it asks anew.
%% Holds: Stamps from before a clock stood still count again; a robot known to have such a clock is
%% not stopped
%% Red: 05e18f4; told by 193bfcc
stamps_from_before_the_clock_stood_still_are_void(_) ->
    {Id, Asking} = asking(led()),
    {Jump, _} = starl_dpp_lease:bounds(#{}),
    Beat = fun(Seq, Stamp, P) ->
        element(2, at(?S, cast, {message, 4, dpp_beat, {{1, 4, 1}, Seq, [{1, Stamp}]}}, P))
    end,
    Answered = fun(P) ->
        {Actions, _} = at(?S, cast, {message, 4, dpp_answer, {{1, 4, 1}, Id, assignment(), []}}, P),
        {length(replies(Actions)), length(sent(dpp_request, Actions))}
    end,
    Heard = Beat(5 * ?S, 0, Asking),
    ?assertEqual({1, 0}, Answered(Beat(5 * ?S + Jump, ?S, Heard))),
    Lags = Beat(5 * ?S + Jump + 1, ?S, Heard),
    ?assertEqual({0, 1}, Answered(Lags)),
    ?assertEqual({0, 1}, Answered(Beat(5 * ?S + Jump + 2, ?S, Lags))).

%% The beginning of a line is taken as its drive is: under a lease, anew when motion has crashed, and
%% with nothing passed or painted by it.
faces_only_by_lease(_) ->
    {Id, Moving} = moving(),
    {Go, Facing} = step({call, {app, 2}}, {face, Id, 1}, Moving),
    Call = {call, motion, {face, {{1.0, 2.0}, {100.0, 2.0}}}, {driven, face, Id, 1}},
    ?assertEqual([Call], Go),
    ?assertEqual([Call], element(1, step(info, {restarted, motion}, Facing))),
    {Ready, Faced} = step({reply, {driven, face, Id, 1}}, ok, Facing),
    ?assertEqual([{reply, {app, 2}, ok}], Ready),
    {Driven, _} = drive(Id, 1, Faced),
    ?assertEqual([{reply, {app, drive}, ok}], replies(Driven)),
    {Stopped, _} = step({reply, {driven, face, Id, 1}}, {error, stopped}, Facing),
    ?assertEqual([{reply, {app, 2}, {error, void}}], Stopped),
    {Late, Void} = at(8 * ?S, {timeout, leave}, leave, Facing),
    ?assertEqual([{reply, {app, 2}, {error, void}}], replies(Late)),
    {Refused, _} = at(10 * ?S, {call, {app, 3}}, {face, Id, 1}, Void),
    ?assertEqual([{reply, {app, 3}, {error, void}}], Refused).

%% Who drove, and was stopped, is told so; not again when the lease ends, and motion drives no more.
failed_drive_is_told_once(_) ->
    {Id, Moving} = moving(),
    {_, Driving} = step({call, {app, 2}}, {drive, Id, 1}, Moving),
    {Told, Stopped} = step({reply, {driven, drive, Id, 1}}, {error, stopped}, Driving),
    ?assertEqual([{reply, {app, 2}, {error, void}}], replies(Told)),
    ?assertEqual([], element(1, step(info, {restarted, motion}, Stopped))),
    {Late, _} = at(8 * ?S, {timeout, leave}, leave, Stopped),
    ?assertEqual([], replies(Late)).

beats_prolong_lease(_) ->
    {Id, Moving} = moving(),
    {_, Driving} = step({call, {app, 2}}, {drive, Id, 1}, Moving),
    {_, Beaten} = at(5 * ?S, cast, {message, 4, dpp_beat, {{1, 4, 1}, 9, [{1, 5 * ?S}]}}, Driving),
    {Still, _} = at(10 * ?S, {timeout, leave}, leave, Beaten),
    ?assertMatch([{{timeout, leave}, _, leave}], Still),
    {Over, _} = at(11 * ?S, {timeout, leave}, leave, Beaten),
    ?assert(lists:member({cast, motion, stop}, Over)).

%% An assignment that was long on its way: its lease has ended, the robot asks anew.
late_assignment_is_void(_) ->
    {Id, P} = asking(led()),
    {Actions, _} =
        at(10 * ?S, cast, {message, 4, dpp_answer, {{1, 4, 1}, Id, assignment(), []}}, P),
    ?assertEqual([], replies(Actions)),
    ?assertMatch([{4, {_, _, _, _, _}}], sent(dpp_request, Actions)).

missing_coordinator_is_replaced(_) ->
    {Actions, _} = at(30 * ?S, {timeout, missing}, missing, led()),
    ?assert(lists:member({cast, dpp_coordinator, {missing, 1}}, Actions)).

painted_goes_with_the_next_request(_) ->
    {Id, Moving} = moving(),
    {_, Passed} = drive(Id, 1, Moving),
    {Stop, P1} = step({call, {app, 2}}, request, Passed),
    {Ask, _} = located(Stop, P1),
    ?assertMatch([{4, {_, _, _, [7], _}}], sent(dpp_request, Ask)).

%% Who has turned to a line, and been told so, is told nothing more of that when the lease ends.
faced_is_told_once(_) ->
    {Id, Moving} = moving(),
    {_, Facing} = step({call, {app, 2}}, {face, Id, 1}, Moving),
    {Faced, P} = step({reply, {driven, face, Id, 1}}, ok, Facing),
    ?assertEqual([{reply, {app, 2}, ok}], replies(Faced)),
    {Ended, _} = at(20 * ?S, {timeout, leave}, leave, P),
    ?assertEqual([], replies(Ended)).

%% What others have painted comes with an answer, and is told to a coordinator that begins.
answers_tell_of_paint(_) ->
    {Id, P} = asking(led()),
    Complete = {message, 4, dpp_answer, {{1, 4, 1}, Id, complete, [3, 9]}},
    {_, P1} = at(?AIR_US, cast, Complete, P),
    {Stop, P2} = recover(4, {2, 4, 1}, P1),
    {Told, _} = located(Stop, P2),
    ?assertMatch([{4, {_, _, {standing, _}, [3, 9], _}}], sent(dpp_state, Told)).

passed_is_told_now_and_then(_) ->
    {Id, Moving} = moving(),
    {Near, P1} = drive(Id, 1, Moving),
    ?assertEqual([], sent(dpp_passed, Near)),
    {_, P2} = drive(Id, 2, P1),
    {Far, _} = drive(Id, 3, P2),
    ?assertEqual([{4, {{1, 4, 1}, Id, 3}}], sent(dpp_passed, Far)).

%% The robot's own coordinator machine hears of a new term, by a claim or a beat, not of the same
%% one again; when it was restarted it has forgotten, and hears of it once more.
own_coordinator_hears_of_each_term(_) ->
    Told = fun(Actions) -> [Term || {cast, dpp_coordinator, {led, Term}} <- Actions] end,
    {Claim, P1} = recover(4, {1, 4, 1}, joined()),
    ?assertEqual([{1, 4, 1}], Told(Claim)),
    {Beat, P2} = step(cast, {message, 4, dpp_beat, {{1, 4, 1}, 8, []}}, P1),
    ?assertEqual([], Told(Beat)),
    {Crash, P3} = step(info, {restarted, dpp_coordinator}, P2),
    ?assertEqual([{cast, dpp_coordinator, {led, {1, 4, 1}}}], Crash),
    {Other, P4} = step(cast, {message, 3, dpp_beat, {{2, 3, 1}, 5, []}}, P3),
    ?assertEqual([{2, 3, 1}], Told(Other)),
    {_, P5} = step(cast, {message, 1, dpp_beat, {{3, 1, 1}, 5, []}}, P4),
    {Own, _} = step(info, {restarted, dpp_coordinator}, P5),
    ?assertMatch([{cast, dpp_coordinator, {lead, 3}} | _], Own).

%% Who asks does not wait for ever, and takes no answer after that.
no_answer_at_all(_) ->
    {Ask, _} = step({call, {app, 1}}, request, led()),
    ?assertMatch([_], [A || {{timeout, patience}, _, patience} = A <- Ask]),
    {Id, P} = asking(led()),
    {Told, Tired} = step({timeout, patience}, patience, P),
    ?assertEqual([{reply, {app, 1}, {error, no_answer}}], replies(Told)),
    ?assert(lists:member({{timeout, again}, cancel}, Told)),
    {Late, _} = answer(4, {1, 4, 1}, Id, Tired),
    ?assertEqual([{trace, {stale_answer, 4, {1, 4, 1}, Id}}], Late).

%% A beat shows that the coordinator hears the robot if it returns a later stamp than before. Only then the
%% robot waits on: one that hears and is not heard does not wait for ever.
%% Holds: A robot that is not heard gets `no_answer` in bounded time
%% Red: 961f67c9, run
no_answer_though_the_coordinator_is_heard(_) ->
    {_, P} = asking(led()),
    Waits = fun(T, Stamps, P0) ->
        {Actions, Next} =
            at(T * ?S, cast, {message, 4, dpp_beat, {{1, 4, 1}, T * ?S, Stamps}}, P0),
        {[Us || {{timeout, patience}, Us, _} <- Actions], Next}
    end,
    {[], P1} = Waits(1, [], P),
    {[], P2} = Waits(2, [{2, 1 * ?S}], P1),
    {[Patience], P3} = Waits(3, [{1, 2 * ?S}], P2),
    ?assertEqual(120 * ?S, Patience),
    {[], _} = Waits(4, [{1, 2 * ?S}], P3).

%% A robot that has not heard its coordinator for a lease would not hear the answer: it asks at the next beat.
deaf_robot_does_not_ask(_) ->
    {_, P} = asking(led()),
    Asks = fun(T, P0) ->
        {Actions, Next} = at(T, {timeout, again}, request, P0),
        {sent(dpp_request, Actions), Next}
    end,
    ?assertMatch({[_], _}, Asks(5 * ?S, P)),
    {[], Deaf} = Asks(6 * ?S, P),
    {Beat, P1} = at(7 * ?S, cast, {message, 4, dpp_beat, {{1, 4, 1}, 7 * ?S, []}}, Deaf),
    ?assert(lists:member({{timeout, again}, 1000, request}, Beat)),
    ?assertMatch({[_], _}, Asks(7 * ?S + 1000, P1)).

%% SAP says that the request was lost: it is sent again soon. An earlier one's loss is no news.
unsent_request_is_sent_again(_) ->
    {{_, N}, P} = asking(led()),
    ?assertMatch({[], _}, step({reply, {sent, N - 1}}, {error, lost}, P)),
    {Again, Waiting} = step({reply, {sent, N}}, {error, lost}, P),
    ?assertEqual([{{timeout, again}, ?S div 2, request}], Again),
    {Ask, _} = step({timeout, again}, request, Waiting),
    ?assertMatch([{4, _}], sent(dpp_request, Ask)).

%% A request may have been lost with the SAP that crashed.
crashed_sap_is_told_who_listens(_) ->
    Types = [dpp_answer, dpp_recover, dpp_beat, dpp_prevote],
    Listens = [{cast, sap, {listen, Type, dpp}} || Type <- Types],
    ?assertMatch({Listens, _}, step(info, {restarted, sap}, led())),
    {_, P} = asking(led()),
    {Actions, _} = step(info, {restarted, sap}, P),
    ?assertEqual(Listens ++ [{{timeout, again}, ?S div 2, request}], Actions).

%% What motion had been told is lost with it: the same line again, if it was on one.
crashed_motion_is_told_to_go_on(_) ->
    {Id, Moving} = moving(),
    ?assertMatch({[], _}, step(info, {restarted, motion}, Moving)),
    {Go, Driving} = step({call, {app, 2}}, {drive, Id, 1}, Moving),
    ?assertMatch([_], Go),
    ?assertMatch({Go, _}, step(info, {restarted, motion}, Driving)),
    ?assertMatch({[], _}, step(info, {restarted, motion}, led())).

%% A timer that was to be stopped, and has run out all the same, has no effect.
late_timers_mean_nothing(_) ->
    {_, Moving} = moving(),
    [
        ?assertEqual({[], P}, step({timeout, Timer}, Timer, P))
     || Timer <- [again, patience], P <- [led(), Moving]
    ].

%% A crash of a machine that it has told nothing is none of its business; what it does not know is
%% traced.
only_known_events_count(_) ->
    P = led(),
    ?assertEqual({[], P}, step(info, {restarted, location}, P)),
    ?assertEqual({[{trace, {unknown_event, info, x}}], P}, step(info, x, P)).

%% A robot that was stopped counts as standing on its path if it is within the slack of it, which is
%% nothing unless it is given.
on_its_path_by_the_slack_alone(_) ->
    Stands = fun(Config, Y) ->
        {_, P0} = starl_machine:new(starl_dpp_participant, Config, base(1, dpp, 1, [1, 2, 3, 4])),
        {_, P1} = step({call, {app, 0}}, {join, 4}, P0),
        {Stop, P2} = recover(4, {1, 4, 1}, P1),
        {_, P3} = located(Stop, P2),
        {Id, P4} = asking(P3),
        {_, Moving} = answer(4, {1, 4, 1}, Id, P4),
        {Again, P5} = step({call, {app, 2}}, request, Moving),
        [N] = [Of || {call, motion, stop, {halted, Of}} <- Again],
        {_, P6} = step({reply, {pose, N}}, {ok, {50.0, Y, 0.0}}, P5),
        {Told, _} = recover(4, {2, 4, 1}, P6),
        [{4, {_, _, {standing, At}, _, _}}] = sent(dpp_state, Told),
        At
    end,
    ?assertEqual({50.0, 2.1}, Stands(#{}, 2.1)),
    ?assertEqual({50.0, 2.0}, Stands(#{slack => 0.2}, 2.1)),
    ?assertEqual({50.0, 2.3}, Stands(#{slack => 0.2}, 2.3)).

%% Who asks while it drives drives no more: neither when motion crashes nor at the end of the next
%% lease is there anything left of that.
request_ends_the_drive(_) ->
    {Id, Moving} = moving(),
    {_, Driving} = step({call, {app, 2}}, {drive, Id, 1}, Moving),
    {Next, P} = asking(Driving),
    {_, Again} = answer(4, {1, 4, 1}, Next, P),
    ?assertMatch({[], _}, step(info, {restarted, motion}, Again)),
    {Late, _} = at(20 * ?S, {timeout, leave}, leave, Again),
    ?assertEqual([], replies(Late)).

%% It waits two minutes in all, for a place half a second, for an answer 40 seconds, and asks again
%% after half a second when told so; with an answer, whichever, all that is over.
timers_while_it_asks(_) ->
    Again = {{timeout, again}, ?S div 2, request},
    Ended = [{{timeout, again}, cancel}, {{timeout, patience}, cancel}],
    {Stop, P1} = step({call, {app, 1}}, request, led()),
    [{call, motion, stop, {halted, N}}] = [A || {call, motion, _, _} = A <- Stop],
    ?assertEqual([{{timeout, patience}, 120 * ?S, patience}], timers(patience, Stop)),
    ?assertEqual([{{timeout, look}, ?S div 2, look}], timers(look, Stop)),
    {Ask, P2} = step({reply, {pose, N}}, {ok, {1.0, 2.0, 0.0}}, P1),
    [{4, {Term, Id, _, _, _}}] = sent(dpp_request, Ask),
    ?assertEqual([{{timeout, look}, cancel}], timers(look, Ask)),
    ?assertEqual([{{timeout, again}, 40 * ?S, request}], timers(again, Ask)),
    Answer = fun(Now, Body) ->
        {Actions, _} = at(Now, cast, {message, 4, dpp_answer, {Term, Id, Body, []}}, P2),
        [A || A <- Actions, A =/= {state_timeout, cancel}, element(1, A) =/= trace]
    end,
    ?assertEqual([Again], Answer(?AIR_US, again)),
    ?assertEqual([Again], Answer(0, assignment())),
    ?assertEqual(Ended ++ [{reply, {app, 1}, complete}], Answer(?AIR_US, complete)),
    Left = starl_dpp_lease:short_us(#{}) - ?AIR_US,
    Taken = {reply, {app, 1}, {ok, {Id, {1.0, 2.0}, path()}}},
    ?assertEqual(
        Ended ++ [{{timeout, leave}, Left, leave}, Taken],
        Answer(?AIR_US, assignment())
    ).

timers(Timer, Actions) -> [A || A <- Actions, element(1, A) =:= {timeout, Timer}].

%% It asks for nothing before it knows where it stands, even if it is time to ask again.
place_is_looked_for_first(_) ->
    {_, P1} = step({call, {app, 1}}, request, joined()),
    {Actions, P2} = step({timeout, again}, request, P1),
    ?assertEqual([], sent(dpp_request, Actions)),
    {Ask, _} = located(Actions, P2),
    ?assertMatch([{4, {_, _, {1.0, 2.0}, _, _}}], sent(dpp_request, Ask)).

%% A place that is seen when the robot is on its way again says nothing.
late_look_ends_the_looking(_) ->
    {{_, N} = Id, Moving} = moving(),
    {Actions, P} = step({reply, {pose, N}}, {ok, {50.0, 50.0, 0.0}}, Moving),
    ?assertEqual([{{timeout, look}, cancel}], Actions),
    {Go, _} = step({call, {app, 2}}, {drive, Id, 1}, P),
    ?assertMatch([{call, motion, {go_along, {{1.0, 2.0}, {100.0, 2.0}}}, _}], Go).

%% To the microsecond: with one left a path is taken and goes on, with none it is void.
lease_is_over_at_its_end(_) ->
    End = starl_dpp_lease:short_us(#{}),
    {Id, P} = asking(led()),
    Answer = {message, 4, dpp_answer, {{1, 4, 1}, Id, assignment(), []}},
    {Taken, _} = at(End - 1, cast, Answer, P),
    ?assertEqual([{{timeout, leave}, 1, leave}], timers(leave, Taken)),
    {Refused, _} = at(End, cast, Answer, P),
    ?assertMatch({[], [{4, _}]}, {replies(Refused), sent(dpp_request, Refused)}),
    {_, Moving} = moving(),
    ?assertMatch(
        {[{{timeout, leave}, 1, leave}], _}, at(End - 1, {timeout, leave}, leave, Moving)
    ),
    {Over, _} = at(End, {timeout, leave}, leave, Moving),
    ?assertEqual(
        [{cast, motion, stop}, {trace, {void, Id}}], Over -- [{state_timeout, cancel}]
    ),
    %% where no lease is, none ends
    ?assertMatch({[], _}, at(End, {timeout, leave}, leave, led())).

%% It drives along the lines of the path that it has, the last one too, and no others.
drives_its_own_lines_only(_) ->
    {{I, N} = Id, Moving} = moving(),
    Drive = fun(Of, Line) ->
        {Actions, _} = step({call, {app, 2}}, {drive, Of, Line}, Moving),
        Actions
    end,
    ?assertEqual(
        [{call, motion, {go_along, {{1.0, 2.0}, {900.0, 2.0}}}, {driven, drive, Id, 3}}],
        Drive(Id, 3)
    ),
    [
        ?assertEqual([{reply, {app, 2}, {error, void}}], Drive(Of, Line))
     || {Of, Line} <- [{Id, 4}, {{I, N - 1}, 1}, {{I + 1, N}, 1}]
    ].

%% An outcome is one of the drive that was begun: not of another line, another path, nor of a turn.
told_of_each_way_once(_) ->
    {{I, N} = Id, Moving} = moving(),
    {_, Driving} = step({call, {app, 2}}, {drive, Id, 2}, Moving),
    [
        ?assertEqual({[], Driving}, step({reply, {driven, What, Of, Line}}, Outcome, Driving))
     || {What, Of, Line} <- [{drive, Id, 1}, {face, Id, 2}, {drive, {I, N + 1}, 2}],
        Outcome <- [ok, {error, stopped}]
    ],
    {Done, P} = step({reply, {driven, drive, Id, 2}}, ok, Driving),
    ?assertEqual([{reply, {app, 2}, ok}], replies(Done)),
    ?assertEqual({[], P}, step({reply, {driven, drive, Id, 2}}, ok, P)).

%% -- helpers --------------------------------------------------------------------------------

participant(Life) ->
    {_, P} = starl_machine:new(starl_dpp_participant, #{}, base(1, dpp, Life, [1, 2, 3, 4])),
    P.

restarted(Stored) ->
    {_, P} = starl_machine:new(starl_dpp_participant, #{}, base(1, dpp, 2, [1, 2, 3, 4], Stored)),
    P.

started(Life) -> started(Life, none).

started(Life, Stored) ->
    Base = base(1, dpp, Life, [1, 2, 3, 4], Stored),
    {Actions, _} = starl_machine:new(starl_dpp_participant, #{}, Base),
    Actions.

joined() -> joined(1).

joined(Life) ->
    {Joined, P} = step({call, {app, 0}}, {join, 4}, participant(Life)),
    [{reply, _, ok}] = replies(Joined),
    P.

%% A participant that has voted for robot 4.
led() ->
    {Stop, P} = recover(4, {1, 4, 1}, joined()),
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
    {_, Moving} = answer(4, {1, 4, 1}, Id, P),
    {Id, Moving}.

drive(Id, N, P) ->
    {_, Driving} = step({call, {app, drive}}, {drive, Id, N}, P),
    step({reply, {driven, drive, Id, N}}, ok, Driving).

answer(Source, Term, Id, P) ->
    at(?AIR_US, cast, {message, Source, dpp_answer, {Term, Id, assignment(), []}}, P).

assignment() -> {assign, {1.0, 2.0}, path()}.

path() -> [{{100.0, 2.0}, {down, 7}}, {{300.0, 2.0}, up}, {{900.0, 2.0}, {down, 8}}].

replies(Actions) -> [A || {reply, _, _} = A <- Actions].
