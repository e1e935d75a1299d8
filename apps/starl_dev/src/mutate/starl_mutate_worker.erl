%% @doc Runs tests against mutants in a separate VM with one scheduler, because a mutant may loop
%% for ever or exhaust memory.
%%
%% A test is limited by the processor time of the VM, not by wall time, so that a busy machine does
%% not kill mutants. A larger limit of wall time ends a test that waits for ever.
-module(starl_mutate_worker).

-export([sink/0]).
%% Called in the VMs of the jobs.
-export([measure/1, attempt/1]).

-export_type([measured/0, limits/0, job/0, verdict/0]).

%% A test on the unchanged code: its result, its processor time and wall time, and the functions of
%% the block that it called.
-type measured() :: #{
    outcome := outcome(),
    cpu_ms := non_neg_integer(),
    wall_ms := non_neg_integer(),
    called := [mfa()]
}.

-type outcome() :: passed | {failed, term()} | timeout.

-type limits() :: {Cpu :: pos_integer(), Wall :: pos_integer()}.

%% A mutant: its name, its code, and the tests that may catch it, cheapest first.
-type job() :: #{
    id := string(),
    module := module(),
    code := binary(),
    units := [{starl_mutate_block:unit(), limits()}]
}.

-type verdict() ::
    {caught, starl_mutate_block:unit(), {failed, Reason :: string()} | timeout} | survived.

%% The interval at which the times are checked, ms.
-define(LOOK_MS, 50).
%% The limits of one test on the unchanged code: processor time and wall time, ms.
-define(MEASURE, {300000, 600000}).
%% The largest number of states that the small search of the checker expands.
-define(STATES, 60000).
-define(REASON_DEPTH, 12).

%% @doc Runs a test on the unchanged code.
-spec measure({starl_mutate_block:unit(), [module()]}) -> measured().
measure({Unit, Modules}) ->
    ok = set_up(),
    _ = [{module, Module} = code:ensure_loaded(Module) || Module <- Modules],
    _ = [erlang:trace_pattern({M, '_', '_'}, true, [local, call_count]) || M <- Modules],
    {Cpu, _} = statistics(runtime),
    Begin = erlang:monotonic_time(millisecond),
    Outcome = limited(Unit, ?MEASURE),
    Wall = erlang:monotonic_time(millisecond) - Begin,
    Called = [{M, F, A} || M <- Modules, {F, A} <- M:module_info(functions), called({M, F, A})],
    {Now, _} = statistics(runtime),
    #{outcome => Outcome, cpu_ms => Now - Cpu, wall_ms => Wall, called => Called}.

called(Function) ->
    case erlang:trace_info(Function, call_count) of
        {call_count, Count} when is_integer(Count) -> Count > 0;
        _ -> false
    end.

