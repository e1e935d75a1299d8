%% @doc Violations of contracts ({@link starl_monitor:violation()}): makes them, turns them into the
%% answers of a monitor, and formats one as a line of text. It also computes the shape of a violation;
%% violations with the same cause have the same shape.
%% ```
%%   step({T, Robot, door, opened}, #state{locked = true} = State) ->
%%       starl_violation:step([starl_violation:new(door, forced, T, [Robot], #{})], State);
%% '''
-module(starl_violation).

-export([new/5, step/2, first/2, finish/2, format/1, shape/1]).

-export_type([shape/0]).

%% A violation without its numbers ({@link shape/1}).
-opaque shape() ::
    {atom(), atom(), none | one | two | many, Details :: [term()], Order :: [term()]}.

%% @doc A violation of a contract at this time, with the robots that take part.
-spec new(Contract :: atom(), What :: atom(), AtUs :: integer(), [starl:robot_id()], map()) ->
    starl_monitor:violation().
new(Contract, What, At, Robots, Details) ->
    #{contract => Contract, what => What, at_us => At, robots => Robots, details => Details}.

%% @doc What a monitor's `step/2' returns if it has found these violations: it reports the first one.
-spec step([starl_monitor:violation()], State) ->
    {ok, State} | {violation, starl_monitor:violation(), State}.
step([], State) -> {ok, State};
step([First | _], State) -> {violation, First, State}.

%% @doc The same where the event itself has been judged: what was found before it is reported first.
-spec first([starl_monitor:violation()], Judged) -> Judged when
    Judged :: {ok, State} | {violation, starl_monitor:violation(), State}, State :: term().
first([], Judged) -> Judged;
first([First | _], {ok, State}) -> {violation, First, State};
first([First | _], {violation, _Second, State}) -> {violation, First, State}.

%% @doc What a monitor's `finish/2' returns if it has found these violations: it reports them all.
-spec finish([starl_monitor:violation()], Results) ->
    {ok | {violation, [starl_monitor:violation(), ...]}, Results}
when
    Results :: starl_monitor:results().
finish([], Results) -> {ok, Results};
finish(Found, Results) -> {{violation, Found}, Results}.

%% @doc One line: contract, when (s), which robots, what.
-spec format(starl_monitor:violation()) -> unicode:chardata().
format(Violation) ->
    #{contract := Contract, what := What, at_us := At, robots := Robots, details := Details} =
        Violation,
    io_lib:format("~ts broken at ~.6f s by ~ts: ~ts~ts", [
        Contract, At / 1.0e6, format_robots(Robots), words(What), format_details(Details)
    ]).

format_robots([]) -> "no robot";
format_robots([Robot]) -> io_lib:format("robot ~b", [Robot]);
format_robots(Robots) -> ["robots ", lists:join(", ", [integer_to_list(R) || R <- Robots])].

words(What) ->
    string:replace(atom_to_list(What), "_", " ", all).

format_details(Details) when map_size(Details) =:= 0 ->
    "";
format_details(Details) ->
    Shown = [io_lib:format("~ts ~0tp", [K, V]) || {K, V} <- lists:sort(maps:to_list(Details))],
    [" (", lists:join(", ", Shown), ")"].

%% @doc The shape of a violation: which contract is broken, how, and the structure of its details.
%% Numbers are left out, and robots beyond two count as many. Of the numbers in the details only
%% their order is kept: a round that comes again is not a round that was left out. Violations of
%% different shapes usually have different causes.
-spec shape(starl_monitor:violation()) -> shape().
shape(#{contract := Contract, what := What, robots := Robots, details := Details}) ->
    {Contract, What, how_many(Robots), outline(Details), order(Details)}.

how_many([]) -> none;
how_many([_]) -> one;
how_many([_, _]) -> two;
how_many([_, _ | _]) -> many.

outline(Map) when is_map(Map) ->
    lists:usort([{outline(Key), outline(Value)} || {Key, Value} <- maps:to_list(Map)]);
outline(Tuple) when is_tuple(Tuple) ->
    list_to_tuple([outline(Part) || Part <- tuple_to_list(Tuple)]);
outline([Head | Tail]) ->
    outlines([Head | Tail], []);
outline(Number) when is_number(Number) -> number;
outline(Bits) when is_bitstring(Bits) -> bits;
outline(Other) ->
    Other.

%% Equal parts of a list are kept once; the list may be improper.
outlines([Head | Tail], Known) -> outlines(Tail, [outline(Head) | Known]);
outlines([], Known) -> lists:usort(Known);
outlines(Tail, Known) -> [outline(Tail) | lists:usort(Known)].

order(Details) ->
    Numbers = lists:sort([Pair || {_, N} = Pair <- maps:to_list(Details), is_number(N)]),
    [{A, compared(M, N), B} || {A, M} <- Numbers, {B, N} <- Numbers, A < B].

compared(M, N) when M < N -> less;
compared(M, N) when M == N -> equal;
compared(_, _) -> more.
