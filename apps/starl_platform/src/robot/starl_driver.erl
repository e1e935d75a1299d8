%% @doc The messages between a robot's driver (a simulator's shard, the link of a real robot) and
%% the processes of its machines ({@link starl_machine_proc}, {@link starl_app_proc}). A process
%% only carries out orders, and is at rest when it has answered:
%% ```
%%   process                                   driver
%%      | -- {starl_attach, Robot, Name, Pid} -->|   once, when the process has started
%%      |<-- {starl_boot, Base} ---------------- |   the configuration; runs init/1
%%      | -- {starl_done, Robot, Pid, Actions} ->|
%%      |<-- {starl_step, Type, Content, Meta} --|   one event
%%      | -- {starl_done, Robot, Pid, Actions} ->|
%% '''
%% An answer names its process: the last answer of a killed process is not taken for its
%% successor's. A driver has one open order with a process at a time.
-module(starl_driver).

-export([attach/3, done/3, boot/1, step/3, later/2, restarted/1]).

-export_type([attach/0, order/0, done/0]).

%% A process has started as the machine of this name.
-type attach() :: {starl_attach, starl:robot_id(), starl_machine:name(), pid()}.

%% An order to a process: start its machine, or handle an event.
-type order() ::
    {starl_boot, Base :: starl_machine:config()}
    | {starl_step, starl_machine:event_type(), Content :: term(), starl_machine:meta()}.

%% The answer to an order.
-type done() :: {starl_done, starl:robot_id(), pid(), [starl_machine:action()]}.

%% @doc A process tells its driver that it has started.
-spec attach(pid(), starl:robot_id(), starl_machine:name()) -> attach().
attach(Driver, Robot, Name) -> Driver ! {starl_attach, Robot, Name, self()}.

%% @doc A process tells its driver that it has carried out its order.
-spec done(pid(), starl:robot_id(), [starl_machine:action()]) -> done().
done(Driver, Robot, Actions) -> Driver ! {starl_done, Robot, self(), Actions}.

%% @doc The order to start.
-spec boot(Base :: starl_machine:config()) -> order().
boot(Base) -> {starl_boot, Base}.

%% @doc The order to handle an event.
-spec step(starl_machine:event_type(), Content :: term(), starl_machine:meta()) -> order().
step(Type, Content, Meta) -> {starl_step, Type, Content, Meta}.

%% @doc The same order, handed over at a later time of the robot's clock.
-spec later(NowUs :: integer(), order()) -> order().
later(Now, {starl_boot, Base}) -> {starl_boot, Base#{now := Now}};
later(Now, {starl_step, Type, Content, Meta}) -> {starl_step, Type, Content, Meta#{now := Now}}.

%% @doc The machines whose restart these orders tell of.
-spec restarted([order()]) -> [starl_machine:name()].
restarted(Orders) -> [Name || {starl_step, info, {restarted, Name}, _Meta} <- Orders].
