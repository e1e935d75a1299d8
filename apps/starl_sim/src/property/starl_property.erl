%% @doc Tests properties of a program for a team of robots with PropEr. The module generates
%% scenarios and faults, runs them, and checks that each run keeps its contracts.
%% ```
%%   -include_lib("proper/include/proper.hrl").
%%
%%   prop_flock() ->
%%       Team = #{app => flock, robots => {1, 8}, random_faults => [all], vary => [spacing, loss]},
%%       ?FORALL(Scenario, starl_property:scenario(Team), starl_property:holds(Scenario)).
%%
%%   flock_test_() -> starl_property:eunit(fun prop_flock/0, #{cases => 100}).
%% '''
%% PropEr shrinks a scenario whose run breaks a contract to fewer faults, robots and extremes. Then
%% the simulator's own shrinker goes on: it removes what the violation does not need, cuts the end
%% of the run, and replaces random losses by the packets that were lost. The result is a scenario
%% file, which `starl run' repeats with the same digest.
%%
%% PropEr must be on the code path where properties are tested. Nothing else in StarL needs it.
-module(starl_property).

-ignore_xref([{proper, quickcheck, 2}, {proper, setup, 2}, {proper, whenfail, 2}]).

-export([scenario/1, faults/2, holds/1, holds/2]).
-export([quickcheck/1, quickcheck/2, eunit/1, eunit/2]).

-export_type([generator/0, team/0, demand/0, options/0]).

%% A generator of PropEr.
-type generator() :: term().

%% What scenarios are drawn for: the application; `robots', their number or the least and the greatest
%% number (1 to 5); `random_faults', the classes and kinds of faults to be drawn (none); `most_faults',
%% the greatest number of faults (6); `heal', by when all faults are over, s (60); `longest_fault', s (a
%% third of `heal'); `vary', the options of a scenario and of the application whose values are drawn over
%% their range. All other keys are those of a scenario, with their values or with generators of them.
-type team() :: #{
    app := module(),
    robots => pos_integer() | {Least :: pos_integer(), Greatest :: pos_integer()},
    random_faults => [all | starl_run_fault:class() | starl_run_fault:kind()],
    most_faults => non_neg_integer(),
    heal => number(),
    longest_fault => number(),
    vary => [atom()],
    atom() => term()
}.

%% What is asked of a run beside its contracts: `crashes => true', that an application may crash by
%% itself (its robot starts it anew; otherwise such a run does not hold); `complete', whether all applications must be done
%% (`false'); `outcome', a further condition on the outcome of a sound run; `dir', the directory for the
%% scenario file of a failing one ("out").
-type demand() :: #{
    crashes => true,
    complete => boolean(),
    outcome => fun((starl_sim_trial:outcome()) -> boolean()),
    dir => file:filename()
}.

%% `cases', the number of cases (100; the variable STARL_CASES of the environment goes before), and
%% `seed', from which all draws follow (new for each test; the variable STARL_SEED goes before).
-type options() :: #{cases => pos_integer(), seed => non_neg_integer()}.

%% The seconds that EUnit gives a property.
-define(EUNIT_S, 3600).

%% The state of shrinking, and the runs that it may take.
-define(KEY, {?MODULE, shrinking}).
-define(MOST, 300).

