%% @doc Parses an XML document into a small tree of the relevant elements. A part of the SVG reader,
%% {@link starl_svg}.
%%
%% The parser is OTP's `xmerl_sax_parser', which makes no atoms from its input. It never sees
%% dangerous input: {@link starl_svg_prolog} reads the prolog, removes the document type
%% declaration, so that nothing is fetched, and expands the entities that it declares, within
%% bounds. Against documents of a hostile shape the tree has bounds on depth and size, and
%% {@link starl_svg} runs the parser with bounds on memory and time.
-module(starl_svg_xml).

-export([parse/2]).
-export([name/1, line/1, attribute/2, attribute/3, children/1, text/1, update/3]).
-export_type([element_/0, vocabulary/0, role/0, problem/0]).

%% The treatment of an element: a group is kept with its content; a hidden group likewise, but its
%% shapes do not count; a shape or a leaf is kept alone, a label or a style sheet with its text.
-type role() :: group | hidden | shape | leaf | label | sheet.
%% Elements and attributes not named here are dropped, the elements with all their content.
-type vocabulary() :: #{
    root := string(),
    namespace := string(),
    elements := #{string() => role()},
    attributes := #{string() => binary()},
    max_shapes := pos_integer()
}.
%% The reason why a document cannot be parsed. Lines count from 1.
-type problem() ::
    empty
    | {not_xml, png | jpeg | gzip | pdf | unknown}
    | {bad_encoding, Name :: string()}
    | {starl_svg_entity:problem(), Line :: pos_integer()}
    | {truncated, Line :: pos_integer()}
    | {bad_xml, Line :: pos_integer(), What :: string()}
    | {wrong_root, Name :: string()}
    | {too_deep, Line :: pos_integer()}
    | too_many_shapes
    | too_complex.

-record(element, {
    name :: binary(),
    %% The line on which the start tag ends.
    line :: pos_integer(),
    attributes :: #{binary() => binary()},
    children = [] :: [element_()],
    %% Pieces, the last one first, and their length.
    text = [] :: [string()],
    length = 0 :: non_neg_integer()
}).
-opaque element_() :: #element{}.

