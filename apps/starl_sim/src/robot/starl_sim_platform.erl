%% @doc The simulator as a platform: one robot's clock, radio and vehicle in virtual time.
%%
%% All network, sensor and actuator draws are stateless: a hash of the seed, the robots, a
%% count and a purpose, so removing a draw shifts no other. Other robots are seen
%% as they were at the beginning of the present window (`sight'), which makes the result
%% independent of how robots are spread over shards.
%%
%% One record holds the values that an event changes; it is copied with each change. Values that
%% change less often ({@link starl_sim_vehicle}, {@link starl_sim_chain}) have records of their own.
-module(starl_sim_platform).
-behaviour(starl_platform).
-behaviour(starl_driver).
-include_lib("starl_platform/include/starl_robot_order.hrl").

-export([new/3, open/3, come/3, rest/2, at/2, soon/1, planned/1, yield/1]).
-export([handles/4, clock/1, present/1, moment/1, base/3, trace/3, plan/5, store/3, ended/2]).
-export([perform/3, stop/1]).
-export([pending/1, now/1, piece/1, happens/5, chain/1, packets/1, stored/2, result/1]).
-export([strike_store/3]).
-export([ride/2, says/2, plan_event/2, postpone/2, reload/2, fallen/3, tell_all/2]).
-export([turn_off/2]).

-export_type([t/0, yield/0]).

%% The yield of a window: events for other robots or later windows; the trace, newest
%% first; whether the robot's motion has changed, and whether its application has ended.
-type yield() :: {
    [starl_sim_queue:event()], [starl_monitor:trace_event()], Changes :: [moved | ended]
}.

-record(body, {
    id :: starl:robot_id(),
    world :: starl_sim_world:t(),
    now = 0 :: starl_sim_queue:time(),
    %% when the present window began, if the robot is in one, and when it ends
    window = none :: starl_sim_queue:time() | none,
    until = 0 :: starl_sim_queue:time(),
    clock :: starl_sim_clock:t(),
    seq = 0 :: non_neg_integer(),
    timers = starl_sim_timers:new() :: starl_sim_timers:t(),
    transmitter = starl_sim_transmitter:new() :: starl_sim_transmitter:t(),
    vehicle :: starl_sim_vehicle:t(),
    store :: starl_sim_store:t(),
    chain :: starl_sim_chain:t(),
    result = running :: running | given_up | {done, term()},
    %% the yield: own events of this window, all other events, the trace, newest first
    soon = [] :: [starl_sim_queue:event()],
    later = [] :: [starl_sim_queue:event()],
    traces = [] :: [starl_monitor:trace_event()],
    changes = [] :: [moved | ended]
}).

-opaque t() :: #body{}.

%% @doc A robot at rest at a pose. Its clock is drawn from the seed within the given bounds.
-spec new(starl:robot_id(), starl:pose(), starl_sim_world:t()) -> t().
new(Id, Pose, World) ->
    Vehicle = starl_sim_vehicle:new(Id, Pose, World),
    #body{
        id = Id,
        world = World,
        chain = starl_sim_chain:new(starl_sim_world:recorded(Id, World)),
        clock = starl_sim_world:clock(Id, World),
        vehicle = Vehicle,
        store = starl_sim_store:new(starl_sim_world:faults(Id, store, World)),
        traces = [{0, Id, chassis, {motion, starl_sim_vehicle:piece(Vehicle)}}]
    }.

%% @doc The robot at a later time, in a new window; its yield begins with what happened
%% since the last one.
-spec open(starl_sim_queue:time(), starl_sim_queue:window(), t()) -> t().
open(Now, {From, Until}, #body{window = none} = Body) ->
    Body#body{now = Now, window = From, until = Until};
open(Now, {From, Until}, Body) ->
    Body#body{
        now = Now, window = From, until = Until, later = [], traces = [], changes = []
    }.

%% @doc The events of the window that take place: not those of timers that no longer run or have
%% been restarted.
-spec come([starl_sim_queue:event()], Running :: starl_robot_timers:t(), t()) ->
    {[starl_sim_queue:event()], t()}.
come(Events, Running, #body{timers = Before, until = Until, later = Later} = Body) ->
    case starl_sim_timers:come(Events, Until, Running, Before) of
        {Come, [], Before} -> {Come, Body};
        {Come, Put, Timers} -> {Come, Body#body{timers = Timers, later = Put ++ Later}}
    end.

%% @doc The robot at a later time, between two windows.
-spec rest(starl_sim_queue:time(), t()) -> t().
rest(Now, #body{window = none} = Body) ->
    Body#body{now = Now};
rest(Now, Body) ->
    Body#body{now = Now, window = none, until = Now, later = [], traces = [], changes = []}.

%% @doc The robot at a later time of the same window.
-spec at(starl_sim_queue:time(), t()) -> t().
at(Now, Body) -> Body#body{now = Now}.

%% @doc The robot's new events of the present window.
-spec soon(t()) -> [starl_sim_queue:event()].
soon(#body{soon = Soon}) -> Soon.

%% @doc The events that the present window has planned so far, and those that wait behind others.
-spec pending(t()) -> [starl_sim_queue:event()].
pending(#body{soon = Soon, later = Later, timers = Timers}) ->
    Soon ++ Later ++ starl_sim_timers:waiting(Timers).

%% @doc Marks the new events of the present window as planned.
-spec planned(t()) -> t().
planned(Body) -> Body#body{soon = []}.

%% @doc The yield of the present window.
-spec yield(t()) -> yield().
yield(#body{later = Later, traces = Traces, changes = Changes}) -> {Later, Traces, Changes}.

%% @doc The start configuration of a machine.
-spec base(starl_machine:name(), Incarnation :: pos_integer(), t()) -> starl_machine:config().
base(Name, Incarnation, #body{id = Id, world = World, store = Store} = Body) ->
    Code = starl_reload:code(Name, starl_sim_store:codes(Store)),
    Own = Code#{stored => stored(Name, Body), now => clock(Body)},
    maps:merge(Own, starl_sim_world:base(Id, Name, Incarnation, World)).

%% @doc The term that a machine finds when it starts now.
-spec stored(starl_machine:name(), t()) -> starl_machine:stored().
stored(Name, #body{now = Now, store = Store}) -> starl_sim_store:kept(Name, Now, Store).

%% @doc The application has ended. Its first end counts, unless a result follows.
-spec ended(starl_robot:ended(), t()) -> t().
ended({done, _} = Done, Body) -> (over(Body))#body{result = Done};
ended(given_up, #body{result = running} = Body) -> (over(Body))#body{result = given_up};
ended(_, Body) -> over(Body).

over(#body{result = running, changes = Changes} = Body) -> Body#body{changes = [ended | Changes]};
over(Body) -> Body.

%% @doc Other values of the world hold from now on, as after a branch.
-spec turn_off(Later :: map(), t()) -> t().
turn_off(Later, #body{world = World0, vehicle = Vehicle} = Body) ->
    World = maps:merge(World0, Later),
    Body#body{world = World, vehicle = starl_sim_vehicle:in_world(World, Vehicle)}.

%% @doc The robot's virtual time.
-spec now(t()) -> starl_sim_queue:time().
now(#body{now = Now}) -> Now.

%% @doc The robot's own clock in microseconds.
-spec clock(t()) -> integer().
clock(#body{now = Now, clock = Clock}) -> starl_sim_clock:local(Now, Clock).

%% @doc The same: a step takes no time, unless the robot stands still in it, and then its time goes on.
-spec present(t()) -> integer().
present(Body) -> clock(Body).

%% @doc The beginning of a life of the robot that comes up now.
-spec moment(t()) -> starl_robot_machines:moment().
moment(#body{id = Id, now = Now, world = #{seed := Seed}, chain = Chain} = Body) ->
    Key = {Seed, Id, life, Now, starl_sim_chain:events(Chain)},
    {clock(Body) div 1000, starl_run_draw:between(Key, 0, starl_robot_machines:lots() - 1)}.

%% @doc The piece of motion that the robot is in.
-spec piece(t()) -> starl_trajectory:piece().
piece(#body{vehicle = Vehicle}) -> starl_sim_vehicle:piece(Vehicle).

%% @doc Chains a local event into the robot's digest.
-spec handles(starl_machine:name(), starl_machine:event_type() | boot, term(), t()) -> t().
handles(Machine, boot, Content, #body{store = Store} = Body) ->
    %% a robot knows no time but its own clock's
    {Told, Begun} = starl_sim_codes:started(Machine, clock(Body), Store),
    all_reloaded(Told, Machine, chained(Machine, boot, Content, Body#body{store = Begun}));
handles(Machine, Type, Content, Body) ->
    chained(Machine, Type, starl_sim_chain:counted(Type, Content), Body).

chained(Machine, Type, Content, #body{now = Now, chain = Chain} = Body) ->
    Body#body{chain = starl_sim_chain:add(Now, Machine, Type, Content, Chain)}.

%% @doc The same for an event at a later time than the last one.
-spec happens(
    starl_sim_queue:time(), starl_machine:name(), starl_machine:event_type() | boot, term(), t()
) -> t().
happens(Now, Machine, Type, Content, #body{chain = Chain} = Body) ->
    Body#body{now = Now, chain = starl_sim_chain:add(Now, Machine, Type, Content, Chain)}.

%% @doc The chain of the robot's events.
-spec chain(t()) -> starl_sim_chain:t().
chain(#body{chain = Chain}) -> Chain.

%% @doc The number of packets that the robot has sent.
-spec packets(t()) -> non_neg_integer().
packets(#body{transmitter = Transmitter}) -> starl_sim_transmitter:packets(Transmitter).

%% @doc The result of the application.
-spec result(t()) -> running | given_up | {done, term()}.
result(#body{result = Result}) -> Result.

%% -- the actions of machines on the world ---------------------------------------------------

%% @doc Carries out an action of a machine on the world.
-spec perform(
    starl_platform:world_action()
    | {transmit, starl:robot_id(), starl_sim_transmitter:datagram()},
    starl_machine:name(),
    t()
) ->
    {[starl_robot:local()], t()}.
perform({transmit, Dest, Packet}, _Name, Body) ->
    {[], transmit(Dest, Packet, Body)};
perform({drive, Script, Mark}, Name, Body) ->
    Effect = starl_sim_ride:drive(Script, {Name, Mark}, Body#body.vehicle, place(Body)),
    {[], carried(Effect, Body)};
perform({sense, Robots, Tag}, Name, #body{id = Id, vehicle = Vehicle} = Body) ->
    {Seen, Sensed} = starl_sim_ride:sense(Robots, Id, look(Body), Vehicle),
    {[{Name, info, {located, Tag, Seen}}], Body#body{vehicle = Sensed}};
perform({feel, Kind, Tag}, Name, #body{vehicle = Vehicle} = Body) ->
    {Felt, Looked} = starl_sim_vehicle:feel(Kind, look(Body), Vehicle),
    {[{Name, info, {felt, Tag, Felt}}], Body#body{vehicle = Looked}};
perform({actuate, Device, Value}, _Name, Body) ->
    {[], actuate({Device, Value}, none, Body)};
perform({actuate, Device, Value, Mark}, Name, Body) ->
    {[], actuate({Device, Value}, {Name, Mark}, Body)};
perform({until, _Us, {trace, Event}, _Mark}, Name, Body) ->
    %% it leaves with the look of its group
    {[], trace(Name, Event, Body)};
perform({until, Us, Action, Mark}, Name, Body) ->
    perform(present(Body) =< Us, Action, Mark, Name, Body);
perform({outlived, N}, _Name, Body) ->
    {[], outlived(N, Body)};
perform({reloaded, #{tell := Tell} = Told}, Name, #body{world = World} = Body) ->
    Others = starl_sim_codes:to_tell(Tell, Name, World),
    {[{To, info, {restarted, Name}} || To <- Others], reloaded(Told, Name, Body)}.

perform(true, Action, _Mark, Name, Body) -> perform(Action, Name, Body);
perform(false, _Action, Mark, Name, Body) -> {[{Name, info, {late, Mark}}], Body}.

%% @doc Keeps a term of a machine over crashes and reboots.
-spec store(starl_machine:name(), term(), t()) -> {ok, t()} | full.
store(Name, Term, #body{store = Store, now = Now} = Body) ->
    case starl_sim_store:keep(Name, Term, Now, Store) of
        {ok, Next} -> {ok, Body#body{store = Next}};
        full -> full
    end.

%% @doc The robot's store is struck; its machines have started so often, and from now on so often.
-spec strike_store(starl_sim_store:strike(), Starts, t()) -> {Starts, t()} when
    Starts :: starl_robot_machines:starts().
strike_store(Strike, Starts, #body{store = Store} = Body) ->
    {Next, Facts, Struck} = starl_sim_store:strike(Strike, Starts, Store),
    {Next, told(robot, Facts, Body#body{store = Struck})}.

%% The whole robot starts anew, once this step is over.
outlived(N, #body{id = Id, now = Now} = Body) ->
    plan_event({Id, Now, ?CLASS_WORLD, {outlived, N}}, Body).

%% -- new code -------------------------------------------------------------------------------

%% @doc Begins a reload, or handles its failure: returns the commands for the robot's machines.
-spec reload(starl_sim_codes:order(), t()) -> {starl_sim_codes:words(), t()}.
reload(Order, #body{world = World, store = Store} = Body) ->
    {Words, Next, Kept} = starl_sim_codes:reload(Order, World, Store),
    {Words, Body#body{world = Next, store = Kept}}.

%% @doc A machine has ended by itself: new code on trial is given up.
-spec fallen(starl_machine:name(), starl_crash:cause() | none, t()) -> t().
fallen(Name, Cause, #body{store = Store} = Body) ->
    all_reloaded(starl_sim_codes:fallen(Name, Cause, clock(Body), Store), Name, Body).

all_reloaded(Told, Name, Body) ->
    lists:foldl(fun(One, B) -> reloaded(One, Name, B) end, Body, Told).

reloaded(#{number := N, outcome := Outcome} = Told, Name, Body) ->
    #body{id = Id, now = Now, world = World, store = Store} = Body,
    {News, Kept} = starl_sim_codes:heeded(Told, Name, {Id, Now, World}, Store),
    tell_all(News, trace(Name, {reloaded, N, Outcome}, Body#body{store = Kept})).

%% @doc Sends the news of a reload to robots.
-spec tell_all([starl_sim_codes:news()], t()) -> t().
tell_all(News, Body) ->
    lists:foldl(
        fun({Robot, Due, Content}, B) -> plan_event({Robot, Due, ?CLASS_WORLD, Content}, B) end,
        Body,
        News
    ).

%% -- the radio ------------------------------------------------------------------------------

transmit(To, Packet, #body{id = Id, now = Now, world = World, seq = Seq} = Body) ->
    #body{transmitter = Transmitter, later = Later, traces = Traces} = Body,
    Sender = {Id, Now, Body#body.window, piece(Body)},
    Before = {Seq, Later, Traces},
    {{Next, Planned, Traced}, Links} =
        starl_sim_transmitter:send(To, Packet, Sender, World, Before, Transmitter),
    Body#body{seq = Next, transmitter = Links, later = Planned, traces = Traced}.

%% -- the vehicle ----------------------------------------------------------------------------

%% @doc Stops the chassis: no machine commands it any more.
-spec stop(t()) -> t().
stop(Body) -> ride(stop, Body).

%% @doc The vehicle does a step.
-spec ride(starl_sim_ride:step(), t()) -> t().
ride(Step, #body{vehicle = Vehicle} = Body) ->
    carried(starl_sim_ride:step(Step, Vehicle, place(Body)), Body).

%% @doc Is the planned answer to the script of this number still valid?
-spec says(Run :: integer(), t()) -> boolean().
says(Run, #body{vehicle = Vehicle}) -> starl_sim_vehicle:says(Run, Vehicle).

look(#body{now = Now, window = From}) -> {Now, From}.

place(#body{id = Id, now = Now, until = Until, world = World}) -> {Id, Now, Until, World}.

actuate(What, Owner, #body{vehicle = Vehicle} = Body) ->
    carried(starl_sim_ride:actuate(What, Owner, Vehicle, place(Body)), Body).

carried({same, Plans, Facts, Vehicle}, Body) ->
    chassis(Plans, told(chassis, Facts, Body#body{vehicle = Vehicle}));
carried({moved, Plans, Facts, Vehicle}, #body{changes = Changes} = Body) ->
    chassis(Plans, told(chassis, Facts, Body#body{vehicle = Vehicle, changes = [moved | Changes]})).

told(_Machine, [], Body) -> Body;
told(Machine, [Fact | Facts], Body) -> told(Machine, Facts, trace(Machine, Fact, Body)).

%% The chassis' own steps come before all other events of that moment.
chassis([], Body) ->
    Body;
chassis([{Us, Content} | Plans], #body{id = Id, now = Now, seq = Seq, until = Until} = Body) ->
    Event = {Id, Now + Us, class(Content), Id, Seq, Content},
    Next =
        case Now + Us < Until of
            true -> Body#body{seq = Seq + 1, soon = [Event | Body#body.soon]};
            false -> Body#body{seq = Seq + 1, later = [Event | Body#body.later]}
        end,
    chassis(Plans, Next).

class({says, _, _, _}) -> ?CLASS_TIMER;
class({_Name, info, _}) -> ?CLASS_TIMER;
class(_Beat) -> ?CLASS_WORLD.

%% -- timers and traces ----------------------------------------------------------------------

%% @doc Plans the event of a timer, under its sequence number.
-spec plan(
    starl_machine:name(), starl_robot_timers:timer(), Us :: non_neg_integer(), term(), t()
) -> {Seq :: non_neg_integer(), t()}.
plan(Machine, Timer, Us, Content, #body{id = Id, now = Now, seq = Seq} = Body) ->
    #body{until = Until, clock = Clock} = Body,
    Due = starl_sim_clock:due(Now, Us, Clock),
    Event = {Id, Due, ?CLASS_TIMER, Id, Seq, {timer, Machine, Timer, Content}},
    case Due < Until of
        true -> {Seq, Body#body{seq = Seq + 1, soon = [Event | Body#body.soon]}};
        false -> {Seq, later(starl_sim_timers:start(Event, Body#body.timers), Event, Body)}
    end.

later({put, Timers}, Event, #body{seq = Seq, later = Later} = Body) ->
    Body#body{seq = Seq + 1, timers = Timers, later = [Event | Later]};
later({waits, Timers}, _Event, #body{seq = Seq} = Body) ->
    Body#body{seq = Seq + 1, timers = Timers}.

%% @doc Plans an event of the robot's, for itself at any time, or for another one in a later window.
-spec plan_event({starl:robot_id(), starl_sim_queue:time(), Class :: 0..2, Content :: term()}, t()) ->
    t().
plan_event({Robot, Due, Class, Content}, #body{id = Id, seq = Seq} = Body) ->
    postpone([{Robot, Due, Class, Id, Seq, Content}], Body#body{seq = Seq + 1}).

%% @doc Plans delayed events of the robot again, in this window or later ones.
-spec postpone([starl_sim_queue:event()], t()) -> t().
postpone(Events, #body{until = Until, soon = Soon, later = Later} = Body) ->
    {Now, Then} = lists:partition(fun(Event) -> element(2, Event) < Until end, Events),
    Body#body{soon = Now ++ Soon, later = Then ++ Later}.

%% @doc Records a fact.
-spec trace(starl_machine:name(), term(), t()) -> t().
trace(Machine, Event, #body{id = Id, now = Now, traces = Traces} = Body) ->
    Body#body{traces = [{Now, Id, Machine, Event} | Traces]}.
