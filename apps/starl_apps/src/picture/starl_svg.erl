%% @doc The SVG reader: finds the shapes that a document draws and gives their outlines in the units
%% of the root element (SVG 1.1, chapters 5, 7, 9).
%%
%% It draws the shapes outside `defs', `symbol', `clipPath', `mask', `marker' and `pattern', and
%% those referenced by a `use', unless an attribute or `style' attribute hides them. Only the
%% outline of a shape counts: paint, stroke width, clipping and style sheets are ignored.
%%
%% Its parts: {@link starl_svg_xml} and {@link starl_svg_prolog} parse the document,
%% {@link starl_svg_shape}, {@link starl_svg_path} and {@link starl_svg_pen} make outlines of
%% {@link starl_svg_curve}, {@link starl_svg_transform} has the affine maps,
%% {@link starl_svg_number} reads numbers.
-module(starl_svg).

-export([read/2]).
-export_type([drawing/0, problem/0, where/0]).

%% The drawing of a document, in the user units of its root element.
-type drawing() :: #{
    outlines := [starl_svg_pen:outline()],
    %% The viewBox, or else width and height; `none' when there is neither.
    frame := starl_svg_curve:bounds() | none,
    title := string(),
    has_text := boolean()
}.
%% The name of the element, its id if it has one, and the line on which its start tag ends.
-type where() :: {Name :: binary(), Id :: binary() | none, Line :: pos_integer()}.
-type problem() ::
    starl_svg_xml:problem()
    | {bad_number, where(), Attribute :: binary(), Text :: binary()}
    | {bad_path, where(), Offset :: non_neg_integer(), starl_svg_path:problem()}
    | {bad_transform, where(), Text :: binary()}
    | {bad_reference, where(), Text :: binary()}
    | {use_too_deep, where()}.

-type element_() :: starl_svg_xml:element_().

-record(context, {
    matrix :: starl_svg_transform:matrix(),
    viewport :: starl_svg_shape:viewport(),
    visible = true :: boolean(),
    uses = 0 :: non_neg_integer()
}).

-record(walk, {
    ids :: #{binary() => element_()},
    %% The numbers of curves and elements that may still follow.
    curves :: non_neg_integer(),
    visits :: non_neg_integer(),
    outlines = [] :: [starl_svg_pen:outline()],
    has_text = false :: boolean()
}).

-define(NAMESPACE, "http://www.w3.org/2000/svg").
%% The size that a browser assumes for a picture without a size.
-define(DEFAULT_VIEWPORT, {300.0, 150.0}).
-define(MAX_USES, 32).
-define(MAX_VISITS, 50_000).
%% A smaller viewBox counts as empty, because a division by its size could overflow.
-define(MIN_EXTENT, 1.0e-6).

%% @doc Reads a document that draws at most `Max' curves.
-spec read(binary(), Max :: pos_integer()) -> {ok, drawing()} | {error, problem()}.
read(Bytes, Max) ->
    case starl_svg_xml:parse(Bytes, vocabulary(Max)) of
        {ok, Root} -> drawing(Root, Max);
        {error, _} = Error -> Error
    end.

%%% Internals. The first mistake ends the walk with a throw.

vocabulary(Max) ->
    Roles = [
        {group, ["svg", "g", "a", "switch"]},
        {hidden, ["defs", "symbol", "clipPath", "mask", "marker", "pattern"]},
        {shape, [binary_to_list(Name) || Name <- starl_svg_shape:names()]},
        {leaf, ["use", "text"]},
        {label, ["title"]}
    ],
    Attributes = [
        "id",
        "href",
        "transform",
        "style",
        "display",
        "visibility",
        "viewBox",
        "x",
        "y",
        "width",
        "height",
        "x1",
        "y1",
        "x2",
        "y2",
        "cx",
        "cy",
        "r",
        "rx",
        "ry",
        "points",
        "d"
    ],
    #{
        root => "svg",
        namespace => ?NAMESPACE,
        elements => maps:from_list([{Name, Role} || {Role, Names} <- Roles, Name <- Names]),
        attributes => maps:from_list([{Name, list_to_binary(Name)} || Name <- Attributes]),
        max_shapes => Max
    }.

drawing(Root, Max) ->
    try
        Walk0 = #walk{ids = ids(Root, #{}), curves = Max, visits = ?MAX_VISITS + Max},
        Frame = frame(Root),
        Context = #context{
            matrix = starl_svg_transform:identity(),
            viewport = viewport(Frame)
        },
        Walk = visit(Root, Context, Walk0, fun group/3),
        {ok, #{
            outlines => lists:reverse(Walk#walk.outlines),
            frame => Frame,
            title => title(starl_svg_xml:children(Root)),
            has_text => Walk#walk.has_text
        }}
    catch
        throw:{?MODULE, Problem} -> {error, Problem}
    end.

