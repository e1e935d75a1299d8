%% @doc What is wrong with a Create or its line, and what to do about it, in one line each.
-module(starl_create_advice).

-export([line/1, is_news/2, on_busy/2]).

-export_type([t/0]).

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

%% @doc Has this not been said, by what was said last? A second advice about the same is no news before
%% things are well again, unless it has become twice as bad.
-spec is_news(t(), Before :: t() | none) -> boolean().
is_news({late, Us}, {late, Before}) -> Us >= 2 * Before;
is_news(_Advice, none) -> true;
is_news(Advice, Before) -> topic(Advice) =/= topic(Before).

%% @doc An advice by a computer that has been late itself by this time. What it has missed may look like
%% another baud rate, a robot that is asleep, or a pressed button: that it is busy comes first.
-spec on_busy(t(), LateUs :: pos_integer()) -> t().
on_busy(Advice, LateUs) ->
    case is_by_time(Advice) of
        true -> {busy, LateUs, Advice};
        false -> Advice
    end.

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
line({other_sensors, Model}) ->
    [
        "a robot answers, but does not know the sensors of a Create ",
        integer_to_list(Model),
        ": set its model to ",
        integer_to_list(3 - Model)
    ];
line(is_create_2) ->
    "the robot is a Create 2: set its model to 2";
line(silent) ->
    "the robot has fallen silent: greeting it anew";
line({late, Us}) ->
    io_lib:format(
        "a leg lasted ~b ms too long: the computer is too busy to drive a robot well, which is "
        "driven more slowly now",
        [Us div 1000]
    );
line({no_control, Why}) ->
    ["the robot does not come under control: ", remedy(Why)];
line({stopped_by_itself, Why}) ->
    ["the robot has stopped by itself: ", cause(Why)];
line({busy, Us, Advice}) ->
    [
        io_lib:format(
            "this computer is too busy: what the driver waits for came ~b ms late; give it less other "
            "work. If it is not busy: ",
            [Us div 1000]
        ),
        line(Advice)
    ];
line({low_battery, Percent}) ->
    io_lib:format("the robot's battery is low (~p %): charge it", [Percent]);
line(ordinary_priority) ->
    "the port program runs without real-time priority: on a busy computer it cuts legs short; let this "
    "user have it (LimitRTPRIO=1 in a systemd unit, or 'USER - rtprio 1' in /etc/security/limits.conf)";
line(under_control) ->
    "the robot is under control again".

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
