%% The parts of a robot of mutual exclusion: its application's acquisitions, what it has heard of
%% owners, and the rules of a home, at their edges.
-module(starl_mutex_parts_tests).
-include_lib("eunit/include/eunit.hrl").

-define(J, starl_mutex_job).
-define(O, starl_mutex_owners).
-define(H, starl_mutex_home).
-define(LEASE, 1000000).

%% -- acquisitions -------------------------------------------------------------------------------

%% A set is acquired token by token in the order of terms, each once; the answer is in that order.
set_test() ->
    Job = ?J:new(app, {app, 1}, [c, a, b, a]),
    ?assertEqual({app, {app, 1}}, {?J:caller(Job), ?J:from(Job)}),
    ?assertEqual({wait, a}, ?J:next(Job)),
    ?assertEqual([true, false, false], [?J:waits_for(T, Job) || T <- [a, b, d]]),
    Two = ?J:got(b, 2, ?J:got(a, 1, Job)),
    ?assertEqual({{wait, c}, [b, a]}, {?J:next(Two), ?J:held(Two)}),
    All = ?J:got(c, 3, Two),
    ?assertEqual({complete, false}, {?J:next(All), ?J:waits_for(c, All)}),
    ?assertEqual([{a, 1}, {b, 2}, {c, 3}], ?J:answer(All)),
    ?assertEqual([{a, 1}, {b, 2}, {c, 3}], ?J:fences(All)),
    %% once more from its beginning, with what it had
    Anew = ?J:anew(Two),
    ?assertEqual({{wait, a}, []}, {?J:next(Anew), ?J:held(Anew)}),
    ?assertEqual(All, ?J:got(c, 3, ?J:got(b, 2, ?J:got(a, 1, Anew)))).

%% One token is answered with its fence, a set of one with the set.
one_test() ->
    ?assertEqual(7, ?J:answer(?J:got(a, 7, ?J:new(app, {app, 1}, a)))),
    ?assertEqual([{a, 7}], ?J:answer(?J:got(a, 7, ?J:new(app, {app, 1}, [a])))),
    Two = ?J:got(b, 2, ?J:got(a, 1, ?J:new(app, {app, 1}, [a, b]))),
    ?assertEqual([b], ?J:held(?J:without(a, Two))),
    ?assertEqual(none, ?J:without(b, ?J:without(a, Two))).

%% What happens to acquisitions is told once, the first first.
notices_test() ->
    New = starl_mutex_state:new(#{
        robot => 1,
        participants => [1, 2],
        incarnation => 1,
        now => 0,
        lease_us => ?LEASE,
        drift_ppm => 0,
        lag_us => 0,
        retry_us => 1
    }),
    Notices = [{locked, 1, a, 7}, {lost, 2, b, []}, {locked, 3, c, 8}],
    Told = lists:foldl(fun starl_mutex_state:notify/2, New, Notices),
    ?assertEqual({Notices, New}, starl_mutex_state:take_notices(Told)),
    ?assertEqual({[], New}, starl_mutex_state:take_notices(New)).

%% -- owners -------------------------------------------------------------------------------------

%% Only a newer owner is news, and sets those going that wait here for the token.
announced_test() ->
    New = ?O:new(),
    ?assertEqual({0, none}, ?O:newest(a, New)),
    Waiting = ?O:wait(b, {{4, 1}, 9}, 3, ?O:wait(a, {{3, 1}, 5}, 3, New)),
    {newer, Early, Told} = ?O:announced(a, 6, 2, Waiting),
    ?assertEqual({[{{3, 1}, 5}], {6, 2}}, {Early, ?O:newest(a, Told)}),
    ?assertEqual({[], Told}, ?O:take_early(a, Told)),
    ?assertMatch({[{4, 1}], _}, ?O:take_early(b, Told)),
    [?assertEqual({F, known}, {F, ?O:announced(a, F, 1, Told)}) || F <- [5, 6]],
    ?assertMatch({newer, [], _}, ?O:announced(a, 7, 1, Told)),
    ?assertEqual({7, 1}, ?O:newest(a, ?O:handed(a, 7, 1, Told))),
    ?assertEqual({0, none}, ?O:newest(b, Told)).

