%% The other side of the wire: datagrams as Vicon Tracker and OptiTrack Motive send them, for tests.
-module(starl_live_mocap_fake).

-export([vicon/3, server/3, frame/2]).

%% -- Vicon ----------------------------------------------------------------------------------

%% A datagram of this size, filled up with zeros. An object's numbers may be given as bytes.
vicon(Frame, Objects, Size) ->
    Items = <<<<0, 72:16/little, (object(Object))/binary>> || Object <- Objects>>,
    Datagram = <<Frame:32/little, (length(Objects)), Items/binary>>,
    <<Datagram/binary, 0:((Size - byte_size(Datagram)) * 8)>>.

object({Name, {X, Y, Z}, {euler, A, B, C}}) ->
    Numbers = <<<<N:64/float-little>> || N <- [X, Y, Z, A, B, C]>>,
    object({Name, Numbers});
object({Name, Numbers}) ->
    <<Name/binary, 0:((24 - byte_size(Name)) * 8), Numbers/binary>>.

%% -- NatNet ---------------------------------------------------------------------------------

%% The server's description of itself.
server(Name, {Major, Minor}, Hz) ->
    packet(
        1,
        <<Name/binary, 0:((256 - byte_size(Name)) * 8), 3, 1, 0, 0, Major, Minor, 0, 0,
            Hz:64/little, 1511:16/little, 1, 239, 255, 42, 99>>
    ).

%% A frame with these rigid bodies, {Id, Place, Quaternion, Seen}, and with `clutter' things of
%% every other kind.
frame(Version, #{number := Number, bodies := Bodies} = Frame) ->
    Clutter = maps:get(clutter, Frame, 0),
    {Exposed, Sent} = maps:get(times, Frame, {0, 0}),
    All = [
        section(Version, [marker_set(N) || N <- lists:seq(1, Clutter)]),
        section(Version, [place(N) || N <- lists:seq(1, Clutter)]),
        section(Version, [body(Body) || Body <- Bodies]),
        section(Version, [skeleton(N) || N <- lists:seq(1, Clutter)]),
        [section(Version, [<<1:32, 2:32>> || _ <- lists:seq(1, Clutter)]) || Version >= {4, 1}],
        section(Version, [labelled(N) || N <- lists:seq(1, Clutter)]),
        section(Version, [device(N) || N <- lists:seq(1, Clutter)]),
        section(Version, [device(N) || N <- lists:seq(1, Clutter)])
    ],
    Suffix =
        <<0:32, 0:32, 1.5:64/float-little, Exposed:64/little, Exposed:64/little, Sent:64/little>>,
    Precision = [<<0:64>> || Version >= {4, 1}],
    Content = [<<Number:32/little>>, All, Suffix, Precision, <<0:16, 0:32>>],
    packet(7, iolist_to_binary(Content)).

packet(Kind, Content) -> <<Kind:16/little, (byte_size(Content)):16/little, Content/binary>>.

section(Version, Items) ->
    Size = [<<(iolist_size(Items)):32/little>> || Version >= {4, 1}],
    [<<(length(Items)):32/little>>, Size, Items].

marker_set(N) ->
    ["set ", integer_to_list(N), 0, <<N:32/little>>, [place(K) || K <- lists:seq(1, N)]].

place(N) -> <<<<(N * 0.5):32/float-little>> || _ <- "xyz">>.

body({Id, {X, Y, Z}, {quaternion, A, B, C, W}, Seen}) ->
    Floats = <<<<F:32/float-little>> || F <- [X, Y, Z, A, B, C, W, 0.0]>>,
    <<Id:32/little-signed, Floats/binary, (flag(Seen)):16/little>>.

flag(true) -> 1;
flag(false) -> 0.

skeleton(N) ->
    Bone = body({N, {0.0, 0.0, 0.0}, {quaternion, 0.0, 0.0, 0.0, 1.0}, true}),
    <<N:32/little, 2:32/little, Bone/binary, Bone/binary>>.

labelled(N) ->
    [<<N:32/little>>, place(N), <<0.01:32/float-little, 2:16/little, 0.0:32/float-little>>].

device(N) ->
    Channel = [<<N:32/little>>, [<<1.0:32/float-little>> || _ <- lists:seq(1, N)]],
    [<<N:32/little, 2:32/little>>, Channel, Channel].
