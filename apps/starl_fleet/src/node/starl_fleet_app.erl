%% @doc The OTP application of a robot's computer. If the environment names a robot, as `bin/robot'
%% of a release does, it starts that robot's node. Otherwise, and where another node of this robot
%% runs, it starts nothing.
-module(starl_fleet_app).
-behaviour(application).

-export([start/2, stop/1]).

-spec start(application:start_type(), []) -> {ok, pid()} | {error, term()}.
start(_Type, []) ->
    case starl_fleet_sup:start_link(alone(starl_fleet_place:here())) of
        {ok, Sup} -> {ok, Sup};
        Otherwise -> {error, Otherwise}
    end.

%% Two nodes with one store would be one robot twice. The second one ends before it opens anything.
alone(none) ->
    none;
alone(#{state := State} = Place) ->
    case starl_fleet_control:is_used(State) of
        false ->
            Place;
        true ->
            Why = "another node of this robot runs, and uses its store; bin/robot stop ends it",
            logger:error(#{what => robot_not_started, why => list_to_binary(Why)}),
            ok = init:stop(1),
            none
    end.

-spec stop(term()) -> ok.
stop(_State) -> ok.
