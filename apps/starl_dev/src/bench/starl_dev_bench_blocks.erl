%% @doc The benchmark of the building blocks. It counts the packets for an election, an entry, a
%% round and a geocast, with acknowledgements, and compares them with the formulas of the blocks'
%% pages.
-module(starl_dev_bench_blocks).
-behaviour(starl_dev_benchmark).

-export([flags/0, run/1]).

-define(PATIENCE_MS, 60000).

%% @doc The flags of this benchmark.
-spec flags() -> [starl_cli_flags:flag()].
flags() ->
    [
        {robots, {list, {integer, 2, 10000}}, [4, 16, 64], "sizes of the team"},
        {loss, {number, 0, 1}, 0.0, "fraction of the packets that the radio loses"},
        {seed, {integer, 0, 1 bsl 32}, 1, "the seed of every random draw"}
    ].

%% @doc Measures, prints one line per block and size, and gives the figures for a file.
-spec run(#{atom() => term()}) -> [starl_dev_benchmark:figures()].
run(#{robots := Sizes, loss := Loss} = Options) ->
    starl_cli_terminal:out(
        "packets on the air per operation, all robots at once, loss: ~w\n"
        "theory is for no loss:\n~ts"
        "  block      robots  operations   packets  packets/op    theory   ratio\n",
        [Loss, [formula(Name, Said) || {Name, Said} <- benchmarks()]]
    ),
    [measure(Name, Said, N, Options) || {Name, Said} <- benchmarks(), N <- Sizes].

%% The benchmarks that the blocks declare.
benchmarks() ->
    [
        {Name, Block:benchmark()}
     || Name <- starl_block_catalogue:able(bench), {ok, Block} <- [starl_block_catalogue:find(Name)]
    ].

formula(Name, #{formula := Formula}) -> io_lib:format("  ~ts: ~ts~n", [Name, Formula]).

common(Block, N, Loss, Seed) ->
    #{
        app => starl_exercise,
        block => Block,
        robots => N,
        loss => Loss,
        seed => Seed,
        world => {50000, 50000},
        mode => inline,
        patience => ?PATIENCE_MS,
        pause => 1
    }.

measure(Block, Said, N, #{loss := Loss, seed := Seed}) ->
    #{workload := Workload, operations := Counted, packets := Theoretical} = Said,
    #{ending := Ending, outcome := Outcome, figures := Told} =
        starl_dev_bench_run:simulate(maps:merge(common(Block, N, Loss, Seed), Workload)),
    #{packets := Packets, violations := Broken} = Outcome,
    Operations = proplists:get_value(Counted, Told),
    Theory = Theoretical(N),
    Figures = [
        {block, Block},
        {robots, N},
        {operations, Operations},
        {packets, Packets},
        {packets_per_operation, Packets / max(1, Operations)},
        {theory, Theory},
        {ratio, Packets / max(1, Operations) / Theory},
        {checks,
            starl_dev_bench_run:sound(io_lib:format("blocks, ~ts", [Block]), [
                {"ending", done, Ending}, {"violations", [], Broken}
            ])}
    ],
    starl_cli_terminal:out(line(Figures)),
    Figures.

line(Figures) ->
    Get = fun(Key) -> proplists:get_value(Key, Figures) end,
    io_lib:format("  ~-9s ~7b ~11b ~9b ~11.1f ~9b ~7.2f\n", [
        Get(block),
        Get(robots),
        Get(operations),
        Get(packets),
        Get(packets_per_operation),
        Get(theory),
        Get(ratio)
    ]).
