%% The contract of the application: a robot says that it is round only after its last corner.
-module(@NAME@_monitor).
-behaviour(starl_monitor).

-export([init/1, interests/0, step/2, finish/2]).

init(_Config) -> #{}.

%% The events that applications trace.
interests() -> [app].

step({_AtUs, Robot, app, {corners_left, Left}}, Corners) ->
    {ok, Corners#{Robot => Left}};
step({AtUs, Robot, app, told}, Corners) ->
    case maps:get(Robot, Corners, none) of
        0 -> {ok, Corners};
        Left -> {violation, too_early(AtUs, Robot, Left), Corners}
    end;
step(_Event, Corners) ->
    {ok, Corners}.

too_early(AtUs, Robot, Left) ->
    #{
        contract => @NAME@,
        what => too_early,
        at_us => AtUs,
        robots => [Robot],
        details => #{corners_left => Left}
    }.

finish(_EndUs, Corners) -> {ok, #{round => length([R || {R, 0} <- maps:to_list(Corners)])}}.
