%% @doc Location: the positions of all robots and the named waypoints.
%%
%% The only machine that asks the positioning system (`sense'); everybody else asks it. Calls:
%% `{pose, Robot}' (answer `{ok, pose()}' or `{error, unknown}'), `poses' (all robots seen),
%% `{waypoint, Name}', `waypoints'. Configuration: `waypoints => #{Name => point()}'.
-module(starl_location).
-behaviour(starl_machine).

-export([pose/2]).
-export([init/1, handle_event/5]).

-record(location, {
    participants :: starl_team:t(),
    waypoints :: #{atom() => starl_geometry:point()},
    %% who waits for the positioning system, oldest first
    asked = [] :: [{starl_machine:from(), {pose, starl:robot_id()} | poses}]
}).

%% @doc The action that asks for a robot's pose; the answer is the event `{reply, Tag}'.
-spec pose(starl:robot_id(), starl_machine:tag()) -> starl_machine:action().
pose(Robot, Tag) -> {call, location, {pose, Robot}, Tag}.

-spec init(starl_machine:config()) -> {ready, #location{}, []}.
init(#{participants := Participants} = Config) ->
    Waypoints = maps:get(waypoints, Config, #{}),
    {ready, #location{participants = Participants, waypoints = Waypoints}, []}.

-spec handle_event(
    starl_machine:event_type(), term(), ready, #location{}, starl_machine:meta()
) -> starl_machine:result().
handle_event({call, From}, {pose, Robot} = Question, ready, Location, _Meta) ->
    ask(From, Question, [Robot], Location);
handle_event(info, {located, Poses}, ready, #location{asked = [Asked | Rest]} = Location, _) ->
    {From, Question} = Asked,
    {keep_state, Location#location{asked = Rest}, [{reply, From, answer(Question, Poses)}]};
handle_event({call, From}, poses, ready, #location{participants = Participants} = Location, _) ->
    ask(From, poses, starl_team:members(Participants), Location);
handle_event({call, From}, {waypoint, Name}, ready, #location{waypoints = Waypoints}, _Meta) ->
    Answer =
        case Waypoints of
            #{Name := Point} -> {ok, Point};
            #{} -> {error, unknown}
        end,
    {keep_state_and_data, [{reply, From, Answer}]};
handle_event({call, From}, waypoints, ready, #location{waypoints = Waypoints}, _Meta) ->
    {keep_state_and_data, [{reply, From, {ok, Waypoints}}]};
handle_event(info, {restarted, _}, ready, _Location, _Meta) ->
    keep_state_and_data;
handle_event(_, _, _, _, _) ->
    unknown_event.

ask(From, Question, Robots, #location{asked = Asked} = Location) ->
    {keep_state, Location#location{asked = Asked ++ [{From, Question}]}, [{sense, Robots}]}.

answer(poses, Poses) ->
    {ok, maps:from_list(Poses)};
answer({pose, Robot}, Poses) ->
    case lists:keyfind(Robot, 1, Poses) of
        {Robot, Pose} -> {ok, Pose};
        false -> {error, unknown}
    end.
