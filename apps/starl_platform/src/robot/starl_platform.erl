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
    | {sense, [starl:robot_id()]}
    | {drive, starl_motion_course:script(), Mark :: term()}
    | {actuate, Device :: atom(), Value :: term()}
    | {actuate, Device :: atom(), Value :: term(), Mark :: term()}.

%% Carries out an action of the machine `Name'; gives the events that answer it at once, in the order
%% in which they are to be delivered.
%% <dl>
%% <dt>`{transmit, Dest | all, Packet}'</dt><dd>puts one packet on the air, for one robot or for
%%   all in range</dd>
%% <dt>`{sense, Robots}'</dt><dd>answered by the event `{Name, info, {located, [{Robot,
%%   Pose}]}}' with those of the robots that the positioning system sees</dd>
%% <dt>`{drive, [{Left, Right, Us}], Mark}'</dt><dd>turns the wheels at these speeds, mm/s, one
%%   after the other, each for so long by the chassis' own clock, and stops them, whatever becomes
%%   of the robot's program; no script stops them at once. Answered, when they stand, by the event
%%   `{Name, info, {driven, Mark, Us}}' with what that clock showed when it heard the command; or,
%%   at most 15 ms after a wheel has ceased to turn as told and both were stopped, by `{Name, info,
%%   {stalled, Mark, {Left, Right}}}' with the speeds that it was told. A script that another takes
%%   the place of is not answered</dd>
%% <dt>`{actuate, Device, Value}'</dt><dd>sets another actuator</dd>
%% <dt>`{actuate, Device, Value, Mark}'</dt><dd>the same, answered by the event `{Name, info,
%%   {actuated, Mark, Device, Value}}' with the state that the device's sensor shows then; a command
%%   or an answer may be lost</dd>
%% </dl>
-callback perform(world_action(), starl_machine:name(), State) ->
    {[starl_robot:local()], State}
when
    State :: term().

%% Nobody commands the chassis any more: its wheels stand.
-callback stop(State) -> State when State :: term().
