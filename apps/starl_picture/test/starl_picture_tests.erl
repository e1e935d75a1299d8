%% @doc Contracts of reading a picture: every shape's outline is painted where SVG puts it, scaled
%% into the area within the tolerance; what cannot be painted is an error of one clear line; no
%% input crashes it.
-module(starl_picture_tests).

-include_lib("eunit/include/eunit.hrl").

-define(AREA, {0.0, 0.0, 1000.0, 1000.0}).

%%% Shapes. In a viewBox of 100 the floor point of (X, Y) is (10 X, 1000 - 10 Y).

shapes_test_() ->
    [
        ?_assertEqual({Body, lists:sort(floor_lines(Lines))}, {Body, drawn(Body)})
     || {Body, Lines} <- [
            {"<line x1='10' y1='20' x2='30' y2='40'/>", [[10, 20, 30, 40]]},
            {"<line x2='50%' y2='25%'/>", [[0, 0, 50, 25]]},
            {"<polyline points='1,2 3,4 5,6'/>", [[1, 2, 3, 4], [3, 4, 5, 6]]},
            {"<polygon points='0 0 10 0 10 10'/>", [[0, 0, 10, 0], [10, 0, 10, 10], [10, 10, 0, 0]]},
            {"<rect x='10' y='20' width='30' height='40'/>", [
                [10, 20, 40, 20], [40, 20, 40, 60], [40, 60, 10, 60], [10, 60, 10, 20]
            ]},
            {"<rect width='3' height='0'/><path d='M1 1h1'/>", [[1, 1, 2, 1]]},
            {"<path d='M1 1H5V5z'/>", [[1, 1, 5, 1], [5, 1, 5, 5], [5, 5, 1, 1]]},
            {"<a><switch><g><path d='M1 1H5'/></g></switch></a>", [[1, 1, 5, 1]]}
        ]
    ].

round_shapes_test_() ->
    [
        ?_test(begin
            [
                ?assert(abs(radius(P, Centre, RX, RY) - 1.0) =< 2.0 / min(RX, RY), {P, Body})
             || {P, _} <- segments(svg(Body))
            ],
            ?assert(closed(segments(svg(Body))))
        end)
     || {Body, Centre, RX, RY} <- [
            {"<circle cx='50' cy='40' r='20'/>", {500.0, 600.0}, 200.0, 200.0},
            {"<ellipse cx='50' cy='40' rx='20' ry='30'/>", {500.0, 600.0}, 200.0, 300.0},
            {"<ellipse cx='50' cy='40' rx='20'/>", {500.0, 600.0}, 200.0, 200.0},
            {"<rect x='30' y='20' width='40' height='40' rx='20'/>", {500.0, 600.0}, 200.0, 200.0},
            {"<rect x='30' y='20' width='40' height='40' ry='99'/>", {500.0, 600.0}, 200.0, 200.0},
            {"<circle r='1' transform='translate(50,40) scale(20)'/>", {500.0, 600.0}, 200.0,
                200.0},
            {"<path d='M30 40a20 20 0 1140 0a20 20 0 11-40 0'/>", {500.0, 600.0}, 200.0, 200.0}
        ]
    ].

%% The tolerance is one of the floor, wherever a transform comes in.
tolerance_test_() ->
    [
        ?_test(begin
            Document = svg("<circle cx='5' cy='5' r='4' transform='scale(10)'/>"),
            Options = #{area => ?AREA, tolerance_mm => Tolerance},
            {ok, Picture} = starl_picture:parse(Document, Options),
            ?assertEqual(Tolerance, starl_picture:tolerance(Picture)),
            Sagittas = [
                abs(400.0 - distance(middle(S), {500.0, 500.0}))
             || S <- starl_picture:segments(Picture)
            ],
            ?assert(lists:max(Sagittas) =< Tolerance),
            ?assert(lists:max(Sagittas) >= Tolerance / 3)
        end)
     || Tolerance <- [20.0, 2.0, 0.2]
    ].

%%% Structure

