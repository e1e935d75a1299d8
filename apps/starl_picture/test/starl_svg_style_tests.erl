%% @doc Contracts of styles: of each shape it is decided as in a browser whether it can be seen
%% (CSS Cascading 4; SVG 2, chapters 5, 6, 13, 14).
-module(starl_svg_style_tests).
-include_lib("eunit/include/eunit.hrl").

%% A shape of the class t and of the identifier t in a group of the class g that has a stroke.
sheets_test_() ->
    [
        ?_assertEqual({Sheet, Seen}, {Sheet, is_seen(["<style>", Sheet, "</style>", target("")])})
     || {Seen, Sheet} <- [
            {false, "path{display:none}"},
            {false, "*{stroke:none}"},
            {false, ".t{stroke:none}"},
            {false, "#t{ stroke : none ; }"},
            {false, "path.t#t{stroke:none}"},
            {false, ".x,.t{stroke:none}"},
            {false, ".g .t{stroke:none}"},
            {false, "svg>g > path{stroke:none}"},
            {false, "svg path{stroke:none}"},
            {false, ":root path{stroke:none}"},
            {true, "svg>path{stroke:none}"},
            {true, ".g.t{stroke:none}"},
            {true, ".t .g{stroke:none}"},
            {true, "g:root path{stroke:none}"},
            {true, "path:hover{stroke:none}"},
            {true, ".T{stroke:none}"},
            {false, ".g{visibility:hidden}"},
            {true, ".g{visibility:hidden}.t{visibility:visible}"},
            {false, ".g{display:none}.t{display:inline}"},
            {false, ".g{opacity:0}.t{opacity:1}"},
            {true, ".g{stroke-opacity:0}.t{stroke-opacity:1}"},
            %% specificity, then order, whatever the attribute says
            {true, ".t{stroke:red}path{stroke:none}"},
            {false, "path{stroke:none}*{stroke:red}"},
            {true, "#t{stroke:red}.g .t{stroke:none}"},
            {false, ".t{stroke:red}.t{stroke:none}"},
            {true, ".t{stroke:none}.t{stroke:red}"},
            {false, "path{stroke:none!important}#t{stroke:red}"},
            {false, "path{STROKE:None ! Important}#t{stroke:red}"},
            %% what is wrong is ignored, alone
            {true, ".t{stroke:none;stroke:light-dark(#000,#fff)}.t{stroke:red;stroke:fnord(1)}"},
            {false, ".t{stroke:none;stroke:;stroke:fnord(1)}"},
            {false, "x{.t{stroke:red}} .t{stroke:none}"},
            {false, ".t{fill:url(a;b{c);stroke:none}"},
            {false, "/* .t{stroke:red} */ .t/**/{stroke:/* red */none}"},
            {false, "<![CDATA[ .g>.t{stroke:none} ]]>"},
            {true, "@media print{.t{stroke:none}}"},
            {false, "@media screen{.t{stroke:none}}"},
            {true, "@media (prefers-color-scheme:dark){.t{stroke:none}}"},
            {false,
                "@import url(x.css);@font-face{src:url(\"}\")}@keyframes a{to{x:0}}.t{stroke:none}"}
        ]
    ].

not_a_sheet_test_() ->
    [
        ?_assert(is_seen(["<style ", Attribute, ">.t{stroke:none}</style>", target("")]))
     || Attribute <- ["type='text/less'", "media='print'"]
    ].

