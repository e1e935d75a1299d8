%% @doc Contracts: an arc lies on its circle and takes the way its flags say; flattening stays
%% within the tolerance; bounds hold the curve and touch it; maps and flattening commute.
-module(starl_svg_curve_tests).

-include_lib("eunit/include/eunit.hrl").

-define(PI, 3.141592653589793).

%% SVG 1.1, 8.3.8: the four arcs between two points of a circle with radius 5.
arc_flags_test_() ->
    From = {3.0, 4.0},
    To = {-3.0, 4.0},
    [
        ?_test(begin
            Points = samples(starl_svg_curve:arc(From, {5.0, 5.0}, 0.0, Large, Sweep, To), 200),
            [?assert(abs(distance(P, Centre) - 5.0) < 1.0e-9, P) || P <- Points],
            ?assert(abs(path_length(Points) - Length) < 0.01),
            ?assertEqual(To, lists:last(Points))
        end)
     || {Large, Sweep, Centre, Length} <- arcs()
    ].

arcs() ->
    Small = 10.0 * math:asin(0.6),
    [
        {false, true, {0.0, 0.0}, Small},
        {false, false, {0.0, 8.0}, Small},
        {true, true, {0.0, 8.0}, 10.0 * ?PI - Small},
        {true, false, {0.0, 0.0}, 10.0 * ?PI - Small}
    ].

%% F.6.6: too small radii grow until the ends fit; a zero radius is a line.
arc_radii_test() ->
    Arc = starl_svg_curve:arc({0.0, 0.0}, {1.0, 1.0}, 0.0, false, true, {10.0, 0.0}),
    Half = samples(Arc, 50),
    [?assert(abs(distance(P, {5.0, 0.0}) - 5.0) < 1.0e-6) || P <- Half],
    ?assertEqual(
        {line, {0.0, 0.0}, {1.0, 1.0}},
        starl_svg_curve:arc({0.0, 0.0}, {0.0, 1.0}, 0.0, false, true, {1.0, 1.0})
    ),
    ?assertEqual(
        {line, {1.0, 1.0}, {1.0, 1.0}},
        starl_svg_curve:arc({1.0, 1.0}, {2.0, 1.0}, 0.0, true, true, {1.0, 1.0})
    ).

%% A rotated arc satisfies the equation of its rotated ellipse.
arc_rotation_test() ->
    Arc = starl_svg_curve:arc({0.0, 0.0}, {8.0, 3.0}, 30.0, true, true, {5.0, 2.0}),
    {arc, _, _, {CX, CY}, _, _, _, _} = Arc,
    {Cos, Sin} = {math:cos(?PI / 6), math:sin(?PI / 6)},
    [
        begin
            {DX, DY} = {X - CX, Y - CY},
            {A, B} = {(Cos * DX + Sin * DY) / 8.0, (Cos * DY - Sin * DX) / 3.0},
            ?assert(abs(A * A + B * B - 1.0) < 1.0e-9, {X, Y})
        end
     || {X, Y} <- samples(Arc, 60)
    ].

%% The largest distance between curve and chords, by dense sampling of random curves.
tolerance_test_() ->
    {timeout, 30, fun() -> for_random(120, fun tolerance_holds/1) end}.

tolerance_holds(Curve) ->
    lists:all(
        fun(Tolerance) ->
            N = starl_svg_curve:steps(Curve, Tolerance),
            Corners = [starl_svg_curve:start(Curve) | starl_svg_curve:flatten(Curve, N)],
            %% Nine points of the curve between each two corners.
            Dense = [starl_svg_curve:start(Curve) | starl_svg_curve:flatten(Curve, N * 10)],
            worst(Corners, Dense, 0.0) =< Tolerance * (1.0 + 1.0e-9) + 1.0e-9
        end,
        [50.0, 2.0, 0.1]
    ).

worst([P, Q | Corners], Dense, Worst) ->
    {Piece, Rest} = lists:split(10, Dense),
    Here = lists:max([to_segment(X, P, Q) || X <- Piece]),
    worst([Q | Corners], Rest, max(Worst, Here));
worst([_], [_], Worst) ->
    Worst.

