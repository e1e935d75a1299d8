%% @doc Declares motion as a block. Every robot has the service, and its contract judges every run, so no
%% application lists this block; it is exercised like the others.
-module(starl_motion_block).
-behaviour(starl_block).

-export([options/0, machines/1, monitors/2, everywhere/0, guarantees/0, contract/0, exercise/0]).

-spec options() -> [starl_options:option()].
options() -> [].

-spec machines(starl_block:options()) -> [].
machines(_Options) -> [].

-spec monitors(starl_block:options(), starl_block:context()) -> [].
monitors(_Options, _Context) -> [].

-spec everywhere() -> [module()].
everywhere() -> [starl_motion_monitor].

-spec guarantees() -> [starl_guarantee:t()].
guarantees() ->
    [
        {line, safety,
            "a robot that drives along a line stays within r(v) of it: L·(ε + δ) + 3s + 3.5 mm, for a "
            "last leg of length L, heading errors up to ε, distance errors up to δ, positions known to "
            "within s (11 mm at 500 mm/s with the default errors; a holonomic robot: 12 mm)", [
                positions, grip
            ]},
        {ends, safety, "it begins and ends a given line within 2 mm along it", [positions, grip]},
        {stops, safety,
            "it stops by itself at the end of its leg, or of the dead-man's time of its velocity, even "
            "if its program crashes", []},
        {arrives, progress, "arrives", [
            positions, grip, devices, ways, prompt, clock_rate, no_restart
        ]}
    ].

-spec contract() -> string().
contract() ->
    "a robot stays within r(v) of its line and arrives, or stands when its time is up; judged in every run".

-spec exercise() -> module().
exercise() -> starl_motion_exercise.
