%% @doc Processes that go into states, one for each core; the search itself keeps what was met.
%%
%% They share the numbers of parts ({@link starl_check_store}), so states go to and fro in few
%% bytes. Answers are taken in the order in which the states were given out.
-module(starl_check_workers).

-export([start/3, stop/2, are_there/1, is_full/1, is_idle/1, give/2, take/1, answer/3]).

-export_type([t/0, context/0, outcome/0, answer/0]).

-type context() :: {
    starl_check_model:t(), [starl_check_term:permutation()], starl_check_store:t()
}.

%% A run from a state: how many steps, and the state that it leads to, with its hash, and whether
%% nothing fails on the way.
-type outcome() :: {
    Steps :: non_neg_integer(),
    {ok, Key :: <<_:128>>, Packed :: binary(), IsSmooth :: boolean()}
    | {violation, starl_monitor:violation()}
    | stuck
}.

%% What there is to know of a state: the runs from it, whether the clients are done, and in what
%% robots were found to differ that are taken for one another.
-type answer() :: {
    starl_check_visited:state_number(),
    [outcome()],
    MayEnd :: boolean(),
    none | starl_check_symmetry:difference()
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
%% Symmetry is tried out on the first states, and on one of so many of the others.
-define(FIRST_TRIED, 500).
-define(TRIED, 50).
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

%% @doc What may happen in a state.
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

%% Does something arrive that was reported lost?
is_ghost({deliver, I}) -> starl_check_part:age(I) =:= ghost;
is_ghost(_Choice) -> false.
