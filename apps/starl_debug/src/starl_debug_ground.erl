%% @doc A predicate for the robots of one recording, without quantifiers. Negation occurs only in
%% parts that concern a single robot.
%%
%% A part that concerns one robot alone is `local', whatever its composition, because its times are
%% known exactly by the robot's own clock. All other parts relate several robots.
-module(starl_debug_ground).

-export([formula/2, robots/1, look_back_us/1]).

-export_type([t/0, local/0, known/0]).

-type us() :: pos_integer().

%% What is true of one robot by its own clock; `near', `left' and `below': its distance from a point
%% and its coordinates are smaller than that (mm); `between': it is one of these times.
-type local() ::
    boolean()
    | {state, starl_debug_type:state()}
    | {near, starl_geometry:point(), number()}
    | {left | below, number()}
    | {inside, starl_debug_type:area()}
    | {between, FromUs :: integer(), ToUs :: integer()}
    | starl_debug_state:geocast()
    | {'not', local()}
    | {'and' | 'or', [local()]}
    | {held | once | ago, us(), local()}.

%% `held': throughout the last so many microseconds; `once': at some moment of them; `ago': before
%% them.
%% `at_least': so many of these are true.
-type t() ::
    boolean()
    | {local, starl:robot_id(), local()}
    | {'<' | '>', starl:robot_id(), starl:robot_id(), Mm :: number()}
    | {'and' | 'or', [t()]}
    | {at_least, pos_integer(), [t()]}
    | {held | once | ago, us(), t()}.

%% What a recording knows: its robots, the tokens that were held, the elections that were decided,
%% and the messages to areas.
-type known() :: #{
    robots := [starl:robot_id()],
    tokens := [starl_debug_parser:name()],
    elections := [starl_debug_parser:name()],
    geocasts := [starl_debug_state:cast()]
}.

%% A violation by a single moment could not be certain: clocks are never known to the microsecond.
-define(AROUND_US, 100000).

%% @doc The predicate for these robots.
-spec formula(starl_debug_type:formula(), known()) -> t().
formula(Formula, Known) -> ground(Formula, #{}, Known).

ground(Bool, _Env, _Known) when is_boolean(Bool) -> Bool;
ground({Operator, A, B}, Env, Known) when Operator =:= 'and'; Operator =:= 'or' ->
    joined(Operator, [ground(A, Env, Known), ground(B, Env, Known)]);
ground({'not', A}, Env, Known) ->
    negated(ground(A, Env, Known));
ground({exists, Variables, A}, Env, Known) ->
    joined('or', [ground(A, E, Known) || E <- bindings(Variables, Env, Known)]);
ground({forall, Variables, A}, Env, Known) ->
    joined('and', [ground(A, E, Known) || E <- bindings(Variables, Env, Known)]);
ground({count, Name, A, Comparison, N}, Env, Known) ->
    counted(Comparison, N, [ground(A, E, Known) || E <- bindings([{robot, Name}], Env, Known)]);
ground({for, Us, A}, Env, Known) ->
    lasting(held, Us, ground(A, Env, Known));
ground({within, Us, A, After}, Env, Known) ->
    joined('or', [
        lasting(ago, Us, negated(ground(After, Env, Known))),
        lasting(once, Us, ground(A, Env, Known))
    ]);
ground({state, R, State}, Env, _Known) ->
    {local, bound(R, Env), {state, thing(State, Env)}};
ground({inside, R, Area}, Env, _Known) ->
    {local, bound(R, Env), {inside, Area}};
ground({undelivered, Us}, _Env, #{robots := Robots, geocasts := Casts}) ->
    joined('or', [
        undelivered(Us, Cast, R)
     || #{source := Source, lifetime := Lifetime} = Cast <- Casts,
        Lifetime >= Us,
        R <- Robots,
        %% the source need not have its own message
        R =/= Source
    ]);
ground({Comparison, Quantity, Mm}, Env, _Known) when Comparison =:= '<'; Comparison =:= '>' ->
    measured(Comparison, Quantity, Mm, Env).

%% Different variables are different robots.
bindings([], Env, _Known) ->
    [Env];
bindings([{robot, Name} | Variables], Env, #{robots := Robots} = Known) ->
    Taken = [R || R <- maps:values(Env), is_integer(R)],
    [E || R <- Robots -- Taken, E <- bindings(Variables, Env#{Name => R}, Known)];
bindings([{token, Name} | Variables], Env, #{tokens := Tokens} = Known) ->
    [E || T <- Tokens, E <- bindings(Variables, Env#{Name => {token, T}}, Known)];
bindings([{election, Name} | Variables], Env, #{elections := Elections} = Known) ->
    [E || T <- Elections, E <- bindings(Variables, Env#{Name => {election, T}}, Known)].

bound({var, Name}, Env) -> maps:get(Name, Env);
bound(R, _Env) -> R.

thing({What, {var, Name}}, Env) -> {What, maps:get(Name, Env)};
thing(State, _Env) -> State.

measured(Comparison, {x, R}, Mm, Env) ->
    sided(Comparison, bound(R, Env), {left, Mm});
measured(Comparison, {y, R}, Mm, Env) ->
    sided(Comparison, bound(R, Env), {below, Mm});
measured(Comparison, {dist, {pos, A}, {point, P}}, Mm, Env) ->
    sided(Comparison, bound(A, Env), {near, P, Mm});
measured(Comparison, {dist, {point, _} = P, {pos, _} = A}, Mm, Env) ->
    measured(Comparison, {dist, A, P}, Mm, Env);
measured(Comparison, {dist, {point, P}, {point, Q}}, Mm, _Env) ->
    compare(Comparison, starl_geometry:distance(P, Q), Mm);
measured(Comparison, {dist, {pos, A}, {pos, B}}, Mm, Env) ->
    case lists:sort([bound(A, Env), bound(B, Env)]) of
        [R, R] -> compare(Comparison, 0, Mm);
        [R, Q] -> {Comparison, R, Q, Mm}
    end.

sided('<', R, Local) -> {local, R, Local};
sided('>', R, Local) -> {local, R, {'not', Local}}.

compare('<', A, B) -> A < B;
compare('>', A, B) -> A > B.

%% From the sending on the robot was inside for that time, the message lived, and neither the robot
%% nor the source began anew. A robot that comes later is owed nothing.
undelivered(Us, #{id := Id, source := Source, at := At, area := Area}, R) ->
    Here = {'and', [{inside, Area}, {'not', {delivered, Id}}, serves]},
    Then = {between, At + Us, At + Us + ?AROUND_US},
    joined('and', [
        {local, R, {held, Us + ?AROUND_US, Here}},
        {local, Source, {'and', [Then, {held, Us, serves}]}}
    ]).

%% -- operators ------------------------------------------------------------------------------

counted('>', N, Parts) -> at_least(N + 1, Parts);
counted('>=', N, Parts) -> at_least(N, Parts);
counted('<', N, Parts) -> negated(at_least(N, Parts));
counted('<=', N, Parts) -> negated(at_least(N + 1, Parts));
counted('=', N, Parts) -> joined('and', [at_least(N, Parts), negated(at_least(N + 1, Parts))]);
counted('!=', N, Parts) -> negated(counted('=', N, Parts)).

at_least(K, _Parts) when K =< 0 -> true;
at_least(1, Parts) -> joined('or', Parts);
at_least(K, Parts) when K > length(Parts) -> false;
at_least(K, Parts) when K =:= length(Parts) -> joined('and', Parts);
at_least(K, Parts) -> {at_least, K, Parts}.

%% The contrary.
-spec negated(t()) -> t().
negated(Bool) when is_boolean(Bool) -> not Bool;
negated({local, R, {'not', Local}}) -> {local, R, Local};
negated({local, R, Local}) -> {local, R, {'not', Local}};
negated({'<', R, Q, Mm}) -> {'>', R, Q, Mm};
negated({'>', R, Q, Mm}) -> {'<', R, Q, Mm};
negated({'and', Parts}) -> joined('or', [negated(P) || P <- Parts]);
negated({'or', Parts}) -> joined('and', [negated(P) || P <- Parts]);
negated({at_least, K, Parts}) -> at_least(length(Parts) - K + 1, [negated(P) || P <- Parts]);
negated({held, Us, A}) -> lasting(once, Us, negated(A));
negated({once, Us, A}) -> lasting(held, Us, negated(A));
negated({ago, Us, A}) -> lasting(ago, Us, negated(A)).

%% What lasts is true of all parts of an `and' alike, what was once of some part of an `or'.
lasting(_How, _Us, Bool) when is_boolean(Bool) -> Bool;
lasting(How, Us, {local, R, Local}) ->
    {local, R, {How, Us, Local}};
