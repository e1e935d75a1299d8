%% @doc A team of live robots in virtual time: the programs of {@link starl_virtual_robot}, with one queue
%% of events, the faults of a scenario, a radio that loses, doubles, delays and damages datagrams, an
%% attacker who sends them again, and power cuts. The monitors of the scenario judge the facts.
%%
%% The network's faults are those of the simulator ({@link starl_sim_radio}), applied to datagrams. Of
%% the others:
%% <dl>
%% <dt>reboot</dt><dd>the program is killed, the power goes, or it goes at one of the next operations
%%   of the disk; meanwhile the robot may try to start, and the power goes again while it does; it starts
%%   at the end of the fault</dd>
%% <dt>kill_machine</dt><dd>the application's process is killed</dd>
%% <dt>pause, slow, kill_robot</dt><dd>as in the simulator</dd>
%% <dt>clock_drift, clock_freeze</dt><dd>the computer's time, system and monotonic; it is never set
%%   ({@link starl_live_clock}), and stands still for no more than 6 s in all</dd>
%% <dt>reloads of the scenario</dt><dd>the operator tells the robots that are up; one that starts gets the
%%   new code; when a reload fails on one of them, all go back</dd>
%% <dt>store_full, store_damaged</dt><dd>the disk is full; the files of terms are found damaged by
%%   machines that start</dd>
%% <dt>store_lost, store_set_back</dt><dd>there is an empty disk in the place of the robot's, or the image
%%   of one of its earlier lives</dd>
%% </dl>
-module(starl_virtual_team).

-export([run/1, kinds/0]).

%% The application answers its link after this time at most, and one time in twenty it computes for
%% longer; the positioning system answers.
-define(ANSWER_US, 3000).
-define(COMPUTES_US, 400000).
-define(SIGHT_US, 20000).
%% A program that has ended by itself is started anew after this time, and none sooner after its last start.
-define(AGAIN_US, 100000).
%% The news of a reload that has failed takes this time.
-define(NEWS_US, 100000).
%% The part of the datagrams that the attacker sends again, and after what time at most.
-define(PLAYED, 0.02).
-define(PLAYED_US, 40000000).
%% The most operations of the disk before the power goes.
-define(OPERATIONS, 12).
%% A clock stands still for this time at most, in all: datagrams are fresh for 15 s.
-define(FROZEN_US, 6000000).
-define(EPOCH_US, 1700000000000000).

-record(robot, {
    id :: starl:robot_id(),
    clock :: starl_sim_clock:t(),
    shown :: starl_virtual_clock:t(),
    disk :: starl_virtual_disk:name(),
    config :: starl_virtual_robot:config(),
    program = none :: starl_virtual_robot:t() | none,
    condition = down :: up | down | dead,
    booted_us = none :: integer() | none,
    life = 0 :: non_neg_integer(),
    names = [] :: [starl_machine:name()],
    hold_us = 0 :: integer(),
    lag_us = 0 :: non_neg_integer(),
    result = running :: running | given_up | {done, term()},
    %% the code that its machines start with, as the operator knows it
    codes = #{} :: starl_reload:codes(),
    %% when it has told how a machine has heeded a reload
    heeded = #{} :: #{{starl_machine:name(), starl_reload:count()} => integer()},
    %% the numbers of datagrams to each robot, of answers
    sent = #{} :: #{starl:robot_id() => pos_integer()},
    draws = 0 :: non_neg_integer()
}).

-record(team, {
    world :: starl_sim_world:t(),
    poses :: [{starl:robot_id(), starl:pose()}],
    robots :: #{starl:robot_id() => #robot{}},
    monitors :: starl_monitor:t(),
    queue = gb_trees:empty() :: gb_trees:tree({integer(), pos_integer()}, event()),
    planned = 1 :: pos_integer(),
    now = 0 :: integer(),
    limit_us :: integer(),
    events = 0 :: non_neg_integer(),
    chain = 0 :: non_neg_integer(),
    violations = [] :: [starl_monitor:violation()]
}).

-type event() ::
    {boot, starl:robot_id()}
    | {strike, starl:robot_id(), term()}
    | {disk, starl:robot_id(), starl_virtual_disk:trouble()}
    | {datagram, starl:robot_id(), From :: starl:robot_id(), binary()}
    | {message, starl:robot_id(), Life :: pos_integer(), starl_virtual_robot:actor(), term()}.

