%% @doc The platform behaviour: what a robot needs of the world below it (the paper's platform layer:
%% packets, location, motion, other actuators).
%%
%% An adapter (the simulator, a real chassis with its radio) carries out what machines ask of the
%% world, over a state of its own, one per robot. Time, the trace, the store and the other machines of
%% the robot are no business of the world's ({@link starl_robot}). What comes from the world (`packet',
%% `located', `driven', `actuated', ...) reaches the machines as events, which the driver hands in.
-module(starl_platform).

-export_type([world_action/0]).

%% What a machine asks of the world.
-type world_action() ::
    {transmit, starl:robot_id() | all, starl_packet:t()}
    | {sense, [starl:robot_id()], Tag :: term()}
    | {drive, starl_chassis:script(), Mark :: term()}
    | {actuate, Device :: atom(), Value :: term()}
    | {actuate, Device :: atom(), Value :: term(), Mark :: term()}.

%% Carries out an action of the machine `Name'; gives the events that answer it at once, in the order
%% in which they are to be delivered.
%% <dl>
%% <dt>`{transmit, Dest | all, Packet}'</dt><dd>puts one packet on the air, for one robot or for
%%   all in range</dd>
%% <dt>`{sense, Robots, Tag}'</dt><dd>answered by the event `{Name, info, {located, Tag, [{Robot, Pose,
%%   AgeUs}]}}' with those of the robots that the positioning system sees, and how long ago it measured
%%   where each is. A system that sends pictures at its own pace is best answered with its next one
%%   (see {@link starl_location})</dd>
%% <dt>`{drive, {Chassis, Commands}, Mark}'</dt><dd>the chassis carries out the commands, one after
%%   the other, each for so long by its own clock, and stops, whatever becomes of the robot's
%%   program; without commands it stops as soon as it can. Answered, when it stands, by the event
%%   `{Name, info, {driven, Mark, Us}}' with what that clock showed when it heard the command; or,
%%   when it has found out within 15 ms that it does not do as it was told and has stopped, by
%%   `{Name, info, {stalled, Mark, Told}}' with what it was told ({@link starl_chassis:told()}). A
%%   script that another takes the place of is not answered, nor is one of another chassis, which
%%   is not carried out but traced, `{not_understood, Commands}'</dd>
%% <dt>`{actuate, Device, Value}'</dt><dd>sets another actuator</dd>
%% <dt>`{actuate, Device, Value, Mark}'</dt><dd>the same, answered by the event `{Name, info,
%%   {actuated, Mark, Device, Value}}' with the state that the device's sensor shows then; a command
%%   or an answer may be lost</dd>
%% </dl>
-callback perform(world_action(), starl_machine:name(), State) ->
    {[starl_robot:local()], State}
when
    State :: term().

%% Nobody commands the chassis any more: it comes to rest.
-callback stop(State) -> State when State :: term().
