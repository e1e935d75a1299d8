%% The transport by UDP, without a network: its sockets are this module, which hands datagrams to the test,
%% and its clock shows what the test sets.
-module(starl_live_udp_tests).
-include_lib("eunit/include/eunit.hrl").
-behaviour(starl_live_clock).

%% The sockets.
-export([open/2, send/4, close/1]).
%% Handles the transport's reports.
-export([log/2]).
-export([system_time/2, time_of_day/2, monotonic_time/2, start_timer/4, send_after/3]).

-define(START, 1_700_000_000_000_000).

%% -- sockets and clock -------------------------------------------------------------------------------

open(7, _Options) -> {error, eaddrinuse};
open(Port, [binary, {active, 100}, {recbuf, 1_000_000}, inet, {broadcast, true}]) -> {ok, Port}.

%% Nobody can be reached at port 9.
send(_Socket, _Ip, 9, _Bytes) ->
    {error, enetunreach};
send(Socket, Ip, Port, Bytes) ->
    self() ! {datagram, Socket, {Ip, Port}, iolist_to_binary(Bytes)},
    ok.

close(Socket) ->
    self() ! {closed, Socket},
    ok.

system_time(Unit, Time) -> erlang:convert_time_unit(atomics:get(Time, 1), microsecond, Unit).
time_of_day(Unit, Time) -> system_time(Unit, Time).
monotonic_time(Unit, Time) -> system_time(Unit, Time).

start_timer(Ms, What, [], _Time) ->
    self() ! {timer, What, Ms},
    What.

send_after(Ms, Message, _Time) ->
    self() ! {held, Ms, Message},
    make_ref().

%% -- robots ------------------------------------------------------------------------------------------

%% The end of a robot of three on port 5000 and its number, and the time that they share.
robot(Robot, Given) -> robot(Robot, Given, now_set()).

robot(Robot, Given, Time) ->
    {ok, Udp} = starl_live_udp:open(maps:merge(config(Robot, Time), Given)),
    Udp.

config(Robot, Time) ->
    #{
        robot => Robot,
        participants => starl_team:new([1, 2, 3]),
        fleet => "tests",
        run => 1,
        key => fun() -> <<7:256>> end,
        peers => places(),
        life => Robot,
        spread_ms => 0,
        beat_ms => infinity,
        clock => starl_live_clock:on({?MODULE, Time}, starl_live_clock:new(0, 1)),
        sockets => ?MODULE,
        random => fun() -> rand:seed_s(exsss, Robot) end
    }.

now_set() ->
    starl_platform_ct:forget(),
    Time = atomics:new(1, [{signed, true}]),
    ok = atomics:put(Time, 1, ?START),
    Time.

after_ms(Ms, Time) -> atomics:add(Time, 1, 1000 * Ms).

%% What has gone on the air: to whom.
datagrams() ->
    receive
        {datagram, Socket, To, Bytes} -> [{Socket, To, Bytes} | datagrams()]
    after 0 -> []
    end.

addresses() -> [To || {_, To, _} <- datagrams()].

address(Robot) -> {{10, 0, 0, Robot}, 5000 + Robot}.

%% A robot hears what another one has sent to it.
hears(From, Udp) ->
    lists:foldl(
        fun({_, _, Bytes}, {Packets, U}) ->
            {Ip, Port} = address(From),
            {Some, Next} = starl_live_udp:hear({udp, socket, Ip, Port, Bytes}, U),
            {Packets ++ Some, Next}
        end,
        {[], Udp},
        datagrams()
    ).

packet() -> packet(1).

packet(From) -> starl_packet:shout(From, hello, here).

large() -> starl_packet:shout(1, hello, binary:copy(<<"large">>, 1000)).

transmits(To, Packet, Udp) ->
    {ok, Next} = starl_live_udp:transmit(To, Packet, Udp),
    Next.

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

places() -> maps:from_list([{N, address(N)} || N <- [1, 2, 3]]).

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

%% A packet of so many bytes more than one without any.
sized(Bytes) -> starl_packet:shout(1, hello, binary:copy(<<7>>, Bytes)).

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

%% Unless it is said otherwise there is a beat each second, and what is refused is in the log.
beats_and_refusals_as_usual_test() ->
    Time = now_set(),
    {ok, Udp} = starl_live_udp:open(maps:remove(beat_ms, config(1, Time))),
    receive
        {timer, beat, Ms} -> ?assertEqual(1000, Ms)
    end,
    Bytes = iolist_to_binary(
        starl_live_seal:seal(1, <<0, 99>>, 0, seal(2, Time))
    ),
    {_, Lines} = logged(fun() ->
        starl_live_udp:hear({udp, socket, {10, 0, 0, 2}, 5002, Bytes}, Udp)
    end),
    ?assertMatch([<<"datagrams of robot 2 are refused: its clock", _/binary>>], Lines).

