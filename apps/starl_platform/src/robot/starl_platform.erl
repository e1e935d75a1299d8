%% @doc The platform behaviour: the services that a robot needs from its world (the paper's platform
%% layer: packets, location, motion, other actuators).
%%
%% An adapter (the simulator, a real chassis with its radio) carries out the actions of machines on
%% the world, with a state of its own, one per robot. The adapter has nothing to do with time, the
%% trace, the store and the robot's other machines ({@link starl_robot}). The driver hands the
%% events of the world (`packet', `located', `driven', `actuated', ...) to the machines.
-module(starl_platform).

-export_type([world_action/0]).

%% An action of a machine on the world.
-type world_action() ::
    {transmit, starl:robot_id() | all, starl_packet:t()}
    | {sense, [starl:robot_id()] | {near, Mm :: number()}, Tag :: term()}
    | {feel, starl_sense:kind(), Tag :: term()}
    | {drive, starl_chassis:script(), Mark :: term()}
    | {actuate, Device :: atom(), Value :: term()}
    | {actuate, Device :: atom(), Value :: term(), Mark :: term()}
    | {until, Us :: integer(), world_action() | {trace, Event :: term()}, Late :: term()}
    | {outlived, starl_packet:incarnation()}
    | {reloaded, starl_reload:told()}.

%% Carries out an action of the machine `Name'; returns the events that answer it at once, in the
%% order in which they are to be delivered.
%% <dl>
%% <dt>`{transmit, Dest | all, Packet}'</dt><dd>puts one packet on the air, for one robot or for
%%   all in range</dd>
%% <dt>`{sense, Robots, Tag}'</dt><dd>answered by the event `{Name, info, {located, Tag, [{Robot,
%%   Pose, AgeUs}]}}' with those of the robots that the positioning system sees (of `{near, Mm}': its own pose, and at
%%   least all that are so near; an adapter may show the whole team), and the age of each
%%   measurement. An adapter to a system that sends pictures at its own pace should answer with the
%%   next picture (see {@link starl_location})</dd>
%% <dt>`{feel, Kind, Tag}'</dt><dd>answered by the event `{Name, info, {felt, Tag, {ok, Reading}}}'
%% with the reading of the sense; `none' if it is silent, `unknown' if the robot has no such
%% sense</dd>
%% <dt>`{drive, {Chassis, Commands}, Mark}'</dt><dd>the chassis carries out the commands, one after
%%   the other, each for its duration by the chassis' own clock, and stops, even if the robot's
%%   program fails; without commands it stops as soon as it can. When it stands, it answers with
%%   the event `{Name, info, {driven, Mark, Us}}'; `Us' is the time of its clock at which it heard
%%   the command. If it finds within 15 ms that its drive does not obey, it stops and answers with
%%   `{Name, info, {stalled, Mark, Told}}' and the command ({@link starl_chassis:movement()}). A
%%   script that another one replaces is not answered. A script of another chassis is neither
%%   carried out nor answered, but traced: `{not_understood, Commands}'</dd>
%% <dt>`{actuate, Device, Value}'</dt><dd>sets another actuator</dd>
%% <dt>`{actuate, Device, Value, Mark}'</dt><dd>the same, answered by the event `{Name, info,
%%   {actuated, Mark, Device, Value}}' with the state that the device's sensor shows then; a command
%%   or an answer may be lost</dd>
%% <dt>`{until, Us, Action, Late}'</dt><dd>carries out the action unless the robot's own clock shows
%% a later time when it leaves the robot; else answered by `{Name, info, {late, Late}}'. A trace
%% event leaves for the record</dd>
%% <dt>`{outlived, Incarnation}'</dt><dd>the robot's store is older than its last life, which had this
%%   number: it is marked as outdated, and the whole robot starts anew, as after a reboot</dd>
%% <dt>`{reloaded, Told}'</dt><dd>reports how the machine has applied a reload command; answered by
%% `{Other, info, {restarted, Name}}' for each machine that is to learn of a crash</dd>
%% </dl>
-callback perform(world_action(), starl_machine:name(), State) ->
    {[starl_robot:local()], State}
when
    State :: term().

%% No machine commands the chassis any more: it comes to rest.
-callback stop(State) -> State when State :: term().
