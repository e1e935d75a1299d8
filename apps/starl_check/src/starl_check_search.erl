%% @doc Searches all states of a team, nearest first, so that a violation comes with a shortest
%% path.
%%
%% States are expanded in the order of their distance in steps (Dijkstra 1959; a run of
%% {@link starl_check_reduce} is several steps). A state is not expanded again if it was met before
%% by an equally short or shorter path, or if it equals such a state after a permutation of alike
%% robots. The search keeps for each state the run by which it was met, so that the path to it can
%% be replayed.
-module(starl_check_search).

-export([run/3]).

-export_type([limits/0, figures/0, unlike/0, ending/0, way/0, control/1]).

%% `depth': number of steps in a row; `memory': bytes of the whole VM.
-type limits() :: #{depth := pos_integer() | infinity, memory := pos_integer()}.

%% `states': states met; `waiting': those not yet expanded; `runs': runs taken; `depth': all states
%% fewer steps away have been expanded; `unlike': a difference found between robots assumed to be
%% alike; the other figures are then those of a search without symmetry; `bounds': up to where the model
%% goes, in words; empty if it goes on to the end.
-type figures() :: #{
    states := non_neg_integer(),
    waiting := non_neg_integer(),
    runs := non_neg_integer(),
    depth := non_neg_integer(),
    unlike := none | unlike(),
    bounds := string()
}.

%% A choice whose effect differs between robots assumed to be alike; a robot that looks at its number.
-type unlike() ::
    {starl_check_choice:t(), starl_check_part:item() | none, starl_check_term:permutation()}
    | {number, starl_check_term:place()}.

%% Decides from time to time whether to continue; has its own state.
-type control(State) :: fun((figures(), State) -> {continue | stop, State}).

%% `endless': more steps in a row than can be represented, as in a team with an ever-growing number.
-type ending() :: complete | depth | endless | memory | interrupted.

%% The steps from the start, each with its message, if any, and the traced events; the last step
%% breaks the contract.
-type way() :: [
    {starl_check_choice:t(), starl_check_part:item() | none, [starl_monitor:trace_event()]}
].

-type result() ::
    {holds, ending(), figures()} | {violated, starl_monitor:violation(), way(), figures()}.

-record(search, {
    model :: starl_check_model:t(),
    store :: starl_check_store:t(),
    permutations :: [starl_check_term:permutation()],
    limits :: limits(),
    control :: {control(term()), term()},
    workers :: starl_check_workers:t(),
    %% Whether the workers have been used.
    parallel = false :: boolean(),
    visited = starl_check_visited:new() :: starl_check_visited:t(),
    %% the states not yet expanded, by distance in steps: number, length, packed state
    waiting = #{} :: #{non_neg_integer() => binary()},
    count = 0 :: non_neg_integer(),
    runs = 0 :: non_neg_integer(),
    depth = 0 :: non_neg_integer(),
    %% whether states were left out because of the depth
    cut = no :: no | depth | endless,
    progress = starl_check_progress:new() :: starl_check_progress:t(),
    unlike = none :: none | unlike(),
    %% the nearest violation: distance in steps, violation, state, run
    found = none :: none | found(),
    until_look = 0 :: non_neg_integer()
}).

-type found() :: {
    Steps :: non_neg_integer(),
    starl_monitor:violation(),
    starl_check_visited:state_number(),
    Run :: non_neg_integer()
}.

%% The number of states expanded between two checks of the memory and calls of the control.
-define(LOOK, 500).
%% The number of states given to a worker at once.
-define(CHUNK, 100).