%% @doc The kinds of faults that are carried out.
-spec kinds() -> [starl_run_fault:kind()].
kinds() ->
    Network = [Kind || {Kind, _, _, _, _} <- starl_run_fault:kinds_of(network), Kind =/= range],
    Network ++
        [
            clock_drift,
            clock_freeze,
            kill_machine,
            kill_robot,
            reboot,
            pause,
            slow,
            store_full,
            store_damaged,
            store_lost,
            store_set_back
        ].

%% @doc Runs a scenario to its end, or to the first violation. `watch' in it: more monitors.
-spec run(#{app := module(), atom() => term()}) -> starl_virtual_run:result().
run(Given) ->
    _ = process_flag(trap_exit, true),
    Scenario = (maps:remove(watch, Given))#{mode => process},
    {ok, {#{faults := Faults}, Scene, Plan}} = starl_run:plan(Scenario, maps:with([watch], Given)),
    #{world := World, reloads := Reloads} = Plan,
    Told = starl_run_reloads:world(Reloads, starl_run_plan:parts(Scene)),
    Team = ended(play(begun(Faults, Plan#{world := maps:merge(World, Told)}))),
    #{
        violations => lists:reverse(Team#team.violations),
        events => Team#team.events,
        digest => Team#team.chain
    }.

begun(Faults, #{robots := Poses, world := World, monitors := Monitors, limit_us := Limit} = Plan) ->
    Ids = [Id || {Id, _} <- Poses],
    Peers = starl_virtual_socket:peers(Ids),
    {Facts, _Bodies} = starl_world_team:new(Poses, World),
    Team = #team{
        world = World,
        poses = Poses,
        robots = maps:from_list([{Id, robot(Id, Peers, Plan)} || Id <- Ids]),
        monitors = starl_monitor:new([excused(Monitor, World) || Monitor <- Monitors]),
        limit_us = Limit
    },
    Strikes = lists:append([starl_run_fault:strikes(Fault) || Fault <- Faults]),
    Events =
        [{0, {boot, Id}} || Id <- Ids] ++
            [{At, {strike, Id, Strike}} || {Id, At, Strike} <- Strikes] ++
            [Event || Fault <- Faults, Event <- troubles(Fault)] ++
            reloads(World),
    Planned = lists:foldl(fun({At, Event}, T) -> plan(At, Event, T) end, Team, Events),
    judged(Facts, Planned).

troubles({_, From, To, store_full, Robot, _}) -> trouble(Robot, From, To, full);
troubles({_, From, To, reboot, Robot, _}) -> [{500 * (From + To), {strike, Robot, try_start}}];
troubles({_, From, To, store_damaged, R, _}) -> trouble(R, From, To, {damaged, ".kept"});
troubles(_Fault) -> [].

trouble(Robot, From, To, Trouble) ->
    [{1000 * From, {disk, Robot, Trouble}}, {1000 * To, {disk, Robot, none}}].

%% New code may crash: what counts is what becomes of it.
excused({starl_crash_monitor, Config}, #{reloads := _}) ->
    {starl_crash_monitor, Config#{excused => [app]}};
excused(Monitor, _World) ->
    Monitor.

reloads(World) ->
    [
        {At, {strike, Id, {reload, N}}}
     || {N, #{at_us := At, robots := Ids}} <- lists:sort(
            maps:to_list(maps:get(reloads, World, #{}))
        ),
        Id <- Ids
    ].

robot(Id, Peers, #{world := World, tree := Tree}) ->
    #{seed := Seed, clock := {OffsetUs, DriftPpb}, clocks := Clocks, profiles := Profiles} = World,
    Disk = "disk-" ++ integer_to_list(Id),
    ok = starl_virtual_disk:new(Disk, {Seed, Id, disk}),
    Dir = {starl_virtual_disk, filename:join(Disk, "robot")},
    ok = starl_live_store:commission(Dir),
    Offset = round(starl_run_draw:signed({Seed, Id, offset}) * OffsetUs),
    Drift = round(starl_run_draw:signed({Seed, Id, drift}) * DriftPpb),
    Hitting = bearable([Fault || Fault <- Clocks, starl_run_fault:hits(Id, Fault)]),
    Radio = #{
        peers => Peers,
        fleet => "virtual",
        run => 1,
        key => fun() -> <<Seed:256>> end,
        %% nothing rests on beats; the radio's own runs have them
        beat_ms => infinity,
        sockets => starl_virtual_socket
    },
    #robot{
        id = Id,
        clock = starl_sim_clock:new(Offset, Drift, Hitting),
        shown = starl_virtual_clock:new(0),
        disk = Disk,
        config = #{
            robot => Id,
            tree => Tree,
            profile => starl_chassis:of_robot(Id, Profiles),
            team_seed => Seed,
            dir => Dir,
            radio => {starl_live_udp, Radio}
        }
    }.

%% A clock that is further off than the seal bears ends all talk with its robot, as it should.
bearable(Faults) -> bearable(Faults, ?FROZEN_US).

bearable([], _Left) ->
    [];
bearable([{_, From, To, clock_freeze, _, _} | Faults], Left) when To - From > Left ->
    bearable(Faults, Left);
bearable([{_, From, To, clock_freeze, _, _} = Fault | Faults], Left) ->
    [Fault | bearable(Faults, Left - (To - From))];
bearable([Fault | Faults], Left) ->
    [Fault | bearable(Faults, Left)].

%% -- the queue ------------------------------------------------------------------------------

plan(At, Event, #team{queue = Queue, planned = N, now = Now} = Team) ->
    Team#team{queue = gb_trees:insert({max(At, Now), N}, Event, Queue), planned = N + 1}.

play(#team{violations = [_ | _]} = Team) ->
    Team;
play(#team{queue = Queue, limit_us = Limit} = Team) ->
    case gb_trees:is_empty(Queue) orelse is_over(Team) of
        true ->
            Team;
        false ->
            case gb_trees:take_smallest(Queue) of
                {{At, _}, _, _} when At > Limit -> Team#team{now = Limit};
                {{At, _}, Event, Left} -> play(happens(Event, Team#team{now = At, queue = Left}))
            end
    end.

%% All that are alive are done.
is_over(#team{robots = Robots}) ->
    lists:all(
        fun(#robot{result = Result, condition = Condition}) ->
            Result =/= running orelse Condition =:= dead
        end,
        maps:values(Robots)
    ).

%% Every program ends, and its processes with it.
ended(#team{robots = Robots, now = Now, monitors = Monitors} = Team) ->
    _ = [starl_virtual_robot:halt(P) || #robot{program = P, condition = up} <- maps:values(Robots)],
    {Late, _Results} = starl_monitor:finish(Now, Monitors),
    found(Late, Team).

found(Violations, #team{violations = Before} = Team) ->
    Team#team{violations = lists:reverse(Violations, Before)}.

happens({strike, Id, Strike}, Team) ->
    struck(Strike, robot(Id, Team), Team);
happens({disk, Id, Trouble}, Team) ->
    ok = starl_virtual_disk:suffer((robot(Id, Team))#robot.disk, Trouble),
    Team;
happens({boot, Id}, Team) ->
    comes_up(robot(Id, Team), Team);
happens({datagram, To, From, Bytes}, Team) ->
    Message = starl_virtual_socket:heard(From, To, Bytes),
    case robot(To, Team) of
        #robot{condition = up, life = Life} = Robot ->
            delivered({message, To, Life, transport, Message}, Robot, Team);
        #robot{} ->
            Team
    end;
happens({message, Id, Life, _, _} = Event, Team) ->
    case robot(Id, Team) of
        #robot{condition = up, life = Life} = Robot -> delivered(Event, Robot, Team);
        #robot{} -> Team
    end.

robot(Id, #team{robots = Robots}) -> maps:get(Id, Robots).

kept(#robot{id = Id} = Robot, #team{robots = Robots} = Team) ->
    Team#team{robots = Robots#{Id := Robot}}.

%% While the computer stands still, messages wait.
delivered(Event, #robot{hold_us = Until}, #team{now = Now} = Team) when Until > Now ->
    plan(Until, Event, Team);
delivered({message, _, _, Actor, Message}, Robot, #team{events = Events} = Team) ->
    #robot{program = Program} = Robot,
    done(
        runs(fun() -> starl_virtual_robot:hear(Actor, Message, Program) end, Robot, Team),
        Robot,
        Team#team{events = Events + 1}
    ).

runs(Step, #robot{clock = Clock, shown = Shown}, #team{now = Now}) ->
    ok = starl_virtual_clock:set(starl_sim_clock:local(Now, Clock), Shown),
    Step().

done({up, Effects, Program}, Robot, Team) ->
    carried_out(Effects, kept(Robot#robot{program = Program, condition = up}, Team), Robot);
done({{down, Why}, Effects, Program}, #robot{id = Id} = Robot, #team{now = Now} = Team) ->
    Ended = kept(Robot#robot{program = Program, condition = up}, Team),
    Told = carried_out(Effects, Ended, Robot),
    Down = goes_down(Why, robot(Id, Told), Told),
    %% whoever watches the program starts it again
    plan(Now + ?AGAIN_US, {boot, Id}, Down).

%% -- what programs do -----------------------------------------------------------------------

carried_out(Effects, Team, #robot{id = Id}) ->
    lists:foldl(fun(Effect, T) -> carry_out(Effect, robot(Id, T), T) end, Team, Effects).

carry_out({timer, Actor, DueUs, Message}, #robot{id = Id, life = Life} = Robot, Team) ->
    #robot{clock = Clock} = Robot,
    #team{now = Now} = Team,
    Left = max(0, DueUs - starl_sim_clock:local(Now, Clock)),
    Due = starl_sim_clock:due(Now, Left, Clock),
    message(Due, {message, Id, Life, Actor, Message}, Robot, Team);
carry_out({sent, To, Bytes}, Robot, Team) ->
    sent(To, Bytes, Robot, Team);
carry_out({answer, Message}, #robot{id = Id, life = Life} = Robot, #team{now = Now} = Team) ->
    {Once, Before} = draw(20, Robot, Team),
    Most =
        case Once of
            1 -> ?COMPUTES_US;
            _ -> ?ANSWER_US
        end,
    {Us, Drawn} = draw(Most, Before, Team),
    message(Now + Us, {message, Id, Life, link, Message}, Drawn, kept(Drawn, Team));
carry_out({asked, Tag, Ids}, #robot{id = Id, life = Life} = Robot, #team{now = Now} = Team) ->
    {Us, Drawn} = draw(?SIGHT_US, Robot, Team),
    Seen = [{R, Pose, Us} || {R, Pose} <- Team#team.poses, lists:member(R, Ids)],
    Located = {starl_located, self(), Tag, Seen},
    message(Now + Us, {message, Id, Life, link, Located}, Drawn, kept(Drawn, Team));
carry_out({facts, Facts}, _Robot, #team{now = Now} = Team) ->
    judged([setelement(1, Fact, Now) || Fact <- Facts], Team);
carry_out({started, Names}, Robot, Team) ->
    kept(Robot#robot{names = Names}, Team);
carry_out({ended, Result}, Robot, Team) ->
    kept(Robot#robot{result = Result}, Team);
carry_out({reloaded, Name, #{number := N, outcome := Outcome}}, Robot, Team) ->
    Known = kept(heeded(Outcome, Name, N, Robot, Team), Team),
    case starl_reload:is_failure(Outcome) of
        true -> failed(N, Robot#robot.id, Known);
        false -> Known
    end.

heeded(taken, Name, N, #robot{heeded = Heeded} = Robot, #team{now = Now}) ->
    Robot#robot{heeded = Heeded#{{Name, N} => Now}};
heeded(done, _Name, _N, Robot, _Team) ->
    Robot;
heeded(_Back, _Name, N, #robot{codes = Codes} = Robot, _Team) ->
    Robot#robot{codes = starl_reload:without(N, Codes)}.

%% The operator has all robots of the reload go back.
failed(N, Failed, #team{world = #{reloads := Reloads}, now = Now} = Team) ->
    #{N := #{robots := Ids}} = Reloads,
    lists:foldl(
        fun(Id, T) -> plan(Now + ?NEWS_US, {strike, Id, {take_back, N, Failed}}, T) end, Team, Ids
    ).

message(At, Event, #robot{lag_us = Lag}, Team) -> plan(At + Lag, Event, Team).

%% A draw of the robot, from its seed and their number.
draw(Most, #robot{id = Id, draws = N} = Robot, #team{world = #{seed := Seed}}) ->
    {starl_run_draw:between({Seed, Id, draw, N}, 1, Most), Robot#robot{draws = N + 1}}.

judged([], Team) ->
    Team;
judged(Facts, #team{monitors = Monitors, chain = Chain} = Team) ->
    Chained = Team#team{chain = erlang:phash2({Chain, Facts})},
    case starl_monitor:step(Facts, Monitors) of
        {ok, Next} ->
            Chained#team{monitors = Next};
        {violation, Violation, Next} ->
            found([Violation], Chained#team{monitors = Next})
    end.

%% -- the radio ------------------------------------------------------------------------------

sent(To, Bytes, #robot{id = Id, sent = Sent} = Robot, #team{world = World, now = Now} = Team) ->
    #{seed := Seed} = World,
    N = maps:get(To, Sent, 0) + 1,
    Link = {Seed, Id, To, N},
    Counted = kept(Robot#robot{sent = Sent#{To => N}}, Team),
    Heard =
        case starl_sim_radio:arrivals(Link, Now, World) of
            lost -> [];
            Arrivals -> Arrivals
        end,
    All = [{To, Now + Us, state(State, Bytes, {Link, Us})} || {Us, State} <- Heard],
    lists:foldl(
        fun({R, At, Datagram}, T) -> plan(At, {datagram, R, Id, Datagram}, T) end,
        Counted,
        All ++ played(Link, Bytes, Counted)
    ).

state(intact, Bytes, _Key) ->
    Bytes;
state(corrupt, Bytes, Key) ->
    Bit = starl_run_draw:between({Key, bit}, 0, 8 * byte_size(Bytes) - 1),
    case starl_run_draw:between({Key, how}, 1, 4) of
        1 ->
            binary:part(Bytes, 0, Bit div 8);
        _ ->
            <<Before:Bit, B:1, After/bits>> = Bytes,
            <<Before:Bit, (1 - B):1, After/bits>>
    end.

%% An attacker has recorded the datagram, and sends it to some robot.
played(Link, Bytes, #team{now = Now, robots = Robots}) ->
    case starl_run_draw:uniform({Link, played}) < ?PLAYED of
        true ->
            At = Now + starl_run_draw:between({Link, played_at}, 1, ?PLAYED_US),
            [{starl_run_draw:between({Link, played_to}, 1, map_size(Robots)), At, Bytes}];
        false ->
            []
    end.

%% -- faults ---------------------------------------------------------------------------------

struck(_Strike, #robot{condition = dead}, Team) ->
    Team;
struck({kill_machine, _Name}, #robot{condition = up, program = Program} = Robot, Team) ->
    done(runs(fun() -> starl_virtual_robot:kill_app(Program) end, Robot, Team), Robot, Team);
struck({pause, Until}, #robot{hold_us = Before} = Robot, Team) ->
    kept(Robot#robot{hold_us = max(Before, Until)}, Team);
struck({lag, Us}, Robot, Team) ->
    kept(Robot#robot{lag_us = Us}, Team);
struck(go_down, #robot{condition = up, disk = Disk} = Robot, Team) ->
    {How, Drawn} = draw(3, Robot, Team),
    case How of
        1 ->
            goes_down(killed, Drawn, kept(Drawn, Team));
        2 ->
            without_power(Drawn, kept(Drawn, Team));
        3 ->
            {N, Next} = draw(?OPERATIONS, Drawn, Team),
            ok = starl_virtual_disk:cut_after(Disk, N, between),
            kept(Next, Team)
    end;
struck(come_up, #robot{condition = up} = Robot, Team) ->
    #robot{id = Id} = Robot,
    Down = without_power(Robot, Team),
    comes_up(robot(Id, Down), Down);
struck(come_up, Robot, Team) ->
    comes_up(Robot, Team);
struck(try_start, #robot{condition = down, disk = Disk} = Robot, Team) ->
    {N, Drawn} = draw(?OPERATIONS, Robot, Team),
    ok = starl_virtual_disk:cut_after(Disk, N, between),
    comes_up(Drawn, kept(Drawn, Team));
struck(lose_store, #robot{disk = Disk} = Robot, Team) ->
    Down = without_power(Robot, Team),
    ok = starl_virtual_disk:erase(Disk),
    Down;
struck({save_store, Image}, #robot{disk = Disk} = Robot, Team) ->
    Down = without_power(Robot, Team),
    ok = starl_virtual_disk:save(Image, Disk),
    Down;
struck({set_back_store, Image}, #robot{id = Id, disk = Disk} = Robot, Team) ->
    #team{now = Now} = Down = without_power(Robot, Team),
    case starl_virtual_disk:set_back(Image, Disk) of
        ok -> judged([{Now, Id, robot, store_set_back}], Down);
        none -> Down
    end;
struck({reload, N}, #robot{codes = Before} = Robot, #team{world = World} = Team) ->
    #{reloads := #{N := #{order := Order}}, parts := Parts} = World,
    {_Words, Codes} = starl_reload:take(Order, Parts, Before),
    told({reload, Order, self()}, Robot#robot{codes = Codes}, Team);
struck({take_back, N, Failed}, #robot{codes = Before} = Robot, Team) ->
    told({take_back, N, Failed}, Robot#robot{codes = starl_reload:without(N, Before)}, Team);
struck(kill_robot, #robot{id = Id} = Robot, Team) ->
    #team{now = Now} = Down = goes_down(killed, Robot, Team),
    Dead = kept((robot(Id, Down))#robot{condition = dead}, Down),
    judged([{Now, Id, robot, {died, killed}}], Dead);
struck(_Strike, _Robot, Team) ->
    Team.

%% The operator tells a robot that is up; one that is down starts with what it is to run.
told(Word, #robot{id = Id, life = Life, condition = up} = Robot, Team) ->
    Event = {message, Id, Life, link, {'$gen_cast', Word}},
    delivered(Event, Robot, kept(Robot, Team));
told(_Word, Robot, Team) ->
    kept(Robot, Team).

%% A robot that starts before its machine has passed its trial is on trial from its start on.
codes(#robot{codes = Codes, heeded = Heeded}, #{reloads := Reloads}, Now) ->
    Passed = [
        N
     || {{_Name, N}, At} <- lists:sort(maps:to_list(Heeded)),
        Now > At + maps:get(trial_us, maps:get(order, maps:get(N, Reloads)))
    ],
    lists:foldl(fun starl_reload:passed/2, Codes, lists:sort(Passed));
codes(_Robot, _World, _Now) ->
    #{}.

goes_down(_Why, #robot{condition = Condition}, Team) when Condition =/= up ->
    Team;
goes_down(Why, #robot{id = Id, program = Program, names = Names} = Robot, Team) ->
    _ = starl_virtual_robot:halt(Program),
    ok = power(Why, Robot),
    #team{now = Now} = Team,
    Crashed = [{Now, Id, Name, crashed} || Name <- Names],
    Facts = [{Now, Id, robot, down} || Names =/= []] ++ Crashed,
    judged(Facts, kept(Robot#robot{condition = down, names = []}, Team)).

without_power(#robot{disk = Disk} = Robot, Team) ->
    goes_down({starl_power_cut, Disk}, Robot, Team).

power({starl_power_cut, _}, #robot{disk = Disk}) -> starl_virtual_disk:cut_power(Disk);
power(_Killed, #robot{disk = Disk}) -> starl_virtual_disk:keep_power(Disk).

%% A program takes a while to start: two lives do not begin in one millisecond.
comes_up(#robot{id = Id, condition = down, booted_us = Last}, #team{now = Now} = Team) when
    is_integer(Last), Now < Last + ?AGAIN_US
->
    plan(Last + ?AGAIN_US, {boot, Id}, Team);
comes_up(#robot{condition = down, life = Before} = Robot, #team{world = World, now = Now} = Team) ->
    #{seed := Seed} = World,
    #robot{id = Id, config = #{radio := {Module, Radio}} = Config, shown = Shown} = Robot,
    Life = Before + 1,
    Clock = starl_live_clock:on(
        {starl_virtual_clock, Shown}, starl_live_clock:new(?EPOCH_US, 1)
    ),
    Random = fun(Stream) ->
        rand:seed_s(exsss, erlang:phash2({Seed, Id, Life, Stream}, 4294967296))
    end,
    Own = Config#{
        codes => codes(Robot, World, Now),
        random => fun(Name, Incarnation) -> Random({Name, Incarnation}) end,
        radio := {Module, Radio#{random => fun() -> Random(radio) end}}
    },
    Up = Robot#robot{life = Life, booted_us = Now},
    done(runs(fun() -> starl_virtual_robot:boot(Own, Clock) end, Up, Team), Up, Team);
comes_up(_Robot, Team) ->
    Team.
