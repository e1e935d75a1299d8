-module(starl_bodies_tests).
-include_lib("eunit/include/eunit.hrl").

%% Drives in a test, and as many as one likes: STARL_DRIVES=10000.
-define(DRIVES, 300).
-define(ROBOTS, 6).

%% Blind drives into walls, each other, boxes that are put down and doors that close: no body is ever in a wall, none goes through another, and
%% all ways of running come to the same digest.
%% Holds: No body is ever in a wall, a closed door or a box, none goes through another, in all ways
%% of running
%% Red: without a look at obstacles, run: `in_a_wall` in 3 of 10 runs
blind_drives_test_() ->
    Seed = number("STARL_SEED", erlang:phash2(make_ref(), 1 bsl 24)),
    Runs = number("STARL_DRIVES", ?DRIVES) div (?ROBOTS * 10),
    {timeout, 3600, fun() ->
        Found = [drive(Seed + I, chassis(I)) || I <- lists:seq(1, Runs)],
        [] = [{'STARL_SEED', Seed, One} || {problem, _} = One <- Found],
        Bumps = lists:sum([N || {ok, N} <- Found]),
        %% it would judge nothing else
        ?assert(Bumps > Runs)
    end}.

number(Name, Default) ->
    case os:getenv(Name) of
        false -> Default;
        Text -> list_to_integer(Text)
    end.

chassis(I) -> lists:nth(1 + I rem 3, [differential, holonomic, mixed]).

