%% The source that is named wins over what was once compiled from it.
-module(starl_cli_source_tests).
-include_lib("eunit/include/eunit.hrl").

%% Old beams of an application and of its helper lie beside the sources, and on the code path.
stale_beams_test() ->
    starl_cli_vm:in_directory(fun(Dir) ->
        write(Dir, old),
        [
            {ok, _} = compile:file(filename:join(Dir, Name), [{outdir, Dir}])
         || Name <- ["stale_app.erl", "stale_help.erl"]
        ],
        write(Dir, new),
        true = code:add_patha(Dir),
        try
            {ok, _} = starl_cli_source:load(filename:join(Dir, "stale_app.erl")),
            ?assertEqual({done, {new, new}}, apply(stale_app, step, [start, s]))
        after
            true = code:del_path(Dir),
            [code:purge(M) || M <- [stale_app, stale_help], code:delete(M)]
        end
    end).

%% A name that a library has is not taken from it, wherever the source lies.
library_test() ->
    starl_cli_vm:in_directory(fun(Dir) ->
        File = filename:join(Dir, "lists.erl"),
        ok = file:write_file(File, "-module(lists).\n-export([step/2]).\nstep(_, s) -> s.\n"),
        {error, [Line]} = starl_cli_source:load(File),
        ?assertEqual(
            File ++ ": there is a module lists already; give yours another name",
            unicode:characters_to_list(Line)
        )
    end).

%% Whoever has warnings count as errors is told them.
a_warning_that_counts_as_an_error_is_said_test() ->
    starl_cli_vm:in_directory(fun(Dir) ->
        File = filename:join(Dir, "strict_app.erl"),
        ok = file:write_file(
            File,
            "-module(strict_app).\n-compile(warnings_as_errors).\n-export([step/2]).\n"
            "step(_, s) ->\n    X = 1,\n    {done, s}.\n"
        ),
        {error, [Line]} = starl_cli_source:load(File),
        ?assertEqual(
            File ++ ":5: variable 'X' is unused", unicode:characters_to_list(Line)
        )
    end).

%% A text would be a token for each character. Lists of numbers are lists of tokens.
a_text_is_no_token_test() ->
    starl_cli_vm:in_directory(fun(Dir) ->
        File = filename:join(Dir, "text_app.erl"),
        ok = file:write_file(
            File,
            "-module(text_app).\n-export([step/2]).\n"
            "step(R, s) ->\n    starl_mutex:acquire(R, [100, 101]),\n"
            "    starl_mutex:acquire(R, \"tok\"),\n    {done, s}.\n"
        ),
        {error, [Line]} = starl_cli_source:load(File),
        ?assertEqual(
            File ++
                ":5: starl_mutex:acquire/2: \"tok\" names a token for each of its characters; "
                "use an atom, or <<\"tok\">>",
            unicode:characters_to_list(Line)
        )
    end).

write(Dir, Version) ->
    App =
        "-module(stale_app).\n-behaviour(starl_app).\n-export([init/2, step/2]).\n"
        "init(_, _) -> s.\nstep(_, s) -> {done, {~p, stale_help:version()}}.\n",
    Help = "-module(stale_help).\n-export([version/0]).\nversion() -> ~p.\n",
    [
        ok = file:write_file(filename:join(Dir, Name), io_lib:format(Text, [Version]))
     || {Name, Text} <- [{"stale_app.erl", App}, {"stale_help.erl", Help}]
    ].
