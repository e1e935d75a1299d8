%% @doc Supervises the processes of one robot.
%% ```
%%   starl_robot_sup
%%     services: sap, location, motion     the platform's machines
%%     election                            a supervisor each for the application's building blocks
%%     dpp
%%     ...
%%     app                                 and for the application
%% '''
%% No process has a registered name, so any number of robots live in one VM. A crash restarts that
%% process alone. The driver notifies the robot's other machines with `{restarted, Name}', and a
%% restarted SAP has a new incarnation.
%%
%% A block or an application that crashes again and again is given up: its supervisor ends and is
%% not restarted, and all other parts go on. A robot cannot work without its services: when their
%% supervisor gives up, so does the robot's.
-module(starl_robot_sup).
-behaviour(supervisor).

-export([start_link/1, parts/1]).
-export([init/1]).

-export_type([spec/0, machine/0, part/0]).

%% A machine of the robot: its name, callback module and own configuration.
-type machine() :: {starl_machine:name(), module(), Config :: map()}.

%% A supervisor of the robot: that of the services, of a block's machine, or of the application.
-type part() :: services | starl_machine:name().

%% A robot. `services' are the platform's machines, in start order; `app' is a sequential
%% application ({@link starl_app}) or a machine. `intensity' is the number of restarts in an hour of
%% wall time that each of its supervisors allows.
-type spec() :: #{
    id := starl:robot_id(),
    participants := starl_team:t(),
    driver := pid(),
    services := [machine()],
    blocks := [machine()],
    app := {sequential, module(), Args :: term()} | {machine, module(), Config :: map()},
    intensity => pos_integer()
}.

%% @doc Starts the robot; its processes attach to the driver one by one.
-spec start_link(spec()) -> supervisor:startlink_ret().
start_link(Spec) -> supervisor:start_link(?MODULE, Spec).

%% @doc Its supervisors, with the machines of each.
-spec parts(Robot :: pid()) -> [{part(), pid()}].
parts(Sup) ->
    [{Part, Pid} || {Part, Pid, supervisor, _} <- supervisor:which_children(Sup), is_pid(Pid)].

-spec init(spec() | {machines, [supervisor:child_spec()], supervisor:sup_flags(), Id}) ->
    {ok, {supervisor:sup_flags(), [supervisor:child_spec()]}}
when
    Id :: starl:robot_id().
init({machines, Children, Flags, Id}) ->
    logger:set_process_metadata(#{robot => Id}),
    {ok, {Flags, Children}};
init(#{id := Id, services := Services, blocks := Blocks, app := App} = Spec) ->
    logger:set_process_metadata(#{robot => Id}),
    Service = [machine(M, Spec) || M <- Services],
    Others = [machine(M, Spec) || M <- Blocks] ++ [app(App, Spec)],
    Parts = [part(services, Service, permanent, Spec) || Service =/= []],
    Alone = [part(Name, [Child], temporary, Spec) || #{id := Name} = Child <- Others],
    %% services that were given up are not started again
    {ok, {#{strategy => one_for_one, intensity => 0, period => 1}, Parts ++ Alone}}.

part(Part, Children, Restart, Spec) ->
    Flags = #{
        strategy => one_for_one, intensity => maps:get(intensity, Spec, 20), period => 3600
    },
    Start = {supervisor, start_link, [?MODULE, {machines, Children, Flags, maps:get(id, Spec)}]},
    #{id => Part, type => supervisor, restart => Restart, start => Start}.

machine({Name, Module, Config}, #{id := Id, driver := Driver}) ->
    Spec = #{robot => Id, name => Name, module => Module, config => Config, driver => Driver},
    #{id => Name, start => {starl_machine_proc, start_link, [Spec]}}.

app({machine, Module, Config}, Spec) ->
    machine({app, Module, Config}, Spec);
app({sequential, Module, Args}, #{id := Id, participants := Team, driver := Driver}) ->
    Handle = starl:robot(Id, Team),
    Spec = #{robot => Id, handle => Handle, module => Module, args => Args, driver => Driver},
    #{id => app, start => {starl_app_proc, start_link, [Spec]}}.
