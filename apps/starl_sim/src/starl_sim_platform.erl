%% @doc The simulator as a platform: one robot's clock, radio and vehicle in virtual time.
%%
%% All network, sensor and actuator draws are stateless: a hash of the seed, the robots, a
%% count and a purpose, so that taking one of them away shifts no other. Other robots are seen
%% as they were at the beginning of the present window (`sight'), which makes the result
%% independent of how robots are spread over shards.
%%
%% What an event changes lies in one record, which is copied with each change: what changes less
%% often ({@link starl_sim_vehicle}), or once ({@link starl_sim_chain}), has a record of its own.
-module(starl_sim_platform).
-behaviour(starl_platform).

-export([new/3, boot/4, open/3, rest/2, at/2, soon/1, planned/1, yield/1]).
-export([fire/6, forget_timers/2, ended/1, give_up/1, local_time/1]).
-export([now/1, piece/1, hash_event/4, hash_event/5, chain/1, packets/1, result/1]).
-export([perform/3, trace/3, stop/1, turn_wheels/1, beat/2, says/2, postpone/2]).

-export_type([t/0, world/0, yield/0]).

%% What all robots share: the seed, the radio, the clocks and the chassis' errors, and the faults
%% of each class; those of the serial line are with those of actuation.
%% `sight' knows the pieces of motion that all robots were in when the window began.
%% `record' says whose events are to be kept, and which.
-type world() :: #{
    seed := integer(),
    team := starl_team:t(),
    clock := {OffsetUs :: non_neg_integer(), DriftPpb :: non_neg_integer()},
    sight => starl_sim_sight:t(),
    loss := float(),
    duplicate := float(),
    delay_us := {Min :: pos_integer(), Max :: pos_integer()},
    range_mm := float() | infinity,
    profile := starl_motion_course:profile(),
    network := [starl_sim_fault:compiled()],
    clocks := [starl_sim_fault:compiled()],
    location := [starl_sim_fault:compiled()],
    actuation := [starl_sim_fault:compiled()],
    store := [starl_sim_fault:compiled()],
    record => #{starl:robot_id() => starl_sim_ledger:range()}
}.

%% What comes out of a window: events for other robots or later windows; the trace, newest
%% first; whether the robot's motion has changed, whether its application has ended.
-type yield() :: {
    [starl_sim_queue:event()], [starl_monitor:trace_event()], Changes :: [moved | ended]
}.

-define(CLASS_CHASSIS, 0).
-define(CLASS_TIMER, 1).

-record(body, {
    id :: starl:robot_id(),
    world :: world(),
    now = 0 :: starl_sim_queue:time(),
    %% when the present window began, if it is in one, and when it ends
    window = none :: starl_sim_queue:time() | none,
    until = 0 :: starl_sim_queue:time(),
    clock :: starl_sim_clock:t(),
    seq = 0 :: non_neg_integer(),
    transmitter = starl_sim_transmitter:new() :: starl_sim_transmitter:t(),
    timers = starl_sim_timers:new() :: starl_sim_timers:t(),
    vehicle :: starl_sim_vehicle:t(),
    store :: starl_sim_store:t(),
    chain :: starl_sim_chain:t(),
    result = running :: running | given_up | {done, term()},
    %% what came out: own events of this window, all others, the trace, newest first
    soon = [] :: [starl_sim_queue:event()],
    later = [] :: [starl_sim_queue:event()],
    traces = [] :: [starl_monitor:trace_event()],
    changes = [] :: [moved | ended]
}).

-opaque t() :: #body{}.

%% @doc A robot at rest at a pose. Its clock is drawn from the seed within the given bounds.
-spec new(starl:robot_id(), starl:pose(), world()) -> t().
new(Id, Pose, #{seed := Seed, clock := {OffsetUs, DriftPpb}} = World) ->
    Vehicle = starl_sim_vehicle:new(Id, Pose, World),
    Offset = round(starl_sim_draw:signed({Seed, Id, offset}) * OffsetUs),
    Drift = round(starl_sim_draw:signed({Seed, Id, drift}) * DriftPpb),
    Hitting = fun(Class) -> [F || F <- maps:get(Class, World), starl_sim_fault:hits(Id, F)] end,
    #body{
        id = Id,
        world = World,
        chain = starl_sim_chain:new(maps:get(Id, maps:get(record, World, #{}), none)),
        clock = starl_sim_clock:new(Offset, Drift, Hitting(clocks)),
        vehicle = Vehicle,
        store = starl_sim_store:new(Hitting(store)),
        traces = [{0, Id, chassis, {motion, starl_sim_vehicle:piece(Vehicle)}}]
    }.

%% @doc The robot at a later time, in a new window; what it yields begins with what happened
%% since the last one.
-spec open(starl_sim_queue:time(), starl_sim_robot:window(), t()) -> t().
open(Now, {From, Until}, #body{window = none} = Body) ->
    Body#body{now = Now, window = From, until = Until};
open(Now, {From, Until}, Body) ->
    Body#body{
        now = Now, window = From, until = Until, later = [], traces = [], changes = []
    }.

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

%% @doc The new events of the present window have been planned.
-spec planned(t()) -> t().
planned(Body) -> Body#body{soon = []}.

%% @doc What has come out in the present window.
-spec yield(t()) -> yield().
yield(#body{later = Later, traces = Traces, changes = Changes}) -> {Later, Traces, Changes}.

%% @doc What a machine is given when it starts.
-spec boot(starl:robot_id(), starl_machine:name(), Incarnation :: pos_integer(), t()) ->
    starl_machine:config().
boot(Id, Name, Incarnation, #body{world = World, now = Now, store = Store} = Body) ->
    #{seed := Seed, team := Team} = World,
    #{
        robot => Id,
        participants => Team,
        name => Name,
        incarnation => Incarnation,
        stored => starl_sim_store:kept(Name, Now, Store),
        random => rand:seed_s(exsss, erlang:phash2({Seed, Id, Name}, 4294967296)),
        now => local_time(Body)
    }.

%% @doc A timer event, at a later time than the last event: chained into the digest if it is
%% still awaited.
-spec fire(
    starl_sim_queue:time(),
    starl_machine:name(),
    Timer :: term(),
    Content :: term(),
    Seq :: non_neg_integer(),
    t()
) -> {ok, starl_machine:event_type(), t()} | stale.
fire(Now, Machine, Timer, Content, Seq, #body{timers = Timers, chain = Chain} = Body) ->
    case starl_sim_timers:expire(Machine, Timer, Seq, Timers) of
        {ok, Left} ->
            Type = starl_sim_timers:event_type(Timer),
            Next = starl_sim_chain:add(Now, Machine, Type, Content, Chain),
            {ok, Type, Body#body{now = Now, timers = Left, chain = Next}};
        stale ->
            stale
    end.

%% @doc Forgets the timers of a machine that crashed.
-spec forget_timers(starl_machine:name(), t()) -> t().
forget_timers(Machine, #body{timers = Timers} = Body) ->
    Body#body{timers = starl_sim_timers:forget(Machine, Timers)}.

%% @doc The robot has died, and its application with it.
-spec ended(t()) -> t().
ended(#body{result = running, changes = Changes} = Body) -> Body#body{changes = [ended | Changes]};
ended(Body) -> Body.

%% @doc The application is not started any more; one that has finished has.
-spec give_up(t()) -> t().
give_up(#body{result = running} = Body) -> (ended(Body))#body{result = given_up};
give_up(Body) -> Body.

%% @doc The virtual time that the robot is at.
-spec now(t()) -> starl_sim_queue:time().
now(#body{now = Now}) -> Now.

%% @doc The robot's own clock in microseconds.
-spec local_time(t()) -> integer().
local_time(#body{now = Now, clock = Clock}) -> starl_sim_clock:local(Now, Clock).

%% @doc The piece of motion that the robot is in.
-spec piece(t()) -> starl_trajectory:piece().
piece(#body{vehicle = Vehicle}) -> starl_sim_vehicle:piece(Vehicle).

%% @doc Chains an event into the robot's digest.
-spec hash_event(starl_machine:name(), starl_machine:event_type() | boot, term(), t()) -> t().
hash_event(Machine, Type, Content, #body{now = Now} = Body) ->
    hash_event(Now, Machine, Type, Content, Body).

%% @doc The same for an event at a later time than the last.
-spec hash_event(
    starl_sim_queue:time(), starl_machine:name(), starl_machine:event_type() | boot, term(), t()
) -> t().
hash_event(Now, Machine, Type, Content, #body{chain = Chain} = Body) ->
    Body#body{now = Now, chain = starl_sim_chain:add(Now, Machine, Type, Content, Chain)}.

%% @doc The chain of the robot's events.
-spec chain(t()) -> starl_sim_chain:t().
chain(#body{chain = Chain}) -> Chain.

%% @doc How many packets the robot has sent.
-spec packets(t()) -> non_neg_integer().
packets(#body{transmitter = Transmitter}) -> starl_sim_transmitter:packets(Transmitter).

%% @doc What the application has returned.
-spec result(t()) -> running | given_up | {done, term()}.
result(#body{result = Result}) -> Result.

%% -- carrying out what machines ask for -----------------------------------------------------

-spec perform([starl_machine:action()], starl_machine:name(), t()) ->
    {[starl_platform:local()], t()} | {store_full, [starl_platform:local()], t()}.
perform(Actions, Name, Body) -> perform(Actions, Name, Body, []).

perform([], _Name, Body, []) ->
    {[], Body};
perform([], _Name, Body, Local) ->
    {lists:reverse(Local), Body};
perform([Action | Rest], Name, Body, Local) ->
    case Action of
        {trace, Event} ->
            perform(Rest, Name, trace(Name, Event, Body), Local);
        {transmit, Dest, Packet} ->
            perform(Rest, Name, transmit(Dest, Packet, Body), Local);
        {{timeout, Timer}, cancel} ->
            perform(Rest, Name, cancel_timer(Name, Timer, Body), Local);
        {{timeout, Timer}, Us, Content} ->
            perform(Rest, Name, start_timer(Name, Timer, Us, Content, Body), Local);
        {state_timeout, cancel} ->
            perform(Rest, Name, cancel_timer(Name, state_timeout, Body), Local);
        {state_timeout, Us, Content} ->
            perform(Rest, Name, start_timer(Name, state_timeout, Us, Content, Body), Local);
        {drive, Script, Mark} ->
            perform(Rest, Name, drive(Script, {Name, Mark}, Body), Local);
        {sense, Robots} ->
            {Poses, Next} = sense(Robots, Body),
            perform(Rest, Name, Next, [{Name, info, {located, Poses}} | Local]);
        {actuate, Device, Value} ->
            perform(Rest, Name, actuate(Device, Value, none, Body), Local);
        {actuate, Device, Value, Mark} ->
            perform(Rest, Name, actuate(Device, Value, {Name, Mark}, Body), Local);
        {done, Result} ->
            perform(Rest, Name, done(Result, Body), Local);
        {store, Term} ->
            store(Term, Rest, Name, Body, Local);
        _ ->
            perform(Rest, Name, Body, [starl_platform:local(Action, Name) | Local])
    end.

%% What follows the write takes place only when that is done.
store(Term, Rest, Name, #body{store = Store, now = Now} = Body, Local) ->
    case starl_sim_store:keep(Name, Term, Now, Store) of
        {ok, Next} -> perform(Rest, Name, Body#body{store = Next}, Local);
        full -> {store_full, lists:reverse(Local), Body}
    end.

%% -- the radio ------------------------------------------------------------------------------

transmit(To, Packet, #body{id = Id, now = Now, world = World, seq = Seq} = Body) ->
    #body{transmitter = Transmitter, later = Later, traces = Traces} = Body,
    Sender = {Id, Now, Body#body.window, piece(Body)},
    Before = {Seq, Later, Traces},
    {{Next, Planned, Traced}, Links} =
        starl_sim_transmitter:send(To, Packet, Sender, World, Before, Transmitter),
    Body#body{seq = Next, transmitter = Links, later = Planned, traces = Traced}.

%% -- the vehicle ----------------------------------------------------------------------------

%% @doc The chassis stops: nobody commands it any more.
-spec stop(t()) -> t().
stop(#body{now = Now, vehicle = Vehicle} = Body) ->
    moved(starl_sim_vehicle:stop(Now, Vehicle), Body).

%% @doc The wheels as they turn from now on, since a fault of theirs begins or ends.
-spec turn_wheels(t()) -> t().
turn_wheels(#body{now = Now, vehicle = Vehicle} = Body) ->
    moved(starl_sim_vehicle:turn_wheels(Now, Vehicle), Body).

%% @doc The chassis does what it had planned.
-spec beat(starl_sim_vehicle:beat(), t()) -> t().
beat(Beat, #body{now = Now, vehicle = Vehicle} = Body) ->
    moved(starl_sim_vehicle:beat(Beat, Now, Vehicle), Body).

%% @doc Is it still true what the chassis had planned to say of the script of this number?
-spec says(Run :: integer(), t()) -> boolean().
says(Run, #body{vehicle = Vehicle}) -> starl_sim_vehicle:says(Run, Vehicle).

drive(Script, Owner, #body{now = Now, vehicle = Vehicle} = Body) ->
    case starl_sim_vehicle:drive(Script, Owner, Now, Vehicle) of
        {lost, Deaf} -> Body#body{vehicle = Deaf};
        Change -> moved(Change, Body)
    end.

actuate(Device, Value, Owner, #body{now = Now, vehicle = Vehicle} = Body) ->
    {Set, Plans, Actuated} = starl_sim_vehicle:actuate({Device, Value}, Owner, Now, Vehicle),
    Planned = plan(Plans, Body#body{vehicle = Actuated}),
    case Set of
        set -> trace(chassis, {actuated, Device, Value}, Planned);
        same -> Planned
    end.

moved({same, Plans, Vehicle}, Body) ->
    plan(Plans, Body#body{vehicle = Vehicle});
moved({moved, Plans, Vehicle}, #body{changes = Changes} = Body) ->
    Moved = Body#body{vehicle = Vehicle, changes = [moved | Changes]},
    plan(Plans, trace(chassis, {motion, starl_sim_vehicle:piece(Vehicle)}, Moved)).

%% What the chassis does itself comes before everything else of that moment.
plan([], Body) ->
    Body;
plan([{Us, Content} | Plans], #body{id = Id, now = Now, seq = Seq, until = Until} = Body) ->
    Event = {Id, Now + Us, class(Content), Id, Seq, Content},
    Next =
        case Now + Us < Until of
            true -> Body#body{seq = Seq + 1, soon = [Event | Body#body.soon]};
            false -> Body#body{seq = Seq + 1, later = [Event | Body#body.later]}
        end,
    plan(Plans, Next).

class({says, _, _, _}) -> ?CLASS_TIMER;
class({_Name, info, _}) -> ?CLASS_TIMER;
class(_Beat) -> ?CLASS_CHASSIS.

sense(Robots, #body{now = Now, window = From, vehicle = Vehicle} = Body) ->
    {Poses, Sensed} = starl_sim_vehicle:sense(Robots, {Now, From}, Vehicle),
    {Poses, Body#body{vehicle = Sensed}}.

%% -- timers and traces ----------------------------------------------------------------------

start_timer(Machine, Timer, Us, Content, #body{id = Id, now = Now, seq = Seq} = Body) ->
    #body{timers = Timers, until = Until, clock = Clock} = Body,
    Due = starl_sim_clock:due(Now, Us, Clock),
    Event = {Id, Due, ?CLASS_TIMER, Id, Seq, {timer, Machine, Timer, Content}},
    Running = starl_sim_timers:start(Machine, Timer, Seq, Timers),
    case Due < Until of
        true -> Body#body{seq = Seq + 1, timers = Running, soon = [Event | Body#body.soon]};
        false -> Body#body{seq = Seq + 1, timers = Running, later = [Event | Body#body.later]}
    end.

cancel_timer(Machine, Timer, #body{timers = Timers} = Body) ->
    case starl_sim_timers:cancel(Machine, Timer, Timers) of
        Timers -> Body;
        Left -> Body#body{timers = Left}
    end.

%% @doc Plans events of the robot anew, in this window or later ones.
-spec postpone([starl_sim_queue:event()], t()) -> t().
postpone(Events, #body{until = Until, soon = Soon, later = Later} = Body) ->
    {Now, Then} = lists:partition(fun(Event) -> element(2, Event) < Until end, Events),
    Body#body{soon = Now ++ Soon, later = Then ++ Later}.

%% @doc Records a fact.
-spec trace(starl_machine:name(), term(), t()) -> t().
trace(Machine, Event, #body{id = Id, now = Now, traces = Traces} = Body) ->
    Body#body{traces = [{Now, Id, Machine, Event} | Traces]}.

done(Result, Body) -> trace(app, {done, Result}, (ended(Body))#body{result = {done, Result}}).
