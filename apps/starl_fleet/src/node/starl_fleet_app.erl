%% @doc The OTP application of a robot's computer. If the environment names a robot, as `bin/robot'
%% of a release does, it starts that robot's node. Otherwise it starts nothing.
-module(starl_fleet_app).
-behaviour(application).

-export([start/2, stop/1]).

-spec start(application:start_type(), []) -> {ok, pid()} | {error, term()}.
start(_Type, []) ->
    case starl_fleet_sup:start_link(starl_fleet_place:here()) of
        {ok, Sup} -> {ok, Sup};
        Otherwise -> {error, Otherwise}
    end.

-spec stop(term()) -> ok.
stop(_State) -> ok.
