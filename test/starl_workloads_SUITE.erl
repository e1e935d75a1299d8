%% The workloads of the benchmarks come to what is known of them, and to the same in every way of
%% simulating them: so what a benchmark measures is the work that it says.
-module(starl_workloads_SUITE).
-include_lib("stdlib/include/assert.hrl").

-export([all/0, init_per_suite/1, end_per_suite/1]).
-export([swarm_receptions/1, swarm_in_every_way/1, events_without_loss/1, events_with_loss/1]).

-define(MODES, [{process, 1}, {process, 3}, {inline, 1}, {inline, 2}]).

all() -> [swarm_receptions, swarm_in_every_way, events_without_loss, events_with_loss].

init_per_suite(Config) -> starl_platform_ct:without_log(Config).

end_per_suite(Config) -> starl_platform_ct:with_log(Config).

%% Between 5 and 7 receptions per robot and tick, all of robots within the range.
swarm_receptions(_Config) ->
    {#{ending := done, violations := []}, Figures} = run((swarm(300))#{mode => inline}),
    PerTick = proplists:get_value(per_tick, Figures),
    ?assert(PerTick >= 5),
    ?assert(PerTick =< 7).

%% Positions, receptions and digest are those of the scenario, not of how it is simulated.
swarm_in_every_way(_Config) ->
    Ways = [swarm_result(#{mode => Mode, shards => Shards}) || {Mode, Shards} <- ?MODES],
    ?assertMatch([_], lists:usort(Ways)),
    ?assertNotEqual(hd(Ways), swarm_result(#{mode => inline, shards => 1, seed => 2})).

swarm_result(How) ->
    {#{digest := Digest, robots := Robots}, _} = run(maps:merge(swarm(60), How)),
    {Digest, [{Id, Pose, Result} || {Id, #{pose := Pose, result := Result}} <- Robots]}.

swarm(Robots) ->
    #{
        app => starl_swarm_broadcast,
        robots => Robots,
        seed => 1,
        range => 1000,
        delay => {10, 50},
        clock_drift => 0,
        messages => 30,
        time => 10
    }.

%% Every message arrives; an event is a timer or a delivery.
events_without_loss(_Config) ->
    {#{ending := done, packets := Packets}, Figures} = run(events(#{loss => 0})),
    ?assertEqual(40 * 50, Packets),
    ?assertEqual([{received, 40 * 50}, {events, 40 * 51 + 40 * 50}], Figures).

%% Of 10,000 packets 5 % are lost, within five standard deviations.
events_with_loss(_Config) ->
    {#{packets := Sent}, Figures} = run(events(#{loss => 0.05, messages => 250, time => 30})),
    Lost = Sent - proplists:get_value(received, Figures),
    ?assertEqual(40 * 250, Sent),
    ?assert(abs(Lost - 0.05 * Sent) =< 5 * math:sqrt(Sent * 0.05 * 0.95)).

events(Given) ->
    maps:merge(
        #{
            app => starl_plain_events,
            robots => 40,
            mode => inline,
            delay => {10, 50},
            clock_drift => 0,
            messages => 50,
            time => 6
        },
        Given
    ).

run(Scenario) ->
    {ok, Sim} = starl_sim:start(Scenario),
    _ = starl_sim:run(Sim),
    {Outcome, #{figures := Figures}} = starl_sim:finish(Sim),
    {Outcome, Figures}.
