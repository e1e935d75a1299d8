%% @doc Lists the services that every robot has, with their configuration, and the tree of its
%% processes. It is the same for every driver.
-module(starl_robot_services).

-export([tree/1, inline/1, parts/1]).

-export_type([t/0, tree/0]).

%% The parts of the robots of a team. `sap': overrides of its configuration; `sap_machine',
%% `motion_machine': other implementations, for tests; `profiles': the profiles of the chassis;
%% `waypoints': the named places; `floor': the floor plan; `exact': the positioning system may show
%% the same pose twice to the bit (only if it has no error). `intensity': the restarts in an hour
%% that each supervisor allows.
-type t() :: #{
    robots := [starl:robot_id()],
    profiles := starl_chassis:profiles(),
    app := {sequential, module(), Args :: term()} | {machine, module(), Config :: map()},
    blocks => [starl_robot_sup:machine()],
    sap => starl_sap:config(),
    sap_machine => module(),
    motion_machine => module(),
    waypoints => #{atom() => starl_geometry:point()},
    floor => starl_floor:t(),
    exact => boolean(),
    solid => boolean(),
    grid => boolean(),
    intensity => pos_integer()
}.

%% A robot's supervision tree without its number and its driver ({@link starl_robot_sup:spec()}).
-type tree() :: #{
    participants := starl_team:t(),
    services := [starl_robot_sup:machine()],
    blocks := [starl_robot_sup:machine()],
    app := term(),
    intensity => pos_integer()
}.

%% @doc The tree of a robot whose machines are processes.
-spec tree(t()) -> tree().
tree(#{robots := Ids, app := App} = Robot) ->
    Tree = #{
        participants => starl_team:new(Ids),
        services => services(Robot),
        blocks => maps:get(blocks, Robot, []),
        app => App
    },
    maps:merge(Tree, maps:with([intensity], Robot)).

%% @doc The machines of a robot that runs inline, and the tree of its remaining processes: a
%% sequential application is always a process.
-spec inline(tree()) -> {tree() | none, starl_robot_machines:inline()}.
inline(#{services := Services, blocks := Blocks, app := App} = Tree) ->
    Machines = maps:from_list([{Name, {M, Config}} || {Name, M, Config} <- Services ++ Blocks]),
    case App of
        {machine, Module, Config} -> {none, Machines#{app => {Module, Config}}};
        {sequential, _, _} -> {Tree#{services := [], blocks := []}, Machines}
    end.

%% @doc The modules of the robot's machines.
-spec parts(tree()) -> #{starl_machine:name() => module()}.
parts(#{services := Services, blocks := Blocks, app := App}) ->
    Machines = maps:from_list([{Name, Module} || {Name, Module, _} <- Services ++ Blocks]),
    Machines#{app => element(2, App)}.

%% The services in start order.
services(#{profiles := Profiles} = Robot) ->
    [
        {sap, maps:get(sap_machine, Robot, starl_sap), maps:get(sap, Robot, #{})},
        {location, starl_location, location(Robot)},
        {motion, maps:get(motion_machine, Robot, starl_motion), motion(Profiles, Robot)}
    ].

motion(Profiles, Robot) -> (maps:with([solid], Robot))#{profiles => Profiles}.

location(#{profiles := [#{position_error_mm := Error} | _]} = Robot) ->
    (maps:with([floor, grid], Robot))#{
        waypoints => maps:get(waypoints, Robot, #{}),
        exact => maps:get(exact, Robot, Error == 0)
    }.
