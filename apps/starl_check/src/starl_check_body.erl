%% @doc The body of a checked robot, in place of motion control and location. The robot stands still
%% at its own place, and all robots see it there. Answers come at once.
-module(starl_check_body).
-behaviour(starl_machine).

-export([init/1, handle_event/5]).

-spec init(starl_machine:config()) -> {standing, none, []}.
init(_Config) -> {standing, none, []}.

-spec handle_event(starl_machine:event_type(), term(), standing, none, starl_machine:meta()) ->
    starl_machine:result().
handle_event({call, From}, {pose, Robot}, standing, none, _Meta) ->
    {X, Y} = at(Robot),
    {keep_state_and_data, [{reply, From, {ok, {X, Y, 0.0}}}]};
handle_event({call, From}, stop, standing, none, _Meta) ->
    {keep_state_and_data, [{reply, From, ok}]};
handle_event(cast, stop, standing, none, _Meta) ->
    keep_state_and_data;
handle_event(info, {restarted, _}, standing, none, _Meta) ->
    keep_state_and_data;
handle_event(_, _, _, _, _) ->
    unknown_event.

%% The place of a robot.
-spec at(starl:robot_id()) -> starl_geometry:point().
at(Robot) -> {1000.0 * starl_check_term:number(Robot), 0.0}.
