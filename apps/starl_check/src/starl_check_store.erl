%% @doc Numbers for terms ("collapse compression", Holzmann 1997): a state of a team is made of
%% the states of its robots, of the monitor and of what is under way, and each of these parts
%% recurs in very many states. Here every part is kept once, under a number, and what has been
%% computed of parts is remembered by their numbers. So a state is a handful of numbers, exact
%% (nothing is hashed away), and most steps are look-ups.
%%
%% A store belongs to the process that made it.
-module(starl_check_store).

-export([new/0, delete/1, number/3, term/2, memo/3, fold/3, size/1]).

-export_type([t/0]).

%% Parts of all kinds are numbered together, from 0.
-record(store, {numbers :: ets:table(), terms :: ets:table(), memos :: ets:table()}).

-opaque t() :: #store{}.

%% @doc An empty store.
-spec new() -> t().
new() ->
    #store{
        numbers = ets:new(numbers, [set, private]),
        terms = ets:new(terms, [set, private]),
        memos = ets:new(memos, [set, private])
    }.

%% @doc Gives up its memory.
-spec delete(t()) -> ok.
delete(#store{numbers = Numbers, terms = Terms, memos = Memos}) ->
    lists:foreach(fun ets:delete/1, [Numbers, Terms, Memos]).

%% @doc The number of a term, known by its `Key'; of terms with one key the first is kept.
-spec number(Key :: term(), Term :: term(), t()) -> non_neg_integer().
number(Key, Term, #store{numbers = Numbers, terms = Terms}) ->
    %% ETS hashes a key with 32 bits and then compares: exact, but the term is kept twice
    case ets:lookup(Numbers, Key) of
        [{_, Number}] ->
            Number;
        [] ->
            Number = ets:info(Numbers, size),
            true = ets:insert(Numbers, {Key, Number}),
            true = ets:insert(Terms, {Number, Term}),
            Number
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

%% @doc Folds over all that is remembered, in no particular order.
-spec fold(fun((Key :: term(), Value :: term(), Acc) -> Acc), Acc, t()) -> Acc.
fold(Fun, First, #store{memos = Memos}) ->
    ets:foldl(fun({Key, Value}, Acc) -> Fun(Key, Value, Acc) end, First, Memos).

%% @doc How many terms have numbers, and how many results are remembered.
-spec size(t()) -> {Terms :: non_neg_integer(), Memos :: non_neg_integer()}.
size(#store{terms = Terms, memos = Memos}) -> {ets:info(Terms, size), ets:info(Memos, size)}.
