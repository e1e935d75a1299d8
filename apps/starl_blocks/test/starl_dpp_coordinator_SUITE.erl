%% The contract of DPP (README), the part that its coordinator keeps: who has no quorum
%% assigns nothing; a lost assignment keeps its reservation until the next request clears it or its
%% lease ends; a late Clear frees nothing; a new coordinator keeps all that robots hold. The machine
%% is stepped by hand. Participants: starl_dpp_participant_SUITE; both in runs:
%% starl_dpp_crash_SUITE.
-module(starl_dpp_coordinator_SUITE).
-include_lib("stdlib/include/assert.hrl").
-import(starl_dpp_ct, [base/4, step/3, at/4, sent/2]).

-export([suite/0, all/0]).
-export([
    nothing_is_assigned_before_all_are_known/1,
    nothing_is_assigned_without_votes/1,
    votes_run_out/1,
    wrong_clock_voids_votes/1,
    refused_for_a_later_term/1,
    after_the_end_all_is_traced/1,
    old_stamp_gives_no_lease/1,
    each_request_is_answered_once/1,
    old_request_is_ignored/1,
    late_clear_frees_nothing/1,
    clear_frees_what_is_behind/1,
    lost_assignment_stays_reserved/1,
    other_terms_are_ignored/1,
    recovered_reservation_is_kept/1,
    silent_robot_keeps_all_until_its_lease_ends/1,
    heard_again_while_looked_for/1,
    late_report_of_a_silent_robot/1,
    unreachable_unknown_robot_ends/1,
    claims_above_what_is_known/1,
    claims_when_told_to_lead/1,
    claims_only_what_a_quorum_would_vote_for/1,
    prevotes_before_it_claims_again/1,
    prevotes_end/1,
    follows_a_higher_term/1,
    gives_up_a_claim/1,
    late_timers_mean_nothing/1,
    beats_every_second/1,
    asks_who_has_not_answered/1,
    asks_itself_when_it_may_win/1,
    says_that_it_leads_at_once/1,
    tells_of_its_term/1,
    outcomes_of_its_own_term_count/1,
    crashes_of_others/1,
    news_are_told_once/1,
    ends_whatever_happens/1,
    lost_time_is_found_once/1,
    says_nothing_after_its_votes/1
]).

-define(CONFIG, #{
    segments => [{{3000.0, 3000.0}, {7000.0, 3000.0}}, {{3000.0, 7000.0}, {7000.0, 7000.0}}],
    world => {10000.0, 10000.0},
    tube_radius => 220.0,
    slack => 10.0,
    horizon => 2000.0,
    seed => 1
}).
-define(S, 1000000).

suite() -> [{timetrap, {minutes, 2}}].

all() ->
    [
        nothing_is_assigned_before_all_are_known,
        nothing_is_assigned_without_votes,
        votes_run_out,
        wrong_clock_voids_votes,
        refused_for_a_later_term,
        after_the_end_all_is_traced,
        old_stamp_gives_no_lease,
        each_request_is_answered_once,
        old_request_is_ignored,
        late_clear_frees_nothing,
        clear_frees_what_is_behind,
        lost_assignment_stays_reserved,
        other_terms_are_ignored,
        recovered_reservation_is_kept,
        silent_robot_keeps_all_until_its_lease_ends,
        heard_again_while_looked_for,
        late_report_of_a_silent_robot,
        unreachable_unknown_robot_ends,
        claims_above_what_is_known,
        claims_when_told_to_lead,
        claims_only_what_a_quorum_would_vote_for,
        prevotes_before_it_claims_again,
        prevotes_end,
        follows_a_higher_term,
        gives_up_a_claim,
        late_timers_mean_nothing,
        beats_every_second,
        asks_who_has_not_answered,
        asks_itself_when_it_may_win,
        says_that_it_leads_at_once,
        tells_of_its_term,
        outcomes_of_its_own_term_count,
        crashes_of_others,
        news_are_told_once,
        ends_whatever_happens,
        lost_time_is_found_once,
        says_nothing_after_its_votes
    ].

%% A team of two, whose first robot is a quorum.
nothing_is_assigned_before_all_are_known(_) ->
    {First, C1} = claimed([1, 2]),
    ?assertMatch([{{1, 1, 1}, _, false}], [B || {cast, sap, {broadcast, dpp_recover, B}} <- First]),
    {_, C2} = state(1, {standing, spot(1)}, C1),
    {Asked, C3} = ask(1, 1, spot(1), C2),
    ?assertEqual([], answers(Asked)),
    {Known, C4} = state(2, {standing, spot(2)}, C3),
    ?assert(lists:member({trace, {coordinator, {1, 1, 1}}}, Known)),
    {Second, _} = ask(2, 1, spot(2), C4),
    ?assertMatch([{2, {assign, _, _}} | _], answers(Second)).

