%% The transport by UDP, without a network: its beats, which prove lives, the names of robots, and their lives.
-module(starl_live_udp_beats_tests).
-include_lib("eunit/include/eunit.hrl").

-import(starl_live_udp_fake, [
    robot/3,
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
    logged/1,
    packet/0, packet/1
]).

%% As the clock shows at first.
-define(START, 1_700_000_000_000_000).

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

%% -- lives ---------------------------------------------------------------------------------------

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
