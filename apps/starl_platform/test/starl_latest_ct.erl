%% For tests of machines that look at actions alone: what has a latest moment, without that moment.
-module(starl_latest_ct).

-export([actions/1]).

%% The actions in their order, groups taken apart; messages and answers without their latest moments.
-spec actions([starl_machine:action()]) -> [starl_machine:action()].
actions(Actions) -> lists:flatmap(fun action/1, Actions).

action({until, _Us, Group, _Mark}) -> actions(Group);
action({call, sap, {send, To, Type, Body, _Us}, Tag}) -> [{call, sap, {send, To, Type, Body}, Tag}];
action({cast, sap, {shout, Type, Body, _Us}}) -> [{cast, sap, {shout, Type, Body}}];
action({reply, From, {until, _Us, Answer}}) -> [{reply, From, Answer}];
action(Action) -> [Action].
