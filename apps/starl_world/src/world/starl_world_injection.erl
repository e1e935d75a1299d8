%% @doc Injects the faults of a run in real time. It keeps the schedule, reports each fault to the
%% world, and keeps the faults that last ({@link starl_world_faults}). The process that runs the
%% robots owns it and carries out the effects that it returns: {@link starl_world_robots} in this
%% VM, {@link starl_cluster_faults} on nodes. The owner gets these messages when they are due:
%% ```
%%     {begins, Fault}    the time of a fault of the schedule --> begins/2
%%     {over, Id}         the time of a fault is over         --> over/2
%% '''
-module(starl_world_injection).

-export([new/2, planned/2, at/3, begins/2, not_played/2, hand/2, unnamed/2, over/2, up/2, fate/2]).
-export([check/2, air/2, senses/2, is_down/2, is_full/2, healable/2, real_ms/2, world/1]).

-export_type([t/0, run/0, effect/0]).

%% The world, the clock of the run, and its pace.
-type run() :: #{
    world := pid(), clock := starl_live_clock:t(), speed := number(), atom() => term()
}.

-record(injection, {
    robots :: [starl:robot_id()],
    world :: pid(),
    clock :: starl_live_clock:t(),
    speed :: number(),
    faults :: starl_world_faults:t()
}).

-opaque t() :: #injection{}.

%% An effect of {@link starl_world_faults:effect()} that is left to who runs the robots.
-type effect() ::
    {kill | start | dead | fill | clear, starl:robot_id()}
    | {halt, starl:robot_id(), Ms :: non_neg_integer(), now | at_work, Id :: atom()}
    | {machine, starl:robot_id(), starl_machine:name()}
    | {tell, [starl:robot_id()]}.

%% @doc No fault has begun.
-spec new([starl:robot_id()], run()) -> t().
new(Robots, #{world := World, clock := Clock, speed := Speed}) ->
    #injection{
        robots = Robots,
        world = World,
        clock = Clock,
        speed = Speed,
        faults = starl_world_faults:new(Robots)
    }.

%% @doc The faults of a schedule that begin before any robot does. The others come as messages, in their time.
-spec planned([starl_run_fault:t()], t()) -> AtOnce :: [starl_run_fault:t()].
planned(Schedule, Injection) ->
    {AtOnce, InTime} = starl_world_faults:from_the_start(Schedule),
    ok = lists:foreach(fun(Fault) -> at(element(2, Fault), {begins, Fault}, Injection) end, InTime),
    AtOnce.

%% @doc This process gets a message at this time of the run.
-spec at(Ms :: integer(), Message :: term(), t()) -> ok.
at(Ms, Message, #injection{clock = Clock}) ->
    At = starl_live_clock:monotonic_ms(1000 * Ms, Clock),
    _ = erlang:send_after(At, self(), Message, [{abs, true}]),
    ok.

now_ms(#injection{clock = Clock}) -> starl_live_clock:now_us(Clock) div 1000.

%% @doc Begins a fault now: the world is notified, and may refuse it.
-spec begins(starl_run_fault:t(), t()) -> {ok, [effect()], t()} | {error, unicode:chardata()}.
begins(Fault, #injection{faults = Faults} = Injection) ->
    {Told, Effects, Next} = starl_world_faults:begins(Fault, now_ms(Injection), Faults),
    case told(Told, Injection) of
        ok -> {ok, left(Effects, Injection), Injection#injection{faults = Next}};
        {error, _} = Error -> Error
    end.

told([], _Play) ->
    ok;
told([Told | More], #injection{world = World} = Injection) ->
    case starl_world:fault(World, Told) of
        ok -> told(More, Injection);
        {error, _} = Error -> Error
    end.

%% The end of a fault is a message to this process; the rest is for others to do.
left(Effects, Injection) ->
    ok = lists:foreach(fun({due, Ms, Id}) -> at(Ms, {over, Id}, Injection) end, [
        Due
     || {due, _, _} = Due <- Effects
    ]),
    [Effect || Effect <- Effects, element(1, Effect) =/= due].

%% @doc A fault of the schedule cannot begin: a line of the log says so.
-spec not_played(starl_run_fault:t(), Why :: unicode:chardata()) -> ok.
not_played(Fault, Why) ->
    Line = unicode:characters_to_binary(Why),
    logger:warning(#{what => fault_not_played, fault => Fault, why => Line}).

%% @doc Checks that all robots of these manual faults exist.
-spec check([starl_run_hand:t()], t()) -> ok | {error, unicode:chardata()}.
check(Hands, #injection{robots = Robots}) ->
    Named = lists:usort(lists:append([starl_run_hand:robots(Hand) || Hand <- Hands])),
    case Named -- Robots of
        [] -> ok;
        [Robot | _] -> {error, io_lib:format("there is no robot ~b", [Robot])}
    end.

%% @doc The fault for a manual fault that is applied now.
-spec hand(starl_run_hand:t(), t()) -> {starl_run_fault:t(), t()}.
hand(Hand, #injection{speed = Speed, faults = Faults} = Injection) ->
    {Fault, Named} = starl_world_faults:named(Hand, now_ms(Injection), Speed, Faults),
    {Fault, Injection#injection{faults = Named}}.

%% @doc A name for a fault that has none.
-spec unnamed(Prefix :: string(), t()) -> {atom(), t()}.
unnamed(Prefix, #injection{faults = Faults} = Injection) ->
    {Id, Named} = starl_world_faults:unnamed(Prefix, Faults),
    {Id, Injection#injection{faults = Named}}.

%% @doc The time of a fault is over, or it is healed.
-spec over(Id :: atom(), t()) -> {[effect()], t()}.
over(Id, #injection{faults = Faults} = Injection) ->
    {Told, Effects, Next} = starl_world_faults:over(Id, now_ms(Injection), Faults),
    _ = told(Told, Injection),
    {left(Effects, Injection), Injection#injection{faults = Next}}.

%% @doc A robot is up: what had sent it down has ended.
-spec up(starl:robot_id(), t()) -> t().
up(Robot, #injection{faults = Faults} = Injection) ->
    {Told, Up} = starl_world_faults:up(Robot, now_ms(Injection), Faults),
    ok = told(Told, Injection),
    Injection#injection{faults = Up}.

%% @doc What becomes of the store of a robot that starts now.
-spec fate(starl:robot_id(), t()) -> {starl_world_faults:fate(), t()}.
fate(Robot, #injection{faults = Faults} = Injection) ->
    {Fate, Fated} = starl_world_faults:fate(Robot, Faults),
    {Fate, Injection#injection{faults = Fated}}.

%% @doc The link conditions of a robot.
-spec air(starl:robot_id(), t()) -> starl_live_conditions:settings().
air(Robot, #injection{speed = Speed, faults = Faults}) ->
    starl_world_faults:air(Robot, Speed, Faults).

%% @doc The faults of a robot's senses.
-spec senses(starl:robot_id(), t()) -> starl_live_sense_fault:faults().
senses(Robot, #injection{faults = Faults}) -> starl_world_faults:senses(Robot, Faults).

%% @doc Checks whether a robot must not start now.
-spec is_down(starl:robot_id(), t()) -> boolean().
is_down(Robot, #injection{faults = Faults} = Injection) ->
    starl_world_faults:is_down(Robot, now_ms(Injection), Faults).

%% @doc Is the disk of a robot full?
-spec is_full(starl:robot_id(), t()) -> boolean().
is_full(Robot, #injection{faults = Faults}) -> starl_world_faults:is_full(Robot, Faults).

%% @doc The names of the faults that can be healed.
-spec healable(starl_run_hand:heal(), t()) -> [atom()].
healable(What, #injection{faults = Faults}) -> starl_world_faults:healable(What, Faults).

%% @doc A time of the run by the computer's clock.
-spec real_ms(Ms :: number(), t()) -> float().
real_ms(Ms, #injection{speed = Speed}) -> Ms / Speed.

%% @doc The world of the run.
-spec world(t()) -> pid().
world(#injection{world = World}) -> World.
