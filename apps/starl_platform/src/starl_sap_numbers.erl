%% @doc Sets of sequence numbers, one under each key, as disjoint intervals: numbers that come
%% nearly in order cost next to nothing. Pure; a part of {@link starl_sap_monitor}.
-module(starl_sap_numbers).

-export([new/0, add/3, put/3, remove/3, is_member/3]).

-export_type([t/0]).

%% Closed intervals, highest first.
-type intervals() :: [{Low :: integer(), High :: integer()}].

-opaque t() :: #{Key :: term() => intervals()}.

%% @doc No numbers.
-spec new() -> t().
new() -> #{}.

%% @doc One number more under a key, unless it is there already.
-spec add(Key :: term(), integer(), t()) -> {ok, t()} | member.
add(Key, N, Sets) ->
    case insert(N, maps:get(Key, Sets, [])) of
        member -> member;
        Set -> {ok, Sets#{Key => Set}}
    end.

%% @doc The same; it may be there already.
-spec put(Key :: term(), integer(), t()) -> t().
put(Key, N, Sets) ->
    case add(Key, N, Sets) of
        {ok, More} -> More;
        member -> Sets
    end.

%% @doc One number less under a key, if it is there.
-spec remove(Key :: term(), integer(), t()) -> {ok, t()} | absent.
remove(Key, N, Sets) ->
    case delete(N, maps:get(Key, Sets, [])) of
        absent -> absent;
        [] -> {ok, maps:remove(Key, Sets)};
        Set -> {ok, Sets#{Key => Set}}
    end.

%% @doc Is the number there?
-spec is_member(Key :: term(), integer(), t()) -> boolean().
is_member(Key, N, Sets) -> member(N, maps:get(Key, Sets, [])).

insert(N, []) -> [{N, N}];
insert(N, [{Low, High} | Rest]) when N =:= High + 1 -> [{Low, N} | Rest];
insert(N, [{_, High} | _] = Set) when N > High -> [{N, N} | Set];
insert(N, [{Low, _} | _]) when N >= Low -> member;
insert(N, [Interval | Rest]) ->
    case insert(N, Rest) of
        member -> member;
        Inserted -> join(Interval, Inserted)
    end.

join({Low, High}, [{Low2, High2} | Rest]) when High2 + 1 =:= Low -> [{Low2, High} | Rest];
join(Interval, Rest) -> [Interval | Rest].

member(_N, []) -> false;
member(N, [{_, High} | _]) when N > High -> false;
member(N, [{Low, _} | _]) when N >= Low -> true;
member(N, [_ | Rest]) -> member(N, Rest).

delete(_N, []) -> absent;
delete(N, [{_, High} | _]) when N > High -> absent;
delete(N, [{Low, High} | Rest]) when N >= Low ->
    [{N + 1, High} || N < High] ++ [{Low, N - 1} || N > Low] ++ Rest;
delete(N, [Interval | Rest]) ->
    case delete(N, Rest) of
        absent -> absent;
        Left -> [Interval | Left]
    end.
