%% @doc What the sessions of a register say of the order of its writes, without a search.
%%
%% A session meets writes one after the other: those that it makes, and those that its reads come from. So
%% one is before the next in any order that explains it. A read of a value that was written more than once
%% has several writes that it may come from; those that would close a circle are left out, until nothing
%% changes. If each read has one left, the order is found, or there is none: then no search is needed.
-module(starl_history_write_order).

-export([narrowed/1]).

-export_type([session/0, call/0]).

%% Writes have numbers from 1; 0 stands before all.
-type session() :: [call()].
-type call() ::
    {write, Write :: pos_integer(), {Writer :: term(), pos_integer()} | none}
    | {maybe_write, Write :: pos_integer()}
    | {read, From :: [Write :: non_neg_integer()]}.

%% All that come after a write, as a set of bits.
-type later() :: #{Write :: non_neg_integer() => Bits :: non_neg_integer()}.

%% @doc The sessions with what is left for each read; `explained' or `unexplained' if that is all.
-spec narrowed([session()]) -> explained | unexplained | {narrowed, [session()]}.
narrowed(Sessions) ->
    case later(Sessions) of
        circle -> unexplained;
        {ok, Later} -> narrowed(Sessions, [narrow(Session, Later) || Session <- Sessions])
    end.

narrowed(Sessions, Sessions) ->
    Reads = [From || {read, From} <- lists:append(Sessions)],
    case {lists:member([], Reads), lists:all(fun(From) -> length(From) =:= 1 end, Reads)} of
        {true, _} -> unexplained;
        {false, true} -> explained;
        {false, false} -> {narrowed, Sessions}
    end;
narrowed(_Before, Sessions) ->
    narrowed(Sessions).

%% -- the order ------------------------------------------------------------------------------

-spec later([session()]) -> {ok, later()} | circle.
later(Sessions) ->
    All = lists:append(Sessions),
    Own = [{Writer, N, Write} || {write, Write, {Writer, N}} <- All],
    Edges = lists:usort(
        [{0, element(2, Call)} || Call <- All, element(1, Call) =/= read] ++
            chained([{Writer, Write} || {Writer, _, Write} <- lists:sort(Own)]) ++
            lists:append([met(known(Session)) || Session <- Sessions])
    ),
    Next = maps:groups_from_list(fun({A, _}) -> A end, fun({_, B}) -> B end, Edges),
    Writes = lists:usort(lists:append([[A, B] || {A, B} <- Edges])),
    closed(Writes, Next, #{}).

chained([{Writer, A}, {Writer, B} | Own]) -> [{A, B} | chained([{Writer, B} | Own])];
chained([_ | Own]) -> chained(Own);
chained([]) -> [].

%% The writes of a session that are known, in its order, and whether they are made there.
known(Session) ->
    [{Write, element(1, Call) =/= read} || Call <- Session, Write <- of_call(Call)].

of_call({read, [Write]}) -> [Write];
of_call({read, _}) -> [];
of_call(Write) -> [element(2, Write)].

%% A write that its session has read before it has made it is before itself.
met([{A, _}, {A, false} = Read | Writes]) -> met([Read | Writes]);
met([{A, _}, {B, _} = Next | Writes]) -> [{A, B} | met([Next | Writes])];
met(_) -> [].

closed([], _Next, Later) ->
    {ok, maps:filter(fun(_, Bits) -> is_integer(Bits) end, Later)};
closed([Write | Writes], Next, Later) ->
    case reach(Write, Next, Later) of
        circle -> circle;
        More -> closed(Writes, Next, More)
    end.

%% Depth first; `open': the way goes through it now.
reach(Write, Next, Later) ->
    case Later of
        #{Write := open} -> circle;
        #{Write := _} -> Later;
        #{} -> reach_all(maps:get(Write, Next, []), Write, 0, Next, Later#{Write => open})
    end.

reach_all([], Write, Bits, _Next, Later) ->
    Later#{Write := Bits};
reach_all([One | Others], Write, Bits, Next, Later) ->
    case reach(One, Next, Later) of
        circle ->
            circle;
        #{One := Own} = More ->
            reach_all(Others, Write, Bits bor Own bor (1 bsl One), Next, More)
    end.

%% -- reads ----------------------------------------------------------------------------------

%% A read comes from no write that is after the next one that its session meets, or before the last one.
narrow(Session, Later) ->
    Forth = narrow(Session, none, fun(From, Last) -> not is_later(From, Last, Later) end, []),
    narrow(Forth, none, fun(From, Next) -> not is_later(Next, From, Later) end, []).

%% The list comes out turned round: the second time it is read from its end.
narrow([], _Known, _May, Seen) ->
    Seen;
narrow([{read, [_, _ | _] = From} | Session], Known, May, Seen) when Known =/= none ->
    narrow(Session, Known, May, [{read, [Write || Write <- From, May(Write, Known)]} | Seen]);
narrow([Call | Session], Known, May, Seen) ->
    Now =
        case of_call(Call) of
            [Write] -> Write;
            [] -> Known
        end,
    narrow(Session, Now, May, [Call | Seen]).

is_later(A, B, Later) -> maps:get(A, Later, 0) band (1 bsl B) =/= 0.
