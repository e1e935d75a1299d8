%% Replay (README): a run can be stopped just after any event of any robot and gone on
%% with as if it had not been; its events can be recorded; checkpoints of the chain do not depend
%% on either. A violating run ends where it ends however it is paused.
-module(starl_sim_replay_SUITE).
-include_lib("stdlib/include/assert.hrl").

-export([suite/0, all/0, init_per_suite/1, end_per_suite/1]).
-export([
    stops_exactly/1,
    stopped_at_random_events/1,
    stop_twice_in_a_window/1,
    recorded_events/1,
    recording_changes_nothing/1,
    checkpoints_are_the_same/1,
    event_beyond_the_end/1,
    event_in_the_past/1,
    no_such_robot/1,
    killed_while_held/1,
    status_while_held/1,
    violation_ends_the_same/1
]).

-define(APP, starl_sim_script_app).

suite() -> [{timetrap, {minutes, 2}}].

all() ->
    [
        stops_exactly,
        stopped_at_random_events,
        stop_twice_in_a_window,
        recorded_events,
        recording_changes_nothing,
        checkpoints_are_the_same,
        event_beyond_the_end,
        event_in_the_past,
        no_such_robot,
        killed_while_held,
        status_while_held,
        violation_ends_the_same
    ].

init_per_suite(Config) -> starl_platform_ct:without_log(Config).

end_per_suite(Config) -> starl_platform_ct:with_log(Config).

%% -- stopping -------------------------------------------------------------------------------

