%% @doc Mutation operators on the abstract code of a function. Each operator makes one small change,
%% a typical programming mistake at one place.
%%
%% In a pattern only the integers are changed, because other changes would not compile or would
%% never match. Binaries and the names of functions, fields and records are not changed.
-module(starl_mutate_operators).

-export([mutants/1, operators/0]).

-export_type([mutant/0, operator/0, form/0]).

%% A function in the abstract format.
-type form() :: erl_parse:abstract_form().

-type operator() ::
    compare | constant | clause | guard | action | field | element | negate | arithmetic | call.

%% The changed function, the place of the change, and the number of the changed clause.
-type mutant() :: #{
    operator := operator(),
    location := erl_anno:location(),
    clause := pos_integer(),
    form := form()
}.

-type context() :: body | guard | pattern.
-type change() :: {operator(), erl_anno:anno(), New :: term()}.

%% The places of the parts of a node of this kind and size, where they are not all after the line.
-define(PLACES, #{
    {call, 4} => [4],
    {record, 4} => [4],
    {record, 5} => [3, 5],
    {record_field, 4} => [4],
    {record_field, 5} => [3],
    {op, 4} => [4],
    {op, 5} => [4, 5]
}).
-define(LEAVES, [
    bin, 'fun', remote, record_index, string, char, atom, var, integer, float
]).

%% @doc All operators, with a description of each.
-spec operators() -> [{operator(), string()}].
operators() ->
    [
        {compare, "a comparison is replaced: by its neighbour (< by =<) and by its opposite"},
        {constant, "a number is changed by one"},
        {clause, "a clause is left out"},
        {guard, "a test of a guard, a side of a condition or a filter is left out"},
        {action, "an expression that is there for its effect is left out"},
        {field, "a field of a map or a record is not updated"},
        {element, "an element of a list, or a part of a ++, is left out"},
        {negate, "a condition, or a truth value, is turned round"},
        {arithmetic, "an arithmetic operator is replaced"},
        {call, "a call that changes a collection, or takes a minimum, is left out or swapped"}
    ].

%% @doc Every mutant of a function, in the order of the code. Other forms have none.
-spec mutants(form()) -> [mutant()].
mutants({function, Anno, Name, Arity, Clauses}) ->
    Whole = fun(New) -> {function, Anno, Name, Arity, New} end,
    [
        #{
            operator => Operator,
            location => erl_anno:location(At),
            clause => N,
            form => Whole(New)
        }
     || {N, {Operator, At, New}} <- of_clauses(Clauses), New =/= Clauses
    ];
mutants(_Form) ->
    [].

of_clauses(Clauses) ->
    lists:append([
        [{N, {clause, element(2, Clause), without(N, Clauses)}} || length(Clauses) > 1] ++
            [
                {N, {Operator, At, with(N, New, Clauses)}}
             || {Operator, At, New} <- changes(Clause, body)
            ]
     || {N, Clause} <- numbered(Clauses)
    ]).

%% -- every place ----------------------------------------------------------------------------

-spec changes(term(), context()) -> [change()].
changes(Nodes, Context) when is_list(Nodes) ->
    [
        {Operator, At, with(N, New, Nodes)}
     || {N, Node} <- numbered(Nodes), {Operator, At, New} <- changes(Node, Context)
    ];
changes(Node, Context) when is_tuple(Node) ->
    own(Node, Context) ++
        [
            {Operator, At, setelement(Place, Node, New)}
         || {Place, Inner} <- parts(Node, Context),
            {Operator, At, New} <- changes(element(Place, Node), Inner)
        ];
changes(_Other, _Context) ->
    [].

%% The parts of a node that are mutated in turn, each with its context.
-spec parts(tuple(), context()) -> [{pos_integer(), context()}].
parts({clause, _, _, _, _}, _) ->
    [{3, pattern}, {4, guard}, {5, body}];
parts({match, _, _, _}, Context) ->
    [{3, pattern}, {4, Context}];
parts({Generate, _, _, _}, _) when
    Generate =:= generate;
    Generate =:= b_generate;
    Generate =:= generate_strict;
    Generate =:= b_generate_strict
->
    [{3, pattern}, {4, body}];
parts({'fun', _, {clauses, _}}, _) ->
    [{3, body}];
parts({clauses, _}, _) ->
    [{2, body}];
parts({named_fun, _, _, _}, _) ->
    [{4, body}];
parts(Node, Context) ->
    [{Place, Context} || Place <- places(Node)].

places(Node) when is_map_key({element(1, Node), tuple_size(Node)}, ?PLACES) ->
    map_get({element(1, Node), tuple_size(Node)}, ?PLACES);
places(Node) ->
    case lists:member(element(1, Node), ?LEAVES) of
        true -> [];
        false -> lists:seq(3, tuple_size(Node))
    end.

%% -- at one place ---------------------------------------------------------------------------