%% Those that wait are served in the order in which they came, one a robot's request, so many.
wait_test() ->
    Wait = fun(Requests, Most) ->
        Owners = lists:foldl(fun(E, O) -> ?O:wait(a, E, Most, O) end, ?O:new(), Requests),
        {newer, Early, _} = ?O:announced(a, 100, 1, Owners),
        {Requested, Left} = ?O:take_early(a, Owners),
        ?assertEqual([Request || {Request, _} <- Early], Requested),
        ?assertEqual({[], Left}, ?O:take_early(a, Left)),
        Early
    end,
    [A, B, C] = [{{R, 1}, 5} || R <- [3, 1, 2]],
    ?assertEqual([A, B, C], Wait([A, B, C], 3)),
    ?assertEqual([A, B], Wait([A, B, C], 2)),
    ?assertEqual([{{3, 1}, 7}, B], Wait([A, B, {{3, 1}, 7}], 3)),
    ?assertEqual([A, B], Wait([A, B, {{3, 1}, 4}], 3)),
    ?assertEqual([A, {{3, 2}, 4}], Wait([A, {{3, 2}, 4}], 3)),
    ?assertEqual([{1, 1}, {2, 1}], ?O:add({2, 1}, [{1, 1}])),
    ?assertEqual([{1, 1}, {2, 1}], ?O:add({1, 1}, [{1, 1}, {2, 1}])).

%% -- the home -----------------------------------------------------------------------------------

home() -> ?H:new(1, 0, ?LEASE, 1000, 0, 1000000).

%% Robot 1 owns the token.
owned() ->
    {[{1, {token, t, F, [{1, 1}]}}], H} = ?H:request(t, {1, 1}, 0, home()),
    {granted, Owned} = ?H:claim(t, F, 1, 0, H),
    {F, Owned}.

%% A number counts holds, then hand-overs, then creations; each has its end.
numbers_test() ->
    {F, _} = owned(),
    ?assertEqual(F, ?H:hand_over(F)),
    Last = ?H:next(F) - 1,
    ?assertEqual([false, false, true], [?H:last_hold(N) || N <- [F, Last - 1, Last]]),
    ?assertEqual(F, ?H:hand_over(Last)),
    ?assertEqual(?H:next(F), ?H:next(Last)),
    ?assert(?H:next(F) > Last),
    Nexts = fun Count(N, K) ->
        case ?H:last_hand_over(N) of
            true -> {K, N};
            false -> Count(?H:next(N), K + 1)
        end
    end,
    {Count, End} = Nexts(F, 1),
    ?assert(Count > 1000),
    %% the next creation of the token is beyond them all
    {granted, H} = ?H:claim(t, End, 2, 10, element(2, owned())),
    {[{3, {token, t, G, _}}], _} = ?H:return(t, End, 2, [{3, 1}], 20, H),
    ?assert(G > End).

%% The lease of the home is longer than the holder's by the drift of two clocks and the lag, and
%% not by much more: a token whose owner is gone is had again soon.
longer_test() ->
    Due = fun(Lease, Ppm, Lag) ->
        {[_], H} = ?H:request(t, {1, 1}, 0, ?H:new(1, 0, Lease, Ppm, Lag, 1000000)),
        {_, Waits} = ?H:request(t, {2, 1}, 10, H),
        ?H:due(t, Waits)
    end,
    [
        begin
            Right = (Lease + Lag) * (1000000 + Ppm) / (1000000 - Ppm),
            ?assert(Due(Lease, Ppm, Lag) >= Right),
            ?assert(Due(Lease, Ppm, Lag) =< Right + 2000)
        end
     || Lease <- [?LEASE, 3600 * ?LEASE], Ppm <- [0, 1000, 10000], Lag <- [0, 250000]
    ].

%% Who owns the token is confirmed, again and again; nobody else with the same number or an older.
claims_test() ->
    {F, H} = owned(),
    ?assertMatch({granted, _}, ?H:claim(t, F, 1, 10, H)),
    ?assertEqual({refused, H}, ?H:claim(t, F, 2, 10, H)),
    ?assertEqual({refused, H}, ?H:claim(t, F - 1, 2, 10, H)),
    ?assertMatch({granted, _}, ?H:renew(t, F, 1, 10, H)),
    ?assertEqual({refused, H}, ?H:renew(t, F, 2, 10, H)),
    ?assertEqual({refused, H}, ?H:renew(t, ?H:next(F), 1, 10, H)),
    {granted, Next} = ?H:claim(t, ?H:next(F), 2, 10, H),
    ?assertEqual({refused, Next}, ?H:claim(t, F, 1, 20, Next)),
    ?assertEqual({refused, Next}, ?H:renew(t, F, 1, 20, Next)),
    %% another token is another matter
    ?assertMatch({[{2, {token, u, _, [{2, 1}]}}], _}, ?H:request(u, {2, 1}, 10, H)).

%% A confirmation begins a new lease.
renewed_test() ->
    {F, H} = owned(),
    {_, Waits} = ?H:request(t, {2, 1}, 10, H),
    First = ?H:due(t, Waits),
    [
        begin
            {granted, Later} = ?H:Kind(t, F, 1, 500, Waits),
            ?assertEqual(First + 500, ?H:due(t, Later)),
            ?assertEqual({[], Later}, ?H:expire(t, First + 499, Later)),
            ?assertMatch({[{2, {token, t, _, [{2, 1}]}}], _}, ?H:expire(t, First + 500, Later))
        end
     || Kind <- [claim, renew]
    ].

