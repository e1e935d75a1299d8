%% @doc A robot's transmitter: finds the robots in range of a packet and its delivery outcome at
%% each ({@link starl_sim_radio}). It counts the packets of each link, since all draws are by
%% number.
%%
%% The places at the beginning of the present window (`sight') decide which robots are in range.
-module(starl_sim_transmitter).
-include_lib("starl_platform/include/starl_robot_order.hrl").

-export([new/0, send/6, damaged/2, packets/1]).

-export_type([t/0, datagram/0, sender/0, outgoing/0]).

%% The number of packets to each robot, and to all.
-opaque t() :: #{starl:robot_id() | all => pos_integer()}.

%% A packet as bytes, whose receiver has to find out itself whether it is damaged.
-type datagram() :: binary().

%% The sender, the present time, the beginning of its window, and its piece of motion.
-type sender() :: {
    starl:robot_id(),
    Now :: starl_sim_queue:time(),
    WindowFrom :: starl_sim_queue:time() | none,
    starl_trajectory:piece()
}.

%% The sequence number of the sender's next event, the planned events, the trace.
-type outgoing() :: {
    Seq :: non_neg_integer(), [starl_sim_queue:event()], [starl_monitor:trace_event()]
}.

%% A way of ten times the length takes 30 dB more (the exponent is 3, as indoors).
-define(DB_A_DECADE, 30.0).
%% Within a square of the floor of this side what takes a packet is the same.
-define(SQUARE_MM, 2000.0).

%% @doc Nothing has been sent.
-spec new() -> t().
new() -> #{}.

%% @doc Sends a packet: plans the arrivals of its copies, each under a sequence number of its own,
%% and traces each loss.
-spec send(
    starl:robot_id() | all,
    starl_packet:t() | datagram(),
    sender(),
    starl_sim_world:t(),
    outgoing(),
    t()
) -> {outgoing(), t()}.
send(To, Packet, Sender, World, Outgoing, Links) ->
    N =
        case Links of
            #{To := Before} -> Before + 1;
            #{} -> 1
        end,
    Dests = audience(To, Sender, World),
    Numbered = {number(To, N), Packet},
    Sent = send_each(Dests, Numbered, Sender, World, Outgoing),
    case World of
        #{packets := true} -> {told(To, Dests, Numbered, Sender, World, Sent), Links#{To => N}};
        #{} -> {Sent, Links#{To => N}}
    end.

%% For an observer: all draws are stateless, so they can be made once more.
told(To, [], {_, Packet}, {Id, Now, _, _}, _World, {Seq, Plans, Traces}) when is_integer(To) ->
    {Seq, Plans, [{Now, Id, radio, told(To, Packet, {lost, out_of_range})} | Traces]};
told(_To, Dests, {Number, Packet}, {Id, Now, _, _} = Sender, #{seed := Seed} = World, Sent) ->
    {Seq, Plans, Traces} = Sent,
    Told = [
        {Now, Id, radio, told(Dest, Packet, fate({Seed, Id, Dest, Number}, Sender, World))}
     || Dest <- Dests
    ],
    {Seq, Plans, Told ++ Traces}.

-spec told(starl:robot_id(), starl_packet:t(), starl_observer:fate()) -> starl_observer:packet().
told(Dest, Packet, Fate) ->
    {packet, Dest, starl_packet:brief(Packet), erlang:external_size(Packet), Fate}.

fate(Link, {_, Now, _, _} = Sender, World) ->
    case is_screened(Link, Sender, World) orelse is_shadowed(Link, Sender, World) of
        true -> {lost, chance};
        false -> starl_sim_radio:fate(Link, Now, World)
    end.

arrivals(Link, {_, Now, _, _} = Sender, World) ->
    case is_screened(Link, Sender, World) orelse is_shadowed(Link, Sender, World) of
        true -> lost;
        false -> starl_sim_radio:arrivals(Link, Now, World)
    end.

%% Do the walls in its way take the packet? Each takes its part of those that come so far.
is_screened({_, _, Dest, _} = Link, {_, Now, From, _} = Sender, #{wall_loss := Loss} = World) when
    Loss > 0.0, is_map_key(walls, World)
->
    #{sight := Sight} = World,
    case starl_sim_sight:piece(Dest, Sight) of
        {ok, Theirs} ->
            Way = {position(Sender), starl_trajectory:position(From, Theirs)},
            Walls = starl_walls:crossed(Way, starl_sim_bodies:walls(Now, World)),
            starl_run_draw:uniform({Link, walls}) >= math:pow(1.0 - Loss, Walls);
        unknown ->
            false
    end;
is_screened(_Link, _Sender, _World) ->
    false.

%% Does the way between the two places take more than a radio of this range has left? What it takes (dB) is half of a normal
%% distribution, drawn for the pair and the squares of the floor in which both are: the same in both
%% directions, and again when they come back. So no range is longer than the radio's.
is_shadowed({Seed, Id, Dest, _}, {_, _, From, _} = Sender, #{shadowing := Db} = World) when
    Db > 0.0
->
    #{sight := Sight, range_mm := Range} = World,
    case starl_sim_sight:piece(Dest, Sight) of
        {ok, Theirs} when is_float(Range) ->
            Places = [{Id, position(Sender)}, {Dest, starl_trajectory:position(From, Theirs)}],
            Taken = Db * abs(normal({Seed, shadow, squares(Places)})),
            [{_, Here}, {_, There}] = Places,
            starl_geometry:distance(Here, There) > Range * math:pow(10, -Taken / ?DB_A_DECADE);
        _ ->
            false
    end;
is_shadowed(_Link, _Sender, _World) ->
    false.

squares(Places) ->
    lists:sort([{Id, floor(X / ?SQUARE_MM), floor(Y / ?SQUARE_MM)} || {Id, {X, Y}} <- Places]).

%% At most three deviations; by Box and Muller.
normal(Key) ->
    U = 1.0 - starl_run_draw:uniform({Key, 1}),
    N = math:sqrt(-2 * math:log(U)) * math:cos(2 * math:pi() * starl_run_draw:uniform({Key, 2})),
    max(-3.0, min(3.0, N)).

number(all, N) -> {all, N};
number(_Dest, N) -> N.

send_each([], _Numbered, _Sender, _World, Outgoing) ->
    Outgoing;
send_each([Dest | Dests], {Number, Packet} = Numbered, Sender, World, {Seq, Plans, Traces}) ->
    {Id, Now, _, _} = Sender,
    case arrivals({maps:get(seed, World), Id, Dest, Number}, Sender, World) of
        lost ->
            Lost = {Now, Id, radio, {lost, Dest, Number}},
            send_each(Dests, Numbered, Sender, World, {Seq, Plans, [Lost | Traces]});
        Arrivals ->
            {Next, More} = plan(Arrivals, Dest, Packet, Id, Now, Seq, Plans),
            send_each(Dests, Numbered, Sender, World, {Next, More, Traces})
    end.

plan([], _Dest, _Packet, _Id, _Now, Seq, Plans) ->
    {Seq, Plans};
plan([{Delay, State} | Arrivals], Dest, Packet, Id, Now, Seq, Plans) ->
    Received =
        case State of
            intact -> Packet;
            corrupt -> corrupted(Packet, {Id, Now, Seq})
        end,
    Content = {sap, packet, Received},
    Event = {Dest, Now + Delay, ?CLASS_PACKET, Id, Seq, Content},
    plan(Arrivals, Dest, Packet, Id, Now, Seq + 1, [Event | Plans]).

%% The link's checksum detects a packet that was cut off or has a flipped bit; its remains
%% are bytes without a meaning.
corrupted(<<Datagram/binary>>, Key) -> damaged(Datagram, Key);
corrupted(Packet, {_, _, Seq}) -> <<(erlang:phash2({Packet, Seq})):32>>.

%% @doc A datagram whose end is missing, or that has something behind it, or a wrong bit, by a draw
%% from this key.
-spec damaged(datagram(), Key :: term()) -> datagram().
damaged(Datagram, Key) ->
    Bit = starl_run_draw:between({Key, bit}, 0, 8 * byte_size(Datagram) - 1),
    case starl_run_draw:between({Key, how}, 1, 6) of
        1 ->
            binary:part(Datagram, 0, Bit div 8);
        2 ->
            <<Datagram/binary, Bit:16>>;
        _ ->
            <<Before:Bit, B:1, After/bits>> = Datagram,
            <<Before:Bit, (1 - B):1, After/bits>>
    end.

%% @doc The number of packets sent.
-spec packets(t()) -> non_neg_integer().
packets(Links) -> maps:fold(fun(_To, N, Sum) -> N + Sum end, 0, Links).

%% The robots that are reached, ascending. A fault can only shorten the range.
audience(To, {Id, Now, _, _} = Sender, #{range_mm := Full, team := Team} = World) ->
    case {starl_sim_radio:range(Id, Now, World), To} of
        {infinity, all} -> starl_team:others(Id, Team);
        {infinity, _} -> [To || starl_team:has(To, Team)];
        {Full, all} -> lists:delete(Id, within_range(Sender, World));
        {Short, all} -> [R || R <- starl_team:others(Id, Team), is_near(R, Short, Sender, World)];
        {Range, _} -> [To || is_near(To, Range, Sender, World)]
    end.

is_near(Dest, Range, {_, _, From, _} = Sender, #{sight := Sight}) ->
    case starl_sim_sight:piece(Dest, Sight) of
        {ok, Theirs} ->
            There = starl_trajectory:position(From, Theirs),
            starl_geometry:distance(position(Sender), There) =< Range;
        unknown ->
            false
    end.

within_range({_, _, From, _} = Sender, #{sight := Sight}) ->
    starl_sim_sight:within(position(Sender), From, Sight).

position({_, Now, _, Piece}) -> starl_trajectory:position(Now, Piece).
