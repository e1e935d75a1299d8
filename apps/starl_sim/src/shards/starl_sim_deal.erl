%% @doc Who has which robot: shards go to the sites in turn, robots to the shards, and each shard is
%% told what it needs to begin. How they are dealt is no part of a run's result.
-module(starl_sim_deal).

-export([in_turn/2, owners/2, load/4]).

%% @doc The first so many of the items, over and over.
-spec in_turn([Item, ...], N :: non_neg_integer()) -> [Item].
in_turn(Items, N) ->
    Turns = lists:append(lists:duplicate(N div length(Items) + 1, Items)),
    lists:sublist(Turns, N).

%% @doc Which shard has which robot.
-spec owners([pid(), ...], [{starl:robot_id(), starl:pose()}]) -> #{starl:robot_id() => pid()}.
owners(Shards, Robots) ->
    Ids = [Id || {Id, _} <- Robots],
    maps:from_list(lists:zip(Ids, in_turn(Shards, length(Ids)))).

%% @doc What one of the shards begins with.
-spec load(pid(), [pid()], #{starl:robot_id() => pid()}, starl_sim_plan:t()) ->
    starl_sim_shard:load().
load(Shard, Shards, Owners, #{robots := Robots, crew := Crew, faults := Faults}) ->
    #{
        robots => [R || {Id, _} = R <- Robots, maps:get(Id, Owners) =:= Shard],
        crew => Crew,
        faults => [F || F <- Faults, maps:get(element(1, F), Owners) =:= Shard],
        peers => lists:delete(Shard, Shards),
        owners => Owners,
        sight => [{Id, standing(Pose)} || {Id, Pose} <- Robots],
        running => length(Robots)
    }.

standing({X, Y, Heading}) -> starl_trajectory:standing(0, {X, Y}, Heading).
