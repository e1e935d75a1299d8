%% @doc Computes the area that outlines enclose: whether there is one, its boundary, and its
%% bounding box. A part of the SVG reader, {@link starl_svg}.
-module(starl_svg_area).

-export([encloses/1, closed/1, covers/2, box/1, merge/2, overlap/2]).

-type outline() :: starl_svg_shape:outline().
-type bounds() :: starl_svg_curve:bounds().

%% The share of the frame by which a page background may be smaller.
-define(GIVE, 0.005).

%% @doc Whether an outline encloses something: one straight line, also back and forth, does not.
-spec encloses(outline()) -> boolean().
encloses([{line, _, _}]) -> false;
encloses([{line, A, B}, {line, B, A}]) -> false;
encloses(_Outline) -> true.

%% @doc The outline with the line that closes it, if it is open.
-spec closed(outline()) -> outline().
closed(Outline) ->
    From = starl_svg_curve:start(hd(Outline)),
    case starl_svg_curve:finish(lists:last(Outline)) of
        From -> Outline;
        To -> Outline ++ [{line, To, From}]
    end.

%% @doc Whether an outline is an upright rectangle that covers the frame.
-spec covers(outline(), bounds()) -> boolean().
covers(Outline, {FX0, FY0, FX1, FY1}) ->
    {X0, Y0, X1, Y1} = box([Outline]),
    {GiveX, GiveY} = {?GIVE * (FX1 - FX0), ?GIVE * (FY1 - FY0)},
    X0 =< FX0 + GiveX andalso Y0 =< FY0 + GiveY andalso
        X1 >= FX1 - GiveX andalso Y1 >= FY1 - GiveY andalso
        length(Outline) >= 3 andalso
        lists:all(fun(Curve) -> is_side(Curve, {X0, Y0, X1, Y1}, {GiveX, GiveY}) end, Outline).

%% @doc The box around outlines.
-spec box([outline(), ...]) -> bounds().
box(Outlines) ->
    [First | Rest] = [starl_svg_curve:bounds(Curve) || Outline <- Outlines, Curve <- Outline],
    lists:foldl(fun starl_svg_curve:merge_bounds/2, First, Rest).

%% @doc The box around two boxes, of which one may be missing.
-spec merge(bounds(), bounds() | none) -> bounds().
merge(Box, none) -> Box;
merge(Box, Other) -> starl_svg_curve:merge_bounds(Box, Other).

%% @doc Whether two boxes have points in common.
-spec overlap(bounds(), bounds() | none) -> boolean().
overlap(_Box, none) ->
    false;
overlap({A0, B0, A1, B1}, {C0, D0, C1, D1}) ->
    A0 =< C1 andalso C0 =< A1 andalso B0 =< D1 andalso D0 =< B1.

%%% Internals

%% An upright line from corner to corner, which may be written as a curve.
is_side(Curve, Box, {GiveX, GiveY} = Give) ->
    {X0, Y0, X1, Y1} = starl_svg_curve:bounds(Curve),
    is_corner(starl_svg_curve:start(Curve), Box, Give) andalso
        is_corner(starl_svg_curve:finish(Curve), Box, Give) andalso
        (X1 - X0 =< GiveX orelse Y1 - Y0 =< GiveY).

is_corner({X, Y}, {X0, Y0, X1, Y1}, {GiveX, GiveY}) ->
    min(abs(X - X0), abs(X - X1)) =< GiveX andalso min(abs(Y - Y0), abs(Y - Y1)) =< GiveY.
