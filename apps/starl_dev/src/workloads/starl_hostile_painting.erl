%% @doc The painting application, with a roll call at its end: each robot asks all others for an
%% acknowledgement. Its result is that of the painting if all have answered, else the robots that
%% have not.
-module(starl_hostile_painting).
-behaviour(starl_app).
-behaviour(starl_scene).

-export([init/2, step/2]).
-export([options/0, scene/1, preview/1, report/2]).

%% The calls before a robot is given up.
-define(CALLS, 5).

-type state() ::
    {paint, Painting :: term()} | {call, Left :: non_neg_integer(), complete | incomplete}.

-spec init(starl:robot(), none) -> {paint, Painting :: term()}.
init(Robot, none) ->
    starl:listen(Robot, present),
    {paint, starl_painting:init(Robot, none)}.

-spec step(starl:robot(), state()) -> {continue, state()} | {done, term()}.
step(Robot, {paint, Painting}) ->
    case starl_painting:step(Robot, Painting) of
        {continue, Next} -> {continue, {paint, Next}};
        {done, Result} -> {continue, {call, ?CALLS, Result}}
    end;
step(Robot, {call, Left, Result}) ->
    case starl:broadcast(Robot, present, Left) of
        ok -> {done, Result};
        {error, Why} when Left =:= 0 -> {done, {unheard, Why}};
        {error, _} -> {continue, {call, Left - 1, Result}}
    end.

-spec options() -> [starl_options:option()].
options() -> starl_painting:options().

-spec scene(starl_scene:context()) -> {ok, starl_scene:t()} | {error, unicode:chardata()}.
scene(Context) ->
    case starl_painting:scene(Context) of
        {ok, Scene} -> {ok, Scene#{app := {sequential, ?MODULE, none}}};
        {error, _} = Error -> Error
    end.

-spec preview(starl_scene:t()) -> starl_scene:preview().
preview(Scene) -> starl_painting:preview(Scene).

-spec report(starl_scene:t(), starl_scene:outcome()) -> starl_scene:report().
report(Scene, Outcome) -> starl_painting:report(Scene, Outcome).
