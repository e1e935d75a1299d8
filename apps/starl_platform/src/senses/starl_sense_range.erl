%% @doc The range finder measures the distance to walls and bodies. A reading is a list of beams
%% from right to left, `{Bearing, Mm | none}', measured from the middle of the robot. `none' means
%% nothing within reach, or no echo.
-module(starl_sense_range).
-behaviour(starl_sense).

-export([profile/0, errors/0, read/2, blurred/3, guess/2, is_reading/2]).

%% `beams' spread evenly over `field' (rad), up to `most_mm'. `noise_mm' and the part `noise' of the
%% distance are standard deviations; `missed': the part of the beams without an echo; `invented':
%% that of beams that come back too early.
-spec profile() -> starl_sense:profile().
profile() ->
    #{
        beams => 16,
        field => 3.141592653589793,
        most_mm => 4000,
        noise_mm => 5,
        noise => 0.01,
        missed => 0.01,
        invented => 0.005
    }.

-spec errors() -> [atom()].
errors() -> [noise_mm, noise, missed, invented].

-spec read(starl_sense:view(), starl_sense:profile()) -> [{float(), float() | none}].
read(#{pose := {X, Y, Heading}, walls := Walls, bodies := Bodies, draw := Draw}, Profile) ->
    Most = float(maps:get(most_mm, Profile)),
    Discs = [{At, R} || {_, At, R} <- Bodies],
    [
        {Bearing,
            echo(starl_sight:ray({X, Y}, Heading + Bearing, Most, Discs, Walls), N, Draw, Profile)}
     || {N, Bearing} <- bearings(Profile)
    ].

bearings(#{beams := Beams, field := Field}) ->
    N = max(1, round(Beams)),
    [{I, beam(I, N, float(Field))} || I <- lists:seq(1, N)].

beam(_I, 1, _Field) -> 0.0;
beam(I, N, Field) -> Field * ((I - 1) / (N - 1) - 0.5).

echo(Mm, N, Draw, #{missed := Missed, invented := Invented, most_mm := Most} = Profile) ->
    case Draw({beam, N}) of
        U when U < Missed -> none;
        U when U < Missed + Invented -> Draw({early, N}) * far(Mm, Most);
        _ -> blurred(Mm, N, Draw, Profile)
    end.

far(none, Most) -> float(Most);
far(Mm, _Most) -> Mm.

blurred(none, _N, _Draw, _Profile) ->
    none;
blurred(Mm, N, Draw, #{noise_mm := Error, noise := Part, most_mm := Most}) ->
    case Mm + (Error + Part * Mm) * starl_sense:normal({blur, N}, Draw) of
        Seen when Seen > Most -> none;
        Seen -> max(0.0, Seen)
    end.

%% @doc Beams that are missed, end too early, or err.
-spec blurred(Beams, starl_sense:draw(), starl_sense:profile()) -> Beams when
    Beams :: [{float(), float() | none}].
blurred(Beams, Draw, Profile) ->
    [{Bearing, echo(Mm, N, Draw, Profile)} || {N, {Bearing, Mm}} <- lists:enumerate(Beams)].

-spec guess(starl_sense:draw(), starl_sense:profile()) -> [{float(), float()}].
guess(Draw, #{most_mm := Most} = Profile) ->
    [{Bearing, Most * Draw({guess, N})} || {N, Bearing} <- bearings(Profile)].

-spec is_reading(term(), starl_sense:profile()) -> boolean().
is_reading(Beams, #{most_mm := Most} = Profile) when is_list(Beams) ->
    [B || {B, _} <- Beams] =:= [B || {_, B} <- bearings(Profile)] andalso
        lists:all(fun({_, Mm}) -> Mm =:= none orelse (Mm >= 0 andalso Mm =< Most) end, Beams);
is_reading(_Other, _Profile) ->
    false.
