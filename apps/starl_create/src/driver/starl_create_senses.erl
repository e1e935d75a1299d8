%% @doc Turns the frames of a Create's stream into events, and detects a wheel that stalls.
%%
%% A wheel stalls if the robot reports too high a current. It also stalls if it does not turn at all
%% in three consecutive frames while the robot has been commanded to turn it for four frames. (One
%% frame may repeat the one before it.) A new bump counts as a stall, too, unless bumps are to be
%% ignored. A robot that already touches something can drive away from it.
-module(starl_create_senses).

-export([new/0, see/2, readings/1]).
-export([events/1, state/1, battery_percent/1, is_stalled/2, is_at_rest/1, unsafe/1]).

-export_type([t/0, event/0, unsafe/0]).

-type event() ::
    {bump, left | right | both | none}
    | {drop, Bits :: non_neg_integer()}
    | {cliff, [left | front_left | front_right | right]}
    | {buttons, Bits :: byte()}
    | {docked, boolean()}
    | {battery, low | ok}.

%% Why a robot leaves its mode, or does not enter it.
-type unsafe() :: wheel_drop | charger | cliff | none.

-record(senses, {
    before = #{} :: starl_create_packet:readings(),
    now = #{} :: starl_create_packet:readings(),
    %% of each wheel: the frames since its command changed
    steady = {0, 0} :: {non_neg_integer(), non_neg_integer()},
    %% the frames in which it has not turned since then
    still = {0, 0} :: {non_neg_integer(), non_neg_integer()}
}).

-opaque t() :: #senses{}.

%% Frames of the same command before a wheel that stands counts as stalled; the slowest speed at
%% which each frame must show a count.
-define(STEADY, 4).
-define(STILL, 3).
-define(SEEN_SPEED, 90).
-define(LOW_BATTERY, 0.15).

%% @doc Nothing has been seen yet.
-spec new() -> t().
new() -> #senses{}.

%% @doc The next frame.
-spec see(starl_create_packet:readings(), t()) -> t().
see(Now, #senses{now = Before, steady = {Left0, Right0}, still = {StillLeft, StillRight}}) ->
    Left = same(left_velocity, Before, Now, Left0),
    Right = same(right_velocity, Before, Now, Right0),
    Still = {
        stands({left_velocity, left_encoder}, {Left, StillLeft}, Before, Now),
        stands({right_velocity, right_encoder}, {Right, StillRight}, Before, Now)
    },
    #senses{before = Before, now = Now, steady = {Left, Right}, still = Still}.

same(Name, Before, Now, N) ->
    case {Before, Now} of
        {#{Name := V}, #{Name := V}} -> N + 1;
        _ -> 0
    end.

%% @doc The last frame.
-spec readings(t()) -> starl_create_packet:readings().
readings(#senses{now = Now}) -> Now.

%% @doc What the last frame shows otherwise than the one before.
-spec events(t()) -> [event()].
events(#senses{before = Before, now = Now}) ->
    [Kind(Now) || Kind <- kinds(), Kind(Before) =/= Kind(Now)].

kinds() -> [fun bumps/1, fun drops/1, fun at_cliff/1, fun buttons/1, fun docked/1, fun battery/1].

%% @doc What the last frame shows of each kind.
-spec state(t()) -> [event()].
state(#senses{now = Now}) when map_size(Now) =:= 0 -> [];
state(#senses{now = Now}) -> [Kind(Now) || Kind <- kinds()].

bumps(#{bumps_drops := Bits}) -> {bump, bump(Bits band 3)}.

bump(0) -> none;
bump(1) -> right;
bump(2) -> left;
bump(3) -> both.

drops(#{bumps_drops := Bits}) -> {drop, Bits bsr 2}.

at_cliff(Readings) -> {cliff, cliffs(Readings)}.

cliffs(Readings) ->
    [Where || {Name, Where} <- cliff_sensors(), maps:get(Name, Readings) =/= 0].

cliff_sensors() ->
    [
        {cliff_left, left},
        {cliff_front_left, front_left},
        {cliff_front_right, front_right},
        {cliff_right, right}
    ].

buttons(#{buttons := Bits}) -> {buttons, Bits}.

docked(#{charging_sources := Bits}) -> {docked, Bits =/= 0}.

battery(#{charge := Charge, capacity := Capacity}) when Charge < ?LOW_BATTERY * Capacity ->
    {battery, low};
battery(_) ->
    {battery, ok}.

%% @doc Does the robot say that its wheels stand?
-spec is_at_rest(t()) -> boolean().
is_at_rest(#senses{now = #{left_velocity := 0, right_velocity := 0}}) -> true;
is_at_rest(#senses{}) -> false.

%% @doc The reason why a robot cannot be in mode Safe, by the last frame.
-spec unsafe(t()) -> unsafe().
unsafe(#senses{now = #{bumps_drops := Bits}}) when Bits band 2#11100 =/= 0 -> wheel_drop;
unsafe(#senses{now = #{charging_sources := Sources}}) when Sources =/= 0 -> charger;
unsafe(#senses{now = Now}) ->
    case cliffs(Now) of
        [] -> none;
        _ -> cliff
    end.

%% @doc Does a wheel stall?
-spec is_stalled(StopsAtBumps :: boolean(), t()) -> boolean().
is_stalled(StopsAtBumps, #senses{before = Before, now = Now, still = {Left, Right}}) ->
    #{overcurrents := Over} = Now,
    Over band 2#11000 =/= 0 orelse
        (StopsAtBumps andalso is_bump(Before, Now)) orelse
        max(Left, Right) >= ?STILL.

is_bump(#{bumps_drops := Old}, #{bumps_drops := New}) -> (New band 3) band (bnot Old) =/= 0.

%% In how many frames, this one the last, has a wheel stood that was to turn?
stands({Velocity, Encoder}, {Steady, Still}, Before, Now) when Steady >= ?STEADY ->
    case Now of
        #{Velocity := V, Encoder := _} when abs(V) >= ?SEEN_SPEED ->
            case starl_create_odometry:counts(Encoder, Before, Now) of
                0 -> Still + 1;
                _ -> 0
            end;
        _ ->
            0
    end;
stands(_, _, _, _) ->
    0.

%% @doc The part of its charge that is left, in percent.
-spec battery_percent(t()) -> 0..100 | unknown.
battery_percent(#senses{now = #{charge := Charge, capacity := Capacity}}) when Capacity > 0 ->
    min(100, 100 * Charge div Capacity);
battery_percent(#senses{}) ->
    unknown.
