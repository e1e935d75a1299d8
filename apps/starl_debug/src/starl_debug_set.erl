%% @doc Sets of times: sorted, disjoint intervals of whole microseconds, both ends included.
%%
%% A <em>three-valued</em> set is a pair: the times at which something may be true, and those at
%% which it must be. The second is part of the first. What is known exactly has both alike.
-module(starl_debug_set).

-export([new/1, union/1, union/2, intersect/1, intersect/2, complement/2]).
-export([dilate/3, erode/3, held/2, once/2, at_least/2, middle/1]).
-export([exactly/1, nothing/0, negate/2]).

-export_type([t/0, interval/0, three/0]).

-type interval() :: {FromUs :: integer(), ToUs :: integer()}.
-type t() :: [interval()].
%% What may be, and what must be.
-type three() :: {May :: t(), Must :: t()}.

%% @doc The set of these intervals; those that are empty count for nothing.
-spec new([interval()]) -> t().
new(Intervals) -> merged(lists:sort([I || {A, B} = I <- Intervals, A =< B])).

%% Intervals that touch are one.
merged([{A, B}, {C, D} | Rest]) when C =< B + 1 -> merged([{A, max(B, D)} | Rest]);
merged([First | Rest]) -> [First | merged(Rest)];
merged([]) -> [].

%% @doc All times of both.
-spec union(t(), t()) -> t().
union(Set, []) -> Set;
union([], Set) -> Set;
union(One, Other) -> merged(lists:merge(One, Other)).

%% @doc All times of all.
-spec union([t()]) -> t().
union(Sets) -> merged(lists:sort(lists:append(Sets))).

%% @doc The times of both.
-spec intersect(t(), t()) -> t().
intersect([{_, B} | One], [{C, _} | _] = Other) when B < C -> intersect(One, Other);
intersect([{A, _} | _] = One, [{_, D} | Other]) when D < A -> intersect(One, Other);
intersect([{A, B} | One], [{C, D} | _] = Other) when B =< D ->
    [{max(A, C), B} | intersect(One, Other)];
intersect([{A, _} | _] = One, [{C, D} | Other]) ->
    [{max(A, C), D} | intersect(One, Other)];
intersect(_, _) ->
    [].

%% @doc The times of all.
-spec intersect([t(), ...]) -> t().
intersect([First | Sets]) -> lists:foldl(fun intersect/2, First, Sets).

%% @doc The times of `Domain' that are not in a set.
-spec complement(t(), Domain :: t()) -> t().
complement(Set, Domain) ->
    intersect(gaps(Set, minus_infinity(Domain), plus_infinity(Domain)), Domain).

minus_infinity([]) -> 0;
minus_infinity([{A, _} | _]) -> A.

plus_infinity([]) -> -1;
plus_infinity(Domain) -> element(2, lists:last(Domain)).

gaps(_Set, From, To) when From > To -> [];
gaps([], From, To) -> [{From, To}];
gaps([{A, B} | Set], From, To) when A =< From -> gaps(Set, max(From, B + 1), To);
gaps([{A, B} | Set], From, To) -> [{From, min(To, A - 1)} | gaps(Set, B + 1, To)].

%% @doc The times T for which T + o is in the set for <em>some</em> o of a window.
-spec dilate(t(), LoUs :: integer(), HiUs :: integer()) -> t().
dilate(Set, 0, 0) -> Set;
dilate(Set, Lo, Hi) -> merged([{A - Hi, B - Lo} || {A, B} <- Set]).

%% @doc The times T for which T + o is in the set for <em>every</em> o of a window.
-spec erode(t(), LoUs :: integer(), HiUs :: integer()) -> t().
erode(Set, 0, 0) -> Set;
erode(Set, Lo, Hi) -> [{A - Lo, B - Hi} || {A, B} <- Set, A - Lo =< B - Hi].

%% @doc The times at which the set has lasted for a duration.
-spec held(t(), Us :: non_neg_integer()) -> t().
held(Set, Us) -> [{A + Us, B} || {A, B} <- Set, A + Us =< B].

%% @doc The times that are at most a duration after one of the set.
-spec once(t(), Us :: non_neg_integer()) -> t().
once(Set, Us) -> dilate(Set, -Us, 0).

%% @doc The times that are in at least `K' of the sets.
-spec at_least(K :: integer(), [t()]) -> t().
at_least(K, Sets) ->
    Steps = [[{A, 1}, {B + 1, -1}] || Set <- Sets, {A, B} <- Set],
    merged(high(lists:sort(lists:append(Steps)), 0, K, none)).

%% An end sorts before a beginning of the same time: it is the first time that is not in its set.
high([], _N, _K, _Since) ->
    [];
high([{At, Step} | Steps], N, K, none) when N + Step >= K -> high(Steps, N + Step, K, At);
high([{At, Step} | Steps], N, K, Since) when Since =/= none, N + Step < K ->
    [{Since, At - 1} || Since < At] ++ high(Steps, N + Step, K, none);
high([{_, Step} | Steps], N, K, Since) ->
    high(Steps, N + Step, K, Since).

%% @doc The middle of its longest interval.
-spec middle([interval(), ...]) -> integer().
middle(Set) ->
    {_, A, B} = lists:max([{B - A, A, B} || {A, B} <- Set]),
    (A + B) div 2.

%% @doc What is known exactly.
-spec exactly(t()) -> three().
exactly(Set) -> {Set, Set}.

%% @doc What is never true.
-spec nothing() -> three().
nothing() -> {[], []}.

%% @doc Where the other is false, within a domain.
-spec negate(three(), Domain :: t()) -> three().
negate({May, Must}, Domain) -> {complement(Must, Domain), complement(May, Domain)}.
