%% @doc Explains what is wrong with a Create or its line, and what to do, in one line each. A driver
%% remembers what it has reported, and reports a problem only once until it is over.
-module(starl_create_advice).

-export([line/1, is_news/2]).
-export([new/0, late/3, say/3, well/1]).

-export_type([t/0, memory/0]).

-type t() ::
    {gone, Reason :: term()}
    | {no_line, Reason :: term()}
    | {line_error, Reason :: term()}
    | {answers_at, Baud :: pos_integer()}
    | {no_frames_at, Baud :: pos_integer()}
    | {asleep, Baud :: pos_integer(), WokenBy :: dtr | rts | none}
    | {other_sensors, starl_create_packet:model()}
    | is_create_2
    | silent
    | {late, Us :: pos_integer()}
    | {no_control, starl_create_senses:unsafe()}
    | {stopped_by_itself, starl_create_senses:unsafe()}
    | {low_battery, Percent :: 0..100 | unknown}
    | ordinary_priority
    | {busy, LateUs :: pos_integer(), t()}
    | under_control.

-record(memory, {
    %% what was said last, and not taken back
    said = none :: t() | none,
    %% the latest that a timer of the driver's own, or a sign of life, came too late, and when
    missed = none :: {Us :: pos_integer(), AtUs :: integer()} | none
}).

-opaque memory() :: #memory{}.

%% The lateness that is none; the time for which a computer that was late is taken for busy.
-define(LATE_US, 50000).
-define(BUSY_US, 10000000).

%% @doc Nothing was said.
-spec new() -> memory().
new() -> #memory{}.

%% @doc This computer is so late now.
-spec late(Us :: integer(), NowUs :: integer(), memory()) -> memory().
late(Us, Now, #memory{missed = Before} = Memory) when Us >= ?LATE_US ->
    case Before of
        {Worse, At} when Worse > Us, Now - At < ?BUSY_US -> Memory;
        _ -> Memory#memory{missed = {Us, Now}}
    end;
late(_Us, _Now, Memory) ->
    Memory.

%% @doc The line to be said now, if it is news.
-spec say(t(), NowUs :: integer(), memory()) -> {[unicode:chardata()], memory()}.
say(Given, Now, #memory{said = Before, missed = Missed} = Memory) ->
    Advice = on_busy(Given, Now, Missed),
    case is_news(Advice, Before) of
        false -> {[], Memory};
        true -> {[line(Advice)], Memory#memory{said = Advice}}
    end.

%% @doc Things are well again; were they not?
-spec well(memory()) -> {boolean(), memory()}.
well(#memory{said = Said} = Memory) -> {Said =/= none, Memory#memory{said = none}}.

%% @doc Has this not been said, by what was said last? A second advice about the same is no news before
%% things are well again, unless it has become twice as bad.
-spec is_news(t(), Before :: t() | none) -> boolean().
is_news({late, Us}, {late, Before}) -> Us >= 2 * Before;
is_news(_Advice, none) -> true;
is_news(Advice, Before) -> topic(Advice) =/= topic(Before).

%% What a computer that was late has missed may look like another baud rate, a robot that is asleep, or a
%% pressed button: that it is busy comes first.
on_busy(Advice, Now, {Us, At}) when Now - At < ?BUSY_US ->
    case is_by_time(Advice) of
        true -> {busy, Us, Advice};
        false -> Advice
    end;
on_busy(Advice, _Now, _Missed) ->
    Advice.

is_by_time({stopped_by_itself, Why}) -> Why =:= none;
is_by_time(silent) -> true;
is_by_time(is_create_2) -> true;
is_by_time({Word, _}) -> lists:member(Word, [answers_at, no_frames_at, other_sensors]);
is_by_time({asleep, _, _}) -> true;
is_by_time(_) -> false.

topic({busy, _, _}) -> busy;
topic({gone, _}) -> line;
topic({no_line, _}) -> line;
topic({line_error, Reason}) -> {line_error, Reason};
topic({answers_at, _}) -> baud;
topic({no_frames_at, _}) -> baud;
topic({other_sensors, _}) -> model;
topic(is_create_2) -> model;
topic(Advice) when is_tuple(Advice) -> element(1, Advice);
topic(Advice) -> Advice.

%% @doc The line.
-spec line(t()) -> unicode:chardata().
line({gone, Reason}) ->
    ["the line to the robot is gone (", reason(Reason), "): it is opened again when it is back"];
line({Word, Reason}) when Word =:= no_line; Word =:= line_error ->
    ["the line to the robot: ", reason(Reason)];
line({answers_at, Baud}) ->
    ["the robot answers at ", integer_to_list(Baud), " baud: set its baud rate to that"];
line({no_frames_at, Baud}) ->
    [
        "bytes come that are no sensor frames at ",
        integer_to_list(Baud),
        " baud: set its baud rate (a Create 1 has 57600, a Create 2 115200; 19200 if it "
        "was started that way), or take its battery out and put it back"
    ];
line({asleep, Baud, Line}) ->
    [no_answer(Baud), wakes_by(Line)];
line(Advice) ->
    of_robot(Advice).

%% What the robot is, and how it is.
of_robot({other_sensors, Model}) ->
    [
        "a robot answers, but does not know the sensors of a Create ",
        integer_to_list(Model),
        ": set its model to ",
        integer_to_list(3 - Model)
    ];
of_robot(is_create_2) ->
    "the robot is a Create 2: set its model to 2";
of_robot(silent) ->
    "the robot has fallen silent: greeting it anew";
of_robot({no_control, Why}) ->
    ["the robot does not come under control: ", remedy(Why)];
of_robot({stopped_by_itself, Why}) ->
    ["the robot has stopped by itself: ", cause(Why)];
of_robot({low_battery, Percent}) ->
    io_lib:format("the robot's battery is low (~p %): charge it", [Percent]);
of_robot(under_control) ->
    "the robot is under control again";
of_robot(Advice) ->
    of_computer(Advice).

of_computer({late, Us}) ->
    io_lib:format(
        "a leg lasted ~b ms too long: the computer is too busy to drive a robot well, which is "
        "driven more slowly now",
        [Us div 1000]
    );
of_computer({busy, Us, Advice}) ->
    [
        io_lib:format(
            "this computer is too busy: what the driver waits for came ~b ms late; give it less other "
            "work. If it is not busy: ",
            [Us div 1000]
        ),
        line(Advice)
    ];
of_computer(ordinary_priority) ->
    "the port program runs without real-time priority: on a busy computer it cuts legs short; let this "
    "user have it (LimitRTPRIO=1 in a systemd unit, or 'USER - rtprio 1' in /etc/security/limits.conf)".

wakes_by(none) ->
    ": switch it on (it may be asleep), or look at its cable and baud rate";
wakes_by(Line) ->
    [
        ", and ",
        atom_to_list(Line),
        " does not wake it: switch it on, or look at its cable, the wire to BRC, and its baud rate"
    ].

no_answer(Baud) -> ["the robot does not answer at ", integer_to_list(Baud), " baud"].

reason({_, Text}) when is_list(Text); is_binary(Text) -> Text;
reason(Reason) -> io_lib:format("~0tp", [Reason]).

remedy(charger) -> "take it off its charger or dock";
remedy(wheel_drop) -> "put it on its wheels";
remedy(_) -> "look at its cliff sensors, or start it anew".

cause(wheel_drop) -> "a wheel hangs down";
cause(charger) -> "it is on its charger";
cause(cliff) -> "it stands at a cliff";
cause(none) -> "it was started anew, or a button was pressed".
