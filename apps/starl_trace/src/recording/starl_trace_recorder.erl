%% @doc Writes the recording of a run while it runs.
%% ```
%%   {ok, Recorder} = starl_trace_recorder:start_link("run.mcap", simulation),
%%   {ok, Sim} = starl_sim:start(Scenario, #{
%%       observe => starl_trace_recorder:observer(Recorder), packets => true}),
%%   ...
%%   {ok, Written} = starl_trace_recorder:close(Recorder)
%% '''
%% A chunk is written each half second of real time, and of the run's time in which something
%% happens. A simulation waits for the recorder; a live run leaves events out when the disk is too
%% slow, and the recording says how many. A full disk ends the recording, not the run. A reserve
%% file is written at the beginning and removed then, to make room for the robot's store. With a
%% limit (`options()') the recording is a series of files.
-module(starl_trace_recorder).
-behaviour(gen_server).

-include_lib("kernel/include/file.hrl").

-export([start_link/2, start_link/3, observer/1, close/1, format_error/1]).
-export([init/1, handle_call/3, handle_cast/2, handle_info/2, terminate/2]).

-export_type([options/0, written/0, reason/0]).

%% `file_bytes': a file that is larger is closed, and the recording goes on in the file named by `next';
%% `reserve': a file of so many bytes, which the recording gives up when the disk is full.
-type options() :: #{
    file_bytes => pos_integer(),
    next => fun(() -> file:filename_all()),
    reserve => {file:filename_all(), Bytes :: pos_integer()}
}.

%% The recording: its last file, its bytes, and the time until which it goes.
-type written() :: #{
    file := file:filename_all(), bytes := non_neg_integer(), until_us := integer()
}.

-type reason() :: {file:filename_all(), file:posix() | badarg | terminated | system_limit}.

%% Events that may wait for the recorder.
-define(WAITING, 1000).
-define(WAITING_LIVE, 200000).
-define(FLUSH_MS, 500).
%% Room for the terms of a chunk: it is collected less often.
-define(HEAP_WORDS, 200000).

-record(recorder, {
    file :: file:filename_all(),
    device :: file:io_device(),
    kind :: simulation | live,
    options = #{} :: options(),
    writer :: starl_trace_writer:t(),
    stream = stream() :: starl_trace_stream:t(),
    now = 0 :: integer(),
    is_begun = false :: boolean(),
    bytes = 0 :: non_neg_integer(),
    %% `closed', or why nothing is written any more
    state = open :: open | closed | reason()
}).

%% @doc Begins a recording; a file of that name is replaced.
-spec start_link(file:filename_all(), simulation | live) ->
    {ok, pid()} | {error, reason()}.
