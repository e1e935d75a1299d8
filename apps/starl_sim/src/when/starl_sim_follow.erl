%% @doc Replays a live robot from its snapshot to a later time. The robot's machines and its
%% application handle the recorded inputs again, at the recorded times of the robot's clock. Their
%% actions are compared with the recorded facts and not carried out again.
%%
%% The chassis is simulated meanwhile ({@link starl_sim_follow_chassis}). At the end it is set to
%% the recorded place.
-module(starl_sim_follow).
-behaviour(starl_driver).
-include_lib("starl_platform/include/starl_robot_order.hrl").

-export([robot/3, anew/3, format_reason/1]).
-export([
    handles/4, clock/1, present/1, base/3, trace/3, plan/5, store/3, ended/2, perform/3, stop/1
]).

-export_type([past/0, setting/0, reason/0]).

%% The last snapshot of a robot ({@link starl_live_snapshots:snapshot()}), what came since, in its order, with the times
%% of the robot's clock; the facts of its machines since then, and its piece of motion at the moment.
-type past() :: #{
    snapshot := map(),
    inputs := [{integer(), term()}],
    facts := [starl_monitor:trace_event()],
    piece := starl_trajectory:piece()
}.

%% What the robots of a plan have in common, and the moment.
-type setting() :: #{
    at_us := starl_sim_queue:time(),
    world := starl_sim_world:t(),
    crew := starl_sim_shard:crew()
}.

%% Why it could not be followed: something came that cannot be repeated; another fact than the recorded
%% one; it went another way.
-type reason() ::
    {other, atom()}
    | {parted, Recorded :: term(), Now :: term()}
    | another_way
    | down
    | no_snapshot
    | starl_snapshot:reason()
    | {failed, term()}.

-record(world, {
    id :: starl:robot_id(),
    now :: integer(),
    inputs :: [{integer(), term()}],
    marks :: non_neg_integer(),
    dues :: #{starl_robot_timers:mark() => tuple()},
    store :: starl_sim_store:t(),
    chassis :: starl_sim_follow_chassis:t(),
    result :: running | given_up | {done, term()},
    %% newest first
    traces = [] :: [starl_monitor:trace_event()]
}).

-define(PATIENCE_MS, 30000).
-define(LAG_US, 1000000).
%% The machines of whom only the world tells.
-define(OF_THE_WORLD, [chassis, radio, robot, supervisor, snapshot]).

%% @doc The robot at the moment, and the facts that come out then because its application was at work.
-spec robot(starl:robot_id(), past(), setting()) ->
    {ok, starl_sim_robot:snapshot(), [starl_monitor:trace_event()]} | {error, reason()}.
robot(Id, Past, Setting) ->
    case starl_sim_trial:apart(fun() -> followed(Id, Past, Setting) end) of
        {ok, Answer} -> Answer;
        {error, Reason} -> {error, Reason}
    end.

followed(Id, #{snapshot := Snapshot} = Past, #{crew := #{inline := Inline}} = Setting) ->
    #{machines := Kept, parts := Parts} = Snapshot,
    case starl_robot_tree:restore(Id, start(Id, Setting), Inline, Kept) of
        {ok, Tree, Machines} ->
            Robot = starl_robot:restore(#{
                id => Id,
                driver => ?MODULE,
                world => world(Id, Past, Setting),
                machines => Machines,
                parts => Parts
            }),
            try
                compared(come(absent, Robot), Past, Setting)
            catch
                throw:{?MODULE, Reason} -> {error, Reason}
            after
                starl_robot_tree:down(Tree)
            end;
        {error, Reason} ->
            {error, {failed, Reason}}
    end.

