%% @doc Worker processes that expand states, one per core. The search itself keeps the set of
%% states.
%%
%% The workers share the numbers of parts ({@link starl_check_store}), so a state is sent in few
%% bytes. Answers are taken in the order in which the states were given out.
-module(starl_check_workers).

-export([start/3, stop/2, are_there/1, is_full/1, is_idle/1, give/2, take/1, answer/3]).

-export_type([t/0, context/0, outcome/0, answer/0]).

-type context() :: {
    starl_check_model:t(), [starl_check_term:permutation()], starl_check_store:t()
}.

%% A run from a state: its number of steps, its final state with its hash, and whether it is free of
%% failures.
-type outcome() :: {
    Steps :: non_neg_integer(),
    {ok, Key :: <<_:128>>, Packed :: binary(), IsSmooth :: boolean()}
    | {violation, starl_monitor:violation()}
    | stuck
}.

%% The expansion of a state: the runs from it, whether the clients are done, and a difference found
%% between robots assumed to be alike.
-type answer() :: {
    starl_check_visited:state_number(),
    [outcome()],
    MayEnd :: boolean(),
    none | starl_check_symmetry:difference()
}.

-type states() :: [{starl_check_visited:state_number(), Packed :: binary()}].

%% `next': the worker that gets the next states; `given': the workers that owe answers, in order.
-record(workers, {
    ref :: reference(),
    pids :: [pid()],
    next = [] :: [pid()],
    given = queue:new() :: queue:queue(pid())
}).

-opaque t() :: #workers{}.

%% A large heap is collected seldom, and little of it survives.
-define(HEAP_WORDS, 60000).
%% Symmetry is tested on the first states, and on a fixed share of the others.
-define(FIRST_TRIED, 500).
-define(TRIED, 50).
%% The number of tasks that may wait for a worker beside the present one.
-define(AHEAD, 2).

%% @doc Starts this number of workers; none for a count of one.
-spec start(Count :: pos_integer(), pid(), context()) -> t().
start(Count, Owner, Context) ->
    Ref = make_ref(),
    Work = fun() -> begin_work(Owner, Ref, Context) end,
    Options = [link, {min_heap_size, ?HEAP_WORDS}],
    Pids = [spawn_opt(Work, Options) || Count > 1, _ <- lists:seq(1, Count)],
    #workers{ref = Ref, pids = Pids, next = Pids}.

%% @doc Ends the workers; their results are added to the store.
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

%% @doc Whether there are workers.
-spec are_there(t()) -> boolean().
are_there(#workers{pids = Pids}) -> Pids =/= [].

%% @doc Whether the workers have enough to do.
-spec is_full(t()) -> boolean().
is_full(#workers{pids = Pids, given = Given}) -> queue:len(Given) >= ?AHEAD * length(Pids).

%% @doc Whether the workers have nothing to do.
-spec is_idle(t()) -> boolean().
is_idle(#workers{given = Given}) -> queue:is_empty(Given).

%% @doc Gives states to the workers.
-spec give(states(), t()) -> t().
give(States, #workers{next = [Pid | Next], ref = Ref, given = Given} = Workers) ->
    Pid ! {Ref, States},
    Workers#workers{next = Next ++ [Pid], given = queue:in(Pid, Given)}.

%% @doc The answers to the oldest unanswered states.
-spec take(t()) -> {[answer()], t()}.
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
            Owner ! {Ref, self(), [answer(Number, P, Context) || {Number, P} <- States]},
            work(Owner, Ref, Context)
    end.

%% @doc Expands a state.
-spec answer(starl_check_visited:state_number(), Packed :: binary(), context()) -> answer().
answer(Number, Packed, {Model, Permutations, Store} = Context) ->
    State = starl_check_state:unpack(Packed),
    Runs = starl_check_reduce:runs(State, Model, Store),
    Outcomes = [{length(Choices), outcome(Run, Packed, Context)} || {Choices, _} = Run <- Runs],
    Differs =
        case Number < ?FIRST_TRIED orelse Number rem ?TRIED =:= 0 of
            true -> starl_check_symmetry:differs(State, Permutations, Model, Store);
            false -> none
        end,
    {Number, Outcomes, starl_check_reduce:may_end(State, Model, Store), Differs}.

outcome({Choices, {ok, _, State}}, From, {Model, Permutations, Store}) ->
    Key = starl_check_state:key(State, Permutations, Model, Store),
    Packed = starl_check_state:pack(State),
    IsSmooth =
        starl_check_state:budgets(Packed) =:= starl_check_state:budgets(From) andalso
            not lists:any(fun is_ghost/1, Choices),
    {ok, Key, Packed, IsSmooth};
outcome({_Choices, {violation, _, Violation}}, _From, _Context) ->
    {violation, Violation};
outcome({_Choices, stuck}, _From, _Context) ->
    stuck.

%% Whether a message arrives that was reported lost.
is_ghost({deliver, I}) -> starl_check_part:age(I) =:= ghost;
is_ghost(_Choice) -> false.
