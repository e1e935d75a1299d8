%% Crashes in the simulator: a machine, an application or a whole robot that crashes, is killed by
%% a fault or from outside, comes back or dies; virtual time waits for it, the others go on.
-module(starl_sim_crash_SUITE).
-include_lib("stdlib/include/assert.hrl").
-import(starl_sim_ct, [
    start/3,
    play/3,
    played/3,
    end_of/1,
    well_ended/1,
    trace/1,
    crashing/1,
    point/1,
    pid_of/3,
    kill/2,
    robot_of/1,
    no_jump/1
]).

-export([suite/0, all/0, init_per_suite/1, end_per_suite/1]).
-export([
    killed_machine_is_told/1,
    killed_services_restart/1,
    killed_app_starts_anew/1,
    ended_is_ended_once/1,
    late_answers_do_not_reach_the_next_app/1,
    listening_survives_a_killed_sap/1,
    killed_robot_dies_alone/1,
    crash_with_events_waiting/1,
    app_crash_with_messages_waiting/1,
    killed_from_outside/1,
    killed_from_outside_while_all_rest/1,
    robot_killed_from_outside/1,
    app_that_crashes_for_ever_is_given_up/1,
    block_that_crashes_for_ever_is_given_up/1,
    own_crash_is_a_violation/1,
    vouched_for_app_must_not_crash/1,
    fault_at_no_machine_is_told/1
]).

-define(APP, starl_sim_script_app).

suite() -> [{timetrap, {minutes, 1}}].

all() ->
    [
        killed_machine_is_told,
        killed_services_restart,
        killed_app_starts_anew,
        ended_is_ended_once,
        late_answers_do_not_reach_the_next_app,
        listening_survives_a_killed_sap,
        killed_robot_dies_alone,
        crash_with_events_waiting,
        app_crash_with_messages_waiting,
        killed_from_outside,
        killed_from_outside_while_all_rest,
        robot_killed_from_outside,
        app_that_crashes_for_ever_is_given_up,
        block_that_crashes_for_ever_is_given_up,
        own_crash_is_a_violation,
        vouched_for_app_must_not_crash,
        fault_at_no_machine_is_told
    ].

init_per_suite(Config) -> starl_platform_ct:without_log(Config).

end_per_suite(Config) -> starl_platform_ct:with_log(Config).

