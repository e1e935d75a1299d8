%% Compares the lines of a picture with what rsvg-convert shows of it, pixel by pixel. An edge is a
%% pixel that differs in colour from its right or lower neighbour. Every point of our lines must lie
%% near an edge, and every edge near one of our lines: near is half the stroke, drawn with at most
%% 3 pixels, and a pixel for each of the two ways of rounding.
-module(starl_first_hour_pixels).

-export([compare/3, decode/1]).

-define(WIDTH, 400).
-define(NEAR, 3.2).
%% Of red, green, blue together: lines that are thinner than a pixel are pale.
-define(CONTRAST, 24).
%% What is left out on purpose is not shown either, nor are pointed corners longer than the stroke is
%% wide: a robot's line has no corners.
-define(LEFT_OUT, [
    "text, image, foreignObject {display: none !important}\n",
    "* {marker-start: none !important; marker-mid: none !important; marker-end: none !important;\n",
    "   stroke-linejoin: round !important; stroke-linecap: butt !important}\n"
]).

%% The pixels of our lines without an edge, and of edges without our lines; Dir is for files. The
%% lines are those of Picture; what is shown is the file Shown.
compare(Picture, Shown, Dir) ->
    {Width, Height, Rows} = rendered(Shown, Dir),
    Edges = edges(Rows, Width, Height),
    Lines = lines(segments(Picture, Width, Height), Height),
    #{
        wrong => outside(Lines, Edges),
        missed => outside(Edges, Lines),
        lines => map_size(Lines),
        edges => map_size(Edges)
    }.

rendered(File, Dir) ->
    Sheet = filename:join(Dir, "left_out.css"),
    Png = filename:join(Dir, filename:basename(File, ".svg") ++ ".png"),
    ok = filelib:ensure_dir(Sheet),
    ok = file:write_file(Sheet, ?LEFT_OUT),
    _ = file:delete(Png),
    Arguments = [
        "--width",
        integer_to_list(?WIDTH),
        "--keep-aspect-ratio",
        "--background-color",
        "white",
        "--stylesheet",
        Sheet,
        "--output",
        Png,
        File
    ],
    {0, _} = {run(os:find_executable("rsvg-convert"), Arguments), File},
    {ok, Bytes} = file:read_file(Png),
    decode(Bytes).

run(false, _Arguments) ->
    error("rsvg-convert is not installed; ./starl setup installs it (package librsvg2-bin)");
run(Program, Arguments) ->
    Port = open_port({spawn_executable, Program}, [{args, Arguments}, exit_status, hide]),
    receive
        {Port, {exit_status, Status}} -> Status
    end.

%% Our lines in pixels, y upwards from the lower edge of the image.
segments(File, Width, Height) ->
    Area = {0.0, 0.0, float(Width), float(Height)},
    Options = #{area => Area, tolerance_mm => 0.25, max_segments => 20000},
    {ok, Picture} = starl_picture:read(File, Options),
    starl_picture:segments(Picture).

%% All pixels on the segments.
lines(Segments, Height) -> maps:from_list(lists:append([pixels(S, Height) || S <- Segments])).

pixels({{X0, Y0}, {X1, Y1}}, Height) ->
    Steps = max(1, ceil(2 * max(abs(X1 - X0), abs(Y1 - Y0)))),
    [
        {{floor(X0 + (X1 - X0) * K / Steps), floor(Height - (Y0 + (Y1 - Y0) * K / Steps))}, []}
     || K <- lists:seq(0, Steps)
    ].

edges(Rows, Width, Height) ->
    Pixel = fun(X, Y) ->
        At = 3 * (min(X, Width - 1) + Width * min(Y, Height - 1)),
        <<_:At/binary, R, G, B, _/binary>> = Rows,
        {R, G, B}
    end,
    maps:from_list([
        {{X, Y}, []}
     || Y <- lists:seq(0, Height - 1),
        X <- lists:seq(0, Width - 1),
        differ(Pixel(X, Y), Pixel(X + 1, Y)) orelse differ(Pixel(X, Y), Pixel(X, Y + 1))
    ]).

differ({R0, G0, B0}, {R1, G1, B1}) ->
    abs(R0 - R1) + abs(G0 - G1) + abs(B0 - B1) > ?CONTRAST.

%% The pixels that are near none of the others.
outside(Pixels, Others) ->
    Disc = disc(),
    [
        Pixel
     || {X, Y} = Pixel <- lists:sort(maps:keys(Pixels)),
        not lists:any(fun({DX, DY}) -> is_map_key({X + DX, Y + DY}, Others) end, Disc)
    ].

%% Nearest first.
disc() ->
    Reach = lists:seq(-ceil(?NEAR), ceil(?NEAR)),
    Near = [{X * X + Y * Y, {X, Y}} || X <- Reach, Y <- Reach, X * X + Y * Y =< ?NEAR * ?NEAR],
    [Offset || {_, Offset} <- lists:sort(Near)].

%% -- PNG ------------------------------------------------------------------------------------

%% Width, height and the red, green and blue of all pixels of an image with 8 bits a component,
%% without interlacing.
decode(<<137, "PNG\r\n", 26, 10, Chunks/binary>>) ->
    <<13:32, "IHDR", Width:32, Height:32, 8, Kind, 0, 0, 0, _:32, Rest/binary>> = Chunks,
    Size =
        case Kind of
            2 -> 3;
            6 -> 4
        end,
    Raw = zlib:uncompress(iolist_to_binary(data(Rest))),
    Rows = rows(Raw, Width * Size, Size, binary:copy(<<0>>, Width * Size)),
    {Width, Height, <<<<R, G, B>> || <<R, G, B, _:(Size - 3)/binary>> <= iolist_to_binary(Rows)>>}.

data(<<Length:32, "IDAT", Bytes:Length/binary, _:32, Rest/binary>>) -> [Bytes | data(Rest)];
data(<<0:32, "IEND", _/binary>>) -> [];
data(<<Length:32, _:4/binary, _:Length/binary, _:32, Rest/binary>>) -> data(Rest).

rows(<<>>, _Length, _Size, _Above) ->
    [];
rows(Raw, Length, Size, Above) ->
    <<Filter, Bytes:Length/binary, Rest/binary>> = Raw,
    Left = lists:duplicate(Size, 0),
    Row = list_to_binary(
        unfiltered(Filter, binary_to_list(Bytes), {Left, Left}, binary_to_list(Above))
    ),
    [Row | rows(Rest, Length, Size, Row)].

%% Each byte is the difference from a guess made of the byte before it (A), above it (B) and before
%% that (C); the queues hold the last bytes, oldest first.
unfiltered(_Filter, [], _Before, []) ->
    [];
unfiltered(Filter, [Byte | Bytes], {[A | As], [C | Cs]}, [B | Bs]) ->
    Value = (Byte + guess(Filter, A, B, C)) band 255,
    [Value | unfiltered(Filter, Bytes, {As ++ [Value], Cs ++ [B]}, Bs)].

guess(0, _A, _B, _C) -> 0;
guess(1, A, _B, _C) -> A;
guess(2, _A, B, _C) -> B;
guess(3, A, B, _C) -> (A + B) div 2;
guess(4, A, B, C) -> paeth(A, B, C, abs(B - C), abs(A - C), abs(A + B - 2 * C)).

paeth(A, _B, _C, PA, PB, PC) when PA =< PB, PA =< PC -> A;
paeth(_A, B, _C, _PA, PB, PC) when PB =< PC -> B;
paeth(_A, _B, C, _PA, _PB, _PC) -> C.
