%% @doc Motion: drives to a point along a straight line, turning on the spot and driving in
%% legs, with a look at the position before each.
%% ```
%%            go_to                   pose                      turned
%%   idle ------------> locating -------------> turning ----------------------> driving
%%     ^                 |  ^  ^                   (small angles are not turned)   |
%%     |  arrived        |  |  +---------------------------------------------------+
%%     +-----------------+  +-- state time-out: no pose yet, ask again     leg driven
%% '''
%% Assumption II.1 of the paper: while it drives from where it stood to its goal, the robot
%% stays within r(v) of the straight line. It aims at the point of the line one leg ahead, so a
%% leg's sideways error does not grow into the next one; with heading errors of at most ε (what
%% is not worth a turn included) and distance errors of at most δ per leg of length L, at
%% positions known to within s, it ends within g = L·(ε + δ) + 2s + 0.5 mm of the goal. A path's
%% next line begins where the robot thinks it should be, so while it drives it is never farther
%% from the line between two points of a path than g + Lε + s ({@link tracking_radius/1}).
%%
%% Calls: `{go_to, point()}' (answer `ok' when it is there, `{error, stopped}' when another
%% command comes first), `stop'. Configuration: {@link profile()}.
-module(starl_motion).
-behaviour(starl_machine).

-export([profile/1, tracking_radius/1, stop/0]).
-export([init/1, handle_event/5]).

-export_type([profile/0]).

