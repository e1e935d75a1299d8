%% @doc Writes the film of a run as one animated SVG file, without scripts. Browsers play it, also
%% as an image of another page. It shows the robots on their paths, the ink as it is drawn, and a
%% clock. It ends with the whole picture, pauses, and begins again. A program that does not animate
%% shows the whole picture. A pure module.
-module(starl_film_svg).

-export([film/2]).

-export_type([options/0]).

%% `seconds': of the film, before it rests; `once': it does not begin again.
-type options() :: #{seconds := float(), title := unicode:chardata(), once => boolean()}.

-record(film, {
    page :: starl_film_draw:page(),
    end_us :: pos_integer(),
    time :: starl_film_animate:t()
}).

-define(WAY_MM, 6.0).
-define(INK_MM, 3.0).
-define(TURN_RAD, 0.06).
%% The clock shows so many different times at most.
-define(TICKS, 400).

%% @doc The film of a scene.
-spec film(starl_film_cast:scene(), options()) -> binary().
film(#{actors := Actors, lines := Lines, end_us := End, cuts := Cuts} = Scene, Options) ->
    #{drawings := Drawings, curves := Curves} = Scene,
    #{title := Title} = Options,
    Page = starl_film_draw:page(Scene),
    Film = #film{
        page = Page,
        end_us = max(1, End),
        time = starl_film_animate:new(End, Options)
    },
    iolist_to_binary([
        starl_film_draw:open(day, foot, Page),
        ["<title>", escape(Title), "</title>\n"],
        starl_film_draw:style(Page),
        starl_film_draw:plan(maps:get(plan, Scene), Page),
        [obstacle(Obstacle, Film) || Obstacle <- maps:get(obstacles, Scene)],
        starl_film_draw:target(Lines, Page),
        [ink(Actor, Film) || Actor <- Actors],
        [drawing(Seen, Film) || Seen <- Drawings],
        [link(Link, Actors, Film) || Link <- starl_film_partitions:links(Cuts)],
        [robot(Actor, Cuts, Film) || Actor <- Actors],
        foot(Title, Film),
        curves(Curves, Film),
        "</svg>\n"
    ]).

