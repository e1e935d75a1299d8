%% The contract of the search: traces that keep it, and for each sentence one that breaks it.
%%
%% Holds: A search is complete only when all floor that a camera can come to see was seen; the
%% place that it reports is right within the camera's error
%% Red: planted, run
-module(starl_search_monitor_tests).
-include_lib("eunit/include/eunit.hrl").

%% A room of 4 m x 2 m with a wall on the right, behind which nobody can look, and the ball.
-define(BALL, {2500.0, 1500.0}).
%% From there the whole room is seen.
-define(MIDDLE, {1500.0, 1000.0}).

monitor() -> monitor(#{}).

monitor(More) ->
    starl_monitor:new([{starl_search_monitor, maps:merge(config(), More)}]).

config() ->
    #{
        floor => starl_floor:new(#{size => {4000, 2000}, walls => [[{3000, 0}, {3000, 2000}]]}),
        ball => ?BALL,
        ball_mm => 100.0,
        range_mm => 2000.0,
        field => 2 * math:pi(),
        wall_mm => 181.0,
        profiles => [starl_chassis:profile(starl_chassis_differential, #{})],
        off => {50.0, 0.1},
        robots => [1, 2],
        within_us => 10000000,
        healed_us => 0
    }.

judged(Events, Monitor) ->
    Step = fun(Event, {Found, M}) ->
        case starl_monitor:step(Event, M) of
            {ok, Next} -> {Found, Next};
            {violation, Violation, Next} -> {Found ++ [Violation], Next}
        end
    end,
    {Found, Last} = lists:foldl(Step, {[], Monitor}, Events),
    {T, _, _, _} = lists:last(Events),
    {More, #{starl_search_monitor := Results}} = starl_monitor:finish(T, Last),
    {[What || #{what := What} <- Found ++ More], Results}.

stands(Robot, T, At) -> stands(Robot, T, At, 0.0).

stands(Robot, T, At, Heading) ->
    {T, Robot, chassis, {motion, starl_trajectory:standing(T, At, Heading)}}.

looks(Robot, T) -> {T, Robot, location, {felt, camera}}.

looks(Robot, T, At) -> [stands(Robot, T, At), looks(Robot, T)].

done(T, Robot, How) -> {T, Robot, app, {done, How}}.

all_done(T) -> [done(T, R, complete) || R <- [1, 2]].

searched(Events, More) -> judged(Events ++ all_done(9000000), monitor(More#{ball => none})).

%% What is behind the wall nobody could see, so `complete' is right; the report names it.
a_search_in_vain_test() ->
    {[], #{found_us := none, left := Left, unseen_m2 := M2}} = searched(looks(1, 0, ?MIDDLE), #{}),
    ?assert(M2 > 1.0),
    ?assertEqual([], [P || {X, _} = P <- Left, X < 3000]).

nobody_has_looked_test() ->
    ?assertMatch({[not_seen], _}, searched([stands(1, 0, ?MIDDLE)], #{})).

%% Driving by is not looking, and a look sees in its range and its field only.
what_is_out_of_view_is_not_seen_test() ->
    Short = #{range_mm => 1000.0},
    ?assertMatch({[not_seen], _}, searched(looks(1, 0, ?MIDDLE), Short)),
    All = lists:append([
        looks(1, T, {X, 1000.0})
     || {T, X} <- [{0, 500.0}, {9, 1500.0}, {99, 2500.0}]
    ]),
    ?assertMatch({[], _}, searched(All, Short)),
    Front = #{field => math:pi()},
    ?assertMatch({[not_seen], _}, searched(looks(1, 0, ?MIDDLE), Front)),
    Back = looks(1, 0, ?MIDDLE) ++ [stands(1, 9, ?MIDDLE, math:pi()), looks(1, 9)],
    ?assertMatch({[], _}, searched(Back, Front)).

%% A wall in the room hides a part; from its other side it is seen.
what_is_behind_a_wall_is_not_seen_test() ->
    Floor = starl_floor:new(#{size => {4000, 2000}, walls => [[{2000, 0}, {2000, 1000}]]}),
    Left = looks(1, 0, {500.0, 500.0}),
    ?assertMatch({[not_seen], _}, searched(Left, #{floor => Floor, range_mm => 5000.0})),
    Right = Left ++ looks(1, 9, {3000.0, 1000.0}),
    ?assertMatch({[], #{left := []}}, searched(Right, #{floor => Floor, range_mm => 5000.0})).

%% One violation is enough for all that is not seen.
complete_is_judged_once_test() ->
    ?assertMatch({[not_seen], _}, searched([stands(1, 0, ?MIDDLE)], #{robots => [1, 2]})).

%% A door that is closed meanwhile hides what is behind it, and nobody knows: it is named, and no violation.
an_obstacle_hides_test() ->
    Box = #{
        obstacles => [{0, 5000000, obstacle, #{x => 2000, y => 500, width => 100, height => 900}}]
    },
    {[], #{left := Left}} = searched(looks(1, 0, ?MIDDLE), Box),
    ?assert(lists:any(fun({X, _}) -> X > 2100 andalso X < 3000 end, Left)),
    {[], #{left := Later}} = searched(looks(1, 6000000, ?MIDDLE), Box),
    ?assertEqual([], [P || {X, _} = P <- Later, X < 3000]).

%% So does another robot, dead or alive.
a_body_hides_test() ->
    Beside = [stands(2, 0, {2000.0, 1000.0}) | looks(1, 0, ?MIDDLE)],
    {[], #{left := Left}} = searched(Beside, #{}),
    Hidden = [P || {X, _} = P <- Left, X < 3000],
    ?assert(lists:any(fun({X, Y}) -> X > 2200 andalso abs(Y - 1000) < 80 end, Hidden)),
    ?assertEqual([], [P || {_, Y} = P <- Hidden, abs(Y - 1000) > 600]),
    {[], #{left := Later}} = searched(Beside ++ looks(2, 9, {2000.0, 1000.0}), #{}),
    ?assertEqual([], [P || {X, _} = P <- Later, X < 3000]).

%% A camera that answers though it is frozen has seen nothing; its robot cannot know.
a_camera_that_is_not_to_be_believed_test() ->
    Frozen = #{senses => [{1, 0, 5000000, fault}]},
    {[], #{unseen_m2 := M2, floor_m2 := M2}} = searched(looks(1, 0, ?MIDDLE), Frozen),
    {[], #{unseen_m2 := Less}} = searched(looks(2, 0, ?MIDDLE), Frozen),
    ?assert(Less < M2).

%% Who was told wrong places has looked elsewhere: that is said, and not judged.
wrong_places_are_not_judged_test() ->
    Wrong = #{places => [{1, 0, 5000000, position}]},
    ?assertMatch(
        {[], #{unjudged := [_]}}, searched(looks(1, 0, {400.0, 400.0}), Wrong#{range_mm => 500.0})
    ),
    ?assertMatch(
        {[not_seen], #{unjudged := []}},
        searched(looks(2, 0, {400.0, 400.0}), Wrong#{range_mm => 500.0})
    ).

%% Over time, with steps for a plot.
%% Holds: The floor that is seen is counted over time
%% Red: a monitor without `measured`
floor_is_counted_over_time_test() ->
    Events = looks(1, 1000000, {500.0, 1000.0}) ++ looks(1, 3000000, {2500.0, 1000.0}),
    {_, #{measured := Measured}} = searched(Events, #{range_mm => 1000.0}),
    ?assertMatch(
        [{0, 0.0}, {1000000, 0.0}, {1000000, A}, {3000000, A}, {3000000, B}, {9000000, B}] when
            A > 0 andalso B > A,
        [{T, M2} || {T, floor_seen_m2, M2} <- Measured]
    ).

%% -- found ------------------------------------------------------------------------------------

found(At) -> [stands(1, 0, ?MIDDLE), {2000000, 1, app, {found, At}}].

found_test() ->
    Events = found(?BALL) ++ [done(2000000, 1, found), done(9000000, 2, found)],
    ?assertMatch({[], #{found_us := 2000000, done_us := 9000000}}, judged(Events, monitor())).

found_what_is_not_there_test() ->
    Found = found(?BALL),
    ?assertMatch({[not_there], _}, judged(Found, monitor(#{ball => none}))),
    %% too far away, behind a wall, and behind the robot
    ?assertMatch({[not_there], _}, judged(Found, monitor(#{range_mm => 900.0}))),
    ?assertMatch({[not_there], _}, judged(Found, monitor(#{ball => {3500.0, 1000.0}}))),
    ?assertMatch(
        {[not_there], _}, judged(Found, monitor(#{ball => {500.0, 1000.0}, field => 2.0}))
    ).

%% The ball is 1118 mm away, so it may be 50 and 112 mm from where it is said to be.
the_place_is_judged_test() ->
    Off = fun(Mm, More) ->
        {X, Y} = ?BALL,
        {What, _} = judged(found({X + Mm, Y}), monitor(More)),
        What
    end,
    ?assertEqual([], Off(160.0, #{})),
    ?assertEqual([misplaced], Off(164.0, #{})),
    ?assertEqual([misplaced], Off(5000.0, #{})),
    %% a camera that is noisy then, or a wrong place, may be it
    ?assertEqual([], Off(5000.0, #{senses => [{1, 1500000, 1600000, fault}]})),
    ?assertEqual([], Off(5000.0, #{places => [{all, 0, 9000000, position}]})),
    ?assertEqual([misplaced], Off(5000.0, #{senses => [{2, 0, 9000000, fault}]})),
    ?assertEqual([misplaced], Off(5000.0, #{senses => [{1, 2000001, 9000000, fault}]})).

a_robot_that_searches_on_test() ->
    Found = found(?BALL) ++ [done(2000000, 1, found)],
    Late = fun(T, Event) -> Found ++ [{T, 2, app, Event}] end,
    ?assertMatch({[], _}, judged(Late(12000000, {done, found}), monitor())),
    ?assertMatch({[not_done], _}, judged(Late(12000001, {done, found}), monitor())),
    %% it is dead; the bound counts from the heal; the faults never end
    Dead = Found ++ [{2000000, 2, robot, {died, killed}}, {20000000, 1, robot, up}],
    ?assertMatch({[], _}, judged(Dead, monitor())),
    ?assertMatch({[], _}, judged(Late(15000000, {done, found}), monitor(#{healed_us => 5000000}))),
    ?assertMatch({[], _}, judged(Late(90000000, {done, found}), monitor(#{healed_us => never}))).
