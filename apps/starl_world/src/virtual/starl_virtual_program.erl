%% @doc The program of one live robot in virtual time, on its computer
%% ({@link starl_virtual_computer}). The link and the transport are the same modules as on a real
%% robot. Their callbacks are called here, one at a time, and their effects on the world are returned.
%%
%% The robot's clock, disk and socket are simulated ({@link starl_virtual_clock},
%% {@link starl_virtual_disk}, {@link starl_virtual_socket}). Its machines run inline. A sequential
%% application is a process: the computer waits until that process has carried out its order,
%% and the shard decides when the link gets the answer.
-module(starl_virtual_program).
-behaviour(starl_virtual_computer).
-behaviour(supervisor).

-export([new/3, obey/2, machines/2]).
-export([init/1]).

-export_type([config/0, command/0]).

%% The specification of the robot's link ({@link starl_live_link:spec()}) without what is given here,
%% that of its transport, and the seed of its disk.
-type config() :: #{seed := integer(), spec := map(), udp := map()}.

%% Further commands: crash the application; apply a fault to the disk.
-type command() ::
    starl_virtual_computer:command()
    | crash_app
    | {suffer, starl_virtual_disk:trouble()}
    | {cut_after, Operations :: pos_integer()}
    | lose_store
    | {save_store | set_back_store, Image :: atom()}.

-define(EPOCH_US, 1700000000000000).

-record(robot, {
    id :: starl:robot_id(),
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

-type done() :: {starl_virtual_computer:up(), [starl_virtual_computer:effect()], #robot{}}.

%% @doc The program on a computer whose disk is commissioned.
-spec new(starl:robot_id(), starl_virtual_clock:t(), config()) -> #robot{}.
new(Id, Clock, #{seed := Seed, spec := #{dir := {starl_virtual_disk, Path} = Dir}} = Config) ->
    Disk = starl_virtual_disk:name_of(Path),
    ok = starl_virtual_disk:new(Disk, {Seed, Id, disk}),
    ok = starl_live_store:commission(Dir),
    #robot{id = Id, config = Config, clock = Clock, disk = Disk}.

%% @doc The machines of the robot, each with its state and data.
-spec machines(gen_server:from(), #robot{}) -> #{starl_machine:name() => starl_robot_tree:seen()}.
machines(_From, #robot{link = none}) ->
    #{};
machines(From, #robot{link = Link}) ->
    {reply, #{} = Seen, _} = starl_live_link:handle_call(inspect, From, Link),
    Seen.

%% @doc Carries out a command. A program that ends by itself is off afterwards.
-spec obey(command(), #robot{}) -> done().
obey(Command, Robot) ->
    case carry_out(Command, Robot) of
        {{down, Why}, Effects, Ended} -> {{down, Why}, Effects, halted(cause(Why), Ended)};
        Done -> Done
    end.

cause({starl_power_cut, _}) -> power_cut;
cause(_Why) -> killed.

carry_out({boot, Life, Seed, Codes}, Robot) ->
    boot(Life, Seed, Codes, Robot);
carry_out({hear, Actor, Message}, Robot) ->
    run([{Actor, Message}], Robot);
carry_out({heard, From, Bytes}, #robot{id = Id} = Robot) ->
    run([{transport, starl_virtual_socket:heard(From, Id, Bytes)}], Robot);
carry_out(crash_app, Robot) ->
    crash_app(Robot);
carry_out({halt, Cause}, Robot) ->
    {off, [], halted(Cause, Robot)};
carry_out(OnDisk, #robot{disk = Disk, link = none} = Robot) ->
    {off, on_disk(OnDisk, Disk), Robot};
carry_out(OnDisk, #robot{disk = Disk} = Robot) ->
    {up, on_disk(OnDisk, Disk), Robot}.

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
            ok = starl_virtual_computer:end_with(Message),
            forget()
    after 0 -> ok
    end.

%% The supervisor of the link stands above the machines' processes, as on a robot.
-spec init([]) -> {ok, {supervisor:sup_flags(), []}}.
init([]) -> {ok, {#{}, []}}.

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
    ok = starl_virtual_computer:end_with(Exit),
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
    Shard = starl_virtual_computer:shard(),
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
