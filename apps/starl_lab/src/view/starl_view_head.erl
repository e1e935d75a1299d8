%% @doc The header of a run for the page: floor, team, contracts, paths, and the faults that the
%% user can apply.
-module(starl_view_head).

-export([rows/2]).

-export_type([kind/0]).

%% `simulation': it can be paused, and anything can be done to it; `live': some things; `recording':
%% nothing.
-type kind() :: simulation | live | recording.

%% The radius of an iRobot Create (mm).
-define(RADIUS_MM, 165).

%% @doc The rows that each page gets first. `extra' is added to the facts.
-spec rows(starl_observer:facts() | starl_trace_message:scenario(), Extra :: map()) ->
    [starl_view_row:row()].
rows(#{app := App, scenario := Scenario, robots := Robots} = Facts, Extra) ->
    #{monitors := Monitors, waypoints := Waypoints, machines := Machines} = Facts,
    Own = #{
        app => App,
        seed => maps:get(seed, Scenario, 0),
        robots => [Id || {Id, _} <- Robots],
        radius => ?RADIUS_MM,
        world => floor_of(Scenario),
        range => range(Scenario),
        limit => maps:get(time, Scenario, 0),
        machines => lists:sort(maps:keys(Machines)),
        contracts => contracts(Monitors),
        spots => [[Id, X, Y] || {Id, {X, Y, _}} <- Robots],
        waypoints => [[Name, X, Y] || {Name, {X, Y}} <- lists:sort(maps:to_list(Waypoints))],
        plan => plan(maps:get(floor, Facts, none)),
        tube => tube(Monitors),
        lines => lines(Monitors)
    },
    [[<<"run">>, maps:merge(Own, Extra)] | faults(Scenario)].

%% Walls, doors, and the rooms' names with a place for each.
plan(#{walls := Walls, doors := Doors, rooms := Rooms}) ->
    #{
        walls => [[[X, Y] || {X, Y} <- Wall] || Wall <- Walls],
        doors => [[X1, Y1, X2, Y2] || {{X1, Y1}, {X2, Y2}} <- Doors],
        rooms => [
            [Name, X, Y]
         || {Name, Room} <- lists:sort(maps:to_list(Rooms)), {X, Y} <- [starl_floor:middle(Room)]
        ]
    };
plan(_None) ->
    null.

floor_of(#{world := {Width, Height}}) -> [Width, Height];
floor_of(_) -> [12000, 12000].

range(#{range := Range}) when is_number(Range) -> Range;
range(_) -> null.

%% Those of an application of its own among them; monitors that only look on are no facts of a run. Crashes break
%% contracts that are named after the machines.
contracts(Monitors) ->
    lists:usort([
        starl_view_row:contract(starl_monitor:name(Module))
     || {Module, _} <- Monitors, Module =/= starl_crash_monitor
    ]).

tube(Monitors) ->
    case [Radius || {_, #{tube_radius := Radius}} <- Monitors] of
        [Radius | _] -> Radius;
        [] -> null
    end.

%% The lines that are to be painted.
lines(Monitors) ->
    [[X1, Y1, X2, Y2] || {_, #{lines := Lines}} <- Monitors, {{X1, Y1}, {X2, Y2}} <- Lines].

faults(Scenario) -> [starl_view_row:fault(0, Fault) || Fault <- maps:get(faults, Scenario, [])].
