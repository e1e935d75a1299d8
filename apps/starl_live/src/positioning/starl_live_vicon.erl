%% @doc Vicon Tracker's "UDP Object Stream" as a source of {@link starl_live_positioning}.
%%
%% All numbers are little-endian, nothing is aligned. Tracker fills a datagram up to 256, 512 or
%% 1,024 bytes; the remaining objects come in another datagram with the same frame number.
%% ```
%%     0   4  frame number
%%     4   1  n, the number of items
%%            n times:
%%     0   1  kind of the item; 0 is an object, others are skipped
%%     1   2  size of what follows, 72 for an object
%%     3  24  name, filled up with zeros
%%    27  24  x, y, z in millimetres, 64-bit floats
%%    51  24  rotations about the body's own x, y, z, in this order, in radians, 64-bit floats
%% '''
%% An object that the cameras do not see is left out, or shown with zeros alone. That is not a
%% place.
%%
%% Options. `names': the objects' names and their robots. `port' (51001), `group', `interface'
%% ({@link starl_live_datagrams}); `axes' ({1, 2, 3}, {@link starl_live_floor}). `turns': the angle
%% between a robot's front and its object's x axis, for robots where they differ. `rate_hz':
%% Tracker's frame rate; with it, the frame number gives the age of a delayed datagram. `latency_us'
%% (10000): the time from the cameras' picture to the datagram's arrival.
-module(starl_live_vicon).
-behaviour(starl_live_positioning).

-export([decode/1]).
-export([open/1, hear/2, figures/1, close/1]).
-export([new/1, datagram/3]).

-export_type([object/0, pure/0]).

-type object() :: {Name :: binary(), starl_live_floor:vector(), starl_live_floor:rotation()}.

-define(PORT, 51001).
-define(NAME, 24).
-define(NUMBERS, 48).
-define(LATENCY_US, 10000).

-record(vicon, {
    names :: #{binary() => starl:robot_id()},
    axes :: starl_live_floor:axes(),
    turns :: #{starl:robot_id() => float()},
    rate_hz :: number() | none,
    latency_us :: non_neg_integer(),
    clock :: starl_live_clock:t(),
    frames = starl_live_frames:new() :: starl_live_frames:t(),
    figures = #{} :: starl_live_positioning:figures()
}).

-opaque pure() :: #vicon{}.

%% -- the format -----------------------------------------------------------------------------

%% @doc Reads a datagram: its frame number, its objects, and the number of objects that it does not
%% see or shows with invalid numbers. If a datagram was cut off, its whole objects are read.
-spec decode(binary()) -> {ok, Frame :: non_neg_integer(), [object() | unseen | absurd]} | error.
decode(<<Frame:32/little, N, Items/binary>>) -> {ok, Frame, items(N, Items)};
decode(_) -> error.

items(0, _) ->
    [];
items(N, <<0, Size:16/little, Item:Size/binary, Rest/binary>>) when Size >= ?NAME + ?NUMBERS ->
    <<Name:?NAME/binary, Numbers:?NUMBERS/binary, _/binary>> = Item,
    [measured(name(Name), Numbers) | items(N - 1, Rest)];
items(N, <<_, Size:16/little, _:Size/binary, Rest/binary>>) ->
    items(N - 1, Rest);
items(_, _) ->
    [].

%% A name of 24 bytes ends without a zero.
name(Name) -> hd(binary:split(Name, <<0>>)).

measured(_Name, <<0:(?NUMBERS * 8)>>) ->
    unseen;
measured(
    Name,
    <<X:64/float-little, Y:64/float-little, Z:64/float-little, A:64/float-little, B:64/float-little,
        C:64/float-little>>
) ->
    {Name, {X, Y, Z}, {euler, A, B, C}};
measured(_Name, _) ->
    absurd.

%% -- the source -----------------------------------------------------------------------------

%% @doc Opens the socket.
-spec open(starl_live_positioning:config()) ->
    {ok, {gen_udp:socket(), pure()}} | {error, iolist()}.
open(Config) ->
    case checked(Config) of
        ok ->
            case starl_live_datagrams:open(maps:get(port, Config, ?PORT), Config) of
                {ok, Socket} -> {ok, {Socket, new(Config)}};
                {error, _} = Error -> Error
            end;
        {error, _} = Error ->
            Error
    end.

