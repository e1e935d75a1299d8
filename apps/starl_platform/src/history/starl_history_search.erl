%% @doc The search for an order of calls that explains their answers, after Wing and Gong, with a cache of
%% what was tried (Lowe, "Testing for linearizability", 2017; Porcupine): of two ways to the same set of
%% calls and the same state only the first is followed.
%%
%% {@link linearizable/4} wants an order that keeps real time: a call that has returned before another was
%% invoked comes first. {@link sequential/3} wants one for a register that keeps the order of each session,
%% and in which no read comes from a write that was invoked after it had returned.
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

%% `maybe': a write whose outcome is unknown. The writes of a writer take effect in the order of their
%% numbers, which count from 1 without a gap, whatever their sessions; `none': one that is in no such order.
-type session_call() ::
    {write, Value :: term(), InvokedUs :: integer(), {Writer :: term(), N :: pos_integer()} | none}
    | {maybe_write, Value :: term(), InvokedUs :: integer()}
    | {read, Value :: term(), ReturnedUs :: integer()}.

%% `undecided': so many states were not enough.
-type answer() :: explained | unexplained | undecided.

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

is_done({Open, [], _State}) -> lists:all(fun({_, {_, End, _}}) -> End =:= infinity end, Open);
is_done(_Node) -> false.

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

%% What is left of the sessions; the value of the register and when its write was invoked; how many reads
%% and writes of each value are left; the number of each writer's next write.
-record(register, {
    sessions :: [session()],
    value = {unset, -1 bsl 80} :: {Value :: term(), InvokedUs :: integer()},
    reads = #{} :: #{Value :: term() => pos_integer()},
    writes = #{} :: #{Value :: term() => pos_integer()},
    next = #{} :: #{Writer :: term() => pos_integer()}
}).

%% @doc Is there an order of these calls that keeps that of each session, in which each read returns the
%% value of the write before it, `unset' before all writes, and none that was invoked after its return?
-spec sequential([session()], Unset :: term(), MostStates :: pos_integer()) -> answer().
sequential(Sessions, Unset, Most) ->
    All = lists:append(Sessions),
    Start = #register{
        sessions = Sessions,
        value = {Unset, -1 bsl 80},
        reads = counted([Value || {read, Value, _} <- All]),
        writes = counted([element(2, Call) || Call <- All, element(1, Call) =/= read])
    },
    explore([read(Start)], fun written/1, fun place_of/1, fun is_over/1, #{}, Most).

counted(Values) ->
    maps:map(fun(_, All) -> length(All) end, maps:groups_from_list(fun same/1, Values)).

same(Value) -> Value.

place_of(#register{sessions = Sessions, value = Value}) -> {[length(S) || S <- Sessions], Value}.

is_over(#register{sessions = Sessions}) ->
    lists:all(fun(Session) -> lists:all(fun is_maybe/1, Session) end, Sessions).

is_maybe({maybe_write, _, _}) -> true;
is_maybe(_) -> false.

%% A read that may return the present value is placed at once: it changes nothing.
read(#register{sessions = Sessions, value = Value, reads = Reads} = Register) ->
    {Left, Now} = lists:mapfoldl(fun(S, Rs) -> read(S, Value, Rs) end, Reads, Sessions),
    Register#register{sessions = Left, reads = Now}.

read([{read, Value, Returned} | Session], {Value, Invoked} = Present, Reads) when
    Invoked =< Returned
->
    read(Session, Present, less(Value, Reads));
read(Session, _Present, Reads) ->
    {Session, Reads}.

less(Value, Counts) ->
    case Counts of
        #{Value := 1} -> maps:remove(Value, Counts);
        #{Value := N} -> Counts#{Value := N - 1}
    end.

%% A value that is still to be read, and that nobody writes again, is not written over.
written(#register{value = {Value, _}, reads = Reads, writes = Writes}) when
    is_map_key(Value, Reads), not is_map_key(Value, Writes)
->
    [];
written(#register{sessions = Sessions} = Register) ->
    [
        read(Next)
     || {N, [Call | Session]} <- lists:enumerate(Sessions),
        Next <- write(Call, Register#register{sessions = replaced(N, Session, Sessions)})
    ].

replaced(N, Session, Sessions) ->
    {Before, [_ | After]} = lists:split(N - 1, Sessions),
    Before ++ [Session | After].

write({read, _, _}, _Register) ->
    [];
write({maybe_write, Value, Invoked}, Register) ->
    [put_value(Value, Invoked, Register)];
write({write, Value, Invoked, none}, Register) ->
    [put_value(Value, Invoked, Register)];
write({write, Value, Invoked, {Writer, N}}, #register{next = Next} = Register) ->
    case maps:get(Writer, Next, 1) of
        N -> [put_value(Value, Invoked, Register#register{next = Next#{Writer => N + 1}})];
        _ -> []
    end.

put_value(Value, Invoked, #register{writes = Writes} = Register) ->
    Register#register{value = {Value, Invoked}, writes = less(Value, Writes)}.
