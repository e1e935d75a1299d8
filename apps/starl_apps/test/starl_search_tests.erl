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

%% The same with the closet open, so that all can be seen.
open_floor() ->
    #{walls := Walls} = Floor = floor(),
    Floor#{walls := lists:droplast(Walls) ++ [starl_floor:box(4400, 0, 4500, 2000)]}.

%% A ball anywhere on the floor is in view of one of the places, from wherever on its line a robot looks, with
%% room on both sides; and the lines are where robots have room.
the_places_show_all_floor_test() ->
    Seed = seed(),
    {ok, #{app := {sequential, starl_search, #{views := Views}}, memo := #{unseen := []}}} =
        starl_search:scene(context(#{floor => open_floor()})),
    Walls = starl_walls:new(open_floor()),
    [?assert(starl_walls:is_free(Line, 181.0, Walls)) || #{line := Line} <- Views],
    [
        begin
            Ball = ball({Seed, N}, 0, Walls),
            InView = fun(P) ->
                starl_geometry:distance(P, Ball) =< 3000 andalso
                    starl_sight:is_clear(P, Ball, [], Walls)
            end,
            Shown = lists:any(fun(#{line := {A, B}}) -> InView(A) andalso InView(B) end, Views),
            ?assert(Shown, {Seed, N, Ball})
        end
     || N <- lists:seq(1, 300)
    ].

%% Found at random: a robot that waited 0.8 m from the corner of a room did not count what it saw there, so a team
%% that had seen all floor ended with `incomplete'.
floor_beside_a_wall_is_seen_test() ->
    Walls = starl_walls:new(starl_floor:new(#{size => {5000, 3000}, walls => []})),
    Sees = #{range_mm => 3000.0, ball_mm => 100.0},
    ?assert(starl_search_cover:sees({218.0, 960.0}, starl_search_cells:cell(0, 1), Sees, Walls)).

%% What counts as seen from somewhere is in view from there: a ball anywhere in the cell.
what_is_seen_from_anywhere_is_in_view_test() ->
    Seed = seed(),
    Walls = starl_walls:new(open_floor()),
    Sees = #{range_mm => 3000.0, ball_mm => 100.0},
    Seen = [
        ?assert(
            starl_geometry:distance(From, Ball) =< 3000 andalso
                starl_sight:is_clear(From, Ball, [], Walls),
            {Seed, N, From, Ball}
        )
     || N <- lists:seq(1, 2000),
        {X, Y} = Ball <- [ball({Seed, N}, 0, Walls)],
        From <- [ball({Seed, from, N}, 0, Walls)],
        Cell <- [starl_search_cells:cell(trunc(X / 100), trunc(Y / 100))],
        starl_search_cover:sees(From, Cell, Sees, Walls)
    ],
    ?assert(length(Seen) > 300).

%% Anywhere where it has room.
ball(Key, N, Walls) ->
    P = {erlang:phash2({Key, x, N}, 5000) * 1.0, erlang:phash2({Key, y, N}, 3000) * 1.0},
    case starl_walls:is_free({P, P}, 100.0, Walls) of
        true -> P;
        false -> ball(Key, N + 1, Walls)
    end.

%% Each cell has one place, and all cells have one.
each_cell_belongs_to_one_place_test() ->
    {ok, #{app := {sequential, _, #{views := Views}}, memo := #{cells := Cells}}} =
        starl_search:scene(context(#{floor => open_floor()})),
    All = lists:append([starl_search_cover:cells(View) || View <- Views]),
    ?assertEqual({Cells, Cells}, {length(All), length(lists:usort(All))}).

the_closed_room_is_told_before_test() ->
    {ok, Scene} = starl_search:scene(context(#{})),
    #{lines := Lines} = starl_search:preview(Scene),
    ?assertMatch(
        ["3 rooms: closet, east, west", _Floor, "nobody can come to see 1.5 of 14 m², in closet"],
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
            #{monitors := #{starl_search_monitor := #{found_us := Found, left := Left}}} = hd(
                Outcomes
            ),
            case Scenario of
                #{ball := nowhere} -> ?assertMatch({none, [_ | _]}, {Found, Left});
                #{} -> ?assert(is_integer(Found))
            end,
            ?assertMatch(#{complete := Is} when Is =:= (Found =/= none), Report),
            %% the closet is named, and nothing else but what a dead robot hides
            Hides = is_map_key(faults, Scenario),
            ?assert(Found =/= none orelse Hides orelse lists:all(fun({X, _}) -> X > 4400 end, Left))
        end}
     || Scenario <- [
            #{robots => 1, ball => nowhere},
            #{robots => 3, ball => nowhere, loss => 0.2},
            #{robots => 3, faults => [{f, 0, 20000, sense_gone, all, #{sense => camera}}]},
            #{robots => 3, ball => nowhere, faults => [{f, 9000, 9000, kill_robot, 2, #{}}]}
        ]
    ].

%% Who finds the ball while nothing can be stored tells it later, and does not leave before.
%% Holds: Who has found the ball while nothing could be stored tells it as soon as it can, and is
%% not done before
%% Red: cd3d8cf0, run: `not done`
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
        %% two may have found it by themselves
        [?assertMatch({done, {found, _}}, Result) || {_, #{result := Result}} <- Robots]
    end}.

%% Robots come to a door that is closed, and to a box that stands in it: they go in when it is gone.
%% Holds: A door that closes for a while keeps nobody out for ever; one that stays closed is named
%% Red: without `blocked` of motion, and without closed edges in the plan, run: robots push on for
%% ever
a_door_that_closes_for_a_while_test_() ->
    Seed = seed(),
    [
        {timeout, 120, fun() ->
            Faults = [{door, From, From + 40000, Kind, all, Params}],
            Scenario = #{robots => N, seed => Seed, ball => nowhere, faults => Faults},
            #{violations := Violations, report := Report} = outcome(Scenario),
            ?assertMatch({Seed, N, [], true}, {Seed, N, Violations, is_all_but_closet(Report)})
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
            ?assertMatch(
                {match, _},
                re:run(
                    unicode:characters_to_binary(Line),
                    "not seen: .* of 1[0-9] m², in east, closet",
                    [
                        unicode
                    ]
                )
            )
        end}
     || N <- [1, 2, 3]
    ].

is_all_but_closet(#{summary := Lines}) ->
    lists:all(fun(Line) -> string:find(Line, "in closet") =/= nomatch end, Lines).

%% Boxes anywhere, doors at any time: what a box hides nobody can see, and is named.
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
            #{violations := Violations, robots := Robots} = outcome(Scenario),
            Ends = lists:usort([Result || {_, #{result := Result}} <- Robots]),
            ?assertEqual({Seed, I, [], [{done, complete}]}, {Seed, I, Violations, Ends})
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
