%% @doc Chooses which job of `./starl test' runs next, so that no core is idle. The longest jobs run
%% first: one computing job per core, and as many jobs that mostly wait, for timers, sockets or
%% other programs. When no waiting job is left, one more computing job runs beside the others,
%% because each waits at times for a program that it has started. A job that must have the machine
%% alone comes last.
%%
%% Known times and kinds of jobs stand in `test/test_times.term'. The seconds of the last run, in
%% `_build/starl/tests/test_times.term', are newer. An unknown job is assumed to compute for ten
%% seconds.
%%
%% ```
%% {starl_create_doctor_SUITE, waits, 19}.
%% '''
-module(starl_test_schedule).

-export([at_most/1, known/2, kept/2, order/2, next/4]).

-export_type([known/0, row/0]).

-type load() :: computes | waits | alone.

%% A row of the tables: a job's name, its load, and how long it took, s.
-type row() :: {Name :: atom(), load(), Seconds :: number()}.

-type known() :: #{Name :: string() => {load(), Seconds :: number()}}.

-type job() :: #{name := string(), _ => _}.

%% @doc The largest number of jobs at once.
-spec at_most(Cores :: pos_integer()) -> pos_integer().
at_most(Cores) when is_integer(Cores) -> 2 * Cores.

%% @doc The rows of the checkout, with the seconds of the last run.
-spec known(Own :: [row()], Last :: [row()]) -> known().
known(Own, Last) ->
    Table = maps:from_list([{atom_to_list(Name), {Load, S}} || {Name, Load, S} <- Own]),
    lists:foldl(fun newer/2, Table, Last).

newer({Name, _, Seconds}, Table) ->
    {Load, _} = of_job(atom_to_list(Name), Table),
    Table#{atom_to_list(Name) => {Load, Seconds}}.

of_job(Name, Known) -> maps:get(Name, Known, {computes, 10}).

%% @doc The rows for the next run.
-spec kept([{Job :: string(), Seconds :: float()}], known()) -> [row()].
kept(Took, Known) ->
    lists:sort([
        {list_to_atom(Name), element(1, of_job(Name, Known)), round(Seconds)}
     || {Name, Seconds} <- Took
    ]).

%% @doc The jobs, those that run last at the end, and each time the longest first.
-spec order([Job], known()) -> [Job] when Job :: job().
order(Jobs, Known) ->
    Keyed = [{rank(Job, Known), Job} || Job <- Jobs],
    [Job || {_, Job} <- lists:keysort(1, Keyed)].

rank(#{name := Name}, Known) ->
    case of_job(Name, Known) of
        {alone, Seconds} -> {1, -Seconds, Name};
        {_, Seconds} -> {0, -Seconds, Name}
    end.

%% @doc Chooses the first of the ordered jobs that may run beside the running ones, and gives the
%% others.
-spec next(Running :: [Job], Later :: [Job, ...], known(), Cores :: pos_integer()) ->
    {Job, [Job]} | wait
when
    Job :: job().
next([], [Job | Later], _Known, _Cores) ->
    {Job, Later};
next(Running, Later, Known, Cores) ->
    Loads = [load(Job, Known) || Job <- Running],
    Most =
        case lists:member(waits, Loads ++ [load(Job, Known) || Job <- Later]) of
            true -> #{waits => Cores, computes => Cores};
            false -> #{waits => Cores, computes => Cores + 1}
        end,
    May = fun(Job) -> fits(load(Job, Known), Loads, Most) end,
    case lists:splitwith(fun(Job) -> not May(Job) end, Later) of
        {_, []} -> wait;
        {Before, [Job | After]} -> {Job, Before ++ After}
    end.

load(#{name := Name}, Known) -> element(1, of_job(Name, Known)).

fits(alone, _Loads, _Most) ->
    false;
fits(Load, Loads, Most) ->
    not lists:member(alone, Loads) andalso
        length([Same || Same <- Loads, Same =:= Load]) < maps:get(Load, Most).
