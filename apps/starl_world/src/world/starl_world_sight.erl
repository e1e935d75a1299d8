%% @doc The positioning system of the simulated world, as a source for a live robot.
-module(starl_world_sight).
-behaviour(starl_live_positioning).

-export([open/1, ask/2, hear/2, figures/1, close/1]).

-record(sight, {world :: pid(), robot :: starl:robot_id(), pictures = 0 :: non_neg_integer()}).

-spec open(#{world := pid(), robot := starl:robot_id(), atom() => term()}) -> {ok, #sight{}}.
open(#{world := World, robot := Robot}) ->
    World ! {starl_watches, Robot, self()},
    {ok, #sight{world = World, robot = Robot}}.

-spec ask([starl:robot_id()], #sight{}) -> #sight{}.
ask(Robots, #sight{world = World, robot = Robot} = Sight) ->
    World ! {starl_look, Robot, self(), lists:usort([Robot | Robots])},
    Sight.

-spec hear(term(), #sight{}) -> {[starl_live_positioning:sighting()], #sight{}} | unknown.
hear({starl_seen, Seen}, #sight{pictures = N} = Sight) -> {Seen, Sight#sight{pictures = N + 1}};
hear(_Message, _Sight) -> unknown.

-spec figures(#sight{}) -> starl_live_positioning:figures().
figures(#sight{pictures = N}) -> #{pictures => N}.

-spec close(#sight{}) -> ok.
close(_Sight) -> ok.
