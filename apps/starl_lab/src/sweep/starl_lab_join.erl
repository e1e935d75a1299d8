%% @doc The command `./starl join': joins the slices of a sweep into one study, or names what is
%% missing.
-module(starl_lab_join).
-behaviour(starl_cli_command).

-export([command/0]).

-define(STRANGER,
    ": a sweep of code that was begun elsewhere; if you trust the code that it names, say --trust"
).

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "join",
        synopsis => "make one study of the slices of a sweep",
        argument => {required, "DIRECTORY", {example, "study"}},
        subject => fun subject/2,
        about => [
            "./starl join DIRECTORY... takes the directories of ./starl sweep ... --slice K/N, in any order, and "
            "writes runs.csv, summary.csv and the plot as the same sweep in one piece would, into the first "
            "of them or that of --out. If runs are missing, it names the slices that lack them and the "
            "command that makes them; a slice goes on where it was stopped.",
            {lines, "  ./starl join study"}
        ],
        flags => [
            {"Flags", [
                {out, string, none,
                    "directory for the results; without it the first of the directories"}
            ]}
        ],
        statuses => maps:get(statuses, starl_lab_sweep:command()),
        run => fun run/1
    }.

-spec subject(string(), [string()]) -> {ok, [file:filename(), ...], [string()]}.
subject(Dir, Args) ->
    {Dirs, Others} = lists:splitwith(fun(Word) -> not lists:prefix("-", Word) end, Args),
    {ok, [string:trim(D, trailing, "/") || D <- [Dir | Dirs]], Others}.

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{subject := [First | _] = Dirs, values := #{out := Given}}) ->
    Out =
        case Given of
            none -> First;
            _ -> Given
        end,
    case starl_lab_sweep_study:noted(Dirs) of
        {ok, Args, Code} ->
            case names_code(Args) andalso not is_ours(Dirs) of
                true -> {error, [[First, ?STRANGER]]};
                false -> joined(read(Args, Out), Dirs, Code)
            end;
        {error, Reason} ->
            {error, [starl_lab_sweep_study:format_error(Reason)]}
    end.

read(Args, Out) -> starl_cli_dispatch:read(starl_lab_sweep:command(), Args ++ ["--out", Out]).

%% Slices come from anywhere, and say what they are slices of: to read that, a target that is a file is loaded.
names_code(Args) ->
    lists:any(
        fun(Word) ->
            is_scenario(filename:extension(Word)) orelse starl_cli_target:names_code(Word)
        end,
        lists:append([string:lexemes(Arg, "=,") || Arg <- Args])
    ).

is_scenario(Extension) -> lists:member(Extension, [".term", ".config"]).

is_ours(Dirs) -> starl_cli_made_here:is_trusted() orelse starl_lab_sweep_study:is_ours(Dirs).

joined({ok, Call}, Dirs, Code) -> starl_lab_sweep:join(Call, Dirs, Code);
joined({error, _} = Error, _Dirs, _Code) -> Error.
