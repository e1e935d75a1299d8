%% @doc Finds the kinds of messages that a machine accepts, each with the shapes of its parts ({@link
%% starl_shape}).
%%
%% Nobody lists them. The clauses of the machine's `accepts/2' give the outlines of bodies. `accepts/2' is
%% then asked about each of them, with marks in place of unknown parts, and calls to {@link starl_shape:is/2}
%% are traced: they say which shape a mark should have. This is repeated until the body is accepted. So a new
%% kind of message is found without a change here.
-module(starl_dev_insider_kinds).

-export([of_machine/1, is_listener/1]).

-export_type([kind/0, body/0]).

%% A body: a given term, a tuple of parts, or any term of a shape.
-type body() :: {is, term()} | {tuple, [body()]} | {shape, starl_shape:t()}.

-type kind() :: {starl_packet:type(), body()}.

%% A body in which some shapes are unknown yet.
-type outline() :: body() | {hole, pos_integer()} | {tuple, [outline()]}.

%% Questions about one body.
-define(MOST_STEPS, 20).
-define(WAIT_MS, 10000).

%% @doc The kinds that a machine accepts, and the clauses of its `accepts/2' for which none was found. Nobody
%% knows what a machine without this function takes.
-spec of_machine(module()) -> {[kind()], Unsolved :: [{module(), Line :: pos_integer()}]}.
of_machine(Module) ->
    %% calls are traced only in loaded code
    ok = code:ensure_modules_loaded([Module, starl_shape]),
    case starl_callback:exported(Module, accepts, 2) of
        true -> found(Module, clauses(Module));
        false -> {[], [{Module, 1}]}
    end.

%% @doc Does a machine take messages?
-spec is_listener(module()) -> boolean().
is_listener(Module) ->
    {ok, {Module, [{imports, Calls}]}} = beam_lib:chunks(code:which(Module), [imports]),
    starl_callback:exported(Module, accepts, 2) orelse lists:member({starl_sap, listen, 2}, Calls).

found(Module, Clauses) ->
    Asker = asker(),
    Found = [{Where, kinds(Module, Clause, Asker)} || {Where, Clause} <- Clauses],
    ended(Asker),
    Kinds = lists:usort(lists:append([Kinds || {_, Kinds} <- Found])),
    {without_variants(Kinds), [Where || {Where, []} <- Found]}.

%% What a body of any outline covers is left out.
without_variants(Kinds) ->
    General = [Type || {Type, {shape, _}} <- Kinds],
    [
        Kind
     || {Type, Body} = Kind <- Kinds,
        element(1, Body) =:= shape orelse not lists:member(Type, General)
    ].

kinds(Module, {Types, Outlines}, Asker) ->
    [
        {Type, Solved}
     || Type <- Types, Outline <- Outlines, {ok, Solved} <- [solved(Module, Type, Outline, Asker)]
    ].

%% -- outlines of bodies ---------------------------------------------------------------------

%% Each clause that may accept something, with the types and the outlines that it may be for.
clauses(Module) ->
    Forms = forms(Module),
    [Function | _] = [Cs || {function, _, accepts, 2, Cs} <- Forms],
    lists:append([clause(Clause, Module, Forms) || Clause <- Function]).

clause({clause, _, _, _, [{atom, _, false}]}, _Module, _Forms) ->
    [];
clause({clause, Place, [Type, Body], _Guards, Exprs} = Clause, Module, Forms) ->
    case [Other || {remote, _, {atom, _, Other}, {atom, _, accepts}} <- terms(Exprs)] of
        [Other | _] ->
            clauses(Other);
        [] ->
            Atoms = lists:usort([Atom || {atom, _, Atom} <- terms(Clause)]),
            Where = {Module, erl_anno:line(Place)},
            [{Where, {types(Type, Atoms), outlines(Body, Forms)}}]
    end.

types({atom, _, Type}, _Atoms) -> [Type];
types(_Any, Atoms) -> Atoms.

%% A clause for any body may ask for its first element in another function.
outlines({tuple, _, _} = Pattern, _Forms) ->
    [numbered(outline(Pattern))];
outlines({match, _, One, Other}, Forms) ->
    outlines(hd([P || P <- [One, Other], element(1, P) =/= var]), Forms);
outlines(_Variable, Forms) ->
    Atoms = lists:usort([
        Atom
     || {function, _, _, 1, Clauses} <- Forms,
        {clause, _, [Head], _, _} = Clause <- Clauses,
        {atom, _, Atom} <- terms({Head, element(4, Clause)})
    ]),
    [{hole, 1} | [{tuple, [{is, Atom}]} || Atom <- Atoms]].

outline({atom, _, Atom}) -> {is, Atom};
outline({integer, _, N}) -> {is, N};
outline({nil, _}) -> {is, []};
outline({tuple, _, Parts}) -> {tuple, [outline(Part) || Part <- Parts]};
outline({match, _, {var, _, _}, Pattern}) -> outline(Pattern);
outline({match, _, Pattern, {var, _, _}}) -> outline(Pattern);
outline(_Other) -> hole.

numbered(Outline) ->
    {Numbered, _} = numbered(Outline, 1),
    Numbered.

numbered(hole, N) ->
    {{hole, N}, N + 1};
