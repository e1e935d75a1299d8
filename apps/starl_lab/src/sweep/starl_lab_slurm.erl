%% @doc Runs a sweep as an array of Slurm jobs: writes the scripts of its slices and of their join,
%% and submits them.
%%
%% The number of slices stands in the script, because Slurm counts differently when only a part of
%% an array is submitted again. The join waits for the end of all slices, also of those that fail,
%% and names what is missing; after `afterok' it would wait for ever.
-module(starl_lab_slurm).

-export([flags/0, wanted/1, begin_jobs/3, scripts/2, again/2]).

-export_type([study/0]).

%% What is submitted: the words of the sweep without those that change no run, the number of slices,
%% the runs that one slice makes at a time, the script `starl', and where all of it is called.
-type study() :: #{
    words := [string(), ...],
    parts := pos_integer(),
    jobs := pos_integer(),
    starl := file:filename(),
    cwd := file:filename()
}.

-define(SLICE, "slice.sh").
-define(JOIN, "join.sh").

%% @doc The flags of a sweep.
-spec flags() -> [starl_cli_flags:flag()].
flags() ->
    [
        {slurm, {optional, {integer, 1, 100000}}, none,
            "submits the sweep in this number of slices, as an array of Slurm's jobs"},
        {'no-submit', switch, false, "with --slurm: only writes the scripts of the jobs"}
    ].

