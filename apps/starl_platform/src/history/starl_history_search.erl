%% @doc Searches for an order of calls that explains their answers, by the algorithm of Wing and
%% Gong. A cache prunes the search (Lowe, "Testing for linearizability", 2017; Porcupine): if two
%% orders lead to the same set of calls and the same state, only the first is followed.
%%
%% {@link linearizable/4} searches for an order that keeps real time: a call that has returned
%% before another was invoked comes first. {@link sequential/3} searches for an order of a
%% register's calls that keeps the order of each session, and in which no read returns a write that
%% was invoked after the read had returned.
%%
%% Both end after a number of states, not of seconds, so the answer is the same on every computer.
-module(starl_history_search).

-export([linearizable/4, sequential/3]).

-export_type([timed/0, step/0, session/0, session_call/0, answer/0]).

%% A call from its invocation to its return, µs. `infinity': its outcome is unknown; it takes effect at any
%% later time, or never.
-type timed() :: {InvokedUs :: integer(), ReturnedUs :: integer() | infinity, Input :: term()}.

%% What a call makes of a state, if it may have its answer there.
-type step() :: fun((Input :: term(), State :: term()) -> {ok, Next :: term()} | no).

%% The calls of a session, in their order.
-type session() :: [session_call()].

%% `maybe_write': one whose outcome is unknown; it is a session of its own. The writes of a writer take effect in the order of their
%% numbers, which count from 1 without a gap, whatever their sessions; `none': one that is in no such order.
-type session_call() ::
    {write, Value :: term(), InvokedUs :: integer(), {Writer :: term(), N :: pos_integer()} | none}
    | {maybe_write, Value :: term(), InvokedUs :: integer()}
    | {read, Value :: term(), ReturnedUs :: integer()}.

%% `undecided': so many states were not enough.
-type answer() :: explained | unexplained | undecided.

%% Writes have numbers from 1; 0 stands before all.
-type sequence() :: [call()].
-type call() ::
    {write, Write :: pos_integer(), {Writer :: term(), pos_integer()} | none}
    | {maybe_write, Write :: pos_integer()}
    | {read, From :: [Write :: non_neg_integer()]}.

%% All that come after a write, as a set of bits.
-type later() :: #{Write :: non_neg_integer() => Bits :: non_neg_integer()}.

