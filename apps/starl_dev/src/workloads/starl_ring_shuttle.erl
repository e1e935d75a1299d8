%% @doc The ring-shuttle workload: N robots send messages around a ring while they drive to and fro.
%% Each robot sends a reliable message to the next one every 100 ms, and drives between two points
%% one metre apart. It is an event-driven application.
%%
%% The benchmarks use it and check its figures: 600·N messages delivered, none twice, mean latency
%% about 15 ms, 7 legs per robot in 60 s.
-module(starl_ring_shuttle).
-behaviour(starl_machine).
-behaviour(starl_scene).

-export([scene/1, options/0, report/2]).
-export([init/1, handle_event/5]).

-record(shuttle, {
    self :: starl:robot_id(),
    next :: starl:robot_id(),
    period_us :: pos_integer(),
    ticks :: pos_integer(),
    tick = 0 :: non_neg_integer(),
    here :: starl_geometry:point(),
    there :: starl_geometry:point(),
    legs = 0 :: non_neg_integer(),
    received = 0 :: non_neg_integer()
}).

-spec options() -> [starl_options:option()].
options() ->
    [
        {period, {integer, 1, 3600000}, 100, "ms between two messages of a robot"},
        {messages, {integer, 1, 1000000000}, 600, "number of messages that each robot sends"}
    ].

%% @doc Robot i starts at A = ((i-1) mod c · 2000, (i-1) div c · 1000), c = ceil(sqrt N); B is
%% one metre to the right of A.
-spec scene(starl_scene:context()) -> {ok, starl_scene:t()}.
scene(#{robots := Ids, options := #{period := Ms, messages := Messages}}) ->
    Columns = ceil(math:sqrt(length(Ids))),
    Place = fun(Id) -> place(Id, Columns) end,
    {ok, #{
        app =>
            {machine, ?MODULE, #{
                columns => Columns, period_us => Ms * 1000, messages => Messages
            }},
        poses => maps:from_list([{Id, pose(Place(Id))} || Id <- Ids]),
        profile => #{
            speed => 250.0,
            near_speed => 175.0,
            near_mm => 700.0,
            turn_rate => radians(50),
            near_turn_rate => radians(25),
            goal_mm => 75.0,
            leg_s => 60.0,
            heading_error => 0.0,
            distance_error => 0.0,
            position_error_mm => 0.0
        },
        sap => #{retransmit_ms => 250, backoff => 1.0, limit => 15}
    }}.

-spec report(starl_scene:t(), starl_scene:outcome()) -> starl_scene:report().
report(_Scene, #{robots := Robots}) ->
    Done = [{Received, Legs} || {_, #{result := {done, {Received, Legs}}}} <- Robots],
    #{
        figures => [
            {received, lists:sum([N || {N, _} <- Done])},
            {legs_min, lists:min([infinity | [L || {_, L} <- Done]])},
            {legs_max, lists:max([0 | [L || {_, L} <- Done]])}
        ]
    }.

-spec init(starl_machine:config()) -> {running, #shuttle{}, [starl_machine:action()]}.
init(#{robot := Id, participants := Team, columns := Columns, period_us := Period} = Config) ->
    {X, Y} = place(Id, Columns),
    Shuttle = #shuttle{
        self = Id,
        next = starl_team:next(Id, Team),
        period_us = Period,
        ticks = maps:get(messages, Config),
        here = {X, Y},
        there = {X + 1000.0, Y}
    },
    {running, Shuttle, [starl_sap:listen(ring, app), tick(0)]}.

-spec handle_event(
    starl_machine:event_type(), term(), running, #shuttle{}, starl_machine:meta()
) -> starl_machine:result().
handle_event(cast, {message, _From, ring, _K}, running, #shuttle{received = N} = Shuttle, _) ->
    {keep_state, Shuttle#shuttle{received = N + 1}};
handle_event({timeout, tick}, _, running, #shuttle{tick = K, ticks = K} = Shuttle, _) ->
    {keep_state, Shuttle, [{done, {Shuttle#shuttle.received, Shuttle#shuttle.legs}}]};
handle_event({timeout, tick}, _, running, #shuttle{tick = K, next = Next} = Shuttle, _) ->
    Actions = [starl_sap:post(Next, ring, integer_to_binary(K)) | extra(K, Shuttle)],
    {keep_state, Shuttle#shuttle{tick = K + 1}, [tick(Shuttle#shuttle.period_us) | Actions]};
handle_event({reply, drive}, ok, running, #shuttle{legs = Legs} = Shuttle, _) ->
    #shuttle{here = Here, there = There} = Shuttle,
    Turned = Shuttle#shuttle{legs = Legs + 1, here = There, there = Here},
    {keep_state, Turned, [{call, motion, {go_to, Here}, drive}]};
handle_event({reply, sample}, _, running, _Shuttle, _) ->
    keep_state_and_data;
handle_event(_, _, _, _, _) ->
    unknown_event.

%% Starts the first drive, and every tenth tick requests the robot's own position.
extra(0, #shuttle{there = There}) -> [{call, motion, {go_to, There}, drive}];
extra(K, #shuttle{self = Self}) when K rem 10 =:= 0 -> [starl_location:pose(Self, sample)];
extra(_, _) -> [].

tick(Us) -> {{timeout, tick}, Us, tick}.

place(Id, Columns) -> {2000.0 * ((Id - 1) rem Columns), 1000.0 * ((Id - 1) div Columns)}.

pose({X, Y}) -> {X, Y, 0.0}.

radians(Degrees) -> Degrees * math:pi() / 180.
