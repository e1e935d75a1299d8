%% @doc The coverage benchmark: simulated seconds per wall second of robots that look at their neighbours and drive.
-module(starl_dev_bench_coverage).
-behaviour(starl_dev_benchmark).

-export([flags/0, run/1]).

%% Of the looks; and the part of the robots that the emptiest quarter of the floor has in the end: none at
%% first.
-define(PER_S, 2).
-define(FILLED, 0.02).

%% @doc The flags of this benchmark.
-spec flags() -> [starl_cli_flags:flag()].
flags() ->
    [
        {robots, {list, {integer, 50, 100000}}, [500], "sizes of the team"},
        {seconds, {integer, 10, 3600}, 60, "virtual time, s"},
        {begins, {one_of, [corner, everywhere]}, corner,
            "where the robots begin; everywhere: teams of every size have one density"},
        {shards, {optional, {integer, 1, 256}}, none, "number of shards; none: as in a run"},
        {reps, {integer, 1, 100}, 2, "repetitions; the fastest is reported"}
    ].

%% @doc Measures, prints one line per size, and gives the figures for a file.
-spec run(#{atom() => term()}) -> [starl_dev_benchmark:figures()].
run(#{robots := Sizes, seconds := Seconds} = Options) ->
    starl_cli_terminal:out("coverage, ~b s of virtual time, best of ~b\n", [
        Seconds, maps:get(reps, Options)
    ]),
    starl_cli_terminal:out(
        "robots   run s   CPU s virt/wall   looks/s CPU us/look seen/look digest\n"
    ),
    [size(N, Options) || N <- Sizes].

size(N, #{seconds := Seconds, reps := Reps} = Options) ->
    Scenario = (maps:with([shards, begins], Options))#{
        app => starl_lloyd_coverage,
        robots => N,
        rounds => ?PER_S * Seconds,
        time => 2 * Seconds
    },
    row(N, Seconds, [starl_dev_bench_run:simulate(Scenario) || _ <- lists:seq(1, Reps)]).

row(N, Seconds, Runs) ->
    [#{wall_s := Wall, cpu_s := Cpu, outcome := #{digest := Digest}, figures := Told} = Run | _] =
        lists:sort(fun(#{wall_s := A}, #{wall_s := B}) -> A =< B end, Runs),
    Looks = N * ?PER_S * Seconds,
    Seen = proplists:get_value(seen, Told),
    Hex = string:lowercase(binary:encode_hex(Digest)),
    Rates = [Seconds / Wall, trunc(Looks / Wall), 1.0e6 * Cpu / Looks],
    Shown = [N, Wall, Cpu] ++ Rates ++ [Seen, binary:part(Hex, 0, 6)],
    starl_cli_terminal:out("~6b ~7.2f ~7.2f ~9.2f ~9b ~11.1f ~9.1f ~ts\n", Shown),
    [
        {robots, N},
        {start_s, maps:get(start_s, Run)},
        {wall_s, Wall},
        {cpu_s, Cpu},
        {virtual_per_wall, Seconds / Wall},
        {looks_per_s, Looks / Wall},
        {cpu_us_per_look, 1.0e6 * Cpu / Looks},
        {seen_per_look, Seen},
        {digest, Hex},
        {checks, starl_dev_bench_run:sound(io_lib:format("coverage, ~b robots", [N]), checks(Runs))}
    ].

%% Every run must end normally, with robots in every quarter, and all must be equal.
checks([#{outcome := #{digest := Digest}} | _] = Runs) ->
    lists:usort(
        lists:append([
            [
                {"ending", done, Ending},
                {"digest", Digest, Own},
                {"robots in every quarter of the floor", true, Part >= ?FILLED}
            ]
         || #{ending := Ending, outcome := #{digest := Own}, figures := Told} <- Runs,
            Part <- [proplists:get_value(emptiest_quarter, Told)]
        ])
    ).
