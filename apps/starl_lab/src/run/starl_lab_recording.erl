%% @doc The recording of a run of the command line: `run.mcap' in its directory. Until the run has
%% ended it is a file beside that directory, with a descriptive name: `painting.4711.mcap'. A run
%% that is killed leaves it there. The nodes of a cluster write recordings of their robots into a
%% directory beside it, `painting.4711.robots', which becomes `robots'.
-module(starl_lab_recording).

-export([flags/0, wanted/2, recorded/4, options/2, nodes/2, kept/2, uploaded/2, into/3]).

-export_type([t/0]).

-opaque t() :: {Recorder :: pid(), file:filename()}.

-define(NAME, "run.mcap").
-define(ROBOTS, "robots").
%% A larger file is not packed at the end of a run, since its user would wait.
-define(MOST_PACKED, 128 * 1024 * 1024).

%% @doc The flags of a run.
-spec flags() -> [starl_cli_flags:flag()].
flags() ->
    [
        {record, switch, false, "records the run as run.mcap, for ./starl judge and for viewers"},
        {no_record, switch, false, "live: no recording"},
        {upload, {optional, string}, none,
            "records, and sends the recordings to a storage of rclone's (lab:runs) meanwhile"}
    ].

%% @doc Is the run to be recorded? A live run is, unless its user says no.
-spec wanted(simulation | live, Values :: #{atom() => term()}) -> boolean().
wanted(_Kind, #{upload := Remote}) when Remote =/= none -> true;
wanted(simulation, Values) -> maps:get(record, Values, false);
wanted(live, Values) -> not maps:get(no_record, Values, false).

%% @doc Runs something with a recorder; what it does not keep is deleted.
-spec recorded(simulation | live | none, Values :: #{atom() => term()}, starl_lab_setup:t(), Run) ->
    Answer
when
    Run :: fun((starl_lab_setup:t()) -> Answer),
    Answer :: starl_cli_command:answer().
recorded(none, _Values, Setup, Run) ->
    Run(Setup);
recorded(Kind, Values, #{out := Out} = Setup, Run) ->
    File = starl_cli_out:beside(Out, ".mcap"),
    _ = filelib:ensure_dir(File),
    Answer = with_recorder(File, Kind, fun(Recorder) ->
        sending(Values, File, Setup#{recording => {Recorder, File}}, Run)
    end),
    _ = file:del_dir(robots(File)),
    Answer.

%% @doc Runs something whose observer records it in this file.
-spec into(file:filename(), simulation | live, fun((starl_observer:t()) -> Answer)) ->
    Answer | {error, [unicode:chardata(), ...]}.
into(File, Kind, Run) ->
    with_recorder(File, Kind, fun(Recorder) -> Run(starl_trace_recorder:observer(Recorder)) end).

with_recorder(File, Kind, Run) ->
    case starl_trace_recorder:start_link(File, Kind) of
        {ok, Recorder} ->
            Answer = Run(Recorder),
            ok = gone(Recorder),
            Answer;
        {error, Reason} ->
            {error, [starl_trace_recorder:format_error(Reason)]}
    end.

%% What is whole of the recordings is sent while they are written. Each look is a try.
sending(#{upload := Remote}, File, Setup, Run) when Remote =/= none ->
    Files = fun() -> [File | filelib:wildcard(robots(File) ++ "/*.mcap")] end,
    case starl_storage_sender:start(Files, Remote, #{tries => 1}) of
        {ok, Sender} ->
            try
                Run(Setup#{upload => {Sender, Remote}})
            after
                exit(Sender, kill)
            end;
        {error, Reason} ->
            {error, [["upload: ", starl_storage:format_error(Reason)]]}
    end;
sending(_Values, _File, Setup, Run) ->
    Run(Setup).

%% @doc Sends the rest of the recordings in the directory of the results, and reports that. If it
%% fails, a line says how to go on; the result of the run does not change.
-spec uploaded(starl_lab_setup:t(), file:filename()) -> ok.
uploaded(#{upload := {Sender, Remote}}, Dir) ->
    _ = is_process_alive(Sender) andalso starl_storage_sender:stop(Sender),
    Robots = filelib:wildcard(filename:join([Dir, ?ROBOTS, "*.mcap"])),
    Files = [F || F <- [filename:join(Dir, ?NAME)], filelib:is_regular(F)] ++ Robots,
    sent(Files, Remote);
uploaded(#{}, _Dir) ->
    ok.

sent([], _Remote) ->
    ok;
sent([File | Files], Remote) ->
    case starl_storage:upload(File, Remote, #{}) of
        {ok, #{run := Run}} ->
            starl_cli_terminal:out("~ts: is in ~ts, run ~ts\n", [File, Remote, Run]),
            sent(Files, Remote);
        {error, Reason} ->
            Again = lists:join(" ", [File | Files]),
            starl_cli_terminal:complain([
                "upload: ",
                starl_storage:format_error(Reason),
                "; ./starl upload ",
                Again,
                " ",
                Remote
            ])
    end.

%% A run that did not even start leaves no recording.
gone(Recorder) ->
    case is_process_alive(Recorder) of
        true -> discard(starl_trace_recorder:close(Recorder));
        false -> ok
    end.

discard({ok, #{file := File, until_us := 0}}) ->
    _ = file:delete(File),
    ok;
discard(_Kept) ->
    ok.

%% @doc The options of the run with its recorder.
-spec options(starl_lab_setup:t(), map()) -> map().
options(#{recording := {Recorder, _}, target := Target} = Setup, Options) ->
    Own = [Module || {Module, _, _} <- maps:get(code, Target, [])],
    Options#{
        observe => starl_trace_recorder:observer(Recorder),
        packets => true,
        histories => maps:get(histories, Setup, {kept, starl_block_catalogue:histories(Own)})
    };
options(Setup, Options) ->
    maps:merge(Options, maps:with([histories], Setup)).

%% @doc The options of a run on nodes, which record their robots themselves, too.
-spec nodes(starl_lab_setup:t(), map()) -> map().
nodes(#{recording := {_, File}}, Options) ->
    Options#{recorder => {starl_trace_robot, #{dir => robots(File)}}};
nodes(#{}, Options) ->
    Options.

robots(File) -> filename:rootname(File) ++ ".robots".

%% @doc Ends the recording and puts it into the directory of the results.
-spec kept(starl_lab_setup:t(), file:filename()) -> ok | {partly, unicode:chardata()}.
kept(#{recording := {Recorder, File}} = Setup, Dir) ->
    case is_process_alive(Recorder) andalso starl_trace_recorder:close(Recorder) of
        {ok, _} ->
            _ = file:rename(robots(File), filename:join(Dir, ?ROBOTS)),
            moved(Setup, File, filename:join(Dir, ?NAME));
        {error, Reason} ->
            _ = file:rename(robots(File), filename:join(Dir, ?ROBOTS)),
            _ = file:rename(File, filename:join(Dir, ?NAME)),
            {partly, starl_trace_recorder:format_error(Reason)};
        false ->
            {partly, "the recorder has failed; see run.log"}
    end;
kept(#{}, _Dir) ->
    ok.

moved(#{upload := _}, File, Into) ->
    %% its pieces are in the storage as they were written
    named(File, Into);
moved(#{}, File, Into) ->
    ok = packed_at_end(filelib:file_size(File), File),
    named(File, Into).

named(File, Into) ->
    case file:rename(File, Into) of
        ok -> ok;
        {error, Posix} -> {partly, [File, ": ", file:format_error(Posix)]}
    end.

packed_at_end(Size, _File) when Size > ?MOST_PACKED -> ok;
packed_at_end(_Size, File) ->
    case starl_mcap_recover:pack(File, starl_trace_writer:patch()) of
        ok -> ok;
        {error, Why} -> starl_cli_terminal:warn([File, ": not packed: ", Why])
    end.
