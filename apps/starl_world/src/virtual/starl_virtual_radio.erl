%% @doc Tests the radio of live robots on simulated sockets and clocks ({@link starl_live_udp}:
%% codec, fragments, seal, replay window, pace). Some robots send packets of all sizes, some of them
%% twice. At first the network loses, doubles, delays and damages datagrams. In some runs, all
%% robots send large packets for a while, and half of the fragments are lost. Then the network is
%% calm. An attacker sends what he has recorded to anybody, at any later time; he also sends
%% datagrams of another run, and rubbish. A robot seals what is no packet. Robots restart meanwhile.
%% In some runs the time of day of one computer is wrong at first, and is set right before the
%% network is calm.
%%
%% The contract:
%% <ul>
%% <li>What is heard was sent, in the sender's name, to the robot that hears it.</li>
%% <li>A robot hears a packet at most as often as it was sent, over all its boots together. It hears no
%%   packet that is older than the seal, the clocks and the fragments allow.</li>
%% <li>What is sent in a calm network is heard, except in the first seconds, in which robots that have just
%%   started learn of each other.</li>
%% <li>The memory of an end is bounded.</li>
%% </ul>
-module(starl_virtual_radio).

-export([run/1]).

-define(ROBOTS, [1, 2, 3]).
%% The network is at its worst, is calm, all robots have met in it, the last packets are sent, and the run ends, us.
-define(WORST_US, {20000000, 24000000}).
-define(CALM_US, 40000000).
-define(MET_US, 43000000).
-define(LAST_US, 55000000).
-define(END_US, 70000000).
-define(PACKETS, 120).
%% The large packets of the worst time, in one run of ten.
-define(FLOOD, 200).
-define(PLAYED_US, 60000000).
%% Clocks differ by this much from true time; datagrams are fresh for 15 s, fragments wait for 10 s.
-define(OFFSET_US, 2000000).
-define(OLDEST_US, 25000000 + 2 * ?OFFSET_US).
%% The most bytes of an end: 8 unfinished messages of each other robot, the queue of its pace (1 MB), and
%% the numbers of datagrams.
-define(MEMORY, 2200000).
-define(EPOCH_US, 1700000000000000).
%% A wrong clock is this far ahead, and is set right at this time: what was sent by it is not fresh before
%% the attacker has ended.
-define(AHEAD_S, {80, 7200}).
-define(SET_RIGHT_US, 35000000).

-record(sent, {
    from :: starl:robot_id(),
    to :: [starl:robot_id()],
    packet :: starl_packet:t(),
    times = 0 :: non_neg_integer(),
    at_us = 0 :: integer()
}).

-record(radio, {
    seed :: integer(),
    ends = #{} :: #{starl:robot_id() => {State :: term(), Life :: pos_integer()}},
    clocks :: #{starl:robot_id() => starl_virtual_clock:t()},
    queue = gb_trees:empty() :: gb_trees:tree({integer(), pos_integer()}, event()),
    n = 1 :: pos_integer(),
    now = 0 :: integer(),
    sent = #{} :: #{pos_integer() => #sent{}},
    heard = #{} :: #{{pos_integer(), starl:robot_id()} => pos_integer()},
    chain = 0 :: non_neg_integer(),
    violations = [] :: [starl_monitor:violation()]
}).

-type event() ::
    {send, Packet :: pos_integer()}
    | {restart, starl:robot_id()}
    | {hear, starl:robot_id(), any | pos_integer(), Message :: term()}.

%% @doc The run that belongs to a seed, up to the first violation.
-spec run(Seed :: integer()) -> starl_virtual_store:result().
run(Seed) ->
    Clocks = [{R, starl_virtual_clock:new(offset(R, Seed))} || R <- ?ROBOTS],
    Radio = #radio{seed = Seed, clocks = maps:from_list(Clocks)},
    Open = lists:foldl(fun(R, S) -> open(R, 1, S) end, Radio, ?ROBOTS),
    Ended = complete(play(lists:foldl(fun planned/2, Open, events(Seed)))),
    #{
        violations => lists:reverse(Ended#radio.violations),
        events => Ended#radio.n,
        digest => Ended#radio.chain
    }.

events(Seed) ->
    flood(starl_run_draw:between({Seed, flood}, 1, 10), Seed) ++ uses(Seed).

flood(1, Seed) ->
    {First, Last} = ?WORST_US,
    [
        {starl_run_draw:between({Seed, N, at}, First, Last - 1), {send, N}}
     || N <- lists:seq(?PACKETS + 1, ?PACKETS + ?FLOOD)
    ];
