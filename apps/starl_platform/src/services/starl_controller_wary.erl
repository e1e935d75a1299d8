%% @doc A controller that avoids robots whose positions it knows. A robot on a line must not leave
%% it. So it waits for a robot that stands or drives in its path, for at most 8 s a goal. A robot
%% that drives with a velocity approaches none faster than half of the gap within the time of its
%% command. It passes others on the right, so two robots that meet both do so. On a line it does not
%% drive around a permanent obstacle: that is for the application or path planning.
-module(starl_controller_wary).
-behaviour(starl_controller).

-export([sees_mm/1, waits_us/1, leg/2, velocity/3]).

%% How far it looks, the gap that it leaves to others, and the length of way that it looks ahead on a line, mm.
-define(SEES_MM, 1500).
-define(GAP_MM, 30).
-define(AHEAD_MM, 300).
-define(WAIT_US, 400000).
-define(WAITS_US, 8000000).
%% A velocity holds for no shorter time than this, us: the next one may be late.
-define(LEAST_US, 500000).
%% The part of what it may not drive towards another that it drives past it instead.
-define(PASSING, 0.8).

-spec sees_mm(starl_chassis:profile()) -> pos_integer().
sees_mm(_Profile) -> ?SEES_MM.

-spec waits_us(starl_chassis:profile()) -> pos_integer().
waits_us(_Profile) -> ?WAITS_US.

-spec leg(starl_geometry:point(), starl_controller:situation()) -> go | {wait, pos_integer()}.
leg({TX, TY}, #{pose := {X, Y, _}, near := Near, profile := Profile}) ->
    Room = 2 * starl_chassis:radius_mm(Profile) + ?GAP_MM,
    Way = {TX - X, TY - Y},
    case [N || N <- Near, in_the_way(N, Way, Room)] of
        [] -> go;
        _ -> {wait, ?WAIT_US}
    end.

%% Does its body lie in the next segment of the path? Robots beside or behind do not matter.
in_the_way(#{offset := {OX, OY} = Offset}, {WX, WY} = Way, Room) ->
    Length = size_of(Way),
    Reach = min(Length, ?AHEAD_MM),
    Length > 0 andalso OX * WX + OY * WY > 0 andalso
        starl_geometry:point_segment(
            Offset, {{0.0, 0.0}, {WX * Reach / Length, WY * Reach / Length}}
        ) < Room.

-spec velocity(starl_chassis:velocity(), pos_integer(), starl_controller:situation()) ->
    {float(), float()}.
velocity(Wish, Us, #{near := Near, profile := Profile}) ->
    Room = 2 * starl_chassis:radius_mm(Profile) + ?GAP_MM,
    Seconds = max(Us, ?LEAST_US) / 1.0e6,
    Limits = [limit(N, Room, Seconds) || #{distance := D} = N <- Near, D > 0],
    held(passing(Wish, Limits), Limits).

%% The direction to another, and how fast it may be approached: both may do so.
limit(#{offset := {OX, OY}, distance := D}, Room, Seconds) ->
    {{OX / D, OY / D}, max(0.0, (D - Room) / 2 / Seconds)}.

%% What is too fast towards others becomes a way past them, to the right.
passing(Wish, Limits) -> lists:foldl(fun(Limit, V) -> past(Limit, V) end, Wish, Limits).

past({{UX, UY}, Most}, {VX, VY} = V) ->
    case UX * VX + UY * VY - Most of
        Much when Much > 0 ->
            {VX - Much * UX + ?PASSING * Much * UY, VY - Much * UY - ?PASSING * Much * UX};
        _ ->
            V
    end.

%% The way past one may lead towards another: what is still too fast is left out, and if that does not
%% help, it stands.
held(V, Limits) ->
    Slower = lists:foldl(fun(Limit, W) -> without(Limit, W) end, V, Limits),
    case lists:all(fun(Limit) -> keeps(Limit, Slower) end, Limits) of
        true -> Slower;
        false -> {0.0, 0.0}
    end.

without({{UX, UY}, Most}, {VX, VY} = V) ->
    case UX * VX + UY * VY - Most of
        Much when Much > 0 -> {VX - Much * UX, VY - Much * UY};
        _ -> V
    end.

keeps({{UX, UY}, Most}, {VX, VY}) -> UX * VX + UY * VY =< Most + 1.0e-6.

size_of({X, Y}) -> math:sqrt(X * X + Y * Y).