start(_Id, #{crew := #{tree := none}}) ->
    none;
start(Id, #{crew := #{tree := Tree}}) ->
    Spec = Tree#{id => Id, driver => self()},
    fun() ->
        {ok, Pid} = starl_robot_sup:start_link(Spec),
        true = unlink(Pid),
        {Pid, starl_robot_sup:parts(Pid)}
    end.

world(Id, #{snapshot := Snapshot, inputs := Inputs, piece := Piece}, #{world := World}) ->
    #{at_us := At, marks := Marks, dues := Dues, stored := Stored, result := Result} = Snapshot,
    Begun = #world{
        id = Id,
        now = At,
        inputs = Inputs,
        marks = Marks,
        dues = Dues,
        store = kept(Stored),
        chassis = starl_sim_follow_chassis:new(Id, Piece, World),
        result = Result
    },
    case Snapshot of
        #{script := none} -> Begun;
        #{script := {Us, Script, Owner}} -> driven(At, drive(Script, Owner, Begun#world{now = Us}))
    end.

%% The chassis has done what it had to do by then.
driven(Until, #world{chassis = Chassis} = World) ->
    World#world{chassis = starl_sim_follow_chassis:until(Until, Chassis)}.

kept(Stored) ->
    Keep = fun(Name, Term, Store) ->
        {ok, Next} = starl_sim_store:keep(Name, Term, 0, Store),
        Next
    end,
    maps:fold(Keep, starl_sim_store:new([]), Stored).

%% -- what came ------------------------------------------------------------------------------

%% The application is at rest (`absent'), at work or has just answered, with the orders that wait for it; as
%% in the robot's link.
come(App, Robot) ->
    #world{inputs = Inputs} = World = starl_robot:world(Robot),
    case Inputs of
        [] ->
            {App, Robot};
        [{At, Input} | Left] ->
            came(Input, App, driven(At, World#world{now = At, inputs = Left}), Robot)
    end.

came({event, Name, Type, Content}, App, World, Robot) ->
    Noted = handles(Name, Type, Content, answered(Name, Content, World)),
    went(starl_robot:event(Name, Type, Content, Noted, Robot), App);
came({timer, Name, Timer, Mark, Content}, App, World, Robot) ->
    case starl_robot:expire(Name, Timer, Mark, Robot) of
        {ok, Type, Left} ->
            Noted = handles(Name, Type, Content, World),
            went(starl_robot:fire(Name, Type, Content, Noted, Left, Robot), App);
        stale ->
            throw({?MODULE, another_way})
    end;
came(acts, {at_work, Orders}, World, Robot) ->
    Valid = starl_robot:without_calls(starl_driver:restarted(Orders), done(Robot)),
    went(starl_robot:act(app, Valid, World, Robot), {idle, Orders});
came(order, {idle, [Order | Orders]}, #world{now = Now} = World, Robot) ->
    process(Robot) ! starl_driver:later(Now, Order),
    come({at_work, Orders}, starl_robot:world(World, Robot));
came({other, What}, _App, _World, _Robot) ->
    throw({?MODULE, {other, What}});
came(_Input, _App, _World, _Robot) ->
    throw({?MODULE, another_way}).

went({quiet, Robot}, {idle, []}) ->
    come(absent, Robot);
went({quiet, Robot}, App) ->
    come(App, Robot);
went({ask, Pid, Order, Robot}, absent) ->
    Pid ! Order,
    went(starl_robot:leave(Robot), {at_work, []});
went({ask, _Pid, Order, Robot}, {How, Orders}) ->
    went(starl_robot:leave(Robot), {How, Orders ++ [Order]});
went(_Other, _App) ->
    throw({?MODULE, another_way}).

process(Robot) -> starl_robot_machines:process(app, starl_robot:machines(Robot)).

done(Robot) ->
    Pid = process(Robot),
    receive
        {starl_done, _, Pid, Actions} -> Actions;
        {'DOWN', _, process, Pid, Reason} -> throw({?MODULE, {failed, Reason}})
    after ?PATIENCE_MS -> throw({?MODULE, {failed, no_answer}})
    end.

answered(Name, {Word, Mark, _}, #world{now = Now, chassis = Chassis} = World) when
    Word =:= driven; Word =:= stalled
->
    World#world{chassis = starl_sim_follow_chassis:answered(Word, {Name, Mark}, Now, Chassis)};
answered(_Name, _Content, World) ->
    World.

%% -- the moment -----------------------------------------------------------------------------

compared({App, Robot}, #{facts := Facts} = Past, #{at_us := At} = Setting) ->
    #world{traces = Traces} = World = starl_robot:world(Robot),
    ok = same(own(Facts), own(lists:reverse(Traces))),
    Later = World#world{traces = [], now = max(At, World#world.now)},
    Rested = rested(App, starl_robot:world(Later, Robot)),
    #world{traces = New} = starl_robot:world(Rested),
    case starl_robot_tree:snapshot(starl_robot:machines(Rested)) of
        {ok, Machines} -> {ok, snapshot(Machines, Rested, Past, Setting), lists:reverse(New)};
        {error, _} = Error -> Error
    end.

%% A recording may tell a fact a little later than it was.
own(Facts) ->
    [{Machine, Fact} || {_, _, Machine, Fact} <- Facts, not lists:member(Machine, ?OF_THE_WORLD)].

same([Fact | Facts], [Fact | Others]) -> same(Facts, Others);
same([], []) -> ok;
same(Facts, Others) -> throw({?MODULE, {parted, first(Facts), first(Others)}}).

first([]) -> none;
first([Fact | _]) -> Fact.

%% An application that is at work answers at once.
rested(absent, Robot) ->
    Robot;
rested({at_work, Orders}, Robot) ->
    Turn = starl_robot:act(app, done(Robot), starl_robot:world(Robot), Robot),
    {App, Next} = went(Turn, {idle, Orders}),
    rested(App, Next);
rested({idle, [Order | Orders]}, Robot) ->
    #world{now = Now} = starl_robot:world(Robot),
    process(Robot) ! starl_driver:later(Now, Order),
    rested({at_work, Orders}, Robot).

snapshot(Machines, Robot, #{piece := Piece}, #{at_us := At}) ->
    #{timers := Running} = Parts = starl_robot:parts(Robot),
    #world{id = Id, marks = Marks, dues = Dues, store = Store, result = Result} =
        World = driven(At, starl_robot:world(Robot)),
    #world{chassis = Chassis} = World,
    Pending = starl_sim_follow_chassis:pending(Chassis),
    Timers = [timer(Id, At, Timer, maps:get(Mark, Dues)) || {_, _, Mark} = Timer <- Running],
    Said = [
        {Id, max(Due, At), Class, Id, Marks + N, Content}
     || {N, {Due, Class, Content}} <- lists:enumerate(Pending), Due > At - ?LAG_US
    ],
    data(Machines, Parts, Timers ++ Said, #{
        now => At,
        seq => Marks + length(Pending) + 1,
        vehicle => starl_sim_follow_chassis:snapshot(Piece, Chassis),
        store => Store,
        result => Result
    }).

data(Machines, Parts, Planned, Body) ->
    #{
        machines => Machines,
        parts => Parts,
        body => Body#{
            timers => starl_sim_timers:new(),
            transmitter => starl_sim_transmitter:new(),
            chain => {0, 0},
            %% a live robot's clock is the run's
            clock => {0, 0}
        },
        planned => Planned,
        hold => {0, 0},
        still => 0,
        despair => starl_sim_crash_loop:new()
    }.

timer(Id, At, {Name, Timer, Mark}, {Due, _, _, Content}) ->
    {Id, max(Due, At), ?CLASS_TIMER, Id, Mark, {timer, Name, Timer, Content}}.

%% @doc A robot that restarts at the moment, at its recorded place, as after a lost store.
-spec anew(starl:robot_id(), starl_trajectory:piece(), setting()) ->
    {ok, starl_sim_robot:snapshot(), [starl_monitor:trace_event()]} | {error, reason()}.
anew(Id, Piece, Setting) ->
    case starl_sim_trial:apart(fun() -> begun(Id, Piece, Setting) end) of
        {ok, Answer} -> Answer;
        {error, Reason} -> {error, Reason}
    end.

begun(Id, Piece, #{at_us := At, world := World, crew := #{inline := Inline}} = Setting) ->
    Moment = {At div 1000, Id rem starl_robot_machines:lots()},
    {Tree, Machines} = starl_robot_tree:resume(Id, start(Id, Setting), Inline, Moment, #{}),
    Robot = starl_robot:new(Id, ?MODULE, none, Machines),
    {ok, Kept} = starl_robot_tree:snapshot(Machines),
    _ = starl_robot_tree:down(Tree),
    Standing = starl_trajectory:pose(At, Piece),
    Stands = starl_trajectory:standing(At, point(Standing), element(3, Standing)),
    Chassis = starl_sim_follow_chassis:new(Id, Stands, World),
    Names = starl_robot_machines:names(Machines),
    Facts =
        [{chassis, {motion, Stands}}, {robot, down}] ++
            [{Name, crashed} || Name <- Names] ++ [{robot, up}],
    {ok,
        data(Kept, starl_robot:parts(Robot), [{Id, At, ?CLASS_WORLD, 0, 0, wake}], #{
            now => At,
            seq => 1,
            vehicle => starl_sim_follow_chassis:snapshot(Stands, Chassis),
            store => starl_sim_store:outdate(starl_sim_store:new([])),
            result => running
        }), [{At, Id, Machine, Fact} || {Machine, Fact} <- Facts]}.

point({X, Y, _}) -> {X, Y}.

%% @doc Why a robot could not be followed, for a sentence.
-spec format_reason(reason()) -> unicode:chardata().
format_reason({other, crashed}) ->
    "one of its machines crashed after its last snapshot";
format_reason({other, boot}) ->
    "one of its machines started after its last snapshot";
format_reason({other, late}) ->
    "something of a step was late after its last snapshot";
format_reason({other, What}) ->
    io_lib:format("~ts after its last snapshot", [What]);
format_reason({parted, Recorded, Now}) ->
    io_lib:format("what it does again is not what was recorded: ~0tP, not ~0tP", [
        Now, 12, Recorded, 12
    ]);
format_reason(another_way) ->
    "its program goes another way the second time";
format_reason(down) ->
    "it is down";
format_reason(no_snapshot) ->
    "it has no snapshot before the moment";
format_reason({failed, Reason}) ->
    io_lib:format("it fails: ~0tP", [Reason, 12]);
format_reason(Reason) ->
    starl_snapshot:format_reason(Reason).

%% -- the robot's driver ---------------------------------------------------------------------

%% @doc The machine handles it when it did.
-spec handles(starl_machine:name(), starl_machine:event_type() | boot, term(), #world{}) ->
    #world{}.
handles(app, info, {sensed, _}, World) -> at(World);
handles(_Name, boot, _Content, _World) -> throw({?MODULE, {other, boot}});
handles(_Name, _Type, _Content, World) -> at(World).

at(#world{inputs = [{At, now} | Left]} = World) -> World#world{now = At, inputs = Left};
at(#world{inputs = []} = World) -> World;
at(#world{}) -> throw({?MODULE, another_way}).

-spec clock(#world{}) -> integer().
clock(#world{now = Now}) -> Now.

-spec present(#world{}) -> integer().
present(#world{now = Now}) -> Now.

-spec base(starl_machine:name(), pos_integer(), #world{}) -> no_return().
base(_Name, _Incarnation, _World) -> throw({?MODULE, {other, boot}}).

-spec trace(starl_machine:name(), term(), #world{}) -> #world{}.
trace(Name, Event, #world{id = Id, now = Now, traces = Traces} = World) ->
    World#world{traces = [{Now, Id, Name, Event} | Traces]}.

-spec plan(starl_machine:name(), starl_robot_timers:timer(), non_neg_integer(), term(), #world{}) ->
    {starl_robot_timers:mark(), #world{}}.
plan(Name, Timer, Us, Content, #world{now = Now, marks = Mark, dues = Dues} = World) ->
    Due = {Now + Us, Name, Timer, Content},
    {Mark, World#world{marks = Mark + 1, dues = Dues#{Mark => Due}}}.

-spec store(starl_machine:name(), term(), #world{}) -> {ok, #world{}}.
store(Name, Term, #world{store = Store, now = Now} = World) ->
    {ok, Next} = starl_sim_store:keep(Name, Term, Now, Store),
    {ok, World#world{store = Next}}.

-spec ended(starl_robot:ended(), #world{}) -> #world{}.
ended({done, _} = Done, World) -> World#world{result = Done};
ended(given_up, #world{result = running} = World) -> World#world{result = given_up};
ended(_, World) -> World.

-spec perform(starl_platform:world_action(), starl_machine:name(), #world{}) -> {[], #world{}}.
perform({drive, Script, Mark}, Name, World) ->
    {[], drive(Script, {Name, Mark}, World)};
perform({actuate, Device, Value}, _Name, World) ->
    {[], actuate({Device, Value}, none, World)};
perform({actuate, Device, Value, Mark}, Name, World) ->
    {[], actuate({Device, Value}, {Name, Mark}, World)};
perform({until, _Us, {trace, Event}, _Mark}, Name, World) ->
    {[], trace(Name, Event, World)};
perform({until, _Us, Action, _Mark}, Name, World) ->
    perform(Action, Name, World);
perform({What, _}, _Name, _World) when What =:= outlived; What =:= reloaded ->
    throw({?MODULE, {other, What}});
perform(_SentOrAsked, _Name, World) ->
    {[], World}.

drive(Script, Owner, #world{now = Now, chassis = Chassis} = World) ->
    World#world{chassis = starl_sim_follow_chassis:drive(Script, Owner, Now, Chassis)}.

actuate(What, Owner, #world{now = Now, chassis = Chassis} = World) ->
    World#world{chassis = starl_sim_follow_chassis:actuate(What, Owner, Now, Chassis)}.

-spec stop(#world{}) -> #world{}.
stop(#world{now = Now, chassis = Chassis} = World) ->
    World#world{chassis = starl_sim_follow_chassis:stop(Now, Chassis)}.
