%% @doc The transport by UDP: sealed datagrams between the robots of a fleet. See
%% `doc/transports.md' for their format and for what an attacker can do.
%%
%% A packet for all goes to each robot in turn, or once to a multicast or broadcast address, by
%% configuration. Bytes leave at a bounded rate ({@link starl_live_pace}). A robot that has just
%% heard a packet for all waits for a short random time before it sends something to that packet's
%% source. So the acknowledgements of a broadcast do not come all at once. The time is at most a
%% tenth of SAP's first retransmission delay.
%%
%% Each second a heartbeat, a datagram without a packet, goes to every other robot. From heartbeats
%% robots know that they hear each other, how long a round trip takes, and where they are.
%% Heartbeats also prove that nobody replays what a robot's former lives have heard
%% ({@link starl_live_peers}). A heartbeat that does not name the receiver's life, or is the first
%% of its sender's life, is answered at once. A separate process looks names up, and again while a
%% robot is silent.
-module(starl_live_udp).
-behaviour(starl_live_transport).

-export([open/1, transmit/3, hear/2, figures/1, peers/1, close/1]).

-export_type([config/0]).

%% Beside the keys of every transport and of {@link starl_live_seal}: `peers': where each robot
%% hears, this one as well; `all': where a packet for all goes; `interface': the address of the
%% network that carries multicast; `rate': bytes per millisecond; `spread_ms': the longest wait
%% before an answer to a packet for all; `beat_ms': the time between two beats; without beats nobody is asked
%% for a proof. A simulation gives it
%% other sockets, a module with the functions of `gen_udp' that are used here, and a random stream; a
%% test another way to look up names.
-type config() :: #{
    robot := starl:robot_id(),
    participants := starl_team:t(),
    fleet := unicode:chardata(),
    run := non_neg_integer(),
    key := starl_live_key:t(),
    peers := #{starl:robot_id() => starl_live_peers:place()},
    all => each | {multicast | broadcast, inet:ip4_address(), inet:port_number()},
    interface => inet:ip4_address(),
    rate => pos_integer(),
    spread_ms => non_neg_integer(),
    fresh_ms => pos_integer(),
    life => starl_live_seal:life(),
    beat_ms => pos_integer() | infinity,
    lookup => lookup(),
    clock => starl_live_clock:t(),
    sockets => module(),
    random => fun(() -> rand:state()),
    atom() => term()
}.

-type lookup() :: fun((inet:hostname()) -> {ok, inet:ip_address()} | {error, inet:posix()}).

