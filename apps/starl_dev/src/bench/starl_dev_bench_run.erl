%% @doc Measures a run for the benchmarks of the simulator, and the baselines taken in the same
%% minute. CPU seconds are those of the whole VM, so on a shared machine they are more reliable than
%% wall seconds.
-module(starl_dev_bench_run).

-export([simulate/1, on_cores/2, bare/0, busy_gain/1, best/1, sound/2, shards/1]).
-export([bounce/0]).

-export_type([run/0, bare/0, check/0]).

%% A run: the time to start and to run (s), the memory beyond the bare VM (bytes) after the start
%% and after the run, and the results.
-type run() :: #{
    start_s := float(),
    wall_s := float(),
    cpu_s := float(),
    start_bytes := integer(),
    end_bytes := integer(),
    ending := atom(),
    events := non_neg_integer(),
    outcome := starl_sim_run:outcome(),
    figures := [{atom(), term()}]
}.

%% Round trips of a message between two bare processes, per wall and per CPU second.
-type bare() :: #{per_wall_s := float(), per_cpu_s := float()}.

%% A check of a run: its name, the expected value, the actual value.
-type check() :: {string(), Want :: term(), Got :: term()}.

-define(ROUND_TRIPS, 300000).
-define(BUSY_STEPS, 20000000).

%% @doc Runs a scenario to its end in a separate process, so that no run pays for the garbage of an
%% earlier one.
-spec simulate(#{app := module(), atom() => term()}) -> run().
simulate(Scenario) -> in_process(fun() -> measured(Scenario) end).

measured(Scenario) ->
    Before = memory(),
    {StartUs, {ok, Sim}} = timer:tc(fun() -> starl_sim:start(Scenario) end),
    Started = memory(),
    {CpuMs0, _} = erlang:statistics(runtime),
    {RunUs, #{ending := Ending}} = timer:tc(fun() -> starl_sim:run(Sim) end),
    {CpuMs1, _} = erlang:statistics(runtime),
    Ended = memory(),
    {#{events := Events} = Outcome, #{figures := Figures}} = starl_sim:finish(Sim),
    #{
        start_s => StartUs / 1.0e6,
        wall_s => RunUs / 1.0e6,
        cpu_s => max(1, CpuMs1 - CpuMs0) / 1000,
        start_bytes => Started - Before,
        end_bytes => Ended - Before,
        ending => Ending,
        events => Events,
        outcome => Outcome,
        figures => Figures
    }.

%% The memory in use after a garbage collection of all processes.
memory() ->
    _ = [erlang:garbage_collect(Pid) || Pid <- processes()],
    erlang:memory(total).

%% Calls a function in a separate process.
-spec in_process(fun(() -> Result)) -> Result.
in_process(Fun) ->
    Self = self(),
    {Pid, Ref} = spawn_monitor(fun() -> Self ! {result, self(), Fun()} end),
    receive
        {result, Pid, Result} ->
            true = erlang:demonitor(Ref, [flush]),
            Result;
        {'DOWN', Ref, process, Pid, Reason} ->
            exit(Reason)
    end.

%% @doc Calls a function while the VM uses at most this number of cores.
-spec on_cores(pos_integer(), fun(() -> Result)) -> Result.
on_cores(Cores, Fun) ->
    Before = erlang:system_flag(schedulers_online, min(Cores, erlang:system_info(schedulers))),
    try
        Fun()
    after
        erlang:system_flag(schedulers_online, Before)
    end.

%% @doc The rate at which two bare processes on one core bounce a message `{ball, From, N}'.
-spec bare() -> bare().
bare() -> on_cores(1, fun() -> in_process(fun bounced/0) end).

bounced() ->
    Echo = spawn_link(?MODULE, bounce, []),
    {CpuMs0, _} = erlang:statistics(runtime),
    {Us, ok} = timer:tc(fun() -> ping(?ROUND_TRIPS, Echo) end),
    {CpuMs1, _} = erlang:statistics(runtime),
    unlink(Echo),
    exit(Echo, kill),
    #{
        per_wall_s => ?ROUND_TRIPS * 1.0e6 / Us,
        per_cpu_s => ?ROUND_TRIPS * 1000 / max(1, CpuMs1 - CpuMs0)
    }.

ping(0, _Echo) ->
    ok;
ping(N, Echo) ->
    Echo ! {ball, self(), N},
    receive
        {ball, Echo, N} -> ping(N - 1, Echo)
    end.

%% @private
-spec bounce() -> no_return().
bounce() ->
    receive
        {ball, Pid, N} -> Pid ! {ball, self(), N}
    end,
    bounce().

%% @doc The speed-up of this number of busy processes over a single one.
-spec busy_gain(pos_integer()) -> float().
busy_gain(1) -> 1.0;
busy_gain(Processes) -> on_cores(Processes, fun() -> Processes * busy(1) / busy(Processes) end).

busy(Processes) ->
    {Us, ok} = timer:tc(fun() ->
        Refs = [spawn_monitor(fun() -> count(?BUSY_STEPS) end) || _ <- lists:seq(1, Processes)],
        lists:foreach(fun await/1, Refs)
    end),
    Us.

await({Pid, Ref}) ->
    receive
        {'DOWN', Ref, process, Pid, normal} -> ok
    end.

count(0) -> ok;
count(N) -> count(N - 1).

%% @doc The run with the least CPU time, because other load can only make a run longer.
-spec best([run(), ...]) -> run().
best([First | Runs]) ->
    lists:foldl(fun(Run, Best) -> better(Run, Best) end, First, Runs).

better(#{cpu_s := Cpu} = Run, #{cpu_s := Least}) when Cpu < Least -> Run;
better(_Run, Best) -> Best.

%% @doc The number of shards, for the head of a table.
-spec shards(pos_integer() | none) -> unicode:chardata().
shards(none) -> "as in a run";
shards(Shards) -> integer_to_list(Shards).

%% @doc Whether a run passed all checks; prints the failed ones.
-spec sound(Run :: unicode:chardata(), [check()]) -> boolean().
sound(Run, Checks) -> [] =:= [complain(Run, Check) || Check <- Checks, failed(Check)].

failed({_Name, Want, Got}) -> Want =/= Got.

complain(Run, {Name, Want, Got}) ->
    starl_cli_terminal:complain(
        io_lib:format("bench ~ts: ~ts is ~0tp, not ~0tp", [Run, Name, Got, Want])
    ).
