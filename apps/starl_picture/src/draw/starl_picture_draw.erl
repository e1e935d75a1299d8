%% @doc Draws a painting into a picture file. It shows the lines to paint in gray, each robot's ink
%% in a separate colour, the positions of the robots, and a legend.
%%
%% The user unit of the SVG is one millimetre of floor. Line widths and letter sizes are given in
%% dots. The longer side of the drawing has 800 dots, so a floor of any size looks the same on a
%% screen.
-module(starl_picture_draw).

-export([svg/1, write/3, colour/1, format_error/1]).
-export_type([drawing/0, reason/0]).

%% Lengths in mm, headings in radians counterclockwise from the floor's x axis.
-type drawing() :: #{
    floor := {Width :: number(), Height :: number()},
    target := [{starl_geometry:point(), starl_geometry:point()}],
    ink := #{starl:robot_id() => [[starl_geometry:point()]]},
    robots := [{starl:robot_id(), starl_geometry:point(), Heading :: float()}],
    plan => starl_floor:t() | none,
    title => unicode:chardata(),
    %% what applications draw
    drawings => [{starl:robot_id(), starl_drawing:t()}],
    %% what is to be painted is shown alone, so it is dark
    preview => boolean()
}.
-type reason() ::
    {cannot_write, file:filename(), file:posix() | badarg | terminated | system_limit}
    | {no_png, Why :: unicode:chardata()}.

-record(page, {
    %% Floor size and one dot, in mm.
    width :: float(),
    height :: float(),
    dot :: float(),
    %% Height of the title above and the legend below the floor, in mm.
    head :: float(),
    foot :: float(),
    columns :: pos_integer()
}).

-define(ROBOT_RADIUS_MM, 165.0).
-define(DOTS, 800).
-define(MARGIN_DOTS, 12).
-define(ROW_DOTS, 22).
-define(COLUMN_DOTS, 95).
%% A legend lists at most so many robots.
-define(LISTED, 64).
-define(COLOURS, 16).
-define(PNG_WIDTH, "1200").
-define(PNG_TIME_MS, 30_000).

