%% The messages between StarL and a program: what it may say, and that nothing it says does more than that.
-module(starl_live_program_message_tests).
-include_lib("eunit/include/eunit.hrl").

-define(HELLO, "{\"op\":\"hello\",\"protocol\":1,\"name\":\"bot\",\"vmax\":400,\"wmax\":2.5").

reads_test_() ->
    [
        ?_assertEqual({ok, Message}, starl_live_program_message:decode(iolist_to_binary(Line)))
     || {Message, Line} <- [
            {{ack, 3, none}, "{\"op\":\"ack\",\"id\":3}"},
            {{done, 3, 17}, "{\"op\":\"done\",\"id\":3,\"t\":17}"},
            {{stalled, 3, none}, "{\"op\":\"stalled\",\"id\":3}"},
            {{refuse, 3, <<"no">>}, "{\"op\":\"refuse\",\"id\":3,\"why\":\"no\"}"},
            {{pose, {1.0, -2.5, 0.0}, 5}, "{\"op\":\"pose\",\"x\":1,\"y\":-2.5,\"th\":0,\"t\":5}"},
            {{sense, {bump, left}}, "{\"op\":\"sense\",\"kind\":\"bump\",\"value\":\"left\"}"},
            {{sense, {other, {<<"nose">>, 4}}}, "{\"op\":\"sense\",\"kind\":\"nose\",\"value\":4}"},
            {{pong, 9}, "{\"op\":\"pong\",\"n\":9,\"more\":[1]}"},
            {{log, <<"hi">>}, "{\"op\":\"log\",\"text\":\"hi\"}"},
            %% a later StarL's message
            {unknown, "{\"op\":\"sing\",\"id\":\"x\"}"}
        ]
    ].

hello_test() ->
    Limits = #{name => <<"bot">>, frame => start, devices => [], vmax => 400, wmax => 2.5},
    Read = fun(More) ->
        starl_live_program_message:decode(iolist_to_binary([?HELLO, More, "}"]))
    end,
    ?assertEqual({ok, {hello, Limits}}, Read("")),
    ?assertEqual({ok, {hello, Limits#{frame := floor}}}, Read(",\"frame\":\"floor\"")),
    ?assertEqual({ok, {hello, Limits#{devices := [<<"pen">>]}}}, Read(",\"devices\":[\"pen\"]")).

%% Each is one line that says what is wrong.
refuses_test_() ->
    [
        {Line, ?_assertEqual({error, Why}, told(Line))}
     || {Line, Why} <- [
            {"", "no JSON"},
            {"hello", "no JSON"},
            {"[1,2]", "no object with an \"op\""},
            {"{\"op\":7}", "no object with an \"op\""},
            {"{\"op\":\"ack\"}", "ack has no whole \"id\""},
            {"{\"op\":\"done\",\"id\":1.5}", "done has no whole \"id\""},
            {"{\"op\":\"ack\",\"id\":1,\"t\":\"now\"}", "ack has a \"t\" that is no time"},
            {"{\"op\":\"pose\",\"x\":1,\"y\":2}", "pose needs \"x\", \"y\" (mm) and \"th\" (rad)"},
            {"{\"op\":\"pose\",\"x\":1e300,\"y\":2,\"th\":0}",
                "pose needs \"x\", \"y\" (mm) and \"th\" (rad)"},
            {"{\"op\":\"pose\",\"x\":NaN,\"y\":2,\"th\":0}", "no JSON"},
            {"{\"op\":\"pong\",\"n\":\"x\"}", "pong lacks a key, or it has a wrong value"},
            {"{\"op\":\"pong\"}", "pong lacks a key, or it has a wrong value"},
            {"{\"op\":\"hello\"}", "hello needs \"protocol\":1"},
            {"{\"op\":\"hello\",\"protocol\":2}", "hello: protocol 2, and this StarL speaks 1"},
            {"{\"op\":\"hello\",\"protocol\":1,\"name\":\"b\",\"vmax\":0,\"wmax\":1}",
                "hello needs \"vmax\", mm/s"},
            {"{\"op\":\"hello\",\"protocol\":1,\"vmax\":1,\"wmax\":1,\"chassis\":\"legs\"}",
                "hello needs \"name\", a text; \"chassis\":\"differential\", the one that there is"}
        ]
    ].

told(Line) ->
    case starl_live_program_message:decode(list_to_binary(Line)) of
        {error, Why} -> {error, lists:flatten(io_lib:format("~ts", [Why]))};
        Read -> Read
    end.

%% Whatever a program says is a message or an error: random bytes, and messages that bytes have hit.
%% Holds: Whatever a program says is a message or an error
%% Red: 073438b3 has no such bodies; seen red without the code
anything_is_borne_test() ->
    Seed = erlang:phash2(make_ref()),
    io:format(user, "seed ~b~n", [Seed]),
    _ = rand:seed(exsss, Seed),
    Good = [
        <<"{\"op\":\"pose\",\"x\":1,\"y\":-2.5,\"th\":0,\"t\":5}">>,
        <<"{\"op\":\"refuse\",\"id\":3,\"why\":\"no\"}">>,
        <<?HELLO, "}">>
    ],
    [
        ?assertMatch(
            {Is, _} when Is =:= ok; Is =:= error, starl_live_program_message:decode(hit(Line))
        )
     || _ <- lists:seq(1, 700), Line <- [rand:bytes(rand:uniform(40)) | Good]
    ].

hit(Line) ->
    At = rand:uniform(byte_size(Line)) - 1,
    <<Before:At/binary, _, After/binary>> = Line,
    <<Before/binary, (rand:uniform(256) - 1), After/binary>>.

writes_test() ->
    Line = fun(Command) -> iolist_to_binary(starl_live_program_message:encode(Command)) end,
    ?assertEqual(
        <<"{\"id\":4,\"legs\":[{\"ms\":250.5,\"v\":100,\"w\":-0.5}],\"op\":\"drive\"}">>,
        Line({drive, 4, [{100, -0.5, 250.5}]})
    ),
    ?assertEqual(
        <<"{\"device\":\"pen\",\"id\":5,\"op\":\"set\",\"value\":\"down\"}">>,
        Line({set, 5, <<"pen">>, <<"down">>})
    ),
    ?assertEqual(
        <<"{\"at\":[1.0,2.0,0.5],\"op\":\"hello\",\"protocol\":1,\"robot\":2}">>,
        Line({hello, #{robot => 2, at => {1.0, 2.0, 0.5}}})
    ),
    ?assertEqual(<<"{\"op\":\"stop\"}">>, Line(stop)).

values_test() ->
    ?assertEqual({ok, <<"down">>}, starl_live_program_message:value(down)),
    ?assertEqual({ok, [<<"red">>, 3]}, starl_live_program_message:value({red, 3})),
    ?assertEqual(none, starl_live_program_message:value(self())),
    ?assertEqual(none, starl_live_program_message:value({red, self()})).