%% @doc A generator of scenarios. Mistakes that can be found before a run, such as an option that
%% does not exist, raise the error `{starl_property, Line}'.
-spec scenario(team()) -> generator().
scenario(Team) ->
    ok = starl_property_mistake:team(Team),
    starl_property_scenario:generator(Team).

%% @doc A generator of lists of faults of these classes and kinds, for a team. It uses the team's
%% keys `robots', `most_faults', `heal' and `longest_fault'. The lists shrink to fewer and simpler
%% faults.
-spec faults([all | starl_run_fault:class() | starl_run_fault:kind()], team()) -> generator().
faults(What, Team) -> starl_property_scenario:faults(Team#{random_faults => What}).

%% @doc Checks that the run of a scenario keeps its contracts. See {@link holds/2}.
-spec holds(#{app := module(), atom() => term()}) -> term().
holds(Scenario) -> holds(Scenario, #{}).

%% @doc Checks that the run of a scenario keeps its contracts and meets the demand. It is a test of
%% PropEr, for the body of a `?FORALL'. A run that is not judged to its end fails. On failure, the
%% smallest scenario that can be found is written to a file, and the command that replays it is
%% printed.
-spec holds(#{app := module(), atom() => term()}, demand()) -> term().
holds(Scenario, Demand) ->
    ok = starl_property_mistake:scenario(Scenario),
    ok = starl_property_mistake:demand(Demand),
    Verdict = judged(Scenario, fun() ->
        starl_property_run:verdict(Scenario, Demand)
    end),
    proper:whenfail(
        fun() -> starl_property_run:tell(Scenario, Demand, Verdict) end,
        fun() -> Verdict =:= holds end
    ).

%% @doc Tests a property of PropEr, and prints the seed that repeats a failing test. PropEr makes a
%% failing case smaller with at most 300 runs.
-spec quickcheck(generator()) -> boolean().
quickcheck(Property) -> quickcheck(Property, #{}).

%% @doc Tests a property of PropEr with these options.
-spec quickcheck(generator(), options()) -> boolean().
quickcheck(Property, Options) ->
    ok = starl_property_mistake:options(Options),
    ok = starl_property_mistake:property(Property),
    Cases = environment("STARL_CASES", maps:get(cases, Options, 100)),
    Drawn = erlang:phash2({os:timestamp(), make_ref()}, 1 bsl 32),
    Seed = environment("STARL_SEED", maps:get(seed, Options, Drawn)),
    io:format("~b cases, seed ~b; the same again with STARL_SEED=~b~n", [Cases, Seed, Seed]),
    %% PropEr has no option for the seed; the set-up runs after it has seeded itself.
    Seeded = proper:setup(
        fun() ->
            _ = rand:seed(exsss, Seed),
            fun() -> ok end
        end,
        Property
    ),
    #{level := Level} = logger:get_primary_config(),
    %% Crashes are planned: what is said of them would hide the answer.
    ok = logger:set_primary_config(level, none),
    try
        within_bound(fun() ->
            true =:= proper:quickcheck(Seeded, [{numtests, Cases}, nocolors])
        end)
    after
        ok = logger:set_primary_config(level, Level)
    end.

%% @doc A test of EUnit for a property, from a generator `NAME_test_'.
-spec eunit(fun(() -> generator())) -> term().
eunit(Property) -> eunit(Property, #{}).

%% @doc A test of EUnit for a property, with these options.
-spec eunit(fun(() -> generator()), options()) -> term().
eunit(Property, Options) ->
    {timeout, ?EUNIT_S, fun() -> true = quickcheck(Property(), Options) end}.

environment(Name, Default) ->
    case os:getenv(Name) of
        false -> Default;
        Text -> natural(Name, string:to_integer(Text))
    end.

natural(_Name, {N, ""}) when N >= 0 -> N;
natural(Name, _) -> error({starl_property, Name ++ " in the environment must be a whole number"}).

%% -- the bound on shrinking ----------------------------------------------------------------

%% How many runs PropEr may take to make a failing case small. Its own bound counts only those that
%% succeed; a scenario with six faults has thousands of neighbours, most of which hold. What is
%% left over is for the simulator's shrinker, which goes on from there and knows runs.
%%
%% It stands in the dictionary of the process that tests, as PropEr's own state does. A property that
%% is tested by PropEr itself (`rebar3 proper') has no such bound.

within_bound(Test) ->
    Outer = put(?KEY, testing),
    try
        Test()
    after
        put(?KEY, Outer)
    end.

%% The verdict on a scenario; once the bound is reached every new one holds, so that PropEr ends. The
%% one that failed last is always judged: PropEr tells of it at its end.
-spec judged(Scenario :: map(), fun(() -> Verdict)) -> Verdict | holds.
judged(Scenario, Verdict) ->
    case get(?KEY) of
        {shrinking, ?MOST, Failing} when Failing =/= Scenario -> holds;
        State -> noted(Verdict(), Scenario, State)
    end.

noted(Verdict, _Scenario, undefined) ->
    Verdict;
noted(holds, _Scenario, testing) ->
    holds;
noted(holds, _Scenario, {shrinking, Runs, Failing}) ->
    _ = put(?KEY, {shrinking, min(?MOST, Runs + 1), Failing}),
    holds;
noted(Verdict, Scenario, State) ->
    _ = put(?KEY, {shrinking, runs(State), Scenario}),
    Verdict.

runs(testing) -> 0;
runs({shrinking, Runs, _}) -> min(?MOST, Runs + 1).
