%% @doc A pairing heap: a priority queue with cheap insertion. The order of equal keys depends only
%% on the order of the operations.
-module(starl_dpp_heap).

-export([new/0, push/3, pop/1]).
-export_type([t/2]).

-type node_(Key, Value) :: {Key, Value, [node_(Key, Value)]}.
-opaque t(Key, Value) :: empty | node_(Key, Value).

%% @doc The empty heap.
-spec new() -> t(any(), any()).
new() -> empty.

%% @doc Enters a value.
-spec push(Key, Value, t(Key, Value)) -> t(Key, Value).
push(Key, Value, Heap) -> meld({Key, Value, []}, Heap).

%% @doc Takes out a value with the least key.
-spec pop(t(Key, Value)) -> empty | {Key, Value, t(Key, Value)}.
pop(empty) -> empty;
pop({Key, Value, Children}) -> {Key, Value, pair(Children)}.

meld(Heap, empty) -> Heap;
meld(empty, Heap) -> Heap;
meld({K1, V1, C1}, {K2, _, _} = H2) when K1 =< K2 -> {K1, V1, [H2 | C1]};
meld(H1, {K2, V2, C2}) -> {K2, V2, [H1 | C2]}.

pair([]) -> empty;
pair([Heap]) -> Heap;
pair([H1, H2 | Rest]) -> meld(meld(H1, H2), pair(Rest)).
