%% @doc Erlang terms as text, between a robot's node, `bin/robot' and `./starl deploy'.
-module(starl_fleet_term).

-export([read/1, write/1]).

%% @doc The text of a term, one line.
-spec write(term()) -> unicode:unicode_binary().
write(Term) -> <<_/binary>> = unicode:characters_to_binary(io_lib:format("~0tp.~n", [Term])).

%% @doc The term of a text's last line: ssh, or a shell on the way, may have warned of something before.
-spec read(unicode:chardata()) -> {ok, term()} | none.
read(Text) ->
    case string:lexemes(unicode:characters_to_list(Text), [$\n, "\r\n"]) of
        [] -> none;
        Lines -> line(lists:last(Lines))
    end.

line(Line) ->
    case erl_scan:string(Line) of
        {ok, Tokens, _} -> parsed(erl_parse:parse_term(Tokens));
        {error, _, _} -> none
    end.

parsed({ok, Term}) -> {ok, Term};
parsed({error, _}) -> none.
