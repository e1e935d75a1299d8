%% @doc A simulated world in real time: the bodies of live robots, their positioning system, and the
%% judge of the run. Robots are on this Erlang node or on others; the world knows where they really
%% are, gathers what they trace, and runs the monitors meanwhile.
%% ```
%%   a robot's chassis -- drive, actuate, stop --> world -- driven, stalled, actuated --> chassis
%%   a robot's positioning -- look ------------->  world -- seen -----------------------> positioning
%%   a robot's link -- started, traced, ended -->  world: facts in the order of time --> monitors
%%   a robot's radio -- sent, came ------------->  world: packets and their deliveries --> observer
%%   hardware of a robot <-- touched ------------  world: it touches another robot, or a wall
%% '''
%% A robot whose process or node ends goes down: its chassis stops, and the monitors are notified.
%% The process advances the bodies in time, sends pictures, and passes the facts to the judge; pure
%% modules decide.
-module(starl_world).

-behaviour(gen_server).

-export([start_link/1, slack_us/0, status/1, await/1, until/2, stop/1, finish/1]).
-export([embody/2, inhabit/2, track/2]).
-export([fault/2, dead/2, clock/3, halt/3, halted/2, resumed/2]).
-export([init/1, handle_call/3, handle_cast/2, handle_info/2]).

-export_type([config/0, status/0, ending/0]).

%% The world of a run: the plan of its simulation ({@link starl_run_plan:t()}), its clock, and the
%% positioning system: its rate (`none': it shows a picture whenever it is asked) and whether it
%% rounds to whole millimetres; walls. An observer of the run comes with the first report for it.
-type config() :: #{
    plan := starl_run_plan:t(),
    clock := starl_live_clock:t(),
    arena => starl_world_floor:arena(),
    rate_hz => number() | none,
    whole_mm => boolean(),
    observe => starl_observer:t(),
    facts => starl_observer:facts()
}.

-type ending() :: done | time | violation | stopped.

%% `leader': the robot that leads by the latest report, in a block with a leader (path planning).
-type status() :: #{
    now_us := integer(),
    leader := starl:robot_id() | none,
    running := non_neg_integer(),
    up := [starl:robot_id()],
    ending := ending() | none
}.

%% The period in which the judge looks at new facts, by the clock of the computer.
-define(JUDGE_MS, 200).
%% The real time by which every bound on a duration is longer.
-define(SLACK_US, 3000000).

-record(world, {
    clock :: starl_live_clock:t(),
    robots :: starl_world_team:t(),
    positioning :: starl_world_positioning:t(),
    %% what hardware touches; is it looked at?
    floor :: starl_world_floor:t(),
    is_felt = false :: boolean(),
    judge :: starl_world_judge:t(),
    limit_us :: integer(),
    ending = none :: ending() | none,
    callers = [] :: [gen_server:from()]
}).

%% @doc The time by which contracts extend every bound, in a run as fast as real time.
-spec slack_us() -> pos_integer().
slack_us() -> ?SLACK_US.

%% @doc Starts the world of a run, linked to the calling process.
-spec start_link(config()) -> gen_server:start_ret().
start_link(#{facts := Facts, clock := Clock} = Config) ->
    gen_server:start_link(?MODULE, Config#{facts := starl_live_clock:live_facts(Facts, Clock)}, []);
start_link(Config) ->
    gen_server:start_link(?MODULE, Config, []).

%% @doc Makes the calling process the chassis of this robot.
-spec embody(pid(), starl:robot_id()) -> ok | {error, unicode:chardata()}.
embody(World, Robot) -> gen_server:call(World, {embody, Robot}).

%% @doc Makes the calling process the hardware of this robot: it drives the body, which goes on when
%% the robot's link ends. On the message `{starl_settle, World, N}' it reports all that it has done
%% until then, and afterwards sends `{starl_settled, Robot, N}' ({@link starl_world_positioning}).
-spec inhabit(pid(), starl:robot_id()) -> ok | {error, unicode:chardata()}.
inhabit(World, Robot) -> gen_server:call(World, {inhabit, Robot}).

%% @doc Makes the calling process the chassis of this robot, which reports where its body is. The
%% world does not move this body. The report is `{starl_body, Robot, self(), {reported, AtUs, {moves,
%% Piece}}}'. The world asks for it as it asks hardware ({@link inhabit/2}). Returns the place of
%% the body until then. If the process ends, the body stands where it was last.
-spec track(pid(), starl:robot_id()) -> {ok, starl:pose()} | {error, unicode:chardata()}.
track(World, Robot) -> gen_server:call(World, {track, Robot}).

