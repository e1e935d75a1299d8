%% @doc Makes the film of a run, or its light painting, from its messages.
%% ```
%%   {ok, Cast, closed} = starl_trace_reader:fold(
%%       fun starl_film_cast:message/2, starl_film_cast:new(), "run.mcap"),
%%   {ok, Scene} = starl_film_cast:scene(Cast),
%%   ok = starl_film:write(Scene, "film.svg", #{seconds => 20.0, title => "painting"})
%% '''
%% The name of the file decides its kind: an animated `.svg'; `.mp4' and `.gif' by the programs
%% `rsvg-convert' and `ffmpeg'; a light painting as `.svg' or `.png'.
-module(starl_film).

-export([kind/1, needs/2, write/3, format_error/1]).

-export_type([options/0, kind/0, reason/0]).

%% `seconds': how long the film moves. `light': the light painting instead. `progress' is told the
%% part of the frames that are done.
-type options() :: #{
    seconds := float(),
    title := unicode:chardata(),
    light => boolean(),
    once => boolean(),
    progress => fun((float()) -> ok)
}.

-type kind() :: svg | png | mp4 | gif.

-type reason() :: starl_film_program:reason() | {file, file:filename(), file:posix() | badarg}.

-define(WIDTH, 800).
-define(LIGHT_WIDTH, 1600).
-define(REST_S, 3).

%% @doc The kind of file that a name stands for.
-spec kind(file:filename()) -> kind() | unknown.
kind(File) ->
    case string:lowercase(filename:extension(File)) of
        ".svg" -> svg;
        ".png" -> png;
        ".mp4" -> mp4;
        ".gif" -> gif;
        _ -> unknown
    end.

%% @doc Checks whether anything is missing that such a film needs.
-spec needs(kind(), Light :: boolean()) -> ok | {error, reason() | kind}.
needs(svg, _Light) -> ok;
needs(png, true) -> there(["rsvg-convert"]);
needs(Kind, false) when Kind =:= mp4; Kind =:= gif -> there(["ffmpeg", "rsvg-convert"]);
needs(_Kind, _Light) -> {error, kind}.

there(Programs) ->
    case [Program || Program <- Programs, not starl_film_program:is_there(Program)] of
        [] -> ok;
        [Absent | _] -> {error, {absent, Absent}}
    end.

%% @doc Writes a film or a light painting. A file that is not complete is not left behind.
-spec write(starl_film_cast:scene(), file:filename(), options()) -> ok | {error, reason()}.
write(Scene, File, #{light := true}) ->
    light(kind(File), starl_film_light:svg(Scene), File);
write(Scene, File, Options) ->
    case kind(File) of
        svg -> saved(File, starl_film_svg:film(Scene, maps:with([seconds, title, once], Options)));
        Kind -> video(Kind, Scene, File, Options)
    end.

light(svg, Svg, File) ->
    saved(File, Svg);
light(png, Svg, File) ->
    Beside = File ++ ".svg",
    Made =
        case saved(Beside, Svg) of
            ok -> starl_film_program:png(Beside, File, ?LIGHT_WIDTH);
            {error, _} = Error -> Error
        end,
    _ = file:delete(Beside),
    Made.

saved(File, Bytes) ->
    _ = filelib:ensure_dir(File),
    case file:write_file(File, Bytes) of
        ok ->
            ok;
        {error, Posix} ->
            _ = file:delete(File),
            {error, {file, File, Posix}}
    end.

%% -- video ----------------------------------------------------------------------------------

%% Frames are pictures in a directory of the user's own, which goes away in the end.
video(Kind, Scene, File, Options) ->
    starl_private_dir:with("frames", fun(Dir) -> frames(Kind, Scene, Dir, File, Options) end).

frames(Kind, #{end_us := End} = Scene, Dir, File, #{seconds := Seconds, title := Title} = Options) ->
    Rate = rate(Kind),
    Last = max(1, round(Seconds * Rate)),
    Progress = maps:get(progress, Options, fun(_) -> ok end),
    Draw = fun(N) ->
        ok = Progress(N / Last),
        frame(N, starl_film_frame:at(End * N div Last, Title, Scene), Dir)
    end,
    case each(Draw, lists:seq(0, Last)) of
        ok ->
            ok = rest(Last, Last + ?REST_S * Rate, Dir),
            Pattern = filename:join(Dir, "frame-%06d.png"),
            joined(starl_film_program:video(Pattern, Rate, Kind, File), File);
        {error, _} = Error ->
            Error
    end.

rate(mp4) -> 25;
rate(gif) -> 10.

each(_Do, []) ->
    ok;
each(Do, [N | Ns]) ->
    case Do(N) of
        ok -> each(Do, Ns);
        {error, _} = Error -> Error
    end.

frame(N, Svg, Dir) ->
    Drawing = filename:join(Dir, "frame.svg"),
    case file:write_file(Drawing, Svg) of
        ok -> starl_film_program:png(Drawing, name(N, Dir), ?WIDTH);
        {error, Posix} -> {error, {file, Drawing, Posix}}
    end.

name(N, Dir) -> filename:join(Dir, io_lib:format("frame-~6..0b.png", [N])).

%% In the end the whole picture stays for a while.
rest(Last, Until, Dir) ->
    _ = [file:make_link(name(Last, Dir), name(N, Dir)) || N <- lists:seq(Last + 1, Until)],
    ok.

joined(ok, _File) ->
    ok;
joined({error, _} = Error, File) ->
    _ = file:delete(File),
    Error.

%% @doc One line on a problem.
-spec format_error(reason()) -> unicode:chardata().
format_error({file, File, Posix}) -> [File, ": ", file:format_error(Posix)];
format_error(Reason) -> starl_film_program:format_error(Reason).
