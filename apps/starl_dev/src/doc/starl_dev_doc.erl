%% @doc The command `./starl doc': makes the pages of all modules ({@link starl_dev_doc_pages}) and
%% of the guides ({@link starl_dev_doc_site}). It also makes the help of modules in the shells of
%% Erlang and Elixir: `h(starl)'.
-module(starl_dev_doc).
-behaviour(starl_cli_command).

-export([command/0]).
-export([make_chunks/2]).

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "doc",
        synopsis => "make the pages of guides and modules, for a browser",
        about => [
            "Makes a page for each guide, and one for each module by EDoc, with contents beside it and "
            "a search over all of them, which needs no server. EDoc's warnings and links that lead nowhere "
            "are printed, one line each.",
            "Afterwards the shells know them, too: h(starl), h(starl_mutex, acquire) in ./starl shell. In the "
            "directory of your own project, built by rebar3 or mix, it makes no pages, but its shells "
            "(rebar3 shell, iex -S mix) tell of its modules and of StarL's."
        ],
        flags => [
            {"Flags", [
                {out, string, default(),
                    "directory for the pages; earlier pages in it are replaced"},
                {tables, switch, false,
                    "only writes the tables of the guides that follow from the code"}
            ]}
        ],
        statuses => [{0, "the pages are made"}, {1, "some pages have problems, which are printed"}],
        run => fun run/1
    }.

default() -> starl_cli_out:shown(filename:join([starl_cli_target:root(), "_build", "doc"])).

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{values := #{tables := true}}) ->
    lists:foreach(fun write_tables/1, starl_dev_doc_tables:pages()),
    0;
run(#{values := #{out := Dir}} = Call) ->
    Root = starl_cli_target:root(),
    Sources = filelib:wildcard(filename:join([Root, "apps", "*", "src", "**", "*.erl"])),
    case {Sources, is_project(Root), is_ours(Dir)} of
        {[], _, _} -> {error, ["there are no sources under ", Root]};
        {_, true, _} -> for_project(Sources, Call);
        {_, false, false} -> {error, [["--out: ", Dir, " holds something else than such pages"]]};
        {_, false, true} -> for_checkout(Sources, Root, Dir)
    end.

write_tables(Page) ->
    File = filename:join(starl_cli_target:root(), Page),
    {ok, Bytes} = file:read_file(File),
    Text = unicode:characters_to_list(Bytes),
    ok = file:write_file(File, unicode:characters_to_binary(starl_dev_doc_tables:update(Text))),
    starl_cli_terminal:out("~ts\n", [Page]).

for_checkout(Sources, Root, Dir) ->
    Made =
        case starl_dev_doc_pages:make(Sources, overview(Root), Dir) of
            {ok, Count} -> with_guides(starl_dev_doc_site:make(Root, Sources, Dir), Count, Dir);
            {error, _} = Error -> Error
        end,
    case told(Made, Dir) of
        0 -> shells(Sources, [filename:join([Root, "_build", "default"])]);
        Status -> Status
    end.

with_guides(Guides, Modules, Dir) ->
    case starl_dev_doc_pages:dead_links(Dir) of
        [] -> {ok, Guides, Modules};
        Problems -> {error, Problems}
    end.

%% The directory of a user's own project.
is_project(Root) ->
    {ok, Here} = file:get_cwd(),
    Here =/= filename:absname(Root) andalso
        lists:any(fun filelib:is_regular/1, ["rebar.config", "mix.exs"]).

for_project(_Sources, #{given := #{out := _}}) ->
    {error, ["--out: the pages are made in StarL's own checkout"]};
for_project(Sources, _Call) ->
    case [filename:dirname(Lib) || Lib <- filelib:wildcard("_build/*/lib")] of
        [] -> {error, ["there is no build of this project yet: rebar3 compile, or mix compile"]};
        Builds -> shells(Sources ++ filelib:wildcard("src/**/*.erl"), Builds)
    end.

shells(Sources, Builds) ->
    Count = make_chunks(Sources, Builds),
    starl_cli_terminal:out("~b modules are known to the shell: h(starl).\n", [Count]),
    0.

overview(Root) -> filename:join([Root, "doc", "overview.edoc"]).

%% Only a directory that this command has made may be emptied.
is_ours(Dir) ->
    not filelib:is_file(Dir) orelse filelib:is_regular(filename:join(Dir, "edoc-info")).

told({ok, Guides, Modules}, Dir) ->
    starl_cli_terminal:out("~b guides, ~b modules: ~ts\n", [
        Guides, Modules, filename:join(Dir, "index.html")
    ]),
    0;
told({error, Problems}, _Dir) ->
    [starl_cli_terminal:complain(Problem) || Problem <- Problems],
    1.

%% -- the shells' pages ---------------------------------------------------------------------

%% EDoc writes a chunk (EEP 48) for each module. `code:get_doc/1' looks for it in a folder `doc/chunks'
%% beside the module's code, and beside each folder above that: one such folder serves a whole build.

%% @doc Makes the chunks of these sources, in the folder of chunks of each build. Gives their number.
-spec make_chunks([file:filename()], Builds :: [file:filename(), ...]) -> non_neg_integer().
make_chunks(Files, [Build | Builds]) ->
    Dir = chunks(Build),
    _ = file:del_dir_r(Dir),
    Sources = filename:join(Build, "doc/src"),
    Copies = starl_dev_doc_pages:copies(Files, Sources),
    Options = [{doclet, edoc_doclet_chunks}, {layout, edoc_layout_chunks}, {preprocess, false}],
    ok = edoc:files(Copies, [{dir, filename:join(Build, "doc")}, {todo, false} | Options]),
    ok = file:del_dir_r(Sources),
    Made = filelib:wildcard(filename:join(Dir, "*.chunk")),
    _ = [copied(Chunk, chunks(Other)) || Other <- Builds, Chunk <- Made],
    length(Made).

chunks(Build) -> filename:join([Build, "doc", "chunks"]).

copied(Chunk, Dir) ->
    To = filename:join(Dir, filename:basename(Chunk)),
    ok = filelib:ensure_dir(To),
    {ok, _} = file:copy(Chunk, To).
