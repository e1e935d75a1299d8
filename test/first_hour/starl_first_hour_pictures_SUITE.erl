%% The first hour with pictures of one's own: what other programs write is painted as rsvg-convert
%% shows it, a picture can be looked at before it is painted, and mistakes are told with the remedy.
%%
%% The pictures in the folder pictures/ are written in the manner of four makers: drawing programs,
%% tracers, diagrams, plots. Each hides something that must not be painted.
-module(starl_first_hour_pictures_SUITE).
-include_lib("stdlib/include/assert.hrl").

-export([suite/0, all/0]).
-export([drawings/1, traces/1, diagrams/1, plots/1]).
-export([a_wrong_reader_is_noticed/1, what_is_left_out_is_counted/1]).
-export([a_picture_is_looked_at/1, a_run_tells_what_was_left_out/1, mistakes_are_told/1]).

-import(starl_first_hour_ct, [sh/2, contains/2, write/2]).

suite() -> [{timetrap, {minutes, 5}}].

all() ->
    [
        drawings,
        traces,
        diagrams,
        plots,
        a_wrong_reader_is_noticed,
        what_is_left_out_is_counted,
        a_picture_is_looked_at,
        a_run_tells_what_was_left_out,
        mistakes_are_told
    ].

%% -- as rsvg-convert shows them -------------------------------------------------------------

drawings(Config) -> as_shown("drawing", Config).

traces(Config) -> as_shown("tracer", Config).

diagrams(Config) -> as_shown("diagram", Config).

plots(Config) -> as_shown("plot", Config).

