%% @doc What the driver tells a Create, as bytes: to come under control, to rest, to go off, to set the
%% pen.
-module(starl_create_order).

-export([way/1, take/1, is_taken/2, rest/1, resting/1, off/1, pen/2, usual_pen/1]).

-export_type([options/0, pen/0, position/0]).

%% Which output is the pen, and the number of its bit.
-type pen() :: {leds | outputs | motors, 0..7}.

-type position() :: up | down.

%% What it has to know of {@link starl_create_driver:options()}.
-type options() :: #{
    model := starl_create_packet:model(),
    mode => safe | full,
    on_robot => boolean(),
    pen => pen(),
    atom() => term()
}.

%% @doc Who times the commands of a script.
-spec way(options()) -> starl_create_script:way().
way(#{model := 1, on_robot := false}) -> by_port;
way(#{model := 1}) -> on_robot;
way(#{model := 2}) -> by_port.

%% @doc Takes control.
-spec take(options()) -> binary().
take(Options) ->
    Script = [starl_create_script:on_robot() || way(Options) =:= on_robot],
    iolist_to_binary([encode(wanted(Options), Options) | Script]).

wanted(Options) -> maps:get(mode, Options, safe).

%% @doc Is control taken, by the mode as the document counts it?
-spec is_taken(Mode :: integer(), options()) -> boolean().
is_taken(Mode, Options) ->
    case wanted(Options) of
        safe -> Mode =:= 2 orelse Mode =:= 3;
        full -> Mode =:= 3
    end.

%% @doc The wheels stand.
-spec rest(options()) -> binary().
rest(Options) -> starl_create_script:rest(way(Options)).

%% @doc What ends everything: the wheels stand, and the pen is up.
-spec resting(options()) -> binary().
resting(Options) -> <<(rest(Options))/binary, (pen(up, Options))/binary>>.

%% @doc The last words: everything rests, and the robot is left to itself.
-spec off(options()) -> binary().
off(Options) -> iolist_to_binary([resting(Options) | [encode(C, Options) || C <- off()]]).

off() -> [{stream_on, 0}, start].

%% @doc Sets the pen.
-spec pen(position(), options()) -> binary().
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