%% All robots are known, but not enough of them vote.
nothing_is_assigned_without_votes(_) ->
    {_, C1} = claimed([1, 2, 3]),
    C2 = lists:foldl(
        fun(R, C) ->
            {_, Next} = state(R, {standing, spot(R)}, {0, 0, R =:= 2}, C),
            Next
        end,
        C1,
        [2, 3, 1]
    ),
    {Actions, C3} = ask(1, 1, spot(1), C2),
    ?assertEqual([], answers(Actions)),
    {Won, _} = step(cast, {message, 3, dpp_here, {{1, 1, 1}, {0, 1, true}}}, C3),
    ?assert(lists:member({trace, {leads, {1, 1, 1}}}, Won)).

%% Votes last for a lease, but for drift and jumps, from the beat that they answer. Then nothing is
%% assigned.
votes_run_out(_) ->
    C = open(),
    {Early, _} = at(5 * ?S, cast, asks(2, 1, spot(2)), C),
    ?assertMatch([{2, {assign, _, _}} | _], answers(Early)),
    {Late, _} = at(6 * ?S, cast, asks(2, 1, spot(2)), C),
    ?assertEqual([], answers(Late)),
    ?assert(lists:member({trace, {stepped_down, {1, 1, 1}}}, Late)).

%% The chassis has shown that the clock stood still: votes count from now on only, in a term of
%% their own. One that does not lead has nothing to lose.
wrong_clock_voids_votes(_) ->
    {Claims, C} = at(5 * ?S, cast, out_of_time, open()),
    ?assert(lists:member({trace, {claims, {2, 1, 1}}}, Claims)),
    {_, C1} = at(5 * ?S, cast, {message, 1, dpp_here, {{1, 1, 1}, {5 * ?S, 5 * ?S, true}}}, C),
    {Asked, _} = at(5 * ?S, cast, asks(2, 1, spot(2)), C1),
    ?assertEqual([], answers(Asked)),
    {_, Idle} = step({timeout, claim}, claim, C1),
    ?assertMatch({[], _}, step(cast, out_of_time, Idle)).

%% A term of the same number, but of a robot with a higher one, is above the own, too.
refused_for_a_later_term(_) ->
    Claims = fun(Term) ->
        {Actions, _} = step(cast, {message, 2, dpp_refused, Term}, open()),
        [Claimed || {trace, {claims, Claimed}} <- Actions]
    end,
    ?assertEqual(
        [[{2, 1, 1}], [{2, 1, 1}], [], []],
        [Claims(Term) || Term <- [{1, 2, 1}, {1, 1, 2}, {1, 1, 1}, {0, 9, 9}]]
    ).

%% What nobody knows is traced also when it comes as the votes run out.
after_the_end_all_is_traced(_) ->
    {Actions, _} = at(8 * ?S, packet, x, open()),
    ?assert(lists:member({trace, {unknown_event, packet, x}}, Actions)).

%% A lease counts from the stamp of a request. Of a stamp that has been known for a lease none is
%% left: the robot's clock stands still, and it is to ask again by another.
old_stamp_gives_no_lease(_) ->
    {_, Asked} = at(0, cast, asks(2, 1, spot(2)), open()),
    C = voted(14, at_beats(lists:seq(1, 14), Asked)),
    {Actions, _} = at(14 * ?S, cast, asks(2, 2, spot(2)), C),
    ?assertEqual([again], [A || {cast, sap, {send, 2, dpp_answer, {_, _, A, _}}} <- Actions]),
    ?assertEqual([], answers(Actions)),
    {message, _, _, {Term, Id, At, [], 0}} = asks(2, 2, spot(2)),
    {Fresh, _} = at(14 * ?S, cast, {message, 2, dpp_request, {Term, Id, At, [], 13 * ?S}}, C),
    ?assertMatch([{2, {assign, _, _}} | _], answers(Fresh)).

%% Each request gets one answer; a doubled request gets no second one.
each_request_is_answered_once(_) ->
    {_, Id, _, C} = assigned(),
    {Again, _} = request(2, Id, spot(2), C),
    ?assertEqual([], Again).

