%% @doc The consistency that the bully election promises its callers: in each life of its machine, a
%% robot reports one leader per election. Two robots may elect different leaders.
-module(starl_bully_history).
-behaviour(starl_history_model).

-export([machine/0, contract/0, objects/2, judge/3]).

-spec machine() -> starl_machine:name().
machine() -> election.

-spec contract() -> module().
contract() -> starl_election_bully_monitor.

%% @doc The calls of each election.
-spec objects([starl_history:call()], map()) -> [{term(), [starl_history:call()]}].
objects(Calls, Config) -> starl_election_history:objects(Calls, Config).

-spec judge([starl_history:call()], map(), starl_history_model:judge()) ->
    starl_history_model:judgement().
judge(Calls, Config, Judge) ->
    Lives = maps:groups_from_list(fun(#{robot := Robot, life := Life}) -> {Robot, Life} end, Calls),
    Of = [starl_election_history:judge(Own, Config, Judge) || Own <- maps:values(Lives)],
    case [Judgement || {unexplained, _} = Judgement <- Of] of
        [] -> {explained, "the same in each life of a robot"};
        [_ | _] -> {unexplained, "the same in each life of a robot"}
    end.