drive(Seed, Chassis) ->
    Scenario = #{
        app => starl_bumper,
        robots => ?ROBOTS,
        drives => 10,
        seed => Seed,
        chassis => Chassis,
        delay => {5, 20},
        random_faults => [closed, obstacle],
        heal => 20
    },
    Ways = [#{mode => process, shards => 1}, #{mode => inline, shards => 1}, #{shards => 3}],
    [First | _] = Outcomes = [outcome(maps:merge(Scenario, Way)) || Way <- Ways],
    Digests = lists:usort([maps:get(digest, Outcome) || Outcome <- Outcomes]),
    #{violations := Violations, monitors := #{starl_contact_monitor := #{bumps := Bumps}}} = First,
    case {Digests, Violations} of
        {[_], []} -> {ok, Bumps};
        _ -> {problem, {Seed, Chassis, Digests, Violations}}
    end.

outcome(Scenario) ->
    {ok, Sim} = starl_sim:start(Scenario),
    _ = starl_sim:run(Sim),
    {Outcome, _} = starl_sim:finish(Sim),
    Outcome.

%% Who drives at a wall again as soon as it feels it, feels it again at the next beat of its sensors: time passes.
%% Holds: A wall that is felt costs time
%% Red: 961f67c9, run: `hung`
a_wall_is_felt_at_the_beats_of_the_sensors_test_() ->
    [
        {
            atom_to_list(Chassis),
            {timeout, 60, fun() ->
                #{violations := Violations, robots := Robots, end_us := EndUs} = outcome(#{
                    app => starl_pusher, robots => 2, bumps => 100, chassis => Chassis
                }),
                ?assertEqual([], Violations),
                ?assertMatch(
                    [{1, #{result := {done, through}}}, {2, #{result := {done, through}}}], Robots
                ),
                ?assert(EndUs >= 99 * 15000)
            end}
        }
     || Chassis <- [differential, holonomic]
    ].

%% A robot that touches another leaves it at first, and its arc bends back into it. Whatever the phase of the chords, it is stopped where it
%% touches again.
%% Holds: A robot that touches another, and whose arc bends back into it, is stopped there
%% Red: before the mend: nobody stopped; of 100 that wander for 307 s two came within 314.5 mm
an_arc_that_bends_back_into_the_other_is_stopped_test() ->
    Profiles = [starl_chassis:profile(starl_chassis_differential, #{})],
    Still = starl_trajectory:standing(0, {0.0, 0.0}, 0.0),
    [
        begin
            Heading = math:pi() / 2 - Leaves,
            Arc = starl_trajectory:piece(0, {329.95, 0.0}, Heading, 111.0, 3.0),
            Sight = starl_sim_sight:new([{1, Still}, {2, Arc}], infinity),
            World = #{profiles => Profiles, sight => Sight, walls => none},
            Touches = starl_sim_bodies:meetings([2], 0, Sight, World),
            Stopped = [At || {2, At, 0, 1, 0, {touch, _, {robot, 1, _, true}}} <- Touches],
            {[At], _} = {Stopped, Leaves},
            %% the other one stands already
            [{1, At, 0, 2, 0, {touch, _, {robot, 2, _, false}}}] = lists:keydelete(2, 1, Touches),
            {X, Y} = starl_trajectory:position(At, Arc),
            ?assert(math:sqrt(X * X + Y * Y) > 329.9)
        end
     || I <- lists:seq(1, 100), Leaves <- [I / 500]
    ].

%% Of two that touch, who drives against the other stops; who is run into goes on.
who_drives_against_the_other_is_stopped_test_() ->
    Profiles = [starl_chassis:profile(starl_chassis_differential, #{})],
    Stops = fun(First, Second) ->
        Pieces = [
            {Id, starl_trajectory:piece(0, {X, 0.0}, Heading, Speed, 0.0)}
         || {Id, {X, Heading, Speed}} <- [{1, First}, {2, Second}]
        ],
        Sight = starl_sim_sight:new(Pieces, infinity),
        World = #{profiles => Profiles, sight => Sight, walls => none},
        [{1, At, 0, 2, 0, {touch, _, One}}, {2, At, 0, 1, 0, {touch, _, Two}}] =
            starl_sim_bodies:meetings([1, 2], 0, Sight, World),
        {element(4, One), element(4, Two)}
    end,
    Ahead = {400.0, 0.0, 100.0},
    Behind = {0.0, 0.0, 300.0},
    [
        ?_assertEqual({false, true}, Stops(Ahead, Behind)),
        ?_assertEqual({true, false}, Stops(Behind, Ahead)),
        ?_assertEqual({true, true}, Stops(Behind, {400.0, math:pi(), 100.0})),
        ?_assertEqual({true, false}, Stops(Behind, {400.0, 0.0, 0.0}))
    ].

%% Also within the window in which it begins, however long that is.
%% Holds: An arc that bends back into another robot is stopped within its window
%% Red: d7c73771, run
an_arc_that_bends_back_is_stopped_in_its_window_test() ->
    Profiles = [starl_chassis:profile(starl_chassis_differential, #{})],
    Still = starl_trajectory:standing(0, {2000.0, 2000.0}, 0.0),
    World = #{
        profiles => Profiles,
        sight => starl_sim_sight:new([{1, Still}], infinity),
        walls => starl_walls:new(starl_floor:empty({4000, 4000}))
    },
    [
        begin
            Heading = math:pi() / 2 - Leaves,
            Arc = starl_trajectory:piece(0, {2329.95, 2000.0}, Heading, 111.0, 3.0),
            {Leaves, {At, {touch, Arc, {robot, 1, Still, true}}}} =
                {Leaves, starl_sim_bodies:contact(2, Arc, 0, 900000, World)},
            Away = starl_geometry:distance(starl_trajectory:position(At, Arc), {2000.0, 2000.0}),
            ?assert(Away > 329.9)
        end
     || I <- lists:seq(1, 100), Leaves <- [I / 500]
    ].

a_run_begins_only_where_all_have_room_test_() ->
    Of = fun(More) ->
        starl_sim:plan(maps:merge(#{app => starl_bumper, robots => 2}, More), #{})
    end,
    [
        ?_assertMatch({error, {scene, _}}, Of(#{floor => "gone.floor"})),
        ?_assertMatch({error, {scene, _}}, Of(#{robots => 200})),
        ?_assertMatch({error, {scene, _}}, Of(#{start => "gone.txt"})),
        ?_assertMatch({ok, {#{world := {12330.0, 8550.0}}, _, _}}, Of(#{floor => "search"})),
        ?_assertMatch({ok, {#{world := {3000.0, 2600.0}}, _, _}}, Of(#{start => "random"}))
    ].

%% On a small floor without a plan they stand closer than in rows two metres apart, which would end beyond it.
%% Holds: Nobody starts off a small floor
%% Red: rows two metres apart: seven of eight robots off 3 m x 3 m
nobody_starts_off_a_small_floor_test_() ->
    Poses = fun(N, World) ->
        {ok, {_, Scene, _}} = starl_sim:plan(
            #{app => starl_looker, robots => N, world => World}, #{}
        ),
        maps:values(maps:get(poses, Scene, #{}))
    end,
    Distance = fun({X, Y, _}, {X2, Y2, _}) -> starl_geometry:distance({X, Y}, {X2, Y2}) end,
    [
        {
            lists:concat([N, " robots"]),
            fun() ->
                Own = Poses(N, {3000, 3000}),
                ?assertEqual(N, length(Own)),
                [
                    ?assert(X > 165 andalso X < 2835 andalso Y > 165 andalso Y < 2835)
                 || {X, Y, _} <- Own
                ],
                [?assert(Distance(P, Q) > 330) || P <- Own, Q <- Own, P < Q]
            end
        }
     || N <- [2, 8, 20]
    ] ++
        %% where they have room, and on the usual floor, they stand in rows; a crowd without room does, too
        [
            ?_assertEqual([], Poses(N, World))
         || {N, World} <- [{9, {6000, 6000}}, {200, {12000, 12000}}, {500, {3000, 3000}}]
        ].
