%% @doc `./starl sweep': all combinations of some settings, each with several seeds, over all
%% cores. A directory takes a row for each run as it ends, and at the end the medians and a plot;
%% a sweep that was stopped goes on with the runs that have no row yet.
-module(starl_cli_sweep).

-export([command/1]).

%% @doc Runs the command; gives the exit status.
-spec command([string()]) -> starl_cli_terminal:status().
command(Args) ->
    case starl_cli_setup:take_target(Args) of
        {none, Flags} -> without_target(Flags);
        {Word, Flags} -> with_target(starl_cli_target:resolve(Word), Flags, Args)
    end.

without_target([Help | _]) when Help =:= "--help"; Help =:= "-h" ->
    help("TARGET", flags(starl_sim_scenario:options()));
without_target(_) ->
    refuse(["name what is to run before its flags, as in ./starl sweep painting --robots 1..8"]).

with_target({error, Problems}, _Flags, _Args) ->
    refuse(Problems);
with_target({ok, Target}, Flags, Args) ->
    Known = flags(options(Target)),
    case {starl_cli_setup:help_wanted(Flags), starl_cli_flags:parse(Flags, Known)} of
        {true, _} -> help(maps:get(replay, Target), Known);
        {false, {ok, Values}} -> checked(Target, Values, Args);
        {false, {error, Problems}} -> refuse(starl_cli_setup:flag_lines(Problems))
    end.

options(#{app := App}) -> starl_cli_setup:options(App).

flags(Options) -> starl_cli_sweep_grid:flags(Options) ++ own_flags().

own_flags() ->
    [
        {plot, {list, string}, none, "which figures of the report to plot, completion time and"
            " assignments without it"},
        {out, string, none, "directory for the results; without it out/TARGET-sweep"},
        starl_cli_jobs:at_once(),
        {help, switch, false, "this help"}
    ].

help(Word, Flags) ->
    starl_cli_terminal:out([
        "Usage: ./starl sweep ", Word, " [FLAGS]\n\n",
        starl_cli_terminal:wrap("Runs every combination of the values of the flags with every "
            "seed. The directory of the results gets runs.csv, a row for each run; summary.csv, "
            "median, least and most of each figure; and a plot. The same command goes on where "
            "it was stopped.", 0, starl_cli_terminal:columns()),
        "\n\n", starl_cli_flags:help(Flags, starl_cli_terminal:columns()),
        "\nExit status: 0 all complete; 1 a simulation failed; 2 bad usage or input; 3 a contract\n"
        "was violated; 4 a run ended before its work was complete; 130 interrupted.\n"
    ]),
    0.

refuse(Problems) -> starl_cli_terminal:bad_input([["sweep: ", P] || P <- Problems]).

%% -- before the runs ------------------------------------------------------------------------

checked(#{name := Name, given := InFile} = Target, Values, Args) ->
    Own = [Key || {Key, _, _, _} <- own_flags()],
    Grid = starl_cli_sweep_grid:new(options(Target), InFile, maps:without(Own, Values), Args),
    Checked = [{P, starl_cli_setup:scenario(Target, maps:merge(InFile, P))}
        || P <- starl_cli_sweep_grid:points(Grid)],
    Unsound = lists:uniq([unicode:characters_to_list(L) || {_, {Ls, _}} <- Checked, L <- Ls]),
    Usual = filename:join([starl_cli_target:root(), "out", Name ++ "-sweep"]),
    Dir = string:trim(maps:get(out, Values, Usual), trailing, "/"),
    {Unwritable, _} = starl_cli_setup:out(Dir, Name),
    case Unsound ++ Unwritable of
        [] ->
            probed(#{
                args => Args, target => Target, grid => Grid, dir => Dir,
                points => [{P, Scenario} || {P, {[], Scenario}} <- Checked],
                jobs => maps:get(jobs, Values, erlang:system_info(schedulers_online)),
                plot => maps:get(plot, Values, none)
            });
        Problems ->
            refuse(Problems)
    end.

%% Every point is prepared once, without a run: a picture may not fit on the floor, and the
%% figures of the report are the columns.
probed(#{points := Points, target := #{name := Name}} = Sweep) ->
    ok = starl_cli_log:install(),
    Jobs = [{N, {Name, Scenario}} || {N, {_, Scenario}} <- lists:enumerate(Points)],
    Each = fun({N, _}, Answer, Reports) -> Reports#{N => Answer} end,
    Plan = starl_cli_sweep_run:plan(Sweep, probe, "points checked", Each),
    case starl_cli_jobs:run(Jobs, Plan, #{}) of
        {interrupted, _} -> interrupted_early();
        {done, Answers} -> sound([Why || {_, Why} <- lists:sort(maps:to_list(Answers))], Sweep)
    end.

interrupted_early() ->
    starl_cli_terminal:out("interrupted before the first run\n"),
    130.

sound(Answers, Sweep) ->
    case lists:uniq([problem(A) || A <- Answers, not is_sound(A)]) of
        [] ->
            {ok, {ok, Report}} = hd(Answers),
            with_columns(starl_cli_sweep_rows:columns(maps:get(grid, Sweep), Report), Sweep);
        Problems ->
            refuse(Problems)
    end.

is_sound({ok, {ok, _}}) -> true;
is_sound(_) -> false.

problem({ok, {error, Why}}) -> unicode:characters_to_list(Why);
problem({crashed, Reason}) -> lists:flatten(io_lib:format("the set-up fails: ~0tP", [Reason, 15])).

with_columns(Columns, #{dir := Dir, plot := Plot} = Sweep) ->
    Numbers = starl_cli_sweep_rows:numbers(Columns),
    File = filename:join(Dir, "runs.csv"),
    case {starl_cli_sweep_plot:chosen(Plot, Numbers), starl_cli_sweep_rows:read(File, Columns)} of
        {{ok, Figures}, {ok, Rows, Bytes}} ->
            starl_cli_sweep_run:run(Sweep, Columns, Figures, Rows, Bytes);
        {{unknown, Names}, _} ->
            refuse([unknown_figure(Name, Numbers) || Name <- Names]);
        {_, {error, Reason}} ->
            refuse([starl_cli_sweep_rows:format_error(Reason)])
    end.

unknown_figure(Name, Numbers) ->
    Texts = [atom_to_list(Key) || Key <- Numbers],
    case starl_cli_flags:nearest(Name, Texts) of
        [Near | _] -> ["--plot: there is no figure ", Name, " (did you mean ", Near, "?)"];
        [] -> ["--plot: there is no figure ", Name, "; there are ", lists:join(", ", Texts)]
    end.
