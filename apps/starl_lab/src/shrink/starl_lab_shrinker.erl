%% @doc Shrinks a run for the command line: shows the progress, obeys Ctrl-C, writes the resulting
%% scenario file and runs it once to confirm the violation.
-module(starl_lab_shrinker).

-export([shrink/1, file/2]).

-export_type([job/0]).

%% The run to be shrunk, its digest if known, the file for the result, and the time limit in
%% seconds.
-type job() :: #{
    target := starl_cli_target:t(),
    scenario := starl_run_scenario:t(),
    file := file:filename(),
    digest := binary() | any,
    seconds := number() | none,
    quiet := boolean(),
    %% whether histories are judged
    options => #{histories => starl_run_plan:histories()}
}.

-type answer() ::
    {ok, [unicode:chardata()], complete | out_of_time | interrupted}
    | {error, input | internal | interrupted, unicode:chardata()}.

%% The number of runs that show the violation to be reproducible.
-define(REPRODUCED, 2).

-record(watch, {
    stop :: atomics:atomics_ref(),
    progress :: starl_cli_progress:t(),
    %% monotonic, in ms
    deadline :: integer() | infinity
}).

%% @doc Shrinks a run and writes the result; gives the lines to print.
-spec shrink(job()) -> answer().
shrink(#{scenario := Scenario, digest := Digest, seconds := Seconds, quiet := Quiet} = Job) ->
    Begin = now_ms(),
    Stop = atomics:new(1, []),
    Progress = starl_cli_progress:new(shown(Quiet)),
    Watch = #watch{stop = Stop, progress = Progress, deadline = deadline(Seconds, Begin)},
    Answer = starl_sim_shrink:shrink(Scenario, #{
        run => fun(S) ->
            starl_sim_trial:run(S, fun(Sim) -> stoppable(Sim, Stop) end, [], options(Job))
        end,
        watch => watch(Watch),
        digest => Digest
    }),
    starl_cli_signal:on_interrupt(quit),
    Interrupted = atomics:get(Stop, 1),
    case Answer of
        {ok, Result} -> written(Result, now_ms() - Begin, Interrupted, Job);
        %% An interrupted run differs from the original.
        {error, _} when Interrupted =:= 1 -> {error, interrupted, "interrupted, nothing is shrunk"};
        {error, Reason} -> {error, blame(Reason), starl_sim_shrink:format_error(Reason)}
    end.

shown(true) -> quiet;
shown(false) -> auto.

