%% The transport by UDP, without a network: packets, their pace, answers to a packet for all, and what is refused.
-module(starl_live_udp_tests).
-include_lib("eunit/include/eunit.hrl").

-import(starl_live_udp_fake, [
    robot/2, robot/3,
    config/2,
    places/0,
    now_set/0,
    after_ms/2,
    seal/2,
    datagrams/0,
    addresses/0,
    address/1,
    hears/2,
    transmits/3,
    messages/0,
    packet/0,
    sized/1,
    large/0
]).

%% As the clock shows at first.
-define(START, 1_700_000_000_000_000).

%% -- packets -----------------------------------------------------------------------------------------

%% A packet for one goes to its place, one for all to each of the others in turn, or once to the group.
packets_go_to_their_robots_test_() ->
    %% the first test may have to load libcrypto
    {timeout, 60, fun packets_go_to_their_robots/0}.

packets_go_to_their_robots() ->
    One = transmits(2, packet(), robot(1, #{})),
    ?assertMatch([{5001, {{10, 0, 0, 2}, 5002}, _}], datagrams()),
    All = transmits(all, packet(), One),
    ?assertEqual([address(2), address(3)], addresses()),
    Unknown = transmits(7, packet(), All),
    ?assertEqual([], addresses()),
    ?assertEqual(
        #{sent => 2, datagrams => 3, unknown_peer => 1}, starl_live_udp:figures(Unknown)
    ),
    ok = starl_live_udp:close(Unknown),
    receive
        {closed, 5001} -> ok
    end.

%% Large ones go in fragments, and come whole; those who are not meant count them.
packets_come_as_they_were_sent_test() ->
    Time = now_set(),
    Two = robot(2, #{}, Time),
    _ = transmits(2, large(), transmits(2, packet(), robot(1, #{}, Time))),
    {Packets, Heard} = hears(1, Two),
    ?assertEqual([packet(), large()], Packets),
    ?assertEqual(#{}, starl_live_udp:figures(Heard)),
    _ = transmits(2, packet(), robot(1, #{}, Time)),
    {[], Three} = hears(1, robot(3, #{}, Time)),
    ?assertEqual(#{address => 1}, starl_live_udp:figures(Three)).

%% What cannot travel is refused with a line.
what_cannot_travel_is_refused_test() ->
    Udp = robot(1, #{}),
    {refused, Line, Udp} = starl_live_udp:transmit(2, starl_packet:shout(1, hello, self()), Udp),
    ?assertNotEqual(nomatch, string:find(Line, "cannot be sent")),
    ?assertEqual([], datagrams()).

%% Where there is no way, that is counted, and is why a robot is silent.
what_is_not_sent_is_counted_test() ->
    starl_platform_ct:quietly(fun() ->
        Places = (places())#{2 => {{10, 0, 0, 2}, 9}},
        Udp = transmits(all, packet(), robot(1, #{peers => Places})),
        ?assertEqual([address(3)], addresses()),
        ?assertEqual(
            #{sent => 1, datagrams => 1, send_error => 1}, starl_live_udp:figures(Udp)
        ),
        ?assertMatch(
            [#{robot := 2, why := {unsent, enetunreach}}, #{robot := 3, why := none}],
            starl_live_udp:peers(Udp)
        )
    end).

%% A burst of 16,000 bytes leaves at once, the rest at 1000 bytes a millisecond.
bytes_leave_at_a_pace_test() ->
    Time = now_set(),
    Udp = lists:foldl(
        fun(_, U) -> transmits(2, large(), U) end, robot(1, #{}, Time), lists:seq(1, 10)
    ),
    First = length(datagrams()),
    ?assert(First > 10 andalso First < 16),
    receive
        {timer, flush, Ms} -> ?assert(Ms >= 1 andalso Ms =< 2)
    end,
    {[], Still} = starl_live_udp:hear({timeout, another, flush}, Udp) =:= unknown andalso {[], Udp},
    after_ms(100, Time),
    {[], Later} = starl_live_udp:hear({timeout, flush, flush}, Still),
    Second = length(datagrams()),
    ?assert(Second > 10),
    ?assertEqual(First + Second, maps:get(datagrams, starl_live_udp:figures(Later))).

%% Exactly 16,000 bytes are a burst, and 1000 bytes are a millisecond.
the_burst_and_the_pace_are_exact_test() ->
    Empty = size_of(0),
    %% how many datagrams of these sizes leave at once, and when the next one may
    Leaves = fun(Sizes) ->
        lists:foldl(
            fun(Size, Udp) -> transmits(2, sized(Size - Empty), Udp) end, robot(1, #{}), Sizes
        ),
        Sent = length(datagrams()),
        {Sent, [Ms || {timer, flush, Ms} <- messages()]}
    end,
    Before = lists:duplicate(15, 1000),
    ?assertEqual({17, []}, Leaves(Before ++ [1000, 500])),
    ?assertEqual({16, [1]}, Leaves(Before ++ [1001, 500])),
    ?assertEqual({17, [1]}, Leaves(Before ++ [999, 1001, 500])),
    ?assertEqual({17, [2]}, Leaves(Before ++ [999, 1002, 500])).

size_of(Bytes) ->
    _ = transmits(2, sized(Bytes), robot(1, #{})),
    [{_, _, Datagram}] = datagrams(),
    byte_size(Datagram).

%% A socket that has fallen silent is asked for more.
a_silent_socket_is_asked_for_more_test() ->
    {ok, Socket} = gen_udp:open(0, [{active, false}]),
    Udp = robot(1, #{}),
    ?assertEqual({[], Udp}, starl_live_udp:hear({udp_passive, Socket}, Udp)),
    ?assertEqual({ok, [{active, 100}]}, inet:getopts(Socket, [active])),
    ok = gen_udp:close(Socket).

%% Beyond a megabyte that waits packets are lost.
a_full_queue_loses_packets_test() ->
    Udp = lists:foldl(
        fun(_, U) -> transmits(2, large(), U) end, robot(1, #{}), lists:seq(1, 250)
    ),
    ?assertMatch(#{sent := 250, queue_full := N} when N > 1, starl_live_udp:figures(Udp)).

%% -- answers to all ----------------------------------------------------------------------------------

%% What goes to the source of a packet for all just after it waits for a short time, at most that of the
%% configuration; what goes to others, or later, does not.
answers_are_spread_test() ->
    Time = now_set(),
    Spread = robot(2, #{spread_ms => 30}, Time),
    _ = transmits(all, packet(), robot(1, #{}, Time)),
    {[_ | _], Called} = hears(1, Spread),
    Held = transmits(1, packet(), Called),
    ?assertEqual([], datagrams()),
    Datagrams =
        receive
            {held, Ms, {starl_live_udp, held, _} = Message} when Ms >= 0, Ms =< 30 -> Message
        end,
    Other = transmits(3, packet(), Held),
    ?assertEqual([address(3)], addresses()),
    {[], Sent} = starl_live_udp:hear(Datagrams, Other),
    ?assertEqual([address(1)], addresses()),
    after_ms(30, Time),
    _ = transmits(1, packet(), Sent),
    ?assertEqual([], datagrams()),
    after_ms(1, Time),
    _ = transmits(1, packet(), Sent),
    ?assertEqual([address(1)], addresses()),
    %% a packet for one calls for no spread answer
    _ = transmits(2, packet(), robot(1, #{}, Time)),
    {[_], Told} = hears(1, Spread),
    _ = transmits(1, packet(), Told),
    ?assertEqual([address(1)], addresses()).

%% How long they wait is drawn anew for each, from nothing to the spread. No more than a thousand wait.
answers_wait_as_drawn_test_() -> {timeout, 60, fun answers_wait_as_drawn/0}.

answers_wait_as_drawn() ->
    Time = now_set(),
    _ = transmits(all, packet(), robot(1, #{}, Time)),
    {[_ | _], Called} = hears(1, robot(2, #{spread_ms => 30}, Time)),
    Waits = fun() ->
        receive
            {held, Ms, _} -> Ms
        end
    end,
    {Waited, Held} = lists:mapfoldl(
        fun(_, Udp) ->
            Next = transmits(1, packet(), Udp),
            {Waits(), Next}
        end,
        Called,
        lists:seq(1, 1000)
    ),
    {Drawn, _} = lists:mapfoldl(
        fun(_, Random) -> rand:uniform_s(31, Random) end, rand:seed_s(exsss, 2), lists:seq(1, 1000)
    ),
    ?assertEqual([N - 1 || N <- Drawn], Waited),
    ?assertEqual([], datagrams()),
    _ = transmits(1, packet(), Held),
    ?assertEqual([address(1)], addresses()),
    %% one that has waited makes room for one
    {[], Room} = starl_live_udp:hear({starl_live_udp, held, []}, Held),
    Full = transmits(1, packet(), Room),
    ?assertEqual([], datagrams()),
    _ = transmits(1, packet(), Full),
    ?assertEqual([address(1)], addresses()).

%% However short the spread is, what is sent within twenty milliseconds is an answer.
an_answer_is_what_comes_within_twenty_milliseconds_test() ->
    Answers = fun(Ms) ->
        Time = now_set(),
        _ = transmits(all, packet(), robot(1, #{}, Time)),
        {[_ | _], Called} = hears(1, robot(2, #{spread_ms => 5}, Time)),
        after_ms(Ms, Time),
        _ = transmits(1, packet(), Called),
        addresses()
    end,
    ?assertEqual([], Answers(20)),
    ?assertEqual([address(1)], Answers(21)).

%% Unless it is said otherwise answers are spread over half a millisecond for each robot, 25 at most.
the_spread_is_that_of_the_team_test_() ->
    Longest = fun(Robots) ->
        Time = now_set(),
        Team = #{
            participants => starl_team:new(lists:seq(1, Robots)),
            peers => maps:from_list([{N, address(N)} || N <- lists:seq(1, Robots)])
        },
        _ = transmits(2, packet(), robot(1, Team, Time)),
        _ = datagrams(),
        {ok, Two} = starl_live_udp:open(
            maps:merge(maps:remove(spread_ms, config(2, Time)), Team)
        ),
        _ = transmits(all, packet(), robot(1, #{}, Time)),
        {[_ | _], Called} = hears(1, Two),
        _ = lists:foldl(
            fun(_, Udp) -> transmits(1, packet(), Udp) end, Called, lists:seq(1, 500)
        ),
        lists:max([Ms || {held, Ms, _} <- messages()])
    end,
    [?_assertEqual(Ms, Longest(Robots)) || {Robots, Ms} <- [{20, 10}, {51, 25}, {90, 25}]].

%% Without a spread they go at once; the shortest spread is one millisecond.
answers_need_not_be_spread_test() ->
    Answers = fun(Spread) ->
        Time = now_set(),
        Two = robot(2, #{spread_ms => Spread}, Time),
        _ = transmits(all, packet(), robot(1, #{}, Time)),
        {[_ | _], Called} = hears(1, Two),
        _ = transmits(1, packet(), Called),
        addresses()
    end,
    ?assertEqual([address(1)], Answers(0)),
    ?assertEqual([], Answers(1)).

%% -- what is not taken -------------------------------------------------------------------------------

%% By its reason; of an unknown atom or another packet, too.
what_is_refused_is_counted_test() ->
    starl_platform_ct:quietly(fun() ->
        Time = now_set(),
        Two = robot(2, #{}, Time),
        Seal = seal(1, Time),
        Hears = fun(Payload) ->
            Now = atomics:get(Time, 1) div 1000,
            Bytes = iolist_to_binary(starl_live_seal:seal(2, Payload, Now, Seal)),
            {[], Udp} = starl_live_udp:hear({udp, socket, {10, 0, 0, 1}, 5001, Bytes}, Two),
            starl_live_udp:figures(Udp)
        end,
        ?assertEqual(#{version => 1}, Hears(<<0, 99>>)),
        ?assertEqual(#{fragment => 1}, Hears(<<9, 99>>)),
        %% a beat that is cut
        ?assertEqual(#{fragment => 1}, Hears(<<2, 0:216>>)),
        Sender = term_to_binary(starl_packet:shout(3, hello, here), [{minor_version, 2}]),
        ?assertEqual(#{sender => 1}, Hears(<<0, 1, Sender/binary>>)),
        {[], Udp} = starl_live_udp:hear({udp, socket, {10, 0, 0, 1}, 5001, <<"x">>}, Two),
        ?assertEqual(#{length => 1}, starl_live_udp:figures(Udp)),
        {[], Error} = starl_live_udp:hear({udp_error, socket, econnrefused}, Two),
        ?assertEqual(#{socket_error => 1}, starl_live_udp:figures(Error)),
        %% its clock is an hour behind
        Old = iolist_to_binary(
            starl_live_seal:seal(2, <<0, 99>>, ?START div 1000 - 3_600_000, Seal)
        ),
        {[], Late} = starl_live_udp:hear({udp, socket, {10, 0, 0, 1}, 5001, Old}, Two),
        ?assertEqual(#{clock => 1}, starl_live_udp:figures(Late)),
        ?assertMatch(
            [#{refused := #{clock := #{count := 1}}}, _], starl_live_udp:peers(Late)
        ),
        ?assertEqual(unknown, starl_live_udp:hear(hello, Two))
    end).

%% Of a message whose parts are not those of its digest nothing is left.
a_forged_message_leaves_nothing_test() ->
    starl_platform_ct:quietly(fun() ->
        Time = now_set(),
        Seal = seal(1, Time),
        Hears = fun(Payload, Before) ->
            Now = atomics:get(Time, 1) div 1000,
            Bytes = iolist_to_binary(starl_live_seal:seal(2, Payload, Now, Seal)),
            starl_live_udp:hear({udp, socket, {10, 0, 0, 1}, 5001, Bytes}, Before)
        end,
        {ok, Message} = starl_live_codec:encode(sized(1500)),
        [First, Second] = [
            iolist_to_binary(Payload)
         || Payload <- starl_live_fragment:split(starl_live_seal:room(), Message)
        ],
        {[], Begun} = Hears(First, robot(2, #{}, Time)),
        <<Header:11/binary, Last:8, Rest/binary>> = Second,
        {[], Forged} = Hears(<<Header/binary, (Last bxor 1), Rest/binary>>, Begun),
        ?assertEqual(#{digest => 1}, starl_live_udp:figures(Forged)),
        {[], Still} = Hears(Second, Forged),
        ?assertEqual(#{digest => 1}, starl_live_udp:figures(Still)),
        %% nor of one that is whole; and what was heard is not heard again
        {[_], Whole} = Hears(First, Still),
        {[], Again} = Hears(First, Whole),
        ?assertEqual(#{digest => 1}, starl_live_udp:figures(Again)),
        Bytes = iolist_to_binary(
            starl_live_seal:seal(2, Second, atomics:get(Time, 1) div 1000, Seal)
        ),
        Datagram = {udp, socket, {10, 0, 0, 1}, 5001, Bytes},
        {[_], Heard} = starl_live_udp:hear(Datagram, Again),
        {[], Replayed} = starl_live_udp:hear(Datagram, Heard),
        ?assertEqual(#{digest => 1, replay => 1}, starl_live_udp:figures(Replayed))
    end).

%% -- opening -----------------------------------------------------------------------------------------

%% One line on what is wrong with a configuration.
mistakes_are_one_line_test() ->
    Line = fun(Given) ->
        {error, Why} = starl_live_udp:open(maps:merge(config(1, now_set()), Given)),
        lists:flatten(Why)
    end,
    ?assertEqual(
        "peers: robot 3: an address and a port expected, {\"192.168.1.11\", 5001}",
        Line(#{peers => maps:remove(3, places())})
    ),
    ?assertEqual(
        "port 7: address already in use", Line(#{peers => (places())#{1 => {{0, 0, 0, 0}, 7}}})
    ),
    ?assertMatch(
        "robot 4294967296: numbers" ++ _,
        Line(#{
            robot => 1 bsl 32,
            participants => starl_team:new([1, 1 bsl 32]),
            peers => (places())#{1 bsl 32 => address(1)}
        })
    ).

%% Without one that is given, a life is the time of day and a lot: later ones are larger.
lives_are_ordered_test() ->
    Time = now_set(),
    Life = fun(Seed) ->
        Random = #{random => fun() -> rand:seed_s(exsss, Seed) end},
        Udp = starl_live_udp:open(maps:merge(maps:remove(life, config(1, Time)), Random)),
        _ = transmits(2, packet(), element(2, Udp)),
        {[_], Heard} = hears(1, robot(2, #{}, Time)),
        [#{life := Life} | _] = starl_live_udp:peers(Heard),
        Life
    end,
    Lot = fun(Seed) ->
        {Lot, _} = rand:uniform_s(1 bsl 16, rand:seed_s(exsss, Seed)),
        Lot - 1
    end,
    Lives = [Life(Seed) || Seed <- lists:seq(1, 8)],
    ?assertEqual([Lot(Seed) || Seed <- lists:seq(1, 8)], [L band 16#FFFF || L <- Lives]),
    ?assertEqual([?START div 1000], lists:usort([L bsr 16 || L <- Lives])),
    after_ms(1, Time),
    ?assert(Life(1) > lists:max(Lives)).

%% Modules of tests share a process: those after this one find nothing of it.
nothing_is_left_test() -> starl_platform_ct:forget().
