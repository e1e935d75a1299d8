%% @doc The contract of every machine of StarL: no machine crashes by itself, on any input. A crash
%% that a fault caused does not count.
%%
%% Events of machine `supervisor': {@link starl_event:supervisor()}. The crashes of machines that
%% are `excused' (a user's application) are reported in the results: their number, the first one,
%% and the number of different causes.
-module(starl_crash_monitor).
-behaviour(starl_monitor).

-export([init/1, step/2, finish/2, interests/0, violation/4]).

-export_type([excused/0]).

%% A crash that is no violation: when (us), which robot and machine, and the cause.
-type excused() :: {
    TimeUs :: integer(), starl:robot_id(), starl_machine:name(), starl_crash:cause()
}.

%% Further causes are not told apart.
-define(MOST_CAUSES, 1000).

-record(state, {
    excused :: [starl_machine:name()],
    first = none :: excused() | none,
    count = 0 :: non_neg_integer(),
    causes = #{} :: #{starl_crash:cause() => true},
    given_up = [] :: [{starl:robot_id(), starl_machine:name()}]
}).

%% @doc `excused': the machines that may crash.
-spec init(#{excused => [starl_machine:name()]}) -> #state{}.
init(Config) -> #state{excused = maps:get(excused, Config, [])}.

%% @doc The events of a robot's supervisors.
-spec interests() -> [supervisor].
interests() -> [supervisor].

%% @doc Judges one event.
-spec step(starl_monitor:trace_event(), #state{}) ->
    {ok, #state{}} | {violation, starl_monitor:violation(), #state{}}.
step({T, Robot, supervisor, {crashed, Machine, Cause}}, #state{excused = Excused} = State) ->
    case lists:member(Machine, Excused) of
        true -> {ok, noted({T, Robot, Machine, Cause}, State)};
        false -> {violation, violation(T, Robot, Machine, Cause), State}
    end;
step({_T, Robot, supervisor, {given_up, Machine}}, #state{given_up = GivenUp} = State) ->
    {ok, State#state{given_up = [{Robot, Machine} | GivenUp]}};
step(_, State) ->
    {ok, State}.

noted(Crash, #state{first = none} = State) ->
    noted(Crash, State#state{first = Crash});
noted({_, _, _, Cause}, #state{count = Count, causes = Causes} = State) when
    map_size(Causes) < ?MOST_CAUSES
->
    State#state{count = Count + 1, causes = Causes#{Cause => true}};
noted(_Crash, #state{count = Count} = State) ->
    State#state{count = Count + 1}.

%% @doc The violation for a crash: the contract is that of the machine.
-spec violation(TimeUs :: integer(), starl:robot_id(), starl_machine:name(), starl_crash:cause()) ->
    starl_monitor:violation().
violation(T, Robot, Machine, {Reason, Stack}) ->
    Where = unicode:characters_to_list(starl_crash:format({"", Stack})),
    starl_violation:new(Machine, crashed, T, [Robot], #{
        reason => Reason, stack => string:trim(Where)
    }).

%% @doc Judges nothing at the end; reports the excused crashes.
-spec finish(integer(), #state{}) ->
    {ok, #{
        crashes := non_neg_integer(),
        causes := non_neg_integer(),
        first_crash := excused() | none,
        given_up := [{starl:robot_id(), starl_machine:name()}]
    }}.
finish(_EndUs, #state{first = First, count = Count, causes = Causes, given_up = GivenUp}) ->
    {ok, #{
        crashes => Count,
        causes => map_size(Causes),
        first_crash => First,
        given_up => lists:sort(GivenUp)
    }}.
