%% @doc The consistency that an election by ballots promises its callers: all robots that elect in
%% one election elect the same robot of the team. Nothing is promised for calls that have failed, or
%% whose outcome is unknown.
-module(starl_election_history).
-behaviour(starl_history_model).

-export([machine/0, contract/0, objects/2, judge/3]).

-spec machine() -> starl_machine:name().
machine() -> election.

-spec contract() -> module().
contract() -> starl_election_monitor.

-spec objects([starl_history:call()], map()) -> [{term(), [starl_history:call()]}].
objects(Calls, _Config) ->
    Of = [{Name, Call} || #{request := {elect, Name, _}} = Call <- Calls],
    Groups = maps:groups_from_list(fun({Name, _}) -> Name end, fun({_, Call}) -> Call end, Of),
    lists:sort(maps:to_list(Groups)).

-spec judge([starl_history:call()], map(), starl_history_model:judge()) ->
    starl_history_model:judgement().
judge(Calls, Config, _Judge) ->
    Leaders = lists:usort([Leader || #{answer := {ok, {ok, Leader}}} <- Calls]),
    Robots = maps:get(robots, Config, Leaders),
    case Leaders -- Robots of
        [] when length(Leaders) =< 1 -> {explained, "agreed"};
        [] -> {unexplained, "agreed"};
        [_ | _] -> {unexplained, "won by a robot of the team"}
    end.
