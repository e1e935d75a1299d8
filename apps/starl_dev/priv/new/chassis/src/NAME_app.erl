%% Each robot drives a square of 300 mm, and is where it began.
-module(@NAME@_app).
-behaviour(starl_app).

-export([init/2, step/2]).

init(Robot, _Options) -> corners(starl:position(Robot)).

corners({ok, {X, Y, _Heading}}) ->
    [{X + 300, Y}, {X + 300, Y + 300}, {X, Y + 300}, {X, Y}];
corners({error, _}) ->
    %% No position yet: any square will do.
    corners({ok, {3000, 3000, 0}}).

step(Robot, [Corner | Corners]) ->
    case starl:go_to(Robot, Corner) of
        ok ->
            {continue, Corners};
        {error, _} ->
            %% A wheel is stuck, or nobody knows where the robot is: it tries again.
            starl:sleep(Robot, 500),
            {continue, [Corner | Corners]}
    end;
step(Robot, []) ->
    {ok, {X, Y, _Heading}} = starl:position(Robot),
    {done, {round(X), round(Y)}}.
