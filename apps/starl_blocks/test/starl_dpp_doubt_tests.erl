%% Numbers that a coordinator, and a robot that counts its requests, do not believe at once: terms and requests of
%% a computer that is broken, or an insider's. The machines are stepped by hand.
-module(starl_dpp_doubt_tests).
-include_lib("eunit/include/eunit.hrl").
-import(starl_dpp_ct, [base/4, step/3, at/4, sent/2]).

-define(S, 1000000).
-define(NATURAL, (1 bsl 58 - 1)).
-define(LARGEST, (1 bsl 128 - 1)).
%% The largest number that is believed at once, and one ten steps further.
-define(FAR, ((1 bsl 90) + (1 bsl 32))).
-define(FARTHER, (?FAR + (10 bsl 32))).
-define(TERM, {?LARGEST, ?NATURAL, ?NATURAL}).
-define(AT, {1000.0, 1000.0}).
-define(TEAM, [1, 2, 3]).

%% -- terms ----------------------------------------------------------------------------------

%% Whatever it is said in, and whatever the coordinator does: its next claim is one that others believe.
no_message_brings_a_coordinator_to_the_end_test() ->
    [
        begin
            {_, Told} = step(cast, {message, 3, Type, Body}, C),
            [{N, 1, 1}] = claimed(step(cast, out_of_time, led(Told))),
            ?assert(N =< 4, {Type, starl_machine:state(C), N})
        end
     || C <- [idle(), prevoting(), claiming(), leading()], {Type, Body} <- messages(?TERM)
    ].

%% Its own participant is believed.
led(C) -> element(2, step(cast, {lead, 1}, C)).

messages(Term) ->
    Ballot = {0, 0, true},
    [
        {dpp_request, {Term, {1, 1}, ?AT, [], 0}},
        {dpp_passed, {Term, {1, 1}, 1}},
        {dpp_state, {Term, {1, 1}, {standing, ?AT}, [], Ballot}},
        {dpp_here, {Term, Ballot}},
        {dpp_refused, Term},
        {dpp_refused, {doubted, Term}},
        {dpp_prevoted, Term}
    ].

%% A coordinator that leads goes on leading.
a_leader_keeps_leading_test() ->
    [
        begin
            {Actions, C} = step(cast, {message, 3, Type, Body}, leading()),
            ?assertEqual({Type, leading, []}, {Type, starl_machine:state(C), claims(Actions)})
        end
     || {Type, Body} <- messages(?TERM)
    ].

%% Who refuses because it knows a term far above is asked again, and says so again, until the coordinator can claim
%% above it.
a_claim_finds_above_a_raised_robot_test() ->
    Refused = {message, 2, dpp_refused, {?FARTHER, 3, 1}},
    [
        begin
            {Claims, Asked, _} = lists:foldl(
                fun(_, {[], Asked, C0}) ->
                    {Actions, C1} = step(cast, Refused, C0),
                    Doubts = [{trace, {doubted, 2, {?FARTHER, 3, 1}}} || claims(Actions) =:= []],
                    ?assertEqual(Doubts, [A || {trace, {doubted, _, _}} = A <- Actions]),
                    {claims(Actions), Asked + length(sent(dpp_recover, Actions)), C1}
                end,
                {[], 0, C},
                lists:seq(1, 11)
            ),
            ?assertEqual({[{?FARTHER + 1, 1, 1}], 10}, {Claims, Asked})
        end
     || C <- [claiming(), leading()]
    ].

%% The same from the other side: a robot that does not believe the own term is told it again. Nobody else is.
a_robot_that_doubts_is_told_again_test() ->
    Doubts = fun(Term) -> {message, 2, dpp_refused, {doubted, Term}} end,
    Asked = fun(Term, C) -> sent(dpp_recover, element(1, step(cast, Doubts(Term), C))) end,
    ?assertMatch([{2, {{1, 1, 1}, _, false}}], Asked({1, 1, 1}, claiming())),
    ?assertMatch([{2, {{1, 1, 1}, _, true}}], Asked({1, 1, 1}, leading())),
    ?assertEqual([[], []], [Asked({2, 1, 1}, C) || C <- [claiming(), leading()]]),
    ?assertEqual([[], []], [Asked({1, 1, 1}, C) || C <- [idle(), prevoting()]]).

%% However often a robot doubts, it is asked 64 times in half a second, and each robot by itself.
%% Holds: A coordinator asks a robot that doubts 64 times in half a second, not without end
%% Red: 0d520217: no bound
a_robot_that_doubts_is_not_asked_without_end_test() ->
    Doubts = fun(Robot) -> {message, Robot, dpp_refused, {doubted, {1, 1, 1}}} end,
    Asked = fun(Robot, Now, Times, C) ->
        lists:foldl(
            fun(_, {N, C0}) ->
                {Actions, C1} = at(Now, cast, Doubts(Robot), C0),
                {N + length(sent(dpp_recover, Actions)), C1}
            end,
            {0, C},
            lists:seq(1, Times)
        )
    end,
    {64, C1} = Asked(2, 0, 200, claiming()),
    ?assertMatch({10, _}, Asked(3, 0, 10, C1)),
    ?assertMatch({64, _}, Asked(2, ?S, 200, C1)).

%% A robot that was raised votes, and is served, all the same.
a_raised_robot_is_heard_test() ->
    {Claims, _} = step(cast, {message, 2, dpp_prevoted, ?TERM}, prevoting()),
    ?assertEqual([{2, 1, 1}], claims(Claims)),
    {_, Known} = step(cast, {message, 2, dpp_prevoted, {1, 2, 1}}, idle()),
    {Asks, _} = step(cast, {message, 2, dpp_request, {?TERM, {1, 1}, ?AT, [], 0}}, Known),
    ?assertEqual([1], [N || {cast, sap, {broadcast, dpp_prevote, N}} <- Asks]).

