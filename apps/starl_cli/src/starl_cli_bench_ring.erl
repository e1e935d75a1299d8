%% @doc The ring-shuttle benchmark: simulated time and messages per second of wall time, beside
%% the round trips of two bare processes in the same minute and the Java StarL simulator's figures.
-module(starl_cli_bench_ring).

-export([flags/0, run/1]).
-export([bounce/0]).

-type figures() :: [{atom(), starl_cli_json:value()}].

-define(TICKS, 600).
-define(RUN_S, 60).
%% A little longer, for the acknowledgements of the last messages.
-define(TIME_S, 61).
-define(ROUND_TRIPS, 200000).

%% The Java StarL simulator 1.5.1 (Java 17) on a two-core machine: robots => run wall s, simulated
%% seconds and messages per wall second.
-define(JAVA, #{
    4 => {0.58, 103, 4100},
    16 => {1.5, 39, 6300},
    64 => {4.6, 13, 8400},
    256 => {20.9, 2.9, 7350},
    512 => {58, 1.03, 5260},
    1000 => {210, 0.28, 2850}
}).

%% @doc The flags of this benchmark.
-spec flags() -> [starl_cli_flags:flag()].
flags() ->
    [
        {robots, {list, {integer, 2, 100000}}, [4, 64, 256, 1000], "sizes of the ring"},
        {shards, {optional, {integer, 1, 256}}, none,
            "over how many shards the robots are spread; none: as in a run"},
        {reps, {integer, 1, 100}, 3, "repetitions; the medians are told"}
    ].

