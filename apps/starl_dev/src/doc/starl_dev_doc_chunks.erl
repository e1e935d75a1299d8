%% @doc Makes what Erlang's and Elixir's shells tell of modules: `h(starl)', `h(starl_mutex, acquire)'. EDoc
%% writes a chunk (EEP 48) for each module. `code:get_doc/1' looks for it in a folder `doc/chunks' beside
%% the module's code, and beside each folder above that: one such folder serves a whole build.
-module(starl_dev_doc_chunks).

-export([make/2]).

%% @doc Makes the chunks of these sources, in the folder of chunks of each build. Gives how many.
-spec make([file:filename()], Builds :: [file:filename(), ...]) -> non_neg_integer().
make(Files, [Build | Builds]) ->
    Dir = chunks(Build),
    _ = file:del_dir_r(Dir),
    Sources = filename:join(Build, "doc/src"),
    Copies = starl_dev_doc_source:copies(Files, Sources),
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