-spec own(tuple(), context()) -> [change()].
own({integer, A, N}, _) ->
    [{constant, A, {integer, A, N + 1}}] ++ [{constant, A, {integer, A, N - 1}} || N > 0];
own(_Node, pattern) ->
    [];
own(Node, _) ->
    datum(Node) ++ operation(Node) ++ branch(Node).

%% A value that is written down or built.
datum({float, A, X}) ->
    [{constant, A, {float, A, X + 1.0}}];
datum({atom, A, Truth}) when is_boolean(Truth) ->
    [{negate, A, {atom, A, not Truth}}];
datum({cons, A, _Head, Tail}) ->
    [{element, A, Tail}];
datum({map, A, Map, Fields}) ->
    [{field, At, updated({map, A, Map}, Map, Left)} || {At, Left} <- all_but_one(Fields)];
datum({record, A, Record, Name, Fields}) ->
    [{field, At, updated({record, A, Record, Name}, Record, L)} || {At, L} <- all_but_one(Fields)];
datum(_Node) ->
    [].

%% An operator, or a call.
operation({op, A, 'not', Operand}) ->
    [{negate, A, Operand}];
operation({op, A, Op, Left, Right}) ->
    operator(Op, A, Left, Right);
operation({call, A, {remote, At, {atom, _, Module} = M, {atom, F, Function}}, Args}) ->
    [
        {call, A, New}
     || New <- called({Module, Function, Args}, fun(Name) ->
            {call, A, {remote, At, M, {atom, F, Name}}, Args}
        end)
    ];
operation({call, A, {atom, F, Function}, [_, _] = Args}) when Function =:= max; Function =:= min ->
    [{call, A, {call, A, {atom, F, opposite(Function)}, Args}}];
operation(_Node) ->
    [].

%% What has clauses, a guard or a body.
branch({'case', A, Of, Clauses}) ->
    [{negate, A, {'case', A, negated(Of), Clauses}} || truth(Clauses), negatable(Of)] ++
        fewer(Clauses, fun(Left) -> {'case', A, Of, Left} end);
branch({'if', A, Clauses}) ->
    fewer(Clauses, fun(Left) -> {'if', A, Left} end);
branch({'receive', A, Clauses}) ->
    fewer(Clauses, fun(Left) -> {'receive', A, Left} end);
branch({'receive', A, Clauses, After, Body}) ->
    fewer(Clauses, fun(Left) -> {'receive', A, Left, After, Body} end);
branch({'fun', A, {clauses, Clauses}}) ->
    fewer(Clauses, fun(Left) -> {'fun', A, {clauses, Left}} end);
branch({named_fun, A, Name, Clauses}) ->
    fewer(Clauses, fun(Left) -> {named_fun, A, Name, Left} end);
branch({Comprehension, A, Template, Qualifiers}) when Comprehension =:= lc; Comprehension =:= bc ->
    [
        {guard, element(2, Filter), {Comprehension, A, Template, without(N, Qualifiers)}}
     || {N, Filter} <- numbered(Qualifiers), not generator(Filter)
    ];
branch({block, A, Body}) ->
    [{action, At, {block, A, Left}} || {At, Left} <- bodies(Body)];
branch({clause, A, Patterns, Guard, Body}) ->
    [{guard, At, {clause, A, Patterns, Left, Body}} || {At, Left} <- guards(Guard)] ++
        [{action, At, {clause, A, Patterns, Guard, Left}} || {At, Left} <- bodies(Body)];
branch(_Node) ->
    [].

operator(Op, A, Left, Right) ->
    [{compare, A, {op, A, New, Left, Right}} || New <- comparisons(Op)] ++
        [{arithmetic, A, {op, A, New, Left, Right}} || New <- arithmetic(Op)] ++
        condition(Op, A, Left, Right) ++ joined(Op, A, Left, Right).

%% Replaces a connective by one operand or by the other connective, or negates an operand.
condition(Op, A, Left, Right) when Op =:= 'andalso'; Op =:= 'orelse' ->
    [{guard, A, Left}, {guard, A, Right}, {negate, A, {op, A, opposite(Op), Left, Right}}] ++
        [{negate, A, {op, A, Op, negated(Left), Right}} || negatable(Left)] ++
        [{negate, A, {op, A, Op, Left, negated(Right)}} || negatable(Right)];
condition(_Op, _A, _Left, _Right) ->
    [].

joined('++', A, Left, Right) -> [{element, A, Left}, {element, A, Right}];
joined('--', A, Left, _Right) -> [{element, A, Left}];
joined(_Op, _A, _Left, _Right) -> [].

comparisons('=:=') -> ['=/='];
comparisons('=/=') -> ['=:='];
comparisons('==') -> ['/='];
comparisons('/=') -> ['=='];
comparisons('<') -> ['=<', '>='];
comparisons('=<') -> ['<', '>'];
comparisons('>') -> ['>=', '=<'];
comparisons('>=') -> ['>', '<'];
comparisons(_) -> [].

