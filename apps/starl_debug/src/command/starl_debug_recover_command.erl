%% @doc The command `./starl recover': recovers a recording that was cut off.
-module(starl_debug_recover_command).
-behaviour(starl_cli_command).

-export([command/0]).

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "recover",
        synopsis => "make a whole recording of one that was cut off",
        argument => {required, "FILE", {example, "out/painting.4711.mcap"}},
        subject => fun subject/2,
        about => [
            "./starl recover FILE [OUT] takes all whole chunks of FILE, a recording whose run was "
            "killed, or another MCAP file, and writes them with a new index: to OUT, or to "
            "FILE-recovered.mcap. A chunk holds a second of the run."
        ],
        flags => [{"Flags", [starl_cli_out:overwrite_file()]}],
        run => fun run/1
    }.

-spec subject(string(), [string()]) ->
    {ok, {file:filename(), file:filename() | none}, [string()]}
    | {error, [unicode:chardata(), ...]}.
subject(Word, Args) ->
    case starl_cli_out:recording(Word, "name the file of a run that was killed") of
        {ok, File} -> subject_of(File, Args);
        {error, _} = Error -> Error
    end.

subject_of(File, [[First | _] = Out | Args]) when First =/= $- -> {ok, {File, Out}, Args};
subject_of(File, Args) -> {ok, {File, none}, Args}.

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{subject := {File, To}, values := #{overwrite := Overwrite}}) ->
    Out =
        case To of
            none -> filename:rootname(File, ".mcap") ++ "-recovered.mcap";
            _ -> To
        end,
    case refused(File, Out, Overwrite) of
        [] -> told(starl_mcap_recover:file(File, Out, packed, starl_trace_writer:patch()), Out);
        Problems -> {error, Problems}
    end.

refused(File, File, _Overwrite) ->
    [[File, ": name another file for the result"]];
refused(_File, Out, true) ->
    [[Out, ": this is a directory"] || filelib:is_dir(Out)];
refused(_File, Out, false) ->
    [[Out, ": is there already; --overwrite replaces it"] || filelib:is_file(Out)].

told({ok, #{chunks := Chunks, messages := Messages} = Recovered}, Out) ->
    starl_cli_terminal:out([
        io_lib:format("~ts: ~b messages in ~b chunks", [Out, Messages, Chunks]),
        lost(Recovered),
        "\n"
    ]),
    case starl_mcap_recover:not_packed(Recovered) of
        ok -> ok;
        {error, Why} -> starl_cli_terminal:warn([Out, ": not packed: ", Why])
    end,
    0;
told({error, Reason}, _Out) ->
    {error, [starl_mcap_recover:format_error(Reason)]}.

lost(#{was_closed := true, damaged := 0}) ->
    "; the file had been whole";
lost(#{damaged := 0, lost_bytes := Bytes}) ->
    io_lib:format("; ~b bytes at the end are lost", [Bytes]);
lost(#{damaged := N, lost_bytes := Bytes}) ->
    io_lib:format("; ~b damaged chunks and ~b bytes at the end are lost", [N, Bytes]).
