%% @doc A driver for a real camera. A program writes pictures to its standard output as binary PPM.
%% The balls in the newest picture are the reading of the sense `camera'.
%%
%% Any program that writes PPM will do; for a camera of Linux
%% ```
%%   ffmpeg -nostdin -loglevel error -f v4l2 -framerate 10 -video_size 320x240 -i /dev/video0 -f image2pipe -c:v ppm -
%% '''
%% `sh' runs the program, in a process of its own. It ends when its pipe is closed: with the robot,
%% or with the whole VM. If the program ends, or writes no pictures, one line reports this, and the
%% program is started again after two seconds. If pictures come faster than they can be processed,
%% the oldest are dropped.
-module(starl_live_camera).
-behaviour(starl_live_sense).

-export([open/1, hear/2, close/1]).
-export([options/1]).

%% After this time a program that has ended is started again, ms.
-define(AGAIN_MS, 2000).

-record(camera, {
    command :: string(),
    options :: starl_live_blobs:options(),
    port = none :: port() | none,
    %% the bytes of a picture that is not whole yet, newest first; how many more it needs
    bytes = [] :: [binary()],
    missing = 1 :: integer(),
    %% what has been said of a program that fails, so that it is said once
    said = none :: term()
}).

%% @doc The options of a camera: its `command', and those of {@link starl_live_blobs:options/0}.
-spec options(map()) -> {ok, string(), starl_live_blobs:options()} | {error, unicode:chardata()}.
options(#{command := [_ | _] = Command} = Config) ->
    Usual = starl_live_blobs:options(),
    Own = maps:merge(Usual, maps:with(maps:keys(Usual), Config)),
    case [Line || Check <- [fun colours/1, fun numbers/1], Line <- Check(Own)] of
        [] -> {ok, Command, Own};
        [Line | _] -> {error, ["camera: ", Line]}
    end;
options(#{}) ->
    {error, "camera: command is the line that starts a program which writes PPM pictures"}.

colours(#{colours := Colours}) when is_map(Colours), map_size(Colours) > 0 ->
    [
        io_lib:format(
            "the colour ~tp is a map such as #{hue => {5, 40}, saturation => 120, value => 40}", [
                Name
            ]
        )
     || {Name, Colour} <- lists:sort(maps:to_list(Colours)), not is_colour(Name, Colour)
    ];
colours(#{}) ->
    ["colours is a map from names to thresholds, as #{orange => #{hue => {5, 40}}}"].

is_colour(Name, #{hue := {From, To}} = Colour) ->
    is_atom(Name) andalso is_hue(From) andalso is_hue(To) andalso
        maps:keys(maps:without([hue, saturation, value], Colour)) =:= [] andalso
        lists:all(
            fun(Key) ->
                V = maps:get(Key, Colour, 0),
                is_integer(V) andalso V >= 0 andalso V =< 255
            end,
            [saturation, value]
        );
is_colour(_Name, _Colour) ->
    false.

is_hue(Hue) -> is_number(Hue) andalso Hue >= 0 andalso Hue =< 360.

numbers(#{field := Field, ball_mm := Ball, most_mm := Most, least_px := Least}) ->
    ["field is the angle of view, rad, between 0 and 3" || not is_within(Field, 0, 3)] ++
        ["ball_mm is the radius of the balls, mm" || not is_within(Ball, 0, 100000)] ++
        [
            "most_mm is the distance up to which balls are seen, mm"
         || not is_within(Most, 0, 1000000)
        ] ++
        ["least_px is a number of pixels" || not (is_integer(Least) andalso Least > 0)].

is_within(Value, Low, High) -> is_number(Value) andalso Value > Low andalso Value < High.

-spec open(starl_live_sense:config()) -> {ok, #camera{}} | {error, unicode:chardata()}.
open(Config) ->
    case options(Config) of
        {ok, Command, Options} -> {ok, started(#camera{command = Command, options = Options})};
        {error, Why} -> {error, Why}
    end.

started(#camera{command = Command} = Camera) ->
    Port = open_port({spawn_executable, "/bin/sh"}, [
        {args, ["-c", Command]}, binary, exit_status, hide
    ]),
    Camera#camera{port = Port, bytes = [], missing = 1}.

-spec hear(term(), #camera{}) ->
    {reading, [map()], #camera{}} | {nothing, #camera{}} | unknown.
hear({Port, {data, Bytes}}, #camera{port = Port, bytes = Before} = Camera) ->
    looked(waiting(Port, Camera#camera{bytes = [Bytes | Before]}));
hear({Port, {exit_status, Status}}, #camera{port = Port} = Camera) ->
    {nothing, failed({ended, Status}, Camera)};
hear({'EXIT', Port, _Reason}, #camera{port = Port}) when is_port(Port) ->
    unknown;
hear(start_again, #camera{port = none} = Camera) ->
    {nothing, started(Camera)};
hear(_Message, _Camera) ->
    unknown.

%% All that waits already: of several pictures only the last counts.
waiting(Port, #camera{bytes = Before} = Camera) ->
    receive
        {Port, {data, Bytes}} -> waiting(Port, Camera#camera{bytes = [Bytes | Before]})
    after 0 -> Camera
    end.

looked(#camera{bytes = Bytes, missing = Missing} = Camera) ->
    case iolist_size(Bytes) < Missing of
        true -> {nothing, Camera};
        false -> last(iolist_to_binary(lists:reverse(Bytes)), none, Camera)
    end.

last(Bytes, Before, #camera{options = Options} = Camera) ->
    case starl_live_ppm:next(Bytes) of
        {ok, Frame, Rest} ->
            last(Rest, Frame, Camera);
        {more, N} when Before =:= none ->
            {nothing, rest(Bytes, N, Camera)};
        {more, N} ->
            {reading, starl_live_blobs:find(Before, Options),
                rest(Bytes, N, Camera#camera{said = none})};
        {error, Why} ->
            {nothing, failed({nonsense, Why}, Camera)}
    end.

rest(Bytes, Missing, Camera) ->
    Camera#camera{bytes = [binary:copy(Bytes)], missing = byte_size(Bytes) + Missing}.

%% A stream that has lost its pictures cannot be taken up in its middle.
failed(What, #camera{port = Port, said = Said, command = Command} = Camera) ->
    ok = closed(Port),
    _ = erlang:send_after(?AGAIN_MS, self(), start_again),
    _ = What =:= Said orelse logger:warning(#{what => camera, why => line(What, Command)}),
    Camera#camera{port = none, bytes = [], missing = 1, said = What}.

line({ended, Status}, Command) ->
    unicode:characters_to_binary(
        io_lib:format("the camera's program ended with status ~b and is started again: ~ts", [
            Status, Command
        ])
    );
line({nonsense, Why}, Command) ->
    unicode:characters_to_binary([
        "the camera's program is started again: ", starl_live_ppm:format_error(Why), ": ", Command
    ]).

-spec close(#camera{}) -> ok.
close(#camera{port = Port}) -> closed(Port).

%% It may have closed itself.
closed(none) ->
    ok;
closed(Port) ->
    try
        true = port_close(Port),
        ok
    catch
        error:badarg -> ok
    end.
