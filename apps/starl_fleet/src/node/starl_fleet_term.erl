%% @doc Writes and reads Erlang terms as text, for a robot's node, `bin/robot' and `./starl deploy'.
%%
%% Whatever a robot's computer sends is data: a text makes no new atom, and is bounded. Only the
%% tokens that {@link write/1} writes are read. An atom that this VM does not know is read as a
%% string.
-module(starl_fleet_term).

-export([read/1, write/1]).

%% A line that is longer is none of ours.
-define(MOST, 100_000).
%% The tokens: blanks, texts, atoms, numbers, and signs.
-define(TOKEN, [
    {"^[ \\t]+", blank},
    {"^\"(?:[^\"\\\\\\x00-\\x1f]|\\\\[^\\x00-\\x1f])*+\"", other},
    {"^'[^'\\\\\\x00-\\x1f]{0,255}'", quoted},
    {"^[a-z][A-Za-z0-9_@]{0,255}", atom},
    {"^-?[0-9]{1,40}(?:\\.[0-9]{1,40}(?:e[-+]?[0-9]{1,3})?)?(?![0-9#])", other},
    {"^(?:#\\{|=>|<<|>>|/utf8|[{}\\[\\],|.])", other}
]).

%% @doc The text of a term, one line.
-spec write(term()) -> unicode:unicode_binary().
write(Term) -> <<_/binary>> = unicode:characters_to_binary(io_lib:format("~0tp.~n", [Term])).

%% @doc Returns the term of a text's last line: ssh, or a shell between, may have printed a warning
%% before it.
-spec read(unicode:chardata()) -> {ok, term()} | none.
read(Text) ->
    %% the words of an answer are atoms of these modules, also where it is only passed on
    ok = code:ensure_modules_loaded([starl_live_hearing, starl_fleet_status]),
    case string:lexemes(unicode:characters_to_list(Text), [$\n, "\r\n"]) of
        [] -> none;
        Lines -> line(unicode:characters_to_binary(lists:last(Lines)))
    end.

line(Line) when byte_size(Line) > ?MOST -> none;
line(Line) ->
    case known(Line, []) of
        {ok, Known} -> scanned(erl_scan:string(unicode:characters_to_list(Known)));
        none -> none
    end.

%% The text with known atoms alone.
known(<<>>, Tokens) ->
    {ok, lists:reverse(Tokens)};
known(Text, Tokens) ->
    case token(?TOKEN, Text) of
        {Kind, Token} ->
            Size = byte_size(Token),
            <<_:Size/binary, Rest/binary>> = Text,
            known(Rest, [taken(Kind, Token) | Tokens]);
        none ->
            none
    end.

token([{Pattern, Kind} | Others], Text) ->
    case re:run(Text, Pattern, [{capture, first, binary}]) of
        {match, [Token]} -> {Kind, Token};
        nomatch -> token(Others, Text)
    end;
token([], _Text) ->
    none.

taken(atom, Token) -> atom_here(Token, Token);
taken(quoted, Token) -> atom_here(Token, binary:part(Token, 1, byte_size(Token) - 2));
taken(_Kind, Token) -> Token.

atom_here(Token, Name) ->
    try
        _ = binary_to_existing_atom(Name, utf8),
        Token
    catch
        error:badarg -> [$", string:replace(Name, "\"", "\\\"", all), $"]
    end.

scanned({ok, Tokens, _}) -> parsed(erl_parse:parse_term(Tokens));
scanned({error, _, _}) -> none.

parsed({ok, Term}) -> {ok, Term};
parsed({error, _}) -> none.
