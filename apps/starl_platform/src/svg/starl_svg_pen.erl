%% @doc Follows the commands of a path with a virtual pen and gives outlines (SVG 1.1, section 8.3).
%% A part of the SVG reader, {@link starl_svg}.
-module(starl_svg_pen).

-export([outlines/1]).
-export_type([outline/0]).

%% Curves that follow each other without a gap.
-type outline() :: [starl_svg_curve:t(), ...].
-type point() :: starl_svg_curve:point().

-record(pen, {
    at = {0.0, 0.0} :: point(),
    %% The start of the subpath, to which `Z' returns.
    from = {0.0, 0.0} :: point(),
    %% The last control point, for the smooth commands, and the kind of its curve.
    control = none :: none | {quad | cubic, point()},
    current = [] :: [starl_svg_curve:t()],
    done = [] :: [outline()]
}).

%% @doc The outlines of a path, one per non-empty subpath, in user units.
-spec outlines([starl_svg_path:command()]) -> [outline()].
outlines(Commands) ->
    #pen{done = Done} = lift(lists:foldl(fun command/2, #pen{}, Commands)),
    lists:reverse(Done).

%%% Internals

command({Letter, Numbers}, #pen{at = {X, Y}} = Pen) when Letter >= $a ->
    draw(Letter - $a + $A, Numbers, {X, Y}, Pen);
command({Letter, Numbers}, Pen) ->
    draw(Letter, Numbers, {0.0, 0.0}, Pen).

%% Coordinates are relative to the origin `{OX, OY}'.
draw($M, [X, Y], {OX, OY}, Pen) ->
    To = {OX + X, OY + Y},
    (lift(Pen))#pen{at = To, from = To, control = none};
draw($Z, [], _Origin, #pen{at = At, from = From} = Pen) ->
    lift(add({line, At, From}, From, none, Pen));
draw($L, [X, Y], {OX, OY}, Pen) ->
    line({OX + X, OY + Y}, Pen);
draw($H, [X], {OX, _OY}, #pen{at = {_, AtY}} = Pen) ->
    line({OX + X, AtY}, Pen);
draw($V, [Y], {_OX, OY}, #pen{at = {AtX, _}} = Pen) ->
    line({AtX, OY + Y}, Pen);
draw($C, [X1, Y1, X2, Y2, X, Y], {OX, OY}, Pen) ->
    cubic({OX + X1, OY + Y1}, {OX + X2, OY + Y2}, {OX + X, OY + Y}, Pen);
draw($S, [X2, Y2, X, Y], {OX, OY}, Pen) ->
    cubic(reflected(cubic, Pen), {OX + X2, OY + Y2}, {OX + X, OY + Y}, Pen);
draw($Q, [X1, Y1, X, Y], {OX, OY}, Pen) ->
    quad({OX + X1, OY + Y1}, {OX + X, OY + Y}, Pen);
draw($T, [X, Y], {OX, OY}, Pen) ->
    quad(reflected(quad, Pen), {OX + X, OY + Y}, Pen);
draw($A, [RX, RY, Degrees, Large, Sweep, X, Y], {OX, OY}, #pen{at = At} = Pen) ->
    To = {OX + X, OY + Y},
    Arc = starl_svg_curve:arc(At, {RX, RY}, Degrees, Large == 1.0, Sweep == 1.0, To),
    add(Arc, To, none, Pen).

line(To, #pen{at = At} = Pen) ->
    add({line, At, To}, To, none, Pen).

quad(C, To, #pen{at = At} = Pen) ->
    add({quad, At, C, To}, To, {quad, C}, Pen).

cubic(C1, C2, To, #pen{at = At} = Pen) ->
    add({cubic, At, C1, C2, To}, To, {cubic, C2}, Pen).

%% The last control point reflected in the pen's position; after another kind of command the
%% position itself.
reflected(Kind, #pen{at = {X, Y}, control = {Kind, {CX, CY}}}) -> {2.0 * X - CX, 2.0 * Y - CY};
reflected(_Kind, #pen{at = At}) -> At.

add(Curve, To, Control, #pen{current = Current} = Pen) ->
    Pen#pen{at = To, control = Control, current = [Curve | Current]}.

%% Ends the subpath.
lift(#pen{current = []} = Pen) ->
    Pen;
lift(#pen{current = Current, done = Done} = Pen) ->
    Pen#pen{current = [], done = [lists:reverse(Current) | Done]}.
