%% @doc The command `./starl info': prints what a recording, or any MCAP file, contains.
-module(starl_debug_info_command).
-behaviour(starl_cli_command).

-export([command/0]).

%% No run of a world's own time is that long.
-define(SINCE_1970_US, 100_000_000_000_000).

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "info",
        synopsis => "tell what a recording holds",
        argument => {required, "FILE", {example, "out/painting-1/run.mcap"}},
        subject => fun subject/2,
        about => [
            "FILE is a recording or another MCAP file, or the directory of a run that holds one."
        ],
        run => fun run/1
    }.

-spec subject(string(), [string()]) ->
    {ok, file:filename(), [string()]} | {error, [unicode:chardata(), ...]}.
subject(Word, Args) ->
    starl_cli_out:recording(Word, "./starl run TARGET --record makes one", Args).

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{subject := File}) ->
    case starl_trace_info:file(File) of
        {ok, Info} ->
            starl_cli_terminal:out([[Line, "\n"] || Line <- lines(Info)]),
            0;
        {error, Reason} ->
            {error, [starl_trace_reader:format_error(Reason)]}
    end.

lines(#{file := File, bytes := Bytes, ended := Ended, topics := Topics} = Info) ->
    #{library := Library, chunks := Chunks, compressions := Packed} = Info,
    #{from_us := From, to_us := To} = Info,
    [
        [io_lib:format("~ts: MCAP, ~b bytes", [File, Bytes]), written_by(Library)],
        ["time    ", span(From, To)],
        io_lib:format("chunks  ~b~ts", [Chunks, packed(Packed)]),
        io_lib:format("end     ~ts", [ended(Ended, Chunks)])
    ] ++
        [
            string:trim(io_lib:format("~8b  ~-12ts ~ts", [N, Topic, Schema]), trailing)
         || {Topic, Schema, N} <- Topics
        ].

%% Robots on their own, and the files of others, count from 1970.
span(From, To) when From >= ?SINCE_1970_US ->
    Seconds = io_lib:format(" UTC, ~.3f s", [(To - From) / 1.0e6]),
    [date(From), " to ", date(To), Seconds];
span(From, To) ->
    io_lib:format("~.3f s to ~.3f s", [From / 1.0e6, To / 1.0e6]).

date(Us) ->
    Options = [{unit, millisecond}, {offset, "Z"}, {time_designator, $\s}],
    string:trim(calendar:system_time_to_rfc3339(Us div 1000, Options), trailing, "Z").

packed(Packed) ->
    case [Name || Name <- Packed, Name =/= <<>>] of
        [] -> "";
        Names -> [", ", lists:join(", ", Names)]
    end.

written_by(<<>>) -> "";
written_by(Library) -> [", written by ", Library].

ended(closed, _Chunks) ->
    "closed";
ended(cut_off, 0) ->
    "cut off before the end of its first chunk";
ended(cut_off, _Chunks) ->
    "cut off; ./starl recover makes a whole file of it";
ended({damaged, At}, _Chunks) ->
    io_lib:format("damaged at byte ~b; ./starl recover takes what is whole", [At]).
