%% Robots wander about a floor plan: each drives until it bumps into something, then elsewhere, and
%% tells in which rooms it has been.
%%     ./starl run examples/wander.erl --floor search --robots 5 --time 300
-module(wander).
-behaviour(starl_app).
-export([options/0, init/2, step/2]).

options() -> [{drives, {integer, 1, 10000}, 60, "drives of each robot"}].

init(Robot, #{drives := N}) ->
    ok = starl:listen(Robot, sense),
    {ok, Floor} = starl:floor(Robot),
    {N, Floor, []}.

step(_Robot, {0, _Floor, Rooms}) ->
    {done, Rooms};
step(Robot, {N, Floor, Rooms}) ->
    Heading = 2 * math:pi() * starl:random(Robot),
    _ = starl:velocity(Robot, {400 * math:cos(Heading), 400 * math:sin(Heading)}, 5000),
    _ = starl:await(Robot, sense, 5000),
    ok = starl:sleep(Robot, 1100),
    {continue, {N - 1, Floor, lists:umerge(Rooms, room(Robot, Floor))}}.

room(Robot, Floor) ->
    case starl:position(Robot) of
        {ok, {X, Y, _}} -> [Room || {ok, Room} <- [starl_floor:room_at({X, Y}, Floor)]];
        {error, _} -> []
    end.