%% Whoever still means it goes on above the later one.
old_request_is_ignored(_) ->
    {_, {I, N}, Held, C} = assigned(),
    {Old, C1} = request(2, {I, N - 1}, spot(2), C),
    ?assertMatch([{cast, sap, {send, 2, dpp_answer, {_, {I, _}, {above, {I, N}}, []}}}], Old),
    ?assertEqual(Held, held(2, C1)).

%% Pitfall: a late or doubled Clear of an earlier path frees space of the present one.
late_clear_frees_nothing(_) ->
    {_, {I, N}, Held, C} = assigned(),
    {Late, C1} = step(cast, {message, 2, dpp_passed, {{1, 1, 1}, {I, N - 1}, 1}}, C),
    ?assertEqual([], Late),
    ?assertEqual(Held, held(2, C1)).

clear_frees_what_is_behind(_) ->
    {_, Id, Held, C} = assigned(),
    {_, C1} = step(cast, {message, 2, dpp_passed, {{1, 1, 1}, Id, 1}}, C),
    Left = held(2, C1),
    ?assertNotEqual(Held, Left),
    {_, C2} = step(cast, {message, 2, dpp_passed, {{1, 1, 1}, Id, 1}}, C1),
    ?assertEqual(Left, held(2, C2)).

%% Pitfall: the assignment is lost, the reservation stays; the robot's next request clears it.
lost_assignment_stays_reserved(_) ->
    {_, {I, N}, Held, C} = assigned(),
    {_, C1} = step({reply, {answered, {1, 1, 1}, 2}}, {error, lost}, C),
    ?assertEqual(Held, held(2, C1)),
    {Next, C2} = request(2, {I, N + 5}, spot(2), C1),
    ?assertMatch([{2, {assign, _, _}} | _], answers(Next)),
    ?assertMatch([_ | _], held(2, C2)).

%% What was said before this term says nothing of what another coordinator has assigned since:
%% the robot is told of the term. A later term begins a new claim.
other_terms_are_ignored(_) ->
    C = open(),
    Early = {message, 2, dpp_request, {{0, 0, 0}, {1, 9}, spot(1), [], 0}},
    {Told, C1} = step(cast, Early, C),
    ?assertEqual([], answers(Told)),
    ?assertMatch([{2, {{1, 1, 1}, _, true}}], sent(dpp_recover, Told)),
    ?assertEqual([{spot(2), spot(2)}], held(2, C1)),
    {Higher, _} = step(cast, {message, 2, dpp_refused, {4, 2, 1}}, C1),
    ?assert(lists:member({trace, {claims, {5, 1, 1}}}, Higher)),
    Later = {message, 2, dpp_request, {{4, 2, 1}, {1, 9}, spot(1), [], 0}},
    {Claims, _} = step(cast, Later, C),
    ?assert(lists:member({trace, {claims, {5, 1, 1}}}, Claims)),
    ?assertEqual({[], C1}, step(cast, {led, {1, 1, 1}}, C1)).

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

%% Robot 2 has an assignment and is not heard again: before its lease has surely ended it keeps
%% everything; then it is looked for, and holds the place where it stands.
silent_robot_keeps_all_until_its_lease_ends(_) ->
    {_, _, Held, C} = assigned(),
    C1 = at_beats(lists:seq(1, 10), C),
    ?assertEqual(Held, held(2, C1)),
    {Looks, C2} = at(11 * ?S, {timeout, beat}, beat, voted(10, C1)),
    ?assert(lists:member({call, location, {pose, 2}, {rest, {1, 1, 1}, 2}}, Looks)),
    ?assertEqual(Held, held(2, C2)),
    {X, Y} = spot(2),
    {Found, C3} = at(11 * ?S, {reply, {rest, {1, 1, 1}, 2}}, {ok, {X, Y, 0.0}}, C2),
    ?assert(lists:member({trace, {silent, 2}}, Found)),
    ?assertEqual([{spot(2), spot(2)}], held(2, C3)).

%% Nobody is looked for whose lease may last; and what is seen of one that was heard again meanwhile
%% says nothing of where it stands.
heard_again_while_looked_for(_) ->
    {_, _, Held, C} = assigned(),
    Looked = fun(Actions) -> [R || {call, location, {pose, R}, {rest, _, _}} <- Actions] end,
    C1 = at_beats(lists:seq(1, 9), C),
    {Early, C2} = at(10 * ?S, {timeout, beat}, beat, C1),
    ?assertEqual([], Looked(Early)),
    {Looks, C3} = at(11 * ?S, {timeout, beat}, beat, voted(10, C2)),
    ?assertEqual([2], Looked(Looks)),
    Here = {message, 2, dpp_here, {{1, 1, 1}, {10 * ?S, 11 * ?S, true}}},
    {_, C4} = at(11 * ?S, cast, Here, C3),
    {X, Y} = spot(2),
    {Found, C5} = at(11 * ?S, {reply, {rest, {1, 1, 1}, 2}}, {ok, {X, Y, 0.0}}, C4),
    ?assertEqual({[], Held}, {Found, held(2, C5)}).

