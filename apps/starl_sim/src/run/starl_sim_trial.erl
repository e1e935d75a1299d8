%% @doc Runs a scenario once and returns only its verdict, for searches over many scenarios. It runs
%% inline and in one shard: that is fast and, by contract, does not change the result.
-module(starl_sim_trial).

-export([run/1, run/2, run/3, run/4, apart/1, whole/1]).

-export_type([verdict/0, outcome/0, reason/0]).

%% The outcome of a run. `scenario' includes the drawn faults, `lost' lists the packets that the
%% radio has lost.
-type outcome() :: #{
    scenario := starl_run_scenario:t(),
    digest := binary(),
    ending := starl_sim_run:ending() | none,
    end_us := starl_sim_queue:time(),
    events := non_neg_integer(),
    violations := [starl_monitor:violation()],
    monitors := #{module() => starl_monitor:results()},
    lost := [starl_run_loss_monitor:lost()]
}.

%% The scenario cannot be run; the simulation itself failed; no contract is broken, but a part of the
%% run is not judged.
-type reason() ::
    {start, starl_sim:reason()} | {failed, term()} | {unjudged, [starl_unjudged:t(), ...]}.

-type verdict() :: {ok, outcome()} | {error, reason()}.

%% @doc Runs a scenario to its end.
-spec run(#{app := module(), atom() => term()}) -> verdict().
run(Scenario) -> run(Scenario, fun(_Sim) -> ok end).

%% @doc The same; calls a function with the simulation when it has started, so that it can be
%% stopped.
-spec run(#{app := module(), atom() => term()}, fun((starl_sim:sim()) -> term())) -> verdict().
run(Scenario, Started) -> run(Scenario, Started, []).

%% @doc The same, with further monitors that only look on.
-spec run(
    #{app := module(), atom() => term()},
    fun((starl_sim:sim()) -> term()),
    [{module(), Config :: map()}]
) -> verdict().
run(Scenario, Started, Watch) -> run(Scenario, Started, Watch, #{}).

%% @doc The same with options of the run.
-spec run(
    #{app := module(), atom() => term()},
    fun((starl_sim:sim()) -> term()),
    [{module(), Config :: map()}],
    starl_sim:options()
) -> verdict().
run(Scenario, Started, Watch, Options) ->
    case apart(fun() -> play(Scenario, Started, Watch, Options) end) of
        {ok, Verdict} -> Verdict;
        {error, _} = Error -> Error
    end.

%% @doc Calls a function in a process of its own, which a failing simulation takes along.
-spec apart(fun(() -> Result)) -> {ok, Result} | {error, {failed, Reason :: term()}}.
apart(Play) ->
    Caller = self(),
    Tag = make_ref(),
    {Pid, Ref} = spawn_monitor(fun() -> Caller ! {Tag, Play()} end),
    receive
        {Tag, Result} ->
            true = erlang:demonitor(Ref, [flush]),
            {ok, Result};
        {'DOWN', Ref, process, Pid, Reason} ->
            {error, {failed, Reason}}
    end.

play(Scenario, Started, Watch, Options) ->
    Watched = Options#{watch => [{starl_run_loss_monitor, #{}} | Watch]},
    case starl_sim:start(Scenario#{mode => inline, shards => 1}, Watched) of
        {ok, Sim} ->
            _ = Started(Sim),
            _ = whole(Sim),
            outcome(Scenario, starl_sim:scenario(Sim), starl_sim:finish(Sim));
        {error, Reason} ->
            {error, {start, Reason}}
    end.

%% @doc Runs a simulation to its end, as {@link starl_sim:run/1} does; exits if a robot does not end
%% its step: where wall time has ended a run, it is like no other.
-spec whole(starl_sim:sim()) -> starl_sim_run:status().
whole(Sim) ->
    case starl_sim:run(Sim) of
        #{ending := hung} ->
            {#{hung := Hang}, _} = starl_sim:finish(Sim),
            exit({hung, Hang});
        Status ->
            Status
    end.

outcome(_Given, _Ran, {#{violations := [], unjudged := [_ | _] = Parts}, _}) ->
    {error, {unjudged, Parts}};
outcome(Given, Ran, {#{monitors := #{starl_run_loss_monitor := #{lost := Lost}}} = Outcome, _}) ->
    Known = maps:with([digest, ending, end_us, events, violations, monitors], Outcome),
    %% the mode of the run is no part of the scenario
    As = maps:with([mode, shards], Given),
    {ok, Known#{lost => Lost, scenario => maps:merge(maps:without([mode, shards], Ran), As)}}.
