%% @doc The program of one live robot in virtual time, and its computer: a process of its own beside
%% the shard that simulates the robot ({@link starl_virtual_robot}). The link and the transport are the
%% same modules as on a real robot. This process calls their callbacks, one at a time. Their effects on
%% the world are returned as {@link effect()}s.
%% ```
%%   shard                            program
%%     | starl_order, time, commands --->|
%%     |                                 | calls link and transport; waits for the application
%%     |<---- starl_done, {up(), effects}|
%% '''
%% The robot's clock, disk and socket are simulated ({@link starl_virtual_clock},
%% {@link starl_virtual_disk}, {@link starl_virtual_socket}). Its machines run inline. A sequential
%% application is a process: the program waits until that process has carried out its order,
%% and the shard decides when the link gets the answer.
%%
%% The process is linked to the shard: neither outlives the other.
-module(starl_virtual_program).
-behaviour(supervisor).

-export([start/2, order/3, inspect/1]).
-export([init/1]).

-export_type([config/0, actor/0, command/0, up/0, effect/0]).

%% The computer with the program of one robot. `spec' is that of its link
%% ({@link starl_live_link:spec()}) without what is given here, `udp' that of its transport.
-type config() :: #{
    robot := starl:robot_id(),
    seed := integer(),
    spec := map(),
    udp := map()
}.

%% The parts of the program that get messages.
-type actor() :: link | transport.

%% Boot the program of a life, whose random streams follow from a seed, with this code; give a part a
%% message, or the socket a datagram; crash the application; end the program, with power or without;
%% apply a fault to the disk.
-type command() ::
    {boot, Life :: pos_integer(), Seed :: integer(), starl_reload:codes()}
    | {hear, actor(), Message :: term()}
    | {heard, From :: starl:robot_id(), binary()}
    | crash_app
    | {halt, killed | power_cut}
    | {suffer, starl_virtual_disk:trouble()}
    | {cut_after, Operations :: pos_integer()}
    | lose_store
    | {save_store | set_back_store, Image :: atom()}.

%% Whether the program runs, is off, or has ended by itself after the last commands, maybe since one of its
%% parts has crashed.
-type up() :: up | off | {down, Why :: {crashed, actor(), Reason :: term()} | term()}.

%% What the program does: it wants to have a message at a time of its computer; a datagram leaves; a
%% process of its has an answer for the link; facts; it asks the positioning system; its machines have
%% started; its application has ended; a machine reports on a reload. An image of the disk was put in
%% its place.
-type effect() ::
    {timer, actor(), DueUs :: integer(), Message :: term()}
    | {sent, starl:robot_id(), binary()}
    | {answer, Message :: term()}
    | {facts, [starl_monitor:trace_event()]}
    | {asked, Tag :: term(), [starl:robot_id()]}
    | {started, [starl_machine:name()]}
    | {ended, given_up | {done, term()}}
    | {reloaded, starl_machine:name(), starl_reload:told()}
    | store_set_back.

-define(EPOCH_US, 1700000000000000).

-record(robot, {
    id :: starl:robot_id(),
    shard :: pid(),
    config :: config(),
    clock :: starl_virtual_clock:t(),
    disk :: starl_virtual_disk:name(),
    %% the program of this life; `none': it does not run
    sup = none :: pid() | none,
    link = none :: term() | none,
    transport = none :: term(),
    %% the processes whose answers are on their way
    answering = [] :: [pid()]
}).

%% @doc Starts the computer, linked to the calling shard. Its disk is commissioned; the program does
%% not run yet.
-spec start(starl:robot_id(), config()) -> pid().
start(Id, Config) ->
    Shard = self(),
    spawn_link(fun() -> begun(Id, Shard, Config) end).

