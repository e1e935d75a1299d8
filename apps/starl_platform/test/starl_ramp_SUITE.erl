%% Pieces of motion with acceleration, against dense sampling: the closest approach of two robots at
%% every instant, ramps, lines and arcs against each other; how far they drive, the disc and the
%% chords around them; and the watch over a whole team.
-module(starl_ramp_SUITE).
-include_lib("stdlib/include/assert.hrl").
-include_lib("proper/include/proper.hrl").

-export([all/0]).
-export([
    closest_approach/1,
    there_and_back/1,
    kinks_and_rests/1,
    length_disc_and_chords/1,
    share_of_the_way/1,
    separation_of_a_team/1,
    a_braking_robot_that_dies/1
]).

-define(S, 1_000_000).
-define(SAMPLES, 2000).

all() ->
    [
        closest_approach,
        there_and_back,
        kinks_and_rests,
        length_disc_and_chords,
        share_of_the_way,
        separation_of_a_team,
        a_braking_robot_that_dies
    ].

%% Never above the samples, attained, and not below what the samples allow.
closest_approach(_) ->
    Prop = ?FORALL(
        {A, B, Span},
        {ramp(), any_piece(), choose(1, 3 * ?S)},
        starl_platform_ct:safely(fun() -> exact(A, B, 100_000, 100_000 + Span) end)
    ),
    starl_platform_ct:property(Prop, 600).

exact(A, B, T1, T2) ->
    {Distance, At} = starl_trajectory:closest_approach(A, B, T1, T2),
    {Turned, _} = starl_trajectory:closest_approach(B, A, T1, T2),
    Sampled = lists:min([apart(T, A, B) || T <- samples(T1, T2)]),
    Speed = starl_trajectory:fastest(A) + starl_trajectory:fastest(B),
    Between = Speed * (T2 - T1) / ?SAMPLES / 2.0e6 + Speed * 1.0e-6 + 1.0e-6,
    Farther = starl_trajectory:closest_within(Sampled - Between - 1.0, A, B, T1, T2),
    Distance =< Sampled + 1.0e-3 andalso
        abs(Distance - Turned) =< 2.0e-3 andalso
        At >= T1 andalso At =< T2 andalso
        abs(Distance - apart(At, A, B)) =< Speed * 1.0e-6 + 1.0e-6 andalso
        Distance >= Sampled - Between andalso
        Farther =:= farther.

%% Straight towards a robot that stands, and back: the moment of the turn, which lies anywhere, is
%% found by the bound of the acceleration alone.
there_and_back(_) ->
    Post = starl_trajectory:standing(0, {0.0, -1000.0}, 0.0),
    [
        begin
            Ramp = starl_trajectory:ramp(0, {0.0, 0.0}, 0.0, {0.0, -V}, {0.0, W}, ?S),
            {Distance, _} = starl_trajectory:closest_approach(Ramp, Post, 0, ?S),
            True = 1000.0 - V * V / (V + W) / 2,
            ?assert(
                Distance >= True - 1.0e-9 andalso Distance =< True + 1.0e-3, {V, W, Distance - True}
            )
        end
     || V <- [130.0, 310.0, 500.0], W <- [11.0 + 7.3 * I || I <- lists:seq(0, 60)]
    ].

samples(T1, T2) -> [T1 + I * (T2 - T1) div ?SAMPLES || I <- lists:seq(0, ?SAMPLES)].

apart(T, A, B) ->
    starl_geometry:distance(starl_trajectory:position(T, A), starl_trajectory:position(T, B)).