%% @doc Waits for the end of the run.
-spec await(pid()) -> ending().
await(World) -> gen_server:call(World, await, infinity).

%% @doc The present time and the robots at work.
-spec status(pid()) -> status().
status(World) -> gen_server:call(World, status, infinity).

%% @doc Waits until this time of the run.
-spec until(pid(), Us :: integer()) -> ok.
until(World, Us) -> gen_server:call(World, {until, Us}, infinity).

%% @doc Begins or ends a fault: the world applies its part of it, on positions and cables, and
%% notifies its observer and its judge. A cable fault of a robot without hardware is an error.
-spec fault(pid(), starl_world_faults:report()) -> ok | {error, unicode:chardata()}.
fault(World, Report) -> gen_server:call(World, {fault, Report}, infinity).

%% @doc Declares a robot dead for good.
-spec dead(pid(), starl:robot_id()) -> ok.
dead(World, Robot) ->
    World ! {starl_ended, Robot, self(), given_up},
    ok.

%% @doc Reports by how much the clock of a robot's node is ahead of this VM's clock, or behind. If
%% the difference is large, nothing is judged from now on.
-spec clock(pid(), starl:robot_id(), AheadUs :: integer()) -> ok.
clock(World, Robot, AheadUs) -> gen_server:call(World, {clock, Robot, AheadUs}, infinity).

%% @doc Announces that the node of a robot is about to be halted: nothing is judged from now on
%% until it goes on. The fault, a pause, is reported under this name.
-spec halt(pid(), starl:robot_id(), Fault :: atom()) -> ok.
halt(World, Robot, Fault) -> gen_server:call(World, {halt, Robot, Fault}, infinity).

%% @doc Reports that the node of a robot has stopped a moment ago.
-spec halted(pid(), starl:robot_id()) -> ok.
halted(World, Robot) -> gen_server:call(World, {halted, Robot}, infinity).

%% @doc Reports that the node of a robot goes on, or has ended: the monitors are notified of the
%% pause.
-spec resumed(pid(), starl:robot_id()) -> ok.
resumed(World, Robot) -> gen_server:call(World, {resumed, Robot}, infinity).

%% @doc Ends the run.
-spec stop(pid()) -> ok.
stop(World) -> gen_server:cast(World, stop).

%% @doc Closes the monitors and returns the outcome, as of a simulation.
-spec finish(pid()) -> starl_run:outcome().
finish(World) -> gen_server:call(World, finish, infinity).

%% -- the process ----------------------------------------------------------------------------

