%% @doc Stores terms under numbers ("collapse compression", Holzmann 1997). A state of a team
%% consists of the states of its robots, of the monitor and of the messages under way, and each of
%% these parts recurs in very many states. The store keeps every part once, under a number, and
%% remembers results computed from parts by these numbers. So a state is a handful of numbers, exact
%% (without hashing), and most steps are look-ups.
%%
%% A store belongs to the process that made it, which may share it with other processes. They share
%% the numbers, and each remembers its own results.
-module(starl_check_store).

-export([new/0, delete/1, number/3, term/2, memo/3, fold/3]).
-export([share/1, give_memos/2, receive_memos/2]).

-export_type([t/0]).

%% Parts of all kinds are numbered together, from 0.
-record(store, {
    numbers :: ets:table(),
    terms :: ets:table(),
    memos :: ets:table(),
    %% the number of terms so far
    last :: atomics:atomics_ref(),
    %% results computed by other processes
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

%% @doc Frees its memory.
-spec delete(t()) -> ok.
delete(#store{numbers = Numbers, terms = Terms, memos = Memos, others = Others}) ->
    lists:foreach(fun ets:delete/1, [Numbers, Terms, Memos | Others]).

%% @doc The store for another process, which must call this itself.
-spec share(t()) -> t().
share(Store) -> Store#store{memos = ets:new(memos, [set, private])}.

%% @doc Gives the results of this process to another one, which must receive them.
-spec give_memos(pid(), t()) -> ok.
give_memos(To, #store{memos = Memos}) ->
    true = ets:give_away(Memos, To, memos),
    ok.

%% @doc The store with the results of another process.
-spec receive_memos(From :: pid(), t()) -> t().
receive_memos(From, #store{others = Others} = Store) ->
    receive
        {'ETS-TRANSFER', Memos, From, memos} -> Store#store{others = [Memos | Others]}
    end.

%% @doc The number of a term, identified by its `Key'; of several terms with one key the first is
%% kept.
-spec number(Key :: term(), Term :: term(), t()) -> non_neg_integer().
number(Key, Term, #store{numbers = Numbers} = Store) ->
    %% ETS compares keys after hashing: exact, but a term that is its own key is kept twice.
    case ets:lookup(Numbers, Key) of
        [{_, Number}] -> Number;
        [] -> new_number(Key, Term, Store)
    end.

%% The term is stored before its number, so that every known number has a term. If two processes
%% store the same term at the same time, the number of the second is not used.
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

%% @doc The result of `Compute', remembered under a key.
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

%% @doc Folds over all remembered results, in no particular order. Results computed by several
%% processes occur several times.
-spec fold(fun((Key :: term(), Value :: term(), Acc) -> Acc), Acc, t()) -> Acc.
fold(Fun, First, #store{memos = Memos, others = Others}) ->
    Each = fun({Key, Value}, Acc) -> Fun(Key, Value, Acc) end,
    lists:foldl(fun(Table, Acc) -> ets:foldl(Each, Acc, Table) end, First, [Memos | Others]).
