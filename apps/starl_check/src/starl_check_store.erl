%% @doc Numbers for terms ("collapse compression", Holzmann 1997): a state of a team is made of
%% the states of its robots, of the monitor and of what is under way, and each of these parts
%% recurs in very many states. Here every part is kept once, under a number, and what has been
%% computed of parts is remembered by their numbers. So a state is a handful of numbers, exact
%% (nothing is hashed away), and most steps are look-ups.
%%
%% A store belongs to the process that made it, which may share it with others: they have the
%% numbers in common, and each remembers what it has computed itself.
-module(starl_check_store).

-export([new/0, delete/1, number/3, term/2, memo/3, fold/3, size/1]).
-export([share/1, give_memos/2, receive_memos/2]).

-export_type([t/0]).

%% Parts of all kinds are numbered together, from 0.
-record(store, {
    numbers :: ets:table(),
    terms :: ets:table(),
    memos :: ets:table(),
    %% how many numbers have been given out
    last :: atomics:atomics_ref(),
    %% what others had computed
    others = [] :: [ets:table()]
}).

-opaque t() :: #store{}.

%% @doc An empty store.
-spec new() -> t().
new() ->
    #store{
        numbers = ets:new(numbers, [set, public, {read_concurrency, true}]),
        terms = ets:new(terms, [set, public, {read_concurrency, true}]),
        memos = ets:new(memos, [set, private]),
        last = atomics:new(1, [])
    }.

%% @doc Gives up its memory.
-spec delete(t()) -> ok.
delete(#store{numbers = Numbers, terms = Terms, memos = Memos, others = Others}) ->
    lists:foreach(fun ets:delete/1, [Numbers, Terms, Memos | Others]).

%% @doc The store for another process, which calls this itself.
-spec share(t()) -> t().
share(Store) -> Store#store{memos = ets:new(memos, [set, private])}.

%% @doc Gives what this process has computed to another one, which is to receive it.
-spec give_memos(pid(), t()) -> ok.
give_memos(To, #store{memos = Memos}) ->
    true = ets:give_away(Memos, To, memos),
    ok.

%% @doc The store with what another process has computed.
-spec receive_memos(From :: pid(), t()) -> t().
receive_memos(From, #store{others = Others} = Store) ->
    receive
        {'ETS-TRANSFER', Memos, From, memos} -> Store#store{others = [Memos | Others]}
    end.

%% @doc The number of a term, known by its `Key'; of terms with one key the first is kept.
-spec number(Key :: term(), Term :: term(), t()) -> non_neg_integer().
number(Key, Term, #store{numbers = Numbers} = Store) ->
    %% ETS hashes a key with 32 bits and then compares: exact, but the term is kept twice
    case ets:lookup(Numbers, Key) of
        [{_, Number}] -> Number;
        [] -> new_number(Key, Term, Store)
    end.

%% The term comes first: whoever knows a number finds its term. Of two processes that have the
%% same term at the same time the second one's number is not used.
new_number(Key, Term, #store{numbers = Numbers, terms = Terms, last = Last}) ->
    Number = atomics:add_get(Last, 1, 1) - 1,
    true = ets:insert(Terms, {Number, Term}),
    case ets:insert_new(Numbers, {Key, Number}) of
        true -> Number;
        false -> ets:lookup_element(Numbers, Key, 2)
    end.

%% @doc The term of a number.
-spec term(non_neg_integer(), t()) -> term().
term(Number, #store{terms = Terms}) -> ets:lookup_element(Terms, Number, 2).

%% @doc What `Compute' gives, remembered under a key.
-spec memo(Key :: term(), fun(() -> Value), t()) -> Value.
memo(Key, Compute, #store{memos = Memos}) ->
    case ets:lookup(Memos, Key) of
        [{_, Value}] ->
            Value;
        [] ->
            Value = Compute(),
            true = ets:insert(Memos, {Key, Value}),
            Value
    end.

%% @doc Folds over all that is remembered, in no particular order; what several processes have
%% computed comes several times.
-spec fold(fun((Key :: term(), Value :: term(), Acc) -> Acc), Acc, t()) -> Acc.
fold(Fun, First, #store{memos = Memos, others = Others}) ->
    Each = fun({Key, Value}, Acc) -> Fun(Key, Value, Acc) end,
    lists:foldl(fun(Table, Acc) -> ets:foldl(Each, Acc, Table) end, First, [Memos | Others]).

%% @doc How many terms have numbers, and how many results are remembered.
-spec size(t()) -> {Terms :: non_neg_integer(), Memos :: non_neg_integer()}.
size(#store{terms = Terms, memos = Memos}) -> {ets:info(Terms, size), ets:info(Memos, size)}.
