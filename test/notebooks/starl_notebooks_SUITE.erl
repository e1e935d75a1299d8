%% The notebooks in doc/notebooks: their cells run as they stand, with Debian's Elixir, and answer what
%% the notebooks show. Their first cell takes StarL from a repository with the sources that are tested.
%%
%% Holds: The notebooks' cells run as they stand, and answer what the notebooks show; a cell is a
%% reload
%% Red: an output that was not the cell's; `reload` that loads nothing: no problem is told
%% Holds: What a mix project compiles for a notebook has all that it calls
%% Red: a `mix.exs` without the modules' folders; a call of another module of `starl_lab`
-module(starl_notebooks_SUITE).
-include_lib("stdlib/include/assert.hrl").

-export([suite/0, all/0, cells_answer_what_notebooks_show/1]).

suite() -> [{timetrap, {minutes, 10}}].

all() -> [cells_answer_what_notebooks_show].

cells_answer_what_notebooks_show(Config) ->
    case os:find_executable("elixir") of
        false -> {skip, "no Elixir (apt-get install elixir)"};
        _ -> cells(proplists:get_value(priv_dir, Config))
    end.

cells(Dir) ->
    Root = starl_first_hour_ct:root(),
    Repository = starl_first_hour_ct:repository(filename:join(Dir, "repository")),
    Notebooks = filelib:wildcard(filename:join([Root, "doc", "notebooks", "*.livemd"])),
    ?assertEqual(["class", "study"], [filename:basename(N, ".livemd") || N <- Notebooks]),
    Words = [
        filename:join([Root, "test", "notebooks", "notebook_cells.exs"]),
        "git: \"URL\"=git: \"file://" ++ Repository ++ "\""
        | Notebooks
    ],
    {Status, Text} = starl_first_hour_ct:sh(
        lists:append(["elixir" | [" '" ++ Word ++ "'" || Word <- Words]] ++ [" 2>cells.log"]),
        Dir,
        [
            {"ERL_LIBS", false}, {"MIX_INSTALL_DIR", filename:join(Dir, "install")}
        ]
    ),
    ?assertEqual(0, Status, Text),
    [
        ?assertMatch({match, _}, re:run(Text, Line, [multiline]), Text)
     || Line <- [
            "^class.livemd: 12 cells, 5 outputs, ([0-9]{3}) of \\1 pictures$",
            "^study.livemd: 5 cells, 2 outputs, 1 of 1 pictures$"
        ]
    ].
