%% @doc A module's source as EDoc wants it. People say what a type is before it, EDoc reads that behind
%% it: so a comment changes places with the type that it stands before. All lines stay, in their
%% number, so what EDoc says of a line is near it.
-module(starl_dev_doc_source).

-export([for_edoc/1]).

%% @doc The lines of a module, with the comment before each type moved behind it.
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

%% The lines of a form, to its full stop.
form([Line | Rest], Before) ->
    Lines = [Line | Before],
    Code = lists:flatten([[L, $\n] || L <- lists:reverse(Lines)]),
    case erl_scan:tokens([], Code, 1) of
        {more, _} when Rest =/= [] -> form(Rest, Lines);
        _ -> {lists:reverse(Lines), Rest}
    end.
