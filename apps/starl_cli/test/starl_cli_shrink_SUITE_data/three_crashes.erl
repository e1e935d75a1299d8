%% An application with a planted violation: robots 2, 5 and 8 talk to robot 1, and when the
%% sequence numbers of all three have begun anew, the contract `planted' is broken. So it takes
%% three particular crashes of machine sap.
-module(three_crashes).
-behaviour(starl_app).

-export([scene/1, init/1, init/2, step/2, finish/2, interests/0]).

scene(_Context) ->
    {ok, #{app => {sequential, ?MODULE, 1}, monitors => [{?MODULE, #{}}]}}.

init(_Robot, Turn) -> Turn.

%% Of the monitor: who is still to crash.
init(#{}) -> [2, 5, 8].

interests() -> [sap].

finish(_EndUs, _Left) -> {ok, #{}}.

%% Of the monitor, then of the application.
step({_, _, sap, _}, []) ->
    {ok, []};
step({Time, Robot, sap, {started, Incarnation}}, Left) when Incarnation > 1 ->
    case lists:delete(Robot, Left) of
        [] ->
            {violation, #{
                contract => planted, what => all_three_crashed, at_us => Time,
                robots => [2, 5, 8], details => #{}
            }, []};
        Fewer ->
            {ok, Fewer}
    end;
step({_, _, sap, _}, Left) ->
    {ok, Left};
step(_Robot, 600) ->
    {done, 600};
step(Robot, Turn) ->
    _ = [starl:post(Robot, 1, word, Turn) || lists:member(starl:id(Robot), [2, 5, 8])],
    ok = starl:sleep(Robot, 100),
    {continue, Turn + 1}.
