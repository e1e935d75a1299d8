%% @doc Divides the text of a predicate into tokens, each with its column, counted from 1.
-module(starl_debug_lexer).

-export([tokens/1]).

-export_type([token/0, column/0]).

-type column() :: pos_integer().

%% A name; a text in quotes; a number; a sign or an operator.
-type token() ::
    {name | text, column(), binary()}
    | {number, column(), number()}
    | {sign, column(), binary()}.

-define(IS_DIGIT(C), (C >= $0 andalso C =< $9)).
-define(IS_LETTER(C),
    ((C >= $a andalso C =< $z) orelse (C >= $A andalso C =< $Z) orelse C =:= $_)
).

%% @doc The tokens of a text.
-spec tokens(unicode:chardata()) -> {ok, [token()]} | {error, {column(), unicode:chardata()}}.
tokens(Text) ->
    case unicode:characters_to_list(Text) of
        Chars when is_list(Chars) -> scan(Chars, 1, []);
        _ -> {error, {1, "this is no text"}}
    end.

scan([], _At, Tokens) ->
    {ok, lists:reverse(Tokens)};
scan([C | Rest], At, Tokens) when C =:= $\s; C =:= $\t; C =:= $\n; C =:= $\r ->
    scan(Rest, At + 1, Tokens);
scan([C | _] = Text, At, Tokens) when ?IS_LETTER(C) ->
    {Name, Rest} = lists:splitwith(fun(D) -> ?IS_LETTER(D) orelse ?IS_DIGIT(D) end, Text),
    scan(Rest, At + length(Name), [{name, At, list_to_binary(Name)} | Tokens]);
scan([C | _] = Text, At, Tokens) when ?IS_DIGIT(C) ->
    {Number, Length, Rest} = number(Text),
    scan(Rest, At + Length, [{number, At, Number} | Tokens]);
scan([$" | Rest], At, Tokens) ->
    case lists:splitwith(fun(C) -> C =/= $" end, Rest) of
        {Quoted, [$" | After]} ->
            Token = {text, At, unicode:characters_to_binary(Quoted)},
            scan(After, At + length(Quoted) + 2, [Token | Tokens]);
        {_, []} ->
            {error, {At, "this text has no end; put a quotation mark behind it"}}
    end;
scan([A, B | Rest], At, Tokens) when
    B =:= $=, (A =:= $< orelse A =:= $> orelse A =:= $! orelse A =:= $=)
->
    scan(Rest, At + 2, [{sign, At, two(A)} | Tokens]);
scan([C | Rest], At, Tokens) ->
    case lists:member(C, "()<>=.,:-") of
        true -> scan(Rest, At + 1, [{sign, At, <<C>>} | Tokens]);
        false -> {error, {At, ["what does ", [C], " mean here?"]}}
    end.

two($=) -> <<"=">>;
two(A) -> <<A, $=>>.

%% `400', `0.5'; a point without digits behind it is not part of the number.
number(Text) ->
    {Whole, Rest} = digits(Text),
    case Rest of
        [$., C | _] when ?IS_DIGIT(C) ->
            {Part, After} = digits(tl(Rest)),
            {list_to_float(Whole ++ "." ++ Part), length(Whole) + 1 + length(Part), After};
        _ ->
            {list_to_integer(Whole), length(Whole), Rest}
    end.

digits(Text) -> lists:splitwith(fun(C) -> ?IS_DIGIT(C) end, Text).
