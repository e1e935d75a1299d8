%% @doc A set of sequence numbers, kept as disjoint intervals. Numbers that arrive nearly in order
%% take almost no memory. Pure; a part of {@link starl_sap_peers} and of {@link starl_sap_monitor}.
-module(starl_sap_numbers).

-export([new/0, add/2, remove/2, is_member/2, is_empty/1, rise/2]).

-export_type([t/0]).

%% Closed intervals, highest first.
-opaque t() :: [{Low :: integer(), High :: integer()}].

%% @doc The empty set.
-spec new() -> t().
new() -> [].

%% @doc Adds a number, unless it is in the set already.
-spec add(integer(), t()) -> t() | member.
add(N, []) ->
    [{N, N}];
add(N, [{Low, High} | Rest]) when N =:= High + 1 -> [{Low, N} | Rest];
add(N, [{_, High} | _] = Set) when N > High -> [{N, N} | Set];
add(N, [{Low, _} | _]) when N >= Low -> member;
add(N, [Interval | Rest]) ->
    case add(N, Rest) of
        member -> member;
        More -> join(Interval, More)
    end.

%% @doc Removes a number, if it is in the set.
-spec remove(integer(), t()) -> t() | absent.
remove(_N, []) ->
    absent;
remove(N, [{_, High} | _]) when N > High -> absent;
remove(N, [{Low, High} | Rest]) when N >= Low ->
    [{N + 1, High} || N < High] ++ [{Low, N - 1} || N > Low] ++ Rest;
remove(N, [Interval | Rest]) ->
    case remove(N, Rest) of
        absent -> absent;
        Left -> [Interval | Left]
    end.

%% @doc Is the number in the set?
-spec is_member(integer(), t()) -> boolean().
is_member(_N, []) -> false;
is_member(N, [{_, High} | _]) when N > High -> false;
is_member(N, [{Low, _} | _]) when N >= Low -> true;
is_member(N, [_ | Rest]) -> is_member(N, Rest).

%% @doc Is the set empty?
-spec is_empty(t()) -> boolean().
is_empty(Set) -> Set =:= [].

%% @doc The lowest number from a floor on that is not in the set, and the numbers above it.
-spec rise(Floor :: integer(), t()) -> {Floor :: integer(), t()}.
rise(Floor, []) ->
    {Floor, []};
rise(Floor, [{_, High} | _]) when High < Floor -> {Floor, []};
rise(Floor, [{Low, High} | _]) when Low =< Floor -> {High + 1, []};
rise(Floor, [Interval | Rest]) ->
    {Risen, Left} = rise(Floor, Rest),
    {Risen, [Interval | Left]}.

join({Low, High}, [{Low2, High2} | Rest]) when High2 + 1 =:= Low -> [{Low2, High} | Rest];
join(Interval, Rest) -> [Interval | Rest].
