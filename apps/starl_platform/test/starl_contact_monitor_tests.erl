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
