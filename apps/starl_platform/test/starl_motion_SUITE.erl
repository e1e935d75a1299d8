%% Assumption II.1 of the paper: while it drives from where it stood to its goal, the robot stays
%% within r(v) of the straight line; it arrives in bounded time. The pure machine drives a
%% chassis model whose errors are bounded as the profile says.
-module(starl_motion_SUITE).
-include_lib("stdlib/include/assert.hrl").
-include_lib("proper/include/proper.hrl").
-include("starl_motion_loop.hrl").

-import(starl_motion_loop, [fresh/0, new/2, uniform/1]).
-import(starl_motion_loop, [drive/2, goto/3, event/3, wheels/3, fire/1, until/2, finish/1]).

-export([all/0]).
-export([
    stays_near_the_line_and_arrives/1,
    stays_near_the_line_at_the_worst/1,
    near_the_goal_slower/1,
    stays_near_the_lines_of_a_path/1,
    draws_lines_from_end_to_end/1,
    arrived_already/1,
    stop_in_a_drive/1,
    stop_while_idle/1,
    another_goal_in_a_drive/1,
    lost_poses/1,
    unknown_poses/1,
    late_pose_is_ignored/1,
    location_restarts/1,
    no_goal_no_motion/1,
    lost_commands/1,
    every_command_ends/1,
    no_look_before_it_stands/1,
    stalled_wheel/1,
    stalled_and_another_goal/1,
    stale_words_of_the_chassis/1,
    large_turns_are_looked_at/1,
    out_of_time/1,
    out_of_time_at_a_stop/1,
    no_second_look_where_it_stands/1,
    stalled_where_it_was_to_stand/1
]).

all() ->
    [
        stays_near_the_line_and_arrives,
        stays_near_the_line_at_the_worst,
        near_the_goal_slower,
        stays_near_the_lines_of_a_path,
        draws_lines_from_end_to_end,
        arrived_already,
        stop_in_a_drive,
        stop_while_idle,
        another_goal_in_a_drive,
        lost_poses,
        unknown_poses,
        late_pose_is_ignored,
        location_restarts,
        no_goal_no_motion,
        lost_commands,
        every_command_ends,
        no_look_before_it_stands,
        stalled_wheel,
        stalled_and_another_goal,
        stale_words_of_the_chassis,
        large_turns_are_looked_at,
        out_of_time,
        out_of_time_at_a_stop,
        no_second_look_where_it_stands,
        stalled_where_it_was_to_stand
    ].

%% Random goals, speeds, legs and errors within the profile's bounds.
stays_near_the_line_and_arrives(_) ->
    Prop = ?FORALL(
        {Seed, Goal, Profile},
        {noshrink(integer(1, 10000)), goal(), profile()},
        starl_platform_ct:safely(fun() -> arrives(uniform(Seed), Goal, Profile) end)
    ),
    starl_platform_ct:property(Prop, 400).