%% @doc The drawing as an SVG document.
-spec svg(drawing()) -> binary().
svg(#{floor := Floor, target := Target, ink := Ink, robots := Robots} = Drawing) ->
    Ids = lists:usort(maps:keys(Ink) ++ [Id || {Id, _, _} <- Robots]),
    Title = maps:get(title, Drawing, ""),
    Listed = listed(Ids),
    Page = page(Floor, length(Listed), string:is_empty(Title)),
    iolist_to_binary([
        head(Page),
        title(Title, Page),
        [starl_picture_floor:svg(Plan, Page#page.dot) || #{plan := #{} = Plan} <- [Drawing]],
        target(Target, maps:get(preview, Drawing, false), Page),
        [ink(Id, maps:get(Id, Ink), Page) || Id <- Ids, is_map_key(Id, Ink)],
        [
            starl_picture_drawing:svg(colour(Id), Drawn, Page#page.height, Page#page.dot)
         || {Id, Drawn} <- maps:get(drawings, Drawing, [])
        ],
        [robot(Robot, Page) || Robot <- lists:sort(Robots)],
        legend(Listed, Page),
        "</svg>\n"
    ]).

%% @doc Writes `Name.svg' into the directory, which is made if necessary, and `Name.png', 1200
%% pixels wide, if the program `rsvg-convert' is installed. Gives the files written; `partly': the
%% SVG only, because that program has failed.
-spec write(file:filename(), string(), drawing()) ->
    {ok, [file:filename()]} | {partly, [file:filename()], reason()} | {error, reason()}.
write(Dir, Name, Drawing) ->
    Svg = filename:join(Dir, Name ++ ".svg"),
    case filelib:ensure_dir(Svg) of
        ok ->
            case file:write_file(Svg, svg(Drawing)) of
                ok -> with_png(png(Svg, filename:join(Dir, Name ++ ".png")), Svg);
                {error, Posix} -> {error, {cannot_write, Svg, Posix}}
            end;
        {error, Posix} ->
            {error, {cannot_write, Svg, Posix}}
    end.

with_png({ok, Files}, Svg) -> {ok, [Svg | Files]};
with_png({error, Reason}, Svg) -> {partly, [Svg], Reason}.

%% @doc The colour of a robot, `#rrggbb'. Sixteen consecutive robots have sixteen colours that are
%% distinguishable on white; then the colours repeat.
-spec colour(starl:robot_id()) -> string().
colour(Id) -> element((Id - 1) rem ?COLOURS + 1, palette()).

%% @doc One line of text.
-spec format_error(reason()) -> binary().
format_error({cannot_write, File, Posix}) ->
    line(io_lib:format("cannot write ~ts: ~ts", [File, file:format_error(Posix)]));
format_error({no_png, Why}) ->
    line(io_lib:format("no PNG was made: ~ts", [Why])).

line(Text) ->
    Line = unicode:characters_to_binary(Text),
    true = is_binary(Line),
    Line.

%%% The page

page({W0, H0}, Robots, Untitled) ->
    {W, H} = {float(W0), float(H0)},
    Dot = max(W, H) / (?DOTS - 2 * ?MARGIN_DOTS),
    Columns = max(1, trunc(W / (?COLUMN_DOTS * Dot))),
    Rows = (Robots + Columns - 1) div Columns,
    Head =
        case Untitled of
            true -> ?MARGIN_DOTS;
            false -> ?MARGIN_DOTS + 30
        end,
    Foot = ?MARGIN_DOTS + ?ROW_DOTS * Rows,
    #page{
        width = W,
        height = H,
        dot = Dot,
        head = Head * Dot,
        foot = Foot * Dot,
        columns = Columns
    }.

head(#page{width = W, height = H, dot = Dot, head = Head, foot = Foot}) ->
    Margin = ?MARGIN_DOTS * Dot,
    {FullW, FullH} = {W + 2 * Margin, H + Head + Foot},
    [
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"",
        number(FullW / Dot),
        "\" height=\"",
        number(FullH / Dot),
        "\" viewBox=\"",
        lists:join($\s, [number(N) || N <- [-Margin, -Head, FullW, FullH]]),
        "\">\n",
        rect({-Margin, -Head}, {FullW, FullH}, "fill=\"#ffffff\""),
        rect({0, 0}, {W, H}, ["fill=\"none\" stroke=\"#d0d0d0\" stroke-width=\"", number(Dot), $"])
    ].

rect({X, Y}, {W, H}, Style) ->
    [
        "<rect x=\"",
        number(X),
        "\" y=\"",
        number(Y),
        "\" width=\"",
        number(W),
        "\" height=\"",
        number(H),
        "\" ",
        Style,
        "/>\n"
    ].

title(Title, #page{width = W, dot = Dot, head = Head}) ->
    case string:is_empty(Title) of
        true -> [];
        false -> text({W / 2, -Head + 30 * Dot}, 20 * Dot, "middle", "#303030", Title)
    end.

text({X, Y}, Size, Anchor, Colour, Text) ->
    [
        "<text x=\"",
        number(X),
        "\" y=\"",
        number(Y),
        "\" font-family=\"sans-serif\" font-size=\"",
        number(Size),
        "\" text-anchor=\"",
        Anchor,
        "\" fill=\"",
        Colour,
        "\">",
        escape(Text),
        "</text>\n"
    ].

%%% Lines, ink, robots, legend

target([], _Preview, _Page) ->
    [];
target(Segments, Preview, #page{dot = Dot} = Page) ->
    Lines = [[$M, place(P, Page), $L, place(Q, Page)] || {P, Q} <- Segments],
    [
        "<path fill=\"none\" stroke=\"",
        shade(Preview),
        "\" stroke-linecap=\"round\" stroke-width=\"",
        number(1.5 * Dot),
        "\" d=\"",
        lists:join($\n, Lines),
        "\"/>\n"
    ].

shade(true) -> "#404040";
shade(false) -> "#c4c4c4".

ink(Id, Polylines, #page{dot = Dot} = Page) ->
    [
        "<g fill=\"none\" stroke=\"",
        colour(Id),
        "\" stroke-width=\"",
        number(3.5 * Dot),
        "\" stroke-linecap=\"round\" stroke-linejoin=\"round\">\n",
        [polyline(Polyline, Page) || Polyline <- Polylines],
        "</g>\n"
    ].

polyline([], _Page) ->
    [];
%% A lone point shows as a round dot only when it is drawn twice.
polyline([Point], Page) ->
    polyline([Point, Point], Page);
polyline(Points, Page) ->
    ["<polyline points=\"", lists:join($\s, [place(Point, Page) || Point <- Points]), "\"/>\n"].

robot({Id, Point, Heading}, Page) ->
    R = ?ROBOT_RADIUS_MM,
    Digits = integer_to_list(Id),
    Size = R * 1.9 / (1 + length(Digits)),
    [
        body(Id, Point, R, Page),
        direction(Id, Point, Heading, R, Page),
        text(label_point(Point, Size, Page), Size, "middle", "#202020", Digits)
    ].

body(Id, Point, R, #page{dot = Dot} = Page) ->
    [CX, CY] = [number(N) || N <- centre(Point, Page)],
    [
        "<circle cx=\"",
        CX,
        "\" cy=\"",
        CY,
        "\" r=\"",
        number(R),
        "\" fill=\"#ffffff\" fill-opacity=\"0.8\" stroke=\"",
        colour(Id),
        "\" stroke-width=\"",
        number(2 * Dot),
        "\"/>\n"
    ].

direction(Id, {X, Y}, Heading, R, #page{dot = Dot} = Page) ->
    Tip = {X + 1.45 * R * math:cos(Heading), Y + 1.45 * R * math:sin(Heading)},
    Rim = {X + R * math:cos(Heading), Y + R * math:sin(Heading)},
    [
        "<path fill=\"none\" stroke=\"",
        colour(Id),
        "\" stroke-width=\"",
        number(3 * Dot),
        "\" stroke-linecap=\"round\" d=\"M",
        place(Rim, Page),
        $L,
        place(Tip, Page),
        "\"/>\n"
    ].

centre({X, Y}, #page{height = H}) -> [X, H - Y].

label_point({X, Y}, Size, #page{height = H}) -> {X, H - Y + 0.36 * Size}.

%% The colours repeat, so that a large team needs no entry for each robot.
listed(Ids) when length(Ids) =< ?LISTED ->
    [{Id, ["robot ", integer_to_list(Id)]} || Id <- Ids];
listed(Ids) ->
    listed(lists:sublist(Ids, ?COLOURS)) ++ [{lists:last(Ids), "and so on"}].

legend(Listed, Page) ->
    [legend_entry(N, Entry, Page) || {N, Entry} <- lists:enumerate(0, Listed)].

legend_entry(N, {Id, Text}, #page{height = H, dot = Dot, columns = Columns}) ->
    X = N rem Columns * ?COLUMN_DOTS * Dot,
    Y = H + (?ROW_DOTS * (N div Columns) + 15) * Dot,
    [
        rect({X, Y - 6 * Dot}, {18 * Dot, 8 * Dot}, ["fill=\"", colour(Id), $"]),
        text(
            {X + 24 * Dot, Y + 3 * Dot},
            14 * Dot,
            "start",
            "#303030",
            Text
        )
    ].

%%% Text

place(Point, Page) -> lists:join($,, [number(N) || N <- centre(Point, Page)]).

%% At most one decimal: a tenth of a millimetre.
number(N) ->
    Tenths = round(N * 10),
    Sign =
        case Tenths < 0 of
            true -> "-";
            false -> ""
        end,
    [Sign, integer_to_list(abs(Tenths) div 10) | decimal(abs(Tenths) rem 10)].

decimal(0) -> [];
decimal(D) -> [$., $0 + D].

escape(Text) ->
    unicode:characters_to_binary([escaped(C) || C <- unicode:characters_to_list(Text)]).

escaped($<) -> "&lt;";
escaped($>) -> "&gt;";
escaped($&) -> "&amp;";
escaped(C) when C < 32; C =:= 16#FFFE; C =:= 16#FFFF -> $\s;
escaped(C) -> C.

%% Chosen greedily to maximize the least distance in CIE L*a*b*, also from white and the gray lines.
palette() ->
    {"#e6194b", "#3cb44b", "#4363d8", "#f58231", "#78005a", "#00b4ff", "#ff00ff", "#5a5a0f",
        "#00d2b4", "#5a0000", "#c3b400", "#0000ff", "#ff9696", "#006969", "#ff00a5", "#ff96f0"}.

%%% PNG

png(Svg, Png) ->
    case os:find_executable("rsvg-convert") of
        false ->
            {ok, []};
        Program ->
            _ = file:delete(Png),
            Arguments = [
                "--width",
                ?PNG_WIDTH,
                "--keep-aspect-ratio",
                "--output",
                filename:absname(Png),
                filename:absname(Svg)
            ],
            made(run(Program, Arguments), Png)
    end.

%% Half a picture is none.
made({0, Text}, Png) ->
    case filelib:is_regular(Png) of
        true -> {ok, [Png]};
        false -> {error, {no_png, said(Text)}}
    end;
made({_, Text}, Png) ->
    _ = file:delete(Png),
    {error, {no_png, said(Text)}}.

said(Text) ->
    case string:trim(lists:last(string:split(string:trim(Text), "\n", all))) of
        <<>> -> "rsvg-convert has failed";
        Last -> ["rsvg-convert: ", Last]
    end.

run(Program, Arguments) ->
    Options = [{args, Arguments}, exit_status, stderr_to_stdout, binary, hide],
    Port = open_port({spawn_executable, Program}, Options),
    Timer = erlang:start_timer(?PNG_TIME_MS, self(), Port),
    Ended = ended(Port, Timer, <<>>),
    _ = erlang:cancel_timer(Timer),
    receive
        {timeout, Timer, Port} -> Ended
    after 0 -> Ended
    end.

ended(Port, Timer, Text) ->
    receive
        {Port, {data, More}} ->
            ended(Port, Timer, <<Text/binary, More/binary>>);
        {Port, {exit_status, Status}} ->
            {Status, Text};
        {timeout, Timer, Port} ->
            true = port_close(Port),
            {timeout, <<"it takes too long">>}
    end.
