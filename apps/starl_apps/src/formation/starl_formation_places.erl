%% @doc The places of a formation: in a circle or in a line round the middle of the floor, each formation turned
%% a little further than the one before. A pure module; lengths are millimetres.
-module(starl_formation_places).

-export([order/2, places/4, way_round/4]).

-export_type([form/0]).

-type form() :: #{shapes := circle | line | both, spacing := number(), atom() => term()}.

%% A formation is turned by this against the one before (rad).
-define(TURN, (math:pi() / 6)).
%% What stays free at the edge of the floor, and beside a way round.
-define(EDGE_MM, 500).
-define(SIDE_MM, 200).
%% The corners of a way round are at most so far apart, seen from the middle (rad).
-define(CORNER, (math:pi() / 4)).

%% @doc The robots in the order of their direction from the middle of all: on the way to places in that order
%% they seldom meet.
-spec order([starl:robot_id(), ...], #{starl:robot_id() => starl:pose()}) ->
    [starl:robot_id(), ...].
order(Ids, Poses) ->
    Known = maps:values(Poses),
    N = max(1, length(Known)),
    {CX, CY} = {lists:sum([X || {X, _, _} <- Known]) / N, lists:sum([Y || {_, Y, _} <- Known]) / N},
    Direction = fun(Id) ->
        {X, Y, _} = maps:get(Id, Poses, {CX, CY, 0.0}),
        math:atan2(Y - CY, X - CX)
    end,
    [Id || {_, Id} <- lists:sort([{Direction(Id), Id} || Id <- Ids])].

%% @doc The places of a round, in the order of the robots.
-spec places(Round :: pos_integer(), N :: pos_integer(), Floor :: {number(), number()}, form()) ->
    [starl_geometry:point(), ...].
places(Round, N, {W, H}, #{spacing := Spacing} = Form) ->
    Room = min(W, H) / 2 - ?EDGE_MM,
    Turn = Round * ?TURN,
    Angles = [Turn + (2 * I + 1 - N) * math:pi() / N || I <- lists:seq(0, N - 1)],
    Polar =
        case shape(Round, Form) of
            circle ->
                Radius = min(Room, Spacing * N / (2 * math:pi())),
                [{Radius, Angle} || Angle <- Angles];
            line ->
                Half = min(Room, Spacing * (N - 1) / 2),
                [{Half * Part, Turn} || Part <- ranks([math:cos(A - Turn) || A <- Angles])]
        end,
    [{W / 2 + R * math:cos(Angle), H / 2 + R * math:sin(Angle)} || {R, Angle} <- Polar].

shape(Round, #{shapes := both}) when Round rem 2 =:= 1 -> circle;
shape(_Round, #{shapes := both}) -> line;
shape(_Round, #{shapes := Shape}) -> Shape.

%% From -1 to 1, evenly, in the order of these numbers.
ranks([_]) ->
    [0.0];
ranks(Numbers) ->
    N = length(Numbers),
    Sorted = [I || {_, I} <- lists:sort(lists:zip(Numbers, lists:seq(1, N)))],
    Parts = lists:zip(Sorted, [(2 * K - N - 1) / (N - 1) || K <- lists:seq(1, N)]),
    [Part || {_, Part} <- lists:sort(Parts)].

%% @doc The way from a point to a place outside of all places, at this distance from them if the floor allows it: out, round the
%% shorter side, and in.
-spec way_round(
    From :: starl_geometry:point(),
    Place :: starl_geometry:point(),
    {[starl_geometry:point(), ...], Mm :: number()},
    Floor :: {number(), number()}
) -> [starl_geometry:point(), ...].
way_round({X, Y}, {PX, PY} = Place, {Places, Mm}, {W, H}) ->
    Middle = {W / 2, H / 2},
    Radius = Mm + lists:max([starl_geometry:distance(P, Middle) || P <- Places]),
    Begin = math:atan2(Y - H / 2, X - W / 2),
    Turn = starl_geometry:angle_diff(math:atan2(PY - H / 2, PX - W / 2), Begin),
    N = max(1, ceil(abs(Turn) / ?CORNER)),
    Corner = fun(I) ->
        Angle = Begin + Turn * I / N,
        {
            within(W / 2 + Radius * math:cos(Angle), W), within(H / 2 + Radius * math:sin(Angle), H)
        }
    end,
    [Corner(I) || I <- lists:seq(0, N)] ++ [Place].

within(X, Size) -> max(?SIDE_MM, min(Size - ?SIDE_MM, X)).
