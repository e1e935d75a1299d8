%% @doc The two wheels of an emulated Create: their commanded and their true speeds, encoders,
%% distance and angle. Speeds are those of the left and the right wheel, mm/s.
-module(starl_create_wheels).

-export([new/2, command/2, turning/2, hold/2, turn/1, commanded/1, told/1]).
-export([pass/2, readings/1, read/2, travelled/1]).
-export([circle/3, mm_per_count/0, axle_mm/1]).

-export_type([t/0, speeds/0]).

-type speeds() :: {Left :: number(), Right :: number()}.

-record(wheels, {
    axle_mm :: number(),
    quirks :: starl_create_quirks:t(),
    commanded = {0, 0} :: speeds(),
    %% what the body was told last, and how the wheels really turn
    told = {0.0, 0.0} :: speeds(),
    turning = {0.0, 0.0} :: speeds(),
    %% does something hold the body, although the wheels are to turn?
    is_held = false :: boolean(),
    %% what the wheels have turned, as encoders see it (mm); since the last reading
    left = 0.0 :: float(),
    right = 0.0 :: float(),
    distance = 0.0 :: float(),
    angle = 0.0 :: float(),
    %% never reset: for waits (mm, degrees)
    total = {0.0, 0.0} :: {float(), float()}
}).

-opaque t() :: #wheels{}.

-define(FASTEST, 500).
-define(PI, 3.141592653589793).

%% @doc Wheels at rest.
-spec new(AxleMm :: number(), starl_create_quirks:t()) -> t().
new(Axle, Quirks) -> #wheels{axle_mm = Axle, quirks = Quirks}.

%% @doc The distance of the wheels (libcreate; Open Interface 2016).
-spec axle_mm(starl_create_packet:model()) -> pos_integer().
axle_mm(1) -> 258;
axle_mm(2) -> 235.

%% @doc The way of a wheel between two counts of its encoder, mm: 508.8 counts each turn, of 72 mm.
-spec mm_per_count() -> float().
mm_per_count() -> ?PI * 72.0 / 508.8.

%% @doc The speeds of the wheels on a circle of this radius (mm): Drive.
-spec circle(number(), starl_create_command:radius(), t()) -> speeds().
circle(V, straight, _Wheels) ->
    {V, V};
circle(V, clockwise, _Wheels) ->
    {V, -V};
circle(V, counterclockwise, _Wheels) ->
    {-V, V};
circle(V, 0, _Wheels) ->
    {V, V};
circle(V, Radius, #wheels{axle_mm = Axle}) ->
    Part = Axle / (2 * Radius),
    limited({V * (1 - Part), V * (1 + Part)}).

limited({Left, Right}) ->
    case max(abs(Left), abs(Right)) of
        Most when Most > ?FASTEST -> {Left * ?FASTEST / Most, Right * ?FASTEST / Most};
        _ -> {Left, Right}
    end.

%% @doc The wheels are to turn at these speeds.
-spec command(speeds(), t()) -> t().
command(Speeds, Wheels) -> Wheels#wheels{commanded = Speeds}.

%% @doc The speeds that were commanded last.
-spec commanded(t()) -> speeds().
commanded(#wheels{commanded = Commanded}) -> Commanded.

%% @doc The last command to the body.
-spec told(t()) -> speeds().
told(#wheels{told = Told}) -> Told.

%% @doc The command to the body, if that has changed. Unless the body reports otherwise, the wheels
%% turn as commanded.
-spec turn(t()) -> {same | speeds(), t()}.
turn(#wheels{commanded = {L, R}, told = Told, quirks = #{speed_step := Step}} = Wheels) ->
    case {stepped(L, Step), stepped(R, Step)} of
        Told -> {same, Wheels};
        New -> {New, Wheels#wheels{told = New, turning = New, is_held = false}}
    end.

stepped(V, Step) when Step == 0 -> float(V);
stepped(V, Step) -> float(Step * round(V / Step)).

%% @doc The body says how its wheels turn.
-spec turning(speeds(), t()) -> t().
turning(Speeds, Wheels) -> Wheels#wheels{turning = Speeds}.

%% @doc Handles that something blocks the body: the wheels stall. When the way is free, the body
%% gets its command again.
-spec hold(boolean(), t()) -> t().
hold(true, Wheels) -> Wheels#wheels{turning = {0.0, 0.0}, is_held = true};
hold(false, #wheels{is_held = true} = W) -> W#wheels{told = {0.0, 0.0}, is_held = false};
hold(false, Wheels) -> Wheels.

%% @doc Time passes.
-spec pass(Us :: non_neg_integer(), t()) -> t().
pass(_Us, #wheels{turning = {L, R}} = Wheels) when L == 0, R == 0 -> Wheels;
pass(Us, #wheels{turning = {L, R}, axle_mm = Axle, quirks = Quirks} = Wheels) ->
    #{odometry := Factor, angle_factor := AngleFactor} = Quirks,
    DL = Factor * L * Us / 1.0e6,
    DR = Factor * R * Us / 1.0e6,
    Mm = (DL + DR) / 2,
    Degrees = (DR - DL) / Axle * 180 / ?PI,
    #wheels{left = Left, right = Right, distance = D, angle = A, total = {TD, TA}} = Wheels,
    Wheels#wheels{
        left = Left + DL,
        right = Right + DR,
        distance = D + grown(Mm, Quirks),
        angle = A + AngleFactor * signed(Degrees, Quirks),
        total = {TD + Mm, TA + Degrees}
    }.

grown(Mm, #{backward_grows := true}) -> abs(Mm);
grown(Mm, _) -> Mm.

signed(Degrees, #{yaw_inverted := true}) -> -Degrees;
signed(Degrees, _) -> Degrees.

%% @doc The whole way (mm) and turn (degrees) so far.
-spec travelled(t()) -> {float(), float()}.
travelled(#wheels{total = Total}) -> Total.

%% @doc What the sensors show.
-spec readings(t()) -> starl_create_packet:readings().
readings(#wheels{left = Left, right = Right, distance = D, angle = A} = Wheels) ->
    #wheels{commanded = {L, R}} = Wheels,
    #{
        left_encoder => counts(Left),
        right_encoder => counts(Right),
        distance => bounded(D),
        angle => bounded(A),
        left_velocity => round(L),
        right_velocity => round(R),
        overcurrents => overcurrents(Wheels)
    }.

counts(Mm) -> floor(Mm / mm_per_count()) band 16#FFFF.

bounded(X) -> max(-32768, min(32767, trunc(X))).

%% A wheel that is told to turn and does not.
overcurrents(#wheels{told = {L, R}, turning = {TL, TR}}) ->
    bit(16, L, TL) + bit(8, R, TR).

bit(Bit, Told, Turning) when abs(Told) > 0, Turning == 0 -> Bit;
bit(_, _, _) -> 0.

%% @doc These packets have been read: distance and angle begin anew.
-spec read([starl_create_packet:name()], t()) -> t().
read(Names, Wheels) ->
    lists:foldl(fun reset/2, Wheels, Names).

reset(distance, #wheels{distance = D, quirks = Quirks} = Wheels) ->
    Wheels#wheels{distance = left(D, Quirks)};
reset(angle, #wheels{angle = A, quirks = Quirks} = Wheels) ->
    Wheels#wheels{angle = left(A, Quirks)};
reset(_, Wheels) ->
    Wheels.

left(X, #{fraction := kept}) -> X - bounded(X);
left(_X, #{fraction := lost}) -> 0.0.
