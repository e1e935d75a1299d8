%% An application for tests of controllers: two robots two metres apart. `cruise': each drives with velocities to
%% where the other began. `cross': the first drives far beyond the second, which leaves its place after three seconds;
%% `stay': which does not.
-module(starl_sim_meeting_app).
-behaviour(starl_app).

-export([options/0, init/2, step/2]).

options() -> [{how, {one_of, [cruise, cross, stay]}, cruise, "what the robots do"}].

init(Robot, #{how := How}) -> {How, starl:id(Robot), 0}.

step(_Robot, {cruise, _Id, 60}) ->
    {done, met};
step(Robot, {cruise, Id, N}) ->
    {ok, {X, Y, _}} = starl:position(Robot),
    {GX, GY} = other(Id),
    Far = max(1.0, starl_geometry:distance({X, Y}, {GX, GY})),
    Speed = min(300.0, Far),
    _ = starl:velocity(Robot, {Speed * (GX - X) / Far, Speed * (GY - Y) / Far}, 500),
    starl:sleep(Robot, 200),
    {continue, {cruise, Id, N + 1}};
step(Robot, {_, 1, _}) ->
    Began = starl:now(Robot),
    ok = starl:go_to(Robot, {6000.0, 1000.0}),
    {done, starl:now(Robot) - Began};
step(Robot, {cross, 2, _}) ->
    starl:sleep(Robot, 3000),
    {done, starl:go_to(Robot, {3000.0, 3000.0})};
step(_Robot, {stay, 2, _}) ->
    {done, stood}.

other(1) -> {3000.0, 1000.0};
other(2) -> {1000.0, 1000.0}.
