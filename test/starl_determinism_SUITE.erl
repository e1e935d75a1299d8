%% The contract of the simulator (README): the same scenario and seed give the same
%% digest, whatever the number of shards or schedulers, load, pauses, and run for run; and the
%% digest tells runs apart, so that these tests can fail.
-module(starl_determinism_SUITE).
-include_lib("stdlib/include/assert.hrl").

-export([
    suite/0, all/0, groups/0, init_per_suite/1, end_per_suite/1, init_per_group/2, end_per_group/2
]).
-export([
    twice_in_a_row/1,
    shards/1,
    inline/1,
    paused_and_stepped/1,
    under_load/1,
    one_and_two_schedulers/1,
    order_of_keys_in_the_scenario/1,
    seeds_differ/1,
    planted_pid/1,
    planted_unique_integer/1,
    planted_reference/1,
    planted_wall_time/1,
    every_input_counts/1,
    digest/1
]).

suite() -> [{timetrap, {minutes, 30}}].

all() -> [{group, painting}, {group, ring_shuttle}, {group, planted}].

groups() ->
    Same = [
        twice_in_a_row,
        shards,
        inline,
        paused_and_stepped,
        under_load,
        one_and_two_schedulers,
        order_of_keys_in_the_scenario,
        seeds_differ
    ],
    Planted = [
        planted_pid,
        planted_unique_integer,
        planted_reference,
        planted_wall_time,
        every_input_counts
    ],
    [{painting, [], Same}, {ring_shuttle, [], Same}, {planted, [], Planted}].

init_per_suite(Config) -> starl_platform_ct:without_log(Config).

end_per_suite(Config) -> starl_platform_ct:with_log(Config).

