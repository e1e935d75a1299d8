%% @doc Location: the positions of all robots and the named waypoints.
%%
%% The only machine that asks the positioning system (`sense'); everybody else asks it. Calls:
%% `{pose, Robot}' (answer `{ok, pose()}' or `{error, unknown}'), `poses' (all robots seen),
%% `{waypoint, Name}', `waypoints'. Configuration: `waypoints => #{Name => point()}', `exact'
%% (false).
%%
%% A positioning system that has got stuck goes on to show its last picture. No live one measures
%% the same pose twice to the bit: so each picture shows the robot itself too, and one that shows it
%% just as the picture before did is not believed. The first picture has none before it, and is
%% looked at twice. Only a system that is `exact', without any noise, may repeat itself.
%%
%% A system that does not answer is asked again, all that is open, after half a second. No more than
%% some questions a robot are open at a time: beyond that the oldest is answered `{error, unknown}'.
-module(starl_location).
-behaviour(starl_machine).

-export([pose/2]).
-export([init/1, handle_event/5]).

-export_type([event/0]).

%% It traces nothing of its own.
-type event() :: none().

%% How long to wait for the positioning system before asking it again.
-define(PATIENCE_US, 500000).
%% So many questions may be open, and so many more for each robot of the team.
-define(OPEN, 16).
-define(OPEN_A_ROBOT, 2).

-record(location, {
    self :: starl:robot_id(),
    participants :: starl_team:t(),
    waypoints :: #{atom() => starl_geometry:point()},
    exact :: boolean(),
    %% the robot itself in the last picture
    last = none :: starl:pose() | none,
    %% who waits for the positioning system, oldest first; how many may
    asked = [] :: [{starl_machine:from(), {pose, starl:robot_id()} | poses}],
    most :: pos_integer()
}).

%% @doc The action that asks for a robot's pose; the answer is the event `{reply, Tag}'.
-spec pose(starl:robot_id(), starl_machine:tag()) -> starl_machine:action().
pose(Robot, Tag) -> {call, location, {pose, Robot}, Tag}.

-spec init(starl_machine:config()) -> {ready, #location{}, []}.
init(#{robot := Self, participants := Participants} = Config) ->
    Location = #location{
        self = Self,
        participants = Participants,
        waypoints = maps:get(waypoints, Config, #{}),
        exact = maps:get(exact, Config, false),
        most = ?OPEN + ?OPEN_A_ROBOT * starl_team:count(Participants)
    },
    {ready, Location, []}.

-spec handle_event(
    starl_machine:event_type(), term(), ready, #location{}, starl_machine:meta()
) -> starl_machine:result().
handle_event({call, From}, {pose, _} = Question, ready, Location, _Meta) ->
    ask(From, Question, Location);
handle_event(info, {located, Poses}, ready, #location{asked = [Asked | Rest]} = Location, _) ->
    waited(seen(Poses, Asked, Location#location{asked = Rest}));
handle_event(info, {located, _Late}, ready, #location{asked = []}, _Meta) ->
    keep_state_and_data;
handle_event(state_timeout, again, ready, #location{asked = Asked} = Location, _Meta) ->
    Again = [{sense, robots(Question, Location)} || {_, Question} <- Asked],
    {keep_state_and_data, Again ++ [patience()]};
handle_event({call, From}, poses, ready, Location, _Meta) ->
    ask(From, poses, Location);
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

ask(From, Question, #location{asked = Asked, most = Most} = Location) ->
    Sense = {sense, robots(Question, Location)},
    case Asked of
        [] ->
            {keep_state, Location#location{asked = [{From, Question}]}, [Sense, patience()]};
        [{Oldest, _} | Rest] when length(Asked) >= Most ->
            Unknown = {reply, Oldest, {error, unknown}},
            {keep_state, Location#location{asked = Rest ++ [{From, Question}]}, [Unknown, Sense]};
        _ ->
            {keep_state, Location#location{asked = Asked ++ [{From, Question}]}, [Sense]}
    end.

patience() -> {state_timeout, ?PATIENCE_US, again}.

%% The next answer may take as long again.
waited({keep_state, #location{asked = []} = Location, Actions}) ->
    {keep_state, Location, Actions ++ [{state_timeout, cancel}]};
waited({keep_state, Location, Actions}) ->
    {keep_state, Location, Actions ++ [patience()]}.

robots({pose, Self}, #location{self = Self}) -> [Self];
robots({pose, Robot}, #location{self = Self}) -> [Self, Robot];
robots(poses, #location{participants = Participants}) -> starl_team:members(Participants).

seen(Poses, {From, Question}, #location{self = Self, last = Last, exact = Exact} = Location) ->
    case lists:keyfind(Self, 1, Poses) of
        {_, Pose} when not Exact, Last =:= none ->
            ask(From, Question, Location#location{last = Pose});
        {_, Last} when not Exact ->
            {keep_state, Location, [{reply, From, answer(Question, [])}]};
        {_, Pose} ->
            {keep_state, Location#location{last = Pose}, [{reply, From, answer(Question, Poses)}]};
        false ->
            {keep_state, Location, [{reply, From, answer(Question, Poses)}]}
    end.

answer(poses, Poses) ->
    {ok, maps:from_list(Poses)};
answer({pose, Robot}, Poses) ->
    case lists:keyfind(Robot, 1, Poses) of
        {Robot, Pose} -> {ok, Pose};
        false -> {error, unknown}
    end.