ids(Element, Ids0) ->
    Ids =
        case starl_svg_xml:attribute(<<"id">>, Element) of
            undefined -> Ids0;
            Id when is_map_key(Id, Ids0) -> Ids0;
            Id -> Ids0#{Id => Element}
        end,
    lists:foldl(fun ids/2, Ids, starl_svg_xml:children(Element)).

title(Children) ->
    case [Child || Child <- Children, starl_svg_xml:name(Child) =:= <<"title">>] of
        [Title | _] -> starl_svg_xml:text(Title);
        [] -> ""
    end.

%%% Sizes

frame(Root) ->
    case view_box(Root) of
        {X, Y, W, H} -> {X, Y, X + W, Y + H};
        none -> frame(size(Root, <<"width">>), size(Root, <<"height">>))
    end.

frame(W, H) when is_float(W), is_float(H), W > 0.0, H > 0.0 -> {0.0, 0.0, W, H};
frame(_, _) -> none.

%% Percentages of the root refer to a browser window, which does not exist here.
size(Root, Name) ->
    case binary:match(starl_svg_xml:attribute(Name, Root, <<"%">>), <<"%">>) of
        nomatch -> number(Root, Name, 0.0, none);
        _ -> none
    end.

viewport(none) -> ?DEFAULT_VIEWPORT;
viewport({X0, Y0, X1, Y1}) -> {X1 - X0, Y1 - Y0}.

view_box(Element) ->
    case starl_svg_xml:attribute(<<"viewBox">>, Element) of
        undefined ->
            none;
        Text ->
            case starl_svg_number:list(Text) of
                {ok, [X, Y, W, H]} when W >= ?MIN_EXTENT, H >= ?MIN_EXTENT -> {X, Y, W, H};
                _ -> fail({bad_number, where(Element), <<"viewBox">>, Text})
            end
    end.

%%% The walk

