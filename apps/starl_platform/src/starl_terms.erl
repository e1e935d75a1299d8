%% @doc Reads a file of Erlang terms that may come from anybody, as `file:consult/1' does, within bounds.
%%
%% A text can ask for more than it is long: `<<0:80000000000>>' for 10 GB, a number of a million digits for minutes,
%% names for all atoms that the VM has. So a file has at most {@link most_bytes/0}; its numbers and words are short, its
%% binaries list their bytes, its terms are not nested deeply, and it makes a bounded number of new atoms.
-module(starl_terms).

-export([consult/1, most_bytes/0, format_error/1]).

-export_type([problem/0]).

-type problem() :: too_large | long_word | deep | segment | names.

-define(MOST_BYTES, (1 bsl 22)).
-define(LONGEST_WORD, 1000).
-define(DEEPEST, 200).
-define(NEW_ATOMS, 100000).
%% Characters that are scanned at a time: the atoms are counted after each.
-define(PIECE, 10000).

%% @doc The longest file.
-spec most_bytes() -> pos_integer().
most_bytes() -> ?MOST_BYTES.

%% @doc The terms of a file, or the problem with its line.
-spec consult(file:name_all()) ->
    {ok, [term()]}
    | {error, file:posix() | badarg | terminated | system_limit}
    | {error, {Line :: pos_integer(), module(), term()}}.
consult(File) ->
    case read(File) of
        {ok, Bytes} -> sized(Bytes);
        {error, _} = Error -> Error
    end.

read(File) ->
    case file:open(File, [read, raw, binary]) of
        {ok, Device} ->
            Read = read(Device, ?MOST_BYTES + 1, []),
            _ = file:close(Device),
            Read;
        {error, _} = Error ->
            Error
    end.

%% A pipe gives less at a time than is asked for.
read(Device, Left, Read) when Left > 0 ->
    case file:read(Device, Left) of
        {ok, Bytes} -> read(Device, Left - byte_size(Bytes), [Bytes | Read]);
        eof -> {ok, iolist_to_binary(lists:reverse(Read))};
        {error, _} = Error -> Error
    end;
read(_Device, _Left, Read) ->
    {ok, iolist_to_binary(lists:reverse(Read))}.

sized(Bytes) when byte_size(Bytes) > ?MOST_BYTES ->
    problem(1, too_large);
sized(Bytes) ->
    case re:run(Bytes, "[0-9A-Za-z_]{" ++ integer_to_list(?LONGEST_WORD + 1) ++ "}") of
        {match, [{At, _}]} -> problem(line(binary:part(Bytes, 0, At)), long_word);
        nomatch -> decoded(unicode:characters_to_list(Bytes))
    end.

line(Before) -> 1 + length(binary:matches(Before, <<"\n">>)).

decoded(Text) when is_list(Text) ->
    terms(Text, 1, [], erlang:system_info(atom_count));
decoded(_Invalid) ->
    {error, {1, file_io_server, invalid_unicode}}.

terms(Text, Line, Terms, Atoms) ->
    case tokens([], Text, Line, Atoms) of
        {ok, Tokens, Next, Rest} ->
            case term(Tokens) of
                {ok, Term} -> terms(Rest, Next, [Term | Terms], Atoms);
                {error, _} = Error -> Error
            end;
        eof ->
            {ok, lists:reverse(Terms)};
        {error, _} = Error ->
            Error
    end.

tokens(Continuation, Text, Line, Atoms) ->
    {Piece, Rest} = piece(Text),
    case erl_scan:tokens(Continuation, Piece, Line) of
        {done, {ok, Tokens, Next}, Left} -> {ok, Tokens, Next, again(Left, Rest)};
        {done, {eof, _}, _} -> eof;
        {done, {error, Info, _}, _} -> {error, Info};
        {more, More} -> more(More, Rest, Line, Atoms)
    end.

more(More, Rest, Line, Atoms) ->
    case erlang:system_info(atom_count) - Atoms > ?NEW_ATOMS of
        true -> problem(Line, names);
        false -> tokens(More, Rest, Line, Atoms)
    end.

piece([]) ->
    {eof, []};
piece(Text) when is_list(Text) ->
    case length(lists:sublist(Text, ?PIECE)) of
        ?PIECE -> lists:split(?PIECE, Text);
        _ -> {Text, []}
    end.

again(eof, _Rest) -> [];
again(Left, Rest) -> Left ++ Rest.

term(Tokens) ->
    case unsound(Tokens, 0) of
        none -> erl_parse:parse_term(Tokens);
        {Line, Problem} -> problem(Line, Problem)
    end.

unsound([{':', Line} | _], _Depth) ->
    {Line, segment};
unsound([{Open, Line} | _], ?DEEPEST) when Open =:= '['; Open =:= '{'; Open =:= '(' -> {Line, deep};
unsound([{Open, _} | Tokens], Depth) when Open =:= '['; Open =:= '{'; Open =:= '(' ->
    unsound(Tokens, Depth + 1);
unsound([{Close, _} | Tokens], Depth) when Close =:= ']'; Close =:= '}'; Close =:= ')' ->
    unsound(Tokens, Depth - 1);
unsound([_ | Tokens], Depth) ->
    unsound(Tokens, Depth);
unsound([], _Depth) ->
    none.

problem(Line, Problem) -> {error, {Line, ?MODULE, Problem}}.

%% @doc What is wrong, without its place.
-spec format_error(problem()) -> unicode:chardata().
format_error(too_large) ->
    io_lib:format("a file of terms has at most ~b MB", [?MOST_BYTES bsr 20]);
format_error(long_word) ->
    io_lib:format("a number or a word of more than ~b characters", [?LONGEST_WORD]);
format_error(deep) ->
    io_lib:format("terms in each other, more than ~b levels", [?DEEPEST]);
format_error(segment) ->
    "a binary with a size: list its bytes";
format_error(names) ->
    io_lib:format("more than ~b new names", [?NEW_ATOMS]).
