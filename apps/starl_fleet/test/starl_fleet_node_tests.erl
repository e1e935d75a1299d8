%% A robot's node: its word to systemd, its health in the eyes of a deployment, its robot.
-module(starl_fleet_node_tests).
-behaviour(starl_app).
-include_lib("eunit/include/eunit.hrl").

-export([init/2, step/2]).

%% The application of a robot: each step says which version of this module runs.
init(_Robot, _Options) -> 0.

step(Robot, N) ->
    {module, Module} = erlang:fun_info(fun ?MODULE:step/2, module),
    starl_fleet_node_test ! {runs, Module, self()},
    ok = starl:sleep(Robot, 20),
    {continue, N + 1}.

%% READY=1 comes once, when the robot answers; the watchdog is fed for each answer, and for nothing else.
%% It is fed twice in its time, in whole milliseconds.
the_watchdog_is_fed_for_each_answer_test() ->
    Path = filename:join("/tmp", "starl-notify-" ++ os:getpid()),
    _ = file:delete(Path),
    ?assertEqual(
        [<<"READY=1">>, <<"WATCHDOG=1">>, <<"WATCHDOG=1">>],
        fed(Path, Path, "2000", 1, [false, true, false, true])
    ),
    file:delete(Path).

%% systemd may use a socket without a file.
an_abstract_socket_is_notified_test() ->
    Name = "starl-abstract-" ++ os:getpid(),
    Bytes = <<0, (list_to_binary(Name))/binary>>,
    ?assertEqual([<<"READY=1">>, <<"WATCHDOG=1">>], fed(Bytes, "@" ++ Name, "2000", 1, [true])).

%% Without systemd nobody is notified, and the robot is checked all the same.
a_robot_without_systemd_is_checked_test() ->
    {ok, Watchdog} = starl_fleet_watchdog:start_link({"", ""}, none, answers(5000)),
    looks(Watchdog, true),
    ok = gen_server:call(Watchdog, done),
    stopped(Watchdog).

half_of_the_time_of_the_watchdog_is_its_period_test() ->
    {ok, Watchdog} = starl_fleet_watchdog:start_link({"", "10000000"}, none, answers(5000)),
    looks(Watchdog, true),
    stopped(Watchdog).

a_node_stops_when_its_watcher_has_ended_test() ->
    Self = self(),
    Ended = fun() ->
        Self ! ended,
        ok
    end,
    {ok, Parent} = starl_fleet_watchdog:parent(os:getpid()),
    {ok, Watched} = starl_fleet_watchdog:start_link({"", ""}, {Parent, Ended}, answers(5000)),
    looks(Watched, true),
    stopped(Watched),
    ?assertEqual(none, flushed()),
    {ok, Left} = starl_fleet_watchdog:start_link({"", ""}, {Parent ++ "0", Ended}, answers(5000)),
    looks(Left, true),
    stopped(Left),
    ?assertEqual(ended, flushed()).

flushed() ->
    receive
        ended -> ended
    after 0 -> none
    end.