%% The guess for a lost store is claimed above at once, in any life.
a_guess_is_claimed_above_at_once_test() ->
    [
        ?assertEqual(
            [{starl_term:guess(Life) + 1, 1, 1}],
            claimed(step(cast, {message, 2, dpp_refused, {starl_term:guess(Life), 0, 0}}, C))
        )
     || Life <- [1, 2, 60000, 1 bsl 57, ?NATURAL], C <- [claiming(), leading()]
    ].

%% -- numbers of requests --------------------------------------------------------------------

%% One that follows an insider is told that its numbers are far above: its next ones still are messages, and the next
%% coordinator takes them, in a few reports.
a_robot_that_is_told_a_far_number_is_heard_later_test() ->
    Life = 5,
    {_, P0} = starl_machine:new(starl_dpp_participant, #{}, base(1, dpp, Life, ?TEAM)),
    {_, P1} = step(cast, {message, 3, dpp_beat, {{1, 3, 1}, 1, []}}, P0),
    {Halts, P2} = step({call, {app, 1}}, request, P1),
    [Halted] = [N || {call, motion, stop, {halted, N}} <- Halts],
    {_, P3} = step({reply, {halted, Halted}}, ok, P2),
    {Asked, P4} = step({reply, {pose, Halted}}, {ok, {1.0, 2.0, 0.0}}, P3),
    [{3, {_, Id, _, _, _}}] = sent(dpp_request, Asked),
    {Last, _} = lists:foldl(
        fun(Us, {Before, P}) ->
            Above = {above, {?NATURAL, ?LARGEST}},
            {_, Told} = at(Us, cast, {message, 3, dpp_answer, {{1, 3, 1}, Before, Above, []}}, P),
            {Again, Next} = at(Us + 1, {timeout, again}, request, Told),
            [{3, {_, After, _, _, _} = Request}] = sent(dpp_request, Again),
            ?assert(After > Before),
            ?assert(starl_dpp_message:accepts(dpp_request, Request)),
            {After, Next}
        end,
        {Id, P4},
        lists:seq(100, 1000, 100)
    ),
    Taken = fun(S) ->
        {Next, _} = starl_dpp_dispatcher:reported(1, Last, {{standing, ?AT}, []}, S),
        {starl_dpp_dispatcher:knows(1, Next), Next}
    end,
    {Known, _} = lists:mapfoldl(fun(_, S) -> Taken(S) end, dispatcher(), lists:seq(1, 11)),
    ?assertEqual(lists:duplicate(10, false) ++ [true], Known).

%% What a robot says of itself with the largest numbers changes nothing for its next life.
a_robot_that_said_the_largest_number_is_served_in_its_next_life_test() ->
    [
        begin
            {S, _} = starl_dpp_dispatcher:requested(1, Id, {?AT, []}, dispatcher()),
            {Next, _} = starl_dpp_dispatcher:requested(1, {7, 1}, {?AT, []}, S),
            ?assert(starl_dpp_dispatcher:knows(1, Next))
        end
     || Id <- [{?NATURAL, ?LARGEST}, {1, ?LARGEST}]
    ].

%% Where the coordinator has taken a large number, the robot is told that, and counts above it.
a_large_number_that_was_taken_is_counted_above_test() ->
    Large = {?NATURAL, ?FAR},
    {S, _} = starl_dpp_dispatcher:requested(1, Large, {?AT, []}, dispatcher()),
    ?assert(starl_dpp_dispatcher:knows(1, S)),
    {_, Actions} = starl_dpp_dispatcher:requested(1, {7, 1}, {?AT, []}, S),
    ?assertMatch([{1, {_, {7, 1}, {above, Large}, []}}], sent(dpp_answer, Actions)),
    {Next, _} = starl_dpp_dispatcher:requested(1, {?NATURAL, ?FAR + 1}, {?AT, []}, S),
    {Told, _} = starl_dpp_dispatcher:requested(1, {?NATURAL, ?FAR + 1}, {?AT, []}, Next),
    ?assertEqual(Next, Told).

dispatcher() ->
    Plan = starl_dpp_dispatcher:prepare((config())#{robots => ?TEAM}),
    starl_dpp_dispatcher:new(Plan, {1, 2, 1}).

%% -- coordinators ---------------------------------------------------------------------------

config() ->
    #{
        segments => [{{3000.0, 3000.0}, {7000.0, 3000.0}}],
        world => {10000.0, 10000.0},
        tube_radius => 220.0,
        slack => 10.0,
        horizon => 2000.0,
        seed => 1
    }.

idle() ->
    {_, C} = starl_machine:new(
        starl_dpp_coordinator, config(), base(1, dpp_coordinator, 1, ?TEAM)
    ),
    C.

prevoting() -> stepped(cast, {missing, 1}, prevoting, idle()).

claiming() -> stepped(cast, {lead, 0}, claiming, idle()).

leading() ->
    State = fun(Robot) ->
        {message, Robot, dpp_state, {{1, 1, 1}, {1, 1}, {standing, spot(Robot)}, [], {0, 0, true}}}
    end,
    stepped(cast, State(1), leading, stepped(cast, State(2), claiming, claiming())).

stepped(Type, Event, State, C) ->
    {_, Next} = step(Type, Event, C),
    ?assertEqual(State, starl_machine:state(Next)),
    Next.

spot(Robot) -> {1000.0 * Robot, 9000.0}.

claims(Actions) -> [Term || {trace, {claims, Term}} <- Actions].

claimed({Actions, _C}) -> claims(Actions).
