%% @doc The default rule of path planning: the most ink per time. The time covers the drive to the
%% line, the drawing, the turns and the request. A line that is begun in its middle counts less.
-module(starl_dpp_rule_ink).
-behaviour(starl_dpp_rule).

-export([score/2, farthest/3]).

-spec score(starl_dpp_rule:work(), starl_dpp_rule:settings()) -> float().
score(#{ink_mm := Ink, spent_mm := Spent, way_mm := Way, middle := Middle}, Settings) ->
    #{overhead_mm := Overhead} = Settings,
    factor(Middle, Settings) * Ink / (Way + Spent + Overhead).

factor(true, #{middle := Weight}) -> Weight;
factor(false, _Settings) -> 1.0.

%% A hair beyond where the bound meets the score, for rounding.
-spec farthest(number(), number(), starl_dpp_rule:settings()) -> float().
farthest(Score, Ink, #{overhead_mm := Overhead}) when Score > 0 ->
    (Ink / Score - Ink - Overhead) * (1.0 + 1.0e-9) + 1.0e-3;
farthest(_Score, _Ink, _Settings) ->
    1.0e300.
