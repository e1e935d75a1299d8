%% A run in a process of the operating system of its own, to be killed: it records a painting, five
%% times as fast as real time, and prints the time that it has reached.
-module(starl_recording_child).

-export([main/0]).

-define(STEP_US, 100000).
-define(STEP_MS, 20).

main() ->
    [File, Seed] = init:get_plain_arguments(),
    {ok, Recorder} = starl_trace_recorder:start_link(File, simulation),
    {ok, Sim} = starl_sim:start(
        #{app => painting, robots => 6, seed => list_to_integer(Seed), loss => 0.1},
        #{observe => starl_trace_recorder:observer(Recorder), packets => true}
    ),
    steps(Sim, 1).

steps(Sim, N) ->
    _ = starl_sim:run(Sim, N * ?STEP_US / 1.0e6),
    io:format("~b~n", [N * ?STEP_US]),
    timer:sleep(?STEP_MS),
    steps(Sim, N + 1).
