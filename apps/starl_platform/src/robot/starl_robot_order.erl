%% @doc Defines the order of a robot's machines: the order in which they boot and hear of a crash,
%% and the list of the robot's services. `starl_robot_order.hrl' defines the order of the events of
%% one moment.
-module(starl_robot_order).

-export([boot/1, part/1]).

%% The services, without which a robot cannot work, in their order.
-define(SERVICES, [sap, location, motion]).

%% @doc Machines in the order in which they boot: the services first, the application last,
%% the blocks by their names between them.
-spec boot([starl_machine:name()]) -> [starl_machine:name()].
boot(Names) ->
    First = [Name || Name <- ?SERVICES, lists:member(Name, Names)],
    Last = [app || lists:member(app, Names)],
    First ++ lists:sort(Names -- (First ++ Last)) ++ Last.

%% @doc The part of the robot to which a machine's restarts count ({@link starl_robot_sup}): the
%% services form one part, each other machine its own.
-spec part(starl_machine:name()) -> starl_robot_sup:part().
part(Name) ->
    case lists:member(Name, ?SERVICES) of
        true -> services;
        false -> Name
    end.