as_shown(Maker, Config) ->
    Files = filelib:wildcard(filename:join([pictures(), Maker, "*.svg"])),
    ?assertEqual(10, length(Files)),
    [
        ?assertMatch({_, #{wrong := [], missed := []}}, {File, compare(File, File, Config)})
     || File <- Files
    ].

%% The comparison must fail for a reader that ignores what these pictures say: we give ours the
%% picture without it.
a_wrong_reader_is_noticed(Config) ->
    [
        begin
            File = filename:join(pictures(), Name ++ ".svg"),
            {ok, Bytes} = file:read_file(File),
            Changed = iolist_to_binary(re:replace(Bytes, From, To, [dotall])),
            ?assertNotEqual(Bytes, Changed, {Name, From}),
            Other = filename:join(proplists:get_value(priv_dir, Config), "changed.svg"),
            write(Other, Changed),
            ?assertMatch({_, _, [_, _ | _]}, {Name, From, differing(Kind, Other, File, Config)})
        end
     || {Kind, Name, From, To} <- [
            %% a sheet, a class, an identifier, visibility, opacity, a clipping path unread
            {wrong, "drawing/illustrator_cc", "\\.st4\\{opacity:0;\\}", ""},
            {wrong, "drawing/illustrator_cc", "class=\"st0\"", ""},
            {wrong, "drawing/inkscape_hidden", "#mitte", "#x"},
            {wrong, "drawing/inkscape_hidden", "hidden", "visible"},
            {wrong, "drawing/inkscape_hidden", "opacity:0\"", "opacity:1\""},
            {wrong, "drawing/figma", "clip-path=\"url\\(#clip1[^\"]*\"", ""},
            {wrong, "plot/d3", "\\.bar\\.empty", ".x"},
            {wrong, "diagram/graphviz_invis", "fill=\"none\" stroke=\"none\"", "fill=\"red\""},
            %% a shape, its place, its way of fitting into a window
            {missed, "drawing/inkscape_layers", "<ellipse[^>]*>", ""},
            {missed, "tracer/potrace", "scale\\(0.1", "scale(0.12"},
            {missed, "drawing/icon", "preserveAspectRatio=\"[^\"]*\"", ""},
            {missed, "diagram/mermaid_flowchart", "link\\{stroke:#333333;", "link{"}
        ]
    ].

differing(Kind, Picture, Shown, Config) -> maps:get(Kind, compare(Picture, Shown, Config)).

compare(Picture, Shown, Config) ->
    starl_first_hour_pixels:compare(Picture, Shown, proplists:get_value(priv_dir, Config)).

pictures() ->
    filename:join([starl_first_hour_ct:root(), "test", "first_hour", "pictures"]).

what_is_left_out_is_counted(_Config) ->
    Area = {0.0, 0.0, 1000.0, 1000.0},
    [
        begin
            File = filename:join(pictures(), Name ++ ".svg"),
            {ok, Picture} = starl_picture:read(File, #{area => Area}),
            LeftOut = maps:filter(fun(_, N) -> N > 0 end, starl_picture:left_out(Picture)),
            ?assertEqual({Name, Expected}, {Name, maps:without([unseen], LeftOut)})
        end
     || {Name, Expected} <- [
            {"drawing/illustrator_cc", #{texts => 1}},
            {"drawing/illustrator_cs", #{}},
            {"drawing/figma", #{backgrounds => 1}},
            {"tracer/vtracer", #{backgrounds => 1}},
            {"tracer/inkscape_trace", #{}},
            {"diagram/drawio", #{texts => 1}},
            {"diagram/bpmn", #{texts => 1, markers => 1}},
            {"diagram/mermaid_flowchart", #{texts => 2, markers => 2}},
            {"plot/matplotlib", #{texts => 1, backgrounds => 1}},
            {"plot/r_cairo", #{backgrounds => 1}}
        ]
    ].

%% -- commands -------------------------------------------------------------------------------

-define(PICTURE,
    "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 100 100'>"
    "<rect width='100%' height='100%' fill='#eee'/><path d='M10 10H90' stroke='red'/>"
    "<text>a</text><text>b</text><text>c</text></svg>"
).

a_picture_is_looked_at(Config) ->
    Dir = dir("look", Config),
    write(filename:join(Dir, "my.svg"), ?PICTURE),
    ?assertEqual(
        {0,
            "my: 1 line segment, 17 edges after cutting, 8.0 m to paint\n"
            "at least 8 s with 2 robots at 500 mm/s, plus the ways between the lines\n"
            "3 texts left out; convert them to paths\n"
            "the page background is not painted\n"
            "result: out/picture-1/picture.png\n"
            "result: out/picture-1/picture.svg\n"},
        sh("$starl picture my.svg --robots 2", Dir)
    ),
    {ok, Png} = file:read_file(filename:join(Dir, "out/picture-1/picture.png")),
    ?assertMatch({1200, _, _}, starl_first_hour_pixels:decode(Png)).

a_run_tells_what_was_left_out(Config) ->
    Dir = dir("run", Config),
    write(filename:join(Dir, "my.svg"), ?PICTURE),
    {0, Text} = sh("$starl run painting --picture my.svg --robots 1", Dir),
    contains("\n  3 texts left out; convert them to paths\n", Text),
    contains("\n  the page background is not painted\n", Text).

mistakes_are_told(Config) ->
    Dir = dir("mistakes", Config),
    Laughs = [
        io_lib:format("<!ENTITY a~b '~s'>\n", [N, lists:duplicate(10, ["&a", $0 + N - 1, $;])])
     || N <- lists:seq(1, 9)
    ],
    write(filename:join(Dir, "laughs.svg"), [
        "<!DOCTYPE svg [\n<!ENTITY a0 'lol'>\n", Laughs, "]>\n<svg><title>&a9;</title></svg>"
    ]),
    write(filename:join(Dir, "outside.svg"), "<!DOCTYPE svg [<!ENTITY a SYSTEM 'b'>]><svg/>"),
    [
        begin
            {Status, Text} = sh(["$starl ", Line], Dir),
            ?assertEqual({Line, 2}, {Line, Status}),
            ?assertEqual({Line, "starl: " ++ Told ++ "\n"}, {Line, Text})
        end
     || {Line, Told} <- [
            {"run painting --picture hous",
                "run: cannot read \"hous\": there is no such file (did you mean house?)"},
            {"picture sun",
                "picture: cannot read \"sun\": there is no such file; give an SVG file, or one of "
                "apart, curve, hatch, house, lines, rocket, snowflake, text"},
            {"run painting --segments 99",
                "run: the picture has more than 99 line segments; simplify it, or allow a larger "
                "--tolerance or more --segments"},
            {"picture laughs.svg",
                "picture: line 6: the entities of the DOCTYPE are too long; save the picture as "
                "plain SVG"},
            {"picture outside.svg",
                "picture: line 1: the DOCTYPE declares something other than plain text entities, "
                "which is refused for safety; save the picture as plain SVG"}
        ]
    ],
    {0, Help} = sh("COLUMNS=200 $starl run painting --help", Dir),
    contains("one that ships: apart (Lines far apart), curve (Flower), ", Help).

dir(Name, Config) -> filename:join(proplists:get_value(priv_dir, Config), Name).
