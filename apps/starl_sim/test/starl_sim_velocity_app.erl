%% An application for tests of velocities: `how' is what its robots do.
-module(starl_sim_velocity_app).
-behaviour(starl_app).

-export([options/0, init/2, step/2]).

options() -> [{how, {one_of, [wander, crash, hang, near]}, wander, "what the robots do"}].

init(_Robot, #{how := How}) -> {How, 0}.

step(Robot, {crash, 0}) ->
    ok = starl:velocity(Robot, {300.0, 0.0}, 700),
    starl:sleep(Robot, 100),
    error(on_purpose);
step(Robot, {hang, 0}) ->
    ok = starl:velocity(Robot, {300.0, 0.0}, 700),
    starl:await(Robot, what_never_comes);
step(Robot, {near, 0}) ->
    {ok, All} = starl:neighbours(Robot, 1.0e6),
    {ok, Near} = starl:neighbours(Robot, 2100),
    {done, {All, Near}};
step(_Robot, {wander, 40}) ->
    {done, wandered};
step(Robot, {wander, N}) ->
    A = 6.28 * starl:random(Robot),
    V = 900.0 * starl:random(Robot),
    _ = starl:velocity(
        Robot, {V * math:cos(A), V * math:sin(A)}, 1 + round(600 * starl:random(Robot))
    ),
    starl:sleep(Robot, round(800 * starl:random(Robot))),
    _ = [starl:go_to(Robot, {2000.0, 2000.0}) || N =:= 20],
    _ = [starl:stop(Robot) || N rem 7 =:= 3],
    {continue, {wander, N + 1}}.
