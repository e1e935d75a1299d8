%% Schedules of up to three reloads ({@link starl_reload_schedule}) in the simulator: no application
%% is lost, no state but by a version that says so, and all is told. STARL_RELOAD_SCHEDULES=500
%% makes it 500 schedules; STARL_SEED=N begins with that seed.
-module(starl_reload_schedule_SUITE).
-include_lib("stdlib/include/assert.hrl").

-export([suite/0, all/0, init_per_suite/1, end_per_suite/1, schedules/1]).

-define(SCHEDULES, 500).

suite() -> [{timetrap, {minutes, 9}}].

all() -> [schedules].

init_per_suite(Config) -> starl_platform_ct:without_log(Config).

end_per_suite(Config) -> starl_platform_ct:with_log(Config).

schedules(_) ->
    First = number("STARL_SEED", 1),
    Seeds = lists:seq(First, First + number("STARL_RELOAD_SCHEDULES", ?SCHEDULES) - 1),
    Broken = [Lines || Seed <- Seeds, Lines <- [broken(Seed)], Lines =/= []],
    _ = [ct:pal("~ts", [lists:join("\n", Lines)]) || Lines <- Broken],
    ?assertEqual([], Broken).

number(Variable, Default) -> list_to_integer(os:getenv(Variable, integer_to_list(Default))).

broken(Seed) ->
    Schedule = starl_reload_schedule:drawn(Seed),
    case starl_reload_schedule:broken(Schedule, run(starl_reload_schedule:scenario(Schedule))) of
        [] ->
            [];
        Lines ->
            [unicode:characters_to_list(L) || L <- [starl_reload_schedule:shown(Schedule) | Lines]]
    end.

run(Scenario) ->
    {ok, Sim} = starl_sim:start(Scenario, #{watch => [{starl_sim_order_monitor, #{}}]}),
    _ = starl_sim:run(Sim),
    {Outcome, _Report} = starl_sim:finish(Sim),
    Outcome.