options(Job) -> maps:get(options, Job, #{}).

%% A history is judged only where that is asked for.
judging(#{options := #{histories := {judged, _}}}) -> " --judge-histories";
judging(_Job) -> "".

blame({trial, {failed, _}}) -> internal;
blame(_) -> input.

deadline(none, _Begin) -> infinity;
deadline(Seconds, Begin) -> Begin + round(1000 * Seconds).

stoppable(Sim, Stop) ->
    starl_cli_signal:on_interrupt(fun() ->
        atomics:put(Stop, 1, 1),
        starl_sim:stop(Sim)
    end).

watch(#watch{stop = Stop, progress = Progress, deadline = Deadline} = Watch) ->
    fun(#{runs := Runs} = Figures) ->
        _ = [starl_cli_terminal:out("reproduced; taking away\n") || Runs =:= ?REPRODUCED],
        Shown = starl_cli_progress:show(Progress, unknown, fun() -> [words(Figures)] end),
        %% A number is less than the atom infinity.
        case atomics:get(Stop, 1) =:= 1 orelse now_ms() >= Deadline of
            true -> {stop, watch(Watch#watch{progress = Shown})};
            false -> {continue, watch(Watch#watch{progress = Shown})}
        end
    end.

words(#{faults := Faults, faults_before := Before, robots := Robots, runs := Runs}) ->
    io_lib:format("~b faults of ~b, ~b robots, ~b runs", [Faults, Before, Robots, Runs]).

counted(1, What) -> ["1 ", What];
counted(N, What) -> [integer_to_list(N), " ", What, "s"].

%% -- the result -----------------------------------------------------------------------------

written(Result, Ms, Interrupted, #{file := File, target := Target} = Job) ->
    #{scenario := Shrunk} = Result,
    Inputs = starl_cli_inputs:read(inputs(File), Target, Shrunk),
    Text = text(Result, File, Inputs, Job),
    case write(File, [{filename:basename(File), Text} | starl_cli_inputs:files(Inputs)]) of
        ok -> replayed(replay(File, Target, Result, Job), Result, Ms, Interrupted, Job);
        {error, Why} -> {error, internal, ["the result could not be written: ", Why, "\n", Text]}
    end.

%% The application and the files of options are copied to a directory beside the result, so that it
%% can be moved together with them.
inputs(File) -> filename:basename(File, ".term") ++ "-inputs".

write(File, Files) ->
    case filelib:ensure_dir(File) of
        ok -> starl_lab_files:put_all(filename:dirname(File), Files);
        {error, Posix} -> {error, [File, ": ", file:format_error(Posix)]}
    end.

replayed(true, Result, Ms, Interrupted, #{file := File, scenario := Before} = Job) ->
    #{violation := Violation, complete := Complete} = Result,
    How =
        case {Complete, Interrupted} of
            {true, _} -> complete;
            {false, 0} -> out_of_time;
            {false, 1} -> interrupted
        end,
    Shrunk = [
        starl_violation:format(Violation),
        ["shrunk to ", size(Result, Before), io_lib:format(" (~.1f s)", [Ms / 1000])]
    ],
    Where = [
        ["result: ", starl_cli_out:shown(File)],
        ["replay: ./starl run ", starl_cli_terminal:quoted(starl_cli_out:shown(File)), judging(Job)]
    ],
    {ok, Shrunk ++ others(Result, Job) ++ Where, How};
replayed(false, _Result, _Ms, _Interrupted, #{file := File}) ->
    {error, internal, [
        File,
        ": run as the robots' processes it violates something else than inline; "
        "./starl diverge tells where the runs part"
    ]}.

%% The other violations met on the way, each written to its own file and not shrunk further.
others(#{others := Others} = Result, #{file := File} = Job) ->
    lists:append([
        other(Result#{scenario := Scenario, violation := Violation}, beside(File, N), Job)
     || {N, #{scenario := Scenario, violation := Violation}} <- lists:enumerate(Others)
    ]).

beside(File, N) ->
    starl_cli_out:free(lists:concat([filename:rootname(File), "-other-", N, ".term"])).

other(#{violation := Violation, scenario := Scenario} = Met, File, Job) ->
    #{target := Target, file := Small} = Job,
    Inputs = starl_cli_inputs:read(inputs(Small), Target, Scenario),
    #{faults := Faults, robots := Robots} = Scenario,
    #{figures := Figures} = Met,
    Sized = Met#{figures := Figures#{faults := length(Faults), robots := Robots, drops := 0}},
    case write(File, [{filename:basename(File), text(Sized, File, Inputs, Job)}]) of
        ok ->
            [
                [
                    "met on the way, in ",
                    counted(Robots, "robot"),
                    " under ",
                    counted(length(Faults), "fault"),
                    ": ",
                    starl_violation:format(Violation),
                    "; ./starl shrink ",
                    starl_cli_terminal:quoted(starl_cli_out:shown(File)),
                    judging(Job)
                ]
            ];
        {error, _} ->
            []
    end.

%% Reads and runs the file as `./starl run' does.
replay(File, #{app := App}, #{digest := Digest}, Job) ->
    {ok, Read} = starl_run_scenario:read(File),
    Given = starl_cli_inputs:resolved(App, File, maps:remove(app, Read)),
    {ok, Scenario} = starl_run_scenario:check(Given#{app => App}, starl_app:options(App)),
    case starl_lab_jobs:simulate(Scenario, options(Job)) of
        {ok, #{outcome := #{digest := Digest}}} -> true;
        _ -> false
    end.

size(#{scenario := #{time := Time}, figures := Figures}, #{time := TimeBefore}) ->
    #{faults := Faults, faults_before := FaultsBefore, drops := Drops} = Figures,
    #{robots := Robots, robots_before := RobotsBefore, runs := Runs} = Figures,
    [
        counted(Faults - Drops, "fault"),
        " of ",
        integer_to_list(FaultsBefore),
        [[", ", counted(Drops, "lost packet")] || Drops > 0],
        ", ",
        counted(Robots, "robot"),
        " of ",
        integer_to_list(RobotsBefore),
        io_lib:format(", ~ts s of ~ts s", [seconds(Time), seconds(TimeBefore)]),
        io_lib:format(", in ~b runs", [Runs])
    ].

seconds(Time) -> io_lib:format("~.2f", [float(Time)]).

%% @doc The default file for the result.
-spec file(starl_cli_target:t(), starl_run_scenario:t()) -> file:filename_all().
file(#{name := Name}, Scenario) ->
    Seed = maps:get(seed, Scenario, 0),
    Base = lists:concat([Name, "-", Seed, "-shrunk.term"]),
    starl_cli_out:usual(Base).

%% The values of options that differ from the defaults.
unusual(Options, Scenario) ->
    Usual = maps:without([robots, seed, time, faults], starl_cli_flags:defaults(Options)),
    [
        line(Key, Value)
     || {Key, _, _, _} <- Options,
        Value <- [maps:get(Key, Scenario)],
        maps:find(Key, Usual) =/= {ok, Value}
    ].

%% The text of the scenario file: a comment on the violation, then the values that differ from
%% the defaults.
-spec text(starl_sim_shrink:result(), file:filename(), starl_cli_inputs:t(), job()) ->
    [unicode:chardata()].
text(#{violation := Violation, scenario := Shrunk} = Result, File, Inputs, Job) ->
    #{target := #{app := App}, scenario := Before} = Job,
    Scenario = starl_cli_inputs:local(Inputs, Shrunk),
    Lines = unusual(starl_run_scenario:options(App), Scenario),
    Name = starl_cli_terminal:quoted(starl_cli_out:shown(File)),
    [
        "%% ",
        starl_violation:format(Violation),
        ".\n",
        "%% Shrunk to ",
        size(Result, Before),
        ".\n",
        "%% Replay it with: ./starl run ",
        Name,
        judging(Job),
        "\n",
        "#{\n",
        lists:join(",\n", [line(app, starl_cli_inputs:app(Inputs)) | Lines]),
        "\n}.\n"
    ].

line(faults, [_ | _] = Faults) ->
    ["    faults => [\n", lists:join(",\n", [["        ", term(F)] || F <- Faults]), "\n    ]"];
line(Key, Value) ->
    ["    ", term(Key), " => ", term(Value)].

term(Term) -> io_lib:format("~0tp", [Term]).

now_ms() -> erlang:monotonic_time(millisecond).