%% @doc Measures and prints a line for each size; the figures for a file.
-spec run(#{atom() => term()}) -> [figures()].
run(#{robots := Sizes, shards := Shards, reps := Reps}) ->
    starl_cli_terminal:out(
        "ring-shuttle, ~b s of virtual time, shards: ~w, medians of ~b\n"
        "bare/s: round trips of a message {ball, From, N} between two bare processes\n",
        [?RUN_S, Shards, Reps]
    ),
    starl_cli_terminal:out(header()),
    [size(N, Shards, Reps) || N <- Sizes].

size(N, Shards, Reps) ->
    Runs = [{bare_rate(), in_process(fun() -> once(N, Shards) end)} || _ <- lists:seq(1, Reps)],
    Figures = figures(N, Runs),
    starl_cli_terminal:out(line(Figures)),
    Figures.

%% Each run starts with a heap of its own, so that no run pays for the one before.
in_process(Fun) ->
    Self = self(),
    {Pid, Ref} = spawn_monitor(fun() -> Self ! {result, self(), Fun()} end),
    receive
        {result, Pid, Result} ->
            true = erlang:demonitor(Ref, [flush]),
            Result;
        {'DOWN', Ref, process, Pid, Reason} ->
            exit(Reason)
    end.

%% -- one run --------------------------------------------------------------------------------

once(N, Shards) ->
    Before = memory(),
    {StartUs, {ok, Sim}} = timer:tc(fun() -> starl_sim:start(scenario(N, Shards)) end),
    Bytes = memory() - Before,
    {CpuMs0, _} = erlang:statistics(runtime),
    {RunUs, #{ending := Ending}} = timer:tc(fun() -> starl_sim:run(Sim, ?TIME_S) end),
    {CpuMs1, _} = erlang:statistics(runtime),
    {Outcome, #{figures := Told}} = starl_sim:finish(Sim),
    #{
        start_s => StartUs / 1.0e6,
        wall_s => RunUs / 1.0e6,
        cpu_s => (CpuMs1 - CpuMs0) / 1000,
        bytes => Bytes / N,
        events => maps:get(events, Outcome),
        checks => checks(N, Ending, Outcome, Told)
    }.

scenario(N, Shards) ->
    #{
        app => starl_ring_shuttle, robots => N, shards => Shards, delay => {10, 20},
        messages => ?TICKS, period => 100, clock_drift => 0, time => ?TIME_S
    }.

memory() ->
    _ = [erlang:garbage_collect(Pid) || Pid <- processes()],
    erlang:memory(total).

%% What every run of this workload must come to, by its name; [] when all is well.
checks(N, Ending, #{packets := Packets, monitors := Monitors, violations := Broken}, Told) ->
    #{starl_sap_monitor := #{sent := Sent, delivered := Delivered, lost := Lost}} = Monitors,
    Wanted = [
        {"all done", done, Ending},
        {"sent", ?TICKS * N, Sent},
        {"delivered", ?TICKS * N, Delivered},
        {"received, none twice", ?TICKS * N, proplists:get_value(received, Told)},
        {"packets", 2 * ?TICKS * N, Packets},
        {"lost", 0, Lost},
        {"least legs", 7, proplists:get_value(legs_min, Told)},
        {"most legs", 7, proplists:get_value(legs_max, Told)},
        {"violations", [], Broken}
    ],
    [{Name, Want, Got} || {Name, Want, Got} <- Wanted, Want =/= Got].

%% -- two bare processes ---------------------------------------------------------------------

%% Round trips per second of a message {ball, From, N}.
bare_rate() ->
    in_process(fun() ->
        Echo = spawn_link(?MODULE, bounce, []),
        {Us, ok} = timer:tc(fun() -> ping(?ROUND_TRIPS, Echo) end),
        unlink(Echo),
        exit(Echo, kill),
        ?ROUND_TRIPS * 1.0e6 / Us
    end).

ping(0, _Echo) ->
    ok;
ping(N, Echo) ->
    Echo ! {ball, self(), N},
    receive
        {ball, Echo, N} -> ping(N - 1, Echo)
    end.

%% @private
-spec bounce() -> no_return().
bounce() ->
    receive
        {ball, Pid, N} -> Pid ! {ball, self(), N}
    end,
    bounce().

%% -- figures --------------------------------------------------------------------------------

figures(N, Runs) ->
    Median = fun(Key) -> starl_cli_bench:median([maps:get(Key, Run) || {_, Run} <- Runs]) end,
    Bare = starl_cli_bench:median([Rate || {Rate, _} <- Runs]),
    Ratio = starl_cli_bench:median([
        Events / Wall / Rate
     || {Rate, #{events := Events, wall_s := Wall}} <- Runs
    ]),
    Wall = Median(wall_s),
    Failed = lists:usort(lists:append([Checks || {_, #{checks := Checks}} <- Runs])),
    _ = [complain(N, Check) || Check <- Failed],
    [
        {robots, N}, {start_s, Median(start_s)}, {wall_s, Wall}, {cpu_s, Median(cpu_s)},
        {virtual_per_wall, ?RUN_S / Wall}, {messages_per_s, ?TICKS * N / Wall},
        {events_per_s, Median(events) / Wall}, {bare_round_trips_per_s, Bare},
        {events_per_bare_round_trip, Ratio}, {bytes_per_robot, Median(bytes)},
        {checks, Failed =:= []}
    ] ++ java(N, Wall).

complain(N, {Name, Want, Got}) ->
    starl_cli_terminal:complain(
        io_lib:format("bench ring, ~b robots: ~ts is ~0tp, not ~0tp", [N, Name, Got, Want])
    ).

java(N, Wall) ->
    case ?JAVA of
        #{N := {JavaWall, _, _}} -> [{java_wall_s, JavaWall}, {times_java, JavaWall / Wall}];
        #{} -> []
    end.

header() ->
    [
        "  robots  start s   run s   CPU s  virt/wall  messages/s    events/s      bare/s  ratio"
        "  KiB/robot  | Java: run s  virt/wall  messages/s\n"
    ].

line(Figures) ->
    Get = fun(Key) -> proplists:get_value(Key, Figures) end,
    [
        io_lib:format("~8b ~8.3f ~7.2f ~7.2f ~10.1f ~11b ~11b ~11b ~6.2f ~10b", [
            Get(robots), Get(start_s), Get(wall_s), Get(cpu_s), Get(virtual_per_wall),
            round(Get(messages_per_s)), round(Get(events_per_s)),
            round(Get(bare_round_trips_per_s)), Get(events_per_bare_round_trip),
            round(Get(bytes_per_robot) / 1024)
        ]),
        java_cells(maps:find(Get(robots), ?JAVA)),
        "\n"
    ].

java_cells({ok, {Wall, Speed, Messages}}) ->
    io_lib:format("  | ~11.2f ~10.2f ~11b", [float(Wall), float(Speed), Messages]);
java_cells(error) ->
    "".
