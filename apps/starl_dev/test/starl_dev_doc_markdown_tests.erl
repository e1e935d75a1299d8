%% Markdown as StarL's pages use it.
-module(starl_dev_doc_markdown_tests).
-include_lib("eunit/include/eunit.hrl").

html(Text) -> html(Text, fun(Link) -> Link end).

html(Text, Link) ->
    {Html, _} = starl_dev_doc_markdown:html(Text, Link),
    lists:flatten(string:replace(unicode:characters_to_list(Html), "\n", "", all)).

blocks_test_() ->
    [
        ?_assertEqual(Html, html(Text))
     || {Text, Html} <- [
            {"a\nb\n\nc", "<p>ab</p><p>c</p>"},
            {"## Two *of* them!", "<h2><a name=\"two-of-them\"></a>Two <em>of</em> them!</h2>"},
            {"```erlang\nA < \"b\" & c.\n# no heading\n```\nd",
                "<pre><code>A &lt; &quot;b&quot; &amp; c.# no heading</code></pre><p>d</p>"},
            {"a:\n\n    code\n\n      more\n\nb",
                "<p>a:</p><pre><code>code  more</code></pre><p>b</p>"},
            {"- a\n  b\n- c\n\n  d\n\ne", "<ul><li>ab</li><li>c<p>d</p></li></ul><p>e</p>"},
            {"1. a\n2. b\n   - c", "<ol><li>a</li><li>b<ul><li>c</li></ul></li></ol>"},
            {"- a\ngoes on", "<ul><li>agoes on</li></ul>"},
            {"> a\n> b", "<blockquote><p>ab</p></blockquote>"},
            {"| a | b |\n| --- | ---: |\n| `x | y` | 1 \\| 2 |",
                "<table><tr><th>a</th><th>b</th></tr>"
                "<tr><td><code>x | y</code></td><td>1 | 2</td></tr></table>"}
        ]
    ].

within_a_line_test_() ->
    [
        ?_assertEqual("<p>" ++ Html ++ "</p>", html(Text))
     || {Text, Html} <- [
            {"`a*b*<c>` *d e* **f `g`**",
                "<code>a*b*&lt;c&gt;</code> <em>d e</em> <b>f <code>g</code></b>"},
            {"2 * 3 * 4 < 5", "2 * 3 * 4 &lt; 5"},
            {"[a `b]c`](d.md#e)", "<a href=\"d.md#e\">a <code>b]c</code></a>"},
            {"x ![p](q.png)", "x <img alt=\"p\" src=\"q.png\">"},
            {"an open ` and [one", "an open ` and [one"}
        ]
    ].

links_are_the_callers_test() ->
    Link = fun
        ("gone") -> none;
        (To) -> "to-" ++ To
    end,
    ?assertEqual("<p>a <a href=\"to-c\">b</a></p>", html("[a](gone) [b](c)", Link)),
    ?assertEqual(
        "<img src=\"to-d.svg\" width=\"9\">", html("<img src=\"d.svg\" width=\"9\">", Link)
    ).

sections_test() ->
    {_, Sections} = starl_dev_doc_markdown:html(
        "# Page\nintro\n\n## A `b`: c\n\n- one\n- [two](x)\n", fun(Link) -> Link end
    ),
    ?assertMatch(
        [{1, "Page", "page", _}, {2, "A b: c", "a-b-c", _}],
        Sections
    ),
    ?assertEqual(
        [["intro"], ["one", "two"]], [string:lexemes(Text, " \n") || {_, _, _, Text} <- Sections]
    ).
