%% @doc Breadth-first search through all states of a team; what it finds first is a shortest way.
%%
%% A state that was met before, or one that differs from it only in which of the robots that are
%% like each other is which, is not gone into again. For each state its predecessor and the
%% choice are kept, eight bytes, so that the way to it can be walked once more.
-module(starl_check_search).

-export([run/3, explain/1]).

-export_type([limits/0, figures/0, ending/0, way/0, control/1]).

%% `depth': choices in a row; `memory': bytes of the whole VM.
-type limits() :: #{depth := pos_integer() | infinity, memory := pos_integer()}.

%% `states' met, of which `waiting' have not been gone into, `steps' taken, `depth' of the last.
-type figures() :: #{
    states := non_neg_integer(), waiting := non_neg_integer(), steps := non_neg_integer(),
    depth := non_neg_integer()
}.

%% Asked now and then whether to go on; keeps a state of its own.
-type control(State) :: fun((figures(), State) -> {continue | stop, State}).

-type ending() :: complete | depth | memory | interrupted.

%% What happened from the beginning on, with the message if there is one, and what the robots
%% traced; the last step breaks the contract.
-type way() :: [
    {starl_check_state:choice(), starl_check_state:item() | none, [starl_monitor:trace_event()]}
].

-type result() ::
    {holds, ending(), figures()} | {violated, starl_monitor:violation(), way(), figures()}.

-record(search, {
    model :: starl_check_model:t(),
    store :: starl_check_store:t(),
    permutations :: [starl_check_term:permutation()],
    limits :: limits(),
    control :: {control(term()), term()},
    visited :: ets:table(),
    %% for each state in the order of their numbers: predecessor, 40 bits, and choice, 24 bits
    ways = <<>> :: binary(),
    states = 0 :: non_neg_integer(),
    steps = 0 :: non_neg_integer(),
    depth = 0 :: non_neg_integer(),
    until_look = 0 :: non_neg_integer()
}).

%% So many states are gone into between two looks at the memory and at the control.
-define(LOOK, 1000).

%% @doc Searches until a contract is broken, all is covered, or a limit is reached.
-spec run(starl_check_model:t(), limits(), {control(State), State}) -> result().
run(Model, Limits, Control) ->
    Search = #search{
        model = Model,
        store = starl_check_store:new(),
        permutations = starl_check_model:permutations(Model),
        limits = Limits,
        control = Control,
        visited = ets:new(visited, [set, private])
    },
    Result = first(starl_check_state:initial(Model, Search#search.store), Search),
    true = ets:delete(Search#search.visited),
    ok = starl_check_store:delete(Search#search.store),
    Result.

first({violation, _, Violation}, Search) ->
    {violated, Violation, [], figures([], [], Search)};
first({ok, _, State}, Search) ->
    {Next, Begun} = meet(State, 0, 0, [], Search),
    level(Next, Begun).

%% Goes into all states of a depth.
level([], Search) ->
    {holds, complete, figures([], [], Search)};
level(Frontier, #search{depth = Depth, limits = #{depth := Most}} = Search) when Depth >= Most ->
    {holds, depth, figures(Frontier, [], Search)};
level(Frontier, #search{depth = Depth} = Search) ->
    case expand_all(lists:reverse(Frontier), [], Search) of
        {ok, Next, Searched} -> level(Next, Searched#search{depth = Depth + 1});
        {_, _, _} = Ended -> Ended;
        {violated, _, _, _} = Ended -> Ended
    end.

expand_all(Left, Next, #search{until_look = 0} = Search) ->
    Figures = figures(Left, Next, Search),
    case look(Figures, Search) of
        #search{} = Looked -> expand_all(Left, Next, Looked#search{until_look = ?LOOK});
        Ending -> {holds, Ending, Figures}
    end;
expand_all([], Next, Search) ->
    {ok, Next, Search};
expand_all([<<Number:40, Packed/binary>> | Left], Next, #search{until_look = Until} = Search) ->
    #search{model = Model, store = Store} = Search,
    State = starl_check_state:unpack(Packed),
    Choices = starl_check_state:choices(State, Model, Store),
    case starl_check_state:is_stuck(State, Model, Store) of
        true ->
            violated(stuck(Model), Number, [], Search);
        false ->
            case try_all(Choices, 0, {Number, State}, Next, Search#search{until_look = Until - 1}) of
                {ok, More, Searched} -> expand_all(Left, More, Searched);
                {violated, _, _, _} = Ended -> Ended
            end
    end.

try_all([], _N, _From, Next, Search) ->
    {ok, Next, Search};
try_all([Choice | Choices], N, {Number, State} = From, Next, #search{steps = Steps} = Search) ->
    #search{model = Model, store = Store} = Search,
    case starl_check_state:step(Choice, State, Model, Store) of
        {ok, _, Reached} ->
            {More, Met} = meet(Reached, Number, N, Next, Search#search{steps = Steps + 1}),
            try_all(Choices, N + 1, From, More, Met);
        {violation, _, Violation} ->
            violated(Violation, Number, [Choice], Search)
    end.

meet(State, From, N, Next, #search{visited = Visited, states = States, ways = Ways} = Search) ->
    #search{model = Model, store = Store, permutations = Permutations} = Search,
    Key = starl_check_state:key(State, Permutations, Model, Store),
    case ets:insert_new(Visited, {Key}) of
        true ->
            {[pack(States, State) | Next], Search#search{
                states = States + 1, ways = <<Ways/binary, From:40, N:24>>
            }};
        false ->
            {Next, Search}
    end.

pack(Number, State) -> <<Number:40, (starl_check_state:pack(State))/binary>>.

look(Figures, #search{limits = #{memory := Most}, control = {Control, Own}} = Search) ->
    {total_heap_size, Words} = process_info(self(), total_heap_size),
    %% a collection of garbage copies the heap
    Peak = erlang:memory(total) + Words * erlang:system_info(wordsize),
    case Control(Figures, Own) of
        {stop, _} -> interrupted;
        {continue, _} when Peak > Most -> memory;
        {continue, Next} -> Search#search{control = {Control, Next}}
    end.

figures(Left, Next, #search{states = States, steps = Steps, depth = Depth}) ->
    #{states => States, waiting => length(Left) + length(Next), steps => Steps, depth => Depth}.

stuck(#{block := Block}) ->
    #{contract => Block, what => nothing_can_happen, at_us => 0, robots => [], details => #{}}.

%% -- the way --------------------------------------------------------------------------------

violated(Violation, Number, Last, #search{ways = Ways} = Search) ->
    Way = walk(choices(Number, Ways, []), Last, Search),
    {violated, Violation, Way, figures([], [], Search)}.

choices(0, _Ways, Choices) ->
    Choices;
choices(Number, Ways, Choices) ->
    Skip = 8 * Number,
    <<_:Skip/binary, From:40, N:24, _/binary>> = Ways,
    choices(From, Ways, [N | Choices]).

walk(Numbers, Last, #search{model = Model, store = Store} = Search) ->
    {ok, _, State} = starl_check_state:initial(Model, Store),
    {Way, End} = lists:mapfoldl(fun(N, At) -> nth_step(N, At, Search) end, State, Numbers),
    Way ++ [last_step(Choice, End, Search) || Choice <- Last].

nth_step(N, State, #search{model = Model, store = Store}) ->
    Choice = lists:nth(N + 1, starl_check_state:choices(State, Model, Store)),
    {ok, Traces, Next} = starl_check_state:step(Choice, State, Model, Store),
    {{Choice, item(Choice, Store), Traces}, Next}.

last_step(Choice, State, #search{model = Model, store = Store}) ->
    {violation, Traces, _} = starl_check_state:step(Choice, State, Model, Store),
    {Choice, item(Choice, Store), Traces}.

item({_, I}, Store) -> starl_check_state:item(I, Store);
item(_, _Store) -> none.

%% @doc A step as a line of a chart.
-spec explain({starl_check_state:choice(), starl_check_state:item() | none,
    [starl_monitor:trace_event()]}) -> starl_check_chart:step().
explain({{fire, Place, {app, _}}, none, Traces}) ->
    {{mark, Place, happens, "the application goes on"}, Traces};
explain({{fire, Place, {Name, Timer}}, none, Traces}) ->
    Text = io_lib:format("~ts: time-out ~0tp", [Name, starl_check_term:shown(Timer)]),
    {{mark, Place, happens, Text}, Traces};
explain({{crash, Place, Name}, none, Traces}) ->
    {{mark, Place, crash, [atom_to_list(Name), " crashes"]}, Traces};
explain({tick, none, Traces}) ->
    {{note, "time passes"}, Traces};
explain({{Kind, _}, Item, Traces}) ->
    {arrow(Kind, Item), Traces}.

arrow(Kind, {packet, From, To, Packet}) ->
    {arrow, From, To, solid, [shown(Packet), again(Kind)]};
arrow(deliver, {message, From, To, Type, Body, _, Age}) ->
    {arrow, From, To, solid, [atom_to_list(Type), " ", shown(Body), slow(Age)]};
arrow(Kind, {message, From, To, Type, Body, _, _}) ->
    Text = [outcome(Kind), ": ", atom_to_list(Type), " ", shown(Body), " to ",
        integer_to_list(To)],
    {mark, From, happens, Text};
arrow(deliver, {report, From, To, _, Outcome, _}) ->
    {arrow, From, To, dotted, ["(", atom_to_list(Outcome), ")"]};
arrow(Kind, {report, From, To, _, _, _}) ->
    {arrow, From, To, dotted, ["(", outcome(Kind), ")"]}.

again(again) -> "  (and once more later)";
again(deliver) -> "".

slow(fresh) -> "";
slow(late) -> "  (slow)";
slow(ghost) -> "  (thought lost)".

outcome(lose) -> "reported lost";
outcome(refuse) -> "reported restarted".

shown(Term) -> io_lib:format("~0tp", [starl_check_term:shown(Term)]).