%% What a function answers, and the lines that it has logged.
logged(Fun) ->
    #{level := Level} = logger:get_primary_config(),
    ok = logger:set_primary_config(level, notice),
    ok = logger:add_handler(?MODULE, ?MODULE, #{config => #{test => self()}}),
    try
        Answer = Fun(),
        {Answer, lines()}
    after
        ok = logger:remove_handler(?MODULE),
        ok = logger:set_primary_config(level, Level)
    end.

lines() ->
    receive
        {logged, Line} -> [Line | lines()]
    after 0 -> []
    end.

log(#{msg := {report, #{why := Why}}}, #{config := #{test := Test}}) ->
    Test ! {logged, Why};
log(_Event, _Handler) ->
    ok.

%% -- beats -------------------------------------------------------------------------------------------

%% A robot that falls silent is in the log.
a_silent_robot_is_in_the_log_test() ->
    Time = now_set(),
    One = robot(1, #{beat_ms => 2500}, Time),
    Beats = fun(_, Udp) ->
        after_ms(2500, Time),
        {[], Next} = starl_live_udp:hear({timeout, beat, beat}, Udp),
        Next
    end,
    {_, Lines} = logged(fun() -> lists:foldl(Beats, One, lists:seq(1, 4)) end),
    ?assertMatch(
        [
            <<"the robot has not heard robot 2", _/binary>>,
            <<"the robot has not heard robot 3", _/binary>>
        ],
        Lines
    ).

%% Each second each of the others is called; a beat that names our life proves what its sender says from then
%% on.
beats_prove_test() ->
    Time = now_set(),
    One = robot(1, #{beat_ms => 1000}, Time),
    ?assertEqual([address(2), address(3)], addresses()),
    receive
        {timer, beat, 1000} -> ok
    end,
    Two = robot(2, #{beat_ms => 1000}, Time),
    Beats = datagrams(),
    %% before a beat nothing is taken
    _ = transmits(2, packet(), One),
    {[], Unproved} = hears(1, Two),
    ?assertMatch(#{unproved := 1}, starl_live_udp:figures(Unproved)),
    %% two's beat is answered at once, since it is the first of its life, with a beat that names that
    [self() ! {datagram, S, To, B} || {S, To, B} <- Beats, To =:= address(1)],
    {[], Heard} = hears(2, One),
    [{_, To, Answer}] = datagrams(),
    ?assertEqual(address(2), To),
    {Ip, Port} = address(1),
    {[], Proved} = starl_live_udp:hear({udp, socket, Ip, Port, Answer}, Unproved),
    _ = datagrams(),
    after_ms(1, Time),
    _ = transmits(2, packet(), Heard),
    ?assertMatch({[_], _}, hears(1, Proved)),
    %% and one has the round trip
    ?assertMatch(
        [#{robot := 1, round_trip_us := 0, life := 1, ahead_ms := 0}, #{robot := 3, life := none}],
        starl_live_udp:peers(Proved)
    ),
    %% the next beat comes with its timer
    after_ms(1000, Time),
    {[], _} = starl_live_udp:hear({timeout, beat, beat}, Heard),
    ?assertEqual([address(2), address(3)], addresses()).

%% What a beat says: our time, the other's last time or 0, how long that was held here or that there is none,
%% and the life that is known of the other one.
what_a_beat_says_test() ->
    Time = now_set(),
    One = robot(1, #{beat_ms => 1000}, Time),
    ?assertEqual({?START, 0, 16#FFFFFFFF, 0}, beat_to(2, 1, Time)),
    _ = robot(2, #{beat_ms => 1000}, Time),
    {[], Heard} = hears(2, One),
    ?assertEqual({?START, ?START, 0, 2}, beat_to(2, 1, Time)),
    after_ms(1000, Time),
    {[], Later} = starl_live_udp:hear({timeout, beat, beat}, Heard),
    ?assertEqual({?START + 1_000_000, ?START, 1_000_000, 2}, beat_to(2, 1, Time)),
    %% it is heard no more for longer than a beat can say
    after_ms(4_294_966, Time),
    {[], Long} = starl_live_udp:hear({timeout, beat, beat}, Later),
    ?assertMatch({_, ?START, 16#FFFFFFFE, 2}, beat_to(2, 1, Time)),
    ok = starl_live_udp:close(Long).

%% The last beat on the air from a robot to another one, and no other datagram.
beat_to(To, From, Time) ->
    Datagrams = [Bytes || {_, Address, Bytes} <- datagrams(), Address =:= address(To)],
    Now = atomics:get(Time, 1) div 1000,
    {ok, #{from := From}, Payload, _} = starl_live_seal:open(
        lists:last(Datagrams), {Now, Now}, seal(To, Time)
    ),
    <<2, Ours:64/signed, Theirs:64/signed, Held:32, Life:64>> = Payload,
    {Ours, Theirs, Held, Life}.

%% A beat of who has heard none of ours tells no round trip; the longest time of holding does.
a_round_trip_is_that_of_an_echo_test() ->
    Time = now_set(),
    Two = robot(2, #{beat_ms => 1000}, Time),
    Trip = fun(Held) ->
        Payload = <<2, 0:64, (?START - 5):64, Held:32, 2:64>>,
        Bytes = iolist_to_binary(
            starl_live_seal:seal(2, Payload, ?START div 1000, seal(1, Time))
        ),
        {[], Heard} = starl_live_udp:hear({udp, socket, {10, 0, 0, 1}, 5001, Bytes}, Two),
        [#{robot := 1} = Peer | _] = starl_live_udp:peers(Heard),
        maps:get(round_trip_us, Peer, none)
    end,
    ?assertEqual([none, 0, 2], [Trip(Held) || Held <- [16#FFFFFFFF, 16#FFFFFFFE, 3]]).

%% The first beat of another life may name ours: that proves, and is answered all the same, since its sender
%% has no proof of ours yet.
a_first_beat_that_names_our_life_test() ->
    Time = now_set(),
    One = robot(1, #{beat_ms => 1000}, Time),
    ToTwo = [D || {_, To, _} = D <- datagrams(), To =:= address(2)],
    Two = robot(2, #{beat_ms => 1000}, Time),
    _ = datagrams(),
    _ = [self() ! {datagram, S, To, Bytes} || {S, To, Bytes} <- ToTwo],
    {[], Answered} = hears(1, Two),
    [{Socket, Home, Answer}] = datagrams(),
    ?assertEqual(address(1), Home),
    self() ! {datagram, Socket, Home, Answer},
    {[], Proved} = hears(2, One),
    ?assertEqual([address(2)], addresses()),
    _ = transmits(1, packet(2), Answered),
    {Packets, _} = hears(2, Proved),
    ?assertEqual([packet(2)], Packets).

%% A beat that names our life already needs no answer.
beats_are_answered_once_test() ->
    Time = now_set(),
    One = robot(1, #{beat_ms => 1000}, Time),
    _ = datagrams(),
    Two = robot(2, #{beat_ms => 1000}, Time),
    Pass = fun(From, To, Udp) ->
        All = datagrams(),
        [self() ! {datagram, S, A, B} || {S, A, B} <- All, A =:= address(To)],
        {[], Next} = hears(From, Udp),
        Next
    end,
    One1 = Pass(2, 1, One),
    Two1 = Pass(1, 2, Two),
    One2 = Pass(2, 1, One1),
    ?assertEqual([], datagrams()),
    after_ms(1000, Time),
    {[], _} = starl_live_udp:hear({timeout, beat, beat}, Two1),
    _ = Pass(2, 1, One2),
    ?assertEqual([], datagrams()).

%% -- names -------------------------------------------------------------------------------------------

%% A name is looked up beside the transport, once at a time, and then the robot is called there.
names_are_looked_up_test() ->
    starl_platform_ct:quietly(fun() ->
        Time = now_set(),
        Test = self(),
        Lookup = fun(Host) ->
            Test ! {looks_up, self(), Host},
            receive
                Found -> Found
            end
        end,
        Places = (places())#{2 => {"robot-2.lab", 5002}, 3 => {"10.0.0.3", 5003}},
        Udp = robot(1, #{beat_ms => 1000, peers => Places, lookup => Lookup}, Time),
        ?assertEqual([address(3)], addresses()),
        Process =
            receive
                {looks_up, Pid, "robot-2.lab"} -> Pid
            end,
        after_ms(6000, Time),
        {[], Again} = starl_live_udp:hear({timeout, beat, beat}, Udp),
        Process ! {ok, {10, 0, 0, 2}},
        Told = fun() ->
            receive
                {starl_live_udp, named, 2, _} = Message -> Message
            end
        end,
        {[], Named} = starl_live_udp:hear(Told(), Again),
        {[], Done} =
            receive
                {'DOWN', _, process, Process, _} = Down -> starl_live_udp:hear(Down, Named)
            end,
        ?assertEqual(unknown, starl_live_udp:hear({'DOWN', make_ref(), process, self(), x}, Done)),
        _ = datagrams(),
        after_ms(1000, Time),
        {[], _} = starl_live_udp:hear({timeout, beat, beat}, Done),
        ?assertEqual([address(2), address(3)], addresses()),
        ?assertEqual([], [Host || {looks_up, _, Host} <- messages()])
    end).

%% Who has no address yet gets nothing. What does not lead anywhere is in the log, and is looked up again, five
%% seconds after it was last.
a_name_that_is_not_found_test() ->
    Time = now_set(),
    Test = self(),
    Lookup = fun(Host) ->
        Test ! {looks_up, Host},
        {error, nxdomain}
    end,
    Places = (places())#{2 => {"robot-2.lab", 5002}},
    {Asked, Lines} = logged(fun() ->
        Udp = robot(1, #{beat_ms => 1000, peers => Places, lookup => Lookup}, Time),
        _ = datagrams(),
        Told = transmits(2, packet(), Udp),
        ?assertEqual([], datagrams()),
        ?assertEqual(#{sent => 1, datagrams => 1}, starl_live_udp:figures(Told)),
        lists:foldl(
            fun(Second, {Before, Times}) ->
                after_ms(1000, Time),
                {[], Heard} = starl_live_udp:hear({timeout, beat, beat}, Before),
                case Second rem 5 of
                    0 -> {looked_up(Heard), Times ++ [Second]};
                    _ -> {Heard, Times}
                end
            end,
            {looked_up(Told), []},
            lists:seq(1, 11)
        )
    end),
    ?assertMatch({_, [5, 10]}, Asked),
    ?assertEqual([], [Host || {looks_up, Host} <- messages()]),
    ?assertMatch([<<"robot 2: the name \"robot-2.lab\" is not found", _/binary>> | _], Lines).

%% After a lookup has come to its end.
looked_up(Udp) ->
    receive
        {looks_up, "robot-2.lab"} -> ok
    end,
    {[], Named} =
        receive
            {starl_live_udp, named, 2, _} = Told -> starl_live_udp:hear(Told, Udp)
        end,
    {[], Done} =
        receive
            {'DOWN', _, process, _, normal} = Down -> starl_live_udp:hear(Down, Named)
        end,
    Done.

messages() ->
    receive
        Message -> [Message | messages()]
    after 0 -> []
    end.

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

seal(Robot, Time) ->
    {ok, Seal} = starl_live_seal:new(config(Robot, Time), 0),
    Seal.

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

%% Two lives of a robot: what the former one has sent before the later began comes still, if it is no beat. When
%% both go on, they are two robots, and that is in the log.
what_a_former_life_says_test() ->
    Time = now_set(),
    Former = robot(1, #{}, Time),
    Later = robot(1, #{life => 5}, Time),
    Says = fun(Udp) ->
        _ = transmits(2, packet(), Udp),
        datagrams()
    end,
    Hears = fun(Datagrams, Udp) ->
        [self() ! {datagram, S, To, Bytes} || {S, To, Bytes} <- Datagrams],
        hears(1, Udp)
    end,
    Under = Says(Former),
    Beat = beat_of(1, Time),
    {[_], Heard} = Hears(Says(Former), robot(2, #{}, Time)),
    after_ms(1, Time),
    {[_], Restarted} = Hears(Says(Later), Heard),
    {Packets, Late} = Hears(Under, Restarted),
    ?assertEqual([packet()], Packets),
    {[], Beaten} = starl_live_udp:hear({udp, socket, {10, 0, 0, 1}, 5001, Beat}, Late),
    ?assertEqual(#{}, starl_live_udp:figures(Beaten)),
    Both = fun(_, {Before, Refused}) ->
        after_ms(1000, Time),
        {_, One} = Hears(Says(Former), Before),
        {_, Two} = Hears(Says(Later), One),
        {Two, Refused ++ [maps:without([sent], starl_live_udp:figures(Two))]}
    end,
    {{Twins, Figures}, Lines} = logged(fun() ->
        lists:foldl(Both, {Beaten, []}, lists:seq(1, 5))
    end),
    ?assertMatch([#{former := 1} | _], Figures),
    ?assertMatch(#{clone := _}, lists:last(Figures)),
    ?assertMatch(
        [#{robot := 1, life := 1, twin := {5, _}}, _], starl_live_udp:peers(Twins)
    ),
    ?assertMatch([_ | _], [Line || Line <- Lines, string:find(Line, "two robots") =/= nomatch]).

%% The first beat of a life of a robot for robot 2, as it is on the air.
beat_of(Robot, Time) ->
    _ = robot(Robot, #{beat_ms => 1000}, Time),
    [Beat | _] = [Bytes || {_, To, Bytes} <- datagrams(), To =:= address(2)],
    Beat.

%% Modules of tests share a process: those after this one find nothing of it.
nothing_is_left_test() -> starl_platform_ct:forget().
