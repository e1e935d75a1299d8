%% @doc Manages the processes of one robot for its driver: its supervision tree, which restarts
%% crashed processes. The driver waits for a restart, which takes no virtual time in the simulator.
%% A robot with inline machines only has no processes. The module restarts its machines as its
%% supervisors would.
-module(starl_robot_tree).

-export([launch/3, launch/2, resume/5, down/1, restart/3, give_up/4, kill/2, owns/3]).
-export([supervisor/1, waiting/1, inspect/1]).

-export_type([t/0, start/0, seen/0, restarted/0, waiting/0]).

%% A machine as an inspection shows it; `waiting' before it has been booted. For a sequential
%% application, the part of its stack that is its own.
-type seen() ::
    waiting
    | #{module := module(), state := term(), data := term()}
    | #{state := sequential, stack := [tuple()]}.

%% An inline machine may be restarted as often as under a simulated robot's supervisor.
-define(RESTARTS, 1000).

-record(tree, {
    robot :: starl:robot_id(),
    %% starts the robot's tree; none: the robot has no processes
    start :: start() | none,
    sup = none :: pid() | none,
    %% its supervisors: of the services, of a block, of the application
    parts = #{} :: #{starl_robot_sup:part() => pid()}
}).

-opaque t() :: #tree{}.

%% What an application waits for, and its calls.
-type waiting() :: {starl_app_proc:waits(), [starl_crash:frame()]} | none.

%% Starts a robot's tree; returns its supervisors.
-type start() :: fun(() -> {pid(), [{starl_robot_sup:part(), pid()}]}).

%% The machines that have come back, those that were given up, and the other crashes meanwhile;
%% or `gave_up': the robot has no services any more.
-type restarted() ::
    {ok,
        #{
            back := [starl_machine:name()],
            given_up := [starl_machine:name()],
            lost := [{starl_machine:name(), Reason :: term()}]
        },
        starl_robot_machines:t()}
    | gave_up.

%% @doc The machines of a robot, whose tree this function starts; no machine is booted yet.
-spec launch(starl:robot_id(), start() | none, starl_robot_machines:inline()) ->
    {t(), starl_robot_machines:t()}.
