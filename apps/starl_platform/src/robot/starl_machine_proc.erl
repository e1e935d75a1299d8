%% @doc The process around a {@link starl_machine}: a thin gen_statem.
%%
%% The process is stepped by its driver (a simulator shard, or the link of a real robot) and is
%% quiescent when it has answered:
%% ```
%%   process                          driver
%%      | -- {starl_attach, Robot, Name, Pid} -->|   once, when the process has started
%%      |<-- {starl_boot, Base} ---------------- |   the configuration; runs init/1
%%      | -- {starl_done, Pid, Actions} -------->|
%%      |<-- {starl_step, Type, Content, Meta} --|   one event
%%      | -- {starl_done, Pid, Actions} -------->|
%% '''
%% {@link starl_app_proc} speaks the same protocol. `sys:get_state/1' shows the machine.
-module(starl_machine_proc).
-behaviour(gen_statem).

-export([start_link/1]).
-export([init/1, callback_mode/0, handle_event/4]).

-export_type([spec/0]).

%% What the process needs to know.
-type spec() :: #{
    robot := starl:robot_id(),
    name := starl_machine:name(),
    module := module(),
    config := map(),
    driver := pid()
}.

-record(shell, {driver :: pid(), module :: module(), config :: map()}).

%% @doc Starts the process and attaches it to its driver.
-spec start_link(spec()) -> {ok, pid()} | {error, term()}.
start_link(Spec) ->
    gen_statem:start_link(?MODULE, Spec, [{spawn_opt, [{fullsweep_after, 20}]}]).

-spec callback_mode() -> gen_statem:callback_mode_result().
callback_mode() -> handle_event_function.

-spec init(spec()) -> {ok, waiting, #shell{}}.
init(#{robot := Robot, name := Name, module := Module, config := Config, driver := Driver}) ->
    logger:set_process_metadata(#{domain => [starl, robot], robot => Robot, machine => Name}),
    Driver ! {starl_attach, Robot, Name, self()},
    {ok, waiting, #shell{driver = Driver, module = Module, config = Config}}.

-spec handle_event(gen_statem:event_type(), term(), waiting | starl_machine:t(), #shell{}) ->
    gen_statem:event_handler_result(starl_machine:t()).
handle_event(info, {starl_step, Type, Content, Meta}, Machine, #shell{driver = Driver} = Shell) ->
    {Actions, Next} = starl_machine:step(Type, Content, Meta, Machine),
    Driver ! {starl_done, self(), Actions},
    {next_state, Next, Shell};
handle_event(info, {starl_boot, Base}, waiting, Shell) ->
    #shell{driver = Driver, module = Module, config = Config} = Shell,
    {Actions, Machine} = starl_machine:new(Module, Config, Base),
    Driver ! {starl_done, self(), Actions},
    {next_state, Machine, Shell};
handle_event(Type, Content, _Machine, _Shell) ->
    logger:warning(#{what => unexpected_event, type => Type, content => Content}),
    keep_state_and_data.
