%% @doc `./starl bench': how fast the simulator and the planner run on this machine. Each
%% benchmark prints a table; all figures go to a file as JSON.
-module(starl_cli_bench).

-export([command/1]).

-define(BENCHMARKS, [
    {ring, starl_cli_bench_ring, "robots that send a message every 100 ms and drive to and fro"},
    {swarm, starl_cli_bench_swarm, "robots that broadcast to those within a metre"},
    {events, starl_cli_bench_events, "timers and deliveries, nothing else"},
    {scale, starl_cli_bench_scale, "start-up and memory of up to 10,000 robots"},
    {painting, starl_cli_bench_painting, "a picture painted, in times of real time"},
    {blocks, starl_cli_bench_blocks, "packets of elections, entries, rounds and geocasts"},
    {dpp, starl_cli_bench_dpp, "requests to the coordinator of distributed path planning"}
]).

%% @doc Runs the command; gives the exit status.
-spec command([string()]) -> starl_cli_terminal:status().
command([]) -> parsed(kinds(), []);
command(["-" ++ _ | _] = Args) -> parsed(kinds(), Args);
command([Name | Args]) ->
    case [Kind || Kind <- kinds(), atom_to_list(Kind) =:= Name] of
        [Kind] -> parsed([Kind], Args);
        [] -> starl_cli_terminal:bad_input([["bench: ", unknown(Name)]])
    end.

kinds() -> [Kind || {Kind, _, _} <- ?BENCHMARKS].

unknown(Name) ->
    Known = [atom_to_list(Kind) || Kind <- kinds()],
    case starl_cli_flags:nearest(Name, Known) of
        [Near | _] -> io_lib:format("unknown benchmark ~ts (did you mean ~ts?)", [Name, Near]);
        [] -> ["unknown benchmark ", Name, "; there are ", lists:join(", ", Known)]
    end.

%% All together run with their defaults: a flag like --robots means another thing to each.
parsed(Kinds, Args) ->
    Flags =
        case Kinds of
            [Kind] -> flags(Kind) ++ own_flags();
            _ -> own_flags()
        end,
    case starl_cli_flags:parse(Args, Flags) of
        {ok, #{help := true}} ->
            help(Kinds);
        {ok, Values} ->
            checked(Kinds, maps:merge(#{out => default_out()}, Values));
        {error, Problems} ->
            starl_cli_terminal:bad_input([
                ["bench: ", starl_cli_flags:format_problem(P)]
             || P <- Problems
            ])
    end.

module(Kind) -> element(2, lists:keyfind(Kind, 1, ?BENCHMARKS)).

flags(Kind) -> (module(Kind)):flags().

own_flags() ->
    [
        {out, string, none, "a JSON file for the figures (out/bench.json)"},
        {help, switch, false, "this help"}
    ].

default_out() -> filename:join([starl_cli_target:root(), "out", "bench.json"]).

%% Known before the work is done, and an older file stays until then.
checked(Kinds, #{out := File} = Options) ->
    Problems = lists:append([problems(Kind, with_defaults(Kind, Options)) || Kind <- Kinds]),
    case Problems =:= [] andalso can_write(File) of
        ok ->
            measured(Kinds, Options);
        false ->
            starl_cli_terminal:bad_input(Problems);
        {error, Posix} ->
            starl_cli_terminal:bad_input([["bench: --out: ", File, ": ", file:format_error(Posix)]])
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
    ok = file:write_file(File, starl_cli_json:pretty(machine() ++ Figures)),
    starl_cli_terminal:out(["\nfigures: ", File, "\n"]),
    case lists:all(fun sound/1, [Row || {_, Rows} <- Figures, Row <- Rows]) of
        true -> 0;
        false -> 3
    end.

bench(Kind, Options) ->
    starl_cli_terminal:out("\n"),
    (module(Kind)):run(with_defaults(Kind, Options)).

with_defaults(Kind, Options) -> maps:merge(starl_cli_flags:defaults(flags(Kind)), Options).

%% Only this one is given anything that may turn out to be wrong.
problems(painting, Options) -> starl_cli_bench_painting:problems(Options);
problems(_Kind, _Options) -> [].

sound(Row) -> proplists:get_value(checks, Row, true).

machine() ->
    [
        {otp, list_to_binary(erlang:system_info(otp_release))},
        {schedulers, erlang:system_info(schedulers_online)},
        {emulator, atom_to_binary(erlang:system_info(emu_flavor))}
    ].

help(Kinds) ->
    Width = starl_cli_terminal:columns(),
    Names = lists:join("|", [atom_to_list(Kind) || Kind <- kinds()]),
    starl_cli_terminal:out([
        "Usage: ./starl bench [", Names, "] [FLAGS]\n\n",
        "Without a name all run, with their defaults.\n",
        [
            ["\n", atom_to_list(Kind), ": ", What, "\n", starl_cli_flags:help(M:flags(), Width)]
         || {Kind, M, What} <- ?BENCHMARKS, lists:member(Kind, Kinds)
        ],
        "\nall:\n",
        starl_cli_flags:help(own_flags(), Width),
        "\nExit status: 0 measured, 3 a check failed, 2 bad input, 130 interrupted.\n"
    ]),
    0.
