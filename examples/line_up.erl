%% The team elects a leader; the leader tells every robot its place in a line.
-module(line_up).
-behaviour(starl_app).
-export([blocks/0, init/2, step/2]).

blocks() -> [starl_election].

init(Robot, _Options) ->
    starl:listen(Robot, place),
    elect.

step(Robot, elect) ->
    case starl_election:elect(Robot, first) of
        {ok, Leader} -> {continue, {led_by, Leader}};
        {error, _} -> {continue, elect}
    end;
step(Robot, {led_by, Leader}) ->
    case starl:id(Robot) of
        Leader ->
            [starl:post(Robot, R, place, {1500.0 * R, 6000.0}) || R <- starl:participants(Robot)];
        _ ->
            wait
    end,
    {ok, Leader, Place} = starl:await(Robot, place),
    ok = starl:go_to(Robot, Place),
    {done, Place}.
