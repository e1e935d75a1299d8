%% @doc The building-blocks benchmark: the packets that an election, an entry, a round and a
%% geocast take, acknowledgements included, beside the formulas of the blocks' pages.
-module(starl_dev_bench_blocks).
-behaviour(starl_dev_benchmark).

-export([flags/0, run/1]).

-define(ROUNDS, 5).
-define(LIFETIME_MS, 5000).
%% A geocast is offered after 0, 50, 150, 350, 750, 1550, … ms, a hundredth of its lifetime left for
%% the drift of clocks.
-define(OFFERS, 9).
-define(PATIENCE_MS, 60000).

%% @doc The flags of this benchmark.
-spec flags() -> [starl_cli_flags:flag()].
flags() ->
    [
        {robots, {list, {integer, 2, 10000}}, [4, 16, 64], "sizes of the team"},
        {loss, {number, 0, 1}, 0.0, "part of the packets lost on the air"},
        {seed, {integer, 0, 1 bsl 32}, 1, "decides every random draw"}
    ].

%% @doc Measures and prints a line for each block and size; the figures for a file.
-spec run(#{atom() => term()}) -> [starl_dev_benchmark:figures()].
run(#{robots := Sizes, loss := Loss} = Options) ->
    starl_cli_terminal:out(
        "packets on the air per operation, all robots at once, loss: ~w\n"
        "theory is for no loss: ballots N^2 and N for each announcement, at most 2 N^2; bully\n"
        "2 N (N - 1) + N; mutex N + 8; barrier N^2; geocast ~w N offers, N - 1 questions, "
        "an answer\n"
        "  block      robots  operations   packets  packets/op    theory   ratio\n",
        [Loss, ?OFFERS]
    ),
    [measure(Block, N, Options) || Block <- blocks(), N <- Sizes].

blocks() -> [election, bully, mutex, barrier, geocast].

measure(Block, N, #{loss := Loss, seed := Seed}) ->
    Common = #{
        app => starl_exercise, block => Block, robots => N, loss => Loss, seed => Seed,
        world => {50000, 50000}, mode => inline, patience => ?PATIENCE_MS, pause => 1
    },
    #{ending := Ending, outcome := Outcome, figures := Told} =
        starl_dev_bench_run:simulate(maps:merge(Common, workload(Block))),
    #{packets := Packets, violations := Broken} = Outcome,
    Operations = operations(Block, Told),
    Theory = theory(Block, N),
    Figures = [
        {block, Block}, {robots, N}, {operations, Operations}, {packets, Packets},
        {packets_per_operation, Packets / max(1, Operations)}, {theory, Theory},
        {ratio, Packets / max(1, Operations) / Theory},
        {checks, starl_dev_bench_run:sound(io_lib:format("blocks, ~ts", [Block]), [
            {"ending", done, Ending}, {"violations", [], Broken}
        ])}
    ],
    starl_cli_terminal:out(line(Figures)),
    Figures.

workload(Block) when Block =:= election; Block =:= bully -> #{turns => 1};
workload(mutex) -> #{tokens => 1, hold => 50, pause => 100, work => 60};
workload(barrier) -> #{turns => ?ROUNDS};
workload(geocast) -> #{turns => 1, lifetime => ?LIFETIME_MS, work => 20}.

%% What is counted: elections, entries, rounds, messages.
operations(election, Told) -> told(elections, Told);
operations(bully, Told) -> told(elections, Told);
operations(mutex, Told) -> told(acquired, Told);
operations(barrier, Told) -> told(rounds, Told);
operations(geocast, Told) -> told(sent, Told).

told(Key, Told) -> proplists:get_value(Key, Told).

theory(election, N) -> 2 * N * N;
theory(bully, N) -> 2 * N * (N - 1) + N;
theory(mutex, N) -> N + 8;
theory(barrier, N) -> N * N;
theory(geocast, N) -> ?OFFERS * N + N.

line(Figures) ->
    Get = fun(Key) -> proplists:get_value(Key, Figures) end,
    io_lib:format("  ~-9s ~7b ~11b ~9b ~11.1f ~9b ~7.2f\n", [
        Get(block), Get(robots), Get(operations), Get(packets), Get(packets_per_operation),
        Get(theory), Get(ratio)
    ]).
