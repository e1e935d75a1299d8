%% @doc Runs the simulation of a command line, prints a summary, writes the files and gives an exit
%% status.
-module(starl_lab_simulation).

-export([run/1, tell/2, conclude/4, answer/2, failed/2, code/2]).

-export_type([ran/0]).

%% A finished simulation.
-type ran() :: #{
    scenario := starl_run_scenario:t(),
    ending := starl_sim_run:ending(),
    wall_ms := integer(),
    outcome := starl_sim_run:outcome(),
    app := starl_scene:report()
}.

%% The faults that were played in real time.
-define(FAULTS, "faults.term").

%% @doc Runs the simulation of a checked command line.
-spec run(starl_lab_setup:t()) -> starl_cli_command:answer().
run(#{nodes := Nodes, target := Target} = Setup) ->
    case starl_lab_nodes:options(Nodes, Target) of
        {ok, Options} -> run(starl_lab_recording:options(Setup, Options), Setup);
        {error, Line} -> {error, [Line]}
    end.

run(Options, #{scenario := Scenario} = Setup) ->
    Watching = Options#{watch => starl_lab_findings:watch(Scenario)},
    answer(
        starl_lab_drive:with(Scenario, Watching, fun(Sim) -> to_the_end(Sim, Setup) end), Setup
    ).

%% @doc Tells of a run that has ended, or of why it did not; gives the exit status.
-spec answer(starl_lab_drive:answer(ran()), starl_lab_setup:t()) -> starl_cli_command:answer().
answer({ok, Ran}, Setup) -> tell(Setup, Ran);
answer({error, {nodes, {lost, Loss}}}, _Setup) -> lost([Loss], 4);
answer({error, Reason}, Setup) -> {error, [[at(Reason, Setup), starl_sim:format_error(Reason)]]};
answer({failed, _} = Failed, Setup) -> failed(Failed, Setup).

%% The place of a mistake that only shows in the scene: a fault's robot or machine.
at(Reason, #{target := Target, scenario := Scenario}) when
    element(1, Reason) =:= fault_target; element(1, Reason) =:= fault_machine
->
    [starl_cli_target:place(faults, Target, Scenario), ": "];
at(_Reason, _Setup) ->
    "".

-spec to_the_end(starl_sim:sim(), starl_lab_setup:t()) -> ran().
to_the_end(Sim, #{scenario := #{time := Seconds}} = Setup) ->
    ok = lists:foreach(fun starl_cli_progress:note/1, starl_sim:notes(Sim)),
    {Ending, WallMs} = starl_lab_drive:run(Sim, round(Seconds * 1.0e6), Setup),
    Ran = conclude(Sim, starl_sim:scenario(Sim), Ending, WallMs),
    ok = starl_sim:close(Sim),
    Ran.

%% @doc What has become of a simulation that has come to its end; it is not closed.
-spec conclude(starl_sim:sim(), starl_run_scenario:t(), starl_lab_drive:ending(), integer()) ->
    ran().
conclude(Sim, Scenario, Ending, WallMs) ->
    {Outcome, App} = starl_sim:conclude(Sim),
    #{
        scenario => Scenario,
        ending => ending(Ending, Outcome),
        wall_ms => WallMs,
        outcome => Outcome,
        app => App
    }.

ending(_, #{lost := [_ | _]}) -> lost;
ending(none, _Outcome) -> time;
ending(Ending, _Outcome) -> Ending.

%% -- results --------------------------------------------------------------------------------

%% @doc Tells of a run: prints a summary and writes the files; gives the exit status.
-spec tell(starl_lab_setup:t(), ran()) -> starl_cli_terminal:status().
tell(#{target := #{name := Name} = Target, scenario := Scenario, out := Out} = Setup, Ran) ->
    #{ending := Ending, wall_ms := WallMs, outcome := Outcome, app := App} = Ran,
    Ways = starl_lab_ways:with(drawings(Outcome), ways(Outcome, App, Scenario)),
    Notes = starl_lab_findings:make(Outcome, Ways, starl_cli_target:beams(Target)),
    Code = code(Target, Scenario),
    Report = starl_lab_report:make(#{
        name => Name,
        scenario => Scenario,
        ending => Ending,
        wall_s => WallMs / 1000,
        outcome => Outcome,
        app => App,
        code => Code,
        notes => Notes
    }),
    Own = own(Ran, Ways, Notes, Setup),
    Record = record(Ran, Code, Setup),
    Written = starl_cli_out:write(Out, fun(Dir) ->
        with_recording(starl_lab_files:write(Dir, Setup, {Report, Record}, Own), Setup, Dir)
    end),
    said(Setup, Report, Outcome),
    ok = uploaded(Written, Setup),
    Status = lost(maps:get(lost, Outcome), status(Report)),
    where(Written, Setup, repeatable(Setup, Outcome), Status).

%% @doc Names the code of a run: of its program, and of the reloads.
-spec code(starl_cli_target:t(), starl_run_scenario:t()) -> starl_build:code().
code(Target, Scenario) ->
    starl_build:code(starl_cli_target:beams(Target) ++ starl_cli_inputs:reloaded(Scenario)).

said(Setup, Report, Outcome) ->
    _ = summarize(Setup, Report),
    violated(Setup, Outcome),
    unjudged(Outcome).

%% The files beside report and record.
own(#{app := App, outcome := Outcome}, Ways, Notes, #{target := #{name := Name}} = Setup) ->
    Draw = fun(Dir) -> starl_lab_ways:draw(Dir, Name, Ways) end,
    Texts = [
        {"results.term", starl_lab_findings:results(Notes)},
        {"trajectories.csv", starl_lab_ways:csv(Ways)}
        | played(Setup, Outcome)
    ],
    #{write => maps:get(write, App, Draw), texts => Texts ++ measures(Outcome)}.

%% What a run in real time has violated need not come again.
repeatable(#{live := true}, Outcome) -> Outcome#{violations := []};
repeatable(#{}, Outcome) -> Outcome.

%% The scenario of a run that has ended includes the faults that were drawn.
record(#{scenario := Effective, ending := Ending, outcome := Outcome}, Code, #{inputs := Inputs}) ->
    Scenario = starl_cli_inputs:local(Inputs, Effective),
    starl_cli_record:make(starl_cli_inputs:app(Inputs), Scenario, {Ending, Outcome}, Code).

measures(#{monitors := Monitors}) ->
    starl_lab_measures:csv(Monitors) ++ starl_lab_measures:svg(Monitors).

%% The scheduled and manual faults of a run in real time, for the simulator.
played(Setup, #{faults := [_ | _] = Faults}) ->
    [
        {?FAULTS, [
            "%% The faults of this run in real time, manual ones among them. In the simulator:\n%%   ",
            simulated(?FAULTS, Setup),
            "\n[\n    ",
            lists:join(",\n    ", [io_lib:format("~0tp", [Fault]) || Fault <- Faults]),
            "\n].\n"
        ]}
    ];
played(_Setup, _Outcome) ->
    [].

simulated(File, #{target := Target, scenario := Scenario}) ->
    [
        starl_cli_target:replay(Target, maps:remove(faults, Scenario)),
        " --faults ",
        starl_cli_terminal:quoted(File)
    ].

uploaded({ok, Dir}, Setup) -> starl_lab_recording:uploaded(Setup, Dir);
uploaded({partly, Dir, _Why}, Setup) -> starl_lab_recording:uploaded(Setup, Dir);
uploaded({error, _Why}, _Setup) -> ok.

with_recording(ok, Setup, Dir) ->
    starl_lab_recording:kept(Setup, Dir);
with_recording({partly, _} = Partly, Setup, Dir) ->
    _ = starl_lab_recording:kept(Setup, Dir),
    Partly;
with_recording({error, _} = Error, _Setup, _Dir) ->
    Error.

%% The floor plan is that of the scenario, or else of the application.
ways(#{monitors := #{starl_run_paths_monitor := Ways}}, #{floor := #{size := Size} = Floor}, _) ->
    starl_lab_ways:on(Floor, starl_lab_ways:new(Ways, Size));
ways(#{monitors := #{starl_run_paths_monitor := Ways}}, _Report, #{world := World}) ->
    starl_lab_ways:new(Ways, World).

drawings(#{monitors := #{starl_run_drawings_monitor := #{drawings := Drawings}}}) -> Drawings.

%% Reports lost nodes; passes on the status.
lost(Losses, Status) ->
    Lines = [starl_sim_nodes:format_loss(Loss) || Loss <- Losses],
    lists:foreach(fun starl_cli_terminal:complain/1, Lines),
    Status.

%% Even a quiet run reports its problems.
summarize(#{quiet := true}, Report) ->
    status(Report) =:= 0 orelse
        starl_cli_terminal:out([hd(starl_lab_report:summary(Report)), "\n"]);
summarize(#{quiet := false}, Report) ->
    starl_cli_terminal:out([[Line, "\n"] || Line <- starl_lab_report:summary(Report)]).

violated(_Setup, #{violations := []}) ->
    ok;
violated(Setup, #{violations := Violations}) ->
    Lines = [[starl_violation:format(V), "\n"] || V <- Violations],
    starl_cli_terminal:out([Lines, repeated(Setup)]).

%% What is not judged is neither kept nor broken.
unjudged(#{unjudged := Parts, monitors := Monitors}) ->
    Clauses = starl_monitor:clauses_not_judged(Monitors),
    Lines = [starl_unjudged:format(Part) || Part <- Parts] ++ Clauses,
    starl_cli_terminal:out([[Line, "\n"] || Line <- Lines]).

%% Real time does not come again.
repeated(#{live := true}) ->
    "";
repeated(#{target := Target, scenario := Scenario} = Setup) ->
    ["replay: ", starl_cli_target:replay(Target, Scenario), judging(Setup), "\n"].

%% Without it another run would break nothing, or go on for longer.
judging(#{histories := {judged, _}}) -> " --judge-histories";
judging(#{}) -> "".

where({ok, Dir}, Setup, Outcome, Status) ->
    Crashes =
        case starl_cli_log:lines() of
            [] -> "";
            [_ | _] -> " (see its run.log)"
        end,
    starl_cli_terminal:out(["result: ", starl_cli_out:shown(Dir), Crashes, "\n"]),
    manual_faults(Dir, Setup, Outcome),
    look(Dir, judging(Setup), Outcome),
    Status;
where({partly, Dir, Why}, Setup, Outcome, Status) ->
    _ = where({ok, Dir}, Setup, Outcome, Status),
    starl_cli_terminal:complain(Why),
    max(Status, 1);
where({error, Why}, _Setup, _Outcome, _Status) ->
    starl_cli_terminal:complain(["the results could not be written: ", Why]),
    1.

%% The simulator has the schedule that was given already.
manual_faults(Dir, #{scenario := #{faults := Given}} = Setup, #{faults := Played}) ->
    Ids = [element(1, Fault) || Fault <- Given],
    _ = [
        starl_cli_terminal:out([
            "manual faults: ",
            simulated(starl_cli_out:shown(filename:join(Dir, ?FAULTS)), Setup),
            "\n"
        ])
     || [Fault || Fault <- Played, not lists:member(element(1, Fault), Ids)] =/= []
    ],
    ok;
manual_faults(_Dir, _Setup, _Outcome) ->
    ok.

%% The commands that show the robots at the first violation and that shrink the run.
look(_Dir, _Judging, #{violations := []}) ->
    ok;
look(Dir, Judging, #{violations := [#{at_us := AtUs, robots := Robots} | _]}) ->
    Shell = starl_cli_terminal:quoted(starl_cli_out:shown(Dir)),
    Ids = lists:join(",", [integer_to_list(Id) || Id <- Robots]),
    Inspect = [[" --inspect ", Ids] || Ids =/= []],
    %% One microsecond later, so that all events of that time have happened.
    Until = io_lib:format(" --until ~.6f", [(AtUs + 1) / 1.0e6]),
    starl_cli_terminal:out([
        "look: ./starl replay ",
        [Shell, Until, Inspect, Judging],
        "\nsmaller: ./starl shrink ",
        [Shell, Judging, "\n"]
    ]).

status(Report) ->
    case {starl_lab_report:figure(violations, Report), starl_lab_report:ending(Report)} of
        {[_ | _], _} -> 3;
        {[], stopped} -> 130;
        {[], _} -> finished(starl_lab_report:judged(Report), starl_lab_report:complete(Report))
    end.

finished(false, _IsComplete) -> 5;
finished(true, true) -> 0;
finished(true, false) -> 4.

%% @doc Tells why a simulation could not start, or that it failed itself; the log has the details.
-spec failed({error, starl_sim:reason()} | {failed, Reason :: term()}, starl_lab_setup:t()) ->
    starl_cli_command:answer().
failed({error, Reason}, _Setup) ->
    {error, [starl_sim:format_error(Reason)]};
failed({failed, Reason}, #{out := Out} = Setup) ->
    starl_cli_signal:on_interrupt(quit),
    Fill = fun(Dir) ->
        with_recording(starl_lab_files:write_failure(Dir, Setup, Reason), Setup, Dir)
    end,
    Where =
        case starl_cli_out:write(Out, Fill) of
            {ok, Dir} -> ["see ", starl_cli_out:shown(filename:join(Dir, "run.log"))];
            {error, Why} -> ["and its log could not be written: ", Why]
        end,
    starl_cli_terminal:complain(["the simulation failed: ", why(Reason), "; ", Where]),
    1.

why({shard_failed, Reason}) ->
    why(Reason);
why({no_answer, Ms, AtWork}) ->
    starl_lab_stall:line(Ms, loop, AtWork);
why(Reason) ->
    io_lib:format("~0tP", [Reason, 15]).
