%% An application for the tests of barriers: all robots go through so many rounds of two names
%% in turn, with pauses between, and call again when a call fails. When it begins anew it goes on
%% where its robot is.
-module(starl_barrier_app).
-behaviour(starl_app).
-behaviour(starl_scene).

-export([options/0, scene/1, init/2, step/2]).

options() ->
    [
        {rounds, {integer, 1, 100000}, 10, "rounds of each name"},
        {names, {term, "two names", fun is_list/1}, [odd, even], "for the rounds in turn"},
        {pause, {integer, 1, 100000}, 400, "longest pause before a round, ms"},
        {patience, {integer, 1, 1000000}, 5000, "patience, ms"},
        {machine, {term, "a machine", fun is_atom/1}, starl_barrier_rounds, "the implementation"},
        {config, {term, "a map", fun is_map/1}, #{}, "its configuration"},
        {judge, {term, "a map", fun is_map/1}, #{}, "the monitor's configuration"}
    ].

scene(#{robots := Robots, options := #{machine := Machine, config := Config} = Options}) ->
    {ok, #{
        app => {sequential, ?MODULE, Options},
        blocks => [{barrier, Machine, Config}],
        monitors => [{starl_barrier_monitor, (maps:get(judge, Options))#{robots => Robots}}]
    }}.

init(_Robot, Options) -> {Options, anew, 0}.

step(Robot, {#{names := Names} = Options, anew, Failed}) ->
    case done(Robot, lists:usort(Names), 0) of
        {ok, Done} ->
            {continue, {Options, Done + 1, Failed}};
        {error, _} ->
            starl:sleep(Robot, 100),
            {continue, {Options, anew, Failed + 1}}
    end;
step(_Robot, {#{rounds := Rounds}, K, Failed}) when K > 2 * Rounds ->
    {done, {2 * Rounds, Failed}};
step(Robot, {#{pause := Pause, patience := Patience, names := Names} = Options, K, Failed}) ->
    starl:sleep(Robot, 1 + trunc(starl:random(Robot) * Pause)),
    case starl_barrier:sync(Robot, lists:nth(1 + K rem 2, Names), Patience) of
        ok ->
            starl:trace(Robot, {synced, K}),
            {continue, {Options, K + 1, Failed}};
        {error, _} ->
            {continue, {Options, K, Failed + 1}}
    end.

%% How many rounds of these names its robot has passed.
done(_Robot, [], Sum) ->
    {ok, Sum};
done(Robot, [Name | Names], Sum) ->
    case starl_barrier:round(Robot, Name) of
        {ok, Round} -> done(Robot, Names, Sum + Round - 1);
        {error, _} = Error -> Error
    end.
