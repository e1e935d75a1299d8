%% When violations of planted bugs became inevitable: what is named is what the bug makes wrong, or
%% the fault that it does not bear. The scenarios are what ./starl shrink has left of the runs in
%% which ./starl planted finds the bugs.
-module(starl_when_SUITE).
-include_lib("stdlib/include/assert.hrl").

-export([suite/0, all/0, init_per_suite/1, end_per_suite/1]).
-export([barrier_forgetful/1, sap_restarts/1]).

suite() -> [{timetrap, {minutes, 2}}].

all() -> [barrier_forgetful, sap_restarts].

init_per_suite(Config) -> starl_platform_ct:without_log(Config).

end_per_suite(Config) -> starl_platform_ct:with_log(Config).

%% A restarted machine begins with round 1: the reboot.
barrier_forgetful(_) ->
    Reboot = {reboot_2, 2819, 5912, reboot, 2, #{}},
    ?assertMatch(
        {{2819000, fault, Reboot}, [#{machine := _, type := boot} | _]},
        named(barrier_forgetful, 11, #{robots => 3, faults => [Reboot], time => 6.002})
    ).

%% Sequence numbers restart with the robot: its store is set back.
sap_restarts(_) ->
    Back = {store_set_back_3, 10007, 16283, store_set_back, 3, #{}},
    ?assertMatch(
        {{10007000, fault, Back}, [#{machine := _, type := boot} | _]},
        named(sap_restarts, 2, #{robots => 3, faults => [Back], time => 10.1})
    ).

%% The entry at the step, and the next events of the robots of a fault.
named(Bug, Seed, Left) ->
    Scenario = maps:merge(starl_planted:scenario(Bug, Seed), maps:merge(plain(), Left)),
    {ok, #{violation := #{at_us := At}, timeline := Timeline} = Run} =
        starl_sim_continuation:repeat(Scenario),
    {ok, Settings} = starl_sim_continuation:settings(Run, violation),
    Last = starl_sim_timeline:at(At, Timeline),
    #{step := {_, Above}, complete := true} = starl_lab_continuations:search(Run, Settings, #{
        grid => starl_sim_inevitable:grid(6, Last, Timeline),
        draws => 8,
        branch_seed => 1,
        jobs => 2,
        interrupt => make_ref(),
        progress => starl_cli_progress:new(quiet)
    }),
    {_, _, What} = Entry = starl_sim_timeline:entry(Above, Timeline),
    Robots = [R || is_tuple(What), R <- starl_run_fault:targets(What)],
    {Entry, [E || {_, _, E} <- starl_sim_timeline:following(Above, Robots, 3, Timeline)]}.

%% What the shrinker sets.
plain() ->
    #{
        random_faults => [],
        converge => none,
        delay => {20, 20},
        clock_offset => 0,
        clock_drift => 0,
        heading_error => 0.0,
        distance_error => 0.0,
        position_error => 0.0
    }.
