%% Holds of robots that have stood still, in the checker.
-module(starl_mutex_model_monitor_tests).
-include_lib("eunit/include/eunit.hrl").

-define(FIRST, 17592187092992).
-define(SECOND, 17592188141568).

%% Two holders are two holders, unless the first has stood still meanwhile.
two_holders_test() ->
    ?assertEqual(two_holders, judged(first() ++ second())),
    ?assertEqual(ok, judged(first() ++ [stands()] ++ second())),
    ?assertEqual(ok, judged(first() ++ [stands(), goes_on()] ++ second())),
    ?assertEqual(two_holders, judged([stands(), goes_on()] ++ first() ++ second())).

%% It may say that its hold is over, once, and nothing else of it.
told_later_test() ->
    Before = first() ++ [stands()] ++ second() ++ [goes_on()],
    Lost = {0, 1, mutex, {lease_lost, door, ?FIRST}},
    ?assertEqual(ok, judged(Before ++ [Lost])),
    ?assertEqual(not_held, judged(Before ++ [Lost, Lost])),
    ?assertEqual(not_held, judged(Before ++ [{0, 1, mutex, {answered, [{door, ?FIRST}]}}])).

%% A hold that begins when another one has begun is late, whoever has stood still.
overtaken_test() ->
    Granted = {0, 2, mutex, {granted, door, ?FIRST, 1}},
    Acquired = {0, 1, mutex, {acquired, door, ?FIRST}},
    Released = {0, 3, mutex, {released, door, ?SECOND}},
    ?assertEqual(
        fence_overtaken,
        judged([Granted, stands()] ++ second() ++ [Released, goes_on(), Acquired])
    ).

first() ->
    [{0, 2, mutex, {granted, door, ?FIRST, 1}}, {0, 1, mutex, {acquired, door, ?FIRST}}].

second() ->
    [{0, 2, mutex, {granted, door, ?SECOND, 3}}, {0, 3, mutex, {acquired, door, ?SECOND}}].

stands() -> {0, 1, robot, stands}.

goes_on() -> {0, 1, robot, goes_on}.

judged(Facts) -> judged(Facts, starl_mutex_model_monitor:init(#{})).

judged([], _State) ->
    ok;
judged([Fact | Facts], State) ->
    case starl_mutex_model_monitor:step(Fact, State) of
        {ok, Next} -> judged(Facts, Next);
        {violation, #{what := What}, _} -> What
    end.
