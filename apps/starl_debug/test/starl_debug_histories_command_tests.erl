%% What `histories' says of recordings that are made here.
-module(starl_debug_histories_command_tests).
-include_lib("eunit/include/eunit.hrl").

-define(PATIENCE_S, 60).

%% The second robot has the token for 30 ms while the first has not released it yet.
calls(SecondAcquired) ->
    [
        invoked(1000000, 1, 1, {acquire, door, 30000000}),
        returned(1010000, 1, 1, {ok, 7}),
        invoked(2000000, 2, 1, {acquire, door, 30000000}),
        invoked(3000000, 1, 2, {release, door}),
        returned(3001000, 1, 2, ok),
        returned(SecondAcquired, 2, 1, {ok, 9}),
        invoked(4000000, 2, 2, {release, door}),
        returned(4001000, 2, 2, ok)
    ].

invoked(At, Robot, N, Request) ->
    {trace, At, {Robot, app, {history, {invoked, {1, N}, mutex, Request}}}}.

returned(At, Robot, N, Answer) ->
    {trace, At, {Robot, app, {history, {returned, {1, N}, {ok, Answer}}}}}.

recording(More, Messages) ->
    Facts = #{
        kind => live,
        app => made,
        scenario => #{seed => 1},
        robots => [{R, {0.0, 0.0, 0.0}} || R <- [1, 2]],
        monitors => [{starl_mutex_monitor, #{robots => [1, 2]}}],
        machines => #{},
        waypoints => #{},
        run => 1
    },
    [{scenario, 0, maps:merge(Facts, More)} | lists:keysort(2, Messages)].

write(Dir, Name, Messages) ->
    {Head, Writer0} = starl_trace_writer:new(),
    {Bytes, Writer} = starl_trace_writer:messages(Messages, Writer0),
    File = filename:join(Dir, Name),
    ok = file:write_file(File, [Head, Bytes, starl_trace_writer:finish(Writer)]),
    File.

in_directory(Test) ->
    {timeout, ?PATIENCE_S, fun() ->
        Dir = filename:join("/tmp", "starl-histories-tests-" ++ os:getpid()),
        ok = filelib:ensure_path(Dir),
        try
            Test(Dir)
        after
            ok = file:del_dir_r(Dir)
        end
    end}.

says(Status, Parts, Args) ->
    {Got, Text} = starl_cli_said:said(["histories" | Args]),
    ?assertEqual({Status, Args, Text}, {Got, Args, Text}),
    [
        ?assertNotEqual({Part, nomatch, Text}, {Part, string:find(Text, Part), Text})
     || Part <- Parts
    ].

a_lock_is_explained_test_() ->
    in_directory(fun(Dir) ->
        File = write(Dir, "a.mcap", recording(#{}, calls(3020000))),
        says(0, ["4 calls\n", "mutex door: 4 calls, linearizable\n"], [File])
    end).

%% The calls at the end of what cannot be explained, the last one first.
two_holders_are_not_test_() ->
    in_directory(fun(Dir) ->
        File = write(Dir, "a.mcap", recording(#{}, calls(2970000))),
        First =
            "mutex door: 4 calls, not linearizable; 3.001000 s is the first moment that cannot be "
            "explained:\n        3.000000 s..    3.001000 s robot 1: {release,door} -> ok\n",
        says(3, [First, "robot 2: {acquire,door,30000000} -> {ok,9}\n"], [File])
    end).

clocks_may_explain_it_test_() ->
    in_directory(fun(Dir) ->
        File = write(Dir, "a.mcap", recording(#{}, calls(2970000) ++ others())),
        says(3, ["not linearizable"], [File, "--sigma", "5ms"]),
        says(6, ["depends on the clocks: by the times of the recording it is not linearizable\n"], [
            File, "--sigma", "50ms"
        ])
    end).

%% Something of each robot, so that the recording has both to its end.
others() -> [{log, At, {info, R, "on"}} || At <- [1, 5000000], R <- [1, 2]].

behind_a_hole_nothing_is_judged_test_() ->
    in_directory(fun(Dir) ->
        Hole = {gap, 2500000, {hole, 2600000}},
        File = write(Dir, "a.mcap", recording(#{}, [Hole | calls(2970000)])),
        says(5, ["mutex door: 2 calls, linearizable\n", "HAS A HOLE"], [File])
    end).

too_few_states_are_undecided_test_() ->
    in_directory(fun(Dir) ->
        File = write(Dir, "a.mcap", recording(#{}, calls(3020000))),
        says(5, ["undecided"], [File, "--states", "2"])
    end).

one_robot_alone_is_refused_test_() ->
    in_directory(fun(Dir) ->
        File = write(Dir, "a.mcap", recording(#{told_by => [1]}, calls(3020000))),
        says(2, ["it does not tell of robot 2", "./starl merge"], [File])
    end).

nothing_to_judge_is_said_test_() ->
    in_directory(fun(Dir) ->
        None = write(Dir, "a.mcap", recording(#{monitors => []}, calls(3020000))),
        says(0, ["the run has no block"], [None]),
        Empty = write(Dir, "b.mcap", recording(#{}, [])),
        says(0, ["nobody has called a block"], [Empty]),
        says(2, ["there is no such file"], [filename:join(Dir, "none.mcap")])
    end).
