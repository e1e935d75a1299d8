%% @doc `./starl film': makes the film of a run, or its light painting.
-module(starl_lab_film).
-behaviour(starl_cli_command).

-export([command/0]).

%% How long a film moves, unless the user says otherwise.
-define(SECONDS, 20.0).

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "film",
        synopsis => "make a film of a run, or a light painting",
        argument => {required, "RUN", {example, "out/painting-1"}},
        subject => fun subject/2,
        about => [
            "RUN is a recording or the directory of a run. A run that was not recorded is done again. The "
            "film is film.svg in that directory, an animated picture that browsers play; --out with a "
            "name that ends with .mp4 or .gif makes a video (by ffmpeg and rsvg-convert). --light makes a "
            "light painting, light.svg and light.png."
        ],
        flags => [
            {"Flags", [
                {out, string, none, "the file: .svg, .mp4 or .gif; with --light .svg or .png"},
                {speed, {number, 0.001, 1.0e6}, none, "how many times as fast as the run"},
                {seconds, {number, 0.5, 3600}, none,
                    "length of the film, without the rest at its end (20)"},
                {once, switch, false, "svg: plays once, and keeps the whole picture"},
                {light, switch, false, "a light painting: a long exposure on a dark floor"},
                {overwrite, switch, false, "replaces an earlier file"},
                {quiet, switch, false, "no progress"}
            ]}
        ],
        run => fun run/1
    }.

-spec subject(string(), [string()]) ->
    {ok, {recording, file:filename()} | {run, starl_cli_target:t()}, [string()]}
    | {error, [unicode:chardata(), ...]}.
subject(Word, Args) ->
    File = starl_cli_out:recording(Word),
    IsDir = filelib:is_dir(Word),
    case filelib:is_regular(File) of
        true when IsDir -> {ok, {recording, File}, Args};
        true -> regular(filename:extension(Word), Word, Args);
        false when IsDir -> again(Word, Args);
        false -> {ok, {recording, Word}, Args}
    end.

regular(".term", Word, Args) -> again(Word, Args);
regular(_, Word, Args) -> {ok, {recording, Word}, Args}.

again(Word, Args) ->
    case starl_lab_replay:subject(Word, Args) of
        {ok, #{record := _} = Target, Others} -> {ok, {run, Target}, Others};
        {ok, _, _} -> {error, [[Word, ": neither a recording nor the record of a run, run.term"]]};
        {error, _} = Error -> Error
    end.

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{subject := Subject, values := Values} = Call) ->
    Files = files(Subject, Values),
    case lists:flatmap(fun(File) -> problem(File, Values) end, Files) ++ lengths(Values) of
        [] -> gathered(gather(Subject, Call), Files, Values);
        Problems -> {error, Problems}
    end.

files(_Subject, #{out := Out}) when Out =/= none -> [Out];
files(Subject, #{light := Light}) ->
    Dir = dir(Subject),
    case Light andalso starl_film_program:is_there("rsvg-convert") of
        true -> [filename:join(Dir, "light.svg"), filename:join(Dir, "light.png")];
        false when Light -> [filename:join(Dir, "light.svg")];
        false -> [filename:join(Dir, "film.svg")]
    end.

dir({recording, File}) ->
    filename:dirname(File);
dir({run, #{file := File}}) ->
    case filelib:is_dir(File) of
        true -> File;
        false -> filename:dirname(File)
    end.

problem(File, #{light := Light, overwrite := Overwrite}) ->
    Kind = starl_film:kind(File),
    case starl_film:needs(Kind, Light) of
        ok ->
            case filelib:is_file(File) andalso not (Overwrite andalso filelib:is_regular(File)) of
                true -> [[File, " is there already; --overwrite replaces it, --out names another"]];
                false -> []
            end;
        {error, kind} when Light ->
            [["--out ", File, ": a light painting is a .svg or a .png"]];
        {error, kind} ->
            [["--out ", File, ": a film is a .svg, .mp4 or .gif; --light makes a .png, too"]];
        {error, Reason} ->
            [["--out ", File, ": ", starl_film:format_error(Reason)]]
    end.

lengths(#{speed := Speed, seconds := Seconds}) when Speed =/= none, Seconds =/= none ->
    ["--speed and --seconds: one of them, please; the other follows from it"];
lengths(_Values) ->
    [].

%% -- what happened --------------------------------------------------------------------------

gather({recording, File}, _Call) ->
    case starl_trace_reader:fold(fun starl_film_cast:message/2, starl_film_cast:new(), File) of
        {ok, Cast, closed} ->
            {ok, Cast, File};
        {ok, Cast, _} ->
            starl_cli_terminal:complain([File, " is not whole; the film ends with it"]),
            {ok, Cast, File};
        {error, Reason} ->
            {error, [starl_trace_reader:format_error(Reason)]}
    end;
gather({run, Target}, #{values := #{quiet := Quiet}}) ->
    Values = #{until => none, inspect => none, out => none, overwrite => false, quiet => Quiet},
    Call = #{subject => Target, given => #{}, args => [], values => Values},
    case starl_lab_replay:setup(Call) of
        {ok, #{run := Run, record := Record}} -> filmed(Run, Record, Target);
        {error, _} = Error -> Error
    end.

filmed(#{scenario := #{time := Seconds} = Scenario} = Run, Record, #{file := File}) ->
    {ok, Camera} = starl_film_camera:start_link(),
    Options = #{observe => starl_film_camera:observer(Camera)},
    Until = min(maps:get(end_us, Record, round(Seconds * 1.0e6)), round(Seconds * 1.0e6)),
    Ran = starl_lab_drive:again(Scenario, Options, Until, Run),
    Cast = starl_film_camera:stop(Camera),
    case Ran of
        {ok, {_Ending, #{digest := Digest}}} ->
            ok = same(starl_cli_record:hex(Digest), Record, File),
            {ok, Cast, File};
        Failed ->
            starl_lab_simulation:failed(Failed, Run)
    end.

same(Digest, #{digest := Digest}, _File) ->
    ok;
same(_Digest, #{digest := ""}, _File) ->
    ok;
same(_Digest, #{ending := stopped}, _File) ->
    ok;
same(_Digest, _Record, File) ->
    starl_cli_terminal:complain([File, ": this run is not the recorded one: the code has changed"]).

%% -- the film -------------------------------------------------------------------------------

gathered({ok, Cast, From}, Files, Values) ->
    case starl_film_cast:scene(Cast) of
        {ok, Scene} -> written(Files, Scene, Values);
        {error, empty} -> {error, [[From, " shows no robot: there is nothing to film"]]}
    end;
gathered(Failed, _Files, _Values) ->
    Failed.

written([], _Scene, _Values) ->
    0;
written([File | Files], Scene, #{light := Light, once := Once, quiet := Quiet} = Values) ->
    Seconds = seconds(Scene, Values),
    Options = #{
        light => Light,
        once => Once,
        seconds => Seconds,
        title => title(Scene, Seconds),
        progress => progress(Quiet)
    },
    Written = starl_film:write(Scene, File, Options),
    starl_cli_progress:erase(),
    case Written of
        ok ->
            starl_cli_terminal:out(["result: ", starl_cli_out:shown(File), "\n"]),
            written(Files, Scene, Values);
        {error, Reason} ->
            {error, [starl_film:format_error(Reason)]}
    end.

progress(true) ->
    fun(_Part) -> ok end;
progress(false) ->
    Progress = starl_cli_progress:new(auto),
    fun(Part) ->
        _ = starl_cli_progress:show(Progress, Part, fun() -> ["film"] end),
        ok
    end.

seconds(#{end_us := End}, #{speed := Speed}) when Speed =/= none -> max(0.5, End / 1.0e6 / Speed);
seconds(_Scene, #{seconds := Seconds}) when Seconds =/= none -> float(Seconds);
seconds(_Scene, _Values) -> ?SECONDS.

title(#{app := App, actors := Actors, end_us := End}, Seconds) ->
    Name = lists:last(string:split(atom_to_list(App), "starl_")),
    Robots =
        case length(Actors) of
            1 -> "1 robot";
            N -> integer_to_list(N) ++ " robots"
        end,
    io_lib:format("~ts, ~ts, ~ts times as fast", [Name, Robots, factor(End / 1.0e6 / Seconds)]).

factor(X) when X >= 10; abs(X - round(X)) < 0.05 -> integer_to_list(round(X));
factor(X) -> float_to_binary(X, [{decimals, 1}]).
