%% @doc Ends the reading of a document at its first mistake, with the place. A part of the SVG
%% reader, {@link starl_svg}, which catches it.
-module(starl_svg_problem).

-export([fail/1, fail/2, caught/1, where/1]).
-export_type([local/0]).

%% A mistake in an element.
-type local() ::
    starl_svg_shape:problem()
    | {bad_transform, Text :: binary()}
    | {bad_reference, Text :: binary()}
    | use_too_deep.

%% @doc Ends the reading.
-spec fail(starl_svg:problem()) -> no_return().
fail(Problem) -> throw({?MODULE, Problem}).

%% @doc Ends the reading because of a mistake in an element.
-spec fail(local(), starl_svg_xml:element_()) -> no_return().
fail(Problem, Element) -> fail(placed(Problem, where(Element))).

%% @doc The result of a function, or the mistake at which it ended.
-spec caught(fun(() -> Result)) -> {ok, Result} | {error, starl_svg:problem()}.
caught(Fun) ->
    try Fun() of
        Result -> {ok, Result}
    catch
        throw:{?MODULE, Problem} -> {error, Problem}
    end.

%% @doc Where an element stands in the document.
-spec where(starl_svg_xml:element_()) -> starl_svg:where().
where(Element) ->
    {
        starl_svg_xml:name(Element),
        starl_svg_xml:attribute(<<"id">>, Element, none),
        starl_svg_xml:line(Element)
    }.

%%% Internals

placed({bad_number, Name, Text}, Where) -> {bad_number, Where, Name, Text};
placed({bad_path, Offset, Problem}, Where) -> {bad_path, Where, Offset, Problem};
placed({bad_transform, Text}, Where) -> {bad_transform, Where, Text};
placed({bad_reference, Text}, Where) -> {bad_reference, Where, Text};
placed(use_too_deep, Where) -> {use_too_deep, Where};
placed(too_many, _Where) -> too_many_shapes.
