-module(starl_contact_monitor_tests).
-include_lib("eunit/include/eunit.hrl").

%% A floor of 4 m x 3 m with a block in the middle.
config() ->
    Floor = starl_floor:new(#{
        size => {4000, 3000}, walls => [starl_floor:box(1800, 1000, 2200, 2000)]
    }),
    #{
        walls => starl_walls:new(Floor),
        profiles => [starl_chassis:profile(starl_chassis_differential, #{})],
        unaware_us => 5000
    }.

judged(Events) -> judged(Events, config()).

judged(Events, Config) ->
    Runner = starl_monitor:new([{starl_contact_monitor, Config}]),
    {Found, Fed} = lists:foldl(
        fun(Event, {Before, R}) ->
            case starl_monitor:step(Event, R) of
                {ok, Next} -> {Before, Next};
                {violation, V, Next} -> {[V | Before], Next}
            end
        end,
        {[], Runner},
        Events
    ),
    {Late, #{starl_contact_monitor := Results}} = starl_monitor:finish(4000000, Fed),
    {lists:usort([What || #{what := What} <- Found ++ Late]), Results}.

stands(Robot, T, X, Y) ->
    {T, Robot, chassis, {motion, starl_trajectory:standing(T, {X, Y}, 0.0)}}.

drives(Robot, T, X, Y, V) ->
    {T, Robot, chassis, {motion, starl_trajectory:piece(T, {X, Y}, 0.0, V, 0.0)}}.

a_robot_that_stops_at_a_wall_keeps_the_contract_test() ->
    Events = [drives(1, 0, 1000.0, 1500.0, 500.0), stands(1, 1270000, 1635.0, 1500.0)],
    {[], #{least_room_mm := Least}} = judged(Events),
    ?assert(abs(Least) < 0.001).

a_robot_a_tenth_of_a_millimetre_in_a_wall_breaks_it_test() ->
    ?assertMatch({[], _}, judged([stands(1, 0, 1635.09, 1500.0)])),
    ?assertMatch({[in_a_wall], _}, judged([stands(1, 0, 1635.11, 1500.0)])),
    ?assertMatch({[in_a_wall], _}, judged([stands(1, 0, 2000.0, 1500.0)])),
    ?assertMatch({[in_a_wall], _}, judged([stands(1, 0, -200.0, 1500.0)])).

%% Though it is out of it at both ends.
a_robot_that_goes_through_a_wall_breaks_it_test() ->
    Events = [drives(1, 0, 1000.0, 1500.0, 500.0), stands(1, 4000000, 3000.0, 1500.0)],
    ?assertMatch({[in_a_wall], _}, judged(Events)).

%% Each at 500 mm/s for 5 ms: 5 mm, and the tenth.
two_may_overlap_by_what_neither_knows_test() ->
    At = fun(X) -> judged([stands(1, 0, 500.0, 500.0), drives(2, 0, X, 500.0, 1.0)]) end,
    ?assertMatch({[], _}, At(500.0 + 325.0)),
    ?assertMatch({[in_another], _}, At(500.0 + 324.0)).

who_promises_no_bump_has_none_test() ->
    Bump = [stands(1, 0, 500.0, 500.0), {5, 1, chassis, {sensed, {bump, left}}}],
    ?assertMatch({[], #{bumps := 1}}, judged(Bump)),
    ?assertMatch({[bump], _}, judged(Bump, (config())#{never_bumps => true})).

%% -- obstacles ------------------------------------------------------------------------------

%% A wall across the lower part from 1 s until 3 s.
with_obstacle() ->
    #{walls := Walls} = Config = config(),
    Obstacles = [{1000000, 3000000, [{{1000.0, 0.0}, {1000.0, 900.0}}]}],
    Config#{obstacles => starl_obstacles:new(Obstacles, Walls)}.

nobody_goes_through_an_obstacle_while_it_stands_test() ->
    Through = fun(T) ->
        Drives = drives(1, T, 500.0, 450.0, 1000.0),
        element(1, judged([Drives, stands(1, T + 1000000, 1500.0, 450.0)], with_obstacle()))
    end,
    ?assertEqual([[], [in_a_wall], []], [Through(T) || T <- [0, 1500000, 3000000]]).

%% 100 mm deep when it appears: it may stay so, and leave, and not go deeper.
%% Holds: Who stands where a door closes gets no deeper, and may leave
%% Red: 073438b3: there were no obstacles
who_is_caught_gets_no_deeper_test() ->
    Caught = fun(V) ->
        Events = [
            stands(1, 0, 935.0, 450.0),
            drives(1, 1500000, 935.0, 450.0, V),
            stands(1, 1600000, 935.0 + V / 10, 450.0)
        ],
        element(1, judged(Events, with_obstacle()))
    end,
    ?assertEqual([[], [], [in_a_wall]], [Caught(V) || V <- [0.0, -200.0, 10.0]]).

%% Once it is out it may not come back.
who_was_caught_and_is_out_is_as_all_others_test() ->
    Events = [
        stands(1, 0, 935.0, 450.0),
        drives(1, 1200000, 935.0, 450.0, -1000.0),
        stands(1, 1500000, 635.0, 450.0),
        stands(1, 1600000, 900.0, 450.0)
    ],
    ?assertEqual([in_a_wall], element(1, judged(Events, with_obstacle()))).

%% Holds: A bump at an obstacle is no broken promise, any other is
%% Red: without the excuse, run: `bump`
a_bump_at_an_obstacle_is_no_broken_promise_test() ->
    Bump = fun(T, X) ->
        Events = [stands(1, T, X, 450.0), {T + 5, 1, chassis, {sensed, {bump, left}}}],
        element(1, judged(Events, (with_obstacle())#{never_bumps => true}))
    end,
    ?assertEqual([[], [bump], [bump]], [
        Bump(1100000, 834.0), Bump(1100000, 700.0), Bump(3100000, 834.0)
    ]).
