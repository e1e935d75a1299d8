%% @doc Reads an SVG document: returns the lines that a browser would show, in the units of the root
%% element. It follows SVG 1.1, chapters 5, 7, 9, and SVG 2 where browsers do.
%%
%% Its parts, in the order in which a document passes them:
%% <ul>
%% <li>{@link starl_svg_prolog} and {@link starl_svg_xml} parse it.</li>
%% <li>{@link starl_svg_cascade} resolves its styles, with {@link starl_svg_css} and
%%   {@link starl_svg_selector}.</li>
%% <li>{@link starl_svg_walk} draws it. {@link starl_svg_paint} and {@link starl_svg_colour} decide what
%%   can be seen; {@link starl_svg_window}, {@link starl_svg_transform} and {@link starl_svg_clip} decide
%%   where; {@link starl_svg_path} and {@link starl_svg_shape} make the outlines of
%%   {@link starl_svg_curve}.</li>
%% <li>{@link starl_svg_area} computes what an outline encloses, {@link starl_svg_number} reads
%%   numbers.</li>
%% </ul>
-module(starl_svg).

-export([read/2, layers/3, name/1]).
-export_type([drawing/0, layers/0, part/0, problem/0, where/0]).

%% The drawing of a document, in the user units of its root element.
-type drawing() :: #{
    shapes := [starl_svg_walk:shape()],
    %% The viewBox, or else width and height; `none' when there is neither.
    frame := starl_svg_curve:bounds() | none,
    title := string(),
    left_out := starl_svg_walk:left_out()
}.
%% The shapes of the layers of a document, each with the layer's name, in the order of the document.
-type layers() :: #{
    parts := [part()], frame := starl_svg_curve:bounds() | none, title := string()
}.
-type part() :: {Layer :: string(), starl_svg_walk:part()}.
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

-define(NAMESPACE, "http://www.w3.org/2000/svg").
-define(ELEMENTS, [
    {group, ["svg", "g", "a", "switch"]},
    {hidden, ["defs", "symbol", "clipPath", "mask", "marker", "pattern"]},
    {shape, [binary_to_list(Name) || Name <- starl_svg_shape:names()]},
    {leaf, ["use", "text", "image", "foreignObject", "linearGradient", "radialGradient"]},
    {label, ["title"]},
    {sheet, ["style"]}
]).
-define(ATTRIBUTES, [
    [
        "id",
        "label",
        "href",
        "class",
        "style",
        "type",
        "media",
        "requiredExtensions",
        "systemLanguage"
    ],
    ["transform", "transform-origin", "viewBox", "preserveAspectRatio", "overflow"],
    ["clip-path", "clipPathUnits", "clip-rule", "mask", "marker-start", "marker-mid", "marker-end"],
    ["display", "visibility", "opacity", "fill", "stroke", "color"],
    ["fill-opacity", "fill-rule", "stroke-opacity", "stroke-width", "stroke-linecap"],
    ["x", "y", "width", "height", "x1", "y1", "x2", "y2", "cx", "cy", "r", "rx", "ry"],
    ["points", "d"]
]).

%% @doc Reads a document that draws at most `Max' curves.
-spec read(binary(), Max :: pos_integer()) -> {ok, drawing()} | {error, problem()}.
read(Bytes, Max) ->
    case starl_svg_xml:parse(Bytes, vocabulary(Max)) of
        {ok, Root} -> drawing(starl_svg_cascade:resolve(Root), Max);
        {error, _} = Error -> Error
    end.

%% @doc Reads the shapes in these layers (lower case) of a document of at most `Max' curves: groups
%% that have one of these names, in upper or lower case. What is in no layer is left out.
-spec layers(binary(), Names :: [string()], Max :: pos_integer()) ->
    {ok, layers()} | {error, problem()}.
layers(Bytes, Names, Max) ->
    case starl_svg_xml:parse(Bytes, vocabulary(Max)) of
        {ok, Root} -> layered(starl_svg_cascade:resolve(Root), Names, Max);
        {error, _} = Error -> Error
    end.

%% @doc The name that a person has given to an element: in Inkscape's label, its title or its id;
%% "" without one.
-spec name(element_()) -> string().
name(Element) ->
    Id = starl_svg_xml:attribute(<<"id">>, Element, <<>>),
    Label = starl_svg_xml:attribute(<<"label">>, Element, <<>>),
    Title = unicode:characters_to_binary(title(starl_svg_xml:children(Element))),
    case [Name || Name <- [Label, string:trim(Title), Id], Name =/= <<>>] of
        [Name | _] -> [_ | _] = unicode:characters_to_list(Name);
        [] -> ""
    end.

%%% Internals

layered(Root, Names, Max) ->
    starl_svg_error:caught(fun() ->
        Frame = frame(Root),
        #{
            parts => [
                {Layer, Part}
             || #{elements := [_ | Around]} = Part <- starl_svg_walk:parts(Root, Frame, Max),
                {ok, Layer} <- [layer(Around, Names)]
            ],
            frame => Frame,
            title => title(starl_svg_xml:children(Root))
        }
    end).

layer([], _Names) ->
    none;
layer([Element | Around], Names) ->
    Name = string:lowercase(name(Element)),
    case lists:member(Name, Names) of
        true -> {ok, Name};
        false -> layer(Around, Names)
    end.

vocabulary(Max) ->
    #{
        root => "svg",
        namespace => ?NAMESPACE,
        elements => maps:from_list([{Name, Role} || {Role, Names} <- ?ELEMENTS, Name <- Names]),
        attributes => maps:from_list([
            {Name, list_to_binary(Name)}
         || Names <- ?ATTRIBUTES, Name <- Names
        ]),
        max_shapes => Max
    }.

drawing(Root, Max) ->
    starl_svg_error:caught(fun() ->
        Frame = frame(Root),
        {Shapes, LeftOut} = starl_svg_walk:drawn(Root, Frame, Max),
        #{
            shapes => Shapes,
            frame => Frame,
            title => title(starl_svg_xml:children(Root)),
            left_out => LeftOut
        }
    end).

-spec title([element_()]) -> string().
title(Children) ->
    case [Child || Child <- Children, starl_svg_xml:name(Child) =:= <<"title">>] of
        [Title | _] -> starl_svg_xml:text(Title);
        [] -> ""
    end.

frame(Root) ->
    case starl_svg_window:view_box(Root) of
        {X, Y, W, H} -> {X, Y, X + W, Y + H};
        none -> frame(size(Root, <<"width">>), size(Root, <<"height">>))
    end.

frame(W, H) when is_float(W), is_float(H), W > 0.0, H > 0.0 -> {0.0, 0.0, W, H};
frame(_, _) -> none.

%% Percentages of the root refer to a browser window, which does not exist here.
size(Root, Name) ->
    case binary:match(starl_svg_xml:attribute(Name, Root, <<"%">>), <<"%">>) of
        nomatch -> starl_svg_window:number(Root, Name, 0.0, none);
        _ -> none
    end.
