%% Promises of live clusters when a node loses its store, has an old one, or is killed while robots
%% elect: no contract is broken. STARL_LIVE_STORES=20 tries each 20 times; a failure names its seed.
-module(starl_hands_SUITE).
-include_lib("stdlib/include/assert.hrl").

-export([suite/0, all/0, init_per_suite/1, end_per_suite/1]).
-export([
    killed_while_electing/1,
    mutex_store_lost/1,
    barrier_store_lost/1,
    painting_store_lost/1,
    mutex_store_set_back/1,
    killed_in_one_sided_radio/1,
    mutex_halted/1,
    painting_halted/1
]).
%% called in the conductor
-export([violations/4, halted/4]).

-define(SPEED, 4).
-define(STRUCK_US, 8000000).

suite() -> [{timetrap, {hours, 1}}].

all() ->
    [
        killed_while_electing,
        mutex_store_lost,
        barrier_store_lost,
        painting_store_lost,
        mutex_store_set_back,
        killed_in_one_sided_radio
    ] ++ halts().

%% Between the last look at the clock and the wire a halt can still strike, about once in hundreds: so these
%% run when they are asked for, as ./starl halts does.
halts() ->
    case os:getenv("STARL_LIVE_HALTS") of
        false -> [];
        _ -> [mutex_halted, painting_halted]
    end.

init_per_suite(Config) -> [{conductor, starl_conductor_ct:start()} | Config].

end_per_suite(Config) -> starl_conductor_ct:stop(proplists:get_value(conductor, Config)).

%% A robot whose node is killed in the middle of its elections casts no second ballot in any.
killed_while_electing(Config) -> hold(reboot, exercise(election, #{work => 20}), Config).

mutex_store_lost(Config) -> hold(store_lost, exercise(mutex, #{work => 40}), Config).

barrier_store_lost(Config) -> hold(store_lost, exercise(barrier, #{work => 40}), Config).

painting_store_lost(Config) ->
    hold(store_lost, #{app => starl_painting, picture => "lines", robots => 4}, Config).

mutex_store_set_back(Config) -> hold(store_set_back, exercise(mutex, #{work => 40}), Config).

exercise(Block, More) -> More#{app => starl_exercise, block => Block, robots => 4}.

%% Three computers. Robot 3 does not hear robot 2, whose node is killed when robot 1 has elected; then
%% it hears it. All elect the same.
killed_in_one_sided_radio(Config) ->
    case starl_hands_computers:allowed() of
        yes ->
            Dir = proplists:get_value(priv_dir, Config),
            Apart = [
                {Seed, Wrong}
             || Seed <- seeds(),
                Wrong <- [starl_hands_computers:election(Seed, dir(one_sided, Seed, Dir))],
                Wrong =/= []
            ],
            ?assertEqual([], Apart);
        {no, Why} ->
            {skip, Why}
    end.

%% Nodes that are halted in the middle of a step, longer than a lease. ./starl halts does it for longer.
mutex_halted(Config) ->
    stand([1, 2, 3, 4, 1, 2, 3, 4], 1.5, exercise(mutex, #{work => 100}), Config).

%% Whoever leads, until another robot leads.
painting_halted(Config) ->
    Scenario = #{app => starl_painting, picture => "text", robots => 5},
    stand([leader, leader, leader], 4, Scenario, Config).

%% -- runs -----------------------------------------------------------------------------------

hold(Kind, Scenario, Config) ->
    Broken = [{Seed, V} || Seed <- seeds(), V <- run(Kind, Scenario#{seed => Seed}, Config)],
    ct:pal("~p, seeds ~w: ~b violations", [Kind, seeds(), length(Broken)]),
    ?assertEqual([], Broken).

stand(Robots, Seconds, Scenario, Config) ->
    Broken = [
        {Seed, V}
     || Seed <- seeds(),
        Name <- [lists:concat(["halted-", length(Robots)])],
        Dir <- [dir(Name, Seed, proplists:get_value(priv_dir, Config))],
        V <- starl_conductor_ct:call(
            proplists:get_value(conductor, Config),
            ?MODULE,
            halted,
            [Robots, Seconds, Scenario#{seed => Seed}, Dir]
        )
    ],
    ?assertEqual([], Broken).

seeds() -> lists:seq(1, list_to_integer(os:getenv("STARL_LIVE_STORES", "1"))).

run(Kind, #{seed := Seed} = Scenario, Config) ->
    Name = maps:get(block, Scenario, painting),
    Dir = dir(lists:concat([Kind, "-", Name]), Seed, proplists:get_value(priv_dir, Config)),
    Victim = 1 + (Seed rem 4),
    Args = [Kind, Victim, Scenario, Dir],
    starl_conductor_ct:call(proplists:get_value(conductor, Config), ?MODULE, violations, Args).

dir(Name, Seed, Dir) -> filename:join(Dir, lists:concat([Name, "-", Seed])).

%% Something is done to a robot in the middle of the run.
violations(Kind, Victim, Scenario, Dir) ->
    {ok, Cluster} = starl_world_run:start(
        Scenario, #{dir => Dir, transport => udp, speed => ?SPEED}
    ),
    ok = starl_world_run:until(Cluster, ?STRUCK_US),
    ok = starl_world_run:inject(Cluster, [{Kind, Victim, #{}, 0}]),
    _ = starl_world_run:await(Cluster),
    violated(Cluster).

%% One robot after the other stands still, if the run goes on.
halted(Robots, Seconds, Scenario, Dir) ->
    {ok, Cluster} = starl_world_run:start(
        Scenario, #{dir => Dir, transport => udp, speed => ?SPEED}
    ),
    ok = starl_world_run:until(Cluster, ?STRUCK_US),
    ok = lists:foreach(fun(Robot) -> ok = stands(Robot, Seconds, Cluster) end, Robots),
    _ = starl_world_run:await(Cluster),
    violated(Cluster).

stands(Robot, Seconds, Cluster) ->
    case starl_world_run:status(Cluster) of
        #{ending := none} = Status ->
            {ok, _} = starl_world_run:halt_at_work(Cluster, robot(Robot, Status), Seconds),
            ok;
        #{} ->
            ok
    end.

robot(leader, #{leader := none}) -> 1;
robot(leader, #{leader := Leader}) -> Leader;
robot(Robot, _Status) -> Robot.

%% That a holder notices the end of its lease within lag_ms, and that the messages which renew a hold come
%% within a lease, is assumed of the computer: one that is busy with other tests breaks it, and nobody can
%% tell the monitor when. Then a hold is too long, or lost.
violated(Cluster) ->
    {#{violations := Violations}, _} = starl_world_run:finish(Cluster),
    [
        lists:flatten(starl_violation:format(V))
     || V <- Violations, not is_of_the_computer(V)
    ].

is_of_the_computer(#{what := held_too_long}) -> true;
is_of_the_computer(#{contract := calls, details := #{outcome := {error, lost}}}) -> true;
is_of_the_computer(_) -> false.
