%% The simulator as its users see it: the API of an application, hot reload, crashes and
%% restarts, and the control of a run. Applications are functions (starl_sim_script_app).
-module(starl_sim_SUITE).
-include_lib("stdlib/include/assert.hrl").

-export([suite/0, all/0, init_per_suite/1, end_per_suite/1]).
-export([
    every_function_of_the_api/1, send_and_await/1, post_and_broadcast/1, await_times_out/1,
    sleep_by_the_robots_clock/1, messages_wait_in_the_inbox/1, go_to_and_positions/1,
    unknown_waypoint_and_robot/1, send_to_a_robot_that_is_not/1, random_from_the_seed/1,
    actuate_and_trace/1, call_times_out/1, call_to_no_machine_is_a_mistake/1,
    unreachable_robot_is_lost/1,
    hot_reload_carries_the_state/1, hot_reload_without_code_change/1,
    errors_of_start/1, run_step_stop_status/1, inspect_before_the_first_step/1, inspect_what_restarts/1, time_never_runs_back/1, ending_time/1,
    finish_leaves_nothing/1, two_simulations_at_once/1,
    killed_machine_is_told/1, killed_services_restart/1, killed_app_starts_anew/1, ended_is_ended_once/1,
    late_answers_do_not_reach_the_next_app/1, listening_survives_a_killed_sap/1,
    killed_robot_dies_alone/1, crash_with_events_waiting/1, app_crash_with_messages_waiting/1,
    killed_from_outside/1, killed_from_outside_while_all_rest/1, robot_killed_from_outside/1,
    supervisor_gives_up/1, fault_at_no_machine_is_told/1
]).

-define(APP, starl_sim_script_app).
-define(WALL_MS, 10000).

suite() -> [{timetrap, {minutes, 1}}].

all() ->
    [
        every_function_of_the_api, send_and_await, post_and_broadcast, await_times_out,
        sleep_by_the_robots_clock, messages_wait_in_the_inbox, go_to_and_positions,
        unknown_waypoint_and_robot, send_to_a_robot_that_is_not, random_from_the_seed,
        actuate_and_trace, call_times_out, call_to_no_machine_is_a_mistake,
        unreachable_robot_is_lost,
        hot_reload_carries_the_state, hot_reload_without_code_change,
        errors_of_start, run_step_stop_status, inspect_before_the_first_step,
        inspect_what_restarts, time_never_runs_back, ending_time,
        finish_leaves_nothing, two_simulations_at_once,
        killed_machine_is_told, killed_services_restart, killed_app_starts_anew, ended_is_ended_once,
        late_answers_do_not_reach_the_next_app, listening_survives_a_killed_sap,
        killed_robot_dies_alone, crash_with_events_waiting, app_crash_with_messages_waiting,
        killed_from_outside, killed_from_outside_while_all_rest, robot_killed_from_outside,
        supervisor_gives_up, fault_at_no_machine_is_told
    ].

%% Crashes are planned here: their reports are not.
init_per_suite(Config) ->
    #{level := Level} = logger:get_primary_config(),
    ok = logger:set_primary_config(level, none),
    [{level, Level} | Config].

end_per_suite(Config) -> logger:set_primary_config(level, proplists:get_value(level, Config)).

%% -- the API of an application --------------------------------------------------------------

