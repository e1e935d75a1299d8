%% The contract of DPP (README) in simulated runs in which its machines crash: reservations
%% are pairwise disjoint whatever is lost, doubled or late, and the picture is completed. The
%% monitors judge. When a coordinator's robot is gone for good: starl_dpp_failover_SUITE.
-module(starl_dpp_crash_SUITE).
-include_lib("stdlib/include/assert.hrl").
-include_lib("proper/include/proper.hrl").

-export([suite/0, all/0, init_per_suite/1, end_per_suite/1]).
-export([
    coordinator_crashes_while_robots_move/1,
    participant_crashes_while_robots_move/1,
    crashes_at_random/1
]).

suite() -> [{timetrap, {minutes, 2}}].

all() ->
    [
        coordinator_crashes_while_robots_move,
        participant_crashes_while_robots_move,
        crashes_at_random
    ].

init_per_suite(Config) -> starl_platform_ct:without_log(Config).

end_per_suite(Config) -> starl_platform_ct:with_log(Config).

%% The coordinator of every robot is killed every six seconds of a run with loss.
coordinator_crashes_while_robots_move(_) ->
    [
        paints(Seed, 0.3, [
            {T + Seed * 500, R, dpp_coordinator}
         || T <- lists:seq(2000, 90000, 6000), R <- [1, 2, 3, 4]
        ])
     || Seed <- [1, 2, 3]
    ].

%% Likewise the participants, while their applications drive on.
participant_crashes_while_robots_move(_) ->
    [
        paints(Seed, 0.3, [
            {T + 700 * R, R, dpp}
         || T <- lists:seq(2000, 90000, 7000), R <- [1, 2, 3, 4]
        ])
     || Seed <- [1, 2, 3]
    ].

crashes_at_random(_) ->
    Prop = ?FORALL(
        {Seed, Loss, Kills},
        {
            oneof(lists:seq(1, 1000)),
            oneof([0.0, 0.2, 0.4]),
            resize(
                30,
                list({
                    oneof(lists:seq(0, 90000, 17)),
                    oneof([1, 2, 3, 4]),
                    oneof([dpp, dpp_coordinator])
                })
            )
        },
        starl_platform_ct:safely(fun() -> paints(Seed, Loss, Kills) end)
    ),
    starl_platform_ct:property(Prop, 20).

paints(Seed, Loss, Kills) ->
    Faults = [
        {starl_platform_ct:fault_id(fault, K), T, T, kill_machine, {R, M}, #{}}
     || {K, {T, R, M}} <- lists:zip(lists:seq(1, length(Kills)), Kills)
    ],
    {ok, Sim} = starl_sim:start(#{
        app => starl_painting,
        robots => 4,
        picture => "house",
        seed => Seed,
        loss => Loss,
        duplicate => 0.2,
        delay => {5, 80},
        faults => Faults,
        time => 5000
    }),
    #{ending := Ending} = starl_sim:run(Sim),
    {#{violations := Violations, robots := Robots}, #{figures := Figures}} = starl_sim:finish(Sim),
    ?assertEqual(
        {[], done, 1.0, [{done, complete}]},
        {Violations, Ending, proplists:get_value(ink_covered, Figures),
            lists:usort([S || {_, #{result := S}} <- Robots])},
        {Seed, Loss, Kills}
    ),
    true.
