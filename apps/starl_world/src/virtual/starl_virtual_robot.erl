%% @doc The program of one live robot in virtual time. Its link and its transport are the same
%% modules as on a real robot. The process that runs the simulation calls their callbacks, one at a
%% time. Their effects on the world are returned as {@link effect()}s.
%%
%% The robot's clock, disk and socket are simulated ({@link starl_virtual_clock},
%% {@link starl_virtual_disk}, {@link starl_virtual_socket}). Its machines run inline. A sequential
%% application is a process: the simulation waits here until that process has carried out its order,
%% and decides when the link gets the answer.
-module(starl_virtual_robot).
-behaviour(supervisor).

-export([boot/2, hear/3, kill_app/1, halt/1, is_up/1]).
-export([init/1]).

-export_type([t/0, actor/0, effect/0, config/0]).

%% The parts of the program that get messages.
-type actor() :: link | transport.

%% What the program does: it wants to have a message at a time of its computer; a datagram leaves; a
%% process of its has an answer for the link; facts; it asks the positioning system; its machines have
%% started; its application has ended.
-type effect() ::
    {timer, actor(), DueUs :: integer(), Message :: term()}
    | {sent, starl:robot_id(), binary()}
    | {answer, Message :: term()}
    | {facts, [starl_monitor:trace_event()]}
    | {asked, Tag :: term(), [starl:robot_id()]}
    | {started, [starl_machine:name()]}
    | {ended, given_up | {done, term()}}
    | {reloaded, starl_machine:name(), starl_reload:told()}.

%% The specification of the robot ({@link starl_live_link:spec()}) without what is given here, and
%% that of its transport.
-type config() :: #{radio := starl_live_link:adapter(), atom() => term()}.

-record(robot, {
    sup :: pid(),
    link :: term() | none,
    transport :: term(),
    %% the processes whose answers are on their way
    answering = [] :: [pid()]
}).

-opaque t() :: #robot{}.

%% -- its life -------------------------------------------------------------------------------

%% @doc Starts the program; `down': it ends at once, for this reason.
-spec boot(config(), starl_live_clock:t()) -> {up | {down, term()}, [effect()], t()}.
boot(#{radio := {Module, Own}, robot := Id, tree := Tree} = Config, Clock) ->
    {ok, Sup} = supervisor:start_link(?MODULE, []),
    Team = maps:get(participants, Tree),
    Radio = Own#{robot => Id, participants => Team, clock => Clock},
    {ok, Transport} = starl_live_transport:init({Module, Radio, self()}),
    {[], Opened} = drained(transport),
    Spec = (maps:remove(radio, Config))#{
        robot_sup => Sup,
        clock => Clock,
        transport => self(),
        positioning => self(),
        chassis => self(),
        sink => self(),
        reporter => self(),
        inline => true,
        tell => at_once
    },
    Robot = #robot{sup = Sup, link = none, transport = Transport},
    {Up, Effects, Booted} = run([{link, {boot, Spec}}], Robot),
    {Up, Opened ++ Effects, Booted}.

%% @doc A part of the program gets a message.
-spec hear(actor(), Message :: term(), t()) -> {up | {down, term()}, [effect()], t()}.
hear(Actor, Message, Robot) -> run([{Actor, Message}], Robot).

%% @doc The process of the application crashes, if it has not ended yet: then its end is on its way.
-spec kill_app(t()) -> {up | {down, term()}, [effect()], t()}.
kill_app(#robot{link = Link} = Robot) ->
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

%% @doc The program ends, by no will of its own.
-spec halt(t()) -> t().
halt(#robot{sup = Sup} = Robot) ->
    true = unlink(Sup),
    ok = starl_sim_stop:shutdown(Sup, infinity),
    ok = forget(),
    Robot#robot{link = none, answering = []}.

forget() ->
    receive
        _ -> forget()
    after 0 -> ok
    end.

%% @doc Does the program run?
-spec is_up(t()) -> boolean().
is_up(#robot{link = Link}) -> Link =/= none.

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
            Last = [M || {transport, _} = M <- Messages ++ Inner],
            {up, More, Next} = run(Last, Robot#robot{link = none}, []),
            {{down, Why}, lists:reverse(Before, Effects ++ More), Next}
    end.

part(link, {boot, Spec}, Robot) -> booted(Spec, Robot);
part(link, _Message, #robot{link = none} = Robot) -> {up, Robot};
part(link, Message, Robot) -> linked(Message, without(Message, Robot));
part(transport, Message, Robot) -> transported(Message, Robot).

booted(Spec, Robot) ->
    guarded(fun() ->
        case starl_live_link:init(Spec) of
            {ok, Opened, {continue, launch}} ->
                changed(starl_live_link:handle_continue(launch, Opened), Robot);
            {stop, Why} ->
                {down, Why}
        end
    end).

linked({'$gen_cast', Request}, #robot{link = Link} = Robot) ->
    guarded(fun() -> changed(starl_live_link:handle_cast(Request, Link), Robot) end);
linked(Message, #robot{link = Link} = Robot) ->
    guarded(fun() -> changed(starl_live_link:handle_info(Message, Link), Robot) end).

changed({noreply, Link}, Robot) -> {up, Robot#robot{link = Link}};
changed({stop, Why, _Link}, _Robot) -> {down, Why}.

%% The power goes while the link uses the disk; the link itself ends.
guarded(Step) ->
    try
        Step()
    catch
        throw:{starl_power_cut, _} = Cut -> {down, Cut};
        exit:{shutdown, _} = Why -> {down, Why}
    end.

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
sent({'EXIT', _, _}, _) ->
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
    Monitor = erlang:monitor(process, Pid),
    receive
        {starl_done, _, Pid, _} = Done ->
            true = erlang:demonitor(Monitor, [flush]),
            Done;
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
