%% @doc Parses a predicate: a condition on several robots at one moment.
%% ```
%%   dist(r1.pos, r2.pos) < 400 mm
%%   owner(r1, lock) and owner(r2, lock)
%%   exists a, b, token t: owner(a, t) and owner(b, t)
%%   exists a, b, election e: leader(a, e) and leader(b, e)
%%   count(r: r.mode = moving) > 3
%%   (forall r: r.mode = waiting) for 2 s
%%   not (r2.mode = moving within 5 s after r1.mode = idle)
%% '''
%% `and' binds stronger than `or'; `for' and `within' bind stronger than both; a quantifier reaches
%% to the end. The result is an expression, plain Erlang data, which a program may also write
%% itself; the parser adds the column of each part. {@link starl_debug_type} says what has a
%% meaning.
-module(starl_debug_parser).

-export([parse/1]).

-export_type([expr/0, name/0, reason/0, comparison/0, variable/0]).

-type name() :: binary().

-type comparison() :: '<' | '<=' | '>' | '>=' | '=' | '!='.

%% It stands for a robot, for a token, or for an election.
-type variable() :: name() | {token | election, name()}.

%% What is written at a column; a quantifier; a number with its unit; a field of a robot; a call.
-type expr() ::
    {at, starl_debug_lexer:column(), expr()}
    | {'and' | 'or', expr(), expr()}
    | {'not', expr()}
    | {exists | forall, [variable(), ...], expr()}
    | {count, variable(), expr()}
    | {for, expr(), Duration :: expr()}
    | {within, expr(), Duration :: expr(), After :: expr()}
    | {comparison(), expr(), expr()}
    | {call, name(), [expr()]}
    | {field, name(), name()}
    | {name | text, name()}
    | {number, number(), Unit :: name() | none}.

-type reason() :: {starl_debug_lexer:column(), unicode:chardata()}.

-define(IS_COMPARISON(S),
    (S =:= <<"<">> orelse S =:= <<"<=">> orelse S =:= <<">">> orelse S =:= <<">=">> orelse
        S =:= <<"=">> orelse S =:= <<"!=">>)
).

%% @doc Reads a text.
-spec parse(unicode:chardata()) -> {ok, expr()} | {error, reason()}.
parse(Text) ->
    case starl_debug_lexer:tokens(Text) of
        {ok, []} -> {error, {1, "a predicate is expected"}};
        {ok, Tokens} -> whole(Tokens, ending(Text));
        {error, _} = Error -> Error
    end.

ending(Text) -> [{ended, 1 + length(unicode:characters_to_list(Text)), <<>>}].

whole(Tokens, End) ->
    try formula(Tokens ++ End) of
        {Expr, [{ended, _, _}]} ->
            {ok, Expr};
        {_, [Token | _]} ->
            {error, {column(Token), ["not understood from here on: ", shown(Token)]}}
    catch
        throw:{?MODULE, Reason} -> {error, Reason}
    end.

%% -- formulas -------------------------------------------------------------------------------

formula(Tokens) -> chain(<<"or">>, 'or', fun conjunction/1, Tokens).

conjunction(Tokens) -> chain(<<"and">>, 'and', fun lasting/1, Tokens).

chain(Word, Operator, Part, Tokens) ->
    {First, Rest} = Part(Tokens),
    chained(First, Word, Operator, Part, Rest).

chained(First, Word, Operator, Part, [{name, At, Word} | Tokens]) ->
    {Next, Rest} = Part(Tokens),
    chained({at, At, {Operator, First, Next}}, Word, Operator, Part, Rest);
chained(First, _Word, _Operator, _Part, Tokens) ->
    {First, Tokens}.

lasting(Tokens) ->
    {First, Rest} = single(Tokens),
    lasting(First, Rest).

lasting(First, [{name, At, <<"for">>} | Tokens]) ->
    {Duration, Rest} = operand(Tokens),
    lasting({at, At, {for, First, Duration}}, Rest);
lasting(First, [{name, At, <<"within">>} | Tokens]) ->
    {Duration, Behind} = operand(Tokens),
    {After, Rest} = single(expect(name, <<"after">>, Behind)),
    lasting({at, At, {within, First, Duration, After}}, Rest);
lasting(First, Tokens) ->
    {First, Tokens}.

single([{name, At, <<"not">>} | Tokens]) ->
    {Expr, Rest} = single(Tokens),
    {{at, At, {'not', Expr}}, Rest};
single([{name, At, Word} | Tokens]) when Word =:= <<"exists">>; Word =:= <<"forall">> ->
    {Variables, Behind} = variables(Tokens),
    {Expr, Rest} = formula(expect(sign, <<":">>, Behind)),
    {{at, At, {quantifier(Word), Variables, Expr}}, Rest};
