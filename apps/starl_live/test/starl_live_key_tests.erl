-module(starl_live_key_tests).
-include_lib("eunit/include/eunit.hrl").
-include_lib("kernel/include/file.hrl").

files_test_() ->
    {foreach, fun folder/0, fun file:del_dir_r/1, [
        fun(Dir) -> {Name, fun() -> Test(filename:join(Dir, "fleet.key")) end} end
     || {Name, Test} <- [
            {"generated and loaded", fun generated/1},
            {"never written over", fun kept/1},
            {"missing", fun missing/1},
            {"no folder", fun no_folder/1},
            {"read by others", fun open_to_others/1},
            {"too short", fun too_short/1},
            {"empty", fun empty/1},
            {"too long", fun too_long/1},
            {"no digits", fun no_digits/1},
            {"beyond a file", fun beyond_a_file/1},
            {"a folder", fun a_folder/1}
        ]
    ]}.

folder() ->
    Dir = filename:join(
        os:getenv("TMPDIR", "/tmp"),
        lists:concat(["starl_key_", erlang:unique_integer([positive]), "_", os:getpid()])
    ),
    ok = file:make_dir(Dir),
    Dir.

generated(File) ->
    ok = starl_live_key:generate(File),
    {ok, #file_info{mode = Mode, size = 65}} = file:read_file_info(File),
    ?assertEqual(8#600, Mode band 8#777),
    {ok, Key} = starl_live_key:load(File),
    {ok, Text} = file:read_file(File),
    ?assertEqual(32, byte_size(Key())),
    Hex = lists:append([io_lib:format("~2.16.0b", [Byte]) || <<Byte>> <= Key()]) ++ "\n",
    ?assertEqual(binary_to_list(Text), lists:flatten(Hex)),
    ?assertEqual(nomatch, string:find(io_lib:format("~p", [Key]), string:trim(Text))).

%% A key in memory is as long, and another one each time.
new_test() ->
    [One, Other] = [(starl_live_key:new())() || _ <- [1, 2]],
    ?assertEqual([32, 32], [byte_size(Key) || Key <- [One, Other]]),
    ?assertNotEqual(One, Other).

kept(File) ->
    ok = starl_live_key:generate(File),
    {ok, Before} = file:read_file(File),
    {error, Line} = starl_live_key:generate(File),
    said("stands there already", File, Line),
    ?assertEqual({ok, Before}, file:read_file(File)).

missing(File) -> refused("no such file; the fleet's key is made by: ./starl keys", File).

no_folder(File) ->
    {error, Line} = starl_live_key:generate(filename:join(File, "key")),
    said("/key: no such file or directory", File, Line).

open_to_others(File) ->
    ok = starl_live_key:generate(File),
    [
        begin
            ok = file:change_mode(File, Mode),
            {error, Line} = starl_live_key:load(File),
            ?assertEqual(
                File ++ ": others may read this key; say: chmod 600 " ++ File,
                lists:flatten(Line)
            )
        end
     || Mode <- [8#604, 8#602, 8#601, 8#640, 8#620, 8#610]
    ].

too_short(File) -> written("abc\n", "3 characters, not the 64 hexadecimal digits", File).

empty(File) -> written("", "0 characters", File).

%% However long a file is, no more than 1000 bytes of it are read.
too_long(File) -> written(lists:duplicate(2000, $7), ": 1000 characters", File).

beyond_a_file(File) ->
    ok = starl_live_key:generate(File),
    refused("not a directory", filename:join(File, "key")).

no_digits(File) -> written(lists:duplicate(64, $x), "not hexadecimal digits only", File).

a_folder(File) -> refused("a file expected", filename:dirname(File)).

written(Text, Word, File) ->
    ok = file:write_file(File, Text),
    ok = file:change_mode(File, 8#600),
    refused(Word, File).

refused(Word, File) ->
    {error, Line} = starl_live_key:load(File),
    said(Word, File, Line).

said(Word, File, Line) ->
    Text = unicode:characters_to_list(Line),
    ?assertNotEqual(nomatch, string:find(Text, Word)),
    ?assertNotEqual(nomatch, string:find(Text, File)),
    ?assertEqual(nomatch, string:find(Text, "\n")).