-record(reading, {
    vocabulary :: vocabulary(),
    open = [] :: [#element{}],
    root = none :: none | element_(),
    depth = 0 :: non_neg_integer(),
    %% The number of open elements, innermost ones, that are being dropped.
    dropped = 0 :: non_neg_integer(),
    hidden = 0 :: non_neg_integer(),
    shapes = 0 :: non_neg_integer(),
    elements = 0 :: non_neg_integer()
}).

-define(MAX_DEPTH, 200).
-define(MAX_ELEMENTS, 200_000).
-define(MAX_LABEL, 1000).
-define(MAX_SHEET, 2_000_000).

%% @doc The root element of a document.
-spec parse(binary(), vocabulary()) -> {ok, element_()} | {error, problem()}.
parse(Bytes, Vocabulary) ->
    case starl_svg_prolog:read(Bytes) of
        {ok, Document} -> sax(Document, Vocabulary);
        {error, _} = Error -> Error
    end.

%% @doc The name of an element, without a prefix.
-spec name(element_()) -> binary().
name(#element{name = Name}) -> Name.

%% @doc The line on which the start tag of an element ends, from 1.
-spec line(element_()) -> pos_integer().
line(#element{line = Line}) -> Line.

%% @doc The text of an attribute.
-spec attribute(binary(), element_()) -> binary() | undefined.
attribute(Name, Element) -> attribute(Name, Element, undefined).

%% @doc The text of an attribute, or `Default' when it is absent.
-spec attribute(binary(), element_(), Default) -> binary() | Default.
attribute(Name, #element{attributes = Attributes}, Default) ->
    maps:get(Name, Attributes, Default).

%% @doc The kept elements inside an element, in document order.
-spec children(element_()) -> [element_()].
children(#element{children = Children}) -> Children.

%% @doc The text inside a label or a style sheet.
-spec text(element_()) -> string().
text(#element{text = Text}) -> lists:append(lists:reverse(Text)).

%% @doc The element with other children, and with these attributes instead of or beside its own.
-spec update(#{binary() => binary()}, [element_()], element_()) -> element_().
update(Attributes, Children, #element{attributes = Own} = Element) ->
    Element#element{attributes = maps:merge(Own, Attributes), children = Children}.

%%% Internals

sax(Document, Vocabulary) ->
    Options = [
        skip_external_dtd,
        {event_fun, fun event/3},
        {event_state, #reading{vocabulary = Vocabulary}}
    ],
    case xmerl_sax_parser:stream(Document, Options) of
        {ok, #reading{root = Root}, Rest} -> finished(Root, Document, Rest);
        {refused, _Location, Problem, _Tags, _Reading} -> {error, Problem};
        {_Tag, {_, _, Line}, What, _Tags, _Reading} -> {error, malformed(Line, What)}
    end.

finished(none, _Document, _Rest) ->
    {error, {truncated, 1}};
finished(#element{} = Root, Document, Rest) ->
    case starl_svg_number:skip_space(Rest) of
        <<>> ->
            {ok, Root};
        Junk ->
            Before = binary:part(Document, 0, byte_size(Document) - byte_size(Junk)),
            Line = 1 + length(binary:matches(Before, <<"\n">>)),
            {error, {bad_xml, Line, "something follows the root element"}}
    end.

%% The parser reports the end of input only by these two texts.
malformed(Line, What) when is_list(What) ->
    Ends = ["No more bytes", "Continuation function undefined"],
    case lists:any(fun(End) -> string:find(What, End) =/= nomatch end, Ends) of
        true -> {truncated, Line};
        false -> {bad_xml, Line, What}
    end;
malformed(Line, _What) ->
    {bad_xml, Line, "malformed"}.

%%% Events of the parser

event({startElement, Uri, Name, _QName, Attributes}, {_, _, Line}, Reading) ->
    opened(Uri, Name, Attributes, Line, deeper(Line, Reading));
event({endElement, _Uri, _Name, _QName}, _Location, Reading) ->
    closed(Reading#reading{depth = Reading#reading.depth - 1});
event({characters, Text}, {_, _, Line}, Reading) ->
    characters(Text, Line, Reading);
event({startDTD, _, _, _}, {_, _, Line}, _Reading) ->
    refuse({entities, Line});
event(_Other, _Location, Reading) ->
    Reading.

deeper(Line, #reading{depth = ?MAX_DEPTH}) -> refuse({too_deep, Line});
deeper(_Line, #reading{depth = Depth} = Reading) -> Reading#reading{depth = Depth + 1}.

opened(Uri, Name, Attributes, Line, #reading{dropped = 0} = Reading) ->
    case {role(Uri, Name, Reading), Reading} of
        {unknown, #reading{open = []}} -> refuse({wrong_root, Name});
        {unknown, _} -> Reading#reading{dropped = 1};
        {Role, _} -> keep(Role, element(Name, Attributes, Line, Reading), Reading)
    end;
opened(_Uri, _Name, _Attributes, _Line, #reading{dropped = Dropped} = Reading) ->
    Reading#reading{dropped = Dropped + 1}.

role(Uri, Name, #reading{open = Open, vocabulary = Vocabulary}) ->
    #{root := Root, namespace := Namespace, elements := Elements} = Vocabulary,
    case (Uri =:= "" orelse Uri =:= Namespace) andalso (Open =/= [] orelse Name =:= Root) of
        true -> maps:get(Name, Elements, unknown);
        false -> unknown
    end.

element(Name, Attributes, Line, #reading{vocabulary = #{attributes := Known}}) ->
    Kept = [
        {maps:get(Key, Known), unicode:characters_to_binary(Value)}
     || {_Uri, _Prefix, Key, Value} <- Attributes, is_map_key(Key, Known)
    ],
    #element{name = list_to_binary(Name), line = Line, attributes = maps:from_list(Kept)}.

keep(Role, Element, Reading) ->
    #reading{open = Open, elements = Elements, shapes = Shapes, hidden = Hidden} = Reading,
    Reading1 = Reading#reading{open = [Element | Open], elements = Elements + 1},
    case Role of
        _ when Elements >= ?MAX_ELEMENTS -> refuse(too_complex);
        _ when Hidden > 0 -> Reading1#reading{hidden = Hidden + 1};
        hidden ->
            Reading1#reading{hidden = 1};
        shape when Shapes >= map_get(max_shapes, Reading#reading.vocabulary) ->
            refuse(too_many_shapes);
        shape ->
            Reading1#reading{shapes = Shapes + 1};
        _ ->
            Reading1
    end.

closed(#reading{dropped = Dropped} = Reading) when Dropped > 0 ->
    Reading#reading{dropped = Dropped - 1};
closed(#reading{open = [Element | Open], hidden = Hidden} = Reading) ->
    Whole = Element#element{children = lists:reverse(Element#element.children)},
    attach(Whole, Reading#reading{open = Open, hidden = max(0, Hidden - 1)}).

attach(Element, #reading{open = []} = Reading) ->
    Reading#reading{root = Element};
attach(Element, #reading{open = [Parent | Open]} = Reading) ->
    Children = [Element | Parent#element.children],
    Reading#reading{open = [Parent#element{children = Children} | Open]}.

characters(Text, Line, #reading{open = []} = Reading) ->
    case string:trim(Text) of
        [] -> Reading;
        _ -> refuse({bad_xml, Line, "text outside the root element"})
    end;
characters(Text, _Line, #reading{dropped = 0, open = [Top | Open]} = Reading) ->
    #{elements := Elements} = Reading#reading.vocabulary,
    case maps:get(binary_to_list(Top#element.name), Elements) of
        label -> Reading#reading{open = [add_text(Text, ?MAX_LABEL, Top) | Open]};
        sheet -> Reading#reading{open = [add_text(Text, ?MAX_SHEET, Top) | Open]};
        _ -> Reading
    end;
characters(_Text, _Line, Reading) ->
    Reading.

add_text(Text, Max, #element{text = Before, length = Length} = Element) ->
    Piece = lists:sublist(Text, Max - Length),
    Element#element{text = [Piece | Before], length = Length + length(Piece)}.

-spec refuse(problem()) -> no_return().
refuse(Problem) -> throw({refused, Problem}).
