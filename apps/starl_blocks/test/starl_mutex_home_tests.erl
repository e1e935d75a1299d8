%% The rules of a token's home, and the pitfalls of hand-over.
-module(starl_mutex_home_tests).
-include_lib("eunit/include/eunit.hrl").

-define(H, starl_mutex_home).
-define(LEASE, 1000000).
-define(RETRY, 500000).

%% Robot 1 owns the token `t'; robots 2 and 3 wait.
owned() ->
    {[{1, {token, t, F, [{1, 1}]}}], H1} = ?H:request(
        t, {1, 1}, 0, ?H:new(1, 0, ?LEASE, 1000, 0, ?RETRY)
    ),
    {granted, H2} = ?H:claim(t, F, 1, 0, H1),
    {F, H2}.

%% A lost report may be wrong: whichever of the claim and the return comes first wins.
lost_hand_over_claim_first_test() ->
    {F, H} = owned(),
    {granted, Claimed} = ?H:claim(t, ?H:next(F), 2, 10, H),
    ?assertEqual({[], Claimed}, ?H:return(t, ?H:next(F), 1, [{2, 1}, {3, 1}], 20, Claimed)).

lost_hand_over_return_first_test() ->
    {F, H} = owned(),
    {[{3, {token, t, G, Queue}}], Back} = ?H:return(t, ?H:next(F), 1, [{3, 1}, {2, 1}], 10, H),
    ?assertEqual([{3, 1}, {2, 1}], Queue),
    ?assert(G > ?H:next(F)),
    ?assertMatch({refused, _}, ?H:claim(t, ?H:next(F), 2, 20, Back)),
    ?assertMatch({refused, _}, ?H:renew(t, F, 1, 20, Back)),
    ?assertMatch({granted, _}, ?H:claim(t, G, 3, 20, Back)).

%% The queue lost with its owner: those that asked the home again get the new token.
queue_lost_with_owner_test() ->
    {F, H} = owned(),
    {[{1, {request, t, {2, 1}, F, home}}], H2} = ?H:request(t, {2, 1}, 10, H),
    {[_], H3} = ?H:request(t, {3, 1}, 20, H2),
    Due = ?H:due(t, H3),
    ?assertEqual({[], H3}, ?H:expire(t, Due - 1, H3)),
    {[{2, {token, t, G, Queue}}], _} = ?H:expire(t, Due, H3),
    ?assertEqual([{2, 1}, {3, 1}], Queue),
    ?assert(G > F).

%% A robot that has died had asked three times, with other calls each time: it costs one lease, not three.
the_requests_of_a_robot_have_one_turn_test() ->
    {_, H} = owned(),
    {[_], H2} = ?H:request(t, {2, 1}, 10, H),
    {[_], H3} = ?H:request(t, {2, 2}, 20, H2),
    {[_], H4} = ?H:request(t, {3, 1}, 30, H3),
    {[_], H5} = ?H:request(t, {2, 3}, 40, H4),
    {[{2, {token, t, _, Queue}}], H6} = ?H:expire(t, ?H:due(t, H5), H5),
    ?assertEqual([{2, 1}, {2, 2}, {3, 1}, {2, 3}], Queue),
    ?assertMatch({[{3, {token, t, _, [{3, 1}]}}], _}, ?H:expire(t, ?H:due(t, H6), H6)).

%% Who has not asked again while so many tokens were made waits no more: a token that had to visit all
%% who have given up would take longer than a lease. Whoever asks keeps its place.
who_no_longer_asks_is_left_out_test() ->
    {_, H} = owned(),
    %% the time in which all who wait ask again is three leases here
    {[{2, 1}, {3, 1}, {4, 1}, {5, 1}], H2} = all_ask([{2, 1}, {3, 1}, {4, 1}, {5, 1}], H),
    {[{3, 1}, {4, 1}, {5, 1}], H3} = all_ask([{4, 1}], H2),
    {[{4, 1}, {5, 1}, {6, 1}], H4} = all_ask([{6, 1}], H3),
    {[{5, 1}, {6, 1}], _} = all_ask([{5, 1}], H4),
    ?assertMatch({[{6, 1}], _}, all_ask([], H4)).

%% The queue of the token that is made next.
all_ask(Requests, Home) ->
    Asked = lists:foldl(fun(R, H) -> element(2, ?H:request(t, R, 0, H)) end, Home, Requests),
    {[{_, {token, t, _, Queue}}], Next} = ?H:expire(t, ?H:due(t, Asked), Asked),
    {Queue, Next}.

%% The home's lease is longer than the holder's by what two clocks may drift apart.
drift_is_waited_out_test() ->
    {_, H} = owned(),
    {_, H2} = ?H:request(t, {2, 1}, 10, H),
    ?assert(?H:due(t, H2) >= ?LEASE * 1001 / 999).

%% And by the time that a robot may take to notice.
lag_is_waited_out_test() ->
    [{[{1, {token, t, F, _}}], H}, {_, H0}] =
        [?H:request(t, {1, 1}, 0, ?H:new(1, 0, ?LEASE, 1000, Lag, ?RETRY)) || Lag <- [250000, 0]],
    [{granted, G}, {granted, G0}] = [?H:claim(t, F, 1, 0, Home) || Home <- [H, H0]],
    [{_, W}, {_, W0}] = [?H:request(t, {2, 1}, 10, Home) || Home <- [G, G0]],
    ?assert(?H:due(t, W) >= ?H:due(t, W0) + 250000).

%% After a crash the home waits for a full lease and grants higher numbers only; an owner of
%% before may go on, and is waited for.
restarted_home_waits_test() ->
    {F, _} = owned(),
    New = ?H:new(2, 5000000, ?LEASE, 1000, 0, ?RETRY),
    {[], H1} = ?H:request(t, {2, 1}, 5000010, New),
    ?assertMatch({refused, _}, ?H:claim(t, ?H:next(F), 3, 5000020, H1)),
    First = ?H:due(t, H1),
    ?assert(First >= 5000000 + ?LEASE),
    {kept, H2} = ?H:renew(t, F, 1, 5500000, H1),
    ?assert(?H:due(t, H2) > First),
    {[{2, {token, t, G, _}}], H3} = ?H:expire(t, ?H:due(t, H2), H2),
    ?assert(G > ?H:next(F)),
    ?assertMatch({refused, _}, ?H:renew(t, F, 1, 7000000, H3)).

%% A robot whose clock stood still may ask too late to go on, just after a crash of the home. Once
%% the owner that followed it has been renewed, it is refused.
restarted_home_keeps_to_the_newest_test() ->
    {F, _} = owned(),
    New = ?H:new(2, 5000000, ?LEASE, 1000, 0, ?RETRY),
    {kept, H1} = ?H:renew(t, F, 1, 5000010, New),
    {kept, H2} = ?H:renew(t, ?H:next(F), 2, 5000020, H1),
    ?assertMatch({refused, _}, ?H:renew(t, F, 1, 5000030, H2)),
    ?assertMatch({kept, _}, ?H:renew(t, ?H:next(F), 2, 5000040, H2)).

%% A token of an earlier incarnation comes back at the end of its hold: a new one is made when a lease
%% is over since the crash, at once after that. If another owner of before has shown itself, too, its
%% lease is waited for.
kept_token_comes_back_test() ->
    {F, _} = owned(),
    New = ?H:new(2, 5000000, ?LEASE, 1000, 0, ?RETRY),
    {kept, Kept} = ?H:renew(t, F, 1, 5000010, New),
    {[], Waits} = ?H:return(t, F, 1, [{2, 1}], 5000020, Kept),
    ?assertEqual(?H:due(t, element(2, ?H:request(t, {2, 1}, 5000020, New))), ?H:due(t, Waits)),
    Late = 5000000 + 2 * ?LEASE,
    {kept, Renewed} = ?H:renew(t, F, 1, Late, Kept),
    ?assertMatch({[{2, {token, t, _, _}}], _}, ?H:return(t, F, 1, [{2, 1}], Late, Renewed)),
    {kept, Both} = ?H:renew(t, ?H:next(F), 3, Late, Kept),
    ?assertMatch({[], _}, ?H:return(t, ?H:next(F), 3, [{2, 1}], Late, Both)).

%% Of a number of a creation that the home has not made it hears nothing: it goes on with its own
%% numbers. Those of the last creation can be used up; then it makes another token.
numbers_that_were_never_made_test() ->
    {F, H} = owned(),
    Most = (1 bsl 128) - 1,
    Creation = 1 bsl 20,
    False = [Most, ?H:hand_over(Most), 1 bsl 127, F + Creation, F + 2 * Creation, F + (1 bsl 44)],
    [
        begin
            ?assertEqual({refused, H}, ?H:claim(t, Fence, 2, 10, H)),
            ?assertEqual({[], H}, ?H:return(t, Fence, 2, [{3, 1}], 10, H))
        end
     || Fence <- False
    ],
    %% nor before a token was made at all
    New = ?H:new(1, 0, ?LEASE, 1000, 0, ?RETRY),
    [?assertEqual({refused, New}, ?H:claim(t, Fence, 2, 10, New)) || Fence <- [F | False]],
    Last = F + Creation - (1 bsl 8),
    ?assert(?H:last_hand_over(Last)),
    {granted, Used} = ?H:claim(t, Last, 2, 10, H),
    {[{3, {token, t, G, _}}], _} = ?H:return(t, Last, 2, [{3, 1}], 20, Used),
    ?assertEqual(F + Creation, G).

%% Forwarding: two robots that take each other for the owner send a request once each, then it
%% goes to the home, and once more; it does not go in circles.
stale_owners_do_not_circle_test() ->
    Team = [1, 2, 3],
    Net = maps:from_list([{R, robot(R, Team)} || R <- Team]),
    #{1 := R1, 2 := R2, 3 := R3} = Net,
    F = 1 bsl 60,
    Stale = Net#{
        1 := starl_mutex_robot:announced(t, F, 2, R1),
        2 := starl_mutex_robot:announced(t, F + 1, 1, R2),
        3 := starl_mutex_robot:announced(t, F, 2, R3)
    },
    ?assert(hops([{3, {request, t, {3, 1}, 0, none}}], Stale, 0) =< 2 * length(Team) + 2).

robot(R, Team) ->
    starl_mutex_state:new(#{
        robot => R,
        participants => Team,
        incarnation => 1,
        now => 0,
        lease_us => ?LEASE,
        drift_ppm => 1000,
        lag_us => 0,
        retry_us => ?LEASE
    }).

hops([], _Net, Count) ->
    Count;
hops(_, _Net, 100) ->
    100;
hops([{To, {request, T, Request, Known, Via}} | Rest], Net, Count) ->
    {keep_state, Robot, Actions} =
        starl_mutex_state:result(
            starl_mutex_robot:route(T, Request, Known, Via, maps:get(To, Net))
        ),
    Sent = [{D, M} || {cast, sap, {send, D, mutex, M}} <- Actions, element(1, M) =:= request],
    hops(Rest ++ Sent, Net#{To := Robot}, Count + 1).
