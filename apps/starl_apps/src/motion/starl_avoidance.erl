%% @doc Drives towards a point for a short time, and avoids other robots. The velocity is the sum of
%% a pull towards the goal and of pushes away from all robots that are near and ahead. Each push
%% points a little to the right, so that two robots that meet pass each other. Nothing is
%% guaranteed: robots that must never touch use path planning (`starl_dpp').
-module(starl_avoidance).

-export([drive/3]).

-export_type([options/0]).

%% `speed': towards the goal, mm/s; nearer than a second's way it is slower. `shy_mm': from where another robot
%% is avoided, the distance of the centres. `ms': the dead man's time.
-type options() :: #{speed := number(), shy_mm := number(), ms := pos_integer()}.

%% The distance of the centres of two Creates that touch (mm).
-define(TOUCH_MM, 330).

%% @doc Drives on; it does not wait.
-spec drive(starl:robot(), Goal :: starl_geometry:point(), options()) ->
    ok | {error, stopped | stalled | restarted | unknown}.
drive(Robot, Goal, #{shy_mm := Shy, ms := Ms} = Options) ->
    case {starl:position(Robot), starl:neighbours(Robot, Shy)} of
        {{ok, {X, Y, _}}, {ok, Near}} ->
            Pull = pull({X, Y}, Goal, Options),
            Pushes = [push(N, Options) || #{distance := D} = N <- Near, D > 0, is_ahead(N, Pull)],
            starl:velocity(Robot, sum([Pull | Pushes]), Ms);
        {{error, _} = Error, _} ->
            Error;
        {_, {error, _} = Error} ->
            Error
    end.

pull({X, Y}, {GX, GY}, #{speed := Speed}) ->
    case starl_geometry:distance({X, Y}, {GX, GY}) of
        D when D > 0 -> {min(Speed, D) / D * (GX - X), min(Speed, D) / D * (GY - Y)};
        _ -> {0.0, 0.0}
    end.

%% Who comes from behind keeps away himself.
is_ahead(#{offset := {DX, DY}}, {VX, VY}) -> DX * VX + DY * VY >= 0.

push(#{offset := {DX, DY}, distance := D}, #{speed := Speed, shy_mm := Shy}) ->
    By = Speed * (Shy - D) / max(1, Shy - ?TOUCH_MM) / D,
    {By * (-DX + 0.7 * DY), By * (-DY - 0.7 * DX)}.

sum(Vectors) -> {lists:sum([X || {X, _} <- Vectors]), lists:sum([Y || {_, Y} <- Vectors])}.
