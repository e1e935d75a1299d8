%% Packets order what clocks do not: messages of robots whose clocks differ, made at random with their true order.
%%
%% Holds: What several robots recorded is ordered by their packets, and no time is moved farther
%% than clocks differ
%% Red: 961f67c9, run: 6 of 6
-module(starl_trace_order_tests).
-include_lib("eunit/include/eunit.hrl").

-define(RUNS, 200).
-define(O, starl_trace_order).

%% -- what is made ---------------------------------------------------------------------------

%% A run: its messages in their true order, as {Source, Message} by the clocks of the robots, and how far
%% these differ at most.
run(Robots, N, Most) ->
    Offsets = maps:from_list([{R, rand:uniform(2 * Most + 1) - Most - 1} || R <- Robots]),
    Steps = steps(N, Robots, 1000000, []),
    {
        [{[R], shown(Step, Offsets)} || {_, R, _} = Step <- lists:sort(Steps)],
        lists:max(maps:values(Offsets)) - lists:min(maps:values(Offsets))
    }.

%% A packet takes from 1 to 20 ms, and some are lost; others say something.
steps(0, _Robots, _T, Steps) ->
    Steps;
steps(N, Robots, T, Steps) ->
    Later = T + rand:uniform(20000),
    From = one_of(Robots),
    steps(N - 1, Robots, Later, step(rand:uniform(4), N, Later, From, one_of(Robots)) ++ Steps).

one_of(List) -> lists:nth(rand:uniform(length(List)), List).

step(1, N, T, From, _To) ->
    [{T, From, {trace, {From, app, {said, N}}}}];
step(_, N, T, From, From) ->
    [{T, From, {trace, {From, app, {said, N}}}}];
step(2, N, T, From, To) ->
    [{T, From, {ways, {From, {sent, To, {data, app, N}, 9, N}}}}];
step(_, N, T, From, To) ->
    Came = T + 1000 + rand:uniform(19000),
    [
        {T, From, {ways, {From, {sent, To, {data, app, N}, 9, N}}}},
        {Came, To, {ways, {To, {came, From, {data, app, N}, 9, N, {arrives, [{Came, intact}]}}}}}
    ].

shown({T, R, {Topic, What}}, Offsets) ->
    Off = maps:get(R, Offsets),
    Own =
        case What of
            {R, {came, From, Brief, Bytes, Hash, {arrives, [{T, How}]}}} ->
                {R, {came, From, Brief, Bytes, Hash, {arrives, [{T + Off, How}]}}};
            _ ->
                What
        end,
    {Topic, T + Off, Own}.

%% The messages in the order of their own times, some at once, and what comes of them.
ordered(Run) ->
    ByTime = lists:sort(fun({_, {_, A, _}}, {_, {_, B, _}}) -> A =< B end, Run),
    {Lists, Order} = lists:mapfoldl(fun({S, M}, O) -> ?O:take(S, [M], O) end, ?O:new(), ByTime),
    {Last, End} = ?O:close(Order),
    {lists:append(Lists) ++ Last, End}.

of_source([R], Messages) -> [M || {_, _, What} = M <- Messages, element(1, What) =:= R].

said(Messages) -> [hash(What) || {_, _, What} <- Messages].

hash({_, {sent, _, _, _, Hash}}) -> {sent, Hash};
hash({_, {came, _, _, _, Hash, _}}) -> {came, Hash};
hash({_, _, Said}) -> Said.

seeded(Test) ->
    Seed = erlang:system_time() rem 1000000,
    io:format("seed ~b~n", [Seed]),
    {timeout, 30, fun() ->
        [
            begin
                _ = rand:seed(exsss, Seed + N),
                Test({seed, Seed + N})
            end
         || N <- lists:seq(1, ?RUNS)
        ]
    end}.

%% -- what must hold -------------------------------------------------------------------------

no_packet_comes_before_it_was_sent_test_() ->
    seeded(fun(Seed) ->
        {Run, Apart} = run(lists:seq(1, 1 + rand:uniform(4)), 60, 50000),
        {Placed, Order} = ordered(Run),
        %% nothing is lost, and no robot's own order changes
        [
            ?assertEqual(
                {Seed, said([M || {S, M} <- Run, S =:= Own])}, {Seed, said(of_source(Own, Placed))}
            )
         || Own <- lists:usort([S || {S, _} <- Run])
        ],
        Times = [At || {_, At, _} <- Placed],
        ?assertEqual({Seed, lists:sort(Times)}, {Seed, Times}),
        Places = maps:from_list(lists:zip(said(Placed), Times)),
        ?assertEqual(
            {Seed, []},
            {Seed, [
                Hash
             || {{came, Hash}, At} <- maps:to_list(Places), At =< maps:get({sent, Hash}, Places)
            ]}
        ),
        %% no time is moved farther than clocks differ
        [?assert(Us =< Apart + 100) || {_, Us} <- ?O:moved(Order)]
    end).

