%% @doc Checks the command line of a run, for all commands that run simulations.
-module(starl_lab_setup).

-export([check/1, own_flags/0, judge_histories/0, histories/2]).

-export_type([t/0, answer/0]).

%% A checked command line: the target, all its values, and the directory for the results.
-type t() :: #{
    target := starl_cli_target:t(),
    scenario := starl_run_scenario:t(),
    out := starl_cli_out:t(),
    inputs := starl_cli_inputs:t(),
    nodes := starl_lab_nodes:plan(),
    quiet := boolean(),
    print_scenario := boolean(),
    %% a run in real time
    live => boolean(),
    %% the user's own chassis
    own => starl_world_own_chassis:drivers(),
    recording => starl_lab_recording:t(),
    %% they are judged, too
    histories => starl_run_plan:histories(),
    %% who sends the recordings meanwhile, and where to
    upload => {pid(), starl_storage_rclone:path()}
}.

-type answer() :: {ok, t()} | {error, [unicode:chardata(), ...]}.

%% @doc Checks the command line of a run and reports all problems at once.
-spec check(starl_cli_command:call()) -> answer().
check(#{subject := #{name := Name} = Target, values := Values} = Call) ->
    Given = starl_cli_target:given(Call, own_flags()),
    {Unsound, Scenario} = starl_cli_target:scenario(Target, Given),
    #{out := Dir, overwrite := Overwrite} = Values,
    {Unwritable, Out} = starl_cli_out:directory(Dir, Name, Overwrite),
    {Unusable, Nodes} = starl_lab_nodes:plan(maps:get(given, Call)),
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
too_large([], Scenario, none) -> starl_lab_memory:check(Scenario);
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

%% -- flags ----------------------------------------------------------------------------------

%% @doc The flags of a run that do not belong to the simulation.
-spec own_flags() -> [starl_cli_flags:flag()].
own_flags() ->
    [
        {out, string, none, "directory for the results; without it a new one under out/"},
        starl_cli_out:overwrite(),
        {quiet, switch, false, "no progress and no summary, only where the result is"},
        {print_scenario, switch, false,
            "no run: prints all values as a scenario file, which ./starl run FILE.term runs"}
        | starl_lab_nodes:flags()
    ].