%% A call to a machine that crashes is answered `restarted'; the other machines are told.
killed_machine_is_told(_) ->
    {_, Results, Trace} = play(
        1,
        fun(R) ->
            {starl:call(R, crash, ignore, infinity), starl:call(R, crash, incarnation, infinity)}
        end,
        crashing(#{faults => [{a, 1000, 1000, kill_machine, {1, crash}, #{}}]})
    ),
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
    {_, Results, Trace} = play(
        2,
        fun(R) ->
            case starl:id(R) of
                1 ->
                    ok = starl:sleep(R, 990),
                    Sent = starl:send(R, 2, a, 1),
                    First = starl:go_to(R, {5000.0, 5000.0}),
                    {Sent, First, starl:go_to(R, {5000.0, 5000.0}), starl:send(R, 2, a, 2)};
                2 ->
                    ok
            end
        end,
        #{faults => Faults, delay => {20, 30}}
    ),
    ?assertEqual([{done, {{error, restarted}, {error, restarted}, ok, ok}}, {done, ok}], Results),
    ?assertEqual([1, 2], [I || {_, 1, sap, {started, I}} <- Trace]).

killed_app_starts_anew(_) ->
    {_, Results, _} = play(
        1,
        fun(R) ->
            case starl:now(R) < 500 of
                true -> starl:await(R, never);
                false -> started_anew
            end
        end,
        #{clock_offset => 0, faults => [{a, 1000, 1000, kill_machine, {1, app}, #{}}]}
    ),
    ?assertEqual([{done, started_anew}], Results).

%% An application that has ended, crashes and ends again, or whose robot dies then, has ended
%% once: the run waits for the others.
ended_is_ended_once(_) ->
    [
        begin
            {_, Results, _} = play(
                2,
                fun(R) -> starl:sleep(R, 1000 * starl:id(R)) end,
                #{faults => [Fault], clock_offset => 0}
            ),
            ?assertMatch([_, {done, ok}], Results)
        end
     || Fault <- [{a, 1300, 1300, kill_machine, {1, app}, #{}}, {a, 1300, 1300, kill_robot, 1, #{}}]
    ],
    {_, Again, _} = play(
        2,
        fun(R) ->
            case {starl:id(R), starl:now(R) < 500} of
                {1, _} -> ok;
                {2, _} -> starl:sleep(R, 2000)
            end
        end,
        #{faults => [{a, 1000, 1000, kill_machine, {1, app}, #{}}], clock_offset => 0}
    ),
    ?assertEqual([{done, ok}, {done, ok}], Again).

%% The answer to a call of an application that crashed is none to a call of the next one.
late_answers_do_not_reach_the_next_app(_) ->
    {_, Results, _} = play(
        2,
        fun(R) ->
            case {starl:id(R), starl:now(R) < 500} of
                {1, true} -> starl:send(R, 2, a, lost);
                {1, false} -> {starl:go_to(R, {9000.0, 9000.0}), starl:now(R) > 10000};
                {2, _} -> ok
            end
        end,
        #{clock_offset => 0, loss => 1, faults => [{a, 1000, 1000, kill_machine, {1, app}, #{}}]}
    ),
    ?assertEqual([{done, {ok, true}}, {done, ok}], Results).

listening_survives_a_killed_sap(_) ->
    {_, Results, _} = play(
        2,
        fun(R) ->
            case starl:id(R) of
                1 ->
                    ok = starl:listen(R, a),
                    starl:await(R, a);
                2 ->
                    ok = starl:sleep(R, 3000),
                    starl:send(R, 1, a, hello)
            end
        end,
        #{faults => [{a, 1000, 1000, kill_machine, {1, sap}, #{}}]}
    ),
    ?assertEqual([{done, {ok, 2, hello}}, {done, ok}], Results).

%% A robot that dies stands where it is, for ever; the others go on.
killed_robot_dies_alone(_) ->
    {_, Results, Trace} = play(
        2,
        fun(R) ->
            case starl:id(R) of
                1 ->
                    starl:go_to(R, {9000.0, 1000.0});
                2 ->
                    ok = starl:sleep(R, 5000),
                    {ok, First} = starl:position(R, 1),
                    Outcome = starl:send(R, 1, a, b),
                    {ok, Second} = starl:position(R, 1),
                    {starl_geometry:distance(point(First), point(Second)) < 5.0, Outcome}
            end
        end,
        #{faults => [{a, 3000, 3000, kill_robot, 1, #{}}]}
    ),
    ?assertEqual([died, {done, {true, {error, lost}}}], Results),
    ?assertMatch([{3000000, 1, robot, {died, killed}}], [E || {_, _, robot, _} = E <- Trace]),
    no_jump(Trace).

%% A machine that crashes while further events of the same moment wait for it comes back first
%% and then gets them.
crash_with_events_waiting(_) ->
    {_, Results, Trace} = played(
        1,
        fun(R) ->
            ok = starl_app_proc:perform([{cast, crash, boom}, {cast, crash, {count, 1}}]),
            ok = starl:sleep(R, 1000),
            starl:call(R, crash, incarnation, 1000)
        end,
        crashing(#{})
    ),
    ?assertEqual([{done, {ok, 2}}], Results),
    ?assertMatch([{_, 1, crash, {counted, 1}}], [E || {_, _, _, {counted, _}} = E <- Trace]).

%% Likewise the application.
app_crash_with_messages_waiting(_) ->
    {_, Results, _} = play(
        1,
        fun(R) ->
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
        end,
        #{clock_offset => 0}
    ),
    ?assertEqual([{done, started_anew}], Results).

%% A process killed from outside between two steps: virtual time waits until it is back.
killed_from_outside(_) ->
    {ok, Sim} = start(
        4,
        fun(R) ->
            ok = starl:listen(R, a),
            [starl:send(R, starl:id(R) rem 4 + 1, a, K) || K <- lists:seq(1, 500)],
            starl:go_to(R, {5000.0, 1000.0 * starl:id(R)})
        end,
        #{shards => 2}
    ),
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
    {ok, Sim} = start(
        4,
        fun(R) ->
            ok = starl:listen(R, a),
            ok = starl:sleep(R, 60000),
            starl:broadcast(R, a, hello)
        end,
        #{shards => 2, clock_offset => 0, clock_drift => 0}
    ),
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
    {ok, Sim} = start(
        4,
        fun(R) -> starl:go_to(R, {9000.0, 1000.0 + 2000.0 * starl:id(R)}) end,
        #{speed => 100, shards => 2}
    ),
    #{now_us := Killed} = starl_sim:run(Sim, 5.1),
    [Robot] = [Sup || Sup <- starl_sim:robot_pids(Sim, all), robot_of(Sup) =:= 1],
    kill(Robot, Sim),
    Outcome = end_of(Sim),
    well_ended(Outcome),
    [{Died, 1}] = [{T, R} || {T, R, robot, {died, _}} <- trace(Outcome)],
    ?assert(Died >= Killed),
    ?assertEqual(
        [died, {done, ok}, {done, ok}, {done, ok}],
        [Result || {_, #{result := Result}} <- maps:get(robots, Outcome)]
    ),
    no_jump(trace(Outcome)).

%% An application that crashes again and again is given up, and only it: the blocks and services of
%% its robot go on and answer, and the robot stands.
app_that_crashes_for_ever_is_given_up(_) ->
    [
        begin
            {_, Results, Trace} = play(
                2,
                fun(R) ->
                    case {starl:id(R), starl:now(R) < 2000} of
                        {1, true} ->
                            ok = starl_app_proc:perform([
                                {cast, motion, {go_to, {9000.0, 1000.0}}},
                                {call, motion, {go_to, {9000.0, 1000.0}}, x}
                            ]),
                            starl:sleep(R, 2000),
                            error(always);
                        {1, false} ->
                            error(always);
                        {2, _} ->
                            ok = starl:sleep(R, 8000),
                            {ok, First} = starl:position(R, 1),
                            Outcome = starl:send(R, 1, a, hello),
                            {ok, Second} = starl:position(R, 1),
                            Moved = starl_geometry:distance(point(First), point(Second)),
                            {Outcome, Moved < 5.0}
                    end
                end,
                crashing(#{mode => Mode, clock_offset => 0, speed => 100})
            ),
            ?assertEqual([given_up, {done, {ok, true}}], Results),
            ?assertMatch(
                [{_, 1, supervisor, {given_up, app}}],
                [E || {_, _, _, {given_up, _}} = E <- Trace]
            ),
            ?assertEqual([], [E || {_, _, robot, _} = E <- Trace])
        end
     || Mode <- [process, inline]
    ].

%% A block is given up alone, too; whoever calls it then is told so.
block_that_crashes_for_ever_is_given_up(_) ->
    [
        begin
            {Outcome, Results, Trace} = played(
                1,
                fun(R) ->
                    Boom = [{cast, crash, boom} || _ <- lists:seq(1, 1001)],
                    ok = starl_app_proc:perform(Boom),
                    ok = starl:sleep(R, 1000),
                    Call = fun(Name) ->
                        try
                            starl:call(R, Name, incarnation, infinity)
                        catch
                            error:Reason -> Reason
                        end
                    end,
                    {Call(crash), Call(other), starl:position(R), starl:send(R, 1, a, b)}
                end,
                crashing(#{mode => Mode})
            ),
            ?assertMatch(
                [{done, {{given_up, crash, _}, {ok, 1}, {ok, {_, _, _}}, ok}}], Results
            ),
            ?assertEqual([crash], [Name || {_, _, supervisor, {given_up, Name}} <- Trace]),
            ?assertMatch(
                [#{contract := crash, what := crashed} | _],
                maps:get(violations, Outcome)
            )
        end
     || Mode <- [process, inline]
    ].

%% A machine that crashes by itself is a violation with its place in the code, the same in every
%% mode; what a fault kills is none, and a user's application is told of.
own_crash_is_a_violation(_) ->
    Play = fun(Mode, Word) ->
        {#{digest := Digest} = Outcome, _, _} = played(
            1,
            fun(R) ->
                ok = starl_app_proc:perform([{cast, crash, Word}]),
                ok = starl:sleep(R, 1000),
                starl:now(R) < 1500 andalso error(mine),
                starl:call(R, crash, incarnation, infinity)
            end,
            crashing(#{
                mode => Mode,
                clock_offset => 0,
                faults => [{a, 500, 500, kill_machine, {1, other}, #{}}]
            })
        ),
        {
            maps:get(violations, Outcome),
            Digest,
            maps:get(starl_crash_monitor, maps:get(monitors, Outcome))
        }
    end,
    [
        begin
            {[Violation | _], Digest, Results} = Play(process, Word),
            ?assertMatch(
                {Word, #{
                    contract := crash,
                    what := crashed,
                    robots := [1],
                    details := #{reason := Reason}
                }},
                {Word, Violation}
            ),
            #{details := #{stack := Stack}} = Violation,
            ?assertMatch(
                {match, _},
                re:run(
                    Stack,
                    "starl_sim_crash_machine:handle_event/5 "
                    "\\(starl_sim_crash_machine.erl:[0-9]+\\)"
                )
            ),
            ?assertMatch(#{first_crash := {_, 1, app, {"mine", [_ | _]}}}, Results),
            {[Inline | _], SameDigest, SameResults} = Play(inline, Word),
            ?assertEqual({Violation, Digest, Results}, {Inline, SameDigest, SameResults})
        end
     || {Word, Reason} <- [
            {boom, "exit with boom"},
            {match, "no match of the value <>"},
            {throw, "thrown and not caught: ball"}
        ]
    ].

%% An application that we vouch for is held to it like a block.
vouched_for_app_must_not_crash(_) ->
    {#{violations := Violations}, _, _} = played(
        1,
        fun(R) ->
            starl:now(R) < 1500 andalso
                begin
                    ok = starl:sleep(R, 2000),
                    error(mine)
                end
        end,
        #{clock_offset => 0, around => #{never_crashes => true}}
    ),
    ?assertMatch([#{contract := app, what := crashed}], Violations).

%% A fault that strikes nothing is a mistake in the scenario, not a success.
fault_at_no_machine_is_told(_) ->
    Given = #{app => ?APP, robots => 1, faults => [{x, 0, 0, kill_machine, {1, sapp}, #{}}]},
    case starl_sim:start(Given) of
        {error, _} ->
            ok;
        {ok, Sim} ->
            starl_sim:close(Sim),
            error(unknown_machine_accepted)
    end.
