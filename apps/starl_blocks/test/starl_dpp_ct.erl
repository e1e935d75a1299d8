%% The machines of path planning for tests, stepped by hand: events of robot 1 in, actions out.
-module(starl_dpp_ct).

-export([base/4, base/5, step/3, at/4, sent/2]).

%% What a machine of this name is booted with, in this of its lives, with what it stored.
base(Robot, Name, Life, Team) -> base(Robot, Name, Life, Team, none).

base(Robot, Name, Life, Team, Stored) ->
    #{
        robot => Robot,
        participants => Team,
        name => Name,
        incarnation => Life,
        stored => Stored,
        random => rand:seed_s(exsss, 1),
        now => 0
    }.

%% An event at time 0, or at a time in us.
step(Type, Content, M) -> at(0, Type, Content, M).

%% What has a latest moment comes without it.
at(Now, Type, Content, M) ->
    {Actions, Next} = starl_machine:step(Type, Content, #{now => Now, robot => 1}, M),
    {starl_action:without_latest(Actions), Next}.

%% The messages of a type, to whom and what.
sent(Type, Actions) ->
    [{To, Body} || {cast, sap, {send, To, T, Body}} <- Actions, T =:= Type] ++
        [{To, Body} || {call, sap, {send, To, T, Body}, _} <- Actions, T =:= Type].
