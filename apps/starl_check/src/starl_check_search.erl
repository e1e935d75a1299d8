%% @doc Search through all states of a team, nearest first; what it finds is a shortest way.
%%
%% States are gone into in the order of the steps that lead to them (Dijkstra 1959; a run of
%% {@link starl_check_reduce} is several steps). A state that was met before by a way that is no
%% longer, or one that differs from it only in which of the robots that are like each other is
%% which, is not gone into again. For each state it is kept by which run it was met, so that
%% the way to it can be walked once more.
-module(starl_check_search).

-export([run/3, explain/1]).

-export_type([limits/0, figures/0, ending/0, way/0, control/1]).

%% `depth': steps in a row; `memory': bytes of the whole VM.
-type limits() :: #{depth := pos_integer() | infinity, memory := pos_integer()}.

%% `states' met, of which `waiting' have not been gone into, `runs' taken, `depth': all states that
%% are fewer steps away have been gone into.
-type figures() :: #{
    states := non_neg_integer(), waiting := non_neg_integer(), runs := non_neg_integer(),
    depth := non_neg_integer()
}.

%% Asked now and then whether to go on; keeps a state of its own.
-type control(State) :: fun((figures(), State) -> {continue | stop, State}).

-type ending() :: complete | depth | memory | interrupted.

%% What happened from the beginning on, with the message if there is one, and what the robots
%% traced; the last step breaks the contract.
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
    visited = starl_check_visited:new() :: starl_check_visited:t(),
    %% what has not been gone into, by the steps that lead there: number, length, packed state
    waiting = #{} :: #{non_neg_integer() => binary()},
    count = 0 :: non_neg_integer(),
    runs = 0 :: non_neg_integer(),
    depth = 0 :: non_neg_integer(),
    %% was anything left out because of the depth asked for?
    cut = false :: boolean(),
    %% the nearest violation: how many steps away, what, in which state, by which run
    found = none :: none | found(),
    until_look = 0 :: non_neg_integer()
}).

-type found() :: {
    Steps :: non_neg_integer(), starl_monitor:violation(), starl_check_visited:state_number(),
    Run :: non_neg_integer()
}.

%% So many states are gone into between two looks at the memory and at the control.
-define(LOOK, 500).

%% @doc Searches until a contract is broken, all is covered, or a limit is reached.
-spec run(starl_check_model:t(), limits(), {control(State), State}) -> result().
run(Model, Limits, Control) ->
    Search = #search{
        model = Model,
        store = starl_check_store:new(),
        permutations = starl_check_model:permutations(Model),
        limits = Limits,
        control = Control
    },
    Result = first(starl_check_step:initial(Model, Search#search.store), Search),
    ok = starl_check_store:delete(Search#search.store),
    case Result of
        unproved -> run(Model#{leave_out := false}, Limits, Control);
        _ -> Result
    end.

first({violation, _, Violation}, Search) ->
    {violated, Violation, [], figures(Search)};
first({ok, _, State}, #search{model = Model} = Search) ->
    #search{store = Store, permutations = Permutations} = Search,
    case nearest(meet(State, 0, {0, 0}, Search)) of
        {holds, _, _} = Held ->
            case starl_check_inert:is_proved(Permutations, Model, Store) of
                true -> Held;
                false -> unproved
            end;
        Violated ->
            Violated
    end.

%% Goes into the states that are nearest.
nearest(#search{waiting = Waiting} = Search) when map_size(Waiting) =:= 0 ->
    ended(Search);
nearest(#search{waiting = Waiting} = Search) ->
    Depth = lists:min(maps:keys(Waiting)),
    case Search#search.found of
        {Steps, _, _, _} when Steps =< Depth -> ended(Search);
        _ ->
            {States, Rest} = maps:take(Depth, Waiting),
            case expand(States, Search#search{waiting = Rest, depth = Depth}) of
                #search{} = Searched -> nearest(Searched);
                Ended -> Ended
            end
    end.

ended(#search{found = none, cut = true} = Search) -> {holds, depth, figures(Search)};
ended(#search{found = none} = Search) -> {holds, complete, figures(Search)};
ended(#search{found = {_, Violation, Number, Run}} = Search) ->
    {violated, Violation, walk(Number, Run, Search), figures(Search)}.

expand(<<>>, Search) ->
    Search;
expand(States, #search{until_look = 0} = Search) ->
    case look(Search) of
        #search{} = Looked -> expand(States, Looked#search{until_look = ?LOOK});
        Ending -> {holds, Ending, figures(Search)}
    end;
expand(<<Number:40, Length:16, Packed:Length/binary, Rest/binary>>, Search) ->
    #search{visited = Visited, depth = Depth, count = Count, until_look = Until} = Search,
    Looking = Search#search{count = Count - 1, until_look = Until - 1},
    case starl_check_visited:way(Number, Visited) of
        {_, _, Depth} ->
            Runs = runs(starl_check_state:unpack(Packed), Search),
            expand(Rest, follow(Runs, 0, Number, Looking));
        {_, _, _Nearer} ->
            expand(Rest, Looking)
    end.

runs(State, #search{model = Model, store = Store}) ->
    starl_check_reduce:runs(State, Model, Store).

follow([], _N, _From, Search) ->
    Search;
follow([{Choices, Result} | Runs], N, From, #search{depth = Depth, runs = Count} = Search) ->
    Steps = Depth + length(Choices),
    Counted = Search#search{runs = Count + 1},
    #search{limits = #{depth := Most}} = Search,
    Next =
        case Result of
            _ when Steps > Most -> Counted#search{cut = true};
            {ok, _, Reached} -> meet(Reached, Steps, {From, N}, Counted);
            {violation, _, Violation} -> found({Steps, Violation, From, N}, Counted);
            stuck -> found({Steps, stuck(Search), From, N}, Counted)
        end,
    follow(Runs, N + 1, From, Next).

found(Found, #search{found = none} = Search) -> Search#search{found = Found};
found({Steps, _, _, _} = Found, #search{found = {Before, _, _, _}} = Search) when Steps < Before ->
    Search#search{found = Found};
found(_Later, Search) ->
    Search.

stuck(#search{model = #{block := Block}}) ->
    #{contract => Block, what => nothing_can_happen, at_us => 0, robots => [], details => #{}}.

meet(State, Steps, {From, N}, #search{visited = Visited} = Search) ->
    #search{model = Model, store = Store, permutations = Permutations} = Search,
    Key = starl_check_state:key(State, Permutations, Model, Store),
    case starl_check_visited:meet(Key, Visited) of
        {new, Number, Met} ->
            wait(Number, State, Steps, Search#search{
                visited = starl_check_visited:put_way(Number, {From, N, Steps}, Met)
            });
        {known, Number, _} ->
            case starl_check_visited:way(Number, Visited) of
                {_, _, Before} when Before =< Steps ->
                    Search;
                _ ->
                    wait(Number, State, Steps, Search#search{
                        visited = starl_check_visited:put_way(Number, {From, N, Steps}, Visited)
                    })
            end
    end.

wait(Number, State, Steps, #search{waiting = Waiting, count = Count} = Search) ->
    Packed = starl_check_state:pack(State),
    Others = maps:get(Steps, Waiting, <<>>),
    Search#search{
        count = Count + 1,
        waiting = Waiting#{
            Steps => <<Others/binary, Number:40, (byte_size(Packed)):16, Packed/binary>>
        }
    }.

look(#search{limits = #{memory := Most}, control = {Control, Own}} = Search) ->
    case Control(figures(Search), Own) of
        {stop, _} -> interrupted;
        {continue, Next} ->
            case erlang:memory(total) > Most of
                true -> memory;
                false -> Search#search{control = {Control, Next}}
            end
    end.

figures(#search{visited = Visited, count = Count, runs = Runs, depth = Depth}) ->
    #{states => starl_check_visited:count(Visited), waiting => Count, runs => Runs, depth => Depth}.

%% -- the way --------------------------------------------------------------------------------

walk(Number, Last, #search{model = Model, store = Store, visited = Visited} = Search) ->
    {ok, _, State} = starl_check_step:initial(Model, Store),
    {Way, End} = lists:mapfoldl(
        fun(N, At) -> walk_run(N, At, Search) end, State, numbers(Number, [], Visited)
    ),
    {LastRun, _} = walk_run(Last, End, Search),
    lists:append(Way ++ [LastRun]).

numbers(0, Numbers, _Visited) ->
    Numbers;
numbers(Number, Numbers, Visited) ->
    {From, N, _} = starl_check_visited:way(Number, Visited),
    numbers(From, [N | Numbers], Visited).

walk_run(N, State, Search) ->
    {Choices, Result} = lists:nth(N + 1, runs(State, Search)),
    {Steps, _} = lists:mapfoldl(fun(C, At) -> walk_step(C, At, Search) end, State, Choices),
    {Steps, reached(Result)}.

reached({ok, _, State}) -> State;
reached(_) -> none.

walk_step(Choice, State, #search{model = Model, store = Store}) ->
    {_, Traces, Next} = starl_check_step:step(Choice, State, Model, Store),
    {{Choice, item(Choice, Store), starl_check_part:traces(Traces, Store)}, Next}.

item({_, I}, Store) -> starl_check_part:item(I, Store);
item(_, _Store) -> none.

%% @doc A step as a line of a chart.
-spec explain({starl_check_choice:t(), starl_check_part:item() | none,
    [starl_monitor:trace_event()]}) -> starl_check_chart:step().
explain({{fire, Place, {app, _}}, none, Traces}) ->
    {{mark, Place, happens, "the application goes on"}, Traces};
explain({{fire, Place, {Name, Timer}}, none, Traces}) ->
    Text = io_lib:format("~ts: time-out ~0tp", [Name, starl_check_term:shown(Timer)]),
    {{mark, Place, happens, Text}, Traces};
explain({{crash, Place, Name}, none, Traces}) ->
    {{mark, Place, crash, [atom_to_list(Name), " crashes"]}, Traces};
explain({{outcome, Place, _, Lost}, none, Traces}) ->
    {{mark, Place, happens, ["hears from SAP: ", heard(Lost)]}, Traces};
explain({tick, none, Traces}) ->
    {{note, "time passes"}, Traces};
explain({{Kind, _}, Item, Traces}) ->
    {arrow(Kind, Item), Traces}.

arrow(Kind, {packet, From, To, Packet}) ->
    {arrow, From, To, solid, [shown(Packet), again(Kind)]};
arrow(deliver, {message, From, To, Type, Body, _, Age}) ->
    {arrow, From, To, solid, [atom_to_list(Type), " ", shown(Body), slow(Age)]};
arrow(refuse, {message, From, To, Type, Body, _, _}) ->
    {arrow, From, To, dotted, [atom_to_list(Type), " ", shown(Body), "  (refused)"]}.

heard([]) -> "nothing is lost";
heard(Lost) ->
    ["lost at ", lists:join(", ", [integer_to_list(starl_check_term:number(R)) || R <- Lost])].

again(again) -> "  (and once more later)";
again(deliver) -> "".

slow(fresh) -> "";
slow(late) -> "  (slow)";
slow(ghost) -> "  (thought lost)".

shown(Term) -> io_lib:format("~0tp", [starl_check_term:shown(Term)]).
