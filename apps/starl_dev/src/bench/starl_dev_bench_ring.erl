%% @doc The ring-shuttle benchmark: simulated time and messages per second of wall time, with
%% processes and inline, on one core and over shards. It is compared with the round trips of two
%% bare processes in the same minute.
-module(starl_dev_bench_ring).
-behaviour(starl_dev_benchmark).

-export([flags/0, run/1, scenario/1, checks/3]).

-define(TICKS, 600).
-define(RUN_S, 60).

%% @doc The flags of this benchmark.
-spec flags() -> [starl_cli_flags:flag()].
flags() ->
    [
        {robots, {list, {integer, 2, 100000}}, [4, 64, 256, 1000], "sizes of the ring"},
        {modes, {list, {one_of, [process, inline]}}, [process, inline], "how robots are simulated"},
        {shards, {list, {integer, 1, 256}}, [1, 2],
            "numbers of shards, each with a core of its own"},
        {reps, {integer, 1, 100}, 2, "repetitions; the one with the least CPU time is reported"}
    ].

%% @doc Measures, prints one line per size, mode and number of shards, and gives the figures.
-spec run(#{atom() => term()}) -> [starl_dev_benchmark:figures()].
run(#{robots := Sizes, modes := Modes, shards := Shards, reps := Reps}) ->
    starl_cli_terminal:out(
        "ring-shuttle, ~b s of virtual time, best of ~b; a shard has a core\n"
        "ratio: events per CPU s over round trips between two bare processes per CPU s\n"
        "gain: of shards over one; busy: of as many busy processes over one (wall time)\n",
        [?RUN_S, Reps]
    ),
    starl_cli_terminal:out(header()),
    lists:append([size(N, Modes, lists:usort(Shards), Reps) || N <- Sizes]).

%% Runs are interleaved, so that other load on the machine affects all alike.
size(N, Modes, Shards, Reps) ->
    Kinds = [{Mode, S} || Mode <- Modes, S <- Shards, S =< N],
    Rounds = [round(N, Kinds) || _ <- lists:seq(1, Reps)],
    Bare = lists:max([Rate || {#{per_cpu_s := Rate}, _, _} <- Rounds]),
    Busy = fun(S) -> lists:max([maps:get(S, Gains) || {_, Gains, _} <- Rounds]) end,
    All = maps:from_list([{K, [maps:get(K, Runs) || {_, _, Runs} <- Rounds]} || K <- Kinds]),
    [row(N, Kind, Bare, Busy(S), All) || {_, S} = Kind <- Kinds].

round(N, Kinds) ->
    Gains = [{S, starl_dev_bench_run:busy_gain(S)} || S <- lists:usort([S || {_, S} <- Kinds])],
    Runs = [{{Mode, S}, once(N, Mode, S)} || {Mode, S} <- Kinds],
    {starl_dev_bench_run:bare(), maps:from_list(Gains), maps:from_list(Runs)}.

once(N, Mode, Shards) ->
    Scenario = (scenario(?TICKS))#{robots => N, mode => Mode, shards => Shards},
    starl_dev_bench_run:on_cores(Shards, fun() -> starl_dev_bench_run:simulate(Scenario) end).

%% @doc The workload with a number of messages per robot in 60 s. The run lasts a little longer, for
%% the acknowledgements of the last messages.
-spec scenario(Messages :: pos_integer()) -> #{app := module(), atom() => term()}.
scenario(Messages) ->
    #{
        app => starl_ring_shuttle,
        delay => {10, 20},
        clock_drift => 0,
        messages => Messages,
        period => ?RUN_S * 1000 div Messages,
        time => ?RUN_S + 1
    }.

%% @doc The checks that every run of this workload must pass.
-spec checks(Robots :: pos_integer(), Messages :: pos_integer(), starl_dev_bench_run:run()) ->
    [starl_dev_bench_run:check()].
checks(N, Messages, #{ending := Ending, figures := Told, outcome := Outcome}) ->
    #{packets := Packets, monitors := Monitors, violations := Broken} = Outcome,
    #{starl_sap_monitor := #{sent := Sent, delivered := Delivered, lost := Lost}} = Monitors,
    [
        {"ending", done, Ending},
        {"sent", Messages * N, Sent},
        {"delivered", Messages * N, Delivered},
        {"received, none twice", Messages * N, proplists:get_value(received, Told)},
        {"packets", 2 * Messages * N, Packets},
        {"lost", 0, Lost},
        {"least legs", 7, proplists:get_value(legs_min, Told)},
        {"most legs", 7, proplists:get_value(legs_max, Told)},
        {"violations", [], Broken}
    ].

%% -- figures --------------------------------------------------------------------------------

row(N, {Mode, Shards} = Kind, Bare, Busy, All) ->
    Runs = maps:get(Kind, All),
    #{wall_s := Wall, cpu_s := Cpu, events := Events} = Run = starl_dev_bench_run:best(Runs),
    Name = io_lib:format("ring, ~b robots, ~ts, shards ~b", [N, Mode, Shards]),
    Checks = lists:usort(lists:append([checks(N, ?TICKS, R) || R <- Runs])),
    Figures =
        [
            {robots, N},
            {mode, atom_to_binary(Mode)},
            {shards, Shards},
            {start_s, maps:get(start_s, Run)},
            {wall_s, Wall},
            {cpu_s, Cpu},
            {virtual_per_wall, ?RUN_S / Wall},
            {messages_per_s, ?TICKS * N / Wall},
            {events_per_s, Events / Wall},
            {events_per_cpu_s, Events / Cpu},
            {bare_round_trips_per_cpu_s, Bare},
            {events_per_bare_round_trip, Events / Cpu / Bare},
            {gain, gain(Kind, All)},
            {busy_gain, Busy},
            {bytes_per_robot, maps:get(start_bytes, Run) / N},
            {checks, starl_dev_bench_run:sound(Name, Checks)}
        ],
    starl_cli_terminal:out(line(Figures)),
    Figures.

%% Compares the least wall time of each kind of run.
gain({Mode, _} = Kind, All) ->
    case All of
        #{{Mode, 1} := Alone, Kind := Runs} -> least_wall(Alone) / least_wall(Runs);
        #{} -> null
    end.

least_wall(Runs) -> lists:min([Wall || #{wall_s := Wall} <- Runs]).

header() ->
    "robots    mode shards   run s  virt/wall messages/s ratio  gain  busy\n".

line(Figures) ->
    Get = fun(Key) -> proplists:get_value(Key, Figures) end,
    io_lib:format("~6b ~7ts ~6b ~7.2f ~10.1f ~10b ~5.2f ~5ts ~5.2f\n", [
        Get(robots),
        Get(mode),
        Get(shards),
        Get(wall_s),
        Get(virtual_per_wall),
        trunc(Get(messages_per_s)),
        Get(events_per_bare_round_trip),
        cell(Get(gain)),
        Get(busy_gain)
    ]).

cell(null) -> "-";
cell(Number) -> io_lib:format("~.2f", [Number]).
