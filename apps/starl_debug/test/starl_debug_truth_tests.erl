%% The check against runs whose truth is known (`starl_debug_truth'): it never says never of what
%% was true, nor certainly of what was not. STARL_DEBUG_RUNS=34 tries more runs of each kind and
%% prints the table of what stayed undecided; STARL_DEBUG_SEED begins at another run.
-module(starl_debug_truth_tests).

-include_lib("eunit/include/eunit.hrl").

-define(RUNS, 60).
-define(SEED, 1).

number(Name, Default) -> list_to_integer(os:getenv(Name, integer_to_list(Default))).

%% The kinds of runs take turns: clocks, drifts, samples and the errors of places.
kinds() ->
    [
        #{ms => 3000, sigma => Sigma, ppm => Ppm, hz => Hz, error => Error}
     || {Sigma, Ppm} <- [{0, 0}, {500, 100}, {5000, 500}, {50000, 5000}, {200000, 10000}],
        {Hz, Error} <- [{20, 0.0}, {10, 40.0}, {40, 5.0}]
    ] ++ [#{ms => 3000, sigma => 5000, ppm => 100, hz => 2, error => 0.0}].

never_and_certainly_are_right_test_() ->
    {timeout, 3600, fun() ->
        Seed = number("STARL_DEBUG_SEED", ?SEED),
        Runs = number("STARL_DEBUG_RUNS", ?RUNS),
        Kinds = kinds(),
        Wrong = lists:append([
            starl_debug_truth:wrong(S, lists:nth(1 + S rem length(Kinds), Kinds))
         || S <- lists:seq(Seed, Seed + Runs - 1)
        ]),
        ?assertEqual([], Wrong),
        _ = [starl_debug_truth:table(Runs) || Runs =/= ?RUNS]
    end}.

%% At sigma 0 and with samples that are dense, nothing is left open that the milliseconds decide.
perfect_clocks_are_a_plain_evaluation_test_() ->
    {timeout, 600, fun() ->
        Seed = number("STARL_DEBUG_SEED", ?SEED),
        {Recording, Run} = starl_debug_truth:make(Seed, #{ms => 3000, sigma => 0, hz => 1000}),
        Open = [
            {Text, Truth, Verdict}
         || {Text, Truth, Verdict} <- starl_debug_truth:answers(Recording, Run, #{sigma => 0}),
            Truth =/= doubtful,
            Verdict =/= verdict(Truth)
        ],
        ?assertEqual({seed, Seed, []}, {seed, Seed, Open})
    end}.

verdict(true) -> certainly;
verdict(false) -> never.
