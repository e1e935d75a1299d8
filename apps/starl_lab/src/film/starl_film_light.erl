%% @doc The light painting of a run, as SVG: a long exposure on a dark floor. Each pen is a light,
%% which shines while it draws; the paths of the robots leave a faint trail. A pure module.
-module(starl_film_light).

-export([svg/1]).

-define(INK_MM, 3.0).
-define(WAY_MM, 20.0).

%% @doc The picture of a whole run.
-spec svg(starl_film_cast:scene()) -> binary().
svg(#{actors := Actors} = Scene) ->
    #{dot := Dot} = Page = starl_film_draw:page(Scene),
    Inks = [{Id, ink(Strokes, Page)} || #{id := Id, ink := Strokes} <- Actors],
    iolist_to_binary([
        starl_film_draw:open(night, bare, Page),
        defs(Dot),
        "<g class=\"a\" opacity=\".22\" filter=\"url(#near)\">",
        [layer(Id, way(Way, Page), 1.2 * Dot) || #{id := Id, way := Way} <- Actors],
        "</g>\n",
        glow(Inks, "far", 16 * Dot, ".55"),
        glow(Inks, "wide", 7 * Dot, ".8"),
        glow(Inks, "near", 3.5 * Dot, "1"),
        "<g class=\"a\" opacity=\".85\">",
        [core(Path, 1.3 * Dot) || {_, Path} <- Inks],
        "</g>\n</svg>\n"
    ]).

defs(Dot) ->
    [
        "<style>.a{fill:none;stroke-linecap:round;stroke-linejoin:round}"
        ".a path{mix-blend-mode:screen}</style>\n",
        [blur(Name, Dots * Dot) || {Name, Dots} <- [{"far", 14.0}, {"wide", 5.0}, {"near", 1.0}]],
        "<radialGradient id=\"floor\"><stop stop-color=\"#141826\"/>"
        "<stop offset=\"1\" stop-color=\"#06070d\"/></radialGradient>\n"
        "<rect width=\"100%\" height=\"100%\" fill=\"url(#floor)\"/>\n"
    ].

blur(Name, Deviation) ->
    [
        ["<filter id=\"", Name, "\" x=\"-10%\" y=\"-10%\" width=\"120%\" height=\"120%\">"],
        ["<feGaussianBlur stdDeviation=\"", starl_film_draw:number(Deviation), "\"/></filter>\n"]
    ].

glow(Inks, Blur, Width, Opacity) ->
    [
        ["<g class=\"a\" opacity=\"", Opacity, "\" filter=\"url(#", Blur, ")\">"],
        [layer(Id, Path, Width) || {Id, Path} <- Inks],
        "</g>\n"
    ].

layer(_Id, [], _Width) -> [];
layer(Id, Path, Width) -> line(bright(starl_film_draw:colour(Id)), Path, Width).

core([], _Width) -> [];
core(Path, Width) -> line("#fff", Path, Width).

line(Colour, Path, Width) ->
    [
        ["<path stroke=\"", Colour, "\" stroke-width=\"", starl_film_draw:number(Width)],
        ["\" d=\"", Path, "\"/>\n"]
    ].

%% Light has no dark colours.
bright([$# | Hex]) ->
    Parts = [list_to_integer(lists:sublist(Hex, N, 2), 16) || N <- [1, 3, 5]],
    Most = max(1, lists:max(Parts)),
    lists:flatten([$# | [io_lib:format("~2.16.0b", [60 + P * 195 div Most]) || P <- Parts]]).

ink(Strokes, Page) -> [path(?INK_MM, Stroke, Page) || Stroke <- Strokes].

way(Way, Page) -> path(?WAY_MM, [{T, [X, Y]} || {T, [X, Y, _]} <- Way], Page).

path(Tolerance, Points, Page) ->
    starl_film_draw:path([
        starl_film_draw:place({X, Y}, Page)
     || {_, [X, Y]} <- starl_film_series:thin(Tolerance, Points)
    ]).
