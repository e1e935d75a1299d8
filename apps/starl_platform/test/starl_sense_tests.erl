%% Senses: what they say of walls, bodies and things, and what no reading ever is, whatever the
%% errors.
%%
%% Holds: Beams and fields of view are where they point to
%% Red: planted, run
-module(starl_sense_tests).
-include_lib("eunit/include/eunit.hrl").

%% Two rooms, 4 m x 3 m, with a wall between them that has a gap at y 0 to 1000.
walls() ->
    starl_walls:new(
        starl_floor:new(#{size => {4000, 3000}, walls => [[{2000, 1000}, {2000, 3000}]]})
    ).

view(More) ->
    maps:merge(
        #{
            pose => {1000.0, 2000.0, 0.0},
            radius_mm => 165.0,
            now_us => 0,
            driven_mm => 0.0,
            walls => walls(),
            bodies => [],
            things => [],
            draw => fun(_) -> 0.5 end
        },
        More
    ).

exact(Kind, Errors) ->
    {ok, Profiles} = starl_sense:profiles(#{Kind => Errors}),
    Profiles.

%% -- a line of sight ------------------------------------------------------------------------

a_ray_ends_at_the_first_thing_test() ->
    Ray = fun(Angle, Most, Discs) ->
        starl_sight:ray({1000.0, 2000.0}, Angle, Most, Discs, walls())
    end,
    ?assert(near(1000.0, Ray(0.0, 5000.0, []))),
    ?assertEqual(none, Ray(0.0, 999.0, [])),
    ?assert(near(1000.0, Ray(math:pi() / 2, 5000.0, []))),
    ?assert(near(400.0, Ray(0.0, 5000.0, [{{1500.0, 2000.0}, 100.0}]))),
    ?assert(near(1000.0, Ray(0.0, 5000.0, [{{1500.0, 2101.0}, 100.0}]))).

near(Expected, Mm) -> abs(Expected - Mm) < 1.0e-6.

walls_and_bodies_hide_test() ->
    Clear = fun(To, Discs) -> starl_sight:is_clear({1000.0, 2000.0}, To, Discs, walls()) end,
    ?assertNot(Clear({3000.0, 2000.0}, [])),
    ?assert(Clear({1900.0, 500.0}, [])),
    ?assert(Clear({2900.0, 50.0}, [])),
    ?assertNot(Clear({1900.0, 500.0}, [{{1450.0, 1250.0}, 165.0}])),
    %% the one that is looked at does not hide itself
    ?assert(Clear({1900.0, 500.0}, [{{1900.0, 500.0}, 165.0}])).

%% -- senses ---------------------------------------------------------------------------------

the_camera_sees_in_its_field_only_test() ->
    Profiles = exact(camera, #{noise => 0, noise_part => 0, missed => 0, invented => 0}),
    See = fun(At, Heading) ->
        Things = [#{at => At, colour => orange}],
        starl_sense:read(
            camera, view(#{things => Things, pose => {1000.0, 2000.0, Heading}}), Profiles
        )
    end,
    [#{colour := orange, bearing := Left, mm := Mm}] = See({1500.0, 2100.0}, 0.0),
    ?assert(Left > 0.19 andalso Left < 0.2),
    ?assert(abs(Mm - 509.9) < 0.1),
    ?assertEqual([], See({500.0, 2000.0}, 0.0)),
    ?assertMatch([#{}], See({500.0, 2000.0}, math:pi())),
    %% behind the wall
    ?assertEqual([], See({3000.0, 2000.0}, 0.0)).

%% Half of the angle of view lies on each side, for each angle and each heading.
what_is_beside_the_field_is_not_seen_test() ->
    [
        begin
            Profiles = exact(camera, #{
                field => Field, noise => 0, noise_part => 0, missed => 0, invented => 0
            }),
            Angle = Heading + Side * (Field / 2 + Off),
            At = {1000.0 + 400 * math:cos(Angle), 2000.0 + 400 * math:sin(Angle)},
            View = view(#{
                things => [#{at => At, colour => orange}], pose => {1000.0, 2000.0, Heading}
            }),
            Seen = starl_sense:read(camera, View, Profiles),
            ?assertEqual(
                {Field, Heading, Side, Off, Off < 0}, {Field, Heading, Side, Off, Seen =/= []}
            )
        end
     || Field <- [0.5, 1.05, 2.1, 4.0],
        Heading <- [0.0, 1.3, -2.5],
        Side <- [-1, 1],
        Off <- [-0.05, 0.05]
    ].

%% A beam to the left ends at what is to the left, whatever the heading.
beams_end_where_they_point_to_test() ->
    Profiles = exact(range, #{noise => 0, noise_mm => 0, missed => 0, invented => 0}),
    [
        begin
            Body = {2, {2000.0 + 800 * math:cos(At), 1500.0 + 800 * math:sin(At)}, 165.0},
            View = view(#{
                pose => {2000.0, 1500.0, Heading},
                walls => starl_walls:new(starl_floor:empty({4000, 3000})),
                bodies => [Body]
            }),
            Beams = starl_sense:read(range, View, Profiles),
            {Nearest, _} = lists:foldl(
                fun
                    ({B, Mm}, {_, Least}) when is_float(Mm), Mm < Least -> {B, Mm};
                    (_, Least) -> Least
                end,
                {none, 1.0e9},
                Beams
            ),
            ?assert(abs(Nearest - Bearing) < 0.11, {Heading, Bearing, Nearest})
        end
     || Heading <- [0.0, 1.3, -2.5],
        Bearing <- [-1.4, -0.7, 0.0, 0.7, 1.4],
        At <- [Heading + Bearing]
    ].

the_bumper_tells_the_side_test() ->
    At = fun(Pose, Bodies) ->
        starl_sense:read(bump, view(#{pose => Pose, bodies => Bodies}), exact(bump, #{}))
    end,
    ?assertEqual(none, At({1000.0, 2000.0, 0.0}, [])),
    ?assertEqual(both, At({1834.5, 2000.0, 0.0}, [])),
    ?assertEqual(left, At({1834.5, 2000.0, -0.8}, [])),
    ?assertEqual(right, At({1834.5, 2000.0, 0.8}, [])),
    ?assertEqual(none, At({1834.5, 2000.0, 3.0}, [])),
    ?assertEqual(both, At({1000.0, 2000.0, 0.0}, [{2, {1330.0, 2000.0}, 165.0}])).

%% It misses touches, and feels some that are none; a sound one does neither.
%% Holds: A noisy bumper misses half a per cent of the touches, and invents as many, so many times
%% Red: 862fcda8, run: it never errs
a_noisy_bumper_errs_test() ->
    {ok, Sound} = starl_sense:profiles(#{}),
    Said = fun(Pose, Profiles) ->
        [
            starl_sense:read(
                bump,
                (view(#{pose => Pose}))#{
                    draw => fun(For) -> erlang:phash2({N, For}, 1000000) / 1.0e6 end
                },
                Profiles
            )
         || N <- lists:seq(1, 2000)
        ]
    end,
    {Free, Touching} = {{1000.0, 2000.0, 0.0}, {1834.5, 2000.0, 0.0}},
    ?assertEqual([none], lists:usort(Said(Free, Sound))),
    ?assertEqual([both], lists:usort(Said(Touching, Sound))),
    Noisy = starl_sense:noisy(bump, 10, Sound),
    ?assertEqual([both, left, none, right], lists:usort(Said(Free, Noisy))),
    ?assertEqual([both, none], lists:usort(Said(Touching, Noisy))),
    %% half a per cent, ten times
    Errs = fun(Right, All) -> length([S || S <- All, S =/= Right]) end,
    [
        ?assert(N > 70 andalso N < 130, {Right, N})
     || {Right, Pose} <- [{none, Free}, {both, Touching}],
        N <- [Errs(Right, Said(Pose, Noisy))]
    ].

robots_in_sight_have_bearings_test() ->
    Profiles = exact(bearing, #{noise => 0, noise_part => 0, missed => 0}),
    Bodies = [
        {2, {1000.0, 2800.0}, 165.0},
        {3, {1500.0, 2000.0}, 165.0},
        %% hidden by robot 3, and by the wall
        {4, {1900.0, 2000.0}, 165.0},
        {5, {3000.0, 2000.0}, 165.0}
    ],
    ?assertMatch(
        [#{robot := 3, mm := 500.0}, #{robot := 2, mm := 800.0}],
        starl_sense:read(bearing, view(#{bodies => Bodies}), Profiles)
    ).

light_falls_with_the_distance_and_in_shadows_test() ->
    Profiles = exact(light, #{noise => 0}),
    Light = fun(At, Bodies) ->
        Things = [#{at => At, lamp_mm => 1000}],
        starl_sense:read(light, view(#{things => Things, bodies => Bodies}), Profiles)
    end,
    ?assert(abs(Light({1000.0, 1000.0}, []) - math:exp(-1)) < 1.0e-9),
    ?assertEqual(0.0, Light({3000.0, 2000.0}, [])),
    ?assertEqual(0.0, Light({1000.0, 1000.0}, [{2, {1000.0, 1500.0}, 165.0}])).

a_battery_empties_test() ->
    Profiles = exact(battery, #{noise => 0, rests_s => 100, drives_mm => 1000}),
    Left = fun(S, Mm) ->
        starl_sense:read(battery, view(#{now_us => S * 1000000, driven_mm => Mm}), Profiles)
    end,
    ?assertEqual([1.0, 0.75, 0.25, 0.0], [
        Left(0, 0.0), Left(25, 0.0), Left(25, 500.0), Left(99, 900.0)
    ]).

%% Random surroundings, usual and large errors, and guesses: a reading is always one that may be.
no_reading_is_out_of_bounds_test() ->
    Seed = seed(),
    {ok, Usual} = starl_sense:profiles(#{}),
    Bad = [
        {Seed, N, Kind, Reading}
     || N <- lists:seq(1, 300),
        {Kind, _} <- starl_sense:kinds(),
        View <- [random_view({Seed, N})],
        Profiles <- [Usual, starl_sense:noisy(Kind, 20, Usual)],
        Reading <- [
            starl_sense:read(Kind, View, Profiles),
            starl_sense:guess(Kind, maps:get(draw, View), Profiles)
        ],
        not starl_sense:is_reading(Kind, Reading, Usual)
    ],
    ?assertEqual([], Bad).

seed() ->
    case os:getenv("STARL_SEED") of
        false -> erlang:phash2(make_ref(), 1 bsl 24);
        Text -> list_to_integer(Text)
    end.

random_view(Key) ->
    U = fun(Purpose) -> erlang:phash2({Key, Purpose}, 1 bsl 27) / (1 bsl 27) end,
    At = fun(Purpose) -> {4000 * U({Purpose, x}), 3000 * U({Purpose, y})} end,
    {X, Y} = At(self),
    view(#{
        pose => {X, Y, 6.28 * U(heading) - 3.14},
        now_us => round(2.0e10 * U(now)),
        driven_mm => 4.0e6 * U(driven),
        bodies => [{N, At({body, N}), 165.0} || N <- [2, 3, 4]],
        things => [#{at => At({thing, N}), colour => red, lamp_mm => 500} || N <- [1, 2]],
        draw => U
    }).

%% What is no reading is told apart, or the test above could not fail.
readings_that_cannot_be_test() ->
    {ok, Usual} = starl_sense:profiles(#{}),
    [
        ?assertNot(starl_sense:is_reading(Kind, Reading, Usual))
     || {Kind, Reading} <- [
            {bump, behind},
            {range, [{0.0, 10.0}]},
            {bearing, [#{robot => 2, bearing => 0.0, mm => 3001.0}]},
            {camera, [#{colour => red, bearing => 1.2, size => 0.1, mm => 100.0}]},
            {light, -0.1},
            {battery, 1.1}
        ]
    ].

a_mistake_in_a_profile_is_one_line_test() ->
    Line = fun(Own) ->
        {error, Why} = starl_sense:profiles(Own),
        lists:flatten(Why)
    end,
    ?assertEqual("there is no sense nose", Line(#{nose => #{}})),
    ?assertMatch("the sense camera has no angle; it has" ++ _, Line(#{camera => #{angle => 1}})),
    ?assertEqual("the sense light: noise is a number from 0", Line(#{light => #{noise => -1}})).
