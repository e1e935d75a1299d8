%% The contract of the shared registers, in the simulator: no read returns what nobody wrote,
%% reads never go back, stamps never go back, all agree when writes stop.
%% starl_registers_monitor is the judge.
-module(starl_registers_SUITE).
-include_lib("stdlib/include/assert.hrl").
-include_lib("proper/include/proper.hrl").

-export([all/0]).
-export([
    contract_under_faults/1,
    planted_bugs_are_caught/1,
    single_writer/1,
    recovers_from_peers/1,
    subscribers_are_told/1,
    too_far_ahead_waits/1,
    same_time_is_decided_by_robots/1,
    every_write_has_a_stamp/1
]).

all() ->
    [
        contract_under_faults,
        planted_bugs_are_caught,
        single_writer,
        recovers_from_peers,
        subscribers_are_told,
        too_far_ahead_waits,
        same_time_is_decided_by_robots,
        every_write_has_a_stamp
    ].

%% Agreement within so long after the last write or crash.
-define(BOUND_US, 60000000).

contract_under_faults(_) ->
    Prop = ?FORALL(
        Case,
        registers(),
        starl_platform_ct:safely(fun() ->
            #{violations := Violations} = run(Case, none),
            ok = starl_platform_ct:tell(Violations),
            Violations =:= []
        end)
    ),
    starl_platform_ct:property(Prop, 40).

planted_bugs_are_caught(_) ->
    _ = rand:seed(exsss, starl_platform_ct:seed()),
    [?assert(caught(Bug, 300), Bug) || Bug <- [restart, last_heard, no_exchange]].

%% By a violation, not by an exception: that would fail the test case.
caught(_Bug, 0) ->
    false;
