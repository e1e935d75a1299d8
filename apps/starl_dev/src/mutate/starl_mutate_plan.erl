%% @doc The steps of mutation testing. It measures a block's tests on the unchanged code. Then, for
%% each mutant, it runs the tests that call the changed function, cheapest first.
-module(starl_mutate_plan).

-export([baseline/3, jobs/2, run/3]).

-export_type([measures/0]).

%% The tests that passed on the unchanged code, with the time and the called functions of each.
-type measures() :: #{starl_mutate_block:unit() => starl_mutate_worker:measured()}.

-type found() :: [{Id :: string(), starl_mutate_worker:verdict()}].

%% A process of a mutant with a larger heap is killed.
-define(HEAP_WORDS, 60000000).
%% The time limit of a test: this multiple of its time on the unchanged code, plus a constant.
-define(TIMES, 5).
-define(CPU_MS, 2000).
-define(WALL_MS, 30000).

%% @doc Runs every test on the unchanged code; failing tests are listed separately.
-spec baseline([starl_mutate_block:unit()], [module()], Jobs :: pos_integer()) ->
    {done | interrupted, measures(), Failed :: [{starl_mutate_block:unit(), term()}]}.
baseline(Units, Modules, Most) ->
    {How, {Measures, Failed}} = starl_lab_jobs:run(
        [{Unit, Modules} || Unit <- Units],
        #{
            work => {starl_mutate_worker, measure},
            at_once => Most,
            what => "tests, unchanged",
            each => fun measured/3,
            args => heap(),
            output => starl_mutate_worker:sink()
        },
        {#{}, []}
    ),
    {How, Measures, lists:sort(Failed)}.

heap() -> ["+hmax", integer_to_list(?HEAP_WORDS), "+hmaxk", "true", "+hmaxel", "false"].

measured({Unit, _}, {ok, #{outcome := passed} = Measured}, {Measures, Failed}) ->
    {Measures#{Unit => Measured}, Failed};
measured({Unit, _}, {ok, #{outcome := Outcome}}, {Measures, Failed}) ->
    {Measures, [{Unit, Outcome} | Failed]};
measured({Unit, _}, {crashed, Reason}, {Measures, Failed}) ->
    {Measures, [{Unit, Reason} | Failed]}.

%% @doc The mutants as jobs, each with the tests that call the changed function.
-spec jobs([starl_mutate_sample:drawn()], measures()) -> [starl_mutate_worker:job()].
jobs(Drawn, Measures) ->
    Callers = maps:fold(fun callers/3, #{}, Measures),
    [
        #{
            id => Id,
            module => Module,
            code => Code,
            units => [{U, limits(maps:get(U, Measures))} || U <- maps:get(changed(C), Ordered, [])]
        }
     || Ordered <- [maps:map(fun(_, Units) -> ordered(Units, Measures) end, Callers)],
        #{id := Id, code := Code, candidate := #{source := #{module := Module}} = C} <- Drawn
    ].

callers(Unit, #{called := Called}, Callers) ->
    lists:foldl(
        fun(F, Known) -> Known#{F => [Unit | maps:get(F, Known, [])]} end, Callers, Called
    ).

changed(#{source := #{module := Module}, before := {function, _, Name, Arity, _}}) ->
    {Module, Name, Arity}.

ordered(Units, Measures) ->
    Cost = fun(Unit) -> maps:get(cpu_ms, maps:get(Unit, Measures)) end,
    [Unit || {_, Unit} <- lists:sort([{Cost(U), U} || U <- Units])].

limits(#{cpu_ms := Cpu, wall_ms := Wall}) -> {?TIMES * Cpu + ?CPU_MS, ?TIMES * Wall + ?WALL_MS}.

%% @doc Tests the mutants, `Jobs' at once; a mutant that crashes its VM counts as caught.
-spec run([starl_mutate_worker:job()], Jobs :: pos_integer(), fun((string()) -> ok)) ->
    {done | interrupted, found()}.
run(Jobs, Most, Tell) ->
    starl_lab_jobs:run(
        Jobs,
        #{
            work => {starl_mutate_worker, attempt},
            at_once => Most,
            what => "mutants",
            args => heap(),
            output => starl_mutate_worker:sink(),
            renew => fun damaged/1,
            limit_ms => fun limit_ms/1,
            each => fun(#{id := Id} = Job, Answer, Found) ->
                Verdict = verdict(Job, Answer),
                ok = Tell(Id),
                [{Id, Verdict} | Found]
            end
        },
        []
    ).

damaged({caught, _, timeout}) -> true;
damaged(_) -> false.

limit_ms(#{units := Units}) -> ?WALL_MS + lists:sum([Wall || {_, {_, Wall}} <- Units]).

verdict(_Job, {ok, Verdict}) -> Verdict;
verdict(#{units := [{Unit, _} | _]}, {crashed, _}) -> {caught, Unit, timeout}.