%% Those that ask the home wait there, once each and in their order, until they have the token or
%% its lease is over; the owner is told of them.
pending_test() ->
    {F, H} = owned(),
    ?assertEqual(never, ?H:due(t, H)),
    ?assertEqual(never, ?H:due(u, H)),
    {Sent, One} = ?H:request(t, {3, 1}, 10, H),
    ?assertEqual([{1, {request, t, {3, 1}, F, home}}], Sent),
    {_, Two} = ?H:request(t, {2, 1}, 20, One),
    {Again, Two} = ?H:request(t, {3, 1}, 30, Two),
    ?assertEqual(Sent, Again),
    {Own, Three} = ?H:request(t, {1, 2}, 40, Two),
    ?assertEqual([], Own),
    Due = ?H:due(t, Three),
    ?assertMatch({[{3, {token, t, _, [{3, 1}, {2, 1}, {1, 2}]}}], _}, ?H:expire(t, Due, Three)),
    %% a request after the end of the lease does it, too
    {[{3, {token, t, G, [{3, 1}, {2, 1}, {1, 2}]}}], Made} = ?H:request(t, {2, 1}, Due, Three),
    %% who has got it waits no more, the others do
    {granted, Had} = ?H:claim(t, G, 3, Due, Made),
    ?assertMatch(
        {[{2, {token, t, _, [{2, 1}, {1, 2}]}}], _}, ?H:expire(t, ?H:due(t, Had), Had)
    ),
    {granted, Gone} = ?H:claim(t, ?H:next(G), 2, Due, Had),
    ?assertMatch({[{1, {token, t, _, [{1, 2}]}}], _}, ?H:expire(t, ?H:due(t, Gone), Gone)).

%% The owner gives the token back: who waits gets a new one at once; nobody else can.
return_test() ->
    {F, H} = owned(),
    ?assertEqual({[], H}, ?H:return(t, F, 2, [{2, 1}], 10, H)),
    ?assertEqual({[], H}, ?H:return(t, F - 1, 1, [{2, 1}], 10, H)),
    {[], Free} = ?H:return(t, F, 1, [], 10, H),
    ?assertMatch({refused, _}, ?H:renew(t, F, 1, 20, Free)),
    {[{2, {token, t, G, [{2, 1}]}}], _} = ?H:request(t, {2, 1}, 20, Free),
    ?assert(G > F),
    {_, Waits} = ?H:request(t, {3, 1}, 10, H),
    %% the token's own queue comes first, each robot's request once
    ?assertMatch(
        {[{2, {token, t, _, [{2, 1}, {4, 1}, {3, 1}]}}], _},
        ?H:return(t, F, 1, [{2, 1}, {4, 1}], 20, element(2, ?H:request(t, {4, 1}, 10, Waits)))
    ).

%% A home that has crashed confirms no claim of before, creates nothing for a lease, and takes no
%% token of before back.
restarted_test() ->
    {F, _} = owned(),
    New = ?H:new(2, 0, ?LEASE, 1000, 0, 1000000),
    ?assertEqual({refused, New}, ?H:claim(t, F, 1, 10, New)),
    ?assertEqual({[], New}, ?H:return(t, F, 1, [{2, 1}], 10, New)),
    {[], Waits} = ?H:request(t, {2, 1}, 10, New),
    {[], Waits} = ?H:expire(t, ?H:due(t, Waits) - 1, Waits),
    {[{2, {token, t, G, _}}], Made} = ?H:expire(t, ?H:due(t, Waits), Waits),
    ?assert(G > F),
    ?assertMatch({refused, _}, ?H:renew(t, F, 1, ?LEASE, Made)),
    ?assertMatch({granted, _}, ?H:claim(t, G, 2, ?LEASE, Made)).

%% A home that has crashed begins beyond all the numbers that it ever gave, however many those are.
incarnations_test() ->
    Make = fun(_, {F, H}) ->
        {[{2, {token, t, G, _}}], Next} = ?H:return(t, F, 2, [{2, 1}], 10, H),
        ?assert(G > F),
        {G, Next}
    end,
    {[{2, {token, t, First, _}}], Home} = ?H:request(t, {2, 1}, 0, home()),
    {Last, _} = lists:foldl(Make, {First, Home}, lists:seq(1, 500)),
    New = ?H:new(2, 0, ?LEASE, 1000, 0, 1000000),
    {[], Waits} = ?H:request(t, {2, 1}, 10, New),
    {[{2, {token, t, Fence, _}}], _} = ?H:expire(t, ?H:due(t, Waits), Waits),
    ?assert(Fence > Last),
    ?assertEqual({refused, New}, ?H:claim(t, Last, 2, 10, New)),
    %% there is room for 24 bits of creations in a life
    {Second, _} = Make(1, {First, Home}),
    ?assertEqual((Second - First) bsl 24, Fence - First).