%% How the robot drives. `speed' and `near_speed' (within `near_mm' of the goal) in mm/s,
%% `turn_rate' and `near_turn_rate' in rad/s, `leg_s' the time between two looks at the
%% position, `goal_mm' how near the goal is near enough, `axle_mm' the distance of the wheels.
%% The bounds of the errors: `heading_error' in rad and `distance_error' as a fraction per leg,
%% `position_error_mm' of the positioning system.
-type profile() :: #{
    speed := float(),
    near_speed := float(),
    near_mm := float(),
    turn_rate := float(),
    near_turn_rate := float(),
    leg_s := float(),
    goal_mm := float(),
    axle_mm := float(),
    turn_from := float(),
    heading_error := float(),
    distance_error := float(),
    position_error_mm := float()
}.

%% How long to wait for a position before asking again.
-define(POSE_TIMEOUT_US, 500000).

-record(drive, {
    self :: starl:robot_id(),
    profile :: profile(),
    from = none :: starl_machine:from() | none,
    start = unknown :: starl_geometry:point() | unknown,
    goal = {0.0, 0.0} :: starl_geometry:point(),
    leg_mm = 0.0 :: float(),
    speed = 0.0 :: float(),
    asked = 0 :: non_neg_integer()
}).

%% @doc A whole profile: the iRobot Create's defaults, overridden by the given keys.
%% The Create's limits: 500 mm/s, axle 258 mm (Open Interface document, 2006).
-spec profile(map()) -> profile().
profile(Overrides) ->
    Default = #{
        speed => 500.0,
        near_speed => 500.0,
        near_mm => 0.0,
        turn_rate => 3.0,
        near_turn_rate => 3.0,
        leg_s => 0.3,
        axle_mm => 258.0,
        turn_from => 0.005,
        heading_error => 0.02,
        distance_error => 0.01,
        position_error_mm => 1.0
    },
    Given = maps:merge(Default, Overrides),
    maps:merge(#{goal_mm => end_error(Given)}, Given).

%% @doc r(v): how far from the straight line the robot may be while it drives, in millimetres.
-spec tracking_radius(profile()) -> float().
tracking_radius(#{goal_mm := Goal} = Profile) ->
    #{heading_error := Error, position_error_mm := Position, turn_from := TurnFrom} = Profile,
    float(Goal + leg(Profile) * (Error + TurnFrom) + Position).

%% @doc The action that stops the robot.
-spec stop() -> starl_machine:action().
stop() -> {cast, motion, stop}.

-spec init(starl_machine:config()) -> {idle, #drive{}, [starl_machine:action()]}.
init(#{robot := Self, profile := Profile}) ->
    {idle, #drive{self = Self, profile = Profile}, [still()]}.

-spec handle_event(
    starl_machine:event_type(),
    term(),
    idle | locating | turning | driving,
    #drive{},
    starl_machine:meta()
) -> starl_machine:result().
handle_event(state_timeout, drive, turning, Drive, _Meta) ->
    #drive{leg_mm = Leg, speed = Speed} = Drive,
    {next_state, driving, Drive, [
        {drive, Speed, Speed}, {state_timeout, duration_us(Leg, Speed), arrived}
    ]};
handle_event(state_timeout, arrived, driving, Drive, _Meta) ->
    locate(Drive, [still()]);
handle_event({reply, N}, {ok, Pose}, locating, #drive{asked = N} = Drive, _Meta) ->
    located(Pose, Drive);
handle_event({call, From}, {go_to, Goal}, _State, Drive, _Meta) ->
    locate(Drive#drive{from = From, goal = Goal, start = unknown}, [still() | stopped(Drive)]);
handle_event(state_timeout, ask, locating, Drive, _Meta) ->
    locate(Drive, []);
handle_event({reply, _}, _, _State, _Drive, _Meta) ->
    keep_state_and_data;
handle_event(cast, stop, _State, Drive, _Meta) ->
    {next_state, idle, Drive#drive{from = none}, [still() | stopped(Drive)]};
handle_event({call, From}, stop, _State, Drive, _Meta) ->
    Actions = [still() | stopped(Drive)] ++ [{reply, From, ok}],
    {next_state, idle, Drive#drive{from = none}, Actions};
handle_event(info, {restarted, location}, locating, Drive, _Meta) ->
    locate(Drive, []);
handle_event(info, {restarted, _}, _State, _Drive, _Meta) ->
    keep_state_and_data;
handle_event(_, _, _, _, _) ->
    unknown_event.

stopped(#drive{from = none}) -> [];
stopped(#drive{from = From}) -> [{reply, From, {error, stopped}}].

still() -> {drive, 0.0, 0.0}.

locate(#drive{asked = N, self = Self} = Drive, Actions) ->
    Ask = [starl_location:pose(Self, N + 1), {state_timeout, ?POSE_TIMEOUT_US, ask}],
    {next_state, locating, Drive#drive{asked = N + 1}, Actions ++ Ask}.

located({X, Y, Heading}, #drive{start = unknown} = Drive) ->
    located({X, Y, Heading}, Drive#drive{start = {X, Y}});
located({X, Y, Heading}, #drive{goal = Goal, profile = Profile, from = From} = Drive) ->
    Here = {X, Y},
    Distance = starl_geometry:distance(Here, Goal),
    case Distance =< maps:get(goal_mm, Profile) of
        true -> {next_state, idle, Drive#drive{from = none}, [{reply, From, ok}]};
        false -> leg(Here, Heading, Distance, Drive)
    end.

%% Turns towards the point of the line one leg ahead, and drives there.
leg(Here, Heading, Distance, #drive{profile = Profile} = Drive) ->
    {Speed, TurnRate} = speeds(Distance, Profile),
    Aim = aim(Here, Distance, Speed, Drive),
    Leg = starl_geometry:distance(Here, Aim),
    Angle = starl_geometry:angle_diff(starl_geometry:heading(Here, Aim), Heading),
    Next = Drive#drive{leg_mm = Leg, speed = Speed},
    case abs(Angle) =< maps:get(turn_from, Profile) of
        true ->
            Actions = [{drive, Speed, Speed}, {state_timeout, duration_us(Leg, Speed), arrived}],
            {next_state, driving, Next, Actions};
        false ->
            Wheel = sign(Angle) * TurnRate * maps:get(axle_mm, Profile) / 2,
            Turn = {state_timeout, duration_us(abs(Angle), TurnRate), drive},
            {next_state, turning, Next, [{drive, -Wheel, Wheel}, Turn]}
    end.

speeds(Distance, #{near_mm := Near} = Profile) when Distance =< Near ->
    #{near_speed := Speed, near_turn_rate := TurnRate} = Profile,
    {Speed, TurnRate};
speeds(_Distance, #{speed := Speed, turn_rate := TurnRate}) ->
    {Speed, TurnRate}.

%% The point of the line from start to goal that lies one leg ahead of the robot; where the
%% speed changes near the goal, a leg ends.
aim(Here, Distance, Speed, #drive{start = Start, goal = Goal, profile = Profile}) ->
    #{leg_s := LegS, near_mm := Near} = Profile,
    ToChange =
        case Distance > Near of
            true -> max(Distance - Near, 1.0);
            false -> Distance
        end,
    Length = starl_geometry:distance(Start, Goal),
    Along = starl_geometry:distance(Start, starl_geometry:closest_point(Here, {Start, Goal})),
    Ahead = Along + min(Speed * LegS, ToChange),
    case Length =< 0.0 orelse Ahead >= Length of
        true -> Goal;
        false -> starl_geometry:interpolate(Start, Goal, Ahead / Length)
    end.

%% How near to its goal the last leg is sure to end.
end_error(#{heading_error := Heading, distance_error := Part, turn_from := TurnFrom} = Profile) ->
    leg(Profile) * (Heading + TurnFrom + Part) + 2 * maps:get(position_error_mm, Profile) + 0.5.

leg(#{speed := Speed, leg_s := LegS}) -> Speed * LegS.

duration_us(Amount, Rate) -> max(1, round(Amount / Rate * 1000000)).

sign(X) when X < 0 -> -1.0;
sign(_) -> 1.0.
