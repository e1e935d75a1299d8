%% @doc Derives flags from tables of options: `safety_distance' becomes `--safety-distance 450'. All
%% problems of a command line are reported at once.
-module(starl_cli_flags).

-export([parse/2, defaults/1, help/2, described/1, flag/1, text/2, arguments/2]).
-export([format_problem/1]).

-export_type([flag/0, type/0, problem/0]).

%% A longer range is taken for a typing error.
-define(LONGEST_RANGE, 100000).

%% The types of options, a flag without a value, and a list of values `A,B,C'. Numbers may be
%% written as a range, `LOW..HIGH' or `LOW..HIGH..STEP'.
%% Of `{first, T}' a single value N stands for 1..N.
-type type() ::
    starl_options:type()
    | switch
    | {list, starl_options:type()}
    | {first, starl_options:type()}.
-type flag() :: {Key :: atom(), type(), Default :: term(), Doc :: string()}.

-type problem() ::
    {unknown_flag, string(), Near :: [string()]}
    | {no_value, Key :: atom(), type()}
    | {needless_value, string()}
    | {bad_value, Key :: atom(), Text :: string(), type()}
    | {stray, string()}.

%% The specifications of flags that getopt expects.
-type specs() :: [{atom(), char() | undefined, string(), string | undefined, string()}].

%% @doc Reads the flags of a command line and gives their values.
-spec parse([string()], [flag()]) -> {ok, #{atom() => term()}} | {error, [problem(), ...]}.
parse(Args, Flags) ->
    {Found, Rest, Unreadable} = scan([spec(Flag) || Flag <- Flags], Args, Flags, []),
    Values = [value(Option, Flags) || Option <- Found],
    Stray = [{stray, Arg} || Arg <- Rest],
    case Unreadable ++ [Problem || {problem, Problem} <- Values] ++ Stray of
        [] -> {ok, maps:from_list([{Key, V} || {ok, Key, V} <- Values])};
        Problems -> {error, Problems}
    end.

%% @doc The defaults of all flags.
-spec defaults([flag()]) -> #{atom() => term()}.
defaults(Flags) -> maps:from_list([{Key, Default} || {Key, _, Default, _} <- Flags]).

%% @doc The flag of a key.
-spec flag(atom()) -> string().
flag(Key) -> "--" ++ [dashed(C) || C <- atom_to_list(Key)].

%% @doc One line that states the problem and the remedy.
-spec format_problem(problem()) -> unicode:chardata().
format_problem({unknown_flag, Flag, Near}) ->
    ["unknown flag ", Flag, starl_similar:meant(Near, "; --help lists all")];
format_problem({no_value, Key, Type}) ->
    io_lib:format("~ts needs a value: ~ts", [flag(Key), type_text(Type)]);
format_problem({needless_value, Flag}) ->
    [hd(string:split(Flag, "=")), " takes no value"];
format_problem({stray, Arg}) ->
    ["unexpected argument ", quoted(Arg), "; flags begin with --"];
format_problem({bad_value, Key, Text, {term, Shape, _} = Type}) ->
    Why =
        case misread(in_file(Text), Type, Text) of
            none -> "";
            Where -> [" (", Where, ")"]
        end,
    io_lib:format("~ts: ~ts expected, not ~ts~ts", [flag(Key), Shape, quoted(Text), Why]);
format_problem({bad_value, Key, Text, Type}) ->
    io_lib:format("~ts: ~ts expected, not ~ts", [flag(Key), type_text(Type), quoted(Text)]).

misread(none, Type, Text) -> starl_options:misread(Type, Text);
misread({ok, [_]}, _Type, _Text) -> none;
misread({ok, Terms}, _Type, _Text) -> io_lib:format("a file with ~b terms", [length(Terms)]);
misread({error, Why}, _Type, _Text) -> file:format_error(Why).

%% @doc The help on flags, wrapped to a width in columns.
-spec help([flag()], Width :: pos_integer()) -> unicode:chardata().
help(Flags, Width) -> [help_on(Flag, Width) || Flag <- Flags].

%% @doc A value as it is written on a command line, the inverse of {@link starl_options:parse/2}.
-spec text(type(), term()) -> string().
text({between, Type}, {Low, Low}) -> text(Type, Low);
text({between, Type}, {Low, High}) -> text(Type, Low) ++ ".." ++ text(Type, High);
text({size, Type}, {Width, Height}) -> text(Type, Width) ++ "x" ++ text(Type, Height);
text({optional, _}, none) -> "none";
text({optional, Type}, Value) -> text(Type, Value);
text({first, Type}, Values) -> text({list, Type}, Values);
text({list, Type}, Values) -> lists:append(lists:join(",", [text(Type, V) || V <- Values]));
text(Type, none) when Type =:= string; Type =:= file -> "none";
text(Type, Value) when Type =:= string; Type =:= file -> Value;
text({one_of, _}, Value) -> atom_to_list(Value);
text(boolean, Value) -> atom_to_list(Value);
text({term, _, _}, Value) when is_binary(Value) -> unicode:characters_to_list(Value);
text({term, _, _}, Value) -> lists:flatten(io_lib:format("~0tp", [Value]));
text({integer, _, _}, Value) -> integer_to_list(Value);
text({number, _, _}, Value) -> lists:flatten(io_lib:format("~p", [Value])).

%% @doc The arguments that give these values, quoted for a shell.
-spec arguments([flag()], #{atom() => term()}) -> [string()].
arguments(Flags, Values) ->
    lists:append([
        [flag(Key), starl_cli_terminal:quoted(text(Type, maps:get(Key, Values)))]
     || {Key, Type, _, _} <- Flags, is_map_key(Key, Values)
    ]).

%% -- reading --------------------------------------------------------------------------------

spec({help, switch, _, Doc}) -> {help, $h, "help", undefined, Doc};
spec({Key, switch, _, Doc}) -> {Key, undefined, tl(tl(flag(Key))), undefined, Doc};
spec({Key, _, _, Doc}) -> {Key, undefined, tl(tl(flag(Key))), string, Doc}.

%% getopt stops at the first unreadable argument. That argument is noted and removed, and the others
%% are read again.
-spec scan(specs(), [string()], [flag()], [problem()]) ->
    {[{atom(), string()} | atom()], [string()], [problem()]}.
scan(Specs, Args, Flags, Problems) ->
    case getopt:parse(Specs, Args) of
        {ok, {Found, Rest}} ->
            {Found, Rest, lists:reverse(Problems)};
        {error, {invalid_option, Flag}} ->
            scan(Specs, without(Flag, Args), Flags, [unknown(Flag, Flags) | Problems]);
        {error, {invalid_option_arg, Flag}} ->
            scan(Specs, lists:delete(Flag, Args), Flags, [{needless_value, Flag} | Problems]);
        {error, {missing_option_arg, Key}} ->
            {Key, Type, _, _} = lists:keyfind(Key, 1, Flags),
            scan(Specs, lists:droplast(Args), Flags, [{no_value, Key, Type} | Problems])
    end.

unknown(Flag, Flags) ->
    Name = hd(string:split(Flag, "=")),
    {unknown_flag, Name, starl_similar:words(Name, [flag(Key) || {Key, _, _, _} <- Flags])}.

%% Removes an unknown flag together with its apparent value.
without(Flag, Args) ->
    {Before, [Flag | After]} = lists:splitwith(fun(Arg) -> Arg =/= Flag end, Args),
    case {lists:member($=, Flag), After} of
        {false, [[C | _] | Others]} when C =/= $- -> Before ++ Others;
        _ -> Before ++ After
    end.

value(Key, _Flags) when is_atom(Key) ->
    {ok, Key, true};
value({Key, "--" ++ _}, Flags) ->
    {Key, Type, _, _} = lists:keyfind(Key, 1, Flags),
    {problem, {no_value, Key, Type}};
value({Key, Text}, Flags) ->
    {Key, Type, _, _} = lists:keyfind(Key, 1, Flags),
    case parse_value(Type, Text) of
        {ok, Value} -> {ok, Key, Value};
        error -> {problem, {bad_value, Key, Text, Type}}
    end.

parse_value({first, Type}, Text) ->
    case starl_options:parse(Type, Text) of
        {ok, N} -> parse_value({list, Type}, "1.." ++ integer_to_list(N));
        error -> parse_value({list, Type}, Text)
    end;
parse_value({list, Type}, Text) ->
    Parts = [parse_values(Type, Part) || Part <- string:split(Text, ",", all)],
    case lists:member(error, Parts) of
        true -> error;
        false -> {ok, lists:append([Values || {ok, Values} <- Parts])}
    end;
parse_value({term, _, Is} = Type, Text) ->
    case {starl_options:parse(Type, Text), in_file(Text)} of
        {error, {ok, [Term]}} ->
            case Is(Term) of
                true -> {ok, Term};
                false -> error
            end;
        {Parsed, _} ->
            Parsed
    end;
parse_value(Type, Text) ->
    starl_options:parse(Type, Text).

%% A long term, such as a list of faults, may be in a file.
in_file(Text) ->
    case filename:extension(Text) of
        ".term" -> starl_terms:consult(Text);
        _ -> none
    end.

parse_values(Type, Text) ->
    case starl_options:parse(Type, Text) of
        {ok, Value} -> {ok, [Value]};
        error -> parse_range(Type, string:split(Text, "..", all))
    end.

parse_range({optional, Type}, Texts) ->
    parse_range(Type, Texts);
parse_range(Type, [Low, High]) ->
    parse_range(Type, [Low, High, "1"]);
parse_range({Kind, _, Max} = Type, [_, _, _] = Texts) when Kind =:= integer; Kind =:= number ->
    Types = [Type, Type, {Kind, 0, max(1, Max)}],
    case [starl_options:parse(T, Text) || {T, Text} <- lists:zip(Types, Texts)] of
        [{ok, Low}, {ok, High}, {ok, Step}] -> range(Low, High, Step);
        _ -> error
    end;
parse_range(_Type, _Texts) ->
    error.

range(Low, High, Step) when Low =< High, Step > 0, High - Low < ?LONGEST_RANGE * Step ->
    %% 0..0.3..0.1 must end with 0.3, in spite of the rounding of 0.1.
    Steps = floor((High - Low) / Step + 1.0e-9),
    {ok, [tidy(Low + K * Step) || K <- lists:seq(0, Steps)]};
range(_Low, _High, _Step) ->
    error.

tidy(X) when X == trunc(X) -> trunc(X);
tidy(X) -> list_to_float(float_to_list(X, [{decimals, 9}, compact])).

%% -- writing --------------------------------------------------------------------------------

dashed($_) -> $-;
dashed(C) -> C.

type_text(switch) -> "no value";
type_text({first, _}) -> "N for 1..N, or A,B,C or LOW..HIGH";
type_text({list, Type}) -> starl_options:type_text(Type) ++ several(Type);
type_text(Type) -> starl_options:type_text(Type).

several({optional, Type}) -> several(Type);
several({integer, _, _}) -> ", or several as A,B,C or LOW..HIGH or LOW..HIGH..STEP";
several({number, _, _}) -> ", or several as A,B,C or LOW..HIGH..STEP";
several(_) -> ", or several with commas between".

help_on(Flag, Width) ->
    {Usage, Text} = described(Flag),
    ["  ", Usage, "\n      ", starl_cli_terminal:wrap(Text, 6, Width), "\n"].

%% @doc A flag as it is typed, and what it means, with the type of its value and the default.
-spec described(flag()) -> {Usage :: unicode:chardata(), unicode:chardata()}.
described({Key, switch, _, Doc}) ->
    {flag(Key), Doc};
described({Key, Type, Default, Doc}) ->
    Facts = [Fact || Fact <- [shape(Type), default(Type, Default)], Fact =/= ""],
    {
        [flag(Key), " ", placeholder(Type)],
        [Doc, [[" (", lists:join("; ", Facts), ")"] || Facts =/= []]]
    }.

%% That a text is a text needs no word.
shape(Type) when Type =:= string; Type =:= file -> "";
shape(Type) -> type_text(Type).

default({optional, _}, none) -> "default: none";
default(_Type, none) -> "";
default({term, _, _}, []) -> "";
default(Type, Default) -> ["default: ", text(Type, Default)].

placeholder({integer, _, _}) -> "N";
placeholder({number, _, _}) -> "X";
placeholder({between, _}) -> "LOW..HIGH";
placeholder({size, _}) -> "WIDTHxHEIGHT";
placeholder({optional, Type}) -> placeholder(Type);
placeholder({first, Type}) -> placeholder(Type);
placeholder({list, Type}) -> [placeholder(Type), ",..."];
placeholder({one_of, _}) -> "NAME";
placeholder(boolean) -> "true|false";
placeholder({term, _, _}) -> "TERM";
placeholder(string) -> "TEXT";
placeholder(file) -> "FILE".

quoted("") -> "nothing";
quoted(Text) -> ["\"", Text, "\""].
