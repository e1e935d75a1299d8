%% @doc The computer of a live robot in virtual time: a process beside the shard that simulates the
%% robot ({@link starl_virtual_robot}). It has a simulated clock ({@link starl_virtual_clock}), and
%% calls a program, a module with this behaviour, with one command after the other.
%% ```
%%   shard                             computer
%%     | starl_order, time, commands --->| sets its clock; the program obeys
%%     |<---- starl_done, {up(), effects}|
%% '''
%% The process is linked to the shard: neither outlives the other.
-module(starl_virtual_computer).

-export([start/3, order/3, machines/1, end_with/1, shard/0]).

-export_type([command/0, up/0, effect/0, actor/0]).

%% The parts of a program that get messages.
-type actor() :: link | transport.

%% Boot the program of a life, whose random streams follow from a seed, with this code; give a part a
%% message, or the socket a datagram; end the program, with power or without. Each program has further
%% ones.
-type command() ::
    {boot, Life :: pos_integer(), Seed :: integer(), starl_reload:codes()}
    | {hear, actor(), Message :: term()}
    | {heard, From :: starl:robot_id(), binary()}
    | {halt, killed | power_cut}
    | term().

%% Whether the program runs, is off, or has ended by itself, maybe since one of its parts has crashed.
-type up() :: up | off | {down, Why :: {crashed, actor(), Reason :: term()} | term()}.

%% What a program does: it wants to have a message at a time of its computer; a datagram leaves; a
%% process of its has an answer for the link; facts; it asks the positioning system; its machines have
%% started; its application has ended; a machine reports on a reload. An image of the disk was put in
%% its place.
-type effect() ::
    {timer, actor(), DueUs :: integer(), Message :: term()}
    | {sent, starl:robot_id(), binary()}
    | {answer, Message :: term()}
    | {facts, [starl_monitor:trace_event()]}
    | {asked, Tag :: term(), [starl:robot_id()]}
    | {started, [starl_machine:name()]}
    | {ended, given_up | {done, term()}}
    | {reloaded, starl_machine:name(), starl_reload:told()}
    | store_set_back.

%% The program before its first boot.
-callback new(starl:robot_id(), starl_virtual_clock:t(), Config :: map()) -> Program :: term().
-callback obey(command(), Program) -> {up(), [effect()], Program}.
%% The machines of the robot, each with its state and data, for this caller.
-callback machines(gen_server:from(), Program :: term()) ->
    #{starl_machine:name() => starl_robot_tree:seen()}.

%% @doc Starts the computer of a robot, linked to the calling shard. The program does not run yet.
-spec start(starl:robot_id(), module(), Config :: map()) -> pid().
start(Id, Module, Config) ->
    Shard = self(),
    spawn_link(fun() ->
        _ = process_flag(trap_exit, true),
        _ = put(?MODULE, Shard),
        Clock = starl_virtual_clock:new(0),
        wait(Id, Shard, Clock, Module, Module:new(Id, Clock, Config))
    end).

%% @doc Gives the program commands at a time of its computer. The shard gets `{starl_done, Robot,
%% Computer, {up(), [effect()]}}'.
-spec order(pid(), LocalUs :: integer(), [command(), ...]) -> ok.
order(Computer, LocalUs, Commands) ->
    Computer ! {starl_order, LocalUs, Commands},
    ok.

%% @doc The machines of the robot, each with its state and data, while it has no order.
-spec machines(pid()) -> #{starl_machine:name() => starl_robot_tree:seen()}.
machines(Computer) -> gen_server:call(Computer, machines, infinity).

wait(Id, Shard, Clock, Module, Program) ->
    receive
        {starl_order, LocalUs, Commands} ->
            ok = starl_virtual_clock:set(LocalUs, Clock),
            {Up, Effects, Next} = obey(Commands, off, [], Module, Program),
            Shard ! {starl_done, Id, self(), {Up, Effects}},
            wait(Id, Shard, Clock, Module, Next);
        {'$gen_call', From, machines} ->
            ok = gen_server:reply(From, Module:machines(From, Program)),
            wait(Id, Shard, Clock, Module, Program);
        {'EXIT', Shard, Why} ->
            exit(Why)
    end.

obey([], Up, Effects, _Module, Program) ->
    {Up, lists:append(lists:reverse(Effects)), Program};
obey([Command | Commands], _Up, Before, Module, Program) ->
    {Up, Effects, Next} = Module:obey(Command, Program),
    obey(Commands, Up, [Effects | Before], Module, Next).

%% @doc Ends the calling computer, if this message says that its shard has ended.
-spec end_with(Message :: term()) -> ok.
end_with({'EXIT', From, Why}) ->
    case get(?MODULE) of
        From -> exit(Why);
        _ -> ok
    end;
end_with(_Message) ->
    ok.

%% @doc The shard of the calling computer.
-spec shard() -> pid().
shard() -> get(?MODULE).
