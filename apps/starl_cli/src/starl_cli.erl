%% @doc The command line: dispatch, exit statuses, and the last resort when something breaks.
-module(starl_cli).

-export([main/1, command/1]).

%% @doc Runs a command and ends the VM with its exit status.
-spec main([string()]) -> no_return().
main(Args) ->
    ok = starl_cli_signal:install(),
    _ = io:setopts(standard_io, [{encoding, unicode}]),
    _ = io:setopts(standard_error, [{encoding, unicode}]),
    erlang:halt(guarded(Args), [{flush, true}]).

guarded(Args) ->
    try
        command(Args)
    catch
        Class:Reason:Stack -> internal_error(erl_error(Class, Reason, Stack))
    end.

erl_error(Class, Reason, Stack) ->
    io_lib:format("~ts~n~tp~n", [erl_error:format_exception(Class, Reason, Stack), Reason]).

internal_error(Text) ->
    File = filename:join(temporary(), "starl-" ++ os:getpid() ++ ".log"),
    Log = [starl_cli_log:lines(), Text],
    Where =
        case file:write_file(File, unicode:characters_to_binary(Log)) of
            ok -> ["; see ", File];
            {error, _} -> ""
        end,
    starl_cli_progress:erase(),
    First = hd(string:split(unicode:characters_to_list(Text), "\n")),
    starl_cli_terminal:complain(["internal error: ", First, Where]),
    1.

temporary() ->
    case os:getenv("TMPDIR") of
        false -> "/tmp";
        Dir -> Dir
    end.

%% @doc Runs a command; gives the exit status.
-spec command([string()]) -> starl_cli_terminal:status().
command([]) -> show(usage());
command([Help | _]) when Help =:= "help"; Help =:= "--help"; Help =:= "-h" -> show(usage());
command(["--version" | _]) -> show(["starl ", version(), "\n"]);
command([Name | Args]) -> known(lists:keyfind(Name, 1, commands()), Name, Args).

known({_, Run, _}, _Name, Args) -> Run(Args);
known(false, Name, _Args) ->
    Names = [N || {N, _, _} <- commands()] ++ ["test", "shell", "help"],
    case starl_cli_flags:nearest(Name, Names) of
        [Near | _] -> refuse(["unknown command ", Name, " (did you mean ", Near, "?)"]);
        [] -> refuse(["unknown command ", Name, "; ./starl help lists all"])
    end.

commands() ->
    [
        {"run", fun starl_cli_run:command/1, "run TARGET        run an application or a scenario"},
        {"table", fun starl_cli_table:command/1,
            "table             paint every picture with many teams, losses and seeds"},
        {"sweep", fun starl_cli_sweep:command/1,
            "sweep TARGET      run every combination of settings and seeds; CSV and a plot"},
        {"soak", fun starl_cli_soak:command/1,
            "soak BLOCK        use a block under random faults, with many seeds"},
        {"planted", fun starl_cli_planted:command/1,
            "planted           find broken building blocks, one per pitfall"},
        {"mutate", fun starl_cli_mutate:command/1,
            "mutate BLOCK      change a block's code in small places; do its tests notice?"},
        {"shrink", fun starl_cli_shrink:command/1,
            "shrink RUN        make a run that violates a contract small"},
        {"replay", fun starl_cli_replay:command/1,
            "replay RUN        run a recorded run again, or stop in it and look at the robots"},
        {"diverge", fun starl_cli_diverge:command/1,
            "diverge TARGET    run seeds in several ways that must agree; find where two differ"},
        {"check", fun starl_cli_check:command/1,
            "check BLOCK       go through all that can happen to a small team"},
        {"node", fun starl_cli_node:command/1,
            "node              a node that waits for runs with --nodes"},
        {"bench", fun starl_cli_bench:command/1, "bench [ring|dpp]  measure how fast it runs"},
        {"apps", fun apps/1, "apps              list the applications"},
        {"scenarios", fun scenarios/1, "scenarios         list the scenarios"},
        {"faults", fun starl_cli_faults:command/1, "faults            list the kinds of faults"}
    ].

usage() ->
    [
        "StarL: programs for teams of robots.\n\nUsage: ./starl COMMAND [ARGUMENTS]\n\n",
        [["  ", Doc, "\n"] || {_, _, Doc} <- commands()],
        "  test              run every test\n",
        "  shell             an Erlang shell with StarL loaded\n",
        "  help, --version\n\n",
        "./starl COMMAND --help tells more. To begin with: ./starl run painting\n"
    ].

show(Text) ->
    starl_cli_terminal:out(Text),
    0.

apps([]) -> show([[Name, "\n"] || {Name, _} <- starl_cli_target:apps()]);
apps(Args) -> list_help(Args, "apps", "lists the applications that ship.").

scenarios([]) ->
    Found = [[Name, Doc] || {Name, _, Doc} <- starl_cli_target:scenarios()],
    Width = lists:max([0 | [string:length(Name) || [Name, _] <- Found]]),
    show([[string:pad(Name, Width + 2), Doc, "\n"] || [Name, Doc] <- Found]);
scenarios(Args) ->
    list_help(Args, "scenarios", "lists the scenarios that ship; ./starl run NAME runs one.").

list_help([Help], Name, Does) when Help =:= "--help"; Help =:= "-h" ->
    show(["Usage: ./starl ", Name, "\n\n", string:titlecase(Does), "\n"]);
list_help([Arg | _], Name, _Does) ->
    refuse([Name, ": unexpected argument ", Arg]).

refuse(Problem) -> starl_cli_terminal:bad_input([Problem]).

version() ->
    case os:getenv("STARL_VERSION") of
        Set when is_list(Set), Set =/= "" -> Set;
        _ -> loaded_version(application:load(starl_cli))
    end.

loaded_version(_) ->
    {ok, Vsn} = application:get_key(starl_cli, vsn),
    Vsn.
