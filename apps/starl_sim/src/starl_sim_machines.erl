%% @doc The machines of one robot: processes of its supervision tree, or inline, which is the
%% same {@link starl_machine} in the shard's own hands.
%%
%% A process is stepped by a message and is busy until it has answered; an inline machine has
%% answered at once. Both crash, are restarted and begin a new incarnation in the same way, so a
%% run comes to the same digest with either. A sequential application has a stack of its own and
%% is a process always.
-module(starl_sim_machines).

-export([new/3, names/1, incarnation/2, condition/1, down/2, up/1]).
-export([boot/3, step/5, crashed/2, kill/2, owns/2, name_of/2, inspect/1]).

-export_type([t/0, inline/0, answer/0, seen/0]).

%% The machines that get no process, by their names.
-type inline() :: #{starl_machine:name() => {module(), Config :: map()}}.

%% What comes of a step: a process is at work on it, it is done, the machine has crashed, or
%% there is no such machine.
-type answer() ::
    busy
    | {done, [starl_machine:action()], t()}
    | {crashed, Reason :: term()}
    | absent.

%% A machine as it can be looked at; `waiting' before it has been booted. Of a sequential
%% application its stack is known, as far as it is its own.
-type seen() ::
    waiting
    | #{module := module(), state := term(), data := term()}
    | #{state := sequential, stack := [tuple()]}.

%% An inline machine may be restarted as often as a simulated robot's supervisor would.
-define(RESTARTS, 1000).
%% The machines without which a robot is none.
-define(SERVICES, [sap, location, motion]).

-record(machines, {
    robot :: starl:robot_id(),
    %% starts the robot's tree; none: it has no processes
    start :: start() | none,
    sup :: pid() | none,
    %% its supervisors: of the services, of a block, of the application
    parts = #{} :: #{starl_robot_sup:part() => pid()},
    condition = up :: up | down | dead,
    now = #{} :: #{starl_machine:name() => pid() | starl_machine:t() | waiting},
    inline :: inline(),
    starts = #{} :: #{starl_machine:name() => pos_integer()},
    restarts = #{} :: #{starl_robot_sup:part() => pos_integer()}
}).

-opaque t() :: #machines{}.

%% Starts a robot's tree; gives its supervisors.
-type start() :: fun(() -> {pid(), [{starl_robot_sup:part(), pid()}]}).

%% @doc The machines of a robot, whose tree this function starts; none of them has been booted.
-spec new(starl:robot_id(), start() | none, inline()) -> t().
new(Robot, Start, Inline) ->
    launch(#machines{robot = Robot, start = Start, sup = none, inline = Inline}).

launch(#machines{start = Start, inline = Inline} = Machines) ->
    Now = maps:map(fun(_, _) -> waiting end, Inline),
    Waiting = Machines#machines{condition = up, now = Now, restarts = #{}},
    Launched = lists:foldl(fun started/2, Waiting, lists:sort(maps:keys(Inline))),
    case Start of
        none -> Launched;
        _ -> attached(with_tree(Start(), Launched))
    end.

with_tree({Sup, Parts}, Machines) ->
    _ = [erlang:monitor(process, Part) || {_, Part} <- Parts],
    Machines#machines{sup = Sup, parts = maps:from_list(Parts)}.

%% All processes of the tree have started, and have said so.
attached(#machines{robot = Robot} = Machines) ->
    receive
        {starl_attach, Robot, Name, Pid} -> attached(attach(Name, Pid, Machines))
    after 0 -> Machines
    end.

attach(Name, Pid, #machines{now = Now} = Machines) ->
    _ = erlang:monitor(process, Pid),
    started(Name, Machines#machines{now = Now#{Name => Pid}}).

%% @doc The robot goes down, or is dead for good; its processes end.
-spec down(down | dead, t()) -> t().
down(Condition, #machines{sup = Sup} = Machines) ->
    ok = kill_tree(Sup),
    Machines#machines{condition = Condition, sup = none, parts = #{}, now = #{}}.

kill_tree(none) ->
    ok;
kill_tree(Sup) ->
    Ref = erlang:monitor(process, Sup),
    exit(Sup, kill),
    receive
        {'DOWN', Ref, process, Sup, _} -> ok
    end.

%% @doc A robot that was down starts anew; nothing of it has been booted yet.
-spec up(t()) -> t().
up(#machines{condition = down} = Machines) -> launch(Machines).

%% @doc Is the robot up, down for a while, or dead?
-spec condition(t()) -> up | down | dead.
condition(#machines{condition = Condition}) -> Condition.

%% @doc The machines that there are now, in the order in which they are booted: the platform's
%% first, the application last, whatever their names.
-spec names(t()) -> [starl_machine:name()].
names(#machines{now = Now}) -> boot_order(maps:keys(Now)).

%% @doc How often a machine has been started.
-spec incarnation(starl_machine:name(), t()) -> pos_integer().
incarnation(Name, #machines{starts = Starts}) -> maps:get(Name, Starts).

%% @doc Boots a machine with this configuration.
-spec boot(starl_machine:name(), starl_machine:config(), t()) -> answer().
boot(Name, Base, #machines{now = Now, inline = Inline} = Machines) ->
    case Now of
        #{Name := Pid} when is_pid(Pid) ->
            Pid ! {starl_boot, Base},
            busy;
        #{Name := _} ->
            #{Name := {Module, Config}} = Inline,
            try starl_machine:new(Module, Config, Base) of
                {Actions, Machine} ->
                    {done, Actions, Machines#machines{now = Now#{Name := Machine}}}
            catch
                Class:Reason:Stack -> {crashed, starl_crash:reason(Class, Reason, Stack)}
            end;
        #{} ->
            absent
    end.

%% @doc Gives a machine an event. Whatever goes wrong inside is the machine's crash, as it is
%% for a process.
-spec step(
    starl_machine:name(), starl_machine:event_type(), Content :: term(), starl_machine:meta(), t()
) -> answer().
step(Name, Type, Content, Meta, #machines{now = Now} = Machines) ->
    case Now of
        #{Name := Pid} when is_pid(Pid) ->
            Pid ! {starl_step, Type, Content, Meta},
            busy;
        #{Name := Machine} ->
            try starl_machine:step(Type, Content, Meta, Machine) of
                {Actions, Next} -> {done, Actions, Machines#machines{now = Now#{Name := Next}}}
            catch
                Class:Reason:Stack -> {crashed, starl_crash:reason(Class, Reason, Stack)}
            end;
        #{} ->
            absent
    end.

%% @doc A machine is gone. Returns when whoever restarts it has done so, with the machines that
%% have come back, in the order in which they are to be booted, and those that have crashed so often
%% that they do not; or the robot has no services any more.
-spec crashed(starl_machine:name(), t()) ->
    {ok, Back :: [starl_machine:name()], GivenUp :: [starl_machine:name()], t()} | gave_up.
crashed(Name, #machines{inline = Inline, restarts = Restarts} = Machines) when
    is_map_key(Name, Inline)
->
    Part = part(Name),
    case {maps:get(Part, Restarts, 0), Part} of
        {N, _} when N < ?RESTARTS ->
            #machines{now = Now} = Machines,
            Counted = Restarts#{Part => N + 1},
            Waiting = Machines#machines{now = Now#{Name := waiting}, restarts = Counted},
            {ok, [Name], [], started(Name, Waiting)};
        {_, services} ->
            gave_up;
        _ ->
            {ok, [], [Name], forget(Name, Machines)}
    end;
crashed(Name, Machines) ->
    await_restart([Name], [], [], forget(Name, Machines)).

part(Name) ->
    case lists:member(Name, ?SERVICES) of
        true -> services;
        false -> Name
    end.

%% Another robot's process that goes down meanwhile is left for the shard to see.
await_restart([], Back, GivenUp, Machines) ->
    {ok, boot_order(Back), GivenUp, Machines};
await_restart(Missing, Back, GivenUp, #machines{robot = Robot, sup = Sup} = Machines) ->
    Own = own(Machines),
    Guards = guards(Missing, Machines),
    receive
        {starl_attach, Robot, Name, Pid} ->
            Left = lists:delete(Name, Missing),
            await_restart(Left, [Name | Back], GivenUp, attach(Name, Pid, Machines));
        {'DOWN', _, process, Sup, _} ->
            gave_up;
        {'DOWN', _, process, Pid, _} when is_map_key(Pid, Guards) ->
            case {maps:get(Pid, Guards), is_process_alive(Sup)} of
                {Name, true} when Name =/= services ->
                    Left = lists:delete(Name, Missing),
                    await_restart(Left, Back, [Name | GivenUp], Machines);
                _ ->
                    gave_up
            end;
        {'DOWN', _, process, Pid, _} when is_map_key(Pid, Own) ->
            Name = maps:get(Pid, Own),
            Now = lists:delete(Name, Back),
            await_restart([Name | Missing], Now, GivenUp, forget(Name, Machines))
    end.

own(#machines{now = Now}) -> maps:from_list([{P, N} || {N, P} <- maps:to_list(Now), is_pid(P)]).

%% The supervisors that restart these machines, or give them up.
guards(Missing, #machines{parts = Parts}) ->
    maps:from_list([{maps:get(part(Name), Parts), part(Name)} || Name <- Missing]).

forget(Name, #machines{now = Now} = Machines) -> Machines#machines{now = maps:remove(Name, Now)}.

started(Name, #machines{starts = Starts} = Machines) ->
    Machines#machines{starts = Starts#{Name => maps:get(Name, Starts, 0) + 1}}.

%% @doc Kills a machine; gives the reason that it went with, `none' if there is no such machine.
-spec kill(starl_machine:name(), t()) -> {ok, Reason :: term()} | none.
kill(Name, #machines{now = Now}) ->
    case Now of
        #{Name := Pid} when is_pid(Pid) ->
            exit(Pid, kill),
            receive
                {'DOWN', _, process, Pid, Reason} -> {ok, Reason}
            end;
        #{Name := _} ->
            {ok, killed};
        #{} ->
            none
    end.

%% @doc Is this the supervisor or one of the processes?
-spec owns(pid(), t()) -> boolean().
owns(Pid, #machines{sup = Pid}) -> true;
owns(Pid, Machines) -> name_of(Pid, Machines) =/= none.

%% @doc Which machine is this process?
-spec name_of(pid(), t()) -> {ok, starl_machine:name()} | none.
name_of(Pid, #machines{now = Now}) ->
    case [Name || {Name, P} <- maps:to_list(Now), P =:= Pid] of
        [Name] -> {ok, Name};
        [] -> none
    end.

%% @doc All machines as they are now.
-spec inspect(t()) -> #{starl_machine:name() => seen()}.
inspect(#machines{now = Now}) -> maps:map(fun(_, Machine) -> seen(Machine) end, Now).

seen(Pid) when is_pid(Pid) ->
    case proc_lib:translate_initial_call(Pid) of
        {starl_app_proc, _, _} -> sequential(erlang:process_info(Pid, current_stacktrace));
        _ -> seen(starl_machine_proc:machine(Pid))
    end;
seen(waiting) ->
    waiting;
seen(Machine) ->
    #{
        module => starl_machine:module(Machine),
        state => starl_machine:state(Machine),
        data => starl_machine:data(Machine)
    }.

%% Where the application itself waits: the innermost call first. The whole stack is cut off at the
%% VM's `backtrace_depth'.
sequential({current_stacktrace, [{starl_app_proc, init, _, _} | _]}) ->
    waiting;
sequential({current_stacktrace, Frames}) ->
    #{state => sequential, stack => [F || {M, _, _, _} = F <- Frames, not is_runtime(M)]};
sequential(undefined) ->
    waiting.

is_runtime(Module) -> lists:member(Module, [starl_app_proc, proc_lib]).

boot_order(Names) ->
    First = [Name || Name <- ?SERVICES, lists:member(Name, Names)],
    Last = [app || lists:member(app, Names)],
    First ++ lists:sort(Names -- (First ++ Last)) ++ Last.