%% Attributes of the shape itself, with a rule for its class or without.
attributes_test_() ->
    [
        ?_assertEqual(
            {Rule, Attributes, Seen},
            {Rule, Attributes, is_seen(["<style>", Rule, "</style>", target(Attributes)])}
        )
     || {Seen, Rule, Attributes} <- [
            {false, "", "stroke='none'"},
            {true, ".t{stroke:red}", "stroke='none'"},
            {false, ".t{stroke:none}", "stroke='red'"},
            {true, ".t{stroke:none}", "style='stroke:red'"},
            {false, ".t{stroke:none!important}", "style='stroke:red'"},
            {true, ".t{stroke:none!important}", "style='stroke:red!important'"},
            {false, "", "stroke='red' style='stroke:none'"},
            {true, "", "stroke='red' style='stroke:'"},
            {true, "", "stroke='red' style='stroke:light-dark(none,none)'"},
            {false, "", "opacity='0'"},
            {false, "", "style='opacity:0%'"},
            {true, "", "opacity='.01'"},
            {false, "", "stroke-opacity='0.0'"},
            {false, "", "stroke-width='0'"},
            {false, "", "style='stroke-width:0px'"},
            {true, "", "stroke-width='-1'"},
            {false, "", "visibility='collapse'"},
            {false, "", "style='stroke:transparent'"},
            {false, "", "stroke='#fff0'"},
            {false, "", "stroke='#12345600'"},
            {false, "", "stroke='rgba(9,9,9,0)'"},
            {false, "", "stroke='rgb(0 0 0 / 0%)'"},
            {false, "", "stroke='hsla(120,100%,50%,0.0)'"},
            {true, "", "stroke='hsl(120,100%,50%)'"},
            {true, "", "stroke='white'"},
            {true, "", "stroke='rgb(100%, 0%, 0%)'"},
            {true, "", "stroke='#CD853F icc-color(acmecmyk, 0.11, 0.48)'"},
            {true, "", "stroke='currentColor'"},
            {false, "", "stroke='currentColor' color='transparent'"},
            {true, "", "stroke='inherit'"},
            {false, "", "stroke='initial'"},
            {false, "", "stroke='url(#nothing)'"},
            {true, "", "stroke='url(#nothing) red'"},
            {true, "", "stroke='url(&quot;#grad&quot;)'"},
            {false, ".g{stroke:none}", ""},
            {false, ".g{color:#0000}", "stroke='currentColor'"}
        ]
    ].

%% A fill without a stroke is painted by its boundary, if it has an inside.
fills_test_() ->
    Line = [[1, 1, 5, 1]],
    Triangle = [[1, 1, 5, 1], [5, 1, 5, 5], [5, 5, 1, 1]],
    [
        ?_assertEqual({Body, lists:sort(lines(Lines))}, {Body, drawn(Body)})
     || {Body, Lines} <- [
            {"<path d='M1 1H5V5z'/>", Triangle},
            {"<path d='M1 1H5V5'/>", Triangle},
            {"<path d='M1 1H5V5' stroke='red'/>", lists:droplast(Triangle)},
            {"<path d='M1 1H5V5' fill='none'/><path d='M1 1H5' stroke='red'/>", Line},
            {"<path d='M1 1H5V5' fill-opacity='0'/><path d='M1 1H5' stroke='red'/>", Line},
            {"<path d='M1 1H5V5' fill='none' stroke='none'/><path d='M1 1H5' stroke='red'/>", Line},
            {"<line x1='2' y2='9'/><path d='M1 1H5' stroke='red'/>", Line},
            {"<path d='M1 9H5Z'/><path d='M1 1H5' stroke='red'/>", Line},
            %% the colour of the page on the page; on something else it shows
            {"<path d='M1 1H5V5' fill='#fff'/><path d='M1 1H5' stroke='red'/>", Line},
            {"<path d='M1 1H5' stroke='red'/><path d='M1 1H5V5' fill='white'/>", Triangle}
        ]
    ].

%% Page backgrounds, in a view box of 100.
backgrounds_test_() ->
    [
        ?_test(begin
            {ok, Picture} = parse([Body, "<path d='M1 1H5' stroke='red'/>"]),
            ?assertEqual({Body, N}, {Body, maps:get(backgrounds, starl_picture:left_out(Picture))}),
            ?assertEqual({Body, N}, {Body, 2 - min(2, length(starl_picture:segments(Picture)))})
        end)
     || {N, Body} <- [
            {1, "<rect width='100%' height='100%' fill='#eee'/>"},
            {1, "<rect x='-9' y='-9' width='300' height='300'/>"},
            {1, "<rect width='100' height='100' fill='white' stroke='#ffffff'/>"},
            {1, "<g transform='scale(2)'><path d='M0 0H50V50H0z' style='fill:tan'/></g>"},
            {1, "<polygon fill='white' points='0,0 0,100 100,100 100,0 0,0'/>"},
            {0, "<rect width='100' height='100' stroke='red'/>"},
            {0, "<rect width='100' height='90'/>"},
            {0, "<rect width='100' height='100' rx='30'/>"},
            {0, "<path d='M0 0L50 9L100 0V100H0z'/>"},
            {0, "<path d='M0 0H100V100H0zM20 20V50H70z'/>"}
        ]
    ].

