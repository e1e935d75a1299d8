%% @doc The motion of a simulated robot as plans and facts: commanded moves, the vehicle's own
%% steps, and contacts with walls and other bodies. On a floor with solid bodies the robot stops
%% where it is blocked. Its bumper notifies the application at the next sensor period, and its next
%% contact is planned. A pure module.
-module(starl_sim_ride).

-export([drive/4, actuate/4, step/3, sense/4]).

-export_type([place/0, step/0, effect/0]).

%% Whose vehicle it is, the present time, the end of the present window, and the world.
-type place() :: {
    starl:robot_id(),
    Now :: starl_sim_queue:time(),
    Until :: starl_sim_queue:time(),
    starl_sim_world:t()
}.

%% What comes to the vehicle: its machines command it no more; a fault of its drive begins or ends; its
%% chassis does a planned step; it touches something, as was planned.
-type step() :: stop | turn_wheels | starl_sim_vehicle:beat() | starl_sim_bodies:touch().

%% Whether the piece of motion has changed or is to be looked at again; the plans; the facts of the
%% chassis, in order.
-type effect() :: {
    moved | same,
    [starl_sim_vehicle:plan() | {Us :: pos_integer(), starl_sim_bodies:touch()}],
    Facts :: [term()],
    starl_sim_vehicle:t()
}.

%% @doc A machine gives the chassis a script.
-spec drive(starl_chassis:script(), Owner, starl_sim_vehicle:t(), place()) -> effect() when
    Owner :: {starl_machine:name(), Mark :: term()}.
drive(Script, Owner, Vehicle, {_, Now, _, _} = Place) ->
    case starl_sim_vehicle:drive(Script, Owner, Now, Vehicle) of
        {lost, Deaf} -> {same, [], [], Deaf};
        not_understood -> {same, [], [{not_understood, element(2, Script)}], Vehicle};
        Change -> moved(Change, Place)
    end.

%% @doc A machine sets another actuator.
-spec actuate({Device :: atom(), Value :: term()}, Owner, starl_sim_vehicle:t(), place()) ->
    {same, [starl_sim_vehicle:plan()], Facts :: [{actuated, atom(), term()}], starl_sim_vehicle:t()}
when
    Owner :: {starl_machine:name(), Mark :: term()} | none.
actuate({Device, Value} = What, Owner, Vehicle, {_, Now, _, _}) ->
    {Set, Plans, Actuated} = starl_sim_vehicle:actuate(What, Owner, Now, Vehicle),
    {same, Plans, [{actuated, Device, Value} || Set =:= set], Actuated}.

%% @doc The vehicle does a step. A touch has no effect if the robot's motion has changed since, or the other's.
-spec step(step(), starl_sim_vehicle:t(), place()) -> effect().
step(stop, Vehicle, {_, Now, _, _} = Place) ->
    moved(starl_sim_vehicle:stop(Now, Vehicle), Place);
step(turn_wheels, Vehicle, {_, Now, _, _} = Place) ->
    moved(starl_sim_vehicle:turn_wheels(Now, Vehicle), Place);
step(Step, Vehicle, Place) when element(1, Step) =:= touch; element(1, Step) =:= look ->
    case starl_sim_vehicle:piece(Vehicle) =:= element(2, Step) of
        true -> touched(Step, Vehicle, Place);
        false -> {same, [], [], Vehicle}
    end;
step(Beat, Vehicle, {_, Now, _, _} = Place) ->
    moved(starl_sim_vehicle:beat(Beat, Now, Vehicle), Place).

moved({moved, Plans, Vehicle}, {_, _, _, #{walls := _}} = Place) ->
    case contact(Vehicle, Place) of
        {blocked, With} -> bump(With, Plans, Vehicle, Place);
        none -> free({moved, Plans, Vehicle});
        Touch -> free({moved, [Touch | Plans], Vehicle})
    end;
moved(Change, _Place) ->
    free(Change).

free({same, Plans, Vehicle}) ->
    {same, Plans, [], Vehicle};
free({moved, Plans, Vehicle}) ->
    {moved, Plans, [{motion, starl_sim_vehicle:piece(Vehicle)}], Vehicle}.

touched({touch, _Piece, {wall, _} = Wall}, Vehicle, Place) ->
    bump(Wall, [], Vehicle, Place);
touched({touch, _Piece, {robot, Other, Piece, Stops}}, Vehicle, {_, _, _, World} = Place) ->
    #{sight := Sight} = World,
    case starl_sim_sight:piece(Other, Sight) of
        {ok, Piece} when Stops -> bump({robot, Other}, [], Vehicle, Place);
        {ok, Piece} -> feel({robot, Other}, {same, [], [], Vehicle}, Place);
        _ -> {same, [], [], Vehicle}
    end;
%% The shards look at it, too.
touched({look, _Piece}, Vehicle, Place) ->
    case contact(Vehicle, Place) of
        {blocked, With} -> bump(With, [], Vehicle, Place);
        none -> {moved, [], [], Vehicle};
        Touch -> {moved, [Touch], [], Vehicle}
    end.

contact(Vehicle, {Id, Now, Until, World}) ->
    starl_sim_bodies:contact(Id, starl_sim_vehicle:piece(Vehicle), Now, Until, World).

bump(With, Earlier, Vehicle, {_, Now, _, _} = Place) ->
    {Is, Plans, Facts, Stopped} = free(starl_sim_vehicle:bump(Now, Vehicle)),
    feel(With, {Is, Earlier ++ Plans, Facts, Stopped}, Place).

%% Its application hears of it at the next beat of the sensors.
feel(With, {Is, Plans, Facts, Vehicle}, {_, Now, _, World}) ->
    Pose = starl_trajectory:pose(Now, starl_sim_vehicle:piece(Vehicle)),
    Side = starl_sim_bodies:side(starl_sim_bodies:place(With, Pose, Now, World), Pose),
    Sensed = {sensed, {bump, Side}},
    Told = {starl_sim_vehicle:beat_in_us(Now), {app, info, Sensed}},
    {Is, Plans ++ [Told], Facts ++ [Sensed], Vehicle}.

%% @doc The places that the robot sees, with their ages: itself as it is now, the others as of the
%% beginning of the window.
-spec sense(
    [starl:robot_id()] | {near, Mm :: number()},
    starl:robot_id(),
    {Now, WindowFrom},
    starl_sim_vehicle:t()
) -> {[{starl:robot_id(), starl:pose(), AgeUs :: non_neg_integer()}], starl_sim_vehicle:t()} when
    Now :: starl_sim_queue:time(), WindowFrom :: starl_sim_queue:time().
sense(Robots, Id, {Now, From}, Vehicle) ->
    {Poses, Sensed} = starl_sim_vehicle:sense(Robots, {Now, From}, Vehicle),
    {[{Robot, Pose, age(Robot =:= Id, Now, From)} || {Robot, Pose} <- Poses], Sensed}.

age(true, _Now, _From) -> 0;
age(false, Now, From) -> Now - From.