%% A brake of 500 mm/s within 0.25 s takes 62.5 mm, and then it stands; what is near to where it
%% stands is met when it comes there.
kinks_and_rests(_) ->
    Brake = starl_trajectory:ramp(0, {0.0, 0.0}, 0.0, {500.0, 0.0}, {0.0, 0.0}, ?S div 4),
    ?assertEqual({62.5, 0.0}, starl_trajectory:position(?S, Brake)),
    ?assertEqual({250.0, 0.0}, starl_trajectory:velocity(?S div 8, Brake)),
    ?assertEqual(?S div 4, starl_trajectory:rests_from(Brake)),
    ?assertEqual(Brake, starl_trajectory:stop(?S div 8, Brake)),
    ?assertNot(starl_trajectory:is_still(Brake)),
    Post = starl_trajectory:standing(0, {62.5, 10.0}, 0.0),
    {Distance, At} = starl_trajectory:closest_approach(Brake, Post, 0, 2 * ?S),
    ?assert(abs(Distance - 10.0) < 1.0e-3, Distance),
    ?assert(At =< ?S div 4, At),
    Even = starl_trajectory:ramp(0, {0.0, 0.0}, 0.0, {0.0, 0.0}, {100.0, 0.0}, ?S),
    ?assertEqual({150.0, 0.0}, starl_trajectory:position(2 * ?S, Even)),
    ?assertEqual(never, starl_trajectory:rests_from(Even)),
    %% there and back: the chord alone would be a dot
    Back = starl_trajectory:ramp(0, {0.0, 0.0}, 0.0, {100.0, 0.0}, {-100.0, 0.0}, ?S),
    ?assert(lists:max([X || {X, _} <- starl_trajectory:polyline(Back, 0, ?S, 0.1)]) > 24.9),
    ?assert(abs(starl_trajectory:moved(0, ?S, Back) - 50.0) < 1.0e-9).

length_disc_and_chords(_) ->
    Prop = ?FORALL(
        {Piece, From, Span},
        {ramp(), choose(0, 2 * ?S), choose(1, 2 * ?S)},
        starl_platform_ct:safely(fun() -> along(Piece, From, From + Span) end)
    ),
    starl_platform_ct:property(Prop, 400).

along(Piece, T1, T2) ->
    Points = [starl_trajectory:position(T, Piece) || T <- samples(T1, T2)],
    Length = lists:sum([
        starl_geometry:distance(P, Q)
     || {P, Q} <- lists:zip(lists:droplast(Points), tl(Points))
    ]),
    Moved = starl_trajectory:moved(T1, T2, Piece),
    {Centre, Radius} = starl_trajectory:enclosing(T1, T2, Piece),
    Chords = starl_trajectory:polyline(Piece, T1, T2, 0.05),
    Segments = lists:zip(Chords, tl(Chords) ++ [lists:last(Chords)]),
    Off = fun(P) -> lists:min([starl_geometry:point_segment(P, S) || S <- Segments]) end,
    %% chords of the samples are a little shorter than the path; a path that turns back about between
    %% two of them by as much as it drives there
    Step = starl_trajectory:fastest(Piece) * ((T2 - T1) / ?SAMPLES + 1) / 1.0e6,
    Moved >= Length - 1.0e-6 andalso Moved =< Length * (1 + 1.0e-4) + 2 * Step + 1.0e-6 andalso
        lists:all(fun(P) -> starl_geometry:distance(P, Centre) =< Radius + 1.0e-6 end, Points) andalso
        lists:all(fun(P) -> Off(P) =< 0.05 + 1.0e-6 end, every(20, Points)).

every(N, Points) -> [P || {I, P} <- lists:zip(lists:seq(1, length(Points)), Points), I rem N =:= 1].

share_of_the_way(_) ->
    Prop = ?FORALL(
        {Piece, Span, Percent},
        {ramp(), choose(1, 2 * ?S), choose(0, 100)},
        starl_platform_ct:safely(fun() ->
            At = starl_trajectory:passing(Percent / 100, Piece, 0, Span),
            Come = starl_trajectory:moved(0, At, Piece),
            Want = starl_trajectory:moved(0, Span, Piece) * Percent / 100,
            abs(Come - Want) =< 1.0e-6 * starl_trajectory:fastest(Piece) + 1.0e-6
        end)
    ),
    starl_platform_ct:property(Prop, 200).

%% The least distance of a whole team, and who met, as pair by pair says.
separation_of_a_team(_) ->
    Prop = ?FORALL(
        Paths,
        vector(6, vector(4, {ramp(), choose(1, 2 * ?S)})),
        starl_platform_ct:safely(fun() -> watched([connected(Path) || Path <- Paths]) end)
    ),
    starl_platform_ct:property(Prop, 60).

