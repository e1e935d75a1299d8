%% @doc Configuration as data: tables of key, type, default and documentation, and the check of
%% given values against them. All problems are reported together; an unknown key is a problem.
-module(starl_options).

-export([check/2, defaults/1, check_table/2, parse/2, misread/2, format_problem/1, type_text/1]).

-export_type([option/0, type/0, problem/0]).

%% The type of a value. Bounds are inclusive. `{between, T}' is two values {Low, High} of T. `file'
%% is the path of a file that the run reads, or a name that the application knows itself.
-type type() ::
    {integer, Min :: integer(), Max :: integer()}
    | {number, Min :: number(), Max :: number()}
    | {between, type()}
    | {size, type()}
    | {one_of, [atom()]}
    | {optional, type()}
    | string
    | file
    | boolean
    | {term, Shape :: string(), fun((term()) -> boolean())}.

-type option() :: {Key :: atom(), type(), Default :: term(), Doc :: string()}.

-type problem() ::
    {unknown_key, Key :: term(), Near :: [atom()]} | {bad_value, atom(), Value :: term(), type()}.

%% @doc Checks given values; returns them completed with the defaults.
-spec check(#{atom() => term()}, [option()]) -> {ok, #{atom() => term()}} | {error, [problem()]}.
check(Given, Options) ->
    Keys = [Key || {Key, _, _, _} <- Options],
    Unknown = [
        {unknown_key, Key, starl_similar:atoms(Key, Keys)}
     || Key <- lists:sort(maps:keys(Given)), not lists:member(Key, Keys)
    ],
    Bad = [
        {bad_value, Key, maps:get(Key, Given), Type}
     || {Key, Type, _, _} <- Options,
        is_map_key(Key, Given),
        not valid(Type, maps:get(Key, Given))
    ],
    case Unknown ++ Bad of
        [] ->
            {ok,
                maps:merge(
                    defaults(Options), maps:map(fun(K, V) -> whole(K, V, Options) end, Given)
                )};
        Problems ->
            {error, Problems}
    end.

%% @doc The default of each key of a table.
-spec defaults([option()]) -> #{atom() => term()}.
defaults(Options) -> maps:from_list([{Key, Default} || {Key, _, Default, _} <- Options]).

%% @doc Checks a table itself: its form, its types, its defaults, and that no key is there twice or
%% taken by another table. One line on the first problem.
-spec check_table(term(), Taken :: [atom()]) -> ok | {error, unicode:chardata()}.
check_table([], _Taken) ->
    ok;
check_table([Option | Options], Taken) ->
    case option(Option, Taken) of
        ok -> check_table(Options, [element(1, Option) | Taken]);
        {error, _} = Error -> Error
    end;
check_table(Other, _Taken) ->
    problem("a list of {Key, Type, Default, \"Doc\"} expected, not ~0tP", [Other, 20]).

option({Key, Type, Default, Doc}, Taken) when is_atom(Key) ->
    Steps = [
        {not lists:member(Key, Taken), "the key ~tp is taken already", [Key]},
        {is_type(Type), "~tp: ~0tP is no type; types are ~ts", [Key, Type, 20, types()]},
        {is_type(Type) andalso valid(Type, Default), "~tp: the default ~0tP is not ~ts", [
            Key, Default, 20, is_type(Type) andalso type_text(Type)
        ]},
        {io_lib:printable_unicode_list(Doc), "~tp: the last element is a text, not ~0tP", [
            Key, Doc, 20
        ]}
    ],
    case [{Format, Args} || {false, Format, Args} <- Steps] of
        [] -> ok;
        [{Format, Args} | _] -> problem(Format, Args)
    end;
option(Other, _Taken) ->
    problem("an option is {Key, Type, Default, \"Doc\"}, not ~0tP", [Other, 20]).

problem(Format, Args) -> {error, io_lib:format(Format, Args)}.

types() ->
    "{integer, Min, Max}, {number, Min, Max}, {between, Type}, {size, Type}, {one_of, Atoms}, "
    "{optional, Type}, string, file, boolean, {term, \"Shape\", Fun}".

is_type({integer, Min, Max}) -> is_integer(Min) andalso is_integer(Max);
is_type({number, Min, Max}) -> is_number(Min) andalso is_number(Max);
is_type({between, Type}) -> is_type(Type);
is_type({size, Type}) -> is_type(Type);
is_type({one_of, Atoms}) -> is_list(Atoms) andalso lists:all(fun is_atom/1, Atoms);
is_type({optional, Type}) -> is_type(Type);
is_type({term, Shape, Is}) -> io_lib:printable_unicode_list(Shape) andalso is_function(Is, 1);
is_type(Type) -> lists:member(Type, [string, file, boolean]).

%% @doc Reads a value of a type from text, as on a command line.
-spec parse(type(), string()) -> {ok, term()} | error.
parse({integer, _, _} = Type, Text) ->
    valid_or_error(Type, whole(Text));
parse({number, _, _} = Type, Text) ->
    valid_or_error(Type, number(Text));
parse({between, Type}, Text) ->
    pair(Type, string:split(Text, ".."), {between, Type});
parse({size, Type}, Text) ->
    pair(Type, string:split(Text, "x"), {size, Type});
parse({one_of, Atoms}, Text) ->
    one_of(Atoms, Text);
parse({optional, _}, "none") ->
    {ok, none};
parse({optional, Type}, Text) ->
    parse(Type, Text);
parse(Type, Text) when Type =:= string; Type =:= file ->
    valid_or_error(Type, Text);
parse(boolean, Text) ->
    one_of([true, false], Text);
parse({term, _, _} = Type, Text) ->
    case term(Text) of
        {ok, Term} -> valid_or_error(Type, Term);
        %% such as the name of a file, if the option takes a binary
        {error, _} -> valid_or_error(Type, unicode:characters_to_binary(Text))
    end.

one_of(Atoms, Text) ->
    case [Atom || Atom <- Atoms, atom_to_list(Atom) =:= Text] of
        [Atom] -> {ok, Atom};
        [] -> error
    end.

term(Text) ->
    case erl_scan:string(Text ++ ".", {1, 1}) of
        {ok, Tokens, _} -> erl_parse:parse_term(Tokens);
        {error, Error, _} -> {error, Error}
    end.

%% @doc Where and why a text is no value of this type: it is no Erlang term, or one of its entries
%% does not fit. `none' if neither is known.
-spec misread(type(), string()) -> none | unicode:chardata().
misread(Type, Text) ->
    case term(Text) of
        {ok, Term} -> unfit(Type, Term);
        {error, {_, erl_parse, ["syntax error before: ", []]}} -> "it ends too early";
        {error, {{1, Column}, Module, What}} -> at(Column, Text, Module:format_error(What));
        {error, {_, Module, What}} -> Module:format_error(What)
    end.

at(Column, Text, _Words) when Column > length(Text) -> "it ends too early";
at(Column, _Text, Words) -> io_lib:format("character ~b: ~ts", [Column, Words]).

%% The first entry of a list that alone keeps it from being a value of this type.
unfit({term, _, Is}, [_ | _] = List) ->
    Numbered = [N || is_proper(List), N <- lists:enumerate(List)],
    case [Entry || Is([]), {_, E} = Entry <- Numbered, not Is([E])] of
        [{N, Entry} | _] -> io_lib:format("entry ~b is ~0tP", [N, Entry, 20]);
        [] -> none
    end;
unfit(_Type, _Value) ->
    none.

%% A user's list may have any tail.
is_proper([_ | Tail]) -> is_proper(Tail);
is_proper(Tail) -> Tail =:= [].

%% @doc One line that describes a problem.
-spec format_problem(problem()) -> unicode:chardata().
format_problem({unknown_key, Key, Near}) ->
    [io_lib:format("unknown key ~tp", [Key]), starl_similar:meant(Near, "")];
format_problem({bad_value, Key, Value, Type}) ->
    Where =
        case unfit(Type, Value) of
            none -> "";
            Entry -> [" (", Entry, ")"]
        end,
    io_lib:format("~tp: ~ts expected, not ~0tP~ts", [Key, type_text(Type), Value, 20, Where]).

%% @doc A type in words.
-spec type_text(type()) -> string().
type_text({integer, Min, Max}) -> "a whole number from " ++ text(Min) ++ " to " ++ text(Max);
type_text({number, Min, Max}) -> "a number from " ++ text(Min) ++ " to " ++ text(Max);
type_text({between, Type}) -> type_text(Type) ++ ", or two as LOW..HIGH";
type_text({size, Type}) -> "WIDTHxHEIGHT, each " ++ type_text(Type);
type_text({one_of, Atoms}) -> "one of " ++ lists:join(", ", [atom_to_list(A) || A <- Atoms]);
type_text({optional, Type}) -> type_text(Type) ++ ", or none";
type_text(string) -> "a text";
type_text(file) -> "a file or a name";
type_text(boolean) -> "true or false";
type_text({term, Shape, _}) -> Shape.

%% -- internals ------------------------------------------------------------------------------

%% A single value stands for a pair of equal values.
whole(Key, Value, Options) ->
    case lists:keyfind(Key, 1, Options) of
        {_, {between, _}, _, _} when not is_tuple(Value) -> {Value, Value};
        _ -> Value
    end.

valid({integer, Min, Max}, V) -> is_integer(V) andalso V >= Min andalso V =< Max;
valid({number, Min, Max}, V) -> is_number(V) andalso V >= Min andalso V =< Max;
valid({between, Type}, V) when not is_tuple(V) -> valid(Type, V);
valid({between, Type}, {A, B}) -> valid(Type, A) andalso valid(Type, B) andalso A =< B;
valid({size, Type}, {A, B}) -> valid(Type, A) andalso valid(Type, B);
valid({between, _}, _) -> false;
valid({size, _}, _) -> false;
valid({one_of, Atoms}, V) -> lists:member(V, Atoms);
valid({optional, Type}, V) -> V =:= none orelse valid(Type, V);
valid(string, V) -> io_lib:printable_unicode_list(V) andalso V =/= "";
valid(file, V) -> valid(string, V);
valid(boolean, V) -> is_boolean(V);
valid({term, _, Is}, V) -> Is(V).

valid_or_error(_Type, error) ->
    error;
valid_or_error(Type, Value) ->
    case valid(Type, Value) of
        true -> {ok, Value};
        false -> error
    end.

whole(Text) ->
    case string:to_integer(Text) of
        {N, ""} -> N;
        _ -> error
    end.

number(Text) ->
    case string:to_float(Text) of
        {X, ""} -> X;
        _ -> whole_or_fraction(Text)
    end.

%% "3" and ".5" are numbers too.
whole_or_fraction([$. | _] = Text) -> number("0" ++ Text);
whole_or_fraction(Text) -> whole(Text).

pair(Type, [A, B], Whole) ->
    case {parse(Type, A), parse(Type, B)} of
        {{ok, Low}, {ok, High}} -> valid_or_error(Whole, {Low, High});
        _ -> error
    end;
pair(Type, [A], {between, _}) ->
    case parse(Type, A) of
        {ok, Value} -> {ok, {Value, Value}};
        error -> error
    end;
pair(_, _, _) ->
    error.

text(X) when X == trunc(X) -> integer_to_list(trunc(X));
text(X) -> lists:flatten(io_lib:format("~p", [X])).
