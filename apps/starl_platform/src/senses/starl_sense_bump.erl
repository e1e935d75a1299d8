%% @doc The bumper detects on which side the robot touches something. It goes around the front half
%% and has a switch on each side; near the middle both close. A reading is `none', `left', `right'
%% or `both'.
-module(starl_sense_bump).
-behaviour(starl_sense).

-export([profile/0, errors/0, read/2, blurred/3, guess/2, is_reading/2]).
-export([side/2]).

%% `middle': both switches close within this bearing (rad); `touch_mm': so near is touching;
%% `missed': the part of the readings in which no touch is felt; `invented': the part of those without a touch in which one is. A
%% switch that is sound does not err.
-spec profile() -> starl_sense:profile().
profile() -> #{middle => 0.26, touch_mm => 1.0, missed => 0.0, invented => 0.0}.

-spec errors() -> [atom()].
errors() -> [missed, invented].

-spec read(starl_sense:view(), starl_sense:profile()) -> none | left | right | both.
read(#{draw := Draw} = View, Profile) ->
    Sides = [Side || P <- touched(View, Profile), Side <- [side(P, View, Profile)]],
    blurred(pressed(Sides), Draw, Profile).

pressed(Sides) ->
    case {lists:member(left, Sides), lists:member(right, Sides), lists:member(both, Sides)} of
        {_, _, true} -> both;
        {true, true, _} -> both;
        {true, false, _} -> left;
        {false, true, _} -> right;
        {false, false, _} -> none
    end.

%% The places at which it touches walls and bodies.
touched(#{pose := {X, Y, _}, radius_mm := R, walls := Walls, bodies := Bodies}, Profile) ->
    Reach = R + maps:get(touch_mm, Profile),
    [
        P
     || {_, Wall} <- starl_walls:near({{X, Y}, {X, Y}}, Reach, Walls),
        P <- [starl_geometry:closest_point({X, Y}, Wall)],
        starl_geometry:distance({X, Y}, P) =< Reach
    ] ++
        [P || {_, P, Other} <- Bodies, starl_geometry:distance({X, Y}, P) =< Reach + Other].

side(Point, #{pose := Pose}, #{middle := Middle}) -> side(starl_sense:bearing(Point, Pose), Middle).

%% @doc The side of the bumper at a bearing.
-spec side(Bearing :: float(), Middle :: float()) -> left | right | both | behind.
side(Bearing, Middle) ->
    if
        abs(Bearing) =< Middle -> both;
        abs(Bearing) > 1.5707963267948966 -> behind;
        Bearing > 0 -> left;
        true -> right
    end.

%% @doc A touch that is missed, or is none.
-spec blurred(Side, starl_sense:draw(), starl_sense:profile()) -> Side when
    Side :: none | left | right | both.
blurred(none, Draw, #{invented := Invented}) ->
    case Draw(invented) < Invented of
        true -> lists:nth(1 + trunc(3 * Draw(guess)), [left, right, both]);
        false -> none
    end;
blurred(Side, Draw, #{missed := Missed}) ->
    case Draw(missed) < Missed of
        true -> none;
        false -> Side
    end.

-spec guess(starl_sense:draw(), starl_sense:profile()) -> none | left | right | both.
guess(Draw, _Profile) -> lists:nth(1 + trunc(4 * Draw(guess)), [none, left, right, both]).

-spec is_reading(term(), starl_sense:profile()) -> boolean().
is_reading(Reading, _Profile) -> lists:member(Reading, [none, left, right, both]).
