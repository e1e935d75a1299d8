%% @doc The chassis of a live robot in the simulated world: passes commands on to the world.
-module(starl_world_chassis).
-behaviour(starl_live_chassis).

-export([open/1, drive/4, actuate/4, stop/1, hear/2, close/1]).

-export_type([lines/0]).

%% The chassis of each robot.
-type lines() :: fun((starl:robot_id(), World :: pid()) -> starl_live_link:adapter()).

-record(line, {world :: pid(), robot :: starl:robot_id(), monitor :: reference()}).

-spec open(#{world := pid(), robot := starl:robot_id(), atom() => term()}) ->
    {ok, #line{}} | {error, unicode:chardata()}.
open(#{world := World, robot := Robot}) ->
    Monitor = erlang:monitor(process, World),
    case starl_world:embody(World, Robot) of
        ok -> {ok, #line{world = World, robot = Robot, monitor = Monitor}};
        {error, Why} -> {error, Why}
    end.

-spec drive(starl_chassis:script(), integer(), term(), #line{}) -> {[], #line{}}.
drive(Script, Until, Mark, Line) -> tell({drive, Script, Until, Mark}, Line).

-spec actuate(atom(), term(), {mark, term()} | none, #line{}) -> {[], #line{}}.
actuate(Device, Value, Mark, Line) -> tell({actuate, {Device, Value}, Mark}, Line).

-spec stop(#line{}) -> #line{}.
stop(Line) ->
    {[], Line} = tell(stop, Line),
    Line.

tell(What, #line{world = World, robot = Robot} = Line) ->
    World ! {starl_body, Robot, self(), What},
    {[], Line}.

-spec hear(term(), #line{}) ->
    {[{term(), starl_live_chassis:answer()}], #line{}} | {stop, unicode:chardata()} | unknown.
hear({starl_body_says, Answers}, Line) -> {Answers, Line};
hear({'DOWN', Monitor, _, _, _}, #line{monitor = Monitor}) -> {stop, "the world has ended"};
hear(_Message, _Line) -> unknown.

-spec close(#line{}) -> ok.
close(_Line) -> ok.
