%% @doc Searches for the baud rate of a robot. It asks for the stream at one rate after the other,
%% until a frame with a correct checksum arrives.
%%
%% A busy computer receives answers late, perhaps when it already tries the next rate, where they
%% look like noise. So rates at which bytes came without a frame are tried again with more time. The
%% search also returns how late the answer was, because later questions need as much patience. A
%% frame may be a late one from the previous rate, so the robot is asked again once the line is
%% quiet.
-module(starl_create_search).

-export([all/2, awake/2, bauds/1, silent/1]).

-export_type([result/0]).

%% `LateMs': how long the first frame took; else how late this computer was, or at least an answer.
-type result() ::
    {found, Baud :: pos_integer(), LateMs :: non_neg_integer()}
    | {none, Noise :: non_neg_integer(), LateMs :: non_neg_integer()}.

-define(BAUDS, [115200, 57600, 19200, 38400, 9600, 28800, 14400, 4800, 2400]).
%% A frame comes each 15 ms; on a busy computer later.
-define(LISTEN_MS, 250).
-define(PATIENT_MS, 1500).
%% A robot that was woken starts for this time.
-define(WAKE_MS, 2500).
%% A computer that is as late is busy; one that is as late as this misses answers.
-define(LATE_MS, 50).
-define(BUSY_MS, 400).

%% @doc All rates that a robot may have, this one first.
-spec bauds(pos_integer()) -> [pos_integer()].
bauds(First) -> [First | lists:delete(First, ?BAUDS)].

%% @doc Tries these rates, and again with more time if that may help.
-spec all(starl_create_probe:t(), [pos_integer()]) -> result().
all(Probe, Bauds) ->
    case once(Probe, Bauds) of
        {none, Noise, Late} when Noise > 0; Late > ?LATE_MS ->
            worse({none, Noise, Late}, tried(?PATIENT_MS, Probe, Bauds));
        Result ->
            Result
    end.

worse({none, Noise, Late}, {none, More, Later}) -> {none, Noise + More, max(Late, Later)};
worse(_Before, Found) -> Found.

%% @doc Tries these rates of a robot that was woken, and starts.
-spec awake(starl_create_probe:t(), [pos_integer()]) ->
    {found, Baud :: pos_integer(), LateMs :: non_neg_integer()} | none.
awake(Probe, Bauds) -> awake(Probe, Bauds, ?WAKE_MS div (?LISTEN_MS * length(Bauds))).

awake(_Probe, _Bauds, 0) ->
    none;
awake(Probe, Bauds, N) ->
    case once(Probe, Bauds) of
        {found, _, _} = Found -> Found;
        {none, _, _} -> awake(Probe, Bauds, N - 1)
    end.

once(Probe, Bauds) -> tried(?LISTEN_MS, Probe, Bauds).

tried(Ms, Probe, Bauds) -> tried(Ms, Probe, Bauds, {none, 0, 0}).

tried(_Ms, _Probe, [], None) ->
    None;
tried(Ms, Probe, [Baud | Bauds], None) ->
    ok = starl_create_probe:speed(Probe, Baud),
    case confirmed(framed(Probe, Ms), Probe) of
        {none, _, _} = Again -> tried(Ms, Probe, Bauds, worse(None, Again));
        {found, Late} -> {found, Baud, Late}
    end.

confirmed({none, _, _} = None, _Probe) ->
    None;
confirmed({found, Before}, Probe) ->
    ok = starl_create_probe:quiet(Probe, max(Before, ?LISTEN_MS)),
    case framed(Probe, ?PATIENT_MS) of
        {found, Late} -> {found, max(Before, Late)};
        {none, Noise, _} -> {none, Noise, ?PATIENT_MS}
    end.

%% Start completes and flushes half a command.
framed(Probe, Ms) ->
    ok = starl_create_probe:send(Probe, binary:copy(<<128>>, 8)),
    _ = starl_create_probe:listen(Probe, 40),
    Begin = erlang:monotonic_time(microsecond),
    ok = starl_create_probe:send(Probe, <<148, 1, 35>>),
    #{frames := Frames, noise := Noise, bytes := Bytes} =
        starl_create_probe:first(Probe, [35], 1, Ms),
    Us = erlang:monotonic_time(microsecond) - Begin,
    ok = starl_create_probe:send(Probe, <<150, 0>>),
    case Frames of
        [] -> {none, max(Noise, Bytes), max(0, Us div 1000 - Ms)};
        [_ | _] -> {found, Us div 1000}
    end.

%% @doc Why there is no answer, and what to do, by what was heard at all rates.
-spec silent({Noise :: non_neg_integer(), LateMs :: non_neg_integer()}) -> unicode:chardata().
silent({_Noise, Late}) when Late > ?BUSY_MS ->
    "no answer came in time, but this computer is too busy to tell: end other programs, and try again";
silent({0, _Late}) ->
    "it says nothing at any baud rate, nor after pulses of DTR and RTS: press its button (Clean, Power); "
    "check TXD, RXD, GND, and that BRC is wired; if it stays silent, take its battery out and put it back";
silent({_Noise, _Late}) ->
    "it says what makes sense at no baud rate: check GND and the level (TTL, 5 V, not RS-232); switch it off "
    "and on, which brings its usual rate back".
