%% A module of the user's own as a chassis: its callbacks and its options.
%%
%% Holds: A mistake in a file of one's own is one line with file and line
%% Red: 073438b3 has no such bodies
-module(starl_live_own_tests).
-include_lib("eunit/include/eunit.hrl").

-define(CALLBACKS,
    "-export([open/1, drive/4, actuate/4, stop/1, hear/2, close/1]).\n"
    "open(_) -> {ok, s}.\ndrive(_, _, _, S) -> {[], S}.\nactuate(_, _, _, S) -> {[], S}.\n"
    "stop(S) -> S.\nhear(_, _) -> unknown.\nclose(_) -> ok.\n"
).
-define(EXPORTS, "-export([options/0]).\n").
-define(OPTIONS,
    "options() -> [{port, {integer, 1, 65535}, 4000, \"of the bot\"}].\n"
).

a_sound_module_test() ->
    ?assertEqual({ok, #{}}, checked(?CALLBACKS, #{})),
    ?assertEqual({ok, #{port => 4000}}, checked(?EXPORTS ?CALLBACKS ?OPTIONS, #{})),
    ?assertEqual({ok, #{port => 9}}, checked(?EXPORTS ?CALLBACKS ?OPTIONS, #{port => 9})).

%% One line, with the place.
mistakes_test_() ->
    [
        ?_assertEqual({error, Why}, checked(Text, Given))
     || {Text, Given, Why} <- [
            {"-export([open/1]).\nopen(_) -> {ok, s}.\n", #{},
                "own_bot.erl:1: actuate/4 is missing; a chassis exports actuate/4, close/1, "
                "drive/4, hear/2, open/1, stop/1"},
            {?CALLBACKS, #{port => 1}, "own_bot.erl:1: takes no options: it has no options/0"},
            {
                ?EXPORTS ?CALLBACKS ?OPTIONS,
                #{port => 0},
                "own_bot.erl:9: port: a whole number from 1 to 65535 expected, not 0"
            },
            {
                ?EXPORTS ?CALLBACKS ?OPTIONS,
                #{pott => 1},
                "own_bot.erl:9: unknown key pott (did you mean port?)"
            },
            {
                ?EXPORTS ?CALLBACKS "options() -> [port].\n",
                #{},
                "own_bot.erl:9: options/0: an option is {Key, Type, Default, \"Doc\"}, not port"
            }
        ]
    ].

checked(Text, Given) ->
    Dir = filename:join(os:getenv("TMPDIR", "/tmp"), "starl-own-" ++ os:getpid()),
    File = filename:join(Dir, "own_bot.erl"),
    ok = filelib:ensure_dir(File),
    ok = file:write_file(File, ["-module(own_bot). ", Text]),
    {ok, own_bot, Beam} = compile:file(File, [binary, debug_info]),
    {module, own_bot} = code:load_binary(own_bot, File, Beam),
    Answer = starl_live_own:check(own_bot, starl_live_chassis, Given),
    ok = file:del_dir_r(Dir),
    true = code:delete(own_bot),
    _ = code:purge(own_bot),
    case Answer of
        {error, Why} -> {error, lists:flatten(io_lib:format("~ts", [Why]))};
        Found -> Found
    end.