placing_test_() ->
    [
        ?_assertEqual({Body, lists:sort(floor_lines(Lines))}, {Body, drawn(Body)})
     || {Body, Lines} <- [
            {
                "<g transform='translate(10 0)'><g transform='scale(2)'>"
                "<path transform='translate(1 1)' d='M0 0h5'/></g></g>",
                [[12, 2, 22, 2]]
            },
            {"<svg x='10' y='10' width='40' height='20' viewBox='0 0 10 10'><path d='M0 0H10'/></svg>",
                [[20, 10, 40, 10]]},
            {"<svg x='50%' width='50%' height='50%'><path d='M0 0h9'/><line x2='100%'/></svg>", [
                [50, 0, 59, 0], [50, 0, 100, 0]
            ]},
            {"<use href='#a' x='1' y='2'/><defs><path id='a' d='M0 0h5'/></defs>", [[1, 2, 6, 2]]},
            {
                "<use xlink:href='#a' transform='scale(2)' x='1'/><defs><g id='a' transform='scale(3)'>"
                "<path d='M1 1h2'/></g></defs>",
                [[8, 6, 20, 6]]
            },
            {
                "<symbol id='s' viewBox='0 0 10 10'><path d='M0 5h10'/></symbol>"
                "<use href='#s' x='10' y='20' width='20' height='40'/>",
                [[10, 40, 30, 40]]
            },
            {
                "<defs><svg id='s' width='1' height='1' viewBox='0 0 1 1'><path d='M0 0h1'/></svg></defs>"
                "<use href='#s' width='30' height='30'/>",
                [[0, 0, 30, 0]]
            },
            {"<use href='#b'/><g id='b'><path d='M1 1h1'/></g>", [[1, 1, 2, 1]]}
        ]
    ].