%% The lines of a path are given with their beginnings, from which the robot is a little off.
stays_near_the_lines_of_a_path(_) ->
    Prop = ?FORALL(
        {Seed, Goals, Profile},
        {noshrink(integer(1, 10000)), vector(4, goal()), profile()},
        starl_platform_ct:safely(fun() ->
            Lines = lists:zip([{0.0, 0.0} | lists:droplast(Goals)], Goals),
            near_all(Lines, new(uniform(Seed), Profile))
        end)
    ),
    starl_platform_ct:property(Prop, 100),
    [
        ?assert(
            near_all(
                [{{0.0, 0.0}, {3000.0, 0.0}}, {{3000.0, 0.0}, {3000.0, 2000.0}}],
                new(Noise, starl_chassis:profile(starl_chassis_differential, #{}))
            )
        )
     || Noise <- [fun(_) -> 1.0 end, fun(_) -> -1.0 end, fun zigzag/1]
    ].

near_all([Line | Lines], #loop{piece = Piece, now = Now, profile = Profile} = Loop) ->
    Here = starl_trajectory:position(Now, Piece),
    Gone = finish(event({call, {app, 1}}, {go_along, Line}, Loop#loop{corners = [Here]})),
    off_line(Gone, Line) =< starl_chassis:tracking_radius(Profile) andalso
        near_all(Lines, Gone);
near_all([], _Loop) ->
    true.

%% Lines of any length, one after the other: where the robot stands at the beginning of one, looking
%% along it, and at its end, is as near to those along the line as is promised, by errors at random
%% and by the worst; on the way between it is no farther off than ever.
draws_lines_from_end_to_end(_) ->
    Prop = ?FORALL(
        {Seed, Lines, Profile},
        {noshrink(integer(1, 10000)), vector(6, stroke()), profile()},
        starl_platform_ct:safely(fun() -> drawn(Lines, new(uniform(Seed), Profile)) end)
    ),
    starl_platform_ct:property(Prop, 200),
    Short = [{{10.0 * N, 7.0 * N}, {10.0 * N + 6.0, 7.0 * N}} || N <- lists:seq(0, 30)],
    [
        ?assert(drawn(Short, new(Noise, starl_chassis:profile(starl_chassis_differential, #{}))))
     || Noise <- [fun(_) -> 1.0 end, fun(_) -> -1.0 end, fun zigzag/1, uniform(3)]
    ].

stroke() ->
    ?LET(
        {X, Y, Length, Turn},
        {
            coordinate(),
            coordinate(),
            oneof([1, 3, 6, 7, 20, 45, 100, 300, 700]),
            oneof(lists:seq(0, 6))
        },
        {{float(X), float(Y)}, {X + Length * math:cos(Turn), Y + Length * math:sin(Turn)}}
    ).

drawn([], _Loop) ->
    true;
drawn([{Start, Goal} = Line | Lines], Loop) ->
    {Ready, _} = travel({go_along, {here(Loop), Start}}, Loop),
    {Begun, _} = travel({face, Line}, Ready),
    {Ended, Off} = travel({go_along, Line}, Begun#loop{corners = [here(Begun)]}),
    #loop{profile = Profile} = Loop,
    Ends = starl_chassis:ends_mm(Profile) + 1.0e-6,
    Towards = starl_geometry:heading(Start, Goal),
    Along = [along(here(Begun), Start, Towards), along(here(Ended), Goal, Towards)],
    (lists:all(fun(Mm) -> abs(Mm) =< Ends end, Along) andalso
        Off =< starl_chassis:tracking_radius(Profile) orelse
        begin
            ct:log("~p: ~p (~p), off ~p", [Line, Along, Ends, Off]),
            false
        end) andalso drawn(Lines, Ended).

here(#loop{piece = Piece, now = Now}) -> starl_trajectory:position(Now, Piece).

travel({_, Line} = Call, Loop) ->
    #loop{replies = [{_, ok} | _]} = Gone = finish(event({call, {app, 1}}, Call, Loop)),
    {Gone, off_line(Gone, Line)}.

%% How far from a point in the direction of a line.
along({X, Y}, {X0, Y0}, Heading) -> (X - X0) * math:cos(Heading) + (Y - Y0) * math:sin(Heading).

%% All errors at their bounds, to the left, to the right and to and fro.
stays_near_the_line_at_the_worst(_) ->
    [
        ?assert(
            arrives(
                Noise, Goal, starl_chassis:profile(starl_chassis_differential, #{speed => Speed})
            )
        )
     || Noise <- [fun(_) -> 1.0 end, fun(_) -> -1.0 end, fun zigzag/1],
        Goal <- [{5000.0, 0.0}, {-3000.0, 4000.0}, {10.0, -8000.0}],
        Speed <- [100.0, 500.0]
    ].

zigzag(Key) -> 2.0 * (erlang:phash2(Key, 2)) - 1.0.

near_the_goal_slower(_) ->
    Profile = starl_chassis:profile(starl_chassis_differential, #{
        near_mm => 700.0, near_speed => 150.0, near_turn_rate => 0.5
    }),
    [?assert(arrives(uniform(Seed), {4000.0, 1000.0}, Profile)) || Seed <- lists:seq(1, 30)],
    Loop = drive({4000.0, 0.0}, new(uniform(1), Profile)),
    ?assertMatch([{_, ok}], Loop#loop.replies).

goal() -> ?LET({X, Y}, {coordinate(), coordinate()}, {float(X), float(Y)}).

coordinate() -> oneof(lists:seq(-9000, 9000, 37)).

profile() ->
    ?LET(
        {Speed, LegS, Heading, Part, Position, Rate},
        {
            oneof([50.0, 200.0, 350.0, 500.0]),
            oneof([0.1, 0.3, 0.7]),
            oneof([0.0, 0.01, 0.05]),
            oneof([0.0, 0.01, 0.05]),
            oneof([0.0, 1.0, 5.0]),
            oneof([1.0, 3.0])
        },
        starl_chassis:profile(starl_chassis_differential, #{
            speed => Speed,
            near_speed => Speed,
            leg_s => LegS,
            heading_error => Heading,
            distance_error => Part,
            position_error_mm => Position,
            turn_rate => Rate,
            near_turn_rate => Rate
        })
    ).

arrives(Noise, Goal, #{speed := Speed, near_speed := Near, goal_mm := GoalMm} = Profile) ->
    Loop = drive(Goal, new(Noise, Profile)),
    [{ArrivedUs, Answer}] = Loop#loop.replies,
    #{position_error_mm := Blur, turn_rate := Rate, near_turn_rate := NearRate} = Profile,
    Distance = starl_geometry:distance({0.0, 0.0}, Goal),
    %% where legs are short and positions uncertain, turns take longer than drives
    Bound = 10 * Distance / min(Speed, Near) + 20 / min(Rate, NearRate) + 5,
    Off = off_line(Loop, {{0.0, 0.0}, Goal}),
    Left = starl_geometry:distance(hd(Loop#loop.corners), Goal),
    Answer =:= ok andalso
        Off =< starl_chassis:tracking_radius(Profile) andalso
        Left =< GoalMm + Blur andalso
        ArrivedUs =< Bound * 1.0e6 orelse
        begin
            ct:log("~p: off ~p (~p), left ~p (~p), ~p us (~p s)", [
                Answer, Off, starl_chassis:tracking_radius(Profile), Left, GoalMm, ArrivedUs, Bound
            ]),
            false
        end.

%% The largest distance from the line: the distance from a segment is convex, so along a straight
%% piece it is largest at one of its ends.
off_line(#loop{corners = Corners}, Line) ->
    lists:max([starl_geometry:point_segment(P, Line) || P <- Corners]).

arrived_already(_) ->
    Loop = drive(
        {1.0, 1.0}, new(uniform(1), starl_chassis:profile(starl_chassis_differential, #{}))
    ),
    ?assertEqual([{0, ok}], Loop#loop.replies),
    ?assert(starl_trajectory:is_still(Loop#loop.piece)).

stop_in_a_drive(_) ->
    Going = until(3000000, goto({8000.0, 0.0}, 1, fresh())),
    Stopped = event({call, {app, 2}}, stop, Going),
    ?assertEqual([{3000000, {error, stopped}}, {3000000, ok}], lists:reverse(Stopped#loop.replies)),
    ?assertEqual(none, Stopped#loop.timer),
    ?assertMatch({piece, 3000000, _, _, _, V, W} when V == 0 andalso W == 0, Stopped#loop.piece),
    ?assertEqual(idle, starl_machine:state(Stopped#loop.machine)),
    Cast = event(cast, stop, Going),
    ?assertEqual([{3000000, {error, stopped}}], Cast#loop.replies).

stop_while_idle(_) ->
    Loop = event({call, {app, 1}}, stop, fresh()),
    ?assertEqual([{0, ok}], Loop#loop.replies).

%% The first caller is told; the line is the one from where the robot stands now.
another_goal_in_a_drive(_) ->
    [
        begin
            Going = until(At, goto({8000.0, 0.0}, 1, fresh())),
            Here = starl_trajectory:position(At, Going#loop.piece),
            Loop = finish(goto({0.0, 5000.0}, 2, Going#loop{corners = [Here]})),
            ?assertMatch([{At, {error, stopped}}, {_, ok}], lists:reverse(Loop#loop.replies)),
            Off = off_line(Loop, {Here, {0.0, 5000.0}}),
            ?assert(Off =< starl_chassis:tracking_radius(Loop#loop.profile))
        end
     || At <- lists:seq(100000, 3000000, 170000)
    ].

%% Without an answer the robot stands and asks again.
lost_poses(_) -> blind(lost).

unknown_poses(_) -> blind(unknown).

blind(How) ->
    Eyes = fun(N) ->
        case N rem 3 of
            0 -> seen;
            _ -> How
        end
    end,
    Loop = drive({3000.0, 1000.0}, (fresh())#loop{eyes = Eyes}),
    ?assertMatch([{_, ok}], Loop#loop.replies),
    Off = off_line(Loop, {{0.0, 0.0}, {3000.0, 1000.0}}),
    ?assert(Off =< starl_chassis:tracking_radius(Loop#loop.profile)).

late_pose_is_ignored(_) ->
    Loop = goto({3000.0, 0.0}, 1, (fresh())#loop{eyes = fun(_) -> lost end}),
    Late = event({reply, 99}, {ok, {9.0, 9.0, 0.0}}, Loop),
    ?assertEqual(locating, starl_machine:state(Late#loop.machine)).

%% The question is put again at once, not when the wait for an answer is over.
location_restarts(_) ->
    Blind = goto({3000.0, 0.0}, 1, (fresh())#loop{eyes = fun(_) -> lost end}),
    Again = event(info, {restarted, location}, Blind#loop{eyes = fun(_) -> seen end}),
    ?assertEqual(0, Again#loop.now),
    ?assertNotEqual(locating, starl_machine:state(Again#loop.machine)).

%% A command that the chassis has not heard is found out, and takes it nowhere.
lost_commands(_) ->
    [
        begin
            Ears = fun(N) ->
                case erlang:phash2({Seed, N}, 100) < 40 of
                    true -> lost;
                    _ -> heard
                end
            end,
            Loop = drive({3000.0, 1000.0}, (fresh())#loop{ears = Ears}),
            ?assertMatch([{_, ok}], Loop#loop.replies),
            Off = off_line(Loop, {{0.0, 0.0}, {3000.0, 1000.0}}),
            ?assert(Off =< starl_chassis:tracking_radius(Loop#loop.profile))
        end
     || Seed <- lists:seq(1, 20)
    ].

%% Whatever becomes of the robot's program: no command is longer than a turn and a leg.
every_command_ends(_) ->
    #loop{commands = Commands, profile = #{leg_s := LegS, turn_rate := Rate}} =
        drive({-3000.0, 4000.0}, fresh()),
    Longest = round((LegS + math:pi() / Rate) * 1.0e6),
    ?assert(length(Commands) > 20),
    [?assert(lists:sum([Us || {_, _, Us} <- Script]) =< Longest) || {_, Script} <- Commands].

%% Where it arrived it was seen just now: the next drive begins without another look, but along a
%% given line not without a word of the chassis. A tenth of a second later it looks again.
no_second_look_where_it_stands(_) ->
    #loop{asked = Asked, now = Now, commands = Commands} = There = drive({1000.0, 0.0}, fresh()),
    Next = {2000.0, 0.0},
    Soon = goto(Next, 2, There),
    ?assertEqual({driving, Asked}, {starl_machine:state(Soon#loop.machine), Soon#loop.asked}),
    Line = event({call, {app, 2}}, {go_along, {{1000.0, 0.0}, Next}}, There),
    ?assertMatch([{_, [_ | _]}, {_, []} | Commands], Line#loop.commands),
    ?assertEqual(Asked, Line#loop.asked),
    Later = goto(Next, 2, until(Now + 100000, There)),
    ?assertEqual(Asked + 1, Later#loop.asked),
    ?assertMatch([{_, ok}, {_, ok}], (finish(Soon))#loop.replies).

%% The chassis is deaf when the robot is to stop: where it is, is asked only once it stands.
no_look_before_it_stands(_) ->
    Going = until(3000000, goto({8000.0, 0.0}, 1, fresh())),
    #loop{asked = Asked} = Deaf = event(cast, stop, Going#loop{ears = fun(_) -> lost end}),
    Other = goto({0.0, 5000.0}, 2, Deaf),
    ?assertEqual({halting, Asked}, {starl_machine:state(Other#loop.machine), Other#loop.asked}),
    Heard = finish(Other#loop{ears = fun(_) -> heard end}),
    ?assertMatch([{_, ok}, {_, {error, stopped}}], Heard#loop.replies).

%% A wheel that is stuck is tried the other way round, slowly, to and fro, each time after a rest,
%% until a try succeeds; then it drives on.
stalled_wheel(_) ->
    Going = until(3000000, goto({8000.0, 0.0}, 1, fresh())),
    Stuck = lists:foldl(
        fun(_, {Loop, Tries}) ->
            {Next, Try} = stall(Loop),
            {Next, [Try | Tries]}
        end,
        {Going, []},
        lists:seq(1, 4)
    ),
    {Last, [D, C, B, A]} = Stuck,
    ?assertEqual([{-100.0, -100.0}, {100.0, 100.0}, {-100.0, -100.0}, {100.0, 100.0}], [A, B, C, D]),
    Loop = finish(Last),
    ?assertMatch([{_, ok}], Loop#loop.replies).

%% Another goal makes it try no sooner and drive no faster.
stalled_and_another_goal(_) ->
    Going = until(3000000, goto({8000.0, 0.0}, 1, fresh())),
    Stalled = say_stalled(Going),
    Said = length(Stalled#loop.commands),
    Other = goto({0.0, 5000.0}, 2, Stalled),
    ?assertEqual({stalled, Said}, {state(Other), length(Other#loop.commands)}),
    Stopped = event(cast, stop, Other),
    Third = goto({0.0, 9000.0}, 3, Stopped),
    ?assertMatch({trying, [{_, [{-100.0, -100.0, _}]} | _]}, {state(Third), Third#loop.commands}),
    ?assertMatch([{_, ok} | _], (finish(Third))#loop.replies).

%% A chassis that says that wheels which were told to stand do not is told once more, and the drive
%% goes on; there is nothing to try the other way round. What is no word of a chassis is traced.
stalled_where_it_was_to_stand(_) ->
    Going = until(3000000, goto({8000.0, 0.0}, 1, fresh())),
    [
        begin
            Mark = element(1, hd(Going#loop.commands)),
            Told = event(info, {stalled, Mark, Zero}, wheels(0.0, 0.0, Going#loop{chassis = none})),
            ?assertMatch({driving, [_, {_, []} | _]}, {state(Told), Told#loop.commands}),
            ?assertMatch([{_, ok}], (finish(Told))#loop.replies),
            %% the same of a wheel that had stuck before
            Trying = fire(say_stalled(Going)),
            ?assertEqual(trying, state(Trying)),
            Next = element(1, hd(Trying#loop.commands)),
            Again = event(
                info, {stalled, Next, Zero}, wheels(0.0, 0.0, Trying#loop{chassis = none})
            ),
            ?assertMatch([{_, ok}], (finish(Again))#loop.replies)
        end
     || Zero <- [{0.0, 0.0}, {0, 0}, {-0.0, 0.0}]
    ],
    Mark = element(1, hd(Going#loop.commands)),
    [
        ?assertMatch(
            {[{trace, {unknown_event, info, Word}}], _},
            starl_machine:step(info, Word, #{now => 0, robot => 1}, Going#loop.machine)
        )
     || Word <- [{stalled, Mark, {fast, 0.0}}, {stalled, Mark, x}, {driven, Mark, soon}]
    ].

state(#loop{machine = Machine}) -> starl_machine:state(Machine).

%% The wheels are found stuck; then it tries: the speeds of the try.
stall(Loop) ->
    Stalled = say_stalled(Loop),
    ?assertEqual({stalled, none}, {state(Stalled), Stalled#loop.chassis}),
    #loop{commands = [{_, [{Left, Right, Us}]} | _]} = Trying = fire(Stalled),
    ?assertEqual(trying, state(Trying)),
    ?assert(Us > 15000),
    {Trying, {Left, Right}}.

say_stalled(#loop{now = Now, commands = [{Mark, Script} | _]} = Loop) ->
    {Left, Right, _} = lists:last(Script),
    Standing = wheels(0.0, 0.0, Loop#loop{now = Now + 15000, chassis = none}),
    event(info, {stalled, Mark, {Left, Right}}, Standing).

%% Words about an earlier command, or of another life, are ignored.
stale_words_of_the_chassis(_) ->
    #loop{commands = [{Mark, _} | _]} = Going = until(3000000, goto({8000.0, 0.0}, 1, fresh())),
    [
        ?assertEqual(Going#loop.machine, (event(info, Word, Going))#loop.machine)
     || Word <- [{driven, Mark - 1, 0}, {stalled, Mark - 1, {1.0, 1.0}}, {driven, 1, 0}]
    ].

%% It does not drive after a turn that may have failed by more than a little.
large_turns_are_looked_at(_) ->
    #loop{commands = Commands, profile = #{look_from := LookFrom, turn_rate := Rate}} =
        drive({-3000.0, 4000.0}, fresh()),
    Turns = [{Us, Rest} || {_, [{Left, Right, Us} | Rest]} <- Commands, Left + Right == 0.0],
    Small = round(LookFrom / Rate * 1.0e6),
    ?assertEqual([], [Turn || {Us, [_]} = Turn <- Turns, Us > Small]),
    ?assertNotEqual([], [Turn || {Us, []} = Turn <- Turns, Us > Small]).

%% The clock stands still, was set back, or the robot was paused: it does not drive on along a line
%% that it may have no leave for any more; to a point it goes on.
out_of_time(_) ->
    Line = {{0.0, 0.0}, {8000.0, 0.0}},
    Along = until(3000000, event({call, {app, 1}}, {go_along, Line}, fresh())),
    To = until(3000000, goto({8000.0, 0.0}, 1, fresh())),
    Word = fun(#loop{chassis = {Due, [], Mark}, heard = Heard} = Loop, Us) ->
        Said = event(info, {driven, Mark, Heard}, Loop#loop{now = Due + Us, chassis = none}),
        {state(Said), [Answer || {_, Answer} <- Said#loop.replies]}
    end,
    [
        ?assertEqual({idle, [{error, out_of_time}]}, Word(Along, Us))
     || Us <- [-290000, -2000000, -20000, 1100000, 20000000]
    ],
    [?assertMatch({driving, []}, Word(Along, Us)) || Us <- [-1000, 0, 1000, 999999]],
    [?assertMatch({driving, []}, Word(To, Us)) || Us <- [-2000000, 0, 20000000]].

%% Who has the robot stop is told of its clock, too.
out_of_time_at_a_stop(_) ->
    Stop = fun(Us) ->
        Deaf = (fresh())#loop{now = 1000000, ears = fun(_) -> lost end},
        #loop{commands = [{Mark, []} | _]} = Loop = event({call, {app, 1}}, stop, Deaf),
        Said = event(info, {driven, Mark, 1000000 + Us}, Loop),
        [Answer || {_, Answer} <- Said#loop.replies]
    end,
    ?assertEqual([[ok], [{error, out_of_time}]], [Stop(Us) || Us <- [0, 10000000]]).

no_goal_no_motion(_) ->
    Loop = fresh(),
    ?assert(starl_trajectory:is_still(Loop#loop.piece)),
    ?assertEqual(none, Loop#loop.timer).
