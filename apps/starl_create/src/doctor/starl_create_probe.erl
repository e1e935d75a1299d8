%% @doc Talks with the robot behind a port, a question at a time: bytes out, the answer or silence.
%%
%% The process that opens a probe waits in it, and owns its port.
-module(starl_create_probe).

-export([
    open/3, close/1, speed/2, send/2, pulse/2, ask/4, said/3, listen/2, quiet/1, quiet/2, quiet_ms/0
]).
-export([stream/4, first/4, drive/4, go/3, is_lost/1, priority/1, lateness_ms/0]).

-export_type([t/0, heard/0]).

-opaque t() :: pid().

%% What was on the line: frames with their time, bytes that belong to none, and all bytes.
-type heard() :: #{
    frames := [{AtUs :: integer(), starl_create_packet:readings()}],
    noise := non_neg_integer(),
    bytes := non_neg_integer()
}.

-define(OPEN_MS, 5000).
%% By which a busy computer is found.
-define(WAITS, 10).
-define(WAIT_MS, 10).
-define(PULSE_MS, 200).
%% Frames come each 15 ms.
-define(QUIET_MS, 60).
-define(QUIET_AT_MOST_MS, 1000).
%% Beyond its own time a script is waited for so long.
-define(LATE_MS, 5000).

%% @doc Opens a device. `Stop' stops the robot when this process ends.
-spec open(Device :: string(), Baud :: pos_integer(), Stop :: binary()) ->
    {ok, t()} | {error, {starl_create_port:reason(), unicode:chardata()}}.
open(Device, Baud, Stop) ->
    {ok, Port} = starl_create_port:start_link(self(), #{}),
    Port ! {stop_bytes, Stop},
    Port ! {open, Device, Baud},
    receive
        {opened, Device} -> {ok, Port};
        {error, Error} -> {error, Error}
    after ?OPEN_MS -> {error, {io, [Device, ": does not open"]}}
    end.

%% @doc Stops the wheels and closes.
-spec close(t()) -> ok.
close(Port) ->
    true = unlink(Port),
    Ref = monitor(process, Port),
    Port ! close,
    exit(Port, shutdown),
    receive
        {'DOWN', Ref, _, _, _} -> ok
    end.

%% @doc Has the line been lost since this was asked last, even if it is back?
-spec is_lost(t()) -> boolean().
is_lost(_Port) ->
    receive
        {closed, _} -> true
    after 0 -> false
    end.

%% @doc How soon the computer lets the port program run, which says it before it opens.
-spec priority(t()) -> starl_create_port:priority().
priority(_Port) ->
    receive
        {priority, Priority} -> Priority
    after 0 -> ordinary
    end.

%% @doc How late the waits of this process end: the worst of some.
-spec lateness_ms() -> non_neg_integer().
lateness_ms() -> lists:max([late_ms() || _ <- lists:seq(1, ?WAITS)]).

late_ms() ->
    Begin = erlang:monotonic_time(millisecond),
    receive
    after ?WAIT_MS -> max(0, erlang:monotonic_time(millisecond) - Begin - ?WAIT_MS)
    end.

%% @doc Another baud rate.
-spec speed(t(), pos_integer()) -> ok.
speed(Port, Baud) -> told(Port, {speed, Baud}).

%% @doc Sends bytes.
-spec send(t(), iodata()) -> ok.
send(Port, Bytes) -> told(Port, {send, Bytes}).

%% @doc Pulls a control line low, once.
-spec pulse(t(), dtr | rts) -> ok.
pulse(Port, Line) ->
    ok = told(Port, {pulse, Line, ?PULSE_MS, 1}),
    %% nothing else may touch the line meanwhile
    _ = listen(Port, 2 * ?PULSE_MS),
    ok.

told(Port, Message) ->
    Port ! Message,
    ok.

%% @doc Sends a question whose answer has this many bytes. What was on the line before is dropped.
-spec ask(t(), iodata(), pos_integer(), Ms :: pos_integer()) -> {ok, binary()} | none.
ask(Port, Question, Size, Ms) ->
    ok = quiet(Port),
    ok = send(Port, Question),
    answer(Size, <<>>, deadline(Ms)).

%% @doc Sends a question with an answer of unknown length: what comes until the line is quiet.
-spec said(t(), iodata(), Ms :: pos_integer()) -> binary().
said(Port, Question, Ms) ->
    ok = quiet(Port),
    ok = send(Port, Question),
    receive
        {data, Bytes} -> iolist_to_binary([Bytes | more(deadline(?QUIET_AT_MOST_MS))])
    after Ms -> <<>>
    end.

more(Deadline) ->
    receive
        {data, Bytes} -> [Bytes | more(Deadline)]
    after min(?QUIET_MS, left(Deadline)) -> []
    end.

answer(Size, Bytes, _Deadline) when byte_size(Bytes) >= Size ->
    {ok, binary:part(Bytes, 0, Size)};
answer(Size, Bytes, Deadline) ->
    receive
        {data, More} -> answer(Size, <<Bytes/binary, More/binary>>, Deadline)
    after left(Deadline) -> none
    end.

deadline(Ms) -> erlang:monotonic_time(millisecond) + Ms.

left(Deadline) -> max(0, Deadline - erlang:monotonic_time(millisecond)).

%% @doc Waits until nothing is on its way any more: a stream that was paused has frames in adapters
%% and queues. One that never ends is not waited for.
-spec quiet(t()) -> ok.
quiet(Port) -> quiet(Port, 0).

%% @doc The same on a line whose bytes come so late.
-spec quiet(t(), LateMs :: non_neg_integer()) -> ok.
quiet(_Port, Late) -> quiet_until(deadline(?QUIET_AT_MOST_MS + 2 * Late), ?QUIET_MS + Late).

%% @doc The time for which nothing has come then.
-spec quiet_ms() -> pos_integer().
quiet_ms() -> ?QUIET_MS.

quiet_until(Deadline, Ms) ->
    receive
        {data, _} ->
            case left(Deadline) of
                0 -> ok;
                _ -> quiet_until(Deadline, Ms)
            end
    after Ms -> ok
    end.

%% @doc All bytes of a time.
-spec listen(t(), Ms :: non_neg_integer()) -> binary().
listen(_Port, Ms) -> iolist_to_binary(bytes(deadline(Ms))).

bytes(Deadline) ->
    receive
        {data, Bytes} -> [Bytes | bytes(Deadline)]
    after left(Deadline) -> []
    end.

%% @doc Listens to a stream of these packets, as a robot of this generation sends it.
-spec stream(t(), [starl_create_packet:id(), ...], starl_create_packet:model(), pos_integer()) ->
    heard().
stream(_Port, Ids, Model, Ms) -> heard(Ids, Model, all, Ms).

%% @doc The same, until the first frame.
-spec first(t(), [starl_create_packet:id(), ...], starl_create_packet:model(), pos_integer()) ->
    heard().
first(_Port, Ids, Model, Ms) -> heard(Ids, Model, first, Ms).

heard(Ids, Model, Wanted, Ms) ->
    Nothing = #{frames => [], noise => 0, bytes => 0},
    heard(starl_create_stream:new(Ids, Model), Nothing, {Wanted, deadline(Ms)}).

heard(_Stream, #{frames := [_ | _]} = Heard, {first, _Deadline}) ->
    Heard;
heard(Stream, #{frames := Frames, bytes := N} = Heard, {_, Deadline} = Until) ->
    receive
        {data, Bytes} ->
            At = erlang:monotonic_time(microsecond),
            {Found, Next} = starl_create_stream:parse(Bytes, Stream),
            New = [{At, Readings} || {frame, Readings} <- Found],
            Noise = lists:sum([byte_size(Some) || {noise, Some} <- Found]),
            heard(
                Next,
                Heard#{
                    frames := Frames ++ New,
                    noise := maps:get(noise, Heard) + Noise,
                    bytes := N + byte_size(Bytes)
                },
                Until
            )
    after left(Deadline) -> Heard
    end.

%% @doc Runs a script of one step: bytes, a time, bytes that end it. On a busy computer it may last
%% longer than it should. A computer that stalls interrupts it, as does a cable that is pulled.
-spec drive(t(), iodata(), Us :: pos_integer(), iodata()) ->
    {ok, LateUs :: non_neg_integer()} | {interrupted, computer | line}.
drive(Port, Go, Us, Stop) ->
    Mark = erlang:unique_integer([positive]),
    Port ! {drive_script, Mark, [{Go, Us}], Stop},
    marked(sent, Mark, Us div 1000 + ?LATE_MS, fun(Begun) ->
        marked(ended, Mark, Us div 1000 + ?LATE_MS, fun(Ended) ->
            {ok, max(0, Ended - Begun - Us)}
        end)
    end).

marked(Word, Mark, Ms, Then) ->
    receive
        {Word, Mark, At} -> Then(At);
        {closed, unplugged} -> {interrupted, line};
        {closed, _} -> {interrupted, computer};
        {stopped, _, _} -> {interrupted, computer}
    after Ms -> {interrupted, computer}
    end.

%% @doc Begins a script and does not wait for its end.
-spec go(t(), [starl_create_port:step()], Stop :: iodata()) -> ok.
go(Port, Steps, Stop) -> told(Port, {drive_script, 0, Steps, Stop}).