checked(#{names := Names} = Config) when map_size(Names) > 0 ->
    case [Name || Name <- maps:keys(Names), not is_name(Name)] of
        [] -> starl_live_floor:axes(maps:get(axes, Config, {1, 2, 3}));
        [Wrong | _] -> {error, io_lib:format("an object of Vicon has no name like ~0p", [Wrong])}
    end;
checked(_) ->
    {error, "Vicon shows objects by name: give names, as in #{<<\"create1\">> => 1}"}.

is_name(Name) ->
    is_binary(Name) andalso Name =/= <<>> andalso byte_size(Name) =< ?NAME.

%% @doc Nothing has arrived yet.
-spec new(starl_live_positioning:config()) -> pure().
new(#{names := Names, clock := Clock} = Config) ->
    #vicon{
        names = Names,
        clock = Clock,
        axes = maps:get(axes, Config, {1, 2, 3}),
        turns = maps:get(turns, Config, #{}),
        rate_hz = maps:get(rate_hz, Config, none),
        latency_us = maps:get(latency_us, Config, ?LATENCY_US)
    }.

-spec hear(term(), {gen_udp:socket(), pure()}) ->
    {[starl_live_positioning:sighting()], {gen_udp:socket(), pure()}} | unknown.
hear(Message, {Socket, Pure}) ->
    case starl_live_datagrams:hear(Message, Socket) of
        {datagram, _From, Datagram} ->
            {Sightings, Next} = datagram(Datagram, erlang:system_time(microsecond), Pure),
            {Sightings, {Socket, Next}};
        nothing ->
            {[], {Socket, Pure}};
        unknown ->
            unknown
    end.

-spec figures({gen_udp:socket(), pure()}) -> starl_live_positioning:figures().
figures({_Socket, #vicon{figures = Figures}}) -> Figures.

-spec close({gen_udp:socket(), pure()}) -> ok.
close({Socket, _Pure}) -> gen_udp:close(Socket).

%% @doc The robots that a datagram shows, which has arrived at this system time.
-spec datagram(binary(), ArrivedUs :: integer(), pure()) ->
    {[starl_live_positioning:sighting()], pure()}.
datagram(Datagram, Arrived, Vicon) ->
    case decode(Datagram) of
        {ok, Frame, Objects} -> frame(Frame, Objects, Arrived, Vicon);
        error -> {[], count(truncated, Vicon)}
    end.

frame(Frame, Objects, Arrived, #vicon{latency_us = Latency, frames = Frames} = Vicon) ->
    {Poses, Counted} = lists:foldl(fun object/2, {[], Vicon}, Objects),
    Picture = #{
        number => Frame,
        time_us => time_us(Frame, Vicon),
        age_us => Latency,
        poses => lists:reverse(Poses)
    },
    {Order, Shown, Next} = starl_live_frames:picture(Picture, Arrived, Frames),
    Sightings = [
        {Robot, Pose, starl_live_clock:at_us(Taken, Vicon#vicon.clock)}
     || {Robot, Pose, Taken} <- Shown
    ],
    {Sightings, count(figure(Order), Counted#vicon{frames = Next})}.

time_us(_Frame, #vicon{rate_hz = none}) -> none;
time_us(Frame, #vicon{rate_hz = Rate}) -> round(Frame * 1.0e6 / Rate).

figure(old) -> old;
figure(_) -> datagrams.

object({Name, Place, Rotation}, {Poses, #vicon{names = Names, axes = Axes} = Vicon}) ->
    case {Names, starl_live_floor:pose(Axes, Place, Rotation)} of
        {#{Name := Robot}, {ok, Pose}} -> {[{Robot, turned(Robot, Pose, Vicon)} | Poses], Vicon};
        {#{Name := _}, {error, Reason}} -> {Poses, count(Reason, Vicon)};
        _ -> {Poses, count(other_objects, Vicon)}
    end;
object(Figure, {Poses, Vicon}) ->
    {Poses, count(Figure, Vicon)}.

turned(Robot, {X, Y, Heading}, #vicon{turns = Turns}) ->
    {X, Y, starl_geometry:normalise(Heading + maps:get(Robot, Turns, 0.0))}.

count(Figure, #vicon{figures = Figures} = Vicon) ->
    Vicon#vicon{figures = maps:update_with(Figure, fun(N) -> N + 1 end, 1, Figures)}.
