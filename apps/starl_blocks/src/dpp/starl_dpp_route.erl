%% @doc Ways off the graph: from anywhere onto it, and straight across instead of along it.
%%
%% The floor has no fixed obstacles, so any straight line that keeps clear of the other robots'
%% reservations may be driven.
-module(starl_dpp_route).

-export([starts/5, smooth/2, legs/2]).

-type point() :: starl_geometry:point().
-type obstacles() :: [starl_dpp_unsafe:obstacle()].

-define(AT, 1.0e-3).
%% A robot this near to a vertex is at it.
-define(TRIES, 6).

%% @doc Where a search from a point can begin: each of the given vertices that can be driven to
%% straight, with the cost of doing so.
-spec starts(point(), float() | none, [starl_dpp_graph:vertex()], obstacles(), Space) ->
    [starl_dpp_search:start()] when Space :: starl_dpp_search:space().
starts(P, Heading, Vertices, Obstacles, #{graph := Graph, turn_mm := TurnMm}) ->
    [start(P, Heading, V, Q, TurnMm)
     || V <- Vertices, Q <- [starl_dpp_graph:point(V, Graph)],
        starl_geometry:distance(P, Q) < ?AT orelse starl_dpp_unsafe:clear({P, Q}, Obstacles)].

%% @doc Leaves out points of a way where a straight line will do.
-spec smooth([point(), ...], obstacles()) -> [point(), ...].
smooth([_] = Points, _Obstacles) ->
    Points;
smooth([P | Rest], Obstacles) ->
    %% The farthest point is tried first, then ones ever nearer by half.
    [Q | _] = Left = farthest(P, Rest, length(Rest), ?TRIES, Obstacles),
    case smooth(Left, Obstacles) of
        [Q | More] when P =:= Q -> [P | More];
        Way -> [P | Way]
    end.

%% @doc The points after the first, with more in between so that no leg is longer than `Mm'.
-spec legs([point(), ...], Mm :: float()) -> [point()].
legs([_], _Mm) ->
    [];
legs([P, Q | Rest], Mm) ->
    N = max(1, ceil(starl_geometry:distance(P, Q) / Mm)),
    [starl_geometry:interpolate(P, Q, I / N) || I <- lists:seq(1, N - 1)]
        ++ [Q | legs([Q | Rest], Mm)].

%%% Internals

start(P, Heading, V, Q, TurnMm) ->
    case starl_geometry:distance(P, Q) of
        D when D < ?AT ->
            {0.0, V, Heading};
        D ->
            Out = starl_geometry:heading(P, Q),
            {D + starl_dpp_search:turn(Heading, Out, TurnMm), V, Out}
    end.

farthest(_P, Rest, 1, _Tries, _Obstacles) ->
    Rest;
farthest(_P, Rest, _N, 0, _Obstacles) ->
    Rest;
farthest(P, Rest, N, Tries, Obstacles) ->
    [Q | _] = Left = lists:nthtail(N - 1, Rest),
    case starl_dpp_unsafe:clear({P, Q}, Obstacles) of
        true -> Left;
        false -> farthest(P, Rest, (N + 1) div 2, Tries - 1, Obstacles)
    end.
