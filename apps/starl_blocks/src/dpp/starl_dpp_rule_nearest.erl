%% @doc The rule of the paper: the nearest free line wins, whatever its length. Turns count as
%% distance.
-module(starl_dpp_rule_nearest).
-behaviour(starl_dpp_rule).

-export([score/2, farthest/3]).

-spec score(starl_dpp_rule:work(), starl_dpp_rule:settings()) -> float().
score(#{ink_mm := Ink, spent_mm := Spent, way_mm := Way}, _Settings) -> float(Ink - Spent - Way).

%% A hair farther, for rounding.
-spec farthest(number(), number(), starl_dpp_rule:settings()) -> float().
farthest(Score, _Ink, _Settings) -> -Score + 1.0e-3.