lasting(How, Us, {'and', Parts}) when How =/= once ->
    joined('and', [lasting(How, Us, P) || P <- Parts]);
lasting(How, Us, {'or', Parts}) when How =/= held ->
    joined('or', [lasting(How, Us, P) || P <- Parts]);
lasting(How, Us, A) ->
    {How, Us, A}.

%% The parts of one robot become one.
joined(Operator, Parts) ->
    Flat = lists:flatmap(fun(P) -> parts(Operator, P) end, Parts),
    {Locals, Others} = lists:partition(
        fun(P) -> is_tuple(P) andalso element(1, P) =:= local end, Flat
    ),
    Own = lists:foldl(
        fun({local, R, L}, Acc) -> maps:update_with(R, fun(Ls) -> [L | Ls] end, [L], Acc) end,
        #{},
        Locals
    ),
    Merged = [
        {local, R, one(Operator, lists:usort(Ls))}
     || {R, Ls} <- lists:sort(maps:to_list(Own))
    ],
    Neutral = Operator =:= 'and',
    case lists:member(not Neutral, Others) of
        true -> not Neutral;
        false -> composed(Operator, Merged ++ lists:usort([P || P <- Others, P =/= Neutral]))
    end.

%% An `or' keeps its alternatives apart, since each is decided by itself.
parts(Operator, {Operator, Parts}) -> Parts;
parts(_Operator, Part) -> [Part].

one(_Operator, [Local]) -> Local;
one(Operator, Locals) -> {Operator, Locals}.

composed('and', []) -> true;
composed('or', []) -> false;
composed(_Operator, [Part]) -> Part;
composed(Operator, Parts) -> {Operator, Parts}.

%% -- figures --------------------------------------------------------------------------------

%% @doc The robots that a predicate speaks of.
-spec robots(t()) -> [starl:robot_id()].
robots(Formula) -> lists:usort(named(Formula)).

named(Bool) when is_boolean(Bool) -> [];
named({local, R, _}) ->
    [R];
named({Comparison, R, Q, _}) when Comparison =:= '<'; Comparison =:= '>' -> [R, Q];
named({Operator, Parts}) when Operator =:= 'and'; Operator =:= 'or' ->
    lists:flatmap(fun named/1, Parts);
named({at_least, _, Parts}) ->
    lists:flatmap(fun named/1, Parts);
named({_Lasting, _Us, A}) ->
    named(A).

%% @doc The time before a moment that the truth at that moment depends on.
-spec look_back_us(t()) -> non_neg_integer().
look_back_us(Formula) -> look_back_us(Formula, 0).

look_back_us({Operator, Parts}, Us) when Operator =:= 'and'; Operator =:= 'or' ->
    lists:max([look_back_us(P, Us) || P <- Parts]);
look_back_us({at_least, _, Parts}, Us) ->
    lists:max([look_back_us(P, Us) || P <- Parts]);
look_back_us({How, More, A}, Us) when
    How =:= held orelse How =:= once orelse How =:= ago, is_integer(More), is_integer(Us)
->
    look_back_us(A, Us + More);
look_back_us(_Other, Us) ->
    Us.
