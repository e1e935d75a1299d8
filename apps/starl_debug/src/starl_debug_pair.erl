%% @doc Bounds of the distance of two robots for a piece of time and windows of their clocks.
%%
%% Each robot stays within a radius of a point that moves evenly by its own clock. The difference of
%% the two points is then linear in the time and in the two errors of clocks, so over the piece and
%% the windows it fills a convex polygon with parallel sides; the distances of its points from 0 are
%% between those found here.
-module(starl_debug_pair).

-export([distance/4]).

-export_type([moving/0]).

%% A robot's track and the window of its clock (us).
-type moving() :: {starl_debug_track:t(), {LoUs :: integer(), HiUs :: integer()}}.

-define(NOTHING_MM, 1.0e-9).

%% @doc The least and the greatest distance (mm) from a time until another, by the common time line.
-spec distance(FromUs :: integer(), ToUs :: integer(), moving(), moving()) ->
    {LeastMm :: float(), GreatestMm :: float()}.
distance(From, To, A, B) ->
    {{AX, AY}, {AVX, AVY}, ASpread, AWindow} = course(From, To, A),
    {{BX, BY}, {BVX, BVY}, BSpread, BWindow} = course(From, To, B),
    Half = (To - From) / 2,
    Spread = ASpread + BSpread,
    Centre = {AX - BX, AY - BY},
    Sides = [
        Side
     || {SX, SY} = Side <- [
            {Half * (AVX - BVX), Half * (AVY - BVY)},
            {AWindow * AVX, AWindow * AVY},
            {BWindow * BVX, BWindow * BVY}
        ],
        abs(SX) + abs(SY) > ?NOTHING_MM
    ],
    {max(0.0, least(Centre, Sides) - Spread), greatest(Centre, Sides) + Spread}.

%% The middle of the piece, the velocity (mm/us), the radius, half the window.
course(From, To, {Track, {Lo, Hi}}) ->
    {First, Last} = starl_debug_track:extent(Track),
    Begin = max(First, From + Lo),
    End = min(Last, To + Hi),
    {{X0, Y0}, {X1, Y1}, Radius} = starl_debug_track:span(Track, min(Begin, Last), max(End, First)),
    Us = max(1, End - Begin),
    {VX, VY} = Velocity = {(X1 - X0) / Us, (Y1 - Y0) / Us},
    %% the clock may be past an end of its recording for a part of the window
    Off = ((From + Lo + To + Hi) - (Begin + End)) / 2,
    {{(X0 + X1) / 2 + Off * VX, (Y0 + Y1) / 2 + Off * VY}, Velocity, Radius, (Hi - Lo) / 2}.

%% In the direction of a unit vector the polygon reaches from its centre as far as the sum of its
%% sides' parts. The least distance is attained in the direction of the centre or across a side.
least({X, Y} = Centre, Sides) ->
    Across = [unit({-SY, SX}) || {SX, SY} <- Sides],
    Directions = [unit(Centre) || abs(X) + abs(Y) > ?NOTHING_MM] ++ Across,
    lists:max([0.0 | [beyond(Direction, Centre, Sides) || Direction <- Directions]]).

beyond({DX, DY}, {X, Y}, Sides) ->
    abs(X * DX + Y * DY) - lists:sum([abs(SX * DX + SY * DY) || {SX, SY} <- Sides]).

unit({X, Y}) ->
    Length = math:sqrt(X * X + Y * Y),
    {X / Length, Y / Length}.

%% A convex function is greatest at a corner.
greatest(Centre, Sides) ->
    math:sqrt(lists:max([X * X + Y * Y || {X, Y} <- corners(Centre, Sides)])).

corners(Corner, []) ->
    [Corner];
corners({X, Y}, [{SX, SY} | Sides]) ->
    corners({X + SX, Y + SY}, Sides) ++ corners({X - SX, Y - SY}, Sides).
