%% An application that drives about blindly: against walls, and against others.
-module(starl_bumper).
-behaviour(starl_app).
-export([options/0, scene/1, init/2, step/2]).

options() ->
    [{drives, {integer, 1, 1000000}, 10, "drives of each robot"}].

%% A room with a pillar, a thin wall and a corner, unless the scenario names a floor.
scene(#{options := Options, seed := Seed}) ->
    Floor = starl_floor:new(#{
        size => {3000, 2600},
        walls => [
            starl_floor:box(1300, 1000, 1700, 1300),
            [{0, 1800}, {900, 1800}],
            [{2100, 0}, {2700, 0}, {2100, 700}]
        ]
    }),
    {ok, #{app => {sequential, ?MODULE, Options#{seed => Seed}}, floor => Floor}}.

init(Robot, #{drives := N}) ->
    ok = starl:listen(Robot, sense),
    {N, 0}.

step(_Robot, {0, Bumps}) ->
    {done, Bumps};
step(Robot, {N, Bumps}) ->
    Angle = 6.283185307179586 * starl:random(Robot),
    Speed = 500 * starl:random(Robot),
    Ms = 50 + round(1500 * starl:random(Robot)),
    Velocity = {Speed * math:cos(Angle), Speed * math:sin(Angle)},
    _ = starl:velocity(Robot, Velocity, Ms),
    case starl:await(Robot, sense, round(1.2 * Ms * starl:random(Robot))) of
        {ok, _, {bump, _}} -> {continue, {N - 1, Bumps + 1}};
        timeout -> {continue, {N - 1, Bumps}}
    end.
