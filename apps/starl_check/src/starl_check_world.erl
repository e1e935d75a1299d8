%% @doc The world of a checked robot while it handles one event. Its clock stands still, its timers
%% fire when the checker chooses, and its store is never full. It collects the robot's messages and
%% traced events.
-module(starl_check_world).
-behaviour(starl_driver).
-behaviour(starl_platform).

-export([new/3, sent/1, put_under_way/2, traces/1, stored/1]).
-export([
    handles/4, clock/1, present/1, base/3, trace/3, plan/5, store/3, ended/2, perform/3, stop/1
]).

-export_type([t/0, sent/0, due/0]).

%% A message that the robot sends.
-type sent() ::
    {message, starl:robot_id(), Type :: atom(), Body :: term(), starl_check_sap:ref() | none}
    | {packet, starl:robot_id(), starl_packet:t()}.

%% The time at which a timer may fire: any time, or after this number of ticks.
-type due() :: any | non_neg_integer().

-record(world, {
    place :: starl_check_term:place(),
    model :: starl_check_model:t(),
    stored :: #{starl_machine:name() => term()},
    %% newest first
    sent = [] :: [sent()],
    traces = [] :: [starl_monitor:trace_event()]
}).

-opaque t() :: #world{}.

%% @doc The world of the robot at a place, with the terms stored by its machines.
-spec new(starl_check_term:place(), #{starl_machine:name() => term()}, starl_check_model:t()) ->
    t().
new(Place, Stored, Model) -> #world{place = Place, stored = Stored, model = Model}.

%% @doc The messages that the robot has sent, in order.
-spec sent(t()) -> [sent()].
sent(#world{sent = Sent}) -> lists:reverse(Sent).

%% @doc Adds sent messages.
-spec put_under_way([sent()], t()) -> t().
put_under_way(New, #world{sent = Sent} = World) -> World#world{sent = lists:reverse(New, Sent)}.

%% @doc The events that the robot has traced, in order.
-spec traces(t()) -> [starl_monitor:trace_event()].
traces(#world{traces = Traces}) -> lists:reverse(Traces).

%% @doc The terms stored by its machines.
-spec stored(t()) -> #{starl_machine:name() => term()}.
stored(#world{stored = Stored}) -> Stored.

%% @doc Ignores the event: the checker keeps no digest.
-spec handles(starl_machine:name(), starl_machine:event_type() | boot, term(), t()) -> t().
handles(_Name, _Type, _Content, World) -> World.

%% @doc The reading of the robot's clock, which stands still ({@link starl_check_term}).
-spec clock(t()) -> integer().
clock(#world{place = Place}) -> starl_check_term:now(Place).

%% @doc The same.
-spec present(t()) -> integer().
present(World) -> clock(World).

%% @doc The base configuration of a machine at its start.
-spec base(starl_machine:name(), Incarnation :: pos_integer(), t()) -> starl_machine:config().
base(Name, Incarnation, #world{place = Place, model = Model, stored = Stored}) ->
    #{ids := Ids, waits := Waits} = Model,
    #{
        robot => starl_check_model:id(Place, Model),
        participants => Ids,
        name => Name,
        incarnation => Incarnation,
        stored => kept(Name, Stored),
        random => rand:seed_s(exsss, erlang:phash2({Place, Name, Incarnation})),
        team_seed => 1,
        now => started(Place, lists:member(Place, Waits))
    }.

kept(Name, Stored) ->
    case Stored of
        #{Name := Term} -> {stored, Term};
        #{} -> none
    end.

started(Place, true) -> starl_check_term:now(Place);
started(Place, false) -> starl_check_term:long_ago(Place).

%% @doc Records a traced event.
-spec trace(starl_machine:name(), term(), t()) -> t().
trace(Name, Event, #world{place = Place, model = Model, traces = Traces} = World) ->
    World#world{traces = [{0, starl_check_model:id(Place, Model), Name, Event} | Traces]}.

%% @doc Marks a timer with its content and its deadline, rounded up to ticks, because a timer never
%% fires early.
-spec plan(starl_machine:name(), starl_robot_timers:timer(), non_neg_integer(), term(), t()) ->
    {{due(), Content :: term()}, t()}.
plan(Name, Timer, Us, Content, #world{place = Place, model = Model} = World) ->
    case starl_check_model:timer({Name, Timer}, Model) of
        timed ->
            Rate = element(Place, maps:get(rates, Model)),
            {{(Us + Rate - 1) div Rate, Content}, World};
        _ ->
            {{any, Content}, World}
    end.

%% @doc Stores a term; all past times in it become equal.
-spec store(starl_machine:name(), term(), t()) -> {ok, t()}.
store(Name, Term, #world{stored = Stored, model = #{rates := Rates, past_us := Past}} = World) ->
    {ok, World#world{stored = Stored#{Name => starl_check_term:shift(Term, 0, Rates, Past)}}}.

%% @doc Does nothing: the end of the application shows in the application's state.
-spec ended(starl_robot:ended(), t()) -> t().
ended(_How, World) -> World.

%% @doc Performs an action in the world; a checked robot only sends. Over SAP's contract a datagram
%% is a message without an outcome.
-spec perform(starl_platform:world_action(), starl_machine:name(), t()) -> {[], t()}.
perform(
    {transmit, Dest, {starl, 1, shout, _, Type, Body}}, _, #world{model = #{sap := contract}} = W
) ->
    {[], put_under_way([{message, To, Type, Body, none} || To <- dests(Dest, W)], W)};
perform({until, _Us, {trace, Event}, _Late}, Name, World) ->
    {[], trace(Name, Event, World)};
perform({until, _Us, Action, _Late}, Name, World) ->
    perform(Action, Name, World);
perform({transmit, Dest, Packet}, _Name, World) ->
    {[], put_under_way([{packet, To, Packet} || To <- dests(Dest, World)], World)}.

%% What is sent to a robot that the team has not goes nowhere.
dests(all, #world{place = Place, model = #{ids := Ids} = Model}) ->
    lists:delete(starl_check_model:id(Place, Model), Ids);
dests(Dest, #world{model = #{ids := Ids}}) ->
    [Dest || lists:member(Dest, Ids)].

%% @doc Does nothing: the robot always stands still.
-spec stop(t()) -> t().
stop(World) -> World.
