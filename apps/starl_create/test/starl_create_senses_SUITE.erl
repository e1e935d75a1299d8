%% What a Create feels, in a live run: it reaches the application and the trace; a robot whose application
%% is done rests. This module is the application, too: it waits for a button, plays a song, and is done.
-module(starl_create_senses_SUITE).
-include_lib("stdlib/include/assert.hrl").

-export([suite/0, all/0, a_button_is_felt/1]).
-export([init/2, step/2]).

%% A guard against waiting for ever.
-define(AFTER_MS, 20000).

suite() -> [{timetrap, {seconds, 90}}].

all() -> [a_button_is_felt].

init(Robot, _) -> starl:listen(Robot, sense).

step(Robot, _) ->
    {ok, Own, {buttons, Bits}} = starl:await(Robot, sense),
    starl:actuate(Robot, song, [{60, 16}]),
    {done, {Own, Bits}}.

a_button_is_felt(Config) ->
    Self = self(),
    Open = fun(Create, _Model) ->
        Self ! {create, Create},
        {{starl_create_pipe, #{}}, Create}
    end,
    Lines = starl_create:emulated([create], Open),
    Chassis = fun(Robot, World) ->
        {Module, Options} = Lines(Robot, World),
        {Module, Options#{events => Self}}
    end,
    Observer = fun(News) ->
        Self ! {news, News},
        ok
    end,
    Scenario = #{app => ?MODULE, robots => 1, chassis => [create]},
    {ok, Run} = starl_world_run:start(Scenario, #{
        dir => proplists:get_value(priv_dir, Config), chassis => Chassis, observe => Observer
    }),
    receive
        {starl_create, 1, ready} -> ok
    after ?AFTER_MS -> error(not_ready)
    end,
    Create =
        receive
            {create, Pid} -> Pid
        after ?AFTER_MS -> error(no_create)
        end,
    ok = starl_create_emulated:feel(Create, {readings, #{buttons => 1}}),
    ?assertEqual(done, starl_world_run:await(Run)),
    receive
        {starl_create, 1, lost} -> rests(Create)
    after ?AFTER_MS -> error(does_not_rest)
    end,
    {#{robots := [{1, #{result := Result}}]}, _} = starl_world_run:finish(Run),
    ?assertEqual({done, {1, 1}}, Result),
    sensed({buttons, 1}).

%% The bytes are on their way.
rests(Create) ->
    case starl_create_emulated:mode(Create) of
        passive ->
            ok;
        _ ->
            erlang:yield(),
            rests(Create)
    end.

%% The fact is in the trace.
sensed(Sense) ->
    receive
        {news, {judged, Events, _}} ->
            case [S || {_, 1, chassis, {sensed, S}} <- Events, S =:= Sense] of
                [] -> sensed(Sense);
                [_] -> ok
            end
    after ?AFTER_MS -> error(not_traced)
    end.
