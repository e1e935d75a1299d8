%% @doc A live robot in a simulation: a kind of robot of the simulator's shards
%% ({@link starl_sim_robot}) that runs the program of real robots ({@link starl_virtual_program}). A
%% scenario with `program => live' has such robots. The shard has the events, the radio, the monitors
%% and the digest, as for its own robots. This module decides what faults do to the program, when the
%% answers of its processes come, and which datagrams an attacker sends again.
%% ```
%%                 killed, power cut, or the program has ended
%%               up -----------------------------------------> down      dead: killed for good
%%                ^                                              |
%%                +------ boot: the end of a fault, or 0.1 s ----+
%% '''
%% The chassis stands still, and feels nothing. Faults of the network are the simulator's, applied to
%% datagrams. Of the others:
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
-module(starl_virtual_robot).
-behaviour(starl_sim_robot).
-include_lib("starl_platform/include/starl_robot_order.hrl").

-export([kinds/0]).
-export_type([t/0, attacker/0]).
-export([plan/2, new/4, new/5, open/3, answered/3, stop_at/2, halted/1, resume/1]).
-export([at_work/1, body/1, summary/2, machines/1]).

%% The application answers its link after this time at most, and one time in twenty it computes for
%% longer; the positioning system answers.
-define(ANSWER_US, 3000).
-define(COMPUTES_US, 400000).
-define(SIGHT_US, 20000).
%% A program that has ended by itself is started anew after this time, and none sooner after its last start.
-define(AGAIN_US, 100000).
%% The most operations of the disk before the power goes.
-define(OPERATIONS, 12).
%% A clock stands still for this time at most, in all: datagrams are fresh for 15 s.
-define(FROZEN_US, 6000000).
%% The part of the datagrams that the attacker sends again, and after what time at most.
-define(PLAYED, 0.02).
-define(PLAYED_US, 40000000).

-record(?MODULE, {
    id :: starl:robot_id(),
    world :: starl_sim_world:t(),
    body :: starl_sim_platform:t(),
    clock :: starl_sim_clock:t(),
    computer :: pid(),
    attacker :: attacker(),
    %% events of this window; what is chained of the event that the program handles
    events = [] :: [starl_sim_queue:event()],
    handles = none :: handles() | none,
    facts = [] :: [{starl_machine:name(), term()}],
    stop = none :: starl_sim_robot:stop(),
    hold = {0, 0} :: starl_sim_queue:hold(),
    condition = down :: up | down | dead,
    booted_us = none :: starl_sim_queue:time() | none,
    life = 0 :: non_neg_integer(),
    names = [] :: [starl_machine:name()],
    draws = 0 :: non_neg_integer(),
    %% the code that its machines start with, as the operator knows it, and when each machine has
    %% reported that it has taken a reload
    codes = #{} :: starl_reload:codes(),
    taken = #{} :: #{{starl_machine:name(), starl_reload:count()} => integer()}
}).

-type t() :: #?MODULE{}.

%% What an attacker sends, to whom and when, who has recorded a datagram of the robot's now. All his draws
%% follow from the key.
-type attacker() :: fun(
    (Key :: term(), NowUs :: starl_sim_queue:time(), binary()) -> [
        {starl:robot_id(), AtUs :: starl_sim_queue:time(), binary()}
    ]
).

%% What is chained of an event: the part of the robot that it is for, its type, its content.
-type handles() :: {starl_machine:name(), starl_machine:event_type() | boot, term()}.

%% @doc The kinds of random faults that are carried out.
-spec kinds() -> [starl_run_fault:kind()].
kinds() ->
    Network = [Kind || {Kind, _, _, _, _} <- starl_run_fault:kinds_of(network), Kind =/= range],
    Computer = [clock_drift, clock_freeze, kill_machine, kill_robot, reboot, pause, slow],
    Network ++ Computer ++ [store_full, store_damaged, store_lost, store_set_back].

%% -- before the run -------------------------------------------------------------------------

%% @doc Adds the troubles of disks and starts to the plan of a simulation, or names a fault that
%% cannot be carried out.
-spec plan(starl_run_scenario:t(), starl_sim_plan:t()) ->
    {ok, starl_sim_plan:t()} | {error, unicode:chardata()}.
plan(#{faults := Faults}, #{robots := Poses, world := World, monitors := Monitors} = Plan) ->
    Can = [range | kinds()],
    case [Fault || {_, _, _, Kind, _, _} = Fault <- Faults, not lists:member(Kind, Can)] of
        [] ->
            Ids = [Id || {Id, _} <- Poses],
            Troubles = [Trouble || Fault <- Faults, Trouble <- troubles(Fault, Ids)],
            Excused = [excused(Monitor, World) || Monitor <- Monitors],
            {ok, starl_sim_plan:add_strikes(Troubles, Plan#{monitors := Excused})};
        [{Id, _, _, Kind, _, _} | _] ->
            {error,
                io_lib:format(
                    "fault ~ts: robots that run the program of real ones have no faults of the kind ~ts",
                    [Id, Kind]
                )}
    end.

troubles({_, From, To, reboot, Robot, _}, _Ids) ->
    [{Robot, 500 * (From + To), try_start}];
troubles({_, From, To, store_full, Target, _}, Ids) ->
    trouble(Target, From, To, full, Ids);
troubles({_, From, To, store_damaged, Target, _}, Ids) ->
    trouble(Target, From, To, {damaged, ".kept"}, Ids);
troubles(_Fault, _Ids) ->
    [].

trouble(Target, From, To, Trouble, Ids) ->
    [
        {Id, 1000 * Ms, {program, {suffer, Suffered}}}
     || Id <- Ids,
        Target =:= all orelse Target =:= Id,
        {Ms, Suffered} <- [{From, Trouble}, {To, none}]
    ].

%% New code may crash: what counts is what becomes of it.
excused({starl_crash_monitor, Config}, #{reloads := _}) ->
    {starl_crash_monitor, Config#{excused => [app]}};
excused(Monitor, _World) ->
    Monitor.

%% @doc A robot whose program boots at the first event.
-spec new(starl:robot_id(), starl:pose(), starl_robot_services:tree(), starl_sim_world:t()) -> t().
new(Id, Pose, Tree, #{clocks := Clocks, team := Team, profiles := Profiles} = Given) ->
    Hitting = [Fault || Fault <- Clocks, starl_run_fault:hits(Id, Fault)],
    World = Given#{clocks := bearable(Hitting, ?FROZEN_US)},
    Seed = maps:get(team_seed, World, maps:get(seed, World)),
    Computer = starl_virtual_computer:start(Id, starl_virtual_program, #{
        seed => Seed,
        spec => #{
            robot => Id,
            tree => Tree,
            profile => starl_chassis:of_robot(Id, Profiles),
            team_seed => Seed,
            dir => {starl_virtual_disk, "disk-" ++ integer_to_list(Id) ++ "/robot"}
        },
        udp => udp(Seed, starl_team:members(Team))
    }),
    new(Id, Pose, World, Computer, fun(Key, Now, Bytes) -> replays(Key, Now, Bytes, World) end).

%% @doc The same with another program on its computer, and another attacker.
-spec new(starl:robot_id(), starl:pose(), starl_sim_world:t(), Computer :: pid(), attacker()) ->
    t().
new(Id, Pose, World, Computer, Attacker) ->
    #?MODULE{
        id = Id,
        world = World,
        body = starl_sim_platform:new(Id, Pose, World),
        clock = starl_sim_world:clock(Id, World),
        computer = Computer,
        attacker = Attacker
    }.

udp(Seed, Ids) ->
    #{
        peers => starl_virtual_socket:peers(Ids),
        fleet => "virtual",
        run => 1,
        key => fun() -> <<Seed:256>> end,
        %% nothing rests on beats; the radio's own runs have them
        beat_ms => infinity,
        sockets => starl_virtual_socket
    }.

%% A clock that is further off than the seal bears ends all talk with its robot, as it should.
bearable([], _Left) ->
    [];
bearable([{_, From, To, clock_freeze, _, _} | Faults], Left) when To - From > Left ->
    bearable(Faults, Left);
bearable([{_, From, To, clock_freeze, _, _} = Fault | Faults], Left) ->
    [Fault | bearable(Faults, Left - (To - From))];
bearable([Fault | Faults], Left) ->
    [Fault | bearable(Faults, Left)].

%% -- windows --------------------------------------------------------------------------------

%% @doc Opens a window with these events of the robot, sorted, and begins with the first.
-spec open([starl_sim_queue:event()], starl_sim_queue:window(), t()) ->
    {busy | idle | held, t()}.
open([{_, Time, _, _, _, _} | _] = Planned, Window, #?MODULE{body = Body} = Robot) ->
    proceed(Robot#?MODULE{body = starl_sim_platform:open(Time, Window, Body), events = Planned}).

%% @doc The program has carried out its commands.
-spec answered(
    pid(), {starl_virtual_computer:up(), [starl_virtual_computer:effect()]}, t()
) -> {busy | idle | held, t()}.
answered(Pid, {Up, Effects}, #?MODULE{computer = Pid} = Robot) ->
    proceed(handled(ended_by_itself(Up, lists:foldl(fun carry_out/2, Robot, Effects)))).

%% @doc Sets where the robot halts, or turns off into a branch.
-spec stop_at(starl_sim_robot:stop(), t()) -> t().
stop_at(Stop, Robot) -> Robot#?MODULE{stop = Stop}.

%% @doc The time at which it halted, if it has.
-spec halted(t()) -> {at, starl_sim_queue:time()} | no.
halted(#?MODULE{stop = N} = Robot) ->
    case count(Robot) of
        N -> {at, now(Robot)};
        _ -> no
    end.

%% @doc Goes on with the window in which it was held.
-spec resume(t()) -> {busy | idle | held, t()}.
resume(Robot) -> proceed(Robot).

%% @doc The program, while it has commands.
-spec at_work(t()) -> [starl_sim_robot:work()].
at_work(#?MODULE{handles = none}) ->
    [];
at_work(#?MODULE{id = Id, handles = {Name, _, _}, computer = Computer} = Robot) ->
    [
        #{
            robot => Id,
            machine => Name,
            process => Computer,
            events => count(Robot),
            application => none
        }
    ].

%% @doc Its body in the simulated world.
-spec body(t()) -> starl_sim_platform:t().
body(#?MODULE{body = Body}) -> Body.

%% @doc A summary of the robot at a time.
-spec summary(starl_sim_queue:time(), t()) -> starl_sim_summary:t().
summary(Time, #?MODULE{body = Body, condition = Condition}) ->
    Result =
        case Condition of
            dead -> died;
            _ -> starl_sim_platform:result(Body)
        end,
    starl_sim_summary:of_body(Time, Body, #{result => Result, crashes => [], waits => none}).

%% @doc Its machines, each with its state and data.
-spec machines(t()) -> #{starl_machine:name() => starl_robot_tree:seen()}.
machines(#?MODULE{computer = Computer}) -> starl_virtual_computer:machines(Computer).

%% -- events ---------------------------------------------------------------------------------

%% Goes on with the rest of this window, unless the robot is to halt here.
proceed(#?MODULE{stop = none} = Robot) ->
    next(Robot);
proceed(#?MODULE{stop = {branch, N, Later}} = Robot) ->
    case count(Robot) < N of
        true -> next(Robot);
        false -> next(in_branch(Later, Robot#?MODULE{stop = none}))
    end;
proceed(#?MODULE{stop = N} = Robot) ->
    case count(Robot) of
        N -> {held, Robot};
        _ -> next(Robot)
    end.

count(#?MODULE{body = Body}) -> starl_sim_chain:events(starl_sim_platform:chain(Body)).

in_branch(Later, #?MODULE{world = World, body = Body} = Robot) ->
    Robot#?MODULE{
        world = maps:merge(World, Later), body = starl_sim_platform:turn_off(Later, Body)
    }.

next(#?MODULE{events = []} = Robot) ->
    {idle, Robot};
next(#?MODULE{condition = dead} = Robot) ->
    {idle, Robot#?MODULE{events = []}};
next(#?MODULE{events = [Event | Events], hold = Hold, body = Body} = Robot) ->
    case starl_sim_queue:delayed([Event], Hold) of
        {[], [_]} ->
            happens(Event, Robot#?MODULE{events = Events});
        {Late, []} ->
            Postponed = starl_sim_platform:postpone(Late, Body),
            next(settled(Robot#?MODULE{events = Events, body = Postponed}))
    end.

happens({Id, Time, Class, Source, Seq, {late, Content}}, Robot) ->
    happens({Id, Time, Class, Source, Seq, Content}, Robot);
happens({_, Time, _, Source, _, Content}, #?MODULE{body = Body} = Robot) ->
    Now = Robot#?MODULE{body = starl_sim_platform:at(Time, Body)},
    case handle(Content, Source, Now) of
        ignored ->
            next(Now);
        {Handles, [], Next} ->
            proceed(handled(Next#?MODULE{handles = Handles}));
        {Handles, Commands, #?MODULE{computer = Computer} = Next} ->
            ok = starl_virtual_computer:order(Computer, local(Next), Commands),
            {busy, Next#?MODULE{handles = Handles}}
    end.

%% What an event has done is chained behind it.
handled(#?MODULE{handles = {Name, Type, What}, facts = Facts, body = Body} = Robot) ->
    Now = starl_sim_platform:now(Body),
    Chained = starl_sim_platform:happens(Now, Name, Type, {What, lists:reverse(Facts)}, Body),
    settled(Robot#?MODULE{handles = none, facts = [], body = Chained}).

%% New events of this window join the others.
settled(#?MODULE{body = Body, events = Events} = Robot) ->
    case starl_sim_platform:soon(Body) of
        [] ->
            Robot;
        Soon ->
            Robot#?MODULE{
                body = starl_sim_platform:planned(Body),
                events = lists:merge(lists:sort(Soon), Events)
            }
    end.

%% The part of the robot that handles an event and what is chained of it; the commands for the program.
handle({message, Life, Actor, Message}, _From, #?MODULE{life = Life, condition = up} = Robot) ->
    {what(Message, Actor), [{hear, Actor, Message}], Robot};
handle({message, _, _, _}, _From, _Robot) ->
    ignored;
handle({sap, packet, Bytes}, From, #?MODULE{condition = up} = Robot) ->
    %% its seal differs in each run
    {{transport, packet, {From, byte_size(Bytes)}}, [{heard, From, Bytes}], Robot};
handle({sap, packet, _}, _From, _Robot) ->
    ignored;
handle(Strike, _From, Robot) ->
    case strike(Strike, Robot) of
        ignored -> ignored;
        {Commands, Struck} -> {struck(Strike), Commands, Struck}
    end.

struck({reload, #{order := #{number := N}}}) -> {robot, info, {reload, N}};
struck(Boot) when Boot =:= wake; Boot =:= boot -> {robot, boot, Boot};
struck(Strike) -> {robot, info, Strike}.

%% References and processes are not chained.
what({timeout, _, {starl_timer, Name, Timer, _, _}}, _Actor) -> {Name, timeout, Timer};
what({starl_done, _, _, _}, Actor) -> {Actor, info, answer};
what({'DOWN', _, process, _, _}, Actor) -> {Actor, info, down};
what({starl_located, _, _, Seen}, Actor) -> {Actor, info, {located, Seen}};
what({'$gen_cast', {reload, #{number := N}, _}}, Actor) -> {Actor, cast, {reload, N}};
what({'$gen_cast', {take_back, N, Failed}}, Actor) -> {Actor, cast, {take_back, N, Failed}};
what(Message, Actor) when is_tuple(Message) -> {Actor, info, element(1, Message)};
what(Message, Actor) -> {Actor, info, Message}.

%% -- what the program does ------------------------------------------------------------------

carry_out({timer, Actor, DueUs, Message}, Robot) ->
    message(due_us(DueUs, Robot), Actor, Message, Robot);
carry_out({sent, To, Bytes}, Robot) ->
    sent(To, Bytes, Robot);
carry_out({answer, Message}, Robot0) ->
    {Once, Robot1} = draw(20, Robot0),
    {Us, Robot} = draw(longest_us(Once), Robot1),
    message(now(Robot) + Us, link, Message, Robot);
carry_out({asked, Tag, Ids}, Robot0) ->
    {Us, #?MODULE{computer = Computer} = Robot} = draw(?SIGHT_US, Robot0),
    Located = {starl_located, Computer, Tag, [Seen || Id <- Ids, Seen <- seen(Id, Us, Robot)]},
    message(now(Robot) + Us, link, Located, Robot);
carry_out({facts, Facts}, Robot) ->
    lists:foldl(fun({_, _, Name, Fact}, R) -> fact(Name, Fact, R) end, Robot, Facts);
carry_out({started, Names}, Robot) ->
    Robot#?MODULE{names = Names};
carry_out({ended, Result}, #?MODULE{body = Body} = Robot) ->
    Robot#?MODULE{body = starl_sim_platform:ended(Result, Body)};
carry_out({reloaded, Name, Told}, Robot) ->
    reloaded(Name, Told, Robot);
carry_out(store_set_back, Robot) ->
    fact(robot, store_set_back, Robot).

longest_us(1) -> ?COMPUTES_US;
longest_us(_) -> ?ANSWER_US.

seen(Id, AgeUs, #?MODULE{world = #{sight := Sight}} = Robot) ->
    case starl_sim_sight:piece(Id, Sight) of
        {ok, Piece} -> [{Id, starl_trajectory:pose(now(Robot), Piece), AgeUs}];
        unknown -> []
    end.

%% Whoever watches the program starts it again. A crash of its own is a fact.
ended_by_itself({down, {crashed, Actor, Why}}, Robot) ->
    again(fact(supervisor, {crashed, Actor, starl_crash:cause(Why)}, Robot));
ended_by_itself({down, _Why}, Robot) ->
    again(Robot);
ended_by_itself(_Up, Robot) ->
    Robot.

again(Robot) -> plan_own(now(Robot) + ?AGAIN_US, ?CLASS_WORLD, boot, is_down(Robot)).

%% The program is off.
is_down(#?MODULE{names = Names} = Robot) ->
    Told = [{robot, down} || Names =/= []] ++ [{Name, crashed} || Name <- Names],
    Down = lists:foldl(fun({Name, Fact}, R) -> fact(Name, Fact, R) end, Robot, Told),
    Down#?MODULE{condition = down, names = []}.

fact(Name, Fact, #?MODULE{body = Body, facts = Facts} = Robot) ->
    Traced = starl_sim_platform:trace(Name, Fact, Body),
    Robot#?MODULE{body = Traced, facts = [{Name, in_chain(Fact)} | Facts]}.

%% The text of a crash may name processes.
in_chain({crashed, Machine, _Cause}) -> {crashed, Machine};
in_chain(Fact) -> Fact.

message(At, Actor, Message, #?MODULE{life = Life} = Robot) ->
    plan_own(At, ?CLASS_TIMER, {message, Life, Actor, Message}, Robot).

plan_own(At, Class, Content, #?MODULE{id = Id, body = Body} = Robot) ->
    Robot#?MODULE{body = starl_sim_platform:plan_event({Id, At, Class, Content}, Body)}.

sent(To, Bytes, #?MODULE{id = Id, world = #{seed := Seed}, body = Before} = Robot) ->
    {[], Sent} = starl_sim_platform:perform({transmit, To, Bytes}, transport, Before),
    Attacks = (Robot#?MODULE.attacker)(
        {Seed, Id, starl_sim_platform:packets(Sent)}, now(Robot), Bytes
    ),
    Body = lists:foldl(
        fun({Victim, At, Forged}, B) ->
            starl_sim_platform:plan_event({Victim, At, ?CLASS_PACKET, {sap, packet, Forged}}, B)
        end,
        Sent,
        Attacks
    ),
    Robot#?MODULE{body = Body}.

%% He sends some datagrams again, to any robot.
replays(Key, Now, Bytes, #{team := Team, delay_us := {Least, _}}) ->
    case starl_run_draw:uniform({Key, played}) < ?PLAYED of
        true ->
            At = Now + starl_run_draw:between({Key, at}, Least, ?PLAYED_US),
            Victim = starl_run_draw:between({Key, to}, 1, starl_team:count(Team)),
            [{lists:nth(Victim, starl_team:members(Team)), At, Bytes}];
        false ->
            []
    end.

%% A draw of the robot, from its seed and their number.
draw(Most, #?MODULE{id = Id, draws = N, world = #{seed := Seed}} = Robot) ->
    {starl_run_draw:between({Seed, Id, draw, N}, 1, Most), Robot#?MODULE{draws = N + 1}}.

now(#?MODULE{body = Body}) -> starl_sim_platform:now(Body).

local(#?MODULE{clock = Clock} = Robot) -> starl_sim_clock:local(now(Robot), Clock).

%% When its clock shows this time, which may be over.
due_us(LocalUs, #?MODULE{clock = Clock} = Robot) ->
    starl_sim_clock:due(now(Robot), max(0, LocalUs - local(Robot)), Clock).

%% -- faults ---------------------------------------------------------------------------------

strike(wake, #?MODULE{life = 0} = Robot) ->
    boot([], Robot);
strike(boot, #?MODULE{condition = down} = Robot) ->
    boot([], Robot);
%% Whichever machine the fault names, the application crashes.
strike({kill_machine, _Name}, #?MODULE{condition = up} = Robot) ->
    {[crash_app], Robot};
strike({pause, Until}, #?MODULE{hold = {Before, Lag}} = Robot) ->
    {[], Robot#?MODULE{hold = {max(Before, Until), Lag}}};
strike({lag, Lag}, #?MODULE{hold = {Until, _}} = Robot) ->
    {[], Robot#?MODULE{hold = {Until, Lag}}};
strike({program, Command}, Robot) ->
    {[Command], Robot};
strike({reload, Reload}, Robot) ->
    ordered(Reload, Robot);
strike({reload_failed, N, Failed}, #?MODULE{codes = Codes} = Robot) ->
    {[], notify({take_back, N, Failed}, Robot#?MODULE{codes = starl_reload:without(N, Codes)})};
strike(go_down, #?MODULE{condition = up} = Robot) ->
    {How, Drawn} = draw(3, Robot),
    fall(How, Drawn);
strike(come_up, Robot) ->
    {Commands, Down} = without_power(Robot),
    boot(Commands, Down);
strike(try_start, #?MODULE{condition = down} = Robot) ->
    {Cut, Drawn} = power_goes_soon(Robot),
    boot(Cut, Drawn);
strike(kill_robot, Robot) ->
    {Commands, #?MODULE{body = Body} = Down} = off(killed, Robot),
    Dead = Down#?MODULE{condition = dead, body = starl_sim_platform:ended(died, Body)},
    {Commands, fact(robot, {died, killed}, Dead)};
strike(Strike, Robot) when
    Strike =:= lose_store; element(1, Strike) =:= save_store; element(1, Strike) =:= set_back_store
->
    %% there is another disk in the robot, which has no power
    {Commands, Down} = without_power(Robot),
    {Commands ++ [Strike], Down};
strike(_Strike, _Robot) ->
    ignored.

%% The program is killed, the power goes, or it goes at one of the next operations of the disk.
fall(1, Robot) -> off(killed, Robot);
fall(2, Robot) -> without_power(Robot);
fall(3, Robot) -> power_goes_soon(Robot).

power_goes_soon(Robot) ->
    {N, Drawn} = draw(?OPERATIONS, Robot),
    {[{cut_after, N}], Drawn}.

without_power(Robot) -> off(power_cut, Robot).

off(Cause, #?MODULE{condition = up} = Robot) -> {[{halt, Cause}], is_down(Robot)};
off(_Cause, Robot) -> {[], Robot}.

%% A program takes a while to start: two lives do not begin in one millisecond.
boot(Commands, #?MODULE{booted_us = Last} = Robot) ->
    case now(Robot) of
        Now when is_integer(Last), Now < Last + ?AGAIN_US ->
            {Commands, plan_own(Last + ?AGAIN_US, ?CLASS_WORLD, boot, Robot)};
        Now ->
            #?MODULE{life = Before, world = #{seed := Seed}} = Robot,
            Boot = {boot, Before + 1, Seed, codes(Now, Robot)},
            Up = Robot#?MODULE{life = Before + 1, condition = up, booted_us = Now},
            {Commands ++ [Boot], Up}
    end.

%% -- its code -------------------------------------------------------------------------------

%% A robot that starts before its machine has passed its trial is on trial from its start on.
codes(Now, #?MODULE{codes = Codes, taken = Taken, world = #{reloads := Reloads}}) ->
    Passed = [
        N
     || {{_Name, N}, At} <- lists:sort(maps:to_list(Taken)),
        Now > At + maps:get(trial_us, maps:get(order, maps:get(N, Reloads)))
    ],
    lists:foldl(fun starl_reload:passed/2, Codes, lists:sort(Passed));
codes(_Now, _Robot) ->
    #{}.

%% The operator gives the robot the code of a reload, of the scenario or as data.
ordered(#{order := #{number := N} = Order} = Reload, #?MODULE{world = World} = Robot) ->
    #{parts := Parts} = World,
    {_Words, Codes} = starl_reload:take(Order, Parts, Robot#?MODULE.codes),
    Reloads = maps:put(N, Reload, maps:get(reloads, World, #{})),
    Known = Robot#?MODULE{world = World#{reloads => Reloads}, codes = Codes},
    {[], notify({reload, Order, Robot#?MODULE.computer}, Known)};
ordered(N, #?MODULE{world = #{reloads := Reloads}} = Robot) ->
    ordered(maps:get(N, Reloads), Robot).

%% The operator notifies a robot that is up; one that is down starts with what it is to run.
notify(Word, #?MODULE{condition = up} = Robot) ->
    message(now(Robot), link, {'$gen_cast', Word}, Robot);
notify(_Word, Robot) ->
    Robot.

reloaded(Name, #{number := N, outcome := taken}, #?MODULE{taken = Taken} = Robot) ->
    Robot#?MODULE{taken = Taken#{{Name, N} => now(Robot)}};
reloaded(_Name, #{outcome := done}, Robot) ->
    Robot;
reloaded(_Name, #{number := N, outcome := Outcome}, #?MODULE{codes = Codes} = Robot) ->
    Back = Robot#?MODULE{codes = starl_reload:without(N, Codes)},
    case starl_reload:is_failure(Outcome) of
        true -> failed(N, Back);
        false -> Back
    end.

%% The operator has all robots of the reload go back.
failed(N, #?MODULE{id = Id, world = World, body = Body} = Robot) ->
    News = starl_sim_codes:news(N, Id, now(Robot), World),
    Robot#?MODULE{body = starl_sim_platform:tell_all(News, Body)}.