%% @doc Gives the program commands at a time of its computer. The shard gets `{starl_done, Robot,
%% Program, {up(), [effect()]}}'.
-spec order(pid(), LocalUs :: integer(), [command(), ...]) -> ok.
order(Program, LocalUs, Commands) ->
    Program ! {starl_order, LocalUs, Commands},
    ok.

%% @doc The machines of the robot, each with its state and data, while it has no order.
-spec inspect(pid()) -> #{starl_machine:name() => starl_robot_tree:seen()}.
inspect(Program) ->
    Ref = erlang:monitor(process, Program),
    Program ! {starl_inspect, self(), Ref},
    receive
        {Ref, Seen} ->
            true = erlang:demonitor(Ref, [flush]),
            Seen
    end.

%% The supervisor of the link stands above the machines' processes, as on a robot.
-spec init([]) -> {ok, {supervisor:sup_flags(), []}}.
init([]) -> {ok, {#{}, []}}.

%% -- its computer ---------------------------------------------------------------------------

begun(Id, Shard, #{seed := Seed, spec := #{dir := {starl_virtual_disk, Path} = Dir}} = Config) ->
    _ = process_flag(trap_exit, true),
    _ = put(?MODULE, Shard),
    Disk = starl_virtual_disk:name_of(Path),
    ok = starl_virtual_disk:new(Disk, {Seed, Id, disk}),
    ok = starl_live_store:commission(Dir),
    wait(#robot{
        id = Id, shard = Shard, config = Config, clock = starl_virtual_clock:new(0), disk = Disk
    }).

wait(#robot{id = Id, shard = Shard, clock = Clock} = Robot) ->
    receive
        {starl_order, LocalUs, Commands} ->
            ok = starl_virtual_clock:set(LocalUs, Clock),
            {Up, Effects, Next} = obey(Commands, off(Robot), [], Robot),
            Shard ! {starl_done, Id, self(), {Up, Effects}},
            wait(Next);
        {starl_inspect, From, Ref} ->
            From ! {Ref, inspected(Robot)},
            wait(Robot);
        {'EXIT', Shard, Why} ->
            exit(Why)
    end.

off(#robot{link = none}) -> off;
off(#robot{}) -> up.

inspected(#robot{link = none}) ->
    #{};
inspected(#robot{link = Link} = Robot) ->
    {reply, Seen, _} = starl_live_link:handle_call(inspect, {self(), Robot#robot.id}, Link),
    Seen.

obey([], Up, Effects, Robot) ->
    {Up, Effects, Robot};
obey([Command | Commands], _Up, Before, Robot) ->
    case obey(Command, Robot) of
        {{down, Why}, Effects, Ended} ->
            obey(Commands, {down, Why}, Before ++ Effects, halted(cause(Why), Ended));
        {Up, Effects, Next} ->
            obey(Commands, Up, Before ++ Effects, Next)
    end.

cause({starl_power_cut, _}) -> power_cut;
cause(_Why) -> killed.

obey({boot, Life, Seed, Codes}, Robot) ->
    boot(Life, Seed, Codes, Robot);
obey({hear, Actor, Message}, Robot) ->
    run([{Actor, Message}], Robot);
obey({heard, From, Bytes}, #robot{id = Id} = Robot) ->
    run([{transport, starl_virtual_socket:heard(From, Id, Bytes)}], Robot);
obey(crash_app, Robot) ->
    crash_app(Robot);
obey({halt, Cause}, Robot) ->
    {off, [], halted(Cause, Robot)};
obey(OnDisk, #robot{disk = Disk} = Robot) ->
    {off(Robot), on_disk(OnDisk, Disk), Robot}.

on_disk({suffer, Trouble}, Disk) ->
    ok = starl_virtual_disk:suffer(Disk, Trouble),
    [];
on_disk({cut_after, N}, Disk) ->
    ok = starl_virtual_disk:cut_after(Disk, N, between),
    [];
on_disk(lose_store, Disk) ->
    ok = starl_virtual_disk:erase(Disk),
    [];
on_disk({save_store, Image}, Disk) ->
    ok = starl_virtual_disk:save(Image, Disk),
    [];
on_disk({set_back_store, Image}, Disk) ->
    [store_set_back || starl_virtual_disk:set_back(Image, Disk) =:= ok].

%% -- its life -------------------------------------------------------------------------------

boot(Life, Seed, Codes, #robot{id = Id, config = Config, clock = Clock} = Robot) ->
    #{spec := #{tree := Tree} = Spec, udp := Udp} = Config,
    {ok, Sup} = supervisor:start_link(?MODULE, []),
    Shown = starl_live_clock:on({starl_virtual_clock, Clock}, starl_live_clock:new(?EPOCH_US, 1)),
    Random = fun(Stream) ->
        rand:seed_s(exsss, erlang:phash2({Seed, Id, Life, Stream}, 4294967296))
    end,
    Own = Udp#{
        robot => Id,
        participants => maps:get(participants, Tree),
        clock => Shown,
        random => fun() -> Random(radio) end
    },
    {ok, Transport} = starl_live_transport:init({starl_live_udp, Own, self()}),
    {[], Opened} = drained(transport),
    Given = Spec#{
        robot_sup => Sup,
        clock => Shown,
        codes => Codes,
        random => fun(Name, Incarnation) -> Random({Name, Incarnation}) end,
        transport => self(),
        positioning => self(),
        chassis => self(),
        sink => self(),
        reporter => self(),
        inline => true,
        tell => at_once
    },
    {Up, Effects, Booted} = run([{link, {boot, Given}}], Robot#robot{
        sup = Sup, transport = Transport
    }),
    {Up, Opened ++ Effects, Booted}.

%% The application crashes, if it has not ended yet: then its end is on its way.
crash_app(#robot{link = Link} = Robot) ->
    case [Pid || Pid <- starl_live_link:processes(Link), is_process_alive(Pid)] of
        [Pid | _] ->
            true = exit(Pid, kill),
            run([{link, gone(Pid)}], Robot);
        [] ->
            {up, [], Robot}
    end.

gone(Pid) ->
    receive
        {'DOWN', _, process, Pid, _} = Down -> Down
    end.

%% The program has ended, or ends by no will of its own.
halted(Cause, #robot{sup = Sup, disk = Disk} = Robot) ->
    true = unlink(Sup),
    ok = starl_sim_stop:shutdown(Sup, infinity),
    ok = forget(),
    ok = power(Cause, Disk),
    Robot#robot{sup = none, link = none, transport = none, answering = []}.

power(power_cut, Disk) -> starl_virtual_disk:cut_power(Disk);
power(killed, Disk) -> starl_virtual_disk:keep_power(Disk).

forget() ->
    receive
        Message ->
            ok = ends(Message),
            forget()
    after 0 -> ok
    end.

%% It ends with its shard.
ends({'EXIT', From, Why}) ->
    case get(?MODULE) of
        From -> exit(Why);
        _ -> ok
    end;
ends(_Message) ->
    ok.

%% -- its parts ------------------------------------------------------------------------------

run(Messages, Robot) -> run(Messages, Robot, []).

%% The messages of its parts to each other are handled at once, in their order.
run([], Robot, Effects) ->
    {Answers, Next} = answers(Robot),
    {up, lists:reverse(Effects, Answers), Next};
run([{Actor, Message} | Messages], Robot, Before) ->
    case part(Actor, Message, Robot) of
        {up, Next} ->
            {Inner, Effects} = drained(Actor),
            run(Messages ++ Inner, Next, lists:reverse(Effects, Before));
        {down, Why} ->
            {Inner, Effects} = drained(Actor),
            Last = [M || {transport, _} = M <- Messages ++ Inner, Actor =:= link],
            {_, More, Next} = run(Last, Robot#robot{link = none}, []),
            {{down, Why}, lists:reverse(Before, Effects ++ More), Next}
    end.

part(link, {boot, Spec}, Robot) ->
    guarded(link, fun() -> booted(Spec, Robot) end);
part(link, _Message, #robot{link = none} = Robot) ->
    {up, Robot};
part(link, Message, Robot) ->
    guarded(link, fun() -> linked(Message, without(Message, Robot)) end);
part(transport, Message, Robot) ->
    guarded(transport, fun() -> transported(Message, Robot) end).

%% The power goes while the link uses the disk; the link itself ends; or the part crashes.
guarded(Actor, Step) ->
    try
        Step()
    catch
        throw:{starl_power_cut, _} = Cut -> {down, Cut};
        exit:{shutdown, _} = Why -> {down, Why};
        error:Why:Stack -> {down, {crashed, Actor, {Why, Stack}}}
    end.

booted(Spec, Robot) ->
    case starl_live_link:init(Spec) of
        {ok, Opened, {continue, launch}} ->
            changed(starl_live_link:handle_continue(launch, Opened), Robot);
        {stop, Why} ->
            {down, Why}
    end.

linked({'$gen_cast', Request}, #robot{link = Link} = Robot) ->
    changed(starl_live_link:handle_cast(Request, Link), Robot);
linked(Message, #robot{link = Link} = Robot) ->
    changed(starl_live_link:handle_info(Message, Link), Robot).

changed({noreply, Link}, Robot) -> {up, Robot#robot{link = Link}};
changed({stop, Why, _Link}, _Robot) -> {down, Why}.

transported({'$gen_cast', Request}, #robot{transport = Transport} = Robot) ->
    {noreply, Next} = starl_live_transport:handle_cast(Request, Transport),
    {up, Robot#robot{transport = Next}};
transported(Message, #robot{transport = Transport} = Robot) ->
    {noreply, Next} = starl_live_transport:handle_info(Message, Transport),
    {up, Robot#robot{transport = Next}}.

%% Everything that the part has sent: messages for the other parts, and effects.
drained(Actor) -> lists:foldr(fun sorted/2, {[], []}, drain(Actor)).

sorted({effect, Effect}, {Inner, Effects}) -> {Inner, [Effect | Effects]};
sorted({inner, Message}, {Inner, Effects}) -> {[Message | Inner], Effects};
sorted(none, Sorted) -> Sorted.

%% What processes say waits until somebody waits for them: it may come sooner or later, and while another
%% robot of the simulation has its turn.
drain(Actor) ->
    receive
        Message when
            element(1, Message) =/= starl_done,
            element(1, Message) =/= starl_attach,
            element(1, Message) =/= 'DOWN'
        ->
            [sent(Message, Actor) | drain(Actor)]
    after 0 -> []
    end.

sent({starl_virtual_timer, Due, Message}, Actor) ->
    {effect, {timer, Actor, Due, Message}};
sent({starl_virtual_sent, To, Bytes}, _) ->
    {effect, {sent, To, Bytes}};
sent({starl_traced, _, _, {_, _, Events}}, _) ->
    {effect, {facts, Events}};
sent({starl_started, _, _, {Names, _}}, _) ->
    {effect, {started, Names}};
sent({starl_ended, _, _, Result}, _) ->
    {effect, {ended, Result}};
sent({starl_reloaded, _, Name, Told}, _) ->
    {effect, {reloaded, Name, Told}};
sent({'$gen_cast', Cast}, link) ->
    cast(Cast);
%% a supervisor's or a process's end that has been handled
sent({'EXIT', _, _} = Exit, _) ->
    ok = ends(Exit),
    none;
sent(Message, _) ->
    {inner, {link, Message}}.

%% What the link tells its lines. The chassis stands, and feels nothing.
cast({ask, Tag, Robots}) -> {effect, {asked, Tag, Robots}};
cast({feel, _Kind, Mark}) -> {inner, {link, {starl_felt, self(), Mark, unknown}}};
cast(Cast) when element(1, Cast) =:= transmit -> {inner, {transport, {'$gen_cast', Cast}}};
cast(_Cast) -> none.

%% -- its processes --------------------------------------------------------------------------

%% Waits for the processes that have got an order.
answers(#robot{link = none} = Robot) ->
    {[], Robot};
answers(#robot{link = Link, answering = Known} = Robot) ->
    New = starl_live_link:at_work(Link) -- Known,
    {[{answer, answer(Pid)} || Pid <- New], Robot#robot{answering = New ++ Known}}.

%% Its answer or its end. An end that the link knows already comes once more.
answer(Pid) ->
    Shard = get(?MODULE),
    Monitor = erlang:monitor(process, Pid),
    receive
        {starl_done, _, Pid, _} = Done ->
            true = erlang:demonitor(Monitor, [flush]),
            Done;
        {'EXIT', Shard, Why} ->
            exit(Why);
        {'DOWN', Monitor, process, Pid, _} = Down ->
            receive
                {'DOWN', _, process, Pid, _} = First -> First
            after 0 -> Down
            end
    end.

without({starl_done, _, Pid, _}, Robot) -> forgotten(Pid, Robot);
without({'DOWN', _, process, Pid, _}, Robot) -> forgotten(Pid, Robot);
without(_Message, Robot) -> Robot.

forgotten(Pid, #robot{answering = Answering} = Robot) ->
    Robot#robot{answering = lists:delete(Pid, Answering)}.