%% Texts and images that a browser shows are counted.
left_out_test_() ->
    [
        ?_test(begin
            {ok, Picture} = parse([Body, "<path d='M1 1H5' stroke='red'/>"]),
            Lines = starl_painting:omissions(starl_picture:left_out(Picture)),
            ?assertEqual({Body, Expected}, {Body, [lists:flatten(Line) || Line <- Lines]})
        end)
     || {Expected, Body} <- [
            {[], ""},
            {["1 text left out; convert it to a path"], "<text>a</text>"},
            {
                ["3 texts left out; convert them to paths"],
                "<g><text>a</text><text id='b'>b<tspan>c</tspan></text></g><use href='#b'/>"
            },
            {
                [],
                "<text display='none'>a</text><text fill='none'>b</text><defs><text>c</text></defs>"
            },
            {["1 image left out; trace it"], "<image width='5' height='5' href='data:'/>"},
            {[], "<image width='0' height='5'/>"},
            {
                ["the markers of 1 line (arrow heads) left out; convert them to paths"],
                "<marker id='m'/><path stroke='red' d='M1 1H5' style='marker-end:url(#m)'/>"
            },
            {["the page background is not painted"], "<rect width='100' height='100'/>"},
            %% as draw.io and mermaid write labels
            {
                ["1 text left out; convert it to a path"],
                "<switch><foreignObject width='9' height='9'/><text>a</text></switch>"
            },
            {[], "<foreignObject width='0' height='0'/>"}
        ]
    ].

%% Illustrator wraps the drawing so that other programs skip its own data.
switch_test_() ->
    [
        ?_assertEqual({Body, lines([[1, 1, 5, 1]])}, {Body, drawn(Body)})
     || Body <- [
            "<switch><foreignObject requiredExtensions='http://ns.adobe.com/i/'/>"
            "<g><path stroke='red' d='M1 1H5'/></g><g><path stroke='red' d='M1 2H5'/></g></switch>",
            "<switch><path systemLanguage='de' stroke='red' d='M1 2H5'/>"
            "<path systemLanguage='fr, en-GB' stroke='red' d='M1 1H5'/></switch>"
        ]
    ].

%% A use gives its paint to what it repeats, which keeps the rules of its own place.
uses_test_() ->
    [
        ?_assertEqual({Body, lists:sort(lines(Lines))}, {Body, drawn(Body)})
     || {Lines, Body} <- [
            {[[1, 1, 5, 1]], "<defs><path id='a' d='M1 1H5'/></defs><use href='#a' stroke='red'/>"},
            {
                [[1, 1, 5, 1]],
                "<style>.p path{stroke:red}.q path{stroke:none}</style><defs><g class='p'>"
                "<path id='a' d='M1 1H5'/></g></defs><g class='q'><use href='#a'/></g>"
            },
            {
                [[2, 2, 10, 2]],
                "<style>.a{transform:scale(2)}</style><path class='a' stroke='red' d='M1 1H5'/>"
            },
            {
                [[11, 1, 15, 1]],
                "<path style='transform:translate(10px,0)' transform='scale(9)' stroke='red' d='M1 1H5'/>"
            },
            {
                [[5, 5, 5, 9]],
                "<path style='transform:rotate(90deg);transform-origin:5px 5px' stroke='red' d='M5 5H9'/>"
            },
            %% preserveAspectRatio
            {
                [[0, 0, 40, 0]],
                "<svg width='40' height='20' viewBox='0 0 10 10' preserveAspectRatio='none'>"
                "<path stroke='red' d='M0 0H10'/></svg>"
            },
            {
                [[0, 0, 20, 0]],
                "<svg width='40' height='20' viewBox='0 0 10 10' preserveAspectRatio='xMinYMid'>"
                "<path stroke='red' d='M0 0H10'/></svg>"
            },
            {
                [[0, 0, 40, 0]],
                "<svg width='40' height='20' viewBox='0 0 10 10' preserveAspectRatio='xMaxYMin slice'>"
                "<path stroke='red' d='M0 0H10M0 9H10'/></svg>"
            },
            %% windows cut
            {
                [[0, 5, 20, 5]],
                "<svg width='20' height='20'><path stroke='red' d='M-9 5H50'/></svg>"
            },
            {
                [[-9, 5, 50, 5]],
                "<svg overflow='visible' width='20' height='20'><path stroke='red' d='M-9 5H50'/></svg>"
                "<path stroke='red' d='M-9 5H50'/>"
            }
        ],
        hd(lists:append(Lines)) >= 0
    ].

