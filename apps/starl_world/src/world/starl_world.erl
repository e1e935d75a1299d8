%% @doc A simulated world in real time: the bodies of live robots, their positioning system, and the
%% judge of the run. Robots are on this Erlang node or on others; the world knows where they really
%% are, gathers what they trace, and runs the monitors meanwhile.
%% ```
%%   a robot's chassis -- drive, actuate, stop --> world -- driven, stalled, actuated --> chassis
%%   a robot's positioning -- look ------------->  world -- seen -----------------------> positioning
%%   a robot's link -- started, traced, ended -->  world: facts in the order of time --> monitors
%%   a robot's radio -- sent, came ------------->  world: packets and their fates --> observer
%%   hardware of a robot <-- touched ------------  world: it touches another robot, or a wall
%% '''
%% A robot whose process or node ends goes down: its chassis stops, and the monitors are told.
-module(starl_world).
-behaviour(gen_server).

-export([
    plan/2,
    observed/2,
    live/2,
    start_link/1,
    embody/2,
    inhabit/2,
    await/1,
    status/1,
    until/2,
    freeze/2,
    cable/3,
    freeze_too/2,
    cut/2,
    killed/2,
    stop/1,
    finish/1
]).
-export([init/1, handle_call/3, handle_cast/2, handle_info/2]).

-export_type([config/0, status/0, ending/0, cable/0]).

%% The cable between a robot's computer and its hardware: pulled at once, or before the hardware could
%% drive on without it; put back.
-type cable() :: pulled | pulled_in_time | back.

%% The world of a run: the plan of its simulation ({@link starl_sim_plan:t()}), its clock, and the
%% positioning system: its rate (`none': it shows a picture whenever it is asked) and whether it
%% rounds to whole millimetres; walls. An observer of the run comes with the facts that he is told
%% first.
-type config() :: #{
    plan := starl_sim_plan:t(),
    clock := starl_live_clock:t(),
    arena => starl_world_floor:arena(),
    rate_hz => number() | none,
    whole_mm => boolean(),
    observe => starl_observer:t(),
    facts => starl_observer:facts()
}.

-type ending() :: done | time | violation | stopped.

%% `leader': the robot that has said last that it leads, in a block with a leader (path planning).
-type status() :: #{
    now_us := integer(),
    leader := starl:robot_id() | none,
    running := non_neg_integer(),
    up := [starl:robot_id()],
    ending := ending() | none
}.

%% The period in which the judge looks at new facts, and the time that he waits for facts, by the
%% clock of the computer.
-define(JUDGE_MS, 200).
-define(SLACK_US, 3000000).
-define(HORIZON_US, 1500000).
%% The longest delay of what the hardware of a robot tells.
-define(LATE_US, 500000).

-record(robot, {
    body :: starl_world_body:t(),
    chassis = none :: pid() | none,
    %% does the body stop with the link?
    is_free = false :: boolean(),
    %% the time of what free hardware has told last
    told_at = 0 :: integer(),
    sight = none :: pid() | none,
    link = none :: pid() | none,
    names = [] :: [starl_machine:name()],
    %% the file of its facts, and the last batch that has come
    record = none :: file:filename() | none,
    batch = 0 :: non_neg_integer(),
    is_up = false :: boolean(),
    result = running :: running | given_up | {done, term()},
    events = 0 :: non_neg_integer()
}).

-record(world, {
    clock :: starl_live_clock:t(),
    robots :: #{starl:robot_id() => #robot{}},
    sim :: starl_sim_platform:world(),
    %% what hardware touches; is it looked at?
    floor :: starl_world_floor:t(),
    is_felt = false :: boolean(),
    judge :: starl_world_judge:t(),
    observer :: starl_observer:t(),
    limit_us :: integer(),
    rate_hz :: number() | none,
    whole_mm :: boolean(),
    draws = 0 :: non_neg_integer(),
    %% what each robot was shown last, and the robots that get nothing newer
    shown = #{} :: #{starl:robot_id() => #{starl:robot_id() => starl:pose()}},
    frozen = [] :: [starl:robot_id()],
    hands = starl_world_hands:new() :: starl_world_hands:t(),
    leader = none :: starl:robot_id() | none,
    ending = none :: ending() | none,
    callers = [] :: [gen_server:from()]
}).

%% @doc Plans the run of a scenario that passes `speed' times as fast as real time; `watch': further
%% monitors, which only look on. This computer has other work, too, so every bound on a duration is
%% longer by some real time.
-spec plan(#{app := module(), atom() => term()}, #{
    speed => number(), watch => [{module(), map()}], atom() => term()
}) ->
    {ok, starl_sim:planned()} | {error, starl_sim:reason()}.
