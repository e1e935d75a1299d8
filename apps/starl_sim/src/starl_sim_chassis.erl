%% @doc The simulated chassis: what its wheels make of a command, and the piece of motion that comes
%% of it, straight or an arc, with the errors of a real one. All draws are stateless.
-module(starl_sim_chassis).

-export([command/2, wheels/2, turn/5]).

-export_type([speeds/0]).

%% The speeds of the left and the right wheel, mm/s.
-type speeds() :: {Left :: number(), Right :: number()}.

%% The Create's limit, mm/s (Open Interface, Drive Direct).
-define(MAX_WHEEL, 500.0).

%% @doc A command as the wheels can follow it, mm/s.
-spec command(Left :: number(), Right :: number()) -> speeds().
command(Left, Right) -> {limit(Left), limit(Right)}.

limit(Speed) -> max(-?MAX_WHEEL, min(?MAX_WHEEL, Speed)).

%% @doc How the wheels turn at a command under these faults.
-spec wheels(speeds(), [starl_sim_fault:compiled()]) -> speeds().
wheels(Command, Faults) -> lists:foldl(fun fault/2, Command, Faults).

fault({_, _, _, wheel_stuck, _, #{wheel := left}}, {_, Right}) -> {0.0, Right};
fault({_, _, _, wheel_stuck, _, #{wheel := right}}, {Left, _}) -> {Left, 0.0};
fault({_, _, _, wheel_slow, _, #{wheel := left, factor := F}}, {Left, Right}) -> {F * Left, Right};
fault({_, _, _, wheel_slow, _, #{wheel := right, factor := F}}, {Left, Right}) -> {Left, F * Right};
fault({_, _, _, slip, _, #{factor := F}}, {Left, Right}) -> {F * Left, F * Right};
fault(_, Speeds) -> Speeds.

%% @doc The piece of motion from now on, and how many draws it took; `same' for a robot that
%% stands and is to stand. The errors of heading and distance are drawn by the key.
-spec turn(speeds(), starl_sim_queue:time(), starl_trajectory:piece(), Key, Profile) ->
    same | {starl_trajectory:piece(), Draws :: 0 | 1}
when
    Key :: {Seed :: integer(), starl:robot_id(), non_neg_integer()},
    Profile :: starl_motion:profile().
turn({Left, Right}, Now, Old, Key, #{axle_mm := Axle} = Profile) ->
    {X, Y, Heading} = starl_trajectory:pose(Now, Old),
    Speed = (Left + Right) / 2,
    Rate = (Right - Left) / Axle,
    case {Speed == 0, Rate == 0} of
        {true, true} -> stand(Now, {X, Y}, Heading, starl_trajectory:is_still(Old));
        {true, false} -> {starl_trajectory:piece(Now, {X, Y}, Heading, 0.0, Rate), 0};
        {false, _} -> {erring(Now, {X, Y, Heading}, Speed, Rate, Key, Profile), 1}
    end.

stand(_Now, _Point, _Heading, true) -> same;
stand(Now, Point, Heading, false) -> {starl_trajectory:standing(Now, Point, Heading), 0}.

erring(Now, {X, Y, Heading}, Speed, Rate, {Seed, Id, N}, Profile) ->
    #{heading_error := Turn, distance_error := Part} = Profile,
    Skew = 0.75 * Turn * starl_sim_draw:signed({Seed, Id, N, skew}),
    Slip = 1.0 + Part * starl_sim_draw:signed({Seed, Id, N, slip}),
    starl_trajectory:piece(Now, {X, Y}, Heading + Skew, Speed * Slip, Rate).