%% @doc Reads the flags. Where there is no Slurm, nothing begins.
-spec wanted(Values :: #{atom() => term()}) ->
    none | {Parts :: pos_integer(), submit | write} | {error, unicode:chardata()}.
wanted(#{slurm := none, 'no-submit' := true}) ->
    {error, "--no-submit: it goes with --slurm N"};
wanted(#{slurm := none}) ->
    none;
wanted(#{slice := Slice}) when Slice =/= none ->
    {error, "--slurm: its jobs make the slices; leave out --slice"};
wanted(#{slurm := Parts, 'no-submit' := true}) ->
    {Parts, write};
wanted(#{slurm := Parts}) ->
    case os:find_executable("sbatch") of
        false ->
            {error,
                "--slurm: there is no sbatch on this computer (package slurm-client); --no-submit "
                "only writes the scripts"};
        _ ->
            {Parts, submit}
    end.

%% @doc Writes the scripts into the directory of the study; submits them, or says how that is done.
-spec begin_jobs(submit | write, study(), file:filename()) ->
    0 | {error, [unicode:chardata(), ...]}.
begin_jobs(How, Study, Dir) ->
    _ = filelib:ensure_path(Dir),
    case {starl_lab_files:put_all(Dir, scripts(Study, Dir)), How} of
        {{error, Why}, _} -> {error, [Why]};
        {ok, write} -> told(Dir);
        {ok, submit} -> submitted(submit(Dir), Study, Dir)
    end.

told(Dir) ->
    [Slice, Join] = [
        starl_cli_terminal:quoted(filename:join(Dir, Name))
     || Name <- [?SLICE, ?JOIN]
    ],
    starl_cli_terminal:out(
        "submit the slices, and behind them the join, with:\n"
        "  job=$(sbatch --parsable ~ts)\n"
        "  sbatch --dependency=afterany:$job ~ts\n",
        [Slice, Join]
    ),
    0.

submitted({ok, Array, Join}, #{parts := Parts}, Dir) ->
    starl_cli_terminal:out("job ~ts makes ~b slices; job ~ts joins them and says how in ~ts\n", [
        Array, Parts, Join, starl_cli_out:shown(filename:join(Dir, "join.log"))
    ]),
    0;
submitted({error, Why}, _Study, _Dir) ->
    {error, [Why]}.

%% @doc The scripts by their names.
-spec scripts(study(), file:filename()) -> [{Name :: string(), unicode:chardata()}].
scripts(#{words := Words, parts := N, jobs := Jobs, starl := Starl, cwd := Cwd}, Dir) ->
    Name = filename:basename(Dir),
    Head = fun(What, Log, More) ->
        head([
            {"job-name", starl_cli_terminal:quoted(Name ++ What)},
            {"chdir", starl_cli_terminal:quoted(Cwd)},
            {"output", starl_cli_terminal:quoted(filename:join(Dir, Log))}
            | More
        ])
    end,
    Line = fun(List) -> ["exec ", lists:join($\s, List), $\n] end,
    Quoted = fun(List) -> [starl_cli_terminal:quoted(Word) || Word <- List] end,
    Array = io_lib:format("1-~b", [N]),
    [
        {?SLICE, [
            Head("", "slice-%a.log", [
                {"array", Array}, {"cpus-per-task", integer_to_list(Jobs)}
            ]),
            Line(
                Quoted([Starl, "sweep" | Words]) ++
                    Quoted(["--out", Dir, "--jobs", integer_to_list(Jobs)]) ++
                    ["--slice", io_lib:format("\"$SLURM_ARRAY_TASK_ID/~b\"", [N])]
            )
        ]},
        {?JOIN, [Head("-join", "join.log", []), Line(Quoted([Starl, "join", Dir]))]}
    ].

%% A name may hold the end of a line, behind which sh would take a command.
head(Options) ->
    [
        "#!/bin/sh\n",
        [
            ["#SBATCH --", Option, $=, starl_cli_terminal:flat(Value), $\n]
         || {Option, Value} <- Options
        ]
    ].

%% The numbers of the jobs.
submit(Dir) ->
    case sbatch([filename:join(Dir, ?SLICE)]) of
        {ok, Array} ->
            behind(Array, sbatch(["--dependency=afterany:" ++ Array, filename:join(Dir, ?JOIN)]));
        {error, _} = Error ->
            Error
    end.

behind(Array, {ok, Join}) -> {ok, Array, Join};
behind(_Array, {error, _} = Error) -> Error.

%% The answer is a number; of one cluster among several also its name.
sbatch(Args) ->
    Options = [
        {args, ["--parsable" | Args]}, {env, shell()}, exit_status, stderr_to_stdout, hide
    ],
    case said(open_port({spawn_executable, os:find_executable("sbatch")}, Options), "") of
        {0, Text} ->
            Last = lists:last(string:lexemes(Text, "\n")),
            {ok, hd(string:split(Last, ";"))};
        {_, Text} ->
            {error, ["--slurm: ", lists:join("; ", string:lexemes(Text, "\n"))]}
    end.

%% Jobs get the environment of who submits them: that of the user's shell, without what the script and
%% this VM have added. With another `erl' first in PATH the script would build anew.
shell() ->
    Own = [os:getenv("BINDIR", ""), filename:join(code:root_dir(), "bin")],
    Added = ["BINDIR", "ROOTDIR", "EMU", "PROGNAME", "ERL_CRASH_DUMP" | starl()],
    Deps = filename:join(os:getenv("STARL_ROOT", "."), ".deps"),
    [{"PATH", path("PATH", Own)}, {"ERL_LIBS", path("ERL_LIBS", [Deps])}] ++
        [{Name, false} || Name <- Added].

starl() -> [Name || "STARL_" ++ _ = Entry <- os:getenv(), [Name, _] <- [string:split(Entry, "=")]].

path(Name, Own) ->
    case string:lexemes(os:getenv(Name, ""), ":") -- Own of
        [] -> false;
        Dirs -> lists:append(lists:join(":", Dirs))
    end.

said(Port, Text) ->
    receive
        {Port, {data, More}} -> said(Port, Text ++ More);
        {Port, {exit_status, Status}} -> {Status, Text}
    end.

%% @doc The command that submits some slices again, where a study was made for Slurm.
-spec again(file:filename(), [K :: pos_integer()]) -> {ok, [string()]} | none.
again(Dir, Slices) ->
    Script = filename:join(Dir, ?SLICE),
    case filelib:is_regular(Script) of
        true ->
            Numbers = lists:flatten(lists:join($,, [integer_to_list(K) || K <- Slices])),
            {ok, ["sbatch", "--array=" ++ Numbers, Script]};
        false ->
            none
    end.
