%% A soak tells what has happened in none of its runs, and many runs owe it.
%%
%% Holds: A soak of many runs tells what has never happened, and fails for what it owes
%% Red: none before: nothing was counted
-module(starl_lab_soak_sometimes_tests).
-include_lib("eunit/include/eunit.hrl").

-define(MANY, 1000).

%% All that may be owed, once.
all_there(Block) ->
    #{owed := Owed} = starl_lab_soak_sometimes:never(Block, ?MANY, []),
    maps:from_keys(Owed, 1).

many_runs_owe_what_happens_sometimes_test() ->
    Never = fun(Without) ->
        starl_lab_soak_sometimes:never(mutex, ?MANY, [#{}, maps:without(Without, all_there(mutex))])
    end,
    ?assertEqual(#{owed => [], seldom => []}, Never([])),
    ?assertEqual(#{owed => [{mutex, lease_lost}], seldom => []}, Never([{mutex, lease_lost}])).

few_runs_owe_nothing_test() ->
    #{owed := Owed, seldom := Told} = starl_lab_soak_sometimes:never(mutex, ?MANY - 1, []),
    ?assertEqual([], Owed),
    ?assertEqual(lists:sort(maps:keys(all_there(mutex))), lists:sort(Told)).

%% What a monitor declares to be seldom is told, and owed by no number of runs.
seldom_test() ->
    #{seldom := Told, owed := Owed} = starl_lab_soak_sometimes:never(dpp, 10 * ?MANY, []),
    Seldom = [
        deluded_coordinator,
        {dpp, doubted},
        {dpp_coordinator, doubted},
        {dpp_coordinator, malformed}
    ],
    ?assertEqual(Seldom, lists:sort(Told)),
    ?assert(lists:member(fail_over, Owed) andalso lists:member({dpp, void}, Owed)).

%% Each name that a monitor declares is one that its results count, or an event of its vocabulary.
declared_test_() ->
    [
        {atom_to_list(Monitor), fun() ->
            Declared = [Name || {Name, _} <- Monitor:sometimes()],
            {_, #{sometimes := Counted}} = finished(Monitor, Config),
            Events = [
                {Machine, Tag}
             || {Machine, Names} <- maps:to_list(Monitor:vocabulary()), {Tag, _} <- Names
            ],
            ?assertEqual([], [N || N <- Declared, is_atom(N)] -- maps:keys(Counted)),
            ?assertEqual([], [N || {_, _} = N <- Declared] -- Events)
        end}
     || {Monitor, Config} <- [
            {starl_motion_monitor, #{
                profiles => [starl_chassis:profile(starl_chassis_differential, #{})]
            }},
            {starl_dpp_monitor, #{tube_radius => 100.0, r_s => 150.0}},
            {starl_barrier_monitor, #{robots => [1]}}
        ]
    ].

finished(Monitor, Config) -> Monitor:finish(0, Monitor:init(Config)).

%% Events of runs are counted, and what monitors count besides.
counts_test() ->
    {Monitor, Config} = starl_lab_soak_sometimes:watch(barrier),
    Runner = starl_monitor:new([{Monitor, Config}]),
    {ok, Told} = starl_monitor:step(
        [
            {1, 1, barrier, {reached, a, 1}},
            {2, 2, barrier, {reached, a, 1}},
            {3, 1, barrier, crashed},
            {4, 1, sap, {started, 1}}
        ],
        Runner
    ),
    {[], Results} = starl_monitor:finish(5, Told),
    ?assertEqual(
        #{{barrier, reached} => 2, {barrier, crashed} => 1, damaged_store => 3},
        starl_lab_soak_sometimes:counts(Results#{
            starl_barrier_monitor => #{sometimes => #{damaged_store => 3, store_set_back => 0}},
            starl_crash_monitor => #{}
        })
    ).

names_are_words_test() ->
    ?assertEqual(
        "lease lost (mutex), fail over",
        lists:flatten(
            lists:join(", ", [
                starl_lab_soak_sometimes:format(N)
             || N <- [{mutex, lease_lost}, fail_over]
            ])
        )
    ).
