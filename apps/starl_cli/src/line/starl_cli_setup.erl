%% @doc Checks the command line of a run, for all commands that run simulations.
-module(starl_cli_setup).

-export([check/1, given/2, scenario/2, place/3, replay/2, command_line/3]).
-export([out/2, out/3, out_file/3, own_flags/0, overwrite/0, overwrite_file/0]).
-export([judge_histories/0, histories/2]).

-export_type([t/0, answer/0]).

%% A checked command line: the target, all its values, and the directory for the results.
-type t() :: #{
    target := starl_cli_target:t(),
    scenario := starl_run_scenario:t(),
    out := starl_cli_out:t(),
    inputs := starl_cli_inputs:t(),
    nodes := starl_cli_nodes:plan(),
    quiet := boolean(),
    print_scenario := boolean(),
    %% a run in real time
    live => boolean(),
    %% the user's own chassis
    own => starl_world_drivers:t(),
    recording => starl_cli_recording:t(),
    %% the period in which the robots' states are recorded
    snapshots_us => pos_integer(),
    %% they are judged, too
    histories => starl_run_plan:histories(),
    %% who sends the recordings meanwhile, and where to
    upload => {pid(), starl_storage_rclone:path()}
}.

-type answer() :: {ok, t()} | {error, [unicode:chardata(), ...]}.

%% @doc Checks the command line of a run and reports all problems at once.
-spec check(starl_cli_command:call()) -> answer().
check(#{subject := #{name := Name} = Target, values := Values} = Call) ->
    {Unsound, Scenario} = scenario(Target, given(Call, own_flags())),
    {Unwritable, Out} = out(maps:get(out, Values), Name, maps:get(overwrite, Values)),
    {Unusable, Nodes} = starl_cli_nodes:plan(maps:get(given, Call)),
    case Unsound ++ Unwritable ++ Unusable ++ too_large(Unsound, Scenario, Nodes) of
        [] ->
            {ok, (maps:with([quiet, print_scenario], Values))#{
                target => Target,
                scenario => Scenario,
                out => Out,
                inputs => starl_cli_inputs:read(Target, Scenario),
                nodes => Nodes
            }};
        Problems ->
            {error, Problems}
    end.

%% Over several machines each has a part of the robots only, so this one says nothing.
too_large([], Scenario, none) -> starl_cli_memory:check(Scenario);
too_large(_Unsound, _Scenario, _Nodes) -> [].

%% @doc The flag by which a simulation also judges the calls to blocks and their answers by themselves.
-spec judge_histories() -> starl_cli_flags:flag().
judge_histories() ->
    {judge_histories, switch, false,
        "judges the calls to blocks and their answers by themselves, too, as ./starl soak does"}.

