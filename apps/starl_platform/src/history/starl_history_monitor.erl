%% @doc Checks the history of calls and answers against a model (linearizability, {@link starl_history}). It uses
%% no trace events of machines: only what applications have seen.
-module(starl_history_monitor).
-behaviour(starl_monitor).

-export([init/1, interests/1, context/2, broken/2, step/2, finish/2]).

-record(monitor, {
    models :: [{module(), map()}],
    machines :: [starl_machine:name()],
    states :: pos_integer(),
    clocks :: [{integer(), integer()}],
    stills :: [{starl:robot_id(), integer(), integer()}],
    history :: starl_history:t()
}).

%% @doc Takes the models with their contracts' configuration ({@link starl_history:models/2}), the
%% most states of a search, the times when clocks were set, and the times when applications stalled
%% within a step.
-spec init(#{
    models := [{module(), map()}],
    states => pos_integer(),
    clocks => [{integer(), integer()}],
    stills => [{starl:robot_id(), integer(), integer()}]
}) -> #monitor{}.
init(#{models := Models} = Config) ->
    Machines = lists:usort([Model:machine() || {Model, _} <- Models]),
    #monitor{
        models = Models,
        machines = Machines,
        states = maps:get(states, Config, 200000),
        clocks = maps:get(clocks, Config, []),
        stills = maps:get(stills, Config, []),
        history = starl_history:new(Machines)
    }.

-spec interests(#monitor{}) -> [starl_machine:name()].
interests(#monitor{machines = Machines}) -> [app, robot | Machines].

-spec context(starl_monitor:known(), map()) -> map().
context(#{broken := Windows}, Config) ->
    Config#{
        clocks => [{From, To} || {_, From, To, {clock, _}} <- Windows],
        stills => [{Robot, From, To} || {Robot, From, To, caller} <- Windows]
    }.

-spec broken(starl_assumption:window(), #monitor{}) -> #monitor{}.
broken({_, From, To, {clock, _}}, #monitor{clocks = Clocks} = Monitor) ->
    Monitor#monitor{clocks = [{From, To} | Clocks]};
broken({Robot, From, To, caller}, #monitor{stills = Stills} = Monitor) ->
    Monitor#monitor{stills = [{Robot, From, To} | Stills]};
broken(_Window, Monitor) ->
    Monitor.

-spec step(starl_monitor:trace_event(), #monitor{}) -> {ok, #monitor{}}.
step(Event, #monitor{history = History} = Monitor) ->
    {ok, Monitor#monitor{history = starl_history:event(Event, History)}}.

-spec finish(integer(), #monitor{}) ->
    {ok | {violation, [starl_monitor:violation(), ...]}, starl_monitor:results()}.
finish(_EndUs, #monitor{models = Models, history = History, states = States} = Monitor) ->
    Verdicts = starl_history:verdicts(Models, History, #{
        states => States, clocks => Monitor#monitor.clocks, stills => Monitor#monitor.stills
    }),
    Undecided = length([undecided || #{outcome := undecided} <- Verdicts]),
    Results = #{objects => length(Verdicts), undecided => Undecided},
    Broken = [Verdict || #{outcome := {broken, _, _, _}} = Verdict <- Verdicts],
    starl_violation:finish([violation(Verdict) || Verdict <- Broken], Results).

violation(#{machine := Machine, object := Object, outcome := {broken, What, At, Calls}}) ->
    Robots = lists:usort([Robot || #{robot := Robot} <- lists:sublist(Calls, 2)]),
    starl_violation:new(history, not_explained, At, Robots, #{
        machine => Machine, object => Object, never => unicode:characters_to_binary(What)
    }).
