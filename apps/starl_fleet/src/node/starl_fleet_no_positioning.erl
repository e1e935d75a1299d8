%% @doc The positioning system of a fleet that has none: it never shows anything. An application
%% that asks for no position runs; any other waits.
-module(starl_fleet_no_positioning).
-behaviour(starl_live_positioning).

-export([open/1, hear/2, figures/1, close/1]).

-spec open(starl_live_positioning:config()) -> {ok, nothing}.
open(_Config) -> {ok, nothing}.

-spec hear(term(), nothing) -> unknown.
hear(_Message, nothing) -> unknown.

-spec figures(nothing) -> starl_live_positioning:figures().
figures(nothing) -> #{}.

-spec close(nothing) -> ok.
close(nothing) -> ok.