start_link(File, Kind) -> start_link(File, Kind, #{}).

%% @doc The same with options.
-spec start_link(file:filename_all(), simulation | live, options()) ->
    {ok, pid()} | {error, reason()}.
start_link(File, Kind, Options) ->
    case reserved(Options) of
        ok -> started(File, Kind, Options);
        {error, _} = Error -> Error
    end.

started(File, Kind, Options) ->
    ok = without_link(File),
    case file:open(File, [write, raw, binary]) of
        {ok, Device} ->
            ok = file:close(Device),
            {ok, _} = gen_server:start_link(?MODULE, {File, Kind, Options}, [
                {spawn_opt, [{min_heap_size, ?HEAP_WORDS}]}
            ]);
        {error, Posix} ->
            {error, {File, Posix}}
    end.

%% The directory may be open to others, who know the name: a link there would lead elsewhere.
without_link(File) ->
    case file:read_link_info(File) of
        {ok, #file_info{type = symlink}} -> file:delete(File);
        _ -> ok
    end.

%% Random bytes: a file system may keep others in no room at all. The reserve of an earlier recording is
%% good.
reserved(#{reserve := {File, Bytes}}) ->
    case filelib:file_size(File) =:= Bytes orelse file:write_file(File, rand:bytes(Bytes)) of
        {error, Posix} ->
            _ = filelib:is_regular(File) andalso file:delete(File),
            {error, {File, Posix}};
        _ ->
            ok
    end;
reserved(_Options) ->
    ok.

given_up(#{reserve := {File, _}}) ->
    _ = file:delete(File),
    ok;
given_up(_Options) ->
    ok.

%% @doc The observer of the run, for its options.
-spec observer(pid()) -> starl_observer:t().
observer(Recorder) -> gen_server:call(Recorder, observer).

%% @doc Ends the recording.
-spec close(pid()) -> {ok, written()} | {error, reason()}.
close(Recorder) ->
    Answer = gen_server:call(Recorder, close, infinity),
    ok = gen_server:stop(Recorder),
    Answer.

%% @doc One line on a recording that could not be written.
-spec format_error(reason()) -> unicode:chardata().
format_error({File, Posix}) ->
    io_lib:format("~ts: the recording could not be written: ~ts", [File, file:format_error(Posix)]).

-spec init({file:filename_all(), simulation | live, options()}) -> {ok, #recorder{}}.
init({File, Kind, Options}) ->
    _ = process_flag(trap_exit, true),
    {ok, Device} = file:open(File, [write, raw, binary]),
    {Head, Writer} = starl_trace_writer:new(),
    _ = erlang:send_after(?FLUSH_MS, self(), flush),
    Recorder = #recorder{
        file = File, device = Device, kind = Kind, options = Options, writer = Writer
    },
    {ok, write(Head, Recorder)}.

-spec handle_call(term(), gen_server:from(), #recorder{}) -> {reply, term(), #recorder{}}.
handle_call(observer, _From, #recorder{kind = simulation} = Recorder) ->
    {reply, starl_observer:feed(self(), wait, ?WAITING), Recorder};
handle_call(observer, _From, Recorder) ->
    {reply, starl_observer:feed(self(), leave_out, ?WAITING_LIVE), Recorder};
handle_call(caught_up, _From, Recorder) ->
    {reply, ok, Recorder};
handle_call(close, _From, Recorder) ->
    Closed = closed(Recorder),
    {reply, answer(Closed), Closed}.

answer(#recorder{state = closed, file = File, bytes = Bytes, now = Now}) ->
    {ok, #{file => File, bytes => Bytes, until_us => Now}};
answer(#recorder{state = Reason}) ->
    {error, Reason}.

-spec handle_cast(term(), #recorder{}) -> {noreply, #recorder{}}.
handle_cast(_Message, Recorder) -> {noreply, Recorder}.

-spec handle_info(term(), #recorder{}) -> {noreply, #recorder{}} | {stop, term(), #recorder{}}.
handle_info({starl_news, Feed, News}, #recorder{state = open} = Recorder) ->
    Next = in_next_file(told(News, Recorder)),
    ok = starl_observer:done(News, Feed),
    {noreply, Next};
handle_info({starl_news, Feed, News}, Recorder) ->
    ok = starl_observer:done(News, Feed),
    {noreply, Recorder};
handle_info(flush, #recorder{state = open} = Recorder) ->
    _ = erlang:send_after(?FLUSH_MS, self(), flush),
    {noreply, flushed(Recorder)};
handle_info({'EXIT', _From, Reason}, Recorder) ->
    {stop, Reason, Recorder};
handle_info(_Other, Recorder) ->
    {noreply, Recorder}.

-spec terminate(term(), #recorder{}) -> ok.
terminate(_Reason, Recorder) ->
    _ = closed(Recorder),
    ok.

told({missed, Events}, #recorder{now = Now} = Recorder) ->
    messages([{gap, Now, Events}], Recorder);
told({begun, _} = News, #recorder{is_begun = true} = Recorder) ->
    told(News, again(Recorder));
told({begun, _} = News, Recorder) ->
    news(News, Recorder#recorder{is_begun = true});
told(News, Recorder) ->
    news(News, Recorder).

%% A run that begins again, with what was done by hand as faults, is recorded from its beginning.
again(#recorder{device = Device} = Recorder) ->
    {ok, 0} = file:position(Device, bof),
    ok = file:truncate(Device),
    {Head, Writer} = starl_trace_writer:new(),
    write(Head, Recorder#recorder{
        writer = Writer,
        stream = stream(),
        now = 0,
        bytes = 0,
        is_begun = false
    }).

%% A full file is a whole recording. Merged with the next one it lacks nothing.
in_next_file(
    #recorder{state = open, bytes = Bytes, options = #{file_bytes := Most}} = Recorder
) when
    Bytes >= Most
->
    #recorder{writer = Full, device = Device, options = #{next := Next}} = Recorder,
    #recorder{state = State} = Last = write(starl_trace_writer:finish(Full), Recorder),
    _ = file:close(Device),
    case State of
        open -> opened(Next(), Last);
        _ -> Last
    end;
in_next_file(Recorder) ->
    Recorder.

opened(File, #recorder{stream = Stream} = Recorder) ->
    {Head, Writer} = starl_trace_writer:new(),
    case file:open(File, [write, raw, binary]) of
        {ok, Device} ->
            Opened = Recorder#recorder{file = File, device = Device, writer = Writer, bytes = 0},
            %% the scenario at once: without it the file of a robot that is killed now cannot be read
            flushed(messages(starl_trace_stream:head(Stream), write(Head, Opened)));
        {error, Posix} ->
            failed({File, Posix}, Recorder)
    end.

%% Places follow from the motions; those that viewers are shown are enough.
stream() -> starl_trace_stream:new(starl_trace_writer:frames_us()).

news(News, #recorder{stream = Stream} = Recorder) ->
    {Messages, Next} = starl_trace_stream:news(News, Stream),
    messages(Messages, Recorder#recorder{stream = Next}).

flushed(#recorder{writer = Writer} = Recorder) ->
    {Bytes, Next} = starl_trace_writer:flush(Writer),
    write(Bytes, Recorder#recorder{writer = Next}).

messages([], Recorder) ->
    Recorder;
messages(Messages, #recorder{writer = Writer} = Recorder) ->
    {Bytes, Next} = starl_trace_writer:messages(Messages, Writer),
    {_, Now, _} = lists:last(Messages),
    write(Bytes, Recorder#recorder{writer = Next, now = Now}).

%% A chunk goes to the disk in one piece; in a live run it is there before the power can fail.
write(Bytes, #recorder{device = Device, bytes = Written, kind = Kind} = Recorder) ->
    case iolist_size(Bytes) of
        0 ->
            Recorder;
        Size ->
            Put = synced(Kind, file:write(Device, Bytes), Device),
            written(Put, Recorder#recorder{bytes = Written + Size})
    end.

synced(live, ok, Device) -> file:datasync(Device);
synced(_Kind, Answer, _Device) -> Answer.

written(ok, Recorder) ->
    Recorder;
written({error, Posix}, #recorder{file = File} = Recorder) ->
    failed({File, Posix}, Recorder).

failed(Reason, #recorder{options = Options} = Recorder) ->
    ok = given_up(Options),
    Recorder#recorder{state = Reason}.

closed(#recorder{state = open, stream = Stream, device = Device} = Recorder) ->
    {Messages, _} = starl_trace_stream:close(Stream),
    #recorder{writer = Writer} = Whole = messages(Messages, Recorder),
    #recorder{state = State} = Last = write(starl_trace_writer:finish(Writer), Whole),
    _ = file:close(Device),
    case State of
        open -> Last#recorder{state = closed};
        _ -> Last
    end;
closed(Recorder) ->
    Recorder.