single([{sign, _, <<"(">>} = Open | Tokens]) ->
    bracketed(formula(Tokens), Open);
single(Tokens) ->
    compared(operand(Tokens)).

quantifier(<<"exists">>) -> exists;
quantifier(<<"forall">>) -> forall.

bracketed({Expr, Tokens}, Open) ->
    case Tokens of
        [{sign, _, <<")">>} | Rest] ->
            {Expr, Rest};
        [Token | _] ->
            fail(Token, [") is expected for the bracket of column ", integer_to_list(column(Open))])
    end.

compared({Left, [{sign, At, Sign} | Tokens]}) when ?IS_COMPARISON(Sign) ->
    {Right, Rest} = operand(Tokens),
    {{at, At, {comparison(Sign), Left, Right}}, Rest};
compared(Operand) ->
    Operand.

comparison(<<"<">>) -> '<';
comparison(<<"<=">>) -> '<=';
comparison(<<">">>) -> '>';
comparison(<<">=">>) -> '>=';
comparison(<<"=">>) -> '=';
comparison(<<"!=">>) -> '!='.

variables(Tokens) ->
    {First, Rest} = variable(Tokens),
    case Rest of
        [{sign, _, <<",">>} | More] ->
            {Others, Behind} = variables(More),
            {[First | Others], Behind};
        _ ->
            {[First], Rest}
    end.

variable([{name, _, <<"token">>}, {name, _, Name} | Rest]) -> {{token, Name}, Rest};
variable([{name, _, <<"election">>}, {name, _, Name} | Rest]) -> {{election, Name}, Rest};
variable([{name, _, Name} | Rest]) -> {Name, Rest};
variable([Token | _]) -> fail(Token, "a name for a robot is expected").

%% -- operands -------------------------------------------------------------------------------

operand([{number, At, Number} | Tokens]) ->
    measured(At, Number, Tokens);
operand([{sign, At, <<"-">>}, {number, _, Number} | Tokens]) ->
    measured(At, -Number, Tokens);
operand([{text, At, Text} | Tokens]) ->
    {{at, At, {text, Text}}, Tokens};
operand([{name, At, <<"count">>}, {sign, _, <<"(">>} = Open | Tokens]) ->
    {Variable, Behind} = variable(Tokens),
    {Expr, Rest} = bracketed(formula(expect(sign, <<":">>, Behind)), Open),
    {{at, At, {count, Variable, Expr}}, Rest};
operand([{name, At, Name}, {sign, _, <<"(">>} = Open | Tokens]) ->
    {Arguments, Rest} = arguments(Tokens, Open),
    {{at, At, {call, Name, Arguments}}, Rest};
operand([{name, At, Name}, {sign, _, <<".">>}, {name, _, Field} | Tokens]) ->
    {{at, At, {field, Name, Field}}, Tokens};
operand([{name, At, Name} | Tokens]) ->
    {{at, At, {name, Name}}, Tokens};
operand([Token | _]) ->
    fail(Token, "a value is expected").

measured(At, Number, [{name, _, Unit} | Tokens]) when
    Unit =/= <<"and">>,
    Unit =/= <<"or">>,
    Unit =/= <<"for">>,
    Unit =/= <<"within">>,
    Unit =/= <<"after">>
->
    {{at, At, {number, Number, Unit}}, Tokens};
measured(At, Number, Tokens) ->
    {{at, At, {number, Number, none}}, Tokens}.

arguments([{sign, _, <<")">>} | Rest], _Open) ->
    {[], Rest};
arguments(Tokens, Open) ->
    {First, Rest} = operand(Tokens),
    more_arguments([First], Rest, Open).

more_arguments(Before, [{sign, _, <<",">>} | Tokens], Open) ->
    {Next, Rest} = operand(Tokens),
    more_arguments([Next | Before], Rest, Open);
more_arguments(Before, Tokens, Open) ->
    bracketed({lists:reverse(Before), Tokens}, Open).

%% -- problems -------------------------------------------------------------------------------

expect(Kind, Word, [{Kind, _, Word} | Rest]) -> Rest;
expect(_Kind, Word, [Token | _]) -> fail(Token, ["\"", Word, "\" is expected"]).

-spec fail(starl_debug_lexer:token() | {ended, pos_integer(), binary()}, unicode:chardata()) ->
    no_return().
fail({ended, At, _}, Problem) -> throw({?MODULE, {At, [Problem, ", and the text ends"]}});
fail(Token, Problem) -> throw({?MODULE, {column(Token), [Problem, ", not ", shown(Token)]}}).

column(Token) -> element(2, Token).

shown({number, _, Number}) -> io_lib:format("~w", [Number]);
shown({text, _, Text}) -> ["\"", Text, "\""];
shown({_, _, Word}) -> Word.
