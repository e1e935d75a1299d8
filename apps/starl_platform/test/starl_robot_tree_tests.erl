%% A robot's processes in the hands of their driver: what their ends lead to, in whatever order the
%% news of them come.
-module(starl_robot_tree_tests).
-include_lib("eunit/include/eunit.hrl").

%% A supervisor that gives up ends just after its process, and the news of both come from two
%% senders: that of the supervisor may come first, when the driver waits for no restart yet.
%% Holds: A driver does not wait for a supervisor that has ended already
%% Red: 3be728d, run: it waits for ever
supervisor_that_ends_first_test() ->
    with_tree(fun(Tree, Machines, #{app := App, guard := Guard}) ->
        ok = ends(Guard),
        ok = ends(App),
        {ok, Restarted, Left} = starl_robot_tree:restart(app, Machines, Tree),
        ?assertEqual(#{back => [], given_up => [app], lost => []}, Restarted),
        ?assertNot(starl_robot_machines:has(app, Left))
    end).

%% Otherwise the driver waits for the one or the other.
supervisor_that_ends_later_test() ->
    with_tree(fun(Tree, Machines, #{app := App, guard := Guard}) ->
        ok = ends(App),
        exit(Guard, kill),
        {ok, Restarted, _} = starl_robot_tree:restart(app, Machines, Tree),
        ?assertMatch(#{given_up := [app]}, Restarted)
    end).

restarted_test() ->
    with_tree(fun(Tree, Machines, #{app := App}) ->
        ok = ends(App),
        Next = idle(),
        self() ! {starl_attach, 1, app, Next},
        {ok, Restarted, With} = starl_robot_tree:restart(app, Machines, Tree),
        ?assertMatch(#{back := [app], given_up := []}, Restarted),
        ?assertEqual(Next, starl_robot_machines:process(app, With)),
        exit(Next, kill)
    end).

%% With the robot's own supervisor the whole robot is gone.
robot_that_ends_first_test() ->
    with_tree(fun(Tree, Machines, #{app := App, guard := Guard, robot := Robot}) ->
        _ = [ok = ends(Pid) || Pid <- [Robot, Guard, App]],
        ?assertEqual(gave_up, starl_robot_tree:restart(app, Machines, Tree))
    end).

%% A robot with an application alone.
with_tree(Test) ->
    [Robot, Guard, App] = All = [idle() || _ <- [1, 2, 3]],
    Start = fun() ->
        _ = erlang:monitor(process, Robot),
        self() ! {starl_attach, 1, app, App},
        {Robot, [{app, Guard}]}
    end,
    {Tree, Machines} = starl_robot_tree:launch(1, Start, #{}),
    try
        Test(Tree, Machines, #{robot => Robot, guard => Guard, app => App})
    after
        [exit(Pid, kill) || Pid <- All]
    end.

idle() ->
    spawn(fun() ->
        receive
            stop -> ok
        end
    end).

%% Ends it, and takes the news of its end as a driver does that has no use for them.
ends(Pid) ->
    exit(Pid, kill),
    receive
        {'DOWN', _, process, Pid, killed} -> ok
    end.
