%% @doc The chassis that drives in any direction without a turn: the paper's quadrotor at a constant
%% height, modelled as a point mass with a limit of speed and one of acceleration.
%%
%% A command is a velocity in the robot's own frame with a duration, `{Forward, Left, Us}', mm/s.
%% The chassis approaches it at its limit of acceleration, from its present velocity, and keeps it
%% for the rest of the time; after the last command it brakes at that limit and stands. So a robot
%% that stands and gets one velocity v for a time t ends v·t from its place, if t is no shorter than
%% the approach to v: the distance that it lacks at the beginning it drives while it brakes.
%%
%% {@link starl_holonomic_course} plans courses with these commands.
-module(starl_chassis_holonomic).
-behaviour(starl_chassis).

-export([profile/1, check/1, duration_us/2, next/4, last/1, undo/1, try_mm/1]).
-export([tracking_radius/1, ends_mm/1, cruise/4, rests_s/1, pace/1]).

-export_type([commands/0]).

-type commands() :: [{Forward :: number(), Left :: number(), Us :: pos_integer()}].

%% The limits of a command: speed (mm/s), duration (us).
-define(FASTEST, 1.0e6).
-define(LONGEST_US, (1 bsl 50)).
-define(IS_SPEED(V), is_number(V), V =< ?FASTEST, V >= -?FASTEST).
%% The limits of a try: longer than the chassis needs to notice a failure (15 ms), and slow (mm/s).
-define(TRY_US, 20000).
-define(TRY_SPEED, 10.0).

-spec profile(map()) -> starl_holonomic_course:profile().
profile(Overrides) -> starl_holonomic_course:profile(Overrides).

-spec check(term()) -> ok | {error, string()}.
check([]) ->
    ok;
check([{Forward, Left, Us} | Commands]) when
    ?IS_SPEED(Forward), ?IS_SPEED(Left), is_integer(Us), Us > 0, Us =< ?LONGEST_US
->
    check(Commands);
check(_) ->
    {error, "[{Forward, Left, Us}]: mm/s within 1.0e6, Us from 1"}.

%% It brakes at the end, from a speed that slip may have lowered, or its error raised.
-spec duration_us(commands(), starl_chassis:profile()) -> {Least, Most} when
    Least :: non_neg_integer(), Most :: non_neg_integer().
duration_us(Commands, #{acceleration := Acceleration, speed := Speed}) ->
    Us = lists:sum([Us || {_, _, Us} <- Commands]),
    {Us, Us + ceil(Speed / Acceleration * 1.0e6)}.

-spec next(starl_chassis:way(), starl:pose(), starl_geometry:segment(), starl_chassis:profile()) ->
    arrived | starl_chassis:step().
next(Way, Pose, Line, Profile) -> starl_holonomic_course:next(Way, Pose, Line, Profile).

-spec last(commands()) -> {Forward :: number(), Left :: number()}.
last([]) ->
    {0.0, 0.0};
last(Commands) ->
    {Forward, Left, _} = lists:last(Commands),
    {Forward, Left}.

-spec undo(term()) -> {ok, commands()} | none | unknown.
undo({Forward, Left}) when Forward == 0, Left == 0 ->
    none;
undo({Forward, Left}) when ?IS_SPEED(Forward), ?IS_SPEED(Left) ->
    Part = min(1.0, ?TRY_SPEED / math:sqrt(Forward * Forward + Left * Left)),
    {ok, [{-Part * Forward, -Part * Left, ?TRY_US}]};
undo(_) ->
    unknown.

-spec try_mm(starl_chassis:profile()) -> float().
try_mm(_Profile) -> ?TRY_SPEED * ?TRY_US / 1.0e6.

%% It approaches the velocity at its limit of acceleration; the speed leaves room for its error.
-spec cruise(starl_chassis:velocity(), starl:pose(), pos_integer(), starl_chassis:profile()) ->
    commands().
cruise({VX, VY}, {_, _, Heading}, Us, #{distance_error := Error}) ->
    {Cos, Sin} = {math:cos(Heading), math:sin(Heading)},
    Part = 1.0 / (1.0 + Error),
    [{Part * (VX * Cos + VY * Sin), Part * (VY * Cos - VX * Sin), Us}].

-spec rests_s(starl_chassis:profile()) -> float().
rests_s(#{speed := Speed, acceleration := Acceleration}) -> Speed / Acceleration.

-spec tracking_radius(starl_chassis:profile()) -> float().
tracking_radius(Profile) -> starl_holonomic_course:tracking_radius(Profile).

-spec ends_mm(starl_chassis:profile()) -> float().
ends_mm(Profile) -> starl_holonomic_course:ends_mm(Profile).

-spec pace(starl_chassis:profile()) -> starl_chassis:pace().
pace(Profile) -> starl_holonomic_course:pace(Profile).
