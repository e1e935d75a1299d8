%% The simulator as its users see it: the API of an application, hot reload, and the control of a
%% run. Applications are functions (starl_sim_script_app). Crashes: starl_sim_crash_SUITE.
-module(starl_sim_SUITE).
-include_lib("stdlib/include/assert.hrl").
-import(starl_sim_ct, [start/3, play/3, end_of/1, crashing/1, pid_of/3, kill/2]).

-export([suite/0, all/0, init_per_suite/1, end_per_suite/1]).
-export([
    every_function_of_the_api/1,
    send_and_await/1,
    post_and_broadcast/1,
    await_times_out/1,
    sleep_by_the_robots_clock/1,
    messages_wait_in_the_inbox/1,
    full_inbox_pushes_back/1,
    full_inbox_of_ones_own/1,
    full_inbox_over_restarts/1,
    go_to_and_positions/1,
    unknown_waypoint_and_robot/1,
    send_to_a_robot_that_is_not/1,
    random_from_the_seed/1,
    actuate_and_trace/1,
    call_times_out/1,
    call_to_no_machine_is_a_mistake/1,
    unreachable_robot_is_lost/1,
    hot_reload_carries_the_state/1,
    hot_reload_without_code_change/1,
    reloads_in_one_step_kill_nobody/1,
    code_is_taken_after_the_step/1,
    code_comes_while_it_runs/1,
    a_crash_on_trial_takes_all_back/1,
    a_crash_takes_an_earlier_reload_back_that_was_on_trial/1,
    failed_code_change_keeps_the_state/1,
    bad_code_is_refused/1,
    errors_of_start/1,
    run_step_stop_status/1,
    inspect_before_the_first_step/1,
    inspect_what_restarts/1,
    time_never_runs_back/1,
    ending_time/1,
    finish_leaves_nothing/1,
    two_simulations_at_once/1
]).

-define(APP, starl_sim_script_app).
-define(WALL_MS, 10000).

suite() -> [{timetrap, {minutes, 1}}].

all() ->
    [
        every_function_of_the_api,
        send_and_await,
        post_and_broadcast,
        await_times_out,
        sleep_by_the_robots_clock,
        messages_wait_in_the_inbox,
        full_inbox_pushes_back,
        full_inbox_of_ones_own,
        full_inbox_over_restarts,
        go_to_and_positions,
        unknown_waypoint_and_robot,
        send_to_a_robot_that_is_not,
        random_from_the_seed,
        actuate_and_trace,
        call_times_out,
        call_to_no_machine_is_a_mistake,
        unreachable_robot_is_lost,
        hot_reload_carries_the_state,
        hot_reload_without_code_change,
        reloads_in_one_step_kill_nobody,
        code_is_taken_after_the_step,
        code_comes_while_it_runs,
        a_crash_on_trial_takes_all_back,
        a_crash_takes_an_earlier_reload_back_that_was_on_trial,
        failed_code_change_keeps_the_state,
        bad_code_is_refused,
        errors_of_start,
        run_step_stop_status,
        inspect_before_the_first_step,
        inspect_what_restarts,
        time_never_runs_back,
        ending_time,
        finish_leaves_nothing,
        two_simulations_at_once
    ].

init_per_suite(Config) -> starl_platform_ct:without_log(Config).

end_per_suite(Config) -> starl_platform_ct:with_log(Config).

%% -- the API of an application --------------------------------------------------------------

