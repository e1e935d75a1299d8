%% An emulated Create in real time: what it tells its body bears the time at which the bytes came,
%% however late this process, the line or the emulator is.
-module(starl_create_emulated_tests).
-include_lib("eunit/include/eunit.hrl").

-behaviour(starl_world_emulator).
-export([lines/2]).

-define(AFTER_MS, 10000).

%% The emulator of another device.
lines(holonomic, here) -> fun(_Robot, _World) -> {?MODULE, #{}} end;
lines(_Name, _Place) -> undefined.

%% Devices of several emulators take part in one run, whichever emulator is listed first.
each_robot_has_the_device_of_its_own_chassis_test_() ->
    [
        fun() ->
            Self = self(),
            World = spawn_link(fun() -> world(Self) end),
            Choice = [create, holonomic, differential],
            Lines = starl_world_emulator:all(Choice, here, Emulators),
            Devices = [Device || Robot <- [1, 2, 3], {Device, _} <- [Lines(Robot, World)]],
            World ! stop,
            ?assertEqual([starl_create_chassis, ?MODULE, starl_world_chassis], Devices)
        end
     || Emulators <- [[?MODULE, starl_create], [starl_create, ?MODULE]]
    ].

nobody_has_a_device_test() ->
    ?assertEqual(undefined, starl_world_emulator:all(mixed, here, [starl_create])),
    ?assertEqual(undefined, starl_world_emulator:all([create, holonomic], here, [])).

%% The test is both the other end of the line and, through a process, the world of the body.
started() ->
    Self = self(),
    World = spawn_link(fun() -> world(Self) end),
    {ok, Create} = starl_create_emulated:start(#{model => 2, body => {starl_world, World, 1}}),
    Create ! {serial, self(), {attach, any}},
    ?assertEqual(off, starl_create_emulated:mode(Create)),
    {Create, World}.

world(Test) ->
    receive
        {'$gen_call', From, {inhabit, 1}} ->
            gen_server:reply(From, ok),
            world(Test);
        {starl_body, 1, _, {at, At, What}} ->
            Test ! {body, At - erlang:time_offset(microsecond), What},
            world(Test);
        {starl_settled, 1, N} ->
            Test ! {settled, N},
            world(Test);
        stop ->
            ok
    end.

says(Commands, At, Create) ->
    Bytes = starl_create_command:encode_all(Commands, 2),
    Create ! {serial, self(), {data, Bytes, At}}.

asks(Create) ->
    receive
        {serial, Create, sync} -> ok
    after ?AFTER_MS -> error(nothing_asked)
    end.

wheels() ->
    receive
        {body, At, {drive, {_, [{Left, Right, _}]}, _, _}} -> {At, Left, Right}
    after ?AFTER_MS -> error(nothing_told)
    end.

%% Bytes that come when a frame of the stream was due long ago still take effect when they came.
bytes_on_the_way_are_waited_for_test() ->
    {Create, World} = started(),
    Begin = erlang:monotonic_time(microsecond),
    says([start, safe, {stream, [7]}, {drive_direct, 100, 100}], Begin, Create),
    ?assertEqual({Begin, 100.0, 100.0}, wheels()),
    asks(Create),
    End = Begin + 1000,
    says([{drive_direct, 0, 0}], End, Create),
    ?assertEqual({End, 0.0, 0.0}, wheels()),
    World ! stop.

%% A look waits for an answer to a question that was asked after it; what came before it is told first.
a_look_waits_for_the_line_test() ->
    {Create, World} = started(),
    Begin = erlang:monotonic_time(microsecond),
    says([start, safe, {stream, [7]}, {drive_direct, 100, 100}], Begin, Create),
    {Begin, 100.0, 100.0} = wheels(),
    asks(Create),
    Create ! {starl_settle, World, 5},
    %% the answer to a question of before
    Create ! {serial, self(), {upto, Begin + 1}},
    asks(Create),
    End = Begin + 2,
    says([{drive_direct, 0, 0}], End, Create),
    Create ! {serial, self(), {upto, erlang:monotonic_time(microsecond)}},
    ?assertEqual({End, 0.0, 0.0}, wheels()),
    receive
        {settled, 5} -> ok
    after ?AFTER_MS -> error(not_settled)
    end,
    World ! stop.

%% No frame leaves before the line has told everything until then; what the body feels waits, too.
nothing_happens_before_the_line_has_told_test() ->
    {Create, World} = started(),
    Begin = erlang:monotonic_time(microsecond),
    says([start, safe, {stream, [7]}], Begin, Create),
    asks(Create),
    ok = starl_create_emulated:feel(Create, {readings, #{bumps_drops => 12}}),
    ?assertEqual(safe, starl_create_emulated:mode(Create)),
    receive
        {serial, Create, {data, _}} -> error(a_frame_too_early)
    after 0 -> ok
    end,
    Create ! {serial, self(), {upto, Begin + 20000}},
    receive
        {serial, Create, {data, _Frame}} -> ok
    after ?AFTER_MS -> error(no_frame)
    end,
    ?assertEqual(passive, starl_create_emulated:mode(Create)),
    World ! stop.

%% Once nobody is there, its time is the present.
time_passes_without_a_line_test() ->
    {Create, World} = started(),
    says([start, safe, {stream, [7]}], erlang:monotonic_time(microsecond), Create),
    asks(Create),
    ok = starl_create_emulated:feel(Create, {readings, #{bumps_drops => 12}}),
    Create ! {serial, self(), detach},
    ?assertEqual(passive, starl_create_emulated:mode(Create)),
    World ! stop.