%% Counts an element, then lets `Draw' draw it unless it is not displayed.
visit(_Element, _Context, #walk{visits = 0}, _Draw) ->
    fail(too_complex);
visit(Element, Context, #walk{visits = Visits} = Walk0, Draw) ->
    Walk = Walk0#walk{visits = Visits - 1},
    Style = style(Element),
    case property(<<"display">>, Element, Style) of
        <<"none">> ->
            Walk;
        _ ->
            Visibility = property(<<"visibility">>, Element, Style),
            Visible = visible(Visibility, Context#context.visible),
            Matrix = transformed(Element, Context#context.matrix),
            Draw(Element, Context#context{visible = Visible, matrix = Matrix}, Walk)
    end.

visible(<<"visible">>, _Inherited) -> true;
visible(<<"hidden">>, _Inherited) -> false;
visible(<<"collapse">>, _Inherited) -> false;
visible(_, Inherited) -> Inherited.

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
    fun group/3;
drawer(<<"svg">>) ->
    fun nested/3;
drawer(<<"use">>) ->
    fun use/3;
drawer(<<"text">>) ->
    fun(_Element, _Context, Walk) -> Walk#walk{has_text = true} end;
drawer(Name) ->
    case lists:member(Name, starl_svg_shape:names()) of
        true -> fun shape/3;
        false -> none
    end.

shape(_Element, #context{visible = false}, Walk) ->
    Walk;
shape(Element, #context{matrix = Matrix, viewport = Viewport}, Walk) ->
    case starl_svg_shape:outlines(Element, Viewport, Walk#walk.curves) of
        {ok, Outlines} ->
            Count = lists:sum([length(Outline) || Outline <- Outlines]),
            add(Outlines, Count, Matrix, Walk);
        {error, too_many} ->
            fail(too_many_shapes);
        {error, Problem} ->
            fail(placed(Problem, Element))
    end.

add(_Outlines, Count, _Matrix, #walk{curves = Curves}) when Count > Curves ->
    fail(too_many_shapes);
add(Outlines, Count, Matrix, #walk{curves = Curves, outlines = Done} = Walk) ->
    Placed = [
        [starl_svg_curve:transform(Matrix, Curve) || Curve <- Outline]
     || Outline <- Outlines
    ],
    Walk#walk{curves = Curves - Count, outlines = lists:reverse(Placed, Done)}.

%%% Nested pictures and references

nested(Element, Context, Walk) ->
    window(Element, corner(Element, Context), extent(Element, Context), Context, Walk).

use(Element, #context{uses = ?MAX_USES}, _Walk) ->
    fail({use_too_deep, where(Element)});
use(Element, #context{uses = Uses} = Context0, Walk) ->
    {X, Y} = corner(Element, Context0),
    Matrix = multiply(Element, Context0#context.matrix, starl_svg_transform:translation(X, Y)),
    Context = Context0#context{matrix = Matrix, uses = Uses + 1},
    Target = target(Element, Walk),
    Extent = extent(Element, Target, Context),
    case starl_svg_xml:name(Target) of
        <<"symbol">> ->
            Draw = fun(E, C, W) -> window(E, {0.0, 0.0}, Extent, C, W) end,
            visit(Target, Context, Walk, Draw);
        <<"svg">> ->
            Draw = fun(E, C, W) -> window(E, corner(E, C), Extent, C, W) end,
            visit(Target, Context, Walk, Draw);
        Name ->
            child(Name, Target, Context, Walk)
    end.

target(Element, #walk{ids = Ids}) ->
    case starl_svg_xml:attribute(<<"href">>, Element, <<>>) of
        <<$#, Id/binary>> when is_map_key(Id, Ids) -> maps:get(Id, Ids);
        Text -> fail({bad_reference, where(Element), Text})
    end.

corner(Element, #context{viewport = {W, H}}) ->
    {number(Element, <<"x">>, W, 0.0), number(Element, <<"y">>, H, 0.0)}.

extent(Element, #context{viewport = {W, H}}) ->
    {number(Element, <<"width">>, W, W), number(Element, <<"height">>, H, H)}.

%% The size given by the `use' has priority over that of its target.
extent(Use, Target, #context{viewport = {W, H}} = Context) ->
    {TargetW, TargetH} = extent(Target, Context),
    {number(Use, <<"width">>, W, TargetW), number(Use, <<"height">>, H, TargetH)}.

%% Draws the content of an element into a window: the viewBox, if any, is scaled to fit and
%% centred.
window(_Element, _Corner, {W, H}, _Context, Walk) when W =< 0.0; H =< 0.0 ->
    Walk;
window(Element, {X, Y}, {W, H}, #context{matrix = Matrix0} = Context, Walk) ->
    {Map, Viewport} =
        case view_box(Element) of
            none ->
                {starl_svg_transform:translation(X, Y), {W, H}};
            {VX, VY, VW, VH} ->
                S = min(W / VW, H / VH),
                DX = X + (W - VW * S) / 2.0 - VX * S,
                DY = Y + (H - VH * S) / 2.0 - VY * S,
                {{S, 0.0, 0.0, S, DX, DY}, {VW, VH}}
        end,
    Matrix = multiply(Element, Matrix0, Map),
    group(Element, Context#context{matrix = Matrix, viewport = Viewport}, Walk).

%%% Attributes

transformed(Element, Matrix) ->
    case starl_svg_xml:attribute(<<"transform">>, Element) of
        undefined ->
            Matrix;
        Text ->
            case starl_svg_transform:parse(Text) of
                {ok, Own} -> multiply(Element, Matrix, Own);
                {error, _} -> fail({bad_transform, where(Element), Text})
            end
    end.

multiply(Element, Outer, Inner) ->
    case starl_svg_transform:multiply(Outer, Inner) of
        {ok, Matrix} ->
            Matrix;
        {error, out_of_range} ->
            Text = starl_svg_xml:attribute(<<"transform">>, Element, <<>>),
            fail({bad_transform, where(Element), Text})
    end.

number(Element, Name, Whole, Default) ->
    case starl_svg_shape:number(Element, Name, Whole, Default) of
        {ok, Number} -> Number;
        {error, Problem} -> fail(placed(Problem, Element))
    end.

%% The `style' attribute has priority over the attribute of the same name.
property(Name, Element, Style) ->
    Own = string:trim(starl_svg_xml:attribute(Name, Element, <<>>)),
    maps:get(Name, Style, Own).

style(Element) ->
    Text = starl_svg_xml:attribute(<<"style">>, Element, <<>>),
    Pairs = [binary:split(Part, <<":">>) || Part <- binary:split(Text, <<";">>, [global])],
    maps:from_list([{string:trim(Name), string:trim(Value)} || [Name, Value] <- Pairs]).

placed({bad_number, Name, Text}, Element) -> {bad_number, where(Element), Name, Text};
placed({bad_path, Offset, Problem}, Element) -> {bad_path, where(Element), Offset, Problem}.

where(Element) ->
    {
        starl_svg_xml:name(Element),
        starl_svg_xml:attribute(<<"id">>, Element, none),
        starl_svg_xml:line(Element)
    }.

-spec fail(problem()) -> no_return().
fail(Problem) -> throw({?MODULE, Problem}).
