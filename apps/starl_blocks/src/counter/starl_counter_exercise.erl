%% @doc The exercise of the counter: each robot reads it every turn, and increments it now and then.
%%
%% It promises that each call is answered; the block's own contract covers agreement.
-module(starl_counter_exercise).
-behaviour(starl_block_exercise).

-export([flags/0, block_options/1, within_ms/1, again_ms/1, draw/1, work/3, final/3, promise/3]).

%% One turn in this many counts.
-define(TURNS, 3).

-spec flags() -> [starl_options:option()].
flags() ->
    [
        {gossip, {integer, 10, 1000000}, 1000,
            "counter: the time between two messages of a robot, ms"}
    ].

-spec block_options(starl_block_exercise:use()) -> starl_block:options().
block_options(#{gossip := Ms}) -> #{gossip_ms => Ms}.

-spec within_ms(starl_block_exercise:use()) -> pos_integer().
within_ms(#{gossip := Ms, team := Robots}) -> starl_counter:within_ms(Ms, Robots).

-spec again_ms(starl_block_exercise:use()) -> pos_integer().
again_ms(#{gossip := Ms, team := Robots}) when is_integer(Ms), is_integer(Robots) ->
    Ms * Robots.

-spec draw(starl_block_exercise:draw()) -> #{atom() => term()}.
draw(Draw) -> #{gossip => Draw(gossip, [200, 1000, 3000])}.

-spec work(starl:robot(), pos_integer(), starl_block_exercise:use()) -> term().
work(Robot, _Turn, _Use) ->
    _ = [increment(Robot) || starl_block_exercise:pick(Robot, ?TURNS) =:= 1],
    value(Robot).

%% In the end there is time until all have to agree.
-spec final(starl:robot(), pos_integer(), starl_block_exercise:use()) -> term().
final(Robot, N, #{final := N, within := Within}) ->
    _ = increment(Robot),
    ok = starl:sleep(Robot, Within * 102 div 100),
    value(Robot);
final(Robot, _N, _Use) ->
    increment(Robot).

increment(Robot) ->
    starl_block_exercise:call(Robot, increment, fun() -> starl_counter:increment(Robot) end).

value(Robot) ->
    starl_block_exercise:call(Robot, value, fun() -> starl_counter:value(Robot) end).

-spec promise(starl_promise:call(), starl_promise:team(), none) -> starl_promise:t().
promise(Call, Team, none) -> starl_promise:soon(Call, fun starl_promise:is_answer/1, Team).
