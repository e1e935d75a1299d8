%% @doc Drives a Create: finds and wakes the robot behind a port, takes control of it, has scripts
%% carried out, and watches its sensors. A pure module: messages of the port and time-outs in, actions
%% out.
%% ```
%%              opened            frames              mode
%%     closed ---------> greeting --------> taking ----------> ready
%%       ^                |  ^  ^             ^                 |  |
%%       |          none: |  |  |             +-- left the mode +  |
%%       |   wake, try again +  +--------- no frames for 250 ms ---+
%%       +------- the cable is pulled, in every state
%% '''
%% Greeting begins with a row of Start commands, which completes whatever half command the robot
%% waits for. A Create 1 is asked for an encoder, which it does not have: who answers is a Create 2.
%% The mode in which the robot is after Start tells whether it counts its modes from 1 or higher.
%%
%% <em>Stalls.</em> A wheel stalls if the robot reports too high a current, or if it does not turn at
%% all while the robot has been commanded to turn it for four frames. A bump counts as a stall, too:
%% the robot stops and its answer is `stalled'.
-module(starl_create_driver).

-export([options/0, open/1, drive/3, actuate/4, stop/1, close/1, hear/3]).
-export([is_ready/1, readings/1, odometry/1, usual_pen/1]).

-export_type([t/0, options/0, action/0, message/0, event/0, pen/0, port_command/0]).

%% Which output is the pen, and the number of its bit.
-type pen() :: {leds | outputs | motors, 0..7}.

%% `device': what the port opens. `baud': that of the robot (default: as it is delivered). `mode':
%% safe, in which the robot stops by itself at a cliff and when it is lifted, or full. `wake': the
%% line of the port that is wired to BRC. `on_robot': scripts of a Create 1 on the robot.
-type options() :: #{
    device := term(),
    model := starl_create_packet:model(),
    baud => pos_integer(),
    mode => safe | full,
    wake => dtr | rts | none,
    on_robot => boolean(),
    pen => pen(),
    stops_at_bumps => boolean()
}.

%% The words to the port, as of erlang-serial, and more ({@link starl_create_pipe}).
-type port_command() ::
    {open, Device :: term(), Baud :: pos_integer()}
    | {send, binary()}
    | {drive_script, Ref :: pos_integer(), [{binary(), Us :: pos_integer()}], Stop :: binary()}
    | {stop_bytes, binary()}
    | {pulse, dtr | rts, LowMs :: pos_integer(), Times :: pos_integer()}
    | close.

%% What to do: tell the port; start a timer in place of the one of that name; answer a command; tell
%% whoever wants to know; write a line.
-type action() ::
    {port, port_command()}
    | {timer, step | silence | odometry | rest, Ms :: non_neg_integer()}
    | {answer, Mark :: term(), starl_live_chassis:answer()}
    | {event, event()}
    | {say, notice | warning, unicode:chardata()}.

-type event() ::
    ready
    | lost
    | {bump, left | right | both | none}
    | {drop, Bits :: non_neg_integer()}
    | {cliff, [left | front_left | front_right | right]}
    | {buttons, Bits :: byte()}
    | {docked, boolean()}
    | {battery, low | ok}.

