%% The search on the floor of its tests.
-module(starl_search_floor).
-behaviour(starl_scene).
-export([options/0, scene/1, report/2]).

options() -> starl_search:options().

scene(Context) -> starl_search:scene(Context#{floor := starl_search_tests:floor()}).

report(Scene, Outcome) -> starl_search:report(Scene, Outcome).