arithmetic('+') -> ['-'];
arithmetic('-') -> ['+'];
arithmetic('*') -> ['+'];
arithmetic('/') -> ['*'];
arithmetic('div') -> ['*', 'rem'];
arithmetic('rem') -> ['div'];
arithmetic('band') -> ['bor'];
arithmetic('bor') -> ['band'];
arithmetic('bxor') -> ['bor'];
arithmetic('bsl') -> ['bsr'];
arithmetic('bsr') -> ['bsl'];
arithmetic(_) -> [].

opposite('andalso') -> 'orelse';
opposite('orelse') -> 'andalso';
opposite(max) -> min;
opposite(min) -> max.

%% Replaces a library call by the collection that it should have changed.
called({lists, all, [_, _]}, Renamed) -> [Renamed(any)];
called({lists, any, [_, _]}, Renamed) -> [Renamed(all)];
called({lists, max, [_]}, Renamed) -> [Renamed(min)];
called({lists, min, [_]}, Renamed) -> [Renamed(max)];
called({maps, Function, Args}, _) -> map(Function, Args);
called({lists, Function, Args}, _) -> list(Function, Args);
called({Sets, Function, Args}, _) when Sets =:= sets; Sets =:= ordsets -> set(Function, Args);
called(_, _) -> [].

map(put, [_, _, Map]) -> [Map];
map(remove, [_, Map]) -> [Map];
map(without, [_, Map]) -> [Map];
map(merge, [Map, More]) -> [Map, More];
map(filter, [_, Map]) -> [Map];
map(_, _) -> [].

list(delete, [_, List]) -> [List];
list(keydelete, [_, _, List]) -> [List];
list(keystore, [_, _, List, _]) -> [List];
list(filter, [_, List]) -> [List];
list(Sorted, [List]) when Sorted =:= sort; Sorted =:= usort; Sorted =:= reverse -> [List];
list(_, _) -> [].

set(add_element, [_, Set]) -> [Set];
set(del_element, [_, Set]) -> [Set];
set(union, [Set, More]) -> [Set, More];
set(subtract, [Set, _]) -> [Set];
set(_, _) -> [].

%% -- clauses, guards, bodies ------------------------------------------------------------------

fewer([_], _Whole) ->
    [];
fewer(Clauses, Whole) ->
    [{clause, element(2, C), Whole(without(N, Clauses))} || {N, C} <- numbered(Clauses)].

%% A guard is a list of alternatives, each a list of tests.
guards([[Test]]) ->
    [{element(2, Test), []}];
guards(Guard) ->
    lists:append([
        [{element(2, hd(Tests)), without(N, Guard)} || length(Guard) > 1] ++
            [
                {element(2, Test), with(N, without(K, Tests), Guard)}
             || length(Tests) > 1, {K, Test} <- numbered(Tests)
            ]
     || {N, Tests} <- numbered(Guard)
    ]).

%% Removes an expression that is not the value of a body and binds no variable.
bodies(Body) ->
    [
        {element(2, Expression), without(N, Body)}
     || {N, Expression} <- numbered(lists:droplast(Body)), not binds(Expression)
    ].

binds({match, _, Pattern, _}) -> named(Pattern);
binds(_) -> false.

named({var, _, '_'}) -> false;
named({var, _, _}) -> true;
named(Node) when is_tuple(Node) -> named(tuple_to_list(Node));
named([Head | Tail]) -> named(Head) orelse named(Tail);
named(_) -> false.

truth(Clauses) ->
    lists:all(
        fun
            ({clause, _, [{atom, _, Truth}], [], _}) -> is_boolean(Truth);
            (_) -> false
        end,
        Clauses
    ).

%% Comparisons and connectives have their own operators.
negatable({call, _, _, _}) -> true;
negatable({var, _, _}) -> true;
negatable(_) -> false.

negated(Node) -> {op, element(2, Node), 'not', Node}.

generator(Qualifier) ->
    lists:member(element(1, Qualifier), [
        generate,
        b_generate,
        m_generate,
        zip,
        generate_strict,
        b_generate_strict,
        m_generate_strict
    ]).

all_but_one(Fields) -> [{element(2, Field), without(N, Fields)} || {N, Field} <- numbered(Fields)].

%% An update without fields is just the record or map.
updated(_Start, Whole, []) -> Whole;
updated(Start, _Whole, Fields) -> erlang:append_element(Start, Fields).

%% -- lists ------------------------------------------------------------------------------------

numbered(List) -> lists:zip(lists:seq(1, length(List)), List).

without(N, List) -> lists:sublist(List, N - 1) ++ lists:nthtail(N, List).

with(N, New, List) -> lists:sublist(List, N - 1) ++ [New | lists:nthtail(N, List)].
