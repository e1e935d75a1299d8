%% @doc The course of a leader, and the trail that it leaves for its followers. A pure module; lengths are
%% millimetres.
-module(starl_follow_course).

-export([corners/1, from/2, passed/2, rank/3, back/2]).

%% A corner of the course is passed at this distance (mm).
-define(NEAR_MM, 200).

%% @doc The corners of the course on a floor of this size.
-spec corners({WidthMm :: number(), HeightMm :: number()}) -> [starl_geometry:point(), ...].
corners({W, H}) ->
    [{0.2 * W, 0.2 * H}, {0.8 * W, 0.2 * H}, {0.8 * W, 0.8 * H}, {0.2 * W, 0.8 * H}].

%% @doc The corners, that which is nearest to a point first.
-spec from(starl_geometry:point(), Corners) -> Corners when
    Corners :: [starl_geometry:point(), ...].
from(Point, Corners) ->
    {_, First} = lists:min([{starl_geometry:distance(Point, C), C} || C <- Corners]),
    {Before, After} = lists:splitwith(fun(C) -> C =/= First end, Corners),
    After ++ Before.

%% @doc The corners from now on, the next one first, of a leader that is here.
-spec passed(starl_geometry:point(), Corners) -> Corners when
    Corners :: [starl_geometry:point(), ...].
passed(Point, [Corner | Corners]) ->
    case starl_geometry:distance(Point, Corner) < ?NEAR_MM of
        true -> Corners ++ [Corner];
        false -> [Corner | Corners]
    end.

%% @doc The place of a robot in the column, 1 behind the leader: the highest number comes first, who would lead next;
%% last those above the leader, whom it takes the place of, since they have died and may be back.
-spec rank(starl:robot_id(), Leader :: starl:robot_id(), [starl:robot_id(), ...]) -> pos_integer().
rank(Id, Leader, Ids) when Id < Leader -> 1 + length([R || R <- Ids, R > Id, R < Leader]);
rank(Id, Leader, Ids) -> 1 + length([R || R <- Ids, R < Leader orelse R > Id]).

%% @doc The point of a trail at this distance from its beginning, or its end if it is shorter; and the trail up
%% to there.
-spec back(Trail, Mm :: number()) -> {starl_geometry:point(), Trail} when
    Trail :: [starl_geometry:point(), ...].
back(Trail, Mm) -> back(Trail, Mm, []).

back([Last], _Mm, Before) ->
    {Last, lists:reverse(Before, [Last])};
back([A, B | Trail], Mm, Before) ->
    case starl_geometry:distance(A, B) of
        D when D >= Mm, D > 0 ->
            {starl_geometry:interpolate(A, B, Mm / D), lists:reverse(Before, [A, B])};
        D ->
            back([B | Trail], Mm - D, [A | Before])
    end.
