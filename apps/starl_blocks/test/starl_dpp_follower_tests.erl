%% Whom a participant follows: terms only rise, a vote and what is asked are told once, and a lease
%% lasts from what the robot itself has said.
-module(starl_dpp_follower_tests).
-include_lib("eunit/include/eunit.hrl").

-define(F, starl_dpp_follower).
-define(S, 1000000).
-define(TERM, {1, 2, 1}).

%% Robot 1 of three, leases of ten seconds, clocks that are right.
new(Stored) -> new(1, Stored).

new(Robot, Stored) ->
    ?F:new(#{
        robot => Robot,
        participants => starl_team:new([1, 2, 3]),
        incarnation => 5,
        now => 0,
        stored => Stored,
        lease_ms => 10000,
        drift_ppm => 0,
        jump_ms => 0
    }).

missing(Us) -> {{timeout, missing}, Us, missing}.

%% It follows robot 2, which it has told its place at one second.
told() ->
    {followed, {F, _}} = ?F:recover(2, {?TERM, 7, false}, ?S, new(none)),
    {Told, [_]} = ?F:tell({5, 1}, {{standing, {1.0, 2.0}}, [9]}, ?S, F),
    Told.

%% -- a new life -----------------------------------------------------------------------------

%% What was stored is known again; what cannot be read may have been any term up to now.
what_was_stored_is_known_again_test() ->
    Knows = fun(Stored) -> {?F:coordinator(new(Stored)), ?F:term(new(Stored))} end,
    ?assertEqual({none, {0, 0, 0}}, Knows(none)),
    ?assertEqual({3, {2, 3, 1}}, Knows({stored, {2, 3, 1}})),
    ?assertEqual({none, {21474836480, 0, 0}}, Knows(damaged)).

%% Who knows of a coordinator waits for it, one robot after the other in the row from it on.
waits_for_the_coordinator_in_the_order_of_the_row_test() ->
    ?assertEqual([], ?F:begins(new(none))),
    ?assertEqual(
        [[missing(12500000)], [missing(14000000)], [missing(11000000)]],
        [?F:begins(new(Robot, {stored, {2, 3, 1}})) || Robot <- [1, 2, 3]]
    ).

%% It has no lease, and nobody was heard.
nothing_at_first_test() ->
    ?assertEqual([0, -?S], [?F:lease_us(Now, new(none)) || Now <- [0, ?S]]),
    ?assert(?F:missed(0, new(none))).

joins_one_coordinator_once_test() ->
    {F, Actions} = ?F:join(2, new(none)),
    ?assertEqual({2, [missing(14000000)]}, {?F:coordinator(F), Actions}),
    ?assertEqual({F, []}, ?F:join(3, F)).

%% -- terms ----------------------------------------------------------------------------------

%% A new term is stored, and the own coordinator hears of it unless it is its own.
new_term_is_stored_and_told_to_the_own_coordinator_test() ->
    Recover = fun(Source, Term) ->
        {followed, {F, Actions}} = ?F:recover(Source, {Term, 7, false}, ?S, new(none)),
        ?assertEqual({Source, Term}, {?F:coordinator(F), ?F:term(F)}),
        Actions
    end,
    ?assertEqual(
        [{store, ?TERM}, {cast, dpp_coordinator, {led, ?TERM}}, missing(14000000)],
        Recover(2, ?TERM)
    ),
    ?assertEqual([{store, {1, 1, 1}}, missing(11000000)], Recover(1, {1, 1, 1})).

%% The time until the leader is missed runs on whatever is claimed: only one that leads ends it.
a_claim_is_no_sign_that_somebody_leads_test() ->
    Watches = fun(Leads) ->
        {followed, {_, Actions}} = ?F:recover(2, {{2, 2, 1}, 8, Leads}, 20 * ?S, told()),
        [Timer || {{timeout, missing}, _, _} = Timer <- Actions]
    end,
    ?assertEqual([], Watches(false)),
    ?assertEqual([missing(14000000)], Watches(true)).