%% Clipping by shapes; what else clips is counted.
%% Holds: A window cuts lines and fills of a picture as a browser shows them, whatever names its
%% shapes; what is not followed is counted
%% Red: d7c73771, run: windows by `use`, empty ones, those cut themselves, and functions (8 cases)
clips_test_() ->
    [
        ?_test(begin
            Body = [
                "<clipPath id='c'>",
                Clip,
                "</clipPath><g clip-path='url(#c)'>",
                "<path stroke='red' d='M0 50H100'/></g>",
                "<defs><rect id='r' x='10' y='10' width='50' height='80'/></defs>"
            ],
            {ok, Picture} = parse(Body),
            ?assertEqual(
                {Clip, lines([Line]), Unknown},
                {
                    Clip,
                    starl_picture:segments(Picture),
                    maps:get(clips, starl_picture:left_out(Picture))
                }
            )
        end)
     || {Clip, Line, Unknown} <- [
            {"<rect x='10' y='10' width='50' height='80'/>", [10, 50, 60, 50], 0},
            {"<rect x='10' y='50' width='50' height='9'/>", [10, 50, 60, 50], 0},
            {"<path d='M10 10H60V90H10Z'/>", [10, 50, 60, 50], 0},
            {"<path d='M10 10V90H60V10L10 10z'/>", [10, 50, 60, 50], 0},
            {
                "<polygon points='50 0 100 50 50 100 0 50' transform='translate(50 50) scale(.5) "
                "translate(-50 -50)'/>",
                [25, 50, 75, 50],
                0
            },
            {"<path d='M0 0L50 40L100 0V100H0z'/>", [0, 50, 100, 50], 0},
            {"<path d='M0 0H60V40H20V100H0z'/>", [0, 50, 20, 50], 0},
            %% a shape elsewhere, one that is not displayed, one without an area, a title
            {"<use href='#r'/>", [10, 50, 60, 50], 0},
            {"<use href='#r' x='20' transform='translate(5 0)'/>", [35, 50, 85, 50], 0},
            {
                "<title>x</title><rect width='100' height='100' display='none'/><rect/>"
                "<rect x='10' width='50' height='90'/><use href='#none'/>",
                [10, 50, 60, 50],
                0
            },
            {"<rect width='50' height='90' clip-path='url(#c)'/>", [0, 50, 100, 50], 1},
            {"<text>x</text>", [0, 50, 100, 50], 1}
        ]
    ].

%% A window without shapes shows nothing; one that is cut itself shows what both do; those that CSS has beside
%% elements are counted.
windows_of_windows_test_() ->
    Red = "<path stroke='red' d='M0 50H100'/>",
    Blue = "<path stroke='blue' d='M0 60H100'/>",
    Below = [0, 60, 100, 60],
    Rect = "<rect x='10' y='0' width='50' height='100'/>",
    [
        ?_test(begin
            {ok, Picture} = parse([Defs, "<g clip-path='", Clip, "'>", Red, "</g>", Blue]),
            ?assertEqual(
                {Clip, Defs, lines(Lines), Unknown},
                {
                    Clip,
                    Defs,
                    starl_picture:segments(Picture),
                    maps:get(clips, starl_picture:left_out(Picture))
                }
            )
        end)
     || {Clip, Defs, Lines, Unknown} <- [
            {"url(#c)", "<clipPath id='c'/>", [Below], 0},
            {"url(#c)", "<clipPath id='c'><rect display='none'/></clipPath>", [Below], 0},
            {
                "url(#c)",
                [
                    "<clipPath id='d'><rect width='30' height='100'/></clipPath>",
                    ["<clipPath id='c' clip-path='url(#d)'>", Rect, "</clipPath>"]
                ],
                [[10, 50, 30, 50], Below],
                0
            },
            {
                "url(#c)",
                ["<clipPath id='c' clip-path='url(#c)'>", Rect, "</clipPath>"],
                [[10, 50, 60, 50], Below],
                0
            },
            {"circle(20px at 50px 50px)", "", [[0, 50, 100, 50], Below], 1},
            {"url(#none)", "", [[0, 50, 100, 50], Below], 0}
        ]
    ].

