%% @doc The process around a {@link starl_machine}: a thin gen_statem.
%%
%% Its driver (a simulator shard, or the link of a real robot) steps the process, with the messages
%% of {@link starl_driver}. The process is at rest when it has answered.
-module(starl_machine_proc).
-behaviour(gen_statem).

-export([start_link/1, machine/1]).
-export([init/1, callback_mode/0, handle_event/4]).

-export_type([spec/0]).

%% The start arguments.
-type spec() :: #{
    robot := starl:robot_id(),
    name := starl_machine:name(),
    module := module(),
    config := map(),
    driver := pid()
}.

-record(shell, {
    driver :: pid(),
    robot :: starl:robot_id(),
    machine :: starl_machine:t()
}).

%% @doc Starts the process and attaches it to its driver.
-spec start_link(spec()) -> gen_statem:start_ret().
start_link(Spec) ->
    gen_statem:start_link(?MODULE, Spec, []).

%% @doc The machine as it is now, for inspection; `waiting' before it has been booted.
-spec machine(pid()) -> starl_machine:t() | waiting.
machine(Pid) -> gen_statem:call(Pid, machine).

-spec callback_mode() -> gen_statem:callback_mode_result().
callback_mode() -> handle_event_function.

-spec init(spec()) -> {ok, waiting, spec()}.
init(#{robot := Robot, name := Name, driver := Driver} = Spec) ->
    logger:set_process_metadata(#{domain => [starl, robot], robot => Robot, machine => Name}),
    _ = starl_driver:attach(Driver, Robot, Name),
    {ok, waiting, Spec}.

%% The machine's own state lies in the data: the process has but two states, so that gen_statem
%% need not compare the machine with its successor after each event.
-spec handle_event(gen_statem:event_type(), term(), waiting | stepping, spec() | #shell{}) ->
    gen_statem:event_handler_result(waiting | stepping).
handle_event(info, {starl_step, Type, Content, Meta}, stepping, #shell{} = Shell) ->
    try starl_machine:step(Type, Content, Meta, Shell#shell.machine) of
        {Actions, Machine} ->
            _ = starl_driver:done(Shell#shell.driver, Shell#shell.robot, Actions),
            {keep_state, Shell#shell{machine = Machine}}
    catch
        Class:Reason:Stack when Class =/= error -> exit(starl_crash:reason(Class, Reason, Stack))
    end;
handle_event(info, {starl_boot, Base}, waiting, Spec) ->
    #{driver := Driver, robot := Robot, module := Module, config := Config} = Spec,
    try starl_machine:new(Module, Config, Base) of
        {Actions, Machine} ->
            _ = starl_driver:done(Driver, Robot, Actions),
            {next_state, stepping, #shell{driver = Driver, robot = Robot, machine = Machine}}
    catch
        Class:Reason:Stack when Class =/= error -> exit(starl_crash:reason(Class, Reason, Stack))
    end;
handle_event({call, From}, machine, stepping, #shell{machine = Machine}) ->
    {keep_state_and_data, [{reply, From, Machine}]};
handle_event({call, From}, machine, waiting, _Spec) ->
    {keep_state_and_data, [{reply, From, waiting}]};
handle_event(Type, Content, _State, _Data) ->
    logger:warning(#{what => unexpected_event, type => Type, content => Content}),
    keep_state_and_data.
