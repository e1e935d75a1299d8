%% @doc Lines of sight: how far a ray goes, and whether one point can be seen from another. Walls
%% and round bodies are in the way. Lengths are millimetres.
-module(starl_sight).

-export([ray/5, is_clear/4]).

-export_type([disc/0]).

-type disc() :: {starl_geometry:point(), RadiusMm :: float()}.

%% @doc How far a ray from a point in this direction goes before it meets a wall or a disc; `none':
%% farther than `Most'.
-spec ray(starl_geometry:point(), Angle :: float(), Most :: float(), [disc()], starl_walls:t()) ->
    float() | none.
ray({X, Y} = From, Angle, Most, Discs, Walls) ->
    To = {X + Most * math:cos(Angle), Y + Most * math:sin(Angle)},
    case [T || T <- meets({From, To}, Discs, Walls), T =< 1.0] of
        [] -> none;
        Times -> Most * lists:min(Times)
    end.

%% @doc Is the straight line between two points free of walls and discs? A disc around one of the
%% points is not in its way.
-spec is_clear(starl_geometry:point(), starl_geometry:point(), [disc()], starl_walls:t()) ->
    boolean().
is_clear(From, To, Discs, Walls) ->
    Others = [
        Disc
     || {At, R} = Disc <- Discs,
        starl_geometry:distance(At, From) > R,
        starl_geometry:distance(At, To) > R
    ],
    [T || T <- meets({From, To}, Others, Walls), T < 1.0] =:= [].

%% The parts of the way at which the line meets something.
meets({{X0, Y0}, {X1, Y1}} = Line, Discs, Walls) ->
    Ways = {X0, Y0, X1 - X0, Y1 - Y0},
    [T || {_, Wall} <- starl_walls:near(Line, 1.0, Walls), T <- wall(Ways, Wall)] ++
        [T || Disc <- Discs, T <- disc(Ways, Disc)].

%% Along a wall one sees; its end is in the way.
wall({X, Y, DX, DY}, {{AX, AY}, {BX, BY}}) ->
    {WX, WY} = {BX - AX, BY - AY},
    Cross = DX * WY - DY * WX,
    case abs(Cross) < 1.0e-9 of
        true ->
            [];
        false ->
            T = ((AX - X) * WY - (AY - Y) * WX) / Cross,
            S = ((AX - X) * DY - (AY - Y) * DX) / Cross,
            [T || T >= 0.0, S >= 0.0, S =< 1.0]
    end.

disc({X, Y, DX, DY}, {{CX, CY}, R}) ->
    {MX, MY} = {X - CX, Y - CY},
    A = DX * DX + DY * DY,
    B = MX * DX + MY * DY,
    C = MX * MX + MY * MY - R * R,
    Root = B * B - A * C,
    if
        C =< 0.0 -> [0.0];
        A == 0; B >= 0.0; Root =< 0.0 -> [];
        true -> [C / (math:sqrt(Root) - B)]
    end.