%% What a window shows of a fill has the window's edges.
clipped_fill_test_() ->
    Square = "<clipPath id='c'><rect x='20' y='20' width='60' height='60'/></clipPath>",
    Cut = fun(Shape) -> [Square, "<g clip-path='url(#c)'>", Shape, "</g>"] end,
    Half = [[20, 20, 50, 20], [50, 20, 50, 80], [20, 80, 50, 80], [20, 20, 20, 80]],
    [
        {Shape, ?_assertEqual(sides(Lines), sides_of(Cut(Shape)))}
     || {Shape, Lines} <- [
            %% the window lies inside of the fill, the fill in the window, or they cross
            {"<rect x='-10' y='-10' width='130' height='130' fill='red'/>", [
                [20, 20, 80, 20], [80, 20, 80, 80], [20, 80, 80, 80], [20, 20, 20, 80]
            ]},
            {"<rect x='30' y='30' width='20' height='20' fill='red'/>", [
                [30, 30, 50, 30], [50, 30, 50, 50], [30, 50, 50, 50], [30, 30, 30, 50]
            ]},
            {"<rect x='0' y='0' width='50' height='100' fill='red'/>", Half},
            %% along the window's own edge
            {"<rect x='20' y='0' width='30' height='100' fill='red'/>", Half},
            {"<rect x='0' y='0' width='50' height='100' fill='red' stroke='blue'/>", Half},
            {"<rect x='0' y='0' width='50' height='100' fill='none' stroke='blue'/>", [
                [50, 20, 50, 80]
            ]},
            %% a hole
            {"<path d='M0 0H100V100H0zM10 10V90H50V10z' fill='red'/>", [
                [50, 20, 50, 80], [50, 20, 80, 20], [80, 20, 80, 80], [50, 80, 80, 80]
            ]}
        ]
    ].

%% Clipped by any shape, a fill is painted as the pixels tell that a browser shows: each line has what is seen on
%% one of its sides alone, and wherever two pixels differ a line is near.
clipped_by_any_shape_test_() ->
    [
        {Clip, fun() -> same_as_pixels(Clip, In) end}
     || {Clip, In} <- [
            {"<circle cx='50' cy='50' r='30'/>", fun(X, Y) -> hypot(X - 50, Y - 50) < 30 end},
            {"<circle cx='5' cy='50' r='40'/>", fun(X, Y) -> hypot(X - 5, Y - 50) < 40 end},
            {"<ellipse cx='50' cy='50' rx='45' ry='20'/>", fun(X, Y) ->
                hypot((X - 50) / 45, (Y - 50) / 20) < 1
            end},
            %% an arrow, which is not convex
            {"<path d='M10 10L50 90L95 15L50 50z'/>", fun(X, Y) ->
                in_polygon({X, Y}, [{10, 10}, {50, 90}, {95, 15}, {50, 50}])
            end},
            %% a ring, by both rules
            {
                "<path clip-rule='evenodd' d='M10 50a40 40 0 0 1 80 0a40 40 0 0 1-80 0z"
                "M30 50a20 20 0 0 1 40 0a20 20 0 0 1-40 0z'/>",
                fun(X, Y) -> hypot(X - 50, Y - 50) < 40 andalso hypot(X - 50, Y - 50) > 20 end
            },
            {
                "<path d='M10 50a40 40 0 0 1 80 0a40 40 0 0 1-80 0z"
                "M30 50a20 20 0 0 1 40 0a20 20 0 0 1-40 0z'/>",
                fun(X, Y) -> hypot(X - 50, Y - 50) < 40 end
            },
            %% two shapes are one window
            {"<circle cx='35' cy='50' r='20'/><rect x='40' y='30' width='30' height='60'/>", fun(
                X, Y
            ) ->
                hypot(X - 35, Y - 50) < 20 orelse
                    (X > 40 andalso X < 70 andalso Y > 30 andalso Y < 90)
            end}
        ]
    ].

