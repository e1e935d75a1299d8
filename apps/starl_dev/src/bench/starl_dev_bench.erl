%% @doc `./starl bench': measures the speed of the simulator and the planner on this machine. Each
%% benchmark prints a table; all figures are written to a file as JSON.
-module(starl_dev_bench).

-behaviour(starl_cli_command).

-export([command/0]).

-define(BENCHMARKS, [
    {ring, starl_dev_bench_ring, "robots that send a message every 100 ms and drive to and fro"},
    {swarm, starl_dev_bench_swarm, "robots that broadcast to those within a metre"},
    {coverage, starl_dev_bench_coverage, "robots that look at their neighbours and spread"},
    {events, starl_dev_bench_events, "timers and deliveries, nothing else"},
    {scale, starl_dev_bench_scale, "start-up and memory of up to 10,000 robots"},
    {painting, starl_dev_bench_painting, "a picture painted, in times of real time"},
    {blocks, starl_dev_bench_blocks, "packets of elections, entries, rounds and geocasts"},
    {live, starl_dev_bench_live, "messages of robots in real time, and the nodes of a cluster"},
    {dpp, starl_dev_bench_dpp, "requests to the coordinator of distributed path planning"}
]).

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "bench",
        synopsis => "measure how fast it runs",
        argument => {optional, "BENCHMARK", [{Kind, Doc} || {Kind, _, Doc} <- ?BENCHMARKS]},
        about => [
            "Measures how fast the simulator and the planner run on this machine, each beside its "
            "baseline. Without a name all benchmarks run, with their defaults."
        ],
        flags => fun flags/1,
        statuses => [
            {0, "measured"}, {3, "a check failed"}, {130, "interrupted"}
        ],
        run => fun run/1
    }.

%% Run together, all use their defaults, because a flag such as --robots has another meaning in
%% each benchmark.
flags(none) -> [{shown, title(Kind), flags_of(Kind)} || Kind <- kinds()] ++ [own_flags()];
flags(Kind) -> [{title(Kind), flags_of(Kind)}, own_flags()].

own_flags() ->
    {"all", [
        {out, string, none, "a JSON file for the figures; without it out/bench.json, or the next"},
        starl_cli_out:overwrite_file()
    ]}.

title(Kind) -> [atom_to_list(Kind), ": ", element(3, lists:keyfind(Kind, 1, ?BENCHMARKS))].

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{subject := none, values := Values}) -> checked(kinds(), Values);
run(#{subject := Kind, values := Values}) -> checked([Kind], Values).

kinds() -> [Kind || {Kind, _, _} <- ?BENCHMARKS].

module(Kind) -> element(2, lists:keyfind(Kind, 1, ?BENCHMARKS)).

flags_of(Kind) -> (module(Kind)):flags().

%% The file is checked before the measurements; an older file stays until they are done.
checked(Kinds, #{out := Out, overwrite := Overwrite} = Given) ->
    Usual = starl_cli_out:usual("bench.json"),
    {There, Absolute} = starl_cli_out:file(Out, Usual, Overwrite),
    File = starl_cli_out:shown(Absolute),
    Options = Given#{out := File},
    Problems = There ++ lists:append([problems(Kind, Options) || Kind <- Kinds]),
    case Problems =:= [] andalso can_write(File) of
        ok ->
            measured(Kinds, Options);
        false ->
            {error, Problems};
        {error, Posix} ->
            {error, [["--out: ", File, ": ", file:format_error(Posix)]]}
    end.

can_write(File) ->
    case filelib:ensure_dir(File) of
        ok ->
            case file:open(File, [append]) of
                {ok, Device} -> file:close(Device);
                {error, _} = Error -> Error
            end;
        {error, _} = Error ->
            Error
    end.

measured(Kinds, #{out := File} = Options) ->
    ok = starl_cli_log:install(),
    Figures = [{Kind, bench(Kind, Options)} || Kind <- Kinds],
    Text = starl_json:pretty(machine() ++ Figures),
    ok = starl_cli_out:sure(File, file:write_file(File, Text)),
    starl_cli_terminal:out(["\nfigures: ", File, "\n"]),
    case lists:all(fun sound/1, [Row || {_, Rows} <- Figures, Row <- Rows]) of
        true -> 0;
        false -> 3
    end.

bench(Kind, Options) ->
    starl_cli_terminal:out("\n"),
    (module(Kind)):run(with_defaults(Kind, Options)).

with_defaults(Kind, Options) -> maps:merge(starl_cli_flags:defaults(flags_of(Kind)), Options).

problems(Kind, Options) ->
    starl_dev_benchmark:problems(module(Kind), with_defaults(Kind, Options)).

sound(Row) -> proplists:get_value(checks, Row, true).

machine() ->
    [
        {otp, list_to_binary(erlang:system_info(otp_release))},
        {schedulers, erlang:system_info(schedulers_online)},
        {emulator, atom_to_binary(erlang:system_info(emu_flavor))}
    ].
