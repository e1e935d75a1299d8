%% @doc Checks the types and units of a predicate, and reports the column of each problem. The
%% result is in core terms: lengths are millimetres, durations microseconds, and each comparison has
%% its constant on the right.
-module(starl_debug_type).

-export([check/1, modes/0, robot_number/1, similar/2]).

-export_type([formula/0, robot/0, thing/0, quantity/0, state/0, area/0, reason/0]).

-type name() :: starl_debug_parser:name().
-type robot() :: starl:robot_id() | {var, name()}.
%% A token or an election as it is written; `any' of them.
-type thing() :: any | {token | election, name()} | {var, name()}.

%% The state of a robot by its own trace; `leader' by any election: by the last one that it has
%% entered; `last': the name of the last event of a machine.
-type state() ::
    {mode, name()}
    | {owner, thing()}
    | {leader, thing()}
    | coordinator
    | up
    | {last, Machine :: name(), Event :: name()}.

%% Lengths in mm.
-type area() :: {circle, starl_geometry:point(), number()} | {rectangle, starl_geometry:box()}.
-type place() :: {pos, robot()} | {point, starl_geometry:point()}.
-type quantity() :: {dist, place(), place()} | {x | y, robot()}.

-type formula() ::
    boolean()
    | {'and' | 'or', formula(), formula()}
    | {'not', formula()}
    | {exists | forall, [{kind(), name()}], formula()}
    | {count, name(), formula(), starl_debug_parser:comparison(), integer()}
    | {for, Us :: pos_integer(), formula()}
    | {within, Us :: pos_integer(), formula(), After :: formula()}
    | {'<' | '>', quantity(), Mm :: number()}
    | {state, robot(), state()}
    | {inside, robot(), area()}
    %% a message to an area has not reached a robot that was inside from its sending on for this time
    | {undelivered, Us :: pos_integer()}.

%% What a variable stands for.
-type kind() :: robot | token | election.

-type reason() :: starl_debug_parser:reason().
-type env() :: #{name() => kind()}.

-define(IS_COMPARISON(C),
    (C =:= '<' orelse C =:= '<=' orelse C =:= '>' orelse C =:= '>=' orelse C =:= '=' orelse
        C =:= '!=')
).
-define(MODES, [<<"moving">>, <<"waiting">>, <<"idle">>, <<"down">>]).
-define(FUNCTIONS, [
    <<"dist">>,
    <<"owner">>,
    <<"leader">>,
    <<"coordinator">>,
    <<"up">>,
    <<"inside">>,
    <<"last">>,
    <<"circle">>,
    <<"rectangle">>,
    <<"point">>
]).
-define(FIELDS, [<<"pos">>, <<"x">>, <<"y">>, <<"mode">>]).
-define(UNITS, [<<"mm">>, <<"cm">>, <<"m">>, <<"us">>, <<"ms">>, <<"s">>, <<"min">>]).
-define(LENGTHS, #{<<"mm">> => 1, <<"cm">> => 10, <<"m">> => 1000}).
-define(DURATIONS, #{<<"us">> => 1, <<"ms">> => 1000, <<"s">> => 1000000, <<"min">> => 60000000}).

%% @doc The modes of a robot.
-spec modes() -> [name()].
modes() -> ?MODES.

%% @doc Checks an expression.
-spec check(starl_debug_parser:expr()) -> {ok, formula()} | {error, reason()}.
check(Expr) ->
    try
        {ok, formula(Expr, 1, #{})}
    catch
        throw:{?MODULE, Reason} -> {error, Reason}
    end.

%% -- formulas -------------------------------------------------------------------------------

-spec formula(starl_debug_parser:expr(), pos_integer(), env()) -> formula().
formula({at, Column, Expr}, _At, Env) ->
    formula(Expr, Column, Env);
formula({Operator, A, B}, At, Env) when Operator =:= 'and'; Operator =:= 'or' ->
    {Operator, formula(A, At, Env), formula(B, At, Env)};
formula({'not', Expr}, At, Env) ->
    {'not', formula(Expr, At, Env)};
formula({Quantifier, Variables, Expr}, At, Env) when Quantifier =:= exists; Quantifier =:= forall ->
    Bound = [variable(V, At) || V <- Variables],
    {Quantifier, Bound, formula(Expr, At, bind(Bound, At, Env))};
formula({for, Expr, Duration}, At, Env) ->
    {for, duration(Duration, At, Env), formula(Expr, At, Env)};
formula({within, Expr, Duration, After}, At, Env) ->
    {within, duration(Duration, At, Env), formula(Expr, At, Env), formula(After, At, Env)};
formula({call, Name, Arguments}, At, Env) ->
    called(Name, Arguments, At, Env);
formula({name, <<"true">>}, _At, _Env) ->
    true;
formula({name, <<"false">>}, _At, _Env) ->
    false;
formula({name, Name}, At, Env) ->
    called(Name, [], At, Env);
formula({Comparison, Left, Right}, At, Env) when ?IS_COMPARISON(Comparison) ->
    compared(Comparison, operand(Left, At, Env), operand(Right, At, Env), At);
formula(_Other, At, _Env) ->
    fail(At, "something that is true or false is expected, such as dist(r1.pos, r2.pos) < 400 mm").

variable({Kind, Name}, At) -> {Kind, free(Name, At)};
variable(Name, At) -> {robot, free(Name, At)}.

free(Name, At) ->
    case robot_number(Name) of
        none -> Name;
        _ -> fail(At, [Name, " is a robot; give the variable another name"])
    end.

bind(Bound, At, Env) ->
    lists:foldl(
        fun
            ({_, Name}, E) when is_map_key(Name, E) -> fail(At, [Name, " has a meaning already"]);
            ({Kind, Name}, E) -> E#{Name => Kind}
        end,
        Env,
        Bound
    ).

called(<<"owner">>, [R, Token], At, Env) ->
    {state, robot(R, At, Env), {owner, thing(token, Token, At, Env)}};
called(<<"owner">>, [R], At, Env) ->
    {state, robot(R, At, Env), {owner, any}};
called(<<"leader">>, [R, Election], At, Env) ->
    {state, robot(R, At, Env), {leader, thing(election, Election, At, Env)}};
called(<<"leader">>, [R], At, Env) ->
    {state, robot(R, At, Env), {leader, any}};
called(<<"coordinator">>, [R], At, Env) ->
    {state, robot(R, At, Env), coordinator};
called(<<"up">>, [R], At, Env) ->
    {state, robot(R, At, Env), up};
called(<<"inside">>, [R, Area], At, Env) ->
    {inside, robot(R, At, Env), area(Area, At, Env)};
called(<<"undelivered">>, [Duration], At, Env) ->
    {undelivered, duration(Duration, At, Env)};
called(Name, Arguments, At, Env) ->
    case starl_debug_library:predicate(Name, Arguments) of
        {ok, Expr} ->
            formula(Expr, At, Env);
        unknown ->
            unknown(At, "no predicate is called ", Name, names());
        {error, Problem} ->
            fail(At, Problem)
    end.

names() -> ?FUNCTIONS ++ [Name || {Name, _, _, _} <- starl_debug_library:known()].

%% -- comparisons ----------------------------------------------------------------------------

compared(Comparison, {constant, _, _} = Left, {Kind, _} = Right, At) when Kind =/= word ->
    compared(mirrored(Comparison), Right, Left, At);
compared(Comparison, {length, Quantity}, {constant, length, Mm}, At) ->
    case Comparison of
        Less when Less =:= '<'; Less =:= '<=' -> {'<', Quantity, Mm};
        More when More =:= '>'; More =:= '>=' -> {'>', Quantity, Mm};
        _ -> fail(At, "two lengths are never quite equal; write < or >")
    end;
compared(Comparison, {count, {Variable, Formula}}, {constant, none, N}, _At) when is_integer(N) ->
    {count, Variable, Formula, Comparison, N};
compared(Comparison, {mode, R}, {word, Mode}, At) ->
    case lists:member(Mode, ?MODES) of
        true -> equal(Comparison, {state, R, {mode, Mode}}, At);
        false -> unknown(At, "no mode is called ", Mode, ?MODES)
    end;
compared(Comparison, {last, {R, Machine}}, {word, Event}, At) ->
    equal(Comparison, {state, R, {last, Machine, Event}}, At);
compared(_Comparison, {length, _}, {constant, none, _}, At) ->
    fail(At, "a length needs its unit: mm, cm or m");
compared(_Comparison, {length, _}, {length, _}, At) ->
    fail(At, "one side has to be a length that is given, such as 400 mm");
compared(_Comparison, Left, Right, At) ->
    fail(At, [kind(Left), " cannot be compared with ", kind(Right)]).

mirrored('<') -> '>';
mirrored('<=') -> '>=';
mirrored('>') -> '<';
mirrored('>=') -> '<=';
mirrored(Other) -> Other.

equal('=', Formula, _At) -> Formula;
equal('!=', Formula, _At) -> {'not', Formula};
equal(_, _Formula, At) -> fail(At, "modes and events are compared by = and !=").

kind({constant, length, _}) -> "a length";
kind({constant, duration, _}) -> "a duration";
kind({constant, none, _}) -> "a number";
kind({length, _}) -> "a length";
kind({count, _}) -> "a count";
kind({mode, _}) -> "a mode";
kind({last, _}) -> "an event";
kind({word, _}) -> "a name";
kind({place, _}) -> "a place".

%% -- operands -------------------------------------------------------------------------------

operand({at, Column, Expr}, _At, Env) ->
    operand(Expr, Column, Env);
operand({number, Number, Unit}, At, _Env) ->
    constant(Number, Unit, At);
operand({field, Name, Field}, At, Env) ->
    field(Field, Name, At, Env);
operand({call, <<"dist">>, [A, B]}, At, Env) ->
    {length, {dist, place(A, At, Env), place(B, At, Env)}};
operand({call, <<"point">>, [X, Y]}, At, Env) ->
    {place, {point, {len(X, At, Env), len(Y, At, Env)}}};
operand({call, <<"last">>, [R, Machine]}, At, Env) ->
    {last, {robot(R, At, Env), word(Machine, At)}};
operand({call, Name, _}, At, _Env) ->
    fail(At, [Name, " with these arguments is no value here"]);
operand({count, Variable, Expr}, At, Env) ->
    {robot, Name} = Bound = variable(Variable, At),
    {count, {Name, formula(Expr, At, bind([Bound], At, Env))}};
operand({name, Name}, _At, _Env) ->
    {word, Name};
operand({text, Text}, _At, _Env) ->
    {word, Text};
operand(_Other, At, _Env) ->
    fail(At, "a value is expected, such as dist(r1.pos, r2.pos) or r1.mode").

constant(Number, none, _At) ->
    {constant, none, Number};
constant(Number, Unit, At) ->
    case {?LENGTHS, ?DURATIONS} of
        {#{Unit := Mm}, _} -> {constant, length, Number * Mm};
        {_, #{Unit := Us}} -> {constant, duration, round(Number * Us)};
        _ -> unknown(At, "no unit is called ", Unit, ?UNITS)
    end.

field(<<"pos">>, Name, At, Env) -> {place, {pos, named(Name, At, Env)}};
field(<<"x">>, Name, At, Env) -> {length, {x, named(Name, At, Env)}};
field(<<"y">>, Name, At, Env) -> {length, {y, named(Name, At, Env)}};
field(<<"mode">>, Name, At, Env) -> {mode, named(Name, At, Env)};
field(Field, _, At, _) -> unknown(At, "a robot has no ", Field, ?FIELDS).

place({at, Column, Expr}, _At, Env) ->
    place(Expr, Column, Env);
place(Expr, At, Env) ->
    case operand(Expr, At, Env) of
        {place, Place} -> Place;
        {word, Name} -> fail(At, ["a place is expected; write ", Name, ".pos"]);
        _ -> fail(At, "a place is expected: r1.pos or point(1 m, 2 m)")
    end.

area({at, Column, Expr}, _At, Env) ->
    area(Expr, Column, Env);
area({call, <<"circle">>, [X, Y, R]}, At, Env) ->
    {circle, {len(X, At, Env), len(Y, At, Env)}, len(R, At, Env)};
area({call, <<"rectangle">>, [X0, Y0, X1, Y1]}, At, Env) ->
    {rectangle, {len(X0, At, Env), len(Y0, At, Env), len(X1, At, Env), len(Y1, At, Env)}};
area(_Other, At, _Env) ->
    fail(At, "an area is expected: circle(X, Y, RADIUS) or rectangle(X0, Y0, X1, Y1)").

len({at, Column, Expr}, _At, Env) ->
    len(Expr, Column, Env);
len(Expr, At, Env) ->
    case operand(Expr, At, Env) of
        {constant, length, Mm} -> float(Mm);
        {constant, none, N} when N == 0 -> 0.0;
        _ -> fail(At, "a length with its unit is expected, such as 400 mm")
    end.

duration({at, Column, Expr}, _At, Env) ->
    duration(Expr, Column, Env);
duration(Expr, At, Env) ->
    case operand(Expr, At, Env) of
        {constant, duration, Us} when Us > 0 -> Us;
        _ -> fail(At, "a duration with its unit is expected, such as 2 s")
    end.

robot({at, Column, Expr}, _At, Env) -> robot(Expr, Column, Env);
robot({name, Name}, At, Env) -> named(Name, At, Env);
robot({field, Name, <<"pos">>}, At, Env) -> named(Name, At, Env);
robot(_Other, At, _Env) -> fail(At, "a robot is expected, such as r1").

named(Name, At, Env) ->
    case {Env, robot_number(Name)} of
        {#{Name := robot}, _} ->
            {var, Name};
        {#{Name := Kind}, _} ->
            fail(At, [Name, " is ", a(Kind), ", not a robot"]);
        {_, none} ->
            fail(At, ["no robot is called ", Name, "; robots are r1, r2, ... or quantified"]);
        {_, N} ->
            N
    end.

thing(Kind, {at, Column, Expr}, _At, Env) ->
    thing(Kind, Expr, Column, Env);
thing(Kind, {text, Text}, _At, _Env) ->
    {Kind, Text};
thing(Kind, {name, Name}, At, Env) ->
    case Env of
        #{Name := Kind} -> {var, Name};
        #{Name := Other} -> fail(At, [Name, " is ", a(Other), ", not ", a(Kind)]);
        #{} -> {Kind, Name}
    end;
thing(Kind, {number, N, none}, _At, _Env) when is_integer(N) -> {Kind, integer_to_binary(N)};
thing(Kind, _Other, At, _Env) ->
    fail(At, ["the name of ", a(Kind), " is expected; others than words in quotes"]).

a(robot) -> "a robot";
a(token) -> "a token";
a(election) -> "an election".

word({at, Column, Expr}, _At) -> word(Expr, Column);
word({name, Name}, _At) -> Name;
word({text, Text}, _At) -> Text;
word(_Other, At) -> fail(At, "a name is expected").

%% @doc The number of a robot by its name, as in r1.
-spec robot_number(name()) -> starl:robot_id() | none.
robot_number(<<"r", Digits/binary>>) when Digits =/= <<>> ->
    try
        binary_to_integer(Digits)
    catch
        error:badarg -> none
    end;
robot_number(_Name) ->
    none.

%% @doc What may have been meant, in brackets.
-spec similar(name(), [name()]) -> unicode:chardata().
similar(Name, Known) ->
    Words = [unicode:characters_to_list(Word) || Word <- Known],
    starl_similar:meant(starl_similar:words(unicode:characters_to_list(Name), Words), "").

-spec unknown(pos_integer(), string(), name(), [name()]) -> no_return().
unknown(At, Problem, Name, Known) ->
    Near = similar(Name, Known),
    fail(At, [Problem, Name, Near, "; there are ", lists:join(", ", Known)]).

-spec fail(pos_integer(), unicode:chardata()) -> no_return().
fail(At, Problem) -> throw({?MODULE, {At, Problem}}).
