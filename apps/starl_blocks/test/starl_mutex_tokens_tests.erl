%% How a request finds the token when messages overtake each other, and what a robot does first
%% that finds its leases over.
-module(starl_mutex_tokens_tests).
-include_lib("eunit/include/eunit.hrl").

-define(F, (1 bsl 44)).
-define(HAND_OVER, (1 bsl 8)).

%% Robot 2 of three, which is not the token's home and wants nothing.
robot() -> robot(2).

robot(Id) ->
    Base = #{
        robot => Id,
        participants => [1, 2, 3],
        name => mutex,
        incarnation => 1,
        now => 0,
        random => rand:seed_s(exsss, 1)
    },
    {_, Machine} = starl_machine:new(starl_mutex_tokens, #{}, Base),
    Machine.

%% A token whose home is robot 1.
token() -> hd([T || T <- lists:seq(1, 100), erlang:phash2(T, 3) =:= 0]).

%% What robot 2 sends in the end.
sent(Messages) ->
    {Last, _} = lists:foldl(
        fun({From, Message}, {_, Machine}) ->
            Content = {message, From, mutex, Message},
            starl_machine:step(cast, Content, #{now => 1, robot => 2}, Machine)
        end,
        {[], robot()},
        Messages
    ),
    [{To, Body} || {Kind, sap, {send, To, mutex, Body}} <- casts(Last), Kind =:= cast].

casts(Actions) ->
    [
        case A of
            {call, M, R, _} -> {cast, M, R};
            _ -> A
        end
     || A <- Actions, tuple_size(A) > 2
    ].

%% Robot 3's request waits for the token that robot 1 is handing over. An announcement of robot 1's
%% own, earlier hold comes late: the request goes on waiting, and on with the token.
late_announcement_test() ->
    T = token(),
    Next = ?F + ?HAND_OVER,
    Sent = sent([
        {1, {request, T, {3, 1}, Next, home}},
        {1, {owner, T, ?F}},
        {1, {token, T, Next, []}}
    ]),
    ?assertEqual([{3, {token, T, Next + ?HAND_OVER, [{3, 1}]}}], Sent).

%% An announcement of a later hold, by another robot: the request goes there.
newer_announcement_test() ->
    T = token(),
    Next = ?F + ?HAND_OVER,
    Newer = Next + ?HAND_OVER,
    Sent = sent([{1, {request, T, {3, 1}, Next, home}}, {1, {owner, T, Newer}}]),
    ?assertEqual([{1, {request, T, {3, 1}, Newer, home}}], Sent).

%% The owner itself asks, as its hold is over: its home knows more than it does.
owner_asks_test() ->
    T = token(),
    Owner = {3, {owner, T, ?F}},
    ?assertEqual(
        [{1, {request, T, {3, 1}, 0, home}}], sent([Owner, {3, {request, T, {3, 1}, 0, none}}])
    ),
    ?assertEqual([], sent([Owner, {1, {request, T, {3, 1}, 1, home}}])),
    ?assertEqual(
        [{3, {request, T, {1, 1}, ?F, none}}], sent([Owner, {1, {request, T, {1, 1}, 0, none}}])
    ).

%% A request that comes twice waits once, for the later of the hand-overs that its senders knew of:
%% an announcement between the two does not send it on.
twice_test_() ->
    T = token(),
    [First, Second, Third, Next] = [?F + K * ?HAND_OVER || K <- [1, 2, 3, 4]],
    [
        begin
            Asked = [{1, {request, T, {3, 1}, Known, home}} || Known <- Order],
            Told = Asked ++ [{1, {owner, T, Second}}],
            [
                ?_assertEqual([], sent(Told)),
                ?_assertEqual(
                    [{3, {token, T, Next, [{3, 1}]}}], sent(Told ++ [{1, {token, T, Third, []}}])
                )
            ]
        end
     || Order <- [[First, Third], [Third, First]]
    ].

%% Two robots that take each other for the owner send a request once each, then it goes to the home,
%% and once more; it does not go in circles.
stale_owners_do_not_circle_test() ->
    Stale = #{
        1 => hears_of_owner(2, ?F, robot(1)),
        2 => hears_of_owner(1, ?F + ?HAND_OVER, robot(2)),
        3 => hears_of_owner(2, ?F, robot(3))
    },
    ?assert(hops([{3, {request, token(), {3, 1}, 0, none}}], Stale, 0) =< 8).

hears_of_owner(Owner, Fence, Machine) ->
    element(2, message(0, Owner, {owner, token(), Fence}, Machine)).

hops([], _Net, Count) ->
    Count;
hops(_, _Net, 100) ->
    100;
hops([{To, Request} | Rest], Net, Count) ->
    {Actions, Machine} = message(0, 1, Request, maps:get(To, Net)),
    Sent = [{D, M} || {D, M} <- posts(Actions), element(1, M) =:= request],
    hops(Rest ++ Sent, Net#{To := Machine}, Count + 1).

%% -- leases that are over -----------------------------------------------------------------------

-define(LEASE_US, 1000000).

%% Robot 2 begins to acquire these tokens of home 1 at a time, and is granted them as they come; the
%% actions and the machine, with all claims made at that time.
holding(Tokens, At) -> holding(Tokens, Tokens, At).

holding(Wanted, Given, At) ->
    Base = #{
        robot => 2,
        participants => [1, 2, 3],
        name => mutex,
        incarnation => 1,
        now => At,
        random => rand:seed_s(exsss, 1)
    },
    {_, New} = starl_machine:new(starl_mutex_tokens, #{lease_ms => ?LEASE_US div 1000}, Base),
    {_, Asking} = at(At, {call, {app, 1}}, {acquire, Wanted, 5 * ?LEASE_US}, New),
    lists:foldl(fun(Token, Machine) -> element(2, given(Token, At, Machine)) end, Asking, Given).

given(Token, At, Machine) ->
    {_, Claiming} = message(At, 1, {token, Token, ?F, [{2, 1}]}, Machine),
    message(At, 1, {granted, Token, ?F, {1, At}}, Claiming).

message(At, From, Message, Machine) -> at(At, cast, {message, From, mutex, Message}, Machine).

at(At, Type, Content, Machine) ->
    {Actions, Next} = starl_machine:step(Type, Content, #{now => At, robot => 2}, Machine),
    {starl_action:without_latest(Actions), Next}.

traces(Actions) -> [Event || {trace, Event} <- Actions].

answers(Actions) -> [Answer || {reply, {app, _}, Answer} <- Actions].

%% Two tokens whose home is robot 1.
two() -> lists:sublist([T || T <- lists:seq(1, 100), erlang:phash2(T, 3) =:= 0], 2).

%% What a hold is told to the monitor with: the lease, the fence, the answer, in this order.
told_test() ->
    [A, B] = two(),
    Machine = holding([A, B], [A], 50),
    {_, Claiming} = message(100, 1, {token, B, ?F, [{2, 1}]}, Machine),
    {Actions, _} = message(300, 1, {granted, B, ?F, {1, 100}}, Claiming),
    ?assertEqual(
        [{leased, B, ?F, ?LEASE_US - 200}, {acquired, B, ?F}, {answered, [{A, ?F}, {B, ?F}]}],
        traces(Actions)
    ),
    ?assertEqual([{ok, [{A, ?F}, {B, ?F}]}], answers(Actions)).

%% A renewal is told; one that is no longer is not.
renewal_told_test() ->
    [A, _] = two(),
    Machine = holding([A], 50),
    {Actions, Renewed} = message(700, 1, {granted, A, ?F, {1, 600}}, Machine),
    ?assertEqual([{leased, A, ?F, ?LEASE_US - 100}], traces(Actions)),
    {Older, _} = message(800, 1, {granted, A, ?F, {1, 500}}, Renewed),
    ?assertEqual([], traces(Older)).

%% A hold is renewed from its beginning on, also one of a token that lies idle here: the timer of
%% the claim is over by then.
renewed_from_the_beginning_test() ->
    [A, _] = two(),
    Machine = holding(A, [A], 0),
    {_, Idle} = at(10, {call, {app, 1}}, {release, A}, Machine),
    [
        begin
            {Actions, Held} = at(At, {call, {app, 1}}, {acquire, A, ?LEASE_US}, Idle),
            ?assertMatch([{leased, A, _, _}, {acquired, A, _} | _], tl(traces(Actions))),
            ?assertEqual([First], renewals(A, Actions)),
            ?assertEqual([], asked(Actions)),
            %% and so on, as long as it is held
            {Again, _} = at(At + ?LEASE_US div 4, {timeout, {renew, A}}, again, Held),
            ?assertEqual([?LEASE_US div 4], renewals(A, Again)),
            ?assertEqual([renew], asked(Again))
        end
     || {At, First} <- [{20, ?LEASE_US div 4}, {?LEASE_US div 2, 0}]
    ].

renewals(Token, Actions) -> [Us || {{timeout, {renew, T}}, Us, again} <- Actions, T =:= Token].

asked(Actions) ->
    [Kind || {cast, sap, {send, 1, mutex, {ask, Kind, _, _, _}}} <- Actions].

%% A robot that has stood still hands on nothing whose lease is over: whoever asks for it is sent
%% to the home. Just before the end it does (when it has released it).
request_comes_first_test() ->
    [A, _] = two(),
    Machine = holding(A, [A], 0),
    {_, Idle} = at(10, {call, {app, 2}}, {release, A}, Machine),
    Ask = {request, A, {3, 1}, ?F, home},
    {Before, _} = message(?LEASE_US - 1, 3, Ask, Idle),
    ?assertMatch([{handed_over, A, _, 3}], traces(Before)),
    [
        begin
            {Actions, _} = message(?LEASE_US, 3, Ask, Had),
            ?assertEqual(Traced, traces(Actions)),
            ?assertEqual([], [To || {call, sap, {send, To, mutex, {token, _, _, _}}, _} <- Actions])
        end
     || {Had, Traced} <- [{Idle, []}, {Machine, [{lease_lost, A, ?F}]}]
    ].

%% Whatever comes first: a call to release, to acquire, a timer, a message of another token.
release_comes_first_test() ->
    [A, B] = two(),
    Machine = holding(A, [A], 0),
    [
        begin
            {Actions, After} = at(?LEASE_US, Type, Content, Machine),
            ?assertEqual([{lease_lost, A, ?F}], [E || {lease_lost, _, _} = E <- traces(Actions)]),
            ?assertEqual({lease_lost, A, ?F}, hd(traces(Actions))),
            {Released, _} = at(?LEASE_US, {call, {app, 1}}, {release, A}, After),
            ?assertEqual([], traces(Released)),
            ?assertEqual([{error, lost}], answers(Released))
        end
     || {Type, Content} <- [
            {{call, {app, 9}}, {acquire, A, ?LEASE_US}},
            {{timeout, {renew, A}}, again},
            {{timeout, {lease, A}}, over},
            {{timeout, {again, 1}}, again},
            {cast, {message, 1, mutex, {granted, A, ?F, {1, ?LEASE_US - 1}}}},
            {cast, {message, 1, mutex, {owner, B, ?F}}},
            {info, {restarted, sap}}
        ]
    ],
    {Released, _} = at(?LEASE_US, {call, {app, 1}}, {release, A}, Machine),
    ?assertEqual([{lease_lost, A, ?F}], traces(Released)),
    ?assertEqual([{error, lost}], answers(Released)),
    {InTime, _} = at(?LEASE_US - 1, {call, {app, 1}}, {release, A}, Machine),
    ?assertEqual([{released, A, ?F}], traces(InTime)),
    ?assertEqual([ok], answers(InTime)).

%% A set of which all is over, complete or not: each hold is lost, none released, and the one that
%% still waits begins anew once.
set_is_over_test() ->
    [A, B] = two(),
    [C | _] = [T || T <- lists:seq(B + 1, 100), erlang:phash2(T, 3) =:= 0],
    Lost = [{lease_lost, T, ?F} || T <- [A, B]],
    {Complete, _} = at(?LEASE_US, info, {restarted, sap}, holding([A, B], 0)),
    ?assertEqual(Lost, traces(Complete)),
    {Waits, _} = at(?LEASE_US, info, {restarted, sap}, holding([A, B, C], [A, B], 0)),
    [LostA, {failed, C, lease_lost}, LostB, {requested, A}] = traces(Waits),
    ?assertEqual(Lost, [LostA, LostB]).

%% One that has no patience left gives back what is still its own, and nothing else.
patience_is_over_test() ->
    [A, B] = two(),
    Machine = holding([A, B], [A], 0),
    Gone = fun(At) ->
        {Actions, _} = at(At, {timeout, {patience, 1}}, patience, Machine),
        traces(Actions)
    end,
    ?assertEqual([{failed, B, timeout}, {released, A, ?F}], Gone(?LEASE_US - 1)),
    ?assertEqual(
        [
            {lease_lost, A, ?F},
            {failed, B, lease_lost},
            {requested, A},
            {failed, A, timeout}
        ],
        Gone(?LEASE_US)
    ).

%% Monotonic clocks may well read less than nothing.
before_zero_test() ->
    [A, _] = two(),
    Machine = holding(A, [A], -5 * ?LEASE_US),
    {Released, _} = at(-4 * ?LEASE_US - 1, {call, {app, 1}}, {release, A}, Machine),
    ?assertEqual([ok], answers(Released)).

%% An application that is not started any more holds nothing and waits for nothing.
caller_given_up_test() ->
    [A, B] = two(),
    [
        ?assertEqual(
            at(100, info, {restarted, app}, Machine), at(100, info, {given_up, app}, Machine)
        )
     || Machine <- [holding([A, B], 50), holding([A, B], [A], 50)]
    ],
    {Actions, _} = at(100, info, {given_up, app}, holding([A, B], 50)),
    ?assertEqual(lists:sort([A, B]), lists:sort([T || {released, T, _} <- traces(Actions)])).

%% -- holds that begin with a lease that is there already -----------------------------------------

%% An idle token is held again at once while its lease is fresh; then the hold is renewed in time,
%% by a timer that stands from its beginning on.
fresh_lease_test() ->
    [A, _] = two(),
    {Actions, Again} = acquired_again(A, ?LEASE_US div 2),
    ?assertMatch(
        [{requested, A}, {leased, A, _, _}, {acquired, A, _}, {answered, _}], traces(Actions)
    ),
    ?assertMatch([Us] when Us =< ?LEASE_US div 2, renew_timers(A, Actions)),
    {Renewing, _} = at(?LEASE_US * 3 div 4, {timeout, {renew, A}}, again, Again),
    ?assertEqual([renew], asks(Renewing)),
    ?assertMatch([_], renew_timers(A, Renewing)).

%% When more than half of it is over the home is asked first, again and again: no hold begins that
%% might be lost at once. With the home's word it begins, with the new lease.
worn_lease_test() ->
    [A, _] = two(),
    At = ?LEASE_US - 10000,
    {Actions, Asking} = acquired_again(A, At),
    ?assertEqual([{requested, A}], traces(Actions)),
    ?assertEqual([], answers(Actions)),
    ?assertEqual([renew], asks(Actions)),
    {Repeated, _} = at(At + 5000, {timeout, {renew, A}}, again, Asking),
    ?assertEqual([renew], asks(Repeated)),
    {Begun, _} = message(At + 9000, 1, {granted, A, ?F, {1, At}}, Asking),
    ?assertEqual(
        [{leased, A, ?F + 1, ?LEASE_US - 9000}, {acquired, A, ?F + 1}],
        lists:sublist(traces(Begun), 2)
    ),
    ?assertMatch([{ok, _}], answers(Begun)),
    %% whoever else asks meanwhile is next
    {Queued, Later} = message(At + 1, 3, {request, A, {3, 1}, ?F, home}, Asking),
    ?assertEqual([], traces(Queued)),
    {_, Held} = message(At + 9000, 1, {granted, A, ?F, {1, At}}, Later),
    {Released, _} = at(At + 9500, {call, {app, 3}}, {release, A}, Held),
    ?assertMatch([{released, A, _}, {handed_over, A, _, 3}], traces(Released)),
    %% where the home says nothing the request goes to it when the lease is over
    {Over, _} = at(?LEASE_US, {timeout, {lease, A}}, over, Asking),
    ?assertEqual([{1, {request, A, {2, 2}, 0, home}}], [{To, M} || {To, M} <- posts(Over)]).

%% Robot 2 has held a token, and wants it again at a time.
acquired_again(Token, At) ->
    {_, Idle} = at(10, {call, {app, 2}}, {release, Token}, holding(Token, [Token], 0)),
    at(At, {call, {app, 3}}, {acquire, Token, 5 * ?LEASE_US}, Idle).

renew_timers(Token, Actions) -> [Us || {{timeout, {renew, T}}, Us, again} <- Actions, T =:= Token].

asks(Actions) -> [Kind || {_, {ask, Kind, _, _, _}} <- posts(Actions)].

posts(Actions) -> [{To, M} || {cast, sap, {send, To, mutex, M}} <- Actions].