caught(Bug, Left) ->
    {ok, Case} = proper_gen:pick(registers()),
    #{violations := Violations} = run(Case, Bug),
    case [What || #{contract := registers, what := What} <- Violations] of
        [] ->
            caught(Bug, Left - 1);
        [What | _] ->
            ct:log("~p is caught as ~p in case ~b", [Bug, What, 301 - Left]),
            true
    end.

registers() ->
    ?LET(
        N,
        range(2, 5),
        map([
            {robots, N},
            {seed, noshrink(integer(1, 100000))},
            {loss, oneof([0.0, 0.2, 0.4])},
            {duplicate, oneof([0.0, 0.3])},
            {delay, oneof([{5, 20}, {2, 100}])},
            {clock_offset, oneof([0, 1000, 2000])},
            {clock_drift, oneof([0, 50, 900])},
            {range, oneof([none, 2500])},
            {faults,
                list(
                    oneof([
                        {moment(), kill_machine, {range(1, N), registers}},
                        {moment(), kill_machine, {range(1, N), oneof([sap, registers])}}
                    ])
                )}
        ])
    ).

map(Pairs) -> ?LET(Drawn, Pairs, maps:from_list(Drawn)).

moment() -> oneof([10, 700, 1300, 2500, 4000]).

run(#{robots := N, faults := Faults} = Case, Bug) ->
    Team = lists:seq(1, N),
    Monitor = #{robots => Team, owners => #{mine => 1}, bound_us => ?BOUND_US, healed_us => 0},
    Around = #{
        blocks => [machine(Bug, #{owners => #{mine => 1}})],
        monitors => [{starl_registers_monitor, Monitor}]
    },
    starl_blocks_script_app:play(fun script/1, Around, Case#{
        faults => planned(Faults), time => 80
    }).

machine(none, Config) -> hd(starl_registers:machines(Config));
machine(Bug, Config) -> {registers, starl_registers_bug, Config#{bug => Bug}}.

script(R) ->
    Id = starl:id(R),
    _ = [
        begin
            ok = starl:sleep(R, 100 + 60 * Id),
            _ = starl_registers:put(R, K rem 3, {Id, K}),
            _ = starl_registers:put(R, mine, {Id, K}),
            [starl_registers:get(R, Name) || Name <- [0, 1, 2, mine]]
        end
     || K <- lists:seq(1, 12)
    ],
    ok = starl:sleep(R, 70000),
    [starl_registers:get(R, Name) || Name <- [0, 1, 2, mine]].

planned(Faults) ->
    [
        {starl_platform_ct:fault_id(f, K), At, At, Kind, Target, #{}}
     || {K, {At, Kind, Target}} <- lists:zip(lists:seq(1, length(Faults)), Faults)
    ].

%% -- directed tests -------------------------------------------------------------------------

single_writer(_) ->
    {[A, B], _} = play(
        2,
        fun(R) ->
            Put = starl_registers:put(R, mine, starl:id(R)),
            ok = starl:sleep(R, 3000),
            {Put, starl_registers:get(R, mine), starl_registers:get(R, other)}
        end,
        #{},
        #{owners => #{mine => 2}}
    ),
    ?assertEqual({done, {{error, not_owner}, {ok, 2}, {error, unset}}}, A),
    ?assertEqual({done, {ok, {ok, 2}, {error, unset}}}, B).

%% A machine that crashed has its registers again, and writes later stamps than before.
recovers_from_peers(_) ->
    {[A, _], Trace} = play(
        2,
        fun(R) ->
            _ = [ok = starl_registers:put(R, x, 1) || starl:id(R) =:= 1],
            ok = starl:sleep(R, 3000),
            Again = starl_registers:get(R, x),
            _ = [ok = starl_registers:put(R, y, 2) || starl:id(R) =:= 1],
            ok = starl:sleep(R, 15000),
            {Again, starl_registers:get(R, y)}
        end,
        #{faults => [{k, 2900, 2900, kill_machine, {1, registers}, #{}}]},
        #{}
    ),
    ?assertEqual({done, {{ok, 1}, {ok, 2}}}, A),
    [First, Second] = [Stamp || {_, 1, registers, {put, _, _, Stamp}} <- Trace],
    ?assert(First < Second).

subscribers_are_told(_) ->
    {[_, B], _} = play(
        2,
        fun(R) ->
            case starl:id(R) of
                1 ->
                    [
                        begin
                            ok = starl_registers:put(R, x, K),
                            starl:sleep(R, 500)
                        end
                     || K <- [1, 2]
                    ];
                2 ->
                    ok = starl_registers:subscribe(R, x),
                    [starl:await(R, register, 5000), starl:await(R, register, 5000)]
            end
        end,
        #{},
        #{}
    ),
    ?assertEqual({done, [{ok, 1, {x, 1}}, {ok, 1, {x, 2}}]}, B).

%% Clocks farther apart than allowed: the slow robot takes the value when its clock is near.
too_far_ahead_waits(_) ->
    {[A, B], Trace} = play(
        2,
        fun(R) ->
            ok = starl_registers:put(R, starl:id(R), here),
            ok = starl:sleep(R, 30000),
            {starl_registers:get(R, 1), starl_registers:get(R, 2)}
        end,
        #{clock_offset => 5000, seed => 3},
        #{ahead_ms => 100}
    ),
    ?assertEqual({done, {{ok, here}, {ok, here}}}, A),
    ?assertEqual(A, B),
    ?assertNotEqual([], [T || {T, _, registers, {too_far_ahead, _, _}} <- Trace]).

%% Two robots write one register at the same time of equal clocks: the larger robot's value wins
%% everywhere, whichever copy comes first.
same_time_is_decided_by_robots(_) ->
    {Results, Trace} = play(
        3,
        fun(R) ->
            _ = [ok = starl_registers:put(R, x, starl:id(R)) || starl:id(R) =/= 2],
            ok = starl:sleep(R, 20000),
            starl_registers:get(R, x)
        end,
        #{clock_offset => 0, clock_drift => 0},
        #{}
    ),
    Stamps = [{Time, Count} || {_, _, registers, {put, x, _, {Time, Count, _}}} <- Trace],
    ?assertMatch([Same, Same], Stamps),
    ?assertEqual(lists:duplicate(3, {done, {ok, 3}}), Results),
    %% the same in a machine alone, in either order
    [
        ?assertEqual({ok, V}, read(x, lists:foldl(fun written/2, machine(Self), Writes)))
     || Self <- [1, 2, 3],
        V <- [3],
        Writes <- [[{1, 7, 0}, {3, 7, 0}], [{3, 7, 0}, {1, 7, 0}]]
    ].

%% No two writes of a robot have one stamp, though its clock stands still; so none is taken for
%% another, and the later one wins.
every_write_has_a_stamp(_) ->
    {Last, Stamps} = lists:foldl(
        fun(V, {Machine, Given}) ->
            {Actions, Next} = step({call, {app, V}}, {put, x, V}, Machine),
            {Next, Given ++ [Stamp || {trace, {put, x, _, Stamp}} <- Actions]}
        end,
        {machine(1), []},
        [1, 2, 3]
    ),
    ?assertEqual([{7, 0, 1}, {7, 1, 1}, {7, 2, 1}], Stamps),
    ?assertEqual({ok, 3}, read(x, Last)),
    %% and a write after one that was heard of is later than that
    {Actions, _} = step({call, {app, 4}}, {put, x, 4}, written({2, 7, 9}, machine(1))),
    ?assertEqual([{7, 10, 1}], [Stamp || {trace, {put, x, _, Stamp}} <- Actions]).

machine(Self) ->
    {_, Machine} = starl_machine:new(starl_registers_lww, #{}, #{
        robot => Self,
        participants => [1, 2, 3],
        name => registers,
        incarnation => 1,
        random => rand:seed_s(exsss, 1),
        now => 7
    }),
    Machine.

%% A write of another robot arrives: its value is the robot's number.
written({Writer, Time, Count}, Machine) ->
    Body = {write, x, Writer, {Time, Count, Writer}},
    {_, Next} = step(cast, {message, Writer, registers, Body}, Machine),
    Next.

read(Name, Machine) ->
    {Actions, _} = step({call, {app, read}}, {get, Name}, Machine),
    [Answer] = [A || {reply, {app, read}, A} <- Actions],
    Answer.

step(Type, Content, Machine) ->
    starl_machine:step(Type, Content, #{now => 7, robot => 1}, Machine).

play(N, Script, Scenario, Config) ->
    Monitor = #{robots => lists:seq(1, N), owners => maps:get(owners, Config, #{})},
    Around = #{
        blocks => starl_registers:machines(Config),
        monitors => [{starl_registers_monitor, Monitor}]
    },
    Outcome = starl_blocks_script_app:play(Script, Around, Scenario#{robots => N, time => 100}),
    ?assertEqual([], maps:get(violations, Outcome)),
    {
        [Result || {_, #{result := Result}} <- maps:get(robots, Outcome)],
        starl_blocks_script_app:trace(Outcome)
    }.
