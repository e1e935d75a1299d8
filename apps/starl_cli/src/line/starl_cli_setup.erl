%% @doc The command line of a run, checked: what all commands share that run something.
-module(starl_cli_setup).

-export([read/1, take_target/1, scenario/2, replay/2, command_line/3]).
-export([help_wanted/1, flag_lines/1, out/2, options/1, own_flags/0]).

-export_type([t/0, answer/0]).

%% A checked command line: what is to run, with all its values, and where the results go.
-type t() :: #{
    target := starl_cli_target:t(),
    scenario := starl_sim_scenario:t(),
    out := starl_cli_out:t(),
    nodes := starl_cli_nodes:plan(),
    quiet := boolean(),
    print_scenario := boolean()
}.

-define(EXAMPLE, "as in ./starl run painting; ./starl run --help tells more").

-type answer() ::
    {ok, t()} | help | {help, starl_cli_target:t()} | {error, [unicode:chardata(), ...]}.

%% @doc Reads and checks the arguments, all in one go.
-spec read([string()]) -> answer().
read(Args) ->
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
    Arguments = starl_cli_flags:arguments(Options, Chosen),
    lists:join(" ", ["./starl", Command, starl_cli_flags:shell(Word) | Arguments]).

%% -- flags and help -------------------------------------------------------------------------

%% @doc The options of a simulation and of its application.
-spec options(module()) -> [starl_options:option()].
options(App) -> starl_sim_scenario:options() ++ starl_app:options(App).

flags(App) -> own_flags() ++ options(App).

%% @doc The flags of a run that are not the simulation's.
-spec own_flags() -> [starl_cli_flags:flag()].
own_flags() ->
    [
        {out, string, none, "directory for the results; without it a new one under out/"},
        {quiet, switch, false, "no progress and no summary, only where the result is"},
        {print_scenario, switch, false,
            "no run: prints all values as a scenario file, which ./starl run FILE.term runs"},
        {help, switch, false, "this help"}
        | starl_cli_nodes:flags()
    ].
