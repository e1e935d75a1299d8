%% @doc The exercise of geocast: robots drive around and send messages to various areas.
%%
%% It promises that each call is answered; the block's own contract covers delivery.
-module(starl_geocast_exercise).
-behaviour(starl_block_exercise).

-export([flags/0, block_options/1, work/3, final/3, promise/3]).

%% More than the faults of positions add up to.
-define(POSITION_ERROR_MM, 400.0).
-define(FINAL_LIFETIME_MS, 4000).

-spec flags() -> [starl_options:option()].
flags() ->
    [
        {lifetime, {optional, {integer, 1, 1000000}}, none,
            "geocast: lifetime, ms; none: 200, 1000 or 4000 at random"}
    ].

-spec block_options(starl_block_exercise:use()) -> starl_block:options().
block_options(_Use) ->
    #{
        listeners => #{news => app}, position_error_mm => ?POSITION_ERROR_MM, all_listen => true
    }.

-spec work(starl:robot(), pos_integer(), starl_block_exercise:use()) -> term().
work(Robot, Turn, #{lifetime := Given}) ->
    Area = {circle, place(Robot), 3000.0},
    _ = geocast(Robot, Area, Turn, lifetime(Robot, Given)),
    _ = starl:await(Robot, news, 100),
    starl:go_to(Robot, place(Robot)).

lifetime(Robot, none) -> lists:nth(starl_block_exercise:pick(Robot, 3), [200, 1000, 4000]);
lifetime(_Robot, Ms) -> Ms.

place(Robot) ->
    X = starl_block_exercise:pick(Robot, 10),
    {1000.0 * X, 1000.0 * starl_block_exercise:pick(Robot, 3)}.

-spec final(starl:robot(), pos_integer(), starl_block_exercise:use()) -> term().
final(Robot, N, _Use) ->
    _ = geocast(Robot, {circle, {5000.0, 5000.0}, 50000.0}, {final, N}, ?FINAL_LIFETIME_MS),
    starl:sleep(Robot, ?FINAL_LIFETIME_MS + 500).

geocast(Robot, Area, Body, Lifetime) ->
    starl_block_exercise:call(Robot, {geocast, news}, fun() ->
        starl_geocast:send(Robot, Area, news, Body, #{lifetime_ms => Lifetime})
    end).

-spec promise(starl_promise:call(), starl_promise:team(), none) -> starl_promise:t().
promise(Call, Team, none) -> starl_promise:soon(Call, fun starl_promise:is_answer/1, Team).
