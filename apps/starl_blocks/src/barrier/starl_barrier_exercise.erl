%% @doc The exercise of the barrier: all robots pass round after round, each at its own pace.
%%
%% It promises that a round is passed if all robots have reached it and no robot has died.
-module(starl_barrier_exercise).
-behaviour(starl_block_exercise).

-export([flags/0, block_options/1, within_ms/1, again_ms/1, draw/1, work/3, final/3]).
-export([watches/0, seen/1, noted/2, promise/3]).

%% The round that a robot has come to, and the time.
-type seen() :: #{Name :: term() => #{starl:robot_id() => {pos_integer(), integer()}}}.

-define(WITHIN_MS, 20000).

-spec flags() -> [starl_options:option()].
flags() ->
    [
        {retry, {integer, 10, 1000000}, 3000,
            "mutex, barrier: the time after which a waiting robot asks again, ms"}
    ].

-spec block_options(starl_block_exercise:use()) -> starl_block:options().
block_options(#{retry := Retry}) -> #{retry_ms => Retry}.

-spec within_ms(starl_block_exercise:use()) -> pos_integer().
within_ms(#{retry := Retry}) -> ?WITHIN_MS + round(2 * Retry).

-spec again_ms(starl_block_exercise:use()) -> pos_integer().
again_ms(#{retry := Retry}) -> Retry.

-spec draw(starl_block_exercise:draw()) -> #{atom() => term()}.
draw(Draw) -> #{retry => Draw(retry, [500, 1000, 3000])}.

-spec work(starl:robot(), pos_integer(), starl_block_exercise:use()) -> term().
work(Robot, _Turn, #{patience := Patience}) -> sync(Robot, round, Patience).

-spec final(starl:robot(), pos_integer(), starl_block_exercise:use()) -> term().
final(Robot, _N, #{last_patience := Ms}) ->
    starl_block_exercise:again(fun() -> sync(Robot, final, Ms) end).

sync(Robot, Name, Ms) ->
    Sync = fun() -> starl_barrier:sync(Robot, Name, Ms) end,
    starl_block_exercise:call(Robot, {sync, Name}, Ms, Sync).

-spec watches() -> [starl_machine:name()].
watches() -> [barrier].

-spec seen([starl:robot_id()]) -> seen().
seen(_Robots) -> #{}.

-spec noted(starl_monitor:trace_event(), seen()) -> seen().
noted({T, Robot, barrier, {reached, Name, K}}, Reached) ->
    Of = maps:get(Name, Reached, #{}),
    Reached#{Name => Of#{Robot => {K, T}}};
noted(_Event, Reached) ->
    Reached.

-spec promise(starl_promise:call(), starl_promise:team(), seen()) -> starl_promise:t().
promise(#{what := {sync, Name}, robot := Robot} = Call, Team, Reached) ->
    Of = maps:get(Name, Reached, #{}),
    {Round, _} = maps:get(Robot, Of, {0, 0}),
    Times = [T || {K, T} <- maps:values(Of), Round > 0, K >= Round],
    starl_promise:when_all(Times, Call, fun starl_promise:is_ok/1, Team);
promise(_Call, _Team, _Reached) ->
    none.
