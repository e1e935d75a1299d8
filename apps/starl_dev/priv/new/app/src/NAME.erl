%% Each robot drives a square, and tells the next robot of the team when it is round. It is done when
%% it is round and has heard of the robot before it.
-module(@NAME@).
-behaviour(starl_app).

-export([options/0, monitors/1, init/2, step/2]).

%% The flag --side of the command line, the key `side' of a scenario.
options() -> [{side, {integer, 100, 1500}, 500, "the side of the square, mm"}].

monitors(_Context) -> [{@NAME@_monitor, #{}}].

init(Robot, #{side := Side}) ->
    starl:listen(Robot, round),
    {drive, corners(starl:position(Robot), Side)}.

corners({ok, {X, Y, _Heading}}, Side) ->
    [{X + Side, Y}, {X + Side, Y + Side}, {X, Y + Side}, {X, Y}];
corners({error, _}, Side) ->
    %% No position yet: any square will do.
    corners({ok, {Side, Side, 0}}, Side).

step(Robot, {drive, [Corner | Corners]}) ->
    case starl:go_to(Robot, Corner) of
        ok ->
            starl:trace(Robot, {corners_left, length(Corners)}),
            {continue, {drive, Corners}};
        {error, _} ->
            %% A wheel is stuck, or nobody knows where the robot is: it tries again.
            starl:sleep(Robot, 500),
            {continue, {drive, [Corner | Corners]}}
    end;
step(Robot, {drive, []}) ->
    starl:trace(Robot, told),
    case starl:send(Robot, next(Robot), round, #{}) of
        ok -> {continue, hear};
        {error, _} -> {continue, {drive, []}}
    end;
step(Robot, hear) ->
    case starl:await(Robot, round, 60000) of
        {ok, From, #{}} -> {done, {heard, From}};
        timeout -> {done, heard_nothing}
    end.

next(Robot) ->
    Team = starl:participants(Robot),
    case [Id || Id <- Team, Id > starl:id(Robot)] of
        [Next | _] -> Next;
        [] -> hd(Team)
    end.