clocks_that_agree_move_nothing_test_() ->
    seeded(fun(Seed) ->
        {Run, 0} = run([1, 2, 3], 60, 0),
        {Placed, Order} = ordered(Run),
        ?assertEqual({Seed, [M || {_, M} <- Run]}, {Seed, Placed}),
        ?assertEqual({[], []}, {?O:moved(Order), ?O:clocks(Order)})
    end).

%% Packets that contradict each other hold nobody up.
no_order_is_an_order_test() ->
    Sent = fun(At, From, To, Hash) ->
        {[From], {ways, At, {From, {sent, To, hello, 9, Hash}}}}
    end,
    Came = fun(At, To, From, Hash) ->
        {[To], {ways, At, {To, {came, From, hello, 9, Hash, {arrives, [{At, intact}]}}}}}
    end,
    Circle = [Came(1000, 1, 2, b), Sent(2000, 1, 2, a), Came(1000, 2, 1, a), Sent(2000, 2, 1, b)],
    Later = [{[R], {trace, 20000000 + R, {R, app, later}}} || R <- [1, 2, 3]],
    {Placed, _} = ordered(Circle ++ Later),
    ?assertEqual(7, length(Placed)),
    {Early, _} = lists:mapfoldl(
        fun({S, M}, O) -> ?O:take(S, [M], O) end, ?O:new(), Circle ++ Later
    ),
    ?assertEqual(4, length(lists:append(Early))).

%% Of a packet that was sent again and again the first may be the one that came: its answer follows that one.
the_first_of_several_counts_test() ->
    Sent = [{[1], {ways, T, {1, {sent, 2, hello, 9, a}}}} || T <- [100000, 150000, 200000]],
    Came = {[2], {ways, 95000, {2, {came, 1, hello, 9, a, {arrives, [{95000, intact}]}}}}},
    {Placed, Order} = ordered([Came | Sent]),
    ?assertMatch([{ways, 100000, _}, {ways, 100001, {2, {came, _, _, _, _, _}}} | _], Placed),
    ?assertMatch([_, {_, _, {2, {came, 1, _, _, _, {arrives, [{100001, intact}]}}}} | _], Placed),
    ?assertEqual([{2, 5001}], ?O:moved(Order)),
    ?assertEqual([{{1, 2}, 5000}], ?O:clocks(Order)).

%% A clock that is seconds off is not mended.
a_clock_that_is_far_off_is_left_test() ->
    Sent = {[1], {ways, 5000000, {1, {sent, 2, hello, 9, a}}}},
    Came = {[2], {ways, 1000000, {2, {came, 1, hello, 9, a, {arrives, [{1000000, intact}]}}}}},
    {Placed, Order} = ordered([Came, Sent]),
    ?assertEqual([1000000, 5000000], [At || {_, At, _} <- Placed]),
    ?assertEqual([], ?O:moved(Order)).

%% What others have heard of a robot, and it has not told, was lost with its power. What it has told was not.
what_was_lost_with_the_power_is_a_gap_test() ->
    Says = {[1], {ways, 1000000, {1, {sent, 2, hello, 9, a}}}},
    Heard = fun(Hash) ->
        {[2], {ways, 1400000, {2, {came, 1, hello, 9, Hash, {arrives, [{1400000, intact}]}}}}}
    end,
    Down = {[1], {trace, 1100000, {1, robot, down}}},
    Other = {[2], {trace, 9000000, {2, robot, down}}},
    Gaps = fun(Run) ->
        {Placed, _} = ordered(Run),
        [{At, Why} || {gap, At, Why} <- Placed]
    end,
    ?assertEqual([], Gaps([Says, Heard(a), Down, Other])),
    ?assertEqual([{1100000, {lost_power, 1}}], Gaps([Says, Heard(b), Down, Other])).

%% A computer that was late was so by its own clock.
times_within_a_message_move_with_it_test() ->
    Sent = {[1], {ways, 100000, {1, {sent, 2, hello, 9, a}}}},
    Came = {[2], {ways, 90000, {2, {came, 1, hello, 9, a, {arrives, [{90000, intact}]}}}}},
    Late = {[2], {trace, 91000, {2, robot, {late, 80000, 91000}}}},
    {Placed, _} = ordered([Came, Late, Sent]),
    ?assertMatch({trace, 100001, {2, robot, {late, 89001, 100001}}}, lists:last(Placed)).
