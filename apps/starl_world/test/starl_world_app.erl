%% Applications of these tests, by their options: `wait': waits for a word of another robot, then is
%% done; `compute': computes until a process of the test says go; `tell': sends to a robot; `numbers'
%% sends numbers until each has arrived; `count' tells the test of each; `talk': sends words to all and
%% tells the test of each, until the test says that it is enough and all have acknowledged one more.
-module(starl_world_app).
-behaviour(starl_app).

-export([options/0, blocks/0, init/2, step/2]).

options() -> [{play, {term, "what each robot does", fun is_map/1}, #{}, "what each robot does"}].

blocks() -> [].

init(Robot, #{play := Play}) ->
    starl:listen(Robot, word),
    %% a sender that starts anew goes on where it was
    case {maps:get(starl:id(Robot), Play, wait), starl:stored(Robot)} of
        {{numbers, To, _, N, Test}, {stored, From}} -> {numbers, To, From, N, Test};
        {What, _} -> What
    end.

step(Robot, wait) ->
    {ok, From, Body} = starl:await(Robot, word),
    {done, {From, Body}};
step(_Robot, {compute, Test}) ->
    Test ! {computing, self()},
    receive
        go -> {done, computed}
    end;
step(Robot, {tell, To, Body, Test}) ->
    Outcome = starl:send(Robot, To, word, Body),
    Test ! {told, Outcome},
    {done, Outcome};
step(Robot, {count, To, N, Test}) ->
    {ok, From, Body} = starl:await(Robot, word),
    Test ! {heard, From, Body},
    case Body of
        N -> {done, N};
        _ -> {continue, {count, To, N, Test}}
    end;
step(Robot, {talk, Test, Enough} = Talk) ->
    IsLast = atomics:get(Enough, 1) =:= 1,
    Outcome = starl:broadcast(Robot, word, talk),
    Test ! {talked, starl:id(Robot)},
    said(Robot, 1),
    case Outcome of
        ok when IsLast -> {done, ok};
        _ -> {continue, Talk}
    end;
step(Robot, {numbers, To, From, N, Test}) ->
    ok = starl:store(Robot, From),
    case starl:send(Robot, To, word, From) of
        ok when From =:= N ->
            {done, N};
        ok ->
            {continue, {numbers, To, From + 1, N, Test}};
        {error, Why} ->
            Test ! {lost, Why},
            {continue, {numbers, To, From, N, Test}}
    end.

%% Reads what has come.
said(Robot, Ms) ->
    case starl:await(Robot, word, Ms) of
        {ok, _, _} -> said(Robot, 0);
        timeout -> ok
    end.
