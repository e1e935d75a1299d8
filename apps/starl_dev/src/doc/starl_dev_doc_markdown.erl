%% @doc Turns the Markdown of StarL's pages into HTML: headings, paragraphs, lists, tables, code, quotes,
%% links, pictures. What a link leads to is the caller's to say. A pure module.
%% ```
%%   {Html, Sections} = starl_dev_doc_markdown:html("# Page\n\nSome *text*.", fun(Link) -> Link end)
%% '''
-module(starl_dev_doc_markdown).

-export([html/2]).

-export_type([section/0, link/0]).

%% A heading: its level, its text, its name on the page, and the text below it.
-type section() :: {1..6, Title :: string(), Name :: string(), Text :: string()}.

%% Where a link of the source leads on the page; `none': nowhere, and its text stands alone.
-type link() :: fun((string()) -> string() | none).

-type block() ::
    {heading, 1..6, string()}
    | {code | raw | paragraph, string()}
    | {table, [string(), ...]}
    | {list, ul | ol, [[block()]]}
    | {quote, [block()]}.

%% @doc The page of a text, and its sections.
-spec html(string(), link()) -> {iolist(), [section()]}.
html(Text, Link) ->
    Blocks = blocks(string:split(Text, "\n", all)),
    {[block(Block, Link) || Block <- Blocks], sections(Blocks)}.

sections([]) ->
    [];
sections([{heading, Level, Title} | Blocks]) ->
    {Below, Others} = lists:splitwith(fun(Block) -> element(1, Block) =/= heading end, Blocks),
    Text = lists:flatten(lists:join(" ", [words(Block) || Block <- Below])),
    [{Level, plain(Title), name(Title), Text} | sections(Others)];
sections([_ | Blocks]) ->
    sections(Blocks).

words({list, _, Items}) -> lists:join(" ", [words(Block) || Item <- Items, Block <- Item]);
words({quote, Blocks}) -> lists:join(" ", [words(Block) || Block <- Blocks]);
words({table, Rows}) -> lists:join(" ", Rows);
words({_, Text}) -> plain(Text).

plain(Text) ->
    re:replace(Text, "!?\\[([^\\]]*)\\]\\([^)]*\\)|[`*|]|<[^>]*>", "\\1", [
        global, unicode, {return, list}
    ]).

%% As GitHub names headings.
name(Title) ->
    Words = re:replace(string:lowercase(plain(Title)), "[^\\w\\- ]", "", [
        global, unicode, {return, list}
    ]),
    lists:flatten(string:replace(Words, " ", "-", all)).

%% -- blocks ---------------------------------------------------------------------------------

-spec blocks([string()]) -> [block()].
blocks([]) ->
    [];
blocks(["```" ++ _ | Lines]) ->
    fenced(Lines);
blocks(["#" ++ _ = Line | Lines]) ->
    heading(Line, Lines);
blocks(["|" ++ _ | _] = Lines) ->
    with(fun table/1, "|", Lines);
blocks([">" ++ _ | _] = Lines) ->
    with(fun quote/1, ">", Lines);
blocks(["    " ++ _ | _] = Lines) ->
    indented(Lines);
blocks(["<" ++ _ | _] = Lines) ->
    raw(Lines);
blocks([Line | Lines] = All) ->
    case {string:trim(Line), item(Line)} of
        {"", _} -> blocks(Lines);
        {_, {Kind, _, _}} -> list(Kind, All, []);
        {_, none} -> paragraph(All)
    end.

fenced(Lines) ->
    {Code, Rest} = lists:splitwith(fun(Line) -> not lists:prefix("```", Line) end, Lines),
    [{code, lines(Code)} | blocks(lists:nthtail(min(1, length(Rest)), Rest))].