%% A robot would vote for another if it could follow its claim now; a no is not said, and nothing is promised.
a_prevote_is_given_where_a_vote_would_be_test() ->
    Prevotes = fun(Robot, Now) -> ?F:prevote(Robot, Now, told()) end,
    Yes = fun(Robot) -> [{cast, sap, {send, Robot, dpp_prevoted, ?TERM}}] end,
    ?assertEqual([[], Yes(3)], [Prevotes(3, T) || T <- [11 * ?S - 1, 11 * ?S]]),
    ?assertEqual(Yes(2), Prevotes(2, 2 * ?S)),
    {beaten, {Led, _}} = ?F:beat(2, {?TERM, 8, []}, 5 * ?S, told()),
    ?assertEqual([[], Yes(3)], [?F:prevote(3, T, Led) || T <- [15 * ?S - 1, 15 * ?S]]).

%% A robot is deaf that has heard its coordinator once, but not for a lease.
deaf_test() ->
    ?assertNot(?F:deaf(99 * ?S, new(none))),
    ?assertEqual([false, true], [?F:deaf(T, told()) || T <- [11 * ?S, 11 * ?S + 1]]).

%% What shows that it is heard is its own stamp in a beat.
a_returned_stamp_shows_that_the_robot_is_heard_test() ->
    Returned = fun(Stamps) ->
        {beaten, {F, _}} = ?F:beat(2, {?TERM, 8, Stamps}, 5 * ?S, told()),
        ?F:returned(F) - ?F:returned(told())
    end,
    ?assertEqual([0, 0, 14 * ?S], [Returned(S) || S <- [[], [{3, 4 * ?S}], [{1, 4 * ?S}]]]).

%% One that it follows already is not stored again, and needs no vote to be heard.
same_term_test() ->
    {followed, {F, Actions}} = ?F:recover(2, {?TERM, 8, false}, 2 * ?S, told()),
    ?assertEqual([], Actions),
    {_, Told} = ?F:tell({5, 2}, {{standing, {1.0, 2.0}}, []}, 2 * ?S, F),
    ?assertMatch([{cast, sap, {send, 2, dpp_state, {_, _, _, _, {8, 2000000, true}}}}], Told).

%% After a crash nobody is voted for, but the term that was followed is followed again.
known_term_needs_no_vote_test() ->
    Recover = fun(Term) ->
        element(1, ?F:recover(2, {Term, 7, false}, ?S, new({stored, ?TERM})))
    end,
    ?assertEqual([followed, refused], [Recover(?TERM), Recover({2, 2, 1})]).

%% A lower term is refused, also of one that says that it leads; so is a higher one of a robot that
%% may not have the vote, unless it leads by others' votes.
lower_term_is_refused_test() ->
    F = told(),
    Refused = fun(Source, Term, Leads, Now) ->
        case ?F:recover(Source, {Term, 8, Leads}, Now, F) of
            {refused, {F, [{cast, sap, {send, Source, dpp_refused, Known}}]}} -> Known;
            {followed, {Next, _}} -> {follows, ?F:coordinator(Next)}
        end
    end,
    ?assertEqual(?TERM, Refused(1, {1, 1, 9}, true, 2 * ?S)),
    ?assertEqual(?TERM, Refused(3, {2, 3, 1}, false, 2 * ?S)),
    ?assertEqual({follows, 3}, Refused(3, {2, 3, 1}, true, 2 * ?S)),
    ?assertEqual(?TERM, Refused(3, {2, 3, 1}, false, 11 * ?S - 1)),
    ?assertEqual({follows, 3}, Refused(3, {2, 3, 1}, false, 11 * ?S)),
    ?assertEqual({follows, 2}, Refused(2, {2, 2, 1}, false, 2 * ?S)).

