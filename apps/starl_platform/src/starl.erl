%% @doc The API that an application sees (the paper's Table of primitives).
%%
%% An application's message types are its own: they never clash with the types that building blocks
%% send, even under the same name.
%%
%% All functions are called in the application's own process, from `Module:init/2' or
%% `Module:step/2' of a {@link starl_app}. Positions are in millimetres, headings in radians,
%% durations in whole milliseconds. An invalid argument (`starl:sleep(Robot, 0.5)') is the
%% caller's mistake: the call fails with the error {@link starl_caller:mistake()}, and only the
%% application crashes. So is a message that could not travel to another robot, or a term that could
%% not be kept ({@link starl_payload}). The building blocks have their own interfaces
%% (`starl_election', `starl_dpp', …), built on {@link call/4}.
-module(starl).
-compile({no_auto_import, [floor/1]}).

-export([id/1, participants/1, now/1, random/1, choice/2, normal/3, shuffle/2]).
-export([send/4, post/4, broadcast/3, shout/3, listen/2, await/2, await/3]).
-export([position/1, position/2, positions/1, neighbours/2]).
-export([floor/1, waypoint/2, waypoints/1, put_waypoint/3, sense/2, watch/3]).
-export([
    go_to/2, go_around/2, velocity/3, stop/1, sleep/2, actuate/3, trace/2, store/2, stored/1, call/4
]).
-export([measure/3, draw/2]).
-export([robot/2]).

-export_type([robot/0, robot_id/0, pose/0, goal/0, outcome/0, neighbour/0]).

%% Robots are numbered from 1.
-type robot_id() :: pos_integer().

%% Position and heading: millimetres, radians counter-clockwise from the x axis.
-type pose() :: {X :: float(), Y :: float(), Heading :: float()}.

%% A point of the floor, or the name of a waypoint.
-type goal() :: starl_geometry:point() | atom().

%% Another robot nearby: its pose, the way to it along the axes of the floor, and how far that is (mm).
-type neighbour() :: #{
    robot := robot_id(),
    pose := pose(),
    offset := {DX :: float(), DY :: float()},
    distance := float()
}.

%% Why a message may not have arrived. `lost': no acknowledgement after the last retransmission; the
%% message may have been delivered all the same. `restarted': the receiver's or the sender's own SAP
%% restarted; likewise. `overload': too many messages are under way; the message was not sent.
-type outcome() :: ok | {error, lost | restarted | overload}.

-record(robot, {id :: robot_id(), team :: starl_team:t()}).

%% A team of so many robots at most is looked at as a whole when a robot asks who is near.
-define(SMALL_TEAM, 64).

%% The robot that an application runs on.
-opaque robot() :: #robot{}.

%% @doc The robot's own number.
-spec id(robot()) -> robot_id().
id(#robot{id = Id}) -> Id.

%% @doc All robots of the team, this one included, in ascending order.
-spec participants(robot()) -> [robot_id()].
participants(#robot{team = Team}) -> starl_team:members(Team).

%% @doc The robot's own clock in milliseconds; the clocks of two robots differ.
-spec now(robot()) -> integer().
now(#robot{}) -> starl_app_proc:now() div 1000.

%% @doc A number in `0.0 =< X < 1.0', from the seed of the run.
-spec random(robot()) -> float().
random(#robot{}) -> starl_app_proc:random().

%% @doc A random item of the list, each with the same probability, from the seed of the run.
-spec choice(robot(), [Item, ...]) -> Item.
choice(#robot{} = Robot, Items) ->
    ok = starl_caller:check({?MODULE, choice, 2}, 'Items', items, Items),
    lists:nth(1 + trunc(random(Robot) * length(Items)), Items).

%% @doc A random number of the normal distribution with this mean and standard deviation, from the
%% seed of the run (by Box and Muller's method).
-spec normal(robot(), Mean :: number(), Deviation :: number()) -> float().
normal(#robot{} = Robot, Mean, Deviation) ->
    ok = starl_caller:check({?MODULE, normal, 3}, 'Mean', value, Mean),
    ok = starl_caller:check({?MODULE, normal, 3}, 'Deviation', deviation, Deviation),
    %% the logarithm of 0 is none
    Radius = math:sqrt(-2 * math:log(1.0 - random(Robot))),
    Mean + Deviation * Radius * math:cos(2 * math:pi() * random(Robot)).

%% @doc The items in a random order, each order with the same probability, from the seed of the run.
-spec shuffle(robot(), [Item]) -> [Item].
shuffle(#robot{} = Robot, Items) ->
    ok = starl_caller:check({?MODULE, shuffle, 2}, 'Items', list, Items),
    [Item || {_, Item} <- lists:keysort(1, [{random(Robot), Item} || Item <- Items])].

%% @doc Sends a message reliably (SAP) and waits for its outcome.
-spec send(robot(), robot_id(), Type :: atom(), Body :: term()) -> outcome().
send(#robot{} = Robot, To, Type, Body) ->
    ok = starl_caller:check({?MODULE, send, 4}, 'To', robot, To),
    ok = starl_caller:check({?MODULE, send, 4}, 'Type', name, Type),
    ok = starl_caller:payload({?MODULE, send, 4}, 'Body', content, Body),
    flatten(call(Robot, sap, {send, To, {app, Type}, Body}, infinity)).

%% @doc Sends a message reliably and does not wait; its outcome is only traced.
-spec post(robot(), robot_id(), Type :: atom(), Body :: term()) -> ok.
post(#robot{}, To, Type, Body) ->
    ok = starl_caller:check({?MODULE, post, 4}, 'To', robot, To),
    ok = starl_caller:check({?MODULE, post, 4}, 'Type', name, Type),
    ok = starl_caller:payload({?MODULE, post, 4}, 'Body', content, Body),
    starl_app_proc:perform([{cast, sap, {send, To, {app, Type}, Body}}]).

%% @doc Sends a message reliably to all other robots and waits for every outcome.
-spec broadcast(robot(), Type :: atom(), Body :: term()) ->
    ok | {error, restarted | overload | {lost, [robot_id()]}}.
broadcast(#robot{} = Robot, Type, Body) ->
    ok = starl_caller:check({?MODULE, broadcast, 3}, 'Type', name, Type),
    ok = starl_caller:payload({?MODULE, broadcast, 3}, 'Body', content, Body),
    flatten(call(Robot, sap, {broadcast, {app, Type}, Body}, infinity)).

%% @doc Tells all robots within the radio's range something, in one packet, and does not wait. The
%% packet is neither acknowledged nor repeated: it may be lost, and it may arrive twice. This is the
%% cheapest message, for what is said again and again, such as a robot's own state. Those who listen
%% to the type get it like any other message, except that what finds no room is dropped.
-spec shout(robot(), Type :: atom(), Body :: term()) -> ok.
shout(#robot{}, Type, Body) ->
    ok = starl_caller:check({?MODULE, shout, 3}, 'Type', name, Type),
    ok = starl_caller:payload({?MODULE, shout, 3}, 'Body', content, Body),
    starl_app_proc:perform([{cast, sap, {shout, {app, Type}, Body}}]).

%% @doc Listens to a type: from now on the application receives its messages ({@link await/2}).
-spec listen(robot(), Type :: atom()) -> ok.
listen(#robot{}, Type) ->
    ok = starl_caller:check({?MODULE, listen, 2}, 'Type', name, Type),
    starl_app_proc:listen({app, Type}).

%% @doc Waits for a message of this type.
-spec await(robot(), Type :: atom()) -> {ok, From :: robot_id(), Body :: term()}.
await(#robot{}, Type) ->
    ok = starl_caller:check({?MODULE, await, 2}, 'Type', name, Type),
    {ok, {From, _, Body}} = starl_app_proc:await(types(Type), infinity),
    {ok, From, Body}.

%% @doc Waits for a message of this type, for at most the given milliseconds.
-spec await(robot(), Type :: atom(), Ms :: non_neg_integer()) ->
    {ok, From :: robot_id(), Body :: term()} | timeout.
await(#robot{}, Type, Ms) ->
    ok = starl_caller:check({?MODULE, await, 3}, 'Type', name, Type),
    ok = starl_caller:check({?MODULE, await, 3}, 'Ms', ms, Ms),
    case starl_app_proc:await(types(Type), Ms * 1000) of
        {ok, {From, _, Body}} -> {ok, From, Body};
        timeout -> timeout
    end.

%% A block that delivers messages to the application, such as geocast, uses the plain type.
types(Type) -> [{app, Type}, Type].

%% @doc The robot's own position.
-spec position(robot()) -> {ok, pose()} | {error, restarted | unknown}.
position(#robot{id = Id} = Robot) -> position(Robot, Id).

%% @doc The position of another robot, as the positioning system last saw it.
-spec position(robot(), robot_id()) -> {ok, pose()} | {error, restarted | unknown}.
position(#robot{} = Robot, Id) ->
    ok = starl_caller:check({?MODULE, position, 2}, 'Id', robot, Id),
    flatten(call(Robot, location, {pose, Id}, infinity)).

%% @doc The positions of all robots that the positioning system sees. `unknown': it gives no answer.
-spec positions(robot()) ->
    {ok, #{robot_id() => pose()}} | {error, restarted | unknown}.
positions(#robot{} = Robot) -> flatten(call(Robot, location, poses, infinity)).

%% @doc The robots at most this far away (mm), nearest first, as the positioning system sees them. A
%% single picture shows them and the robot itself. `offset' has the axes of {@link velocity/3}: a
%% robot drives towards a neighbour if it takes its offset, scaled, as its velocity.
-spec neighbours(robot(), WithinMm :: number()) ->
    {ok, [neighbour()]} | {error, restarted | unknown}.
neighbours(#robot{id = Id} = Robot, Within) ->
    ok = starl_caller:check({?MODULE, neighbours, 2}, 'WithinMm', distance, Within),
    case near(Robot, Within) of
        {ok, #{Id := {X, Y, _}} = Poses} ->
            Others = lists:sort(maps:to_list(maps:remove(Id, Poses))),
            All = [neighbour({X, Y}, Other) || Other <- Others],
            Near = [{Mm, One} || #{distance := Mm} = One <- All, Mm =< Within],
            {ok, [One || {_, One} <- lists:keysort(1, Near)]};
        {ok, #{}} ->
            {error, unknown};
        {error, _} = Error ->
            Error
    end.

%% A small team is looked at as a whole.
near(#robot{team = Team} = Robot, Within) ->
    case starl_team:count(Team) > ?SMALL_TEAM of
        true -> flatten(call(Robot, location, {near, Within}, infinity));
        false -> positions(Robot)
    end.

neighbour({X0, Y0}, {Robot, {X, Y, _} = Pose}) ->
    {DX, DY} = Offset = {X - X0, Y - Y0},
    Distance = math:sqrt(DX * DX + DY * DY),
    #{robot => Robot, pose => Pose, offset => Offset, distance => Distance}.

%% @doc A named waypoint.
-spec waypoint(robot(), Name :: atom()) ->
    {ok, starl_geometry:point()} | {error, restarted | unknown}.
waypoint(#robot{} = Robot, Name) ->
    ok = starl_caller:check({?MODULE, waypoint, 2}, 'Name', name, Name),
    flatten(call(Robot, location, {waypoint, Name}, infinity)).

%% @doc All named waypoints.
-spec waypoints(robot()) -> {ok, #{atom() => starl_geometry:point()}} | {error, restarted}.
waypoints(#robot{} = Robot) -> flatten(call(Robot, location, waypoints, infinity)).

%% @doc Defines a named waypoint, or replaces it, for this robot only. The robot keeps it over
%% restarts and reboots. `full': it has already defined 1,000.
-spec put_waypoint(robot(), Name :: atom(), starl_geometry:point()) ->
    ok | {error, full | restarted}.
put_waypoint(#robot{} = Robot, Name, Point) ->
    ok = starl_caller:check({?MODULE, put_waypoint, 3}, 'Name', name, Name),
    ok = starl_caller:check({?MODULE, put_waypoint, 3}, 'Point', point, Point),
    flatten(call(Robot, location, {put_waypoint, Name, Point}, infinity)).

%% @doc The floor plan of the run: its size, walls, rooms, doors and places. Without a plan, it is
%% an empty floor of the run's size. The places are waypoints, too.
-spec floor(robot()) -> {ok, starl_floor:t()} | {error, unknown | restarted}.
floor(#robot{} = Robot) -> flatten(call(Robot, location, floor, infinity)).

%% @doc Reads a sense ({@link starl_sense}): `bump', `range', `bearing', `camera', `light' or
%% `battery'. The answer is the present reading. `gone': the sense does not answer; `unknown': the
%% robot has no such sense.
-spec sense(robot(), starl_sense:kind()) ->
    {ok, Reading :: term()} | {error, gone | unknown | restarted}.
sense(#robot{} = Robot, Kind) ->
    ok = starl_caller:check({?MODULE, sense, 2}, 'Kind', sense, Kind),
    flatten(call(Robot, location, {sense, Kind}, infinity)).

%% @doc Reads a sense periodically, every so many milliseconds from now on. Each time that the
%% reading has changed, the application gets the message `{Kind, Reading}' of type `sense' from its
%% own robot: `{ok, _, {camera, Blobs}} = starl:await(Robot, sense)'.
-spec watch(robot(), starl_sense:kind(), Ms :: pos_integer()) -> ok.
watch(#robot{}, Kind, Ms) ->
    ok = starl_caller:check({?MODULE, watch, 3}, 'Kind', sense, Kind),
    ok = starl_caller:check({?MODULE, watch, 3}, 'Ms', positive_ms, Ms),
    starl_app_proc:perform([{cast, location, {subscribe, Kind, us(Ms)}}]).

%% @doc Drives in a straight line to a point or a named waypoint and waits for the arrival.
%% While it drives, the robot keeps within r(v) of the line (Assumption II.1 of the paper;
%% {@link starl_chassis:tracking_radius/1}). `stopped': another command came first.
-spec go_to(robot(), goal()) -> ok | {error, stopped | restarted | unknown}.
go_to(#robot{} = Robot, Name) when is_atom(Name) ->
    case waypoint(Robot, Name) of
        {ok, Point} -> go_to(Robot, Point);
        {error, _} = Error -> Error
    end;
go_to(#robot{} = Robot, Point) ->
    ok = starl_caller:check({?MODULE, go_to, 2}, 'Goal', point, Point),
    flatten(call(Robot, motion, {go_to, Point}, infinity)).

%% @doc Drives to a point or a named waypoint around the walls of the floor plan, and waits for the
%% arrival. The path ({@link starl_floor_path:find/3}) keeps the body and its r(v) clear of all walls, so
%% the robot touches none. Without a plan this is {@link go_to/2}.
%%
%% `unreachable': no passage is wide enough, or a wall is too near to the point. `blocked': the robot
%% has run three times against something that the plan does not show: a closed door, an obstacle,
%% another robot. Nothing keeps two robots apart here; path planning does ({@link starl_dpp}).
-spec go_around(robot(), goal()) ->
    ok | {error, unreachable | blocked | stopped | restarted | unknown}.
go_around(#robot{} = Robot, Name) when is_atom(Name) ->
    case waypoint(Robot, Name) of
        {ok, Point} -> go_around(Robot, Point);
        {error, _} = Error -> Error
    end;
go_around(#robot{} = Robot, Point) ->
    ok = starl_caller:check({?MODULE, go_around, 2}, 'Goal', point, Point),
    case flatten(call(Robot, motion, wall_mm, infinity)) of
        {ok, none} -> go_to(Robot, Point);
        {ok, Mm} -> go_around(Robot, Point, Mm);
        {error, _} = Error -> Error
    end.

go_around(Robot, To, Mm) ->
    case {floor(Robot), position(Robot)} of
        {{ok, Floor}, {ok, {X, Y, _}}} ->
            follow(Robot, starl_floor_path:find({{X, Y}, To}, Mm, Floor));
        {{error, _} = Error, _} ->
            Error;
        {_, {error, _} = Error} ->
            Error
    end.

follow(Robot, {ok, [Point | Points]}) ->
    case flatten(call(Robot, motion, {go_to, Point, until_blocked}, infinity)) of
        ok when Points =:= [] -> ok;
        ok -> follow(Robot, {ok, Points});
        {error, _} = Error -> Error
    end;
follow(_Robot, {error, _} = Error) ->
    Error.

%% @doc Drives with a velocity, in mm/s along the axes of the floor, until another command comes,
%% for at most the given milliseconds: the dead-man's time. It does not wait. The robot gets its
%% whole script at once, so it stops by itself at the end of that time, even if its program has
%% crashed. A program that wants to drive on calls this function again within the time.
%%
%% A faster velocity than the robot can drive is taken at the robot's own limit. A holonomic robot
%% takes the velocity up as it is; a robot with two wheels turns towards it while it drives
%% ({@link starl_chassis_differential:cruise/4}). Nothing keeps two robots apart here: that is up to the program.
%%
%% `stalled': a drive does not obey, and the robot stands; `unknown': there is no position, and it
%% stops; `stopped': another command came first. A {@link go_to/2} ends a velocity, and the other
%% way about: the later call wins.
-spec velocity(robot(), {VX :: number(), VY :: number()}, Ms :: pos_integer()) ->
    ok | {error, stopped | stalled | restarted | unknown}.
velocity(#robot{} = Robot, Velocity, Ms) ->
    ok = starl_caller:check({?MODULE, velocity, 3}, 'Velocity', velocity, Velocity),
    ok = starl_caller:check({?MODULE, velocity, 3}, 'Ms', positive_ms, Ms),
    flatten(call(Robot, motion, {velocity, Velocity, us(Ms)}, infinity)).

%% @doc Stops the robot and waits until it stands.
-spec stop(robot()) -> ok | {error, stopped | restarted}.
stop(#robot{} = Robot) ->
    case flatten(call(Robot, motion, stop, infinity)) of
        %% it stands; that the clocks do not agree matters to leases only
        {error, out_of_time} -> ok;
        Answer -> Answer
    end.

%% @doc Waits for this time by the robot's own clock.
-spec sleep(robot(), Ms :: non_neg_integer()) -> ok.
sleep(#robot{}, Ms) ->
    ok = starl_caller:check({?MODULE, sleep, 2}, 'Ms', ms, Ms),
    starl_app_proc:sleep(Ms * 1000).

%% @doc Sets an actuator: `starl:actuate(Robot, pen, down)'.
-spec actuate(robot(), Device :: atom(), Value :: term()) -> ok.
actuate(#robot{}, Device, Value) ->
    ok = starl_caller:check({?MODULE, actuate, 3}, 'Device', name, Device),
    starl_app_proc:perform([{actuate, Device, Value}]).

%% @doc Records an event for the monitors.
-spec trace(robot(), Event :: term()) -> ok.
trace(#robot{}, Event) -> starl_app_proc:perform([{trace, Event}]).

%% @doc Records the present value of a quantity, such as an error in mm. All values of a run are in
%% `measures.csv' and `measures.svg' of its results, and on the topic `/measures' of its recording.
%% The report and sweeps show their median and range ({@link starl_app}: `measures/0').
-spec measure(robot(), Key :: atom(), Value :: number()) -> ok.
measure(#robot{}, Key, Value) ->
    ok = starl_caller:check({?MODULE, measure, 3}, 'Key', key, Key),
    ok = starl_caller:check({?MODULE, measure, 3}, 'Value', value, Value),
    starl_app_proc:perform([{trace, {measure, Key, Value}}]).

%% @doc Draws points, a line, an area or a text on the floor, for people who watch the run in the
%% window, in its film or in its recording. It has no influence on anything.
%% ```
%%   starl:draw(Robot, #{key => way, line => [{0, 0}, {1000, 500}]}),
%%   starl:draw(Robot, #{key => said, text => "leader", at => {500, 500}, seconds => 5})
%% '''
%% What a robot draws takes the place of what it has drawn before under the same key, and goes by
%% itself after `seconds', if that is given ({@link starl_drawing}).
-spec draw(robot(), starl_drawing:shape()) -> ok.
draw(#robot{}, Shape) ->
    case starl_drawing:new(Shape) of
        {ok, Drawing} ->
            starl_app_proc:perform([{trace, {draw, Drawing}}]);
        {error, Expected} ->
            starl_caller:mistake({?MODULE, draw, 2}, 'Shape', Shape, Expected)
    end.

%% @doc Stores a term durably, over a crash of the application and a reboot of the robot. It
%% replaces the term stored before. Later actions of the application take place only when the term
%% is durable. If it cannot be written, the application crashes instead, when it next blocks.
-spec store(robot(), term()) -> ok.
store(#robot{}, Term) ->
    ok = starl_caller:payload({?MODULE, store, 2}, 'Term', kept, Term),
    starl_app_proc:store(Term).

%% @doc The term that was stored last; `none': nothing was ever stored; `damaged': it is unreadable.
-spec stored(robot()) -> none | {stored, term()} | damaged.
stored(#robot{}) -> starl_app_proc:stored().

%% @doc Calls a machine of this robot; the building blocks' interfaces are built on it. The answer
%% is `late' if the machine granted something for a time, and that time has already run out
%% ({@link starl_machine:from()}).
-spec call(robot(), starl_machine:name(), Request :: term(), Ms :: pos_integer() | infinity) ->
    {ok, Answer :: term()} | {error, timeout | restarted}.
call(#robot{}, Name, Request, Ms) ->
    ok = starl_caller:check({?MODULE, call, 4}, 'Name', name, Name),
    ok = starl_caller:check({?MODULE, call, 4}, 'Ms', ms_or_infinity, Ms),
    starl_app_proc:call(Name, Request, us(Ms)).

%% @private Only the runtime makes handles.
-spec robot(robot_id(), starl_team:t()) -> robot().
robot(Id, Team) -> #robot{id = Id, team = Team}.

us(infinity) -> infinity;
us(Ms) -> Ms * 1000.

flatten({ok, Answer}) -> Answer;
flatten({error, _} = Error) -> Error.
