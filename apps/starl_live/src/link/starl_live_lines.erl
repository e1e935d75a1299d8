%% @doc Connects a live robot to its radio, its positioning system, its chassis and its senses. It
%% sends what a step of the machines wants sent, and turns incoming messages into events. Each of
%% these lines (ports) is a process that the link has started, or its stand-in.
-module(starl_live_lines).

-export([new/1, process/2, hear/2, send/2, send_until/4]).

-export_type([t/0, lines/0, out/0]).

%% The processes.
-type lines() :: #{
    transport := pid(),
    positioning := pid(),
    chassis := pid(),
    senses := #{starl_sense:kind() => pid()},
    atom() => term()
}.

-record(lines, {
    transport :: pid(),
    positioning :: pid(),
    chassis :: pid(),
    senses :: #{starl_sense:kind() => pid()}
}).

-opaque t() :: #lines{}.

%% What is sent.
-type out() ::
    {transmit, starl:robot_id() | all, starl_packet:t()}
    | {sense, Tag :: term(), [starl:robot_id()]}
    | {feel, starl_sense:kind(), Mark :: term()}
    | {drive, starl_chassis:script(), UntilUs :: integer(), Mark :: term()}
    | {actuate, atom(), term(), {mark, term()} | none}
    | rest
    | stop.

%% @doc The lines of these processes.
-spec new(lines()) -> t().
new(#{transport := T, positioning := P, chassis := Chassis, senses := Senses}) ->
    #lines{transport = T, positioning = P, chassis = Chassis, senses = Senses}.

%% @doc The process of a line.
-spec process(transport | positioning | chassis, t()) -> pid().
process(transport, #lines{transport = Pid}) -> Pid;
process(positioning, #lines{positioning = Pid}) -> Pid;
process(chassis, #lines{chassis = Pid}) -> Pid.

%% @doc Turns a message from a port into events of the robot.
-spec hear(Message :: term(), t()) -> [starl_robot:local()] | unknown.
hear({starl_heard, Transport, Packets}, #lines{transport = Transport}) ->
    [{sap, packet, Packet} || Packet <- Packets];
hear({starl_located, Positioning, {Name, Tag}, Seen}, #lines{positioning = Positioning}) ->
    [{Name, info, {located, Tag, Seen}}];
hear({starl_chassis, Chassis, sensed, Sense}, #lines{chassis = Chassis}) ->
    [{app, info, {sensed, Sense}}];
hear({starl_chassis, Chassis, {Name, Mark}, Answer}, #lines{chassis = Chassis}) ->
    said(Name, Mark, Answer);
hear({starl_felt, From, {Name, _Kind, Tag}, Felt}, #lines{chassis = Chassis, senses = Senses}) ->
    case lists:member(From, [Chassis | maps:values(Senses)]) of
        true -> [{Name, info, {felt, Tag, Felt}}];
        false -> unknown
    end;
hear(_Message, _Lines) ->
    unknown.

said(Name, Mark, {driven, HeardUs}) -> [{Name, info, {driven, Mark, HeardUs}}];
said(Name, Mark, {stalled, Told}) -> [{Name, info, {stalled, Mark, Told}}];
said(Name, Mark, {actuated, Device, Value}) -> [{Name, info, {actuated, Mark, Device, Value}}];
said(_Name, _Mark, {not_understood, _Commands}) -> [].

%% @doc Sends.
-spec send(out(), t()) -> ok.
send({transmit, To, Packet}, #lines{transport = Transport}) ->
    starl_live_transport:transmit(Transport, To, Packet);
send({sense, Tag, Robots}, #lines{positioning = Positioning}) ->
    starl_live_positioning:ask(Positioning, Tag, Robots);
%% What no sense of its own tells is asked of the chassis.
send({feel, Kind, Mark}, #lines{senses = Senses, chassis = Chassis}) ->
    case Senses of
        #{Kind := Sense} -> starl_live_sense:ask(Sense, Mark);
        #{} -> starl_live_chassis:feel(Chassis, Kind, Mark)
    end;
send({drive, Script, Until, Mark}, #lines{chassis = Chassis}) ->
    starl_live_chassis:drive(Chassis, Script, Until, Mark);
send({actuate, Device, Value, Mark}, #lines{chassis = Chassis}) ->
    starl_live_chassis:actuate(Chassis, Device, Value, Mark);
send(rest, #lines{chassis = Chassis}) ->
    starl_live_chassis:rest(Chassis);
send(stop, #lines{chassis = Chassis}) ->
    starl_live_chassis:stop(Chassis).

%% @doc Sends what has a latest moment. The radio and the chassis look once more.
-spec send_until(Us :: integer(), out(), Owner :: {starl_machine:name(), Mark :: term()}, t()) ->
    ok.
send_until(Us, {transmit, To, Packet}, Owner, #lines{transport = Transport}) ->
    starl_live_transport:transmit(Transport, To, Packet, {Us, Owner});
send_until(Us, {drive, Script, Latest, Mark}, _Owner, Lines) ->
    send({drive, Script, min(Us, Latest), Mark}, Lines);
send_until(_Us, Out, _Owner, Lines) ->
    send(Out, Lines).
