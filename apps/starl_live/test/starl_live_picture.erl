%% Pictures for the tests of the camera: a shaded ball before a grey wall and on a brown floor, in good and
%% bad light, with noise.
-module(starl_live_picture).

-export([frame/2, ppm/1, focal/2]).

%% `ball': where it is (bearing, rad, and mm), or none; `light': the part of full light; `tint': the
%% factors of red, green and blue; `sigma': the noise of each value. The camera stands 100 mm above
%% the floor and looks ahead.
frame({Width, Height}, #{field := Field, ball_mm := Radius} = Scene) ->
    Focal = focal(Width, Field),
    Ball = ball(maps:get(ball, Scene, none), Focal, Radius, Width, Height),
    #{light := Light, sigma := Sigma, seed := Seed} = Scene,
    Tint = maps:get(tint, Scene, {1.0, 1.0, 1.0}),
    Noise = noise(Sigma),
    {Rows, _} = lists:mapfoldl(
        fun(Y, Rng) -> row(Y, Width, Height, Ball, {Light, Tint}, Noise, Rng) end,
        16#9E3779B9 bxor Seed,
        lists:seq(0, Height - 1)
    ),
    #{width => Width, height => Height, pixels => iolist_to_binary(Rows)}.

focal(Width, Field) -> Width / (2 * math:tan(Field / 2)).

%% Its centre and radius in the picture.
ball(none, _Focal, _Radius, _Width, _Height) ->
    none;
ball({Bearing, Mm}, Focal, Radius, Width, Height) ->
    Depth = Mm * math:cos(Bearing),
    {
        Width / 2 - Focal * math:tan(Bearing),
        Height / 2 + Focal * (100 - Radius) / Depth,
        Focal * Radius / Depth / math:cos(Bearing),
        Focal * Radius / Depth
    }.

row(Y, Width, Height, Ball, Light, Noise, Rng0) ->
    lists:mapfoldl(
        fun(X, Rng) -> pixel(colour(X + 0.5, Y + 0.5, Height, Ball), Light, Noise, Rng) end,
        Rng0,
        lists:seq(0, Width - 1)
    ).

colour(X, Y, Height, {Cx, Cy, Rx, Ry}) ->
    case {(X - Cx) / Rx, (Y - Cy) / Ry} of
        {U, V} when U * U + V * V < 1.0 ->
            %% light from above
            Shade = 0.55 + 0.45 * max(0.0, -0.6 * V + 0.8 * math:sqrt(1.0 - U * U - V * V)),
            {255 * Shade, 110 * Shade, 20 * Shade};
        _ ->
            background(Y, Height)
    end;
colour(_X, Y, Height, none) ->
    background(Y, Height).

background(Y, Height) when Y < 0.45 * Height -> {150, 150, 150};
background(_Y, _Height) -> {120, 95, 70}.

pixel({R, G, B}, {Light, {Tr, Tg, Tb}}, Noise, Rng0) ->
    {Nr, Rng1} = drawn(Noise, Rng0),
    {Ng, Rng2} = drawn(Noise, Rng1),
    {Nb, Rng} = drawn(Noise, Rng2),
    {
        <<
            (level(R * Light * Tr + Nr)),
            (level(G * Light * Tg + Ng)),
            (level(B * Light * Tb + Nb))
        >>,
        Rng
    }.

level(V) -> max(0, min(255, round(V))).

%% A table of normal values, drawn from by a generator of Lehmer's.
noise(Sigma) when Sigma == 0 -> none;
noise(Sigma) ->
    {Values, _} = lists:mapfoldl(
        fun(_, R) ->
            {V, Next} = rand:normal_s(R),
            {Sigma * V, Next}
        end,
        rand:seed_s(exsss, 7),
        lists:seq(1, 4096)
    ),
    list_to_tuple(Values).

drawn(none, Rng) ->
    {0.0, Rng};
drawn(Noise, Rng) ->
    Next = (Rng * 48271) rem 16#7FFFFFFF,
    {element(1 + (Next bsr 8) band 4095, Noise), Next}.

ppm(#{width := Width, height := Height, pixels := Pixels}) ->
    iolist_to_binary([io_lib:format("P6\n~b ~b\n255\n", [Width, Height]), Pixels]).
