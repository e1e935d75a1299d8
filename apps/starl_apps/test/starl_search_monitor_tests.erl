%% The contract of the search: traces that keep it, and for each sentence one that breaks it.
-module(starl_search_monitor_tests).
-include_lib("eunit/include/eunit.hrl").

%% A room of 4 m x 2 m with a wall on the right, one line, and the ball.
-define(WAY, {{500.0, 1000.0}, {1500.0, 1000.0}}).
-define(BALL, {2500.0, 1500.0}).

monitor() -> monitor(#{}).

monitor(More) ->
    Floor = starl_floor:new(#{size => {4000, 2000}, walls => [[{3000, 0}, {3000, 2000}]]}),
    Config = #{
        floor => Floor,
        lines => [?WAY],
        ball => ?BALL,
        range_mm => 2000.0,
        robots => [1, 2],
        within_us => 10000000,
        healed_us => 0
    },
    starl_monitor:new([{starl_search_monitor, maps:merge(Config, More)}]).

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

%% It drives along the line in two seconds, and stands.
drives(Robot, T, {X, Y}) ->
    [
        {T, Robot, chassis, {motion, starl_trajectory:piece(T, {X, Y}, 0.0, 500.0, 0.0)}},
        {
            T + 2000000,
            Robot,
            chassis,
            {motion, starl_trajectory:standing(T + 2000000, {X + 1000.0, Y}, 0.0)}
        }
    ].

done(T, Robot, How) -> {T, Robot, app, {done, How}}.

a_search_in_vain_test() ->
    Events = drives(1, 0, {500.0, 1000.0}) ++ [done(3000000, R, complete) || R <- [1, 2]],
    ?assertMatch(
        {[], #{searched := 1.0, found_us := none}}, judged(Events, monitor(#{ball => none}))
    ).

a_line_that_nobody_drove_test() ->
    Beside = drives(1, 0, {500.0, 1070.0}) ++ [done(3000000, 1, complete)],
    ?assertMatch({[not_searched], #{searched := +0.0}}, judged(Beside, monitor())),
    [Begins | _] = drives(1, 0, {500.0, 1000.0}),
    Half = [Begins, done(1000000, 1, complete)],
    ?assertMatch({[not_searched], #{searched := 0.5}}, judged(Half, monitor())).

%% Over time: a room is searched when all its lines are driven; in between the number stays, for a plot.
rooms_are_counted_over_time_test() ->
    Floor = starl_floor:new(#{
        size => {4000, 2000},
        rooms => #{
            west => starl_floor:box(0, 0, 2000, 2000), east => starl_floor:box(2000, 0, 4000, 2000)
        }
    }),
    East = {{2500.0, 1000.0}, {3500.0, 1000.0}},
    Config = #{floor => Floor, lines => [?WAY, East], ball => none},
    Events =
        drives(1, 0, {500.0, 1000.0}) ++ drives(2, 3000000, {2500.0, 1000.0}) ++
            [done(6000000, 1, complete)],
    {[], #{measured := Measured}} = judged(Events, monitor(Config)),
    ?assertEqual(
        [{0, 0}, {2000000, 0}, {2000000, 1}, {5000000, 1}, {5000000, 2}, {6000000, 2}],
        [{T, N} || {T, rooms_searched, N} <- Measured]
    ).

found_test() ->
    Events =
        drives(1, 0, {500.0, 1000.0}) ++
            [{2000000, 1, app, {found, ?BALL}}, done(2000000, 1, found), done(9000000, 2, found)],
    ?assertMatch({[], #{found_us := 2000000, done_us := 9000000}}, judged(Events, monitor())).

found_what_is_not_there_test() ->
    Found = drives(1, 0, {500.0, 1000.0}) ++ [{2000000, 1, app, {found, ?BALL}}],
    ?assertMatch({[not_there], _}, judged(Found, monitor(#{ball => none}))),
    %% too far away, and behind a wall
    ?assertMatch({[not_there], _}, judged(Found, monitor(#{range_mm => 900.0}))),
    ?assertMatch({[not_there], _}, judged(Found, monitor(#{ball => {3100.0, 1000.0}}))).

a_robot_that_searches_on_test() ->
    Found =
        drives(1, 0, {500.0, 1000.0}) ++
            [{2000000, 1, app, {found, ?BALL}}, done(2000000, 1, found)],
    Late = fun(T, Event) -> Found ++ [{T, 2, app, Event}] end,
    ?assertMatch({[], _}, judged(Late(12000000, {done, found}), monitor())),
    ?assertMatch({[not_done], _}, judged(Late(12000001, {done, found}), monitor())),
    %% it is dead; the bound counts from the heal; the faults never end
    Dead = Found ++ [{2000000, 2, robot, {died, killed}}, {20000000, 1, robot, up}],
    ?assertMatch({[], _}, judged(Dead, monitor())),
    ?assertMatch({[], _}, judged(Late(15000000, {done, found}), monitor(#{healed_us => 5000000}))),
    ?assertMatch({[], _}, judged(Late(90000000, {done, found}), monitor(#{healed_us => never}))).
