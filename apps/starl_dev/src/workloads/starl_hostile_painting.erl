%% @doc The painting application, with a roll call at its end: each robot asks all others for an
%% acknowledgement. It returns the result of the painting if all have answered, else the robots that
%% have not.
-module(starl_hostile_painting).
-behaviour(starl_app).
-behaviour(starl_scene).

-export([init/2, step/2]).
-export([options/0, scene/1, preview/1, report/2]).

%% What is painted with; its scene names the program of each robot.
-define(PAINTING, starl_painting).
%% The calls before a robot is given up.
-define(CALLS, 5).

%% The program that paints, and its argument.
-type program() :: {module(), Argument :: term()}.

-type state() ::
    {paint, module(), Painting :: term()}
    | {call, Left :: non_neg_integer(), complete | incomplete}.

-spec init(starl:robot(), program()) -> {paint, module(), Painting :: term()}.
init(Robot, {Program, Argument}) ->
    starl:listen(Robot, present),
    {paint, Program, Program:init(Robot, Argument)}.

-spec step(starl:robot(), state()) -> {continue, state()} | {done, term()}.
step(Robot, {paint, Program, Painting}) ->
    case Program:step(Robot, Painting) of
        {continue, Next} -> {continue, {paint, Program, Next}};
        {done, Result} -> {continue, {call, ?CALLS, Result}}
    end;
step(Robot, {call, Left, Result}) ->
    case starl:broadcast(Robot, present, Left) of
        ok -> {done, Result};
        {error, Why} when Left =:= 0 -> {done, {unheard, Why}};
        {error, _} -> {continue, {call, Left - 1, Result}}
    end.

-spec options() -> [starl_options:option()].
options() -> starl_app:options(?PAINTING).

-spec scene(starl_scene:context()) -> {ok, starl_scene:t()} | {error, unicode:chardata()}.
scene(Context) ->
    case starl_scene:make(?PAINTING, Context) of
        {ok, #{app := {sequential, Program, Argument}} = Scene} ->
            {ok, Scene#{app := {sequential, ?MODULE, {Program, Argument}}}};
        {error, _} = Error ->
            Error
    end.

-spec preview(starl_scene:t()) -> starl_scene:preview().
preview(Scene) -> starl_scene:preview(?PAINTING, Scene).

-spec report(starl_scene:t(), starl_scene:outcome()) -> starl_scene:report().
report(Scene, Outcome) -> starl_scene:report(?PAINTING, Scene, Outcome).