%% One after the other, each from where the last one got to.
connected(Path) ->
    {Pieces, _} = lists:mapfoldl(
        fun({{ramp, _, X, Y, H, V0, V1, Us}, Span}, {T, Point}) ->
            Here =
                case Point of
                    none -> {X, Y};
                    _ -> Point
                end,
            Piece = starl_trajectory:ramp(T, Here, H, V0, V1, Us),
            {Piece, {T + Span, starl_trajectory:position(T + Span, Piece)}}
        end,
        {0, none},
        Path
    ),
    Pieces.

watched(Team) ->
    End = 8 * ?S,
    Numbered = lists:zip(lists:seq(1, length(Team)), Team),
    Motions = lists:sort([
        {starl_trajectory:start_us(P), Robot, P}
     || {Robot, Ps} <- Numbered, P <- Ps
    ]),
    {Met, Last} = lists:foldl(
        fun({T, Robot, Piece}, {Found, S}) ->
            {New, Now} = starl_separation:advance(T, S),
            {Found ++ New, starl_separation:motion(Robot, Piece, Now)}
        end,
        {[], starl_separation:new(60.0)},
        Motions
    ),
    {Late, {Least, _, _}} = starl_separation:finish(End, Last),
    Pairs = [
        {nearest(stretches(As, End), stretches(Bs, End)), {A, B}}
     || {A, As} <- Numbered, {B, Bs} <- Numbered, A < B
    ],
    Found = [Pair || {_, _, Pair} <- Met ++ Late],
    {True, _} = lists:min(Pairs),
    abs(Least - True) =< 2.0e-3 andalso
        [P || {D, P} <- Pairs, D < 59.998] -- Found =:= [] andalso
        Found -- [P || {D, P} <- Pairs, D < 60.0] =:= [].

nearest(As, Bs) ->
    lists:min([
        element(1, starl_trajectory:closest_approach(A, B, max(FA, FB), min(TA, TB)))
     || {FA, TA, A} <- As, {FB, TB, B} <- Bs, max(FA, FB) =< min(TA, TB)
    ]).

stretches(Pieces, End) ->
    Starts = [starl_trajectory:start_us(P) || P <- Pieces],
    lists:zip3(Starts, tl(Starts) ++ [End], Pieces).

%% It does not stand at once where it dies, but where it comes to rest.
a_braking_robot_that_dies(_) ->
    Brake = starl_trajectory:ramp(0, {0.0, 0.0}, 0.0, {500.0, 0.0}, {0.0, 0.0}, ?S div 4),
    Post = starl_trajectory:standing(0, {100.0, 0.0}, 0.0),
    S0 = starl_separation:motion(
        2, Post, starl_separation:motion(1, Brake, starl_separation:new(50.0))
    ),
    {Met, {Least, _, _}} = starl_separation:finish(2 * ?S, starl_separation:stop(1, 0, S0)),
    ?assertMatch([{_, _, {1, 2}}], Met),
    ?assert(abs(Least - 37.5) < 1.0e-3, Least).

%% -- generators -----------------------------------------------------------------------------

any_piece() -> oneof([ramp(), ramp(), arc()]).

ramp() ->
    ?LET(
        {X, Y, V0, V1, Us, T0},
        {coordinate(), coordinate(), velocity(), change(), choose(0, 2 * ?S), choose(-?S, 0)},
        starl_trajectory:ramp(T0, {X, Y}, 0.3, V0, turned(V0, V1), Us)
    ).

%% To rest, along the same line, back, or any other.
turned({VX, VY}, {along, K}) -> {K * VX, K * VY};
turned(_V0, {_, _} = V1) -> V1.

arc() ->
    ?LET(
        {X, Y, H, V, W},
        {coordinate(), coordinate(), choose(0, 62), oneof([0, 50, 500]), oneof([0.0, -3.0, 0.4])},
        starl_trajectory:piece(-200_000, {X, Y}, H / 10, float(V), W)
    ).

coordinate() -> ?LET(Mm, choose(0, 600), float(Mm)).

velocity() -> oneof([{0.0, 0.0}, {speed(), speed()}, {speed(), speed()}]).

change() -> oneof([velocity(), {along, oneof([0.0, 0.5, 1.0, -1.0, -0.3])}]).

speed() -> ?LET(V, choose(-500, 500), float(V)).
