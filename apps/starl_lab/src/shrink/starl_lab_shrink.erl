%% @doc `./starl shrink': turns a run that violates a contract into a small scenario file that
%% violates the same contract.
-module(starl_lab_shrink).

-behaviour(starl_cli_command).

-export([command/0, subject/2]).
-export([digest/2]).

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "shrink",
        synopsis => "make a run that violates a contract small",
        argument => {required, "RUN", {example, "out/painting-1"}},
        subject => fun subject/2,
        about => [
            "Takes a run that violates a contract (RUN is the directory of a run, a scenario file, an "
            "application with the flags of ./starl run, or SEED --app APPLICATION) and takes away from "
            "it all that is not needed: time, faults, robots, chance, lost packets. The result is a "
            "scenario file that violates the same contract in the same way; it has been run. Ctrl-C "
            "writes the smallest so far."
        ],
        flags => fun flags/1,
        statuses => [
            {0, "shrunk"},
            {1, "internal error"},
            {2, "bad usage or input, also where the run violates nothing or is not reproducible"},
            {4, "the seconds were up"},
            {130, "interrupted"}
        ],
        run => fun run/1
    }.

flags(none) -> [{"Flags", own_flags()}];
flags(#{app := App}) -> [{"Flags", own_flags() ++ starl_run_scenario:options(App)}].

own_flags() ->
    [
        {out, string, none, "the file for the result, FILE.term; without it one under out/"},
        starl_cli_out:overwrite_file(),
        {seconds, {optional, {number, 0.001, 1.0e6}}, none,
            "time limit, s; then the smallest run so far is the result"},
        {quiet, switch, false, "no progress line"},
        starl_lab_setup:judge_histories()
    ].

%% A run's directory, a scenario file or the name of an application. The directory of a failed
%% run has no record.
-spec subject(string(), [string()]) ->
    {ok, starl_cli_target:t(), [string()]} | {error, [unicode:chardata(), ...]}.
subject(Word, Args) ->
    case starl_cli_target:seeded(Word, Args) of
        {error, _} = Error -> Error;
        {Target, Others} -> starl_cli_target:subject(source(Target), Others)
    end.

source(Word) ->
    Scenario = filename:join(Word, "scenario.term"),
    Recorded = filelib:is_regular(filename:join(Word, "run.term")),
    case filelib:is_regular(Scenario) andalso not Recorded of
        true -> Scenario;
        false -> Word
    end.

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{subject := Target, values := Values} = Call) ->
    {Unsound, Scenario} = starl_cli_target:scenario(
        Target, starl_cli_target:given(Call, own_flags())
    ),
    {Unwritable, File} = out(Values, Target, Scenario),
    case Unsound ++ Unwritable of
        [] ->
            shrink((maps:with([seconds, quiet], Values))#{
                target => Target,
                scenario => Scenario,
                file => File,
                digest => digest(Call, own_flags()),
                options => starl_lab_setup:histories(Target, Values)
            });
        Problems ->
            {error, Problems}
    end.

%% @doc The digest that a recorded run must give again; with values that are not the record's, `any'.
-spec digest(starl_cli_command:call(), Own :: [starl_cli_flags:flag()]) -> binary() | any.
digest(#{subject := #{record := #{digest := Hex}}, given := Given}, Own) ->
    case maps:without([Key || {Key, _, _, _} <- Own], Given) of
        Chosen when map_size(Chosen) =:= 0 -> binary:decode_hex(list_to_binary(Hex));
        _ -> any
    end;
digest(_Call, _Own) ->
    any.

out(#{out := none, overwrite := Overwrite}, Target, Scenario) ->
    starl_cli_out:file(none, starl_lab_shrinker:file(Target, Scenario), Overwrite);
out(#{out := File, overwrite := Overwrite}, _Target, _Scenario) ->
    case {filename:extension(File), filelib:is_dir(File)} of
        {".term", false} -> starl_cli_out:file(File, File, Overwrite);
        {_, true} -> {[["--out: ", File, " is a directory; name a file as in small.term"]], none};
        {_, false} -> {[["--out: ", File, ": name a file that ends in .term"]], none}
    end.

shrink(Job) ->
    ok = starl_cli_log:install(),
    Answer = starl_lab_shrinker:shrink(Job),
    starl_cli_progress:erase(),
    case Answer of
        {ok, Lines, complete} -> told(Lines, 0);
        {ok, Lines, out_of_time} -> told(Lines, 4);
        {ok, Lines, interrupted} -> told(["interrupted; this is the smallest so far" | Lines], 130);
        {error, input, Why} -> {error, [Why]};
        {error, interrupted, Why} -> told([Why], 130);
        {error, internal, Why} -> failed(Why)
    end.

told(Lines, Status) ->
    starl_cli_terminal:out([[Line, "\n"] || Line <- Lines]),
    Status.

failed(Why) ->
    starl_cli_terminal:complain(["shrink: ", Why]),
    1.
