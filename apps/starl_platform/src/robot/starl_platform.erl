%% @doc The platform behaviour: what a robot needs of the world below it (the paper's platform
%% layer: packets, location, motion, clock, trace).
%%
%% An adapter (the simulator, a real chassis with its radio) carries out what machines ask for,
%% over a state of its own, one per robot. What one machine says to another of the same robot is
%% no business of the world's: {@link local/2} turns it into an event to deliver. The clock and
%% the events that come from the world (`packet', time-outs, `located') reach the machines through
%% the driver that steps them ({@link starl_machine_proc}).
-module(starl_platform).

-export([local/2]).

-export_type([local/0]).

%% An event for a machine of the same robot.
-type local() :: {starl_machine:name(), starl_machine:event_type(), Content :: term()}.

%% Carries out the actions of the machine `Name' in their order; gives the events for machines of
%% the same robot in the order in which they are to be delivered.
%% <dl>
%% <dt>`{transmit, Dest | all, Packet}'</dt><dd>puts one packet on the air, for one robot or for
%%   all in range</dd>
%% <dt>`{sense, Robots}'</dt><dd>answered by the local event `{Name, info, {located, [{Robot,
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
%% <dt>`{{timeout, T}, Us, Content}', `{state_timeout, Us, Content}'</dt><dd>starts a timer of
%%   this machine, by the robot's clock, in place of the one of the same name</dd>
%% <dt>`{{timeout, T}, cancel}', `{state_timeout, cancel}'</dt><dd>stops it if it runs</dd>
%% <dt>`{store, Term}'</dt><dd>makes the term durable, in place of what this machine stored before,
%%   and goes on when it is; where it cannot be written, nothing that follows takes place: `perform'
%%   answers `store_full' with the events so far, and the driver has the machine crash</dd>
%% <dt>`{trace, Event}'</dt><dd>records a fact</dd>
%% <dt>`{done, Result}'</dt><dd>the application has finished</dd>
%% <dt>`{cast, …}', `{call, …}', `{reply, …}'</dt><dd>see {@link local/2}</dd>
%% </dl>
-callback perform([starl_machine:action()], Name :: starl_machine:name(), State) ->
    {[local()], State} | {store_full, [local()], State}
when
    State :: term().

%% @doc The event that a machine's word to another machine of the same robot becomes.
-spec local(starl_machine:action(), Name :: starl_machine:name()) -> local().
local({cast, To, Content}, _Name) -> {To, cast, Content};
local({reply, {To, Tag}, Answer}, _Name) -> {To, {reply, Tag}, Answer};
local({call, To, Request, Tag}, Name) -> {To, {call, {Name, Tag}}, Request}.
