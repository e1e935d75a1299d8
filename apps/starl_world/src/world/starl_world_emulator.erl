%% @doc The behaviour of an emulator: it puts emulated devices into a simulated world that runs in real time,
%% as the bodies of robots whose drivers are those of real ones. An application lists its emulators in
%% its `.app' file ({@link starl_catalogue}): `{starl_emulators, [starl_create]}'.
-module(starl_world_emulator).

-export([all/2]).

-export_type([place/0]).

%% A robot's program runs in this VM, or on a node, which opens a device in this directory as if it were real.
-type place() :: here | {node, file:filename()}.

%% The chassis of the robots of a run: an emulated device for each robot that has one by this choice, a
%% chassis of the world for all others. `undefined' if nobody has one.
-callback lines(starl_chassis_choice:t(), place()) -> starl_world_chassis:lines() | undefined.

%% @doc The chassis of the robots of a run, by the emulator that knows one of them.
-spec all(starl_chassis_choice:t(), place()) -> starl_world_chassis:lines() | undefined.
all(Choice, Place) ->
    Known = [Emulator:lines(Choice, Place) || Emulator <- starl_catalogue:listed(starl_emulators)],
    case [Lines || Lines <- Known, Lines =/= undefined] of
        [Lines | _] -> Lines;
        [] -> undefined
    end.
