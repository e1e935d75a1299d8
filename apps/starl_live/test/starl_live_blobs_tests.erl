%% A coloured ball in pictures: found, and where; what is no ball; and the table of light and noise.
%%
%% Holds: A ball is found where it is, in half light and in warm light; a strip, a cross and a box
%% are none
%% Red: without grey world (its gains bounded by 1): `a_ball_is_where_it_is`, `light_and_noise`
-module(starl_live_blobs_tests).
%% PropEr first: both have a macro LET.
-include_lib("proper/include/proper.hrl").
-include_lib("eunit/include/eunit.hrl").

-define(SIZE, {160, 120}).

a_ball_is_where_it_is_test() ->
    [
        begin
            [#{colour := orange, bearing := B, mm := Told, size := Size}] = seen(#{
                ball => {Bearing, Mm}
            }),
            ?assert(abs(B - Bearing) < 0.01, {Bearing, Mm, B}),
            ?assert(abs(Told / Mm - 1) < 0.2, {Bearing, Mm, Told}),
            ?assert(abs(Size - 2 * math:atan(33.5 / Told)) < 1.0e-6)
        end
     || Bearing <- [-0.4, -0.1, 0.0, 0.25, 0.4], Mm <- [250, 500, 900, 1200]
    ].

nothing_is_seen_in_an_empty_room_test() -> ?assertEqual([], seen(#{})).

%% A ball that the border cuts is at most so far as is told.
clipped_test() ->
    [#{clipped := true, mm := Mm}] = seen(#{ball => {0.53, 400}}),
    ?assert(Mm >= 380, Mm),
    [Whole] = seen(#{ball => {0.3, 400}}),
    ?assertNot(is_map_key(clipped, Whole)).

%% A strip, a cross and a box of the ball's colour are no balls; a disc is one.
what_is_no_ball_test() ->
    ?assertEqual([], shape(fun(X, Y) -> Y >= 40 andalso Y < 44 andalso X > 20 andalso X < 100 end)),
    ?assertEqual(
        [],
        shape(fun(X, Y) ->
            (abs(X - 60) < 3 andalso abs(Y - 60) < 30) orelse
                (abs(Y - 60) < 3 andalso abs(X - 60) < 30)
        end)
    ),
    ?assertEqual([], shape(fun(X, Y) -> abs(X - 60) < 10 andalso abs(Y - 60) < 11 end)),
    ?assertMatch([_], shape(fun(X, Y) -> is_in(X - 60, Y - 60, 10) end)).

is_in(X, Y, Radius) -> X * X + Y * Y < Radius * Radius.

%% A ring is one blob, though its sides are found apart; so is a U, joined at its end.
joined_below_test() ->
    U = fun(X, Y) ->
        (abs(X - 50) < 6 andalso Y > 30 andalso Y < 70) orelse
            (abs(X - 70) < 6 andalso Y > 30 andalso Y < 70) orelse
            (X > 44 andalso X < 76 andalso Y >= 60 andalso Y < 72)
    end,
    ?assertMatch([_], shape(U)).

%% Red lies around 0 degrees; two colours are told apart.
hue_wraps_test() ->
    Colours = #{
        red => #{hue => {340, 10}}, blue => #{hue => {200, 260}}
    },
    Frame = drawn(fun(X, Y) ->
        case {is_in(X - 40, Y - 60, 10), is_in(X - 100, Y - 60, 10)} of
            {true, _} -> {220, 20, 30};
            {_, true} -> {20, 40, 220};
            _ -> {128, 128, 128}
        end
    end),
    ?assertMatch(
        [#{colour := red}, #{colour := blue}],
        starl_live_blobs:find(Frame, (options())#{colours := Colours})
    ).

%% Too small to be seen through the mean, and black: no crash.
tiny_pictures_test() ->
    [
        ?assertEqual([], starl_live_blobs:find(frame(W, H), options()))
     || {W, H} <- [{1, 1}, {2, 2}, {3, 3}, {2, 50}, {50, 2}, {64, 3}]
    ].

frame(W, H) -> #{width => W, height => H, pixels => <<0:(24 * W * H)>>}.

%% Readings are such as the sense `camera' may give, whatever is in the picture.
readings_test() ->
    Profile = (starl_sense_camera:profile())#{field => 1.05, most_mm => 3000},
    starl_platform_ct:property(
        ?FORALL(
            {W, H},
            {proper_types:integer(3, 40), proper_types:integer(3, 40)},
            ?FORALL(
                Pixels,
                proper_types:binary(3 * W * H),
                begin
                    Frame = #{width => W, height => H, pixels => Pixels},
                    Options = (options())#{least_px := 1, colours := all_hues()},
                    starl_sense_camera:is_reading(starl_live_blobs:find(Frame, Options), Profile)
                end
            )
        ),
        100
    ).

all_hues() -> #{any => #{hue => {0, 360}, saturation => 0, value => 0}}.

%% 500 pictures by light and noise: printed; the marked ones must be right.
light_and_noise_test_() ->
    {timeout, 600, fun() ->
        Table = [
            {Name, Sigma, Light, Tint, sums(Light, Tint, Sigma)}
         || {Name, Light, Tint} <- lights(), Sigma <- [0, 8, 20]
        ],
        io:format(user, "~-22s ~5s ~10s ~10s~n", ["light", "noise", "missed", "false ones"]),
        [
            io:format(user, "~-22s ~5b ~6b of ~b ~6b of ~b~n", [Name, S, Missed, N, False, N])
         || {Name, S, _, _, {Missed, False, N}} <- Table
        ],
        [
            ?assertEqual({Name, Sigma, 0, 0}, {Name, Sigma, Missed, False})
         || {Name, Sigma, Light, _, {Missed, False, _}} <- Table, Sigma =< 8, Light >= 0.5
        ]
    end}.

lights() ->
    [
        {"full", 1.0, {1.0, 1.0, 1.0}},
        {"half", 0.5, {1.0, 1.0, 1.0}},
        {"a quarter", 0.25, {1.0, 1.0, 1.0}},
        {"full, warm", 1.0, {1.15, 1.0, 0.75}},
        {"half, warm", 0.5, {1.15, 1.0, 0.75}}
    ].

%% 17 pictures with a ball and 17 without: more than 500 in all.
sums(Light, Tint, Sigma) ->
    N = 17,
    Scene = fun(I) -> #{light => Light, tint => Tint, sigma => Sigma, seed => 1000 * Sigma + I} end,
    Missed = [
        I
     || I <- lists:seq(1, N),
        {B, Mm} <- [place(I, N)],
        not is_found(B, seen((Scene(I))#{ball => {B, Mm}}))
    ],
    False = [I || I <- lists:seq(1, N), seen(Scene(N + I)) =/= []],
    {length(Missed), length(False), N}.

place(I, N) -> {-0.4 + 0.8 * I / N, 250 + 950 * ((I * 7) rem N) / N}.

is_found(Bearing, [#{bearing := B}]) -> abs(B - Bearing) < 0.03;
is_found(_Bearing, _Blobs) -> false.

seen(Scene) ->
    Frame = starl_live_picture:frame(
        ?SIZE,
        maps:merge(#{field => 1.05, ball_mm => 33.5, light => 1.0, sigma => 0, seed => 1}, Scene)
    ),
    starl_live_blobs:find(Frame, options()).

options() -> starl_live_blobs:options().

shape(Is) ->
    Frame = drawn(fun(X, Y) ->
        case Is(X, Y) of
            true -> {255, 110, 20};
            false -> {128, 128, 128}
        end
    end),
    starl_live_blobs:find(Frame, options()).

drawn(Colour) ->
    {W, H} = ?SIZE,
    Pixels = <<
        <<R, G, B>>
     || Y <- lists:seq(0, H - 1), X <- lists:seq(0, W - 1), {R, G, B} <- [Colour(X, Y)]
    >>,
    #{width => W, height => H, pixels => Pixels}.
