%% A pure network of SAP machines, without processes: events in the order of time, and a function
%% that says what becomes of each packet.
-module(starl_platform_net).

-export([new/1, at/3, run/1, run/2, heal/2]).
-export([trace/1, now/1, replies/1, inbox/2, machine/2, air/1, judge/2, size/2]).

-record(net, {
    team :: [pos_integer()],
    config :: map(),
    %% fun(Packet, From, To, N-th on this link) -> delays in us of the copies that arrive
    fate :: fun(),
    now = 0 :: integer(),
    seq = 0 :: integer(),
    queue = gb_sets:new() :: gb_sets:set(),
    machines = #{} :: map(),
    incarnations = #{} :: map(),
    timers = #{} :: map(),
    links = #{} :: map(),
    trace = [] :: list(),
    replies = [] :: list(),
    inbox = [] :: list(),
    air = [] :: list()
}).

%% All robots start at time 0. `config': SAP's own; `fate': see above.
new(#{robots := Team} = Options) ->
    Config = maps:get(config, Options, #{}),
    Fate = maps:get(fate, Options, fun(_, _, _, _) -> [5000] end),
    Net = #net{team = Team, config = Config, fate = Fate},
    lists:foldl(fun start/2, Net, Team).

%% From now on this becomes of packets.
heal(Fate, Net) -> Net#net{fate = Fate}.

%% Plans an operation: `{call, Robot, Request, Tag}', `{cast, Robot, Content}', `{crash, Robot}',
%% `{fate, Fun}', `{packet, Robot, Packet}'.
at(Us, Op, #net{} = Net) -> add(Us, {op, Op}, Net).

%% Runs until nothing is left to happen, or until a time.
run(Net) -> run(infinity, Net).

run(Until, #net{queue = Queue} = Net) ->
    case gb_sets:is_empty(Queue) of
        true ->
            Net;
        false ->
            {{T, _, Event}, Rest} = gb_sets:take_smallest(Queue),
            case T =< Until of
                true -> run(Until, event(Event, Net#net{now = T, queue = Rest}));
                false -> Net
            end
    end.

trace(#net{trace = Trace}) -> lists:reverse(Trace).
now(#net{now = Now}) -> Now.
%% `{At, Robot, Tag, Answer}', oldest first.
replies(#net{replies = Replies}) -> lists:reverse(Replies).
%% The messages that the robot's listener got: `{From, Type, Body}', oldest first.
inbox(Robot, #net{inbox = Inbox}) -> [M || {R, M} <- lists:reverse(Inbox), R =:= Robot].
machine(Robot, #net{machines = Machines}) -> maps:get(Robot, Machines).
%% What was put on the air: `{At, From, Dest, Packet}', oldest first.
air(#net{air = Air}) -> lists:reverse(Air).
%% Words that the robot's SAP keeps.
size(Robot, Net) -> erts_debug:flat_size(starl_machine:data(machine(Robot, Net))).

%% The violations of the SAP contract in the trace.
judge(#net{now = Now, trace = Trace}, BoundUs) ->
    Monitor = starl_monitor:new([{starl_sap_monitor, #{bound_us => BoundUs}}]),
    {First, Fed} =
        case starl_monitor:step(lists:reverse(Trace), Monitor) of
            {ok, M} -> {[], M};
            {violation, V, M} -> {[V], M}
        end,
    {Late, _} = starl_monitor:finish(Now + BoundUs + 1, Fed),
    First ++ Late.

%% -- internals ------------------------------------------------------------------------------

start(Robot, #net{team = Team, config = Config, incarnations = Incarnations, now = Now} = Net) ->
    Incarnation = maps:get(Robot, Incarnations, 0) + 1,
    Base = #{
        robot => Robot,
        participants => Team,
        name => sap,
        incarnation => Incarnation,
        random => rand:seed_s(exsss, Robot),
        now => Now
    },
    {Actions, Machine} = starl_machine:new(starl_sap, Config, Base),
    Live = maps:filter(fun({R, _}, _) -> R =/= Robot end, Net#net.timers),
    Started = Net#net{
        machines = (Net#net.machines)#{Robot => Machine},
        incarnations = Incarnations#{Robot => Incarnation},
        timers = Live
    },
    perform(Robot, Actions, Started).

add(T, Event, #net{seq = Seq, queue = Queue} = Net) ->
    Net#net{seq = Seq + 1, queue = gb_sets:add_element({T, Seq, Event}, Queue)}.

event({op, {crash, Robot}}, Net) ->
    start(Robot, Net);
event({op, {fate, Fate}}, Net) ->
    Net#net{fate = Fate};
event({op, {call, Robot, Request, Tag}}, Net) ->
    step(Robot, {call, {app, Tag}}, Request, Net);
event({op, {cast, Robot, Content}}, Net) ->
    step(Robot, cast, Content, Net);
event({op, {packet, Robot, Packet}}, Net) ->
    step(Robot, packet, Packet, Net);
event({packet, Robot, Packet}, Net) ->
    step(Robot, packet, Packet, Net);
event({timer, Robot, Timer, Mark, Content}, #net{timers = Timers} = Net) ->
    Key = {Robot, Timer},
    case Timers of
        #{Key := Mark} ->
            step(Robot, {timeout, Timer}, Content, Net#net{timers = maps:remove(Key, Timers)});
        #{} ->
            Net
    end.

step(Robot, Type, Content, #net{machines = Machines, now = Now} = Net) ->
    Meta = #{now => Now, robot => Robot},
    {Actions, Next} = starl_machine:step(Type, Content, Meta, maps:get(Robot, Machines)),
    perform(Robot, Actions, Net#net{machines = Machines#{Robot := Next}}).

perform(Robot, Actions, Net) -> lists:foldl(fun(A, N) -> act(A, Robot, N) end, Net, Actions).

act({trace, Event}, Robot, #net{trace = Trace, now = Now} = Net) ->
    Net#net{trace = [{Now, Robot, sap, Event} | Trace]};
act({cast, app, {message, From, Type, Body}}, Robot, #net{inbox = Inbox} = Net) ->
    Net#net{inbox = [{Robot, {From, Type, Body}} | Inbox]};
act({reply, {app, Tag}, Answer}, Robot, #net{replies = Replies, now = Now} = Net) ->
    Net#net{replies = [{Now, Robot, Tag, Answer} | Replies]};
act({{timeout, Timer}, cancel}, Robot, #net{timers = Timers} = Net) ->
    Net#net{timers = maps:remove({Robot, Timer}, Timers)};
act({{timeout, Timer}, Us, Content}, Robot, #net{timers = Timers, seq = Mark, now = Now} = Net) ->
    Set = Net#net{timers = Timers#{{Robot, Timer} => Mark}},
    add(Now + Us, {timer, Robot, Timer, Mark, Content}, Set);
act({transmit, Dest, Packet}, Robot, #net{air = Air, now = Now, team = Team} = Net) ->
    Dests =
        case Dest of
            all -> lists:delete(Robot, Team);
            _ -> [Dest]
        end,
    Sent = Net#net{air = [{Now, Robot, Dest, Packet} | Air]},
    lists:foldl(fun(D, N) -> fly(Robot, D, Packet, N) end, Sent, Dests).

fly(From, To, Packet, #net{links = Links, fate = Fate, now = Now} = Net) ->
    N = maps:get({From, To}, Links, 0) + 1,
    lists:foldl(
        fun(Delay, Acc) -> add(Now + Delay, {packet, To, Packet}, Acc) end,
        Net#net{links = Links#{{From, To} => N}},
        Fate(Packet, From, To, N)
    ).
