%% Progress is judged in the run of any application that uses a block, with the monitors that the block
%% gives: a block that does nothing breaks its contract.
-module(starl_blocks_progress_tests).
-include_lib("eunit/include/eunit.hrl").

-define(TEAM, [1, 2, 3]).

a_mutex_that_never_grants_breaks_its_contract_test_() ->
    {timeout, 60, fun() ->
        ?assertEqual([], violations(mutex(starl_mutex_tokens))),
        ?assertMatch([lies_idle | _], violations(mutex(starl_blocks_deaf)))
    end}.

a_barrier_that_passes_nobody_breaks_its_contract_test_() ->
    {timeout, 60, fun() ->
        ?assertEqual([], violations(barrier(starl_barrier_rounds))),
        ?assertMatch([not_passed | _], violations(barrier(starl_blocks_deaf)))
    end}.

%% So it does although some of the packets are lost all the time, and a fault came long before. (With more
%% loss a claim and its answer may take longer than the lease, and nothing is sure.)
no_fault_elsewhere_is_an_excuse_test_() ->
    {timeout, 60, fun() ->
        Bad = #{
            loss => 0.05,
            patience => 600000,
            time => 600,
            faults => [
                {early, 100, 900, isolate, 1, #{}},
                {dead, 0, 0, slip, 2, #{
                    factor => 0.9
                }}
            ]
        },
        [
            begin
                ?assertEqual({What, []}, {What, violations(maps:merge(Of(Real), Bad))}),
                ?assertMatch([What | _], violations(maps:merge(Of(starl_blocks_deaf), Bad)))
            end
         || {What, Of, Real} <- [
                {lies_idle, fun mutex/1, starl_mutex_tokens},
                {not_passed, fun barrier/1, starl_barrier_rounds}
            ]
        ]
    end}.

mutex(Machine) ->
    [{Monitor, Judge}] = starl_mutex:monitors(
        #{lease_ms => 3000, drift_ppm => 10000, lag_ms => 250, retry_ms => 1000}, #{robots => ?TEAM}
    ),
    ?assertEqual(starl_mutex_monitor, Monitor),
    #{
        app => starl_mutex_app,
        patience => 30000,
        machine => Machine,
        config => #{real => starl_mutex_tokens, lease_ms => 3000, retry_ms => 1000},
        judge => Judge
    }.

barrier(Machine) ->
    [{Monitor, Judge}] = starl_barrier:monitors(#{retry_ms => 1000}, #{robots => ?TEAM}),
    ?assertEqual(starl_barrier_monitor, Monitor),
    #{
        app => starl_barrier_app,
        patience => 30000,
        machine => Machine,
        config => #{real => starl_barrier_rounds, retry_ms => 1000},
        judge => Judge
    }.

violations(Given) ->
    {ok, Sim} = starl_sim:start(
        maps:merge(#{time => 120}, Given#{robots => length(?TEAM), seed => 3})
    ),
    _ = starl_sim:run(Sim),
    {#{violations := Violations}, _} = starl_sim:finish(Sim),
    [What || #{what := What} <- Violations].
