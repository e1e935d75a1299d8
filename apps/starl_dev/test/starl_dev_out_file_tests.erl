%% A result in a single file does not replace an earlier one without a word.
-module(starl_dev_out_file_tests).
-include_lib("eunit/include/eunit.hrl").

-define(ASKED(File, Overwrite), starl_cli_out:file(File, Usual, Overwrite)).

a_file_is_kept_test() ->
    starl_cli_vm:in_directory(fun(Dir) ->
        Usual = filename:join(Dir, "bench.json"),
        Own = filename:join(Dir, "own.json"),
        ?assertEqual({[], Usual}, ?ASKED(none, false)),
        ?assertEqual({[], Own}, ?ASKED(Own, false)),
        [ok = file:write_file(File, "") || File <- [Usual, Own]],
        ?assertEqual({[], filename:join(Dir, "bench-2.json")}, ?ASKED(none, false)),
        ?assertEqual({[], Usual}, ?ASKED(none, true)),
        {[Line], Own} = ?ASKED(Own, false),
        ?assertEqual(
            "--out: " ++ Own ++ " is there already; --overwrite replaces it",
            unicode:characters_to_list(Line)
        ),
        ?assertEqual({[], Own}, ?ASKED(Own, true)),
        ok = file:write_file(filename:join(Dir, "bench-2.json"), ""),
        ?assertEqual({[], filename:join(Dir, "bench-3.json")}, ?ASKED(none, false)),
        %% A device takes whatever is written.
        ?assertEqual({[], "/dev/null"}, ?ASKED("/dev/null", false))
    end).

%% The commands ask.
commands_ask_test_() ->
    {timeout, 30, fun() ->
        starl_cli_vm:in_directory(fun(Dir) ->
            File = filename:join(Dir, "there"),
            ok = file:write_file(File, "kept"),
            [
                ?assertEqual({Module, {error, [line(File)]}}, {Module, texts(Run(Call))})
             || {Module, Args} <- [
                    {starl_dev_bench, ["dpp"]}, {starl_dev_table, ["--pictures", "lines"]}
                ],
                #{run := Run} = Command <- [Module:command()],
                {ok, Call} <- [starl_cli_dispatch:read(Command, Args ++ ["--out", File])]
            ],
            ?assertEqual({ok, <<"kept">>}, file:read_file(File))
        end)
    end}.

line(File) -> "--out: " ++ File ++ " is there already; --overwrite replaces it".

texts({error, Lines}) -> {error, [unicode:characters_to_list(Line) || Line <- Lines]}.
