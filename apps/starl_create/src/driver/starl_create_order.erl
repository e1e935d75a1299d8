%% @doc What the driver tells a Create, as bytes: to come under control, to rest, to go off, to set the
%% pen.
-module(starl_create_order).

-export([is_on_robot/1, take/1, is_taken/2, resting/1, resting/2, off/1, pen/2, usual_pen/1]).

-export_type([pen/0, position/0]).

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

%% @doc Sets the pen.
-spec pen(position(), starl_create_options:t()) -> binary().
pen(Position, #{model := Model} = Options) ->
    encode(pen_command(Position, maps:get(pen, Options, usual_pen(Model))), Options).

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
