%% @doc OptiTrack's NatNet, versions 3 and 4, as a source of {@link starl_live_positioning}.
%% {@link starl_live_natnet_codec} reads its packets.
%%
%% The server (Motive) reports which version of the format it uses; frames that come earlier are not
%% read. The robot asks it each second until it answers, and every five seconds from then on, since
%% it may be started anew with another version. A server that sends to each client separately
%% forgets silent clients, so the robot sends it a message each second.
%%
%% Motive measures in metres, with the second axis towards the ceiling. A body is known by its
%% streaming ID. The times in a frame show how long ago the cameras were exposed. Cameras without a
%% common clock (USB) do not show it; then `latency_us' counts.
%%
%% Options. `server': the address of Motive's computer. `unicast' (false): if true, no group is
%% joined. `group' ("239.255.42.99"), `port' (1511), `interface' ({@link starl_live_datagrams});
%% `command_port' (1510). `version', as in `{3, 1}': the format is this, whatever the server
%% reports, and a server of version 4 is asked for it. `bodies': the robots of streaming IDs (each
%% robot's own number). `axes' ({1, -3, 2}, {@link starl_live_floor}). `turns': the angle between a
%% robot's front and its body's axis, for robots where they differ. `latency_us' (10000).
-module(starl_live_natnet).
-behaviour(starl_live_positioning).

-export([open/1, hear/2, figures/1, close/1]).
-export([new/1, packet/3, requests/1, figures_of/1]).

-export_type([pure/0, said/0]).

-define(GROUP, {239, 255, 42, 99}).
-define(PORT, 1511).
-define(COMMAND_PORT, 1510).
-define(AXES, {1, -3, 2}).
-define(LATENCY_US, 10000).
%% A frame that says it is older than this does not know.
-define(OLDEST_US, 10000000).
-define(TICK_MS, 1000).
%% The server is asked again after so many ticks.
-define(AGAIN, 5).

-record(pure, {
    %% the format's version, and the one that was asked for
    version :: starl_live_natnet_codec:version() | unknown,
    wanted :: starl_live_natnet_codec:version() | own,
    unicast :: boolean(),
    hz = unknown :: pos_integer() | unknown,
    bodies :: #{integer() => starl:robot_id()},
    axes :: starl_live_floor:axes(),
    turns :: #{starl:robot_id() => float()},
    latency_us :: non_neg_integer(),
    clock :: starl_live_clock:t(),
    frames = starl_live_frames:new() :: starl_live_frames:t(),
    %% the last server that has been spoken of
    server = none :: {Name :: binary(), starl_live_natnet_codec:version()} | none,
    ticks = 0 :: non_neg_integer(),
    figures = #{} :: starl_live_positioning:figures()
}).

-record(natnet, {
    command :: gen_udp:socket() | none,
    data :: gen_udp:socket(),
    server :: {inet:ip4_address(), inet:port_number()} | none,
    pure :: pure()
}).

%% What is said in the log: a server that has been found, or one that is not understood.
-type said() :: {info | error, iolist()}.

-opaque pure() :: #pure{}.

%% -- the source -----------------------------------------------------------------------------

