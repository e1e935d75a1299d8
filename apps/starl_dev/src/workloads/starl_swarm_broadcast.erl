%% @doc The swarm-broadcast workload: N robots drive about in a square arena and broadcast over a
%% short radio range. They start at random places. A radio range of one metre gives each robot about
%% six neighbours. Each robot drives straight ahead; at the border it turns on the spot to a random
%% new heading. Robots do not avoid one another. Each broadcasts 10 bytes every 100 ms,
%% unacknowledged. It is an event-driven application.
%% ```
%%   looking --- located, room ahead: drives ----------> driving --- at the border ---> looking
%%      ^        located, at the border: turns ---> turning --- turned ---+
%%      +----------------------------------------------------------------+
%% '''
%% A robot commands its wheels directly. A straight line and a turn on the spot are each one motion
%% segment in closed form, so a moving robot costs no computation.
-module(starl_swarm_broadcast).
-behaviour(starl_machine).
-behaviour(starl_scene).

-export([scene/1, options/0, report/2]).
-export([init/1, handle_event/5]).

-type state() :: looking | driving | turning.

-record(drone, {
    self :: starl:robot_id(),
    side :: float(),
    rate :: float(),
    random :: rand:state(),
    period_us :: pos_integer(),
    ticks :: pos_integer(),
    tick = 0 :: non_neg_integer(),
    received = 0 :: non_neg_integer()
}).

-define(RANGE_MM, 1000.0).
-define(NEIGHBOURS, 6).
-define(SPEED, 100.0).
%% A robot with less room ahead is at the border.
-define(ROOM_MM, 1.0).
-define(BODY, <<"0123456789">>).

-spec options() -> [starl_options:option()].
options() ->
    [
        {period, {integer, 1, 3600000}, 100, "ms between two broadcasts of a robot"},
        {messages, {integer, 1, 1000000000}, 200, "number of broadcasts by each robot"}
    ].

%% @doc The arena's corners are (0, 0) and (side, side). The range of the radio, 1000 mm, is the
%% scenario's.
-spec scene(starl_scene:context()) -> {ok, starl_scene:t()} | {error, string()}.
scene(#{profiles := [#{chassis := starl_chassis_differential} = Profile]} = Context) ->
    arena(Profile, Context);
scene(_Context) ->
    {error, "the swarm drives on two wheels: leave --chassis out"}.

arena(Profile, #{robots := Ids, seed := Seed, options := Options}) ->
    #{period := Ms, messages := Messages} = Options,
    Side = side(length(Ids)),
    {Poses, _} = lists:mapfoldl(
        fun(Id, Random) -> place(Id, Side, Random) end, rand:seed_s(exsss, Seed), Ids
    ),
    {ok, #{
        app =>
            {machine, ?MODULE, #{
                side => Side,
                axle_mm => maps:get(axle_mm, Profile),
                period_us => Ms * 1000,
                messages => Messages
            }},
        poses => maps:from_list(Poses),
        profile => #{heading_error => 0.0, distance_error => 0.0, position_error_mm => 0.0},
        memo => Messages
    }}.

%% The side (mm) of the arena for this number of robots.
-spec side(Robots :: pos_integer()) -> float().
side(Robots) -> ?RANGE_MM * math:sqrt(Robots * math:pi() / ?NEIGHBOURS).

%% @doc Figures over all robots: `received', the messages received; `per_tick', the mean number of
%% receptions per broadcast of a robot.
-spec report(starl_scene:t(), starl_scene:outcome()) -> starl_scene:report().
report(#{memo := Messages}, #{robots := Robots}) ->
    Received = lists:sum([N || {_, #{result := {done, N}}} <- Robots]),
    #{figures => [{received, Received}, {per_tick, Received / (Messages * length(Robots))}]}.

-spec init(starl_machine:config()) -> {looking, #drone{}, [starl_machine:action()]}.
init(#{robot := Id, side := Side, axle_mm := Axle, period_us := Period} = Config) ->
    Drone = #drone{
        self = Id,
        side = Side,
        rate = 2 * ?SPEED / Axle,
        random = maps:get(random, Config),
        period_us = Period,
        ticks = maps:get(messages, Config)
    },
    {looking, Drone, [starl_sap:listen(swarm, app), {sense, [Id], look}, tick(0)]}.

-spec handle_event(
    starl_machine:event_type(), term(), state(), #drone{}, starl_machine:meta()
) -> starl_machine:result().
handle_event(cast, {message, _From, swarm, _Body}, _, #drone{received = N} = Drone, _) ->
    {keep_state, Drone#drone{received = N + 1}};
handle_event({timeout, tick}, _, _, #drone{tick = K, ticks = K, received = N} = Drone, _) ->
    {keep_state, Drone, [{done, N}]};
handle_event({timeout, tick}, _, _, #drone{tick = K, period_us = Period} = Drone, _) ->
    {keep_state, Drone#drone{tick = K + 1}, [tick(Period), starl_sap:shout(swarm, ?BODY)]};
handle_event(info, {located, look, [{Self, Pose, _}]}, looking, #drone{self = Self} = Drone, _) ->
    go(Pose, Drone);
handle_event(info, {driven, _, _}, _, #drone{self = Self} = Drone, _) ->
    {next_state, looking, Drone, [{sense, [Self], look}]};
handle_event(info, {restarted, _}, _, _, _) ->
    keep_state_and_data;
handle_event(_, _, _, _, _) ->
    unknown_event.

go(Pose, #drone{side = Side} = Drone) ->
    case ahead(Pose, Side) of
        Room when Room < ?ROOM_MM -> turn(Pose, Drone);
        Room -> drive(Room, Drone)
    end.

drive(Room, Drone) ->
    %% Rounded down, so that the robot stays inside.
    Us = trunc(Room / ?SPEED * 1.0e6),
    {next_state, driving, Drone, [wheels(?SPEED, ?SPEED, Us, straight)]}.

%% Turns the shorter way to a heading with room ahead.
turn({X, Y, Heading} = Pose, #drone{side = Side, rate = Rate, random = Random0} = Drone) ->
    {Draw, Random} = rand:uniform_s(Random0),
    Angle = (2 * Draw - 1) * math:pi(),
    Turning = Drone#drone{random = Random},
    case ahead({X, Y, Heading + Angle}, Side) < ?ROOM_MM of
        true ->
            turn(Pose, Turning);
        false ->
            Us = round(abs(Angle) / Rate * 1.0e6),
            Left =
                case Angle > 0 of
                    true -> -?SPEED;
                    false -> ?SPEED
                end,
            {next_state, turning, Turning, [wheels(Left, -Left, Us, turn)]}
    end.

wheels(Left, Right, Us, Mark) ->
    {drive, {starl_chassis_differential, [{Left, Right, Us}]}, Mark}.

%% The distance straight ahead to the border, mm.
ahead({X, Y, Heading}, Side) ->
    min(ahead(X, math:cos(Heading), Side), ahead(Y, math:sin(Heading), Side)).

ahead(X, Step, Side) when Step > 0 -> max(0.0, Side - X) / Step;
ahead(X, Step, _Side) when Step < 0 -> max(0.0, X) / -Step;
ahead(_X, _Step, Side) -> 2 * Side.

tick(Us) -> {{timeout, tick}, Us, tick}.

place(Id, Side, Random0) ->
    {X, Random1} = rand:uniform_s(Random0),
    {Y, Random2} = rand:uniform_s(Random1),
    {Turn, Random3} = rand:uniform_s(Random2),
    {{Id, {Side * X, Side * Y, 2 * math:pi() * Turn}}, Random3}.