every_function_of_the_api(_) ->
    {_, Results, _} = play(2, fun(R) ->
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
    end, #{around => #{waypoints => #{dock => {3000.0, 3000.0}}}}),
    ?assertEqual([{done, 1}, {done, 2}], Results).

%% A message is delivered with its source and content, and its outcome is told.
send_and_await(_) ->
    {_, Results, _} = play(2, fun(R) -> ring(starl:id(R), R) end, #{loss => 0.3, duplicate => 0.3}),
    ?assertEqual([{done, lists:seq(1, 20)}, {done, sent}], Results).

ring(1, R) ->
    ok = starl:listen(R, number),
    [begin {ok, 2, K} = starl:await(R, number), K end || _ <- lists:seq(1, 20)];
ring(2, R) ->
    [ok = starl:send(R, 1, number, K) || K <- lists:seq(1, 20)],
    sent.

post_and_broadcast(_) ->
    {_, Results, _} = play(3, fun(R) ->
        ok = starl:listen(R, a),
        ok = starl:listen(R, b),
        ok = starl:broadcast(R, a, starl:id(R)),
        [ok = starl:post(R, Id, b, starl:id(R)) || Id <- starl:participants(R)],
        Got = fun(Type, N) ->
            lists:sort([begin {ok, F, F} = starl:await(R, Type), F end || _ <- lists:seq(1, N)])
        end,
        {Got(b, 3), Got(a, 2)}
    end, #{}),
    ?assertEqual([{done, {[1, 2, 3], [1, 2, 3] -- [Id]}} || Id <- [1, 2, 3]], Results).

await_times_out(_) ->
    {_, [{done, {timeout, Ms, {ok, 1, late}}}], _} = play(1, fun(R) ->
        ok = starl:listen(R, a),
        Before = starl:now(R),
        First = starl:await(R, a, 700),
        Took = starl:now(R) - Before,
        ok = starl:post(R, 1, a, late),
        {First, Took, starl:await(R, a, 700)}
    end, #{}),
    ?assert(abs(Ms - 700) =< 1).

%% A robot sleeps by its own clock: clocks that drift apart wake at different times.
sleep_by_the_robots_clock(_) ->
    {_, Results, Trace} = play(4, fun(R) ->
        Before = starl:now(R),
        ok = starl:sleep(R, 100000),
        ok = starl:trace(R, awake),
        ok = starl:sleep(R, 1),
        starl:now(R) - Before
    end, #{clock_drift => 1000, clock_offset => 5000}),
    [?assert(abs(Took - 100001) =< 2) || {done, Took} <- Results],
    Woke = [T || {T, _, app, awake} <- Trace],
    ?assertEqual(4, length(lists:usort(Woke))),
    [?assert(abs(T - 100000000) =< 101000) || T <- Woke].

%% Messages that come while the application waits for something else are kept, in order.
messages_wait_in_the_inbox(_) ->
    {_, [{done, _}, {done, Got}], _} = play(2, fun(R) ->
        case starl:id(R) of
            1 -> [ok = starl:send(R, 2, a, K) || K <- lists:seq(1, 50)];
            2 ->
                ok = starl:listen(R, a),
                ok = starl:sleep(R, 60000),
                [begin {ok, 1, K} = starl:await(R, a, 0), K end || _ <- lists:seq(1, 50)]
        end
    end, #{}),
    ?assertEqual(lists:seq(1, 50), Got).

go_to_and_positions(_) ->
    Waypoints = #{dock => {6000.0, 2500.0}},
    {_, [{done, Own}, {done, Seen}], _} = play(2, fun(R) ->
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
    end, #{around => #{waypoints => Waypoints}}),
    Goal = maps:get(goal_mm, starl_motion:profile(#{})),
    [
        ?assert(starl_geometry:distance({X, Y}, {6000.0, 2500.0}) =< Goal + 3.0)
     || {X, Y, _} <- [Own, Seen]
    ].

unknown_waypoint_and_robot(_) ->
    {_, Results, _} = play(1, fun(R) ->
        {starl:waypoint(R, nowhere), starl:go_to(R, nowhere), starl:position(R, 7)}
    end, #{}),
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
    {_, _, Trace} = play(1, fun(R) ->
        starl:actuate(R, pen, down),
        starl:sleep(R, 1000),
        starl:trace(R, {fact, 1}),
        starl:actuate(R, pen, up)
    end, #{}),
    ?assertMatch(
        [{0, 1, chassis, {actuated, pen, down}}, {T, 1, app, {fact, 1}}, {T, 1, chassis, {actuated, pen, up}}]
            when T > 990000,
        [E || {_, _, M, What} = E <- Trace, M =:= app orelse M =:= chassis, element(1, What) =:= fact
            orelse element(1, What) =:= actuated]
    ).

call_times_out(_) ->
    {_, Results, _} = play(1, fun(R) ->
        {starl:call(R, crash, ignore, 500), starl:call(R, crash, incarnation, 500)}
    end, crashing(#{})),
    ?assertEqual([{done, {{error, timeout}, {ok, 1}}}], Results).

%% It is not answered at all, nor waits for ever: the application crashes, until its robot dies.
call_to_no_machine_is_a_mistake(_) ->
    {_, Results, Trace} = play(1, fun(R) -> starl:call(R, no_such, x, infinity) end, #{}),
    ?assertEqual([died], Results),
    ?assertMatch([_ | _], [E || {_, 1, no_such, {unknown_machine, _} = E} <- Trace]).

unreachable_robot_is_lost(_) ->
    {_, [{done, A}, {done, B}], _} = play(2, fun(R) ->
        Other = 3 - starl:id(R),
        {starl:send(R, Other, a, b), starl:broadcast(R, a, b)}
    end, #{loss => 1}),
    ?assertEqual({{error, lost}, {error, {lost, [2]}}}, A),
    ?assertEqual({{error, lost}, {error, {lost, [1]}}}, B).

%% -- hot reload -----------------------------------------------------------------------------

%% Newly loaded code takes effect at the next step; code_change/2 carries the state over.
hot_reload_carries_the_state(_) ->
    reload("code_change(N, Old) when is_binary(Old) -> {n, N + 1000}.", "{n, N}", fun(Results) ->
        ?assertEqual([{done, {new, 1005}}, {done, {new, 1005}}], Results)
    end).

hot_reload_without_code_change(_) ->
    reload("", "N", fun(Results) ->
        ?assertEqual([{done, {new, 5}}, {done, {new, 5}}], Results)
    end).

reload(Change, Pattern, Check) ->
    load("init(_, _) -> 0.
          step(R, N) -> ok = starl:sleep(R, 1000), {continue, N + 1}."),
    {ok, Sim} = starl_sim:start(#{app => starl_sim_reloaded, robots => 2}),
    #{ending := none} = starl_sim:run(Sim, 4.5),
    load("init(_, _) -> error(started_anew).
          step(_, " ++ Pattern ++ ") -> {done, {new, N}}.\n" ++ Change),
    #{ending := done} = starl_sim:run(Sim),
    {#{robots := Robots}, _} = starl_sim:finish(Sim),
    Check([Result || {_, #{result := Result}} <- Robots]).

load(Code) ->
    Source = "-module(starl_sim_reloaded).
-compile([export_all, nowarn_export_all]).\n" ++ Code,
    {ok, Tokens, _} = erl_scan:string(Source),
    Forms = [begin {ok, Form} = erl_parse:parse_form(F), Form end || F <- forms(Tokens, [])],
    {ok, Module, Binary} = compile:forms(Forms),
    {module, Module} = code:load_binary(Module, "starl_sim_reloaded.erl", Binary).

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
    ?assertEqual("there is no application no_such_app", Line(#{app => no_such_app})),
    Both = Line(#{app => ?APP, robots => 0, lss => 0.5}),
    ?assertNotEqual(nomatch, string:find(Both, "did you mean loss?")),
    ?assertNotEqual(nomatch, string:find(Both, "robots: a whole number from 1")),
    ?assertEqual("fault x: there is no robot 5",
                 Line(#{app => ?APP, robots => 4, faults => [{x, 0, 0, kill_robot, 5, #{}}]})),
    ?assertNotEqual(nomatch, string:find(Line(#{app => ?APP, faults => [{x, 9, 1, kill_robot, 1, #{}}]}),
                                         "fault x:")).

run_step_stop_status(_) ->
    {ok, Sim} = start(2, fun(R) -> starl:sleep(R, 100000) end, #{}),
    ?assertMatch(#{now_us := 0, running := 2, ending := none}, starl_sim:status(Sim)),
    ?assertMatch(#{now_us := 10000000, ending := none}, starl_sim:run(Sim, 10)),
    ?assertMatch(#{now_us := 10500000, ending := none}, starl_sim:step(Sim, 0.5)),
    ?assertMatch(#{sap := #{module := starl_sap, state := ready}, motion := #{state := idle},
                   app := #{state := sequential, stack := [_ | _]}}, starl_sim:inspect(Sim, 2)),
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

%% -- crashes --------------------------------------------------------------------------------

%% A call to a machine that crashes is answered `restarted'; the other machines are told.
killed_machine_is_told(_) ->
    {_, Results, Trace} = play(1, fun(R) ->
        {starl:call(R, crash, ignore, infinity), starl:call(R, crash, incarnation, infinity)}
    end, crashing(#{faults => [{a, 1000, 1000, kill_machine, {1, crash}, #{}}]})),
    ?assertEqual([{done, {{error, restarted}, {ok, 2}}}], Results),
    ?assertMatch([{1000000, 1, crash, crashed}], [E || {_, _, _, crashed} = E <- Trace]),
    ?assertMatch([{1000000, 1, other, {told, crash}}], [E || {_, _, _, {told, _}} = E <- Trace]).

%% SAP, location and motion come back; SAP with its next incarnation.
killed_services_restart(_) ->
    Faults = [
        {sap, 1000, 1000, kill_machine, {1, sap}, #{}},
        {motion, 2000, 2000, kill_machine, {1, motion}, #{}},
        {location, 2100, 2100, kill_machine, {1, location}, #{}}
    ],
    {_, Results, Trace} = play(2, fun(R) ->
        case starl:id(R) of
            1 ->
                ok = starl:sleep(R, 990),
                Sent = starl:send(R, 2, a, 1),
                First = starl:go_to(R, {5000.0, 5000.0}),
                {Sent, First, starl:go_to(R, {5000.0, 5000.0}), starl:send(R, 2, a, 2)};
            2 ->
                ok
        end
    end, #{faults => Faults, delay => {20, 30}}),
    ?assertEqual([{done, {{error, restarted}, {error, restarted}, ok, ok}}, {done, ok}], Results),
    ?assertEqual([1, 2], [I || {_, 1, sap, {started, I}} <- Trace]).

killed_app_starts_anew(_) ->
    {_, Results, _} = play(1, fun(R) ->
        case starl:now(R) < 500 of
            true -> starl:await(R, never);
            false -> started_anew
        end
    end, #{clock_offset => 0, faults => [{a, 1000, 1000, kill_machine, {1, app}, #{}}]}),
    ?assertEqual([{done, started_anew}], Results).

%% An application that has ended, crashes and ends again, or whose robot dies then, has ended
%% once: the run waits for the others.
ended_is_ended_once(_) ->
    [
        begin
            {_, Results, _} = play(2, fun(R) -> starl:sleep(R, 1000 * starl:id(R)) end,
                #{faults => [Fault], clock_offset => 0}),
            ?assertMatch([_, {done, ok}], Results)
        end
     || Fault <- [{a, 1300, 1300, kill_machine, {1, app}, #{}}, {a, 1300, 1300, kill_robot, 1, #{}}]
    ],
    {_, Again, _} = play(2, fun(R) ->
        case {starl:id(R), starl:now(R) < 500} of
            {1, _} -> ok;
            {2, _} -> starl:sleep(R, 2000)
        end
    end, #{faults => [{a, 1000, 1000, kill_machine, {1, app}, #{}}], clock_offset => 0}),
    ?assertEqual([{done, ok}, {done, ok}], Again).

%% The answer to a call of an application that crashed is none to a call of the next one.
late_answers_do_not_reach_the_next_app(_) ->
    {_, Results, _} = play(2, fun(R) ->
        case {starl:id(R), starl:now(R) < 500} of
            {1, true} -> starl:send(R, 2, a, lost);
            {1, false} -> {starl:go_to(R, {9000.0, 9000.0}), starl:now(R) > 10000};
            {2, _} -> ok
        end
    end, #{clock_offset => 0, loss => 1, faults => [{a, 1000, 1000, kill_machine, {1, app}, #{}}]}),
    ?assertEqual([{done, {ok, true}}, {done, ok}], Results).

listening_survives_a_killed_sap(_) ->
    {_, Results, _} = play(2, fun(R) ->
        case starl:id(R) of
            1 -> ok = starl:listen(R, a), starl:await(R, a);
            2 -> ok = starl:sleep(R, 3000), starl:send(R, 1, a, hello)
        end
    end, #{faults => [{a, 1000, 1000, kill_machine, {1, sap}, #{}}]}),
    ?assertEqual([{done, {ok, 2, hello}}, {done, ok}], Results).

%% A robot that dies stands where it is, for ever; the others go on.
killed_robot_dies_alone(_) ->
    {_, Results, Trace} = play(2, fun(R) ->
        case starl:id(R) of
            1 -> starl:go_to(R, {9000.0, 1000.0});
            2 ->
                ok = starl:sleep(R, 5000),
                {ok, First} = starl:position(R, 1),
                Outcome = starl:send(R, 1, a, b),
                {ok, Second} = starl:position(R, 1),
                {starl_geometry:distance(point(First), point(Second)) < 5.0, Outcome}
        end
    end, #{faults => [{a, 3000, 3000, kill_robot, 1, #{}}]}),
    ?assertEqual([died, {done, {true, {error, lost}}}], Results),
    ?assertMatch([{3000000, 1, robot, {died, killed}}], [E || {_, _, robot, _} = E <- Trace]),
    no_jump(Trace).

%% A machine that crashes while further events of the same moment wait for it comes back first
%% and then gets them.
crash_with_events_waiting(_) ->
    {_, Results, Trace} = play(1, fun(R) ->
        ok = starl_app_proc:perform([{cast, crash, boom}, {cast, crash, {count, 1}}]),
        ok = starl:sleep(R, 1000),
        starl:call(R, crash, incarnation, 1000)
    end, crashing(#{})),
    ?assertEqual([{done, {ok, 2}}], Results),
    ?assertMatch([{_, 1, crash, {counted, 1}}], [E || {_, _, _, {counted, _}} = E <- Trace]).

%% Likewise the application.
app_crash_with_messages_waiting(_) ->
    {_, Results, _} = play(1, fun(R) ->
        ok = starl:listen(R, a),
        case starl:now(R) < 500 of
            true ->
                [ok = starl:post(R, 1, a, K) || K <- lists:seq(1, 3)],
                {ok, 1, 1} = starl:await(R, a),
                ok = starl:sleep(R, 1000),
                [ok = starl:post(R, 1, a, K) || K <- lists:seq(1, 3)],
                {ok, 1, 2} = starl:await(R, a),
                {ok, 1, 3} = starl:await(R, a),
                {ok, 1, 1} = starl:await(R, a),
                error(planned);
            false ->
                started_anew
        end
    end, #{clock_offset => 0}),
    ?assertEqual([{done, started_anew}], Results).

%% A process killed from outside between two steps: virtual time waits until it is back.
killed_from_outside(_) ->
    {ok, Sim} = start(4, fun(R) ->
        ok = starl:listen(R, a),
        [starl:send(R, starl:id(R) rem 4 + 1, a, K) || K <- lists:seq(1, 500)],
        starl:go_to(R, {5000.0, 1000.0 * starl:id(R)})
    end, #{shards => 2}),
    Kill = fun(Name) ->
        kill(pid_of(Sim, 1, Name), Sim),
        starl_sim:step(Sim, 0.5)
    end,
    starl_sim:run(Sim, 1),
    [Kill(Name) || Name <- [sap, location, motion, sap, app]],
    Outcome = end_of(Sim),
    well_ended(Outcome),
    ?assertEqual([1, 2, 3], [I || {_, 1, sap, {started, I}} <- trace(Outcome)]).

%% The same while nothing is to happen for long: the restart takes place now, not then, and
%% virtual time does not run back for it.
killed_from_outside_while_all_rest(_) ->
    {ok, Sim} = start(4, fun(R) ->
        ok = starl:listen(R, a),
        ok = starl:sleep(R, 60000),
        starl:broadcast(R, a, hello)
    end, #{shards => 2, clock_offset => 0, clock_drift => 0}),
    #{now_us := 10000000} = starl_sim:run(Sim, 10),
    kill(pid_of(Sim, 1, sap), Sim),
    #{now_us := Later} = starl_sim:step(Sim, 1),
    ?assertEqual(11000000, Later),
    Outcome = end_of(Sim),
    well_ended(Outcome),
    ?assertMatch([0, T] when T >= 10000000, [T || {T, 1, sap, {started, _}} <- trace(Outcome)]),
    ?assert(lists:max([T || {T, 1, sap, {started, _}} <- trace(Outcome)]) < 11000000).

%% A whole robot killed from outside in the middle of a drive dies where it is.
robot_killed_from_outside(_) ->
    {ok, Sim} = start(4, fun(R) -> starl:go_to(R, {9000.0, 1000.0 + 2000.0 * starl:id(R)}) end,
        #{speed => 100, shards => 2}),
    #{now_us := Killed} = starl_sim:run(Sim, 5.1),
    [Robot] = [Sup || Sup <- starl_sim:robot_pids(Sim, all), robot_of(Sup) =:= 1],
    kill(Robot, Sim),
    Outcome = end_of(Sim),
    well_ended(Outcome),
    [{Died, 1}] = [{T, R} || {T, R, robot, {died, _}} <- trace(Outcome)],
    ?assert(Died >= Killed),
    ?assertEqual([died, {done, ok}, {done, ok}, {done, ok}],
                 [Result || {_, #{result := Result}} <- maps:get(robots, Outcome)]),
    no_jump(trace(Outcome)).

%% A machine that crashes again and again: its supervisor gives up, the robot has died, and the
%% others go on.
supervisor_gives_up(_) ->
    {_, Results, Trace} = play(2, fun(R) ->
        case starl:id(R) of
            1 -> error(always);
            2 -> ok = starl:sleep(R, 5000), starl:position(R, 1)
        end
    end, #{}),
    ?assertMatch([died, {done, {ok, {_, _, _}}}], Results),
    ?assertMatch([{_, 1, robot, {died, gave_up}}], [E || {_, _, robot, _} = E <- Trace]).

%% A fault that strikes nothing is a mistake in the scenario, not a success.
fault_at_no_machine_is_told(_) ->
    Given = #{app => ?APP, robots => 1, faults => [{x, 0, 0, kill_machine, {1, sapp}, #{}}]},
    case starl_sim:start(Given) of
        {error, _} -> ok;
        {ok, Sim} -> starl_sim:close(Sim), error(unknown_machine_accepted)
    end.

%% -- helpers --------------------------------------------------------------------------------

start(N, Script, Scenario) ->
    starl_sim:start(maps:merge(#{app => ?APP, robots => N, script => Script, time => 3600}, Scenario)).

%% Plays to the end: the outcome, the robots' results, the trace. No contract may be broken.
play(N, Script, Scenario) ->
    Outcome = starl_platform_ct:within(?WALL_MS, fun() ->
        {ok, Sim} = start(N, Script, Scenario),
        starl_sim:run(Sim),
        {O, _} = starl_sim:finish(Sim),
        O
    end),
    ?assertEqual([], maps:get(violations, Outcome)),
    {Outcome, [Result || {_, #{result := Result}} <- maps:get(robots, Outcome)], trace(Outcome)}.

end_of(Sim) ->
    starl_sim:run(Sim),
    {Outcome, _} = starl_sim:finish(Sim),
    Outcome.

well_ended(#{ending := Ending, violations := Violations}) ->
    ?assertEqual({done, []}, {Ending, Violations}).

trace(#{monitors := #{starl_sim_order_monitor := #{trace := Trace}}}) -> Trace.

crashing(Scenario) ->
    Blocks = [{crash, starl_sim_crash_machine, #{}}, {other, starl_sim_crash_machine, #{}}],
    Scenario#{around => #{blocks => Blocks}}.

point({X, Y, _}) -> {X, Y}.

%% The process of a machine, by the robot's tree.
pid_of(Sim, Robot, Name) ->
    [Pid] = [
        Child
     || Sup <- starl_sim:robot_pids(Sim, all),
        robot_of(Sup) =:= Robot,
        {Id, Child, _, _} <- supervisor:which_children(Sup),
        Id =:= Name
    ],
    Pid.

%% Kills something of robot 1. Returns when its shard has had the news, too: it is also the
%% shard of robot 3 (of four robots on two shards), which has nothing to do with it.
kill(Pid, Sim) ->
    Ref = monitor(process, Pid),
    true = exit(Pid, kill),
    receive
        {'DOWN', Ref, process, Pid, _} -> ok
    end,
    #{sap := _} = starl_sim:inspect(Sim, 3),
    ok.

robot_of(Sup) ->
    {ok, #{start := {_, _, [#{robot := Robot}]}}} = supervisor:get_childspec(Sup, sap),
    Robot.

%% Each piece of motion begins where the one before it has led to.
no_jump(Trace) ->
    Pieces = [{R, P} || {_, R, chassis, {motion, P}} <- Trace],
    [follows([P || {R, P} <- Pieces, R =:= Robot]) || Robot <- lists:usort([R || {R, _} <- Pieces])].

follows([Piece, Next | Rest]) ->
    T = element(2, Next),
    ?assert(T >= element(2, Piece)),
    Distance = starl_geometry:distance(starl_trajectory:position(T, Piece),
                                       starl_trajectory:position(T, Next)),
    ?assert(Distance < 1.0e-6),
    follows([Next | Rest]);
follows([_]) ->
    ok.
