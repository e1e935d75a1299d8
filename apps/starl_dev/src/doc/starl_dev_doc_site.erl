%% @doc Joins the guides and EDoc's module pages into one set of pages. Each page has a column of
%% contents, with the guides and the important modules first, and a search over all pages. No page
%% needs a server.
-module(starl_dev_doc_site).

-export([make/3]).

%% A guide: its file, the page, its title, its text and its sections.
-type guide() :: #{
    file := file:filename(),
    page := string(),
    title := string(),
    html := iolist(),
    sections := [starl_dev_doc_markdown:section()],
    pictures := [{file:filename(), string()}]
}.

-define(MODULES, [
    starl,
    starl_app,
    starl_election,
    starl_mutex,
    starl_barrier,
    starl_registers,
    starl_geocast,
    starl_dpp,
    starl_run,
    starl_sim,
    starl_property,
    starl_monitor,
    starl_machine
]).

%% The guides in the order of a reader; those that are not named here come last.
-define(GUIDES, [
    {"Begin", [
        "README.md",
        "doc/tutorial/application.md",
        "doc/own_application.md",
        "doc/erlang.md",
        "doc/tutorial/block.md",
        "doc/library.md",
        "doc/notebooks.md",
        "doc/coming_from.md",
        "doc/commands.md"
    ]},
    {"Blocks and worlds", [
        "doc/blocks.md", "doc/guarantees.md", "doc/assumptions.md", "doc/floors.md"
    ]},
    {"Find faults", [
        "doc/finding_faults.md",
        "doc/faults.md",
        "doc/checking.md",
        "doc/debug.md",
        "doc/when.md",
        "doc/histories.md",
        "doc/mutation.md"
    ]},
    {"Look and study", [
        "doc/report.md",
        "doc/view.md",
        "doc/recordings.md",
        "doc/film.md",
        "doc/experiments.md",
        "doc/studies.md",
        "doc/nodes.md",
        "doc/benchmarks.md",
        "python/README.md"
    ]},
    {"Real robots", [
        "doc/live.md", "doc/chassis.md", "doc/create.md", "doc/deploy.md", "doc/trust.md"
    ]},
    {"To work on StarL", [
        "CONTRIBUTING.md",
        "doc/architecture.md",
        "doc/glossary.md",
        "doc/evidence.md",
        "SECURITY.md",
        "CHANGELOG.md"
    ]}
]).

%% What a rank means to the search: the smaller the earlier.
-define(GUIDE, 0).
-define(FIRST_MODULE, 1).
-define(OTHER, 4).

%% @doc Adds guides, contents and search to the pages of these sources in a directory, where EDoc has
%% made its own. Gives the number of guides.
-spec make(Root :: file:filename(), Sources :: [file:filename()], Dir :: file:filename()) ->
    pos_integer().
