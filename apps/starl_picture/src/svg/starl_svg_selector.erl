%% @doc Selectors of CSS: parses lists of them, and matches them with elements (Selectors 3). A part
%% of the SVG reader, {@link starl_svg}.
%%
%% Known are types, `*', classes, identifiers and `:root', and their combinations as descendants and
%% children. Other selectors match nothing, which for `:hover' and its like is what a still picture
%% needs.
-module(starl_svg_selector).

-export([parse/1, specificity/1, key/1, matches/2]).
-export_type([t/0, key/0, node_/0]).

-type specificity() :: {Ids :: non_neg_integer(), Classes :: non_neg_integer(), non_neg_integer()}.
-record(compound, {
    type = any :: any | binary(),
    ids = [] :: [binary()],
    classes = [] :: [binary()],
    %% Only the outermost element matches `:root'.
    root = false :: boolean()
}).
%% Innermost first, each with its relation to the next one outwards.
-opaque t() :: [{#compound{}, child | descendant}, ...].
%% The rarest thing that an element must have to be matched.
-type key() :: {id | class | type, binary()} | any.
%% An element: name, identifier, classes.
-type node_() :: {Name :: binary(), Id :: binary() | none, Classes :: [binary()]}.

-define(NAME, "[^][\\s.#:>+~,()*|\\\\\"'=]+").
-define(MAX_COMPOUNDS, 16).

%% @doc The selectors of a list that can match something.
-spec parse(binary()) -> [t()].
parse(Text) ->
    lists:append([selector(Part) || Part <- binary:split(Text, <<",">>, [global])]).

%% @doc The specificity: the higher one wins.
-spec specificity(t()) -> specificity().
specificity(Selector) ->
    Compounds = [Compound || {Compound, _} <- Selector],
    Pseudo = length([root || #compound{root = true} <- Compounds]),
    {
        lists:sum([length(Ids) || #compound{ids = Ids} <- Compounds]),
        Pseudo + lists:sum([length(Classes) || #compound{classes = Classes} <- Compounds]),
        length([Type || #compound{type = Type} <- Compounds, Type =/= any])
    }.

%% @doc A key under which to file the selector; an element that it matches has this key.
-spec key(t()) -> key().
key([{#compound{ids = [Id | _]}, _} | _]) -> {id, Id};
key([{#compound{classes = [Class | _]}, _} | _]) -> {class, Class};
key([{#compound{type = any}, _} | _]) -> any;
key([{#compound{type = Type}, _} | _]) -> {type, Type}.

%% @doc Whether a selector matches an element, given with its ancestors, nearest first.
-spec matches(t(), [node_(), ...]) -> boolean().
matches([{Compound, Relation} | Outer], [Node | Ancestors]) ->
    fits(Compound, Node, Ancestors) andalso outside(Relation, Outer, Ancestors).

%%% Internals

selector(Text) ->
    Spaced = re:replace(Text, <<"\\s*>\\s*">>, <<" > ">>, [global, {return, binary}]),
    Parts = re:split(string:trim(Spaced), <<"\\s+">>),
    case chain(Parts, descendant, []) of
        Chain when is_list(Chain), length(Chain) =< ?MAX_COMPOUNDS -> [Chain];
        _ -> []
    end.

%% The relation of a compound to the one before it, which lies outside of it.
chain([<<">">> | Parts], descendant, [_ | _] = Chain) ->
    chain(Parts, child, Chain);
chain([Part | Parts], Relation, Chain) ->
    case compound(Part) of
        {ok, Compound} -> chain(Parts, descendant, [{Compound, Relation} | Chain]);
        error -> error
    end;
chain([], descendant, Chain) ->
    Chain;
chain([], child, _Chain) ->
    error.

compound(Text) ->
    Pattern = <<"^(\\*|" ?NAME ")?((?:[.#]" ?NAME ")*)(:root)?$">>,
    case re:run(Text, Pattern, [{capture, [1, 2, 3], binary}]) of
        {match, [<<>>, <<>>, <<>>]} -> error;
        {match, [Type, Marks, Root]} -> {ok, compound(Type, Marks, Root =/= <<>>)};
        nomatch -> error
    end.

compound(Type, Marks, Root) ->
    Named = [
        {Sign, Name}
     || [<<Sign, Name/binary>>] <- matched(
            re:run(Marks, <<"[.#]" ?NAME>>, [global, {capture, first, binary}])
        )
    ],
    #compound{
        type = type(Type),
        ids = [Id || {$#, Id} <- Named],
        classes = [Class || {$., Class} <- Named],
        root = Root
    }.

matched({match, Found}) -> Found;
matched(nomatch) -> [].

type(<<>>) -> any;
type(<<"*">>) -> any;
type(Name) -> Name.

outside(_Relation, [], _Ancestors) ->
    true;
outside(_Relation, _Outer, []) ->
    false;
outside(child, Outer, Ancestors) ->
    matches(Outer, Ancestors);
outside(descendant, Outer, [_ | Further] = Ancestors) ->
    matches(Outer, Ancestors) orelse outside(descendant, Outer, Further).

fits(#compound{type = Type, ids = Ids, classes = Classes, root = Root}, Node, Ancestors) ->
    {Name, Id, Own} = Node,
    (Type =:= any orelse Type =:= Name) andalso
        lists:all(fun(Wanted) -> Wanted =:= Id end, Ids) andalso
        lists:all(fun(Class) -> lists:member(Class, Own) end, Classes) andalso
        (not Root orelse Ancestors =:= []).