plan(Given, Options) ->
    Slack = round(?SLACK_US * maps:get(speed, Options, 1)),
    starl_sim:plan(Given#{mode => process}, (maps:with([watch], Options))#{slack_us => Slack}).

%% @doc The options of a run with what its observer and the recorders of its robots are told first.
-spec observed(starl_sim:planned(), Options) -> Options when Options :: map().
observed(Planned, Options) when is_map_key(observe, Options); is_map_key(recorder, Options) ->
    Options#{facts => starl_sim_plan:facts(Planned, maps:get(watch, Options, []))};
observed(_Planned, Options) ->
    Options.

%% @doc These facts in a run of this clock.
-spec live(starl_observer:facts(), starl_live_clock:t()) -> starl_observer:facts().
live(Facts, Clock) -> Facts#{kind := live, epoch_us => starl_live_clock:epoch_us(Clock)}.

%% @doc Starts the world of a run.
-spec start_link(config()) -> gen_server:start_ret().
start_link(Config) -> gen_server:start_link(?MODULE, Config, []).

%% @doc The calling process is the chassis of this robot from now on.
-spec embody(pid(), starl:robot_id()) -> ok | {error, unicode:chardata()}.
embody(World, Robot) -> gen_server:call(World, {embody, Robot}).

%% @doc The calling process is the hardware of this robot from now on: it drives the body, which goes
%% on when the robot's link ends.
-spec inhabit(pid(), starl:robot_id()) -> ok | {error, unicode:chardata()}.
inhabit(World, Robot) -> gen_server:call(World, {inhabit, Robot}).

%% @doc Waits for the end of the run.
-spec await(pid()) -> ending().
await(World) -> gen_server:call(World, await, infinity).

%% @doc The present time and the robots at work.
-spec status(pid()) -> status().
status(World) -> gen_server:call(World, status).

%% @doc Waits until this time of the run.
-spec until(pid(), Us :: integer()) -> ok.
until(World, Us) -> gen_server:call(World, {until, Us}, infinity).

%% @doc From now on these robots, and no others, are shown what they were shown last, again and again.
-spec freeze(pid(), [starl:robot_id()]) -> ok.
freeze(World, Robots) -> gen_server:call(World, {freeze, Robots}).

%% @doc Pulls the cable of a robot's hardware, or puts it back.
-spec cable(pid(), starl:robot_id(), cable()) -> ok | {error, unicode:chardata()}.
cable(World, Robot, Cable) -> gen_server:call(World, {cable, Robot, Cable}).

%% @doc From now on this robot, too, is shown what it was shown last.
-spec freeze_too(pid(), starl:robot_id()) -> ok.
freeze_too(World, Robot) -> gen_server:call(World, {freeze_too, Robot}).

%% @doc From now on these links, and no others, are cut: the world only tells its observer.
-spec cut(pid(), [{starl:robot_id(), starl:robot_id()}]) -> ok.
cut(World, Links) -> gen_server:call(World, {cut, Links}).

%% @doc A robot has been killed by hand: the world only tells its observer.
-spec killed(pid(), starl:robot_id()) -> ok.
killed(World, Robot) -> gen_server:call(World, {killed, Robot}).

%% @doc Ends the run.
-spec stop(pid()) -> ok.
stop(World) -> gen_server:cast(World, stop).

%% @doc Closes the monitors and returns the outcome, as of a simulation.
-spec finish(pid()) -> starl_sim_outcome:t().
finish(World) -> gen_server:call(World, finish, infinity).

-spec init(config()) -> {ok, #world{}}.
init(#{plan := Plan, clock := Clock} = Config) ->
    #{robots := Poses, world := Sim, monitors := Monitors, limit_us := Limit} = Plan,
    _ = erlang:send_after(?JUDGE_MS, self(), judge),
    Rate = maps:get(rate_hz, Config, none),
    _ = Rate =/= none andalso erlang:send_after(0, self(), show),
    Embodied = [{Id, starl_world_body:new(Id, Pose, Sim)} || {Id, Pose} <- Poses],
    Observer = maps:get(observe, Config, none),
    ok = begun(Observer, Config),
    Judge = starl_world_judge:new(Monitors, ?HORIZON_US, Observer),
    {ok, #world{
        clock = Clock,
        sim = Sim,
        floor = starl_world_floor:new(maps:with([arena], Config)),
        robots = maps:from_list([{Id, #robot{body = Body}} || {Id, {_, Body}} <- Embodied]),
        judge = starl_world_judge:told(lists:append([T || {_, {T, _}} <- Embodied]), Judge),
        observer = Observer,
        limit_us = Limit,
        rate_hz = Rate,
        whole_mm = maps:get(whole_mm, Config, false)
    }}.

begun(none, _Config) ->
    ok;
begun(Observer, #{facts := Facts, clock := Clock}) ->
    starl_observer:tell({begun, live(Facts, Clock)}, Observer).

-spec handle_call(term(), gen_server:from(), #world{}) ->
    {reply, term(), #world{}} | {noreply, #world{}}.
handle_call({embody, Id}, {Chassis, _}, World) ->
    embodied(Id, Chassis, false, World);
handle_call({inhabit, Id}, {Create, _}, World) ->
    embodied(Id, Create, true, felt(World));
handle_call(await, From, #world{ending = none, callers = Callers} = World) ->
    {noreply, World#world{callers = [From | Callers]}};
handle_call(await, _From, #world{ending = Ending} = World) ->
    {reply, Ending, World};
handle_call(status, _From, #world{robots = Robots, ending = Ending} = World) ->
    Status = #{
        now_us => now_us(World),
        leader => World#world.leader,
        running => length(running(World)),
        up => lists:sort([Id || {Id, #robot{is_up = true}} <- maps:to_list(Robots)]),
        ending => Ending
    },
    {reply, Status, World};
handle_call({until, Us}, From, #world{clock = Clock} = World) ->
    At = starl_live_clock:monotonic_ms(Us, Clock),
    _ = erlang:send_after(At, self(), {reached, From}, [{abs, true}]),
    {noreply, World};
handle_call({freeze, Ids}, _From, World) ->
    Done = fun(Now, Hands) -> starl_world_hands:holds(location_frozen, Ids, Now, Hands) end,
    {reply, ok, by_hand(Done, World#world{frozen = Ids})};
handle_call({freeze_too, Id}, From, #world{frozen = Frozen} = World) ->
    handle_call({freeze, lists:usort([Id | Frozen])}, From, World);
handle_call({cut, Links}, _From, World) ->
    Done = fun(Now, Hands) -> starl_world_hands:holds(loss, Links, Now, Hands) end,
    {reply, ok, by_hand(Done, World)};
handle_call({killed, Id}, _From, World) ->
    Done = fun(Now, Hands) -> starl_world_hands:struck(kill_robot, Id, Now, Hands) end,
    {reply, ok, by_hand(Done, World)};
handle_call({cable, Id, Cable}, _From, #world{robots = Robots} = World) ->
    case Robots of
        #{Id := #robot{is_free = true, chassis = Hardware}} ->
            Hardware ! {starl_cable, Cable},
            {reply, ok, World};
        #{} ->
            {reply, {error, io_lib:format("robot ~b has no cable: it is no Create", [Id])}, World}
    end;
handle_call(finish, _From, World) ->
    {reply, outcome(World), World}.

-spec handle_cast(stop, #world{}) -> {noreply, #world{}}.
handle_cast(stop, World) -> {noreply, ended(stopped, World)}.

-spec handle_info(term(), #world{}) -> {noreply, #world{}}.
handle_info({starl_body, Id, Chassis, What}, World) ->
    {noreply, hears(Id, Chassis, What, World)};
handle_info({advance, Id}, World) ->
    {noreply, advance(Id, World)};
handle_info(feel, World) ->
    {noreply, feel(now_us(World), free(World), felt(World#world{is_felt = false}))};
handle_info({starl_watches, Id, Sight}, #world{robots = Robots} = World) ->
    #{Id := Robot} = Robots,
    {noreply, put_robot(Id, Robot#robot{sight = Sight}, World)};
handle_info({starl_look, Id, Sight, Looked}, #world{rate_hz = none} = World) ->
    {Seen, Next} = seen(Id, Looked, World),
    {Picture, Shown} = shown(Id, Seen, Next),
    Sight ! {starl_seen, Picture},
    {noreply, Shown};
handle_info({starl_look, _Id, _Sight, _Looked}, World) ->
    {noreply, World};
handle_info({reached, From}, World) ->
    gen_server:reply(From, ok),
    {noreply, World};
handle_info(show, World) ->
    {noreply, show(World)};
handle_info({starl_started, Id, Link, {Names, File}}, #world{robots = Before} = World0) ->
    %% the end of its predecessor may not be known yet
    #world{robots = #{Id := Robot}} = World = down(Id, maps:get(Id, Before), World0),
    _ = erlang:monitor(process, Link),
    Up = Robot#robot{link = Link, names = Names, record = File, batch = 0, is_up = true},
    {noreply, put_robot(Id, Up, World)};
handle_info({starl_traced, Id, Link, Batch, Events}, #world{robots = Robots} = World) ->
    case Robots of
        #{Id := #robot{link = Link} = Robot} ->
            {noreply, told(Events, put_robot(Id, Robot#robot{batch = Batch}, World))};
        #{} ->
            {noreply, World}
    end;
handle_info({starl_radio, _Id, Events}, #world{judge = Judge} = World) ->
    {noreply, World#world{judge = starl_world_judge:heard(Events, Judge)}};
handle_info({starl_ended, Id, _Link, Result}, World) ->
    {noreply, result(Id, Result, World)};
handle_info({'DOWN', _, process, Pid, _Reason}, World) ->
    {noreply, gone(Pid, World)};
handle_info(judge, World) ->
    _ = erlang:send_after(?JUDGE_MS, self(), judge),
    {noreply, judged(World)};
handle_info(_Message, World) ->
    {noreply, World}.

now_us(#world{clock = Clock}) -> starl_live_clock:now_us(Clock).

put_robot(Id, Robot, #world{robots = Robots} = World) ->
    World#world{robots = Robots#{Id := Robot}}.

embodied(Id, Chassis, IsFree, #world{robots = Robots} = World) ->
    case Robots of
        #{Id := Robot} ->
            _ = erlang:monitor(process, Chassis),
            Embodied = Robot#robot{chassis = Chassis, is_free = IsFree},
            {reply, ok, put_robot(Id, Embodied, World)};
        #{} ->
            {reply, {error, io_lib:format("the world has no robot ~b", [Id])}, World}
    end.

%% -- bodies ---------------------------------------------------------------------------------

%% Hardware tells when something was (system time): a moment ago, but not before what it has told last.
%% However late it is heard, the body moves as if it had been heard at once.
hears(Id, Chassis, {at, SystemUs, What}, #world{robots = Robots, clock = Clock} = World) ->
    case Robots of
        #{Id := #robot{chassis = Chassis, body = Body, told_at = Before} = Robot} ->
            Now = now_us(World),
            Then = starl_live_clock:at_us(SystemUs, Clock),
            At = lists:max([Before, Now - ?LATE_US, min(Now, Then)]),
            Told = yielded(Id, does(What, At, Body), Robot#robot{told_at = At}, World),
            driven(Id, What, At, Told);
        #{} ->
            World
    end;
hears(Id, Chassis, What, #world{robots = Robots} = World) ->
    case Robots of
        #{Id := #robot{chassis = Chassis, body = Body} = Robot} ->
            yielded(Id, does(What, now_us(World), Body), Robot, World);
        #{} ->
            World
    end.

does({drive, Script, Until, Mark}, Now, Body) ->
    case starl_live_chassis:is_late(Script, Until, Now) of
        true -> {[], [], Body};
        false -> starl_world_body:drive(Script, Mark, Now, Body)
    end;
does({actuate, What, Mark}, Now, Body) ->
    starl_world_body:actuate(What, Mark, Now, Body);
does(stop, Now, Body) ->
    starl_world_body:stop(Now, Body).

advance(Id, #world{robots = Robots} = World) ->
    #{Id := #robot{body = Body} = Robot} = Robots,
    yielded(Id, starl_world_body:advance(now_us(World), Body), Robot, World).

yielded(Id, {Traces, Answers, Body}, #robot{chassis = Chassis} = Robot, World) ->
    _ = Answers =/= [] andalso is_pid(Chassis) andalso (Chassis ! {starl_body_says, Answers}),
    ok = wake(Id, starl_world_body:next_due(Body), World),
    told(Traces, put_robot(Id, Robot#robot{body = Body}, World)).

%% A wake-up that comes when there is nothing to do any more does no harm.
wake(_Id, none, _World) ->
    ok;
wake(Id, Due, #world{clock = Clock}) ->
    At = starl_live_clock:monotonic_ms(Due, Clock),
    _ = erlang:send_after(At, self(), {advance, Id}, [{abs, true}]),
    ok.

%% -- what hardware touches ------------------------------------------------------------------

felt(#world{is_felt = true} = World) ->
    World;
felt(World) ->
    _ = erlang:send_after(starl_world_floor:period_us() div 1000, self(), feel),
    World#world{is_felt = true}.

free(#world{robots = Robots}) -> [Id || {Id, #robot{is_free = true}} <- maps:to_list(Robots)].

%% A robot that was told to drive feels at once that it cannot.
driven(Id, {drive, _, _, _}, At, #world{floor = Floor} = World) ->
    feel(At, [Id], World#world{floor = starl_world_floor:told(Id, Floor)});
driven(_Id, _What, _At, World) ->
    World.

feel(At, Ids, #world{robots = Robots, floor = Floor} = World) ->
    Bodies = [
        starl_world_body:on_floor(Id, At, Body)
     || {Id, #robot{body = Body}} <- lists:sort(maps:to_list(Robots))
    ],
    {Changes, Next} = starl_world_floor:look(Ids, Bodies, Floor),
    lists:foldl(fun(Change, W) -> touched(At, Change, W) end, World#world{floor = Next}, Changes).

touched(At, {Id, {_Bits, IsBlocked} = Touch}, #world{robots = Robots} = World) ->
    #{Id := #robot{chassis = Chassis, body = Body, told_at = Before} = Robot} = Robots,
    _ = is_pid(Chassis) andalso (Chassis ! {starl_body_touches, Touch}),
    case IsBlocked of
        true -> yielded(Id, starl_world_body:stop(max(At, Before), Body), Robot, World);
        false -> World
    end.

%% -- positioning ----------------------------------------------------------------------------

show(#world{rate_hz = Rate, robots = Robots, clock = Clock} = World) ->
    Next = starl_live_clock:monotonic_ms(now_us(World) + round(1.0e6 / Rate), Clock),
    _ = erlang:send_after(Next, self(), show, [{abs, true}]),
    Ids = lists:sort(maps:keys(Robots)),
    {Seen, Drawn} = seen(0, Ids, World),
    Watching = [{Id, S} || {Id, #robot{sight = S}} <- maps:to_list(Robots), is_pid(S)],
    lists:foldl(
        fun({Id, Sight}, Before) ->
            {Picture, Shown} = shown(Id, Seen, Before),
            Sight ! {starl_seen, Picture},
            Shown
        end,
        Drawn,
        Watching
    ).

%% A frozen system shows a robot the last picture that it has got, again and again, as a new one.
shown(Id, Seen, #world{shown = Shown, frozen = Frozen} = World) ->
    Last = maps:get(Id, Shown, #{}),
    case lists:member(Id, Frozen) of
        true ->
            Now = now_us(World),
            {[{R, Pose, Now} || {R, _, _} <- Seen, #{R := Pose} <- [Last]], World};
        false ->
            Latest = maps:merge(Last, maps:from_list([{R, Pose} || {R, Pose, _} <- Seen])),
            {Seen, World#world{shown = Shown#{Id => Latest}}}
    end.

seen(By, Ids, #world{robots = Robots, sim = Sim, draws = N, whole_mm = Whole} = World) ->
    Now = now_us(World),
    #{profiles := Profiles, seed := Seed} = Sim,
    Seen = [
        {Id, rounded(Whole, blurred(Pose, {Seed, By, Id, N}, Id, Profiles)), Now}
     || Id <- Ids,
        #{Id := #robot{body = Body}} <- [Robots],
        {_, _, Caught} <- [starl_world_body:advance(Now, Body)],
        Pose <- [starl_world_body:pose(Now, Caught)]
    ],
    {Seen, World#world{draws = N + 1}}.

blurred(Pose, Key, Id, Profiles) ->
    starl_sim_sense:blur(Pose, Key, starl_chassis:of_robot(Id, Profiles)).

rounded(false, Pose) -> Pose;
rounded(true, {X, Y, Heading}) -> {float(round(X)), float(round(Y)), Heading}.

%% -- robots that start and end --------------------------------------------------------------

result(Id, Result, #world{robots = Robots} = World) ->
    #{Id := Robot} = Robots,
    Next = put_robot(Id, Robot#robot{result = Result}, World),
    case running(Next) of
        [] -> ended(done, Next);
        _ -> Next
    end.

running(#world{robots = Robots}) ->
    [Id || {Id, #robot{result = running}} <- maps:to_list(Robots)].

gone(Pid, #world{robots = Robots} = World) ->
    case [Id || {Id, #robot{link = Link}} <- maps:to_list(Robots), Link =:= Pid] of
        [Id] -> down(Id, maps:get(Id, Robots), World);
        [] -> World
    end.

down(_Id, #robot{is_up = false}, World) ->
    World;
down(Id, #robot{body = Body, names = Names} = Robot, World) ->
    Now = now_us(World),
    Last = unsaid(Robot),
    Down = [{Now, Id, robot, down} | [{Now, Id, Name, crashed} || Name <- Names]],
    Left = Robot#robot{is_up = false, link = none},
    told(Last ++ Down, yielded(Id, left(Now, Robot#robot.is_free, Body), Left, World)).

left(Now, true, Body) -> starl_world_body:advance(Now, Body);
left(Now, false, Body) -> starl_world_body:stop(Now, Body).

%% What a killed node has done and could not tell any more.
unsaid(#robot{record = none}) -> [];
unsaid(#robot{record = File, batch = Batch}) -> starl_live_record:read(File, Batch).

by_hand(Done, #world{hands = Hands, observer = Observer} = World) ->
    Now = now_us(World),
    {Told, Next} = Done(Now, Hands),
    ok = lists:foreach(fun(F) -> starl_observer:tell({fault, Now, F}, Observer) end, Told),
    World#world{hands = Next}.

%% -- judging --------------------------------------------------------------------------------

told([], World) ->
    World;
told(Events, #world{judge = Judge} = World) ->
    World#world{judge = starl_world_judge:told(Events, Judge)}.

judged(#world{ending = Ending} = World) when Ending =/= none -> World;
judged(#world{judge = Judge, limit_us = Limit} = World) ->
    Now = now_us(World),
    case starl_world_judge:judge(Now, Judge) of
        {violation, Next} -> ended(violation, World#world{judge = Next});
        {ok, Next} when Now >= Limit -> ended(time, World#world{judge = Next});
        {ok, Next} -> World#world{judge = Next}
    end.

ended(Ending, #world{ending = none, callers = Callers} = World) ->
    lists:foreach(fun(From) -> gen_server:reply(From, Ending) end, Callers),
    World#world{ending = Ending, callers = []};
ended(_Ending, World) ->
    World.

outcome(#world{judge = Judge, robots = Robots, ending = Ending} = World) ->
    Now = now_us(World),
    {Violations, Results} = starl_world_judge:close(Now, Judge),
    Told = #{ending => Ending, end_us => Now, violations => Violations, digest => <<>>},
    ok = starl_observer:tell({ended, Told}, World#world.observer),
    Summaries = [{Id, summary(Now, Robot)} || {Id, Robot} <- lists:sort(maps:to_list(Robots))],
    #{
        ending => Ending,
        end_us => Now,
        violations => Violations,
        monitors => Results,
        robots => Summaries,
        digest => <<>>,
        events => lists:sum([E || {_, #{events := E}} <- Summaries]),
        packets => lists:sum([P || {_, #{packets := P}} <- Summaries]),
        lost => []
    }.

summary(Now, #robot{body = Body, result = Result, link = Link}) ->
    {_, _, Caught} = starl_world_body:advance(Now, Body),
    Figures = figures(Link),
    Figures#{
        at_us => Now,
        chain => 0,
        checkpoints => [],
        result => Result,
        pose => starl_world_body:pose(Now, Caught),
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
