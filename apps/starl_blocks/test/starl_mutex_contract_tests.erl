%% The contract of mutual exclusion once more: who broke it and when, what is counted, and the order
%% of requests.
-module(starl_mutex_contract_tests).
-include_lib("eunit/include/eunit.hrl").

-define(HOME, 9).

%% Each violation as it is told, and the results.
told(Events, End, Config) ->
    {Met, Last} = lists:foldl(
        fun(Event, {Found, State}) ->
            case starl_mutex_monitor:step(trace(Event), State) of
                {ok, Next} -> {Found, Next};
                {violation, V, Next} -> {Found ++ [V], Next}
            end
        end,
        {[], starl_mutex_monitor:init(Config)},
        Events
    ),
    {Verdict, Results} = starl_mutex_monitor:finish(End, Last),
    Late =
        case Verdict of
            ok -> [];
            {violation, Vs} -> Vs
        end,
    {[facts(V) || V <- Met ++ Late], Results}.

facts(#{contract := mutex, what := What, at_us := T, robots := Robots, details := Details}) ->
    {What, T, Robots, Details}.

found(Events) -> found(Events, 0, #{}).

found(Events, End, Config) -> element(1, told(Events, End, Config)).

trace({T, Robot, died}) -> {T, Robot, robot, {died, killed}};
trace({T, Robot, set_back}) -> {T, Robot, robot, store_set_back};
trace({T, Robot, Event}) -> {T, Robot, mutex, Event}.

fence(N) -> N bsl 8.

granted(T, Robot, N) -> {T, ?HOME, {granted, a, fence(N), Robot}}.

acquired(T, Robot, N) -> {T, Robot, {acquired, a, fence(N)}}.

got(T, Robot, N) -> [granted(T, Robot, N), acquired(T, Robot, N)].

let_go(T, Robot, N) -> {T, Robot, {released, a, fence(N)}}.

asks(T, Robot) -> asks(T, Robot, a).

asks(T, Robot, Token) -> {T, Robot, {requested, Token}}.

fails(T, Robot) -> {T, Robot, {failed, a, timeout}}.

%% -- who and when -------------------------------------------------------------------------------

%% A violation names the robots that have broken the contract, the token, its fence and the moment.
whose_test() ->
    Fences = fun(N, More) -> maps:merge(#{token => a, fence => fence(N)}, More) end,
    ?assertEqual(
        [{grant_not_larger, 2, [1], Fences(4, #{last => fence(5)})}],
        found([granted(1, 2, 5), granted(2, 1, 4)])
    ),
    ?assertEqual([{never_granted, 1, [2], Fences(5, #{})}], found([acquired(1, 2, 5)])),
    ?assertEqual(
        [{fence_not_larger, 3, [2], Fences(5, #{last => fence(5)})}],
        found(got(1, 2, 5) ++ [let_go(2, 2, 5), acquired(3, 2, 5)])
    ),
    [
        ?assertEqual([{not_held, 3, [2], Fences(5, #{})}], found([{3, 2, Event}]))
     || Event <- [
            {released, a, fence(5)}, {lease_lost, a, fence(5)}, {answered, [{a, fence(5)}]}
        ]
    ],
    %% both of the holders, in their order, whoever was first
    [
        ?assertEqual(
            [{two_holders, 2, [1, 2], Fences(5, #{holder => Old})}],
            found(got(1, Old, 5) ++ got(2, New, 6))
        )
     || {Old, New} <- [{1, 2}, {2, 1}]
    ],
    ?assertEqual(
        [{fence_overtaken, 5, [1], Fences(5, #{last => fence(6)})}],
        found(
            [granted(1, 1, 5) | got(1, 2, 6)] ++ [let_go(2, 2, 6), acquired(5, 1, 5)]
        )
    ),
    Lease = #{lease_us => 100, drift_ppm => 0, lag_us => 10},
    Held = [granted(5, 1, 5), {5, 1, {leased, a, fence(5), 100}}, acquired(5, 1, 5)],
    ?assertEqual([{held_too_long, 116, [1], Fences(5, #{})}], found(Held, 116, Lease)),
    ?assertEqual([], found(Held, 115, Lease)).

%% However many are held too long, they are told in the order of tokens.
order_test() ->
    Tokens = lists:seq(1, 40),
    Held = lists:append([
        [
            {5, ?HOME, {granted, Token, fence(5), 1}},
            {5, 1, {leased, Token, fence(5), 100}},
            {5, 1, {acquired, Token, fence(5)}}
        ]
     || Token <- Tokens
    ]),
    Found = found(Held, 900, #{lease_us => 100, drift_ppm => 0, lag_us => 10}),
    ?assertEqual(Tokens, [Token || {held_too_long, _, _, #{token := Token}} <- Found]).

%% -- progress -----------------------------------------------------------------------------------

%% Each request has a bound of its own, in time at the bound itself; they are told in their order.
bounds_test() ->
    Found = fun(Events, End) ->
        [{T, R, D} || {no_grant_in_time, T, R, D} <- found(Events, End, #{bound_us => 10})]
    end,
    Asked = [asks(1, 1), asks(2, 2), asks(3, 3, b)],
    A = #{token => a},
    ?assertEqual([], Found(Asked, 11)),
    ?assertEqual([{11, [1], A}], Found(Asked, 12)),
    ?assertEqual([{11, [1], A}, {12, [2], A}, {13, [3], #{token => b}}], Found(Asked, 90)),
    %% the oldest request of a robot is granted first
    Twice = [asks(1, 1), asks(5, 1)],
    ?assertEqual([{15, [1], A}], Found(Twice ++ got(8, 1, 5), 90)),
    ?assertEqual([], Found(Twice ++ got(8, 1, 5) ++ [let_go(9, 1, 5), fails(15, 1)], 90)),
    ?assertEqual([{11, [1], A}, {15, [1], A}], Found(Twice, 90)),
    %% once told
    ?assertEqual(
        [{11, [1], A}], Found([asks(1, 1), {20, 2, {failed, b, x}}, {30, 2, {failed, b, x}}], 90)
    ),
    %% a failure, a crash and a death end the requests of the robot, and of no other one; from a crash
    %% and a death on the others have their time anew
    [
        begin
            ?assertEqual(
                [{max(12, Anew), [2], A}], Found([asks(1, 1), asks(2, 2), {5, 1, End}], 90)
            ),
            ?assertEqual(
                [{max(11, Anew), [1], A}], Found([asks(1, 1), asks(2, 2), {5, 2, End}], 90)
            )
        end
     || {End, Anew} <- [{crashed, 15}, {{failed, a, timeout}, 0}, {died, 15}]
    ].

%% A token that somebody asks for does not lie idle, while applications hold as long as they like.
idle_test() ->
    Judge = fun(Events, End, More) ->
        Config = maps:merge(#{idle_us => 10, robots => [1, 2, 3]}, More),
        [{T, R} || {lies_idle, T, R, _} <- found(Events, End, Config)]
    end,
    Found = fun(Events, End) -> Judge(Events, End, #{}) end,
    ?assertEqual([], Found([asks(1, 1)], 11)),
    ?assertEqual([{11, [1]}], Found([asks(1, 1)], 12)),
    ?assertEqual([{11, [1, 2]}], Found([asks(1, 1), asks(5, 2)], 12)),
    ?assertEqual([{11, [1]}, {22, [1]}], Found([asks(1, 1), {12, 2, {failed, b, x}}], 30)),
    %% it counts from the end of the hold, and from a hand-over that was lost
    Held = [asks(1, 1), asks(1, 2)] ++ got(5, 1, 1),
    ?assertEqual([], Found(Held, 900)),
    ?assertEqual([{40, [2]}], Found(Held ++ [let_go(30, 1, 1)], 50)),
    ?assertEqual([{13, [1]}], Found([asks(1, 1), {3, 3, {hand_over_lost, a, 1, 2}}], 20)),
    %% a robot that has died may be in the queue still
    Dead = hd([1, 2, 3] -- [1, starl_mutex:home(a, [1, 2, 3])]),
    Goes = fun(To) -> Found([asks(1, 1), {2, Dead, died}, {5, 1, {handed_over, a, 1, To}}], 16) end,
    ?assertEqual([{15, [1]}], Goes(Dead)),
    ?assertEqual([{12, [1]}], Goes(1)),
    %% who gives up asks no more
    ?assertEqual([], Found([asks(1, 1), fails(5, 1)], 900)),
    %% a crash and faults give it its time anew, if it meets them
    ?assertEqual([{15, [1]}], Found([asks(1, 1), {5, 2, crashed}], 20)),
    Faults = fun(Windows) -> Judge([asks(1, 1)], 30, #{faults => Windows}) end,
    ?assertEqual([{18, [1]}], Faults([{3, 7, 8, fault}])),
    ?assertEqual([{11, [1]}], Faults([{3, 12, 18, fault}, {3, 0, 0, fault}])),
    %% without its home nobody holds it
    Home = starl_mutex:home(a, [1, 2, 3]),
    [Asker, Other] = [1, 2, 3] -- [Home],
    ?assertEqual([], Found([asks(1, Asker), {2, Home, died}], 900)),
    ?assertEqual([{12, [Asker]}], Found([asks(1, Asker), {2, Other, died}], 20)).

%% Requests of before `from_us' may take any time, and may fail.
from_test() ->
    Found = fun(Events, Config) -> [{W, T} || {W, T, _, _} <- found(Events, 90, Config)] end,
    Asked = [asks(5, 1)],
    ?assertEqual([{no_grant_in_time, 15}], Found(Asked, #{bound_us => 10, from_us => 5})),
    ?assertEqual([], Found(Asked, #{bound_us => 10, from_us => 6})),
    ?assertEqual([], Found(Asked, #{from_us => 5})),
    Failed = Asked ++ [fails(8, 1)],
    ?assertEqual([{not_granted, 8}], Found(Failed, #{granted => true, from_us => 5})),
    ?assertEqual([], Found(Failed, #{granted => true, from_us => 6})),
    ?assertEqual([], Found(Failed, #{granted => false})),
    ?assertEqual([], Found(Failed, #{})),
    ?assertEqual([], Found([fails(8, 1)], #{granted => true})),
    ?assertEqual(
        [{not_granted, 8, [1], #{token => a, reason => timeout}}],
        found(Failed, 90, #{granted => true})
    ).

results_test() ->
    Events =
        [asks(4, 1), asks(6, 2), asks(9, 3)] ++ got(10, 1, 5) ++
            [{20, 1, {lease_lost, a, fence(5)}}] ++
            got(30, 2, 6) ++ [let_go(40, 2, 6), fails(50, 3), {50, 3, {failed, b, x}}],
    {[], Results} = told(Events, 90, #{}),
    ?assertEqual(
        #{
            tokens => 1,
            acquired => 2,
            lease_lost => 1,
            failed => 2,
            longest_wait_us => 24,
            mean_wait_us => 15.0,
            unfairness => 1.6
        },
        Results
    ),
    {[], None} = told([], 90, #{}),
    ?assertMatch(#{tokens := 0, acquired := 0, longest_wait_us := 0}, None),
    %% one that waited is its own mean
    {[], One} = told([asks(0, 1) | got(1, 1, 5)], 90, #{}),
    ?assertEqual({1.0, 1.0}, {maps:get(mean_wait_us, One), maps:get(unfairness, One)}),
    %% a hold that nobody asked for counts as no wait
    {[], Unasked} = told(got(10, 1, 5), 90, #{}),
    ?assertMatch(#{tokens := 1, acquired := 0}, Unasked).

%% -- everything else ----------------------------------------------------------------------------

%% What is to be judged while no time passes: who holds and which fences there were, not when.
timeless_test() ->
    At = fun(Delay, Events) ->
        Last = lists:foldl(
            fun({T, R, E}, S) ->
                element(2, starl_mutex_monitor:step(trace({T + Delay, R, E}), S))
            end,
            starl_mutex_monitor:init(#{}),
            Events
        ),
        starl_mutex_monitor:timeless(Last)
    end,
    Base = got(1, 1, 5),
    ?assertEqual(At(0, Base), At(9, Base)),
    [
        ?assertNotEqual(At(0, Base), At(0, Other))
     || Other <- [
            [],
            [granted(1, 1, 5)],
            got(1, 2, 5),
            got(1, 1, 6),
            Base ++ [let_go(2, 1, 5)],
            Base ++ [granted(2, 2, 6)]
        ]
    ].

%% Where nothing is said the leases are judged as those that machines have where nothing is said.
defaults_test() ->
    Said = #{lease_us => 8000000, drift_ppm => 10000, lag_us => 250000},
    ?assertEqual(starl_mutex_monitor:init(Said), starl_mutex_monitor:init(#{})).

others_test() ->
    ?assertEqual([mutex, robot, sap], lists:sort(starl_mutex_monitor:interests())),
    Start = starl_mutex_monitor:init(#{granted => true, bound_us => 1}),
    [
        ?assertEqual({ok, Start}, starl_mutex_monitor:step({1, 2, Machine, Event}, Start))
     || {Machine, Event} <- [
            {robot, {released, a, 1}}, {barrier, crashed}, {mutex, {handed_over, a, 1, 2}}
        ]
    ].

%% Where a claim and its answer may take a lease, no bound is known: a grant that comes then is void.
no_bound_where_a_claim_takes_a_lease_test() ->
    IsBounded = fun(DelayUs) -> is_map_key(idle_us, in_context(DelayUs, [1, 2])) end,
    ?assertEqual([true, false, false], [IsBounded(Us) || Us <- [980000, 991000, 1000000]]).

%% A token may go to each robot of its queue, of which none wants it any more.
each_robot_may_have_given_up_test() ->
    Bound = fun(Robots) -> map_get(idle_us, in_context(1000, Robots)) end,
    ?assertEqual(18 * 1000, Bound(lists:seq(1, 20)) - Bound([1, 2])).

in_context(DelayUs, Robots) ->
    Known = #{
        broken => [],
        faults => [],
        healed_us => 0,
        delay_us => DelayUs,
        loss => 0,
        sap => #{},
        slack_us => 0
    },
    Config = #{lease_us => 2000000, lag_us => 250000, retry_us => 500000, robots => Robots},
    starl_mutex_monitor:context(Known, Config).

%% A home whose store and clock were set back, and of which nobody has heard since, begins anew, once: its
%% tokens' numbers grow from there. A clock or a store alone explains nothing.
numbers_begin_anew_test() ->
    Clock = #{broken => [{?HOME, 0, 1, {clock, -1000000}}]},
    Judge = fun(Events, Config) -> [What || {What, _, _, _} <- found(Events, 0, Config)] end,
    Five = got(1, 1, 5) ++ [let_go(2, 1, 5)],
    Back = [{3, ?HOME, set_back}],
    Four = got(4, 1, 4) ++ [let_go(5, 1, 4)],
    ?assertEqual([], Judge(Five ++ Back ++ Four ++ got(6, 2, 5), Clock)),
    [
        ?assertMatch([grant_not_larger | _], Judge(Events, Config))
     || {Events, Config} <- [
            {Five ++ Back ++ Four, #{}},
            {Five ++ Four, Clock},
            {Five ++ [{3, 1, set_back}] ++ Four, Clock},
            {Five ++ Back ++ Four ++ [granted(6, 1, 3)], Clock}
        ]
    ].
