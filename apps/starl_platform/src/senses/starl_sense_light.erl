%% @doc The light sensor measures how bright it is at the robot. A reading is a number from 0
%% (dark). A lamp in sight adds 1 right beside it, and 1/e of that (37 %) at the distance `lamp_mm'.
%% Walls and robots cast shadows.
-module(starl_sense_light).
-behaviour(starl_sense).

-export([profile/0, errors/0, read/2, blurred/3, guess/2, is_reading/2]).

%% `most': the brightest that it tells; `noise': the standard deviation, as a part of the reading.
-spec profile() -> starl_sense:profile().
profile() -> #{most => 4.0, noise => 0.02}.

-spec errors() -> [atom()].
errors() -> [noise].

-spec read(starl_sense:view(), starl_sense:profile()) -> float().
read(
    #{pose := {X, Y, _}, things := Things, walls := Walls, bodies := Bodies, draw := Draw}, Profile
) ->
    #{most := Most, noise := Noise} = Profile,
    Discs = [{At, R} || {_, At, R} <- Bodies],
    Light = lists:sum([
        math:exp(-starl_geometry:distance({X, Y}, At) / Mm)
     || #{at := At, lamp_mm := Mm} <- Things, starl_sight:is_clear({X, Y}, At, Discs, Walls)
    ]),
    max(0.0, min(float(Most), Light * (1.0 + Noise * starl_sense:normal(light, Draw)))).

%% @doc A reading with more noise.
-spec blurred(float(), starl_sense:draw(), starl_sense:profile()) -> float().
blurred(Light, Draw, #{most := Most, noise := Noise}) ->
    max(0.0, min(float(Most), Light * (1.0 + Noise * starl_sense:normal(light, Draw)))).

-spec guess(starl_sense:draw(), starl_sense:profile()) -> float().
guess(Draw, #{most := Most}) -> float(Most) * Draw(guess).

-spec is_reading(term(), starl_sense:profile()) -> boolean().
is_reading(Light, #{most := Most}) -> is_float(Light) andalso Light >= 0 andalso Light =< Most.