%% Who follows one that leads without its vote says so; the vote stays with the other.
vote_of_another_test() ->
    {followed, {F, _}} = ?F:recover(3, {{2, 3, 1}, 8, true}, 2 * ?S, told()),
    {_, [Report]} = ?F:tell({5, 2}, {{standing, {1.0, 2.0}}, []}, 2 * ?S, F),
    ?assertMatch({cast, sap, {send, 3, dpp_state, {{2, 3, 1}, _, _, _, {8, _, false}}}}, Report).

%% A claim alone shows no leader; a beat does, and so does the word of one that leads: for a lease
%% nobody else may claim.
who_leads_test() ->
    {beaten, {Beaten, _}} = ?F:beat(2, {?TERM, 8, []}, 5 * ?S, told()),
    {followed, {Led, _}} = ?F:recover(2, {?TERM, 8, true}, 5 * ?S, told()),
    Claim = fun(Now, F) -> element(1, ?F:recover(3, {{2, 3, 1}, 9, false}, Now, F)) end,
    [
        ?assertEqual([refused, refused, followed], [
            Claim(Now, F)
         || Now <- [12 * ?S, 15 * ?S - 1, 15 * ?S]
        ])
     || F <- [Beaten, Led]
    ],
    ?assertEqual(followed, Claim(12 * ?S, told())).

only_the_followed_term_is_answered_test() ->
    ?assertEqual(
        [true, false, false],
        [?F:answers(R, T, told()) || {R, T} <- [{2, ?TERM}, {3, ?TERM}, {2, {2, 2, 1}}]]
    ).

%% -- terms that are not believed --------------------------------------------------------------

-define(LARGEST, (1 bsl 128 - 1)).
%% The largest number that is believed at once.
-define(FAR, ((1 bsl 90) + (1 bsl 32))).

%% Neither a beat nor a claim with the largest number is followed, and nothing is stored; who means it is asked to say
%% it again.
a_term_too_far_above_is_not_followed_test() ->
    Term = {?LARGEST, 3, 1},
    Doubts = [
        {trace, {doubted, 3, Term}}, {cast, sap, {send, 3, dpp_refused, {doubted, Term}}}
    ],
    [
        begin
            {refused, {Next, Actions}} = Said,
            ?assertEqual(Doubts, Actions),
            ?assertEqual({2, ?TERM}, {?F:coordinator(Next), ?F:term(Next)}),
            %% the coordinator that it follows goes on
            ?assertMatch({beaten, _}, ?F:beat(2, {?TERM, 9, []}, 20 * ?S, Next))
        end
     || Said <- [
            ?F:beat(3, {Term, 8, []}, 20 * ?S, told()),
            ?F:recover(3, {Term, 8, true}, 20 * ?S, told()),
            ?F:recover(3, {Term, 8, false}, 20 * ?S, told())
        ]
    ].

%% The largest that is believed leaves room for more.
there_is_always_a_higher_term_test() ->
    {followed, {F, [{store, {?FAR, 3, 1}} | _]}} = ?F:beat(3, {{?FAR, 3, 1}, 8, []}, ?S, told()),
    {followed, {Next, _}} = ?F:recover(2, {{?FAR + 1, 2, 1}, 8, true}, 2 * ?S, F),
    ?assertEqual({?FAR + 1, 2, 1}, ?F:term(Next)),
    ?assert(starl_dpp_message:accepts(dpp_beat, {{?FAR + 1, 2, 1}, 8, []})).

%% Each time that it is said it is nearer.
said_again_and_again_a_far_term_is_believed_test() ->
    Term = {?FAR + (10 bsl 32), 3, 1},
    Beat = fun(F) ->
        {How, {Next, _}} = ?F:beat(3, {Term, 8, []}, 20 * ?S, F),
        {How, Next}
    end,
    {Said, _} = lists:mapfoldl(fun(_, F) -> Beat(F) end, told(), lists:seq(1, 11)),
    ?assertEqual(lists:duplicate(10, refused) ++ [followed], Said).

