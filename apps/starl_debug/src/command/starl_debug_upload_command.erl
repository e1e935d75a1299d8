%% @doc `./starl upload': sends recordings to a storage that rclone knows.
-module(starl_debug_upload_command).
-behaviour(starl_cli_command).

-export([command/0]).

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "upload",
        synopsis => "send recordings to a storage",
        argument => {required, "FILES", {example, "out/painting-1"}},
        subject => fun subject/2,
        about => [
            "./starl upload FILES... REMOTE:PATH sends recordings to any storage that the program "
            "rclone knows, in pieces by their hashes. Started again it sends only what is missing. "
            "./starl download fetches them.",
            {lines, ["  ./starl upload robot-*.mcap lab:runs\n"]}
        ],
        run => fun run/1
    }.

-spec subject(string(), [string()]) ->
    {ok, {[file:filename()], string() | none}, [string()]} | {error, [unicode:chardata(), ...]}.
subject(Word, Args) ->
    {Words, Others} = lists:splitwith(fun(Arg) -> not lists:prefix("-", Arg) end, Args),
    case lists:reverse([Word | Words]) of
        [_] -> {ok, {[Word], none}, Others};
        [Remote | Files] -> found(lists:reverse(Files), Remote, Others)
    end.

found(Files, Remote, Others) ->
    Found = [starl_cli_out:recording(F, "./starl run TARGET --record makes one") || F <- Files],
    case lists:append([Problems || {error, Problems} <- Found]) of
        [] -> {ok, {[File || {ok, File} <- Found], Remote}, Others};
        Problems -> {error, Problems}
    end.

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{subject := {_, none}}) ->
    {error, ["name the storage last, such as ./starl upload out/painting-1 lab:runs"]};
run(#{subject := {Files, Remote}}) ->
    sent(Files, Remote).

sent([], _Remote) ->
    0;
sent([File | Files], Remote) ->
    case starl_storage:upload(File, Remote, #{}) of
        {ok, #{run := Run, pieces := Pieces, sent := Sent}} ->
            Line = "~ts: ~b of ~b pieces sent, run ~ts\n",
            starl_cli_terminal:out(Line, [File, Sent, Pieces, Run]),
            sent(Files, Remote);
        {error, Reason} ->
            {error, [starl_storage:format_error(Reason)]}
    end.