%% @doc The option of a simulation for that flag, by the models of all blocks and of the target's own ones.
-spec histories(starl_cli_target:t(), #{atom() => term()}) ->
    #{histories => starl_run_plan:histories()}.
histories(Target, #{judge_histories := true}) ->
    Own = [Module || {Module, _, _} <- maps:get(code, Target, [])],
    #{histories => {judged, starl_block_catalogue:histories(Own)}};
histories(_Target, _Values) ->
    #{}.

%% @doc The values of a simulation that a command line sets, for a command with flags of its own.
%% Flags override the values of a scenario file.
-spec given(starl_cli_command:call(), Own :: [starl_cli_flags:flag()]) -> #{atom() => term()}.
given(#{subject := #{given := InFile}, given := Given}, Own) ->
    maps:merge(InFile, maps:without([Key || {Key, _, _, _} <- Own], Given)).

%% @doc Checks the values for a target; gives the problems and the scenario.
-spec scenario(starl_cli_target:t(), #{atom() => term()}) ->
    {[unicode:chardata()], starl_run_scenario:t()}.
scenario(#{app := App} = Target, Given) ->
    Uncompiled = starl_cli_source:of_options(starl_run_scenario:options(App), Given),
    case starl_run_scenario:check(Given#{app => App}, starl_app:options(App)) of
        _ when Uncompiled =/= [] ->
            {Uncompiled, #{}};
        {ok, Scenario} ->
            {[], Scenario};
        {error, {problems, Problems}} ->
            {[problem(P, Target, Given) || P <- Problems], #{}}
    end.

%% Problems of lists of faults do not name the key themselves.
problem({fault, _} = P, Target, Given) -> problem(faults, P, Target, Given);
problem({no_controller, _} = P, Target, Given) -> problem(controller, P, Target, Given);
problem({no_such_faults, _} = P, Target, Given) -> problem(random_faults, P, Target, Given);
problem(P, #{file := File}, _Given) -> [File, ": ", starl_options:format_problem(P)].

problem(Key, P, Target, Given) ->
    [place(Key, Target, Given), ": ", starl_run_scenario:format_problem(P)].

%% @doc The place of a value: its flag, or its key in a scenario file.
-spec place(Key :: atom(), starl_cli_target:t(), #{atom() => term()}) -> unicode:chardata().
place(Key, #{file := File, given := InFile}, Given) ->
    case {maps:get(Key, Given), InFile} of
        {Value, #{Key := Value}} -> [File, ": ", atom_to_list(Key)];
        {_, _} -> starl_cli_flags:flag(Key)
    end.

%% @doc Checks the directory for the results; gives the problems and the plan.
-spec out(none | file:filename(), Name :: string()) ->
    {[unicode:chardata()], starl_cli_out:t() | none}.
out(Dir, Name) ->
    case starl_cli_out:plan(Dir, Name) of
        {ok, Plan} -> {[], Plan};
        {error, Why} -> {[["--out: ", Why]], none}
    end.

%% @doc The same for a run, which replaces the results of an earlier one only on request.
-spec out(none | file:filename(), Name :: string(), Overwrite :: boolean()) ->
    {[unicode:chardata()], starl_cli_out:t() | none}.
out(Dir, Name, Overwrite) ->
    case Dir =/= none andalso not Overwrite andalso starl_cli_out:holds_a_run(Dir) of
        true -> {[["--out: ", Dir, " holds an earlier run; --overwrite replaces it"]], none};
        false -> out(Dir, Name)
    end.

%% @doc The file for a result: the one of --out, which replaces an earlier one only on request; else
%% the usual one, or one beside it if that exists.
-spec out_file(none | file:filename(), Usual :: file:filename(), Overwrite :: boolean()) ->
    {[unicode:chardata()], file:filename()}.
out_file(none, Usual, true) ->
    {[], Usual};
out_file(none, Usual, false) ->
    {[], starl_cli_out:free(Usual)};
out_file(File, _Usual, Overwrite) ->
    %% A device such as /dev/null holds nothing.
    case not Overwrite andalso filelib:is_regular(File) of
        true -> {[["--out: ", File, " is there already; --overwrite replaces it"]], File};
        false -> {[], File}
    end.

%% @doc The command line that replays a run exactly.
-spec replay(starl_cli_target:t(), starl_run_scenario:t()) -> unicode:chardata().
replay(Target, Scenario) -> command_line("run", Target, Scenario).

%% @doc The command line of a command that takes a target and its values.
-spec command_line(string(), starl_cli_target:t(), starl_run_scenario:t()) -> unicode:chardata().
command_line(Command, #{app := App, replay := Word}, Scenario) ->
    Options = starl_run_scenario:options(App),
    Defaults = maps:without([seed, robots], starl_cli_flags:defaults(Options)),
    Chosen = maps:filter(
        fun(Key, Value) -> maps:find(Key, Defaults) =/= {ok, Value} end, maps:remove(app, Scenario)
    ),
    Arguments = starl_cli_flags:arguments(Options, Chosen),
    lists:join(" ", ["./starl", Command, starl_cli_quoted:word(Word) | Arguments]).

%% -- flags ----------------------------------------------------------------------------------

%% @doc The flag that allows the results of an earlier run to be replaced.
-spec overwrite() -> starl_cli_flags:flag().
overwrite() -> {overwrite, switch, false, "replaces the earlier run that --out holds"}.

%% @doc The flag that allows an earlier file to be replaced.
-spec overwrite_file() -> starl_cli_flags:flag().
overwrite_file() -> {overwrite, switch, false, "replaces an earlier file of that name"}.

%% @doc The flags of a run that do not belong to the simulation.
-spec own_flags() -> [starl_cli_flags:flag()].
own_flags() ->
    [
        {out, string, none, "directory for the results; without it a new one under out/"},
        overwrite(),
        {quiet, switch, false, "no progress and no summary, only where the result is"},
        {print_scenario, switch, false,
            "no run: prints all values as a scenario file, which ./starl run FILE.term runs"}
        | starl_cli_nodes:flags()
    ].