%% The bound is not bought with needless chords: a circle takes at most one more than the least.
economy_test() ->
    Circle = starl_svg_curve:ellipse({0.0, 0.0}, {4000.0, 4000.0}, 0.0, 2 * ?PI),
    Least = ?PI / math:acos(1.0 - 2.0 / 4000.0),
    ?assert(starl_svg_curve:steps(Circle, 2.0) =< Least + 1.0),
    Dot = starl_svg_curve:ellipse({0.0, 0.0}, {1.0, 1.0}, 0.0, 2 * ?PI),
    ?assertEqual(4, starl_svg_curve:steps(Dot, 2.0)).

bounds_test_() ->
    {timeout, 30, fun() -> for_random(200, fun bounds_hold/1) end}.

bounds_hold(Curve) ->
    {X0, Y0, X1, Y1} = starl_svg_curve:bounds(Curve),
    Points = samples(Curve, 2000),
    {Xs, Ys} = lists:unzip(Points),
    Size = max(1.0, max(X1 - X0, Y1 - Y0)),
    lists:all(
        fun({Bound, Seen}) ->
            Bound - Seen > -1.0e-9 * Size andalso Bound - Seen < 1.0e-3 * Size
        end,
        [{-X0, -lists:min(Xs)}, {-Y0, -lists:min(Ys)}, {X1, lists:max(Xs)}, {Y1, lists:max(Ys)}]
    ).

transform_test_() ->
    {timeout, 30, fun() -> for_random(100, fun maps_commute/1) end}.

maps_commute(Curve) ->
    Map = {1.5, 0.3, -0.7, 0.9, 10.0, -20.0},
    Mapped = samples(starl_svg_curve:transform(Map, Curve), 20),
    Expected = [starl_svg_transform:apply(Map, P) || P <- samples(Curve, 20)],
    lists:all(fun({P, Q}) -> distance(P, Q) < 1.0e-6 end, lists:zip(Mapped, Expected)).

%%% Helpers

for_random(Count, Holds) ->
    Seed =
        case os:getenv("STARL_SEED") of
            false -> 20240;
            Text -> list_to_integer(Text)
        end,
    for_random(Count, Holds, Seed, rand:seed_s(exsss, Seed)).

for_random(0, _Holds, _Seed, _Random) ->
    ok;
for_random(Count, Holds, Seed, Random0) ->
    {Curve, Random} = random_curve(Random0),
    ?assert(Holds(Curve), {seed, Seed, Curve}),
    for_random(Count - 1, Holds, Seed, Random).

random_curve(Random0) ->
    {Kind, Random1} = rand:uniform_s(3, Random0),
    Draw = fun(_, R) -> rand:uniform_s(R) end,
    {Numbers, Random} = lists:mapfoldl(Draw, Random1, lists:seq(1, 9)),
    [P0, P1, P2, P3] = pairs([(N - 0.5) * 10000.0 || N <- lists:sublist(Numbers, 8)]),
    [A, B, C | _] = Numbers,
    Curve =
        case Kind of
            1 ->
                {quad, P0, P1, P2};
            2 ->
                {cubic, P0, P1, P2, P3};
            3 ->
                starl_svg_curve:arc(
                    P0,
                    {A * 9000.0 + 1.0, B * 9000.0 + 1.0},
                    C * 360.0,
                    A > 0.5,
                    B > 0.5,
                    P3
                )
        end,
    {Curve, Random}.

pairs([X, Y | Rest]) -> [{X, Y} | pairs(Rest)];
pairs([]) -> [].

samples(Curve, N) -> [starl_svg_curve:start(Curve) | starl_svg_curve:flatten(Curve, N)].

path_length([P, Q | Rest]) -> distance(P, Q) + path_length([Q | Rest]);
path_length([_]) -> 0.0.

distance({X0, Y0}, {X1, Y1}) -> math:sqrt((X1 - X0) * (X1 - X0) + (Y1 - Y0) * (Y1 - Y0)).

to_segment({X, Y} = P, {X0, Y0} = A, {X1, Y1}) ->
    {DX, DY} = {X1 - X0, Y1 - Y0},
    case DX * DX + DY * DY of
        Square when Square < 1.0e-18 -> distance(P, A);
        Square ->
            T = max(0.0, min(1.0, ((X - X0) * DX + (Y - Y0) * DY) / Square)),
            distance(P, {X0 + T * DX, Y0 + T * DY})
    end.