%% A second node on the same store ends; the socket of one that was killed is in nobody's way.
a_store_is_used_while_its_node_lives_test() ->
    State = "/tmp/starl-used-" ++ os:getpid(),
    ok = filelib:ensure_path(State),
    ?assertNot(starl_fleet_control:is_used(State)),
    {ok, Control} = starl_fleet_control:start_link(#{state => State}),
    ?assert(starl_fleet_control:is_used(State)),
    true = unlink(Control),
    Ref = erlang:monitor(process, Control),
    true = exit(Control, kill),
    receive
        {'DOWN', Ref, process, Control, _} -> ok
    end,
    ?assertMatch({ok, ["control"]}, file:list_dir(State)),
    ?assertNot(starl_fleet_control:is_used(State)),
    ok = file:del_dir_r(State).

%% What comes to this socket, for these answers of the robot.
fed(Address, Name, WatchdogUs, PeriodMs, Answers) ->
    {ok, Socket} = gen_udp:open(0, [binary, {active, false}, {ifaddr, {local, Address}}]),
    {ok, Watchdog} = starl_fleet_watchdog:start_link({Name, WatchdogUs}, none, answers(PeriodMs)),
    [looks(Watchdog, Answer) || Answer <- Answers],
    receive
        %% the notifications for the last answer have been sent by now
        {looks, Watchdog} -> ok
    end,
    Heard = heard(Socket),
    stopped(Watchdog),
    gen_udp:close(Socket),
    Heard.

answers(PeriodMs) ->
    Self = self(),
    fun(Ms) when Ms =:= PeriodMs ->
        Self ! {looks, self()},
        receive
            {answers, Answer} -> Answer
        end
    end.

looks(Watchdog, Answer) ->
    receive
        {looks, Watchdog} -> Watchdog ! {answers, Answer}
    end.

stopped(Watchdog) ->
    unlink(Watchdog),
    exit(Watchdog, kill),
    ok.

heard(Socket) ->
    case gen_udp:recv(Socket, 0, 0) of
        {ok, {_, _, State}} -> [State | heard(Socket)];
        {error, timeout} -> []
    end.

health_test_() ->
    [
        ?_assertEqual(Health, health(Answer))
     || {Health, Answer} <- [
            {{healthy, 7}, {ok, status(#{})}},
            {{healthy, 7}, {ok, status(#{result => {done, "x"}})}},
            {{dead, "its application has given up"}, {ok, status(#{result => given_up})}},
            {
                {dead, "2 crashes, the latest app: x"},
                {ok, status(#{crashes => 2, crash => "app: x"})}
            },
            {{ill, "its link does not answer"}, {ok, status(#{link => silent})}},
            {{ill, "release 0-b still runs"}, {ok, status(#{release => "0-b"})}},
            {{ill, "its node does not answer"}, none},
            {{healthy, 7}, {ok, status(#{reload => #{waiting => [], failed => none}})}},
            {
                {dead, "the new code"},
                {ok, status(#{reload => #{waiting => [], failed => "the new code"}})}
            },
            {
                {waits, "it is still in a step, and takes the new code after it"},
                {ok, status(#{reload => #{waiting => [app], failed => none}})}
            },
            {{healthy, 7}, {ok, status(#{peers => [peer(2, #{}), peer(3, #{})]})}},
            {
                {ill,
                    "it has not heard robot 2: its clock is 60.0 s ahead of ours; it has not heard robot 3 "
                    "for 8 s"},
                {ok,
                    status(#{
                        peers => [
                            peer(2, #{heard_ms => never, why => {clock, 60_000}}),
                            peer(3, #{heard_ms => 8000, is_silent => true})
                        ]
                    })}
            }
        ]
    ].

peer(Robot, More) ->
    Well = #{
        robot => Robot,
        is_silent => false,
        heard_ms => 10,
        address => {{127, 0, 0, 1}, 5001},
        life => 7,
        refused => #{},
        why => none
    },
    maps:merge(Well, More).

health(Answer) ->
    case starl_fleet_ask:health(Answer, #{version => "0-a"}) of
        {healthy, _} = Healthy -> Healthy;
        {How, Why} -> {How, lists:flatten(Why)}
    end.

status(More) ->
    Well = #{
        release => "0-a",
        link => answers,
        crashes => 0,
        crash => none,
        result => running,
        started => 7
    },
    maps:merge(Well, More).

%% What has changed, what runs in versions already, and what calls them.
reloaded_modules_test() ->
    Own = [
        compiled("upper", "f() -> middle:f()."),
        compiled("middle", "f() -> lower:f()."),
        compiled("lower", "f() -> ok."),
        compiled("other", "f() -> lists:seq(1, 2).")
    ],
    Names = fun(Changed, Known) ->
        [M || {M, _, _} <- starl_fleet_reload:sources(Changed, Known, Own)]
    end,
    ?assertEqual([upper, middle, lower], Names([lower], [])),
    ?assertEqual([upper], Names([upper], [])),
    ?assertEqual([upper, other], Names([other], [upper])),
    ?assertEqual([], Names([], [])).

compiled(Name, Code) ->
    Forms = [
        begin
            {ok, Tokens, _} = erl_scan:string(Text),
            {ok, Form} = erl_parse:parse_form(Tokens),
            Form
        end
     || Text <- ["-module(" ++ Name ++ ").", "-export([f/0]).", Code]
    ],
    {ok, Module, Beam} = compile:forms(Forms, [debug_info]),
    {Module, Name ++ ".erl", Beam}.

%% A release for Creates: StarL's own services and drivers change with a deployment only, the applications that ship
%% by a reload, too.
only_applications_are_reloaded_test() ->
    Release = "/tmp/starl-layers-" ++ os:getpid(),
    [
        begin
            Link = filename:join([Release, "lib", atom_to_list(Layer) ++ "-0.1.0"]),
            ok = filelib:ensure_dir(Link),
            ok = file:make_symlink(code:lib_dir(Layer), Link)
        end
     || Layer <- [
            starl_platform,
            starl_blocks,
            starl_run,
            starl_live,
            starl_trace,
            starl_create,
            starl_fleet,
            starl_apps
        ]
    ],
    Changed = starl_fleet_reload:changed(Release, #{}),
    ok = file:del_dir_r(Release),
    Apps = [filename:basename(filename:dirname(filename:dirname(File))) || File <- Changed],
    ?assertEqual(["starl_apps-0.1.0"], lists:usort(Apps)).

%% A robot whose link starts anew within its node goes on with the new code, and can still be taken back.
reload_outlives_the_link_test_() ->
    {timeout, 30, fun() -> with_node(fun reload_outlives_the_link/2) end}.

reload_outlives_the_link(Dir, _Node) ->
    Old = runs(fun(Module, _) -> Module =:= ?MODULE end),
    ok = takes(1, Dir ++ "/two"),
    Old = runs(fun(Module, _) -> Module =/= ?MODULE end),
    true = exit(starl_live_robot:link(starl_live_sup:robot()), kill),
    _ = runs(fun(Module, App) -> App =/= Old andalso Module =/= ?MODULE end),
    ?assertMatch({error, _}, starl_fleet_node:leaves(Dir ++ "/another", 1)),
    ok = starl_fleet_node:leaves(Dir, 1),
    _ = runs(fun(Module, App) -> App =/= Old andalso Module =:= ?MODULE end),
    ?assertMatch(#{number := 2, versions := [?MODULE]}, starl_fleet_node:code()).

%% What a node tells of a reload: who has not taken it yet, what has failed first, and nothing once it has left it.
%% Words on another reload change nothing.
a_node_tells_how_its_reload_goes_test_() ->
    {timeout, 30, fun() -> with_node(fun a_node_tells_how_its_reload_goes/2) end}.

a_node_tells_how_its_reload_goes(Dir, Node) ->
    Old = runs(fun(Module, _) -> Module =:= ?MODULE end),
    Tells = fun(N, Outcome) ->
        Node ! {starl_reloaded, 1, app, #{number => N, outcome => Outcome, module => ?MODULE}}
    end,
    %% an application in the middle of a step
    true = erlang:suspend_process(Old),
    ok = takes(1, Dir ++ "/two"),
    Tells(2, {crashed, {"other", []}}),
    ?assertMatch(
        #{release := "two", reload := #{waiting := [app], failed := none}},
        starl_fleet_node:status()
    ),
    true = erlang:resume_process(Old),
    ok = none_waits(Old),
    Tells(1, {crashed, {"first", []}}),
    Tells(1, {crashed, {"second", []}}),
    #{reload := #{waiting := [], failed := Why}} = starl_fleet_node:status(),
    ?assertMatch("robot 1, app (starl_fleet_node_tests): rolled back: " ++ _, Why),
    ?assertEqual([false, true], [is_list(string:find(Why, W)) || W <- ["second", "first"]]),
    %% what has failed is not given to a robot that starts anew
    true = exit(starl_live_robot:link(starl_live_sup:robot()), kill),
    New = runs(fun(_, App) -> App =/= Old end),
    #{reload := _} = starl_fleet_node:status(),
    ?assertEqual([?MODULE, ?MODULE], [next(New), next(New)]),
    ok = starl_fleet_node:leaves(Dir, 2),
    Status = #{release := Release} = starl_fleet_node:status(),
    ?assertEqual({filename:basename(Dir), false}, {Release, is_map_key(reload, Status)}),
    ?assertMatch({error, _}, starl_fleet_node:leaves(Dir, 2)).

%% The application has taken the new code, and its node knows of it.
none_waits(App) ->
    _ = next(App),
    case starl_fleet_node:status() of
        #{reload := #{waiting := [], failed := none}} -> ok;
        #{reload := #{waiting := [app]}} -> none_waits(App)
    end.

%% The node of a robot with the application of these tests.
with_node(Test) ->
    true = register(starl_fleet_node_test, self()),
    {ok, _} = application:ensure_all_started(starl_live),
    Dir = "/tmp/starl-node-" ++ os:getpid(),
    Place = #{robot => 1, release => Dir, version => "0-a", keys => Dir, state => Dir ++ "/state"},
    Robots = #{1 => #{host => "127.0.0.1", port => free_port()}},
    Fleet = #{name => "lab", app => ?MODULE, robots => Robots, record_mb => 0},
    ok = filelib:ensure_path(Dir),
    ok = file:write_file(Dir ++ "/fleet.term", io_lib:format("~tp.~n", [Fleet])),
    ok = file:write_file(Dir ++ "/fleet.key", lists:duplicate(64, $a)),
    ok = file:change_mode(Dir ++ "/fleet.key", 8#600),
    {ok, Node} = starl_fleet_node:start_link(Place),
    Test(Dir, Node),
    true = unlink(Node),
    true = exit(Node, kill),
    ok = application:stop(starl_live),
    true = unregister(starl_fleet_node_test),
    ok = file:del_dir_r(Dir).

%% The robot takes new versions, of that release.
takes(N, Release) ->
    #{number := N, parts := Parts} = starl_fleet_node:code(),
    {ok, Order, Code} = starl_reload:order(N, [?MODULE], Parts, 0),
    ok = starl_version:load(Code),
    starl_fleet_node:takes(Order, Release).

free_port() ->
    {ok, Socket} = gen_udp:open(0),
    {ok, Port} = inet:port(Socket),
    ok = gen_udp:close(Socket),
    Port.

%% The module that this process runs at its next step.
next(App) ->
    receive
        {runs, Module, App} -> Module
    end.

%% The application's process, as soon as this is so.
runs(Wanted) ->
    receive
        {runs, Module, App} ->
            case Wanted(Module, App) of
                true -> App;
                false -> runs(Wanted)
            end
    end.

%% A robot comes from its fleet file alone.
spec_test() ->
    Robots = #{1 => #{host => "a.b"}, 2 => #{host => "c.d", port => 6000}},
    Given = #{name => "lab", app => starl_exercise, robots => Robots},
    {ok, Fleet} = starl_fleet_file:check("f.term", Given, starl_exercise),
    Place = #{robot => 2, release => "/none", version => "0-a", keys => "k", state => "s"},
    Key = starl_live_key:new(),
    {ok, Spec} = starl_fleet_node:spec(Place, Key, Fleet),
    #{transport := {starl_live_udp, Transport}} = Spec,
    ?assertMatch(#{robot := 2, dir := "s", chassis := {starl_fleet_no_chassis, _}}, Spec),
    ?assertEqual(#{1 => {"a.b", 5001}, 2 => {"c.d", 6000}}, maps:get(peers, Transport)),
    %% another release is another run
    {ok, #{transport := {_, #{run := Other}}}} = starl_fleet_node:spec(
        Place#{version := "0-b"}, Key, Fleet
    ),
    ?assertNotEqual(Other, maps:get(run, Transport)).

node_name_test() ->
    Robots = #{1 => #{host => "10.0.0.1"}},
    Given = #{name => "lab", app => starl_exercise, robots => Robots, transport => dist},
    {ok, Fleet} = starl_fleet_file:check("f.term", Given, starl_exercise),
    ?assertEqual('lab-robot-1@10.0.0.1', starl_fleet_adapters:node_name(1, Fleet)),
    ?assert(is_list(string:find(starl_fleet_net:vm_args(Fleet), "-erl_epmd_port 5001"))).

%% A chassis that does not move says so.
still_test() ->
    Clock = starl_live_clock:new(0, 1),
    Script = [{velocity, 1.0, 0.0, 1.0}],
    ?assertMatch(
        {[{m, {stalled, _}}], Clock},
        starl_fleet_no_chassis:drive({starl_fleet_node_tests_chassis(), Script}, 0, m, Clock)
    ),
    ?assertMatch({[{m, {driven, _}}], Clock}, starl_fleet_no_chassis:drive({any, []}, 0, m, Clock)).

starl_fleet_node_tests_chassis() -> lists.
