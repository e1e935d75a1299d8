%% @doc Lists the conditions that a kind of fault may break ({@link starl_guarantee}). While such a
%% fault can occur, a team cannot rely on them.
-module(starl_run_condition).

-export([broken/1, breakers/2]).

%% @doc The conditions that a kind of fault may break, whatever its parameters.
-spec broken(starl_run_fault:kind()) -> [starl_guarantee:condition()].
broken(Kind) -> starl_run_fault_kinds:broken(Kind).

%% @doc Those of the kinds that break a condition.
-spec breakers(starl_guarantee:condition(), [starl_run_fault:kind()]) -> [starl_run_fault:kind()].
breakers(Condition, Kinds) -> [Kind || Kind <- Kinds, lists:member(Condition, broken(Kind))].
