%% The contract of the geocast, clause by clause: traces that keep it, traces that break it; and
%% the areas. Robot 1 stands at the origin, robot 2 drives along the x axis at 1000 mm/s from
%% x = 5000 on, away; the area reaches to x = 1000.
-module(starl_geocast_monitor_tests).
-include_lib("eunit/include/eunit.hrl").

-define(ID, {1, 1, 1}).
-define(AREA, {circle, {0.0, 0.0}, 1000.0}).

judge(Events) -> judge(Events, true).

judge(Events, Progress) ->
    Config = #{robots => [1, 2], progress => Progress},
    Moves = [{0, 1, chassis, {motion, {piece, 0, 0.0, 0.0, 0.0, 0.0, 0.0}}},
             {0, 2, chassis, {motion, {piece, 0, 5000.0, 0.0, 0.0, 1000.0, 0.0}}}],
    M0 = starl_monitor:new([{starl_geocast_monitor, Config}]),
    {Found, M} = lists:foldl(fun(Event, {Acc, Monitor}) ->
        case starl_monitor:step(Event, Monitor) of
            {ok, Next} -> {Acc, Next};
            {violation, V, Next} -> {Acc ++ [V], Next}
        end
    end, {[], M0}, Moves ++ Events),
    {Late, _} = starl_monitor:finish(100000000, M),
    [What || #{what := What} <- Found ++ Late].

sent() -> {10, 1, geocast, {sent, ?ID, ?AREA, 1000000}}.
delivered(T, Robot) -> {T, Robot, geocast, {delivered, ?ID}}.

kept_test() -> ?assertEqual([], judge([sent(), delivered(20, 1)])).
at_the_very_end_test() -> ?assertEqual([], judge([sent(), delivered(1000010, 1)])).
too_late_test() -> ?assertEqual([too_late], judge([sent(), delivered(1000011, 1)], false)).
twice_test() -> ?assertEqual([delivered_twice], judge([sent(), delivered(2, 1), delivered(3, 1)])).
never_sent_test() -> ?assertEqual([never_sent], judge([delivered(2, 1)])).
outside_test() -> ?assertEqual([outside], judge([sent(), delivered(20, 1), delivered(30, 2)])).
not_delivered_test() -> ?assertEqual([not_delivered], judge([sent()])).
safety_only_test() -> ?assertEqual([], judge([sent()], false)).
crashed_in_the_window_test() -> ?assertEqual([], judge([sent(), {500, 1, geocast, crashed}])).
crashed_long_before_test() ->
    Sent = {9000000, 1, geocast, {sent, ?ID, ?AREA, 1000000}},
    ?assertEqual([not_delivered], judge([{5, 1, geocast, crashed}, Sent])).
died_test() -> ?assertEqual([], judge([sent(), {500, 1, robot, {died, killed}}])).

%% Inside for an instant between two events: no violation; and no debt for who leaves again.
comes_by_test() ->
    Back = {100, 2, chassis, {motion, {piece, 100, 1200.0, 0.0, 0.0, -1000.0, 0.0}}},
    Away = {500000, 2, chassis, {motion, {piece, 500000, 5000.0, 0.0, 0.0, 0.0, 0.0}}},
    ?assertEqual([], judge([sent(), delivered(20, 1), Back, Away])),
    ?assertEqual([], judge([sent(), delivered(20, 1), Back, delivered(400000, 2), Away])).

%% -- areas ----------------------------------------------------------------------------------

%% A notch is cut into the square from above: (5, 8) lies in the notch.
notched() ->
    {polygon, [{0.0, 0.0}, {10.0, 0.0}, {10.0, 10.0}, {5.0, 5.0}, {0.0, 10.0}]}.

depth_test_() ->
    [?_assert(abs(Depth - starl_geocast_area:depth(Point, Area)) < 1.0e-9) || {Point, Area, Depth} <- [
        {{0.0, 0.0}, {circle, {3.0, 4.0}, 6.0}, 1.0},
        {{0.0, 0.0}, {circle, {3.0, 4.0}, 4.0}, -1.0},
        {{2.0, 5.0}, {rectangle, {0.0, 0.0, 10.0, 10.0}}, 2.0},
        {{-3.0, -4.0}, {rectangle, {0.0, 0.0, 10.0, 10.0}}, -5.0},
        {{5.0, 2.0}, notched(), 2.0},
        {{5.0, 8.0}, notched(), -3 / math:sqrt(2)},
        %% on the height of a corner, inside and outside
        {{9.0, 5.0}, notched(), 1.0},
        {{-1.0, 5.0}, notched(), -1.0},
        {{12.0, 10.0}, notched(), -2.0}
    ]].

border_belongs_test() ->
    ?assert(starl_geocast_area:inside({10.0, 5.0}, notched())),
    ?assert(starl_geocast_area:inside({10.0, 5.0}, {rectangle, {0.0, 0.0, 10.0, 10.0}})),
    ?assertNot(starl_geocast_area:inside({10.001, 5.0}, {rectangle, {0.0, 0.0, 10.0, 10.0}})).

%% A straight path that cuts a corner of the notch, and an arc that leaves and comes back.
every_instant_test() ->
    Across = starl_trajectory:piece(0, {1.0, 8.0}, 0.0, 8.0, 0.0),
    ?assertNot(starl_geocast_area:keeps_inside(Across, 0, 1000000, notched(), 0.0)),
    ?assert(starl_geocast_area:keeps_inside(Across, 0, 50000, notched(), 0.0)),
    Turn = starl_trajectory:piece(0, {100.0, 0.0}, math:pi() / 2, 200.0 * math:pi(), 2 * math:pi()),
    Disc = {circle, {0.0, 0.0}, 100.1},
    ?assert(starl_geocast_area:keeps_inside(Turn, 0, 1000000, Disc, 0.0)),
    ?assertNot(starl_geocast_area:keeps_inside(Turn, 0, 1000000, Disc, 1.0)),
    ?assert(starl_geocast_area:keeps_outside(Turn, 0, 1000000, {circle, {0.0, 0.0}, 99.0})),
    ?assertNot(starl_geocast_area:keeps_outside(Turn, 0, 1000000, {circle, {-100.0, 0.0}, 1.0})).

check_test_() ->
    [?_assertEqual({error, Reason}, starl_geocast_area:check(Area)) || {Area, Reason} <- [
        {{circle, {0.0, 0.0}, -1.0}, negative_radius},
        {{rectangle, {1.0, 0.0, 0.0, 1.0}}, upside_down},
        {{polygon, [{0.0, 0.0}]}, too_few_points},
        {{polygon, [{0, 0}, {1, 1}, {2, 2}]}, not_an_area},
        {nonsense, not_an_area}
    ]] ++ [?_assertEqual(ok, starl_geocast_area:check(notched()))].
