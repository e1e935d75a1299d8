%% @doc The painting benchmark measures how fast a team paints a picture on one core, relative to
%% real time. The digest and all monitors are on. The times of several seeds are added, because the
%% duration of a run depends on which robots obstruct one another.
-module(starl_dev_bench_painting).
-behaviour(starl_dev_benchmark).

-export([flags/0, problems/1, run/1]).

%% @doc The flags of this benchmark.
-spec flags() -> [starl_cli_flags:flag()].
flags() ->
    [
        {robots, {list, {integer, 1, 100}}, [10], "sizes of the team"},
        {pictures, {list, string}, ["house", "lines"], "SVG files or names of pictures that ship"},
        {modes, {list, {one_of, [process, inline]}}, [process, inline], "how robots are simulated"},
        {seeds, {integer, 1, 1000}, 5, "the runs of seeds 1 to N are added up"},
        {reps, {integer, 1, 100}, 5, "repetitions of each; the one with the least CPU time counts"}
    ].

%% @doc The pictures that these teams cannot paint, with the reasons; one line each.
-spec problems(#{atom() => term()}) -> [unicode:chardata()].
problems(#{robots := Sizes, pictures := Pictures}) ->
    lists:append([
        case starl_sim:start(scenario(Picture, lists:max(Sizes), inline, 1)) of
            {ok, Sim} ->
                starl_sim:close(Sim),
                [];
            {error, Reason} ->
                [starl_sim:format_error(Reason)]
        end
     || Picture <- Pictures
    ]).

scenario(Picture, N, Mode, Seed) ->
    #{app => starl_painting, robots => N, picture => Picture, mode => Mode, seed => Seed}.

%% @doc Measures, prints one line per picture, size and mode, and gives the figures for a file.
-spec run(#{atom() => term()}) -> [starl_dev_benchmark:figures()].
run(#{robots := Sizes, pictures := Pictures, modes := Modes, seeds := Seeds, reps := Reps}) ->
    starl_cli_terminal:out(
        "painting, one core, digest and monitors on\n"
        "seeds 1 to ~b together, best of ~b each\n"
        "picture      robots    mode virtual s  events  run s  CPU s virt/wall virt/CPU s\n",
        [Seeds, Reps]
    ),
    [
        row(Picture, N, Mode, [best(Picture, N, Mode, Seed, Reps) || Seed <- lists:seq(1, Seeds)])
     || Picture <- Pictures, N <- Sizes, Mode <- Modes
    ].

best(Picture, N, Mode, Seed, Reps) ->
    Scenario = scenario(Picture, N, Mode, Seed),
    Runs = [
        starl_dev_bench_run:on_cores(1, fun() -> starl_dev_bench_run:simulate(Scenario) end)
     || _ <- lists:seq(1, Reps)
    ],
    #{outcome := #{digest := Digest}} = Best = starl_dev_bench_run:best(Runs),
    {Best, checks(Digest, Runs)}.

row(Picture, N, Mode, Best) ->
    {Runs, Checks} = lists:unzip(Best),
    Sum = fun(Of) -> lists:sum([Of(Run) || Run <- Runs]) end,
    Virtual = Sum(fun(#{outcome := #{end_us := EndUs}}) -> EndUs / 1.0e6 end),
    Events = Sum(fun(#{events := Count}) -> Count end),
    Wall = Sum(fun(#{wall_s := S}) -> S end),
    Cpu = Sum(fun(#{cpu_s := S}) -> S end),
    Name = io_lib:format("painting ~ts, ~b robots, ~s", [Picture, N, Mode]),
    Figures = [
        {picture, unicode:characters_to_binary(Picture)},
        {robots, N},
        {mode, atom_to_binary(Mode)},
        {seeds, length(Runs)},
        {virtual_s, Virtual},
        {events, Events},
        {wall_s, Wall},
        {cpu_s, Cpu},
        {virtual_per_wall, Virtual / Wall},
        {virtual_per_cpu_s, Virtual / Cpu},
        {checks, starl_dev_bench_run:sound(Name, lists:usort(lists:append(Checks)))}
    ],
    starl_cli_terminal:out(
        "~-12.12ts ~6b ~7s ~9.1f ~7b ~6.1f ~6.1f ~9b ~10b\n",
        [filename:basename(Picture), N, Mode, Virtual, Events, Wall, Cpu] ++
            [trunc(Virtual / Wall), trunc(Virtual / Cpu)]
    ),
    Figures.

checks(Digest, Runs) ->
    lists:usort(
        lists:append([
            [{"ending", done, Ending}, {"digest", Digest, Own}, {"violations", [], Broken}]
         || #{ending := Ending, outcome := #{digest := Own, violations := Broken}} <- Runs
        ])
    ).
