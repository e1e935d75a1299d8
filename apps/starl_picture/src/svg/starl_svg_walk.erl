%% @doc Walks through a document with resolved styles ({@link starl_svg_cascade}) and collects the
%% outlines of visible shapes, in the units of the root element. It also reports what it leaves out.
%% A part of the SVG reader, {@link starl_svg}.
%%
%% It draws shapes outside of `defs', `symbol', `clipPath', `mask', `marker' and `pattern', and
%% those that a `use' repeats. A stroke counts as its middle line; a fill without a stroke counts as
%% its boundary, with the edge that a window cuts. A line without length counts if its ends are
%% round or square: a dot. Two things are left out: a page background, which is a filled rectangle
%% without a stroke that covers the frame; and a fill in the page's colour with nothing beneath.
-module(starl_svg_walk).

-export([drawn/3, parts/3]).
-export_type([shape/0, part/0, left_out/0]).

%% An outline and the windows through which it is seen; or the edges that the windows give to an
%% area of these outlines.
-type shape() ::
    {line, starl_svg_shape:outline(), [starl_svg_clip:t()]}
    | {edges, [starl_svg_shape:outline(), ...], [starl_svg_clip:t(), ...]}.
%% Numbers of texts, images, markers, clipping paths that are no shapes (and masks), and
%% page backgrounds; and of shapes without anything to see.
-type left_out() :: #{
    texts := non_neg_integer(),
    images := non_neg_integer(),
    markers := non_neg_integer(),
    clips := non_neg_integer(),
    backgrounds := non_neg_integer(),
    unseen := non_neg_integer()
}.

%% A shape that can be seen, with its elements, its own first and the root last: its outlines,
%% whether its inside is painted, and the width of its line, 0.0 without one.
-type part() :: #{
    elements := [element_(), ...],
    outlines := [starl_svg_shape:outline(), ...],
    is_filled := boolean(),
    line := float()
}.

-type element_() :: starl_svg_xml:element_().
-type frame() :: starl_svg_curve:bounds() | none.

-record(context, {
    matrix :: starl_svg_transform:matrix(),
    viewport :: starl_svg_shape:viewport(),
    paint :: starl_svg_paint:t(),
    %% The elements around, the innermost first.
    elements = [] :: [element_()],
    clips = [] :: [starl_svg_clip:t()],
    uses = 0 :: non_neg_integer()
}).

-record(walk, {
    ids :: #{binary() => element_()},
    frame :: frame(),
    %% The colour of the page: that of its background, or white.
    page = {rgb, 255, 255, 255} :: starl_svg_colour:paint(),
    %% The box around all that has been drawn.
    box = none :: frame(),
    %% The numbers of curves and elements that may still follow.
    curves :: non_neg_integer(),
    visits :: non_neg_integer(),
    shapes = [] :: [shape()],
    parts = [] :: [part()],
    left_out :: left_out()
}).

%% The size that a browser assumes for a picture without a size.
-define(DEFAULT_VIEWPORT, {300.0, 150.0}).
-define(MAX_USES, 32).
-define(MAX_VISITS, 50_000).
%% The namespace by which browsers know HTML.
-define(XHTML, <<"http://www.w3.org/1999/xhtml">>).
-define(MARKERS, [<<"marker-start">>, <<"marker-mid">>, <<"marker-end">>]).
-define(NOTHING, #{
    texts => 0, images => 0, markers => 0, clips => 0, backgrounds => 0, unseen => 0
}).

%% @doc The shapes to draw, in the order of the document, and what is left out. Throws
%% `{starl_svg, Problem}'.
-spec drawn(element_(), frame(), Max :: pos_integer()) -> {[shape()], left_out()}.
drawn(Root, Frame, Max) ->
    Walk = walk(Root, Frame, Max),
    {lists:reverse(Walk#walk.shapes), Walk#walk.left_out}.

%% @doc The same shapes, whole, with the elements that they come from. Throws
%% `{starl_svg, Problem}'.
-spec parts(element_(), frame(), Max :: pos_integer()) -> [part()].
parts(Root, Frame, Max) -> lists:reverse((walk(Root, Frame, Max))#walk.parts).

%%% Internals

walk(Root, Frame, Max) ->
    Walk0 = #walk{
        ids = ids(Root, #{}),
        frame = Frame,
        curves = Max,
        visits = ?MAX_VISITS + Max,
        left_out = ?NOTHING
    },
    Context = #context{
        matrix = starl_svg_transform:identity(),
        viewport = viewport(Frame),
        paint = starl_svg_paint:initial()
    },
    visit(Root, Context, Walk0, fun group/3).

ids(Element, Ids0) ->
    Ids =
        case starl_svg_xml:attribute(<<"id">>, Element) of
            undefined -> Ids0;
            Id when is_map_key(Id, Ids0) -> Ids0;
            Id -> Ids0#{Id => Element}
        end,
    lists:foldl(fun ids/2, Ids, starl_svg_xml:children(Element)).

viewport(none) -> ?DEFAULT_VIEWPORT;
viewport({X0, Y0, X1, Y1}) -> {X1 - X0, Y1 - Y0}.

%% Counts an element, then lets `Draw' draw it unless it is not displayed.
visit(_Element, _Context, #walk{visits = 0}, _Draw) ->
    starl_svg_error:fail(too_complex);
visit(Element, Context0, #walk{visits = Visits} = Walk0, Draw) ->
    Walk = Walk0#walk{visits = Visits - 1},
    case starl_svg_paint:is_displayed(Element) of
        true ->
            Paint = starl_svg_paint:inherit(Element, Context0#context.paint),
            Matrix = starl_svg_window:transformed(
                Element, Context0#context.viewport, Context0#context.matrix
            ),
            Elements = [Element | Context0#context.elements],
            Context = Context0#context{paint = Paint, matrix = Matrix, elements = Elements},
            clipped(Element, Context, Walk, Draw);
        false ->
            Walk
    end.

clipped(Element, #context{clips = Clips, matrix = Matrix} = Context, Walk, Draw) ->
    case clips(Element, Matrix, Walk#walk.ids) of
        {ok, More} -> Draw(Element, Context#context{clips = More ++ Clips}, Walk);
        empty -> Walk;
        unknown -> Draw(Element, Context, left_out(clips, Walk))
    end.

%% The windows of an element. No browser follows one that refers to itself.
clips(Element, Matrix, Ids) ->
    case {reference(<<"clip-path">>, Element), reference(<<"mask">>, Element)} of
        {none, none} ->
            by_function(starl_svg_xml:attribute(<<"clip-path">>, Element, <<>>));
        {none, Mask} when is_map_key(Mask, Ids) -> unknown;
        {Id, none} when is_map_key(Id, Ids) ->
            of_path(maps:get(Id, Ids), Matrix, maps:remove(Id, Ids));
        {Id, _} when is_map_key(Id, Ids) -> unknown;
        {_, _} ->
            {ok, []}
    end.

%% A `clipPath' may be cut itself.
of_path(Path, Matrix, Ids) ->
    case {starl_svg_clip:of_path(Path, Matrix, Ids), clips(Path, Matrix, Ids)} of
        {none, _} -> {ok, []};
        {Own, Around} when Own =:= empty; Around =:= empty -> empty;
        {{ok, Clip}, {ok, Clips}} -> {ok, [Clip | Clips]};
        {_, _} -> unknown
    end.

%% CSS has windows without an element of their own.
by_function(<<>>) ->
    {ok, []};
by_function(Text) ->
    Names = <<"^\\s*(circle|ellipse|inset|polygon|path|rect|shape|xywh)\\(">>,
    case re:run(Text, Names, [caseless, {capture, none}]) of
        match -> unknown;
        nomatch -> {ok, []}
    end.

%% The identifier in `url(#ID)'.
reference(Name, Element) ->
    case starl_svg_colour:paint(starl_svg_xml:attribute(Name, Element, <<"none">>)) of
        {ok, {server, Id, _}} -> Id;
        _ -> none
    end.

left_out(What, #walk{left_out = Before} = Walk) ->
    Walk#walk{left_out = maps:update_with(What, fun(N) -> N + 1 end, Before)}.

group(Element, Context, Walk) ->
    lists:foldl(
        fun(Child, Acc) -> child(starl_svg_xml:name(Child), Child, Context, Acc) end,
        Walk,
        starl_svg_xml:children(Element)
    ).

child(Name, Element, Context, Walk) ->
    case drawer(Name) of
        none -> Walk;
        Draw -> visit(Element, Context, Walk, Draw)
    end.

drawer(<<"g">>) ->
    fun group/3;
drawer(<<"a">>) ->
    fun group/3;
drawer(<<"switch">>) ->
    fun switch/3;
drawer(<<"svg">>) ->
    fun nested/3;
drawer(<<"use">>) ->
    fun use/3;
drawer(<<"text">>) ->
    fun(_Element, Context, Walk) -> text(is_seen(Context, Walk), Walk) end;
drawer(<<"foreignObject">>) ->
    fun(Element, Context, Walk) -> text(has_area(Element, Context), Walk) end;
drawer(<<"image">>) ->
    fun(Element, Context, Walk) -> image(has_area(Element, Context), Walk) end;
drawer(Name) ->
    case lists:member(Name, starl_svg_shape:names()) of
        true -> fun shape/3;
        false -> none
    end.

text(true, Walk) -> left_out(texts, Walk);
text(false, Walk) -> Walk.

image(true, Walk) -> left_out(images, Walk);
image(false, Walk) -> Walk.

is_seen(#context{paint = Paint}, Walk) ->
    seen(Paint, Walk) =/= #{fill => none, stroke => none}.

seen(Paint, #walk{ids = Ids}) ->
    starl_svg_paint:seen(Paint, fun(Id) -> is_map_key(Id, Ids) end).

has_area(Element, #context{paint = Paint, viewport = Viewport}) ->
    {W, H} = starl_svg_window:extent(Element, Viewport),
    W > 0.0 andalso H > 0.0 andalso starl_svg_paint:is_visible(Paint).

%% Only the first child for which this program is good enough.
switch(Element, Context, Walk) ->
    case lists:dropwhile(fun is_refused/1, starl_svg_xml:children(Element)) of
        [] -> Walk;
        [First | _] -> child(starl_svg_xml:name(First), First, Context, Walk)
    end.

%% Extensions are not known, but for the one that every browser has; the language is English.
is_refused(Child) ->
    Extensions = starl_svg_xml:attribute(<<"requiredExtensions">>, Child, ?XHTML),
    Languages = starl_svg_xml:attribute(<<"systemLanguage">>, Child, <<"en">>),
    Extensions =/= ?XHTML orelse
        nomatch =:= re:run(Languages, <<"(^|,)\\s*en\\s*(-|,|$)">>, [caseless]).

%%% Shapes

shape(Element, #context{viewport = Viewport, paint = Paint} = Context, Walk) ->
    case starl_svg_shape:outlines(Element, Viewport, Walk#walk.curves) of
        {ok, Outlines} ->
            Seen = seen(Paint, Walk),
            Placed = placed(Outlines, Context),
            shown(Placed, Seen, Context, part(Placed, Seen, Context, marked(Element, Walk)));
        {error, too_many} ->
            starl_svg_error:fail(too_many_shapes);
        {error, Problem} ->
            starl_svg_error:fail(Problem, Element)
    end.

part([], _Seen, _Context, Walk) ->
    Walk;
part(_Outlines, #{fill := none, stroke := none}, _Context, Walk) ->
    Walk;
part(Outlines, #{fill := Fill, stroke := Stroke}, Context, #walk{parts = Parts} = Walk) ->
    #context{elements = Elements, paint = Paint, matrix = Matrix} = Context,
    Part = #{
        elements => Elements,
        outlines => Outlines,
        is_filled => Fill =/= none,
        line => line(Stroke, starl_svg_paint:stroke_width(Paint), Matrix)
    },
    Walk#walk{parts = [Part | Parts]}.

%% A map that scales unevenly draws lines of several widths: their mean is taken.
line(none, _Width, _Matrix) -> 0.0;
line(_Stroke, Width, {A, B, C, D, _, _}) -> Width * math:sqrt(abs(A * D - B * C)).

placed(Outlines, #context{matrix = Matrix}) ->
    [[starl_svg_curve:transform(Matrix, Curve) || Curve <- Outline] || Outline <- Outlines].

marked(Element, Walk) ->
    Markers = [reference(Name, Element) || Name <- ?MARKERS],
    case lists:any(fun(Id) -> is_map_key(Id, Walk#walk.ids) end, Markers) of
        true -> left_out(markers, Walk);
        false -> Walk
    end.

shown([], _Seen, _Context, Walk) ->
    Walk;
shown(_Outlines, #{fill := none, stroke := none}, _Context, Walk) ->
    left_out(unseen, Walk);
shown(Outlines, #{fill := Fill, stroke := Stroke}, Context, Walk) when
    Stroke =:= none; Stroke =:= Fill
->
    case is_background(Outlines, Context, Walk) of
        true -> left_out(backgrounds, Walk#walk{page = Fill});
        false when Stroke =:= none -> filled(Outlines, Fill, Context, Walk);
        false -> add(Outlines, Context, Walk)
    end;
shown(Outlines, #{fill := Fill}, Context, #walk{page = Page} = Walk) ->
    Areas = [Outline || Fill =/= none, Fill =/= Page, Outline <- areas(Outlines)],
    cut_out(Areas, Context, add(Outlines, Context, Walk)).

is_background([Outline], #context{clips = Clips}, #walk{frame = Frame}) when Frame =/= none ->
    starl_svg_area:covers(Outline, Frame) andalso
        lists:all(fun(Clip) -> starl_svg_clip:covers(Clip, Frame) end, Clips);
is_background(_Outlines, _Context, _Walk) ->
    false.

%% The boundary of a fill.
filled(Outlines, Fill, Context, #walk{page = Page, box = Box} = Walk) ->
    case areas(Outlines) of
        [] ->
            left_out(unseen, Walk);
        Areas ->
            Hidden =
                Fill =:= Page andalso
                    not starl_svg_area:overlap(starl_svg_area:box(Areas), Box),
            case Hidden of
                true -> left_out(unseen, Walk);
                false -> cut_out(Areas, Context, add(Areas, Context, Walk))
            end
    end.

areas(Outlines) ->
    [starl_svg_area:closed(Each) || Each <- Outlines, starl_svg_area:encloses(Each)].

add(Outlines, #context{paint = Paint} = Context, Walk) ->
    HasDots = starl_svg_paint:has_dots(Paint),
    with_length([Each || Each <- Outlines, HasDots orelse not is_dot(Each)], Context, Walk).

with_length([], _Context, Walk) ->
    Walk;
with_length(Outlines, #context{clips = Clips}, #walk{curves = Curves, shapes = Done} = Walk) ->
    Count = lists:sum([length(Outline) || Outline <- Outlines]),
    Count =< Curves orelse starl_svg_error:fail(too_many_shapes),
    Box = starl_svg_area:merge(starl_svg_area:box(Outlines), Walk#walk.box),
    Shapes = [{line, Outline, Clips} || Outline <- Outlines],
    Walk#walk{curves = Curves - Count, box = Box, shapes = lists:reverse(Shapes, Done)}.

is_dot(Outline) ->
    {X0, Y0, X1, Y1} = starl_svg_area:box([Outline]),
    X0 == X1 andalso Y0 == Y1.

%% A window that cuts a fill is an edge of what is seen of it.
cut_out(Areas, #context{clips = [_ | _] = Clips}, #walk{shapes = Done} = Walk) when Areas =/= [] ->
    Walk#walk{shapes = [{edges, Areas, Clips} | Done]};
cut_out(_Areas, _Context, Walk) ->
    Walk.

%%% Nested pictures and references

nested(Element, #context{viewport = Viewport} = Context, Walk) ->
    Corner = starl_svg_window:corner(Element, Viewport),
    window(Element, Corner, starl_svg_window:extent(Element, Viewport), Context, Walk).

use(Element, #context{uses = ?MAX_USES}, _Walk) ->
    starl_svg_error:fail(use_too_deep, Element);
use(Element, #context{uses = Uses, viewport = Viewport} = Context0, Walk) ->
    Corner = starl_svg_window:corner(Element, Viewport),
    Matrix = starl_svg_window:moved(Element, Corner, Context0#context.matrix),
    Context = Context0#context{matrix = Matrix, uses = Uses + 1},
    Target = target(Element, Walk),
    Extent = starl_svg_window:extent(Element, Target, Viewport),
    repeat(starl_svg_xml:name(Target), Target, Extent, Context, Walk).

repeat(<<"symbol">>, Target, Extent, Context, Walk) ->
    visit(Target, Context, Walk, fun(E, C, W) -> window(E, {0.0, 0.0}, Extent, C, W) end);
repeat(<<"svg">>, Target, Extent, #context{viewport = Viewport} = Context, Walk) ->
    Corner = starl_svg_window:corner(Target, Viewport),
    visit(Target, Context, Walk, fun(E, C, W) -> window(E, Corner, Extent, C, W) end);
repeat(Name, Target, _Extent, Context, Walk) ->
    child(Name, Target, Context, Walk).

target(Element, #walk{ids = Ids}) ->
    case starl_svg_xml:attribute(<<"href">>, Element, <<>>) of
        <<$#, Id/binary>> when is_map_key(Id, Ids) -> maps:get(Id, Ids);
        Text -> starl_svg_error:fail({bad_reference, Text}, Element)
    end.

%% Draws the content of an element into a window.
window(_Element, _Corner, {W, H}, _Context, Walk) when W =< 0.0; H =< 0.0 ->
    Walk;
window(Element, Corner, Extent, #context{matrix = Outer, clips = Clips} = Context, Walk) ->
    {Matrix, Viewport} = starl_svg_window:fit(Element, Corner, Extent, Outer),
    Seen =
        case starl_svg_window:is_cut(Element) of
            true -> [starl_svg_clip:rectangle(Corner, Extent, Outer) | Clips];
            false -> Clips
        end,
    group(Element, Context#context{matrix = Matrix, viewport = Viewport, clips = Seen}, Walk).
