%% @doc `./starl sweep': runs all combinations of some settings with several seeds on all cores. It
%% appends a row to a file as each run ends, and finally writes the medians and a plot. An
%% interrupted sweep continues with the runs that have no row yet.
%% ```
%%   checked command line -> each point is set up once -> columns, figures
%%     -> the missing runs, a row each -> all rows: summary, curves, plot, exit status
%% '''
-module(starl_lab_sweep).

-behaviour(starl_cli_command).

-export([command/0]).
-export([join/3]).
%% Called in the VMs of the jobs.
-export([probe/1, one/1]).

-export_type([sweep/0, job/0]).

%% A checked command line. `points': the scenario of each point, with an arbitrary seed.
-type sweep() :: #{
    args := [string()],
    target := starl_cli_target:t(),
    grid := starl_lab_sweep_grid:t(),
    points := [{starl_lab_sweep_grid:point(), starl_run_scenario:t()}, ...],
    %% what is to be done: runs, of which file and slice; or the whole from what others have run
    work :=
        {make, starl_lab_slice:t()}
        | {join, [file:filename(), ...], starl_build:code()}
        | {submit | write, starl_lab_slurm:study()},
    slice => starl_lab_slice:t(),
    file => file:filename(),
    dir := file:filename(),
    jobs := pos_integer(),
    plot := none | [string()]
}.

%% A run to make, with the name of its application.
-type job() :: {starl_lab_sweep_rows:key(), App :: string(), starl_run_scenario:t()}.

-define(WIDTH, 80).

-record(made, {
    rows :: starl_lab_sweep_rows:rows(),
    columns :: starl_lab_sweep_rows:columns(),
    device :: file:io_device()
}).

-type run() :: {starl_lab_sweep_rows:key(), starl_run_scenario:t()}.

%% The file of the rows, those that it has, and the length of its complete lines.
-type known() :: {file:filename(), starl_lab_sweep_rows:rows(), Bytes :: non_neg_integer()}.

-type answer() :: 0 | 1 | 3 | 4 | 5 | 130 | {error, [unicode:chardata(), ...]}.

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "sweep",
        synopsis => "run every combination of settings and seeds; CSV and a plot",
        argument => {required, "TARGET", {example, "painting --robots 1..8"}},
        subject => fun starl_cli_target:subject/2,
        about => [
            "Runs every combination of the values of the flags with every seed. The directory of the "
            "results gets runs.csv, a row for each run; summary.csv, median, least and most of each "
            "figure; curves.csv and curves.svg, the application's measures over time; and a plot. The same command goes on where it was stopped.",
            "With --slice only a part of the runs is made, for several computers or the jobs of a cluster; "
            "./starl join then makes the whole. With --slurm the slices are jobs of Slurm: the command writes "
            "their scripts into the directory of the results and submits them, and the join behind them."
        ],
        flags => fun flags/1,
        statuses => [
            {0, "all complete"},
            {1, "a simulation failed"},
            {3, "a contract was violated"},
            {4, "a run ended before its work was complete"},
            {5, "a run was not judged to its end"},
            {130, "interrupted"}
        ],
        run => fun run/1
    }.

flags(none) -> flags_for(starl_run_scenario:options());
flags(Target) -> flags_for(options(Target)).

flags_for(Options) -> [{"Flags", starl_lab_sweep_grid:flags(Options) ++ own_flags()}].

options(#{app := App}) -> starl_run_scenario:options(App).

own_flags() ->
    [
        {plot, {list, string}, none,
            "which figures of the report to plot; without it completion"
            " time and those that the application names"},
        {out, string, none, "directory for the results; without it out/TARGET-sweep"},
        starl_lab_slice:flag(),
        starl_lab_jobs:at_once()
        | starl_lab_slurm:flags()
    ].

%% -- before the runs ------------------------------------------------------------------------

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{values := #{slice := Text} = Values} = Call) ->
    case {starl_lab_slurm:wanted(Values), starl_lab_slice:read(Text)} of
        {{error, Why}, _} -> {error, [Why]};
        {_, {error, Why}} -> {error, [["--slice: ", Why]]};
        {none, {ok, Slice}} -> checked(Call, {make, Slice});
        {{Parts, How}, {ok, whole}} -> checked(Call, {How, study(Parts, Call)})
    end.

%% A slice makes one run at a time, or the number that --jobs says.
study(Parts, #{args := Args, given := Given}) ->
    {ok, Cwd} = file:get_cwd(),
    #{
        words => starl_lab_sweep_study:plain(Args),
        parts => Parts,
        jobs => maps:get(jobs, Given, 1),
        starl => filename:join(os:getenv("STARL_ROOT", "."), "starl"),
        cwd => Cwd
    }.

%% @doc Makes one study of the slices in these directories, whose runs are of this code.
-spec join(starl_cli_command:call(), [file:filename(), ...], starl_build:code()) ->
    starl_cli_command:answer().
join(Call, Dirs, Code) -> checked(Call, {join, Dirs, Code}).

checked(#{subject := Target, given := Given, values := Values, args := Args}, Work) ->
    #{name := Name, given := InFile} = Target,
    Own = [Key || {Key, _, _, _} <- own_flags()],
    Grid = starl_lab_sweep_grid:new(options(Target), InFile, maps:without(Own, Given), Args),
    Checked = [
        {P, starl_cli_target:scenario(Target, maps:merge(InFile, P))}
     || P <- starl_lab_sweep_grid:points(Grid)
    ],
    Unsound = lists:uniq([unicode:characters_to_list(L) || {_, {Ls, _}} <- Checked, L <- Ls]),
    Dir = directory(maps:get(out, Values), Name),
    {Unwritable, _} = starl_cli_out:directory(Dir, Name),
    case Unsound ++ Unwritable ++ too_large(Unsound, Checked, Grid, Values) of
        [] ->
            Points = [{P, Scenario} || {P, {[], Scenario}} <- Checked],
            probed((maps:with([jobs, plot], Values))#{
                work => Work,
                args => Args,
                target => Target,
                grid => Grid,
                dir => Dir,
                points => Points
            });
        Problems ->
            {error, Problems}
    end.

%% Every point has a run for each seed.
too_large([], Checked, Grid, #{jobs := Jobs}) ->
    Runs = length(Checked) * length(starl_lab_sweep_grid:seeds(Grid)),
    Use = #{jobs => min(Jobs, Runs), nodes => false},
    starl_lab_memory:largest([Scenario || {_, {_, Scenario}} <- Checked], Use);
too_large(_Unsound, _Checked, _Grid, _Values) ->
    [].

directory(none, Name) -> starl_cli_out:usual(Name ++ "-sweep");
directory(Dir, _Name) -> string:trim(Dir, trailing, "/").

%% Every point is started once without a run: this finds errors, such as a picture that does not fit
%% on the floor, and the figures of the report, which become the columns.
probed(#{points := Points, target := #{name := Name}} = Sweep) ->
    ok = starl_cli_log:install(),
    Jobs = [{N, {Name, Scenario}} || {N, {_, Scenario}} <- lists:enumerate(Points)],
    Each = fun({N, _}, Answer, Reports) -> Reports#{N => Answer} end,
    Plan = plan(Sweep, probe, "points checked", Each),
    case starl_lab_jobs:run(Jobs, Plan, #{}) of
        {interrupted, _} -> interrupted_early();
        {done, Answers} -> sound([Why || {_, Why} <- lists:sort(maps:to_list(Answers))], Sweep)
    end.

interrupted_early() ->
    starl_cli_terminal:out("interrupted before the first run\n"),
    130.

sound(Answers, Sweep) ->
    case lists:uniq([problem(A) || A <- Answers, not is_sound(A)]) of
        [] ->
            {ok, {ok, Report, _}} = hd(Answers),
            [{_, Scenario} | _] = maps:get(points, Sweep),
            Measures = [Key || {Key, _} <- starl_lab_sweep_curve:measures(Scenario)],
            Columns = starl_lab_sweep_rows:columns(maps:get(grid, Sweep), Report, Measures),
            with_columns(Columns, starl_lab_report:formats(Report), Sweep);
        Problems ->
            {error, Problems}
    end.

is_sound({ok, {ok, _, _}}) -> true;
is_sound(_) -> false.

problem({ok, {error, Why}}) -> unicode:characters_to_list(Why);
problem({crashed, Reason}) -> lists:flatten(io_lib:format("the set-up fails: ~0tP", [Reason, 15])).

with_columns(Columns, Formats, #{plot := Plot} = Sweep) ->
    Numbers = starl_lab_sweep_rows:numbers(Columns),
    case starl_lab_sweep_plot:chosen(Plot, Numbers, Formats) of
        {ok, Figures} -> with_figures(maps:get(work, Sweep), Columns, Figures, Sweep);
        {unknown, Names} -> {error, [unknown_figure(Name, Numbers) || Name <- Names]}
    end.

with_figures({How, #{} = Study}, _Columns, _Figures, #{dir := Dir}) ->
    starl_lab_slurm:begin_jobs(How, Study, Dir);
with_figures({join, Dirs, _Code}, Columns, Figures, Sweep) ->
    case starl_lab_sweep_study:rows(Dirs, Columns) of
        {ok, Rows} -> joined(Sweep, Columns, Figures, Rows);
        {error, Reason} -> wrong(Reason)
    end;
with_figures(
    {make, Slice}, Columns, Figures, #{dir := Dir, target := Target, args := Args} = Sweep
) ->
    Code = starl_build:code(starl_cli_target:beams(Target)),
    case starl_lab_sweep_study:begin_slice(Dir, Slice, Columns, {Args, Code}) of
        {ok, Known} -> make(Sweep#{slice => Slice}, Columns, Figures, Known);
        {error, Reason} -> wrong(Reason)
    end.

wrong(Reason) -> {error, [starl_lab_sweep_study:format_error(Reason)]}.

unknown_figure(Name, Numbers) ->
    Texts = [atom_to_list(Key) || Key <- Numbers],
    All = ["; there are ", lists:join(", ", Texts)],
    Meant = starl_similar:meant(starl_similar:words(Name, Texts), All),
    ["--plot: there is no figure ", Name, Meant].

%% -- the runs -------------------------------------------------------------------------------

%% Makes the runs, or those of a slice.
-spec make(sweep(), starl_lab_sweep_rows:columns(), [starl_lab_sweep_plot:figure(), ...], known()) ->
    answer().
make(#{slice := Slice} = Sweep, Columns, Figures, {File, Rows, Bytes}) ->
    case starl_lab_sweep_rows:open(File, Columns, Bytes) of
        {ok, Device} ->
            Made = #made{rows = Rows, columns = Columns, device = Device},
            all(starl_lab_slice:part(Slice, runs(Sweep)), Made, Figures, Sweep#{file => File});
        {error, Reason} ->
            {error, [starl_lab_sweep_rows:format_error(Reason)]}
    end.

%% Makes the summary and the plot from rows that are there, if none is missing.
joined(#{work := {join, Dirs, _Code}} = Sweep, Columns, Figures, Rows) ->
    Runs = runs(Sweep),
    case [Key || {Key, _} <- Runs, not is_map_key(Key, Rows)] of
        [] -> whole(Runs, Columns, Rows, Figures, Sweep);
        Missing -> lacking(Missing, Runs, starl_lab_sweep_study:parts(Dirs), Sweep)
    end.

%% The slices that lack runs, each with their number, and that of all its runs.
slices(Missing, Runs, Parts) ->
    [
        {Slice, Count, length(Part)}
     || K <- lists:seq(1, Parts),
        Slice <- [{K, Parts}],
        Part <- [starl_lab_slice:part(Slice, Runs)],
        Count <- [length([Key || {Key, _} <- Part, is_map_key(Key, Missing)])],
        Count > 0
    ].

%% Which slices lack runs, and how they are made.
lacking(Missing, Runs, Parts, #{args := Args, dir := Dir, work := {join, Dirs, _Code}}) ->
    Command = ["sweep" | starl_lab_sweep_study:plain(Args)] ++ ["--out", starl_cli_out:shown(Dir)],
    Lacking = slices(maps:from_keys(Missing, true), Runs, Parts),
    starl_cli_terminal:out([
        io_lib:format("~b of ~b runs are missing\n", [length(Missing), length(Runs)]),
        [
            io_lib:format("slice ~ts lacks ~b of ~b; make them with: ~ts --slice ~ts\n", [
                starl_lab_slice:text(Slice),
                Count,
                All,
                command(Command),
                starl_lab_slice:text(Slice)
            ])
         || {Slice, Count, All} <- Lacking
        ],
        [
            [
                "or submit them: ",
                lists:join(" ", [starl_cli_terminal:quoted(W) || W <- Words]),
                "\n"
            ]
         || {ok, Words} <- [starl_lab_slurm:again(hd(Dirs), [K || {{K, _}, _, _} <- Lacking])]
        ]
    ]),
    4.

-spec runs(sweep()) -> [run(), ...].
runs(#{points := Points, grid := Grid, target := #{name := Name}}) ->
    [
        {starl_lab_sweep_rows:key(Name, Grid, Scenario, Seed), Scenario#{seed := Seed}}
     || {_, Scenario} <- Points, Seed <- starl_lab_sweep_grid:seeds(Grid)
    ].

all(Runs, #made{rows = Rows, device = Device} = Made, Figures, Sweep) ->
    #{target := #{name := Name}} = Sweep,
    Later = [{Key, Name, S} || {Key, S} <- Runs, not is_map_key(Key, Rows)],
    Before = length(Runs) - length(Later),
    Plan = plan(Sweep, one, "runs", fun noted/3),
    {How, #made{rows = Known}} = starl_lab_jobs:run(Later, Plan#{before => Before}, Made),
    ok = starl_lab_sweep_rows:close(Device),
    ended(How, Runs, Made#made{rows = Known}, Figures, Sweep).

noted({Key, _, _}, Answer, #made{rows = Rows, columns = Columns, device = Device} = Made) ->
    Report =
        case Answer of
            {ok, {ok, _, _} = Known} -> Known;
            _ -> failed
        end,
    Row = starl_lab_sweep_rows:row(Columns, Key, Report),
    ok = starl_lab_sweep_rows:append(Device, Row),
    Made#made{rows = Rows#{Key => Row}}.

%% The plan for jobs that call a function of this module.
plan(#{jobs := Most, target := Target}, Function, What, Each) ->
    #{
        work => {?MODULE, Function},
        at_once => Most,
        what => What,
        each => Each,
        code => maps:get(code, Target, [])
    }.

%% -- the end --------------------------------------------------------------------------------

ended(interrupted, Runs, #made{rows = Rows}, _Figures, #{file := File, args := Args}) ->
    Known = length([Key || {Key, _} <- Runs, is_map_key(Key, Rows)]),
    starl_cli_terminal:out("interrupted; ~b of ~b runs are kept in ~ts\ngo on with: ~ts\n", [
        Known,
        length(Runs),
        starl_cli_out:shown(File),
        command(["sweep" | Args])
    ]),
    130;
ended(done, Runs, #made{rows = Rows, columns = Columns}, Figures, #{slice := whole} = Sweep) ->
    whole(Runs, Columns, Rows, Figures, Sweep);
ended(done, Runs, #made{rows = Rows, columns = Columns}, _Figures, Sweep) ->
    #{target := Target, slice := Slice, file := File, dir := Dir} = Sweep,
    Judged = judged(Runs, Columns, Rows),
    starl_cli_terminal:out(["slice ", starl_lab_slice:text(Slice), ": "]),
    told(Judged, Target),
    starl_cli_terminal:out("kept in ~ts\nwhen all slices are there: ./starl join ~ts\n", [
        starl_cli_out:shown(File), starl_cli_terminal:quoted(starl_cli_out:shown(Dir))
    ]),
    verdict([How || {How, _} <- Judged]).

command(Words) -> lists:join(" ", ["./starl" | [starl_cli_terminal:quoted(Word) || Word <- Words]]).

judged(Runs, Columns, Rows) ->
    [
        {starl_lab_sweep_rows:status(Columns, maps:get(Key, Rows)), Scenario}
     || {Key, Scenario} <- Runs
    ].

%% All runs have rows.
whole(Runs, Columns, Rows, Figures, #{target := Target} = Sweep) ->
    Points = points(Columns, Rows, Sweep),
    Text = starl_lab_sweep_rows:ordered(Columns, [Key || {Key, _} <- Runs], Rows),
    Curves = curves(Columns, Rows, Sweep),
    Written = write([{"runs.csv", Text} | note(Sweep) ++ Curves], Points, Columns, Figures, Sweep),
    Judged = judged(Runs, Columns, Rows),
    told(Judged, Target),
    written(Written, verdict([How || {How, _} <- Judged])).

%% A study that was joined goes on as a sweep in one piece does; that one has its note already.
note(#{work := {join, _Dirs, Code}, args := Args}) ->
    [{"runs.term", starl_lab_sweep_study:note(Args, Code)}];
note(#{work := {make, _Slice}}) ->
    [].

points(Columns, Rows, #{points := Points, grid := Grid, target := #{name := Name}}) ->
    Seeds = starl_lab_sweep_grid:seeds(Grid),
    [
        begin
            Keys = [starl_lab_sweep_rows:key(Name, Grid, Scenario, Seed) || Seed <- Seeds],
            Cells = lists:droplast(hd(Keys)),
            Known = [maps:get(Key, Rows) || Key <- Keys],
            {Point, starl_lab_sweep_summary:summarize(Columns, Cells, Known)}
        end
     || {Point, Scenario} <- Points
    ].

%% The measures over time, as a table and as a plot; nothing where nothing was measured.
curves(Columns, Rows, Job) ->
    Settings = starl_lab_sweep_rows:settings(Columns),
    case measured(Columns, Rows, Job) of
        [] ->
            [];
        Curves ->
            [
                {"curves.csv", starl_lab_sweep_curve:csv(Settings, Curves)},
                {"curves.svg", starl_lab_sweep_curve:svg(Curves)}
            ]
    end.

measured(Columns, Rows, #{points := Points, grid := Grid, target := #{name := Name}}) ->
    [
        {Cells, starl_lab_sweep_plot:point_name(Grid, Point), Measure, Text, Moments}
     || {Point, Scenario} <- Points,
        Keys <- [
            [
                starl_lab_sweep_rows:key(Name, Grid, Scenario, Seed)
             || Seed <- starl_lab_sweep_grid:seeds(Grid)
            ]
        ],
        Cells <- [lists:droplast(hd(Keys))],
        {Measure, Text} <- starl_lab_sweep_curve:measures(Scenario),
        Moments <- [
            starl_lab_sweep_summary:curve(Columns, Measure, [maps:get(Key, Rows) || Key <- Keys])
        ],
        Moments =/= []
    ].

%% The files are made in another directory and moved. The rows, until now in the order in which the
%% runs ended, are replaced by the rows in the order of the grid.
write(Tables, Points, Columns, Figures, #{dir := Dir, grid := Grid, target := #{name := Name}}) ->
    {ok, Plan} = starl_cli_out:plan(Dir, Name),
    Summary = starl_lab_sweep_summary:csv(Columns, [Sum || {_, Sum} <- Points]),
    starl_cli_out:write(Plan, fun(New) ->
        Files = Tables ++ [{"summary.csv", Summary}],
        case plot(Name, Grid, Points, Figures) of
            {ok, Plot} ->
                starl_lab_sweep_plot:put(New, Files, Plot);
            {none, Why} ->
                starl_cli_terminal:warn(["no plot: ", Why]),
                starl_lab_files:put_all(New, Files)
        end
    end).

plot(Name, Grid, Points, Figures) ->
    case starl_lab_sweep_plot:axis(Grid) of
        {ok, X} -> with_points(starl_lab_sweep_plot:data(Name, Grid, X, Points, Figures));
        none -> {none, "no setting with numbers has several values"}
    end.

with_points(#{panels := []}) -> {none, "no run has a figure to plot"};
with_points(Plot) -> {ok, Plot}.

told(Judged, Target) ->
    lists:foreach(
        fun({How, Scenario}) ->
            Replay = starl_cli_target:replay(Target, Scenario),
            starl_cli_terminal:out([words(How), "; replay: ", Replay, "\n"])
        end,
        [Run || {How, _} = Run <- Judged, lists:member(How, [violation, unjudged, failed])]
    ),
    Counts = [
        io_lib:format("~b ~ts", [length(Known), words(How)])
     || How <- [complete, incomplete, violation, unjudged, failed],
        Known <- [[x || {H, _} <- Judged, H =:= How]],
        Known =/= []
    ],
    Text = io_lib:format("~b runs: ~ts", [length(Judged), lists:join(", ", Counts)]),
    starl_cli_terminal:out([starl_cli_terminal:wrap(Text, 2, ?WIDTH), "\n"]).

words(complete) -> "complete";
words(incomplete) -> "NOT COMPLETE";
words(violation) -> "A CONTRACT WAS VIOLATED";
words(unjudged) -> "NOT JUDGED TO THE END";
words(failed) -> "THE SIMULATION FAILED".

verdict(Known) ->
    Worst = [
        Status
     || {How, Status} <- [{violation, 3}, {failed, 1}, {unjudged, 5}, {incomplete, 4}],
        lists:member(How, Known)
    ],
    hd(Worst ++ [0]).

written({ok, Dir}, Status) ->
    starl_cli_terminal:out(["result: ", starl_cli_out:shown(Dir), "\n"]),
    Status;
written({error, Why}, _Status) ->
    starl_cli_terminal:complain(["the results could not be written: ", Why]),
    1.

%% -- in a VM of its own ---------------------------------------------------------------------

%% @private The report of a simulation that was only started.
-spec probe({N :: pos_integer(), {App :: string(), starl_run_scenario:t()}}) ->
    {ok, starl_lab_report:t(), #{atom() => string()}} | {error, unicode:chardata()}.
probe({_N, {Name, Scenario}}) -> report(Name, Scenario, starl_lab_jobs:set_up(Scenario)).

%% @private The report of a run, and its measures over time.
-spec one(job()) ->
    {ok, starl_lab_report:t(), #{atom() => string()}} | {error, unicode:chardata()}.
one({_Key, Name, Scenario}) -> report(Name, Scenario, starl_lab_jobs:simulate(Scenario)).

report(_Name, _Scenario, {error, Why}) ->
    {error, Why};
report(Name, Scenario, {ok, Ran}) ->
    {ok, starl_lab_report:make(Ran#{name => Name, scenario => Scenario}), curves(Scenario, Ran)}.

curves(Scenario, #{outcome := #{monitors := #{starl_run_measures_monitor := Seen}}}) ->
    #{values := Values, until_us := Until} = Seen,
    maps:from_list([
        {
            Measure,
            starl_lab_sweep_curve:text(starl_lab_sweep_curve:of_run(Measure, Values, Until))
        }
     || {Measure, _} <- starl_lab_sweep_curve:measures(Scenario)
    ]).
