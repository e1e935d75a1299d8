%% Searches of small floors: the ball is found, or all rooms are searched, and the same in all ways
%% of running.
-module(starl_search_tests).
-export([floor/0]).
-compile({no_auto_import, [floor/1]}).
-include_lib("eunit/include/eunit.hrl").

%% Two rooms with a door, and a closet that nobody can enter.
floor() ->
    starl_floor:new(#{
        size => {5000, 3000},
        walls => [
            starl_floor:box(2450, 0, 2550, 1100),
            starl_floor:box(2450, 1700, 2550, 3000),
            starl_floor:box(4400, 0, 4500, 3000)
        ],
        rooms => #{
            west => starl_floor:box(0, 0, 2450, 3000),
            east => starl_floor:box(2550, 0, 4400, 3000),
            closet => starl_floor:box(4500, 0, 5000, 3000)
        },
        doors => [{{2500, 1100}, {2500, 1700}}],
        places => #{object => {4000, 2500}, start => {400, 400}}
    }).

lines_keep_away_from_walls_test() ->
    Rooms = starl_search_scene:lines(floor(), #{spacing => 1500, wall_mm => 181.0}),
    Walls = starl_walls:new(floor()),
    ?assertEqual([{closet, 1}, {east, 2}, {west, 2}], [{Name, length(L)} || {Name, L} <- Rooms]),
    [
        ?assert(starl_walls:is_free(Line, 181.0, Walls))
     || {_, Lines} <- Rooms, Line <- Lines
    ].

the_closed_room_is_told_before_test() ->
    {ok, Scene} = starl_search:scene(context(#{})),
    #{lines := Lines} = starl_search:preview(Scene),
    ?assertMatch(
        ["2 rooms: east, west", _Metres, "cannot be searched, too narrow or closed: closet"],
        [unicode:characters_to_list(Line) || Line <- Lines]
    ).

mistakes_are_one_line_test() ->
    Why = fun(More) ->
        {error, Line} = starl_search:scene(context(More)),
        lists:flatten(Line)
    end,
    #{places := Places} = floor(),
    NoBall = (floor())#{places := maps:remove(object, Places)},
    ?assertMatch("the floor plan has no place object" ++ _, Why(#{floor => NoBall})),
    ?assertMatch("the floor has parking spots " ++ _, Why(#{robots => lists:seq(1, 60)})).

context(More) ->
    maps:merge(
        #{
            robots => [1, 2],
            world => {5000, 3000},
            floor => floor(),
            seed => 1,
            profiles => [starl_chassis:profile(starl_chassis_differential, #{})],
            sap => #{},
            options => maps:from_list([{Key, Value} || {Key, _, Value, _} <- starl_search:options()])
        },
        More
    ).

searches_test_() ->
    [
        {timeout, 120, fun() ->
            Ways = [#{mode => inline}, #{mode => process, shards => 2}],
            [#{violations := [], digest := Digest, report := Report} | _] =
                Outcomes = [outcome(maps:merge(Scenario, Way)) || Way <- Ways],
            ?assertEqual([Digest], lists:usort([D || #{digest := D} <- Outcomes])),
            ?assertMatch(#{complete := true}, Report),
            #{monitors := #{starl_search_monitor := #{found_us := Found, searched := Searched}}} = hd(
                Outcomes
            ),
            case Scenario of
                #{ball := nowhere} -> ?assertEqual({none, 1.0}, {Found, Searched});
                #{} -> ?assert(is_integer(Found))
            end
        end}
     || Scenario <- [
            #{robots => 1, ball => nowhere},
            #{robots => 3, ball => nowhere, loss => 0.2},
            #{robots => 3, faults => [{f, 0, 20000, sense_gone, all, #{sense => camera}}]},
            #{robots => 3, ball => nowhere, faults => [{f, 9000, 9000, kill_robot, 2, #{}}]}
        ]
    ].

%% Who finds the ball while nothing can be stored tells it later, and does not leave before.
a_full_store_keeps_no_ball_secret_test_() ->
    {timeout, 120, fun() ->
        Scenario = #{robots => 3, time => 600, heal => 60},
        #{monitors := #{starl_search_monitor := #{found_us := Us}}} = outcome(Scenario),
        Full = [
            {Name, Us div 1000 - 3000, 60000, store_full, Robot, #{}}
         || {Robot, Name} <- [{1, one}, {2, two}, {3, three}]
        ],
        #{violations := Violations, robots := Robots} = outcome(Scenario#{faults => Full}),
        ?assertEqual([], Violations),
        ?assertMatch([{done, {found, _}}], lists:usort([R || {_, #{result := R}} <- Robots]))
    end}.

%% Three freezes of a clock add up to 33 s, and a robot refuses for so long what the other one writes: that is
%% excused, and said.
clocks_too_far_apart_test_() ->
    {timeout, 60, fun() ->
        Kinds =
            [network, clock, process, location_dropout, location_frozen] ++
                [actuation, serial, store, sense],
        #{violations := Violations, monitors := Monitors} = outcome(#{
            robots => 2,
            seed => 9700053,
            time => 300,
            random_faults => Kinds,
            heal => 45,
            longest_fault => 45,
            lease => 9562
        }),
        ?assertEqual([], Violations),
        ?assertMatch(
            #{starl_registers_monitor := #{sometimes := #{clocks_apart := 1}}}, Monitors
        )
    end}.

%% Robots come to a door that is closed, and to a box that stands in it: they go in when it is gone.
a_door_that_closes_for_a_while_test_() ->
    Seed = seed(),
    [
        {timeout, 120, fun() ->
            Faults = [{door, From, From + 40000, Kind, all, Params}],
            Scenario = #{robots => N, seed => Seed, ball => nowhere, faults => Faults},
            #{violations := Violations, report := Report} = outcome(Scenario),
            ?assertMatch({Seed, N, [], #{complete := true}}, {Seed, N, Violations, Report})
        end}
     || N <- [1, 2, 4],
        From <- [0, erlang:phash2({Seed, N}, 60000)],
        {Kind, Params} <- [
            {closed, #{door => 1}},
            {obstacle, #{x => 2400, y => 1150, width => 200, height => 500}}
        ]
    ].

%% The team says so, and names the room; whoever is in there stays.
a_door_that_closes_for_good_test_() ->
    [
        {timeout, 120, fun() ->
            Faults = [{door, 0, 1500000, closed, all, #{door => 1}}],
            Scenario = #{robots => N, ball => nowhere, faults => Faults, time => 1500},
            #{violations := Violations, report := Report} = Outcome = outcome(Scenario),
            #{robots := Robots} = Outcome,
            ?assertMatch({[], #{complete := false}}, {Violations, Report}),
            ?assertEqual([{done, incomplete}], lists:usort([R || {_, #{result := R}} <- Robots])),
            #{summary := [Line | _]} = Report,
            ?assertEqual("not searched, or in part: east", unicode:characters_to_list(Line))
        end}
     || N <- [1, 2, 3]
    ].

%% Boxes anywhere, doors at any time.
obstacles_break_no_contract_test_() ->
    Seed = seed(),
    [
        {timeout, 120, fun() ->
            Scenario = #{
                robots => 1 + I rem 4,
                seed => Seed + I,
                chassis => lists:nth(1 + I rem 3, [differential, holonomic, mixed]),
                ball => nowhere,
                random_faults => [floor],
                heal => 60
            },
            #{violations := Violations, report := Report} = outcome(Scenario),
            ?assertMatch({Seed, I, [], #{complete := true}}, {Seed, I, Violations, Report})
        end}
     || I <- lists:seq(1, 12)
    ].

seed() ->
    case os:getenv("STARL_SEED") of
        false -> erlang:phash2(make_ref(), 1 bsl 24);
        Text -> list_to_integer(Text)
    end.

outcome(Scenario) ->
    Given = maps:merge(#{time => 900}, Scenario),
    {ok, Sim} = starl_sim:start(Given#{app => starl_search_floor, camera_range => 1200}),
    _ = starl_sim:run(Sim),
    {Outcome, Report} = starl_sim:finish(Sim),
    Outcome#{report => Report}.
