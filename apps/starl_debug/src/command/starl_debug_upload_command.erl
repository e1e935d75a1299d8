%% @doc `./starl upload': sends recordings to a storage that rclone knows.
-module(starl_debug_upload_command).
-behaviour(starl_cli_command).

-export([name/0, synopsis/0, argument/0, about/1, flags/1, subject/2, run/1]).

-spec name() -> string().
name() -> "upload".

-spec synopsis() -> string().
synopsis() -> "send recordings to a storage".

-spec argument() -> starl_cli_command:argument().
argument() -> {required, "FILES", {example, "out/painting-1"}}.

-spec about(starl_cli_command:subject()) -> [starl_cli_command:paragraph()].
about(_Subject) ->
    [
        "./starl upload FILES... REMOTE:PATH sends recordings to any storage that the program "
        "rclone knows, in pieces by their hashes. Started again it sends only what is missing. "
        "./starl download fetches them.",
        {lines, ["  ./starl upload robot-*.mcap lab:runs\n"]}
    ].

-spec flags(starl_cli_command:subject()) -> [starl_cli_command:group()].
flags(_Subject) -> [].

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