%% Robot 2 has had exactly 37 events; the run goes on to the same end.
stops_exactly(_) ->
    Whole = outcome(shuttle()),
    [
        begin
            {ok, Sim} = starl_sim:start(maps:merge(shuttle(), How)),
            ?assertMatch({ok, #{ending := none}}, starl_sim:run_until_event(Sim, 2, 37)),
            ?assertEqual({How, 37}, {How, events(Sim, 2)}),
            starl_sim:run(Sim),
            ?assertEqual({How, Whole}, {How, told(starl_sim:finish(Sim))})
        end
     || How <- ways()
    ].

%% The same for events drawn at random, one after the other in one run.
stopped_at_random_events(_) ->
    Seed = erlang:unique_integer([positive]) rem 100000,
    ct:pal("seed ~b", [Seed]),
    Whole = outcome(shuttle()),
    _ = rand:seed(exsss, Seed),
    [
        begin
            {ok, Sim} = starl_sim:start(maps:merge(shuttle(), How)),
            _ = [stop_somewhere(Sim, Seed) || _ <- lists:seq(1, 30)],
            starl_sim:run(Sim),
            ?assertEqual({Seed, How, Whole}, {Seed, How, told(starl_sim:finish(Sim))})
        end
     || How <- ways()
    ].

stop_somewhere(Sim, Seed) ->
    Robot = rand:uniform(5),
    N = events(Sim, Robot) + rand:uniform(40) - 1,
    case N > 0 andalso starl_sim:run_until_event(Sim, Robot, N) of
        {ok, _} -> ?assertEqual({Seed, Robot, N}, {Seed, Robot, events(Sim, Robot)});
        false -> ok
    end.

%% All the events of one instant, one by one: many of them lie in one window.
stop_twice_in_a_window(_) ->
    Whole = outcome(shuttle()),
    {ok, Sim} = starl_sim:start((shuttle())#{shards => 2}),
    Stop = fun(N) ->
        {ok, #{now_us := Now}} = starl_sim:run_until_event(Sim, 3, N),
        ?assertEqual(N, events(Sim, 3)),
        Now
    end,
    Times = [Stop(N) || N <- lists:seq(1, 60)],
    ?assertEqual(Times, lists:sort(Times)),
    ?assert(length(lists:usort(Times)) < 50),
    starl_sim:run(Sim),
    ?assertEqual(Whole, told(starl_sim:finish(Sim))).

event_beyond_the_end(_) ->
    {ok, Sim} = starl_sim:start((shuttle())#{shards => 2}),
    {error, {ended, 2, Events} = Why} = starl_sim:run_until_event(Sim, 2, 1000000),
    ?assertEqual(Events, events(Sim, 2)),
    ?assertNotEqual(nomatch, string:find(starl_sim:format_error(Why), integer_to_list(Events))),
    ?assertEqual({error, Why}, starl_sim:run_until_event(Sim, 2, 1000000)),
    ?assertEqual(outcome(shuttle()), told(starl_sim:finish(Sim))).

event_in_the_past(_) ->
    {ok, Sim} = starl_sim:start(shuttle()),
    {ok, Status} = starl_sim:run_until_event(Sim, 1, 50),
    ?assertEqual({ok, Status}, starl_sim:run_until_event(Sim, 1, 50)),
    ?assertEqual({error, {past, 1, 50}}, starl_sim:run_until_event(Sim, 1, 49)),
    starl_sim:close(Sim).

no_such_robot(_) ->
    {ok, Sim} = starl_sim:start(shuttle()),
    ?assertEqual({error, {no_robot, 6}}, starl_sim:run_until_event(Sim, 6, 1)),
    ?assertEqual(unknown, starl_sim:events(Sim, 6)),
    starl_sim:close(Sim).

%% Processes that are killed from outside while a robot is held restart when it goes on (that of
%% robot 2 is killed by a fault besides).
killed_while_held(_) ->
    {ok, Sim} = starl_sim:start((shuttle())#{mode => process, shards => 2}),
    {ok, _} = starl_sim:run_until_event(Sim, 2, 37),
    kill_all_sap(Sim),
    starl_sim:run(Sim),
    {#{robots := Robots, violations := []}, _} = starl_sim:finish(Sim),
    ?assertEqual([1, 2, 1, 1, 1], [
        length([killed || {sap, killed} <- Crashes])
     || {_, #{crashes := Crashes}} <- Robots
    ]).

kill_all_sap(Sim) ->
    Pids = [
        Pid
     || Sup <- starl_sim:robot_pids(Sim, all),
        {services, Services} <- starl_robot_sup:parts(Sup),
        {sap, Pid, _, _} <- supervisor:which_children(Services)
    ],
    Refs = [monitor(process, Pid) || Pid <- Pids],
    _ = [exit(Pid, kill) || Pid <- Pids],
    _ = [
        receive
            {'DOWN', Ref, _, _, _} -> ok
        end
     || Ref <- Refs
    ],
    ok.

%% The time is that of the event, and everything can be looked at.
status_while_held(_) ->
    {ok, Sim} = starl_sim:start((shuttle())#{mode => process, shards => 3}, recording(2, {37, 37})),
    {ok, #{now_us := Now, running := 5}} = starl_sim:run_until_event(Sim, 2, 37),
    [#{n := 37, at_us := At}] = starl_sim:events(Sim, 2),
    ?assertEqual(At, Now),
    ?assertMatch(#{now_us := At}, starl_sim:status(Sim)),
    _ = [?assertMatch(#{sap := #{}}, starl_sim:inspect(Sim, Id)) || Id <- [1, 2, 3, 4, 5]],
    ?assertEqual([1, 2, 3, 4, 5], [Id || {Id, #{pose := {_, _, _}}} <- starl_sim:robots(Sim)]),
    starl_sim:close(Sim).

%% -- recording and checkpoints --------------------------------------------------------------

%% What is recorded are the events of the robot in their order, and its chain.
recorded_events(_) ->
    {ok, Sim} = starl_sim:start(shuttle(), recording(2, {990, 1010})),
    starl_sim:run(Sim),
    Events = starl_sim:events(Sim, 2),
    [] = starl_sim:events(Sim, 3),
    {#{robots := Robots}, _} = starl_sim:finish(Sim),
    ?assertEqual(lists:seq(990, 1010), [N || #{n := N} <- Events]),
    Times = [At || #{at_us := At} <- Events],
    ?assertEqual(Times, lists:sort(Times)),
    [#{chain := Chain, at_us := At}] = [E || #{n := 1000} = E <- Events],
    {2, #{checkpoints := [{1000, At, Chain} | _]}} = lists:keyfind(2, 1, Robots),
    [?assertMatch(#{machine := M, type := _, content := _} when is_atom(M), E) || E <- Events].

recording_changes_nothing(_) ->
    Whole = outcome(shuttle()),
    {ok, Sim} = starl_sim:start(shuttle(), #{record => #{1 => {1, 100}, 2 => {1, 1000000}}}),
    starl_sim:run(Sim),
    {100, Count} = {length(starl_sim:events(Sim, 1)), length(starl_sim:events(Sim, 2))},
    ?assertEqual(events(Sim, 2), Count),
    ?assertEqual(Whole, told(starl_sim:finish(Sim))).

%% Checkpoints every 1,000 events, the same whatever the way.
checkpoints_are_the_same(_) ->
    [One | Others] = [checkpoints(maps:merge(shuttle(), How)) || How <- ways()],
    [?assertEqual(One, Other) || Other <- Others],
    [?assertEqual(lists:seq(1000, 1000 * length(Cs), 1000), [N || {N, _, _} <- Cs]) || Cs <- One],
    ?assert(lists:min([length(Cs) || Cs <- One]) >= 2),
    ?assertNotEqual(One, checkpoints((shuttle())#{seed => 12})).

checkpoints(Scenario) ->
    {ok, Sim} = starl_sim:start(Scenario),
    starl_sim:run(Sim),
    {#{robots := Robots}, _} = starl_sim:finish(Sim),
    [Checkpoints || {_, #{checkpoints := Checkpoints}} <- Robots].

%% -- violations -----------------------------------------------------------------------------

%% A run that breaks a contract comes to the same end when it is run in pieces.
violation_ends_the_same(_) ->
    Script = fun(R) ->
        [
            begin
                starl:sleep(R, 50),
                starl:trace(R, K)
            end
         || K <- lists:seq(1, 200)
        ]
    end,
    Scenario = #{
        app => ?APP,
        robots => 3,
        script => Script,
        time => 60,
        delay => {10, 10},
        around => #{monitors => [{starl_sim_replay_monitor, #{}}]}
    },
    Whole = outcome(Scenario),
    ?assertMatch({violation, _, _, _, [_ | _]}, Whole),
    ?assert(element(2, Whole) < 4000000),
    [
        begin
            {ok, Sim} = starl_sim:start(Scenario#{shards => Shards}),
            ok = in_pieces(Sim, Piece),
            ?assertEqual({Piece, Shards, Whole}, {Piece, Shards, told(starl_sim:finish(Sim))})
        end
     || Piece <- [0.01, 0.013, 0.1, 1], Shards <- [1, 2]
    ].

in_pieces(Sim, Piece) ->
    case starl_sim:step(Sim, Piece) of
        #{ending := none} -> in_pieces(Sim, Piece);
        #{ending := violation} -> ok
    end.

%% -- helpers --------------------------------------------------------------------------------

shuttle() ->
    #{
        app => starl_ring_shuttle,
        robots => 5,
        messages => 500,
        seed => 11,
        loss => 0.2,
        duplicate => 0.1,
        delay => {10, 20},
        time => 90,
        faults => [
            {a, 3000, 3000, kill_machine, {2, sap}, #{}},
            {b, 5000, 5000, kill_machine, {4, app}, #{}}
        ]
    }.

ways() -> [#{mode => Mode, shards => N} || Mode <- [process, inline], N <- [1, 2, 3]].

recording(Robot, Range) -> #{record => #{Robot => Range}}.

events(Sim, Robot) ->
    {Robot, #{events := Events}} = lists:keyfind(Robot, 1, starl_sim:robots(Sim)),
    Events.

outcome(Scenario) ->
    {ok, Sim} = starl_sim:start(Scenario),
    starl_sim:run(Sim),
    told(starl_sim:finish(Sim)).

told({#{ending := Ending, end_us := End, digest := Digest} = Outcome, _}) ->
    #{events := Events, violations := Violations} = Outcome,
    {Ending, End, Digest, Events, Violations}.
