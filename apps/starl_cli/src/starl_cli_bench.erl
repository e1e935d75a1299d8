%% @doc `./starl bench': how fast the simulator and the planner run on this machine.
-module(starl_cli_bench).

-export([command/1, median/1]).

%% @doc Runs the command; gives the exit status.
-spec command([string()]) -> starl_cli_terminal:status().
command([Help | _]) when Help =:= "--help"; Help =:= "-h" -> help();
command(["ring" | Args]) -> parsed([ring], Args);
command(["dpp" | Args]) -> parsed([dpp], Args);
command(Args) -> parsed([ring, dpp], Args).

%% Both together run with their defaults: a flag like --robots means another thing to each.
parsed(Kinds, Args) ->
    Flags =
        case Kinds of
            [Kind] -> flags(Kind) ++ own_flags();
            _ -> own_flags()
        end,
    case starl_cli_flags:parse(Args, Flags) of
        {ok, #{help := true}} -> help();
        {ok, Values} -> checked(Kinds, maps:merge(#{out => none}, Values));
        {error, Problems} ->
            starl_cli_terminal:bad_input([["bench: ", starl_cli_flags:format_problem(P)] || P <- Problems])
    end.

flags(ring) -> starl_cli_bench_ring:flags();
flags(dpp) -> starl_cli_bench_dpp:flags().

own_flags() ->
    [
        {out, string, none, "a JSON file for the figures"},
        {help, switch, false, "this help"}
    ].

checked(Kinds, #{out := none} = Options) ->
    measured(Kinds, Options);
checked(Kinds, #{out := File} = Options) ->
    %% known before the work is done, and an older file stays until then
    case file:open(File, [append]) of
        {ok, Device} ->
            ok = file:close(Device),
            measured(Kinds, Options);
        {error, Posix} ->
            starl_cli_terminal:bad_input([["bench: --out: ", File, ": ", file:format_error(Posix)]])
    end.

measured(Kinds, #{out := File} = Options) ->
    ok = starl_cli_log:install(),
    Figures = [{Kind, bench(Kind, Options)} || Kind <- Kinds],
    case File =:= none orelse file:write_file(File, starl_cli_json:pretty(machine() ++ Figures)) of
        true -> ok;
        ok -> starl_cli_terminal:out(["figures: ", File, "\n"])
    end,
    case lists:all(fun sound/1, [Row || {_, Rows} <- Figures, Row <- Rows]) of
        true -> 0;
        false -> 3
    end.

bench(Kind, Options) ->
    Full = maps:merge(starl_cli_flags:defaults(flags(Kind)), Options),
    case Kind of
        ring -> starl_cli_bench_ring:run(Full);
        dpp -> starl_cli_bench_dpp:run(Full)
    end.

sound(Row) -> proplists:get_value(checks, Row, true).

machine() ->
    [
        {otp, list_to_binary(erlang:system_info(otp_release))},
        {schedulers, erlang:system_info(schedulers_online)},
        {emulator, atom_to_binary(erlang:system_info(emu_flavor))}
    ].

help() ->
    Width = starl_cli_terminal:columns(),
    starl_cli_terminal:out([
        "Usage: ./starl bench [ring|dpp] [FLAGS]\n\n",
        "Without ring or dpp both run, with their defaults.\n\n"
        "Flags of ring, robots that each send a message every 100 ms and drive to and fro:\n",
        starl_cli_flags:help(starl_cli_bench_ring:flags(), Width),
        "\nFlags of dpp, requests to the coordinator of distributed path planning:\n",
        starl_cli_flags:help(starl_cli_bench_dpp:flags(), Width),
        "\n",
        starl_cli_flags:help(own_flags(), Width),
        "\nExit status: 0 measured, 3 a check failed, 2 bad input, 130 interrupted.\n"
    ]),
    0.

%% @doc The lower median.
-spec median([number(), ...]) -> number().
median(Values) -> lists:nth((length(Values) + 1) div 2, lists:sort(Values)).
