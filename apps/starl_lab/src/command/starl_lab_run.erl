%% @doc `./starl run': runs one simulation and writes a directory with its results.
-module(starl_lab_run).
-behaviour(starl_cli_command).

-export([command/0]).

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "run",
        synopsis => "run an application or a scenario",
        argument => {required, "TARGET", {example, "painting"}},
        subject => fun starl_cli_target:subject/2,
        about => fun about/1,
        flags => fun flags/1,
        statuses => [
            {0, "done"},
            {1, "internal error"},
            {3, "a contract was violated"},
            {4, "ended before the work was complete (time up, robots died, a node was lost)"},
            {5, "a part of the run was not judged, and in the rest no contract was violated"},
            {130, "interrupted"}
        ],
        run => fun run/1
    }.

about(none) ->
    [
        "TARGET is an application, a scenario, a scenario file (FILE.term), an application of "
        "your own (FILE.erl, or a directory with it and its blocks and monitors) or a recorded run "
        "(its directory).",
        {list, "TARGET", [
            {"applications", names(starl_cli_target:purposes())},
            {"scenarios", names(starl_cli_target:scenarios())}
        ]},
        "./starl run TARGET --help lists the flags of TARGET, too."
    ];
about(_Target) ->
    [].

names(Known) -> lists:join(", ", [element(1, Item) || Item <- Known]).

flags(none) ->
    flags_of_all();
flags(#{app := App, name := Name}) ->
    Own = [{["Flags of ", Name], starl_app:options(App)}],
    [Group || {_, [_ | _]} = Group <- Own] ++ flags_of_all().

flags_of_all() ->
    [
        {"Flags of every simulation", starl_run_scenario:options()},
        {"Other flags",
            starl_lab_setup:own_flags() ++
                [live(), starl_lab_setup:judge_histories() | starl_lab_live:flags()] ++
                starl_lab_window:flags() ++ starl_lab_recording:flags()}
    ].

live() -> {live, switch, false, "in real time, as on real robots, not in virtual time"}.

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{values := #{live := true, judge_histories := true}}) ->
    {error, [
        "--judge-histories is for simulations; ./starl histories judges the recording of a live run"
    ]};
run(#{given := Given, values := Values} = Call) ->
    Flags =
        [live(), starl_lab_setup:judge_histories() | starl_lab_live:flags()] ++
            starl_lab_window:flags() ++ starl_lab_recording:flags(),
    Other = [Key || {Key, _, _, _} <- Flags],
    case starl_lab_setup:check(Call#{given := maps:without(Other, Given)}) of
        {ok, #{print_scenario := true} = Setup} ->
            starl_cli_terminal:out(starl_lab_files:scenario(Setup)),
            0;
        {ok, #{target := Target} = Setup} ->
            run(maps:merge(Setup, starl_lab_setup:histories(Target, Values)), Values);
        {error, _} = Error ->
            Error
    end.

run(Setup, #{live := true} = Values) ->
    starl_lab_live:run(here, Setup, Values);
run(Setup, Values) ->
    Recorded =
        case starl_lab_recording:wanted(simulation, Values) of
            true -> simulation;
            false -> none
        end,
    Run = fun(With) -> simulated(With, Values) end,
    starl_lab_recording:recorded(Recorded, Values, Setup, Run).

simulated(Setup, #{view := true} = Values) -> starl_lab_window:run(Setup, Values);
simulated(Setup, _Values) -> starl_lab_simulation:run(Setup).
