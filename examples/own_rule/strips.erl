%% A rule of path planning: each robot works in its own strip of the floor as long as lines are left
%% there, and only then helps the others. So robots seldom get in each other's way.
-module(strips).
-behaviour(starl_dpp_rule).
-export([score/2]).

-define(STRIP_MM, 3000).
-define(STRIPS, 4).
-define(AWAY, 10).

%% The ink for each millimetre driven; abroad it counts a tenth.
score(Work, #{overhead_mm := Overhead}) ->
    #{robot := Robot, begins := Begins, ink_mm := Ink, spent_mm := Spent, way_mm := Way} = Work,
    Worth = Ink / (Way + Spent + Overhead),
    case strip(Begins) =:= Robot rem ?STRIPS of
        true -> Worth;
        false -> Worth / ?AWAY
    end.

strip({X, _Y}) -> min(?STRIPS - 1, trunc(X / ?STRIP_MM)).
