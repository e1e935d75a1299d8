%% @doc Draws a sample of a block's mutants with a seed, from those that compile to different code.
%%
%% The name of a mutant is its function and a hash of the clause before and after. So the name stays
%% when other clauses or line numbers change. When the clause itself changes, its mutants get new
%% names and must be reviewed again.
-module(starl_mutate_sample).

-export([all/1, draw/3, only/2, stale/2, id/1]).

-export_type([candidate/0, drawn/0]).

-type candidate() :: #{
    source := starl_mutate_code:source(),
    before := starl_mutate_operators:form(),
    mutant := starl_mutate_operators:mutant()
}.

%% `id': its name; `code': its machine code.
-type drawn() :: #{id := string(), code := binary(), candidate := candidate()}.

%% @doc Every mutant of these sources, in the order of modules and lines. Functions named
%% `format_...' make text for people and are not mutated.
-spec all([starl_mutate_code:source()]) -> [candidate()].
all(Sources) ->
    [
        #{source => Source, before => Form, mutant => Mutant}
     || #{forms := Forms} = Source <- Sources,
        Form <- Forms,
        not is_text(Form),
        Mutant <- starl_mutate_operators:mutants(Form)
    ].

is_text({function, _, Name, _, _}) -> lists:prefix("format_", atom_to_list(Name));
is_text(_) -> false.

%% @doc Draws at most `Most' mutants with a seed. Gives also the number of candidates that did not
%% compile (`broken') and of those that compiled to the same code (`same').
-spec draw([candidate()], Most :: pos_integer() | infinity, Seed :: integer()) ->
    {[drawn()], #{broken := non_neg_integer(), same := non_neg_integer()}}.
draw(Candidates, Most, Seed) ->
    take(shuffled(Candidates, Seed), Most, [], #{broken => 0, same => 0}).

shuffled(List, Seed) ->
    {Keyed, _} = lists:mapfoldl(
        fun(Element, Rand0) ->
            {Key, Rand1} = rand:uniform_s(Rand0),
            {{Key, Element}, Rand1}
        end,
        rand:seed_s(exsss, Seed),
        List
    ),
    [Element || {_, Element} <- lists:keysort(1, Keyed)].

take(_Candidates, 0, Drawn, Left) ->
    {lists:reverse(Drawn), Left};
take([], _Most, Drawn, Left) ->
    {lists:reverse(Drawn), Left};
take([#{source := Source, mutant := #{form := Form}} = One | Others], Most, Drawn, Left) ->
    case starl_mutate_code:compiled(Form, Source) of
        {ok, Code} ->
            take(
                Others, less(Most), [#{id => id(One), code => Code, candidate => One} | Drawn], Left
            );
        Why ->
            take(Others, Most, Drawn, maps:update_with(Why, fun(N) -> N + 1 end, Left))
    end.

less(infinity) -> infinity;
less(Most) -> Most - 1.

%% @doc The mutants with this name; normally one.
-spec only([candidate()], string()) -> [candidate()].
only(Candidates, Id) -> [Candidate || Candidate <- Candidates, id(Candidate) =:= Id].

%% @doc Those of these names that no mutant has any more, though their module is among the sources.
-spec stale([candidate()], Names :: [string()]) -> [string()].
stale(Candidates, Names) ->
    Known = maps:from_keys([id(Candidate) || Candidate <- Candidates], []),
    Modules = maps:from_keys([atom_to_list(M) || #{source := #{module := M}} <- Candidates], []),
    [
        Name
     || Name <- Names,
        is_map_key(hd(string:split(Name, ":")), Modules),
        not is_map_key(Name, Known)
    ].

%% @doc The name of a mutant.
-spec id(candidate()) -> string().
id(#{source := #{module := Module}, before := Before, mutant := #{form := After} = Mutant}) ->
    {function, _, Name, Arity, Old} = Before,
    {function, _, Name, Arity, New} = After,
    #{operator := Operator, clause := N} = Mutant,
    Hash = erlang:phash2({Operator, bare(N, Old, Old), bare(N, New, Old)}, 1 bsl 32),
    lists:flatten(io_lib:format("~s:~s/~b-~8.16.0b", [Module, Name, Arity, Hash])).

%% A clause without its line numbers; `none' if the mutation removed it.
bare(_N, Clauses, Old) when length(Clauses) < length(Old) -> none;
bare(N, Clauses, _Old) -> erl_parse:map_anno(fun(_) -> 0 end, lists:nth(N, Clauses)).
