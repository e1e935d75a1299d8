%% @doc The live set-up of a run on this computer: its clock, its world, its transport, and each
%% robot's start parameters and store.
-module(starl_world_setup).

-export([open/3, robot/2, with_links/2, prepare_store/2]).
-export([transports/0, transport/3, line/3]).

-export_type([t/0, name/0, transport/0]).

%% The name of a transport: within one VM, by Erlang distribution, by UDP.
-type name() :: local | dist | udp.

-record(transport, {
    name :: name(),
    common :: map(),
    %% of UDP: the address of each robot
    ports = #{} :: #{starl:robot_id() => {inet:ip_address(), inet:port_number()}}
}).

-opaque transport() :: #transport{}.

-define(COPY, ".earlier").
-define(SPREAD_MS, 25).
-define(LOOPBACK, {127, 0, 0, 1}).
-define(PORTS, {10240, 32767}).

%% `line': the line of each robot to the others.
-type t() :: #{
    plan := starl_run_plan:t(),
    clock := starl_live_clock:t(),
    world := pid(),
    line := fun((starl:robot_id()) -> starl_live_link:adapter()),
    options := #{dir := file:filename(), atom() => term()}
}.

%% @doc Starts the clock and the world of a run; the world is linked to the calling process. `Nodes': the
%% robots' nodes, if they have some.
-spec open(starl_run_plan:t(), Nodes :: #{starl:robot_id() => node()}, starl_world_run:options()) ->
    t().
open(#{robots := Poses, world := Sim} = Plan, Nodes, Options) ->
    Speed = maps:get(speed, Options, 1),
    Epoch = maps:get(epoch_us, Options, erlang:system_time(microsecond)),
    Clock = starl_live_clock:new(Epoch, Speed),
    Known = maps:with([rate_hz, whole_mm, arena, observe, facts], Options),
    {ok, World} = starl_world:start_link(Known#{plan => Plan, clock => Clock}),
    Radio = (maps:with([air], Options))#{sim => Sim, speed => Speed},
    Transport = transport(maps:get(transport, Options, local), [Id || {Id, _} <- Poses], Radio),
    #{
        plan => Plan,
        clock => Clock,
        world => World,
        line => fun(Id) -> line(Id, Nodes, Transport) end,
        options => Options
    }.

%% -- what a robot starts with ---------------------------------------------------------------

%% @doc The start parameters of a robot. A robot on a node of its own records its facts there, too,
%% and reports reloads to the calling process. The robot has never run: its store is commissioned. If
%% that fails, the robot reports it when it opens its store.
-spec robot(starl:robot_id(), t()) -> starl_live_robot:spec().
robot(Id, #{plan := Plan, clock := Clock, world := World, line := Line, options := Options}) ->
    #{tree := Tree, world := #{profiles := Profiles, seed := Seed}} = Plan,
    #{dir := Dir} = Options,
    Own = filename:join(Dir, "robot-" ++ integer_to_list(Id)),
    _ = starl_live_store:commission(Own),
    maps:merge(on_node(Clock, Options), #{
        robot => Id,
        tree => Tree,
        team_seed => Seed,
        profile => starl_chassis:of_robot(Id, Profiles),
        clock => Clock,
        dir => Own,
        transport => Line(Id),
        positioning => {starl_world_positioning, (maps:with([placing], Plan))#{world => World}},
        chassis => chassis(Id, World, Options),
        sink => World,
        packets => maps:get(packets, Options, false)
    }).

chassis(Id, World, #{chassis := Lines}) -> Lines(Id, World);
chassis(_Id, World, #{}) -> {starl_world_chassis, #{world => World}}.

on_node(Clock, #{transport := Name} = Options) when Name =/= local ->
    Own = #{reporter => self(), record => true, metrics => maps:get(metrics, Options, none)},
    case Options of
        #{recorder := {Module, Recorder}, facts := Facts} ->
            Live = starl_live_clock:live_facts(Facts, Clock),
            Own#{recorder => {Module, Recorder#{facts => Live}}};
        #{} ->
            Own
    end;
on_node(_Clock, _Options) ->
    #{}.

%% @doc The same robot with other link conditions from its start on. A later change could come too
%% late for its first packets.
-spec with_links(starl_live_conditions:settings(), starl_live_robot:spec()) -> starl_live_robot:spec().
with_links(Air, #{transport := {Module, #{air := Before} = Line}} = Spec) ->
    Spec#{transport := {Module, Line#{air := maps:merge(Before, Air)}}}.

%% @doc Prepares the store of a robot that is about to start. A lost store stands for a replaced card,
%% one that is set back for a restored image. The record of the robot's facts lies in the same
%% directory and stays: it is a witness, no part of the robot.
%%
%% The store is copied before each start. Setting it back puts that copy in its place, so the last
%% start and everything since are undone. Before the first start there was no store: then it is lost.
%% (The mark that the store was commissioned is written once, and is not copied.)
-spec prepare_store(starl_world_faults:store(), #{dir := file:filename(), atom() => term()}) -> ok.
prepare_store(kept, #{dir := Dir}) ->
    ok = emptied(Dir ++ ?COPY),
    copied(Dir, Dir ++ ?COPY);
prepare_store(lost, #{dir := Dir}) ->
    ok = emptied(Dir),
    emptied(Dir ++ ?COPY);
prepare_store(set_back, #{dir := Dir}) ->
    ok = emptied(Dir),
    copied(Dir ++ ?COPY, Dir).

emptied(Dir) ->
    lists:foreach(fun(Name) -> ok = file:delete(filename:join(Dir, Name)) end, files(Dir)).

copied(From, To) ->
    ok = filelib:ensure_path(To),
    Copy = fun(Name) -> {ok, _} = file:copy(filename:join(From, Name), filename:join(To, Name)) end,
    lists:foreach(Copy, files(From)).

files(Dir) ->
    [
        Name
     || Name <- filelib:wildcard("*", Dir),
        filelib:is_regular(filename:join(Dir, Name)),
        not starl_live_record:is_record(Name),
        not starl_live_store:is_mark(Name)
    ].

%% -- the line between robots ----------------------------------------------------------------

%% @doc The transports between nodes, and how packets travel by them.
-spec transports() -> [{name(), Text :: string()}, ...].
transports() ->
    [{dist, "Erlang distribution"}, {udp, "sealed datagrams, as between real robots"}].

%% @doc A transport for these robots, with the radio of a scenario. Its time passes this much faster
%% than real time, so the delays of packets are shorter. `air': other air than the scenario's.
-spec transport(name(), [starl:robot_id()], #{
    sim := starl_sim_world:t(), speed := number(), air => starl_live_conditions:settings()
}) -> transport().
transport(Name, Robots, #{sim := Sim, speed := Speed} = Options) ->
    #{loss := Loss, duplicate := Duplicate, delay_us := {Least, Most}} = Sim,
    <<Run:64>> = crypto:strong_rand_bytes(8),
    Common = #{
        fleet => "cluster",
        run => Run,
        air => maps:merge(
            #{seed => maps:get(seed, Sim)},
            maps:get(air, Options, #{
                loss => Loss,
                duplicates => Duplicate,
                delay_ms => {round(Least / 1000 / Speed), round(Most / 1000 / Speed)}
            })
        ),
        %% answers to a packet for all wait for a shorter time, too
        spread_ms => round(min(?SPREAD_MS, length(Robots) div 2) / Speed)
    },
    sockets(Name, Robots, #transport{name = Name, common = Common}).

sockets(udp, Robots, #transport{common = Common} = Transport) ->
    Addresses = [{?LOOPBACK, Port} || Port <- free_ports(length(Robots))],
    Transport#transport{
        common = Common#{key => starl_live_key:new()},
        ports = maps:from_list(lists:zip(Robots, Addresses))
    };
sockets(_Name, _Robots, Transport) ->
    Transport.

%% These are out of the range from which computers take ports for anybody, since a robot that is started anew
%% needs its port again. Another cluster may take one in the moment before the robot does: then its
%% start fails with one line.
free_ports(Number) ->
    Sockets = free_ports(Number, first(Number), []),
    Ports = [Port || {Port, _Socket} <- Sockets],
    ok = lists:foreach(fun({_, Socket}) -> ok = gen_udp:close(Socket) end, Sockets),
    Ports.

first(Number) ->
    {Least, Most} = ?PORTS,
    Least + rand:uniform(max(1, Most - Least - 2 * Number)).

%% All are open until all are found: so none is found twice.
free_ports(0, _Port, Sockets) ->
    Sockets;
free_ports(Number, Port, Sockets) ->
    case gen_udp:open(Port) of
        {ok, Socket} -> free_ports(Number - 1, Port + 1, [{Port, Socket} | Sockets]);
        {error, _} -> free_ports(Number, Port + 1, Sockets)
    end.

%% @doc The line of a robot; `Nodes' are the robots' nodes.
-spec line(starl:robot_id(), #{starl:robot_id() => node()}, transport()) -> starl_live_link:adapter().
line(Robot, Nodes, #transport{name = Name, common = #{air := Air} = Common, ports = Ports}) ->
    %% each robot has a chance of its own
    #{seed := Seed} = Air,
    Own = Common#{air := Air#{seed := erlang:phash2({Seed, Robot})}},
    case Name of
        local -> {starl_live_local, Own};
        dist -> {starl_live_dist, Own#{peers => Nodes}};
        udp -> {starl_live_udp, Own#{peers => Ports}}
    end.
