%% @doc `./starl run': one simulation, from the flags to the directory with its results.
-module(starl_cli_run).

-export([command/1]).

%% @doc Runs the command; gives the exit status.
-spec command([string()]) -> starl_cli_terminal:status().
command(Args) ->
    case starl_cli_setup:read(Args) of
        {ok, #{print_scenario := true} = Setup} -> print(starl_cli_files:scenario(Setup));
        {ok, Setup} -> starl_cli_simulation:run(Setup);
        help -> print(general_help());
        {help, Target} -> print(target_help(Target));
        {error, Problems} -> starl_cli_terminal:bad_input(Problems)
    end.

print(Text) ->
    starl_cli_terminal:out(Text),
    0.

general_help() ->
    [
        "Usage: ./starl run TARGET [FLAGS]\n\n",
        "TARGET is an application, a scenario, a scenario file (FILE.term) or an application of\n"
        "your own (FILE.erl).\n\n",
        "  applications  ", names(starl_cli_target:apps()), "\n",
        "  scenarios     ", names(starl_cli_target:scenarios()), "\n\n",
        "./starl run TARGET --help lists the flags of TARGET.\n\n",
        statuses()
    ].

names(Known) -> lists:join(", ", [element(1, Item) || Item <- Known]).

target_help(#{app := App, name := Name, replay := Word}) ->
    Width = starl_cli_terminal:columns(),
    Sections = [
        {["Flags of ", Name], starl_app:options(App)},
        {"Flags of every simulation", starl_sim_scenario:options()},
        {"Other flags", starl_cli_setup:own_flags()}
    ],
    [
        "Usage: ./starl run ", Word, " [FLAGS]\n",
        [
            ["\n", Title, ":\n", starl_cli_flags:help(Flags, Width)]
         || {Title, Flags} <- Sections, Flags =/= []
        ],
        "\n",
        statuses()
    ].

statuses() ->
    [
        "Exit status: 0 done; 1 internal error; 2 bad usage or input; 3 a contract was violated;\n"
        "4 ended before the work was complete (time up, robots died, a node was lost);\n"
        "130 interrupted.\n"
    ].
