%% Scenarios: unknown keys and bad values are all reported at once, with their place.
-module(starl_run_scenario_tests).
-include_lib("eunit/include/eunit.hrl").

defaults_are_valid_test() ->
    {ok, Default} = starl_run_scenario:check(#{}, []),
    ?assertMatch({ok, Default}, starl_run_scenario:check(Default, [])).

keeps_the_application_test() ->
    ?assertMatch(
        {ok, #{app := some, robots := 4, own := 7}},
        starl_run_scenario:check(#{app => some, own => 7}, [{own, {integer, 0, 9}, 1, ""}])
    ).

all_problems_at_once_test() ->
    Given = #{robots => 0, loss => 2, deley => {1, 2}, seed => -1},
    {error, {problems, Problems} = Reason} = starl_run_scenario:check(Given, []),
    ?assertEqual(4, length(Problems)),
    Line = text(Reason),
    [
        ?assertNotEqual({Part, nomatch}, {Part, string:find(Line, Part)})
     || Part <- ["robots", "loss", "did you mean delay?", "seed"]
    ],
    ?assertEqual(nomatch, string:find(Line, "\n")).

faults_test_() ->
    Check = fun(Faults) -> element(1, starl_run_scenario:check(#{faults => Faults}, [])) end,
    [
        ?_assertEqual({F, Expected}, {F, Check(F)})
     || {F, Expected} <- [
            {[], ok},
            {[{a, 0, 0, kill_machine, {1, sap}, #{}}], ok},
            {[{a, 0, 9, kill_robot, 1, #{}}], ok},
            {[{a, 9, 0, kill_robot, 1, #{}}], error},
            {[{a, -1, 0, kill_robot, 1, #{}}], error},
            {[{a, 0, 0, kill_robot, sap, #{}}], error},
            {[{a, 0, 0, kill_machine, 1, #{}}], error},
            {[{a, 0, 0, bite, 1, #{}}], error},
            {[{"a", 0, 0, kill_robot, 1, #{}}], error},
            {[{a, 0, 0, kill_robot, 1}], error},
            {none, error},
            {[nonsense], error}
        ]
    ].

%% A scenario file may hold anything: also this is an error, not a crash.
improper_list_of_faults_test() ->
    ?assertMatch(
        {error, _}, starl_run_scenario:check(#{faults => [{a, 0, 0, kill_robot, 1, #{}} | b]}, [])
    ).

files_test_() ->
    {setup,
        fun() ->
            Dir = filename:join(["_build", "starl_run_scenario_tests"]),
            ok = filelib:ensure_dir(filename:join(Dir, "x")),
            Dir
        end,
        fun(Dir) -> file:del_dir_r(Dir) end, fun(Dir) ->
            Read = fun(Name, Text) ->
                File = filename:join(Dir, Name),
                ok = file:write_file(File, Text),
                starl_run_scenario:read(File)
            end,
            [
                ?_assertEqual(
                    {ok, #{app => x, robots => 3}}, Read("ok", "#{app => x, robots => 3}.")
                ),
                ?_assertMatch({error, {shape, _}}, Read("list", "[a].")),
                ?_assertMatch({error, {shape, _}}, Read("two", "#{}. #{}.")),
                ?_assertMatch({error, {shape, _}}, Read("empty", "")),
                ?_assertMatch({error, {syntax, _, 2, _}}, Read("broken", "#{a => 1,\n b => }.")),
                ?_assertMatch({error, {syntax, _, _, _}}, Read("open", "#{a => 1")),
                ?_assertMatch(
                    {error, {file, _, enoent}}, starl_run_scenario:read(filename:join(Dir, "no"))
                ),
                ?_assertMatch({error, _}, Read("binary", <<0, 255, 254, 1>>)),
                ?_assert(
                    lists:all(fun(R) -> length(text(R)) > 5 end, [
                        {shape, "f"},
                        {file, "f", enoent},
                        {file, "f", eacces},
                        element(2, Read("broken2", "#{a => 1,\n b => }."))
                    ])
                )
            ]
        end}.

text(Reason) -> lists:flatten(io_lib:format("~ts", [starl_run_scenario:format_error(Reason)])).
