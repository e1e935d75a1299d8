%% Calls of a user's modules whose values are not the robot's.
-module(starl_cli_lint_tests).
-include_lib("eunit/include/eunit.hrl").

calls_that_are_not_the_robots_are_found_test() ->
    Calls = [
        {"rand:uniform()", random},
        {"os:system_time()", clock},
        {"make_ref()", unique},
        {"self()", process},
        {"ets:new(t, [])", shared},
        {"ets:lookup(t, k)", shared},
        {"persistent_term:get(k)", shared},
        {"application:get_env(a, k)", environment},
        {"application:set_env(a, k, v)", environment},
        {"os:getenv(\"HOME\")", environment},
        {"rand:uniform_s(1)", none},
        {"application:ensure_all_started(a)", none},
        {"maps:get(k, #{})", none}
    ],
    [?assertEqual({Call, Kind}, {Call, kind(Call)}) || {Call, Kind} <- Calls].

%% Each of them has a word on what to use instead.
kind(Call) ->
    case starl_cli_lint:calls(beam(Call)) of
        [] ->
            none;
        [One] ->
            Text = unicode:characters_to_list(starl_cli_lint:text(One)),
            ?assertMatch({match, _}, re:run(Text, "^caller\\.erl:1: .*; use ")),
            hd([Kind || {Part, Kind} <- kinds(), string:find(Text, Part) =/= nomatch])
    end.

kinds() ->
    [
        {"random number", random},
        {"clock", clock},
        {"counter", unique},
        {"another process", process},
        {"shared", shared},
        {"an option", environment}
    ].

beam(Call) ->
    {ok, Tokens, _} = erl_scan:string("f() -> " ++ Call ++ "."),
    {ok, Function} = erl_parse:parse_form(Tokens),
    Head = [{attribute, 1, module, caller}, {attribute, 1, export, [{f, 0}]}],
    {ok, caller, Beam} = compile:forms(Head ++ [Function], [debug_info]),
    Beam.
