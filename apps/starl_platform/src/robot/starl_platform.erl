%% @doc The platform behaviour: what a robot needs of the world below it (the paper's platform
%% layer), and the one place that carries out a machine's actions.
%%
%% An adapter (the simulator, a real chassis with its radio) implements the callbacks over a
%% state of its own, one per robot. {@link perform/4} carries the actions of a machine out: what
%% concerns other machines of the same robot comes back as events to deliver, everything else
%% goes to the adapter.
-module(starl_platform).

-export([perform/4]).

-export_type([local/0]).

%% An event for a machine of the same robot.
-type local() :: {starl_machine:name(), starl_machine:event_type(), Content :: term()}.

%% Puts one packet on the air, for one robot or for all in range.
-callback transmit(starl:robot_id() | all, starl_packet:t(), State) -> State when State :: term().

%% The poses of those of the robots that the positioning system sees now.
-callback sense([starl:robot_id()], State) -> {[{starl:robot_id(), starl:pose()}], State} when
    State :: term().

%% Sets the speeds of the wheels, in mm/s.
-callback drive(Left :: float(), Right :: float(), State) -> State when State :: term().

%% Sets another actuator.
-callback actuate(Device :: atom(), Value :: term(), State) -> State when State :: term().

%% Starts a machine's timer, in microseconds of the robot's clock, in place of the one of the
%% same name. The event type is `state_timeout' for that name, else `{timeout, Name}'.
-callback start_timer(
    starl_machine:name(), Timer :: term(), Us :: non_neg_integer(), Content :: term(), State
) -> State when State :: term().

%% Stops a machine's timer if it runs.
-callback cancel_timer(starl_machine:name(), Timer :: term(), State) -> State when
    State :: term().

%% Records a fact.
-callback trace(starl_machine:name(), Event :: term(), State) -> State when State :: term().

%% The application has finished.
-callback done(Result :: term(), State) -> State when State :: term().

%% @doc Carries out a machine's actions in their order. Gives the events for machines of the
%% same robot, in the order in which they are to be delivered.
-spec perform([starl_machine:action()], starl_machine:name(), Adapter :: module(), State) ->
    {[local()], State}
when
    State :: term().
perform(Actions, Name, Adapter, State) -> perform(Actions, Name, Adapter, State, []).

perform([], _Name, _Adapter, State, Local) ->
    {lists:reverse(Local), State};
perform([Action | Rest], Name, Adapter, State, Local) ->
    case Action of
        {trace, Event} ->
            perform(Rest, Name, Adapter, Adapter:trace(Name, Event, State), Local);
        {cast, To, Content} ->
            perform(Rest, Name, Adapter, State, [{To, cast, Content} | Local]);
        {reply, {To, Tag}, Answer} ->
            perform(Rest, Name, Adapter, State, [{To, {reply, Tag}, Answer} | Local]);
        {call, To, Request, Tag} ->
            perform(Rest, Name, Adapter, State, [{To, {call, {Name, Tag}}, Request} | Local]);
        {sense, Robots} ->
            {Poses, Next} = Adapter:sense(Robots, State),
            perform(Rest, Name, Adapter, Next, [{Name, info, {located, Poses}} | Local]);
        _ ->
            perform(Rest, Name, Adapter, outward(Action, Name, Adapter, State), Local)
    end.

outward({transmit, Dest, Packet}, _Name, Adapter, State) ->
    Adapter:transmit(Dest, Packet, State);
outward({{timeout, Timer}, cancel}, Name, Adapter, State) ->
    Adapter:cancel_timer(Name, Timer, State);
outward({{timeout, Timer}, Us, Content}, Name, Adapter, State) ->
    Adapter:start_timer(Name, Timer, Us, Content, State);
outward({state_timeout, cancel}, Name, Adapter, State) ->
    Adapter:cancel_timer(Name, state_timeout, State);
outward({state_timeout, Us, Content}, Name, Adapter, State) ->
    Adapter:start_timer(Name, state_timeout, Us, Content, State);
outward({drive, Left, Right}, _Name, Adapter, State) ->
    Adapter:drive(Left, Right, State);
outward({actuate, Device, Value}, _Name, Adapter, State) ->
    Adapter:actuate(Device, Value, State);
outward({done, Result}, _Name, Adapter, State) ->
    Adapter:done(Result, State).
