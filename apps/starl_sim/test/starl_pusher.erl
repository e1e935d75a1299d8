%% An application that drives at a wall, and gives the same velocity again whenever it feels the wall.
-module(starl_pusher).
-behaviour(starl_app).
-export([options/0, scene/1, init/2, step/2]).

options() ->
    [{bumps, {integer, 1, 1000000}, 100, "bumps of each robot"}].

%% A room with the robots side by side.
scene(#{options := #{bumps := N}, robots := Ids}) ->
    {ok, #{
        app => {sequential, ?MODULE, N},
        floor => starl_floor:empty({3000, 1000 * length(Ids)}),
        poses => maps:from_list([
            {Robot, {2500.0, 1000.0 * Robot - 500.0, 0.0}}
         || Robot <- Ids
        ])
    }}.

init(Robot, N) ->
    ok = starl:listen(Robot, sense),
    N.

step(_Robot, 0) ->
    {done, through};
step(Robot, N) ->
    _ = starl:velocity(Robot, {300, 0}, 60000),
    case starl:await(Robot, sense, 1000) of
        {ok, _, {bump, _}} -> {continue, N - 1};
        %% a drive that has stalled may refuse one velocity
        timeout -> {continue, N}
    end.
