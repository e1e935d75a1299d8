%% @doc Adapts the actions of a step in three unusual cases. The robot stalls in the middle of the
%% step, an action has a deadline, or machines that the step calls have restarted meanwhile. Pure; a
%% part of {@link starl_robot}.
-module(starl_robot_actions).

-export([standing_still/2, aged/2, bounded/3, without_calls/2, without_call_events/2]).

-type action() ::
    starl_machine:action() | stand_still | {until, Us :: integer(), [action()], Mark :: term()}.

%% @doc Inserts the mark `stand_still' after this number of actions, if there are more. Trace events
%% in a group with a deadline are not separated from the check of the clock.
-spec standing_still(After :: non_neg_integer(), [starl_machine:action()]) ->
    {ok, [action(), ...]} | too_few.
standing_still(After, Actions) ->
    case count(Actions) > After of
        true -> {ok, cut(After, Actions)};
        false -> too_few
    end.

count(Actions) -> lists:sum([size_of(Action) || Action <- Actions]).

size_of({until, _Us, Group, _Mark}) when is_list(Group) -> length(Group);
%% what is kept of calls is no action: a run is the same with it and without
size_of({trace, {history, _}}) -> 0;
size_of(_Action) -> 1.

cut(0, Actions) ->
    [stand_still | Actions];
cut(After, [{until, Us, Group, Mark} | Rest]) when After =< length(Group) ->
    [{until, Us, cut_group(After, Group), Mark} | Rest];
cut(After, [{until, _, Group, _} = Until | Rest]) ->
    [Until | cut(After - length(Group), Rest)];
cut(After, [Action | Rest]) ->
    [Action | cut(After - size_of(Action), Rest)].

%% The facts of a group leave with the look at the clock.
cut_group(After, Group) ->
    Facts = lists:takewhile(fun(Action) -> element(1, Action) =:= trace end, Group),
    {Before, Behind} = lists:split(max(After, length(Facts)), Group),
    Before ++ [stand_still | Behind].

%% @doc The actions of a step that began this long ago: its timers count from its beginning.
-spec aged(Us :: non_neg_integer(), [action()]) -> [action()].
aged(Us, Actions) -> [older(Us, Action) || Action <- Actions].

older(Us, {{timeout, Name}, Time, Content}) ->
    {{timeout, Name}, max(0, Time - Us), Content};
older(Us, {state_timeout, Time, Content}) ->
    {state_timeout, max(0, Time - Us), Content};
older(Us, {until, Latest, Group, Mark}) when is_list(Group) ->
    {until, Latest, aged(Us, Group), Mark};
older(_Us, Action) ->
    Action.

%% @doc The actions of a group with a latest moment: what leaves the robot keeps it, and the driver looks again.
-spec bounded(Us :: integer(), Mark :: term(), [action()]) -> [action()].
bounded(Us, Mark, Group) -> [bound(Us, Mark, Action) || Action <- Group].

bound(Us, Mark, {trace, _} = Action) -> {until, Us, Action, Mark};
bound(Us, Mark, {transmit, _, _} = Action) -> {until, Us, Action, Mark};
bound(Us, Mark, {drive, _, _} = Action) -> {until, Us, Action, Mark};
bound(Us, Mark, Action) when element(1, Action) =:= actuate -> {until, Us, Action, Mark};
bound(_Us, _Mark, Action) -> Action.

%% @doc The actions of a step without its calls of these machines, which have restarted since the step
%% began: the caller is about to learn of that, and takes it for the end of its call ({@link
%% starl_robot:back/3}). A call that reached the new machine all the same would be answered to nobody.
-spec without_calls([starl_machine:name()], [starl_machine:action()]) -> [starl_machine:action()].
without_calls([], Actions) -> Actions;
without_calls(Restarted, Actions) -> [A || A <- Actions, not is_call(A, Restarted)].

is_call({call, To, _, _}, Names) -> lists:member(To, Names);
is_call(_Action, _Names) -> false.

%% @doc Local events without calls of these machines, likewise.
-spec without_call_events([starl_machine:name()], [starl_robot_loop:local()]) ->
    [starl_robot_loop:local()].
without_call_events(Restarted, Events) -> [E || E <- Events, not is_call_event(E, Restarted)].

is_call_event({To, {call, _From}, _Request}, Names) -> lists:member(To, Names);
is_call_event(_Event, _Names) -> false.