make(Root, Sources, Dir) ->
    Groups = groups(Root),
    Files = [File || {_, Files} <- Groups, File <- Files],
    Guides = [guide(Root, File, Files) || File <- Files],
    Pages = maps:from_list([{File, Guide} || #{file := File} = Guide <- Guides]),
    Named = parts(Groups, Pages, Sources),
    ok = save(Dir, "modules.html", page("All modules", modules(Sources), "modules.html", Named)),
    lists:foreach(fun(Guide) -> guide_page(Guide, Named, Dir) end, Guides),
    Entries = [entries(Source, Named, Dir) || Source <- Sources],
    ok = save(Dir, "pages.js", script(lists:append([found(G) || G <- Guides] ++ Entries))),
    ok = save(Dir, "pages.css", asset("pages.css")),
    length(Guides).

%% The contents: guides, the modules that matter, and the guides on details.
parts(Groups, Pages, Sources) ->
    {Guides, [Details]} = lists:split(length(?GUIDES), [
        {Name, [
            {Page, Title}
         || File <- Own, #{page := Page, title := Title} <- [map_get(File, Pages)]
        ]}
     || {Name, Own} <- Groups
    ]),
    Names = [name(Source) || Source <- Sources],
    Modules = [
        {Name ++ ".html", Name}
     || Module <- ?MODULES, Name <- [atom_to_list(Module)], lists:member(Name, Names)
    ],
    Guides ++ [{"Modules", Modules ++ [{"modules.html", "all modules"}]}, Details].

groups(Root) ->
    All = [
        lists:nthtail(length(Root) + 1, File)
     || Pattern <- ["*.md", "doc/**/*.md", "apps/*/doc/**/*.md", "python/*.md"],
        File <- filelib:wildcard(filename:join(Root, Pattern))
    ],
    Known = [File || {_, Files} <- ?GUIDES, File <- Files],
    [{Name, [File || File <- Files, lists:member(File, All)]} || {Name, Files} <- ?GUIDES] ++
        [{"Details", lists:usort(All) -- Known}].

%% -- guides ---------------------------------------------------------------------------------

-spec guide(file:filename(), file:filename(), [file:filename()]) -> guide().
guide(Root, File, Files) ->
    {ok, Bytes} = file:read_file(filename:join(Root, File)),
    Text = unicode:characters_to_list(Bytes),
    Link = fun(To) -> link(To, File, Files, Root) end,
    {Html, Sections} = starl_dev_doc_markdown:html(Text, Link),
    #{
        file => File,
        page => page_of(File),
        title => title(Sections, File),
        html => Html,
        sections => Sections,
        pictures => pictures(Text, File, Root)
    }.

title([{_, Title, _, _} | _], _File) -> Title;
title([], File) -> filename:rootname(filename:basename(File)).

page_of("README.md") -> "index.html";
page_of(File) -> flat(filename:rootname(File)) ++ ".html".

flat(File) -> "guide-" ++ lists:flatten(string:replace(File, "/", "-", all)).

%% Another guide, a picture, or a page of the web; what else is in the checkout is named only.
link("http" ++ _ = To, _File, _Files, _Root) ->
    To;
link("#" ++ _ = To, _File, _Files, _Root) ->
    To;
link(To, File, Files, Root) ->
    [Path | Place] = string:split(To, "#"),
    Target = beside(Path, File),
    case {lists:member(Target, Files), is_picture(Target, Root)} of
        {true, _} -> lists:append([page_of(Target) | ["#" ++ Name || Name <- Place]]);
        {false, true} -> flat(Target);
        {false, false} -> none
    end.

beside(Path, File) ->
    Parts = filename:split(filename:join(filename:dirname(File), Path)),
    filename:join(["." | lists:reverse(lists:foldl(fun stepped/2, [], Parts))]) -- "./".

stepped(".", Parts) -> Parts;
stepped("..", [_ | Parts]) -> Parts;
stepped(Part, Parts) -> [Part | Parts].

is_picture(File, Root) ->
    lists:member(filename:extension(File), [".svg", ".png"]) andalso
        filelib:is_regular(filename:join(Root, File)).

pictures(Text, File, Root) ->
    {match, Found} = re:run(["()" | Text], "[(\"]([^()\"\\s]*)[)\"]", [
        global, unicode, {capture, all_but_first, list}
    ]),
    [
        {filename:join(Root, Target), flat(Target)}
     || [Path] <- Found, Path =/= "", Target <- [beside(Path, File)], is_picture(Target, Root)
    ].

guide_page(#{page := Page, title := Title, html := Html, pictures := Pictures}, Named, Dir) ->
    ok = save(Dir, Page, page(Title, Html, Page, Named)),
    lists:foreach(
        fun({From, To}) -> {ok, _} = file:copy(From, filename:join(Dir, To)) end, Pictures
    ).

found(#{page := Page, title := Title, sections := Sections}) ->
    [
        [Name, Page ++ "#" ++ Place, string:slice(Text, 0, 1500), ?GUIDE]
     || {_, Heading, Place, Text} <- Sections,
        Name <- [
            case Heading of
                Title -> Title;
                _ -> Title ++ ": " ++ Heading
            end
        ]
    ].

%% -- modules --------------------------------------------------------------------------------

modules(Sources) ->
    Apps = lists:usort([app(Source) || Source <- Sources]),
    [
        [
            ["<h2>", App, "</h2>\n<p>"],
            lists:join(", ", [
                ["<a href=\"", Name, ".html\">", Name, "</a>"]
             || Name <- lists:sort([name(S) || S <- Sources, app(S) =:= App])
            ]),
            "</p>\n"
        ]
     || App <- Apps
    ].

app(Source) ->
    Up = lists:reverse(filename:split(Source)),
    ["src", App | _] = lists:dropwhile(fun(Part) -> Part =/= "src" end, Up),
    App.

name(Source) -> filename:basename(Source, ".erl").

%% EDoc's page of a module gets the column; what it tells of is found.
entries(Source, Named, Dir) ->
    Name = name(Source),
    File = Name ++ ".html",
    {ok, Bytes} = file:read_file(filename:join(Dir, File)),
    Text = unicode:characters_to_binary(Bytes),
    Headed = string:replace(Text, "</head>", [head(), "</head>"]),
    Bodied = string:replace(Headed, "<body bgcolor=\"white\">", ["<body>", contents(File, Named)]),
    ok = save(Dir, File, string:replace(Bodied, "</body>", [scripts(), "</body>"])),
    Rank =
        case lists:member(list_to_atom(Name), ?MODULES) of
            true -> ?FIRST_MODULE;
            false -> ?OTHER
        end,
    {match, [First]} = re:run(Text, "</ul>(.*?)(?:\n\n|<)", [
        unicode, dotall, {capture, all_but_first, list}
    ]),
    [[Name, File, First, Rank] | functions(Name, File, Text, Rank)].

functions(Name, File, Text, Rank) ->
    Anchor = "<h3 class=\"function\"><a name=\"([^\"]*)-([0-9]+)\"",
    Found =
        case re:run(Text, Anchor, [global, {capture, all_but_first, list}]) of
            {match, All} -> All;
            nomatch -> []
        end,
    [
        [
            lists:append([Name, ":", F, "/", Arity]),
            lists:append([File, "#", F, "-", Arity]),
            "",
            Rank
        ]
     || [F, Arity] <- Found
    ].

%% -- pages ----------------------------------------------------------------------------------

page(Title, Html, Page, Named) ->
    [
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>",
        Title,
        "</title>\n",
        head(),
        "</head>\n<body>\n",
        contents(Page, Named),
        Html,
        scripts(),
        "</body></html>\n"
    ].

head() ->
    "<meta name=\"viewport\" content=\"width=device-width\">\n"
    "<link rel=\"stylesheet\" href=\"pages.css\">\n".

scripts() -> "<script src=\"pages.js\"></script>\n".

contents(Here, Named) ->
    [
        "<div id=\"contents\"><input id=\"search\" type=\"search\" placeholder=\"Search ( / )\" "
        "autocomplete=\"off\"><ul id=\"found\"></ul>\n",
        [part(Name, Links, Here) || {Name, [_ | _] = Links} <- Named],
        "</div>\n"
    ].

part(Name, Links, Here) ->
    [
        ["<h4>", Name, "</h4><ul>\n"],
        [
            [
                "<li",
                [" class=\"here\"" || Page =:= Here],
                "><a href=\"",
                Page,
                "\">",
                Title,
                "</a>\n"
            ]
         || {Page, Title} <- Links
        ],
        "</ul>\n"
    ].

script(Entries) ->
    Value = [[text(Title), text(Page), text(Text), Rank] || [Title, Page, Text, Rank] <- Entries],
    ["var ENTRIES = ", starl_json:encode(Value), ";\n", asset("pages.js")].

text(Chars) ->
    unicode:characters_to_binary(re:replace(Chars, "\\s+", " ", [global, unicode, {return, list}])).

asset(Name) ->
    {ok, Bytes} = file:read_file(filename:join([code:priv_dir(starl_dev), "pages", Name])),
    Bytes.

save(Dir, Name, Text) ->
    starl_cli_out:sure(Name, file:write_file(filename:join(Dir, Name), utf8(Text))).

utf8(Bytes) when is_binary(Bytes) -> Bytes;
utf8(Text) -> unicode:characters_to_binary(Text).
