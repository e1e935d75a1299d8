%% @doc The plain-events benchmark: timers and deliveries per second on one core, inline, compared
%% with the round trips of two bare processes in the same minute.
-module(starl_dev_bench_events).
-behaviour(starl_dev_benchmark).

-export([flags/0, run/1]).

-define(PER_S, 10).
-define(LOSS, 0.05).

%% @doc The flags of this benchmark.
-spec flags() -> [starl_cli_flags:flag()].
flags() ->
    [
        {robots, {list, {integer, 2, 100000}}, [1000, 10000], "sizes of the ring"},
        {seconds, {integer, 1, 3600}, 20, "virtual time, s"},
        {reps, {integer, 1, 100}, 3, "repetitions; the one with the least CPU time is reported"}
    ].

%% @doc Measures, prints one line per size, and gives the figures for a file.
-spec run(#{atom() => term()}) -> [starl_dev_benchmark:figures()].
run(#{robots := Sizes, seconds := Seconds, reps := Reps}) ->
    starl_cli_terminal:out(
        "plain events, ~b s of virtual time, inline, one core, best of ~b\n"
        "an event: a timer or a delivery; ratio: events per CPU s over round trips of two\n"
        "bare processes per CPU s (bare/s)\n",
        [Seconds, Reps]
    ),
    starl_cli_terminal:out(
        "  robots    events   run s   CPU s events/CPU s      bare/s  ratio\n"
    ),
    [size(N, Seconds, Reps) || N <- Sizes].

size(N, Seconds, Reps) ->
    Rounds = [{starl_dev_bench_run:bare(), once(N, Seconds)} || _ <- lists:seq(1, Reps)],
    Bare = lists:max([Rate || {#{per_cpu_s := Rate}, _} <- Rounds]),
    row(N, Seconds, Bare, [Run || {_, Run} <- Rounds]).

once(N, Seconds) ->
    Scenario = #{
        app => starl_plain_events,
        robots => N,
        shards => 1,
        mode => inline,
        delay => {10, 50},
        loss => ?LOSS,
        clock_drift => 0,
        messages => ?PER_S * Seconds,
        time => Seconds + 1
    },
    starl_dev_bench_run:on_cores(1, fun() -> starl_dev_bench_run:simulate(Scenario) end).

row(N, Seconds, Bare, Runs) ->
    #{wall_s := Wall, cpu_s := Cpu, figures := Told} = starl_dev_bench_run:best(Runs),
    Events = proplists:get_value(events, Told),
    Ratio = Events / Cpu / Bare,
    Name = io_lib:format("events, ~b robots", [N]),
    Checks = lists:usort(lists:append([checks(N, Seconds, Run) || Run <- Runs])),
    Figures = [
        {robots, N},
        {events, Events},
        {wall_s, Wall},
        {cpu_s, Cpu},
        {events_per_s, Events / Wall},
        {events_per_cpu_s, Events / Cpu},
        {bare_round_trips_per_cpu_s, Bare},
        {events_per_bare_round_trip, Ratio},
        {checks, starl_dev_bench_run:sound(Name, Checks)}
    ],
    starl_cli_terminal:out(
        "~8b ~9b ~7.2f ~7.2f ~12b ~11b ~6.2f\n",
        [N, Events, Wall, Cpu, trunc(Events / Cpu), trunc(Bare), Ratio]
    ),
    Figures.

%% The radio must have lost the requested share of the packets, within five standard deviations.
checks(N, Seconds, #{ending := Ending, figures := Told, outcome := #{packets := Packets}}) ->
    Sent = ?PER_S * Seconds * N,
    Lost = Sent - proplists:get_value(received, Told),
    Spread = 5 * math:sqrt(Sent * ?LOSS * (1 - ?LOSS)),
    [
        {"ending", done, Ending},
        {"packets", Sent, Packets},
        {"lost about 5 %", true, abs(Lost - ?LOSS * Sent) =< Spread}
    ].