numbered({tuple, Parts}, N) ->
    {Numbered, Next} = lists:mapfoldl(fun numbered/2, N, Parts),
    {{tuple, Numbered}, Next};
numbered(Known, N) ->
    {Known, N}.

forms(Module) ->
    case beam_lib:chunks(code:which(Module), [abstract_code]) of
        {ok, {Module, [{abstract_code, {_, Forms}}]}} -> Forms;
        _ -> error({no_abstract_code, Module})
    end.

%% All tuples in a term, at any depth.
terms(Term) when is_tuple(Term) -> [Term | terms(tuple_to_list(Term))];
terms([Head | Tail]) -> terms(Head) ++ terms(Tail);
terms(_) -> [].

%% -- questions ------------------------------------------------------------------------------

-spec solved(module(), starl_packet:type(), outline(), pid()) -> {ok, body()} | none.
solved(Module, Type, Outline, Asker) -> solved(?MOST_STEPS, Module, Type, Outline, Asker).

solved(0, _Module, _Type, _Outline, _Asker) ->
    none;
solved(Left, Module, Type, Outline, Asker) ->
    Body = instance(Outline),
    case asked(Asker, Module, Type, Body) of
        {true, _Calls} ->
            {ok, filled(Outline)};
        {_, Calls} ->
            case lists:foldl(fun(Call, O) -> learned(Call, Body, O) end, Outline, Calls) of
                Outline -> none;
                More -> solved(Left - 1, Module, Type, More, Asker)
            end
    end.

instance({hole, N}) -> mark(N);
instance({is, Term}) -> Term;
instance({shape, Shape}) -> sample(Shape);
instance({tuple, Parts}) -> list_to_tuple([instance(Part) || Part <- Parts]).

mark(N) -> <<"part-", N>>.

%% Nobody has asked about what is left.
filled({hole, _}) -> {shape, any};
filled({tuple, Parts}) -> {tuple, [filled(Part) || Part <- Parts]};
filled(Known) -> Known.

%% The whole body should have this shape: of its outline only the first element was known.
learned({Shape, Body}, Body, {tuple, [{is, _} = Head]}) when is_list(Shape), length(Shape) > 1 ->
    {tuple, [Head | [{shape, Part} || Part <- tl(Shape)]]};
learned({Shape, Term}, _Body, Outline) ->
    put_shapes(bound(Shape, Term, #{}), Outline).

put_shapes(Shapes, {hole, N}) when is_map_key(N, Shapes) -> {shape, maps:get(N, Shapes)};
put_shapes(Shapes, {tuple, Parts}) -> {tuple, [put_shapes(Shapes, Part) || Part <- Parts]};
put_shapes(_Shapes, Known) -> Known.

%% The shapes of the marks in a term that should have a shape.
bound(Shape, <<"part-", N>>, Shapes) ->
    Shapes#{N => Shape};
bound(Parts, Term, Shapes) when is_list(Parts), length(Parts) =:= tuple_size(Term) ->
    Pairs = lists:zip(Parts, tuple_to_list(Term)),
    lists:foldl(fun({Part, Element}, Known) -> bound(Part, Element, Known) end, Shapes, Pairs);
bound({either, Alternatives}, Term, Shapes) ->
    lists:foldr(fun(Shape, Known) -> bound(Shape, Term, Known) end, Shapes, Alternatives);
bound(_Shape, _Term, Shapes) ->
    Shapes.

%% A small term of a shape.
-spec sample(starl_shape:t()) -> term().
sample(any) -> <<"any">>;
sample(atom) -> any;
sample(boolean) -> true;
sample(mm) -> 1.0;
sample(point) -> {1.0, 1.0};
sample({is, Value}) -> Value;
sample({either, [Shape | _]}) -> sample(Shape);
sample({list, _}) -> [];
sample(Parts) when is_list(Parts) -> list_to_tuple([sample(Part) || Part <- Parts]);
sample(_Number) -> 1.

%% -- the process that asks ------------------------------------------------------------------

%% Only its calls are traced.
asker() ->
    Asker = spawn_link(fun answer/0),
    _ = erlang:trace_pattern({starl_shape, is, 2}, true, [global]),
    1 = erlang:trace(Asker, true, [call, {tracer, self()}]),
    Asker.

ended(Asker) ->
    _ = erlang:trace_pattern({starl_shape, is, 2}, false, [global]),
    true = unlink(Asker),
    true = exit(Asker, kill),
    ok.

answer() ->
    receive
        {ask, From, Module, Type, Body} ->
            Answer =
                try
                    Module:accepts(Type, Body)
                catch
                    _:_ -> crashed
                end,
            From ! {answer, self(), Answer},
            answer()
    end.

asked(Asker, Module, Type, Body) ->
    Asker ! {ask, self(), Module, Type, Body},
    receive
        {answer, Asker, Answer} ->
            Delivered = erlang:trace_delivered(Asker),
            receive
                {trace_delivered, Asker, Delivered} -> {Answer, calls(Asker)}
            end
    after ?WAIT_MS -> error({no_answer, Module, Type, Body})
    end.

calls(Asker) ->
    receive
        {trace, Asker, call, {starl_shape, is, [Shape, Term]}} -> [{Shape, Term} | calls(Asker)]
    after 0 -> []
    end.
