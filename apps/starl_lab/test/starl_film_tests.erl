%% A film shows where the robots are and what they drew, at each time; its end is the whole picture.
-module(starl_film_tests).
-include_lib("eunit/include/eunit.hrl").

%% A robot that drives 1 m to the right in 2 s, with its pen down in the second second.
scene() ->
    Facts = #{
        app => starl_painting,
        scenario => #{world => {4000, 2000}},
        robots => [{1, {500.0, 500.0, 0.0}}],
        monitors => [{m, #{lines => [{{1000.0, 500.0}, {1500.0, 500.0}}]}}],
        machines => #{},
        waypoints => #{},
        kind => simulation
    },
    Messages = [
        {scenario, 0, Facts},
        {trace, 0, {1, chassis, {motion, {piece, 0, 500.0, 500.0, 0.0, 500.0, 0.0}}}},
        {trace, 1000000, {1, chassis, {actuated, pen, down}}},
        {trace, 2000000, {1, chassis, {motion, {piece, 2000000, 1500.0, 500.0, 0.0, 0.0, 0.0}}}},
        {trace, 2000000, {1, chassis, {actuated, pen, up}}},
        {trace, 3000000, {1, robot, down}}
    ],
    Cast = lists:foldl(fun starl_film_cast:message/2, starl_film_cast:new(), Messages),
    {ok, Scene} = starl_film_cast:scene(Cast),
    Scene.

the_scene_test() ->
    #{actors := [#{way := Way, ink := [Ink], down := Down}], end_us := 3000000} = scene(),
    ?assertEqual([750.0, 500.0, 0.0], starl_film_series:at(500000, Way)),
    ?assertEqual([{1000000, [1000.0, 500.0]}, {2000000, [1500.0, 500.0]}], Ink),
    ?assertEqual([{3000000, 3000000}], Down).

%% The film of a robot that counts from 1970 begins with its recording.
late_test() ->
    Begun = 1795451471512000,
    Facts = #{
        app => starl_painting,
        scenario => #{},
        monitors => [],
        begun_us => Begun
    },
    Messages = [
        {scenario, Begun, Facts},
        {poses, Begun + 100, #{full => false, robots => [{1, {1.0, 2.0, 0.0}, down, unknown}]}},
        {poses, Begun + 500, #{full => false, robots => [{1, {9.0, 2.0, 0.0}, up, unknown}]}},
        {trace, Begun + 700, {1, robot, down}}
    ],
    Cast = lists:foldl(fun starl_film_cast:message/2, starl_film_cast:new(), Messages),
    {ok, #{actors := [Actor], end_us := End}} = starl_film_cast:scene(Cast),
    ?assertMatch(
        #{
            way := [{100, [1.0, 2.0, 0.0]}, {500, [9.0, 2.0, 0.0]}],
            ink := [[{100, [1.0, 2.0]}, {500, [9.0, 2.0]}]],
            down := [{700, 700}]
        },
        Actor
    ),
    ?assertEqual(700, End).

nothing_moves_test() ->
    ?assertEqual({error, empty}, starl_film_cast:scene(starl_film_cast:new())).

thin_keeps_the_tolerance_test() ->
    Points = [{T, [100 * math:sin(T / 10), float(T)]} || T <- lists:seq(0, 100)],
    Thin = starl_film_series:thin(2.0, Points),
    ?assert(length(Thin) < 50),
    [
        ?assert(abs(X - hd(starl_film_series:at(T, Thin))) =< 2.0)
     || {T, [X, _]} <- Points
    ].

the_animation_test() ->
    Svg = starl_film_svg:film(scene(), #{seconds => 6.0, title => "a < b"}),
    ?assertEqual(nomatch, binary:match(Svg, <<"<script">>)),
    ?assertMatch({_, _}, binary:match(Svg, <<"<title>a &lt; b</title>">>)),
    %% of 10 s 6 move: the ink begins after 2 s, and is drawn after 4 s
    ?assertMatch(
        {_, _},
        binary:match(
            Svg,
            <<"dur=\"10.0s\" repeatCount=\"indefinite\" keyTimes=\"0;.2;.2;.4;1\" values=\"510;510;501;0;0\"">>
        )
    ),
    %% the picture at rest is the last one
    ?assertMatch({_, _}, binary:match(Svg, <<"<g transform=\"translate(1500,1500)\">">>)),
    {_, []} = xmerl_scan:string(binary_to_list(Svg)).

%% Robot 1 drives 500 mm a second; its link to robot 2 is cut from 1 s to 2 s, by two faults; robot 2 is
%% alone from 1.5 s on, and nobody has said until when.
parted() ->
    Facts = #{
        app => starl_painting,
        scenario => #{
            world => {4000, 2000},
            faults => [
                {there, 1000, 2000, loss, {1, 2}, #{}},
                {back, 1000, 2000, loss, {2, 1}, #{}},
                {all, 1000, 2000, loss, all, #{}},
                {unknown, 1000, 2000, isolate, 3, #{}},
                {late, 9000, 9500, isolate, 1, #{}},
                {killed, 1000, 1000, kill_robot, 1, #{}}
            ]
        },
        monitors => []
    },
    Messages = [
        {scenario, 0, Facts},
        {trace, 0, {1, chassis, {motion, {piece, 0, 500.0, 500.0, 0.0, 500.0, 0.0}}}},
        {trace, 0, {2, chassis, {motion, {piece, 0, 500.0, 1500.0, 0.0, 0.0, 0.0}}}},
        {faults, 1500000, {began, {manual_1, 1500, forever, isolate, [2], #{}}}},
        {trace, 3000000, {2, robot, down}}
    ],
    Cast = lists:foldl(fun starl_film_cast:message/2, starl_film_cast:new(), Messages),
    {ok, Scene} = starl_film_cast:scene(Cast),
    Scene.

cuts_test() ->
    #{cuts := Cuts} = parted(),
    Expected = [{{ring, 2}, {1500000, 3000000}}, {{link, 1, 2}, {1000000, 2000000}}],
    ?assertEqual(Expected, Cuts).

cuts_in_the_film_test() ->
    Svg = starl_film_svg:film(parted(), #{seconds => 6.0, title => "t"}),
    {_, []} = xmerl_scan:string(binary_to_list(Svg)),
    %% 3 s of 10 s take 6 s: from 1 s to 2 s is from .2 to .4
    Line =
        "<line opacity=\"0\" stroke=\"#c40d2e\" .*\"opacity\".*keyTimes=\"0;.2;.4;1\" values=\"0;1;0;0\""
        ".*\"x1\".*keyTimes=\"0;.2;.4;1\" values=\"1000;1000;1500;1500\""
        ".*\"y2\".*values=\"500;500;500;500\"/></line>\n",
    ?assertMatch({match, _}, re:run(Svg, Line)),
    Ring =
        "<circle r=\"200.0?\" [^>]*opacity=\"0\"><animate [^>]*keyTimes=\"0;.3;.6;1\" values=\"0;1;0;0\"/>",
    {match, Rings} = re:run(Svg, Ring, [global]),
    ?assertEqual(1, length(Rings)),
    ?assertEqual(1, length(binary:matches(Svg, <<"<circle r=\"200">>))).

cuts_in_a_frame_test() ->
    Frame = fun(T) -> starl_film_frame:at(T, "t", parted()) end,
    Drawn = fun(T) ->
        {
            re:run(Frame(T), "<line x1=\"1250\" y1=\"1500\" x2=\"500\" y2=\"500\"") =/= nomatch,
            binary:match(Frame(T), <<"<line">>) =/= nomatch,
            length(binary:matches(Frame(T), <<"stroke-dasharray">>))
        }
    end,
    ?assertEqual({false, false, 0}, Drawn(900000)),
    ?assertEqual({true, true, 2}, Drawn(1500000)),
    ?assertEqual({false, false, 1}, Drawn(2000000)),
    {_, []} = xmerl_scan:string(binary_to_list(Frame(1500000))).

a_frame_test() ->
    Svg = starl_film_frame:at(1500000, "t", scene()),
    ?assertMatch({_, _}, binary:match(Svg, <<"d=\"M1000,1500l250,0\"">>)),
    {_, []} = xmerl_scan:string(binary_to_list(Svg)),
    {_, []} = xmerl_scan:string(binary_to_list(starl_film_light:svg(scene()))).

kinds_test() ->
    ?assertEqual(mp4, starl_film:kind("a.MP4")),
    ?assertEqual({error, kind}, starl_film:needs(png, false)),
    ?assertEqual({error, kind}, starl_film:needs(unknown, true)),
    ?assertEqual(ok, starl_film:needs(svg, true)).

%% The walls all the time, a closed door in its time only.
a_floor_plan_test() ->
    Floor = starl_floor:new(#{
        size => {4000, 2000},
        walls => [starl_floor:box(1950, 0, 2050, 1000)],
        doors => [{{2000, 1000}, {2000, 2000}}]
    }),
    Facts = #{
        app => starl_painting,
        scenario => #{
            world => {4000, 2000}, faults => [{shut, 1000, 2000, closed, all, #{door => 1}}]
        },
        floor => Floor,
        robots => [{1, {500.0, 500.0, 0.0}}],
        monitors => [],
        machines => #{},
        waypoints => #{},
        kind => simulation
    },
    Messages = [
        {scenario, 0, Facts},
        {trace, 0, {1, chassis, {motion, {piece, 0, 500.0, 500.0, 0.0, 0.0, 0.0}}}},
        {trace, 3000000, {1, robot, down}}
    ],
    Cast = lists:foldl(fun starl_film_cast:message/2, starl_film_cast:new(), Messages),
    {ok, Scene} = starl_film_cast:scene(Cast),
    Wall = <<"M1950.0,2000.0L2050.0,2000.0L2050.0,1000.0L1950.0,1000.0Z">>,
    Shut = <<"stroke=\"#c40d2e\"">>,
    ?assertEqual([{true, false}, {true, true}, {true, false}], [
        {binary:match(Frame, Wall) =/= nomatch, binary:match(Frame, Shut) =/= nomatch}
     || T <- [500000, 1500000, 2500000], Frame <- [starl_film_frame:at(T, "plan", Scene)]
    ]).

%% -- what applications draw -----------------------------------------------------------------

drawn(At, Shape) ->
    {ok, Drawing} = starl_drawing:new(Shape),
    {trace, At, {1, app, {draw, Drawing}}}.

%% A text of half a second, an area that stays, and a line that is taken away.
drawings() ->
    [
        {scenario, 0, #{app => a, scenario => #{world => {4000, 2000}}, monitors => []}},
        {trace, 0, {1, chassis, {motion, {piece, 0, 500.0, 500.0, 0.0, 500.0, 0.0}}}},
        drawn(1000000, #{key => a, text => "hello <all>", at => {100, 200}, seconds => 0.5}),
        drawn(1000000, #{key => b, area => starl_drawing:circle({9, 9}, 50), colour => red}),
        drawn(1000000, #{key => c, line => [{1, 2}, {3, 4}]}),
        drawn(2000000, #{key => c, line => []}),
        {trace, 4000000, {1, robot, down}}
    ].

drawn_scene() ->
    Cast = lists:foldl(fun starl_film_cast:message/2, starl_film_cast:new(), drawings()),
    {ok, Scene} = starl_film_cast:scene(Cast),
    Scene.

has(Text, Svg) -> string:find(Svg, Text) =/= nomatch.

drawings_in_a_frame_test() ->
    At = fun(T) ->
        Svg = starl_film_frame:at(T, "t", drawn_scene()),
        {has("hello &lt;all&gt;", Svg), has("<polygon", Svg), has("<polyline", Svg)}
    end,
    ?assertEqual({false, false, false}, At(900000)),
    ?assertEqual({true, true, true}, At(1200000)),
    ?assertEqual({false, true, true}, At(1700000)),
    ?assertEqual({false, true, false}, At(3000000)).

%% Without animation it shows the end: the area alone.
drawings_in_the_film_test() ->
    Svg = starl_film_svg:film(drawn_scene(), #{seconds => 4.0, title => "t"}),
    {_, []} = xmerl_scan:string(unicode:characters_to_list(Svg), [{quiet, true}]),
    Begins = fun(Shape) ->
        [Before, _] = string:split(Svg, Shape),
        lists:last(string:split(Before, "<g opacity=", all))
    end,
    ?assertMatch(<<"\"0\"", _/binary>>, Begins("<polyline")),
    ?assertMatch(<<"\"0\"", _/binary>>, Begins("hello &lt;all&gt;")),
    ?assertMatch(<<"\"1\"", _/binary>>, Begins("<polygon")).

%% A run of 10 s with this many measures, of two robots.
measured(Keys) ->
    Facts = #{app => starl_formation, scenario => #{world => {8000, 8000}}, monitors => []},
    Messages =
        [
            {scenario, 0, Facts},
            {trace, 0, {1, chassis, {motion, {piece, 0, 500.0, 500.0, 0.0, 0.0, 0.0}}}}
        ] ++
            [
                {trace, 1000000 * S, {Robot, app, {measure, Key, S * Robot}}}
             || Key <- Keys, S <- lists:seq(0, 10), Robot <- [1, 2]
            ],
    Cast = lists:foldl(fun starl_film_cast:message/2, starl_film_cast:new(), Messages),
    {ok, Scene} = starl_film_cast:scene(Cast),
    Scene.

parts(Pattern, Svg) ->
    case re:run(Svg, Pattern, [global, {capture, all_but_first, list}]) of
        {match, Found} -> Found;
        nomatch -> []
    end.

%% Beneath the film there is a strip for each measure, three at most, with a line for each robot from the first value
%% to the last, and a mark that goes over them with the time.
%% Holds: What is measured reaches table, plot, figures and viewers …: and the film, to the scale
%% of its bar of time
%% Red: a film without curves
curves_test() ->
    Height = fun(Keys) ->
        Film = starl_film_svg:film(measured(Keys), #{seconds => 10.0, title => ""}),
        [[H]] = parts("^<svg [^>]*height=\"(\\d+)\"", Film),
        {Film, list_to_integer(H)}
    end,
    {_, Bare} = Height([]),
    {Film, One} = Height([a]),
    ?assertEqual(Bare + 116, One),
    ?assertEqual(Bare + 348, element(2, Height([a, b, c]))),
    ?assertEqual(Bare + 348, element(2, Height([a, b, c, d]))),
    ?assertEqual([["a: 0 to 20"]], parts("(a: 0 to 20)", Film)),
    %% robot 2 measures twice as much: its line ends at the top, that of robot 1 halfway up
    Lines = parts("style=\"stroke-width:15[^>]*d=\"M0,(\\d+)l8000 ?,?(-\\d+)\"", Film),
    ?assertMatch([[Low, _], [Low, _]], Lines),
    [Half, Full] = [list_to_integer(Up) || [_, Up] <- Lines],
    ?assertEqual(Full, 2 * Half),
    Mark = fun(T) ->
        parts("translate\\((\\d+),0\\)\"/>", starl_film_frame:at(T, "", measured([a])))
    end,
    ?assertEqual([["0"]], Mark(0)),
    ?assertEqual([["4000"]], Mark(5000000)),
    ?assertEqual([["8000"]], Mark(99000000)).
