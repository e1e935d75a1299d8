-module(starl_live_replay_tests).
-include_lib("eunit/include/eunit.hrl").

remembered_for_the_time_test() ->
    Replay = starl_live_replay:add(1, 5, 5, starl_live_replay:new(10, 0)),
    Later = starl_live_replay:add(2, 15, 15, Replay),
    ?assert(starl_live_replay:has(1, Later)),
    ?assertNot(starl_live_replay:has(3, Later)),
    ?assertNot(starl_live_replay:has(1, starl_live_replay:add(3, 26, 26, Later))).

%% Nothing is remembered for longer than twice the time, from the beginning on.
forgotten_after_twice_the_time_test() ->
    Add = fun({Id, At}, Replay) -> starl_live_replay:add(Id, At, At, Replay) end,
    Replay = lists:foldl(Add, starl_live_replay:new(10, 0), [{1, 9}, {2, 10}, {3, 19}]),
    ?assertEqual([true, true, true], [starl_live_replay:has(Id, Replay) || Id <- [1, 2, 3]]),
    Later = Add({4, 20}, Replay),
    ?assertEqual(
        [false, true, true, true], [starl_live_replay:has(Id, Later) || Id <- [1, 2, 3, 4]]
    ).

%% What is forgotten in its time is too old by then: nothing is refused for it.
nothing_is_floored_in_time_test() ->
    Add = fun({Id, At}, Replay) -> starl_live_replay:add(Id, At, At, Replay) end,
    Replay = lists:foldl(Add, starl_live_replay:new(10, 0), [{1, 5}, {2, 10}, {3, 20}, {4, 31}]),
    ?assertNot(starl_live_replay:may_have(5, 20, Replay)),
    ?assertNot(starl_live_replay:may_have(10, 31, Replay)).

%% The floor is the latest time of what is forgotten, be it one packet.
the_floor_is_that_of_what_is_forgotten_test() ->
    Fill = fun fill/4,
    First = starl_live_replay:add(1, 100, 5, starl_live_replay:new(10, 0)),
    Second = Fill(1, 50, 10, First),
    ?assertNot(starl_live_replay:may_have(0, 11, Second)),
    Third = Fill(100_001, 60, 11, Second),
    ?assert(starl_live_replay:may_have(100, 12, Third)),
    Fourth = starl_live_replay:add(200_002, 70, 12, Third),
    ?assertEqual(
        [true, true, false], [
            starl_live_replay:may_have(Sent, 13, Fourth)
         || Sent <- [50, 100, 101]
        ]
    ).

%% When generations are forgotten one after the other, none of their packets is taken twice, as long as it could
%% come in time.
a_packet_that_was_forgotten_is_never_taken_twice_test_() ->
    [
        {
            lists:concat(["sent at ", First, ", then at ", Then]),
            {timeout, 60, fun() ->
                Keep = 5,
                Start = starl_live_replay:add(0, First, 2, starl_live_replay:new(Keep, 0)),
                {_, Replays} = lists:foldl(
                    fun(Now, {Before, All}) ->
                        Next = fill(100_000 * Now, Then, Now, Before),
                        {Next, [{Now, Next} | All]}
                    end,
                    {Start, []},
                    lists:seq(3, 2 + Keep)
                ),
                Taken = [
                    Now
                 || {Now, Replay} <- Replays,
                    Now < 2 + Keep,
                    not starl_live_replay:has(0, Replay),
                    not starl_live_replay:may_have(First, Now, Replay)
                ],
                ?assertEqual([], Taken)
            end}
        }
     || {First, Then} <- [{100, 50}, {50, 100}, {7, 7}]
    ].

%% A full generation of packets of other numbers.
fill(From, Sent, Now, Replay) ->
    lists:foldl(
        fun(N, R) -> starl_live_replay:add(N, Sent, Now, R) end,
        Replay,
        lists:seq(From + 1, From + 100_000)
    ).

%% What is forgotten early is refused for its age.
memory_is_bounded_test() ->
    %% a hundred thousand in each millisecond
    Add = fun(N, Replay) ->
        Ms = (N - 1) div 100_000,
        starl_live_replay:add(N, Ms, Ms, Replay)
    end,
    First = lists:foldl(Add, starl_live_replay:new(10, 0), lists:seq(1, 100_001)),
    %% all are known still
    ?assertNot(starl_live_replay:may_have(0, 1, First)),
    Many = lists:foldl(Add, First, lists:seq(100_002, 350_000)),
    %% from 200,001, which came in millisecond 2, all are known
    ?assert(starl_live_replay:may_have(1, 3, Many)),
    ?assertNot(starl_live_replay:may_have(2, 3, Many)),
    %% what was sent then is too old by now
    ?assertNot(starl_live_replay:may_have(1, 13, Many)),
    ?assert(starl_live_replay:has(200_001, Many)),
    ?assert(starl_live_replay:has(350_000, Many)),
    ?assert(starl_live_replay:has(250_001, Many)),
    ?assertNot(starl_live_replay:has(200_000, Many)).
