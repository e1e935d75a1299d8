%% @doc Emulated Creates as the robots of a simulated world in real time.
-module(starl_create).
-behaviour(starl_world_emulator).

-export([lines/2, emulated/2]).

%% A line without a wire is late only if its computer is busy.
-define(JITTER_MS, 5).

%% @doc The chassis of a run's robots, with emulated Creates. A robot on a node drives its Create
%% through a pty, as if it were real, if the program for devices is built; else it uses a pipe, like
%% robots in this VM.
-spec lines(starl_chassis_choice:t(), starl_world_emulator:place()) ->
    starl_world_chassis:lines() | undefined.
lines(Choice, here) ->
    emulated(Choice, pipe);
lines(Choice, {node, Dir}) ->
    case starl_create_program:path() of
        {ok, _} -> emulated(Choice, starl_create_on_pty:in(Dir));
        {error, _} -> emulated(Choice, pipe)
    end.

%% @doc The chassis of a run's robots: an emulated Create with its driver for each robot that has
%% one by this choice. All other robots have a chassis of the world. `undefined' if no robot has an
%% emulated Create.
%%
%% `open' gives the port of an emulated robot, and what the port opens: as a rule, a pipe within the
%% VM or between nodes.
-spec emulated(starl_chassis_choice:t(), Open) -> starl_world_chassis:lines() | undefined when
    Open ::
        pipe | fun((pid(), starl_create_packet:model()) -> {{module(), map()}, Device :: term()}).
emulated(Choice, Open) ->
    Names = starl_chassis_choice:in_turn(Choice),
    case [Name || Name <- Names, Name =:= create orelse Name =:= create_1] of
        [] ->
            undefined;
        _ ->
            fun(Robot, World) ->
                line(starl_chassis_choice:of_robot(Robot, Choice), Robot, World, Open)
            end
    end.

line(create, Robot, World, Open) -> create(2, Robot, World, Open);
line(create_1, Robot, World, Open) -> create(1, Robot, World, Open);
line(_Other, _Robot, World, _Open) -> {starl_world_chassis, #{world => World}}.

create(Model, Robot, World, Open) ->
    Body = {starl_world, World, Robot},
    {ok, Create} = starl_create_emulated:start(#{model => Model, body => Body}),
    {Port, Device} = opened(Open, Create, Model),
    Own = #{model => Model, device => Device, jitter_ms => ?JITTER_MS},
    {starl_create_chassis, #{port => Port, create => Own}}.

opened(pipe, Create, _Model) -> {{starl_create_pipe, #{}}, Create};
opened(Open, Create, Model) -> Open(Create, Model).
