%% @doc Makes the missing runs of a sweep. From all rows it then makes the summary, the plot and the
%% exit status.
-module(starl_lab_sweep_run).

-export([run/4, join/4, plan/4]).
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

%% @doc Makes the runs, or those of a slice.
-spec run(sweep(), starl_lab_sweep_rows:columns(), [starl_lab_sweep_plot:figure(), ...], known()) ->
    answer().
run(#{slice := Slice} = Sweep, Columns, Figures, {File, Rows, Bytes}) ->
    case starl_lab_sweep_rows:open(File, Columns, Bytes) of
        {ok, Device} ->
            Made = #made{rows = Rows, columns = Columns, device = Device},
            all(starl_lab_slice:part(Slice, runs(Sweep)), Made, Figures, Sweep#{file => File});
        {error, Reason} ->
            {error, [starl_lab_sweep_rows:format_error(Reason)]}
    end.

%% @doc Makes the summary and the plot from rows that are there, if none is missing.
-spec join(sweep(), Columns, [starl_lab_sweep_plot:figure(), ...], starl_lab_sweep_rows:rows()) ->
    0 | 1 | 3 | 4 | 5
when
    Columns :: starl_lab_sweep_rows:columns().
join(#{work := {join, Dirs, _Code}} = Sweep, Columns, Figures, Rows) ->
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

%% @doc The plan for the jobs of a sweep, which call a function of this module.
-spec plan(sweep(), probe | one, What :: string(), Each) -> starl_lab_jobs:plan(Job, Acc) when
    Each :: fun((Job, starl_lab_jobs:answer(term()), Acc) -> Acc).
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
