%% @doc Processes that go into states, one for each core; the search itself keeps what was met.
%%
%% They share the numbers of parts ({@link starl_check_store}), so states go to and fro in few
%% bytes. Answers are taken in the order in which the states were given out.
-module(starl_check_workers).

-export([start/3, stop/2, are_there/1, is_full/1, is_idle/1, give/2, take/1, outcomes/2]).

-export_type([t/0, context/0, outcome/0]).

-type context() :: {
    starl_check_model:t(), [starl_check_term:permutation()], starl_check_store:t()
}.

%% A run from a state: how many steps, and the state that it leads to, with its hash.
-type outcome() :: {
    Steps :: non_neg_integer(),
    {ok, Key :: <<_:128>>, Packed :: binary()}
    | {violation, starl_monitor:violation()}
    | stuck
}.

-type states() :: [{starl_check_visited:state_number(), Packed :: binary()}].

%% `next' is given something to do next; `given': from whom answers will come, in their order.
-record(workers, {
    ref :: reference(),
    pids :: [pid()],
    next = [] :: [pid()],
    given = queue:new() :: queue:queue(pid())
}).

-opaque t() :: #workers{}.

%% Roomy, so that a worker's heap is collected seldom; what is left of it then is little.
-define(HEAP_WORDS, 60000).
%% What a worker may have before it besides what it is at.
-define(AHEAD, 2).

%% @doc So many workers; none if one core is all there is to use.
-spec start(Count :: pos_integer(), pid(), context()) -> t().
start(Count, Owner, Context) ->
    Ref = make_ref(),
    Work = fun() -> begin_work(Owner, Ref, Context) end,
    Options = [link, {min_heap_size, ?HEAP_WORDS}],
    Pids = [spawn_opt(Work, Options) || Count > 1, _ <- lists:seq(1, Count)],
    #workers{ref = Ref, pids = Pids, next = Pids}.

%% @doc Ends them; what they have computed is added to the store.
-spec stop(t(), starl_check_store:t()) -> starl_check_store:t().
stop(#workers{pids = Pids, ref = Ref}, Store) ->
    lists:foldl(
        fun(Pid, Sum) ->
            Pid ! {Ref, stop},
            starl_check_store:receive_memos(Pid, Sum)
        end,
        Store,
        Pids
    ).

%% @doc Are there any?
-spec are_there(t()) -> boolean().
are_there(#workers{pids = Pids}) -> Pids =/= [].

%% @doc Do they have as much to do as is good?
-spec is_full(t()) -> boolean().
is_full(#workers{pids = Pids, given = Given}) -> queue:len(Given) >= ?AHEAD * length(Pids).

%% @doc Do they have nothing to do?
-spec is_idle(t()) -> boolean().
is_idle(#workers{given = Given}) -> queue:is_empty(Given).

%% @doc Gives them states to go into.
-spec give(states(), t()) -> t().
give(States, #workers{next = [Pid | Next], ref = Ref, given = Given} = Workers) ->
    Pid ! {Ref, States},
    Workers#workers{next = Next ++ [Pid], given = queue:in(Pid, Given)}.

%% @doc The answer to what was given first and has not been answered.
-spec take(t()) -> {[{starl_check_visited:state_number(), [outcome()]}], t()}.
take(#workers{ref = Ref, given = Given} = Workers) ->
    {{value, Pid}, Rest} = queue:out(Given),
    receive
        {Ref, Pid, Answer} -> {Answer, Workers#workers{given = Rest}}
    end.

%% -- a worker -------------------------------------------------------------------------------

begin_work(Owner, Ref, {Model, Permutations, Store}) ->
    work(Owner, Ref, {Model, Permutations, starl_check_store:share(Store)}).

work(Owner, Ref, {_, _, Store} = Context) ->
    receive
        {Ref, stop} ->
            starl_check_store:give_memos(Owner, Store);
        {Ref, States} ->
            Owner ! {Ref, self(), [{Number, outcomes(P, Context)} || {Number, P} <- States]},
            work(Owner, Ref, Context)
    end.

%% @doc What may happen in a state.
-spec outcomes(Packed :: binary(), context()) -> [outcome()].
outcomes(Packed, {Model, _, Store} = Context) ->
    Runs = starl_check_reduce:runs(starl_check_state:unpack(Packed), Model, Store),
    [{length(Choices), outcome(Result, Context)} || {Choices, Result} <- Runs].

outcome({ok, _, State}, {Model, Permutations, Store}) ->
    Key = starl_check_state:key(State, Permutations, Model, Store),
    {ok, Key, starl_check_state:pack(State)};
outcome({violation, _, Violation}, _Context) ->
    {violation, Violation};
outcome(stuck, _Context) ->
    stuck.
