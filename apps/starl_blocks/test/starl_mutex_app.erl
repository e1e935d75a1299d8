%% An application for the tests of mutual exclusion: each robot acquires tokens at random,
%% alone and in sets, holds them for a while and releases them, until its time is up.
-module(starl_mutex_app).
-behaviour(starl_app).
-behaviour(starl_scene).

-export([options/0, scene/1, init/2, step/2]).

options() ->
    [
        {work, {integer, 1, 100000}, 20, "seconds of virtual time in which robots acquire"},
        {tokens, {integer, 1, 1000}, 3, "how many tokens there are"},
        {hold, {integer, 1, 100000}, 200, "longest hold, ms"},
        {pause, {integer, 1, 100000}, 300, "longest pause between two acquisitions, ms"},
        {sets, {integer, 1, 10}, 2, "largest set"},
        {patience, {integer, 1, 1000000}, 20000, "patience, ms"},
        {machine, {term, "a machine", fun is_atom/1}, starl_mutex_tokens, "the implementation"},
        {config, {term, "a map", fun is_map/1}, #{}, "its configuration"},
        {judge, {term, "a map", fun is_map/1}, #{}, "the monitor's configuration"}
    ].

scene(#{options := #{machine := Machine, config := Config, judge := Judge} = Options}) ->
    {ok, #{
        app => {sequential, ?MODULE, Options},
        blocks => [{mutex, Machine, Config}],
        monitors => [{starl_mutex_monitor, Judge}]
    }}.

init(Robot, #{work := Seconds} = Options) ->
    {Options, starl:now(Robot) + Seconds * 1000, 0}.

step(Robot, {Options, Until, Count}) ->
    case starl:now(Robot) >= Until of
        true -> {done, Count};
        false -> {continue, {Options, Until, Count + turn(Robot, Options)}}
    end.

turn(Robot, #{hold := Hold, pause := Pause, patience := Patience} = Options) ->
    Tokens = choose(Robot, Options),
    Got =
        case starl_mutex:acquire(Robot, Tokens, Patience) of
            {ok, _} ->
                starl:sleep(Robot, within(Robot, Hold)),
                case starl_mutex:release(Robot, Tokens) of
                    ok -> 1;
                    {error, _} -> 0
                end;
            {error, _} ->
                0
        end,
    starl:sleep(Robot, within(Robot, Pause)),
    Got.

choose(Robot, #{tokens := N, sets := Sets}) ->
    case within(Robot, Sets) of
        1 -> {token, within(Robot, N)};
        Size -> [{token, within(Robot, N)} || _ <- lists:seq(1, Size)]
    end.

within(Robot, N) -> 1 + trunc(starl:random(Robot) * N).
