%% @doc The OTP application of a robot's computer. Where the environment names a robot (`bin/robot' of
%% a release does), its node starts; elsewhere nothing does.
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
