%% `./starl diverge' as its user meets it: runs that must agree do, and two runs that hang on a pid
%% are led back to the event.
-module(starl_lab_diverge_tests).
-include_lib("eunit/include/eunit.hrl").

-import(starl_cli_vm, [says/3, contains/2, printed/2, in_directory/1]).

-define(PATIENCE_S, 60).

no_difference_test_() ->
    {timeout, ?PATIENCE_S, fun() ->
        says(0, "4 seeds, 3 ways: no digest differs", [
            "diverge",
            "exercise",
            "--work",
            "2",
            "--random-faults",
            "[all]",
            "--heal",
            "2",
            "--seeds",
            "5..8",
            "--ways",
            "process:2,inline:3,process:1:2"
        ])
    end}.

%% A decision by self(): how long robot 2 sleeps after its tenth turn. Its timer is the event that
%% differs; the command that is printed stops right before it.
planted_self_test_() ->
    {timeout, ?PATIENCE_S, fun() ->
        in_directory(fun(Dir) ->
            File = filename:join(Dir, "starl_cli_by_pid.erl"),
            ok = file:write_file(File, by_pid()),
            Text = says(
                3,
                "2 seeds, 2 ways: DIFFERENT DIGESTS of 2 seeds",
                [
                    "diverge",
                    File,
                    "--robots",
                    "3",
                    "--seeds",
                    "1,2",
                    "--ways",
                    "process:1,process:2"
                ]
            ),
            {match, [N]} = re:run(
                Text,
                "the first difference is event ([0-9]+) of robot 2",
                [{capture, [1], list}]
            ),
            ?assertMatch(
                {match, _}, re:run(Text, "  " ++ N ++ "  [0-9.]+ s  app\n    type    {timeout,")
            ),
            Seen = says(0, "robot 2", printed("look: ", Text)),
            Before = integer_to_list(list_to_integer(N) - 1),
            contains("just after event " ++ Before ++ " of robot 2", Seen)
        end)
    end}.

by_pid() ->
    "-module(starl_cli_by_pid).\n"
    "-export([init/2, step/2]).\n"
    "init(_, _) -> 0.\n"
    "step(_, 20) -> {done, 20};\n"
    "step(Robot, N) ->\n"
    "    ok = starl:sleep(Robot, 300),\n"
    "    _ = [starl:sleep(Robot, 1 + erlang:phash2(self(), 100000))\n"
    "        || starl:id(Robot) =:= 2, N =:= 10],\n"
    "    {continue, N + 1}.\n".

bad_ways_test_() ->
    [
        ?_assertEqual({error, {bad_way, Bad}}, starl_lab_diverge:parse("process:1," ++ Bad))
     || Bad <- ["", "thread:1", "process", "process:0", "inline:1:0", "inline:1:1:1", "inline:x"]
    ] ++
        [
            ?_assertEqual({error, {one_way, "inline:1"}}, starl_lab_diverge:parse("inline:1")),
            ?_assertEqual(
                {ok, [{process, 2, 1}, {inline, 3, 2}]},
                starl_lab_diverge:parse("process:2,inline:3:2")
            )
        ].
