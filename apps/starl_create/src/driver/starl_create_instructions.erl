%% @doc The commands of the driver to a Create, as bytes: take control, stop everything, leave the
%% robot to itself, set the pen.
-module(starl_create_instructions).

-export([is_on_robot/1, take/1, is_taken/2, resting/1, resting/2, off/1, pen/2, usual_pen/1]).
-export([passive/1, seek_dock/1, leave_dock/1, signal/4]).

-export_type([pen/0, position/0]).

%% From the dock, mm/s.
-define(LEAVE_SPEED, 100).
-define(LEAVE_US, 3000000).

%% Which output is the pen, and the number of its bit.
-type pen() :: {leds | outputs | motors, 0..7}.

-type position() :: up | down.

%% @doc Does a Create 1 time the commands of a script by itself?
-spec is_on_robot(starl_create_options:t()) -> boolean().
is_on_robot(#{model := Model} = Options) -> Model =:= 1 andalso maps:get(on_robot, Options, true).

%% @doc Takes control.
-spec take(starl_create_options:t()) -> binary().
take(Options) -> encode(wanted(Options), Options).

wanted(Options) -> maps:get(mode, Options, safe).

%% @doc Is control taken, by the mode as the document counts it?
-spec is_taken(Mode :: integer(), starl_create_options:t()) -> boolean().
is_taken(Mode, Options) ->
    case wanted(Options) of
        safe -> Mode =:= 2 orelse Mode =:= 3;
        full -> Mode =:= 3
    end.

%% @doc What ends everything: the wheels stand, and the pen is up, or as it is said.
-spec resting(starl_create_options:t()) -> binary().
resting(Options) -> resting(up, Options).

-spec resting(position(), starl_create_options:t()) -> binary().
resting(Pen, Options) -> <<(starl_create_script:rest())/binary, (pen(Pen, Options))/binary>>.

%% @doc The last words: everything rests, and the robot is left to itself.
-spec off(starl_create_options:t()) -> binary().
off(Options) -> iolist_to_binary([resting(Options) | [encode(C, Options) || C <- off()]]).

off() -> [{stream_on, 0}, start].

%% @doc It is left to itself, under its own care: it may sleep, and charge.
-spec passive(starl_create_options:t()) -> binary().
passive(Options) -> encode(start, Options).

%% @doc It looks for its dock by itself.
-spec seek_dock(starl_create_options:t()) -> binary().
seek_dock(Options) -> encode(dock, Options).

%% @doc It drives backwards off its dock. Mode Safe does not hold while it charges, so for this way it is in
%% mode Full, which sees no cliff: the bytes, the time, and the bytes that end it.
-spec leave_dock(starl_create_options:t()) -> {binary(), Us :: pos_integer(), binary()}.
leave_dock(Options) ->
    Back = {drive_direct, -?LEAVE_SPEED, -?LEAVE_SPEED},
    Begin = <<(encode(full, Options))/binary, (encode(Back, Options))/binary>>,
    {Begin, ?LEAVE_US, <<(starl_create_script:rest())/binary, (take(Options))/binary>>}.

%% @doc Lights, as `{Bits, Colour, Intensity}', or a song, a list of notes `{Note, Duration}' as the Open
%% Interface numbers them, which is played at once. A light that is the pen stays as the pen is. `none': no
%% signal of a Create.
-spec signal(Device :: atom(), Value :: term(), position(), starl_create_options:t()) ->
    {ok, binary()} | none.
signal(lights, {Bits, Colour, Intensity}, Pen, Options) when is_integer(Bits) ->
    commands([{leds, with_pen(Bits, Pen, pen_of(Options)), Colour, Intensity}], Options);
signal(song, Notes, _Pen, Options) ->
    commands([{song, 0, Notes}, {play, 0}], Options);
signal(_Device, _Value, _Pen, _Options) ->
    none.

with_pen(Bits, Pen, {leds, N}) -> (Bits band bnot (1 bsl N)) bor bit(Pen, N);
with_pen(Bits, _Pen, _Other) -> Bits.

%% What an application says may be out of range.
commands(Commands, #{model := Model} = Options) ->
    case
        [
            Wrong
         || Command <- Commands, {error, _} = Wrong <- [starl_create_command:check(Command, Model)]
        ]
    of
        [] -> {ok, <<<<(encode(Command, Options))/binary>> || Command <- Commands>>};
        _ -> none
    end.

%% @doc Sets the pen.
-spec pen(position(), starl_create_options:t()) -> binary().
pen(Position, Options) -> encode(pen_command(Position, pen_of(Options)), Options).

pen_of(#{model := Model} = Options) -> maps:get(pen, Options, usual_pen(Model)).

pen_command(Position, {leds, N}) -> {leds, bit(Position, N), 0, 255};
pen_command(Position, {outputs, N}) -> {outputs, bit(Position, N)};
pen_command(Position, {motors, N}) -> {motors, bit(Position, N)}.

bit(up, _N) -> 0;
bit(down, N) -> 1 bsl N.

%% @doc The pen, if nothing else is said: the first digital output of a Create 1, the first light
%% (Debris) of a Create 2.
-spec usual_pen(starl_create_packet:model()) -> {outputs | leds, 0}.
usual_pen(1) -> {outputs, 0};
usual_pen(2) -> {leds, 0}.

encode(Command, #{model := Model}) -> starl_create_command:encode(Command, Model).
