%% @doc The consistency that registers promise their callers. They are not linearizable: a write is
%% visible at once at its writer, and later elsewhere. But of two writes the later wins, the same at
%% all robots. So each register by itself is sequentially consistent.
%%
%% There is one order of all writes and reads in which each read returns the write before it. This
%% order keeps the order of the calls to one life of a robot's machine. It also keeps the order of a
%% robot's writes in all its lives, until its store is lost or set back. No read returns a value
%% that was written after it. That all robots agree in the end is progress, which a history does not
%% show.
-module(starl_registers_history).
-behaviour(starl_history_model).

-export([machine/0, contract/0, objects/2, judge/3]).

%% No application's value: it is wrapped.
-define(UNSET, unset).

-spec machine() -> starl_machine:name().
machine() -> registers.

-spec contract() -> module().
contract() -> starl_registers_monitor.

-spec objects([starl_history:call()], map()) -> [{term(), [starl_history:call()]}].
objects(Calls, _Config) ->
    Of = [{element(2, Request), Call} || #{request := Request} = Call <- Calls, is_access(Request)],
    Groups = maps:groups_from_list(fun({Name, _}) -> Name end, fun({_, Call}) -> Call end, Of),
    lists:sort(maps:to_list(Groups)).

is_access({put, _, _}) -> true;
is_access({get, _}) -> true;
is_access(_) -> false.

-spec judge([starl_history:call()], map(), starl_history_model:judge()) ->
    starl_history_model:judgement().
judge(Calls, Config, #{states := Most, marks := Marks}) ->
    case [Call || Call <- Calls, is_foreign(Call, maps:get(owners, Config, #{}))] of
        [] ->
            Sessions = sessions(Calls, Marks),
            said(starl_history_search:sequential(Sessions, ?UNSET, Most));
        [_ | _] ->
            {unexplained, "kept for its owner"}
    end.

said(explained) -> {explained, "sequentially consistent"};
said(unexplained) -> {unexplained, "sequentially consistent"};
said(undecided) -> undecided.

is_foreign(#{request := {put, Name, _}, robot := Robot, answer := {ok, ok}}, Owners) ->
    maps:get(Name, Owners, Robot) =/= Robot;
is_foreign(_Call, _Owners) ->
    false.

%% A write of unknown outcome is a session of its own: it may come about after later calls.
sessions(Calls, Marks) ->
    {Known, Unknown, _} = lists:foldl(
        fun(Call, Seen) -> call(Call, Marks, Seen) end, {#{}, [], #{}}, Calls
    ),
    [lists:reverse(Session) || {_, Session} <- lists:sort(maps:to_list(Known))] ++ Unknown.

call(#{request := {put, _, Value}, answer := unknown} = Call, _Marks, {Known, Unknown, Counts}) ->
    #{invoked_us := Invoked} = Call,
    {Known, [[{maybe_write, {value, Value}, Invoked}] | Unknown], Counts};
call(#{request := {put, _, Value}, answer := {ok, ok}} = Call, Marks, {Known, Unknown, Counts}) ->
    #{robot := Robot, invoked_us := Invoked} = Call,
    Writer = {Robot, length([At || {At, R, store} <- Marks, R =:= Robot, At =< Invoked])},
    N = maps:get(Writer, Counts, 0) + 1,
    Write = {write, {value, Value}, Invoked, {Writer, N}},
    {added(Call, Write, Known), Unknown, Counts#{Writer => N}};
call(#{request := {get, _}, answer := {ok, {ok, Value}}} = Call, _Marks, {Known, Unknown, Counts}) ->
    {added(Call, {read, {value, Value}, maps:get(returned_us, Call)}, Known), Unknown, Counts};
call(
    #{request := {get, _}, answer := {ok, {error, unset}}} = Call, _Marks, {Known, Unknown, Counts}
) ->
    {added(Call, {read, ?UNSET, maps:get(returned_us, Call)}, Known), Unknown, Counts};
call(_Refused, _Marks, Seen) ->
    Seen.

added(#{robot := Robot, life := Life}, Call, Sessions) ->
    maps:update_with({Robot, Life}, fun(Session) -> [Call | Session] end, [Call], Sessions).
