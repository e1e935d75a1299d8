%% @doc Checks the command line of a run, for all commands that run simulations.
-module(starl_cli_setup).

-export([check/1, given/2, scenario/2, place/3, replay/2, command_line/3]).
-export([out/2, options/1, own_flags/0]).

-export_type([t/0, answer/0]).

%% A checked command line: the target, all its values, and the directory for the results.
-type t() :: #{
    target := starl_cli_target:t(),
    scenario := starl_sim_scenario:t(),
    out := starl_cli_out:t(),
    nodes := starl_cli_nodes:plan(),
    quiet := boolean(),
    print_scenario := boolean()
}.

-type answer() :: {ok, t()} | {error, [unicode:chardata(), ...]}.

%% @doc Checks the command line of a run and reports all problems at once.
-spec check(starl_cli_command:call()) -> answer().
check(#{subject := #{name := Name} = Target, values := Values} = Call) ->
    {Unsound, Scenario} = scenario(Target, given(Call, own_flags())),
    {Unwritable, Out} = out(maps:get(out, Values), Name),
    {Unusable, Nodes} = starl_cli_nodes:plan(maps:get(given, Call)),
    case Unsound ++ Unwritable ++ Unusable of
        [] ->
            {ok, (maps:with([quiet, print_scenario], Values))#{
                target => Target, scenario => Scenario, out => Out, nodes => Nodes
            }};
        Problems ->
            {error, Problems}
    end.

%% @doc The values of a simulation that a command line sets, for a command with flags of its own.
%% Flags override the values of a scenario file.
-spec given(starl_cli_command:call(), Own :: [starl_cli_flags:flag()]) -> #{atom() => term()}.
given(#{subject := #{given := InFile}, given := Given}, Own) ->
    maps:merge(InFile, maps:without([Key || {Key, _, _, _} <- Own], Given)).

%% @doc Checks the values for a target; gives the problems and the scenario.
-spec scenario(starl_cli_target:t(), #{atom() => term()}) ->
    {[unicode:chardata()], starl_sim_scenario:t()}.
scenario(#{app := App} = Target, Given) ->
    case starl_sim_scenario:check(Given#{app => App}, starl_app:options(App)) of
        {ok, Scenario} ->
            {[], Scenario};
        {error, {problems, Problems}} ->
            {
                [
                    [place(key(P), Target, Given), ": ", starl_sim_scenario:format_problem(P)]
                 || P <- Problems
                ],
                #{}
            }
    end.

%% The value in which a problem lies.
key({fault, _}) -> faults;
key({no_such_faults, _}) -> random_faults;
key(Problem) -> element(2, Problem).

%% @doc The place of a value: its flag, or the file that it stands in.
-spec place(Key :: term(), starl_cli_target:t(), #{atom() => term()}) -> unicode:chardata().
place(Key, #{file := File, given := InFile}, Given) ->
    case {maps:find(Key, Given), maps:find(Key, InFile)} of
        {{ok, Value}, {ok, Value}} -> [File, in(Key)];
        {{ok, _}, _} when is_atom(Key) -> starl_cli_flags:flag(Key);
        {_, _} -> File
    end.

in(Key) when Key =:= faults; Key =:= random_faults -> [": ", atom_to_list(Key)];
in(_Key) -> "".

%% @doc Checks the directory for the results; gives the problems and the plan.
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

%% -- flags ----------------------------------------------------------------------------------

%% @doc The options of a simulation and of its application.
-spec options(module()) -> [starl_options:option()].
options(App) -> starl_sim_scenario:options() ++ starl_app:options(App).

%% @doc The flags of a run that do not belong to the simulation.
-spec own_flags() -> [starl_cli_flags:flag()].
own_flags() ->
    [
        {out, string, none, "directory for the results; without it a new one under out/"},
        {quiet, switch, false, "no progress and no summary, only where the result is"},
        {print_scenario, switch, false,
            "no run: prints all values as a scenario file, which ./starl run FILE.term runs"}
        | starl_cli_nodes:flags()
    ].
