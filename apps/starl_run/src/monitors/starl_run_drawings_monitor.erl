%% @doc Keeps the latest drawings of applications (`starl:draw/2') for the picture of a run. It
%% judges nothing. It keeps only a limited number of drawings.
-module(starl_run_drawings_monitor).
-behaviour(starl_monitor).

-export([init/1, step/2, finish/2, interests/0]).

-type state() :: #{
    {starl:robot_id(), starl_drawing:key()} => {
        AtUs :: integer(), starl:robot_id(), starl_drawing:t()
    }
}.

-define(MOST, 5000).

-spec init(map()) -> state().
init(_Config) -> #{}.

-spec interests() -> [atom()].
interests() -> [app].

-spec step(starl_monitor:trace_event(), state()) -> {ok, state()}.
step({T, Robot, app, {draw, #{key := Key, kind := _} = Drawing}}, State) when
    map_size(State) < ?MOST; is_map_key({Robot, Key}, State)
->
    {ok, State#{{Robot, Key} => {T, Robot, Drawing}}};
step(_, State) ->
    {ok, State}.

%% @doc The drawings that are there at the end, the earliest first.
-spec finish(integer(), state()) ->
    {ok, #{drawings := [{starl:robot_id(), starl_drawing:t()}]}}.
finish(EndUs, State) ->
    Seen = starl_drawing:shown(lists:sort(maps:values(State)), EndUs),
    {ok, #{drawings => [{Robot, Drawing} || {_, To, Robot, Drawing} <- Seen, To >= EndUs]}}.
