%% @doc `./starl doc': makes the pages of all modules ({@link starl_dev_doc_pages}).
-module(starl_dev_doc).
-behaviour(starl_cli_command).

-export([name/0, synopsis/0, about/1, flags/1, statuses/0, run/1]).

-spec name() -> string().
name() -> "doc".

-spec synopsis() -> string().
synopsis() -> "make the pages of all modules, for a browser".

-spec about(starl_cli_command:subject()) -> [starl_cli_command:paragraph()].
about(_Subject) ->
    [
        "Makes a page for each module by EDoc, from its sources, and an index. EDoc's warnings "
        "and links that lead nowhere are printed, one line each."
    ].

-spec flags(starl_cli_command:subject()) -> [starl_cli_command:group()].
flags(_Subject) ->
    [
        {"Flags", [
            {out, string, default(), "directory for the pages; earlier pages in it are replaced"}
        ]}
    ].

default() -> starl_cli_out:shown(filename:join([starl_cli_target:root(), "_build", "doc"])).

-spec statuses() -> [{starl_cli_terminal:status(), unicode:chardata()}].
statuses() -> [{0, "the pages are made"}, {1, "some pages have problems, which are printed"}].

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{values := #{out := Dir}}) ->
    Root = starl_cli_target:root(),
    Sources = filelib:wildcard(filename:join([Root, "apps", "*", "src", "**", "*.erl"])),
    case {Sources, is_ours(Dir)} of
        {[], _} -> {error, ["there are no sources under ", Root]};
        {_, false} -> {error, [["--out: ", Dir, " holds something else than such pages"]]};
        {_, true} -> told(starl_dev_doc_pages:make(Sources, overview(Root), Dir), Dir)
    end.

overview(Root) -> filename:join([Root, "doc", "overview.edoc"]).

%% Only a directory that this command has made may be emptied.
is_ours(Dir) ->
    not filelib:is_file(Dir) orelse filelib:is_regular(filename:join(Dir, "edoc-info")).

told({ok, Count}, Dir) ->
    starl_cli_terminal:out("~b pages: ~ts\n", [Count, filename:join(Dir, "index.html")]),
    0;
told({error, Problems}, _Dir) ->
    [starl_cli_terminal:complain(Problem) || Problem <- Problems],
    1.
