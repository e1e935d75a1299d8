%% @doc Converts a pose in space, as a motion capture system measures it, into the pose of a robot
%% on the floor.
%%
%% <em>Axes.</em> The floor has x to the right, y up (on paper) and z towards the ceiling. `{A, B,
%% C}' says where these three are in the system. `{1, 2, 3}' is for a system whose third axis points
%% to the ceiling. `{1, -3, 2}' is for a system whose second axis does: our x is its first, our y is
%% its third reversed, our z is its second. A choice that would mirror the floor is refused.
%%
%% <em>Heading.</em> A rigid body has the system's axes when it is not rotated; then the robot looks
%% along the floor's x. The heading is the direction on the floor in which the robot looks, even if
%% it is tilted. A rotation about the system's vertical axis alone would not give that.
-module(starl_live_floor).

-export([axes/1, pose/3]).

-export_type([axes/0, vector/0, rotation/0, reason/0]).

%% The number of an axis of the system for each axis of the floor, negative if it is reversed.
-type axes() :: {axis(), axis(), axis()}.
-type axis() :: -3..-1 | 1..3.

%% Lengths in millimetres.
-type vector() :: {float(), float(), float()}.

%% Angles about the body's own x, y and z, in this order, in radians; or a unit quaternion.
-type rotation() ::
    {euler, float(), float(), float()}
    | {quaternion, X :: float(), Y :: float(), Z :: float(), W :: float()}.

%% A place far off every floor; a rotation that is none; a robot that does not stand on its wheels.
-type reason() :: absurd | no_rotation | tilted.

%% The largest coordinate (mm) and angle (rad) that is believed.
-define(FAR_MM, 1.0e6).
-define(TURNS, 100.0).
%% A quaternion in single precision is of length 1 to within far less than this.
-define(UNIT, 0.01).
%% The cosine of the largest tilt, 30 degrees.
-define(UPRIGHT, 0.866).

%% @doc Checks axes: one line on what is wrong with them.
-spec axes(term()) -> ok | {error, iolist()}.
axes({A, B, C} = Axes) when is_integer(A), is_integer(B), is_integer(C) ->
    case {lists:sort([abs(A), abs(B), abs(C)]), determinant(Axes)} of
        {[1, 2, 3], 1} ->
            ok;
        {[1, 2, 3], -1} ->
            {error, io_lib:format("axes ~w mirror the floor: reverse the sign of one", [Axes])};
        {_, _} ->
            unknown_axes(Axes)
    end;
axes(Axes) ->
    unknown_axes(Axes).

unknown_axes(Axes) ->
    {error,
        io_lib:format("axes are three of 1, 2, 3, each once, like {1, -3, 2}; not ~0p", [Axes])}.

%% Of a permutation with signs.
determinant({A, B, C}) ->
    Even = lists:member({abs(A), abs(B), abs(C)}, [{1, 2, 3}, {2, 3, 1}, {3, 1, 2}]),
    Sign = sign(A) * sign(B) * sign(C),
    case Even of
        true -> Sign;
        false -> -Sign
    end.

sign(N) when N < 0 -> -1;
sign(_) -> 1.

%% @doc The pose on the floor of a body at this place, rotated like this.
-spec pose(axes(), vector(), rotation()) -> {ok, starl:pose()} | {error, reason()}.
pose(Axes, Place, Rotation) ->
    case is_near(Place) andalso is_rotation(Rotation) of
        true -> on_floor(Axes, Place, Rotation);
        false -> {error, refused(Place)}
    end.

refused(Place) ->
    case is_near(Place) of
        true -> no_rotation;
        false -> absurd
    end.

is_near({X, Y, Z}) -> abs(X) =< ?FAR_MM andalso abs(Y) =< ?FAR_MM andalso abs(Z) =< ?FAR_MM.

is_rotation({euler, A, B, C}) ->
    abs(A) =< ?TURNS andalso abs(B) =< ?TURNS andalso abs(C) =< ?TURNS;
is_rotation({quaternion, X, Y, Z, W}) ->
    lists:max([abs(X), abs(Y), abs(Z), abs(W)]) < 2.0 andalso
        abs(X * X + Y * Y + Z * Z + W * W - 1.0) < ?UNIT.

on_floor({AlongX, _, AlongZ} = Axes, Place, Rotation) ->
    {X, Y, _} = to_floor(Axes, Place),
    {LookX, LookY, _} = to_floor(Axes, rotate(Rotation, unit(AlongX))),
    case to_floor(Axes, rotate(Rotation, unit(AlongZ))) of
        {_, _, Up} when Up >= ?UPRIGHT -> {ok, {X, Y, math:atan2(LookY, LookX)}};
        _ -> {error, tilted}
    end.

unit(1) -> {1.0, 0.0, 0.0};
unit(2) -> {0.0, 1.0, 0.0};
unit(3) -> {0.0, 0.0, 1.0};
unit(Reversed) -> scale(-1.0, unit(-Reversed)).

to_floor({A, B, C}, V) -> {along(A, V), along(B, V), along(C, V)}.

along(Axis, V) when Axis < 0 -> -element(-Axis, V);
along(Axis, V) -> element(Axis, V).

%% About the body's own axes, first x: so the vector is rotated about z first.
rotate({euler, A, B, C}, V) ->
    about_x(A, about_y(B, about_z(C, V)));
rotate({quaternion, X, Y, Z, W}, V) ->
    Q = {X, Y, Z},
    Twice = scale(2.0, cross(Q, V)),
    add(V, add(scale(W, Twice), cross(Q, Twice))).

about_x(A, {X, Y, Z}) ->
    {X, Y * math:cos(A) - Z * math:sin(A), Y * math:sin(A) + Z * math:cos(A)}.

about_y(B, {X, Y, Z}) ->
    {X * math:cos(B) + Z * math:sin(B), Y, Z * math:cos(B) - X * math:sin(B)}.

about_z(C, {X, Y, Z}) ->
    {X * math:cos(C) - Y * math:sin(C), X * math:sin(C) + Y * math:cos(C), Z}.

scale(S, {X, Y, Z}) -> {S * X, S * Y, S * Z}.

add({A, B, C}, {X, Y, Z}) -> {A + X, B + Y, C + Z}.

cross({A, B, C}, {X, Y, Z}) -> {B * Z - C * Y, C * X - A * Z, A * Y - B * X}.
