%% @doc The swarm-broadcast benchmark: simulated seconds per wall second.
-module(starl_dev_bench_swarm).
-behaviour(starl_dev_benchmark).

-export([flags/0, run/1]).

-define(PER_S, 10).
%% The radio range is measured from positions at the start of a window of 10 ms, the least delay. At
%% 100 mm/s a receiver has then moved by at most 1 mm.
-define(DELAY_MS, {10, 50}).
-define(RANGE_MM, 1000).
-define(PER_TICK, {5, 7}).

%% @doc The flags of this benchmark.
-spec flags() -> [starl_cli_flags:flag()].
flags() ->
    [
        {robots, {list, {integer, 50, 100000}}, [1000, 10000], "sizes of the swarm"},
        {seconds, {integer, 1, 3600}, 20, "virtual time, s"},
        {mode, {one_of, [auto, process, inline]}, auto,
            "how robots are simulated; auto: as in a run"},
        {shards, {optional, {integer, 1, 256}}, none, "number of shards; none: as in a run"},
        {reps, {integer, 1, 100}, 2, "repetitions; the fastest is reported"}
    ].

%% @doc Measures, prints one line per size, and gives the figures for a file.
-spec run(#{atom() => term()}) -> [starl_dev_benchmark:figures()].
run(#{robots := Sizes, seconds := Seconds} = Options) ->
    starl_cli_terminal:out(
        "swarm-broadcast, ~b s of virtual time, shards: ~ts, mode: ~w, best of ~b\n",
        [
            Seconds,
            starl_dev_bench_run:shards(maps:get(shards, Options)),
            maps:get(mode, Options),
            maps:get(reps, Options)
        ]
    ),
    starl_cli_terminal:out(
        "robots   run s   CPU s virt/wall receptions/s per tick digest\n"
    ),
    [size(N, Options) || N <- Sizes].

size(N, #{seconds := Seconds, reps := Reps, shards := Shards, mode := Mode}) ->
    Scenario = #{
        app => starl_swarm_broadcast,
        robots => N,
        shards => Shards,
        mode => Mode,
        delay => ?DELAY_MS,
        range => ?RANGE_MM,
        clock_drift => 0,
        messages => ?PER_S * Seconds,
        time => Seconds + 1
    },
    row(N, Seconds, [starl_dev_bench_run:simulate(Scenario) || _ <- lists:seq(1, Reps)]).

row(N, Seconds, Runs) ->
    [#{wall_s := Wall, cpu_s := Cpu} = Run | _] =
        lists:sort(fun(#{wall_s := A}, #{wall_s := B}) -> A =< B end, Runs),
    #{figures := Told, outcome := #{digest := Digest}} = Run,
    Speed = Seconds / Wall,
    Figures = [
        {robots, N},
        {start_s, maps:get(start_s, Run)},
        {wall_s, Wall},
        {cpu_s, Cpu},
        {virtual_per_wall, Speed},
        {virtual_per_cpu_s, Seconds / Cpu},
        {receptions_per_s, proplists:get_value(received, Told) / Wall},
        {per_tick, proplists:get_value(per_tick, Told)},
        {digest, string:lowercase(binary:encode_hex(Digest))},
        {checks, starl_dev_bench_run:sound(io_lib:format("swarm, ~b robots", [N]), checks(Runs))}
    ],
    starl_cli_terminal:out(line(Figures)),
    Figures.

%% Every run must end normally with the expected number of receptions, and all must be equal.
checks([#{outcome := #{digest := Digest}} | _] = Runs) ->
    {Least, Most} = ?PER_TICK,
    lists:usort(
        lists:append([
            [
                {"ending", done, Ending},
                {"digest", Digest, Own},
                {"receptions per robot and tick between 5 and 7", true,
                    PerTick >= Least andalso PerTick =< Most}
            ]
         || #{ending := Ending, outcome := #{digest := Own}, figures := Told} <- Runs,
            PerTick <- [proplists:get_value(per_tick, Told)]
        ])
    ).

line(Figures) ->
    Get = fun(Key) -> proplists:get_value(Key, Figures) end,
    io_lib:format(
        "~6b ~7.2f ~7.2f ~9.2f ~12b ~8.2f ~ts\n",
        [
            Get(robots),
            Get(wall_s),
            Get(cpu_s),
            Get(virtual_per_wall),
            trunc(Get(receptions_per_s)),
            Get(per_tick),
            binary:part(Get(digest), 0, 6)
        ]
    ).