flood(_, _Seed) ->
    [].

uses(Seed) ->
    [{starl_run_draw:between({Seed, N, at}, 0, ?LAST_US), {send, N}} || N <- lists:seq(1, ?PACKETS)] ++
        [
            {starl_run_draw:between({Seed, N, again}, 0, ?LAST_US), {send, N}}
         || N <- lists:seq(1, ?PACKETS), N rem 5 =:= 0
        ] ++
        [{At, {restart, R}} || R <- ?ROBOTS, At <- restarts(R, Seed)].

restarts(Robot, Seed) ->
    [
        starl_run_draw:between({Seed, Robot, restart}, 0, ?CALM_US)
     || starl_run_draw:uniform({Seed, Robot, restarts}) < 0.3
    ].

planned({At, Event}, Radio) -> plan(At, Event, Radio).

plan(At, Event, #radio{queue = Queue, n = N} = Radio) ->
    Radio#radio{queue = gb_trees:insert({At, N}, Event, Queue), n = N + 1}.

play(#radio{violations = [_ | _]} = Radio) ->
    Radio;
play(#radio{queue = Queue} = Radio) ->
    case gb_trees:is_empty(Queue) of
        true ->
            Radio;
        false ->
            case gb_trees:take_smallest(Queue) of
                {{At, _}, _, _} when At > ?END_US -> Radio;
                {{At, _}, Event, Left} -> play(happens(Event, Radio#radio{now = At, queue = Left}))
            end
    end.

%% -- the ends -------------------------------------------------------------------------------

offset(Robot, Seed) -> round(starl_run_draw:signed({Seed, Robot, offset}) * ?OFFSET_US).

open(Robot, Life, #radio{seed = Seed, ends = Ends} = Radio) ->
    shown(Robot, Radio),
    {ok, End} = starl_live_udp:open((config(Robot, 1, Radio))#{
        life => Life,
        random => fun() -> rand:seed_s(exsss, erlang:phash2({Seed, Robot, Life}, 4294967296)) end
    }),
    effects(Robot, Radio#radio{ends = Ends#{Robot => {End, Life}}}).

config(Robot, Run, #radio{seed = Seed, clocks = Clocks}) ->
    #{
        robot => Robot,
        participants => starl_team:new(?ROBOTS),
        fleet => "virtual",
        run => Run,
        key => fun() -> <<Seed:256>> end,
        peers => starl_virtual_socket:peers(?ROBOTS),
        clock => starl_live_clock:on(
            {starl_virtual_clock, maps:get(Robot, Clocks)}, starl_live_clock:new(?EPOCH_US, 1)
        ),
        sockets => starl_virtual_socket
    }.

happens({send, N}, Radio) ->
    send(N, Radio);
happens({restart, Robot}, #radio{ends = Ends} = Radio) ->
    #{Robot := {_, Life}} = Ends,
    open(Robot, Life + 1, Radio);
happens({hear, Robot, For, Message}, #radio{ends = Ends} = Radio) ->
    case Ends of
        #{Robot := {End, Life}} when For =:= any; For =:= Life ->
            shown(Robot, Radio),
            heard(starl_live_udp:hear(Message, End), Robot, Radio);
        #{} ->
            Radio
    end.

shown(Robot, #radio{seed = Seed, clocks = Clocks, now = Now}) ->
    #{Robot := Clock} = Clocks,
    {System, Day} = ahead(Robot, Now, Seed),
    ok = starl_virtual_clock:set_ahead(System, Day, Clock),
    starl_virtual_clock:set(Now + offset(Robot, Seed), Clock).

%% In one run of five the clock of one robot is wrong, and then the VM does not follow it.
ahead(Robot, Now, Seed) ->
    case starl_run_draw:between({Seed, wrong}, 1, 5 * length(?ROBOTS)) of
        Robot ->
            {Least, Most} = ?AHEAD_S,
            Us = 1000000 * starl_run_draw:between({Seed, ahead}, Least, Most),
            {Us, Us * (1 - min(1, Now div ?SET_RIGHT_US))};
        _ ->
            {0, 0}
    end.

send(N, #radio{sent = Sent, now = Now, ends = Ends} = Radio) ->
    #sent{from = From, to = To, packet = Packet, times = Times} = New = packet(N, Radio),
    #{From := {End, Life}} = Ends,
    shown(From, Radio),
    Dest =
        case To of
            [One] -> One;
            _ -> all
        end,
    {ok, Next} = starl_live_udp:transmit(Dest, Packet, End),
    Noted = Sent#{N => New#sent{times = Times + 1, at_us = Now}},
    effects(From, Radio#radio{sent = Noted, ends = Ends#{From := {Next, Life}}}).

packet(N, #radio{sent = Sent}) when is_map_key(N, Sent) -> maps:get(N, Sent);
packet(N, #radio{seed = Seed}) ->
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
    Body = {N, binary:copy(<<N:16>>, Size div 2)},
    #sent{from = From, to = To, packet = starl_packet:shout(From, {app, note}, Body)}.

heard({Packets, End}, Robot, #radio{ends = Ends} = Radio) ->
    #{Robot := {_, Life}} = Ends,
    Heard = lists:foldl(
        fun(Packet, R) -> judge(Packet, Robot, R) end,
        Radio#radio{ends = Ends#{Robot := {End, Life}}},
        Packets
    ),
    effects(Robot, bounded(Robot, End, Heard)).

bounded(Robot, End, #radio{n = N} = Radio) when N rem 50 =:= 0 ->
    case erlang:external_size(End) of
        Bytes when Bytes > ?MEMORY -> broken(memory, Robot, #{bytes => Bytes}, Radio);
        _ -> Radio
    end;
bounded(_Robot, _End, Radio) ->
    Radio.

%% What an end has done, in the order in which it did it.
effects(Robot, #radio{ends = Ends, now = Now, seed = Seed} = Radio) ->
    #{Robot := {_, Life}} = Ends,
    receive
        {starl_virtual_timer, Due, Message} ->
            At = max(Now, Due - offset(Robot, Seed)),
            effects(Robot, plan(At, {hear, Robot, Life, Message}, Radio));
        {starl_virtual_sent, To, Bytes} ->
            effects(Robot, on_air(Robot, To, Bytes, Radio))
    after 0 -> Radio
    end.

%% -- the network and its attacker -----------------------------------------------------------

on_air(From, To, Bytes, #radio{n = N, seed = Seed, now = Now} = Radio) ->
    Key = {Seed, N, From, To},
    lists:foldl(
        fun({Robot, At, Datagram}, R) ->
            plan(At, {hear, Robot, any, starl_virtual_socket:heard(From, Robot, Datagram)}, R)
        end,
        Radio,
        arrivals(To, Bytes, Key, Now) ++ attacks(From, Bytes, Key, Radio)
    ).

arrivals(To, Bytes, Key, Now) when Now >= ?CALM_US ->
    [{To, Now + starl_run_draw:between({Key, delay}, 1000, 20000), Bytes}];
arrivals(To, Bytes, Key, Now) ->
    {First, Last} = ?WORST_US,
    Loss =
        if
            Now >= First, Now < Last -> 0.5;
            true -> 0.1
        end,
    Copies =
        case starl_run_draw:uniform({Key, twice}) of
            Twice when Twice < 0.15 -> [1, 2];
            _ -> [1]
        end,
    [
        {
            To,
            Now + starl_run_draw:between({Key, Copy, delay}, 1000, 500000),
            state({Key, Copy}, Bytes)
        }
     || Copy <- Copies, starl_run_draw:uniform({Key, Copy, lost}) >= Loss
    ].

state(Key, Bytes) ->
    case starl_run_draw:uniform({Key, state}) of
        Drawn when Drawn < 0.1 -> damaged(Key, Bytes);
        _ -> Bytes
    end.

%% A bit is wrong, the end is missing, or something is behind it.
damaged(Key, Bytes) ->
    Bit = starl_run_draw:between({Key, bit}, 0, 8 * byte_size(Bytes) - 1),
    case starl_run_draw:between({Key, how}, 1, 6) of
        1 ->
            binary:part(Bytes, 0, Bit div 8);
        2 ->
            <<Bytes/binary, Bit:16>>;
        _ ->
            <<Before:Bit, B:1, After/bits>> = Bytes,
            <<Before:Bit, (1 - B):1, After/bits>>
    end.

attacks(From, Bytes, Key, Radio) ->
    Robot = starl_run_draw:between({Key, victim}, 1, length(?ROBOTS)),
    At = Radio#radio.now + starl_run_draw:between({Key, attack}, 1, ?PLAYED_US),
    case starl_run_draw:uniform({Key, attacks}) of
        Drawn when Drawn < 0.1 -> [{Robot, At, Bytes}];
        Drawn when Drawn < 0.12 -> [{Robot, At, damaged({Key, attack}, Bytes)}];
        Drawn when Drawn < 0.13 -> [{Robot, At, foreign(From, Robot, Radio)}];
        Drawn when Drawn < 0.15 -> [{Robot, At, malformed(From, Robot, At, Key, Radio)}];
        _ -> []
    end.

%% A datagram of another run of the same fleet.
foreign(From, To, #radio{now = Now} = Radio) ->
    {ok, Bytes} = starl_live_codec:encode(packet_of(From, <<>>)),
    sealed(2, From, To, Bytes, Now, Radio).

%% One that a robot with damaged memory has sealed: what is in it is no packet of its.
malformed(From, To, At, Key, Radio) ->
    Content = starl_run_draw:between({Key, content}, 1, 12),
    sealed(1, From, To, malformed(Content, From), At, Radio).

malformed(1, _From) -> <<>>;
malformed(2, _From) -> <<1, 131>>;
malformed(3, From) -> <<2, (term_to_binary(packet_of(From, <<>>)))/binary>>;
malformed(4, From) -> <<1, (term_to_binary(packet_of(From, <<>>)))/binary, 0>>;
malformed(5, _From) -> <<1, (term_to_binary({starl, 1}))/binary>>;
malformed(6, From) -> content(packet_of(1 + From rem length(?ROBOTS), <<>>));
malformed(7, _From) -> <<1, 131, 119, 12, "no_such_atom">>;
malformed(8, From) -> content(packet_of(From, self()));
malformed(9, From) -> content(packet_of(From, make_ref()));
malformed(10, From) -> content(packet_of(From, fun() -> From end));
malformed(11, From) -> content(packet_of(From, <<1:3>>));
malformed(12, From) -> content(packet_of(From, nested(200))).

content(Packet) -> <<1, (term_to_binary(Packet, [{minor_version, 2}]))/binary>>.

nested(0) -> [];
nested(N) -> {nested(N - 1)}.

packet_of(From, Body) -> starl_packet:shout(From, {app, note}, {0, Body}).

sealed(Run, From, To, Bytes, Now, #radio{seed = Seed} = Radio) ->
    Life = 1 + length([At || At <- restarts(From, Seed), At =< Now]),
    {ok, Seal} = starl_live_seal:new((config(From, Run, Radio))#{life => Life}, 0),
    NowMs = (?EPOCH_US + Now + offset(From, Seed)) div 1000,
    iolist_to_binary(starl_live_seal:seal(To, [0, Bytes], NowMs, Seal)).

%% -- the judge ------------------------------------------------------------------------------

judge({starl, 1, shout, _, _, {N, _}} = Packet, Robot, #radio{sent = Sent} = Radio) ->
    Key = {N, Robot},
    #radio{heard = Heard, chain = Chain, now = Now} = Radio,
    Times = maps:get(Key, Heard, 0) + 1,
    Noted = Radio#radio{
        heard = Heard#{Key => Times}, chain = erlang:phash2({Chain, Now, Key})
    },
    Told = #{packet => N, times => Times},
    case Sent of
        #{N := #sent{packet = Packet, to = To, times = Most, at_us = At}} ->
            case {lists:member(Robot, To), Times =< Most, Now - At =< ?OLDEST_US} of
                {true, true, true} -> Noted;
                {false, _, _} -> broken(heard_by_another, Robot, Told, Noted);
                {true, false, _} -> broken(heard_twice, Robot, Told, Noted);
                {true, true, false} -> broken(heard_late, Robot, Told, Noted)
            end;
        #{} ->
            broken(never_sent, Robot, Told, Noted)
    end;
judge(_Other, Robot, Radio) ->
    broken(never_sent, Robot, #{}, Radio).

%% Everything that was sent in the calm network, when all had met, has been heard.
complete(#radio{violations = [_ | _]} = Radio) ->
    Radio;
complete(#radio{sent = Sent, heard = Heard} = Radio) ->
    Missing = [
        {N, Robot}
     || {N, #sent{to = To, at_us = At}} <- lists:sort(maps:to_list(Sent)),
        At >= ?MET_US,
        Robot <- To,
        not is_map_key({N, Robot}, Heard)
    ],
    case Missing of
        [] -> Radio;
        [{N, Robot} | _] -> broken(not_heard, Robot, #{packet => N}, Radio)
    end.

broken(What, Robot, Details, #radio{now = Now, violations = Violations} = Radio) ->
    Violation = #{
        contract => live_radio,
        what => What,
        at_us => Now,
        robots => [Robot],
        details => Details
    },
    Radio#radio{violations = [Violation | Violations]}.