launch(Robot, Start, Inline) ->
    launch(#tree{robot = Robot, start = Start}, starl_robot_machines:new(Inline)).

%% @doc The machines of a robot that comes up, and have started this often before: processes, and those
%% that are inline.
-spec resume(
    starl:robot_id(),
    start() | none,
    starl_robot_machines:inline(),
    starl_robot_machines:moment(),
    starl_robot_machines:starts()
) -> {t(), starl_robot_machines:t()}.
resume(Robot, Start, Inline, Moment, Starts) ->
    Waiting = starl_robot_machines:resume(Inline, Moment, Starts),
    launch(#tree{robot = Robot, start = Start}, Waiting).

%% @doc The same for a robot that was down; its machines know how often they have started.
-spec launch(t(), starl_robot_machines:t()) -> {t(), starl_robot_machines:t()}.
launch(#tree{start = none} = Tree, Machines) ->
    {Tree, Machines};
launch(#tree{start = Start} = Tree, Machines) ->
    {Sup, Parts} = Start(),
    _ = [erlang:monitor(process, Part) || {_, Part} <- Parts],
    {Tree#tree{sup = Sup, parts = maps:from_list(Parts)}, attached(Tree, Machines)}.

%% All processes of the tree have started and attached.
attached(#tree{robot = Robot} = Tree, Machines) ->
    receive
        {starl_attach, Robot, Name, Pid} -> attached(Tree, attach(Name, Pid, Machines))
    after 0 -> Machines
    end.

attach(Name, Pid, Machines) ->
    _ = erlang:monitor(process, Pid),
    {ok, Attached} = starl_robot_machines:attach(Name, Pid, Machines),
    Attached.

%% @doc The robot goes down, or is dead for good; its processes end.
-spec down(t()) -> t().
down(#tree{sup = Sup} = Tree) ->
    ok = kill_tree(Sup),
    Tree#tree{sup = none, parts = #{}}.

kill_tree(none) ->
    ok;
kill_tree(Sup) ->
    Ref = erlang:monitor(process, Sup),
    exit(Sup, kill),
    receive
        {'DOWN', Ref, process, Sup, _} -> ok
    end.

%% @doc A machine is gone. Returns when its supervisor has restarted it, or has given it up.
-spec restart(starl_machine:name(), starl_robot_machines:t(), t()) -> restarted().
restart(Name, Machines, Tree) ->
    case starl_robot_machines:inline(Machines) of
        #{Name := _} ->
            inline(Name, starl_robot_machines:restart(Name, ?RESTARTS, Machines), Machines);
        #{} ->
            Waits = #{back => [], given_up => [], lost => []},
            await([Name], Waits, starl_robot_machines:lose(Name, Machines), Tree)
    end.

inline(Name, {ok, Waiting}, _) ->
    {ok, #{back => [Name], given_up => [], lost => []}, Waiting};
inline(_Name, gave_up, _) ->
    gave_up;
inline(Name, given_up, Machines) ->
    GivenUp = #{back => [], given_up => [Name], lost => []},
    {ok, GivenUp, starl_robot_machines:lose(Name, Machines)}.

%% If a process of another robot goes down meanwhile, the shard handles it later.
await([], So, Machines, _Tree) ->
    {ok, So, Machines};
await(Missing, So, Machines, Tree) ->
    Guards = guards(Missing, Tree),
    case [Part || {Pid, Part} <- maps:to_list(Guards), not is_process_alive(Pid)] of
        [] -> await(Guards, Missing, So, Machines, Tree);
        [Part | _] -> guard_gone(Part, Missing, So, Machines, Tree)
    end.

await(Guards, Missing, So, Machines, #tree{robot = Robot, sup = Sup} = Tree) ->
    Own = starl_robot_machines:processes(Machines),
    receive
        %% the end of a process is handled before its successor
        {'DOWN', _, process, Pid, Reason} when is_map_key(Pid, Own) ->
            lose(maps:get(Pid, Own), Reason, Missing, So, Machines, Tree);
        {starl_attach, Robot, Name, Pid} ->
            came(Name, Pid, Missing, So, Machines, Tree);
        {'DOWN', _, process, Sup, _} ->
            gave_up;
        {'DOWN', _, process, Pid, _} when is_map_key(Pid, Guards) ->
            guard_gone(maps:get(Pid, Guards), Missing, So, Machines, Tree)
    end.

%% A supervisor that gives up ends just after its process, but the news of its end may be the first to
%% come, when nobody waits for them.
guard_gone(Part, Missing, #{given_up := GivenUp} = So, Machines, #tree{sup = Sup} = Tree) ->
    case is_process_alive(Sup) of
        true when Part =/= services ->
            Given = So#{given_up := [Part | GivenUp]},
            await(lists:delete(Part, Missing), Given, Machines, Tree);
        _ ->
            gave_up
    end.

%% Another machine has crashed meanwhile.
lose(Name, Reason, Missing, #{back := Back, lost := Lost} = So, Machines, Tree) ->
    More = So#{back := lists:delete(Name, Back), lost := [{Name, Reason} | Lost]},
    await([Name | Missing], More, starl_robot_machines:lose(Name, Machines), Tree).

came(Name, Pid, Missing, #{back := Back} = So, Machines, Tree) ->
    case starl_robot_machines:process(Name, Machines) of
        none ->
            Attached = attach(Name, Pid, Machines),
            await(lists:delete(Name, Missing), So#{back := [Name | Back]}, Attached, Tree);
        Before ->
            self() ! {starl_attach, Tree#tree.robot, Name, Pid},
            receive
                {'DOWN', _, process, Before, Reason} ->
                    lose(Name, Reason, Missing, So, Machines, Tree)
            end
    end.

%% The supervisors that restart these machines, or give them up.
guards(Missing, #tree{parts = Parts}) ->
    Named = [starl_robot_machines:part(Name) || Name <- Missing],
    maps:from_list([{maps:get(Part, Parts), Part} || Part <- Named]).

%% @doc Gives up a machine that has just been restarted, if that is hopeless.
-spec give_up(goes_on | hopeless, starl_machine:name(), restarted(), t()) -> restarted().
give_up(hopeless, Name, {ok, #{back := Back, given_up := GivenUp} = So, Machines}, Tree) ->
    case lists:member(Name, Back) of
        true ->
            ok = end_part(Name, starl_robot_machines:process(Name, Machines), Tree),
            Left = So#{back := lists:delete(Name, Back), given_up := [Name | GivenUp]},
            {ok, Left, starl_robot_machines:lose(Name, Machines)};
        false ->
            {ok, So, Machines}
    end;
give_up(_Hope, _Name, Restarted, _Tree) ->
    Restarted.

%% The machine's supervisor ends, and its process with it; an inline machine has neither.
end_part(_Name, none, _Tree) ->
    ok;
end_part(Name, Pid, #tree{sup = Sup, parts = Parts}) ->
    _ = supervisor:terminate_child(Sup, starl_robot_machines:part(Name)),
    await_ends([Pid, maps:get(starl_robot_machines:part(Name), Parts)]).

await_ends(Pids) ->
    lists:foreach(
        fun(Pid) ->
            receive
                {'DOWN', _, process, Pid, _} -> ok
            end
        end,
        Pids
    ).

%% @doc Ends a machine's process, if it has one; returns the reason of the machine's end, `none'
%% if there is no such machine.
-spec kill(starl_machine:name(), starl_robot_machines:t()) -> {ok, Reason :: term()} | none.
kill(Name, Machines) ->
    case {starl_robot_machines:process(Name, Machines), starl_robot_machines:has(Name, Machines)} of
        {none, true} ->
            {ok, killed};
        {none, false} ->
            none;
        {Pid, true} ->
            exit(Pid, kill),
            receive
                {'DOWN', _, process, Pid, Reason} -> {ok, Reason}
            end
    end.

%% @doc Is this process the supervisor or one of the machines' processes?
-spec owns(pid(), starl_robot_machines:t(), t()) -> boolean().
owns(Pid, _Machines, #tree{sup = Pid}) -> true;
owns(Pid, Machines, _Tree) -> starl_robot_machines:name_of(Pid, Machines) =/= none.

%% @doc The supervisor of the machines' processes.
-spec supervisor(t()) -> pid() | none.
supervisor(#tree{sup = Sup}) -> Sup.

%% @doc What a sequential application waits for; `none': the robot has no such process.
-spec waiting(starl_robot_machines:t()) -> waiting().
waiting(Machines) ->
    case starl_robot_machines:process(app, Machines) of
        none ->
            none;
        Pid ->
            case proc_lib:translate_initial_call(Pid) of
                {starl_app_proc, _, _} -> starl_app_proc:waiting(Pid);
                _ -> none
            end
    end.

%% @doc All machines in their present state.
-spec inspect(starl_robot_machines:t()) -> #{starl_machine:name() => seen()}.
inspect(Machines) ->
    maps:map(fun(_, Machine) -> seen(Machine) end, starl_robot_machines:to_map(Machines)).

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

%% The place where the application waits: the innermost call first. The whole stack is cut off at
%% the VM's `backtrace_depth'.
sequential({current_stacktrace, [{starl_app_proc, init, _, _} | _]}) ->
    waiting;
sequential({current_stacktrace, Frames}) ->
    Own = [Frame || {M, _, _, _} = Frame <- Frames, not starl_code:is_runtime(M)],
    #{state => sequential, stack => Own};
sequential(undefined) ->
    waiting.
