%% @doc `./starl download': fetches the recordings of a storage, by run.
-module(starl_debug_download_command).
-behaviour(starl_cli_command).

-export([command/0]).

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "download",
        synopsis => "fetch recordings from a storage",
        argument => {required, "REMOTE", {example, "lab:runs"}},
        subject => fun subject/2,
        about => [
            "./starl download REMOTE:PATH fetches what ./starl upload has sent there: a directory for "
            "each run, with the recordings that its robots left. Each is checked by its hash. Started "
            "again it fetches only what is missing."
        ],
        flags => [
            {"Flags", [
                {out, file, none, "the directory for the runs (recordings)"},
                {list, switch, false, "only lists what is there"}
            ]}
        ],
        run => fun run/1
    }.

-spec subject(string(), [string()]) -> {ok, string(), [string()]}.
subject(Remote, Args) -> {ok, Remote, Args}.

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{subject := Remote, values := #{out := Out, list := IsListed}}) ->
    case starl_storage:list(Remote) of
        {ok, []} -> {error, [[Remote, ": no recording is there"]]};
        {ok, Entries} when IsListed -> listed(Entries);
        {ok, Entries} -> fetched(Entries, Entries, Remote, directory(Out));
        {error, Reason} -> {error, [starl_storage:format_error(Reason)]}
    end.

directory(none) -> "recordings";
directory(Out) -> Out.

listed(Entries) ->
    starl_cli_terminal:out([[Run, "/", Name, "\n"] || #{run := Run, name := Name} <- Entries]),
    0.

fetched([], _All, _Remote, _Out) ->
    0;
fetched([Entry | Entries], All, Remote, Out) ->
    File = filename:join([Out, maps:get(run, Entry), file(Entry, All)]),
    case starl_storage:download(Entry, Remote, File, #{}) of
        {ok, How} ->
            starl_cli_terminal:out("~ts~ts\n", [File, [": is there" || How =:= is_there]]),
            fetched(Entries, All, Remote, Out);
        {error, Reason} ->
            {error, [starl_storage:format_error(Reason)]}
    end.

%% Two files of one name are told apart by their hashes.
file(#{run := Run, name := Name, list := List}, All) ->
    case [L || #{run := R, name := N, list := L} <- All, R =:= Run, N =:= Name] of
        [_] -> Name;
        [_, _ | _] -> lists:nthtail(length(List) - 16, List) ++ "-" ++ Name
    end.