%% The fill is the square from 10 to 90.
same_as_pixels(Clip, In) ->
    {ok, Picture} = parse([
        "<clipPath id='c'>",
        Clip,
        "</clipPath>",
        "<g clip-path='url(#c)'><rect x='10' y='10' width='80' height='80' fill='red'/></g>"
    ]),
    ?assertEqual(0, maps:get(clips, starl_picture:left_out(Picture))),
    Lines = [
        {{X0 / 10, 100 - Y0 / 10}, {X1 / 10, 100 - Y1 / 10}}
     || {{X0, Y0}, {X1, Y1}} <- starl_picture:segments(Picture)
    ],
    Shown = fun({X, Y}) ->
        X > 10 andalso X < 90 andalso Y > 10 andalso Y < 90 andalso In(X, Y)
    end,
    [?assertEqual({Line, 1}, {Line, seen_beside(Line, Shown)}) || Line <- Lines, is_long(Line)],
    Grid = [X + 0.37 || X <- lists:seq(0, 98, 2)],
    Pairs = [{{X, Y}, {X + DX, Y + DY}} || X <- Grid, Y <- Grid, {DX, DY} <- [{2, 0}, {0, 2}]],
    Changes = [{P, Q} || {P, Q} <- Pairs, Shown(P) =/= Shown(Q)],
    ?assert(length(Changes) > 50),
    [
        ?assert(lists:min([starl_geometry:point_segment(middle(Pair), L) || L <- Lines]) < 1.2)
     || Pair <- Changes
    ].

%% On how many sides of its middle something is seen.
seen_beside({{X0, Y0}, {X1, Y1}} = Line, Shown) ->
    {X, Y} = middle(Line),
    Length = hypot(X1 - X0, Y1 - Y0),
    {NX, NY} = {0.3 * (Y0 - Y1) / Length, 0.3 * (X1 - X0) / Length},
    length([seen || Side <- [1, -1], Shown({X + Side * NX, Y + Side * NY})]).

middle({{X0, Y0}, {X1, Y1}}) -> {(X0 + X1) / 2, (Y0 + Y1) / 2}.

%% A short one may lie at a corner.
is_long({{X0, Y0}, {X1, Y1}}) -> hypot(X1 - X0, Y1 - Y0) > 1.

%% A ray to the right crosses the sides an odd number of times.
in_polygon({X, Y}, [First | Rest] = Corners) ->
    Crossed = [
        crossed
     || {{X0, Y0}, {X1, Y1}} <- lists:zip(Corners, Rest ++ [First]),
        (Y0 > Y) =/= (Y1 > Y),
        X < X0 + (Y - Y0) * (X1 - X0) / (Y1 - Y0)
    ],
    length(Crossed) rem 2 =:= 1.

hypot(X, Y) -> math:sqrt(X * X + Y * Y).

%% A background remains one in a window that shows all of the page.
clipped_background_test() ->
    {ok, Picture} = parse([
        "<clipPath id='c'><rect width='100' height='100'/></clipPath><g clip-path='url(#c)'>",
        "<rect width='100' height='100' fill='white'/><path stroke='red' d='M0 50H100'/></g>"
    ]),
    ?assertMatch([_], starl_picture:segments(Picture)),
    ?assertMatch(#{backgrounds := 1}, starl_picture:left_out(Picture)).

sides_of(Body) ->
    {ok, Picture} = parse(Body),
    sides(starl_picture:segments(Picture)).

%% In any direction and order.
sides(Lines) ->
    lists:sort([
        {min(P, Q), max(P, Q)}
     || Line <- Lines, {P, Q} <- as_segments(Line)
    ]).

as_segments({_, _} = Segment) -> [Segment];
as_segments(Line) -> lines([Line]).

%%% Helpers

target(Attributes) ->
    [
        "<g class='g' stroke='black'><path id='t' class='x2 t' d='M1 1h4v4' fill='none' ",
        Attributes,
        "/></g>"
    ].

is_seen(Body) ->
    case parse(["<linearGradient id='grad'/>", Body]) of
        {ok, _} -> true;
        {error, {no_lines, _}} -> false
    end.

drawn(Body) ->
    {ok, Picture} = parse(Body),
    lists:sort(starl_picture:segments(Picture)).

parse(Body) ->
    Document = iolist_to_binary([
        "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 100 100'>", Body, "</svg>"
    ]),
    starl_picture:parse(Document, #{area => {0.0, 0.0, 1000.0, 1000.0}}).

lines(Lines) ->
    [
        {{X0 * 10.0, 1000.0 - Y0 * 10.0}, {X1 * 10.0, 1000.0 - Y1 * 10.0}}
     || [X0, Y0, X1, Y1] <- Lines
    ].
