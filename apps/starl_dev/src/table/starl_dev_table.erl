%% @doc `./starl table': paints every picture with teams of several sizes, several loss rates and
%% several seeds. It prints one row per picture, team and loss rate when its last seed is done.
-module(starl_dev_table).

-behaviour(starl_cli_command).

-export([command/0]).
%% Called in the VMs of the jobs.
-export([one/1]).

-type cell() :: starl_dev_table_rows:cell().
-type result() :: starl_dev_table_rows:result().
-type job() :: {cell(), starl_run_scenario:t()}.

-record(table, {
    rows :: [cell()],
    seeds :: pos_integer(),
    total :: pos_integer(),
    done = 0 :: non_neg_integer(),
    results = #{} :: #{cell() => [{Seed :: integer(), result()}]},
    bad = [] :: [unicode:chardata()],
    csv :: file:fd() | none
}).

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "table",
        synopsis => "paint every picture with many teams, losses and seeds",
        about => [
            "Paints every picture with teams of several sizes, several losses and seeds; a row for each "
            "picture, team and loss. Every run has to be sound: all painted, no contract violated, no two "
            "robots closer than the safety distance. A slice has whole rows; the files of --out of all slices "
            "together have the lines of one."
        ],
        flags => [
            {"Flags", [
                {pictures, {list, string}, shipped(), "the pictures to paint"},
                {robots, {list, {integer, 1, 1000}}, [1, 4, 8, 16], "sizes of the team"},
                {loss, {list, {number, 0, 1}}, [0, 0.2, 0.4],
                    "fractions of the packets that the radio loses"},
                {delay, {between, {number, 1, 60000}}, {5, 50}, "delay of a packet, ms"},
                {seeds, {integer, 1, 100000}, 20, "seeds per row, from 1"},
                {random, {integer, 0, 10000}, 0,
                    "number of random pictures, small to large, besides the others"},
                {random_seed, {integer, 0, 1 bsl 32}, 1, "the seed of the random pictures"},
                {time, {number, 1, 1.0e6}, 40000, "a run ends at this virtual time, s"},
                starl_lab_slice:flag(),
                starl_lab_jobs:at_once(),
                {out, string, none, "a CSV file with a line for each run"},
                starl_cli_out:overwrite_file()
            ]}
        ],
        statuses => [
            {0, "all runs were sound"}, {3, "some were not"}, {130, "interrupted"}
        ],
        run => fun run/1
    }.

shipped() ->
    Files = filelib:wildcard("*.svg", filename:join(code:priv_dir(starl_apps), "pictures")),
    [filename:rootname(File) || File <- lists:sort(Files)].

%% -- before the runs ------------------------------------------------------------------------

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{values := #{slice := Text} = Options}) ->
    case starl_lab_slice:read(Text) of
        {ok, Slice} -> begun(Options#{slice := Slice});
        {error, Why} -> {error, [["--slice: ", Why]]}
    end.

begun(#{random := N, random_seed := Seed, pictures := Named} = Options) ->
    ok = starl_cli_log:install(),
    _ = process_flag(trap_exit, true),
    {Dir, Files} = starl_dev_table_pictures:write(N, Seed),
    Pictures = Named ++ Files,
    #{out := Out, overwrite := Overwrite} = Options,
    There = [
        Line
     || Out =/= none, Line <- element(1, starl_cli_out:file(Out, Out, Overwrite))
    ],
    Problems = There ++ lists:append([problems(P, Options) || P <- Pictures]),
    case {Problems, csv(Problems, Out)} of
        {[], {ok, Csv}} -> painted(Pictures, Csv, Dir, Options);
        {_, {error, Why}} -> {error, Problems ++ [["--out: ", Why]]};
        {_, {ok, _}} -> {error, Problems}
    end.

%% Whether a picture can be painted by the largest team.
problems(Picture, #{robots := Robots} = Options) ->
    case starl_sim:start(scenario({Picture, lists:max(Robots), 0}, 1, Options)) of
        {ok, Sim} ->
            starl_sim:close(Sim),
            [];
        {error, Reason} ->
            [starl_sim:format_error(Reason)]
    end.

%% Nothing is opened, and emptied, for runs that cannot be made.
csv(_Problems, none) ->
    {ok, none};
csv([_ | _], _File) ->
    {ok, none};
csv([], File) ->
    case file:open(File, [write, raw]) of
        {ok, Csv} ->
            ok = keep(Csv, starl_dev_table_rows:csv_header()),
            {ok, Csv};
        {error, Posix} ->
            {error, [File, ": ", file:format_error(Posix)]}
    end.

scenario({Picture, Robots, Loss}, Seed, #{delay := Delay, time := Time}) ->
    #{
        app => starl_painting,
        picture => Picture,
        robots => Robots,
        loss => Loss,
        seed => Seed,
        delay => Delay,
        time => Time
    }.

%% -- the runs -------------------------------------------------------------------------------

painted(Pictures, Csv, Dir, #{robots := Robots, loss := Losses, seeds := Seeds} = Options) ->
    All = [{P, N, Loss} || P <- Pictures, N <- Robots, Loss <- Losses],
    Rows = starl_lab_slice:part(maps:get(slice, Options), All),
    Jobs = [{Row, scenario(Row, Seed, Options)} || Row <- Rows, Seed <- lists:seq(1, Seeds)],
    starl_cli_terminal:out(starl_dev_table_rows:header(Seeds)),
    Plan = #{
        work => {?MODULE, one},
        at_once => maps:get(jobs, Options),
        what => "runs",
        each => fun noted/3
    },
    Table = #table{rows = Rows, seeds = Seeds, total = length(Jobs), csv = Csv},
    {How, Ended} = starl_lab_jobs:run(Jobs, Plan, Table),
    conclude(How, Ended, Dir).

%% @private One run, in the VM of its job.
-spec one(job()) -> result().
one({_Row, Scenario}) ->
    case starl_lab_jobs:simulate(Scenario) of
        {ok, #{outcome := Outcome, app := #{figures := Figures}, wall_s := Wall}} ->
            figures(maps:from_list(Figures), Outcome, Wall);
        {error, _} ->
            failed
    end.

figures(Figures, #{end_us := EndUs, violations := Violations, digest := Digest}, Wall) ->
    #{driven_mm := Driven, ink_mm := Ink} = Figures,
    #{
        covered => maps:get(ink_covered, Figures),
        violations => length(Violations),
        separation => separation(maps:get(min_separation_mm, Figures)),
        safe => maps:get(safety_distance_mm, Figures),
        makespan => EndUs / 1.0e6,
        ratio => maps:get(makespan_bound_ratio, Figures),
        detour => Driven / max(1.0, Ink),
        deadlocks => maps:get(deadlocks_resolved, Figures),
        wall => Wall,
        digest => string:lowercase(binary:encode_hex(Digest))
    }.

separation(null) -> none;
separation(Mm) -> Mm.

%% -- rows -----------------------------------------------------------------------------------

-spec noted(job(), starl_lab_jobs:answer(result()), #table{}) -> #table{}.
noted(Job, {crashed, _}, Table) ->
    noted(Job, {ok, failed}, Table);
noted({Row, #{seed := Seed} = Scenario}, {ok, Result}, #table{results = Results} = Table) ->
    ok = keep(Table#table.csv, starl_dev_table_rows:csv(Row, Seed, Result)),
    Noted = [{Seed, Result} | maps:get(Row, Results, [])],
    Bad =
        case starl_dev_table_rows:sound(Result) of
            true -> [];
            false -> [complaint(Result, Scenario)]
        end,
    finished_rows(Table#table{
        results = Results#{Row => Noted}, bad = Bad ++ Table#table.bad, done = Table#table.done + 1
    }).

keep(none, _Line) -> ok;
keep(Csv, Line) -> starl_cli_out:sure("--out", file:write(Csv, unicode:characters_to_binary(Line))).

%% Rows are printed in order: each waits for all rows before it.
finished_rows(#table{rows = [Row | Rows], seeds = Seeds, results = Results} = Table) ->
    case maps:get(Row, Results, []) of
        Known when length(Known) =:= Seeds ->
            starl_cli_progress:erase(),
            Ordered = [Result || {_Seed, Result} <- lists:sort(Known)],
            starl_cli_terminal:out(starl_dev_table_rows:line(Row, Ordered)),
            finished_rows(Table#table{rows = Rows, results = maps:remove(Row, Results)});
        _ ->
            Table
    end;
finished_rows(#table{rows = []} = Table) ->
    Table.

complaint(Result, Scenario) ->
    {ok, Target} = starl_cli_target:resolve("painting"),
    {[], Full} = starl_cli_target:scenario(Target, Scenario),
    [starl_dev_table_rows:wrong(Result), ": ", starl_cli_target:replay(Target, Full)].

%% -- the end --------------------------------------------------------------------------------

conclude(How, #table{bad = Bad, done = Done, total = Total, csv = Csv}, Dir) ->
    _ = [ok = file:close(Csv) || Csv =/= none],
    Wrong = lists:reverse(Bad),
    starl_cli_terminal:out([[Line, "\n"] || Line <- Wrong]),
    _ = Wrong =:= [] andalso starl_dev_table_pictures:remove(Dir),
    verdict(Wrong, How, Done, Total).

verdict(Wrong, interrupted, Done, Total) ->
    starl_cli_terminal:out("interrupted after ~b of ~b runs, ~b not sound\n", [
        Done, Total, length(Wrong)
    ]),
    130;
verdict([], done, Done, _Total) ->
    starl_cli_terminal:out(
        "all ~b runs: painted 100 %, no contract violated,\n"
        "no robots closer than the safety distance\n",
        [Done]
    ),
    0;
verdict(Wrong, done, Done, _Total) ->
    starl_cli_terminal:out("NOT SOUND: ~b of ~b runs, see above\n", [length(Wrong), Done]),
    3.
