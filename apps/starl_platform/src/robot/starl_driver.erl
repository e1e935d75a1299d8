%% @doc The behaviour of a robot's driver: a simulator's shard, the checker, or the link of a real
%% robot. A driver adds time, a store, a trace, and the world ({@link starl_platform}) to a
%% {@link starl_robot}, through callbacks with a state of its own.
%%
%% Rules for a driver:
%% <ul>
%% <li>The driver hands in an event of the world or of a timer when the robot is quiet, one at a
%%   time, ordered by time, then class (`starl_robot_order.hrl'). Local events come before.</li>
%% <li>A planned timer is never taken back: when its event comes, {@link starl_robot:expire/4} says whether
%%   the timer still runs; the event of a cancelled or replaced timer is dropped there.</li>
%% <li>While a process is at work the driver hands in nothing else. The actions and trace events of
%%   the process have the time at which its event began, not the time of its answer. Actions with a
%%   latest moment (`until') take place only if the driver's `present' time allows it.</li>
%% <li>A simulator can stall the robot in mid-step ({@link starl_robot:stand_still/3}). The turn
%% ends there (`stands'), and the driver hands in nothing before {@link starl_robot:go_on/1}. The
%% rest of the step takes place at the time of that call.</li>
%% <li>An answer counts only if it comes from the process at work: see {@link starl_robot:answered/3}.</li>
%% <li>A process may attach before the end of its predecessor is known. It has to wait until that
%%   end has been handled ({@link starl_robot_machines:attach/3} returns `early').</li>
%% <li>A full store crashes the machine that stores: the driver ends its process, if it has one,
%%   and no later action of the machine takes place.</li>
%% <li>When the robot goes down or dies, or its services are given up, the chassis stops
%%   (`stop'), and only events of the chassis itself reach the robot.</li>
%% </ul>
%%
%% The module also has the messages between the driver and the processes of the robot's machines
%% ({@link starl_machine_proc}, {@link starl_app_proc}). A process only carries out orders, and is
%% at rest when it has answered:
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

-export([attach/3, done/3, boot/1, step/3, event/2, later/2, restarted/1]).

-export_type([world/0, attach/0, order/0, done/0]).

%% The driver's own state.
-type world() :: term().

%% A process has started as the machine of this name.
-type attach() :: {starl_attach, starl:robot_id(), starl_machine:name(), pid()}.

%% An order to a process: start its machine, or handle an event.
-type order() ::
    {starl_boot, Base :: starl_machine:config()}
    | {starl_step, starl_machine:event_type(), Content :: term(), starl_machine:meta()}.

%% The answer to an order.
-type done() :: {starl_done, starl:robot_id(), pid(), [starl_machine:action()]}.

%% Notes that a machine is about to handle a local event, or to boot. The driver itself notes
%% an event that it hands in.
-callback handles(starl_machine:name(), starl_machine:event_type() | boot, Content, World) ->
    World
when
    Content :: term(), World :: world().
%% The time of the robot's own clock at which the present step began, in microseconds.
-callback clock(world()) -> integer().
%% The time that the robot's own clock shows now, in mid-step.
-callback present(world()) -> integer().
%% The start configuration of a machine, but for `life', which the robot adds.
-callback base(starl_machine:name(), Incarnation :: pos_integer(), world()) ->
    starl_machine:config().
%% Records a fact.
-callback trace(starl_machine:name(), Event :: term(), World) -> World when World :: world().
%% Plans a timer's event after this time by the robot's clock; returns the mark of the event.
-callback plan(starl_machine:name(), starl_robot_timers:timer(), Us, Content, World) ->
    {starl_robot_timers:mark(), World}
when
    Us :: non_neg_integer(), Content :: term(), World :: world().
%% Makes a term durable for a machine in place of its earlier term; `full': nothing is stored.
-callback store(starl_machine:name(), term(), World) -> {ok, World} | full when World :: world().
%% The application has ended.
-callback ended(starl_robot:ended(), World) -> World when World :: world().

%% @doc A process notifies its driver that it has started.
-spec attach(pid(), starl:robot_id(), starl_machine:name()) -> attach().
attach(Driver, Robot, Name) -> Driver ! {starl_attach, Robot, Name, self()}.

%% @doc A process notifies its driver that it has carried out its order.
-spec done(pid(), starl:robot_id(), [starl_machine:action()]) -> done().
done(Driver, Robot, Actions) -> Driver ! {starl_done, Robot, self(), Actions}.

%% @doc The order to start.
-spec boot(Base :: starl_machine:config()) -> order().
boot(Base) -> {starl_boot, Base}.

%% @doc The order to handle an event.
-spec step(starl_machine:event_type(), Content :: term(), starl_machine:meta()) -> order().
step(Type, Content, Meta) -> {starl_step, Type, Content, Meta}.

%% @doc The local event of this machine that the order was made of.
-spec event(starl_machine:name(), order()) -> starl_robot:local().
event(Name, {starl_boot, _Base}) -> {Name, boot, none};
event(Name, {starl_step, Type, Content, _Meta}) -> {Name, Type, Content}.

%% @doc The same order, handed over at a later time of the robot's clock.
-spec later(NowUs :: integer(), order()) -> order().
later(Now, {starl_boot, Base}) -> {starl_boot, Base#{now := Now}};
later(Now, {starl_step, Type, Content, Meta}) -> {starl_step, Type, Content, Meta#{now := Now}}.

%% @doc The machines whose restart these orders report.
-spec restarted([order()]) -> [starl_machine:name()].
restarted(Orders) -> [Name || {starl_step, info, {restarted, Name}, _Meta} <- Orders].
