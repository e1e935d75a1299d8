%% The shared counter: its contract under drawn faults. Its machine: starl_counter_gossip_tests; what it
%% declares: starl_counter_block_tests; the contract by traces: starl_counter_monitor_tests.
-module(starl_counter_tests).
%% in this order: both have a macro LET
-include_lib("proper/include/proper.hrl").
-include_lib("eunit/include/eunit.hrl").

contract_holds_test_() ->
    {timeout, 120, fun() -> starl_platform_ct:property(prop_contract(none), 30) end}.

%% The same property fails over a counter with a bug.
bugs_are_found_test_() ->
    {timeout, 120, fun() ->
        [
            ?assertEqual(
                {Bug, true},
                {Bug,
                    lists:any(
                        fun(Seed) -> broken(Bug, 4, Seed) =/= [] end, lists:seq(1, 30)
                    )}
            )
         || Bug <- [adds, replaces, zero, reborn]
        ]
    end}.

prop_contract(Bug) ->
    ?FORALL(
        {N, Seed},
        {proper_types:oneof([1, 2, 4, 6]), proper_types:noshrink(proper_types:integer(1, 100000))},
        starl_platform_ct:safely(fun() -> broken(Bug, N, Seed) =:= [] end)
    ).

broken(Bug, N, Seed) ->
    #{violations := Violations} =
        starl_blocks_script_app:play(fun script/1, around(Bug, N), #{
            robots => N,
            seed => Seed,
            random_faults => [network, process, clock],
            heal => 10,
            time => 60
        }),
    Violations.

around(none, _N) ->
    #{blocks => [{starl_counter, #{gossip_ms => 500}}]};
around(Bug, N) ->
    #{
        blocks => [{counter, starl_counter_bug, #{bug => Bug, gossip_ms => 500}}],
        monitors => [
            {starl_counter_monitor, #{
                robots => lists:seq(1, N), within_us => 1000 * starl_counter:within_ms(500, N)
            }}
        ]
    }.

script(Robot) ->
    _ = [
        begin
            _ = starl_counter:increment(Robot),
            ok = starl:sleep(Robot, 1 + trunc(2000 * starl:random(Robot)))
        end
     || _ <- lists:seq(1, 10)
    ],
    ok = starl:sleep(Robot, 20000),
    starl_counter:value(Robot).
