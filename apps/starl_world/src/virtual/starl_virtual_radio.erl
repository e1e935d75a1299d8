%% @doc Tests the radio of live robots on simulated sockets and clocks: a kind of robot of the
%% simulator that has nothing but its radio. The radio is {@link starl_live_udp} with codec, fragments,
%% seal, replay window and pace. Some robots send packets of all sizes, some of them twice. At first the network loses, doubles, delays and damages datagrams. In some runs, all
%% robots send large packets for a while, and half of the fragments are lost. Then the network is
%% calm. An attacker sends what he has recorded to anybody, at any later time; he also sends
%% datagrams of another run, and rubbish. A robot seals what is no packet. Robots restart meanwhile.
%% In some runs the time of day of one computer is wrong at first, and is set right before the
%% network is calm.
%%
%% The contract is that of {@link starl_virtual_radio_monitor}. In the trace, `{sent, N, To}' of machine `udp' is the
%% N-th packet on its way to some robots, `{heard, N}' the same packet as it was sent, `{heard, none}'
%% any other packet, and `{memory, Bytes}' that a robot's end of the radio has more bytes than it may have.
-module(starl_virtual_radio).
-behaviour(starl_virtual_computer).

-export([scenario/1, plan/2, new/4]).
-export([new/3, obey/2, machines/2]).

-define(ROBOTS, [1, 2, 3]).
%% The network is at its worst, is calm, the last packets are sent, and the run ends, ms.
-define(WORST_MS, {20000, 24000}).
-define(CALM_MS, 40000).
-define(LAST_MS, 55000).
-define(END_S, 70).
-define(PACKETS, 120).
%% The large packets of the worst time, in one run of ten.
-define(FLOOD, 200).
-define(PLAYED_US, 60000000).
%% Clocks differ by this much from true time.
-define(OFFSET_MS, 2000).
-define(EPOCH_US, 1700000000000000).
%% A wrong clock is this far ahead, and is set right at this time: what was sent by it is not fresh before
%% the attacker has ended.
-define(AHEAD_S, {80, 7200}).
-define(SET_RIGHT_US, 35000000).
%% The memory of an end is looked at this often. The most bytes: 8 unfinished messages of each other robot,
%% the queue of its pace (1 MB), and the numbers of datagrams.
-define(EVERY, 50).
-define(MEMORY, 2200000).

-record(radio, {
    robot :: starl:robot_id(),
    seed :: integer(),
    clock :: starl_virtual_clock:t(),
    radio = none :: term(),
    commands = 0 :: non_neg_integer()
}).

%% -- the run --------------------------------------------------------------------------------

%% @doc The run that belongs to a seed. Its application is there for its name only.
-spec scenario(Seed :: integer()) -> #{app := module(), atom() => term()}.
scenario(Seed) ->
    {First, Last} = ?WORST_MS,
    #{
        app => starl_exercise,
        program => radio,
        robots => length(?ROBOTS),
        seed => Seed,
        time => ?END_S,
        delay => {1, 20},
        clock_offset => ?OFFSET_MS,
        clock_drift => 0,
        faults => [
            {lost, 0, ?CALM_MS, loss, all, #{part => 0.1}},
            {worst, First, Last, loss, all, #{part => 0.45}},
            {twice, 0, ?CALM_MS, duplicate, all, #{part => 0.15}},
            {damaged, 0, ?CALM_MS, corrupt, all, #{part => 0.1}},
            {late, 0, ?CALM_MS, reorder, all, #{part => 1.0, extra_ms => 480}}
        ]
    }.

%% @doc The plan of a simulation with the packets and the restarts that belong to its seed.
-spec plan(starl_run_scenario:t(), starl_sim_plan:t()) ->
    {ok, starl_sim_plan:t()} | {error, unicode:chardata()}.
plan(#{robots := N}, _Plan) when N =/= length(?ROBOTS) ->
    {error, io_lib:format("the program radio is for ~b robots", [length(?ROBOTS)])};
plan(#{reloads := [_ | _]}, _Plan) ->
    {error, "the program radio has no application to reload"};
plan(#{faults := Faults} = Scenario, Plan) ->
    Can = [Kind || {Kind, _, _, _, _} <- starl_run_fault:kinds_of(network)],
    case [Fault || {_, _, _, Kind, _, _} = Fault <- Faults, not lists:member(Kind, Can)] of
        [] ->
            {ok, used(Scenario, Plan)};
        [{Id, _, _, Kind, _, _} | _] ->
            Format =
                "fault ~ts: the program radio has no faults of the kind ~ts, only those of the network",
            {error, io_lib:format(Format, [Id, Kind])}
    end.

used(#{seed := Seed}, #{monitors := Monitors} = Plan) ->
    Contract = {starl_virtual_radio_monitor, #{offset_us => 1000 * ?OFFSET_MS}},
    Strikes = flood(starl_run_draw:between({Seed, flood}, 1, 10), Seed) ++ uses(Seed),
    Timed = [{Robot, 1000 * Ms, Strike} || {Robot, Ms, Strike} <- Strikes],
    starl_sim_plan:add_strikes(Timed, Plan#{monitors := [Contract | Monitors]}).

flood(1, Seed) ->
    {First, Last} = ?WORST_MS,
    [
        send(N, starl_run_draw:between({Seed, N, at}, First, Last - 1), Seed)
     || N <- lists:seq(?PACKETS + 1, ?PACKETS + ?FLOOD)
    ];
flood(_, _Seed) ->
    [].

uses(Seed) ->
    Packets = lists:seq(1, ?PACKETS),
    At = fun(N, Which) -> starl_run_draw:between({Seed, N, Which}, 0, ?LAST_MS) end,
    [send(N, At(N, at), Seed) || N <- Packets] ++
        [send(N, At(N, again), Seed) || N <- Packets, N rem 5 =:= 0] ++
        [{R, Ms, come_up} || R <- ?ROBOTS, Ms <- restarts(R, Seed)].

send(N, AtMs, Seed) ->
    {From, _To, _Packet} = packet(N, Seed),
    {From, AtMs, {program, {send, N}}}.

restarts(Robot, Seed) ->
    [
        starl_run_draw:between({Seed, Robot, restart}, 0, ?CALM_MS)
     || starl_run_draw:uniform({Seed, Robot, restarts}) < 0.3
    ].

%% Who sends the N-th packet, and to whom.
packet(N, Seed) ->
    From = starl_run_draw:between({Seed, N, from}, 1, length(?ROBOTS)),
    Others = lists:delete(From, ?ROBOTS),
    To = lists:nth(starl_run_draw:between({Seed, N, to}, 1, 3), [Others | [[R] || R <- Others]]),
    Most =
        case starl_run_draw:between({Seed, N, class}, 1, 4) of
            _ when N > ?PACKETS -> 60000;
            1 -> 1300;
            2 -> 20000;
            3 -> 60000;
            4 -> 100
        end,
    Least = max(0, 60000 * (min(N, ?PACKETS + 1) - ?PACKETS)),
    Size = starl_run_draw:between({Seed, N, size}, min(Least, Most), Most),
    {From, To, packet_of(From, N, binary:copy(<<N:16>>, Size div 2))}.

%% @doc A robot that has nothing but its radio.
-spec new(starl:robot_id(), starl:pose(), starl_robot_services:tree(), starl_sim_world:t()) ->
    starl_virtual_robot:t().
new(Id, Pose, _Tree, #{seed := Seed, delay_us := {Least, _}} = World) ->
    Computer = starl_virtual_computer:start(Id, ?MODULE, #{seed => Seed}),
    Attacker = fun(Key, Now, Bytes) -> attacks(Id, Key, Now + Least, Bytes, Seed) end,
    starl_virtual_robot:new(Id, Pose, World, Computer, Attacker).

%% -- its computer ---------------------------------------------------------------------------

%% @doc The radio before its first life.
-spec new(starl:robot_id(), starl_virtual_clock:t(), #{seed := integer()}) -> #radio{}.
new(Id, Clock, #{seed := Seed}) -> #radio{robot = Id, seed = Seed, clock = Clock}.

%% @doc There are no machines.
-spec machines(gen_server:from(), #radio{}) -> #{}.
machines(_From, #radio{}) -> #{}.

%% @doc Carries out a command; besides those of all programs: send the N-th packet.
-spec obey(starl_virtual_computer:command() | {send, pos_integer()}, #radio{}) ->
    {up | off, [starl_virtual_computer:effect()], #radio{}}.
obey(Command, #radio{commands = N} = End) ->
    ok = show(End),
    {Facts, Next} = carry_out(Command, End#radio{commands = N + 1}),
    {up, effects() ++ [{facts, [{0, End#radio.robot, udp, F} || F <- Facts ++ memory(Next)]}],
        Next}.

carry_out({boot, Life, Seed, _Codes}, #radio{robot = Id, clock = Clock} = End) ->
    Config = config(Id, 1, Life, Seed),
    {ok, Radio} = starl_live_udp:open(Config#{
        clock => starl_live_clock:on(
            {starl_virtual_clock, Clock}, starl_live_clock:new(?EPOCH_US, 1)
        ),
        sockets => starl_virtual_socket,
        random => fun() -> rand:seed_s(exsss, erlang:phash2({Seed, Id, Life}, 4294967296)) end
    }),
    {[], End#radio{radio = Radio}};
carry_out({halt, _Cause}, End) ->
    {[], End#radio{radio = none}};
%% its restart takes a moment
carry_out(_Command, #radio{radio = none} = End) ->
    {[], End};
carry_out({send, N}, #radio{seed = Seed, radio = Radio} = End) ->
    {_From, To, Packet} = packet(N, Seed),
    {ok, Next} = starl_live_udp:transmit(dest(To), Packet, Radio),
    {[{sent, N, To}], End#radio{radio = Next}};
carry_out({hear, transport, Message}, End) ->
    hear(Message, End);
carry_out({heard, From, Bytes}, #radio{robot = Id} = End) ->
    hear(starl_virtual_socket:heard(From, Id, Bytes), End).

dest([One]) -> One;
dest(_) -> all.

hear(Message, #radio{radio = Radio, seed = Seed} = End) ->
    {Packets, Next} = starl_live_udp:hear(Message, Radio),
    {[{heard, number(Packet, Seed)} || Packet <- Packets], End#radio{radio = Next}}.

%% A packet is heard as it was sent.
number({starl, 1, shout, _, _, {N, _}} = Packet, Seed) when N > 0, N =< ?PACKETS + ?FLOOD ->
    case packet(N, Seed) of
        {_, _, Packet} -> N;
        _ -> none
    end;
number(_Packet, _Seed) ->
    none.

memory(#radio{commands = N, radio = Radio}) when N rem ?EVERY =:= 0 ->
    [{memory, Bytes} || Bytes <- [erlang:external_size(Radio)], Bytes > ?MEMORY];
memory(#radio{}) ->
    [].

%% What the radio has done, in the order in which it did it.
effects() ->
    receive
        {starl_virtual_timer, Due, Message} -> [{timer, transport, Due, Message} | effects()];
        {starl_virtual_sent, To, Bytes} -> [{sent, To, Bytes} | effects()]
    after 0 -> []
    end.

%% In one run of five the clock of one robot is wrong, and then the VM does not follow it.
show(#radio{robot = Robot, seed = Seed, clock = Clock}) ->
    case starl_run_draw:between({Seed, wrong}, 1, 5 * length(?ROBOTS)) of
        Robot ->
            {Least, Most} = ?AHEAD_S,
            Us = 1000000 * starl_run_draw:between({Seed, ahead}, Least, Most),
            Now = starl_virtual_clock:monotonic_time(microsecond, Clock),
            Day = Us * (1 - max(0, min(1, Now div ?SET_RIGHT_US))),
            starl_virtual_clock:set_ahead(Us, Day, Clock);
        _ ->
            ok
    end.

config(Id, Run, Life, Seed) ->
    #{
        robot => Id,
        participants => starl_team:new(?ROBOTS),
        fleet => "virtual",
        run => Run,
        life => Life,
        key => fun() -> <<Seed:256>> end,
        peers => starl_virtual_socket:peers(?ROBOTS)
    }.

%% -- the attacker ---------------------------------------------------------------------------

attacks(From, Key, Earliest, Bytes, Seed) ->
    Robot = starl_run_draw:between({Key, victim}, 1, length(?ROBOTS)),
    At = Earliest + starl_run_draw:between({Key, attack}, 1, ?PLAYED_US),
    case starl_run_draw:uniform({Key, attacks}) of
        Drawn when Drawn < 0.1 -> [{Robot, At, Bytes}];
        Drawn when Drawn < 0.12 -> [{Robot, At, starl_sim_transmitter:damaged(Bytes, Key)}];
        Drawn when Drawn < 0.13 -> [{Robot, At, foreign(From, Robot, Earliest, Seed)}];
        Drawn when Drawn < 0.15 -> [{Robot, At, malformed(From, Robot, At, Key, Seed)}];
        _ -> []
    end.

%% A datagram of another run of the same fleet.
foreign(From, To, Now, Seed) ->
    {ok, Bytes} = starl_live_codec:encode(packet_of(From, 0, <<>>)),
    sealed(2, From, To, Bytes, Now, Seed).

%% One that a robot with damaged memory has sealed: what is in it is no packet of its.
malformed(From, To, At, Key, Seed) ->
    Content = starl_run_draw:between({Key, content}, 1, 12),
    sealed(1, From, To, malformed(Content, From), At, Seed).

malformed(1, _From) -> <<>>;
malformed(2, _From) -> <<1, 131>>;
malformed(3, From) -> <<2, (term_to_binary(packet_of(From, 0, <<>>)))/binary>>;
malformed(4, From) -> <<1, (term_to_binary(packet_of(From, 0, <<>>)))/binary, 0>>;
malformed(5, _From) -> <<1, (term_to_binary({starl, 1}))/binary>>;
malformed(6, From) -> content(packet_of(1 + From rem length(?ROBOTS), 0, <<>>));
malformed(7, _From) -> <<1, 131, 119, 12, "no_such_atom">>;
malformed(8, From) -> content(packet_of(From, 0, self()));
malformed(9, From) -> content(packet_of(From, 0, make_ref()));
malformed(10, From) -> content(packet_of(From, 0, fun() -> From end));
malformed(11, From) -> content(packet_of(From, 0, <<1:3>>));
malformed(12, From) -> content(packet_of(From, 0, nested(200))).

content(Packet) -> <<1, (term_to_binary(Packet, [{minor_version, 2}]))/binary>>.

nested(0) -> [];
nested(N) -> {nested(N - 1)}.

packet_of(From, N, Body) -> starl_packet:shout(From, {app, note}, {N, Body}).

sealed(Run, From, To, Bytes, NowUs, Seed) ->
    Life = 1 + length([Ms || Ms <- restarts(From, Seed), 1000 * Ms =< NowUs]),
    {ok, Seal} = starl_live_seal:new(config(From, Run, Life, Seed), 0),
    Offset = round(starl_run_draw:signed({Seed, From, offset}) * 1000 * ?OFFSET_MS),
    NowMs = (?EPOCH_US + NowUs + Offset) div 1000,
    iolist_to_binary(starl_live_seal:seal(To, [0, Bytes], NowMs, Seal)).
