%% @doc Records the owner of each parking spot. Each robot owns one spot of the graph; robots
%% exchange spots. Pure; lengths are millimetres.
-module(starl_dpp_spot_owners).

-export([new/2, all/1, place/2, exchange/3, on/3]).
-export_type([t/0]).

%% A robot within this many R of its spot is parked: spots have this much room to spare.
-define(PARKED, 0.04).

-record(spots, {
    graph :: starl_dpp_graph:t(),
    owned :: #{starl:robot_id() => starl_dpp_graph:vertex()}
}).
-opaque t() :: #spots{}.

%% @doc The spots in the order of the robots.
-spec new([starl:robot_id()], starl_dpp_graph:t()) -> t().
new(Robots, Graph) ->
    Places = starl_dpp_graph:spots(Graph),
    Numbered = lists:zip(Robots, lists:seq(1, length(Robots))),
    Owned = maps:from_list([{Id, maps:get(N, Places)} || {Id, N} <- Numbered]),
    #spots{graph = Graph, owned = Owned}.

%% @doc Each robot's spot, sorted by robot.
-spec all(t()) -> [{starl:robot_id(), starl_dpp_graph:vertex()}].
all(#spots{owned = Owned}) -> lists:sort(maps:to_list(Owned)).

%% @doc Where a robot's spot is.
-spec place(starl:robot_id(), t()) -> starl_geometry:point().
place(Robot, #spots{graph = Graph, owned = Owned}) ->
    starl_dpp_graph:point(maps:get(Robot, Owned), Graph).

%% @doc Two robots exchange their spots.
-spec exchange(starl:robot_id(), starl:robot_id(), t()) -> t().
exchange(Robot, Owner, #spots{owned = Owned} = Spots) ->
    #{Robot := V, Owner := W} = Owned,
    Spots#spots{owned = Owned#{Robot := W, Owner := V}}.

%% @doc Is the point on the robot's spot?
-spec on(starl_geometry:point(), starl:robot_id(), t()) -> boolean().
on(P, Robot, #spots{graph = Graph} = Spots) ->
    starl_geometry:distance(P, place(Robot, Spots)) < ?PARKED * starl_dpp_graph:radius(Graph).
