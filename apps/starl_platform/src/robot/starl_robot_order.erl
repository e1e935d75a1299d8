%% @doc The order of a robot's machines, said once: in which order they boot and are told of a crash,
%% and which of them are the robot's services. The order of events of one moment:
%% `starl_robot_order.hrl'.
-module(starl_robot_order).

-export([boot/1, part/1]).

%% The machines without which a robot is none, in their order.
-define(SERVICES, [sap, location, motion]).

%% @doc These machines in the order in which they boot: the services first, the application last,
%% the blocks by their names between them.
-spec boot([starl_machine:name()]) -> [starl_machine:name()].
boot(Names) ->
    First = [Name || Name <- ?SERVICES, lists:member(Name, Names)],
    Last = [app || lists:member(app, Names)],
    First ++ lists:sort(Names -- (First ++ Last)) ++ Last.

%% @doc The part of the robot that bears a machine's restarts ({@link starl_robot_sup}): the services
%% have theirs together, each other machine its own.
-spec part(starl_machine:name()) -> starl_robot_sup:part().
part(Name) ->
    case lists:member(Name, ?SERVICES) of
        true -> services;
        false -> Name
    end.