%% @doc Opens the sockets, and asks the server to describe itself.
-spec open(starl_live_positioning:config()) -> {ok, #natnet{}} | {error, iolist()}.
open(Config) ->
    Axes = starl_live_floor:axes(maps:get(axes, Config, ?AXES)),
    case {Axes, version(maps:get(version, Config, {4, 1})), server(Config)} of
        {ok, ok, {ok, Server}} -> opened(Server, data(Config), Config);
        {{error, _} = Error, _, _} -> Error;
        {_, {error, _} = Error, _} -> Error;
        {_, _, {error, _} = Error} -> Error
    end.

version({Major, Minor}) when Major >= 3, Major =< 4, Minor >= 0, Minor < 256 -> ok;
version(Version) ->
    {error,
        io_lib:format("version is that of NatNet, from {3, 0} to {4, 255}, not ~0p", [Version])}.

server(#{server := Address} = Config) ->
    case starl_live_datagrams:address(Address) of
        {ok, At} -> {ok, {At, maps:get(command_port, Config, ?COMMAND_PORT)}};
        {error, _} = Error -> Error
    end;
server(#{unicast := true}) ->
    {error, "a NatNet server that sends by unicast must be asked to: give server, its address"};
server(#{version := _}) ->
    {ok, none};
server(_) ->
    {error, "NatNet needs server, the address of Motive's computer, or else version, like {3, 1}"}.

data(Config) ->
    Port = maps:get(port, Config, ?PORT),
    case Config of
        #{unicast := true} -> starl_live_datagrams:open(Port, #{});
        _ -> starl_live_datagrams:open(Port, maps:merge(#{group => ?GROUP}, Config))
    end.

opened(none, {ok, Data}, Config) ->
    {ok, #natnet{command = none, data = Data, server = none, pure = new(Config)}};
opened(Server, {ok, Data}, Config) ->
    case starl_live_datagrams:open(0, #{}) of
        {ok, Command} ->
            Natnet = #natnet{command = Command, data = Data, server = Server, pure = new(Config)},
            {ok, tick(Natnet)};
        {error, _} = Error ->
            ok = gen_udp:close(Data),
            Error
    end;
opened(_Server, {error, _} = Error, _Config) ->
    Error.

-spec hear(term(), #natnet{}) -> {[starl_live_positioning:sighting()], #natnet{}} | unknown.
hear({timeout, _, natnet}, Natnet) ->
    {[], tick(Natnet)};
hear(Message, #natnet{data = Data, command = Command} = Natnet) ->
    case starl_live_datagrams:hear(Message, Data) of
        unknown when Command =/= none ->
            command(starl_live_datagrams:hear(Message, Command), Natnet);
        {datagram, _From, Packet} ->
            heard(Packet, Natnet);
        nothing ->
            {[], Natnet};
        unknown ->
            unknown
    end.

%% Only the server itself describes the server.
command({datagram, From, Packet}, #natnet{server = {From, _}} = Natnet) -> heard(Packet, Natnet);
command({datagram, _, _}, Natnet) -> {[], Natnet};
command(nothing, Natnet) -> {[], Natnet};
command(unknown, _Natnet) -> unknown.

heard(Packet, #natnet{pure = Pure} = Natnet) ->
    {Sightings, Said, Next} = packet(Packet, erlang:system_time(microsecond), Pure),
    lists:foreach(fun say/1, Said),
    {Sightings, Natnet#natnet{pure = Next}}.

say({Level, Line}) ->
    logger:log(Level, #{what => natnet, text => unicode:characters_to_binary(Line)}).

tick(#natnet{command = Socket, server = {Address, Port}, pure = Pure} = Natnet) ->
    {Packets, Next} = requests(Pure),
    %% A server that cannot be reached now is asked again.
    _ = [gen_udp:send(Socket, Address, Port, Packet) || Packet <- Packets],
    _ = erlang:start_timer(?TICK_MS, self(), natnet),
    Natnet#natnet{pure = Next}.

-spec figures(#natnet{}) -> starl_live_positioning:figures().
figures(#natnet{pure = Pure}) -> figures_of(Pure).

-spec close(#natnet{}) -> ok.
close(#natnet{command = none, data = Data}) ->
    gen_udp:close(Data);
close(#natnet{command = Command, data = Data}) ->
    ok = gen_udp:close(Command),
    gen_udp:close(Data).

%% -- its pure part --------------------------------------------------------------------------

%% @doc Nothing has arrived yet.
-spec new(starl_live_positioning:config()) -> pure().
new(#{participants := Participants, clock := Clock} = Config) ->
    Own = maps:from_list([{Robot, Robot} || Robot <- starl_team:members(Participants)]),
    #pure{
        version = maps:get(version, Config, unknown),
        wanted = maps:get(version, Config, own),
        unicast = maps:get(unicast, Config, false),
        bodies = maps:get(bodies, Config, Own),
        axes = maps:get(axes, Config, ?AXES),
        turns = maps:get(turns, Config, #{}),
        latency_us = maps:get(latency_us, Config, ?LATENCY_US),
        clock = Clock
    }.

%% @doc Its counters.
-spec figures_of(pure()) -> starl_live_positioning:figures().
figures_of(#pure{figures = Figures}) -> Figures.

%% @doc What is to be sent to the server now, once a second.
-spec requests(pure()) -> {[binary()], pure()}.
requests(#pure{ticks = Ticks, wanted = Wanted} = Pure) ->
    Connect = [
        starl_live_natnet_codec:connect(Wanted)
     || Pure#pure.server =:= none orelse Ticks rem ?AGAIN =:= 0
    ],
    Alive = [starl_live_natnet_codec:keep_alive() || Pure#pure.unicast],
    {Connect ++ Alive, Pure#pure{ticks = Ticks + 1}}.

%% @doc The robots that a packet shows, which has arrived at this system time, and what to say.
-spec packet(binary(), ArrivedUs :: integer(), pure()) ->
    {[starl_live_positioning:sighting()], [said()], pure()}.
packet(Packet, Arrived, #pure{version = Version} = Pure) ->
    case starl_live_natnet_codec:decode(Packet, Version) of
        {ok, {frame, Frame}} ->
            {Sightings, Next} = frame(Frame, Arrived, Pure),
            {Sightings, [], Next};
        {ok, {server, Server}} ->
            {Said, Next} = found(Server, Pure),
            {[], Said, Next};
        {ok, other} ->
            {[], [], Pure};
        {error, Reason} ->
            {[], [], count(Reason, Pure)}
    end.

found(
    #{name := Name, version := Version, hz := Hz}, #pure{server = Server, wanted = Wanted} = Pure
) ->
    Known = Pure#pure{server = {Name, Version}, hz = positive(Hz)},
    Said = [said(Name, Version, Wanted) || Server =/= {Name, Version}],
    case Wanted of
        own -> {Said, Known#pure{version = Version}};
        _ -> {Said, Known}
    end.

positive(Hz) when is_integer(Hz), Hz > 0 -> Hz;
positive(_) -> unknown.

said(Name, {Major, Minor}, Wanted) when Major =:= 3; Major =:= 4; Wanted =/= own ->
    {info, io_lib:format("positions come from ~ts, NatNet ~b.~b", [Name, Major, Minor])};
said(Name, {Major, Minor}, own) ->
    {error,
        io_lib:format(
            "~ts speaks NatNet ~b.~b: only versions 3 and 4 are read here. Have Motive stream "
            "version 4.1 or 3.1 (Settings, Streaming), or give version => {4, 1}",
            [Name, Major, Minor]
        )}.

frame(#{number := Number, bodies := Bodies, times := Times}, Arrived, Pure) ->
    {Time, Age} = times(Times, Pure),
    {Poses, Counted} = lists:foldl(fun body/2, {[], Pure}, Bodies),
    Picture = #{
        number => Number, time_us => Time, age_us => Age, poses => lists:reverse(Poses)
    },
    {Order, Shown, Next} = starl_live_frames:picture(Picture, Arrived, Pure#pure.frames),
    Sightings = [
        {Robot, Pose, starl_live_clock:at_us(Taken, Pure#pure.clock)}
     || {Robot, Pose, Taken} <- Shown
    ],
    {Sightings, count(figure(Order), Counted#pure{frames = Next})}.

figure(old) -> old;
figure(_) -> datagrams.

%% When the frame was sent, by the server's clock, and how old it was by then.
times({Exposed, Sent}, #pure{hz = Hz, latency_us = Latency}) when is_integer(Hz), Sent > 0 ->
    case (Sent - Exposed) * 1000000 div Hz of
        Us when Exposed > 0, Us >= 0, Us =< ?OLDEST_US -> {Sent * 1000000 div Hz, Us};
        _ -> {Sent * 1000000 div Hz, Latency}
    end;
times(_, #pure{latency_us = Latency}) ->
    {none, Latency}.

body({Id, {X, Y, Z}, Rotation}, {Poses, #pure{bodies = Bodies, axes = Axes} = Pure}) ->
    Place = {1000.0 * X, 1000.0 * Y, 1000.0 * Z},
    case {Bodies, starl_live_floor:pose(Axes, Place, Rotation)} of
        {#{Id := Robot}, {ok, Pose}} -> {[{Robot, turned(Robot, Pose, Pure)} | Poses], Pure};
        {#{Id := _}, {error, Reason}} -> {Poses, count(Reason, Pure)};
        _ -> {Poses, count(other_bodies, Pure)}
    end;
body(Figure, {Poses, Pure}) ->
    {Poses, count(Figure, Pure)}.

turned(Robot, {X, Y, Heading}, #pure{turns = Turns}) ->
    {X, Y, starl_geometry:normalise(Heading + maps:get(Robot, Turns, 0.0))}.

count(Figure, #pure{figures = Figures} = Pure) ->
    Pure#pure{figures = maps:update_with(Figure, fun(N) -> N + 1 end, 1, Figures)}.
