%% @doc The simulated chassis with two wheels ({@link starl_chassis_differential}). It turns a
%% command into wheel speeds, and these into a straight or curved motion segment, with the errors of
%% a real chassis. It stops at once when it is commanded to.
-module(starl_sim_differential).
-behaviour(starl_sim_chassis).

-export([standing/0, command/2, errors/3, move/5, lasts_us/1, stops_us/2]).
%% for the other simulated chassis as well
-export([failing/2, is_off/2, slipping/2]).

-export_type([speeds/0]).

%% The speeds of the left and the right wheel, mm/s.
-type speeds() :: {Left :: number(), Right :: number()}.

%% The Create's limit, mm/s (Open Interface, Drive Direct).
-define(MAX_WHEEL, 500.0).
%% The loss of speed, as a fraction, from which on the chassis notices a slow wheel.
-define(NOTICED, 0.02).

-spec standing() -> speeds().
standing() -> {0.0, 0.0}.

%% @doc A command within the limits of the wheels, mm/s.
-spec command({Left :: number(), Right :: number(), Us :: pos_integer()}, starl_chassis:profile()) ->
    {speeds(), Us :: pos_integer()}.
command({Left, Right, Us}, _Profile) -> {{limit(Left), limit(Right)}, Us}.

limit(Speed) -> max(-?MAX_WHEEL, min(?MAX_WHEEL, Speed)).

%% @doc The actual speeds of the wheels at a command under these faults.
-spec failing(speeds(), [starl_run_fault:compiled()]) -> speeds().
failing(Command, Faults) -> lists:foldl(fun wheel/2, Command, Faults).

wheel({_, _, _, wheel_stuck, _, #{wheel := left}}, {_, Right}) ->
    {0.0, Right};
wheel({_, _, _, wheel_stuck, _, #{wheel := right}}, {Left, _}) ->
    {Left, 0.0};
wheel({_, _, _, wheel_slow, _, #{wheel := left, factor := F}}, {Left, Right}) ->
    {F * Left, Right};
wheel({_, _, _, wheel_slow, _, #{wheel := right, factor := F}}, {Left, Right}) ->
    {Left, F * Right};
wheel(_, Speeds) ->
    Speeds.

%% @doc Do the wheels deviate from their command so far that the chassis notices?
-spec is_off(Told :: speeds(), Turning :: speeds()) -> boolean().
is_off({Left, Right}, {Left, Right}) ->
    false;
is_off({Left0, Right0}, {Left, Right}) ->
    abs(Left - Left0) > ?NOTICED * abs(Left0) orelse abs(Right - Right0) > ?NOTICED * abs(Right0).

%% @doc The part of the wheels' turning that reaches the floor under these faults. The chassis,
%% which counts the turns, does not notice slip.
-spec slipping(speeds(), [starl_run_fault:compiled()]) -> speeds().
slipping(Turning, Faults) -> lists:foldl(fun slip/2, Turning, Faults).

slip({_, _, _, slip, _, #{factor := F}}, {Left, Right}) -> {F * Left, F * Right};
slip(_, Speeds) -> Speeds.

%% @doc The errors of a command, drawn by the key: of the heading, rad, and the actual distance as a
%% fraction. A turn in place has none.
-spec errors(speeds(), starl_sim_chassis:key(), starl_chassis:profile()) ->
    starl_sim_chassis:errors().
errors({Left, Right}, _Key, _Profile) when Left + Right == 0 ->
    {0.0, 1.0};
errors(_, {Seed, Id, N}, #{heading_error := Turn, distance_error := Part}) ->
    {
        0.75 * Turn * starl_run_draw:signed({Seed, Id, N, skew}),
        1.0 + Part * starl_run_draw:signed({Seed, Id, N, slip})
    }.

%% @doc The robot's next motion, and whether the chassis notices that its wheels do not obey.
%% The heading's error applies once for each command.
-spec move(starl_sim_chassis:drive(), Faults, Now, Old, starl_chassis:profile()) ->
    {IsOff :: boolean(), same | starl_trajectory:piece()}
when
    Faults :: [starl_run_fault:compiled()],
    Now :: starl_sim_queue:time(),
    Old :: starl_trajectory:piece().
move({Command, Errors, When}, Faults, Now, Old, #{axle_mm := Axle}) ->
    Turning = failing(Command, Faults),
    Speeds = slipping(Turning, Faults),
    {is_off(Command, Turning), turn(Speeds, now(When, Errors), Axle, Now, Old)}.

now(begins, Errors) -> Errors;
now(goes_on, {_Skew, Part}) -> {0.0, Part}.

%% @doc The duration of a script.
-spec lasts_us(starl_chassis_differential:commands()) -> non_neg_integer().
lasts_us([]) -> 0;
lasts_us([{_, _, Us} | Commands]) when is_integer(Us) -> Us + lasts_us(Commands).

%% @doc The time that it takes to stop.
-spec stops_us(starl_sim_queue:time(), starl_trajectory:piece()) -> 0.
stops_us(_Now, _Piece) -> 0.

turn({Left, Right}, {Skew, Part}, Axle, Now, Old) ->
    {X, Y, Heading} = starl_trajectory:pose(Now, Old),
    Speed = (Left + Right) / 2,
    Rate = (Right - Left) / Axle,
    case {Speed == 0, Rate == 0} of
        {true, true} -> stand(Now, {X, Y}, Heading, Old);
        {true, false} -> starl_trajectory:piece(Now, {X, Y}, Heading, 0.0, Rate);
        {false, _} -> starl_trajectory:piece(Now, {X, Y}, Heading + Skew, Speed * Part, Rate)
    end.

%% A robot that turns in place does not stand.
stand(_Now, _Point, _Heading, {piece, _, _, _, _, V, W}) when V == 0, W == 0 -> same;
stand(Now, Point, Heading, _Old) -> starl_trajectory:standing(Now, Point, Heading).