-spec init(config()) -> {ok, #world{}}.
init(#{plan := Plan, clock := Clock} = Config) ->
    #{robots := Poses, world := Sim, monitors := Monitors, limit_us := Limit} = Plan,
    _ = erlang:send_after(?JUDGE_MS, self(), judge),
    Positioning = starl_world_positioning:new(Sim, Config),
    _ = starl_world_positioning:rate_hz(Positioning) =/= none andalso (self() ! show),
    {Traces, Robots} = starl_world_team:new(Poses, Sim),
    Observer = maps:get(observe, Config, none),
    _ = [ok = starl_observer:tell({begun, Facts}, Observer) || #{facts := Facts} <- [Config]],
    {ok, #world{
        clock = Clock,
        robots = Robots,
        positioning = Positioning,
        floor = starl_world_floor:new(maps:with([arena], Config)),
        judge = starl_world_judge:facts(
            Traces, starl_world_judge:new(Monitors, starl_world_judge:horizon_us(), Observer)
        ),
        limit_us = Limit
    }}.

-spec handle_call(term(), gen_server:from(), #world{}) ->
    {reply, term(), #world{}} | {noreply, #world{}}.
handle_call({embody, Id}, {Chassis, _}, World) ->
    embodied(Id, Chassis, false, World);
handle_call({inhabit, Id}, {Hardware, _}, World) ->
    embodied(Id, Hardware, true, felt(World));
handle_call({track, Id}, {Chassis, _}, World) ->
    tracked(Id, Chassis, World);
handle_call(await, From, #world{ending = none, callers = Callers} = World) ->
    {noreply, World#world{callers = [From | Callers]}};
handle_call(await, _From, #world{ending = Ending} = World) ->
    {reply, Ending, World};
handle_call({until, Us}, From, World) ->
    ok = at(Us, {reached, From}, World),
    {noreply, World};
handle_call(status, _From, World) ->
    {reply, now_status(World), World};
handle_call({fault, Report}, _From, World) ->
    case cable(Report, World) of
        ok -> {reply, ok, faulted(Report, World)};
        {error, _} = Error -> {reply, Error, World}
    end;
handle_call(finish, _From, World) ->
    {reply, outcome(World), World};
handle_call(Report, _From, World) ->
    {reply, ok, node_report(Report, World)}.

-spec handle_cast(stop, #world{}) -> {noreply, #world{}}.
handle_cast(stop, World) -> {noreply, ended(stopped, World)}.

-spec handle_info(term(), #world{}) -> {noreply, #world{}}.
handle_info(Message, World) -> {noreply, hear(Message, World)}.

hear({starl_body, Id, Chassis, What}, World) -> heard(Id, Chassis, What, World);
hear({advance, Id}, World) -> advance(Id, World);
hear(feel, World) -> feel(World);
hear({starl_watches, Id, Sight}, World) -> watched(Id, Sight, World);
hear({starl_look, Id, Sight, Looked}, World) -> looked(Id, Sight, Looked, World);
hear({starl_settled, Id, N}, World) -> settled(Id, N, World);
hear(show, World) -> show(World);
hear({starl_started, Id, Link, What}, World) -> started(Id, Link, What, World);
hear({starl_traced, Id, Link, Batch}, World) -> traced(Id, Link, Batch, World);
hear({starl_radio, _Id, Events}, World) -> radioed(Events, World);
hear({starl_marked, Id, Link, Us}, World) -> marked(Id, Link, Us, World);
hear({starl_ended, Id, _Link, Result}, World) -> result(Id, Result, World);
hear({'DOWN', _, process, Pid, _Reason}, World) -> gone(Pid, World);
hear({reached, From}, World) -> reached(From, World);
hear(judge, World) -> judge(World);
hear(_Message, World) -> World.

now_us(#world{clock = Clock}) -> starl_live_clock:now_us(Clock).

%% This process gets a message at this time of the run.
at(Us, Message, #world{clock = Clock}) ->
    At = starl_live_clock:monotonic_ms(Us, Clock),
    _ = erlang:send_after(At, self(), Message, [{abs, true}]),
    ok.

reached(From, World) ->
    gen_server:reply(From, ok),
    World.

now_status(#world{robots = Robots, judge = Judge, ending = Ending} = World) ->
    #{
        now_us => now_us(World),
        leader => starl_world_judge:leader(Judge),
        running => length(starl_world_team:running(Robots)),
        up => starl_world_team:up(Robots),
        ending => Ending
    }.

%% -- bodies ---------------------------------------------------------------------------------

embodied(Id, Chassis, IsFree, #world{robots = Robots} = World) ->
    case starl_world_team:embodied(Id, Chassis, IsFree, Robots) of
        {ok, Next} -> {reply, ok, World#world{robots = Next}};
        {error, _} = Error -> {reply, Error, World}
    end.

tracked(Id, Chassis, #world{robots = Robots} = World) ->
    case starl_world_team:tracked(Id, Chassis, Robots) of
        {ok, At, Next} ->
            _ = erlang:monitor(process, Chassis),
            {reply, {ok, At}, World#world{robots = Next}};
        {error, _} = Error ->
            {reply, Error, World}
    end.

%% A cable is pulled at once, or while the hardware stands; and put back.
cable({Is, {_, _, _, serial_gone, Id, Params}}, #world{robots = Robots} = World) ->
    case starl_world_team:hardware(Id, Robots) of
        {ok, Hardware} -> effect({send, Hardware, {starl_cable, pulled(Is, Params)}}, World);
        {error, _} = Error -> Error
    end;
cable(_Report, _World) ->
    ok.

pulled(ended, _Params) -> back;
pulled(began, #{in_time := true}) -> pulled_in_time;
pulled(began, _Params) -> pulled.

%% Hardware reports when something happened, by the system's time, and feels what it touches.
heard(Id, Chassis, {at, SystemUs, What}, #world{clock = Clock} = World) ->
    Then = starl_live_clock:at_us(SystemUs, Clock),
    Report = {{at, Then}, What},
    heard_at(
        Id, Chassis, Report, fun(At, Next) -> driven(Id, What, At, Next) end, late(Then, World)
    );
heard(Id, Chassis, {reported, Then, What}, World) ->
    heard_at(Id, Chassis, {{at, Then}, What}, fun(_At, Next) -> Next end, late(Then, World));
heard(Id, Chassis, What, World) ->
    heard_at(Id, Chassis, {now, What}, fun(_At, Next) -> Next end, World).

late(Then, #world{judge = Judge} = World) ->
    World#world{judge = starl_world_judge:too_late(Then, now_us(World), Judge)}.

heard_at(Id, Chassis, Report, Then, #world{robots = Robots} = World) ->
    case starl_world_team:heard(Id, Chassis, Report, now_us(World), Robots) of
        {At, Change} -> Then(At, changed(Change, World));
        unknown -> World
    end.

advance(Id, #world{robots = Robots} = World) ->
    changed(starl_world_team:advance(Id, now_us(World), Robots), World).

changed({Traces, Effects, Robots}, World) ->
    {Undone, Others} = lists:partition(fun(Effect) -> element(1, Effect) =:= undo end, Effects),
    Next = lists:foldl(fun undo/2, World#world{robots = Robots}, Undone),
    ok = lists:foreach(fun(Effect) -> effect(Effect, Next) end, Others),
    facts(Traces, Next).

undo({undo, Events}, #world{judge = Judge} = World) ->
    World#world{judge = starl_world_judge:undone(Events, now_us(World), Judge)}.

%% A wake-up that comes when there is nothing to do any more does no harm.
effect({send, Pid, Message}, _World) ->
    Pid ! Message,
    ok;
effect({wake, Id, Due}, World) ->
    at(Due, {advance, Id}, World).

%% -- what hardware touches ------------------------------------------------------------------

felt(#world{is_felt = true} = World) ->
    World;
felt(World) ->
    _ = erlang:send_after(starl_world_floor:period_us() div 1000, self(), feel),
    World#world{is_felt = true}.

feel(#world{robots = Robots} = World) ->
    Free = [Id || {Id, _} <- starl_world_team:free(starl_world_team:ids(Robots), Robots)],
    feel(now_us(World), Free, felt(World#world{is_felt = false})).

%% A robot that gets a command to drive feels at once that it cannot.
driven(Id, {drive, _, _, _}, At, #world{floor = Floor} = World) ->
    feel(At, [Id], World#world{floor = starl_world_floor:commanded(Id, Floor)});
driven(_Id, _What, _At, World) ->
    World.

feel(At, Ids, #world{robots = Robots, floor = Floor} = World) ->
    {Changes, Next} = starl_world_floor:look(Ids, starl_world_team:on_floor(At, Robots), Floor),
    Touched = fun({Id, Touch}, #world{robots = R} = W) ->
        changed(starl_world_team:touched(Id, Touch, At, R), W)
    end,
    lists:foldl(Touched, World#world{floor = Next}, Changes).

%% -- positioning ----------------------------------------------------------------------------

watched(Id, Sight, #world{robots = Robots} = World) ->
    World#world{robots = starl_world_team:watches(Id, Sight, Robots)}.

%% A system with a rate of its own is not asked.
looked(Id, Sight, Looked, #world{positioning = Positioning} = World) ->
    case starl_world_positioning:rate_hz(Positioning) of
        none -> look({{Id, Sight}, Looked}, World);
        _Rate -> World
    end.

show(#world{positioning = Positioning, robots = Robots} = World) ->
    Rate = starl_world_positioning:rate_hz(Positioning),
    ok = at(now_us(World) + round(1.0e6 / Rate), show, World),
    look({all, starl_world_team:ids(Robots)}, World).

look({_, Ids} = Look, #world{positioning = Positioning, robots = Robots} = World) ->
    Now = now_us(World),
    case
        starl_world_positioning:begun(Look, Now, starl_world_team:free(Ids, Robots), Positioning)
    of
        taken ->
            picture(Look, Now, World);
        {Effects, Next} ->
            _ = [Hardware ! {starl_settle, self(), N} || {Hardware, N} <- Effects],
            World#world{positioning = Next}
    end.

settled(Id, N, #world{positioning = Positioning} = World) ->
    case starl_world_positioning:settled(Id, N, Positioning) of
        {taken, Look, At, Next} -> picture(Look, At, World#world{positioning = Next});
        {waits, Next} -> World#world{positioning = Next}
    end.

picture(Look, At, #world{positioning = Positioning, robots = Robots} = World) ->
    Now = now_us(World),
    {Pictures, Next} = starl_world_positioning:picture(Look, At, Now, Robots, Positioning),
    _ = [Sight ! {starl_seen, Picture} || {Sight, Picture} <- Pictures],
    World#world{positioning = Next}.

%% -- faults ---------------------------------------------------------------------------------

faulted(Report, #world{positioning = Positioning, judge = Judge} = World) ->
    World#world{
        positioning = starl_world_positioning:fault(Report, Positioning),
        judge = starl_world_judge:fault(Report, now_us(World), Judge)
    }.

node_report({clock, Id, Us}, #world{judge = Judge} = World) ->
    World#world{judge = starl_world_judge:clock(Id, Us, Judge)};
node_report({halt, Id, Fault}, #world{judge = Judge} = World) ->
    World#world{judge = starl_world_judge:halt(Id, Fault, now_us(World), Judge)};
node_report({resumed, Id}, #world{judge = Judge} = World) ->
    World#world{judge = starl_world_judge:released(Id, now_us(World), Judge)};
node_report({halted, Id}, #world{robots = Robots} = World) ->
    Now = now_us(World),
    {Events, Next} = starl_world_team:halted(Id, unsaid(Id, Robots), Now, Robots),
    #world{judge = Judge} = Known = facts(Events, World#world{robots = Next}),
    Known#world{judge = starl_world_judge:halted(Id, Now, Judge)}.

%% -- robots that start and end --------------------------------------------------------------

%% The end of its predecessor may not be known yet.
started(Id, Link, What, World0) ->
    #world{robots = Robots} = World = down(Id, World0),
    _ = erlang:monitor(process, Link),
    #world{judge = Judge} = World,
    World#world{
        robots = starl_world_team:started(Id, Link, What, Robots),
        judge = starl_world_judge:up(Id, now_us(World), Judge)
    }.

traced(Id, Link, Batch, #world{robots = Robots} = World) ->
    {New, Next} = starl_world_team:traced(Id, Link, Batch, Robots),
    facts(New, heard_again(Id, World#world{robots = Next})).

heard_again(Id, #world{judge = Judge} = World) ->
    World#world{judge = starl_world_judge:heard(Id, now_us(World), Judge)}.

gone(Pid, #world{robots = Robots} = World) ->
    case starl_world_team:of_link(Pid, Robots) of
        {ok, Id} -> down(Id, World);
        none -> changed(starl_world_team:untracked(Pid, Robots), World)
    end.

down(Id, #world{robots = Robots} = World) ->
    Down = starl_world_team:down(Id, unsaid(Id, Robots), now_us(World), Robots),
    #world{judge = Judge} = Next = changed(Down, heard_again(Id, World)),
    Next#world{judge = starl_world_judge:down(Id, Judge)}.

%% The facts that a node has written, and has not sent because it is halted, killed or busy.
unsaid(Id, Robots) ->
    [
        Batch
     || {File, After} <- starl_world_team:record(Id, Robots),
        Batch <- starl_live_record:batches(File, After)
    ].

result(Id, Result, #world{robots = Robots} = World) ->
    Next = starl_world_team:result(Id, Result, Robots),
    case starl_world_team:running(Next) of
        [] -> ended(done, World#world{robots = Next});
        _ -> World#world{robots = Next}
    end.

%% -- judging --------------------------------------------------------------------------------

facts(Events, #world{judge = Judge} = World) ->
    World#world{judge = starl_world_judge:facts(Events, Judge)}.

radioed(Events, #world{judge = Judge} = World) ->
    World#world{judge = starl_world_judge:radio(Events, Judge)}.

judge(World) ->
    _ = erlang:send_after(?JUDGE_MS, self(), judge),
    #world{robots = Robots} = Next = judged(World),
    Now = now_us(Next),
    ok = lists:foreach(
        fun(Link) -> starl_live_link:mark(Link, Now) end, starl_world_team:links(Robots)
    ),
    Next.

%% A robot has sent all its facts up to a time.
marked(Id, Link, Us, #world{robots = Robots, judge = Judge} = World) ->
    case starl_world_team:of_link(Link, Robots) of
        {ok, Id} -> World#world{judge = starl_world_judge:complete(Id, Us, now_us(World), Judge)};
        _ -> World
    end.

judged(#world{ending = Ending} = World) when Ending =/= none -> World;
judged(World) ->
    Now = now_us(World),
    case verdict(Now, World) of
        {violation, Next} -> doubted(Now, Next, World);
        {ok, Next} -> sound(Now, Next, World)
    end.

verdict(Now, #world{judge = Judge}) -> starl_world_judge:look(Now, 1000 * ?JUDGE_MS, Judge).

sound(Now, Found, #world{limit_us = Limit, judge = Judge} = World) ->
    Accepted = World#world{judge = starl_world_judge:accept(Found, Now, Judge)},
    case Now >= Limit of
        true -> ended(time, Accepted);
        false -> Accepted
    end.

%% A fact may be under way from a node that hangs, or waits for its processor, while its consequence
%% has come. Before a violation counts, the judge looks for the fact where it was written.
doubted(Now, Found, World) ->
    case recalled(infinity, World) of
        {[], _} ->
            accused(Found, World);
        {[_ | _], Known} ->
            case verdict(Now, Known) of
                {violation, Next} -> accused(Next, Known);
                {ok, Next} -> sound(Now, Next, Known)
            end
    end.

accused(Found, #world{judge = Judge} = World) ->
    ended(violation, World#world{judge = starl_world_judge:accuse(Found, Judge)}).

%% The facts up to this time that robots have written and not sent. At the end of a run the robots go on;
%% if a fact up to now follows from another one, both are written.
-spec recalled(integer() | infinity, #world{}) -> {[starl_monitor:trace_event()], #world{}}.
recalled(Until, #world{robots = Robots} = World) ->
    {Written, Next} = lists:mapfoldl(
        fun(Id, Before) -> starl_world_team:recalled(Id, unsaid(Id, Before), Before) end,
        Robots,
        starl_world_team:up(Robots)
    ),
    Events = [Event || Event <- lists:append(Written), element(1, Event) =< Until],
    {Events, facts(Events, World#world{robots = Next})}.

ended(Ending, #world{ending = none, callers = Callers} = World) ->
    lists:foreach(fun(From) -> gen_server:reply(From, Ending) end, Callers),
    World#world{ending = Ending, callers = []};
ended(_Ending, World) ->
    World.

outcome(World) ->
    Now = now_us(World),
    {_, #world{judge = Judge, robots = Robots, ending = Ending}} = recalled(Now, World),
    Summaries = [
        {Id, summary(Now, Robot)}
     || {Id, Robot} <- starl_world_team:summaries(Now, Robots)
    ],
    starl_world_judge:outcome(Ending, Now, Summaries, Judge).

%% With the counters of its link, if it still runs.
summary(Now, #{result := Result, pose := Pose, link := Link}) ->
    Figures = figures(Link),
    Figures#{
        at_us => Now,
        chain => 0,
        checkpoints => [],
        result => Result,
        pose => Pose,
        crashes => []
    }.

figures(none) ->
    #{events => 0, packets => 0};
figures(Link) ->
    try
        starl_live_link:figures(Link)
    catch
        exit:_ -> #{events => 0, packets => 0}
    end.
