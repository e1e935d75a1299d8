%% The type `event()' of a module, from its debugging information: the names of its events, and
%% whether a term is one of them, down to its last part.
-module(starl_event_type).

-export([names/2, is/3]).

%% The names (starl_event:name()) of the events of a type.
names(Module, Type) -> lists:usort(names(definition(Module, Type, []))).

names({Module, {type, _, union, Types}}) ->
    lists:append([names({Module, Type}) || Type <- Types]);
names({_, {type, _, none, []}}) ->
    [];
names({_, {atom, _, Tag}}) ->
    [{Tag, 0}];
names({_, {type, _, tuple, [{atom, _, Tag} | Parts]}}) ->
    [{Tag, length(Parts)}];
names({Module, Type}) ->
    names(resolved(Module, Type)).

%% Is the term of the type?
is(Term, Module, Type) ->
    {Where, Definition} = definition(Module, Type, []),
    of_type(Definition, Term, Where).

resolved(_, {remote_type, _, [{atom, _, Module}, {atom, _, Type}, Args]}) ->
    definition(Module, Type, Args);
resolved(Module, {user_type, _, Type, Args}) ->
    definition(Module, Type, Args).

%% What a type is defined as, and where.
definition(Module, Type, []) ->
    {Module, maps:get(Type, types(Module))}.

types(Module) ->
    case persistent_term:get({?MODULE, Module}, none) of
        none ->
            {ok, {Module, [{abstract_code, {_, Forms}}]}} =
                beam_lib:chunks(code:which(Module), [abstract_code]),
            Types = maps:from_list([
                {Name, Type}
             || {attribute, _, What, {Name, Type, []}} <- Forms,
                What =:= type orelse What =:= opaque
            ]),
            ok = persistent_term:put({?MODULE, Module}, Types),
            Types;
        Types ->
            Types
    end.

of_type({ann_type, _, [_, Type]}, Term, M) ->
    of_type(Type, Term, M);
of_type({type, _, union, Types}, Term, M) ->
    lists:any(fun(T) -> of_type(T, Term, M) end, Types);
of_type({type, _, tuple, any}, Term, _) ->
    is_tuple(Term);
of_type({type, _, tuple, Types}, Term, M) ->
    is_tuple(Term) andalso tuple_size(Term) =:= length(Types) andalso
        lists:all(
            fun({T, Part}) -> of_type(T, Part, M) end, lists:zip(Types, tuple_to_list(Term))
        );
of_type({type, _, List, [Type]}, Term, M) when List =:= list; List =:= nonempty_list ->
    is_list(Term) andalso (Term =/= [] orelse List =:= list) andalso
        lists:all(fun(Part) -> of_type(Type, Part, M) end, Term);
of_type({type, _, string, []}, Term, _) ->
    io_lib:printable_unicode_list(Term);
of_type({type, _, map, _}, Term, _) ->
    is_map(Term);
of_type({type, _, Any, []}, _, _) when Any =:= term; Any =:= any -> true;
of_type({type, _, none, []}, _, _) ->
    false;
of_type({type, _, pos_integer, []}, Term, _) ->
    is_integer(Term) andalso Term > 0;
of_type({type, _, non_neg_integer, []}, Term, _) ->
    is_integer(Term) andalso Term >= 0;
of_type({type, _, integer, []}, Term, _) ->
    is_integer(Term);
of_type({type, _, float, []}, Term, _) ->
    is_float(Term);
of_type({type, _, number, []}, Term, _) ->
    is_number(Term);
of_type({type, _, boolean, []}, Term, _) ->
    is_boolean(Term);
of_type({type, _, Atom, []}, Term, _) when Atom =:= atom; Atom =:= module -> is_atom(Term);
of_type({type, _, binary, _}, Term, _) ->
    is_binary(Term);
of_type({type, _, arity, []}, Term, _) ->
    is_integer(Term);
of_type({Kind, _, Value}, Term, _) when Kind =:= atom; Kind =:= integer -> Term =:= Value;
of_type(Named, Term, M) ->
    {Where, Type} = resolved(M, Named),
    of_type(Type, Term, Where).
