%% @doc The parts that the pictures of a film have in common. The unit of the SVG is a millimetre of floor,
%% with y downwards. A pure module.
-module(starl_film_draw).

-export([
    page/1,
    open/3,
    plan/2,
    drawing/3,
    obstacle/2,
    target/2,
    body/2,
    style/1,
    place/2,
    path/1,
    number/1,
    colour/1
]).

-export_type([page/0, look/0]).

%% The size of the floor, of the foot and of one dot, in mm: the longer side has 800 dots; the number and the
%% height of strips with curves in the foot.
-type page() :: #{
    width := integer(),
    height := integer(),
    dot := float(),
    foot := float(),
    strips := non_neg_integer(),
    strip := float()
}.

-type look() :: day | night.

-define(RADIUS_MM, 165).
-define(DOTS, 800).
-define(FOOT_DOTS, 44).
-define(STRIP_DOTS, 116).

%% @doc The page of a scene.
-spec page(starl_film_cast:scene()) -> page().
page(#{floor := {Width, Height}, curves := Curves}) ->
    Dot = max(Width, Height) / ?DOTS,
    #{
        width => round(Width),
        height => round(Height),
        dot => Dot,
        foot => (?FOOT_DOTS + ?STRIP_DOTS * length(Curves)) * Dot,
        strips => length(Curves),
        strip => ?STRIP_DOTS * Dot
    }.

%% @doc The head of a picture, with a foot below the floor or without.
-spec open(look(), foot | bare, page()) -> iolist().
open(Look, Foot, #{width := Width, height := Height, dot := Dot} = Page) ->
    Below =
        case Foot of
            foot -> maps:get(foot, Page);
            bare -> 0.0
        end,
    Full = Height + Below,
    [
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"",
        number(2 * round(Width / Dot / 2)),
        "\" height=\"",
        number(2 * round(Full / Dot / 2)),
        "\" viewBox=\"0 0 ",
        [number(Width), $\s, number(Full)],
        "\">\n<rect width=\"100%\" height=\"100%\"",
        ground(Look),
        "/>\n"
    ].

ground(day) -> " class=\"p\" fill=\"#fff\"";
ground(night) -> " fill=\"#06070d\"".

%% A film within a dark page is dark: browsers ask the reader's setting for pictures, too.
dark() ->
    "@media(prefers-color-scheme:dark){.p,.b{fill:#0d1117}.t{stroke:#3d444d}"
    ".e{fill:#2a2f36}text{fill:#d1d7e0}}".

%% @doc The styles of ink, robots and letters.
-spec style(page()) -> iolist().
style(#{dot := Dot}) ->
    [
        "<style>.i{fill:none;stroke-linecap:round;stroke-linejoin:round;stroke-width:",
        number(3.5 * Dot),
        "}.t{fill:none;stroke:#d4d4d4;stroke-linecap:round;stroke-width:",
        number(1.5 * Dot),
        "}.b{fill:#fff;fill-opacity:.85;stroke-width:",
        number(2.5 * Dot),
        "}text{font-family:sans-serif;fill:#303030}",
        dark(),
        "</style>\n"
    ].

%% @doc The walls of the floor plan, with doors and names.
-spec plan(starl_floor:t() | none, page()) -> iolist().
plan(none, _Page) -> [];
plan(Plan, #{dot := Dot}) -> starl_picture_floor:svg(Plan, Dot).

%% @doc What stands in the way for a time.
-spec obstacle([starl_geometry:segment()], page()) -> iolist().
obstacle(Sides, #{height := Height, dot := Dot}) ->
    starl_picture_floor:obstacle(Sides, float(Height), Dot).

%% @doc The lines that are to be painted.
-spec target([{starl_geometry:point(), starl_geometry:point()}], page()) -> iolist().
target([], _Page) ->
    [];
target(Lines, Page) ->
    [
        "<path class=\"t\" d=\"",
        [path([place(A, Page), place(B, Page)]) || {A, B} <- Lines],
        "\"/>\n"
    ].

%% @doc A robot at the origin, which looks to the right; and its number, which does not turn.
-spec body(starl:robot_id(), page()) -> {Body :: iodata(), Number :: iodata()}.
body(Id, #{dot := Dot}) ->
    Colour = colour(Id),
    {
        [
            "<circle class=\"b\" r=\"",
            number(?RADIUS_MM),
            "\" stroke=\"",
            Colour,
            "\"/><path d=\"M",
            number(?RADIUS_MM),
            " 0h",
            number(0.45 * ?RADIUS_MM),
            "\" stroke=\"",
            Colour,
            "\" stroke-linecap=\"round\" stroke-width=\"",
            number(3.5 * Dot),
            "\"/>"
        ],
        digits(integer_to_list(Id))
    }.

digits(Digits) ->
    Size = ?RADIUS_MM * 2.4 / (1 + length(Digits)),
    [
        "<text text-anchor=\"middle\" y=\"",
        number(0.36 * Size),
        "\" font-size=\"",
        number(Size),
        "\">",
        Digits,
        "</text>"
    ].

%% @doc A place of the floor on the page, in whole millimetres.
-spec place({number(), number()}, page()) -> {integer(), integer()}.
place({X, Y}, #{height := Height}) -> {round(X), Height - round(Y)}.

%% @doc The data of a path.
-spec path([{integer(), integer()}, ...]) -> iolist().
path([{X, Y} | Points]) ->
    [$M, integer_to_list(X), comma(Y), $l | steps({X, Y}, Points)].

steps(_From, []) -> "0 0";
steps({X0, Y0}, [{X, Y}]) -> step(X - X0, Y - Y0);
steps({X0, Y0}, [{X, Y} | Points]) -> [step(X - X0, Y - Y0), $\s | steps({X, Y}, Points)].

step(X, Y) -> [integer_to_list(X), comma(Y)].

comma(N) when N < 0 -> integer_to_list(N);
comma(N) -> [$,, integer_to_list(N)].

%% @doc A number with at most one decimal.
-spec number(number()) -> iodata().
number(N) when is_integer(N) -> integer_to_list(N);
number(N) -> float_to_binary(float(N), [{decimals, 1}, compact]).

%% @doc What an application draws.
-spec drawing(starl:robot_id(), starl_drawing:t(), page()) -> iolist().
drawing(Robot, Drawing, #{height := Height, dot := Dot}) ->
    starl_picture_drawing:svg(starl_picture_draw:colour(Robot), Drawing, Height, Dot).

%% @doc The colour of a robot, as in the pictures of its run.
-spec colour(starl:robot_id()) -> string().
colour(Id) -> starl_picture_draw:colour(Id).