%% Pitfall: a report of a moving robot that was so long on its way that the robot has been found
%% standing meanwhile gives it nothing back.
late_report_of_a_silent_robot(_) ->
    {[{2, {assign, From, Path}} | _], _, _, _} = assigned(),
    {_, C1} = claimed([1, 2]),
    {_, C2} = state(1, {standing, spot(1)}, C1),
    C3 = at_beats(lists:seq(1, 10), C2),
    {_, C4} = at(11 * ?S, {timeout, beat}, beat, voted(10, C3)),
    {X, Y} = spot(2),
    {_, C5} = at(11 * ?S, {reply, {rest, {1, 1, 1}, 2}}, {ok, {X, Y, 0.0}}, C4),
    Late = {{1, 1, 1}, {1, 5}, {moving, 0, From, Path}, [], {0, 0, true}},
    {_, C6} = at(11 * ?S, cast, {message, 2, dpp_state, Late}, C5),
    ?assertEqual([{spot(2), spot(2)}], held(2, C6)).

%% A robot that nobody finds does not stop the others for ever: who waits gets an answer in
%% bounded time.
unreachable_unknown_robot_ends(_) ->
    {_, C1} = claimed([1, 2]),
    {_, C2} = state(1, {standing, spot(1)}, C1),
    {Asked, C3} = ask(1, 1, spot(1), C2),
    [{_, Us, give_up}] = [A || {{timeout, give_up}, _, _} = A <- Asked],
    C4 = at_beats(lists:seq(1, Us div ?S), C3),
    {Ended, _} = at(Us, {timeout, give_up}, give_up, C4),
    ?assertEqual([{1, incomplete}], answers(Ended)),
    ?assertMatch([[_ | _]], [Edges || {trace, {unreachable, Edges}} <- Ended]).

%% -- terms and timers -------------------------------------------------------------------------

-define(CANCELLED, [
    {{timeout, T}, cancel}
 || T <- [serve, give_up, beat, recover, claim]
]).

coordinator(Self, Team) ->
    Base = (base(1, dpp_coordinator, 1, Team))#{robot => Self},
    {_, C} = starl_machine:new(starl_dpp_coordinator, ?CONFIG, Base),
    C.

claims(Actions) -> [Term || {trace, {claims, Term}} <- Actions].

%% A claim asks all robots at once, ends what an earlier term was about, and has a lease and a half
%% to be won; it is above every term that was heard of.
claims_above_what_is_known(_) ->
    Request = fun(Term) -> {message, 2, dpp_request, {Term, {1, 0}, spot(2), [], 0}} end,
    {_, Asking} = at(5, cast, Request({6, 2, 3}), coordinator(1, [1, 2, 3])),
    {Actions, C} = at(5, cast, {message, 3, dpp_prevoted, {5, 3, 1}}, Asking),
    ?assertEqual(
        [{state_timeout, cancel} | ?CANCELLED] ++
            [
                {trace, {claims, {7, 1, 1}}},
                {{timeout, claim}, 15 * ?S, claim},
                {cast, sap, {broadcast, dpp_recover, {{7, 1, 1}, 5, false}}},
                {{timeout, recover}, 2 * ?S, recover}
            ],
        Actions
    ),
    {Higher, _} = step(cast, Request({9, 1, 1}), C),
    ?assertEqual([{10, 1, 1}], claims(Higher)),
    {Refused, _} = step(cast, {message, 2, dpp_refused, {7, 2, 1}}, C),
    ?assertEqual([{8, 1, 1}], claims(Refused)),
    %% one that is idle only takes note of a refusal
    Idle = coordinator(1, [1, 2, 3]),
    {[], Told} = step(cast, {message, 2, dpp_refused, {7, 2, 1}}, Idle),
    ?assertEqual([{8, 1, 1}], claims(element(1, step(cast, {lead, 0}, Told)))),
    %% and of what is not a request
    {[], Passed} = step(cast, {message, 2, dpp_passed, {{6, 2, 1}, {1, 1}, 1}}, Idle),
    ?assertEqual([{7, 1, 1}], claims(element(1, step(cast, {lead, 0}, Passed)))).

