%% @doc The camera sees coloured things in front of the robot. A reading lists blobs from left to
%% right: `#{colour, bearing, size, mm}'. `size' is the angle under which the thing appears (rad),
%% and `mm' the distance of a ball of the usual size at that angle. Walls and robots hide a thing;
%% some things are missed, and some are reported that are not there.
-module(starl_sense_camera).
-behaviour(starl_sense).

-export([profile/0, errors/0, read/2, blurred/3, guess/2, is_reading/2]).

%% `field': the angle of view (rad); `most_mm': how far a thing is seen; `ball_mm': the radius of
%% the ball that a distance is told for. `noise' (rad) and the part `noise_part' of the distance are
%% standard deviations; `missed': the part of the things that is overlooked; `invented': the part of
%% the pictures with a false blob.
-spec profile() -> starl_sense:profile().
profile() ->
    #{
        field => 2.1,
        most_mm => 3000,
        ball_mm => 100,
        noise => 0.01,
        noise_part => 0.05,
        missed => 0.05,
        invented => 0.005
    }.

-spec errors() -> [atom()].
errors() -> [noise, noise_part, missed, invented].

-spec read(starl_sense:view(), starl_sense:profile()) -> [map()].
read(#{things := Things, draw := Draw} = View, #{invented := Invented} = Profile) ->
    Seen = [
        Blob
     || {N, #{colour := _} = Thing} <- lists:enumerate(Things),
        Blob <- blob(N, Thing, View, Profile)
    ],
    False = [One || Draw(invented) < Invented, One <- guess(Draw, Profile)],
    from_the_left(Seen ++ False).

blob(N, #{at := At, colour := Colour} = Thing, #{pose := {X, Y, _} = Pose} = View, Profile) ->
    #{walls := Walls, bodies := Bodies, draw := Draw} = View,
    #{field := Field, most_mm := Most, missed := Missed, ball_mm := Ball} = Profile,
    Mm = max(1.0, starl_geometry:distance({X, Y}, At)),
    Bearing = starl_sense:bearing(At, Pose),
    Discs = [{Where, R} || {_, Where, R} <- Bodies],
    case
        Mm =< Most andalso abs(Bearing) =< Field / 2 andalso Draw({missed, N}) >= Missed andalso
            starl_sight:is_clear({X, Y}, At, Discs, Walls)
    of
        true ->
            Size = 2 * math:atan(maps:get(radius_mm, Thing, Ball) / Mm),
            [seen(Colour, Bearing, Size, N, Draw, Profile)];
        false ->
            []
    end.

seen(Colour, Bearing, Size0, N, Draw, #{noise := Noise, noise_part := Part} = Profile) ->
    #{field := Field} = Profile,
    Off = Noise * starl_sense:normal({bearing, N}, Draw),
    Size = Size0 / max(0.1, 1.0 + Part * starl_sense:normal({size, N}, Draw)),
    made(Colour, max(-Field / 2, min(Field / 2, Bearing + Off)), Size, Profile).

made(Colour, Bearing, Size, #{ball_mm := Ball, most_mm := Most}) ->
    Mm = Ball / math:tan(min(1.5, Size / 2)),
    #{colour => Colour, bearing => Bearing, size => Size, mm => min(float(Most), Mm)}.

%% @doc Things that are missed, invented, or seen elsewhere.
-spec blurred([map()], starl_sense:draw(), starl_sense:profile()) -> [map()].
blurred(Blobs, Draw, #{missed := Missed, invented := Invented} = Profile) ->
    Seen = [
        maps:merge(Blob, seen(Colour, Bearing, Size, N, Draw, Profile))
     || {N, #{colour := Colour, bearing := Bearing, size := Size} = Blob} <- lists:enumerate(Blobs),
        Draw({missed, N}) >= Missed
    ],
    from_the_left(Seen ++ [One || Draw(invented) < Invented, One <- guess(Draw, Profile)]).

from_the_left(Blobs) -> lists:sort(fun(#{bearing := A}, #{bearing := B}) -> A >= B end, Blobs).

%% A false blob has the colour of no thing in particular.
-spec guess(starl_sense:draw(), starl_sense:profile()) -> [map()].
guess(Draw, #{field := Field, most_mm := Most, ball_mm := Ball} = Profile) ->
    Colour = lists:nth(1 + trunc(4 * Draw(colour)), [red, orange, green, blue]),
    Size = 2 * math:atan(Ball / (Ball + (Most - Ball) * Draw(far))),
    [made(Colour, Field * (Draw(angle) - 0.5), Size, Profile)].

-spec is_reading(term(), starl_sense:profile()) -> boolean().
is_reading(Blobs, #{field := Field, most_mm := Most}) when is_list(Blobs) ->
    lists:all(
        fun(#{colour := Colour, bearing := B, size := Size, mm := Mm}) ->
            is_atom(Colour) andalso abs(B) =< Field / 2 + 1.0e-9 andalso Size > 0 andalso Mm >= 0 andalso
                Mm =< Most
        end,
        Blobs
    );
is_reading(_Other, _Profile) ->
    false.
