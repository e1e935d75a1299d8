%% @doc Runs the programs that make PNG and video files: `rsvg-convert' and `ffmpeg'.
-module(starl_film_program).

-export([is_there/1, png/3, video/4, format_error/1]).

-export_type([reason/0]).

-type reason() :: {absent, Program :: string()} | {failed, Program :: string(), Said :: binary()}.

-define(TIME_MS, 600000).

%% @doc Is a program at hand?
-spec is_there(string()) -> boolean().
is_there(Program) -> os:find_executable(Program) =/= false.

%% @doc Draws an SVG file into a PNG file, so many pixels wide.
-spec png(file:filename(), file:filename(), Width :: pos_integer()) -> ok | {error, reason()}.
png(Svg, Png, Width) ->
    run("rsvg-convert", [
        "--width",
        integer_to_list(Width),
        "--keep-aspect-ratio",
        "--unlimited",
        "--output",
        filename:absname(Png),
        filename:absname(Svg)
    ]).

%% @doc Joins pictures, numbered as in the pattern `frame-%06d.png', to a video; the name of the
%% file decides its kind.
-spec video(Pattern :: file:filename(), Rate :: pos_integer(), mp4 | gif, file:filename()) ->
    ok | {error, reason()}.
video(Pattern, Rate, Kind, File) ->
    Input = [
        "-nostdin", "-loglevel", "error", "-y", "-framerate", integer_to_list(Rate), "-i", Pattern
    ],
    run("ffmpeg", Input ++ coding(Kind) ++ [filename:absname(File)]).

coding(mp4) ->
    [
        "-c:v",
        "libx264",
        "-pix_fmt",
        "yuv420p",
        "-crf",
        "20",
        "-movflags",
        "+faststart",
        "-f",
        "mp4"
    ];
coding(gif) ->
    Palette = "split[a][b];[a]palettegen=stats_mode=diff[p];[b][p]paletteuse=dither=none",
    ["-vf", Palette, "-f", "gif"].

run(Program, Arguments) ->
    case os:find_executable(Program) of
        false -> {error, {absent, Program}};
        Path -> ran(Program, Path, Arguments)
    end.

ran(Program, Path, Arguments) ->
    Options = [{args, Arguments}, exit_status, stderr_to_stdout, binary, hide],
    Port = open_port({spawn_executable, Path}, Options),
    case ended(Port, <<>>) of
        {0, _} -> ok;
        {_, Said} -> {error, {failed, Program, Said}}
    end.

ended(Port, Said) ->
    receive
        {Port, {data, More}} ->
            ended(Port, <<Said/binary, More/binary>>);
        {Port, {exit_status, Status}} ->
            {Status, Said}
    after ?TIME_MS ->
        true = port_close(Port),
        {timeout, <<"it takes too long">>}
    end.

%% @doc One line on a problem.
-spec format_error(reason()) -> unicode:chardata().
format_error({absent, "ffmpeg"}) ->
    "the program ffmpeg is not there (Debian: apt install ffmpeg); a film as .svg needs none";
format_error({absent, "rsvg-convert"}) ->
    "the program rsvg-convert is not there (Debian: apt install librsvg2-bin); .svg needs none";
format_error({failed, Program, Said}) ->
    case string:trim(lists:last(string:split(string:trim(Said), "\n", all))) of
        <<>> -> [Program, " has failed"];
        Line -> [Program, ": ", Line]
    end.
