%% @doc `./starl run': one simulation, from the flags to the directory with its results.
-module(starl_cli_run).

-export([command/1, setup/1, replay/2, command_line/3, take_target/1, scenario/2]).
-export([help_wanted/1, flag_lines/1, out/2, options/1]).

-export_type([setup/0]).

%% A checked command line: what is to run, with all its values, and where the results go.
-type setup() :: #{
    target := starl_cli_target:t(),
    scenario := starl_sim_scenario:t(),
    out := starl_cli_out:t(),
    nodes := starl_cli_nodes:plan(),
    quiet := boolean(),
    print_scenario := boolean()
}.

-define(EXAMPLE, "as in ./starl run painting; ./starl run --help tells more").

-type answer() ::
    {ok, setup()} | help | {help, starl_cli_target:t()} | {error, [unicode:chardata(), ...]}.

%% @doc Runs the command; gives the exit status.
-spec command([string()]) -> starl_cli_terminal:status().
command(Args) ->
    case setup(Args) of
        {ok, #{print_scenario := true} = Setup} -> print(starl_cli_files:scenario(Setup));
        {ok, Setup} -> starl_cli_simulation:run(Setup);
        help -> print(general_help());
        {help, Target} -> print(target_help(Target));
        {error, Problems} -> starl_cli_terminal:bad_input(Problems)
    end.

%% @doc Reads and checks the arguments, all in one go.
-spec setup([string()]) -> answer().
setup(Args) ->
    case take_target(Args) of
        {none, []} -> {error, ["run: name what is to run, " ?EXAMPLE]};
        {none, [Flag | _]} when Flag =:= "--help"; Flag =:= "-h" -> help;
        {none, _} -> {error, ["run: name what is to run before its flags, " ?EXAMPLE]};
        {Word, Others} -> with_target(starl_cli_target:resolve(Word), Others)
    end.

%% @doc Takes the word that names the target from the arguments. It comes first; behind flags it
%% is known by what it names.
-spec take_target([string()]) -> {string() | none, [string()]}.
take_target([[C | _] = Word | Args]) when C =/= $- ->
    {Word, Args};
take_target(Args) ->
    case lists:splitwith(fun(Arg) -> not starl_cli_target:looks_like_one(Arg) end, Args) of
        {Before, [Word | After]} -> {Word, Before ++ After};
        {_, []} -> {none, Args}
    end.

with_target({error, Problems}, _Args) ->
    {error, Problems};
with_target({ok, #{app := App} = Target}, Args) ->
    case {help_wanted(Args), starl_cli_flags:parse(Args, flags(App))} of
        {true, _} -> {help, Target};
        {false, {ok, Values}} -> checked(Target, Values, []);
        {false, {error, Problems}} -> checked(Target, #{}, flag_lines(Problems))
    end.

%% @doc Whether help is asked for, whatever else.
-spec help_wanted([string()]) -> boolean().
help_wanted(Args) -> lists:member("--help", Args) orelse lists:member("-h", Args).

%% @doc The problems of flags as lines.
-spec flag_lines([starl_cli_flags:problem()]) -> [unicode:chardata()].
flag_lines(Problems) -> [starl_cli_flags:format_problem(P) || P <- Problems].

%% Values of a scenario file give way to flags.
checked(#{name := Name, given := FromFile} = Target, Values, Flagged) ->
    Own = [Key || {Key, _, _, _} <- own_flags()],
    Given = maps:merge(FromFile, maps:without(Own, Values)),
    {Unsound, Scenario} = scenario(Target, Given),
    {Unwritable, Out} = out(maps:get(out, Values, none), Name),
    {Unusable, Nodes} = starl_cli_nodes:plan(Values),
    case Flagged ++ Unsound ++ Unwritable ++ Unusable of
        [] ->
            {ok, #{
                target => Target, scenario => Scenario, out => Out, nodes => Nodes,
                quiet => maps:get(quiet, Values, false),
                print_scenario => maps:get(print_scenario, Values, false)
            }};
        Problems ->
            {error, Problems}
    end.

%% @doc Checks the values for a target; gives what is wrong, and the scenario.
-spec scenario(starl_cli_target:t(), #{atom() => term()}) ->
    {[unicode:chardata()], starl_sim_scenario:t()}.
scenario(#{app := App, file := File}, Given) ->
    case starl_sim_scenario:check(Given#{app => App}, starl_app:options(App)) of
        {ok, Scenario} -> {[], Scenario};
        {error, {problems, Problems}} ->
            {[[File, ": ", starl_options:format_problem(P)] || P <- Problems], #{}}
    end.

%% @doc Checks the directory for the results; gives what is wrong, and the plan.
-spec out(none | file:filename(), Name :: string()) ->
    {[unicode:chardata()], starl_cli_out:t() | none}.
out(Dir, Name) ->
    case starl_cli_out:plan(Dir, Name) of
        {ok, Plan} -> {[], Plan};
        {error, Why} -> {[["--out: ", Why]], none}
    end.

%% @doc The command line that replays a run exactly.
-spec replay(starl_cli_target:t(), starl_sim_scenario:t()) -> unicode:chardata().
replay(Target, Scenario) -> command_line("run", Target, Scenario).

%% @doc The command line of a command that takes a target and its values.
-spec command_line(string(), starl_cli_target:t(), starl_sim_scenario:t()) -> unicode:chardata().
command_line(Command, #{app := App, replay := Word}, Scenario) ->
    Options = options(App),
    Defaults = maps:without([seed, robots], starl_cli_flags:defaults(Options)),
    Chosen = maps:filter(
        fun(Key, Value) -> maps:find(Key, Defaults) =/= {ok, Value} end, maps:remove(app, Scenario)
    ),
    lists:join(" ", ["./starl", Command, starl_cli_flags:shell(Word) | starl_cli_flags:arguments(Options, Chosen)]).

%% -- flags and help -------------------------------------------------------------------------

%% @doc The options of a simulation and of its application.
-spec options(module()) -> [starl_options:option()].
options(App) -> starl_sim_scenario:options() ++ starl_app:options(App).

flags(App) -> own_flags() ++ options(App).

own_flags() ->
    [
        {out, string, none, "directory for the results; without it a new one under out/"},
        {quiet, switch, false, "no progress and no summary, only where the result is"},
        {print_scenario, switch, false,
            "no run: prints all values as a scenario file, which ./starl run FILE.term runs"},
        {help, switch, false, "this help"}
        | starl_cli_nodes:flags()
    ].

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
        {"Other flags", own_flags()}
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