every_function_of_the_api(_) ->
    {_, Results, _} = play(
        2,
        fun(R) ->
            [1, 2] = starl:participants(R),
            true = is_integer(starl:now(R)),
            X = starl:random(R),
            true = X >= 0.0 andalso X < 1.0,
            ok = starl:listen(R, hello),
            ok = starl:sleep(R, 100),
            {ok, {_, _, _}} = starl:position(R),
            {ok, #{1 := _, 2 := _}} = starl:positions(R),
            {ok, {3000.0, 3000.0}} = starl:waypoint(R, dock),
            {ok, #{dock := {3000.0, 3000.0}}} = starl:waypoints(R),
            ok = starl:actuate(R, pen, down),
            ok = starl:trace(R, here),
            starl:id(R)
        end,
        #{around => #{waypoints => #{dock => {3000.0, 3000.0}}}}
    ),
    ?assertEqual([{done, 1}, {done, 2}], Results).

%% A message is delivered with its source and content, and its outcome is told.
send_and_await(_) ->
    {_, Results, _} = play(2, fun(R) -> ring(starl:id(R), R) end, #{loss => 0.3, duplicate => 0.3}),
    ?assertEqual([{done, lists:seq(1, 20)}, {done, sent}], Results).

ring(1, R) ->
    ok = starl:listen(R, number),
    [
        begin
            {ok, 2, K} = starl:await(R, number),
            K
        end
     || _ <- lists:seq(1, 20)
    ];
ring(2, R) ->
    [ok = starl:send(R, 1, number, K) || K <- lists:seq(1, 20)],
    sent.

post_and_broadcast(_) ->
    {_, Results, _} = play(
        3,
        fun(R) ->
            ok = starl:listen(R, a),
            ok = starl:listen(R, b),
            ok = starl:broadcast(R, a, starl:id(R)),
            [ok = starl:post(R, Id, b, starl:id(R)) || Id <- starl:participants(R)],
            Got = fun(Type, N) ->
                lists:sort([
                    begin
                        {ok, F, F} = starl:await(R, Type),
                        F
                    end
                 || _ <- lists:seq(1, N)
                ])
            end,
            {Got(b, 3), Got(a, 2)}
        end,
        #{}
    ),
    ?assertEqual([{done, {[1, 2, 3], [1, 2, 3] -- [Id]}} || Id <- [1, 2, 3]], Results).

await_times_out(_) ->
    {_, [{done, {timeout, Ms, {ok, 1, late}}}], _} = play(
        1,
        fun(R) ->
            ok = starl:listen(R, a),
            Before = starl:now(R),
            First = starl:await(R, a, 700),
            Took = starl:now(R) - Before,
            ok = starl:post(R, 1, a, late),
            {First, Took, starl:await(R, a, 700)}
        end,
        #{}
    ),
    ?assert(abs(Ms - 700) =< 1).

%% A robot sleeps by its own clock: clocks that drift apart wake at different times.
sleep_by_the_robots_clock(_) ->
    {_, Results, Trace} = play(
        4,
        fun(R) ->
            Before = starl:now(R),
            ok = starl:sleep(R, 100000),
            ok = starl:trace(R, awake),
            ok = starl:sleep(R, 1),
            starl:now(R) - Before
        end,
        #{clock_drift => 1000, clock_offset => 5000}
    ),
    [?assert(abs(Took - 100001) =< 2) || {done, Took} <- Results],
    Woke = [T || {T, _, app, awake} <- Trace],
    ?assertEqual(4, length(lists:usort(Woke))),
    [?assert(abs(T - 100000000) =< 101000) || T <- Woke].

%% Messages that come while the application waits for something else are kept, in order.
messages_wait_in_the_inbox(_) ->
    {_, [{done, _}, {done, Got}], _} = play(
        2,
        fun(R) ->
            case starl:id(R) of
                1 ->
                    [ok = starl:send(R, 2, a, K) || K <- lists:seq(1, 50)];
                2 ->
                    ok = starl:listen(R, a),
                    ok = starl:sleep(R, 60000),
                    [
                        begin
                            {ok, 1, K} = starl:await(R, a, 0),
                            K
                        end
                     || _ <- lists:seq(1, 50)
                    ]
            end
        end,
        #{}
    ),
    ?assertEqual(lists:seq(1, 50), Got).

%% Two sources send more than the inbox holds before the application reads: whatever they are told
%% is delivered it reads, and the rest they are told is lost. Types share the inbox.
full_inbox_pushes_back(_) ->
    {Outcome, [{done, Told}, {done, Read}, {done, Told3}], _} = play(
        3,
        fun(R) ->
            case starl:id(R) of
                2 ->
                    [ok = starl:listen(R, T) || T <- [a, b]],
                    ok = starl:sleep(R, 45000),
                    read_all(R, [a, b]);
                Id ->
                    Type = lists:nth(Id, [a, x, b]),
                    [K || K <- lists:seq(1, 800), starl:send(R, 2, Type, {Id, K}) =:= ok]
            end
        end,
        #{time => 300}
    ),
    Sent = [{1, K} || K <- Told] ++ [{3, K} || K <- Told3],
    ?assertEqual(lists:sort(Sent), lists:sort(Read)),
    ?assert(length(Read) > 1500),
    ?assertEqual([], maps:get(violations, Outcome)).

read_all(R, Types) -> lists:append([read_type(R, Type) || Type <- Types ++ Types]).

read_type(R, Type) ->
    case starl:await(R, Type, 3000) of
        {ok, _, Body} -> [Body | read_type(R, Type)];
        timeout -> []
    end.

%% To itself a robot can send as many as it has room for; the next is refused at once.
full_inbox_of_ones_own(_) ->
    {Outcome, [{done, {Told, Read}}], Trace} = play(
        1,
        fun(R) ->
            ok = starl:listen(R, a),
            Told = [starl:send(R, 1, a, K) || K <- lists:seq(1, 1001)],
            {Told, read_type(R, a)}
        end,
        #{}
    ),
    ?assertEqual([ok || _ <- lists:seq(1, 1000)] ++ [{error, overload}], Told),
    ?assertEqual(lists:seq(1, 1000), Read),
    ?assertMatch([_], [E || {_, 1, sap, {overload, _} = E} <- Trace]),
    ?assertEqual([], maps:get(violations, Outcome)).

%% So it is when SAP or the application crashes meanwhile: what is acknowledged afterwards is read.
full_inbox_over_restarts(_) ->
    [
        begin
            {Outcome, [{done, Told}, {done, Read}], _} = play(
                2,
                fun(R) ->
                    case starl:id(R) of
                        1 ->
                            [K || K <- lists:seq(1, 1400), starl:send(R, 2, a, K) =:= ok];
                        2 ->
                            ok = starl:listen(R, a),
                            ok = starl:sleep(R, 60000),
                            read_type(R, a)
                    end
                end,
                #{time => 300, faults => [{crash, 20000, 20000, kill_machine, {2, Machine}, #{}}]}
            ),
            Crashed = length([K || K <- Told, not lists:member(K, Read)]),
            ?assertEqual({Machine, []}, {Machine, maps:get(violations, Outcome)}),
            ?assertEqual(
                {Machine, []}, {Machine, [K || K <- Read, not lists:member(K, Told), K > 1000]}
            ),
            ?assert(Machine =:= app orelse Crashed =:= 0, {Machine, Crashed})
        end
     || Machine <- [sap, app]
    ].

go_to_and_positions(_) ->
    Waypoints = #{dock => {6000.0, 2500.0}},
    {_, [{done, Own}, {done, Seen}], _} = play(
        2,
        fun(R) ->
            case starl:id(R) of
                1 ->
                    ok = starl:go_to(R, {2500.0, 4000.0}),
                    ok = starl:go_to(R, dock),
                    {ok, Pose} = starl:position(R),
                    Pose;
                2 ->
                    ok = starl:sleep(R, 60000),
                    {ok, Pose} = starl:position(R, 1),
                    {ok, #{1 := _, 2 := _}} = starl:positions(R),
                    Pose
            end
        end,
        #{around => #{waypoints => Waypoints}}
    ),
    Goal = maps:get(goal_mm, starl_chassis:profile(starl_chassis_differential, #{})),
    [
        ?assert(starl_geometry:distance({X, Y}, {6000.0, 2500.0}) =< Goal + 3.0)
     || {X, Y, _} <- [Own, Seen]
    ].

unknown_waypoint_and_robot(_) ->
    {_, Results, _} = play(
        1,
        fun(R) ->
            {starl:waypoint(R, nowhere), starl:go_to(R, nowhere), starl:position(R, 7)}
        end,
        #{}
    ),
    Unknown = {error, unknown},
    ?assertEqual([{done, {Unknown, Unknown, Unknown}}], Results).

%% A message to a robot that does not exist is reported lost; it does not end the simulation.
send_to_a_robot_that_is_not(_) ->
    {_, Results, _} = play(2, fun(R) -> starl:send(R, 9, a, b) end, #{}),
    ?assertEqual([{done, {error, lost}}, {done, {error, lost}}], Results).

%% Draws come from the seed, and each robot has its own.
random_from_the_seed(_) ->
    Draw = fun(R) -> [starl:random(R) || _ <- [1, 2, 3]] end,
    {_, [First, Second], _} = play(2, Draw, #{seed => 1}),
    {_, Again, _} = play(2, Draw, #{seed => 1}),
    {_, [Other, _], _} = play(2, Draw, #{seed => 2}),
    ?assertEqual([First, Second], Again),
    ?assertNotEqual(First, Second),
    ?assertNotEqual(First, Other).

actuate_and_trace(_) ->
    {_, _, Trace} = play(
        1,
        fun(R) ->
            starl:actuate(R, pen, down),
            starl:sleep(R, 1000),
            starl:trace(R, {fact, 1}),
            starl:actuate(R, pen, up)
        end,
        #{}
    ),
    ?assertMatch(
        [
            {0, 1, chassis, {actuated, pen, down}},
            {T, 1, app, {fact, 1}},
            {T, 1, chassis, {actuated, pen, up}}
        ] when
            T > 990000,
        [
            E
         || {_, _, M, What} = E <- Trace,
            M =:= app orelse M =:= chassis,
            element(1, What) =:= fact orelse
                element(1, What) =:= actuated
        ]
    ).

call_times_out(_) ->
    {_, Results, _} = play(
        1,
        fun(R) ->
            {starl:call(R, crash, ignore, 500), starl:call(R, crash, incarnation, 500)}
        end,
        crashing(#{})
    ),
    ?assertEqual([{done, {{error, timeout}, {ok, 1}}}], Results).

%% It is not answered at all, nor waits for ever: the application crashes, until it is given up.
call_to_no_machine_is_a_mistake(_) ->
    {_, Results, Trace} = play(1, fun(R) -> starl:call(R, no_such, x, infinity) end, #{}),
    ?assertEqual([given_up], Results),
    ?assertMatch([_ | _], [E || {_, 1, no_such, {unknown_machine, _} = E} <- Trace]).

unreachable_robot_is_lost(_) ->
    {_, [{done, A}, {done, B}], _} = play(
        2,
        fun(R) ->
            Other = 3 - starl:id(R),
            {starl:send(R, Other, a, b), starl:broadcast(R, a, b)}
        end,
        #{loss => 1}
    ),
    ?assertEqual({{error, lost}, {error, {lost, [2]}}}, A),
    ?assertEqual({{error, lost}, {error, {lost, [1]}}}, B).

%% -- hot reload -----------------------------------------------------------------------------

%% Code that the VM itself has loaded anew takes effect at the next step; code_change/2 carries the state over.
hot_reload_carries_the_state(_) ->
    reload("code_change(N, Old) when is_binary(Old) -> {n, N + 1000}.", "{n, N}", fun(Results) ->
        ?assertEqual([{done, {new, 1005}}, {done, {new, 1005}}], Results)
    end).

hot_reload_without_code_change(_) ->
    reload("", "N", fun(Results) ->
        ?assertEqual([{done, {new, 5}}, {done, {new, 5}}], Results)
    end).

reload(Change, Pattern, Check) ->
    load(
        "init(_, _) -> 0.\n"
        "          step(R, N) -> ok = starl:sleep(R, 1000), {continue, N + 1}."
    ),
    {ok, Sim} = starl_sim:start(#{app => starl_sim_reloaded, robots => 2}),
    #{ending := none} = starl_sim:run(Sim, 4.5),
    load(
        "init(_, _) -> error(started_anew).\n"
        "          step(_, " ++ Pattern ++ ") -> {done, {new, N}}.\n" ++ Change
    ),
    #{ending := done} = starl_sim:run(Sim),
    {#{robots := Robots}, _} = starl_sim:finish(Sim),
    Check([Result || {_, #{result := Result}} <- Robots]).

%% However often new code comes during one step, the application keeps its life and its state, and
%% the newest code takes over.
reloads_in_one_step_kill_nobody(_) ->
    load(
        "init(_, _) -> [].\n"
        "          step(R, Ks) -> ok = starl:sleep(R, 10000), {continue, [1 | Ks]}."
    ),
    {ok, Sim} = starl_sim:start(#{app => starl_sim_reloaded, robots => 2}),
    #{ending := none} = starl_sim:run(Sim, 5),
    [
        ok = starl_sim:reload(Sim, code(carries(V) ++ "step(_, Ks) -> {done, {" ++ V ++ ", Ks}}."))
     || V <- ["2", "3", "4", "5", "6"]
    ],
    #{ending := done} = starl_sim:run(Sim),
    Done = {done, {6, [v6, v5, v4, v3, v2, 1]}},
    ?assertEqual([Done, Done], results(Sim)).

carries(V) ->
    "init(_, _) -> error(started_anew).\n code_change(Ks, _) -> [v" ++ V ++ " | Ks].\n".

results(Sim) ->
    {#{robots := Robots}, _} = starl_sim:finish(Sim),
    [Result || {_, #{result := Result}} <- Robots].

%% Versions that come during a step are taken one after the other at its end, and the run tells of each.
code_is_taken_after_the_step(_) ->
    Long =
        "step(R, Ks) when length(Ks) < 5 -> ok = starl:sleep(R, 10000), {continue, [1 | Ks]};\n"
        "            step(_, Ks) -> {done, Ks}.",
    load("init(_, _) -> []. " ++ Long),
    {ok, Sim} = starl_sim:start(#{app => starl_sim_reloaded, robots => 2}),
    #{ending := none} = starl_sim:run(Sim, 5),
    [ok = starl_sim:reload(Sim, code(carries(V) ++ Long)) || V <- ["2", "3", "4"]],
    #{ending := none} = starl_sim:run(Sim, 8),
    ?assertEqual([], starl_sim:reloads(Sim)),
    #{ending := done} = starl_sim:run(Sim),
    ?assertMatch(
        [
            #{number := 1, machines := [app], taken := [1, 2], back := [], why := none},
            #{number := 2, taken := [1, 2], back := []},
            #{number := 3, taken := [1, 2], back := []}
        ],
        starl_sim:reloads(Sim)
    ),
    Done = {done, [1, v4, v3, v2, 1]},
    ?assertEqual([Done, Done], results(Sim)).

%% The run goes on until the new code is there: the robots of each shard take it.
code_comes_while_it_runs(_) ->
    load("init(_, _) -> 0. step(R, N) -> ok = starl:sleep(R, 1), {continue, N + 1}."),
    {ok, Sim} = starl_sim:start(#{
        app => starl_sim_reloaded, robots => 4, shards => 2, time => 36000
    }),
    {Runs, Ref} = spawn_monitor(fun() -> exit(starl_sim:run(Sim)) end),
    ok = starl_sim:reload(Sim, code("init(_, _) -> error(anew). step(_, _) -> {done, new}.")),
    receive
        {'DOWN', Ref, process, Runs, Status} -> ?assertMatch(#{ending := done}, Status)
    end,
    ?assertMatch([#{number := 1, taken := [1, 2, 3, 4], back := []}], starl_sim:reloads(Sim)),
    ?assertEqual(lists:duplicate(4, {done, new}), results(Sim)).

%% Robot 2 crashes in the new code: all go on with the former one, and it is told where and why.
%% Holds: There is one way: a simulation's reload that crashes on one robot takes all back, and is
%% told; versions that come within one step are all taken; code comes while the run goes on
%% Red: d7c73771, run: robot 2 crashes and begins anew, again and again, and the run does not end
a_crash_on_trial_takes_all_back(_) ->
    load("init(_, _) -> 0. " ++ counting()),
    {ok, Sim} = starl_sim:start(#{app => starl_sim_reloaded, robots => 2}),
    #{ending := none} = starl_sim:run(Sim, 2.5),
    Crashing = "step(R, N) -> ok = starl:sleep(R, 1000), 1 = starl:id(R), {continue, N + 100}.",
    ok = starl_sim:reload(Sim, code("init(_, _) -> error(started_anew). " ++ Crashing)),
    #{ending := done} = starl_sim:run(Sim),
    ?assertMatch(
        [#{back := [1, 2], why := {_, 2, app, {crashed, {"no match of" ++ _, [_ | _]}}}}],
        starl_sim:reloads(Sim)
    ),
    [{done, {old, _}}, {done, {old, 10}}] = results(Sim).

%% Robot 2 crashes in code that came within the trial of other code: both are taken back, on all robots.
a_crash_takes_an_earlier_reload_back_that_was_on_trial(_) ->
    load("init(_, _) -> 0. " ++ counting()),
    {ok, Sim} = starl_sim:start(#{app => starl_sim_reloaded, robots => 2}),
    #{ending := none} = starl_sim:run(Sim, 2.5),
    [
        begin
            Step = "step(R, N) -> ok = starl:sleep(R, 1000), " ++ Own ++ ", {continue, N}.",
            ok = starl_sim:reload(Sim, code("init(_, _) -> error(started_anew). " ++ Step)),
            #{ending := none} = starl_sim:run(Sim, Until)
        end
     || {Own, Until} <- [{"ok", 4.7}, {"1 = starl:id(R)", 5}]
    ],
    #{ending := done} = starl_sim:run(Sim),
    ?assertMatch(
        [
            #{number := 1, back := [1, 2], why := {_, 2, app, {unproven, 2}}},
            #{number := 2, back := [1, 2], why := {_, 2, app, {crashed, _}}}
        ],
        starl_sim:reloads(Sim)
    ),
    [{done, {old, _}}, {done, {old, _}}] = results(Sim).

counting() ->
    "step(R, N) when N < 10 -> ok = starl:sleep(R, 1000), {continue, N + 1}; step(_, N) -> {done, {old, N}}.".

%% Code that cannot take over the state does not get it: the application goes on with the former code and
%% keeps what it is sent; it takes other code that comes.
failed_code_change_keeps_the_state(_) ->
    First =
        "init(R, _) -> starl:listen(R, a), starl:post(R, 1, a, kept), 0.\n"
        "             step(R, N) when N < 3 -> ok = starl:sleep(R, 1000), {continue, N + 1};\n"
        "             step(R, N) -> {done, {N, starl:await(R, a)}}.",
    Better =
        "init(_, _) -> error(started_anew).\n"
        "              code_change(N, _) -> {better, N}.\n"
        "              step(R, {better, N}) -> {done, {better, N, starl:await(R, a)}}.",
    Bad =
        "init(_, _) -> error(started_anew).\n"
        "           code_change(N, _) when is_list(N) -> N.\n"
        "           step(_, _) -> error(of_no_use).",
    [
        begin
            load(First),
            {ok, Sim} = starl_sim:start(
                #{app => starl_sim_reloaded, robots => 1, clock_offset => 0, clock_drift => 0},
                #{watch => [{starl_sim_order_monitor, #{}}]}
            ),
            #{ending := none} = starl_sim:run(Sim, 1.5),
            [ok = starl_sim:reload(Sim, code(Code)) || Code <- [Bad | Next]],
            #{ending := done} = starl_sim:run(Sim),
            [#{back := [1], why := {_, 1, app, {migration_failed, Why}}} | _] =
                starl_sim:reloads(Sim),
            ?assertMatch({"no clause of " ++ _, [_ | _]}, Why),
            {#{robots := [{1, #{result := Result}}]} = Outcome, _} = starl_sim:finish(Sim),
            ?assertEqual({done, Expected}, Result),
            Trace = starl_sim_ct:trace(Outcome),
            ?assertEqual([], [E || {_, _, supervisor, _} = E <- Trace])
        end
     || {Next, Expected} <- [{[], {3, {ok, 1, kept}}}, {[Better], {better, 2, {ok, 1, kept}}}]
    ].

bad_code_is_refused(_) ->
    load("init(_, _) -> 0. step(R, 0) -> ok = starl:sleep(R, 1000), {done, fine}."),
    {ok, Sim} = starl_sim:start(#{app => starl_sim_reloaded, robots => 1}),
    [
        begin
            {error, Reason} = starl_sim:reload(Sim, Source),
            ?assertMatch(
                [_ | _], lists:flatten(io_lib:format("~ts", [starl_sim:format_error(Reason)]))
            )
        end
     || Source <- [{starl_sim_reloaded, "x.erl", <<"no beam">>}, no_such, "no_such.erl", lists]
    ],
    #{ending := done} = starl_sim:run(Sim),
    {#{robots := [{1, #{result := {done, fine}}}]}, _} = starl_sim:finish(Sim).

code(Code) -> {starl_sim_reloaded, "starl_sim_reloaded.erl", compiled(Code)}.

load(Code) ->
    Beam = compiled(Code),
    true = code:soft_purge(starl_sim_reloaded),
    {module, _} = code:load_binary(starl_sim_reloaded, "starl_sim_reloaded.erl", Beam).

compiled(Code) ->
    Source =
        "-module(starl_sim_reloaded).\n"
        "-compile([export_all, nowarn_export_all]).\n" ++ Code,
    {ok, Tokens, _} = erl_scan:string(Source),
    Forms = [
        begin
            {ok, Form} = erl_parse:parse_form(F),
            Form
        end
     || F <- forms(Tokens, [])
    ],
    {ok, starl_sim_reloaded, Binary} = compile:forms(Forms, [debug_info]),
    Binary.

forms([], []) -> [];
forms([{dot, _} = Dot | Rest], Form) -> [lists:reverse([Dot | Form]) | forms(Rest, [])];
forms([Token | Rest], Form) -> forms(Rest, [Token | Form]).

%% -- control of a run -----------------------------------------------------------------------

%% What is wrong is told in one line, everything at once.
errors_of_start(_) ->
    Line = fun(Given) ->
        {error, Reason} = starl_sim:start(Given),
        lists:flatten(io_lib:format("~ts", [starl_sim:format_error(Reason)]))
    end,
    ?assertEqual(
        "there is no application no_such_app; is it compiled, and in the path?",
        Line(#{app => no_such_app})
    ),
    Both = Line(#{app => ?APP, robots => 0, lss => 0.5}),
    ?assertNotEqual(nomatch, string:find(Both, "did you mean loss?")),
    ?assertNotEqual(nomatch, string:find(Both, "robots: a whole number from 1")),
    ?assertEqual(
        "fault x: there is no robot 5",
        Line(#{app => ?APP, robots => 4, faults => [{x, 0, 0, kill_robot, 5, #{}}]})
    ),
    ?assertNotEqual(
        nomatch,
        string:find(
            Line(#{app => ?APP, faults => [{x, 9, 1, kill_robot, 1, #{}}]}),
            "fault x:"
        )
    ).

run_step_stop_status(_) ->
    {ok, Sim} = start(2, fun(R) -> starl:sleep(R, 100000) end, #{}),
    ?assertMatch(#{now_us := 0, running := 2, ending := none}, starl_sim:status(Sim)),
    ?assertMatch(#{now_us := 10000000, ending := none}, starl_sim:run(Sim, 10)),
    ?assertMatch(#{now_us := 10500000, ending := none}, starl_sim:step(Sim, 0.5)),
    ?assertMatch(
        #{
            sap := #{module := starl_sap, state := ready},
            motion := #{state := idle},
            app := #{state := sequential, stack := [_ | _]}
        },
        starl_sim:inspect(Sim, 2)
    ),
    ?assertEqual(unknown, starl_sim:inspect(Sim, 3)),
    ?assertEqual(2, length(starl_sim:robot_pids(Sim, all))),
    ok = starl_sim:stop(Sim),
    ?assertMatch(#{ending := stopped}, starl_sim:run(Sim)),
    ?assertMatch({#{ending := stopped, violations := []}, #{figures := []}}, starl_sim:finish(Sim)).

%% A simulation can be looked at from the beginning,
inspect_before_the_first_step(_) ->
    Seen = starl_platform_ct:within(?WALL_MS, fun() ->
        {ok, Sim} = start(1, fun starl:id/1, #{}),
        starl_sim:inspect(Sim, 1)
    end),
    ?assertMatch(#{sap := _, app := _, motion := _}, Seen).

%% and also after a process was killed that has not gone on yet.
inspect_what_restarts(_) ->
    Seen = starl_platform_ct:within(?WALL_MS, fun() ->
        {ok, Sim} = start(4, fun(R) -> starl:sleep(R, 1000) end, #{shards => 2}),
        starl_sim:run(Sim, 0.5),
        kill(pid_of(Sim, 1, sap), Sim),
        starl_sim:inspect(Sim, 1)
    end),
    ?assertMatch(#{sap := _, app := _, motion := _}, Seen).

%% A time that has passed already is no time to run to.
time_never_runs_back(_) ->
    {ok, Sim} = start(1, fun(R) -> starl:sleep(R, 100000) end, #{}),
    #{now_us := 10000000} = starl_sim:run(Sim, 10),
    ?assertMatch(#{now_us := 10000000}, starl_sim:run(Sim, 5)),
    {#{end_us := 10000000}, _} = starl_sim:finish(Sim).

%% A run whose time is up says so.
ending_time(_) ->
    {ok, Sim} = start(1, fun(R) -> starl:sleep(R, 100000) end, #{time => 20}),
    ?assertMatch(#{now_us := 20000000, running := 1, ending := time}, starl_sim:run(Sim)),
    starl_sim:finish(Sim).

%% Any number of simulations, one after the other: neither processes nor tables are left.
finish_leaves_nothing(_) ->
    Count = fun() -> {length(processes()), length(ets:all())} end,
    Play = fun() ->
        {ok, Sim} = start(4, fun starl:id/1, #{shards => 2}),
        end_of(Sim)
    end,
    _ = Play(),
    Before = Count(),
    _ = [Play() || _ <- [1, 2, 3]],
    ?assertEqual(Before, Count()).

two_simulations_at_once(_) ->
    Script = fun(R) -> [starl:send(R, 3 - starl:id(R), a, K) || K <- lists:seq(1, 20)] end,
    {#{digest := Alone}, _, _} = play(2, Script, #{}),
    {ok, A} = start(2, Script, #{}),
    {ok, B} = start(2, Script, #{}),
    _ = [[starl_sim:step(S, 0.1) || S <- [A, B]] || _ <- lists:seq(1, 10)],
    [starl_sim:run(S) || S <- [A, B]],
    [?assertMatch({#{digest := Alone}, _}, starl_sim:finish(S)) || S <- [A, B]].
