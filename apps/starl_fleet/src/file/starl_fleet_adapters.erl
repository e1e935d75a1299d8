%% @doc Selects the drivers that connect a fleet's robots to the world. It finds the module that
%% drives a chassis, the module that reads a positioning system, and the configuration of each
%% transport.
-module(starl_fleet_adapters).

-export([chassis/0, driver/1, drivers/1, sources/0, source/1]).
-export([transports/0, chassis/2, positioning/3, senses/2, transport/3, node_name/2]).

-export_type([name/0, transport/0]).

%% A name in a table; a file of the user's own, or its module once it is compiled.
-type name() :: atom() | file:filename() | {module, module()}.

%% How packets travel between the robots.
-type transport() :: udp | dist.

%% A chassis of this name, and the module of its driver.
-define(CHASSIS, [
    {none, starl_fleet_no_chassis},
    {create, starl_create_chassis},
    {exec, starl_live_exec}
]).

%% A positioning system of this name, and the module that reads it.
-define(SOURCES, [
    {none, starl_fleet_no_positioning},
    {broadcast, starl_live_broadcast},
    {vicon, starl_live_vicon},
    {natnet, starl_live_natnet}
]).

%% @doc The names of the chassis.
-spec chassis() -> [atom()].
chassis() -> [Name || {Name, _} <- ?CHASSIS].

%% @doc The driver of a chassis.
-spec driver(name()) -> {ok, module()} | {error, unicode:chardata()}.
driver(Name) -> module(Name, ?CHASSIS, "driver for a chassis").

%% @doc The drivers of a fleet's chassis, and what they need: a program speaks JSON.
-spec drivers(starl_fleet_file:t()) -> [module()].
drivers(#{robots := Robots}) ->
    Names = lists:usort([Name || #{chassis := {Name, _}} <- maps:values(Robots)]),
    [Module || {Name, Module} <- ?CHASSIS, lists:member(Name, Names)] ++
        [starl_json:codec() || lists:member(exec, Names)].

%% @doc The names of the positioning systems.
-spec sources() -> [atom()].
sources() -> [Name || {Name, _} <- ?SOURCES].

%% @doc The module that reads a positioning system.
-spec source(name()) -> {ok, module()} | {error, unicode:chardata()}.
source(Name) -> module(Name, ?SOURCES, "reader of a positioning system").

module({module, Module}, _Table, _What) ->
    case code:ensure_loaded(Module) of
        {module, Module} -> {ok, Module};
        {error, _} -> {error, io_lib:format("the module ~ts is not in this release", [Module])}
    end;
%% it is compiled by whoever deploys it
module([_ | _] = _File, _Table, _What) ->
    {ok, starl_fleet_no_chassis};
module(Name, Table, What) ->
    {Name, Module} = lists:keyfind(Name, 1, Table),
    case code:ensure_loaded(Module) of
        {module, Module} ->
            {ok, Module};
        {error, _} ->
            Line = "this StarL has no ~ts ~ts yet; there is ~ts",
            There = [atom_to_list(N) || {N, M} <- Table, code:which(M) =/= non_existing],
            {error, io_lib:format(Line, [What, Name, lists:join(", ", There)])}
    end.

%% @doc A robot's connection to its chassis: a driver with its options.
-spec chassis(starl:robot_id(), starl_fleet_file:t()) -> starl_live_link:adapter().
chassis(Robot, #{robots := Robots}) ->
    #{Robot := #{chassis := {Name, Own}}} = Robots,
    {ok, Module} = driver(Name),
    {Module, Own}.

%% @doc A robot's connection to the positioning system. Anybody who could send it positions could
%% move it. So a broadcast is sealed with the fleet's key, unless the fleet file says `key => none'.
-spec positioning(starl:robot_id(), starl_live_key:t(), starl_fleet_file:t()) ->
    starl_live_link:adapter().
positioning(_Robot, Key, #{positioning := {Name, Own}}) ->
    {ok, Module} = source(Name),
    {Module, sealed(Module, Key, Own)}.

sealed(starl_live_broadcast, _Key, #{key := none} = Own) -> maps:remove(key, Own);
sealed(starl_live_broadcast, Key, Own) -> maps:merge(#{key => Key}, Own);
sealed(_Module, _Key, Own) -> Own.

%% @doc A robot's senses that are not its chassis'.
-spec senses(starl:robot_id(), starl_fleet_file:t()) ->
    #{starl_sense:kind() => starl_live_link:adapter()}.
senses(Robot, #{robots := Robots}) ->
    case Robots of
        #{Robot := #{camera := #{} = Own}} -> #{camera => {starl_live_camera, Own}};
        #{} -> #{}
    end.

%% @doc The names of the transports.
-spec transports() -> [transport(), ...].
transports() -> [udp, dist].

%% @doc A robot's connection to the other robots. Robots of different runs do not hear each other.
-spec transport(Run :: non_neg_integer(), starl_live_key:t(), starl_fleet_file:t()) ->
    starl_live_link:adapter().
transport(Run, Key, #{transport := udp, name := Name, robots := Robots, all := All}) ->
    Peers = maps:map(fun(_, #{address := Address, port := Port}) -> {Address, Port} end, Robots),
    {starl_live_udp, #{fleet => Name, run => Run, key => Key, peers => Peers, all => All}};
transport(Run, _Key, #{transport := dist, name := Name, robots := Robots} = Fleet) ->
    Peers = maps:map(fun(Robot, _) -> node_name(Robot, Fleet) end, Robots),
    {starl_live_dist, #{fleet => Name, run => Run, peers => Peers}}.

%% @doc The name of a robot's node: one for each robot of the fleet file.
-spec node_name(starl:robot_id(), starl_fleet_file:t()) -> node().
node_name(Robot, #{name := Name, robots := Robots}) ->
    #{Robot := #{address := Address}} = Robots,
    list_to_atom(Name ++ "-robot-" ++ integer_to_list(Robot) ++ "@" ++ Address).
