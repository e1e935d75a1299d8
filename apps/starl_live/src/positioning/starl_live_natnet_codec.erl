%% @doc Decodes the packets of OptiTrack's NatNet, as far as a robot needs them: the server's
%% description, and the rigid bodies and times of a frame. Versions 3.0 to 4.x; all numbers
%% little-endian.
%%
%% A packet is its kind (2 bytes), the size of its content (2), and the content. A frame is its
%% number (4 bytes) and sections, each of which begins with the number of its items (4). From 4.1
%% on, the section's size in bytes (4) follows. So sections are skipped without parsing, and rigid
%% bodies that have become longer can still be read. Before 4.1 each item has to be parsed.
%%
%% Neither counts nor sizes are trusted. If an item takes no bytes of the packet, the packet is
%% refused; nothing is allocated for a count.
-module(starl_live_natnet_codec).

-export([decode/2, connect/1, keep_alive/0]).

-export_type([version/0, packet/0, server/0, frame/0, body/0, times/0, reason/0]).

-type version() :: {Major :: byte(), Minor :: byte()}.

-type packet() :: {server, server()} | {frame, frame()} | other.

%% `hz' is the frequency of the server's clock.
-type server() :: #{name := binary(), version := version(), hz := non_neg_integer() | unknown}.

-type frame() :: #{number := integer(), bodies := [body()], times := times() | unknown}.

%% A rigid body: its streaming ID, its place in metres, a quaternion. `unseen': the cameras do not see
%% it now. `absurd': its numbers are none.
-type body() ::
    {Id :: integer(), starl_live_floor:vector(), starl_live_floor:rotation()} | unseen | absurd.

%% Ticks of the server's clock, 0 where it does not know: the middle of the exposure, and when the
%% frame was sent.
-type times() :: {ExposedTicks :: non_neg_integer(), SentTicks :: non_neg_integer()}.

%% Shorter than it says; a version that is not known here.
-type reason() :: truncated | version.

-define(CONNECT, 0).
-define(SERVER, 1).
-define(FRAME, 7).
-define(KEEP_ALIVE, 10).
-define(NAME, 256).
%% Sizes of a marker's place, a rigid body, and a labelled marker, from 3.0 on.
-define(PLACE, 12).
-define(BODY, 38).
-define(LABELLED, 26).

%% @doc Asks the server to describe itself, and, where it sends to each client by itself, to send to
%% this socket: in this version of the format, or in its own.
-spec connect(version() | own) -> binary().
connect(own) ->
    packet(?CONNECT, sender());
connect({Major, Minor}) ->
    packet(?CONNECT, <<(sender())/binary, 0, Major, Minor, 0, 0>>).

%% Name, version of the program, its version of NatNet.
sender() -> <<"Ping", 0:((?NAME - 4) * 8), 0:32, 4, 1, 0, 0>>.

%% @doc Tells the server that this client still listens.
-spec keep_alive() -> binary().
keep_alive() -> packet(?KEEP_ALIVE, <<>>).

%% The end is marked by a zero, which does not count.
packet(Kind, Content) ->
    <<Kind:16/little, (byte_size(Content)):16/little, Content/binary, 0>>.

%% @doc Reads a packet, in the server's version of the format where that is known.
-spec decode(binary(), version() | unknown) -> {ok, packet()} | {error, reason()}.
decode(<<Kind:16/little, Size:16/little, Content:Size/binary, _/binary>>, Version) ->
    try
        content(Kind, Content, Version)
    catch
        throw:Reason -> {error, Reason}
    end;
decode(_, _Version) ->
    {error, truncated}.

content(?SERVER, Content, _Version) -> {ok, {server, server(Content)}};
content(?FRAME, Content, {3, _} = Version) -> {ok, {frame, frame(Content, Version)}};
content(?FRAME, Content, {4, _} = Version) -> {ok, {frame, frame(Content, Version)}};
content(?FRAME, _Content, _Version) -> {error, version};
content(_Kind, _Content, _Version) -> {ok, other}.

server(<<Name:?NAME/binary, _Program:4/binary, Major, Minor, _:2/binary, Rest/binary>>) ->
    #{name => hd(binary:split(Name, <<0>>)), version => {Major, Minor}, hz => hz(Rest)};
server(_) ->
    throw(truncated).

hz(<<Hz:64/little, _/binary>>) -> Hz;
hz(_) -> unknown.

%% -- a frame --------------------------------------------------------------------------------

frame(<<Number:32/little-signed, Sections/binary>>, Version) ->
    NoSets = skip(fun marker_set/1, Sections, Version),
    NoMarkers = skip(?PLACE, NoSets, Version),
    {N, Bodies, Rest} = section(NoMarkers, Version),
    {Read, Left} = bodies(N, Bodies, Rest),
    #{number => Number, bodies => Read, times => times(Left, Version)};
frame(_, _Version) ->
    throw(truncated).

%% The number of a section's items, their bytes where the section tells, and the rest.
section(<<N:32/little, Size:32/little, Items:Size/binary, Rest/binary>>, Version) when
    Version >= {4, 1}
->
    {N, Items, Rest};
section(<<N:32/little, Rest/binary>>, Version) when Version < {4, 1} ->
    {N, unknown, Rest};
section(_, _Version) ->
    throw(truncated).

skip(Item, Sections, Version) ->
    case section(Sections, Version) of
        {N, unknown, Rest} -> walk(N, Item, Rest);
        {_, _, Rest} -> Rest
    end.

%% Each item takes at least one byte, so a count that is too large ends where the packet does.
walk(N, Size, Items) when is_integer(Size) -> drop(N * Size, Items);
walk(0, _Item, Rest) -> Rest;
walk(N, Item, Items) -> walk(N - 1, Item, Item(Items)).

drop(Size, Items) ->
    case Items of
        <<_:Size/binary, Rest/binary>> -> Rest;
        _ -> throw(truncated)
    end.

counted(Item, <<N:32/little, Items/binary>>) -> walk(N, Item, Items);
counted(_Item, _) -> throw(truncated).

marker_set(Items) ->
    case binary:split(Items, <<0>>) of
        [_Name, Rest] -> counted(?PLACE, Rest);
        _ -> throw(truncated)
    end.

skeleton(Items) -> counted(?BODY, drop(4, Items)).

%% A force plate or another device: its number, and its channels, each with its values.
device(Items) -> counted(fun(Channel) -> counted(4, Channel) end, drop(4, Items)).

bodies(N, unknown, Rest) ->
    {Bodies, Left} = split(N * ?BODY, Rest),
    {bodies(?BODY, Bodies), Left};
bodies(0, _Items, Rest) ->
    {[], Rest};
bodies(N, Items, Rest) when byte_size(Items) rem N =:= 0, byte_size(Items) div N >= ?BODY ->
    {bodies(byte_size(Items) div N, Items), Rest};
bodies(_, _, _) ->
    throw(truncated).

split(Size, Items) when byte_size(Items) >= Size -> split_binary(Items, Size);
split(_, _) -> throw(truncated).

bodies(Length, Bodies) ->
    [body(Body) || <<Body:Length/binary>> <= Bodies].

%% Bit 0 of the parameters: the cameras see it.
body(<<_:36/binary, Parameters:16/little, _/binary>>) when Parameters band 1 =:= 0 ->
    unseen;
body(
    <<Id:32/little-signed, X:32/float-little, Y:32/float-little, Z:32/float-little,
        A:32/float-little, B:32/float-little, C:32/float-little, W:32/float-little, _/binary>>
) ->
    {Id, {X, Y, Z}, {quaternion, A, B, C, W}};
body(_) ->
    absurd.

%% What follows the rigid bodies only tells times: where it is not understood they are unknown.
times(Sections, Version) ->
    try suffix(after_bodies(Sections, Version)) of
        Times -> Times
    catch
        throw:truncated -> unknown
    end.

after_bodies(Sections, Version) ->
    NoSkeletons = skip(fun skeleton/1, Sections, Version),
    NoAssets = assets(NoSkeletons, Version),
    NoLabelled = skip(?LABELLED, NoAssets, Version),
    NoPlates = skip(fun device/1, NoLabelled, Version),
    skip(fun device/1, NoPlates, Version).

assets(Sections, Version) when Version >= {4, 1} -> skip(0, Sections, Version);
assets(Sections, _Version) -> Sections.

%% Time code, its subframe, time stamp (a 64-bit float); then ticks: exposed, received, sent.
suffix(<<_:16/binary, Exposed:64/little, _:8/binary, Sent:64/little, _/binary>>) ->
    {Exposed, Sent};
suffix(_) ->
    throw(truncated).
