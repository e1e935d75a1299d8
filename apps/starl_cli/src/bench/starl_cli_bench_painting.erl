%% @doc The painting benchmark: how many times faster than real time a team paints a picture on
%% one core, with the digest and all monitors on.
-module(starl_cli_bench_painting).

-export([flags/0, run/1]).

-type figures() :: [{atom(), starl_cli_json:value()}].

%% @doc The flags of this benchmark.
-spec flags() -> [starl_cli_flags:flag()].
flags() ->
    [
        {robots, {list, {integer, 1, 100}}, [10], "sizes of the team"},
        {picture, string, "house", "an SVG file or the name of a picture that ships"},
        {reps, {integer, 1, 100}, 3, "repetitions; the one of the least CPU time is told"}
    ].

%% @doc Measures and prints a line for each size; the figures for a file.
-spec run(#{atom() => term()}) -> [figures()].
run(#{robots := Sizes, picture := Picture, reps := Reps}) ->
    starl_cli_terminal:out(
        "painting ~ts, one core, digest and monitors on, best of ~b\n"
        "  robots  virtual s   run s   CPU s  virt/wall  virt/CPU s  digest\n",
        [Picture, Reps]
    ),
    [row(N, [once(N, Picture) || _ <- lists:seq(1, Reps)]) || N <- Sizes].

once(N, Picture) ->
    Scenario = #{app => starl_painting, robots => N, picture => Picture},
    starl_cli_bench_run:on_cores(1, fun() -> starl_cli_bench_run:simulate(Scenario) end).

row(N, Runs) ->
    #{wall_s := Wall, cpu_s := Cpu, outcome := Outcome} = starl_cli_bench_run:best(Runs),
    #{end_us := EndUs, digest := Digest} = Outcome,
    Virtual = EndUs / 1.0e6,
    Hex = string:lowercase(binary:encode_hex(Digest)),
    Name = io_lib:format("painting, ~b robots", [N]),
    Figures = [
        {robots, N}, {virtual_s, Virtual}, {wall_s, Wall}, {cpu_s, Cpu},
        {virtual_per_wall, Virtual / Wall}, {virtual_per_cpu_s, Virtual / Cpu}, {digest, Hex},
        {checks, starl_cli_bench_run:sound(Name, checks(Digest, Runs))}
    ],
    starl_cli_terminal:out(
        "~8b ~10.1f ~7.2f ~7.2f ~10b ~11b  ~ts\n",
        [N, Virtual, Wall, Cpu, trunc(Virtual / Wall), trunc(Virtual / Cpu), binary:part(Hex, 0, 6)]
    ),
    Figures.

checks(Digest, Runs) ->
    lists:usort(lists:append([
        [{"ending", done, Ending}, {"digest", Digest, Own}, {"violations", [], Broken}]
     || #{ending := Ending, outcome := #{digest := Own, violations := Broken}} <- Runs
    ])).
