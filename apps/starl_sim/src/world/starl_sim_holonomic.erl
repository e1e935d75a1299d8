%% @doc The simulated chassis that drives in any direction ({@link starl_chassis_holonomic}). It is
%% a point mass that approaches the commanded velocity at its limit of acceleration, with the errors
%% of a real chassis. It does not turn.
%%
%% Faults of actuation act on the drive along one axis of the body: `left' on the forward axis,
%% `right' on the sideways axis. A stuck drive brakes and then keeps its part of the velocity at
%% zero. A slow drive reaches only a fraction of its command. Slip acts like a wind that the body
%% cannot measure: the body reaches only a fraction of its velocity over ground. All of these faults
%% change the velocity that the body approaches. None changes its acceleration: it brakes as usual.
-module(starl_sim_holonomic).
-behaviour(starl_sim_chassis).

-export([standing/0, command/2, errors/3, move/5, lasts_us/1, stops_us/2]).

-type velocity() :: {Forward :: number(), Left :: number()}.

-spec standing() -> velocity().
standing() -> {0.0, 0.0}.

%% @doc A command within the limit of speed.
-spec command({Forward :: number(), Left :: number(), Us}, starl_chassis:profile()) ->
    {velocity(), Us}
when
    Us :: pos_integer().
command({Forward, Left, Us}, #{speed := Most}) -> {limit({Forward, Left}, Most), Us}.

limit({X, Y} = Velocity, Most) ->
    case math:sqrt(X * X + Y * Y) of
        Speed when Speed > Most -> {X * Most / Speed, Y * Most / Speed};
        _ -> Velocity
    end.

%% @doc The errors of a command.
-spec errors(velocity(), starl_sim_chassis:key(), starl_chassis:profile()) ->
    starl_sim_chassis:errors().
errors(_Command, {Seed, Id, N}, #{heading_error := Turn, distance_error := Part}) ->
    {
        0.75 * Turn * starl_run_draw:signed({Seed, Id, N, skew}),
        1.0 + Part * starl_run_draw:signed({Seed, Id, N, slip})
    }.

%% @doc The approach to a new velocity; `same' if the body approaches it already.
-spec move(starl_sim_chassis:drive(), Faults, Now, Old, starl_chassis:profile()) ->
    {IsOff :: boolean(), same | starl_trajectory:piece()}
when
    Faults :: [starl_run_fault:compiled()],
    Now :: starl_sim_queue:time(),
    Old :: starl_trajectory:piece().
move({Command, Errors, _When}, Faults, Now, Old, Profile) ->
    Doing = starl_sim_differential:failing(Command, Faults),
    Slipping = starl_sim_differential:slipping(Doing, Faults),
    {X, Y, Heading} = starl_trajectory:pose(Now, Old),
    Aim = over_ground(Slipping, Heading, Errors, Profile),
    IsOff = starl_sim_differential:is_off(Command, Doing),
    {IsOff, take_to(Aim, Now, {X, Y}, Heading, Old, Profile)}.

over_ground({Forward, Left}, _Heading, _Errors, _Profile) when Forward == 0, Left == 0 ->
    {0.0, 0.0};
over_ground({Forward, Left}, Heading, {Skew, Part}, #{speed := Most}) ->
    Cos = Part * math:cos(Heading + Skew),
    Sin = Part * math:sin(Heading + Skew),
    limit({Forward * Cos - Left * Sin, Forward * Sin + Left * Cos}, Most).

take_to(Aim, Now, Point, Heading, Old, #{acceleration := Acceleration}) ->
    {VX, VY} = Velocity = starl_trajectory:velocity(Now, Old),
    {AX, AY} = Aim,
    Change = math:sqrt((AX - VX) * (AX - VX) + (AY - VY) * (AY - VY)),
    case aims_at(Old) of
        Aim ->
            same;
        _ ->
            Us = ceil(Change / Acceleration * 1.0e6),
            starl_trajectory:ramp(Now, Point, Heading, Velocity, Aim, Us)
    end.

%% The velocity that a piece reaches in the end.
aims_at(Piece) -> starl_trajectory:velocity(1 bsl 62, Piece).

%% @doc Unknown: the time to brake depends on the velocity then.
-spec lasts_us(starl_chassis_holonomic:commands()) -> unknown.
lasts_us(_Commands) -> unknown.

%% @doc The time that it still brakes.
-spec stops_us(starl_sim_queue:time(), starl_trajectory:piece()) -> non_neg_integer().
stops_us(Now, Piece) ->
    case starl_trajectory:rests_from(Piece) of
        T when is_integer(T), is_integer(Now) -> max(0, T - Now)
    end.
