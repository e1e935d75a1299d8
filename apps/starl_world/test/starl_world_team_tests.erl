%% When the facts of a robot that was halted hold.
-module(starl_world_team_tests).
-include_lib("eunit/include/eunit.hrl").

-define(T, starl_world_team).

%% What it had written before the halt holds when it was; it is told once.
written_before_test() ->
    {[], One} = traced(1, [], team()),
    {Written, Two} = ?T:halted(1, [{1, []}, {2, [fact(5)]}, {3, [fact(6)]}], 10, One),
    ?assertEqual([fact(5), fact(6)], Written),
    {[], Three} = traced(2, [fact(5)], Two),
    {[], Four} = traced(3, [fact(6)], Three),
    ?assertMatch({[{30, 1, a, x}], _}, traced(4, [fact(30)], Four)).

%% What leaves it after the halt holds from then on, which is known by its next fact.
cut_test() ->
    {[], One} = ?T:halted(1, [], 10, team()),
    {[], Two} = traced(1, [fact(8)], One),
    {[], Three} = traced(2, [fact(9)], Two),
    {Told, Four} = traced(3, [fact(10), fact(31), fact(32)], Three),
    ?assertEqual([fact(31), fact(31), fact(31), fact(31), fact(32)], Told),
    ?assertMatch({[{9, 1, a, x}], _}, traced(4, [fact(9)], Four)).

%% A robot that ends then holds it until the end.
killed_test() ->
    {[], One} = ?T:halted(1, [], 10, team()),
    {[], Two} = traced(1, [fact(8)], One),
    {Told, _, Three} = ?T:down(1, [fact(9)], 40, Two),
    ?assertEqual([fact(40), fact(40)], [F || {_, 1, a, x} = F <- Told]),
    ?assertEqual([], ?T:up(Three)).

%% A former link tells nothing.
former_test() ->
    ?assertMatch({[], _}, ?T:traced(1, spawn(fun() -> ok end), 1, [fact(1)], team())).

%% The world, too, begins no script after its latest moment: the body does not move. To stop is never too
%% late.
late_script_test() ->
    {ok, Team} = ?T:embodied(1, self(), false, team()),
    Drive = fun(Commands, Now, Robots) ->
        Script = {starl_chassis_differential, Commands},
        {Now, {Traces, _, Next}} = ?T:heard(
            1, self(), {now, {drive, Script, 1000, mark}}, Now, Robots
        ),
        {[At || {At, 1, chassis, {motion, _}} <- Traces], Next}
    end,
    Go = [{100.0, 100.0, 5000}],
    ?assertMatch({[], _}, Drive(Go, 1001, Team)),
    {[1000], Driving} = Drive(Go, 1000, Team),
    ?assertMatch({[1001], _}, Drive([], 1001, Driving)).

fact(At) -> {At, 1, a, x}.

traced(Batch, Events, Team) -> ?T:traced(1, self(), Batch, Events, Team).

team() ->
    {ok, {_, _, #{world := World}}} = starl_sim:plan(
        #{app => starl_world_app, robots => 1, play => #{}}, #{}
    ),
    {_, Team} = ?T:new([{1, {0.0, 0.0, 0.0}}], World),
    ?T:started(1, self(), {[a], none}, Team).
