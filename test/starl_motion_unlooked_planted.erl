%% Motion that looks where it stands before the first leg of a drive only, and takes itself to be there
%% before each further one. Where it heads it looks each time.
-module(starl_motion_unlooked_planted).
-behaviour(starl_machine).

-export([init/1, handle_event/5]).

init(Config) ->
    {State, Drive, Actions} = starl_motion:init(Config),
    {State, {none, Drive}, Actions}.

handle_event({reply, _} = Type, {ok, Pose}, locating, {none, Drive}, Meta) ->
    handle_event(Type, {ok, Pose}, locating, {Pose, Drive}, Meta);
handle_event({reply, _} = Type, {ok, {_, _, Heading}}, locating, {{X, Y, _} = Pose, Drive}, Meta) ->
    with(Pose, starl_motion:handle_event(Type, {ok, {X, Y, Heading}}, locating, Drive, Meta));
handle_event({call, _} = Type, Command, State, {_, Drive}, Meta) ->
    with(none, starl_motion:handle_event(Type, Command, State, Drive, Meta));
handle_event(Type, Content, State, {Pose, Drive}, Meta) ->
    with(Pose, starl_motion:handle_event(Type, Content, State, Drive, Meta)).

with(Pose, {next_state, State, Drive, Actions}) -> {next_state, State, {Pose, Drive}, Actions};
with(Pose, {keep_state, Drive, Actions}) -> {keep_state, {Pose, Drive}, Actions};
with(Pose, {keep_state, Drive}) -> {keep_state, {Pose, Drive}};
with(_Pose, Same) -> Same.
