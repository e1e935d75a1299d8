%% @doc The consistency that the counter promises its callers. It is neither linearizable nor
%% sequentially consistent: two robots that increment at once may both get the answer 1. An answer
%% is at least the number of increments that this life of the robot's machine has answered. It is at
%% most the number of all increments made until the answer. In one life of a machine the answers
%% never go back.
-module(starl_counter_history).
-behaviour(starl_history_model).

-export([machine/0, contract/0, objects/2, judge/3]).

-spec machine() -> starl_machine:name().
machine() -> counter.

-spec contract() -> module().
contract() -> starl_counter_monitor.

%% @doc There is one counter.
-spec objects([starl_history:call()], map()) -> [{term(), [starl_history:call()]}].
objects([], _Config) -> [];
objects(Calls, _Config) -> [{value, Calls}].

-spec judge([starl_history:call()], map(), starl_history_model:judge()) ->
    starl_history_model:judgement().
judge(Calls, _Config, _Judge) ->
    Made = list_to_tuple(lists:sort([At || #{request := increment, invoked_us := At} <- Calls])),
    Lives = maps:groups_from_list(fun(#{robot := Robot, life := Life}) -> {Robot, Life} end, Calls),
    case lists:all(fun(Own) -> is_right(Own, 0, 0, Made) end, maps:values(Lives)) of
        true -> {explained, "bounded, and never goes back"};
        false -> {unexplained, "within its bounds, or goes back"}
    end.

%% A robot makes one call after the other: the number of increments of this life that have been
%% answered, and the last value.
is_right([], _Own, _Last, _Made) ->
    true;
is_right([#{answer := {ok, Value}, returned_us := At} = Call | Calls], Own, Last, Made) ->
    Least =
        case Call of
            #{request := increment} -> Own + 1;
            #{request := value} -> Own
        end,
    max(Least, Last) =< Value andalso Value =< made(At, Made, 0, tuple_size(Made)) andalso
        is_right(Calls, Least, Value, Made);
is_right([_Unknown | Calls], Own, Last, Made) ->
    is_right(Calls, Own, Last, Made).

%% The number of increments that were invoked until then.
made(_At, _Made, Least, Most) when Least =:= Most -> Least;
made(At, Made, Least, Most) ->
    Middle = (Least + Most + 1) div 2,
    case element(Middle, Made) =< At of
        true -> made(At, Made, Middle, Most);
        false -> made(At, Made, Least, Middle - 1)
    end.