%% @doc Loads a mutant and runs its tests until one catches it.
-spec attempt(job()) -> verdict().
attempt(#{module := Module, code := Code, units := Units}) ->
    ok = set_up(),
    %% as StarL's own: other monitors are checked before each run
    {module, Module} = code:ensure_loaded(Module),
    File = code:which(Module),
    _ = code:purge(Module),
    {module, Module} = code:load_binary(Module, File, Code),
    Verdict = first(Units),
    _ = code:purge(Module),
    {module, Module} = code:load_file(Module),
    _ = code:purge(Module),
    Verdict.

first([]) ->
    survived;
first([{Unit, Limits} | Units]) ->
    case limited(Unit, Limits) of
        passed -> first(Units);
        {failed, Reason} -> {caught, Unit, {failed, shown(Reason)}};
        timeout -> {caught, Unit, timeout}
    end.

shown(Reason) -> lists:flatten(io_lib:format("~0tP", [Reason, ?REASON_DEPTH])).

%% Random tests use the same seed for each mutant.
set_up() ->
    _ = [os:putenv("STARL_SEED", "1") || os:getenv("STARL_SEED") =:= false],
    logger:set_primary_config(level, none).

%% -- one test, with an end --------------------------------------------------------------------

-spec limited(starl_mutate_block:unit(), limits()) -> outcome().
limited(Unit, {MostCpu, MostWall}) ->
    Before = {processes(), logger:get_handler_ids()},
    Sink = sink(),
    {Pid, Ref} = spawn_monitor(fun() ->
        true = group_leader(Sink, self()),
        exit(self(), {outcome, outcome(Unit)})
    end),
    {Cpu, _} = statistics(runtime),
    Wall = erlang:monotonic_time(millisecond),
    Outcome = watch(Pid, Ref, {Cpu + MostCpu, Wall + MostWall}),
    true = unlink(Sink),
    ok = tidied(Before),
    Outcome.

watch(Pid, Ref, {Cpu, Wall} = Ends) ->
    receive
        {'DOWN', Ref, process, Pid, {outcome, Outcome}} -> Outcome;
        {'DOWN', Ref, process, Pid, Reason} -> {failed, Reason}
    after ?LOOK_MS ->
        {Now, _} = statistics(runtime),
        case Now > Cpu orelse erlang:monotonic_time(millisecond) > Wall of
            false ->
                watch(Pid, Ref, Ends);
            true ->
                true = exit(Pid, kill),
                true = demonitor(Ref, [flush]),
                timeout
        end
    end.

%% The names of processes and handlers that a test has left behind, since it failed or was ended, would be in
%% the way of the tests of other mutants.
tidied({Processes, Handlers}) ->
    _ = [ok = logger:remove_handler(Id) || Id <- logger:get_handler_ids() -- Handlers],
    lists:foreach(fun ended/1, [Left || Left <- processes() -- Processes, is_stray(Left)]).

ended(Pid) ->
    Monitor = monitor(process, Pid),
    true = exit(Pid, kill),
    receive
        {'DOWN', Monitor, process, Pid, _} -> ok
    end.

%% OTP's own servers are registered, under other names than StarL's.
is_stray(Pid) ->
    case erlang:process_info(Pid, registered_name) of
        [] -> true;
        {registered_name, Name} -> lists:prefix("starl_", atom_to_list(Name));
        undefined -> false
    end.

%% @doc A group leader that discards all output; linked to the caller.
-spec sink() -> pid().
sink() -> spawn_link(fun swallow/0).

-spec swallow() -> no_return().
swallow() ->
    receive
        {io_request, From, Tag, Request} ->
            From ! {io_reply, Tag, answer(Request)},
            swallow();
        _ ->
            swallow()
    end.

answer(Request) when element(1, Request) =:= put_chars; element(1, Request) =:= requests -> ok;
answer(Request) when element(1, Request) =:= setopts -> ok;
answer(_) -> {error, enotsup}.

-spec outcome(starl_mutate_block:unit()) -> passed | {failed, term()}.
outcome(Unit) ->
    try passes(Unit) of
        true -> passed;
        Other -> {failed, Other}
    catch
        _Class:Reason:_ -> {failed, Reason}
    end.

passes({unit, Module}) ->
    eunit:test(Module, [no_tty]) =:= ok;
passes({soak, Block, Robots, Seed}) ->
    case starl_lab_soak:violations(Block, Robots, Seed) of
        {ok, Violations} -> kept(Violations);
        {error, Reason} -> Reason
    end;
passes({soak, {live, Part}, Seed}) ->
    kept(starl_lab_soak_live:violations(Part, Seed));
passes({check, Block, Robots, Faults}) ->
    Options = #{robots => Robots, faults => Faults, workers => 1},
    case starl_lab_check:search(Block, Options, ?STATES) of
        {holds, _, _} -> true;
        {violated, #{violation := Violation}} -> kept([Violation]);
        {mistaken, _, Line} -> {mistaken, Line}
    end;
passes({suite, Suite, Path}) ->
    starl_mutate_suite:run(Suite, Path) =:= ok.

kept([]) -> true;
kept([Violation | _]) -> maps:with([contract, what], Violation).