%% A robot that has lost its store knows a term as high as its life; others follow the next one, and it follows what
%% others have counted.
the_guess_for_a_lost_store_is_believed_test() ->
    [
        begin
            Base = #{robot => 3, participants => starl_team:new([1, 2, 3]), now => 0},
            Lost = ?F:new(Base#{incarnation => Life, stored => damaged}),
            {N, 0, 0} = ?F:term(Lost),
            Next = {N + 1, 2, 7},
            ?assertMatch({followed, _}, ?F:recover(2, {Next, 8, true}, ?S, new(none))),
            ?assertMatch({followed, _}, ?F:recover(2, {Next, 8, true}, ?S, told())),
            ?assertMatch({followed, _}, ?F:beat(2, {{N + 100, 2, 7}, 8, []}, ?S, Lost))
        end
     || Life <- [1, 2, 60000, 1 bsl 57, 1 bsl 58 - 1]
    ].

%% An earlier version has stored what anybody said. Then the robot knows a term that others can pass, does not vote
%% for a lease, and follows nobody outside the team.
an_absurd_stored_term_counts_as_lost_test() ->
    ?assertEqual(new(damaged), new({stored, {?LARGEST, 2, 1}})),
    ?assertEqual({none, {7, 99, 1}}, {
        ?F:coordinator(new({stored, {7, 99, 1}})), ?F:term(new({stored, {7, 99, 1}}))
    }),
    F = new({stored, {?LARGEST, 1 bsl 58 - 1, 1 bsl 58 - 1}}),
    {N, 0, 0} = ?F:term(F),
    Claim = {{N + 1, 2, 1}, 8, false},
    ?assertMatch({refused, _}, ?F:recover(2, Claim, 10 * ?S - 1, F)),
    ?assertMatch({followed, _}, ?F:recover(2, Claim, 10 * ?S, F)).

%% Only its claimant speaks in a term.
a_term_in_the_name_of_another_robot_is_none_test() ->
    F = told(),
    [
        ?assertEqual(
            {refused, {F, [{trace, {doubted, 3, Term}}]}}, ?F:beat(3, {Term, 8, []}, ?S, F)
        )
     || Term <- [?TERM, {2, 1, 1}, {2, 99, 1}, {2, 0, 1}]
    ].

%% A robot that leads returns stamps. None of the own clock is in the future, so no lease lasts longer.
a_stamp_of_the_future_is_no_lease_test() ->
    {beaten, {F, _}} = ?F:beat(2, {?TERM, 8, [{1, 1 bsl 57}]}, 5 * ?S, told()),
    ?assertEqual(10 * ?S, ?F:lease_us(5 * ?S, F)).

%% -- where the robot is ---------------------------------------------------------------------

%% Told once for each question, with the vote.
place_is_told_once_for_each_question_test() ->
    {followed, {F, _}} = ?F:recover(2, {?TERM, 7, false}, ?S, new(none)),
    Tell = fun(Now, F0) -> ?F:tell({5, 1}, {{standing, {1.0, 2.0}}, [9]}, Now, F0) end,
    {Told, Report} = Tell(3 * ?S, F),
    Body = {?TERM, {5, 1}, {standing, {1.0, 2.0}}, [9], {7, 3 * ?S, true}},
    ?assertEqual([{cast, sap, {send, 2, dpp_state, Body}}], Report),
    ?assertEqual({Told, []}, Tell(4 * ?S, Told)),
    ?assertEqual({new(none), []}, Tell(?S, new(none))).

%% The first beat of a life asks where the robot is, also in a term that is known.
first_beat_test() ->
    {followed, {F, Actions}} = ?F:beat(2, {?TERM, 7, []}, ?S, new({stored, ?TERM})),
    ?assertEqual([missing(14000000)], Actions),
    {_, Told} = ?F:tell({5, 1}, {{standing, {1.0, 2.0}}, []}, ?S, F),
    ?assertMatch([{cast, sap, {send, 2, dpp_state, _}}], Told).

%% So does one of another term.
beat_of_another_term_test() ->
    Beat = fun(Term) -> ?F:beat(3, {Term, 8, []}, 2 * ?S, told()) end,
    ?assertMatch({followed, {_, [{store, {2, 3, 1}} | _]}}, Beat({2, 3, 1})),
    ?assertMatch({refused, {_, [{cast, sap, {send, 3, dpp_refused, ?TERM}}]}}, Beat({0, 3, 1})).

%% Beats are answered every other second, with the vote; not before the place is told.
every_other_beat_is_answered_with_the_vote_test() ->
    Here = fun(Now, F0) ->
        {beaten, {F, Actions}} = ?F:beat(2, {?TERM, Now + 1, []}, Now, F0),
        ?assertEqual([missing(14000000)], [A || {{timeout, _}, _, _} = A <- Actions]),
        {[Body || {cast, sap, {send, 2, dpp_here, Body}} <- Actions], F}
    end,
    F = told(),
    ?assertMatch({[], _}, Here(3 * ?S - 1, F)),
    {First, Answered} = Here(3 * ?S, F),
    ?assertEqual([{?TERM, {3 * ?S + 1, 3 * ?S, true}}], First),
    ?assertMatch({[], _}, Here(5 * ?S - 1, Answered)),
    ?assertMatch({[_], _}, Here(5 * ?S, Answered)),
    {followed, {Asked, _}} = ?F:recover(2, {?TERM, 8, true}, 2 * ?S, F),
    ?assertMatch({[], _}, Here(9 * ?S, Asked)).

%% -- its coordinator is missed --------------------------------------------------------------

coordinator_is_missed_after_ten_seconds_test() ->
    {beaten, {F, _}} = ?F:beat(2, {?TERM, 8, []}, 2 * ?S, told()),
    ?assertEqual([false, false, true], [?F:missed(T, F) || T <- [2 * ?S, 12 * ?S, 12 * ?S + 1]]).

own_coordinator_is_asked_to_lead_and_told_its_term_test() ->
    Missing = [{cast, dpp_coordinator, {missing, 1}}, missing(14000000)],
    ?assertEqual(Missing, ?F:missing(told())),
    ?assertEqual([{cast, dpp_coordinator, {led, ?TERM}}], ?F:restarted(told())),
    ?assertEqual(
        [{cast, dpp_coordinator, {lead, 1}}, missing(11000000)],
        ?F:restarted(new(2, {stored, ?TERM}))
    ).

%% -- lease ----------------------------------------------------------------------------------

%% From the latest of its stamps that has come back, or from its request; none takes a lease back.
lease_runs_from_the_latest_stamp_and_is_never_taken_back_test() ->
    Beat = fun(Now, Stamps, F0) ->
        {beaten, {F, _}} = ?F:beat(2, {?TERM, Now, Stamps}, Now, F0),
        F
    end,
    Left = fun(F) -> ?F:lease_us(6 * ?S, F) end,
    F1 = Beat(5 * ?S, [{2, 5 * ?S}, {1, 4 * ?S}], told()),
    ?assertEqual(8 * ?S, Left(F1)),
    ?assertEqual(8 * ?S, Left(Beat(6 * ?S, [{1, 3 * ?S}], F1))),
    ?assertEqual(8 * ?S, Left(Beat(6 * ?S, [{2, 6 * ?S}], F1))),
    ?assertEqual(9 * ?S, Left(?F:asked(5 * ?S, F1))),
    ?assertEqual(8 * ?S, Left(?F:asked(3 * ?S, F1))).

%% An answer in no time at all shows a clock that stands still, but for the own coordinator's.
in_no_time_test() ->
    Asked = ?F:asked(5 * ?S, told()),
    ?assertEqual([true, true, false], [?F:in_no_time(5 * ?S + Us, Asked) || Us <- [-1, 0, 1]]),
    ?assertNot(?F:in_no_time(0, ?F:asked(5 * ?S, new(2, {stored, ?TERM})))).