%% @doc Searches until a contract is broken, all is covered, or a limit is reached.
-spec run(starl_check_model:t(), limits(), {control(State), State}) -> result().
run(#{workers := Count} = Model, Limits, Control) ->
    Store = starl_check_store:new(),
    Permutations = starl_check_model:permutations(Model),
    Search = #search{
        model = Model,
        store = Store,
        permutations = Permutations,
        limits = Limits,
        control = Control,
        workers = starl_check_workers:start(Count, self(), {Model, Permutations, Store})
    },
    Result = first(starl_check_step:initial(Model, Store), Search),
    Whole = starl_check_workers:stop(Search#search.workers, Store),
    Checked = numbered(proved(Result, Permutations, Model, Whole), Permutations, Model, Whole),
    ok = starl_check_store:delete(Whole),
    case Checked of
        unproved -> run(Model#{leave_out := false}, Limits, Control);
        {unlike, How} -> told(How, run(starl_check_model:told_apart(Model), Limits, Control));
        %% With several workers the way found depends on their speed.
        any_way -> run(Model#{workers := 1}, Limits, Control);
        _ -> Checked
    end.

told(How, {holds, Ending, Figures}) ->
    {holds, Ending, Figures#{unlike := How}};
told(How, {violated, Violation, Way, Figures}) ->
    {violated, Violation, Way, Figures#{unlike := How}}.

first({violation, _, Violation}, Search) ->
    {violated, Violation, [], figures(Search)};
first({ok, _, State}, Search) ->
    #search{model = Model, store = Store, permutations = Permutations} = Search,
    Key = starl_check_state:key(State, Permutations, Model, Store),
    {Met, 0} = meet(Key, starl_check_state:pack(State), 0, {0, 0}, Search),
    nearest(Met).

proved({holds, _, _} = Held, Permutations, Model, Store) ->
    case starl_check_inert:is_proved(Permutations, Model, Store) of
        true -> Held;
        false -> unproved
    end;
proved(Other, _Permutations, _Model, _Store) ->
    Other.

%% What robots with other numbers than their own have done is worth something if the numbers are nothing
%% to them.
numbered(Checked, [], _Model, _Store) ->
    Checked;
numbered({holds, Ending, _} = Held, _, Model, Store) when
    Ending =:= complete; Ending =:= depth; Ending =:= endless
->
    unless_numbered(Held, Model, Store);
numbered({violated, _, _, _} = Violated, _, Model, Store) ->
    unless_numbered(Violated, Model, Store);
numbered(Other, _, _Model, _Store) ->
    Other.

unless_numbered(Checked, Model, Store) ->
    case starl_check_symmetry:numbered(Model, Store) of
        none -> Checked;
        Place -> {unlike, {number, Place}}
    end.

%% Expands the nearest states.
nearest(#search{unlike = Unlike}) when Unlike =/= none ->
    {unlike, Unlike};
nearest(#search{waiting = Waiting} = Search) when map_size(Waiting) =:= 0 ->
    ended(Search);
nearest(#search{waiting = Waiting} = Search) ->
    Depth = lists:min(maps:keys(Waiting)),
    case Search#search.found of
        {Steps, _, _, _} when Steps =< Depth -> ended(Search);
        _ ->
            {States, Rest} = maps:take(Depth, Waiting),
            case layer(States, Search#search{waiting = Rest, depth = Depth}) of
                #search{} = Searched -> nearest(Searched);
                Ended -> Ended
            end
    end.

ended(#search{found = none, cut = no} = Search) ->
    hopeful(Search);
ended(#search{found = none, cut = Cut} = Search) ->
    {holds, Cut, figures(Search)};
ended(#search{parallel = true}) ->
    any_way;
ended(#search{found = {_, Violation, Number, Run}} = Search) ->
    {violated, Violation, walk(Number, Run, Search), figures(Search)}.

%% Tests whether the clients can finish from every state; if not, reports the nearest such state.
hopeful(#search{progress = Progress, visited = Visited, parallel = Parallel} = Search) ->
    Steps = fun(Number) -> element(3, starl_check_visited:way(Number, Visited)) end,
    case starl_check_progress:hopeless(starl_check_visited:count(Visited), Progress) of
        [] ->
            {holds, complete, figures(Search)};
        [_ | _] when Parallel ->
            any_way;
        Numbers ->
            {_, Nearest} = lists:min([{Steps(Number), Number} || Number <- Numbers]),
            {Way, _} = walk(Nearest, Search),
            {violated, no_end(Search), Way, figures(Search)}
    end.

no_end(#search{model = #{block := Block}}) ->
    #{contract => Block, what => calls_never_end, at_us => 0, robots => [], details => #{}}.

layer(States, #search{workers = Workers, model = #{spread := Least}} = Search) ->
    case byte_size(States) >= Least andalso starl_check_workers:are_there(Workers) of
        true -> spread(States, Search#search{parallel = true});
        false -> expand(States, Search)
    end.

%% Expands states without workers.
expand(<<>>, Search) ->
    Search;
expand(States, #search{until_look = Until} = Search) when Until =< 0 ->
    look(Search, fun(Looked) -> expand(States, Looked) end);
expand(States, Search) ->
    #search{model = Model, permutations = Permutations, store = Store} = Search,
    {Some, Rest, Taken} = some(States, 1, [], Search),
    Context = {Model, Permutations, Store},
    Answers = [starl_check_workers:answer(Number, P, Context) || {Number, P} <- Some],
    expand(Rest, gone_into(Answers, Taken)).

%% Expands states with the workers.
spread(States, #search{until_look = Until} = Search) when Until =< 0 ->
    look(Search, fun(Looked) -> spread(States, Looked) end);
spread(States, #search{workers = Workers} = Search) ->
    case States =:= <<>> orelse starl_check_workers:is_full(Workers) of
        false ->
            {Some, Rest, Taken} = some(States, ?CHUNK, [], Search),
            Given = starl_check_workers:give(Some, Workers),
            spread(Rest, Taken#search{workers = Given});
        true ->
            await(States, starl_check_workers:is_idle(Workers), Search)
    end.

await(<<>>, true, Search) ->
    Search;
await(States, false, #search{workers = Workers} = Search) ->
    {Answers, Left} = starl_check_workers:take(Workers),
    spread(States, gone_into(Answers, Search#search{workers = Left})).

%% The next states of a layer, without those that have been met at a shorter distance since.
some(States, Left, Some, Search) when States =:= <<>>; Left =:= 0 ->
    {lists:reverse(Some), States, Search};
some(<<Number:40, Length:16, Packed:Length/binary, Rest/binary>>, Left, Some, Search) ->
    #search{visited = Visited, depth = Depth, count = Count, until_look = Until} = Search,
    Taken = Search#search{count = Count - 1, until_look = Until - 1},
    case starl_check_visited:way(Number, Visited) of
        {_, _, Depth} -> some(Rest, Left - 1, [{Number, Packed} | Some], Taken);
        {_, _, _Nearer} -> some(Rest, Left, Some, Taken)
    end.

gone_into(Answers, Search) ->
    lists:foldl(
        fun({Number, Outcomes, MayEnd, Differs}, S) ->
            follow(Outcomes, 0, Number, unlike(Differs, ends(MayEnd, Number, S)))
        end,
        Search,
        Answers
    ).

ends(true, Number, #search{progress = Progress} = Search) ->
    Search#search{progress = starl_check_progress:ends(Number, Progress)};
ends(false, _Number, Search) ->
    Search.

unlike({Choice, Permutation}, #search{unlike = none, store = Store} = Search) ->
    Search#search{unlike = {Choice, item(Choice, Store), Permutation}};
unlike(_Differs, Search) ->
    Search.

follow([], _N, _From, Search) ->
    Search;
follow([{Length, Outcome} | Outcomes], N, From, Search) ->
    #search{depth = Depth, runs = Count, limits = #{depth := Most}} = Search,
    Steps = Depth + Length,
    Counted = Search#search{runs = Count + 1},
    TooMany = Steps > starl_check_visited:most_steps(),
    Next =
        case Outcome of
            _ when Steps > Most -> Counted#search{cut = depth};
            _ when TooMany -> Counted#search{cut = endless};
            {ok, Key, Packed, true} ->
                lead(meet(Key, Packed, Steps, {From, N}, Counted), From);
            {ok, Key, Packed, false} ->
                {Met, _To} = meet(Key, Packed, Steps, {From, N}, Counted),
                Met;
            {violation, Violation} ->
                found({Steps, Violation, From, N}, Counted);
            stuck ->
                found({Steps, stuck(Search), From, N}, Counted)
        end,
    follow(Outcomes, N + 1, From, Next).

lead({#search{progress = Progress} = Search, To}, From) ->
    Search#search{progress = starl_check_progress:leads(From, To, Progress)}.

found(Found, #search{found = none} = Search) ->
    Search#search{found = Found};
found({Steps, _, _, _} = Found, #search{found = {Before, _, _, _}} = Search) when Steps < Before ->
    Search#search{found = Found};
found(_Later, Search) ->
    Search.

stuck(#search{model = #{block := Block}}) ->
    #{contract => Block, what => nothing_can_happen, at_us => 0, robots => [], details => #{}}.

meet(Key, Packed, Steps, {From, N}, #search{visited = Visited} = Search) ->
    case starl_check_visited:meet(Key, Visited) of
        {new, Number, Met} ->
            {
                wait(Number, Packed, Steps, Search#search{
                    visited = starl_check_visited:put_way(Number, {From, N, Steps}, Met)
                }),
                Number
            };
        {known, Number, _} ->
            {nearer(Number, Packed, Steps, {From, N}, Search), Number}
    end.

nearer(Number, Packed, Steps, {From, N}, #search{visited = Visited} = Search) ->
    case starl_check_visited:way(Number, Visited) of
        {_, _, Before} when Before =< Steps ->
            Search;
        _ ->
            wait(Number, Packed, Steps, Search#search{
                visited = starl_check_visited:put_way(Number, {From, N, Steps}, Visited)
            })
    end.

wait(Number, Packed, Steps, #search{waiting = Waiting, count = Count} = Search) ->
    Others = maps:get(Steps, Waiting, <<>>),
    Search#search{
        count = Count + 1,
        waiting = Waiting#{
            Steps => <<Others/binary, Number:40, (byte_size(Packed)):16, Packed/binary>>
        }
    }.

look(#search{limits = #{memory := Most}, control = {Control, Own}} = Search, Continue) ->
    Figures = figures(Search),
    case Control(Figures, Own) of
        {stop, _} ->
            {holds, interrupted, Figures};
        {continue, Next} ->
            case erlang:memory(total) > Most of
                true -> {holds, memory, Figures};
                false -> Continue(Search#search{control = {Control, Next}, until_look = ?LOOK})
            end
    end.

figures(#search{visited = Visited, count = Count, runs = Runs, depth = Depth, model = Model}) ->
    #{
        bounds => maps:get(bounds, Model),
        states => starl_check_visited:count(Visited),
        waiting => Count,
        runs => Runs,
        depth => Depth,
        unlike => none
    }.

%% -- the way --------------------------------------------------------------------------------

walk(Number, Last, Search) ->
    {Way, End} = walk(Number, Search),
    {LastRun, _} = walk_run(Last, End, Search),
    Way ++ LastRun.

walk(Number, #search{model = Model, store = Store, visited = Visited} = Search) ->
    {ok, _, State} = starl_check_step:initial(Model, Store),
    {Way, End} = lists:mapfoldl(
        fun(N, At) -> walk_run(N, At, Search) end, State, numbers(Number, [], Visited)
    ),
    {lists:append(Way), End}.

numbers(0, Numbers, _Visited) ->
    Numbers;
numbers(Number, Numbers, Visited) ->
    {From, N, _} = starl_check_visited:way(Number, Visited),
    numbers(From, [N | Numbers], Visited).

walk_run(N, State, Search) ->
    #search{model = Model, store = Store} = Search,
    {Choices, Result} = lists:nth(N + 1, starl_check_reduce:runs(State, Model, Store)),
    {Steps, _} = lists:mapfoldl(fun(C, At) -> walk_step(C, At, Search) end, State, Choices),
    {Steps, reached(Result)}.

reached({ok, _, State}) -> State;
reached(_) -> none.

walk_step(Choice, State, #search{model = Model, store = Store}) ->
    {_, Traces, Next} = starl_check_step:step(Choice, State, Model, Store),
    {{Choice, item(Choice, Store), starl_check_part:traces(Traces, Store)}, Next}.

item({still, Choice, _Cut}, Store) ->
    item(Choice, Store);
item({Kind, I}, Store) when Kind =:= deliver; Kind =:= again; Kind =:= refuse ->
    starl_check_part:item(I, Store);
item(_, _Store) ->
    none.
