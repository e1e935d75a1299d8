%% @doc Rearranges a module's source for EDoc. In StarL the comment on a type stands before it, but
%% EDoc expects it after the type: so the comment and the type change places. The number of lines
%% stays the same, so EDoc's line numbers are nearly right.
-module(starl_dev_doc_source).

-export([for_edoc/1]).

%% @doc The lines of a module, with the comment on each type moved after it.
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
is_type(_Lines) -> false.

%% The lines of a form, up to its full stop.
form([Line | Rest], Before) ->
    Lines = [Line | Before],
    Code = lists:flatten([[L, $\n] || L <- lists:reverse(Lines)]),
    case erl_scan:tokens([], Code, 1) of
        {more, _} when Rest =/= [] -> form(Rest, Lines);
        _ -> {lists:reverse(Lines), Rest}
    end.
