%% @doc The scale benchmark measures the start-up time and the memory per robot, for a thousand and
%% for ten thousand robots by default. Each robot is a supervision tree (process) or a term in a
%% shard (inline). Then the robots run ring-shuttle for 60 s with one message per second.
-module(starl_dev_bench_scale).
-behaviour(starl_dev_benchmark).

-export([flags/0, run/1]).

-define(MESSAGES, 60).
-define(RUN_S, 60).

%% @doc The flags of this benchmark.
-spec flags() -> [starl_cli_flags:flag()].
flags() ->
    [
        {robots, {list, {integer, 2, 100000}}, [1000, 10000], "sizes of the team"},
        {modes, {list, {one_of, [process, inline]}}, [process, inline], "how robots are simulated"},
        {shards, {optional, {integer, 1, 256}}, none, "number of shards; none: as in a run"}
    ].

%% @doc Measures, prints one line per size, and gives the figures for a file.
-spec run(#{atom() => term()}) -> [starl_dev_benchmark:figures()].
run(#{robots := Sizes, modes := Modes, shards := Shards}) ->
    starl_cli_terminal:out(
        "scale: ring-shuttle, ~b s of virtual time, a message per robot and second\n"
        "shards: ~ts; KiB/robot: beyond the bare VM, all garbage collected,\n"
        "after the start and after the run\n",
        [?RUN_S, starl_dev_bench_run:shards(Shards)]
    ),
    starl_cli_terminal:out(
        "  robots     mode  start s  KiB/robot  after run   run s   CPU s  virt/wall\n"
    ),
    [row(N, Mode, once(N, Mode, Shards)) || N <- Sizes, Mode <- Modes].

once(N, Mode, Shards) ->
    Scenario = starl_dev_bench_ring:scenario(?MESSAGES),
    starl_dev_bench_run:simulate(Scenario#{robots => N, mode => Mode, shards => Shards}).

row(N, Mode, #{start_s := Start, wall_s := Wall, cpu_s := Cpu} = Run) ->
    #{start_bytes := Started, end_bytes := Ended} = Run,
    Name = io_lib:format("scale, ~b robots, ~ts", [N, Mode]),
    Figures = [
        {robots, N},
        {mode, atom_to_binary(Mode)},
        {start_s, Start},
        {bytes_per_robot, Started / N},
        {bytes_per_robot_after, Ended / N},
        {wall_s, Wall},
        {cpu_s, Cpu},
        {virtual_per_wall, ?RUN_S / Wall},
        {checks, starl_dev_bench_run:sound(Name, starl_dev_bench_ring:checks(N, ?MESSAGES, Run))}
    ],
    starl_cli_terminal:out(
        "~8b ~8ts ~8.2f ~10.1f ~10.1f ~7.2f ~7.2f ~10.2f\n",
        [N, Mode, Start, Started / N / 1024, Ended / N / 1024, Wall, Cpu, ?RUN_S / Wall]
    ),
    Figures.
