%% @doc Finds paths on which waiting robots make room for others, to a parking spot or just aside.
%% It also finds the robots that should take them.
%%
%% On a floor without walls there is nothing but robots. So the outermost robot of any crowd can
%% drive straight outwards, away from all others, to the ring road. Therefore a path to a spot may
%% begin with a straight line to any place on the ring. It may end on any spot whose owner is away.
-module(starl_dpp_evasion).

-export([park/2, aside/2, closes/2, wish/2, in_way/3, outermost/2]).
-export_type([wish/0]).

-type segment() :: starl_geometry:segment().
-type vertex() :: starl_dpp_graph:vertex().
-type view() :: starl_dpp_route:view().
-type travel() :: [{starl_geometry:point(), up}].
-type wish() :: #{
    robot := starl:robot_id(),
    cost_mm := float(),
    way := [segment()],
    blockers := [starl:robot_id()]
}.
%% The work that a robot could do without the waiting robots: the way to the nearest free edge, that
%% edge included, and the robots that stand in it.

-define(BLOCKER_MM, 1000.0).
%% The cost of each blocker that must move, as a distance to drive.

%% @doc A path to the nearest of the given spots.
-spec park([vertex()], view()) -> {ok, vertex(), travel()} | none.
park(Spots, #{graph := Graph} = View) ->
    Wide = starl_dpp_route:nearby(View) ++ starl_dpp_graph:ring(Graph) ++ Spots,
    Wanted = maps:from_list([{V, true} || V <- Spots]),
    to_first(fun(V) -> is_map_key(V, Wanted) end, lists:usort(Wide), View).

%% @doc A path to the nearest vertex that satisfies the predicate, parking spots left out.
-spec aside(fun((vertex()) -> boolean()), view()) -> {ok, vertex(), travel()} | none.
aside(Good, #{graph := Graph} = View) ->
    Spots = maps:from_list([{V, true} || V <- maps:values(starl_dpp_graph:spots(Graph))]),
    Will = fun(V) -> not is_map_key(V, Spots) andalso Good(V) end,
    to_first(Will, starl_dpp_route:nearby(View), View).

%% @doc The free edges that a robot at a vertex would close to others.
-spec closes(vertex(), view()) -> [starl_dpp_graph:edge_id()].
closes(V, #{graph := Graph, free := Free}) ->
    P = starl_dpp_graph:point(V, Graph),
    Mm = 2.0 * starl_dpp_graph:radius(Graph),
    starl_dpp_graph:within({P, P}, {Mm, fun(E) -> starl_dpp_free:has(E, Free) end}, Graph).

%% @doc The robot's wish: its work if the waiting robots, all standing, were not in the way.
-spec wish([starl:robot_id()], view()) -> {ok, wish()} | none.
wish(Waiting, #{free := Free} = View) ->
    #{masks := Masks, own := Own} = Space = starl_dpp_route:space(Waiting, View),
    Others = bnot Own,
    Open = fun(E) -> starl_dpp_array:get(E, Masks) band Others =:= 0 end,
    Visit = fun(V, Cost, _, none) ->
        case [E || {E, _, _, _} <- starl_dpp_free:steps(V, Free), Open(E)] of
            [] -> {continue, infinity, none};
            [E | _] -> {stop, {Cost, V, E}}
        end
    end,
    Starts = starl_dpp_route:starts(starl_dpp_route:nearby(View), [], View),
    case starl_dpp_search:run(Starts, Space, Visit, none) of
        {_, none} -> none;
        {Labels, Found} -> {ok, wished(Found, Labels, Waiting, View)}
    end.

%% @doc Does a robot that holds these segments block this path?
-spec in_way(Held :: [segment()], Way :: [segment()], starl_dpp_graph:t()) -> boolean().
in_way(Held, Way, Graph) ->
    Mm = 2.0 * starl_dpp_graph:radius(Graph) + 1.0,
    lists:any(fun(S) -> lists:any(fun(H) -> starl_geometry:closer(H, S, Mm) end, Held) end, Way).

%% @doc Sorts robots by their distance from the nearest wall: no robot is between the first one and
%% the ring.
-spec outermost([{starl:robot_id(), starl_geometry:point()}], starl_dpp_graph:t()) ->
    [starl:robot_id()].
outermost(Places, Graph) ->
    [Id || {_, Id} <- lists:sort([{starl_dpp_graph:depth(P, Graph), Id} || {Id, P} <- Places])].

%%% Internals

to_first(Will, Vertices, #{robot := Robot} = View) ->
    Obstacles = starl_dpp_route:obstacles(View),
    Starts = starl_dpp_route:starts(Vertices, Obstacles, View),
    Visit = fun(V, _, _, none) ->
        case Will(V) of
            true -> {stop, {ok, V}};
            false -> {continue, infinity, none}
        end
    end,
    case starl_dpp_search:run(Starts, starl_dpp_route:space([Robot], View), Visit, none) of
        {_, none} ->
            none;
        {Labels, {ok, V}} ->
            Trail = starl_dpp_search:trail(V, Labels),
            moved(V, starl_dpp_route:travel(Trail, Obstacles, View))
    end.

moved(_V, []) -> none;
moved(V, Travel) -> {ok, V, Travel}.

wished({Cost, V, E}, Labels, Waiting, #{robot := Robot, at := P} = View) ->
    #{graph := Graph, unsafe := Unsafe} = View,
    Trail = starl_dpp_search:trail(V, Labels),
    Points = [P | [starl_dpp_graph:point(W, Graph) || W <- Trail]],
    Way = [starl_dpp_graph:segment(E, Graph) | lists:zip(lists:droplast(Points), tl(Points))],
    Blockers = [
        Id
     || Id <- Waiting,
        Id =/= Robot,
        in_way(starl_dpp_unsafe:held(Id, Unsafe), Way, Graph)
    ],
    #{
        robot => Robot,
        way => Way,
        blockers => Blockers,
        cost_mm => Cost + ?BLOCKER_MM * length(Blockers)
    }.
