%% The driver with an emulated Create in virtual time: quirks, faults, and what it says about them.
-module(starl_create_driver_tests).
-include_lib("eunit/include/eunit.hrl").

-export([start_link/2, log/2]).

-define(S, 1000000).

new(Options) -> starl_create_bench:new(Options).

ready(Options) -> get_ready(10, new(Options)).

get_ready(Seconds, Bench) -> starl_create_bench:until(fun is_ready/1, Seconds * ?S, Bench).

is_ready(Bench) -> starl_create_driver:is_ready(starl_create_bench:driver(Bench)).

mode(Bench) -> starl_create_emulator:mode(starl_create_bench:create(Bench)).

is_said(Text, Bench) ->
    lists:any(fun(Line) -> string:find(Line, Text) =/= nomatch end, starl_create_bench:said(Bench)).

ahead(Mm, V, Bench) ->
    starl_create_bench:drive({[{V, V, round(Mm / abs(V) * ?S)}], leg}, Bench).

x(Bench) -> element(1, starl_create_bench:pose(Bench)).

%% -- to find and wake the robot -------------------------------------------------------------

a_robot_that_sleeps_is_woken_test() ->
    Bench = ready(#{model => 2, quirks => #{asleep => true}}),
    ?assertEqual([], starl_create_bench:said(Bench)).

one_line_for(Text, Options) ->
    Bench = starl_create_bench:run(60 * ?S, new(Options)),
    ?assertNot(is_ready(Bench)),
    ?assertMatch([_], starl_create_bench:said(Bench)),
    ?assert(is_said(Text, Bench)),
    Bench.

a_robot_that_cannot_be_woken_is_told_once_test() ->
    one_line_for("switch it on", #{model => 2, quirks => #{asleep => true, no_wake => true}}).

a_wrong_baud_rate_is_told_once_test() ->
    one_line_for("answers at 19200 baud", #{model => 2, baud => 19200}),
    one_line_for("answers at 115200 baud", #{model => 1, baud => 115200}).

a_wrong_model_is_told_once_test() ->
    one_line_for("set its model to 1", #{model => 2, robot_model => 1, baud => 115200}),
    one_line_for("set its model to 2", #{model => 1, robot_model => 2, baud => 57600}).

a_robot_on_its_dock_is_told_once_test() ->
    Docked = one_line_for("off its charger", #{model => 2, quirks => #{docked => true}}),
    Bench = get_ready(3, starl_create_bench:feel({charger, false}, Docked)),
    ?assertEqual(safe, mode(Bench)).

quirks_that_change_nothing_test_() ->
    [
        {lists:flatten(io_lib:format("~0p", [{Model, Quirk}])), fun() -> goes(Model, Quirk) end}
     || {Model, Quirk} <- [
            {1, #{checksum => without_header}},
            {1, #{fraction => kept}},
            {1, #{yaw_inverted => true}},
            {2, #{mode_offset => 1}},
            {2, #{burst_ms => 80}},
            {2, #{stray_byte => 97}},
            {1, #{stray_byte => 97}}
        ]
    ].

goes(Model, Quirk) ->
    Bench = starl_create_bench:run(
        3 * ?S, ahead(300, 200.0, ready(#{model => Model, quirks => Quirk}))
    ),
    ?assertMatch([{_, leg, {driven, _}}], starl_create_bench:answers(Bench)),
    ?assert(abs(x(Bench) - 300) < 8),
    ?assertEqual({0.0, 0.0}, starl_create_bench:wheels(Bench)).

%% -- commands -------------------------------------------------------------------------------

the_pen_is_an_output_test() ->
    pen(1, {outputs, 1}, {outputs, 0}),
    pen(2, {leds, 1, 0, 255}, {leds, 0, 0, 255}).

pen(Model, Down, Up) ->
    Lowered = starl_create_bench:actuate({pen, down, {mark, p}}, ready(#{model => Model})),
    ?assertMatch([{_, p, {actuated, pen, down}}], starl_create_bench:answers(Lowered)),
    Bench = starl_create_bench:run(
        ?S, starl_create_bench:stop(starl_create_bench:run(?S, Lowered))
    ),
    Outs = [Out || {_, Out} <- starl_create_bench:outs(Bench), Out =:= Down orelse Out =:= Up],
    ?assertEqual([Down, Up], lists:nthtail(length(Outs) - 2, Outs)).

a_new_script_replaces_the_old_one_test() ->
    Going = starl_create_bench:run(300000, ahead(1000, 200.0, ready(#{model => 2}))),
    Back = starl_create_bench:drive({[{-100.0, -100.0, ?S}], back}, Going),
    Bench = starl_create_bench:run(3 * ?S, Back),
    ?assertMatch([{_, back, {driven, _}}], starl_create_bench:answers(Bench)),
    ?assert(abs(x(Bench) - (60 - 100)) < 4).

%% No script is answered, and none is driven, before the robot is under control.
nothing_is_driven_without_control_test() ->
    Bench = starl_create_bench:run(150000, ahead(100, 100.0, new(#{model => 2}))),
    ?assertEqual([], starl_create_bench:answers(Bench)),
    ?assertEqual(0.0, x(Bench)).

%% -- stalls, bumps, cliffs ------------------------------------------------------------------

a_wheel_that_is_stuck_stops_the_robot_test() ->
    [stuck(Model, 100000) || Model <- [1, 2]].

%% Overcurrent shows in the next frame, within 15 ms; the line takes 4 ms.
stuck(Model, LatestUs) ->
    Going = starl_create_bench:run(500000, ahead(1000, 200.0, ready(#{model => Model}))),
    Now = starl_create_bench:now_us(Going),
    Stuck = starl_create_bench:feel({turning, {0.0, 200.0}}, Going),
    Bench = starl_create_bench:until(
        fun(B) -> starl_create_bench:answers(B) =/= [] end, LatestUs, Stuck
    ),
    ?assertMatch([{_, leg, {stalled, {200.0, 200.0}}}], starl_create_bench:answers(Bench)),
    ?assert(starl_create_bench:now_us(Bench) - Now =< 15000 + 7000),
    Stands = starl_create_bench:run(150000, Bench),
    ?assertEqual({0.0, 0.0}, starl_create_bench:wheels(Stands)).

a_bump_stops_the_robot_and_is_an_event_test() ->
    Going = starl_create_bench:run(500000, ahead(1000, 200.0, ready(#{model => 2}))),
    Bumped = starl_create_bench:feel({readings, #{bumps_drops => 2}}, Going),
    Bench = starl_create_bench:run(100000, Bumped),
    ?assertMatch([{_, leg, {stalled, _}}], starl_create_bench:answers(Bench)),
    ?assert(lists:keymember({bump, left}, 2, starl_create_bench:events(Bench))),
    %% it may drive away while the bumper is still pressed
    Away = starl_create_bench:run(2 * ?S, ahead(100, -100.0, Bench)),
    ?assertMatch([_, {_, leg, {driven, _}}], starl_create_bench:answers(Away)).

sensors_are_events_test() ->
    Bench0 = ready(#{model => 2, quirks => #{}}),
    Readings = #{buttons => 1, cliff_left => 1},
    Bench = starl_create_bench:run(50000, starl_create_bench:feel({readings, Readings}, Bench0)),
    Events = [Event || {_, Event} <- starl_create_bench:events(Bench)],
    ?assert(lists:member({buttons, 1}, Events)),
    ?assert(lists:member({cliff, [left]}, Events)).

%% A frame may repeat the one before it; a wheel that turns in the third is well.
a_repeated_frame_is_no_stall_test() ->
    Frame = fun(Count) ->
        #{
            left_velocity => 200,
            right_velocity => 200,
            left_encoder => Count,
            right_encoder => Count,
            bumps_drops => 0,
            overcurrents => 0
        }
    end,
    See = fun(Counts) ->
        lists:foldl(
            fun(N, Senses) -> starl_create_senses:see(Frame(N), Senses) end,
            starl_create_senses:new(),
            Counts
        )
    end,
    Turns = [0, 7, 14, 21, 28, 35, 42],
    [
        ?assertEqual(
            {Repeated, Repeated >= 3},
            {Repeated,
                starl_create_senses:is_stalled(
                    true, See(Turns ++ lists:duplicate(Repeated, 42))
                )}
        )
     || Repeated <- [0, 1, 2, 3, 4]
    ],
    ?assertNot(starl_create_senses:is_stalled(true, See(Turns ++ [42, 42, 49, 49, 49]))).

%% A battery that is low when the robot is taken is told, as an event, too.
a_low_battery_is_told_at_the_start_test() ->
    Bench = ready(#{model => 2, charge_mah => 200}),
    ?assert(is_said("battery is low (7 %)", Bench)),
    ?assert(lists:keymember({battery, low}, 2, starl_create_bench:events(Bench))).

%% A robot with nothing more to do is in mode Passive until a script comes.
a_robot_that_is_done_rests_test() ->
    Rests = starl_create_bench:run(3 * ?S, rest(ready(#{model => 2}))),
    ?assertEqual(passive, mode(Rests)),
    ?assertNot(is_ready(Rests)),
    ?assertEqual([], starl_create_bench:said(Rests)),
    Again = get_ready(2, ahead(100, 100.0, Rests)),
    ?assertEqual(safe, mode(Again)).

rest(Bench) -> starl_create_bench:rest(Bench).

a_robot_looks_for_its_dock_and_leaves_it_test() ->
    Seeks = starl_create_bench:run(?S, actuates(dock, seek, ready(#{model => 2}))),
    ?assert(lists:member(dock, commands(Seeks))),
    ?assertEqual(passive, mode(Seeks)),
    Docked = starl_create_bench:run(?S, starl_create_bench:feel({charger, true}, Seeks)),
    ?assert(lists:keymember({docked, true}, 2, starl_create_bench:events(Docked))),
    Leaves = starl_create_bench:run(2 * ?S, actuates(dock, leave, Docked)),
    ?assert(x(Leaves) - x(Docked) < -150),
    Left = get_ready(5, starl_create_bench:feel({charger, false}, Leaves)),
    ?assertEqual(safe, mode(Left)).

songs_and_lights_test() ->
    Bench = starl_create_bench:run(?S, signals(ready(#{model => 2}))),
    Commands = commands(Bench),
    ?assert(lists:member({song, 0, [{60, 16}, {64, 16}]}, Commands)),
    ?assert(lists:member({play, 0}, Commands)),
    %% the first light is the pen, and up
    ?assert(lists:member({leds, 2#1000, 128, 255}, Commands)).

signals(Bench) ->
    Given = [{song, [{60, 16}, {64, 16}]}, {lights, {2#1001, 128, 255}}, {song, []}, {lights, red}],
    lists:foldl(fun({Device, Value}, B) -> actuates(Device, Value, B) end, Bench, Given).

actuates(Device, Value, Bench) -> starl_create_bench:actuate({Device, Value, none}, Bench).

%% What the driver has written, as commands.
commands(Bench) -> starl_create_bench:commands(Bench).

%% A computer that has missed its own timers is busy: that comes before what its robot may lack.
a_busy_computer_is_said_first_test() ->
    Late = starl_create_bench:hear({behind, 340000}, new(#{model => 2, baud => 19200})),
    Bench = starl_create_bench:run(9 * ?S, Late),
    ?assertMatch([_], starl_create_bench:said(Bench)),
    ?assert(
        is_said("this computer is too busy: what the driver waits for came 340 ms late", Bench)
    ),
    %% a computer that is no longer late does not hide what is wrong
    Later = starl_create_bench:run(60 * ?S, Bench),
    ?assert(is_said("the robot answers at 19200 baud", Later)),
    ?assertMatch([_, _], starl_create_bench:said(Later)).

%% A lateness that has become twice as long is news.
a_longer_lateness_is_said_test() ->
    Says = fun(Us, Before) -> starl_create_advice:is_news({late, Us}, Before) end,
    ?assert(Says(5000, none)),
    ?assertNot(Says(9000, {late, 5000})),
    ?assert(Says(400000, {late, 5000})).

a_port_program_without_real_time_is_told_test() ->
    Bench = starl_create_bench:hear({priority, raised}, ready(#{model => 2})),
    ?assert(is_said("LimitRTPRIO=1", Bench)),
    #{priority := raised, control := true, charge := Charge} = starl_create_driver:condition(
        starl_create_bench:driver(Bench)
    ),
    ?assert(is_integer(Charge)).

%% A log has words of the driver, not a term. This module is the port and the handler.
a_line_in_the_log_is_plain_test() ->
    Level = maps:get(level, logger:get_primary_config()),
    ok = logger:add_handler(?MODULE, ?MODULE, #{config => self()}),
    ok = logger:set_primary_config(level, notice),
    try
        {ok, Chassis} = starl_create_chassis:open(#{
            robot => 1,
            clock => starl_live_clock:new(0, 1),
            create => #{model => 2, device => "none"},
            port => {?MODULE, #{}}
        }),
        {[], _} = starl_create_chassis:hear({priority, raised}, Chassis),
        receive
            {logged, #{what := create}, Text} ->
                ?assertMatch("its Create: the port program runs without" ++ _, Text)
        end
    after
        ok = logger:set_primary_config(level, Level),
        ok = logger:remove_handler(?MODULE)
    end.

start_link(_Owner, _Options) ->
    {ok,
        spawn_link(fun() ->
            receive
                never -> ok
            end
        end)}.

log(#{msg := {report, Report}} = Event, #{config := Test}) ->
    Text = logger_formatter:format(Event, #{template => [msg], single_line => true}),
    Test ! {logged, Report, unicode:characters_to_list(Text)};
log(_Event, _Config) ->
    ok.

%% At a cliff a robot in mode Safe stops by itself; it is under control again when it was put back.
a_cliff_ends_control_test() ->
    Going = starl_create_bench:run(500000, ahead(1000, 200.0, ready(#{model => 2}))),
    Cliff = starl_create_bench:feel({readings, #{cliff_front_left => 1}}, Going),
    ?assertEqual({0.0, 0.0}, starl_create_bench:wheels(Cliff)),
    Bench = starl_create_bench:run(100000, Cliff),
    ?assertEqual([], starl_create_bench:answers(Bench)),
    ?assert(is_said("at a cliff", Bench)),
    Back = starl_create_bench:feel({readings, #{cliff_front_left => 0}}, Bench),
    ?assertEqual(safe, mode(get_ready(3, Back))).

a_lifted_robot_is_told_test() ->
    Lifted = starl_create_bench:feel({readings, #{bumps_drops => 12}}, ready(#{model => 1})),
    Bench = starl_create_bench:run(5 * ?S, Lifted),
    ?assert(is_said("a wheel hangs down", Bench)),
    ?assertEqual(passive, mode(Bench)).

%% -- the line -------------------------------------------------------------------------------

the_cable_is_pulled_twenty_times_test() ->
    [pulled(Model) || Model <- [1, 2]].

pulled(Model) ->
    Bench = lists:foldl(
        fun(N, Bench0) ->
            Going = starl_create_bench:run(250000 + 1700 * N, ahead(500, 100.0, Bench0)),
            Gone = starl_create_bench:run(500000, starl_create_bench:pull(unplugged, Going)),
            ?assertNot(is_ready(Gone)),
            Back = get_ready(5, starl_create_bench:plug(Gone)),
            ?assertEqual({0.0, 0.0}, starl_create_bench:wheels(Back)),
            Back
        end,
        ready(#{model => Model, latency => {0, 20000}}),
        lists:seq(1, 20)
    ),
    Gone = [
        Line
     || Line <- starl_create_bench:said(Bench), string:find(Line, "is gone") =/= nomatch
    ],
    Back = [Line || Line <- starl_create_bench:said(Bench), string:find(Line, "again") =/= nomatch],
    ?assertEqual({20, 20}, {length(Gone), length(Back -- Gone)}),
    ?assertEqual([], starl_create_bench:answers(Bench)).

%% A Create 1 stops by itself when its computer is gone; a Create 2 cannot.
a_create_1_stops_without_a_computer_test() ->
    [
        begin
            Ready = ready(#{model => 1, driver => #{short_waits => Short}}),
            Going = starl_create_bench:run(Us, ahead(1000, 200.0, Ready)),
            ?assertEqual({200.0, 200.0}, rounded(starl_create_bench:wheels(Going))),
            Gone = starl_create_bench:run(Within, starl_create_bench:pull(dead, Going)),
            ?assertEqual({0.0, 0.0}, starl_create_bench:wheels(Gone))
        end
     || {Short, Within} <- [{false, 165000}, {true, 90000}],
        Us <- lists:seq(50000, 650000, 7000)
    ].

%% A line that breaks between any two bytes of a slice leaves no speeds without their end.
a_slice_cut_short_drives_no_farther_test() ->
    [
        begin
            {_, Robot} = starl_create_emulator:hear(
                0, <<128, 131>>, starl_create_emulator:new(#{model => 1})
            ),
            Cut = binary:part(Bytes, 0, Length),
            {_, Told} = starl_create_emulator:hear(100000, Cut, Robot),
            {_, Later} = starl_create_emulator:advance(300000, Told),
            ?assertEqual(
                {Waits, Length, {0.0, 0.0}}, {Waits, Length, starl_create_emulator:wheels(Later)}
            )
        end
     || Waits <- [long, short],
        {_, Bytes, _} <- starl_create_script:steps(
            [{200.0, 200.0, 300000}], {on_robot, Waits, rest}
        ),
        Length <- lists:seq(1, byte_size(Bytes))
    ].

%% Slices of short waits follow each other without a gap, also if bytes are late: the time of the leg is
%% exactly that of its slices.
short_waits_leave_no_gap_test() ->
    [
        begin
            Ready = ready(#{
                model => 1, seed => Seed, latency => {0, 20000}, driver => #{short_waits => true}
            }),
            Before = length(starl_create_bench:outs(Ready)),
            Outs = starl_create_bench:outs(
                starl_create_bench:run(4 * ?S, ahead(500, 250.0, Ready))
            ),
            Wheels = [{At, V} || {At, {wheels, V}} <- lists:nthtail(Before, Outs)],
            ?assertMatch([{_, {247.0, 247.0}}, {_, {0.0, 0.0}}], Wheels),
            [{Begin, _}, {End, _}] = Wheels,
            ?assertEqual({Seed, 45 * 45000}, {Seed, End - Begin})
        end
     || Seed <- lists:seq(1, 20)
    ].

%% Commands that follow each other faster than they are driven, as those of a velocity, do not pile up in a
%% Create 1, which reads nothing while it waits: it still stops as soon as without them.
commands_do_not_pile_up_test() ->
    [
        begin
            Ready = ready(#{model => 1, driver => #{short_waits => Short}}),
            Steered = lists:foldl(
                fun(N, B) ->
                    starl_create_bench:run(Each, ahead(300, 200.0 + 10 * (N rem 2), B))
                end,
                Ready,
                lists:seq(1, 40)
            ),
            Gone = starl_create_bench:run(Within, starl_create_bench:pull(dead, Steered)),
            ?assertEqual({Short, Each, {0.0, 0.0}}, {Short, Each, starl_create_bench:wheels(Gone)}),
            Stopped = starl_create_bench:run(Within + 105000, starl_create_bench:stop(Steered)),
            ?assertEqual(
                {Short, Each, {0.0, 0.0}}, {Short, Each, starl_create_bench:wheels(Stopped)}
            )
        end
     || {Short, Within} <- [{false, 165000}, {true, 90000}], Each <- [50000, 130000, 200000, 317000]
    ].

%% The slices of a leg have a little less than its speed.
rounded({L, R}) -> {10.0 * round(L / 10), 10.0 * round(R / 10)}.

%% Frames from before Start, which a computer that stood still hears after it, show a higher mode than
%% Passive; the robot comes under control all the same.
old_frames_after_start_do_no_harm_test() ->
    Ids = starl_create_greeting:ids(2),
    Zero = maps:from_list([{starl_create_packet:name(Id), 0} || Id <- Ids]),
    Frame = starl_create_stream:frame(Ids, Zero#{mode => 2}, with_header),
    Asking = starl_create_bench:run(125000, new(#{model => 2})),
    Bench = starl_create_bench:inject({driver, binary:copy(Frame, 5)}, Asking),
    ?assertEqual(safe, mode(get_ready(3, Bench))).

a_reset_robot_is_taken_again_test() ->
    Bench = starl_create_bench:run(
        20000, starl_create_bench:inject({robot, <<7>>}, ready(#{model => 2}))
    ),
    ?assertEqual(off, mode(Bench)),
    Lost = starl_create_bench:run(400000, Bench),
    ?assertNot(is_ready(Lost)),
    ?assertEqual(safe, mode(get_ready(5, Lost))).

%% Half a command, and whatever else a torn line leaves, is no command.
half_commands_are_flushed_test() ->
    [
        begin
            Ready = ready(#{model => Model}),
            Half = starl_create_bench:inject({robot, Bytes}, Ready),
            Pulled = starl_create_bench:run(200000, starl_create_bench:pull(x, Half)),
            Before = length(starl_create_bench:outs(Pulled)),
            Bench = get_ready(5, starl_create_bench:plug(Pulled)),
            New = lists:nthtail(Before, starl_create_bench:outs(Bench)),
            ?assertEqual([], [V || {_, {wheels, V}} <- New, V /= {0.0, 0.0}])
        end
     || Model <- [1, 2],
        Bytes <- [
            <<137>>, <<137, 1>>, <<145, 0, 200, 0>>, <<140, 1, 16>>, <<139, 1>>, <<148, 20, 7>>
        ]
    ].

%% A million bytes of garbage among the frames: the driver stays, answers nothing wrong, and has its
%% robot in the end.
garbage_on_the_line_test_() ->
    [{timeout, 60, fun() -> garbage_on_the_line(Model) end} || Model <- [1, 2]].

garbage_on_the_line(Model) ->
    Seed = starl_platform_ct:seed(),
    {Bench, _} = lists:foldl(
        fun(_, {Before, Random}) ->
            {Garbage, Next} = rand:bytes_s(4000, Random),
            Noisy = starl_create_bench:inject({driver, Garbage}, Before),
            {starl_create_bench:run(20000, Noisy), Next}
        end,
        {ready(#{model => Model, seed => Seed}), rand:seed_s(exsss, Seed)},
        lists:seq(1, 250)
    ),
    ?assertEqual([], starl_create_bench:answers(Bench)),
    ?assertEqual([], [V || {_, {wheels, V}} <- starl_create_bench:outs(Bench), V /= {0.0, 0.0}]),
    goes_on(get_ready(5, Bench)).

goes_on(Bench0) ->
    Bench = starl_create_bench:run(3 * ?S, ahead(300, 200.0, Bench0)),
    ?assertMatch([{_, leg, {driven, _}}], starl_create_bench:answers(Bench)).

%% -- odometry -------------------------------------------------------------------------------

%% The encoders wrap at 29 m, forwards and backwards.
odometry_of_a_create_2_test_() ->
    {timeout, 60, fun odometry_of_a_create_2/0}.

odometry_of_a_create_2() ->
    lists:foldl(
        fun({V, Seconds, Sum}, Bench0) ->
            Driven = starl_create_bench:drive({[{V, V, Seconds * ?S}], leg}, Bench0),
            Bench = starl_create_bench:run((2 * Seconds + 1) * ?S, Driven),
            {Mm, _} = starl_create_driver:odometry(starl_create_bench:driver(Bench)),
            ?assert(abs(Mm - Sum) < 2),
            Bench
        end,
        ready(#{model => 2}),
        [{-500.0, 40, -20000}, {-500.0, 30, -35000}, {500.0, 100, 15000}]
    ).

%% A Create 1 knows whole millimetres and degrees, five times a second.
odometry_of_a_create_1_test() ->
    Bench0 = starl_create_bench:run(6 * ?S, ahead(1000, 200.0, ready(#{model => 1}))),
    {Mm, Angle} = starl_create_driver:odometry(starl_create_bench:driver(Bench0)),
    ?assert(abs(Mm - 1000) < 30),
    ?assert(abs(Angle) < 0.01).

%% The answer bears the time at which the first command left, also of a script of several.
an_answer_bears_the_time_of_the_first_command_test() ->
    Bench0 = ready(#{model => 2}),
    Now = starl_create_bench:now_us(Bench0),
    Script = [{-100.0, 100.0, 300000}, {200.0, 200.0, 500000}],
    Bench = starl_create_bench:run(?S, starl_create_bench:drive({Script, turn}, Bench0)),
    ?assertMatch([{_, turn, {driven, Now}}], starl_create_bench:answers(Bench)).

%% -- time -----------------------------------------------------------------------------------

%% A robot that drives slowly enough for its line: speed and least duration of a command.
a_line_with_little_jitter_is_driven_at_full_speed_test() ->
    [
        begin
            Given = [{500.0, 500.0, 300000}, {-100.0, 100.0, 3000}],
            [{_, _, Us}, {_, _, Least}] = starl_create_script:steps(Given, {by_port, 1000 * Ms}),
            ?assertEqual({Ms, Lasts, LeastMs}, {Ms, round(Us / 1000), round(Least / 1000)})
        end
     || {Ms, Lasts, LeastMs} <- [{5, 300, 15}, {20, 500, 60}]
    ].

drive() ->
    {_, Drive} = starl_create_drive:drive(
        [{500.0, 500.0, 300000}],
        leg,
        starl_create_drive:new(#{model => 2, device => x, jitter_ms => 5})
    ),
    Drive.

senses(V) ->
    Reading = #{left_velocity => V, right_velocity => V, overcurrents => 0, bumps_drops => 0},
    starl_create_senses:see(Reading, starl_create_senses:see(Reading, starl_create_senses:new())).

%% What a robot is told, word by word: what comes back of all words.
told(Words, Drive) ->
    {Actions, Next} = lists:mapfoldl(fun(Word, Before) -> Word(Before) end, Drive, Words),
    {lists:append(Actions), Next}.

hear(Word, V) -> fun(Drive) -> starl_create_drive:hear(Word, senses(V), Drive) end.
watch(V) -> fun(Drive) -> starl_create_drive:watch(senses(V), Drive) end.
due(V) -> fun(Drive) -> starl_create_drive:due(senses(V), Drive) end.

%% The answer comes with the first frame in which a robot stands that was seen to move.
a_leg_is_answered_as_soon_as_the_robot_stands_test() ->
    Moving = [hear({sent, 1, 0}, 0), watch(500), hear({ended, 1, 300000}, 500), watch(500)],
    {Before, Drive} = told(Moving, drive()),
    ?assertMatch([{timer, rest, _}], Before),
    ?assertMatch({[{answer, leg, {driven, 0}}], _}, told([watch(0)], Drive)).

%% A frame from before the robot moved is no answer; after the time to come to rest it is.
an_old_frame_is_no_answer_test() ->
    {Before, Drive} = told([hear({sent, 1, 0}, 0), hear({ended, 1, 300000}, 0), watch(0)], drive()),
    ?assertMatch([{timer, rest, _}], Before),
    ?assertMatch({[{answer, leg, {driven, 0}}], _}, told([due(0)], Drive)).

%% A robot that stands already has nothing to wait for.
a_robot_that_stands_stands_at_once_test() ->
    {_, Stands} = told([hear({sent, 1, 0}, 0), watch(500), hear({ended, 1, 300000}, 0)], drive()),
    {_, Stopping} = starl_create_drive:drive([], stop, Stands),
    ?assertMatch({[{answer, stop, {driven, 9}}], _}, told([hear({ended, 2, 9}, 0)], Stopping)).

%% A script that has lasted too long is said, and the next ones are driven more slowly for a while.
a_late_computer_is_driven_more_slowly_test() ->
    {Actions, Late} = told([hear({sent, 1, 0}, 0), hear({ended, 1, 330000}, 0)], drive()),
    ?assertMatch([{say, warning, {late, 30000}} | _], Actions),
    Lasts = fun(Drive) ->
        {[{port, {drive_script, Ref, [{_, Us}], _}}], Next} =
            starl_create_drive:drive([{500.0, 500.0, 300000}], leg, Drive),
        {_, Done} = told([hear({sent, Ref, 0}, 0), hear({ended, Ref, Us}, 0)], Next),
        {Us, Done}
    end,
    {[First | _] = All, _} = lists:mapfoldl(fun(_, D) -> Lasts(D) end, Late, lists:seq(1, 30)),
    ?assert(First > 700000),
    ?assertEqual(300000, lists:last(All)),
    ?assertEqual(All, lists:reverse(lists:sort(All))).

%% What the port has cut short is answered when it should have ended, not sooner: the robot's clock
%% and that of its chassis agree.
a_script_cut_short_is_answered_at_its_end_test() ->
    Cut = [hear({sent, 1, 0}, 0), watch(500), hear({ended, 1, 100000}, 500), watch(0)],
    {Actions, Drive} = told(Cut, drive()),
    ?assertEqual([{timer, rest, 50 + 200}], Actions),
    ?assertMatch({[{answer, leg, {driven, 0}}], _}, told([due(0)], Drive)).

%% A robot whose cable was pulled goes on where it stood, with its pen as it was told; one that was
%% lifted may stand elsewhere, and does not paint.
the_pen_after_a_loss_of_control_test() ->
    [
        begin
            Down = starl_create_bench:run(
                100000, starl_create_bench:actuate({pen, down, none}, ready(#{model => 2}))
            ),
            Bench = starl_create_bench:run(100000, get_ready(5, Loses(Down))),
            Leds = [Bits || {_, {leds, Bits, _, _}} <- starl_create_bench:outs(Bench)],
            ?assertEqual({What, Pen}, {What, lists:last(Leds)})
        end
     || {What, Loses, Pen} <- [
            {cable, fun pulled_and_plugged/1, 1},
            {reset, fun reset_by_itself/1, 1},
            {lifted, fun lifted_and_put_back/1, 0}
        ]
    ].

pulled_and_plugged(Bench) ->
    starl_create_bench:plug(starl_create_bench:run(500000, starl_create_bench:pull(gone, Bench))).

reset_by_itself(Bench) ->
    starl_create_bench:run(400000, starl_create_bench:inject({robot, <<7>>}, Bench)).

lifted_and_put_back(Bench) ->
    Lifted = starl_create_bench:feel({readings, #{bumps_drops => 12}}, Bench),
    starl_create_bench:feel(
        {readings, #{bumps_drops => 0}}, starl_create_bench:run(500000, Lifted)
    ).

%% The stop bytes of the port raise the pen; the robot goes on with its pen as it was.
the_pen_after_a_stop_of_the_port_test() ->
    Down = starl_create_bench:actuate({pen, down, none}, ready(#{model => 2})),
    Driver = starl_create_bench:driver(Down),
    {Actions, _} = starl_create_driver:hear({stopped, heartbeat, 0}, 0, Driver),
    Lowers = starl_create_instructions:pen(down, #{model => 2, device => x}),
    ?assertMatch([{port, {send, Lowers}} | _], Actions).

%% -- a measured profile ---------------------------------------------------------------------

%% Wheels that are worn by 5 %: encoders and speed control do not know. A tape does, and its profile
%% brings a leg to its end.
a_measured_profile_brings_a_leg_to_its_end_test() ->
    File = "/tmp/starl_create_profile_" ++ os:getpid(),
    Measured = #{drive => 0.95, turn => 0.95, distance => 0.95, angle => 0.95},
    ok = starl_create_calibration:profile(File, Measured#{model => 2, baud => 115200}),
    {ok, Options} = starl_create_options:configured(#{device => "bench", profile => File}),
    ok = file:delete(File),
    Radius = starl_chassis:tracking_radius(starl_create_bench:profile(2)),
    [
        ?assertEqual({Model, Name, Ends}, {Model, Name, off(Model, Driver) =< Radius})
     || Model <- [1, 2],
        {Name, Driver, Ends} <- [
            {measured, maps:remove(baud, Options#{model => Model}), true}, {default, #{}, false}
        ]
    ].

%% How far off a leg of 400 mm to the left ends, and a little more if the odometry is off as well.
off(Model, Options) ->
    Bench0 = ready(#{model => Model, worn => 0.95, driver => Options}),
    Turn = 1_000_000 * (math:pi() / 2) * 129 / 150,
    Left = starl_create_bench:drive({[{-150.0, 150.0, round(Turn)}], turn}, Bench0),
    Turned = starl_create_bench:run(4 * ?S, Left),
    {_, _, Heading} = starl_create_bench:pose(Turned),
    Bench = starl_create_bench:run(4 * ?S, ahead(400, 250.0, Turned)),
    {X, Y, _} = starl_create_bench:pose(Bench),
    {Way, _} = starl_create_driver:odometry(starl_create_bench:driver(Bench)),
    abs(math:sqrt(X * X + Y * Y) - 400) + 20 * abs(Heading - math:pi() / 2) + abs(Way - 400) / 8.

%% The odometry is that of the factors, straight and in a turn.
a_measured_profile_corrects_the_odometry_test() ->
    Counted = fun(Commands, Own) ->
        Bench0 = ready(#{model => 2, driver => Own}),
        Bench = starl_create_bench:run(4 * ?S, starl_create_bench:drive({Commands, leg}, Bench0)),
        starl_create_driver:odometry(starl_create_bench:driver(Bench))
    end,
    Straight = [{250.0, 250.0, 2 * ?S}],
    {Mm, _} = Counted(Straight, #{}),
    {Measured, _} = Counted(Straight, #{distance => 0.9}),
    ?assert(abs(Measured / Mm - 0.9) < 0.001),
    Turn = [{-100.0, 100.0, 2 * ?S}],
    {_, Radians} = Counted(Turn, #{}),
    {_, Turned} = Counted(Turn, #{angle => 0.9}),
    ?assert(abs(Turned / Radians - 0.9) < 0.001).

%% What is said beside a profile counts.
what_is_said_counts_more_than_a_profile_test() ->
    File = "/tmp/starl_create_profile_said_" ++ os:getpid(),
    ok = starl_create_calibration:profile(File, #{model => 2, baud => 19200, short_waits => true}),
    Said = #{device => "bench", profile => File, baud => 57600},
    {ok, Options} = starl_create_options:configured(Said),
    ok = file:delete(File),
    ?assertEqual(
        #{device => "bench", model => 2, baud => 57600, short_waits => true}, Options
    ).

what_is_wrong_with_a_profile_is_said_in_a_line_test() ->
    [
        begin
            {error, Reason} = starl_create_options:configured(Given),
            Line = unicode:characters_to_list(starl_create_options:format_error(Reason)),
            ?assertNotEqual({Line, nomatch}, {Line, string:find(Line, Part)})
        end
     || {Given, Part} <- [
            {#{device => "x", profile => "/no/such.term"}, "/no/such.term: no such file"},
            {#{device => "x"}, "model must be said"},
            {#{device => "x", model => 2, modle => 1}, "modle is no option"}
        ]
    ].