%% The port's words. Times are those at which bytes left, by the clock of the caller. A line that has
%% been closed is opened again by the port; `stopped': the port has stopped the wheels by itself.
-type message() ::
    {opened, Device :: term()}
    | {data, binary()}
    | {error, Reason :: term()}
    | {closed, Reason :: term()}
    | {sent, Ref :: pos_integer(), AtUs :: integer()}
    | {ended, Ref :: pos_integer(), AtUs :: integer()}
    | {stopped, Why :: atom(), AtUs :: integer()}
    | {timeout, step | silence | odometry | rest}.

-record(script, {
    mark :: term(),
    ref :: pos_integer(),
    steps :: [starl_create_script:step()],
    heard = none :: integer() | none,
    %% has the port written the last bytes, and has the robot had time to come to rest?
    has_ended = false :: boolean(),
    may_rest = false :: boolean()
}).

-record(driver, {
    options :: options(),
    model :: starl_create_packet:model(),
    phase = closed :: closed | greeting | asking | taking | ready,
    tries = 0 :: non_neg_integer(),
    %% another baud rate than its own, at which a robot is looked for
    tried = none :: pos_integer() | none,
    %% the line that was said last, and not taken back
    said = none :: term(),
    parser :: starl_create_stream:t(),
    frames = 0 :: integer(),
    %% has a time without frames been noticed?
    is_silent = false :: boolean(),
    %% bytes of this greeting that were no frames
    noise = <<>> :: binary(),
    is_other_model = false :: boolean(),
    offset = 0 :: integer(),
    ref = 0 :: non_neg_integer(),
    script = none :: none | #script{},
    pen = up :: up | down,
    readings = #{} :: starl_create_packet:readings(),
    %% of each wheel: the frames since its command changed
    steady = {0, 0} :: {non_neg_integer(), non_neg_integer()},
    %% the whole way (mm) and turn (rad)
    odometry = {0.0, 0.0} :: {float(), float()},
    asks_odometry = false :: boolean()
}).

-opaque t() :: #driver{}.

-define(FLUSH, 34).
-define(START_MS, 120).
-define(FRAMES_MS, 500).
-define(FRAMES, 4).
-define(ASK_MS, 150).
-define(AGAIN_MS, 2500).
-define(REOPEN_MS, 1000).
-define(MODE_MS, 300).
-define(LATER_MS, 1000).
-define(SILENCE_MS, 150).
-define(DOUBT_MS, 100).
-define(ODOMETRY_MS, 200).
%% The time that a robot takes to come to rest.
-define(REST_MS, 50).
-define(PULSE_MS, 200).
%% Frames of the same command before a wheel that stands counts as stalled; the slowest speed at
%% which each frame must show a count.
-define(STEADY, 4).
-define(SEEN_SPEED, 90).
-define(LOW_BATTERY, 0.15).

%% @doc The table of what can be chosen, as of a fleet file.
-spec options() -> [starl_options:option()].
options() ->
    [
        {model, {integer, 1, 2}, 2, "the generation: 1 (Create, 2006) or 2 (Create 2, Roomba 600)"},
        {baud, {optional, {integer, 300, 115200}}, none, "of its line; none: as it is delivered"},
        {mode, {one_of, [safe, full]}, safe, "safe: it stops at cliffs and when it is lifted"},
        {wake, {one_of, [rts, dtr, none]}, rts, "the line of the adapter that is wired to BRC"},
        {on_robot, switch, true, "a Create 1 stops by itself when its computer is gone"}
    ].

%% @doc A driver that opens its port.
-spec open(options()) -> {[action()], t()}.
open(#{model := Model} = Options) ->
    Driver = #driver{
        options = Options, model = Model, parser = starl_create_stream:new(ids(Model), Model)
    },
    {[{port, opening(Driver)}], Driver}.

opening(#driver{options = #{device := Device} = Options, model = Model, tried = none}) ->
    {open, Device, baud(Options, Model)};
opening(#driver{options = #{device := Device}, tried = Baud}) ->
    {open, Device, Baud}.

baud(#{baud := Baud}, _Model) when is_integer(Baud) -> Baud;
baud(_, 1) -> 57600;
baud(_, 2) -> 115200.

%% The sensors of the stream. The Create 1's distance and angle are asked for more rarely: their
%% fractions are lost with each reading.
ids(1) -> [7, 9, 10, 11, 12, 14, 18, 25, 26, 34, 35, 41, 42];
ids(2) -> ids(1) ++ [43, 44].

%% @doc Does it have control of its robot?
-spec is_ready(t()) -> boolean().
is_ready(#driver{phase = Phase}) -> Phase =:= ready.

%% @doc What the sensors have shown last.
-spec readings(t()) -> starl_create_packet:readings().
readings(#driver{readings = Readings}) -> Readings.

%% @doc The way (mm) and the turn (rad) since it was opened, as the robot counts them. A Create 1
%% knows its turns to a degree each 0.2 s only.
-spec odometry(t()) -> {Mm :: float(), Radians :: float()}.
odometry(#driver{odometry = Odometry}) -> Odometry.

%% -- commands -------------------------------------------------------------------------------

%% @doc Has a script carried out in place of the present one. A robot that is not under control does
%% not hear it.
-spec drive(starl_chassis_differential:commands(), Mark :: term(), t()) -> {[action()], t()}.
drive(_Commands, _Mark, #driver{phase = Phase} = Driver) when Phase =/= ready ->
    {[], Driver#driver{script = none}};
drive(Commands, Mark, #driver{ref = Ref} = Driver) ->
    Way = way(Driver),
    Steps = starl_create_script:steps(Commands, Way),
    Written = [{Bytes, Us} || {_, Bytes, Us} <- Steps],
    Word = {drive_script, Ref + 1, Written, starl_create_script:rest(Way)},
    Script = #script{mark = Mark, ref = Ref + 1, steps = Steps},
    {[{port, Word}], Driver#driver{ref = Ref + 1, script = Script}}.

way(#driver{model = 1, options = Options}) ->
    case maps:get(on_robot, Options, true) of
        true -> on_robot;
        false -> by_port
    end;
way(_) ->
    by_port.

%% @doc Sets the pen. The robot cannot confirm its outputs, so the answer comes as soon as it is
%% known to listen.
-spec actuate(Device :: atom(), Value :: term(), {mark, term()} | none, t()) -> {[action()], t()}.
actuate(pen, Value, Mark, #driver{phase = ready} = Driver) when Value =:= up; Value =:= down ->
    Answer = [{answer, M, {actuated, pen, Value}} || {mark, M} <- [Mark]],
    Next = Driver#driver{pen = Value},
    {[{port, {send, pen(Next)}} | Answer], Next};
actuate(_Device, _Value, _Mark, Driver) ->
    {[], Driver}.

pen(#driver{options = Options, model = Model, pen = Value}) ->
    Pen = maps:get(pen, Options, usual_pen(Model)),
    pen_bytes(Value, Pen, Model).

%% @doc The pen, if nothing else is said: the first digital output of a Create 1, the first light
%% (Debris) of a Create 2.
-spec usual_pen(starl_create_packet:model()) -> {outputs | leds, 0}.
usual_pen(1) -> {outputs, 0};
usual_pen(2) -> {leds, 0}.

pen_bytes(Value, {leds, N}, Model) -> encode({leds, bit(Value, N), 0, 255}, Model);
pen_bytes(Value, {outputs, N}, Model) -> encode({outputs, bit(Value, N)}, Model);
pen_bytes(Value, {motors, N}, Model) -> encode({motors, bit(Value, N)}, Model).

bit(up, _N) -> 0;
bit(down, N) -> 1 bsl N.

encode(Command, Model) -> starl_create_command:encode(Command, Model).

%% @doc Everything comes to rest.
-spec stop(t()) -> {[action()], t()}.
stop(#driver{phase = closed} = Driver) ->
    {[], Driver#driver{script = none}};
stop(#driver{ref = Ref} = Driver0) ->
    Driver = Driver0#driver{pen = up, script = none, ref = Ref + 1},
    {[{port, {drive_script, Ref + 1, [], resting(Driver)}}], Driver}.

%% What ends everything: wheels that stand, and the pen up.
resting(#driver{} = Driver) ->
    Up = pen(Driver#driver{pen = up}),
    <<(starl_create_script:rest(way(Driver)))/binary, Up/binary>>.

%% @doc The last words: the robot stands, and goes to rest.
-spec close(t()) -> [action()].
close(#driver{phase = closed}) ->
    [{port, close}];
close(#driver{model = Model} = Driver) ->
    Off = <<(encode({stream_on, 0}, Model))/binary, (encode(start, Model))/binary>>,
    [{port, {send, <<(resting(Driver))/binary, Off/binary>>}}, {port, close}].

%% -- messages of the port, and time-outs ----------------------------------------------------

%% @doc Handles a message.
-spec hear(message(), NowUs :: integer(), t()) -> {[action()], t()}.
hear({opened, _Device}, _Now, Driver) ->
    greet(Driver);
hear({data, Bytes}, _Now, #driver{parser = Parser} = Driver) ->
    {Found, Next} = starl_create_stream:parse(Bytes, Parser),
    all(fun found/2, Found, Driver#driver{parser = Next});
hear({sent, Ref, At}, _Now, #driver{script = #script{ref = Ref} = Script} = Driver) ->
    Heard = first(Script#script.heard, At),
    {[], Driver#driver{script = Script#script{heard = Heard}}};
hear({ended, Ref, At}, _Now, #driver{script = #script{ref = Ref} = Script} = Driver) ->
    Heard = first(Script#script.heard, At),
    Ended = Script#script{heard = Heard, has_ended = true},
    {[{timer, rest, ?REST_MS}], Driver#driver{script = Ended}};
hear({Word, _Ref, _At}, _Now, Driver) when Word =:= sent; Word =:= ended ->
    {[], Driver};
hear({stopped, _Why, _At}, _Now, Driver) ->
    {[], Driver#driver{script = none}};
hear({closed, Reason}, _Now, Driver) ->
    {Said, Next} = say(warning, gone, gone(Reason), Driver),
    {Lost, Closed} = lose(closed, Next),
    {Said ++ Lost, Closed#driver{tries = 0}};
%% A line that could not be opened is tried again.
hear({error, Reason}, _Now, #driver{phase = closed} = Driver) ->
    {Said, Next} = say(warning, gone, no_line(Reason), Driver),
    {Said ++ [{timer, step, ?REOPEN_MS}], Next};
hear({error, Reason}, _Now, Driver) ->
    say(warning, {error, Reason}, no_line(Reason), Driver);
hear({timeout, Timer}, _Now, Driver) ->
    due(Timer, Driver).

first(none, At) -> At;
first(Heard, _At) -> Heard.

all(Fun, Items, Driver) ->
    {Actions, Next} = lists:mapfoldl(Fun, Driver, Items),
    {lists:append(Actions), Next}.

%% It is said once, until things are well again.
say(_Level, What, _Line, #driver{said = What} = Driver) -> {[], Driver};
say(Level, What, Line, Driver) -> {[{say, Level, Line}], Driver#driver{said = What}}.

lose(Phase, #driver{phase = ready} = Driver) ->
    {[{event, lost}], Driver#driver{phase = Phase, script = none}};
lose(Phase, Driver) ->
    {[], Driver#driver{phase = Phase, script = none}}.

%% -- greeting -------------------------------------------------------------------------------

greet(#driver{model = Model} = Driver) ->
    Flush = binary:copy(encode(start, Model), ?FLUSH),
    Fresh = Driver#driver{
        phase = greeting,
        frames = 0,
        is_silent = false,
        noise = <<>>,
        is_other_model = false,
        asks_odometry = false,
        readings = #{},
        steady = {0, 0},
        parser = starl_create_stream:new(ids(Model), Model)
    },
    Words = [{stop_bytes, resting(Driver)}, {send, Flush}],
    {[{port, Word} || Word <- Words] ++ [{timer, step, ?START_MS}], Fresh}.

%% The robot has started.
due(step, #driver{phase = greeting, frames = 0, model = Model} = Driver) ->
    Probe = [{query, [43]} || Model =:= 1],
    Ask = starl_create_command:encode_all(Probe ++ [{stream, ids(Model)}], Model),
    {[{port, {send, Ask}}, {timer, step, ?FRAMES_MS}], Driver#driver{phase = asking, noise = <<>>}};
%% No frame has come: the mode alone is a question that each robot answers with one byte.
due(step, #driver{phase = asking, frames = 0, model = Model} = Driver) ->
    Ask = encode({sensors, 35}, Model),
    {[{port, {send, Ask}}, {timer, step, ?ASK_MS}], Driver#driver{frames = -1, noise = <<>>}};
%% At another baud rate only the answer to that question counts.
due(step, #driver{phase = asking, tried = Baud, noise = <<_>>} = Driver) when is_integer(Baud) ->
    {Said, Next} = say(warning, baud, other_baud(Baud), Driver#driver{tried = none, tries = 0}),
    {Said ++ [{timer, step, ?AGAIN_MS}], Next#driver{phase = greeting, frames = -1}};
due(step, #driver{phase = asking, noise = <<>>} = Driver) ->
    silent(Driver);
due(step, #driver{phase = asking, tries = N} = Driver) ->
    {Said, Next} = diagnosed(Driver#driver{tried = none}),
    {Said ++ [{timer, step, ?AGAIN_MS}], Next#driver{phase = greeting, frames = -1, tries = N + 1}};
due(step, #driver{phase = greeting, frames = -1} = Driver) ->
    {[{port, opening(Driver)}], Driver#driver{frames = 0}};
due(step, #driver{phase = greeting} = Driver) ->
    greet(Driver);
due(step, #driver{phase = closed} = Driver) ->
    {[{port, opening(Driver)}], Driver};
due(step, #driver{phase = taking} = Driver) ->
    {Said, Next} = say(warning, no_control, no_control(Driver), Driver),
    {Taken, Taking} = take(?LATER_MS, Next),
    {Said ++ Taken, Taking};
due(step, Driver) ->
    {[], Driver};
%% If the computer itself stood still, the frames are there in a moment.
due(silence, #driver{is_silent = false} = Driver) ->
    {[{timer, silence, ?DOUBT_MS}], Driver#driver{is_silent = true}};
due(silence, #driver{phase = Phase} = Driver) when Phase =:= ready; Phase =:= taking ->
    {Said, Next} = say(warning, silence, "the robot has fallen silent: greeting it anew", Driver),
    {Lost, Silent} = lose(greeting, Next),
    {Stop, Stopped} = stop(Silent#driver{tries = 0}),
    {Greeting, Greeted} = greet(Stopped),
    {Said ++ Lost ++ Stop ++ Greeting, Greeted};
due(silence, Driver) ->
    {[], Driver};
due(rest, #driver{script = #script{has_ended = true} = Script} = Driver) ->
    rested(Driver#driver{script = Script#script{may_rest = true}});
due(rest, Driver) ->
    {[], Driver};
due(odometry, #driver{model = 1, phase = Phase} = Driver) when
    Phase =:= ready; Phase =:= taking
->
    Ask = encode({query, [19, 20]}, 1),
    Next = Driver#driver{asks_odometry = true},
    {[{port, {send, Ask}}, {timer, odometry, ?ODOMETRY_MS}], Next};
due(odometry, Driver) ->
    {[], Driver}.

%% A silent robot is woken, greeted again, and looked for at the other baud rates.
silent(#driver{tries = 0, options = Options} = Driver) ->
    Pulse = [
        {port, {pulse, Line, ?PULSE_MS, 1}}
     || Line <- [maps:get(wake, Options, rts)], Line =/= none
    ],
    Next = Driver#driver{phase = greeting, frames = -1, tries = 1},
    {Pulse ++ [{timer, step, ?AGAIN_MS}], Next};
silent(#driver{tries = N, options = Options, model = Model} = Driver) ->
    case lists:nthtail(N - 1, lists:delete(baud(Options, Model), [57600, 115200, 19200])) of
        [Other | _] ->
            Next = Driver#driver{phase = greeting, frames = -1, tries = N + 1, tried = Other},
            {[{timer, step, ?START_MS}], Next};
        [] ->
            Line = asleep(Driver, integer_to_list(baud(Options, Model))),
            {Said, Next} = say(warning, asleep, Line, Driver),
            Again = Next#driver{phase = greeting, frames = -1, tries = 0, tried = none},
            {Said ++ [{timer, step, ?AGAIN_MS}], Again}
    end.

other_baud(Baud) ->
    ["the robot answers at ", integer_to_list(Baud), " baud: set its baud rate to that"].

diagnosed(#driver{noise = <<_>>, model = Model} = Driver) ->
    Line = [
        "a robot answers, but does not know the sensors of a Create ",
        integer_to_list(Model),
        ": set its model to ",
        integer_to_list(3 - Model)
    ],
    say(warning, model, Line, Driver);
diagnosed(#driver{options = Options, model = Model} = Driver) ->
    Line = [
        "bytes come that are no sensor frames at ",
        integer_to_list(baud(Options, Model)),
        " baud: set its baud rate (a Create 1 has 57600, a Create 2 115200; 19200 if it "
        "was started that way), or take its battery out and put it back"
    ],
    say(warning, baud, Line, Driver).

asleep(#driver{options = Options}, Baud) ->
    case maps:get(wake, Options, rts) of
        none ->
            [
                "the robot does not answer at ",
                Baud,
                " baud: switch it on (it may be asleep), or "
                "look at its cable and baud rate"
            ];
        Line ->
            [
                "the robot does not answer at ",
                Baud,
                " baud, and ",
                atom_to_list(Line),
                " does not wake it: switch it on, or look at its cable, the wire to BRC, and its "
                "baud rate"
            ]
    end.

gone(Reason) ->
    io_lib:format("the line to the robot is gone (~ts): it is opened again when it is back", [
        reason(Reason)
    ]).

no_line(Reason) -> ["the line to the robot: ", reason(Reason)].

reason({_, Text}) when is_list(Text); is_binary(Text) -> Text;
reason(Reason) -> io_lib:format("~0tp", [Reason]).

%% -- what the robot sends -------------------------------------------------------------------

found({noise, Bytes}, #driver{noise = Noise} = Driver) when byte_size(Noise) < 100 ->
    asked(Bytes, Driver#driver{noise = <<Noise/binary, Bytes/binary>>});
found({noise, Bytes}, Driver) ->
    asked(Bytes, Driver);
found({frame, Readings}, #driver{phase = Phase, frames = N} = Driver) when Phase =:= asking ->
    framed(max(N, 0) + 1, Driver#driver{readings = Readings});
found({frame, Readings}, #driver{phase = Phase} = Driver) when Phase =:= ready; Phase =:= taking ->
    sensed(Readings, Driver);
found({frame, _Readings}, Driver) ->
    {[], Driver}.

%% The answer of a Create 1 to the question for its distance and angle.
asked(<<Mm:16/signed, Degrees:16/signed>>, #driver{asks_odometry = true} = Driver) ->
    #driver{odometry = {Way, Turn}} = Driver,
    Odometry = {Way + Mm, Turn + Degrees * 3.141592653589793 / 180},
    {[], Driver#driver{odometry = Odometry, asks_odometry = false}};
asked(_Bytes, Driver) ->
    {[], Driver}.

%% Frames at another baud rate than that of the options.
framed(_N, #driver{tried = Baud} = Driver) when is_integer(Baud) ->
    {Said, Next} = say(warning, baud, other_baud(Baud), Driver),
    Off = encode({stream_on, 0}, Driver#driver.model),
    Again = [{port, {send, Off}}, {timer, step, ?AGAIN_MS}],
    {Said ++ Again, Next#driver{phase = greeting, frames = -1, tries = 0, tried = none}};
%% A Create 2 has answered the question for an encoder, among the first bytes.
framed(_N, #driver{model = 1, noise = <<_:16>>, tries = Tries} = Driver) ->
    Line = "the robot is a Create 2: set its model to 2",
    {Said, Next} = say(warning, model, Line, Driver),
    Off = encode({stream_on, 0}, 1),
    Other = Next#driver{phase = greeting, frames = -1, tries = Tries + 1, tried = none},
    {Said ++ [{port, {send, Off}}, {timer, step, ?AGAIN_MS}], Other};
framed(N, Driver) when N < ?FRAMES ->
    {[], Driver#driver{frames = N}};
framed(N, #driver{readings = #{mode := Mode}} = Driver) ->
    {Taken, Taking} = take(?MODE_MS, Driver#driver{frames = N, offset = Mode - 1}),
    Odometry = [{timer, odometry, ?ODOMETRY_MS} || Driver#driver.model =:= 1],
    {Taken ++ Odometry ++ [{timer, silence, ?SILENCE_MS}], Taking}.

%% -- control --------------------------------------------------------------------------------

take(Ms, #driver{model = Model, options = Options} = Driver) ->
    Mode = encode(maps:get(mode, Options, safe), Model),
    Script =
        case way(Driver) of
            on_robot -> starl_create_script:on_robot();
            by_port -> <<>>
        end,
    Send = {port, {send, <<Mode/binary, Script/binary>>}},
    {[Send, {timer, step, Ms}], Driver#driver{phase = taking}}.

no_control(#driver{readings = Readings}) ->
    [
        "the robot does not come under control: ",
        case Readings of
            #{charging_sources := Sources} when Sources =/= 0 -> "take it off its charger or dock";
            #{bumps_drops := Bits} when Bits band 2#11100 =/= 0 -> "put it on its wheels";
            _ -> "look at its cliff sensors, or start it anew"
        end
    ].

%% The mode as the document counts it.
mode(#{mode := Mode}, #driver{offset = Offset}) -> Mode - Offset.

is_wanted(Mode, #driver{options = Options}) ->
    case maps:get(mode, Options, safe) of
        safe -> Mode =:= 2 orelse Mode =:= 3;
        full -> Mode =:= 3
    end.

sensed(Readings, #driver{readings = Before, phase = Phase} = Driver0) ->
    Driver1 = Driver0#driver{readings = Readings, is_silent = false},
    Events = [{event, E} || Phase =:= ready, E <- events(Before, Readings)],
    Driver = counted(Before, Readings, steady(Before, Readings, Driver1)),
    {Actions, Next} =
        case {is_wanted(mode(Readings, Driver), Driver), Phase} of
            {true, taking} -> ready(Driver);
            {true, ready} -> watched(Before, Readings, Driver);
            {false, taking} -> {[], Driver};
            {false, ready} -> left(Readings, Driver)
        end,
    {[{timer, silence, ?SILENCE_MS} | Events] ++ Actions, Next}.

ready(#driver{said = Said} = Driver) ->
    Word = [{say, notice, "the robot is under control again"} || Said =/= none],
    {Stop, Stopped} = stop(Driver),
    {Word ++ Stop ++ [{event, ready}], Stopped#driver{phase = ready, said = none, tries = 0}}.

%% It has left the mode by itself.
left(Readings, Driver) ->
    {Said, Next} = say(warning, left, ["the robot has stopped by itself: ", why(Readings)], Driver),
    {Lost, Left} = lose(taking, Next),
    {Stop, Stopped} = stop(Left),
    {Taken, Taking} = take(?LATER_MS, Stopped),
    {Said ++ Lost ++ Stop ++ Taken, Taking}.

why(#{bumps_drops := Bits}) when Bits band 2#11100 =/= 0 -> "a wheel hangs down";
why(#{charging_sources := Sources}) when Sources =/= 0 -> "it is on its charger";
why(Readings) ->
    case cliffs(Readings) of
        [] -> "it was started anew, or a button was pressed";
        _ -> "it stands at a cliff"
    end.

%% -- sensors --------------------------------------------------------------------------------

events(Before, Now) ->
    Kinds = [
        fun(#{bumps_drops := Bits}) -> {bump, bump(Bits band 3)} end,
        fun(#{bumps_drops := Bits}) -> {drop, Bits bsr 2} end,
        fun(Readings) -> {cliff, cliffs(Readings)} end,
        fun(#{buttons := Bits}) -> {buttons, Bits} end,
        fun(#{charging_sources := Bits}) -> {docked, Bits =/= 0} end,
        fun(Readings) -> {battery, battery(Readings)} end
    ],
    [Kind(Now) || Kind <- Kinds, Kind(Before) =/= Kind(Now)].

bump(0) -> none;
bump(1) -> right;
bump(2) -> left;
bump(3) -> both.

cliffs(Readings) ->
    [
        Where
     || {Name, Where} <- [
            {cliff_left, left},
            {cliff_front_left, front_left},
            {cliff_front_right, front_right},
            {cliff_right, right}
        ],
        maps:get(Name, Readings) =/= 0
    ].

battery(#{charge := Charge, capacity := Capacity}) when Charge < ?LOW_BATTERY * Capacity -> low;
battery(_) -> ok.

%% For how many frames each wheel has had its command.
steady(Before, Now, #driver{steady = {Left, Right}} = Driver) ->
    Driver#driver{
        steady = {same(left_velocity, Before, Now, Left), same(right_velocity, Before, Now, Right)}
    }.

same(Name, Before, Now, N) ->
    case {Before, Now} of
        {#{Name := V}, #{Name := V}} -> N + 1;
        _ -> 0
    end.

counted(Before, #{left_encoder := _} = Now, #driver{odometry = {Way, Turn}} = Driver) ->
    Mm = starl_create_wheels:mm_per_count(),
    Left = Mm * counts(left_encoder, Before, Now),
    Right = Mm * counts(right_encoder, Before, Now),
    Axle = starl_create_wheels:axle_mm(2),
    Driver#driver{odometry = {Way + (Left + Right) / 2, Turn + (Right - Left) / Axle}};
counted(_Before, _Now, Driver) ->
    Driver.

%% An encoder wraps at 65536, forwards and backwards.
counts(Name, Before, Now) ->
    case {Before, Now} of
        {#{Name := Old}, #{Name := New}} -> ((New - Old + 32768) band 16#FFFF) - 32768;
        _ -> 0
    end.

watched(_Before, _Now, #driver{script = none} = Driver) ->
    {[], Driver};
watched(_Before, _Now, #driver{script = #script{may_rest = true}} = Driver) ->
    rested(Driver);
watched(Before, Now, #driver{script = #script{mark = Mark} = Script} = Driver) ->
    case is_stalled(Before, Now, Driver) of
        false ->
            {[], Driver};
        true ->
            Told = told(Script, Now),
            {Stop, Stopped} = hold(Driver),
            {Stop ++ [{answer, Mark, {stalled, Told}}], Stopped}
    end.

%% A script is over when the robot says that it stands: the line may be slow.
rested(#driver{readings = #{left_velocity := 0, right_velocity := 0}} = Driver) ->
    #driver{script = #script{mark = Mark, heard = Heard}} = Driver,
    {[{answer, Mark, {driven, Heard}}], Driver#driver{script = none}};
rested(Driver) ->
    {[], Driver}.

%% The pen stays as it is.
hold(#driver{ref = Ref} = Driver) ->
    Word = {drive_script, Ref + 1, [], starl_create_script:rest(way(Driver))},
    {[{port, Word}], Driver#driver{ref = Ref + 1, script = none}}.

is_stalled(Before, Now, #driver{steady = {Left, Right}, options = Options}) ->
    #{overcurrents := Over} = Now,
    Over band 2#11000 =/= 0 orelse
        (maps:get(stops_at_bumps, Options, true) andalso is_bump(Before, Now)) orelse
        stands({left_velocity, left_encoder}, Left, Before, Now) orelse
        stands({right_velocity, right_encoder}, Right, Before, Now).

%% A new bump, that is: a robot that touches something can drive away from it.
is_bump(#{bumps_drops := Old}, #{bumps_drops := New}) -> (New band 3) band (bnot Old) =/= 0.

stands({Velocity, Encoder}, Steady, Before, Now) when Steady >= ?STEADY ->
    case Now of
        #{Velocity := V, Encoder := _} when abs(V) >= ?SEEN_SPEED ->
            counts(Encoder, Before, Now) =:= 0;
        _ ->
            false
    end;
stands(_, _, _, _) ->
    false.

%% The command that the robot was carrying out: its speeds tell.
told(#script{steps = []}, _Now) ->
    {0.0, 0.0};
told(#script{steps = Steps}, #{left_velocity := L, right_velocity := R}) ->
    Same = [Told || {{TL, TR} = Told, _, _} <- Steps, sign(TL) =:= sign(L), sign(TR) =:= sign(R)],
    case Same of
        [First | _] -> First;
        [] -> element(1, hd(Steps))
    end.

sign(X) when X > 0 -> 1;
sign(X) when X < 0 -> -1;
sign(_) -> 0.