%% The own participant misses its coordinator: one that is idle claims, any other only if it has
%% not claimed a higher term already.
claims_when_told_to_lead(_) ->
    {First, C} = step(cast, {lead, 4}, coordinator(1, [1, 2, 3])),
    ?assertEqual([{5, 1, 1}], claims(First)),
    ?assertEqual([[], [], [{7, 1, 1}]], [
        claims(element(1, step(cast, {lead, N}, C)))
     || N <- [4, 5, 6]
    ]),
    {_, Idle} = step({timeout, claim}, claim, C),
    ?assertEqual([[{6, 1, 1}], [{6, 1, 1}]], [
        claims(element(1, step(cast, {lead, N}, Idle)))
     || N <- [0, 5]
    ]).

%% A robot that misses its leader asks the others first whether they would vote for it: one that hears
%% nobody claims nothing, how often it is told. The claim is above all terms that they know.
claims_only_what_a_quorum_would_vote_for(_) ->
    Asks = fun(Actions) -> [N || {cast, sap, {broadcast, dpp_prevote, N}} <- Actions] end,
    Agrees = fun(Robot, Term) -> {message, Robot, dpp_prevoted, Term} end,
    {First, C1} = step(cast, {missing, 4}, coordinator(1, [1, 2, 3, 4, 5])),
    ?assertEqual({[4], []}, {Asks(First), claims(First)}),
    {Again, C2} = step(cast, {missing, 4}, C1),
    ?assertEqual({[4], []}, {Asks(Again), claims(Again)}),
    {Two, C3} = step(cast, Agrees(2, {6, 2, 1}), C2),
    {Same, C4} = step(cast, Agrees(2, {6, 2, 1}), C3),
    ?assertEqual([], claims(Two ++ Same)),
    {Three, _} = step(cast, Agrees(5, {3, 2, 1}), C4),
    ?assertEqual([{7, 1, 1}], claims(Three)),
    %% the first robot of two is a quorum by itself
    {Alone, _} = step(cast, {missing, 4}, coordinator(1, [1, 2])),
    ?assertEqual({[], [{5, 1, 1}]}, {Asks(Alone), claims(Alone)}).

%% A request makes one that is idle claim the first term at once; a later one only with a quorum.
prevotes_before_it_claims_again(_) ->
    Request = fun(N) -> {message, 2, dpp_request, {{N, 0, 0}, {1, 0}, spot(2), [], 0}} end,
    {First, C} = step(cast, Request(0), coordinator(1, [1, 2, 3])),
    ?assertEqual([{1, 1, 1}], claims(First)),
    {_, Idle} = step({timeout, claim}, claim, C),
    {Asks, Asking} = step(cast, Request(0), Idle),
    ?assertEqual([], claims(Asks)),
    %% whoever asks meanwhile has it ask nobody again, and what stands still has no votes to lose
    ?assertMatch({[], Asking}, step(cast, Request(1), Asking)),
    ?assertMatch({[], Asking}, step(cast, out_of_time, Asking)),
    {Claims, _} = step(cast, {message, 3, dpp_prevoted, {1, 1, 1}}, Asking),
    ?assertEqual([{2, 1, 1}], claims(Claims)).

%% Without a quorum it is idle again, and a late yes has no effect; so it is when another claims.
prevotes_end(_) ->
    {_, Asking} = step(cast, {missing, 4}, coordinator(1, [1, 2, 3])),
    Yes = {message, 3, dpp_prevoted, {1, 1, 1}},
    [
        begin
            {_, Idle} = step(Type, Event, Asking),
            ?assertEqual(idle, starl_machine:state(Idle)),
            ?assertMatch({[], _}, step(cast, Yes, Idle))
        end
     || {Type, Event} <- [{{timeout, claim}, claim}, {cast, {led, {5, 2, 1}}}]
    ].

%% The own participant follows a higher term: this one is over. A lower one is none of its business.
follows_a_higher_term(_) ->
    {Actions, C} = step(cast, {led, {3, 2, 1}}, open()),
    Ended = [{state_timeout, cancel}, {trace, {stepped_down, {1, 1, 1}}} | ?CANCELLED],
    ?assertEqual(Ended, Actions),
    ?assertEqual([{4, 1, 1}], claims(element(1, step(cast, {lead, 0}, C)))),
    {_, Claiming} = claimed([1, 2, 3]),
    {Quiet, _} = step(cast, {led, {1, 2, 1}}, Claiming),
    ?assertEqual([{state_timeout, cancel} | ?CANCELLED], Quiet),
    ?assertEqual({[], Claiming}, step(cast, {led, {1, 1, 1}}, Claiming)).

