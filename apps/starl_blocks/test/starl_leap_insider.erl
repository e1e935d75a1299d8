%% A machine for tests, on all robots, which acts on one of them: that robot's own SAP sends what is
%% given here to the machines of the others, again and again in a window of time. Such a robot has the
%% key of the team, and lies in its own name.
-module(starl_leap_insider).
-behaviour(starl_machine).

-export([init/1, handle_event/5]).

%% `by': the robot that lies; `from_ms', `to_ms': when, by its clock, and again after `every_ms'; `lies':
%% what it says to another robot, each time, at this time of its clock.
init(#{robot := Robot, by := Robot, from_ms := From, now := Now} = Config) ->
    {ready, Config, [{{timeout, lie}, max(1, 1000 * From - Now), again}]};
init(Config) ->
    {ready, Config, []}.

handle_event({timeout, lie}, again, ready, #{to_ms := To} = Config, #{now := Now}) when
    Now < 1000 * To
->
    #{robot := Self, participants := Team, lies := Lies, every_ms := Every} = Config,
    Said = [
        {cast, sap, {send, Other, Type, Body}}
     || Other <- starl_team:others(Self, Team), {Type, Body} <- Lies(Other, Now)
    ],
    {keep_state_and_data, Said ++ [{{timeout, lie}, 1000 * Every, again}]};
handle_event(_, _, ready, _Config, _Meta) ->
    keep_state_and_data.