%% Only `<path d="M1 1h1"/>' of these documents is drawn.
not_drawn_test_() ->
    [
        ?_assertEqual(
            {Body, floor_lines([[1, 1, 2, 1]])}, {Body, drawn(Body ++ "<path d='M1 1h1'/>")}
        )
     || Body <- [
            "<defs><path d='M5 5h9'/></defs>",
            "<clipPath><path d='M5 5h9'/></clipPath>",
            "<mask><path d='M5 5h9'/></mask>",
            "<marker><path d='M5 5h9'/></marker>",
            "<pattern><path d='M5 5h9'/></pattern>",
            "<symbol><path d='M5 5h9'/></symbol>",
            "<g display='none'><path d='M5 5h9'/></g>",
            "<path style='fill:red; display : none' d='M5 5h9'/>",
            "<g visibility='hidden'><path d='M5 5h9'/></g>",
            "<g visibility='hidden'><path d='M1 1h1' visibility='visible'/></g>",
            "<path visibility='visible' style='visibility:hidden' d='M5 5h9'/>",
            "<style>.gone { display: none }</style><path class='gone' d='M5 5h9'/>",
            "<text>word</text>",
            "<image href='a.png'/>",
            "<x:path xmlns:x='urn:other' d='M5 5h9'/>",
            "<linearGradient><path d='M5 5h9'/></linearGradient>",
            "<path d='M1 1h1'/>",
            "<path d='M1 1h1'/><path d='M2 1h-1'/>",
            "<path d='M9 9h0.0001'/>",
            "<path d=''/>",
            "<polygon/>",
            "<circle/>"
        ]
    ].

%% What a browser shows as a dot is a line of a tenth of a millimetre; without round or square ends a
%% line of no length shows nothing.
dots_test_() ->
    Dot = [{{50.0, 950.0}, {50.1, 950.0}}],
    Line = [{{0.0, 1000.0}, {1000.0, 1000.0}}],
    [
        ?_assertEqual(
            {Body, Expected ++ Line}, {Body, segments(svg(Body ++ "<path d='M0 0H100'/>"))}
        )
     || {Body, Expected} <- [
            {"<path stroke-linecap='round' d='M5 5h0'/>", Dot},
            {"<g style='stroke-linecap: square'><path d='M5 5z'/></g>", Dot},
            {"<line stroke-linecap='round' x1='5' y1='5' x2='5' y2='5'/>", Dot},
            {"<path stroke-linecap='butt' d='M5 5h0'/>", []},
            {"<path stroke-linecap='wide' d='M5 5h0'/>", []},
            {"<path d='M5 5h0'/>", []}
        ]
    ].

%% A loop of one curve is not left out, however small, though it ends where it began.
small_loops_test_() ->
    [
        ?_assertMatch({Body, [_ | _]}, {Body, segments(svg(Body))})
     || Body <- [
            "<path d='M5 5c.2.2.2-.2 0 0M0 0'/>",
            "<path d='M5 5c.01.01.01-.01 0 0'/>",
            "<path d='M5 5q.2.2 0 0'/>"
        ]
    ].

%% Many steps, each too short to keep, still make a line.
tiny_steps_test() ->
    Steps = lists:flatten(lists:duplicate(20000, "h.0005")),
    {ok, Picture} = starl_picture:parse(
        svg("<path d='M1 1" ++ Steps ++ "'/>"),
        #{area => ?AREA, max_segments => 20000}
    ),
    Length = lists:sum([distance(P, Q) || {P, Q} <- starl_picture:segments(Picture)]),
    ?assert(abs(Length - 100.0) < 0.02).

%%% Frame

frame_test_() ->
    Line = "><path d='M0 0H50'/></svg>",
    [
        ?_assertEqual({Root, Segments}, {Root, segments(root(Root ++ Line))})
     || {Root, Segments} <- [
            {"viewBox='0 0 100 100'", [{{0.0, 1000.0}, {500.0, 1000.0}}]},
            {"viewBox='-50 -50 100 100'", [{{500.0, 500.0}, {1000.0, 500.0}}]},
            {"viewBox='0 0 100 50'", [{{0.0, 750.0}, {500.0, 750.0}}]},
            {"width='100' height='200'", [{{250.0, 1000.0}, {500.0, 1000.0}}]},
            {"width='1in' height='96px'", [{{0.0, 1000.0}, {520.833, 1000.0}}]},
            {"width='100%' height='100%'", [{{0.0, 500.0}, {1000.0, 500.0}}]},
            {"", [{{0.0, 500.0}, {1000.0, 500.0}}]},
            %% The line sticks out of the viewBox, so its own box counts.
            {"viewBox='0 0 40 40'", [{{0.0, 500.0}, {1000.0, 500.0}}]}
        ]
    ].

area_test() ->
    {ok, Picture} = starl_picture:parse(
        svg("<path d='M0 0L100 100'/>"),
        #{area => {100, 200, 300, 900}}
    ),
    ?assertEqual([{{100.0, 650.0}, {300.0, 450.0}}], starl_picture:segments(Picture)).

title_test_() ->
    [
        ?_assertEqual(Title, starl_picture:title(ok(svg(Body ++ "<path d='M1 1h1'/>"))))
     || {Body, Title} <- [
            {"<title> My\n <!-- x -->house &amp; tree </title>", "My house & tree"},
            {"<g><title>no</title></g>", ""},
            {"", ""}
        ]
    ].

caller_mistakes_test_() ->
    [
        ?_assertError(badarg, starl_picture:parse(svg("<path d='M1 1h1'/>"), Options))
     || Options <- [
            #{area => {0, 0, 0, 1}},
            #{area => ?AREA, tolerance_mm => 0.0},
            #{area => ?AREA, max_segments => 0}
        ]
    ].

%%% Errors: what, where, what to do

errors_test_() ->
    [
        ?_test(check_error(Reason, Words, Document))
     || {Reason, Words, Document} <- of_documents() ++ of_elements()
    ].

of_documents() ->
    [
        {empty, ["empty"], ""},
        {empty, ["empty"], " \n"},
        {{not_xml, unknown}, ["not an SVG"], "hello"},
        {{not_xml, png}, ["PNG"], [16#89, "PNG\r\n"]},
        {{wrong_root, "html"}, ["\"html\"", "<svg>"], "<html/>"},
        {{wrong_root, "svg"}, ["<svg>"], "<svg xmlns='urn:other'/>"},
        {no_lines(#{}), ["no lines"], svg("<g/>")},
        {no_lines(#{}), ["no lines"], svg("<path d='M1 1'/>")},
        {no_lines(#{texts => 1}), ["convert the text to paths"], svg("<text>StarL</text>")},
        {no_lines(#{images => 1}), ["trace"], svg("<image width='9' height='9'/>")},
        {
            no_lines(#{unseen => 1}),
            ["only shape", "stroke"],
            svg("<path d='M1 1h9v9' stroke='none' fill='none'/>")
        },
        {{truncated, 3}, ["line 3", "ends"], "<svg>\n<g>\n<path d='M1 1"},
        {{truncated, 2}, ["line 2", "ends"], "<svg>\n<g>"},
        {{too_deep, 1}, ["nested"], svg(lists:duplicate(300, "<g>"))}
    ].

of_elements() ->
    [
        {
            {bad_path, {<<"path">>, <<"p">>, 2}, 5, expected_number},
            ["line 2", "<path id=\"p\">", "character 6"],
            "<svg>\n<path id='p' d='M1 1L'/></svg>"
        },
        {
            {bad_number, {<<"circle">>, none, 1}, <<"r">>, <<"five">>},
            ["<circle>", "\"five\"", " r "],
            svg("<circle r='five'/>")
        },
        {
            {bad_number, {<<"circle">>, none, 1}, <<"r">>, <<"-5">>},
            ["<circle>", "\"-5\""],
            svg("<circle r='-5'/>")
        },
        {
            {bad_number, {<<"polyline">>, none, 1}, <<"points">>, <<"1 2 3">>},
            ["points"],
            svg("<polyline points='1 2 3'/>")
        },
        {
            {bad_number, {<<"svg">>, none, 1}, <<"viewBox">>, <<"0 0 0 5">>},
            ["viewBox"],
            "<svg viewBox='0 0 0 5'/>"
        },
        {
            {bad_transform, {<<"g">>, none, 1}, <<"spin(3)">>},
            ["<g>", "\"spin(3)\"", "rotate"],
            svg("<g transform='spin(3)'/>")
        },
        {
            {bad_reference, {<<"use">>, none, 1}, <<"#a">>},
            ["<use>", "\"#a\""],
            svg("<use href='#a'/>")
        },
        {
            {bad_reference, {<<"use">>, none, 1}, <<"/etc/passwd#a">>},
            ["<use>"],
            svg("<use href='/etc/passwd#a'/>")
        },
        {
            {use_too_deep, {<<"use">>, none, 1}},
            ["without end"],
            svg("<g id='a'><use href='#a'/></g>")
        }
    ].

malformed_test_() ->
    [
        ?_assertMatch({error, {bad_xml, 2, _}}, parse(["<svg>\n", Body]))
     || Body <- [
            "<g></h></svg>",
            "<g a=1/></svg>",
            "<g a='1' a='2'/></svg>",
            "</svg>junk",
            "<path d='M0 0<'/></svg>"
        ]
    ].

files_test() ->
    Options = #{area => ?AREA},
    {error, Missing} = starl_picture:read("no/such/file.svg", Options),
    ?assertEqual({cannot_read, "no/such/file.svg", missing}, Missing),
    ?assertEqual({error, {cannot_read, ".", directory}}, starl_picture:read(".", Options)),
    [
        ?assertMatch(<<"cannot read ", _/binary>>, line({cannot_read, "a.svg", Why}))
     || Why <- [missing, directory, no_permission, too_big, badarg, enospc]
    ].

title_of_file_test() ->
    File = temporary("drawing one.svg", svg("<path d='M1 1h1'/>")),
    {ok, Picture} = starl_picture:read(File, #{area => ?AREA}),
    ok = file:del_dir_r(filename:dirname(File)),
    ?assertEqual("drawing one", starl_picture:title(Picture)).

%%% Limits

too_big_test_() ->
    {timeout, 20, fun() ->
        File = temporary("big.svg", binary:copy(<<" ">>, 20_000_001)),
        Result = starl_picture:read(File, #{area => ?AREA}),
        ok = file:del_dir_r(filename:dirname(File)),
        ?assertEqual({error, {cannot_read, File, too_big}}, Result)
    end}.

%% 200,000 segments in one path, one polyline, or as many elements, are refused: ten times as many
%% as 20,000, and at most ten times the work.
many_segments_test_() ->
    Points = fun(Many) ->
        [
            [" ", integer_to_list(I * 7919 rem 1000), " ", integer_to_list(I * 104729 rem 997)]
         || I <- lists:seq(1, Many)
        ]
    end,
    Refused = fun(Body) ->
        {Work, Result} = starl_platform_ct:work(fun() -> parse(svg(Body)) end),
        ?assertEqual({error, {too_many_segments, 5000}}, Result),
        Work
    end,
    [
        {timeout, 60,
            ?_test(begin
                Fewer = Refused(Body(Few)),
                Many = Refused(Body(10 * Few)),
                ?assert(Many < 13 * Fewer, {Fewer, Many})
            end)}
     || {Few, Body} <- [
            {20_000, fun(Many) -> ["<path d='M0 0", Points(Many), "'/>"] end},
            {20_000, fun(Many) -> ["<polyline points='", Points(Many), "'/>"] end},
            {20_000, fun(Many) ->
                [["<line x2='5' y2='", integer_to_list(N), "'/>"] || N <- lists:seq(1, Many)]
            end}
        ]
    ].

limit_is_exact_test() ->
    Document = svg([["<path d='M0 ", integer_to_list(Y), "h9'/>"] || Y <- lists:seq(1, 10)]),
    Parse = fun(Max) -> starl_picture:parse(Document, #{area => ?AREA, max_segments => Max}) end,
    ?assertMatch({ok, _}, Parse(10)),
    ?assertEqual({error, {too_many_segments, 9}}, Parse(9)).

%% Ten references each on thirty levels would be 10^30 shapes.
use_bomb_test_() ->
    {timeout, 20, fun() ->
        Level = fun(I) ->
            Use = io_lib:format("<use href='#a~b'/>", [I - 1]),
            [io_lib:format("<g id='a~b'>", [I]), lists:duplicate(10, Use), "</g>"]
        end,
        [
            begin
                Document = svg([
                    "<defs><g id='a0'>",
                    Leaf,
                    "</g>",
                    lists:map(Level, lists:seq(1, 30)),
                    "</defs><use href='#a30'/>"
                ]),
                ?assertEqual({error, Reason}, parse(Document))
            end
         || {Leaf, Reason} <- [
                {"", too_complex},
                {"<path d='M0 0h1'/>", {too_many_segments, 5000}}
            ]
        ]
    end}.

%%% Shipped pictures

shipped_test_() ->
    [
        ?_test(begin
            Options = #{area => {0.0, 0.0, 10000.0, 10000.0}},
            {ok, Picture} = starl_picture:read(filename:join(pictures(), Name ++ ".svg"), Options),
            Segments = starl_picture:segments(Picture),
            ?assert(length(Segments) >= Least andalso length(Segments) =< Most, length(Segments)),
            ?assertNotEqual("", starl_picture:title(Picture)),
            [
                ?assert(X >= 0.0 andalso X =< 10000.0 andalso Y >= 0.0 andalso Y =< 10000.0)
             || {P, Q} <- Segments, {X, Y} <- [P, Q]
            ],
            ?assertEqual(length(Segments), sets:size(sets:from_list(Segments)))
        end)
     || {Name, Least, Most} <- [
            {"house", 100, 600},
            {"text", 100, 600},
            {"curve", 300, 600},
            {"lines", 20, 30},
            {"rocket", 100, 600},
            {"snowflake", 50, 100}
        ]
    ].

%%% Any input: a picture or one printable line

fuzz_test_() ->
    {timeout, 60, fun() ->
        Seed =
            case os:getenv("STARL_SEED") of
                false -> 411;
                Text -> list_to_integer(Text)
            end,
        Files = filelib:wildcard(filename:join(pictures(), "*.svg")),
        Documents = [element(2, {ok, _} = file:read_file(File)) || File <- lists:sort(Files)],
        lists:foldl(
            fun(N, Random) -> fuzz(N, Seed, Documents, Random) end,
            rand:seed_s(exsss, Seed),
            lists:seq(1, 1500)
        )
    end}.

fuzz(N, Seed, Documents, Random0) ->
    {Pick, Random1} = rand:uniform_s(length(Documents), Random0),
    {Flips, Random2} = rand:uniform_s(6, Random1),
    {Bytes, Random} = mutate(Flips, lists:nth(Pick, Documents), Random2),
    try parse(Bytes) of
        {ok, Picture} -> ?assert(is_list(starl_picture:segments(Picture)));
        {error, Reason} -> ?assert(printable(line(Reason)), {seed, Seed, N, Reason})
    catch
        Class:Why:Stack -> ?assert(false, {seed, Seed, N, Bytes, Class, Why, Stack})
    end,
    Random.

mutate(Flips, Bytes, Random) when Flips =:= 0; Bytes =:= <<>> ->
    {Bytes, Random};
mutate(Flips, Bytes, Random0) ->
    {At, Random1} = rand:uniform_s(byte_size(Bytes), Random0),
    {Kind, Random2} = rand:uniform_s(8, Random1),
    {Byte, Random3} = rand:uniform_s(256, Random2),
    <<Before:(At - 1)/binary, Old, After/binary>> = Bytes,
    Alphabet = <<"0123456789.,-+eE \"'<>/&;#()%MmLlHhVvCcSsQqTtAaZz">>,
    Common = binary:at(Alphabet, Byte rem byte_size(Alphabet)),
    New =
        case Kind of
            1 -> <<Before/binary, Old>>;
            2 -> <<Before/binary, (Old bxor (1 bsl (Byte rem 8))), After/binary>>;
            3 -> <<Before/binary, (Byte - 1), After/binary>>;
            4 -> <<Before/binary, (binary:copy(<<Old>>, Byte))/binary, After/binary>>;
            5 -> <<Before/binary, After/binary, " ">>;
            6 -> <<Before/binary, "1e9", After/binary>>;
            _ -> <<Before/binary, Common, After/binary>>
        end,
    mutate(Flips - 1, New, Random3).

%%% Helpers

check_error(Reason, Words, Document) ->
    ?assertEqual({error, Reason}, parse(Document)),
    Line = line(Reason),
    ?assert(printable(Line), Line),
    [?assertNotEqual(nomatch, string:find(Line, Word), {Word, Line}) || Word <- Words].

no_lines(Some) ->
    None = #{
        texts => 0, images => 0, markers => 0, clips => 0, backgrounds => 0, unseen => 0
    },
    {no_lines, maps:merge(None, Some)}.

line(Reason) -> iolist_to_binary(starl_picture:format_error(Reason)).

printable(Line) ->
    case unicode:characters_to_list(Line) of
        [_ | _] = Text -> lists:all(fun(C) -> C >= 32 andalso C =/= 127 end, Text);
        _ -> false
    end.

parse(Document) -> starl_picture:parse(iolist_to_binary(Document), #{area => ?AREA}).

ok(Document) ->
    {ok, Picture} = parse(Document),
    Picture.

segments(Document) -> starl_picture:segments(ok(Document)).

svg(Body) ->
    iolist_to_binary([
        "<svg xmlns='http://www.w3.org/2000/svg' "
        "xmlns:xlink='http://www.w3.org/1999/xlink' viewBox='0 0 100 100' stroke='black'>",
        Body,
        "</svg>"
    ]).

root(Text) -> ["<svg xmlns='http://www.w3.org/2000/svg' stroke='black' ", Text].

drawn(Body) -> lists:sort(segments(svg(Body))).

floor_lines(Lines) ->
    [
        {{X0 * 10.0, 1000.0 - Y0 * 10.0}, {X1 * 10.0, 1000.0 - Y1 * 10.0}}
     || [X0, Y0, X1, Y1] <- Lines
    ].

closed(Segments) ->
    {Starts, Ends} = lists:unzip(Segments),
    lists:sort(Starts) =:= lists:sort(Ends).

radius({X, Y}, {CX, CY}, RX, RY) ->
    {A, B} = {(X - CX) / RX, (Y - CY) / RY},
    math:sqrt(A * A + B * B).

middle({{X0, Y0}, {X1, Y1}}) -> {(X0 + X1) / 2.0, (Y0 + Y1) / 2.0}.

distance({X0, Y0}, {X1, Y1}) -> math:sqrt((X1 - X0) * (X1 - X0) + (Y1 - Y0) * (Y1 - Y0)).

temporary(Name, Bytes) ->
    Unique = integer_to_list(erlang:unique_integer([positive])),
    Dir = filename:join(["/tmp", "starl_picture_" ++ os:getpid() ++ "_" ++ Unique]),
    File = filename:join(Dir, Name),
    ok = filelib:ensure_dir(File),
    ok = file:write_file(File, Bytes),
    File.

%% Beside the application, or beside the source where there is no application.
pictures() ->
    case code:priv_dir(starl_apps) of
        {error, bad_name} ->
            Source = proplists:get_value(source, ?MODULE:module_info(compile)),
            filename:join([filename:dirname(Source), "../../starl_apps/priv/pictures"]);
        Priv ->
            filename:join(Priv, "pictures")
    end.
