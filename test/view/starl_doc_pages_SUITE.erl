%% The pages of guides and modules: what is on them, that their links lead somewhere, and the search, in a
%% browser.
%%
%% Holds: Guides and modules are one set of pages without dead links, and the search finds what
%% matters first
%% Red: bars in code that part cells; links to guides that lose their places; ranks turned round
-module(starl_doc_pages_SUITE).
-include_lib("stdlib/include/assert.hrl").
-include_lib("common_test/include/ct.hrl").

-export([all/0, suite/0, init_per_suite/1, end_per_suite/1]).
-export([guides_and_modules_are_one_set/1, a_dead_link_is_told/1, the_search_finds/1]).

-define(B, starl_view_browser).

suite() -> [{timetrap, {minutes, 3}}].

all() -> [guides_and_modules_are_one_set, a_dead_link_is_told, the_search_finds].

%% A small checkout: two guides and two modules, one of them one that matters.
init_per_suite(Config) ->
    Root = filename:join(?config(priv_dir, Config), "checkout"),
    Files = [
        {"README.md",
            "# Teams\n\nSee [live](doc/live.md#real-time), [mutex](apps/starl_x/src/starl_mutex.erl) "
            "and ![p](doc/p.svg).\n"},
        {"doc/live.md",
            "# Live robots\n\nA robot & its node. [Back](../README.md)\n\n## Real time\n\n"
            "A lantern shines.\n"},
        {"doc/p.svg", "<svg xmlns=\"http://www.w3.org/2000/svg\"/>"},
        {"doc/overview.edoc", "@title Teams\n@doc Teams.\n"},
        {"apps/starl_x/src/starl_mutex.erl",
            "%% @doc Tokens, and who holds them.\n-module(starl_mutex).\n-export([acquire/2]).\n\n"
            "%% @doc Acquires.\nacquire(_, _) -> ok.\n"},
        {"apps/starl_x/src/starl_other.erl",
            "%% @doc Acquires nothing.\n-module(starl_other).\n-export([acquire/1]).\n\n"
            "%% @doc Acquires.\nacquire(_) -> ok.\n"}
    ],
    [starl_first_hour_ct:write(filename:join(Root, Name), Text) || {Name, Text} <- Files],
    [{root, Root} | Config].

end_per_suite(_Config) -> ok.

made(Config) ->
    Root = ?config(root, Config),
    Dir = filename:join(?config(priv_dir, Config), "pages"),
    Sources = filelib:wildcard(filename:join(Root, "apps/*/src/*.erl")),
    {ok, 2} = starl_dev_doc_pages:make(Sources, filename:join(Root, "doc/overview.edoc"), Dir),
    {starl_dev_doc_site:make(Root, Sources, Dir), Dir}.

guides_and_modules_are_one_set(Config) ->
    {Guides, Dir} = made(Config),
    ?assertEqual(2, Guides),
    ?assertEqual([], [lists:flatten(Line) || Line <- starl_dev_doc_pages:dead_links(Dir)]),
    Page = fun(Name) -> unicode:characters_to_list(read(filename:join(Dir, Name))) end,
    [
        starl_first_hour_ct:contains(Part, Page(Name))
     || {Name, Part} <- [
            {"index.html", "<a href=\"guide-doc-live.html#real-time\">live</a>, mutex"},
            {"index.html", "<img alt=\"p\" src=\"guide-doc-p.svg\">"},
            {"guide-doc-live.html",
                "<li class=\"here\"><a href=\"guide-doc-live.html\">Live robots"},
            {"guide-doc-live.html", "A robot &amp; its node. <a href=\"index.html\">Back</a>"},
            {"starl_mutex.html", "<li class=\"here\"><a href=\"starl_mutex.html\">"},
            {"modules.html", "<h2>starl_x</h2>"}
        ]
    ],
    ?assert(filelib:is_regular(filename:join(Dir, "guide-doc-p.svg"))).

a_dead_link_is_told(Config) ->
    Live = filename:join(?config(root, Config), "doc/live.md"),
    Sound = read(Live),
    ok = file:write_file(Live, [Sound, "\n[gone](../README.md#gone)\n"]),
    {2, Dir} = made(Config),
    ok = file:write_file(Live, Sound),
    ?assertEqual(
        ["guide-doc-live: a link leads nowhere: index.html#gone"],
        [unicode:characters_to_list(Line) || Line <- starl_dev_doc_pages:dead_links(Dir)]
    ).

%% Words of titles and texts; what matters first.
the_search_finds(Config) ->
    case ?B:program() of
        {skip, Why} -> {skip, Why};
        {ok, Program} -> searched(?B:start(Program), made(Config))
    end.

searched(Browser, {_, Dir}) ->
    ok = ?B:visit(["file://", filename:join(Dir, "guide-doc-live.html")], Browser),
    ?assertEqual(
        [<<"starl_mutex:acquire/2">>, <<"starl_other:acquire/1">>, <<"starl_other">>],
        typed("acquire", Browser)
    ),
    ?assertEqual([<<"Live robots: Real time">>], typed("LANTERN real", Browser)),
    ?assertEqual([], typed("lantern acquire", Browser)),
    ?assertEqual(
        <<"nothing has all these words">>,
        ?B:eval("document.getElementById('found').textContent", Browser)
    ),
    ?assertEqual(
        <<"guide-doc-live.html#real-time">>,
        begin
            _ = typed("lantern", Browser),
            ?B:eval("document.querySelector('#found a').getAttribute('href')", Browser)
        end
    ),
    ?B:stop(Browser).

%% The titles that are found for some words.
typed(Words, Browser) ->
    ?B:eval(
        [
            "(() => { const f = document.getElementById('search'); f.value = '",
            Words,
            "'; f.dispatchEvent(new Event('input'));",
            "return [...document.querySelectorAll('#found a')].map(a => a.textContent); })()"
        ],
        Browser
    ).

read(File) ->
    {ok, Text} = file:read_file(File),
    Text.
