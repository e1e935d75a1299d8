%% @doc `./starl sweep': runs all combinations of some settings with several seeds on all cores. It
%% appends a row to a file as each run ends, and finally writes the medians and a plot. An
%% interrupted sweep continues with the runs that have no row yet.
-module(starl_lab_sweep).

-behaviour(starl_cli_command).

-export([command/0]).
-export([join/3]).

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
    Plan = starl_lab_sweep_run:plan(Sweep, probe, "points checked", Each),
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
        {ok, Rows} -> starl_lab_sweep_run:join(Sweep, Columns, Figures, Rows);
        {error, Reason} -> wrong(Reason)
    end;
with_figures(
    {make, Slice}, Columns, Figures, #{dir := Dir, target := Target, args := Args} = Sweep
) ->
    Code = starl_build:code(starl_cli_target:beams(Target)),
    case starl_lab_sweep_study:begin_slice(Dir, Slice, Columns, {Args, Code}) of
        {ok, Known} -> starl_lab_sweep_run:run(Sweep#{slice => Slice}, Columns, Figures, Known);
        {error, Reason} -> wrong(Reason)
    end.

wrong(Reason) -> {error, [starl_lab_sweep_study:format_error(Reason)]}.

unknown_figure(Name, Numbers) ->
    Texts = [atom_to_list(Key) || Key <- Numbers],
    All = ["; there are ", lists:join(", ", Texts)],
    Meant = starl_similar:meant(starl_similar:words(Name, Texts), All),
    ["--plot: there is no figure ", Name, Meant].
