%% @doc The table of the options of a Create's driver.
-module(starl_create_options).

-export([configured/1, baud/1, waits/1, odometry/1, drive/1, format_error/1]).

-export_type([t/0, factors/0, reason/0]).

%% `device': what the port opens. `baud': that of the robot (default: as it is delivered). `mode':
%% safe, in which the robot stops by itself at a cliff and when it is lifted, or full. `wake': the
%% line of the port that is wired to BRC. `on_robot': scripts of a Create 1 on the robot; `short_waits':
%% with waits of 15 ms, which the doctor has measured ({@link starl_create_script}). `jitter_ms' (20): how late bytes may be on the line. `distance' and `angle': the true way and turn by what the
%% odometry says; `drive' and `turn': by what was commanded, as a tape has shown.
-type t() :: #{
    device := term(),
    model := starl_create_packet:model(),
    baud => pos_integer() | none,
    mode => safe | full,
    wake => dtr | rts | none,
    on_robot => boolean(),
    short_waits => boolean(),
    jitter_ms => pos_integer(),
    pen => starl_create_instructions:pen(),
    stops_at_bumps => boolean(),
    distance => number(),
    angle => number(),
    drive => number(),
    turn => number()
}.

%% For straight ways, and for turns.
-type factors() :: {Straight :: number(), Turn :: number()}.

-type reason() ::
    {no_profile, file:filename(), term()}
    | {no_map, file:filename()}
    | {options, [unicode:chardata()]}.

%% What a profile says of the robot; the driver needs no more of it.
-define(MEASURED, [distance, angle, drive, turn]).

%% The table of what can be chosen, as of a fleet file.
-spec options() -> [starl_options:option()].
options() ->
    [
        {model, {integer, 1, 2}, 2, "the generation: 1 (Create, 2006) or 2 (Create 2, Roomba 600)"},
        {baud, {optional, {integer, 300, 115200}}, none, "of its line; none: as it is delivered"},
        {mode, {one_of, [safe, full]}, safe, "safe: it stops at cliffs and when it is lifted"},
        {wake, {one_of, [rts, dtr, none]}, rts, "the line of the adapter that is wired to BRC"},
        {on_robot, switch, true, "a Create 1 stops by itself when its computer is gone"},
        {short_waits, switch, false, "as in a profile: a Create 1 stops sooner"},
        {jitter_ms, {integer, 1, 40}, 20,
            "how late bytes may be on its line; less lets it drive faster"},
        {profile, {optional, file}, none, "of ./starl create doctor --calibrate --profile FILE"}
        | [
            {Factor, {number, 0.5, 2}, 1.0, "as in a profile"}
         || Factor <- ?MEASURED
        ]
    ].

%% @doc The options of a robot's driver, as of a fleet file: with those of its profile, a file on the
%% robot's own computer. What is said beside the profile counts.
-spec configured(#{atom() => term()}) -> {ok, t()} | {error, reason()}.
configured(#{profile := File} = Given) when File =/= none ->
    case file:consult(File) of
        {ok, [#{} = Profile]} -> checked(maps:merge(Profile, maps:remove(profile, Given)));
        {ok, _} -> {error, {no_map, File}};
        {error, Why} -> {error, {no_profile, File, Why}}
    end;
configured(Given) ->
    checked(maps:remove(profile, Given)).

checked(Given) ->
    Known = [Key || {Key, _, _, _} <- options()] ++ [device, pen, stops_at_bumps],
    Unknown = [io_lib:format("~p is no option of a Create", [K]) || K <- maps:keys(Given) -- Known],
    Missing = [
        io_lib:format("~p must be said, here or in a profile", [Key])
     || Key <- [device, model], not is_map_key(Key, Given)
    ],
    case Unknown ++ Missing of
        [] -> {ok, Given};
        Problems -> {error, {options, Problems}}
    end.

%% @doc The true way and turn by what the odometry says.
-spec odometry(t()) -> factors().
odometry(Options) -> {maps:get(distance, Options, 1.0), maps:get(angle, Options, 1.0)}.

%% @doc The true way and turn by what was commanded.
-spec drive(t()) -> factors().
drive(Options) -> {maps:get(drive, Options, 1.0), maps:get(turn, Options, 1.0)}.

%% @doc What is wrong, in a line.
-spec format_error(reason()) -> unicode:chardata().
format_error({no_profile, File, Why}) ->
    [File, ": ", file:format_error(Why)];
format_error({no_map, File}) ->
    [File, ": no profile; ./starl create doctor --profile FILE writes one"];
format_error({options, Problems}) ->
    lists:join("; ", Problems).

%% @doc The waits of a Create 1.
-spec waits(t()) -> starl_create_script:waits().
waits(#{short_waits := true}) -> short;
waits(#{}) -> long.

%% @doc The baud rate of the robot's line.
-spec baud(t()) -> pos_integer().
baud(#{baud := Baud}) when is_integer(Baud) -> Baud;
baud(#{model := 1}) -> 57600;
baud(#{model := 2}) -> 115200.
