%% An application with a planted violation: the contract `planted' is broken when a message from
%% robot 3 to robot 1 is reported lost, which takes the loss of three particular packets.
-module(three_losses).
-behaviour(starl_app).

-export([scene/1, init/1, init/2, step/2, finish/2, interests/0]).

scene(_Context) ->
    {ok, #{
        app => {sequential, ?MODULE, 1},
        sap => #{limit => 2},
        monitors => [{?MODULE, #{}}]
    }}.

init(_Robot, Turn) -> Turn.

%% Of the monitor.
init(#{}) -> none.

interests() -> [sap].

finish(_EndUs, none) -> {ok, #{}}.

step({Time, 3, sap, {outcome, _Id, 1, lost}}, none) ->
    {violation, #{
        contract => planted, what => reported_lost, at_us => Time, robots => [1, 3],
        details => #{}
    }, none};
step({_, _, sap, _}, none) ->
    {ok, none};
step(_Robot, 300) ->
    {done, 300};
step(Robot, Turn) ->
    _ = [starl:post(Robot, 1, word, Turn) || starl:id(Robot) =/= 1],
    ok = starl:sleep(Robot, 100),
    {continue, Turn + 1}.