%% 8 Mbit/s, and a burst of some milliseconds of a usual wireless network.
-define(RATE, 1000).
-define(BURST, 16_000).
%% What is sent to a robot within this time after its packet for all is taken for an answer.
-define(ANSWER_MS, 20).
-define(SPREAD_MS, 25).
%% The most datagrams that wait before an answer; beyond that they go at once.
-define(HELD, 1000).
-define(BEAT_MS, 1000).
%% A beat's payload has another type than a packet's ({@link starl_live_fragment}). It says that no beat
%% was heard yet.
-define(BEAT, 2).
-define(NONE, 16#FFFFFFFF).

-type datagram() :: {starl_live_peers:address(), iodata()}.

-record(udp, {
    clock :: starl_live_clock:t(),
    sockets :: starl_live_udp_sockets:t(),
    all :: starl_live_udp_sockets:all(),
    peers :: starl_live_peers:t(),
    lookup :: lookup(),
    %% robots whose names are being looked up
    asked = #{} :: #{reference() => starl:robot_id()},
    beat_ms :: pos_integer() | infinity,
    beat = none :: reference() | none,
    seal :: starl_live_seal:t(),
    life :: starl_live_seal:life(),
    fragments :: starl_live_fragment:t(),
    pace :: starl_live_pace:t(datagram()),
    flush = none :: reference() | none,
    spread_ms :: non_neg_integer(),
    %% when each robot was last heard with a packet for all
    calls = #{} :: #{starl:robot_id() => Ms :: integer()},
    held = 0 :: non_neg_integer(),
    random :: rand:state(),
    figures = #{} :: starl_live_transport:figures()
}).

%% -- opening --------------------------------------------------------------------------------

-spec open(config()) -> {ok, #udp{}} | {error, unicode:chardata()}.
open(#{robot := Robot, participants := Team, peers := Peers} = Config) ->
    case starl_live_udp_sockets:places([Robot | starl_team:others(Robot, Team)], Peers) of
        {ok, Places} -> with_seal(with_life(Config), Places);
        {error, _} = Error -> Error
    end.

%% Lives begin in the order of their times.
with_life(#{life := _} = Config) ->
    Config;
with_life(Config) ->
    {Lot, _} = rand:uniform_s(1 bsl 16, (random(Config))()),
    Ms = starl_live_clock:time_of_day(millisecond, clock(Config)),
    <<Life:64>> = <<Ms:48, (Lot - 1):16>>,
    Config#{life => Life}.

random(Config) -> maps:get(random, Config, fun() -> rand:seed_s(exsss) end).

with_seal(Config, Places) ->
    case starl_live_seal:new(Config, now_ms(clock(Config))) of
        {ok, Seal} -> opened(Config, Places, Seal);
        {error, _} = Error -> Error
    end.

opened(#{robot := Robot} = Config, Places, Seal) ->
    Module = maps:get(sockets, Config, gen_udp),
    case starl_live_udp_sockets:open(maps:get(Robot, Places), Module, Config) of
        {ok, Sockets, All} -> {ok, call_all(udp(Config, Places, Seal, {Sockets, All}))};
        {error, _} = Error -> Error
    end.

%% Without a clock: that of this computer.
clock(Config) -> maps:get(clock, Config, starl_live_clock:new(0, 1)).

udp(#{robot := Robot, life := Life} = Config, Places, Seal, {Sockets, All}) ->
    Rate = maps:get(rate, Config, ?RATE),
    Clock = clock(Config),
    #udp{
        clock = Clock,
        sockets = Sockets,
        all = All,
        peers = starl_live_peers:new(maps:remove(Robot, Places), now_ms(Clock)),
        lookup = maps:get(lookup, Config, fun(Host) -> inet:getaddr(Host, inet) end),
        beat_ms = maps:get(beat_ms, Config, ?BEAT_MS),
        seal = Seal,
        life = Life,
        fragments = starl_live_fragment:new(starl_live_seal:room()),
        pace = starl_live_pace:new(Rate, max(?BURST, Rate), now_us(Clock)),
        spread_ms = maps:get(spread_ms, Config, min(?SPREAD_MS, map_size(Places) div 2)),
        random = (random(Config))()
    }.

%% -- sending --------------------------------------------------------------------------------

-spec transmit(starl:robot_id() | all, starl_packet:t(), #udp{}) ->
    {ok, #udp{}} | {refused, unicode:chardata(), #udp{}}.
transmit(To, Packet, #udp{} = Udp) ->
    case {starl_live_codec:encode(Packet), addresses(To, Udp)} of
        {{error, Why}, _} ->
            {refused, starl_live_codec:format_error(Packet, Why), Udp};
        {_, unknown} ->
            {ok, count(unknown_peer, Udp)};
        {{ok, Bytes}, Addresses} ->
            Datagrams = [
                {Address, Sealed}
             || Sealed <- sealed(To, Bytes, day_ms(Udp), Udp#udp.seal), Address <- Addresses
            ],
            {ok, answer(To, Datagrams, count(sent, Udp))}
    end.

addresses(all, #udp{all = each, peers = Peers}) ->
    starl_live_peers:addresses(Peers);
addresses(all, #udp{all = Address}) ->
    [Address];
addresses(To, #udp{peers = Peers}) ->
    case starl_live_peers:address(To, Peers) of
        unknown -> unknown;
        none -> [];
        Address -> [Address]
    end.

sealed(To, Bytes, Now, Seal) ->
    Payloads = starl_live_fragment:split(starl_live_seal:room(), Bytes),
    [starl_live_seal:seal(To, Payload, Now, Seal) || Payload <- Payloads].

answer(To, Datagrams, #udp{calls = Calls, spread_ms = Spread, held = Held} = Udp) ->
    case Calls of
        #{To := At} when Spread > 0, Held < ?HELD ->
            hold(now_ms(Udp#udp.clock) - At =< max(?ANSWER_MS, Spread), Datagrams, Udp);
        #{} ->
            put_on_air(Datagrams, Udp)
    end.

hold(false, Datagrams, Udp) ->
    put_on_air(Datagrams, Udp);
hold(true, Datagrams, #udp{spread_ms = Spread, held = Held, random = Random} = Udp) ->
    {Wait, Next} = rand:uniform_s(Spread + 1, Random),
    _ = starl_live_clock:send_after(Wait - 1, {?MODULE, held, Datagrams}, Udp#udp.clock),
    Udp#udp{held = Held + 1, random = Next}.

put_on_air(Datagrams, Udp) -> flush(lists:foldl(fun wait/2, Udp, Datagrams)).

wait({_, Bytes} = Datagram, #udp{pace = Pace} = Udp) ->
    case starl_live_pace:put(Datagram, iolist_size(Bytes), Pace) of
        {ok, Next} -> Udp#udp{pace = Next};
        full -> count(queue_full, Udp)
    end.

%% Sends what may go now; the rest when its time has come.
flush(#udp{flush = none, pace = Pace, clock = Clock} = Udp) ->
    {Datagrams, Wait, Next} = starl_live_pace:take(now_us(Clock), Pace),
    Sent = lists:foldl(fun send/2, Udp#udp{pace = Next}, Datagrams),
    Sent#udp{flush = timer(Wait, Clock)};
flush(Udp) ->
    Udp.

timer(infinity, _Clock) -> none;
timer(Wait, Clock) -> starl_live_clock:start_timer(Wait, flush, [], Clock).

send({Address, Bytes}, #udp{sockets = Sockets} = Udp) ->
    case starl_live_udp_sockets:send(Address, Bytes, Sockets) of
        ok ->
            count(datagrams, Udp);
        %% No way to that robot now: the packet is lost.
        {error, Why} ->
            #udp{peers = Peers, clock = Clock} = Udp,
            Known = starl_live_peers:unsent(Address, Why, now_ms(Clock), Peers),
            count(send_error, Udp#udp{peers = Known})
    end.

%% -- beats ----------------------------------------------------------------------------------

%% Calls all robots, looks who is silent, and looks up names.
call_all(#udp{beat_ms = infinity} = Udp) ->
    Udp;
call_all(#udp{beat_ms = Ms, peers = Peers, clock = Clock} = Udp) ->
    {News, Known} = starl_live_peers:look(now_ms(Clock), Peers),
    ok = starl_live_hearing:log(News),
    Asked = looked_up(Udp#udp{peers = Known}),
    Calls = [{Address, beat(Robot, Asked)} || {Robot, Address} <- starl_live_peers:calls(Known)],
    Next = put_on_air(Calls, Asked),
    Next#udp{beat = starl_live_clock:start_timer(Ms, beat, [], Clock)}.

beat(Robot, #udp{clock = Clock, peers = Peers, seal = Seal} = Udp) ->
    {Ours, Theirs, Held} = starl_live_peers:beat(Robot, now_us(Clock), Peers),
    Life = starl_live_peers:life(Robot, Peers),
    Payload = <<?BEAT, Ours:64/signed, Theirs:64/signed, (held(Held)):32, Life:64>>,
    starl_live_seal:seal(Robot, Payload, day_ms(Udp), Seal).

held(none) -> ?NONE;
held(Us) -> min(Us, ?NONE - 1).

%% Our beat names the life of a robot that has just been heard in it.
call_back(Robot, #udp{peers = Peers} = Udp) ->
    Calls = [
        {Address, beat(Robot, Udp)}
     || {R, Address} <- starl_live_peers:calls(Peers), R =:= Robot
    ],
    put_on_air(Calls, Udp).

%% A lookup may take seconds.
looked_up(#udp{peers = Peers, clock = Clock} = Udp) ->
    Now = now_ms(Clock),
    lists:foldl(
        fun(Name, U) -> look_up(Name, Now, U) end, Udp, starl_live_peers:unnamed(Now, Peers)
    ).

look_up({Robot, Host}, Now, #udp{asked = Asked, lookup = Lookup, peers = Peers} = Udp) ->
    case lists:member(Robot, maps:values(Asked)) of
        true ->
            Udp;
        false ->
            Self = self(),
            Look = fun() -> Self ! {?MODULE, named, Robot, Lookup(Host)} end,
            {_Pid, Monitor} = spawn_monitor(Look),
            Udp#udp{
                asked = Asked#{Monitor => Robot}, peers = starl_live_peers:asked(Robot, Now, Peers)
            }
    end.

named(Robot, Found, #udp{peers = Peers} = Udp) ->
    {News, Known} = starl_live_peers:named(Robot, Found, Peers),
    ok = starl_live_hearing:log(News),
    Udp#udp{peers = Known}.

%% -- hearing --------------------------------------------------------------------------------

-spec hear(term(), #udp{}) -> {[starl_packet:t()], #udp{}} | unknown.
hear({udp, _Socket, Ip, Port, Datagram}, #udp{seal = Seal, clock = Clock} = Udp) ->
    Now = {day_ms(Udp), now_ms(Clock)},
    case starl_live_seal:open(Datagram, Now, Seal) of
        {ok, Said, Payload, Next} -> opened(Said, {Ip, Port}, Now, Payload, Udp#udp{seal = Next});
        {error, Why, Claimed} -> {[], refused(Claimed, Why, {Ip, Port}, Udp)}
    end;
hear({udp_passive, Socket}, Udp) ->
    ok = starl_live_udp_sockets:more(Socket),
    {[], Udp};
hear({timeout, Timer, flush}, #udp{flush = Timer} = Udp) ->
    {[], flush(Udp#udp{flush = none})};
hear({timeout, Timer, beat}, #udp{beat = Timer} = Udp) ->
    {[], call_all(Udp)};
hear({?MODULE, named, Robot, Found}, Udp) ->
    {[], named(Robot, Found, Udp)};
hear({'DOWN', Monitor, process, _Pid, _Why}, #udp{asked = Asked} = Udp) when
    is_map_key(Monitor, Asked)
->
    {[], Udp#udp{asked = maps:remove(Monitor, Asked)}};
hear({?MODULE, held, Datagrams}, #udp{held = Held} = Udp) ->
    {[], put_on_air(Datagrams, Udp#udp{held = Held - 1})};
%% A robot's computer has nobody at that port, or the like.
hear({udp_error, _Socket, _Why}, Udp) ->
    {[], count(socket_error, Udp)};
hear(_Message, _Udp) ->
    unknown.

opened(#{from := From, to := To} = Said, Address, Now, Payload, #udp{peers = Peers} = Udp) ->
    {Verdict, News, Known} = starl_live_peers:heard(Said, Address, Now, Peers),
    ok = starl_live_hearing:log(News),
    Hearing = Udp#udp{peers = Known},
    case Verdict of
        heard ->
            IsNew = starl_live_peers:life(From, Peers) =/= starl_live_peers:life(From, Known),
            taken(Said, Payload, Address, IsNew, called(From, To, Hearing));
        late ->
            late(Said, Payload, Address, Hearing);
        Why ->
            {[], refused(From, Why, Address, Hearing)}
    end.

%% A beat of a former life tells nothing.
late(_Said, <<?BEAT, _/binary>>, _Address, Udp) -> {[], Udp};
late(Said, Payload, Address, Udp) -> proved(Said, Payload, Address, Udp).

called(From, all, #udp{calls = Calls, clock = Clock} = Udp) ->
    Udp#udp{calls = Calls#{From => now_ms(Clock)}};
called(_From, _To, Udp) ->
    Udp.

taken(#{from := From, sent_ms := Sent}, <<?BEAT, Beat/binary>>, _Address, IsNew, Udp) when
    byte_size(Beat) =:= 28
->
    <<Theirs:64/signed, Echo:64/signed, Held:32, Life:64>> = Beat,
    #udp{peers = Peers, clock = Clock, life = Ours} = Udp,
    Beaten = starl_live_peers:beaten(From, Theirs, {Echo, heard(Held)}, now_us(Clock), Peers),
    case Life of
        Ours when not IsNew ->
            {[], Udp#udp{peers = starl_live_peers:proved(From, Sent, Beaten)}};
        Ours ->
            {[], call_back(From, Udp#udp{peers = starl_live_peers:proved(From, Sent, Beaten)})};
        _Former ->
            {[], call_back(From, Udp#udp{peers = Beaten})}
    end;
taken(Said, Payload, Address, _IsNew, Udp) ->
    proved(Said, Payload, Address, Udp).

heard(?NONE) -> none;
heard(Held) -> Held.

proved(#{from := From} = Said, Payload, Address, #udp{peers = Peers, beat_ms = Ms} = Udp) ->
    case Ms =:= infinity orelse starl_live_peers:is_proved(Said, Peers) of
        true -> joined(From, Payload, Address, Udp);
        false -> {[], refused(From, unproved, Address, Udp)}
    end.

joined(From, Payload, Address, #udp{fragments = Fragments, clock = Clock} = Udp) ->
    case starl_live_fragment:join(From, Payload, now_ms(Clock), Fragments) of
        {whole, Bytes, Next} ->
            decoded(From, starl_live_codec:decode(From, Bytes), Address, Udp#udp{fragments = Next});
        {more, Next} ->
            {[], Udp#udp{fragments = Next}};
        {error, Why, Next} ->
            {[], refused(From, Why, Address, Udp#udp{fragments = Next})}
    end.

decoded(_From, {ok, Packet}, _Address, Udp) ->
    {[Packet], Udp};
decoded(From, {error, Why}, Address, #udp{figures = Figures} = Udp) ->
    Counted = Udp#udp{figures = starl_live_transport:refused(Why, From, Figures)},
    {[], noted(From, Why, Address, Counted)}.

refused(From, Why, Address, Udp) -> noted(From, Why, Address, count(reason(Why), Udp)).

reason({clock, _Ahead}) -> clock;
reason(Why) -> Why.

noted(From, Why, Address, #udp{peers = Peers, clock = Clock} = Udp) ->
    {News, Known} = starl_live_peers:refused(From, Why, Address, now_ms(Clock), Peers),
    ok = starl_live_hearing:log(News),
    Udp#udp{peers = Known}.

count(What, #udp{figures = Figures} = Udp) ->
    Udp#udp{figures = starl_live_transport:count(What, Figures)}.

%% The time by which packets are fresh: that which the computers' clocks show.
day_ms(#udp{clock = Clock}) -> starl_live_clock:time_of_day(millisecond, Clock).

now_ms(Clock) -> starl_live_clock:monotonic_time(millisecond, Clock).

now_us(Clock) -> starl_live_clock:monotonic_time(microsecond, Clock).

-spec figures(#udp{}) -> starl_live_transport:figures().
figures(#udp{figures = Figures}) -> Figures.

-spec peers(#udp{}) -> [starl_live_peers:peer()].
peers(#udp{peers = Peers, clock = Clock}) -> starl_live_peers:all(now_ms(Clock), Peers).

-spec close(#udp{}) -> ok.
close(#udp{sockets = Sockets}) -> starl_live_udp_sockets:close(Sockets).
