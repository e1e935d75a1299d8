%% @doc What is wrong with a Create or its line, and what to do about it, in one line each.
-module(starl_create_advice).

-export([line/1, topic/1]).

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
    | under_control.

%% @doc What it is about. A second advice about the same is not said before things are well again.
-spec topic(t()) -> term().
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
line({asleep, Baud, none}) ->
    [
        no_answer(Baud),
        ": switch it on (it may be asleep), or look at its cable and baud rate"
    ];
line({asleep, Baud, Line}) ->
    [
        no_answer(Baud),
        ", and ",
        atom_to_list(Line),
        " does not wake it: switch it on, or look at its cable, the wire to BRC, and its baud rate"
    ];
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
line(under_control) ->
    "the robot is under control again".

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
