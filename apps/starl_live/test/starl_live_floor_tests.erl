%% From space to the floor: axes, and the heading of a robot that is turned and tilted.
-module(starl_live_floor_tests).
-include_lib("eunit/include/eunit.hrl").

-define(Z_UP, {1, 2, 3}).
-define(Y_UP, {1, -3, 2}).
-define(NEAR(Expected, Got), ?assert(abs((Expected) - (Got)) < 1.0e-9, Got)).

axes_test() ->
    [?assertEqual(ok, starl_live_floor:axes(A)) || A <- [?Z_UP, ?Y_UP, {3, 1, 2}, {-1, -2, 3}]],
    Wrong = [
        {1, 3, 2}, {1, 2, -3}, {1, 1, 2}, {0, 1, 2}, {1, 2}, {1, 2, 4}, "xyz", {1.0, 2.0, 3.0}
    ],
    [?assertMatch({error, _}, starl_live_floor:axes(A)) || A <- Wrong],
    {error, Mirror} = starl_live_floor:axes({1, 3, 2}),
    ?assertEqual("axes {1,3,2} mirror the floor: reverse the sign of one", lists:flatten(Mirror)).

%% A whole turn in steps, in both ways of telling a rotation, with each of two axes upwards.
turned_test() ->
    [
        begin
            Heading = starl_geometry:normalise(Degrees * math:pi() / 180),
            {ok, {10.0, 20.0, A}} = starl_live_floor:pose(
                ?Z_UP, {10.0, 20.0, 30.0}, {euler, 0.0, 0.0, Heading}
            ),
            ?NEAR(Heading, A),
            {ok, {10.0, 20.0, B}} = starl_live_floor:pose(
                ?Z_UP, {10.0, 20.0, 30.0}, about({0.0, 0.0, 1.0}, Heading)
            ),
            ?NEAR(Heading, B),
            {ok, {10.0, 20.0, C}} = starl_live_floor:pose(
                ?Y_UP, {10.0, 30.0, -20.0}, about({0.0, 1.0, 0.0}, Heading)
            ),
            ?NEAR(Heading, C),
            {ok, {10.0, 20.0, D}} = starl_live_floor:pose(
                {3, 1, 2}, {20.0, 30.0, 10.0}, about({0.0, 1.0, 0.0}, Heading)
            ),
            ?NEAR(Heading, D)
        end
     || Degrees <- lists:seq(-175, 180, 5)
    ].

%% Nose up by 20 degrees and turned by 90: about its own axes that is a turn about x, then about z. The
%% angle about z says 90 degrees, and the robot looks there. Banked as well, it does not any more.
tilted_test() ->
    Tilt = math:pi() / 9,
    {ok, {_, _, A}} = pose({euler, Tilt, 0.0, math:pi() / 2}),
    ?NEAR(math:pi() / 2, A),
    {ok, {_, _, B}} = pose({euler, 0.3, 0.3, 0.8}),
    %% by hand: x = cos b cos c, y = cos a sin c + sin a sin b cos c
    X = math:cos(0.3) * math:cos(0.8),
    Y = math:cos(0.3) * math:sin(0.8) + math:sin(0.3) * math:sin(0.3) * math:cos(0.8),
    ?NEAR(math:atan2(Y, X), B),
    ?assert(abs(B - 0.8) > 0.04).

%% The same rotation as angles and as a quaternion.
angles_and_quaternion_test() ->
    {A, B, C} = {0.2, -0.3, 2.5},
    Q = times(
        about({1.0, 0.0, 0.0}, A), times(about({0.0, 1.0, 0.0}, B), about({0.0, 0.0, 1.0}, C))
    ),
    {ok, {_, _, First}} = pose({euler, A, B, C}),
    {ok, {_, _, Second}} = pose(Q),
    ?NEAR(First, Second).

refused_test() ->
    ?assertEqual({error, tilted}, pose({euler, 0.6, 0.0, 0.0})),
    ?assertEqual({error, tilted}, pose({euler, math:pi(), 0.0, 0.0})),
    ?assertMatch({ok, _}, pose({euler, 0.5, 0.0, 0.0})),
    ?assertEqual({error, no_rotation}, pose({euler, 1.0e300, 0.0, 0.0})),
    ?assertEqual({error, no_rotation}, pose({quaternion, 0.0, 0.0, 0.0, 0.0})),
    ?assertEqual({error, no_rotation}, pose({quaternion, 1.0e300, 0.0, 0.0, 1.0})),
    ?assertEqual({error, no_rotation}, pose({quaternion, 0.0, 0.0, 0.1, 1.0})),
    Level = {euler, 0.0, 0.0, 0.0},
    ?assertEqual({error, absurd}, starl_live_floor:pose(?Z_UP, {1.0e7, 0.0, 0.0}, Level)),
    ?assertEqual({error, absurd}, starl_live_floor:pose(?Z_UP, {0.0, 0.0, -1.0e308}, Level)).

pose(Rotation) -> starl_live_floor:pose(?Z_UP, {0.0, 0.0, 0.0}, Rotation).

about({X, Y, Z}, Angle) ->
    S = math:sin(Angle / 2),
    {quaternion, X * S, Y * S, Z * S, math:cos(Angle / 2)}.

times({quaternion, A, B, C, W}, {quaternion, X, Y, Z, V}) ->
    {quaternion, W * X + A * V + B * Z - C * Y, W * Y - A * Z + B * V + C * X,
        W * Z + A * Y - B * X + C * V, W * V - A * X - B * Y - C * Z}.
