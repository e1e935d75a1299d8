%% Maps of ROS: written in all the ways of YAML and PGM, they are the same plan, or a line says what is not followed.
-module(starl_floor_ros_tests).
-compile({no_auto_import, [floor/1]}).
-include_lib("eunit/include/eunit.hrl").

-define(PGM, <<"P5 3 2 255\n", 254, 254, 205, 0, 254, 254>>).

%% Three pixels by two of 0.5 m: one is unknown, one is a wall.
plan() ->
    starl_floor:new(#{
        size => {1500, 1000},
        walls => [starl_floor:box(0, 0, 500, 500), starl_floor:box(1000, 500, 1500, 1000)]
    }).

floor(Yaml) -> floor(Yaml, ?PGM).

floor(Yaml, Pgm) ->
    Dir = "/tmp/starl-ros-" ++ os:getpid(),
    ok = filelib:ensure_path(Dir),
    ok = file:write_file(filename:join(Dir, "m #1.pgm"), Pgm),
    ok = file:write_file(filename:join(Dir, "m.pgm"), Pgm),
    Read = starl_floor_ros:parse(iolist_to_binary(Yaml), Dir),
    ok = file:del_dir_r(Dir),
    case Read of
        {ok, #{size := Size, walls := Walls}} -> {Size, lists:sort([lists:sort(W) || W <- Walls])};
        {error, {Line, Why}} -> {Line, unicode:characters_to_list(Why)}
    end.

expected() ->
    #{size := Size, walls := Walls} = plan(),
    {Size, lists:sort([lists:sort(W) || W <- Walls])}.

%% The keys in their usual form, but for these.
keys(Changed) -> keys(Changed, "").

keys(Changed, Indent) ->
    Usual = #{
        "image" => "m.pgm",
        "resolution" => "0.5",
        "origin" => "[-1.0, -2.0, 0.0]",
        "negate" => "0",
        "occupied_thresh" => "0.65",
        "free_thresh" => "0.196"
    },
    [
        [
            Indent,
            Key,
            ":",
            [[" ", V] || V <- [Value], hd(V) =/= $\n],
            [V || V <- [Value], hd(V) =:= $\n],
            "\n"
        ]
     || {Key, Value} <- lists:sort(maps:to_list(maps:merge(Usual, Changed)))
    ].

the_same_plan_in_all_forms_of_yaml_test_() ->
    Crlf = string:replace(lists:flatten(keys(#{})), "\n", "\r\n", all),
    Json =
        "{\"image\": \"m.pgm\", \"resolution\": 0.5, \"origin\": [0, 0, 0], \"negate\": 0,\n"
        "\"occupied_thresh\": 0.65, \"free_thresh\": 0.196}\n",
    [
        ?_assertEqual({Yaml, expected()}, {Yaml, floor(Yaml)})
     || Yaml <- [
            keys(#{}),
            Crlf,
            Json,
            [<<16#EF, 16#BB, 16#BF>>, keys(#{})],
            ["%YAML 1.2\n---\n", keys(#{}), "...\n"],
            ["# a map\n\n", keys(#{}, "   ")],
            keys(#{"resolution" => "0.5   # m: 50 cm"}),
            keys(#{"image" => "'m.pgm'"}),
            keys(#{"image" => "\"m #1.pgm\""}),
            keys(#{"origin" => "\n- -7.2\n- -7.75\n- 0"}),
            keys(#{"metadata" => "\n  image: not_this.pgm\n  resolution: 7.0"}),
            keys(#{"a" => "\n  - resolution: 7.0\n  - x"}),
            [keys(#{"negate" => No}) || No <- ["no"]],
            keys(#{"negate" => "False"}),
            keys(#{"resolution" => ".5"}),
            keys(#{"resolution" => "5e-1"}),
            keys(#{"free_thresh" => ".196"}),
            keys(#{"free_thresh" => "19.6e-2"}),
            %% unknown is a wall, whatever the threshold
            keys(#{"free_thresh" => "0.25"}),
            keys(#{"mode" => "Trinary"})
        ]
    ].

what_is_not_followed_is_said_test_() ->
    [
        ?_assertEqual(
            {Line, true, Says, Why}, {Line, string:find(Why, Says) =/= nomatch, Says, Why}
        )
     || {Changed, Says} <- [
            {#{"origin" => "[0, 0, 1.5708]"}, "turned by 1.5708 rad"},
            {#{"origin" => "[0, 0, .nan]"}, "origin needs three numbers"},
            {#{"origin" => "[0, 0]"}, "origin needs three numbers"},
            {#{"resolution" => "0"}, "resolution needs a number above 0"},
            {#{"resolution" => "five"}, "resolution needs a number above 0"},
            {#{"free_thresh" => "1.5"}, "free_thresh needs a number from 0 to 1"},
            {#{"free_thresh" => "\n  nested: 1"}, "free_thresh needs a number"},
            {#{"negate" => "maybe"}, "negate is 0 or 1"},
            {#{"mode" => "fancy"}, "mode is trinary, scale or raw"},
            {#{"image" => "gone.pgm"}, "no such file"},
            {#{"image" => "[m.pgm]"}, "image needs the name of a file"},
            {#{"x" => "1\nx: 2"}, "the key x is there twice"},
            {#{"x" => "1\nnonsense"}, "this is no key with a value: nonsense"}
        ],
        {Line, Why} <- [floor(keys(Changed))]
    ].

thresholds_and_modes_test() ->
    Levels = <<"P5 3 1 255\n", 255, 128, 0>>,
    Solid = fun(Changed) ->
        {_, Walls} = floor(keys(Changed), Levels),
        [X / 500 || [{X, _} | _] <- Walls]
    end,
    ?assertEqual([1.0], Solid(#{"free_thresh" => "0.0"})),
    ?assertEqual([2.0], Solid(#{"free_thresh" => "0.5"})),
    ?assertEqual([0.0], Solid(#{"free_thresh" => "0.4", "negate" => "1"})),
    %% raw: 0 is free, and all else is a wall or unknown; nothing is negated
    ?assertEqual([0.0], Solid(#{"mode" => "raw", "negate" => "1"})).

the_same_plan_in_all_forms_of_pgm_test_() ->
    Pixels = <<254, 254, 205, 0, 254, 254>>,
    Wide = <<<<(V * 257):16>> || <<V>> <= Pixels>>,
    [
        ?_assertEqual({Pgm, expected()}, {Pgm, floor(keys(#{}), Pgm)})
     || Pgm <- [
            <<"P5\n# CREATOR: map_saver\n3 2\n255\n", Pixels/binary>>,
            <<"P5\r\n3 2\r\n255\r\n", Pixels/binary>>,
            <<"P5 3 2 255 # the greatest value\n", Pixels/binary>>,
            <<"P5\r# old Mac\r3 2\r255\r", Pixels/binary>>,
            <<"P5\v3\f2\v255\n", Pixels/binary>>,
            <<"P5 3 2 255\n", Pixels/binary, "\n">>,
            <<"P5 3 2 65535\n", Wide/binary>>,
            <<"P2 # plain\n3 2 255\n254 254 205\n0 254 254">>
        ]
    ].

what_is_no_pgm_is_refused_test_() ->
    [
        ?_assertMatch({Pgm, {4, [_ | _]}}, {Pgm, floor(["x: 1\ny: 2\n", keys(#{})], Pgm)})
     || Pgm <- [
            <<>>, <<"P6 3 2 255\n">>, <<"P5 3 2 255\n", 1, 2, 3>>, <<"P5 3 2">>, <<"P5 3 2 255">>
        ]
    ].