%% A claim that is not won in time is over; one that is won does not end.
gives_up_a_claim(_) ->
    {_, Claiming} = claimed([1, 2, 3]),
    {Actions, Idle} = step({timeout, claim}, claim, Claiming),
    ?assertEqual([{state_timeout, cancel} | ?CANCELLED], Actions),
    {Voted, _} = state(1, {standing, spot(1)}, Idle),
    ?assertEqual([], Voted),
    C = open(),
    ?assertEqual({[], C}, step({timeout, claim}, claim, C)).

%% Timers that run out after all have no effect on one that does not lead.
late_timers_mean_nothing(_) ->
    Idle = coordinator(1, [1, 2, 3]),
    {_, Claiming} = claimed([1, 2, 3]),
    [
        ?assertEqual({[], C}, step({timeout, T}, T, C))
     || {C, Timers} <- [
            {Idle, [beat, recover, serve, give_up, claim]}, {Claiming, [beat, serve, give_up]}
        ],
        T <- Timers
    ].

%% Each beat carries the latest stamps of those whose place is known, goes to the own participant
%% by itself, and is followed by another; a short lease has shorter beats.
beats_every_second(_) ->
    {Actions, _} = at(?S, {timeout, beat}, beat, open()),
    Beat = {{1, 1, 1}, ?S, [{1, 0}, {2, 0}]},
    ?assertEqual(
        [
            {cast, sap, {shout, dpp_beat, Beat}},
            {cast, sap, {send, 1, dpp_beat, Beat}},
            {{timeout, beat}, starl_dpp_lease:beat_us(#{}), beat}
        ],
        Actions
    ),
    Here = {message, 2, dpp_here, {{1, 1, 1}, {?S, ?S + 7, true}}},
    {_, C} = at(?S + 9, cast, Here, element(2, at(?S, {timeout, beat}, beat, open()))),
    {Next, _} = at(2 * ?S, {timeout, beat}, beat, C),
    ?assertMatch([{{1, 1, 1}, 2000000, [{1, 0}, {2, 1000007}]}], [
        B
     || {cast, sap, {shout, dpp_beat, B}} <- Next
    ]).

%% Who has not told its place is asked again after two seconds, alone; when all are known nobody is.
asks_who_has_not_answered(_) ->
    {_, C} = claimed([1, 2, 3]),
    {_, C1} = state(1, {standing, spot(1)}, C),
    {_, Leads} = state(2, {standing, spot(2)}, C1),
    {Asked, C2} = at(2 * ?S, {timeout, recover}, recover, Leads),
    ?assertEqual(
        [
            {cast, sap, {send, 3, dpp_recover, {{1, 1, 1}, 2 * ?S, true}}},
            {{timeout, recover}, 2 * ?S, recover}
        ],
        Asked
    ),
    {_, All} = state(3, {standing, {5000.0, 5000.0}}, C2),
    ?assertMatch({[], _}, at(4 * ?S, {timeout, recover}, recover, All)).

%% Its own participant keeps following another until the votes of the others and its own would do.
asks_itself_when_it_may_win(_) ->
    Own = fun(Actions) -> [B || {1, B} <- sent(dpp_recover, Actions)] end,
    {First, C} = claimed([1, 2, 3, 4]),
    ?assertEqual([], Own(First)),
    Vote = fun(Robot, C0) ->
        state(Robot, {standing, spot(Robot)}, {0, 0, true}, C0)
    end,
    %% half of the team with its first robot is a quorum
    {Second, C2} = Vote(2, C),
    ?assertEqual([{{1, 1, 1}, 0, false}], Own(Second)),
    {Third, _} = Vote(1, C2),
    ?assert(lists:member({trace, {leads, {1, 1, 1}}}, Third)),
    %% without a vote it is not
    {Refused, _} = state(2, {standing, spot(2)}, {0, 0, false}, C),
    ?assertEqual([], Own(Refused)).

%% A claim that is won is told with a beat in the same turn, and asks those that have not answered.
says_that_it_leads_at_once(_) ->
    {_, C} = claimed([1, 2]),
    {Actions, _} = at(7, cast, {message, 1, dpp_state, state_body(1)}, C),
    ?assertEqual([{trace, {leads, {1, 1, 1}}}], [T || {trace, {leads, _}} = T <- Actions]),
    ?assertEqual([{{1, 1, 1}, 7, [{1, 0}]}], [B || {cast, sap, {shout, dpp_beat, B}} <- Actions]),
    ?assertEqual(
        [
            {{timeout, beat}, starl_dpp_lease:beat_us(#{}), beat},
            {{timeout, claim}, cancel},
            {{timeout, recover}, 2 * ?S, recover}
        ],
        [A || A <- Actions, is_tuple(element(1, A))]
    ).

state_body(Robot) -> {{1, 1, 1}, {1, 0}, {standing, spot(Robot)}, [], {0, 0, true}}.

%% Who speaks in an earlier term is told of the one that leads; one that only claims says nothing.
tells_of_its_term(_) ->
    Early = {message, 2, dpp_passed, {{0, 9, 9}, {1, 9}, 1}},
    {Told, _} = at(?S, cast, Early, open()),
    ?assertEqual([{cast, sap, {send, 2, dpp_recover, {{1, 1, 1}, ?S, true}}}], Told),
    {_, Claiming} = claimed([1, 2, 3]),
    ?assertMatch({[], _}, step(cast, Early, Claiming)).

%% What SAP or the positioning service say of another term's business says nothing.
outcomes_of_its_own_term_count(_) ->
    C = open(),
    [
        ?assertEqual({[], C}, step({reply, Tag}, Outcome, C))
     || {Tag, Outcome} <- [
            {{answered, {0, 1, 1}, 2}, ok},
            {{rest, {0, 1, 1}, 2}, {ok, {1.0, 1.0, 0.0}}},
            {{rest, {1, 1, 1}, 2}, {error, timeout}}
        ]
    ],
    {_, Idle} = step(cast, {led, {3, 2, 1}}, C),
    ?assertEqual({[], Idle}, step({reply, {answered, {1, 1, 1}, 2}}, ok, Idle)).

%% When its votes have run out it leads no more, whatever it is that happens next.
ends_whatever_happens(_) ->
    Ended = [{trace, {stepped_down, {1, 1, 1}}} | ?CANCELLED],
    [
        begin
            {[{state_timeout, cancel} | Actions], C} = at(8 * ?S, Type, Event, open()),
            ?assertEqual({Event, Ended}, {Event, lists:sublist(Actions, length(Ended))}),
            ?assertEqual(idle, starl_machine:state(C))
        end
     || {Type, Event} <- [
            {info, {restarted, sap}},
            {info, {restarted, motion}},
            {cast, {message, 2, dpp_refused, {0, 2, 1}}},
            {cast, {message, 2, dpp_passed, {{0, 2, 1}, {1, 1}, 1}}},
            {{timeout, beat}, beat}
        ]
    ].

%% The clock of another robot shows that the own one has stood still: it claims anew, once for what
%% was lost.
lost_time_is_found_once(_) ->
    Here = fun(Term, Stamp) -> {message, 2, dpp_here, {Term, {0, Stamp, true}}} end,
    {_, C0} = step(cast, Here({1, 1, 1}, 0), open()),
    {First, C1} = step(cast, Here({1, 1, 1}, 5 * ?S), C0),
    ?assertEqual([{2, 1, 1}], claims(First)),
    {Second, C2} = step(cast, Here({2, 1, 1}, 5 * ?S), C1),
    ?assertEqual([], claims(Second)),
    {Third, _} = step(cast, Here({2, 1, 1}, 8 * ?S), C2),
    ?assertEqual([{3, 1, 1}], claims(Third)).

%% What has arrived at a robot is not told again; what was lost is.
news_are_told_once(_) ->
    Painted = {message, 2, dpp_request, {{1, 1, 1}, {1, 9}, spot(2), [1], 0}},
    {_, C} = step(cast, Painted, open()),
    {First, C1} = ask(1, 1, spot(1), C),
    [{News, Tag}] = [
        {New, Tag}
     || {call, sap, {send, 1, dpp_answer, {_, _, _, New}}, Tag} <- First
    ],
    ?assertEqual([1], News),
    Next = fun(Outcome) ->
        {[], C2} = step({reply, Tag}, Outcome, C1),
        {Actions, _} = ask(1, 2, spot(1), C2),
        [New || {call, sap, {send, 1, dpp_answer, {_, _, _, New}}, _} <- Actions]
    end,
    ?assertEqual([[[]], [[1]]], [Next(Outcome) || Outcome <- [ok, {error, lost}]]).

%% SAP that crashed is told who listens; other crashes are none of its business.
crashes_of_others(_) ->
    C = open(),
    Types = [dpp_request, dpp_passed, dpp_state, dpp_here, dpp_refused, dpp_prevoted],
    Listens = [{cast, sap, {listen, Type, dpp_coordinator}} || Type <- Types],
    ?assertMatch({Listens, _}, step(info, {restarted, sap}, C)),
    ?assertEqual({[], C}, step(info, {restarted, motion}, C)),
    ?assertEqual({[{trace, {unknown_event, info, x}}], C}, step(info, x, C)).

%% -- helpers --------------------------------------------------------------------------------

%% Beats every second, which only the own participant answers.
at_beats(Seconds, C) ->
    lists:foldl(
        fun(T, C0) ->
            {_, C1} = at(T * ?S, {timeout, beat}, beat, C0),
            voted(T, C1)
        end,
        C,
        Seconds
    ).

voted(T, C) ->
    {_, Voted} = at(T * ?S, cast, {message, 1, dpp_here, {{1, 1, 1}, {T * ?S, T * ?S, true}}}, C),
    Voted.

%% A coordinator that was asked for a path and claims a term.
claimed(Team) ->
    {_, C} = starl_machine:new(
        starl_dpp_coordinator, ?CONFIG, base(1, dpp_coordinator, 1, Team)
    ),
    step(cast, {message, 1, dpp_request, {{0, 0, 0}, {1, 0}, spot(1), [], 0}}, C).

state(Robot, Place, C) -> state(Robot, Place, {0, 0, true}, C).

state(Robot, Place, Ballot, C) ->
    step(cast, {message, Robot, dpp_state, {{1, 1, 1}, {1, 0}, Place, [], Ballot}}, C).

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

%% A leading coordinator says nothing after its votes have ended, though it stood still in mid-step:
%% facts and messages have that latest moment. Late, it steps down; what it has assigned in vain is
%% forgotten with its term.
%% Holds: A coordinator that stood still does not lead on votes that have ended
%% Red: f2d72a2; told by 5331a3c. 300 seeds of `soak dpp` there found nothing; the planted
%% coordinator without latest moments is caught at seed 20
says_nothing_after_its_votes(_) ->
    {Actions, C} = starl_machine:step(
        cast, asks(2, 5, spot(2)), #{now => 0, robot => 1}, open()
    ),
    Until = starl_dpp_lease:short_us(?CONFIG) - 1,
    [{Until, Said}] = [{Us, Group} || {until, Us, Group, said} <- Actions],
    [_] = [Id || {trace, {assigned, 2, Id, _}} <- Said],
    [Until] = [Us || {call, sap, {send, 2, dpp_answer, _, Us}, _} <- Said],
    [] = [A || A <- Actions, not is_tuple(element(1, A)), element(1, A) =/= until],
    {Late, Idle} = at(Until + 1, info, {late, said}, C),
    ?assert(lists:member({trace, {stepped_down, {1, 1, 1}}}, Late)),
    ?assertEqual(idle, starl_machine:state(Idle)),
    %% its clock was set back meanwhile: it begins a new term all the same
    {Back, _} = at(0, info, {late, said}, C),
    ?assertEqual([{2, 1, 1}], claims(Back)),
    %% beats, too
    {Beats, _} = starl_machine:step({timeout, beat}, beat, #{now => 0, robot => 1}, C),
    [{until, Until, [{cast, sap, {shout, dpp_beat, _, Until}} | _], said}] =
        [U || {until, _, _, _} = U <- Beats].

ask(Robot, N, At, C) -> request(Robot, {1, N}, At, C).

request(Robot, Id, At, C) -> step(cast, asks(Robot, element(2, Id), At), C).

asks(Robot, N, At) -> {message, Robot, dpp_request, {{1, 1, 1}, {1, N}, At, [], 0}}.

answers(Actions) ->
    [{R, A} || {call, sap, {send, R, dpp_answer, {_, _, A, _}}, _} <- Actions].

%% What the plan inside the coordinator holds for a robot.
held(Robot, C) ->
    [Serve] = records(serve, starl_machine:data(C)),
    [Plan] = records(plan, Serve),
    starl_dpp_plan:held(Robot, Plan).

records(Tag, Record) ->
    [
        R
     || R <- tuple_to_list(Record),
        is_tuple(R),
        R =/= {},
        element(1, R) =:= Tag,
        tuple_size(R) > 5
    ].

spot(Robot) ->
    {ok, Plan} = starl_dpp_plan:new(maps:put(robots, [1, 2], ?CONFIG)),
    starl_dpp_plan:spot((Robot - 1) rem 2 + 1, Plan).
