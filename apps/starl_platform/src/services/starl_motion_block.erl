%% @doc Declares motion as a block. Every robot has the service, and its contract judges every run, so no
%% application lists this block; it is exercised like the others.
-module(starl_motion_block).
-behaviour(starl_block).

-export([options/0, machines/1, monitors/2, everywhere/0, contract/0, exercise/0]).

-spec options() -> [starl_options:option()].
options() -> [].

-spec machines(starl_block:options()) -> [].
machines(_Options) -> [].

-spec monitors(starl_block:options(), starl_block:context()) -> [].
monitors(_Options, _Context) -> [].

-spec everywhere() -> [module()].
everywhere() -> [starl_motion_monitor].

-spec contract() -> string().
contract() ->
    "a robot stays within r(v) of its line and arrives, or stands when its time is up; judged in every run".

-spec exercise() -> module().
exercise() -> starl_motion_exercise.