obstacle({Sides, Span}, #film{page = Page, time = Time}) ->
    [
        ["<g opacity=\"0\">", starl_film_draw:obstacle(Sides, Page)],
        [starl_film_animate:shown([Span], Time), "</g>\n"]
    ].

%% -- ink ------------------------------------------------------------------------------------

ink(#{id := Id, ink := Strokes}, Film) ->
    [
        "<g class=\"i\" stroke=\"",
        starl_film_draw:colour(Id),
        "\">\n",
        [stroke(S, Film) || S <- Strokes],
        "</g>\n"
    ].

%% A dash as long as the line moves into sight.
stroke(Stroke, #film{page = Page} = Film) ->
    Points = [
        {T, starl_film_draw:place({X, Y}, Page)}
     || {T, [X, Y]} <- starl_film_series:thin(?INK_MM, Stroke)
    ],
    {Driven, Length} = driven(Points),
    Dash = ceil(Length) + 1,
    Keys =
        [{0, Dash + 9}, {element(1, hd(Points)), Dash + 9}] ++
            [
                {T, round(Dash - S)}
             || {T, [S]} <- starl_film_series:thin(?WAY_MM, lists:droplast(Driven))
            ] ++
            [{element(1, lists:last(Points)), 0}],
    [
        "<path d=\"",
        starl_film_draw:path([Point || {_, Point} <- Points]),
        io_lib:format("\" stroke-dasharray=\"~b ~b\">", [Dash, 2 * Dash + 20]),
        animate(
            "animate attributeName=\"stroke-dashoffset\"",
            [{T, integer_to_list(V)} || {T, V} <- Keys],
            Film
        ),
        "</path>\n"
    ].

%% The length that is drawn, by time.
driven([{T, Point} | Points]) -> driven(Points, Point, 0.0, [{T, [0.0]}]).

driven([], _Last, Length, Driven) ->
    {lists:reverse(Driven), Length};
driven([{T, {X, Y}} | Points], {X0, Y0}, Length, Driven) ->
    Longer = Length + math:sqrt((X - X0) * (X - X0) + (Y - Y0) * (Y - Y0)),
    driven(Points, {X, Y}, Longer, [{T, [Longer]} | Driven]).

%% -- what applications draw -----------------------------------------------------------------

%% What is there at the end stays; a picture without animation shows it.
drawing({0, To, Robot, Drawing}, #film{page = Page, end_us = End}) when To >= End ->
    starl_film_draw:drawing(Robot, Drawing, Page);
drawing({From, To, Robot, Drawing}, #film{page = Page, end_us = End, time = Time}) ->
    {Opacity, Keys} =
        case To >= End of
            true -> {"1", [{0, "0"}, {From, "1"}]};
            false -> {"0", [{0, "0"}, {From, "1"}, {To, "0"}]}
        end,
    [
        ["<g opacity=\"", Opacity, "\">"],
        starl_film_animate:values(
            "animate attributeName=\"opacity\" calcMode=\"discrete\"", Keys, Time
        ),
        starl_film_draw:drawing(Robot, Drawing, Page),
        "</g>\n"
    ].

%% -- robots ---------------------------------------------------------------------------------

robot(#{id := Id, way := Way, down := Down}, Cuts, #film{page = Page} = Film) ->
    {Body, Number} = starl_film_draw:body(Id, Page),
    Places = [
        {T, pair(starl_film_draw:place({X, Y}, Page))}
     || {T, [X, Y]} <- starl_film_series:thin(?WAY_MM, [{T, [X, Y]} || {T, [X, Y, _]} <- Way])
    ],
    Turns = [
        {T, integer_to_list(round(-Heading * 180 / math:pi()))}
     || {T, [Heading]} <- starl_film_series:thin(?TURN_RAD, [{T, [H]} || {T, [_, _, H]} <- Way])
    ],
    [
        ["<g", opacity(Down, Film), ">", faint(Down, Film)],
        ["<g transform=\"translate(", last(Places), ")\">"],
        animate("animateTransform attributeName=\"transform\" type=\"translate\"", Places, Film),
        ["<g transform=\"rotate(", last(Turns), ")\">"],
        animate("animateTransform attributeName=\"transform\" type=\"rotate\"", Turns, Film),
        [Body, "</g>", Number, ring(starl_film_partitions:rings(Id, Cuts), Film), "</g></g>\n"]
    ].

ring([], _Film) ->
    [];
ring(Spans, #film{page = Page, time = Time}) ->
    [
        [starl_film_partitions:ring(Page), " opacity=\"0\">"],
        [starl_film_animate:shown(Spans, Time), "</circle>"]
    ].

%% A cut link: a line between two robots that drive.
link({A, B, Span}, Actors, #film{page = Page, time = Time} = Film) ->
    Ends = [
        end_of(Key, Way, Span, Film)
     || {Key, Id} <- [{"1", A}, {"2", B}], #{id := Actor, way := Way} <- Actors, Actor =:= Id
    ],
    [
        ["<line opacity=\"0\" ", starl_film_partitions:line(Page), $>],
        [starl_film_animate:shown([Span], Time), Ends, "</line>\n"]
    ].

end_of(Key, Way, {From, To}, #film{page = Page} = Film) ->
    Points = starl_film_series:slice(From, To, [{T, [X, Y]} || {T, [X, Y, _]} <- Way]),
    Places = [
        {T, starl_film_draw:place({X, Y}, Page)}
     || {T, [X, Y]} <- starl_film_series:thin(?WAY_MM, Points)
    ],
    [
        coordinate([$x, Key], [{T, X} || {T, {X, _}} <- Places], Film),
        coordinate([$y, Key], [{T, Y} || {T, {_, Y}} <- Places], Film)
    ].

coordinate(Name, Keys, Film) ->
    Values = [{T, integer_to_list(Value)} || {T, Value} <- Keys],
    animate(["animate attributeName=\"", Name, $"], Values, Film).

pair({X, Y}) -> [integer_to_list(X), $,, integer_to_list(Y)].

last(Keys) -> element(2, lists:last(Keys)).

%% A robot that is down is faint.
opacity(Down, #film{end_us = End}) ->
    case [To || {_, To} <- Down, To >= End] of
        [] -> "";
        _ -> " opacity=\".3\""
    end.

faint([], _Film) ->
    [];
faint(Down, Film) ->
    Keys = [{0, "1"} | lists:append([[{From, ".3"}, {To, "1"}] || {From, To} <- Down])],
    Kept =
        case opacity(Down, Film) of
            "" -> Keys;
            _ -> lists:droplast(Keys)
        end,
    animate("animate attributeName=\"opacity\" calcMode=\"discrete\"", Kept, Film).

%% -- the foot: a clock, a bar of time, a title ------------------------------------------------

foot(Title, #film{page = #{width := Width, height := Height, dot := Dot}, end_us = End} = Film) ->
    Bar = animate(
        "animate attributeName=\"width\"", [{0, "0"}, {End, integer_to_list(Width)}], Film
    ),
    [
        io_lib:format("<rect class=\"e\" y=\"~b\" width=\"~b\" height=\"~b\" fill=\"#eee\"/>\n", [
            Height, Width, round(4 * Dot)
        ]),
        io_lib:format("<rect y=\"~b\" width=\"~b\" height=\"~b\" fill=\"#888\">", [
            Height, Width, round(4 * Dot)
        ]),
        Bar,
        "</rect>\n",
        io_lib:format("<text x=\"~b\" y=\"~b\" font-size=\"~b\">", [
            round(12 * Dot), round(Height + 30 * Dot), round(18 * Dot)
        ]),
        [escape(Title), "</text>\n"],
        clock(Film)
    ].

%% A mark goes over the curves with the bar.
curves([], _Film) ->
    [];
curves(Curves, #film{page = #{width := Width} = Page, end_us = End} = Film) ->
    Keys = [{0, "0,0"}, {End, [integer_to_list(Width), ",0"]}],
    [
        starl_film_curves:strips(Curves, End, Page),
        [starl_film_curves:mark(Page), io_lib:format(" transform=\"translate(~b,0)\">", [Width])],
        animate("animateTransform attributeName=\"transform\" type=\"translate\"", Keys, Film),
        "</path>\n"
    ].

%% Digits turn behind a window: an image without scripts cannot change a text.
clock(#film{page = #{width := Width, height := Height, dot := Dot}, end_us = End} = Film) ->
    Step = tick(End),
    Times = [{T, text(T)} || T <- lists:seq(0, End, Step)],
    Columns = length(element(2, lists:last(Times))),
    Texts = [{T, string:pad(Text, Columns, leading, $\s)} || {T, Text} <- Times],
    Advance = 12 * Dot,
    X0 = Width - Advance * (Columns + 1),
    Y = Height + 30 * Dot,
    Window = io_lib:format(
        "<clipPath id=\"w\"><rect x=\"0\" y=\"~b\" width=\"~b\" height=\"~b\"/></clipPath>\n", [
            round(Height + 11 * Dot), Width, round(25 * Dot)
        ]
    ),
    [
        Window,
        io_lib:format("<g clip-path=\"url(#w)\" font-size=\"~b\" text-anchor=\"middle\">\n", [
            round(20 * Dot)
        ]),
        [
            reel({X0 + Column * Advance, Y, 30 * Dot}, column(Column, Texts), Film)
         || Column <- lists:seq(1, Columns)
        ],
        "</g>\n"
    ].

tick(End) ->
    hd([
        S * 1000000
     || S <- [1, 2, 5, 10, 30, 60, 600, 3600, 86400, 1 bsl 40], End div (S * 1000000) =< ?TICKS
    ]).

text(T) ->
    Seconds = T div 1000000,
    lists:flatten(io_lib:format("~b:~2..0b", [Seconds div 60, Seconds rem 60])).

column(Column, Texts) ->
    changes([{T, lists:nth(Column, lists:flatten(Text))} || {T, Text} <- Texts]).

changes([{T, C}, {_, C} | Texts]) -> changes([{T, C} | Texts]);
changes([Text | Texts]) -> [Text | changes(Texts)];
changes([]) -> [].

%% The signs of a column, one below the other.
reel({X, Y, Down}, Changes, Film) ->
    Signs = lists:usort([C || {_, C} <- Changes]),
    Places = maps:from_list(lists:zip(Signs, lists:seq(0, length(Signs) - 1))),
    Keys = [
        {T, ["0,-", integer_to_list(round(Down * maps:get(C, Places)))]}
     || {T, C} <- Changes
    ],
    Texts = [
        io_lib:format("<text x=\"~b\" y=\"~b\">~c</text>", [round(X), round(Y + Down * N), C])
     || {C, N} <- lists:sort(maps:to_list(Places))
    ],
    ["<g transform=\"translate(", last(Keys), ")\">", turning(Keys, Film), Texts, "</g>\n"].

turning([_], _Film) ->
    [];
turning(Keys, Film) ->
    animate(
        "animateTransform attributeName=\"transform\" type=\"translate\" calcMode=\"discrete\"",
        Keys,
        Film
    ).

%% -------------------------------------------------------------------------------------------

animate(What, Keys, #film{time = Time}) -> starl_film_animate:values(What, Keys, Time).

escape(Text) ->
    unicode:characters_to_binary([escaped(C) || C <- unicode:characters_to_list(Text)]).

escaped($<) -> "&lt;";
escaped($>) -> "&gt;";
escaped($&) -> "&amp;";
escaped(C) when C < 32 -> $\s;
escaped(C) -> C.
