%% @doc Places elements: `transform', the position and size of `svg', `symbol' and `use', and how a
%% viewBox fits into its window (SVG 2, chapter 8). A part of the SVG reader, {@link starl_svg}.
-module(starl_svg_window).

-export([view_box/1, number/4, corner/2, extent/2, extent/3, fit/4, is_cut/1]).
-export([transformed/3, moved/3]).

-type element_() :: starl_svg_xml:element_().
-type matrix() :: starl_svg_transform:matrix().
-type viewport() :: starl_svg_shape:viewport().
-type box() :: {X :: float(), Y :: float(), Width :: float(), Height :: float()}.

%% A smaller viewBox counts as empty, because a division by its size could overflow.
-define(MIN_EXTENT, 1.0e-6).

%% @doc The viewBox of an element.
-spec view_box(element_()) -> box() | none.
view_box(Element) ->
    case starl_svg_xml:attribute(<<"viewBox">>, Element) of
        undefined ->
            none;
        Text ->
            case starl_svg_number:list(Text) of
                {ok, [X, Y, W, H]} when W >= ?MIN_EXTENT, H >= ?MIN_EXTENT -> {X, Y, W, H};
                _ -> starl_svg_error:fail({bad_number, <<"viewBox">>, Text}, Element)
            end
    end.

%% @doc An attribute as a length; see {@link starl_svg_shape:number/4}.
-spec number(element_(), Name :: binary(), Whole :: float(), Default) -> float() | Default.
number(Element, Name, Whole, Default) ->
    case starl_svg_shape:number(Element, Name, Whole, Default) of
        {ok, Number} -> Number;
        {error, Problem} -> starl_svg_error:fail(Problem, Element)
    end.

%% @doc The position of an element.
-spec corner(element_(), viewport()) -> starl_geometry:point().
corner(Element, {W, H}) ->
    {number(Element, <<"x">>, W, 0.0), number(Element, <<"y">>, H, 0.0)}.

%% @doc The size of an element, by default that of its surroundings.
-spec extent(element_(), viewport()) -> viewport().
extent(Element, {W, H}) ->
    {number(Element, <<"width">>, W, W), number(Element, <<"height">>, H, H)}.

%% @doc The size given by a `use' has priority over that of its target.
-spec extent(Use :: element_(), Target :: element_(), viewport()) -> viewport().
extent(Use, Target, {W, H} = Viewport) ->
    {TargetW, TargetH} = extent(Target, Viewport),
    {number(Use, <<"width">>, W, TargetW), number(Use, <<"height">>, H, TargetH)}.

%% @doc The map for the content of a window, and the size to which its percentages refer.
-spec fit(element_(), starl_geometry:point(), viewport(), matrix()) -> {matrix(), viewport()}.
fit(Element, Corner, {W, H} = Extent, Outer) ->
    case view_box(Element) of
        none ->
            {moved(Element, Corner, Outer), Extent};
        {VX, VY, VW, VH} ->
            {Align, {SX, SY}} = scales(Element, W / VW, H / VH),
            {X, Y} = aligned(Align, Corner, {W - VW * SX, H - VH * SY}),
            Map = {SX, 0.0, 0.0, SY, X - VX * SX, Y - VY * SY},
            {multiply(Element, Outer, Map), {VW, VH}}
    end.

%% @doc Whether what sticks out of the window is cut off.
-spec is_cut(element_()) -> boolean().
is_cut(Element) ->
    Overflow = starl_svg_xml:attribute(<<"overflow">>, Element, <<"hidden">>),
    not lists:member(string:trim(Overflow), [<<"visible">>, <<"auto">>]).

%% @doc The map of an element's own coordinates, with that of its parent.
-spec transformed(element_(), viewport(), matrix()) -> matrix().
transformed(Element, Viewport, Matrix) ->
    case starl_svg_xml:attribute(<<"transform">>, Element) of
        undefined ->
            Matrix;
        Text ->
            case starl_svg_transform:parse(Text) of
                {ok, Own} -> about(origin(Element, Viewport), Own, Element, Matrix);
                {error, _} -> bad_transform(Element)
            end
    end.

%% @doc The map followed by a move.
-spec moved(element_(), starl_geometry:point(), matrix()) -> matrix().
moved(Element, {X, Y}, Matrix) ->
    multiply(Element, Matrix, starl_svg_transform:translation(X, Y)).

%%% Internals

%% preserveAspectRatio: where the viewBox goes and how it is scaled.
scales(Element, SX, SY) ->
    Text = starl_svg_xml:attribute(<<"preserveAspectRatio">>, Element, <<>>),
    case string:lexemes(Text, " \t\r\n") of
        [<<"none">> | _] -> {<<"xMidYMid">>, {SX, SY}};
        [Align, <<"slice">>] -> {Align, {max(SX, SY), max(SX, SY)}};
        [Align | _] -> {Align, {min(SX, SY), min(SX, SY)}};
        [] -> {<<"xMidYMid">>, {min(SX, SY), min(SX, SY)}}
    end.

aligned(<<"x", X:3/binary, "Y", Y:3/binary>>, {CornerX, CornerY}, {SpareX, SpareY}) ->
    {CornerX + share(X) * SpareX, CornerY + share(Y) * SpareY};
aligned(_Unknown, Corner, Spare) ->
    aligned(<<"xMidYMid">>, Corner, Spare).

share(<<"Min">>) -> 0.0;
share(<<"Max">>) -> 1.0;
share(_) -> 0.5.

about(none, Own, Element, Matrix) ->
    multiply(Element, Matrix, Own);
about({X, Y}, Own, Element, Matrix) ->
    There = multiply(Element, moved(Element, {X, Y}, Matrix), Own),
    moved(Element, {-X, -Y}, There).

%% transform-origin, of the window; one of the shape's own box is not known.
origin(Element, Viewport) ->
    Text = starl_svg_xml:attribute(<<"transform-origin">>, Element, <<>>),
    origin_of(string:lexemes(Text, " \t\r\n"), Viewport).

origin_of([X], Viewport) ->
    origin_of([X, <<"center">>], Viewport);
origin_of([X, Y | _], {W, H}) ->
    case {starl_svg_number:length(share_text(X), W), starl_svg_number:length(share_text(Y), H)} of
        {{ok, OX}, {ok, OY}} -> {OX, OY};
        _ -> none
    end;
origin_of([], _Viewport) ->
    none.

share_text(<<"center">>) -> <<"50%">>;
share_text(Side) when Side =:= <<"left">>; Side =:= <<"top">> -> <<"0">>;
share_text(Side) when Side =:= <<"right">>; Side =:= <<"bottom">> -> <<"100%">>;
share_text(Text) -> Text.

multiply(Element, Outer, Inner) ->
    case starl_svg_transform:multiply(Outer, Inner) of
        {ok, Matrix} -> Matrix;
        {error, out_of_range} -> bad_transform(Element)
    end.

-spec bad_transform(element_()) -> no_return().
bad_transform(Element) ->
    Text = starl_svg_xml:attribute(<<"transform">>, Element, <<>>),
    starl_svg_error:fail({bad_transform, Text}, Element).
