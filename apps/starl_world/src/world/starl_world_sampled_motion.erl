%% @doc Computes motion from samples of a body's pose. Between two samples the body is taken to have
%% moved evenly, straight on or along an arc. Each motion segment begins at one sample and reaches
%% the next one to within 0.02 mm. A pure module.
-module(starl_world_sampled_motion).

-export([new/2, add/3, rest/1, reported_us/1]).

-export_type([t/0]).

%% The last sample, and the motion segment that it ends.
-opaque t() :: {Us :: integer(), starl:pose(), starl_trajectory:arc()}.

%% A body that stood began to move at most this time before the first sample that shows it.
-define(LONGEST_US, 500000).
%% A pose that is nearer than this is the expected one (mm, rad).
-define(NEAR_MM, 0.02).
-define(NEAR_RAD, 1.0e-4).

%% @doc A body at rest at a pose, since this time.
-spec new(Us :: integer(), starl:pose()) -> t().
new(Us, {X, Y, Heading} = Pose) -> {Us, Pose, starl_trajectory:standing(Us, {X, Y}, Heading)}.

%% @doc The time of the last sample.
-spec reported_us(t()) -> integer().
reported_us({Us, _, _}) -> Us.

%% @doc Adds a sample: returns the motion segment from the last sample on, if it is a new one. A sample
%% that is no later than the last one changes nothing.
-spec add(Us :: integer(), starl:pose(), t()) -> {starl_trajectory:arc() | same, t()}.
add(Us, _Pose, {Last, _, _} = Motion) when Us =< Last ->
    {same, Motion};
add(Us, Pose, {Last, From, Piece}) ->
    case is_near(starl_trajectory:pose(Us, Piece), Pose) of
        true ->
            {same, {Us, Pose, Piece}};
        false ->
            Next = between(begins(Last, Us, Piece), From, Us, Pose),
            {Next, {Us, Pose, Next}}
    end.

begins(Last, Us, Piece) ->
    case is_standing(Piece) of
        true -> max(Last, Us - ?LONGEST_US);
        false -> Last
    end.

is_standing({piece, _, _, _, _, V, W}) -> V == 0 andalso W == 0.

%% @doc Handles that no more samples come: as far as is known, the body stands where it was last.
-spec rest(t()) -> {starl_trajectory:arc() | same, t()}.
rest({Last, {X, Y, Heading} = Pose, Piece}) ->
    Standing = starl_trajectory:standing(Last, {X, Y}, Heading),
    case is_standing(Piece) of
        true -> {same, {Last, Pose, Piece}};
        false -> {Standing, {Last, Pose, Standing}}
    end.

is_near({X, Y, Heading}, {X1, Y1, Heading1}) ->
    abs(X - X1) < ?NEAR_MM andalso abs(Y - Y1) < ?NEAR_MM andalso
        abs(starl_geometry:normalise(Heading - Heading1)) < ?NEAR_RAD.

%% On an arc the chord points half way between the headings; a body that has slipped aside has moved
%% along the chord.
between(T0, {X0, Y0, H0}, T1, {X1, Y1, H1}) ->
    S = (T1 - T0) / 1.0e6,
    Turn = starl_geometry:normalise(H1 - H0),
    {DX, DY} = {X1 - X0, Y1 - Y0},
    Chord = math:sqrt(DX * DX + DY * DY),
    Ahead = DX * math:cos(H0 + Turn / 2) + DY * math:sin(H0 + Turn / 2),
    case Chord - abs(Ahead) < ?NEAR_MM of
        true ->
            starl_trajectory:piece(T0, {X0, Y0}, H0, Ahead / sinc(Turn / 2) / S, Turn / S);
        false ->
            starl_trajectory:piece(T0, {X0, Y0}, math:atan2(DY, DX), Chord / S, 0.0)
    end.

sinc(U) when abs(U) < 1.0e-4 -> 1.0;
sinc(U) -> math:sin(U) / U.
