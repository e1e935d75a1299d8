%% @doc Robots that send numbers to each other for ever, one by one in both directions. A robot that
%% restarts goes on where it was.
-module(starl_hostile_traffic).
-behaviour(starl_app).

-export([options/0, blocks/0, init/2, step/2]).

%% The pause between two rounds, ms.
-define(PAUSE_MS, 20).

-spec options() -> [].
options() -> [].

-spec blocks() -> [].
blocks() -> [].

-spec init(starl:robot(), map()) -> pos_integer().
init(Robot, _Options) ->
    starl:listen(Robot, number),
    case starl:stored(Robot) of
        {stored, N} -> N;
        _ -> 1
    end.

-spec step(starl:robot(), pos_integer()) -> {continue, pos_integer()}.
step(Robot, N) ->
    _ = starl:store(Robot, N + 1),
    _ = starl:broadcast(Robot, number, N),
    read(Robot, ?PAUSE_MS),
    {continue, N + 1}.

read(Robot, Ms) ->
    case starl:await(Robot, number, Ms) of
        {ok, _, _} -> read(Robot, 0);
        timeout -> ok
    end.
