%% @doc Rearranges a module's source for EDoc. In StarL the comment on a type or a callback stands before it,
%% but EDoc expects it after it: so the two change places. The number of lines stays the same, so EDoc's
%% line numbers are nearly right.
-module(starl_dev_doc_source).

-export([for_edoc/1, copies/2]).

%% @doc Copies of these sources for EDoc, in a directory.
-spec copies([file:filename()], Dir :: file:filename()) -> [file:filename_all()].
copies(Files, Dir) ->
    ok = filelib:ensure_dir(filename:join(Dir, "any")),
    [copy(File, Dir) || File <- Files].

copy(File, Dir) ->
    {ok, Text} = file:read_file(File),
    Lines = string:split(unicode:characters_to_list(Text), "\n", all),
    Copy = filename:join(Dir, filename:basename(File)),
    Turned = unicode:characters_to_binary(lists:join("\n", for_edoc(Lines))),
    ok = starl_cli_out:sure(Copy, file:write_file(Copy, Turned)),
    Copy.

%% @doc The lines of a module, with the comment on each type and callback moved after it.
-spec for_edoc([string()]) -> [string()].
for_edoc([]) ->
    [];
for_edoc(Lines) ->
    case lists:splitwith(fun is_comment/1, Lines) of
        {[], [Line | Rest]} -> [Line | for_edoc(Rest)];
        {Comment, Rest} -> behind(Comment, Rest, is_type(Rest))
    end.

behind(Comment, Lines, false) ->
    Comment ++ for_edoc(Lines);
behind(Comment, Lines, true) ->
    {Type, Rest} = form(Lines, []),
    Type ++ Comment ++ for_edoc(Rest).

is_comment(Line) -> lists:prefix("%%", Line).

is_type(["-type " ++ _ | _]) -> true;
is_type(["-opaque " ++ _ | _]) -> true;
is_type(["-callback " ++ _ | _]) -> true;
is_type(_Lines) -> false.

%% The lines of a form, up to its full stop.
form([Line | Rest], Before) ->
    Lines = [Line | Before],
    Code = lists:flatten([[L, $\n] || L <- lists:reverse(Lines)]),
    case erl_scan:tokens([], Code, 1) of
        {more, _} when Rest =/= [] -> form(Rest, Lines);
        _ -> {lists:reverse(Lines), Rest}
    end.
