%% @doc The behaviour of an emulator, which puts emulated devices into a simulated world that runs
%% in real time. The devices are the bodies of robots whose drivers are those of real robots. An
%% application lists its emulators in its `.app' file ({@link starl_catalogue}): `{starl_emulators,
%% [starl_create]}'. Devices of several emulators may take part in a run: each robot has the device
%% of its own chassis.
-module(starl_world_emulator).

-export([all/2, all/3]).

-export_type([place/0]).

%% A robot's program runs in this VM, or on a node, which opens a device in this directory as if it were real.
-type place() :: here | {node, file:filename()}.

%% An emulated device for each robot that has a chassis of this name; `undefined' if the emulator does not
%% know the name.
-callback lines(starl_chassis_choice:name(), place()) -> starl_world_chassis:lines() | undefined.

%% @doc The chassis of the robots of a run: an emulated device for each robot that has one by this choice, a
%% chassis of the world for all others. `undefined' if nobody has one.
-spec all(starl_chassis_choice:t(), place()) -> starl_world_chassis:lines() | undefined.
all(Choice, Place) -> all(Choice, Place, starl_catalogue:listed(starl_emulators)).

%% @doc The same with these emulators.
-spec all(starl_chassis_choice:t(), place(), Emulators :: [module()]) ->
    starl_world_chassis:lines() | undefined.
all(Choice, Place, Emulators) ->
    Known = [
        {Name, Lines}
     || Name <- starl_chassis_choice:in_turn(Choice),
        Emulator <- Emulators,
        Lines <- [Emulator:lines(Name, Place)],
        Lines =/= undefined
    ],
    case Known of
        [] -> undefined;
        [_ | _] -> fun(Robot, World) -> line(Robot, World, Choice, Known) end
    end.

line(Robot, World, Choice, Known) ->
    case lists:keyfind(starl_chassis_choice:of_robot(Robot, Choice), 1, Known) of
        {_, Lines} -> Lines(Robot, World);
        false -> {starl_world_chassis, #{world => World}}
    end.
