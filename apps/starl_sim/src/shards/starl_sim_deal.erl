%% @doc Assigns robots and shards: shards go to the sites in turn, robots to the shards, and each
%% shard gets its initial load. The assignment does not change a run's result.
-module(starl_sim_deal).

-export([in_turn/2, owners/2, load/4]).

%% @doc The first `N' items of a list that repeats without end.
-spec in_turn([Item, ...], N :: non_neg_integer()) -> [Item].
in_turn(Items, N) ->
    Turns = lists:append(lists:duplicate(N div length(Items) + 1, Items)),
    lists:sublist(Turns, N).

%% @doc The shard of each robot.
-spec owners([pid(), ...], [{starl:robot_id(), starl:pose()}]) -> #{starl:robot_id() => pid()}.
owners(Shards, Robots) ->
    Ids = [Id || {Id, _} <- Robots],
    maps:from_list(lists:zip(Ids, in_turn(Shards, length(Ids)))).

%% @doc The initial load of one shard.
-spec load(pid(), [pid()], #{starl:robot_id() => pid()}, starl_sim_plan:t()) ->
    starl_sim_shard:load().
load(Shard, Shards, Owners, #{robots := Robots, crew := Crew, faults := Faults} = Plan) ->
    Load = #{
        robots => [R || {Id, _} = R <- Robots, maps:get(Id, Owners) =:= Shard],
        crew => Crew,
        faults => [F || F <- Faults, maps:get(element(1, F), Owners) =:= Shard],
        peers => lists:delete(Shard, Shards),
        owners => Owners,
        sight => [{Id, standing(Pose)} || {Id, Pose} <- Robots],
        running => length(Robots)
    },
    case Plan of
        #{from := From} -> from(From, Load);
        #{} -> Load
    end.

%% Faults that have struck before are in the robots' states.
from(#{at_us := At} = From, #{faults := Faults} = Load) ->
    Load#{
        from => From,
        faults := [Fault || Fault <- Faults, element(2, Fault) >= At],
        sight := starl_sim_start:pieces(From),
        running := starl_sim_start:running(From)
    }.

standing({X, Y, Heading}) -> starl_trajectory:standing(0, {X, Y}, Heading).
