%% @doc Finds what a mistyped name may have meant, for messages that end with `(did you mean mutex?)'.
-module(starl_similar).

-export([words/2, atoms/2, meant/2]).

%% @doc The known words that are similar to a mistyped one, most similar first.
-spec words(string(), [string()]) -> [string()].
words(Text, Known) ->
    Scored = [{distance(Text, Word), Word} || Word <- Known],
    [Word || {Edits, Word} <- lists:sort(Scored), Edits =< slips(length(Word))].

%% @doc The known names that are similar to a mistyped one, most similar first.
-spec atoms(Name :: term(), [atom()]) -> [atom()].
atoms(Name, Known) when is_atom(Name) ->
    Texts = [{atom_to_list(Atom), Atom} || Atom <- Known],
    [
        proplists:get_value(Text, Texts)
     || Text <- words(atom_to_list(Name), [Text || {Text, _} <- Texts])
    ];
atoms(_Name, _Known) ->
    [].

%% @doc The end of a message: the most similar name, in brackets, or else this text.
-spec meant(Similar :: [string() | atom()], Otherwise :: unicode:chardata()) -> unicode:chardata().
meant([Atom | _], _Otherwise) when is_atom(Atom) -> io_lib:format(" (did you mean ~tp?)", [Atom]);
meant([Word | _], _Otherwise) -> [" (did you mean ", Word, "?)"];
meant([], Otherwise) -> Otherwise.

%% The largest edit distance at which a word is recognized: half the length of a short word, a third
%% of a long one.
slips(Length) -> min((Length + 1) div 2, max(2, Length div 3)).

%% Levenshtein distance: the number of letters to insert, delete or change.
distance(From, To) ->
    Next = fun(Letter, [Left | Row]) -> [Left + 1 | edits(Letter, To, Left + 1, [Left | Row])] end,
    lists:last(lists:foldl(Next, lists:seq(0, length(To)), From)).

%% The rest of a row of the table, from the row above it.
edits(_Letter, [], _Before, [_]) ->
    [];
edits(Letter, [Letter | To], _Before, [Diagonal | Row]) ->
    [Diagonal | edits(Letter, To, Diagonal, Row)];
edits(Letter, [_ | To], Before, [Diagonal, Above | Row]) ->
    Least = 1 + lists:min([Before, Diagonal, Above]),
    [Least | edits(Letter, To, Least, [Above | Row])].
