%% What the interface of the election asks its machine, and what it makes of the answers.
-module(starl_election_interface_tests).
-include_lib("eunit/include/eunit.hrl").

-import(starl_blocks_driver, [play/2]).

%% Half a minute's patience, or so much; the machine counts in microseconds.
elect_test() ->
    Elect = fun(R) -> starl_election:elect(R, chief) end,
    Asked = [{election, {elect, chief, 30000000}, infinity}],
    [
        ?assertEqual({Asked, Answer}, play(Elect, [{answer, Answer}]))
     || Answer <- [{ok, 7}, {error, timeout}]
    ],
    ?assertEqual({Asked, {error, restarted}}, play(Elect, [restarted])),
    ?assertEqual(
        {[{election, {elect, chief, 5000}, infinity}], {ok, 2}},
        play(fun(R) -> starl_election:elect(R, chief, 5) end, [{answer, {ok, 2}}])
    ).

%% The mistake in a call is told with the function that was called.
mistake_test() ->
    Robot = starl:robot(1, [1, 2]),
    ?assertError(
        {bad_argument, #{function := {starl_election, elect, 3}, argument := 'Ms', given := 0}},
        starl_election:elect(Robot, chief, 0)
    ).

block_test() ->
    ?assertEqual([{election, starl_election_ballots, #{}}], starl_election:machines(#{})),
    ?assertEqual([{election, starl_election_bully, #{}}], starl_bully:machines(#{})),
    ?assertEqual(
        [{election, starl_election_bully, #{rounds => 7}}],
        starl_bully:machines(#{rounds => 7, patience_ms => 9})
    ).
