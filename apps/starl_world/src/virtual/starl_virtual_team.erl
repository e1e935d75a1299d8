%% @doc Runs a team of live robots in virtual time: the programs of {@link starl_virtual_robot} with
%% one event queue. It applies the faults of a scenario and power cuts. Its radio loses, doubles,
%% delays and damages datagrams, and an attacker sends them again. The monitors of the scenario
%% judge the facts.
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
%% <dt>reloads of the scenario</dt><dd>the operator notifies the robots that are up; a robot that starts
%%   gets the new code; when a reload fails on one of them, all go back</dd>
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
%% The most operations of the disk before the power goes.
-define(OPERATIONS, 12).
-record(robot, {
    id :: starl:robot_id(),
    computer :: starl_virtual_computer:t(),
    program = none :: starl_virtual_robot:t() | none,
    condition = down :: up | down | dead,
    booted_us = none :: integer() | none,
    life = 0 :: non_neg_integer(),
    names = [] :: [starl_machine:name()],
    hold_us = 0 :: integer(),
    lag_us = 0 :: non_neg_integer(),
    result = running :: running | given_up | {done, term()},
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
    Computer = [clock_drift, clock_freeze, kill_machine, kill_robot, reboot, pause, slow],
    Network ++ Computer ++ [store_full, store_damaged, store_lost, store_set_back].

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
        robots = maps:from_list([
            {Id, #robot{id = Id, computer = starl_virtual_computer:new(Id, Peers, Plan)}}
         || Id <- Ids
        ]),
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
    ok = starl_virtual_computer:suffer(Trouble, (robot(Id, Team))#robot.computer),
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

runs(Step, #robot{computer = Computer}, #team{now = Now}) ->
    ok = starl_virtual_computer:shows(Now, Computer),
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
    Due = starl_virtual_computer:due_us(DueUs, Team#team.now, Robot#robot.computer),
    message(Due, {message, Id, Life, Actor, Message}, Robot, Team);
carry_out({sent, To, Bytes}, Robot, Team) ->
    sent(To, Bytes, Robot, Team);
carry_out({answer, Message}, #robot{id = Id, life = Life} = Robot, #team{now = Now} = Team) ->
    {Once, Before} = draw(20, Robot, Team),
    {Us, Drawn} = draw(longest_us(Once), Before, Team),
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
carry_out({reloaded, Name, Told}, Robot, Team) ->
    heeded(Name, Told, Robot, Team).

longest_us(1) -> ?COMPUTES_US;
longest_us(_) -> ?ANSWER_US.

heeded(Name, #{number := N, outcome := Outcome}, Robot, #team{now = Now} = Team) ->
    #robot{id = Id, computer = Before} = Robot,
    Computer = starl_virtual_computer:heeded(Outcome, Name, N, Now, Before),
    Known = kept(Robot#robot{computer = Computer}, Team),
    case starl_reload:is_failure(Outcome) of
        true -> failed(N, Id, Known);
        false -> Known
    end.

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

sent(To, Bytes, #robot{id = Id, sent = Sent} = Robot, Team) ->
    #team{world = World, robots = Robots, now = Now} = Team,
    N = maps:get(To, Sent, 0) + 1,
    Counted = kept(Robot#robot{sent = Sent#{To => N}}, Team),
    lists:foldl(
        fun({R, At, Datagram}, T) -> plan(At, {datagram, R, Id, Datagram}, T) end,
        Counted,
        starl_virtual_air:arrivals({Id, To, N}, Bytes, map_size(Robots), Now, World)
    ).

%% -- faults ---------------------------------------------------------------------------------

struck(_Strike, #robot{condition = dead}, Team) ->
    Team;
struck({kill_machine, _Name}, #robot{condition = up, program = Program} = Robot, Team) ->
    done(runs(fun() -> starl_virtual_robot:kill_app(Program) end, Robot, Team), Robot, Team);
struck({pause, Until}, #robot{hold_us = Before} = Robot, Team) ->
    kept(Robot#robot{hold_us = max(Before, Until)}, Team);
struck({lag, Us}, Robot, Team) ->
    kept(Robot#robot{lag_us = Us}, Team);
struck({reload, N}, #robot{computer = Before} = Robot, #team{world = World} = Team) ->
    {Order, Computer} = starl_virtual_computer:reload(N, World, Before),
    told({reload, Order, self()}, Robot#robot{computer = Computer}, Team);
struck({take_back, N, Failed}, #robot{computer = Before} = Robot, Team) ->
    Computer = starl_virtual_computer:take_back(N, Before),
    told({take_back, N, Failed}, Robot#robot{computer = Computer}, Team);
struck(Strike, Robot, Team) ->
    power_struck(Strike, Robot, Team).

%% Faults by which the power goes, or comes back.
power_struck(go_down, #robot{condition = up} = Robot, Team) ->
    {How, Drawn} = draw(3, Robot, Team),
    falls(How, Drawn, kept(Drawn, Team));
power_struck(come_up, #robot{condition = up, id = Id} = Robot, Team) ->
    Down = without_power(Robot, Team),
    comes_up(robot(Id, Down), Down);
power_struck(come_up, Robot, Team) ->
    comes_up(Robot, Team);
power_struck(try_start, #robot{condition = down} = Robot, Team) ->
    Drawn = power_goes_soon(Robot, Team),
    comes_up(Drawn, kept(Drawn, Team));
power_struck(kill_robot, #robot{id = Id} = Robot, Team) ->
    #team{now = Now} = Down = goes_down(killed, Robot, Team),
    Dead = kept((robot(Id, Down))#robot{condition = dead}, Down),
    judged([{Now, Id, robot, {died, killed}}], Dead);
power_struck(lose_store, Robot, Team) ->
    store_struck(lose_store, Robot, without_power(Robot, Team));
power_struck({Kind, _Image} = Strike, Robot, Team) when
    Kind =:= save_store; Kind =:= set_back_store
->
    store_struck(Strike, Robot, without_power(Robot, Team));
power_struck(_Strike, _Robot, Team) ->
    Team.

%% The program is killed, the power goes, or it goes at one of the next operations of the disk.
falls(1, Robot, Team) -> goes_down(killed, Robot, Team);
falls(2, Robot, Team) -> without_power(Robot, Team);
falls(3, Robot, Team) -> kept(power_goes_soon(Robot, Team), Team).

power_goes_soon(#robot{computer = Computer} = Robot, Team) ->
    {N, Drawn} = draw(?OPERATIONS, Robot, Team),
    ok = starl_virtual_computer:cut_after(N, Computer),
    Drawn.

%% There is another disk in the robot, which has no power.
store_struck(Strike, #robot{id = Id, computer = Computer}, #team{now = Now} = Team) ->
    Facts = starl_virtual_computer:strike_store(Strike, Computer),
    judged([{Now, Id, robot, Fact} || Fact <- Facts], Team).

%% The operator tells a robot that is up; one that is down starts with what it is to run.
told(Word, #robot{id = Id, life = Life, condition = up} = Robot, Team) ->
    Event = {message, Id, Life, link, {'$gen_cast', Word}},
    delivered(Event, Robot, kept(Robot, Team));
told(_Word, Robot, Team) ->
    kept(Robot, Team).

goes_down(_Why, #robot{condition = Condition}, Team) when Condition =/= up ->
    Team;
goes_down(Why, #robot{id = Id, program = Program, names = Names} = Robot, Team) ->
    _ = starl_virtual_robot:halt(Program),
    ok = starl_virtual_computer:power(Why, Robot#robot.computer),
    #team{now = Now} = Team,
    Crashed = [{Now, Id, Name, crashed} || Name <- Names],
    Facts = [{Now, Id, robot, down} || Names =/= []] ++ Crashed,
    judged(Facts, kept(Robot#robot{condition = down, names = []}, Team)).

without_power(#robot{computer = Computer} = Robot, Team) ->
    goes_down({starl_power_cut, starl_virtual_computer:disk(Computer)}, Robot, Team).

%% A program takes a while to start: two lives do not begin in one millisecond.
comes_up(#robot{id = Id, condition = down, booted_us = Last}, #team{now = Now} = Team) when
    is_integer(Last), Now < Last + ?AGAIN_US
->
    plan(Last + ?AGAIN_US, {boot, Id}, Team);
comes_up(#robot{condition = down, life = Before} = Robot, #team{world = World, now = Now} = Team) ->
    Life = Before + 1,
    Started = starl_virtual_computer:start(Life, Now, World, Robot#robot.computer),
    done(Started, Robot#robot{life = Life, booted_us = Now}, Team);
comes_up(_Robot, Team) ->
    Team.
