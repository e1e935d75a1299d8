%% @doc Quotes words for a shell, for the commands that messages tell a user to type.
-module(starl_cli_quoted).

-export([word/1]).

%% @doc A text as one word of a command line, quoted where a shell would not take it as it is.
-spec word(string()) -> string().
word("") ->
    "''";
word(Text) ->
    case lists:all(fun plain/1, Text) of
        true -> Text;
        false -> "'" ++ lists:append(string:replace(Text, "'", "'\\''", all)) ++ "'"
    end.

plain(C) when C >= $a, C =< $z; C >= $A, C =< $Z; C >= $0, C =< $9 -> true;
plain(C) -> lists:member(C, "-_./,:=+@%").