heading(Line, Lines) ->
    {Marks, Title} = lists:splitwith(fun(C) -> C =:= $# end, Line),
    [{heading, min(6, length(Marks)), string:trim(Title)} | blocks(Lines)].

with(Make, Begin, Lines) ->
    {Own, Rest} = lists:splitwith(fun(Line) -> lists:prefix(Begin, Line) end, Lines),
    [Make(Own) | blocks(Rest)].

table(Rows) -> {table, Rows}.

quote(Lines) -> {quote, blocks([string:trim(tl(Line), leading) || Line <- Lines])}.

%% Blank lines between indented ones belong to the code.
indented(Lines) ->
    {Own, Rest} = lists:splitwith(
        fun(Line) -> lists:prefix("    ", Line) orelse string:trim(Line) =:= "" end, Lines
    ),
    Code = [string:slice(Line, 4) || Line <- Own],
    [{code, string:trim(lines(Code), trailing, "\n") ++ "\n"} | blocks(Rest)].

raw(Lines) ->
    {Own, Rest} = lists:splitwith(fun(Line) -> string:trim(Line) =/= "" end, Lines),
    [{raw, lines(Own)} | blocks(Rest)].

paragraph(Lines) ->
    {Own, Rest} = lists:splitwith(fun goes_on/1, tl(Lines)),
    [{paragraph, lines([hd(Lines) | Own])} | blocks(Rest)].

goes_on(Line) ->
    string:trim(Line) =/= "" andalso item(Line) =:= none andalso
        not lists:any(fun(Begin) -> lists:prefix(Begin, Line) end, ["```", "#", "|", ">"]).

%% An item of a list: its kind, its indent, and its first line.
item(Line) ->
    case re:run(Line, "^([-*] +|[0-9]+[.] +)(.*)$", [unicode, {capture, all_but_first, list}]) of
        {match, [[Mark | _] = Head, First]} when Mark =:= $-; Mark =:= $* ->
            {ul, length(Head), First};
        {match, [Head, First]} ->
            {ol, length(Head), First};
        nomatch ->
            none
    end.

list(Kind, [Line | Lines] = All, Items) ->
    case item(Line) of
        {Kind, Indent, First} ->
            {Own, Rest} = belonging(Lines, Indent, []),
            list(Kind, Rest, [blocks([First | Own]) | Items]);
        _ ->
            [{list, Kind, lists:reverse(Items)} | blocks(All)]
    end;
list(Kind, [], Items) ->
    [{list, Kind, lists:reverse(Items)}].

%% Lines that go on, and, after blank ones, those with the item's indent.
belonging([Line | Lines], Indent, Own) ->
    {Spaces, Text} = lists:splitwith(fun(C) -> C =:= $\s end, Line),
    Next = [Following || Following <- Lines, string:trim(Following) =/= ""],
    Inside = fun(L) -> lists:prefix(lists:duplicate(Indent, $\s), L) end,
    case {Text, Next} of
        {"", [After | _]} ->
            case Inside(After) of
                true -> belonging(Lines, Indent, ["" | Own]);
                false -> {lists:reverse(Own), drop_blank([Line | Lines])}
            end;
        {"", []} ->
            {lists:reverse(Own), []};
        _ when length(Spaces) >= Indent ->
            belonging(Lines, Indent, [string:slice(Line, Indent) | Own]);
        _ when Spaces =/= "" ->
            belonging(Lines, Indent, [Text | Own]);
        _ ->
            case goes_on(Line) andalso (Own =:= [] orelse hd(Own) =/= "") of
                true -> belonging(Lines, Indent, [Line | Own]);
                false -> {lists:reverse(Own), [Line | Lines]}
            end
    end;
belonging([], _Indent, Own) ->
    {lists:reverse(Own), []}.

drop_blank(Lines) -> lists:dropwhile(fun(Line) -> string:trim(Line) =:= "" end, Lines).

lines(Lines) -> lists:flatten([[Line, $\n] || Line <- Lines]).

%% -- HTML -----------------------------------------------------------------------------------

block({heading, Level, Title}, Link) ->
    H = integer_to_list(Level),
    ["<h", H, "><a name=\"", name(Title), "\"></a>", inline(Title, Link), "</h", H, ">\n"];
block({code, Text}, _Link) ->
    ["<pre><code>", escaped(Text), "</code></pre>\n"];
block({raw, Text}, Link) ->
    re_linked(Text, Link);
block({paragraph, Text}, Link) ->
    ["<p>", inline(Text, Link), "</p>\n"];
block({quote, Blocks}, Link) ->
    ["<blockquote>", [block(Block, Link) || Block <- Blocks], "</blockquote>\n"];
block({list, Kind, Items}, Link) ->
    Tag = atom_to_list(Kind),
    [
        ["<", Tag, ">\n"],
        [["<li>", tight(Item, Link), "</li>\n"] || Item <- Items],
        ["</", Tag, ">\n"]
    ];
block({table, [Head, _Rule | Rows]}, Link) ->
    ["<table>\n", row("th", Head, Link), [row("td", Row, Link) || Row <- Rows], "</table>\n"];
block({table, Rows}, Link) ->
    ["<table>\n", [row("td", Row, Link) || Row <- Rows], "</table>\n"].

tight([{paragraph, Text} | Blocks], Link) ->
    [inline(Text, Link) | [block(Block, Link) || Block <- Blocks]];
tight(Blocks, Link) ->
    [block(Block, Link) || Block <- Blocks].

row(Tag, Line, Link) ->
    Cells = cells(string:trim(string:trim(Line), leading, "|"), [], false),
    ["<tr>", [["<", Tag, ">", inline(Cell, Link), "</", Tag, ">"] || Cell <- Cells], "</tr>\n"].

%% A bar within code, or after a backslash, parts no cells.
cells([], [], _InCode) -> [];
cells([], Cell, _InCode) -> [string:trim(lists:reverse(Cell))];
cells("\\|" ++ Text, Cell, InCode) -> cells(Text, [$| | Cell], InCode);
cells("`" ++ Text, Cell, InCode) -> cells(Text, [$` | Cell], not InCode);
cells("|" ++ Text, Cell, false) -> [string:trim(lists:reverse(Cell)) | cells(Text, [], false)];
cells([C | Text], Cell, InCode) -> cells(Text, [C | Cell], InCode).

re_linked(Text, Link) ->
    case
        re:run(Text, "^(.*?(?:src|href)=\")([^\"]*)(.*)$", [
            dotall, unicode, {capture, all_but_first, list}
        ])
    of
        {match, [Before, To, After]} ->
            [Before, or_nothing(Link(To)), re_linked(After, Link)];
        nomatch ->
            Text
    end.

or_nothing(none) -> "";
or_nothing(To) -> To.

%% -- within a line --------------------------------------------------------------------------

inline([], _Link) ->
    [];
inline([C | Rest] = Text, Link) ->
    case part(Text, Link) of
        {Html, After} -> [Html | inline(After, Link)];
        none -> [escaped([C]) | inline(Rest, Link)]
    end.

part("`" ++ _ = Text, _Link) ->
    found("^`([^`]+)`(.*)$", Text, fun([Code]) -> ["<code>", escaped(Code), "</code>"] end);
part("![" ++ _ = Text, Link) ->
    found("^!\\[([^\\]]*)\\]\\(([^)]*)\\)(.*)$", Text, fun([Alt, To]) ->
        ["<img alt=\"", escaped(Alt), "\" src=\"", or_nothing(Link(To)), "\">"]
    end);
part("[" ++ _ = Text, Link) ->
    found("^\\[((?:`[^`]*`|[^\\]])*)\\]\\(([^)]*)\\)(.*)$", Text, fun([Words, To]) ->
        linked(Link(To), inline(Words, Link))
    end);
part("**" ++ _ = Text, Link) ->
    found("^\\*\\*(.+?)\\*\\*(.*)$", Text, fun([Bold]) -> ["<b>", inline(Bold, Link), "</b>"] end);
part("*" ++ _ = Text, Link) ->
    found("^\\*([^*\\s](?:[^*]*[^*\\s])?)\\*(.*)$", Text, fun([Words]) ->
        ["<em>", inline(Words, Link), "</em>"]
    end);
part("<http" ++ _ = Text, _Link) ->
    found("^<([^>]*)>(.*)$", Text, fun([To]) -> linked(To, escaped(To)) end);
part("<" ++ _ = Text, Link) ->
    found("^(<(?:img|br|a|/a|sub|sup)\\b[^>]*>)(.*)$", Text, fun([Tag]) -> re_linked(Tag, Link) end);
part(_Text, _Link) ->
    none.

found(Pattern, Text, Html) ->
    case re:run(Text, Pattern, [dotall, unicode, {capture, all_but_first, list}]) of
        {match, Parts} -> {Html(lists:droplast(Parts)), lists:last(Parts)};
        nomatch -> none
    end.

linked(none, Html) -> Html;
linked(To, Html) -> ["<a href=\"", escaped(To), "\">", Html, "</a>"].

escaped(Text) ->
    lists:foldl(fun({From, To}, T) -> string:replace(T, From, To, all) end, Text, [
        {"&", "&amp;"}, {"<", "&lt;"}, {">", "&gt;"}, {"\"", "&quot;"}
    ]).
