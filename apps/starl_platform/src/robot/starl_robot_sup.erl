%% @doc One robot: its supervision tree.
%% ```
%%   starl_robot_sup (one_for_one)
%%     sap, location, motion        the platform's machines
%%     starl_blocks_sup             election, dpp, … : the application's building blocks
%%     app                          the application
%% '''
%% Nothing in it has a registered name, so any number of robots live in one VM. A crash restarts
%% that process alone: the driver tells the robot's other machines with `{restarted, Name}', and
%% a restarted SAP has a new incarnation.
-module(starl_robot_sup).
-behaviour(supervisor).

-export([start_link/1]).
-export([init/1]).

-export_type([spec/0, machine/0]).

%% A machine of the robot: its name, callback module and own configuration.
-type machine() :: {starl_machine:name(), module(), Config :: map()}.

%% A robot. `services' are the platform's machines, in start order; `app' is a sequential
%% application ({@link starl_app}) or a machine. `intensity' is how many restarts in an hour of
%% wall time a supervisor bears.
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

-spec init(spec() | {blocks, spec()}) ->
    {ok, {supervisor:sup_flags(), [supervisor:child_spec()]}}.
init({blocks, #{blocks := Blocks} = Spec}) ->
    {ok, {flags(Spec), [machine(M, Spec) || M <- Blocks]}};
init(#{services := Services, app := App} = Spec) ->
    Children = [machine(M, Spec) || M <- Services] ++ blocks_sup(Spec) ++ [app(App, Spec)],
    {ok, {flags(Spec), Children}}.

flags(Spec) ->
    #{strategy => one_for_one, intensity => maps:get(intensity, Spec, 20), period => 3600}.

machine({Name, Module, Config}, #{id := Id, driver := Driver}) ->
    Spec = #{robot => Id, name => Name, module => Module, config => Config, driver => Driver},
    #{id => Name, start => {starl_machine_proc, start_link, [Spec]}}.

blocks_sup(#{blocks := []}) ->
    [];
blocks_sup(Spec) ->
    Start = {supervisor, start_link, [?MODULE, {blocks, Spec}]},
    [#{id => blocks, type => supervisor, start => Start}].

app({machine, Module, Config}, Spec) ->
    machine({app, Module, Config}, Spec);
app({sequential, Module, Args}, #{id := Id, participants := Team, driver := Driver}) ->
    Handle = starl:robot(Id, Team),
    Spec = #{robot => Id, handle => Handle, module => Module, args => Args, driver => Driver},
    #{id => app, start => {starl_app_proc, start_link, [Spec]}}.
