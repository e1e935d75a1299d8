%% @doc Finds paths that leave the graph: from anywhere onto it, and straight across it.
%%
%% A robot may drive any straight line that keeps clear of the other robots' reservations and of the
%% walls. Lengths are millimetres.
-module(starl_dpp_route).

-export([space/2, obstacles/1, nearby/1, starts/3, travel/3, smooth/3, legs/2]).
-export_type([view/0]).

-type vertex() :: starl_dpp_graph:vertex().
-type obstacles() :: [starl_dpp_unsafe:obstacle()].
-type view() :: #{
    robot := starl:robot_id(),
    at := starl_geometry:point(),
    heading := float() | none,
    graph := starl_dpp_graph:t(),
    unsafe := starl_dpp_unsafe:t(),
    free := starl_dpp_free:t(),
    turn_mm := float(),
    leg := float()
}.
%% The plan as one standing robot sees it: the robot, its point and heading, the graph, the
%% reservations and the free edges; the price of a turn and the longest leg without paint.

-define(AT, 1.0e-3).
%% A robot this near to a vertex is at it.
-define(TRIES, 6).
-define(JOINTS, 14).
%% Vertices around the robot that a search may begin at.

%% @doc The space in which the robot may search when these robots' reservations do not count.
-spec space([starl:robot_id()], view()) -> starl_dpp_search:space().
space(Ignored, #{graph := Graph, unsafe := Unsafe, turn_mm := TurnMm}) ->
    Own = lists:foldl(fun(Id, Acc) -> Acc bor starl_dpp_unsafe:bit(Id, Unsafe) end, 0, Ignored),
    #{graph => Graph, masks => starl_dpp_unsafe:masks(Unsafe), turn_mm => TurnMm, own => Own}.

%% @doc The obstacles of the robot.
-spec obstacles(view()) -> obstacles().
obstacles(#{robot := Robot, unsafe := Unsafe}) -> starl_dpp_unsafe:others(Robot, Unsafe).

%% @doc The vertices around the robot.
-spec nearby(view()) -> [vertex()].
nearby(#{at := P, graph := Graph}) -> [V || {_, V} <- starl_dpp_graph:joints(P, ?JOINTS, Graph)].

%% @doc The starts of a search: each of the given vertices that the robot can drive to straight,
%% with the cost of doing so.
-spec starts([vertex()], obstacles(), view()) -> [starl_dpp_search:start()].
starts(Vertices, Obstacles, #{at := P, graph := Graph} = View) ->
    [
        start(V, Q, View)
     || V <- Vertices,
        Q <- [starl_dpp_graph:point(V, Graph)],
        starl_geometry:distance(P, Q) < ?AT orelse is_clear({P, Q}, Obstacles, Graph)
    ].

%% @doc The path along vertices with the pen up, cut short where that is safe. Empty when the robot
%% is there.
-spec travel([vertex(), ...], obstacles(), view()) -> [{starl_geometry:point(), up}].
travel(Trail, Obstacles, #{at := P, graph := Graph, leg := Leg}) ->
    Points = [starl_dpp_graph:point(V, Graph) || V <- Trail],
    Way = smooth(distinct([P | Points]), Obstacles, Graph),
    [{Q, up} || Q <- legs(Way, Leg)].

%% @doc Shortens a path: drops points between which a straight line is clear.
-spec smooth([starl_geometry:point(), ...], obstacles(), starl_dpp_graph:t()) ->
    [starl_geometry:point(), ...].
smooth([_] = Points, _Obstacles, _Graph) ->
    Points;
smooth([P | Rest], Obstacles, Graph) ->
    %% The farthest point is tried first, then ones ever nearer by half.
    [P | smooth(farthest(P, Rest, length(Rest), ?TRIES, Obstacles, Graph), Obstacles, Graph)].

%% @doc The points after the first, with more in between so that no leg is longer than `Mm'.
-spec legs([starl_geometry:point(), ...], Mm :: float()) -> [starl_geometry:point()].
legs([_], _Mm) ->
    [];
legs([P, Q | Rest], Mm) ->
    N = max(1, ceil(starl_geometry:distance(P, Q) / Mm)),
    [starl_geometry:interpolate(P, Q, I / N) || I <- lists:seq(1, N - 1)] ++
        [Q | legs([Q | Rest], Mm)].

%%% Internals

start(V, Q, #{at := P, heading := Heading, turn_mm := TurnMm}) ->
    case starl_geometry:distance(P, Q) of
        D when D < ?AT ->
            {0.0, V, Heading};
        D ->
            Out = starl_geometry:heading(P, Q),
            {D + starl_dpp_search:turn(Heading, Out, TurnMm), V, Out}
    end.

distinct([P, Q | Rest]) ->
    case starl_geometry:distance(P, Q) < ?AT of
        true -> distinct([P | Rest]);
        false -> [P | distinct([Q | Rest])]
    end;
distinct(Points) ->
    Points.

farthest(_P, Rest, N, Tries, _Obstacles, _Graph) when N =:= 1; Tries =:= 0 ->
    Rest;
farthest(P, Rest, N, Tries, Obstacles, Graph) ->
    [Q | _] = Left = lists:nthtail(N - 1, Rest),
    case is_clear({P, Q}, Obstacles, Graph) of
        true -> Left;
        false -> farthest(P, Rest, (N + 1) div 2, Tries - 1, Obstacles, Graph)
    end.

is_clear(Line, Obstacles, Graph) ->
    starl_dpp_unsafe:clear(Line, Obstacles) andalso starl_dpp_graph:clear(Line, Graph).
