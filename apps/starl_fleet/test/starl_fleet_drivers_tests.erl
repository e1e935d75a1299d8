%% The user's own chassis of a fleet file and of a scenario.
-module(starl_fleet_drivers_tests).
-include_lib("eunit/include/eunit.hrl").

-define(FLEET(Robots),
    "#{name => \"own\", app => painting, robots => #{1 => #{host => \"a\"" Robots "}}}.\n"
).

%% The module takes the place of its file, and goes into the release; a program keeps its words.
fleet_test() ->
    Two = in_dir(
        "#{name => \"own\", app => painting, positioning => none, robots => #{\n"
        "1 => #{host => \"a\", chassis => \"exec:/opt/bot --port 3\"},\n"
        "2 => #{host => \"b\", chassis => {\"two_wheels.erl\", #{port => 9}}}}}.\n"
    ),
    {ok, #{fleet := #{robots := Robots} = Fleet, code := Code}} = Two,
    ?assertEqual([two_wheels, two_wheels_robot], lists:sort([Module || {Module, _, _} <- Code])),
    ?assertMatch(#{1 := #{chassis := {exec, #{exec := "/opt/bot --port 3"}}}}, Robots),
    ?assertMatch(#{2 := #{chassis := {{module, two_wheels}, #{port := 9}}}}, Robots),
    ?assertEqual(
        {starl_live_exec, #{exec => "/opt/bot --port 3"}}, starl_fleet_adapters:chassis(1, Fleet)
    ),
    ?assertEqual({two_wheels, #{port => 9}}, starl_fleet_adapters:chassis(2, Fleet)),
    %% what the robot's node reads is sound, too
    Text = unicode:characters_to_list(starl_fleet_file:portable(Fleet, #{})),
    {ok, Tokens, _} = erl_scan:string(Text),
    {ok, Given} = erl_parse:parse_term(Tokens),
    ?assertMatch(
        {ok, #{robots := Robots}}, starl_fleet_file:check("fleet.term", Given, starl_painting)
    ),
    ?assert(lists:member(starl_json:codec(), starl_fleet_adapters:drivers(Fleet))).

fleet_mistakes_test_() ->
    [
        ?_assertEqual("fleet.term: " ++ Why, refused(Text))
     || {Text, Why} <- [
            {?FLEET(", chassis => \"nobody.erl\""), "nobody.erl: there is no such file"},
            {
                ?FLEET(", chassis => {\"two_wheels.erl\", #{port => x}}"),
                "two_wheels.erl:11: port: a whole number from 0 to 65535 expected, not x"
            },
            {
                "#{name => \"own\", app => painting, positioning => \"two_wheels.erl\", robots => "
                "#{1 => #{host => \"a\"}}}.\n",
                "two_wheels.erl:7: figures/1 is missing; a source of positions exports close/1, "
                "figures/1, hear/2, open/1"
            }
        ]
    ].

refused(Text) ->
    {error, [Line]} = in_dir(Text),
    Told = unicode:characters_to_list(Line),
    %% without the directory
    lists:flatten(
        string:replace(Told, filename:dirname(hd(string:split(Told, ": "))) ++ "/", "", all)
    ).

%% The answer to a fleet file beside the example.
in_dir(Text) ->
    Dir = filename:join(os:getenv("TMPDIR", "/tmp"), "starl-own-fleet-" ++ os:getpid()),
    File = filename:join(Dir, "fleet.term"),
    ok = filelib:ensure_dir(File),
    Examples = filename:join([root(filename:dirname(code:which(?MODULE))), "examples", "own_body"]),
    [
        {ok, _} = file:copy(filename:join(Examples, Name), filename:join(Dir, Name))
     || Name <- ["two_wheels.erl", "two_wheels_robot.erl"]
    ],
    ok = file:write_file(File, Text),
    Answer = starl_fleet_target:read(File),
    ok = file:del_dir_r(Dir),
    _ = [code:purge(M) || M <- [two_wheels, two_wheels_robot], code:delete(M)],
    case Answer of
        {ok, #{fleet := _}} ->
            _ = [
                {module, M} = code:load_binary(M, F, B)
             || {M, F, B} <- maps:get(code, element(2, Answer))
            ],
            Answer;
        _ ->
            Answer
    end.

root(Dir) ->
    case filelib:is_regular(filename:join(Dir, "starl")) of
        true -> Dir;
        false when Dir =/= "/" -> root(filename:dirname(Dir))
    end.

%% A choice of a command line and its text.
choice_test_() ->
    {chassis, Type, _, _} = starl_chassis_choice:option(),
    [
        ?_assertEqual(Value, starl_options:parse(Type, Text))
     || {Text, Value} <- [
            {"exec:./my_robot.py --fast", {ok, <<"exec:./my_robot.py --fast">>}},
            {"my_bot.erl", {ok, <<"my_bot.erl">>}},
            {"{\"my_bot.erl\", #{port => 1}}", {ok, {"my_bot.erl", #{port => 1}}}},
            {"[create, \"exec:./bot\"]", {ok, [create, "exec:./bot"]}},
            {"my_bot.py", error},
            {"exec", error},
            {"[create, \"bot\"]", error},
            {"[]", error}
        ]
    ].

in_turn_test() ->
    ?assertEqual([<<"exec:./b">>], starl_chassis_choice:in_turn(<<"exec:./b">>)),
    ?assertEqual(["exec:./b"], starl_chassis_choice:in_turn("exec:./b")),
    ?assertEqual(["exec:./b", create], starl_chassis_choice:in_turn(["exec:./b", create])).