%% @doc Is there an order of these calls that keeps real time, in which each may have its answer?
-spec linearizable([timed()], State :: term(), step(), MostStates :: pos_integer()) -> answer().
linearizable(Calls, State, Step, Most) ->
    Numbered = lists:enumerate(lists:sort(Calls)),
    Moves = fun(Node) -> moves(Node, Step) end,
    explore([{[], Numbered, State}], Moves, fun place/1, fun is_done/1, #{}, Most).

%% Those of the open calls are still to be placed; the others have not been invoked before the first of
%% these returns.
place({Open, [], State}) -> {[N || {N, _} <- Open], none, State};
place({Open, [{Next, _} | _], State}) -> {[N || {N, _} <- Open], Next, State}.

is_done({Open, Rest, _State}) -> are_unknown(Rest) andalso are_unknown(Open).

are_unknown(Calls) -> lists:all(fun({_, {_, End, _}}) -> End =:= infinity end, Calls).

moves({Before, After, State}, Step) ->
    {Open, Rest} = admitted(Before, After, first_return(Before)),
    [
        {lists:delete(Call, Open), Rest, Next}
     || {_, {_, _, Input}} = Call <- Open, {ok, Next} <- [Step(Input, State)]
    ].

first_return(Open) -> lists:min([infinity | [End || {_, {_, End, _}} <- Open]]).

admitted(Open, [{_, {Invoked, End, _}} = Call | Rest], First) when Invoked =< First ->
    admitted(Open ++ [Call], Rest, min(End, First));
admitted(Open, Rest, _First) ->
    {Open, Rest}.

explore([], _Moves, _Key, _Done, _Seen, _Most) ->
    unexplained;
explore(_Nodes, _Moves, _Key, _Done, Seen, Most) when map_size(Seen) >= Most ->
    undecided;
explore([Node | Nodes], Moves, Key, Done, Seen, Most) ->
    At = Key(Node),
    case is_map_key(At, Seen) of
        true ->
            explore(Nodes, Moves, Key, Done, Seen, Most);
        false ->
            case Done(Node) of
                true -> explained;
                false -> explore(Moves(Node) ++ Nodes, Moves, Key, Done, Seen#{At => []}, Most)
            end
    end.

%% -- sessions -------------------------------------------------------------------------------

%% What is left of the sessions, each with the number of its calls; the number of the write that stands; for
%% each write the reads that are left and can come from no other; the number of each writer's next write.
%% Writes count from 1; before all stands 0.
-record(register, {
    sessions :: [{Length :: non_neg_integer(), sequence()}],
    value = 0 :: non_neg_integer(),
    needed :: #{Write :: non_neg_integer() => pos_integer()},
    next = #{} :: #{Writer :: term() => pos_integer()}
}).

%% @doc Is there an order of these calls that keeps that of each session, in which each read returns the
%% value of the write before it, `unset' before all writes, and none that was invoked after its return?
-spec sequential([session()], Unset :: term(), MostStates :: pos_integer()) -> answer().
sequential(Sessions, Unset, Most) ->
    {Placed, Writes} = placed(Sessions, #{Unset => [{0, -1 bsl 80}]}),
    Sources = [[sources(Call, Writes) || Call <- Session] || Session <- Placed],
    case narrowed(Sources) of
        {narrowed, Left} -> ordered(Left, Most);
        Answer -> Answer
    end.

ordered(Sessions, Most) ->
    Start = #register{
        sessions = [{length(Session), Session} || Session <- Sessions],
        needed = counted([Write || {read, [Write]} <- lists:append(Sessions)])
    },
    explore([read(Start)], fun written/1, fun place_of/1, fun is_over/1, #{}, Most).

%% The writes get numbers in the order of their invocations, and stand by their values.
placed(Sessions, Known) ->
    Of = [
        {element(3, Call), Session, Place}
     || {Session, Calls} <- lists:enumerate(Sessions),
        {Place, Call} <- lists:enumerate(Calls),
        element(1, Call) =/= read
    ],
    Numbers = maps:from_list([{{S, P}, N} || {N, {_, S, P}} <- lists:enumerate(lists:sort(Of))]),
    lists:mapfoldl(
        fun({S, Calls}, Writes) ->
            lists:mapfoldl(
                fun({P, Call}, Before) -> numbered(Call, maps:get({S, P}, Numbers, 0), Before) end,
                Writes,
                lists:enumerate(Calls)
            )
        end,
        Known,
        lists:enumerate(Sessions)
    ).

numbered({read, _, _} = Read, _N, Writes) ->
    {Read, Writes};
numbered({write, Value, Invoked, In}, N, Writes) ->
    {{write, N, In}, added(Value, {N, Invoked}, Writes)};
numbered({maybe_write, Value, Invoked}, N, Writes) ->
    {{maybe_write, N}, added(Value, {N, Invoked}, Writes)}.

added(Value, Write, Writes) -> Writes#{Value => [Write | maps:get(Value, Writes, [])]}.

sources({read, Value, Returned}, Writes) ->
    {read, [N || {N, Invoked} <- maps:get(Value, Writes, []), Invoked =< Returned]};
sources(Write, _Writes) ->
    Write.

counted(Writes) ->
    lists:foldl(fun(W, Counts) -> Counts#{W => maps:get(W, Counts, 0) + 1} end, #{}, Writes).

place_of(#register{sessions = Sessions, value = Value}) -> {[N || {N, _} <- Sessions], Value}.

is_over(#register{sessions = Sessions}) ->
    lists:all(fun({_, Session}) -> lists:all(fun is_maybe/1, Session) end, Sessions).

is_maybe({maybe_write, _}) -> true;
is_maybe(_) -> false.

%% A read that may return what stands is placed at once: it changes nothing.
read(#register{sessions = Sessions, value = Value, needed = Needed} = Register) ->
    {Left, Now} = lists:mapfoldl(fun(S, Ns) -> read(S, Value, Ns) end, Needed, Sessions),
    Register#register{sessions = Left, needed = Now}.

read({N, [{read, [Value]} | Session]}, Value, Needed) ->
    read({N - 1, Session}, Value, less(Value, Needed));
read({N, [{read, From} | Session]} = All, Value, Needed) ->
    case lists:member(Value, From) of
        true -> read({N - 1, Session}, Value, Needed);
        false -> {All, Needed}
    end;
read(Session, _Value, Needed) ->
    {Session, Needed}.

less(Write, Counts) ->
    case Counts of
        #{Write := 1} -> maps:remove(Write, Counts);
        #{Write := N} -> Counts#{Write := N - 1}
    end.

%% What is still to be read is not written over.
written(#register{value = Value, needed = Needed}) when is_map_key(Value, Needed) ->
    [];
%% An earlier write is tried first: clocks are seldom far apart.
written(#register{sessions = Sessions} = Register) ->
    Next = [
        {element(2, Call), Place, N - 1, Call, Session}
     || {Place, {N, [Call | Session]}} <- lists:enumerate(Sessions), element(1, Call) =/= read
    ],
    [
        read(Written)
     || {_, Place, N, Call, Session} <- lists:sort(Next),
        Written <- write(
            Call, Register#register{sessions = replaced(Place, {N, Session}, Sessions)}
        )
    ].

replaced(N, Session, Sessions) ->
    {Before, [_ | After]} = lists:split(N - 1, Sessions),
    Before ++ [Session | After].

write({maybe_write, Write}, Register) ->
    [Register#register{value = Write}];
write({write, Write, none}, Register) ->
    [Register#register{value = Write}];
write({write, Write, {Writer, N}}, #register{next = Next} = Register) ->
    case maps:get(Writer, Next, 1) of
        N -> [Register#register{value = Write, next = Next#{Writer => N + 1}}];
        _ -> []
    end.

%% -- the order of writes ----------------------------------------------------------------------

%% What the sessions of a register say of the order of its writes, without a search.
%%
%% A session meets writes one after the other: those that it makes, and those that its reads come from. So
%% one is before the next in any order that explains it. A read of a value that was written more than once
%% has several writes that it may come from; those that would close a circle are left out, until nothing
%% changes. If each read has one left, the order is found, or there is none: then no search is needed.

%% The sessions with what is left for each read; `explained' or `unexplained' if that is all.
-spec narrowed([sequence()]) -> explained | unexplained | {narrowed, [sequence()]}.
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

-spec later([sequence()]) -> {ok, later()} | circle.
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
