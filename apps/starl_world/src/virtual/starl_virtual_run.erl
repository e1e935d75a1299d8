%% @doc Tests a part of the program that ships on robots in virtual time, from a seed. Its clock,
%% sockets and disk are simulated. The same seed gives the same run.
%% ```
%%     1> starl_virtual_run:run({store, 1, #{}}).
%%     #{violations => [], events => 83, digest => 70286913}
%% '''
-module(starl_virtual_run).

-export([parts/0, blocks/0, run/1]).

-export_type([part/0, run/0, result/0]).

%% The store on its disk, the radio of some robots, or whole robots that use a block.
-type part() :: store | radio | sap | mutex | barrier | election | registers.

%% A part, a seed, and for whole robots the scenario.
-type run() :: {part(), Seed :: integer(), #{atom() => term()}}.

-type result() :: #{
    violations := [starl_monitor:violation()],
    events := non_neg_integer(),
    digest := non_neg_integer()
}.

%% @doc The parts, each with a line.
-spec parts() -> [{part(), string()}].
parts() ->
    [
        {store, "the store under power cuts"},
        {radio, "datagrams under an attacker"}
        | [{Block, "whole robots that use " ++ atom_to_list(Block)} || Block <- blocks()]
    ].

%% @doc The blocks that whole robots use.
-spec blocks() -> [part()].
blocks() -> [sap, mutex, barrier, election, registers].

%% @doc One run, in a process of its own.
-spec run(run()) -> result().
run(Run) ->
    Caller = self(),
    {Pid, Monitor} = spawn_monitor(fun() -> Caller ! {self(), ran(Run)} end),
    receive
        {Pid, Result} ->
            true = erlang:demonitor(Monitor, [flush]),
            Result;
        {'DOWN', Monitor, process, Pid, Why} ->
            error(Why)
    end.

ran({store, Seed, _Given}) -> starl_virtual_store:run(Seed);
ran({radio, Seed, _Given}) -> starl_virtual_radio:run(Seed);
ran({_Block, _Seed, Scenario}) -> starl_virtual_team:run(Scenario).
