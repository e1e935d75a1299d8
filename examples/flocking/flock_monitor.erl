%% The contract of the flock: no robot sees another one nearer than `least_mm'.
-module(flock_monitor).
-behaviour(starl_monitor).
-export([init/1, interests/0, step/2, finish/2]).

init(#{least_mm := Least}) -> #{least => Least, nearest => null}.

%% The machines whose events it wants.
interests() -> [app].

%% An event: when (microseconds), which robot, which machine, what.
step({AtUs, Robot, app, {nearest, Mm}}, #{least := Least, nearest := Nearest} = State) ->
    %% an atom such as null is greater than every number
    Next = State#{nearest := min(Mm, Nearest)},
    case Mm < Least of
        true -> {violation, violation(AtUs, Robot, Mm), Next};
        false -> {ok, Next}
    end;
step(_Other, State) ->
    {ok, State}.

violation(AtUs, Robot, Mm) ->
    #{
        contract => flock,
        what => too_close,
        at_us => AtUs,
        robots => [Robot],
        details => #{mm => round(Mm)}
    }.

%% Whether the end breaks the contract, and the figures that were measured.
finish(_EndUs, #{nearest := Nearest}) -> {ok, #{nearest_mm => Nearest}}.