init_per_group(painting, Config) ->
    Kill = fun(Id, T, Robot, Machine) -> {Id, T, T, kill_machine, {Robot, Machine}, #{}} end,
    [
        {scenario, #{
            app => starl_painting,
            robots => 5,
            picture => "house",
            seed => 11,
            loss => 0.2,
            duplicate => 0.1,
            delay => {5, 50},
            time => 2000,
            faults => [
                Kill(a, 8000, 1, sap),
                Kill(b, 12000, 2, motion),
                Kill(c, 12000, 3, dpp),
                Kill(d, 20000, 4, app),
                Kill(e, 30000, 5, location),
                Kill(f, 31000, 3, election),
                {g, 40000, 40000, kill_robot, 2, #{}}
            ]
        }}
        | Config
    ];
init_per_group(ring_shuttle, Config) ->
    [
        {scenario, #{
            app => starl_ring_shuttle,
            robots => 9,
            messages => 100,
            seed => 11,
            loss => 0.2,
            duplicate => 0.1,
            delay => {10, 20},
            time => 60,
            clock_drift => 100,
            faults => [
                {a, 3000, 3000, kill_machine, {2, sap}, #{}},
                {b, 5000, 5000, kill_machine, {9, app}, #{}},
                {c, 7000, 7000, kill_robot, 4, #{}}
            ]
        }}
        | Config
    ];
init_per_group(planted, Config) ->
    [{scenario, #{app => starl_sim_script_app, robots => 2, seed => 1}} | Config].

end_per_group(_, _) -> ok.

%% -- the same -------------------------------------------------------------------------------

twice_in_a_row(Config) ->
    Scenario = scenario(Config),
    ?assertEqual(digest(Scenario), digest(Scenario)).

%% How the robots are spread is no part of the result.
shards(Config) ->
    Scenario = scenario(Config),
    One = digest(Scenario#{shards => 1}),
    [?assertEqual({N, One}, {N, digest(Scenario#{shards => N})}) || N <- [2, 3, 7]].

%% A machine does not know whether it is a process.
inline(Config) ->
    Scenario = scenario(Config),
    Process = digest(Scenario#{mode => process}),
    [
        ?assertEqual({N, Process}, {N, digest(Scenario#{mode => inline, shards => N})})
     || N <- [1, 2, 3]
    ].

%% Where a run pauses, and what is looked at meanwhile, does not change it.
paused_and_stepped(Config) ->
    Scenario = (scenario(Config))#{shards => 2},
    {ok, Sim} = starl_sim:start(Scenario),
    ok = step(Sim, lists:seq(1, 40)),
    starl_sim:run(Sim),
    ?assertEqual(digest(Scenario), told(starl_sim:finish(Sim))).

step(_Sim, []) ->
    ok;
step(Sim, [K | Rest]) ->
    case starl_sim:step(Sim, 0.0137 * K) of
        #{ending := none} ->
            #{sap := _} = starl_sim:inspect(Sim, 1 + K rem 3 * 2),
            step(Sim, Rest);
        #{} ->
            ok
    end.

%% Two processes that never rest, and six that come and go.
under_load(Config) ->
    Scenario = (scenario(Config))#{shards => 2},
    Alone = digest(Scenario),
    [
        ?assertEqual({Name, Alone}, {Name, loaded(Load, Scenario)})
     || {Name, Load} <- [
            {never_rest, lists:duplicate(2, fun() -> busy(0) end)},
            {come_and_go, [fun() -> at_times(N, N) end || N <- lists:seq(1, 6)]}
        ]
    ].

loaded(Load, Scenario) ->
    Busy = [spawn_link(One) || One <- Load],
    Digest = digest(Scenario),
    _ = [unlink(Pid) andalso exit(Pid, kill) || Pid <- Busy],
    Digest.

busy(N) -> busy(hashed(N)).

%% Works, and makes room, by turns of different lengths.
at_times(Length, 0) ->
    receive
    after Length -> at_times(Length, 1000 * Length)
    end;
at_times(Length, Left) ->
    _ = hashed(Left),
    at_times(Length, Left - 1).

hashed(N) -> (N * 31 + 7) rem 1000003.

one_and_two_schedulers(Config) ->
    Scenario = (scenario(Config))#{shards => 2},
    Here = digest(Scenario),
    [?assertEqual({S, Here}, {S, on_a_node(S, Scenario)}) || S <- ["1", "2"]].

on_a_node(Schedulers, Scenario) ->
    Paths = lists:append([["-pa", Dir] || Dir <- code:get_path(), filelib:is_dir(Dir)]),
    {ok, Peer, _} = peer:start_link(#{
        connection => standard_io,
        args => ["+S", Schedulers, "-kernel", "logger_level", "none" | Paths]
    }),
    Digest = peer:call(Peer, ?MODULE, digest, [Scenario], 60000),
    ok = peer:stop(Peer),
    Digest.

order_of_keys_in_the_scenario(Config) ->
    Scenario = scenario(Config),
    ?assertEqual(digest(Scenario), digest(maps:from_list(lists:reverse(maps:to_list(Scenario))))).

%% -- not the same ---------------------------------------------------------------------------

seeds_differ(Config) ->
    Scenario = scenario(Config),
    Digests = [digest(Scenario#{seed => Seed}) || Seed <- [1, 2, 3, 4]],
    ?assertEqual(4, length(lists:usort(Digests))).

%% Not the term itself, which no message may hold, but what follows from it.
planted_pid(Config) -> shows(Config, fun() -> pid_to_list(self()) end).

planted_unique_integer(Config) -> shows(Config, fun() -> erlang:unique_integer() end).

planted_reference(Config) -> shows(Config, fun() -> ref_to_list(make_ref()) end).

planted_wall_time(Config) -> shows(Config, fun() -> erlang:monotonic_time() end).

%% What does not belong into a message shows in the digest; what does, does not.
shows(Config, Plant) ->
    Run = fun(What) ->
        digest((scenario(Config))#{
            script => fun(R) ->
                starl:send(R, 3 - starl:id(R), planted, What())
            end
        })
    end,
    ?assertEqual(Run(fun() -> clean end), Run(fun() -> clean end)),
    ?assertNotEqual(Run(Plant), Run(Plant)).

%% A change of any setting that the run depends on shows as well.
every_input_counts(Config) ->
    Scenario = (scenario(Config))#{
        script => fun(R) ->
            [starl:send(R, 3 - starl:id(R), a, {K, starl:now(R)}) || K <- lists:seq(1, 30)],
            starl:go_to(R, {5000.0, 1000.0 * starl:id(R)})
        end
    },
    Other = [
        Scenario,
        Scenario#{loss => 0.2},
        Scenario#{duplicate => 0.5},
        Scenario#{delay => {5, 21}},
        Scenario#{clock_offset => 2},
        Scenario#{clock_drift => 5000},
        Scenario#{speed => 400},
        Scenario#{heading_error => 0.01},
        Scenario#{position_error => 2.0},
        Scenario#{range => 1000},
        Scenario#{faults => [{a, 100, 100, kill_machine, {1, sap}, #{}}]}
    ],
    Digests = [digest(S) || S <- Other],
    ?assertEqual(length(Other), length(lists:usort(Digests))).

%% -- helpers --------------------------------------------------------------------------------

scenario(Config) -> proplists:get_value(scenario, Config).

%% Everything of the outcome that a run is known by. (Called on other nodes, too.)
digest(Scenario) ->
    {ok, Sim} = starl_sim:start(Scenario),
    starl_sim:run(Sim),
    told(starl_sim:finish(Sim)).

told({#{digest := Digest, events := Events, packets := Packets, violations := Violations} = O, R}) ->
    #{end_us := EndUs, robots := Robots} = O,
    ?assertEqual([], Violations),
    Figures = maps:get(figures, R),
    {Digest, Events, Packets, EndUs, [{Id, pose(S)} || {Id, S} <- Robots], Figures}.

pose(#{pose := Pose, result := Result}) -> {Pose, Result}.
