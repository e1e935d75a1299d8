%% @doc Collects the promises that tests hold, from the tags in their comments.
%%
%% A tag stands above a test, or above `-module' if the whole module holds the promise:
%% ```
%%   %% Holds: A robot that hears nobody is elected by nobody else.
%%   %% Red: 961f67c9, run: `deaf'
%%   deaf_leader_test() ->
%% '''
%% `Red' names the last commit at which the test fails, and what it said there. Both may go on over
%% further lines of the comment, which end with the comment or with the next tag.
-module(starl_dev_doc_evidence).

-export([table/0, tags/1]).

-export_type([tag/0]).

%% The test is `all' for a tag of a whole module.
-type tag() :: #{test := string() | all, holds := string(), red := string()}.

%% @doc The tables of all tags in the checkout, one for each application, in Markdown.
-spec table() -> iolist().
table() ->
    Root = starl_cli_target:root(),
    lists:join("\n", [section(Title, files(Pattern, Root)) || {Title, Pattern} <- folders(Root)]).

folders(Root) ->
    [
        {filename:basename(App), filename:join(App, "test/**/*.erl")}
     || App <- filelib:wildcard("apps/*", Root)
    ] ++ [{"All applications together", "test/**/*.erl"}].

files(Pattern, Root) -> [filename:join(Root, File) || File <- filelib:wildcard(Pattern, Root)].

section(Title, Files) ->
    case [row(File, Tag) || File <- Files, Tag <- tags(read(File))] of
        [] ->
            [];
        Rows ->
            ["## ", Title, "\n\n| promise | test | red at |\n| --- | --- | --- |\n", Rows]
    end.

read(File) ->
    {ok, Binary} = file:read_file(File),
    unicode:characters_to_list(Binary).

row(File, #{test := Test, holds := Holds, red := Red}) ->
    Module = filename:basename(File, ".erl"),
    Name = [Module | [[$:, Test] || Test =/= all]],
    ["| ", cell(Holds), " | `", Name, "` | ", cell(Red), " |\n"].

cell(Text) -> string:replace(Text, "|", "\\|", all).

%% @doc The tags of a source, in its order.
-spec tags(Source :: string()) -> [tag()].
tags(Source) -> tags(string:split(Source, "\n", all), []).

tags([], _Comment) ->
    [];
tags(["%% " ++ Text | Lines], Comment) ->
    tags(Lines, [Text | Comment]);
tags(["-module" ++ _ | Lines], Comment) ->
    tagged(all, Comment) ++ tags(Lines, []);
tags([Line | Lines], Comment) ->
    case re:run(Line, "^([a-z]\\w*)\\(", [unicode, {capture, all_but_first, list}]) of
        {match, [Name]} -> tagged(test_name(Name), Comment) ++ tags(Lines, []);
        nomatch -> tags(Lines, [])
    end.

%% EUnit's endings say only that it is a test.
test_name(Name) -> re:replace(Name, "_test_?$", "", [unicode, {return, list}]).

%% Lines come last first.
tagged(Test, Comment) -> tagged(Test, lists:reverse(Comment), none, []).

tagged(Test, ["Holds: " ++ Holds | Lines], _, Tags) ->
    tagged(Test, Lines, holds, [#{test => Test, holds => Holds, red => ""} | Tags]);
tagged(Test, ["Red: " ++ Red | Lines], holds, [Tag | Tags]) ->
    tagged(Test, Lines, red, [Tag#{red := Red} | Tags]);
tagged(Test, [Line | Lines], Key, [Tag | Tags]) when Key =/= none ->
    #{Key := Text} = Tag,
    tagged(Test, Lines, Key, [Tag#{Key := Text ++ " " ++ Line} | Tags]);
tagged(Test, [_ | Lines], none, Tags) ->
    tagged(Test, Lines, none, Tags);
tagged(_Test, [], _Key, Tags) ->
    lists:reverse(Tags).
