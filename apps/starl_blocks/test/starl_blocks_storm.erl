%% Runs of a test application under random faults, for the properties of the blocks.
-module(starl_blocks_storm).
-include_lib("proper/include/proper.hrl").

-export([storm/1, run/3, drawn/2, broken/2, caught/4]).

%% Faults at any time of the first twenty seconds, on a bad network, with drifting clocks.
storm(Machine) when is_atom(Machine) -> storm([Machine, Machine]);
storm(Machines) ->
    {
        oneof(lists:seq(1, 1000)),
        oneof([0.0, 0.1, 0.4]),
        oneof([0.0, 0.3]),
        oneof([{5, 20}, {5, 400}]),
        oneof([50, 10000]),
        resize(5, list({range(0, 200), range(1, 4), oneof(Machines ++ [sap, app, robot])}))
    }.

%% What came of it: the outcome of the run.
run(App, {Seed, Loss, Duplicate, Delay, Drift, Strikes}, Options) ->
    Given = Options#{
        app => App,
        robots => 4,
        time => 90,
        seed => Seed,
        loss => Loss,
        duplicate => Duplicate,
        delay => Delay,
        clock_drift => Drift,
        faults => faults(Strikes)
    },
    starl_platform_ct:quietly(fun() ->
        {ok, Sim} = starl_sim:start(Given),
        _ = starl_sim:run(Sim),
        {Outcome, _} = starl_sim:finish(Sim),
        Outcome
    end).

faults(Strikes) ->
    lists:append([faults(N, S) || {N, S} <- lists:zip(lists:seq(1, length(Strikes)), Strikes)]).

%% A robot, a machine, or a robot's store is struck; `damaged': it comes up anew and can read
%% nothing of what it has stored.
faults(N, {Tenths, Robot, robot}) ->
    [{name(N), Tenths * 100, Tenths * 100, kill_robot, Robot, #{}}];
faults(N, {Tenths, Robot, Kind}) when Kind =:= reboot; Kind =:= store_full ->
    [{name(N), Tenths * 100, ends(Tenths, Robot), Kind, Robot, #{}}];
faults(N, {Tenths, Robot, damaged}) ->
    [
        {name(N), Tenths * 100, ends(Tenths, Robot), reboot, Robot, #{}},
        {name(1000 + N), Tenths * 100, ends(Tenths, Robot) + 1000, store_damaged, Robot, #{}}
    ];
faults(N, {Tenths, Robot, Machine}) ->
    [{name(N), Tenths * 100, Tenths * 100, kill_machine, {Robot, Machine}, #{}}].

ends(Tenths, Robot) -> Tenths * 100 + 1 + erlang:phash2({Tenths, Robot}, 8000).

name(N) -> starl_platform_ct:fault_id(fault_, N).

%% The N-th storm of a series: a function of N alone.
drawn(N, Machine) ->
    Draw = fun(What, Range) -> erlang:phash2({N, What}, Range) end,
    {N, lists:nth(1 + Draw(loss, 3), [0.0, 0.2, 0.4]), 0.2, {5, 20 + 200 * Draw(delay, 2)}, 10000, [
            {
                Draw({at, I}, 200),
                1 + Draw({robot, I}, 4),
                lists:nth(1 + Draw({kind, I}, 4), [Machine, Machine, app, robot])
            }
         || I <- lists:seq(1, Draw(count, 5))
        ]}.

%% The violations of one contract, logged.
broken(Contract, #{violations := Violations}) ->
    Mine = [V || #{contract := C} = V <- Violations, C =:= Contract],
    ok = starl_platform_ct:tell(Mine),
    Mine.

%% The first of so many storms that shows a violation of the contract.
caught(Contract, App, Machine, {Options, Seeds}) ->
    caught(Contract, App, Machine, Options, 1, Seeds).

caught(_Contract, _App, _Machine, _Options, N, Seeds) when N > Seeds -> not_caught;
caught(Contract, App, Machine, Options, N, Seeds) ->
    case broken(Contract, run(App, drawn(N, Machine), Options)) of
        [] -> caught(Contract, App, Machine, Options, N + 1, Seeds);
        [First | _] -> {caught, N, maps:get(what, First)}
    end.
