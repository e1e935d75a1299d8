%% The contract of painting: ink on the lines and nowhere else, every line painted. Traces that
%% keep it and traces that break it; intervals and coverage against brute-force sampling (seeded).
-module(starl_painting_monitor_tests).
-include_lib("eunit/include/eunit.hrl").

-define(S, 1_000_000).
-define(REACH, 10.0).

%% A square of 1 m.
square() ->
    Corners = [{0.0, 0.0}, {1000.0, 0.0}, {1000.0, 1000.0}, {0.0, 1000.0}],
    lists:zip(Corners, tl(Corners) ++ [hd(Corners)]).

line() -> [{{0.0, 0.0}, {1000.0, 0.0}}].

run(Lines, Events, End) -> run(Lines, Events, End, #{}).

run(Lines, Events, End, Extra) ->
    Config = maps:merge(#{lines => Lines, ink_radius_mm => 9.0, tolerance_mm => 1.0}, Extra),
    M0 = starl_monitor:new([{starl_painting_monitor, Config}]),
    {Met, M} = lists:foldl(fun step/2, {[], M0}, Events),
    {Late, #{starl_painting_monitor := Results}} = starl_monitor:finish(End, M),
    {Met ++ Late, Results}.

%% Judged without the completeness clause.
judge(Lines, Events, End) ->
    {Found, _} = run(Lines, Events, End, #{complete => false}),
    [What || #{contract := painting, what := What} <- Found].

step(Event, {Found, M0}) ->
    case starl_monitor:step(Event, M0) of
        {ok, M} -> {Found, M};
        {violation, Violation, M} -> {Found ++ [Violation], M}
    end.

motion(T, Robot, Piece) -> {T, Robot, chassis, {motion, Piece}}.
pen(T, Robot, Pen) -> {T, Robot, chassis, {actuated, pen, Pen}}.
stroke(T, Robot, Line) -> {T, Robot, app, {stroke, Line}}.
stand(T, X, Y) -> starl_trajectory:standing(T, {X, Y}, 0.0).

%% Drives through the points with 100 mm/s, from time T on, and says of each way that it is a
%% stroke; returns the events and the end.
tour(T, Robot, [_]) ->
    {[{T, Robot, pause}], T};
tour(T, Robot, [{X, Y} = A, B | Points]) ->
    Length = starl_geometry:distance(A, B),
    Heading = starl_geometry:heading(A, B),
    Next = T + round(Length * 1.0e4),
    Piece = starl_trajectory:piece(T, {X, Y}, Heading, Length / ((Next - T) / 1.0e6), 0.0),
    {Later, End} = tour(Next, Robot, [B | Points]),
    {[stroke(T, Robot, {A, B}), motion(T, Robot, Piece) | Later], End}.

%% The tour with the pen down all the way, then standing with the pen up.
paint(Points) -> paint(0, 1, Points).

paint(T, Robot, [{X, Y} | _] = Points) ->
    {Events, End} = tour(T + 1, Robot, Points),
    {XE, YE} = lists:last(Points),
    {
        [motion(T, Robot, stand(T, X, Y)), pen(T + 1, Robot, down)] ++
            [E || {_, _, _, _} = E <- Events] ++
            [pen(End, Robot, up), motion(End, Robot, stand(End, XE, YE))],
        End
    }.

everything_painted_test() ->
    Points = [A || {A, _} <- square()] ++ [{0.0, 0.0}],
    {Events, End} = paint(Points),
    {[], Results} = run(square(), Events, End + ?S),
    #{
        coverage := 1.0,
        ink_covered := true,
        ink_mm := Ink,
        driven_mm := Driven,
        unpainted_mm := +0.0,
        ink := #{1 := [Polyline]}
    } = Results,
    ?assert(abs(Ink - 4000.0) < 0.01),
    ?assert(abs(Driven - 4000.0) < 0.01),
    ?assertEqual(5, length(Polyline)).

two_robots_share_a_line_test() ->
    {First, End1} = paint(0, 1, [{0.0, 0.0}, {500.0, 0.0}]),
    {Second, End2} = paint(End1, 2, [{1000.0, 0.0}, {500.0, 0.0}]),
    {[], #{coverage := 1.0, ink := Ink}} = run(line(), First ++ Second, End2),
    ?assertMatch(#{1 := [[{_, _}, {_, _}]], 2 := [[{_, _}, {_, _}]]}, Ink).

%%% Every line is painted

unfinished_test() ->
    {Events, End} = paint([{0.0, 0.0}, {980.0, 0.0}]),
    {[#{what := unfinished}], #{coverage := Coverage}} = run(line(), Events, End),
    ?assert(abs(Coverage - 0.98) < 1.0e-6).

unfinished_is_fine_when_stopped_early_test() ->
    {Events, End} = paint([{0.0, 0.0}, {980.0, 0.0}]),
    ?assertMatch({[], #{ink_covered := false}}, run(line(), Events, End, #{complete => false})).

%% A robot that says that the picture is complete has to be right.
said_to_be_complete_test() ->
    {Events, End} = paint([{0.0, 0.0}, {980.0, 0.0}]),
    Ends = fun(Result) ->
        Said = Events ++ [{End, 2, app, {done, Result}}],
        {Found, _} = run(line(), Said, End, #{complete => false}),
        [What || #{what := What} <- Found]
    end,
    ?assertEqual([unfinished], Ends(complete)),
    ?assertEqual([], Ends(incomplete)).

%% Two millimetres may be missing at each end, and where two strokes meet as much of both.
finished_at_the_limit_test() ->
    {Events, End} = paint([{2.0, 0.0}, {998.0, 0.0}]),
    ?assertMatch({[], #{coverage := 1.0}}, run(line(), Events, End)),
    {_, #{inked := Inked}} = run(line(), Events, End),
    ?assert(abs(Inked - 0.996) < 1.0e-9),
    [
        ?assertMatch({[#{what := unfinished}], _}, painted(From, To))
     || {From, To} <- [{2.01, 998.0}, {2.0, 997.99}]
    ],
    ?assertMatch({[], _}, with_a_gap(4.0)),
    ?assertMatch({[#{what := unfinished}], _}, with_a_gap(4.01)).

painted(From, To) ->
    {Events, End} = paint([{From, 0.0}, {To, 0.0}]),
    run(line(), Events, End).

with_a_gap(Mm) ->
    {First, End1} = paint([{0.0, 0.0}, {450.0, 0.0}]),
    {Second, End2} = paint(End1, 1, [{450.0 + Mm, 0.0}, {1000.0, 0.0}]),
    run(line(), First ++ Second, End2).

gap_in_the_middle_test() ->
    {[#{what := unfinished}], #{unpainted_mm := Gap}} = with_a_gap(100.0),
    ?assert(abs(Gap - 100.0) < 1.0e-4).

%% The tolerance is across a line, not along it: what lies near is not painted by a dot.
dots_do_not_paint_short_lines_test() ->
    Short = [{{0.0, 0.0}, {6.0, 0.0}}],
    Drawn = fun(From, To) ->
        {Events, End} = paint([{From, 0.0}, {To, 0.0}]),
        element(2, run(Short, Events, End, #{complete => false}))
    end,
    ?assertMatch(#{coverage := +0.0}, Drawn(-1.0, -0.9)),
    ?assertMatch(#{coverage := C} when C < 0.6, Drawn(0.0, 1.0)),
    ?assertMatch(#{coverage := 1.0}, Drawn(2.0, 4.0)).

%% Lines 7 mm apart: ink on one of them is near enough to the other, but was not driven for it.
close_lines_are_told_apart_test() ->
    Lines = [{{0.0, 7.0 * I}, {1000.0, 7.0 * I}} || I <- [0, 1, 2]],
    {Events, End} = paint([{0.0, 0.0}, {1000.0, 0.0}]),
    {[#{what := unfinished}], #{coverage := Coverage}} = run(Lines, Events, End),
    ?assert(abs(Coverage - 1 / 3) < 1.0e-9),
    %% who paints them all need be no more exact than that
    Shaky = fun(I) -> [{0.0, 7.0 * I + 2.0}, {1000.0, 7.0 * I - 2.0}] end,
    Each = fun(I, {T, All}) ->
        {Drawn, Then} = paint(T, 1, Shaky(I)),
        {Then + 1, All ++ [for(lists:nth(I + 1, Lines), E) || E <- Drawn]}
    end,
    {Last, Drawn} = lists:foldl(Each, {0, []}, [0, 1, 2]),
    ?assertMatch({[], #{coverage := 1.0}}, run(Lines, Drawn, Last)).

for(Line, {T, Robot, app, {stroke, _}}) -> stroke(T, Robot, Line);
for(_Line, Event) -> Event.

%% Ink of a robot that does not say for what is no stroke; one stroke paints all lines that it is
%% on.
strokes_test() ->
    {Events, End} = paint([{0.0, 0.0}, {1000.0, 0.0}]),
    Silent = [E || {_, _, Machine, _} = E <- Events, Machine =/= app],
    ?assertMatch({[#{what := unfinished}], _}, run(line(), Silent, End)),
    Twice = line() ++ [{{600.0, 0.0}, {300.0, 0.0}}] ++ line(),
    ?assertMatch(
        {[], #{coverage := 1.0}},
        run(Twice, [for({{300.0, 0.0}, {600.0, 0.0}}, E) || E <- Events], End)
    ),
    ?assertMatch(
        {[], #{coverage := 1.0}},
        run(line(), [for({{0.0, 0.4}, {9.0, 0.4}}, E) || E <- Events], End)
    ),
    ?assertMatch(
        {[_], #{coverage := +0.0}},
        run(line(), [for({{0.0, 0.6}, {9.0, 0.6}}, E) || E <- Events], End)
    ).

%% A stroke is on a line when both of its ends are.
stroke_that_ends_beside_test() ->
    {Events, End} = paint([{0.0, 0.0}, {1000.0, 0.0}]),
    Coverage = fun(Stroke) ->
        {_, #{coverage := C}} = run(line(), [for(Stroke, E) || E <- Events], End),
        C
    end,
    On = {9.0, 0.4},
    [
        ?assertEqual({Stroke, Expected}, {Stroke, Coverage(Stroke)})
     || {Stroke, Expected} <- [
            {{On, {500.0, 0.5}}, 1.0}, {{On, {500.0, 0.6}}, 0.0}, {{{500.0, 0.6}, On}, 0.0}
        ]
    ].

%% Every line counts, however short.
shortest_line_test() ->
    Unpainted = fun(Mm) ->
        {_, #{unpainted_mm := Left}} = run([{{0.0, 0.0}, {Mm, 0.0}}], [], ?S, #{ends_mm => 0.0}),
        Left
    end,
    ?assertEqual([0.01, 0.499, 0.5], [Unpainted(Mm) || Mm <- [0.01, 0.499, 0.5]]).

%% A robot with its pen down that sets out to paint another line has a dot of ink where it stands. It
%% need not move if the line ends within 2 mm of it.
a_short_line_is_painted_where_the_robot_stands_test() ->
    Corner = fun(Mm) -> [{{0.0, 0.0}, {1000.0, 0.0}}, {{1000.0, 0.0}, {1000.0, Mm}}] end,
    {Events, End} = paint([{0.0, 0.0}, {1000.0, 0.0}]),
    Drawing = [Event || {T, _, _, _} = Event <- Events, T < End],
    Then = fun(Mm, Pen) ->
        [_, Short] = Corner(Mm),
        Stands = [
            motion(End, 1, stand(End, 1000.0, 0.0)),
            pen(End + 1, 1, Pen),
            stroke(End + 2, 1, Short),
            pen(End + 3, 1, up)
        ],
        {Found, _} = run(Corner(Mm), Drawing ++ Stands, End + ?S),
        [{What, Details} || #{what := What, details := Details} <- Found]
    end,
    [?assertEqual({Mm, []}, {Mm, Then(Mm, down)}) || Mm <- [0.01, 0.3, 0.6, 1.9, 2.0]],
    %% the rest of a longer one is missing, and without ink all of it
    ?assertMatch([{unfinished, #{unpainted_mm := Mm}}] when Mm > 2.99, Then(3.0, down)),
    ?assertMatch([{unfinished, #{unpainted_mm := Mm}}] when Mm > 0.59, Then(0.6, up)).

%% A line so short that its ends are one point of the plan has no stroke of its own: it is painted
%% with the line that it lies on.
a_tiny_line_is_painted_with_its_neighbour_test() ->
    {Events, End} = paint([{0.0, 0.0}, {1000.0, 0.0}]),
    With = fun(Tiny) -> run([Tiny | line()], Events, End) end,
    [
        ?assertMatch({[], #{coverage := 1.0}}, With({{X, 0.0}, {X + 0.02, 0.03}}))
     || X <- [0.0, 400.0, 999.99]
    ],
    ?assertMatch({[#{what := unfinished}], _}, With({{500.0, 0.6}, {500.02, 0.6}})),
    ?assertMatch({[#{what := unfinished}], _}, With({{500.0, 0.0}, {500.0, 0.6}})).

no_lines_are_all_painted_test() ->
    ?assertMatch({[], #{coverage := 1.0}}, run([], [], ?S)).

%%% Ink on the lines and nowhere else

driving_with_the_pen_up_is_free_test() ->
    {Events, End} = tour(0, 1, [{0.0, 0.0}, {3000.0, 3000.0}]),
    Driving = [E || {_, _, _, _} = E <- Events],
    ?assertEqual([], judge(line(), Driving, End)),
    ?assertEqual([ink_off_the_lines], judge(line(), Driving ++ [pen(End, 1, down)], End)).

ink_beside_the_line_at_the_limit_test() ->
    Beside = fun(Y) ->
        {Events, End} = paint([{0.0, Y}, {1000.0, Y}]),
        judge(line(), Events, End)
    end,
    ?assertEqual([], Beside(10.0)),
    ?assertEqual([ink_off_the_lines], Beside(10.001)).

%% A robot of which more is known is held to that.
own_ink_radius_test() ->
    {Events, End} = paint([{0.0, 9.0}, {1000.0, 9.0}]),
    Judge = fun(Own) ->
        {Found, _} = run(line(), Events, End, #{tracking_mm => Own}),
        [What || #{what := ink_off_the_lines = What} <- Found]
    end,
    ?assertEqual([[], []], [Judge(#{}), Judge(#{2 => 1.0})]),
    ?assertEqual([ink_off_the_lines], Judge(#{1 => 1.0})),
    %% 8 mm of its own and 1 mm of tolerance reach just as far; never farther than all others'
    ?assertEqual([[], [ink_off_the_lines]], [Judge(#{1 => Mm}) || Mm <- [8.0, 7.9]]),
    {Far, Last} = paint([{0.0, 10.5}, {1000.0, 10.5}]),
    {Found, _} = run(line(), Far, Last, #{tracking_mm => #{1 => 20.0}}),
    ?assert(lists:member(ink_off_the_lines, [What || #{what := What} <- Found])).

ink_past_the_end_of_the_line_test() ->
    Past = fun(X) ->
        {Events, End} = paint([{0.0, 0.0}, {X, 0.0}]),
        judge(line(), Events, End)
    end,
    ?assertEqual([], Past(1009.99)),
    ?assertEqual([ink_off_the_lines], Past(1011.0)).

%% Less than a millimetre of ink is judged like any other: its first half lies on the line.
short_ink_past_the_end_test() ->
    Past = fun(From, To) ->
        {Events, End} = paint([{From, 0.0}, {To, 0.0}]),
        judge(line(), Events, End)
    end,
    ?assertEqual([], Past(1009.2, 1010.0)),
    ?assertEqual([ink_off_the_lines], Past(1009.6, 1010.4)).

%% The ink leaves the line and comes back: both ends of the piece are on lines.
shortcut_across_a_corner_test() ->
    {Events, End} = paint([{500.0, 0.0}, {1000.0, 500.0}]),
    {[Violation], _} = run(square(), Events, End, #{complete => false}),
    #{what := ink_off_the_lines, at_us := At, robots := [1], details := Details} = Violation,
    %% It leaves when it is 10 mm above the bottom line.
    ?assert(abs(At - round(10.0 * math:sqrt(2) * 1.0e4)) < 10),
    ?assert(abs(maps:get(distance_mm, Details) - 250.0) < 10.0).

around_a_corner_test() ->
    {Events, End} = paint([{500.0, 0.0}, {1000.0, 0.0}, {1000.0, 500.0}]),
    ?assertEqual([], judge(square(), Events, End)).

%% One report per lowering of the pen.
reported_once_per_stroke_test() ->
    {Off, End1} = paint([{0.0, 100.0}, {100.0, 100.0}, {200.0, 100.0}]),
    {Again, End2} = paint(End1, 1, [{0.0, 100.0}, {100.0, 100.0}]),
    ?assertEqual([ink_off_the_lines, ink_off_the_lines], judge(line(), Off ++ Again, End2)).

dot_beside_the_line_test() ->
    Dot = fun(Y) ->
        judge(
            line(),
            [
                motion(0, 1, stand(0, 50.0, Y)),
                pen(5, 1, down),
                pen(5, 1, up)
            ],
            10
        )
    end,
    ?assertEqual([], Dot(9.0)),
    ?assertEqual([ink_off_the_lines], Dot(12.0)).

%% The pen is still down and the robot under way when the run ends.
open_stroke_is_judged_test() ->
    Drive = starl_trajectory:piece(0, {900.0, 0.0}, 0.0, 100.0, 0.0),
    Events = [motion(0, 1, Drive), pen(0, 1, down)],
    ?assertEqual([], judge(line(), Events, ?S)),
    ?assertEqual([ink_off_the_lines], judge(line(), Events, 2 * ?S)).

dead_robot_stays_test() ->
    Drive = starl_trajectory:piece(0, {900.0, 0.0}, 0.0, 100.0, 0.0),
    Events = [motion(0, 1, Drive), pen(0, 1, down), {?S, 1, robot, {died, killed}}],
    ?assertEqual([], judge(line(), Events, 99 * ?S)).

%% An arc on its chords' lines: a quarter circle of radius 300 in 8 lines.
arc_on_a_flattened_arc_test() ->
    Lines = [{on_circle(I), on_circle(I + 1)} || I <- lists:seq(0, 7)],
    Turn = math:pi() / 20,
    Arc = starl_trajectory:piece(0, {0.0, 0.0}, 0.0, 300.0 * Turn, Turn),
    Strokes = [
        stroke(round(1.25 * ?S) * I, 1, Line)
     || {I, Line} <- lists:zip(lists:seq(0, 7), Lines)
    ],
    Events = [motion(0, 1, Arc), pen(0, 1, down)] ++ Strokes ++ [pen(10 * ?S, 1, up)],
    {[], #{coverage := 1.0, ink_mm := Ink}} = run(Lines, Events, 10 * ?S),
    ?assert(abs(Ink - 150.0 * math:pi()) < 1.0e-6),
    %% The sagitta of these lines is 1.44 mm.
    Tight = #{ink_radius_mm => 1.0, tolerance_mm => 0.3, complete => false},
    ?assertMatch({[#{what := ink_off_the_lines}], _}, run(Lines, Events, 10 * ?S, Tight)).

on_circle(I) ->
    Angle = I * math:pi() / 16,
    {300.0 * math:sin(Angle), 300.0 - 300.0 * math:cos(Angle)}.

%% An arc that leaves a straight line: 300 (1 - cos a) is 10 mm for a = 0.25857 radians.
arc_leaves_the_line_test() ->
    Arc = starl_trajectory:piece(0, {0.0, 0.0}, 0.0, 30.0, 0.1),
    Events = [motion(0, 1, Arc), pen(0, 1, down)],
    Leave = round(?S * math:acos(29.0 / 30.0) / 0.1),
    ?assertEqual([], judge(line(), Events, Leave - 20_000)),
    {[#{at_us := At}], _} = run(line(), Events, 5 * ?S, #{complete => false}),
    ?assert(abs(At - Leave) < 20_000).

a_jump_is_not_connected_test() ->
    Events = [
        motion(0, 1, stand(0, 0.0, 0.0)),
        pen(0, 1, down),
        motion(5, 1, stand(5, 900.0, 0.0))
    ],
    {[], #{ink := #{1 := Polylines}}} = run(line(), Events, 9, #{complete => false}),
    ?assertEqual([[{0.0, 0.0}], [{900.0, 0.0}]], Polylines).

%% One is a jump from a thousandth of a millimetre on.
small_jump_test() ->
    Polylines = fun(X) ->
        Events = [
            motion(0, 1, stand(0, 0.0, 0.0)), pen(0, 1, down), motion(5, 1, stand(5, X, 0.0))
        ],
        {[], #{ink := #{1 := Ink}}} = run(line(), Events, 9, #{complete => false}),
        length(Ink)
    end,
    ?assertEqual([1, 2], [Polylines(0.0005), Polylines(0.5)]).

%% A motion that is told before it begins changes nothing until then.
told_beforehand_test() ->
    Drive = starl_trajectory:piece(0, {0.0, 0.0}, 0.0, 100.0, 0.0),
    Then = stand(2 * ?S, 200.0, 0.0),
    Events = [motion(0, 1, Drive), pen(0, 1, down), motion(?S, 1, Then)],
    {[], #{ink_mm := Ink}} = run(line(), Events, 5 * ?S, #{complete => false}),
    ?assert(abs(Ink - 200.0) < 1.0e-6).

%% At the end the robots come in their order, also where there are many.
strays_of_many_test() ->
    Robots = lists:seq(1, 40),
    Drive = starl_trajectory:piece(0, {900.0, 0.0}, 0.0, 100.0, 0.0),
    Events = [E || R <- Robots, E <- [motion(0, R, Drive), pen(0, R, down)]],
    {Found, _} = run(line(), Events, 2 * ?S, #{complete => false}),
    ?assertEqual([[R] || R <- Robots], [Who || #{robots := Who} <- Found]).

%%% Intervals and coverage against sampling

within_against_sampling_test() ->
    lists:foldl(fun(N, S) -> within_case(N, S) end, rand:seed_s(exsss, 7), lists:seq(1, 500)).

within_case(N, S0) ->
    {A, S1} = random_segment(S0),
    {B, S2} = random_segment(S1),
    {R, S3} = rand:uniform_s(S2),
    Reach = 60.0 * R,
    Part = starl_painting_monitor_parts:within(Reach, A, B),
    Length = starl_geometry:length(A),
    [
        begin
            Point = starl_geometry:interpolate(element(1, A), element(2, A), I / 400),
            Margin = Reach - starl_geometry:point_segment(Point, B),
            ?assert(agrees(Margin, inside(I / 400 * Length, Part)), {seed, 7, N, A, B, Reach, I})
        end
     || I <- lists:seq(0, 400)
    ],
    S3.

agrees(Margin, _Inside) when abs(Margin) < 1.0e-9 -> true;
agrees(Margin, Inside) -> Inside =:= (Margin > 0).

inside(_Mm, none) -> false;
inside(Mm, {From, To}) -> Mm >= From - 1.0e-9 andalso Mm =< To + 1.0e-9.

random_segment(S0) ->
    {[X1, Y1, X2, Y2], S} = lists:mapfoldl(fun(_, S) -> rand:uniform_s(S) end, S0, [1, 2, 3, 4]),
    {{{100.0 * X1, 100.0 * Y1}, {100.0 * X2, 100.0 * Y2}}, S}.

coverage_against_sampling_test_() ->
    {timeout, 60, fun() -> [coverage_case(Seed) || Seed <- lists:seq(1, 20)] end}.

%% Scribbles beside random lines, each for one of them; of how much of a line is ink to the left or
%% right?
coverage_case(Seed) ->
    {Lines, S1} = lists:mapfoldl(
        fun(_, S) -> random_segment(S) end,
        rand:seed_s(exsss, Seed),
        lists:seq(1, 6)
    ),
    {Inks, _} = lists:mapfoldl(fun(_, S) -> random_segment(S) end, S1, lists:seq(1, 18)),
    For = [lists:nth(1 + I rem 6, Lines) || I <- lists:seq(1, 18)],
    Each = fun({{A, B}, Line}, {T, All}) ->
        {Drawn, End} = paint(T, 1, [A, B]),
        {End + 1, All ++ [for(Line, E) || E <- Drawn]}
    end,
    {End, Events} = lists:foldl(Each, {0, []}, lists:zip(Inks, For)),
    {_, #{inked := Inked}} = run(Lines, Events, End, #{complete => false}),
    Total = lists:sum([starl_geometry:length(Line) || Line <- Lines]),
    Beside = lists:sum([
        starl_geometry:length(Line) *
            beside_part(Line, [Ink || {Ink, L} <- lists:zip(Inks, For), L =:= Line])
     || Line <- Lines
    ]),
    ?assert(abs(Inked - Beside / Total) < 0.005, {seed, Seed, Inked, Beside / Total}).

beside_part({A, B} = Line, Inks) ->
    Samples = [starl_geometry:interpolate(A, B, (I + 0.5) / 1000) || I <- lists:seq(0, 999)],
    Near = [P || P <- Samples, lists:any(fun(Ink) -> crosses(P, Line, Ink) end, Inks)],
    length(Near) / 1000.

%% Does the ink cross the perpendicular through this point, within reach of it?
crosses(P, {A, B}, Ink) ->
    Across = starl_geometry:heading(A, B) + math:pi() / 2,
    Off = fun(Mm) ->
        {element(1, P) + Mm * math:cos(Across), element(2, P) + Mm * math:sin(Across)}
    end,
    starl_geometry:segment_segment({Off(-?REACH), Off(?REACH)}, Ink) < 1.0e-9.

%% A pen may be lowered before anything is known of where the robot is: no ink is seen.
pen_before_motion_test() ->
    {Found, Results} = run(line(), [pen(1, 1, down), pen(2, 1, up)], 9, #{complete => false}),
    ?assertEqual([], Found),
    ?assertMatch(#{ink_mm := +0.0, driven_mm := +0.0}, Results).
