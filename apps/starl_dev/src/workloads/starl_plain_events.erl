%% @doc The plain-events workload: each of N robots in a ring sends an unacknowledged message to the
%% next every 100 ms, and no robot moves. This event-driven application makes the simulator handle
%% timers and deliveries only.
-module(starl_plain_events).
-behaviour(starl_machine).
-behaviour(starl_scene).

-export([scene/1, options/0, report/2]).
-export([init/1, handle_event/5]).

-record(ring, {
    self :: starl:robot_id(),
    next :: starl:robot_id(),
    period_us :: pos_integer(),
    ticks :: pos_integer(),
    tick = 0 :: non_neg_integer(),
    received = 0 :: non_neg_integer()
}).

-spec options() -> [starl_options:option()].
options() ->
    [
        {period, {integer, 1, 3600000}, 100, "ms between two messages of a robot"},
        {messages, {integer, 1, 1000000000}, 600, "number of messages that each robot sends"}
    ].

-spec scene(starl_scene:context()) -> {ok, starl_scene:t()}.
scene(#{options := #{period := Ms, messages := Messages}}) ->
    {ok, #{
        app => {machine, ?MODULE, #{period_us => Ms * 1000, messages => Messages}},
        memo => Messages
    }}.

%% @doc Figures over all robots: `received', the messages received; `events', the timers and
%% deliveries.
-spec report(starl_scene:t(), starl_scene:outcome()) -> starl_scene:report().
report(#{memo := Messages}, #{robots := Robots}) ->
    Received = lists:sum([N || {_, #{result := {done, N}}} <- Robots]),
    Timers = (Messages + 1) * length(Robots),
    #{figures => [{received, Received}, {events, Timers + Received}]}.

-spec init(starl_machine:config()) -> {running, #ring{}, [starl_machine:action()]}.
init(#{robot := Id, participants := Team, period_us := Period, messages := Messages}) ->
    Ring = #ring{
        self = Id, next = starl_team:next(Id, Team), period_us = Period, ticks = Messages
    },
    {running, Ring, [starl_sap:listen(ring, app), tick(0)]}.

-spec handle_event(
    starl_machine:event_type(), term(), running, #ring{}, starl_machine:meta()
) -> starl_machine:result().
handle_event(cast, {message, _From, ring, _K}, running, #ring{received = N} = Ring, _) ->
    {keep_state, Ring#ring{received = N + 1}};
handle_event({timeout, tick}, _, running, #ring{tick = K, ticks = K, received = N} = Ring, _) ->
    {keep_state, Ring, [{done, N}]};
handle_event({timeout, tick}, _, running, #ring{self = Self, next = Next, tick = K} = Ring, _) ->
    Message = starl_sap:datagram(Self, Next, ring, K),
    {keep_state, Ring#ring{tick = K + 1}, [tick(Ring#ring.period_us), Message]};
handle_event(info, {restarted, _}, running, _Ring, _) ->
    keep_state_and_data;
handle_event(_, _, _, _, _) ->
    unknown_event.

tick(Us) -> {{timeout, tick}, Us, tick}.
