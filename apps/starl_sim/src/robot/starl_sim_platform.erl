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
-export([outdate_store/1, save_store/3, set_back_store/2]).
-export([turn_wheels/1, beat/2, touch/2, says/2, postpone/2, reload/2, take_back/3, fallen/3]).
-export([turn_off/2, snapshot/1, restore/2, piece_of/1]).

-export_type([t/0, world/0, yield/0]).

%% The data that all robots share: the seed, the radio, the clocks and the chassis' errors, and the
%% faults of each class; faults of the serial line are among those of actuation.
%% `sight' knows the pieces of motion that all robots were in when the window began.
%% `record' names the robots and events to record; `packets': each packet is traced.
%% After a branch ({@link starl_sim_branch}) `team_seed' is the seed that all robots knew from the
%% beginning.
-type world() :: #{
    seed := integer(),
    team_seed => integer(),
    branch => starl_sim_branch:planted(),
    team := starl_team:t(),
    clock := {OffsetUs :: non_neg_integer(), DriftPpb :: non_neg_integer()},
    sight => starl_sim_sight:t(),
    loss := float(),
    duplicate := float(),
    delay_us := {Min :: pos_integer(), Max :: pos_integer()},
    range_mm := float() | infinity,
    %% the part of the packets that each wall in their way takes
    wall_loss => float(),
    %% the deviation of the loss on the way between two places, dB
    shadowing => float(),
    %% the delay of a command on its way to the chassis
    latency_us => {Min :: non_neg_integer(), Max :: non_neg_integer()},
    profiles := starl_chassis:profiles(),
    %% bodies are solid
    walls => starl_walls:t(),
    %% what stands in the way for a time, if anything does
    obstacles => starl_obstacles:t(),
    %% what the senses see on the floor, and their measures
    senses => starl_sim_senses:t(),
    network := [starl_run_fault:compiled()],
    clocks := [starl_run_fault:compiled()],
    location := [starl_run_fault:compiled()],
    sense => [starl_run_fault:compiled()],
    actuation := [starl_run_fault:compiled()],
    store := [starl_run_fault:compiled()],
    record => #{starl:robot_id() => starl_sim_ledger:range()},
    packets => boolean(),
    %% the machines of whose calls histories are kept
    histories => [starl_machine:name()],
    %% a snapshot of each robot is told this often
    snapshots_us => pos_integer(),
    %% the reloads by number, if there are any, and the modules of a robot's machines
    reloads => #{pos_integer() => starl_run_reloads:t()},
    parts => #{starl_machine:name() => module()}
}.

%% The yield of a window: events for other robots or later windows; the trace, newest
%% first; whether the robot's motion has changed, and whether its application has ended.
-type yield() :: {
    [starl_sim_queue:event()], [starl_monitor:trace_event()], Changes :: [moved | ended]
}.

-record(body, {
    id :: starl:robot_id(),
    world :: world(),
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
-spec new(starl:robot_id(), starl:pose(), world()) -> t().
new(Id, Pose, World) ->
    Vehicle = starl_sim_vehicle:new(Id, Pose, World),
    #body{
        id = Id,
        world = World,
        chain = starl_sim_chain:new(range(Id, World)),
        clock = clock(Id, World),
        vehicle = Vehicle,
        store = starl_sim_store:new(hitting(Id, store, World)),
        traces = [{0, Id, chassis, {motion, starl_sim_vehicle:piece(Vehicle)}}]
    }.

range(Id, World) -> maps:get(Id, maps:get(record, World, #{}), none).

%% Clocks do not change with a branch.
clock(Id, #{clock := {OffsetUs, DriftPpb}} = World) ->
    Seed = team_seed(World),
    Offset = round(starl_run_draw:signed({Seed, Id, offset}) * OffsetUs),
    Drift = round(starl_run_draw:signed({Seed, Id, drift}) * DriftPpb),
    starl_sim_clock:new(Offset, Drift, hitting(Id, clocks, World)).

hitting(Id, Class, World) -> [F || F <- maps:get(Class, World), starl_run_fault:hits(Id, F)].

team_seed(#{seed := Seed} = World) -> maps:get(team_seed, World, Seed).

%% @doc The body as data, between two windows: all but the world.
-spec snapshot(t()) -> map().
snapshot(#body{vehicle = Vehicle, chain = Chain} = Body) ->
    #{
        now => Body#body.now,
        seq => Body#body.seq,
        timers => Body#body.timers,
        transmitter => Body#body.transmitter,
        vehicle => starl_sim_vehicle:snapshot(Vehicle),
        store => Body#body.store,
        chain => {starl_sim_chain:value(Chain), starl_sim_chain:events(Chain)},
        result => Body#body.result
    }.

%% That of a robot that was not simulated so far.
own_clock(Id, #{clock := {Offset, Ppb}}, World) ->
    starl_sim_clock:new(Offset, Ppb, hitting(Id, clocks, World));
own_clock(Id, _Kept, World) ->
    clock(Id, World).

%% @doc The piece of motion in such data.
-spec piece_of(map()) -> starl_trajectory:piece().
piece_of(#{vehicle := Vehicle}) -> starl_sim_vehicle:piece(Vehicle).

%% @doc The body of such data in a world, whose faults strike it from now on.
-spec restore({starl:robot_id(), map()}, world()) -> t().
restore({Id, #{now := Now, chain := Chain, store := Store} = Kept}, World) ->
    #body{
        id = Id,
        world = World,
        now = Now,
        until = Now,
        clock = own_clock(Id, Kept, World),
        seq = maps:get(seq, Kept),
        timers = maps:get(timers, Kept),
        transmitter = maps:get(transmitter, Kept),
        vehicle = starl_sim_vehicle:restore(maps:get(vehicle, Kept), World),
        store = starl_sim_store:with_faults(hitting(Id, store, World), Store),
        chain = starl_sim_chain:new(range(Id, World), Chain),
        result = maps:get(result, Kept)
    }.

%% @doc The robot at a later time, in a new window; its yield begins with what happened
%% since the last one.
-spec open(starl_sim_queue:time(), starl_sim_robot:window(), t()) -> t().
open(Now, {From, Until}, #body{window = none} = Body) ->
    Body#body{now = Now, window = From, until = Until};
open(Now, {From, Until}, Body) ->
    Body#body{
        now = Now, window = From, until = Until, later = [], traces = [], changes = []
    }.

%% @doc Of these events of the window, those that come: not the timers that do not run any more, or have
%% been started anew.
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
base(Name, Incarnation, #body{id = Id, world = World} = Body) ->
    #{team := Team} = World,
    (starl_reload:code(Name, codes(Body)))#{
        robot => Id,
        participants => Team,
        name => Name,
        incarnation => Incarnation,
        stored => stored(Name, Body),
        random => rand:seed_s(exsss, stream(Name, Incarnation, Body)),
        team_seed => team_seed(World),
        now => clock(Body),
        snapshots => is_map_key(snapshots_us, World),
        histories => maps:get(histories, World, [])
    }.

%% A restart begins another stream: a robot that has started anew does not know how far it had got.
%% The first one is the same in all branches of a run: what its applications are about to do is how
%% a run begins, as the places of its robots, and no event of it.
stream(Name, 1, #body{id = Id, world = World}) ->
    erlang:phash2({team_seed(World), Id, Name}, 1 bsl 32);
stream(Name, Incarnation, #body{id = Id, world = #{seed := Seed}}) ->
    erlang:phash2({Seed, Id, Name, Incarnation}, 1 bsl 32).

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

%% @doc Chains a local event into the robot's digest. Of an answer of the positioning system only
%% the poses count: the tag and the ages are the driver's own.
-spec handles(starl_machine:name(), starl_machine:event_type() | boot, term(), t()) -> t().
handles(Machine, info, {located, _Tag, Seen}, Body) ->
    handles(Machine, info, {located, [{Robot, Pose} || {Robot, Pose, _Age} <- Seen]}, Body);
handles(Machine, info, {felt, _Tag, Felt}, Body) ->
    handles(Machine, info, {felt, Felt}, Body);
handles(Machine, code, {take, #{number := N}}, Body) ->
    %% the names of versions depend on the compiler's release
    handles(Machine, code, {take, N}, Body);
handles(Machine, boot, Content, Body) ->
    %% a robot knows no time but its own clock's
    {Told, Codes} = starl_reload:started(Machine, clock(Body), codes(Body)),
    all_reloaded(Told, Machine, chained(Machine, boot, Content, codes(Codes, Body)));
handles(Machine, Type, Content, Body) ->
    chained(Machine, Type, Content, Body).

chained(Machine, Type, Content, #body{now = Now, chain = Chain} = Body) ->
    Body#body{chain = starl_sim_chain:add(Now, Machine, Type, Content, Chain)}.

%% @doc The same for an event at a later time than the last one.
-spec happens(
    starl_sim_queue:time(), starl_machine:name(), starl_machine:event_type(), term(), t()
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
-spec perform(starl_platform:world_action(), starl_machine:name(), t()) ->
    {[starl_robot:local()], t()}.
perform({transmit, Dest, Packet}, _Name, Body) ->
    {[], transmit(Dest, Packet, Body)};
perform({drive, Script, Mark}, Name, Body) ->
    {[], drive(Script, {Name, Mark}, Body)};
perform({sense, Robots, Tag}, Name, Body) ->
    {Seen, Next} = sense(Robots, Body),
    {[{Name, info, {located, Tag, Seen}}], Next};
perform({feel, Kind, Tag}, Name, Body) ->
    {Felt, Next} = feels(Kind, Body),
    {[{Name, info, {felt, Tag, Felt}}], Next};
perform({actuate, Device, Value}, _Name, Body) ->
    {[], actuate(Device, Value, none, Body)};
perform({actuate, Device, Value, Mark}, Name, Body) ->
    {[], actuate(Device, Value, {Name, Mark}, Body)};
perform({until, _Us, {trace, Event}, _Mark}, Name, Body) ->
    %% it leaves with the look of its group
    {[], trace(Name, Event, Body)};
perform({until, Us, Action, Mark}, Name, Body) ->
    case present(Body) =< Us of
        true -> perform(Action, Name, Body);
        false -> {[{Name, info, {late, Mark}}], Body}
    end;
perform({outlived, N}, _Name, Body) ->
    {[], outlived(N, Body)};
perform({reloaded, #{tell := Tell} = Told}, Name, Body) ->
    {
        [{To, info, {restarted, Name}} || To <- to_tell(Tell, Name, Body)],
        reloaded(Told, Name, Body)
    }.

%% @doc Keeps a term of a machine over crashes and reboots.
-spec store(starl_machine:name(), term(), t()) -> {ok, t()} | full.
store(Name, Term, #body{store = Store, now = Now} = Body) ->
    case starl_sim_store:keep(Name, Term, Now, Store) of
        {ok, Next} -> {ok, Body#body{store = Next}};
        full -> full
    end.

%% @doc The robot's store is lost, or known to be an old one.
-spec outdate_store(t()) -> t().
outdate_store(#body{store = Store} = Body) -> Body#body{store = starl_sim_store:outdate(Store)}.

%% The whole robot starts anew, once this step is over.
outlived(N, #body{id = Id, now = Now, seq = Seq, soon = Soon} = Body) ->
    Body#body{seq = Seq + 1, soon = [{Id, Now, ?CLASS_WORLD, Id, Seq, {outlived, N}} | Soon]}.

%% @doc Takes an image of the robot's store, with the numbers of starts, for a fault of this name.
-spec save_store(Fault :: atom(), starl_robot_machines:starts(), t()) -> t().
save_store(Fault, Starts, #body{store = Store} = Body) ->
    Body#body{store = starl_sim_store:save(Fault, Starts, Store)}.

%% @doc The robot's store is as it was when that image was taken.
-spec set_back_store(Fault :: atom(), t()) -> {starl_robot_machines:starts(), t()}.
set_back_store(Fault, #body{store = Store} = Body) ->
    {Starts, Earlier} = starl_sim_store:set_back(Fault, Store),
    {Starts, trace(robot, store_set_back, Body#body{store = Earlier})}.

%% -- new code -------------------------------------------------------------------------------

%% @doc A reload begins, one of the scenario by its number, or another: the words for the robot's machines,
%% which start with this code from now on.
-spec reload(starl_reload:count() | starl_run_reloads:t(), t()) ->
    {[{starl_machine:name(), starl_reload:word()}], t()}.
reload(#{order := #{number := N}} = Reload, #body{world = World} = Body) ->
    Reloads = maps:get(reloads, World, #{}),
    reload(N, Body#body{world = World#{reloads => Reloads#{N => Reload}}});
reload(N, #body{world = #{reloads := Reloads, parts := Parts}} = Body) ->
    #{N := #{order := Order}} = Reloads,
    {Words, Codes} = starl_reload:take(Order, Parts, codes(Body)),
    {Words, codes(Codes, Body)}.

%% @doc A reload has failed elsewhere: the machines that have to go back, which start with the
%% former code from now on.
-spec take_back(pos_integer(), Failed :: starl:robot_id(), t()) ->
    {[{starl_machine:name(), starl_reload:word()}], t()}.
take_back(N, Failed, Body) ->
    {Words, Codes} = starl_reload:back(N, Failed, codes(Body)),
    {Words, codes(Codes, Body)}.

codes(#body{store = Store}) -> starl_sim_store:codes(Store).

codes(Codes, #body{store = Store} = Body) -> Body#body{store = starl_sim_store:codes(Codes, Store)}.

to_tell(nobody, _Name, _Body) ->
    [];
to_tell(others, Name, #body{world = #{parts := Parts}}) ->
    lists:delete(Name, lists:sort(maps:keys(Parts))).

%% @doc A machine has ended by itself: new code on trial, which it could not even start with or
%% which could not go back in peace, is given up.
-spec fallen(starl_machine:name(), starl_crash:cause() | none, t()) -> t().
fallen(_Name, none, Body) ->
    Body;
fallen(Name, Cause, Body) ->
    all_reloaded(starl_reload:fallen(Name, Cause, clock(Body), codes(Body)), Name, Body).

all_reloaded(Told, Name, Body) ->
    lists:foldl(fun(One, B) -> reloaded(One, Name, B) end, Body, Told).

reloaded(Told, Name, #body{id = Id} = Body) ->
    #{number := N, outcome := Outcome, module := Module} = Told,
    Traced = trace(Name, {reloaded, N, Outcome}, Body),
    Line = unicode:characters_to_binary(starl_reload:format(Id, Name, Module, Outcome)),
    logger:notice(#{what => reload, number => N, outcome => Line}, #{domain => [starl, sim]}),
    Heard = codes(starl_reload:heard(Name, Told, codes(Traced)), Traced),
    case starl_reload:is_failure(Outcome) of
        true -> tell_all(N, Heard);
        false -> Heard
    end.

tell_all(N, #body{id = Id, world = #{reloads := Reloads} = World} = Body) ->
    #{N := #{robots := Robots}} = Reloads,
    #{delay_us := {Window, _}} = World,
    Due = Body#body.now + starl_run_reloads:news_us(Window),
    lists:foldl(fun(Robot, B) -> told(Robot, Due, {reload_failed, N, Id}, B) end, Body, Robots).

told(Robot, Due, News, #body{id = Id, seq = Seq, later = Later} = Body) ->
    Body#body{seq = Seq + 1, later = [{Robot, Due, ?CLASS_WORLD, Id, Seq, News} | Later]}.

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
stop(#body{now = Now, vehicle = Vehicle} = Body) ->
    moved(starl_sim_vehicle:stop(Now, Vehicle), Body).

%% @doc Adapts the motion when a fault of the drive begins or ends.
-spec turn_wheels(t()) -> t().
turn_wheels(#body{now = Now, vehicle = Vehicle} = Body) ->
    moved(starl_sim_vehicle:turn_wheels(Now, Vehicle), Body).

%% @doc The chassis does its planned step.
-spec beat(starl_sim_vehicle:beat(), t()) -> t().
beat(Beat, #body{now = Now, vehicle = Vehicle} = Body) ->
    moved(starl_sim_vehicle:beat(Beat, Now, Vehicle), Body).

%% @doc Is the planned answer to the script of this number still valid?
-spec says(Run :: integer(), t()) -> boolean().
says(Run, #body{vehicle = Vehicle}) -> starl_sim_vehicle:says(Run, Vehicle).

drive(Script, Owner, #body{now = Now, vehicle = Vehicle} = Body) ->
    case starl_sim_vehicle:drive(Script, Owner, Now, Vehicle) of
        {lost, Deaf} -> Body#body{vehicle = Deaf};
        not_understood -> trace(chassis, {not_understood, element(2, Script)}, Body);
        Change -> moved(Change, Body)
    end.

actuate(Device, Value, Owner, #body{now = Now, vehicle = Vehicle} = Body) ->
    {Set, Plans, Actuated} = starl_sim_vehicle:actuate({Device, Value}, Owner, Now, Vehicle),
    Planned = chassis(Plans, Body#body{vehicle = Actuated}),
    case Set of
        set -> trace(chassis, {actuated, Device, Value}, Planned);
        same -> Planned
    end.

moved({moved, Plans, Vehicle}, #body{world = #{walls := _}} = Body) ->
    #body{id = Id, now = Now, until = Until, world = World} = Body,
    Piece = starl_sim_vehicle:piece(Vehicle),
    case starl_sim_bodies:contact(Id, Piece, Now, Until, World) of
        {blocked, With} -> bump(With, chassis(Plans, Body#body{vehicle = Vehicle}));
        none -> free({moved, Plans, Vehicle}, Body);
        Touch -> free({moved, [Touch | Plans], Vehicle}, Body)
    end;
moved(Moved, Body) ->
    free(Moved, Body).

%% @doc The robot touches something, as was planned, unless its motion has changed since, or the other's.
-spec touch(starl_sim_bodies:touch(), t()) -> t().
touch({touch, Piece, With}, Body) ->
    case piece(Body) of
        Piece -> touched(With, Body);
        _ -> Body
    end;
touch({look, Piece}, Body) ->
    case piece(Body) of
        Piece -> look(Piece, Body);
        _ -> Body
    end.

touched({wall, _} = Wall, Body) ->
    bump(Wall, Body);
touched({robot, Other, Piece, Stops}, #body{world = #{sight := Sight}} = Body) ->
    case starl_sim_sight:piece(Other, Sight) of
        {ok, Piece} when Stops -> bump({robot, Other}, Body);
        {ok, Piece} -> feel({robot, Other}, Body);
        _ -> Body
    end.

%% The shards look at it, too.
look(Piece, #body{id = Id, now = Now, until = Until, world = World, changes = Changes} = Body) ->
    Seen = Body#body{changes = [moved | Changes]},
    case starl_sim_bodies:contact(Id, Piece, Now, Until, World) of
        {blocked, With} -> bump(With, Body);
        none -> Seen;
        Touch -> chassis([Touch], Seen)
    end.

bump(With, #body{now = Now, vehicle = Vehicle} = Body) ->
    feel(With, free(starl_sim_vehicle:bump(Now, Vehicle), Body)).

%% Its application is told, too.
feel(With, #body{now = Now, world = World} = Body) ->
    Pose = starl_trajectory:pose(Now, piece(Body)),
    Sense = {bump, starl_sim_bodies:side(starl_sim_bodies:place(With, Pose, Now, World), Pose)},
    chassis([{0, {app, info, {sensed, Sense}}}], trace(chassis, {sensed, Sense}, Body)).

free({same, Plans, Vehicle}, Body) ->
    chassis(Plans, Body#body{vehicle = Vehicle});
free({moved, Plans, Vehicle}, #body{changes = Changes} = Body) ->
    Moved = Body#body{vehicle = Vehicle, changes = [moved | Changes]},
    chassis(Plans, trace(chassis, {motion, starl_sim_vehicle:piece(Vehicle)}, Moved)).

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

%% The robot itself is seen as it is now, the others as of the beginning of the window.
sense(Robots, #body{id = Id, now = Now, window = From, vehicle = Vehicle} = Body) ->
    {Poses, Sensed} = starl_sim_vehicle:sense(Robots, {Now, From}, Vehicle),
    Age = fun
        (Robot) when Robot =:= Id -> 0;
        (_Other) -> Now - From
    end,
    {[{Robot, Pose, Age(Robot)} || {Robot, Pose} <- Poses], Body#body{vehicle = Sensed}}.

feels(Kind, #body{now = Now, window = From, vehicle = Vehicle} = Body) ->
    {Felt, Looked} = starl_sim_vehicle:feel(Kind, {Now, From}, Vehicle),
    {Felt, Body#body{vehicle = Looked}}.

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

%% @doc Plans delayed events of the robot again, in this window or later ones.
-spec postpone([starl_sim_queue:event()], t()) -> t().
postpone(Events, #body{until = Until, soon = Soon, later = Later} = Body) ->
    {Now, Then} = lists:partition(fun(Event) -> element(2, Event) < Until end, Events),
    Body#body{soon = Now ++ Soon, later = Then ++ Later}.

%% @doc Records a fact.
-spec trace(starl_machine:name(), term(), t()) -> t().
trace(Machine, Event, #body{id = Id, now = Now, traces = Traces} = Body) ->
    Body#body{traces = [{Now, Id, Machine, Event} | Traces]}.
