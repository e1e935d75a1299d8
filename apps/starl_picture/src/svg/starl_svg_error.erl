%% @doc Reports a mistake of a document ({@link starl_svg:problem()}). The first mistake ends the
%% reading, and becomes one line that states the problem, its place and the remedy. A part of the
%% SVG reader, {@link starl_svg}.
-module(starl_svg_error).

-export([fail/1, fail/2, caught/1, format/1, line/2, quote/2]).

-export_type([local/0]).

%% A mistake in an element.
-type local() ::
    starl_svg_shape:problem()
    | {bad_transform, Text :: binary()}
    | {bad_reference, Text :: binary()}
    | use_too_deep.

%% Text quoted from a file is cut to this many characters.
-define(QUOTED, 40).

%% @doc Ends the reading.
-spec fail(starl_svg:problem()) -> no_return().
fail(Problem) -> throw({?MODULE, Problem}).

%% @doc Ends the reading because of a mistake in an element.
-spec fail(local(), starl_svg_xml:element_()) -> no_return().
fail(Problem, Element) -> fail(placed(Problem, place(Element))).

%% @doc The result of a function, or the mistake at which it ended.
-spec caught(fun(() -> Result)) -> {ok, Result} | {error, starl_svg:problem()}.
caught(Fun) ->
    try Fun() of
        Result -> {ok, Result}
    catch
        throw:{?MODULE, Problem} -> {error, Problem}
    end.

%% @doc One line of printable text without a line feed, as UTF-8.
-spec format(starl_svg:problem()) -> binary().
format(Problem) ->
    {Format, Arguments} = text(Problem),
    line(Format, Arguments).

%% @doc Text as UTF-8.
-spec line(io:format(), [term()]) -> binary().
line(Format, Arguments) ->
    Line = unicode:characters_to_binary(io_lib:format(Format, Arguments)),
    true = is_binary(Line),
    Line.

%% @doc Text of a file in quotation marks, without control characters, cut to `Max' characters.
-spec quote(unicode:chardata() | file:filename_all(), Max :: pos_integer()) -> unicode:chardata().
quote(Text, Max) -> [$", shown(Text, Max), $"].

%%% Internals

%% Where an element stands in the document.
-spec place(starl_svg_xml:element_()) -> starl_svg:where().
place(Element) ->
    {
        starl_svg_xml:name(Element),
        starl_svg_xml:attribute(<<"id">>, Element, none),
        starl_svg_xml:line(Element)
    }.

placed({bad_number, Name, Text}, Where) -> {bad_number, Where, Name, Text};
placed({bad_path, Offset, Problem}, Where) -> {bad_path, Where, Offset, Problem};
placed({bad_transform, Text}, Where) -> {bad_transform, Where, Text};
placed({bad_reference, Text}, Where) -> {bad_reference, Where, Text};
placed(use_too_deep, Where) -> {use_too_deep, Where};
placed(too_many, _Where) -> too_many_shapes.

text(empty) ->
    {"the picture is empty; give an SVG file", []};
text({not_xml, Kind}) ->
    {"the picture is not an SVG drawing: ~ts", [kind_text(Kind)]};
text({bad_encoding, Name}) ->
    {"the picture cannot be read as ~ts; save it as UTF-8", [quote(Name)]};
text({entities, Line}) ->
    {
        "line ~b: the DOCTYPE declares something other than plain text entities, which is refused "
        "for safety; save the picture as plain SVG",
        [Line]
    };
text({entities_too_big, Line}) ->
    {"line ~b: the entities of the DOCTYPE are too long; save the picture as plain SVG", [Line]};
text({truncated, Line}) ->
    {"line ~b: the picture ends in the middle; fetch or export the file again", [Line]};
text({bad_xml, Line, What}) ->
    {"line ~b: not well-formed XML (~ts); export the file again", [Line, shown(What, 80)]};
text({wrong_root, Name}) ->
    {"the root element is ~ts, not an SVG <svg> element; give an SVG file", [quote(Name)]};
text({too_deep, Line}) ->
    {"line ~b: elements are nested more than 200 deep; ungroup the drawing", [Line]};
text(too_complex) ->
    {"the picture takes too much memory or work to read; simplify the drawing", []};
text(too_many_shapes) ->
    {"the picture has too many shapes; simplify the drawing", []};
text(Problem) ->
    element_text(Problem).

%% An element is wrong, at this place.
element_text({bad_number, Where, Attribute, Text}) ->
    {"~ts: ~ts in attribute ~ts is not what SVG allows there; correct it", [
        where(Where), quote(Text), Attribute
    ]};
element_text({bad_path, Where, Offset, Problem}) ->
    {"~ts: the path data is wrong at character ~b: ~ts; correct it", [
        where(Where), Offset + 1, path_text(Problem)
    ]};
element_text({bad_transform, Where, Text}) ->
    {
        "~ts: cannot use the transform ~ts; it must be a list of matrix, translate, scale, rotate, "
        "skewX and skewY of moderate size",
        [where(Where), quote(Text)]
    };
element_text({bad_reference, Where, Text}) ->
    {"~ts: the reference ~ts does not lead to an element of this file; remove or embed it", [
        where(Where), quote(Text)
    ]};
element_text({use_too_deep, Where}) ->
    {"~ts: <use> elements refer to each other without end; remove the loop", [where(Where)]}.

kind_text(png) -> "it is a PNG image; trace it to SVG first";
kind_text(jpeg) -> "it is a JPEG image; trace it to SVG first";
kind_text(gzip) -> "it is compressed; unpack it with gunzip first";
kind_text(pdf) -> "it is a PDF document; convert it to SVG first";
kind_text(unknown) -> "it does not begin as XML; give an SVG file".

path_text(expected_moveto) -> "it must begin with M or m";
path_text(expected_command) -> "a command letter is missing or unknown";
path_text(expected_number) -> "a number is missing";
path_text(expected_flag) -> "an arc flag must be 0 or 1";
path_text(out_of_range) -> "a number is too large".

where({Name, none, Line}) -> io_lib:format("line ~b, <~ts>", [Line, Name]);
where({Name, Id, Line}) -> io_lib:format("line ~b, <~ts id=~ts>", [Line, Name, quote(Id)]).

quote(Text) -> quote(Text, ?QUOTED).

%% At most Max characters, none of them a control character.
shown(Text, Max) ->
    Characters = characters(Text),
    Short = lists:sublist(Characters, Max),
    [visible(C) || C <- Short] ++ ["..." || length(Characters) > Max].

%% File names may be raw bytes that are not UTF-8.
characters(Text) ->
    case unicode:characters_to_list(Text) of
        Characters when is_list(Characters) -> Characters;
        _ when is_binary(Text) -> binary_to_list(Text);
        _ -> "?"
    end.

visible(C) when C < 32; C >= 127, C < 160; C =:= 16#2028; C =:= 16#2029 -> $\s;
visible(C) -> C.
