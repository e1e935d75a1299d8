%% @doc A robot's transmitter: whom a packet reaches, and what becomes of it on the way there
%% ({@link starl_sim_radio}). It counts the packets of each link, since all draws are by number.
%%
%% Robots are in range or not by where they were at the beginning of the present window (`sight').
-module(starl_sim_transmitter).

-export([new/0, send/4, plan/5, packets/1]).

-export_type([t/0, sender/0, copy/0]).

-define(CLASS_PACKET, 2).

%% How many packets went to each robot, and to all.
-opaque t() :: #{starl:robot_id() | all => pos_integer()}.

%% Who sends, now, in a window that began then, and in which piece of motion.
-type sender() :: {
    starl:robot_id(),
    Now :: starl_sim_queue:time(),
    WindowFrom :: starl_sim_queue:time() | none,
    starl_trajectory:piece()
}.

%% A copy of a packet that arrives.
-type copy() :: {To :: starl:robot_id(), starl_sim_radio:arrival()}.

%% @doc Nothing has been sent.
-spec new() -> t().
new() -> #{}.

%% @doc Sends a packet: gives the copies that arrive, by receiver, and tells for whom it is lost.
-spec send(starl:robot_id() | all, sender(), starl_sim_platform:world(), t()) ->
    {[copy()], Lost :: [starl_monitor:trace_event()], t()}.
send(To, {Id, Now, _, _} = Sender, #{seed := Seed} = World, Links) ->
    N = maps:get(To, Links, 0) + 1,
    Number = number(To, N),
    Sent = [
        {Dest, starl_sim_radio:arrivals({Seed, Id, Dest, Number}, Now, World)}
     || Dest <- audience(To, Sender, World)
    ],
    Copies = [{Dest, Copy} || {Dest, Arrivals} <- Sent, Arrivals =/= lost, Copy <- Arrivals],
    Lost = [{Now, Id, radio, {lost, Dest, Number}} || {Dest, lost} <- Sent],
    {Copies, Lost, Links#{To => N}}.

number(all, N) -> {all, N};
number(_Dest, N) -> N.

%% @doc The arrivals of a packet's copies, before the events that are planned already. The first has
%% this sequence number of the sender, the others those after it.
-spec plan([copy()], starl_packet:t(), sender(), Seq, [starl_sim_queue:event()]) ->
    [starl_sim_queue:event()]
when
    Seq :: non_neg_integer().
plan([], _Packet, _Sender, _Seq, Later) ->
    Later;
plan([{Dest, {Delay, State}} | Copies], Packet, {Id, Now, _, _} = Sender, Seq, Later) ->
    Content = {sap, packet, received(State, Packet, Seq)},
    Event = {Dest, Now + Delay, ?CLASS_PACKET, Id, Seq, Content},
    plan(Copies, Packet, Sender, Seq + 1, [Event | Later]).

%% The link's checksum tells a packet that was cut off or has a flipped bit; what is left of it
%% are bytes without a meaning.
received(intact, Packet, _Seq) -> Packet;
received(corrupt, Packet, Seq) -> <<(erlang:phash2({Packet, Seq})):32>>.

%% @doc How many packets were sent.
-spec packets(t()) -> non_neg_integer().
packets(Links) -> maps:fold(fun(_To, N, Sum) -> N + Sum end, 0, Links).

%% Who is reached, ascending. A fault can but shorten the range.
audience(To, {Id, Now, _, _} = Sender, #{range_mm := Full, team := Team} = World) ->
    case {starl_sim_radio:range({Id, Now}, World), To} of
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
