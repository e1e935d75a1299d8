%% @doc Stateless random draws: a hash of the seed and the purpose of the draw.
-module(starl_run_draw).

-export([uniform/1, signed/1, between/3]).

-define(RANGE, 134217728).

%% @doc A number in `0.0 =< X < 1.0'.
-spec uniform(Key :: term()) -> float().
uniform(Key) -> erlang:phash2(Key, ?RANGE) / ?RANGE.

%% @doc A number in `-1.0 =< X < 1.0'.
-spec signed(Key :: term()) -> float().
signed(Key) -> 2.0 * uniform(Key) - 1.0.

%% @doc A whole number in `Min =< X =< Max'.
-spec between(Key :: term(), Min :: integer(), Max :: integer()) -> integer().
between(_Key, Same, Same) -> Same;
between(Key, Min, Max) -> Min + erlang:phash2(Key, Max - Min + 1).
