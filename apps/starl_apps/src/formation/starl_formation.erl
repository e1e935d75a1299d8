%% @doc Formation: an elected leader gives each robot a place ({@link starl_decision}), and the team
%% drives into circles and lines in turn. Each formation is turned a little further. At a barrier
%% each robot waits until all stand in their places. A robot that waits long checks where it stands,
%% because wrong positions may have led it to a place that another robot needs. Robots that already
%% stand may then be in its way ({@link starl_approach}).
%%
%% Measure: `error_mm', the distance of a robot from its place. Trace: {@link event()} (see
%% {@link starl_formation_monitor}).
-module(starl_formation).
-behaviour(starl_app).

-export([init/2, step/2]).
-export([options/0, blocks/0, monitors/1, guarantees/0, measures/0, report/2, knows_walls/0]).
-export([by_direction/2, places/4, way_round/4]).

-export_type([event/0, form/0]).

%% The robot stands in its place of this round; it knows that all do.
-type event() ::
    {in_place, Round :: pos_integer(), starl_geometry:point()} | {formed, Round :: pos_integer()}.

-type state() :: #{
    next := order | round | {drive | wait, Round :: pos_integer(), starl_geometry:point()},
    order => [starl:robot_id(), ...],
    %% of this round, in that order; and the size of the floor
    places => [starl_geometry:point(), ...],
    size => {number(), number()},
    atom() => term()
}.

%% The pace of control (ms), and the fastest drive (mm/s).
-define(PACE_MS, 250).
-define(SPEED, 300).
%% From where a robot avoids another: the distance of their centres (mm).
-define(SHY_MM, 1000).
%% A formation stands so long; the patience of a wait for the others (ms).
-define(HOLD_MS, 2000).
-define(PATIENCE_MS, 10000).

-type form() :: #{shapes := circle | line | both, spacing := number(), atom() => term()}.

%% A formation is turned by this against the one before (rad).
-define(TURN, (math:pi() / 6)).
%% The election and the register of the order.
-define(DECISION, {formation, order}).
%% What stays free at the edge of the floor, and beside a way round.
-define(EDGE_MM, 500).
-define(SIDE_MM, 200).
%% The corners of a way round are at most so far apart, seen from the middle (rad).
-define(CORNER, (math:pi() / 4)).

-spec options() -> [starl_options:option()].
options() ->
    [
        {shapes, {one_of, [circle, line, both]}, both, "the shapes, one after the other"},
        {rounds, {integer, 1, 1000}, 4, "how many formations, one after the other"},
        {spacing, {number, 400, 5000}, 900, "the distance of neighbours, where there is room, mm"},
        {tolerance, {number, 10, 1000}, 50, "a robot this near to its place is in it, mm"}
    ].

-spec blocks() -> [starl_block:entry()].
blocks() -> [starl_election, starl_registers, starl_barrier].

-spec monitors(starl_scene:context()) -> [{module(), map()}].
monitors(#{robots := Ids, options := #{tolerance := Mm}}) ->
    [{starl_formation_monitor, #{robots => Ids, tolerance_mm => Mm}}].

-spec measures() -> [{atom(), string()}].
measures() -> [{error_mm, "distance from the place in the formation, mm"}].

%% @doc Robots drive as if the floor were free.
-spec knows_walls() -> false.
knows_walls() -> false.

%% @doc The guarantees for the users of a formation.
-spec guarantees() -> [starl_guarantee:t()].
guarantees() ->
    [
        {formed, safety,
            "who first takes a formation for formed is right: every robot is in its place", [
                {barrier, together}, positions, store
            ]},
        {next, progress, "the next formation is formed within three minutes", [
            alive, delivery, store, {barrier, passed}, {motion, arrives}
        ]}
    ].

-spec init(starl:robot(), map()) -> state().
init(_Robot, Options) -> Options#{next => order}.

-spec step(starl:robot(), state()) -> {continue, state()} | {done, Rounds :: pos_integer()}.
step(Robot, #{next := order} = State) ->
    Order = starl_decision:await(Robot, ?DECISION, fun() -> order(Robot) end),
    {continue, State#{next := round, order => Order}};
step(Robot, #{next := round} = State) ->
    next_round(Robot, State);
step(Robot, #{next := {drive, Round, Place}} = State) ->
    ok = starl_approach:arrive(Robot, Place, driving(Place, State)),
    ok = starl:trace(Robot, {in_place, Round, Place}),
    {continue, State#{next := {wait, Round, Place}}};
step(Robot, #{next := {wait, Round, Place}} = State) ->
    _ = starl:stop(Robot),
    case starl_barrier:sync(Robot, formation, ?PATIENCE_MS) of
        ok ->
            ok = starl:trace(Robot, {formed, Round}),
            ok = starl:sleep(Robot, ?HOLD_MS),
            {continue, State#{next := round}};
        {error, _} ->
            {continue, back_to_place(Robot, Round, Place, State)}
    end.

next_round(Robot, #{rounds := Rounds, order := Order} = State) ->
    case {starl_barrier:round(Robot, formation), starl:floor(Robot)} of
        {{ok, Round}, _} when Round > Rounds ->
            {done, Rounds};
        {{ok, Round}, {ok, #{size := Size}}} ->
            Places = places(Round, length(Order), Size, State),
            Next = State#{places => Places, size => Size},
            {continue, Next#{next := {drive, Round, place(Robot, Places, Order)}}};
        _ ->
            {continue, State}
    end.

%% A robot that is a little off only measures a little otherwise. Perhaps the others have another order.
back_to_place(Robot, Round, Place, #{tolerance := Tolerance, order := Order} = State) ->
    case starl_decision:latest(Robot, ?DECISION, Order) of
        Order ->
            case is_away(starl:position(Robot), Place, 2 * Tolerance) of
                true -> State#{next := {drive, Round, Place}};
                false -> State
            end;
        Other ->
            State#{next := round, order := Other}
    end.

is_away({ok, {X, Y, _}}, Place, Mm) -> starl_geometry:distance(Place, {X, Y}) > Mm;
is_away({error, _}, _Place, _Mm) -> false.

order(Robot) ->
    case starl:positions(Robot) of
        {ok, Poses} ->
            Text = io_lib:format("robot ~b leads", [starl:id(Robot)]),
            ok = starl:draw(Robot, #{key => leader, text => Text, at => {200, 200}}),
            {ok, by_direction(starl:participants(Robot), Poses)};
        {error, _} ->
            unknown
    end.

place(Robot, Places, Order) ->
    {_, Place} = lists:keyfind(starl:id(Robot), 1, lists:zip(Order, Places)),
    ok = starl:draw(Robot, #{key => place, area => starl_drawing:circle(Place, 250)}),
    Place.

%% A way round leads round all places.
driving(Place, #{spacing := Spacing, tolerance := Mm, places := Places, size := Size}) ->
    Shy = min(?SHY_MM, 0.9 * Spacing),
    #{
        within_mm => Mm,
        speed => ?SPEED,
        shy_mm => Shy,
        pace_ms => ?PACE_MS,
        measure => error_mm,
        round => fun(At) -> way_round(At, Place, {Places, Shy}, Size) end
    }.

%% -- the report -----------------------------------------------------------------------------

%% @doc The formations, and the greatest distance of a robot from its place when one was formed.
-spec report(starl_scene:t(), starl_scene:outcome()) -> starl_scene:report().
report(_Scene, #{monitors := #{starl_formation_monitor := #{formed := Formed, worst_mm := Mm}}}) ->
    #{
        figures => [{formations, Formed}, {worst_mm, Mm}],
        formats => #{
            worst_mm => #{decimals => 1, label => "distance from the place when formed, mm"}
        },
        done => io_lib:format("~b formations", [Formed])
    }.

%% -- the places -------------------------------------------------------------------------------

%% The places of a formation: in a circle or in a line round the middle of the floor, each formation turned
%% a little further than the one before. A pure module; lengths are millimetres.

%% @doc The robots in the order of their direction from the middle of all: on the way to places in that order
%% they seldom meet.
-spec by_direction([starl:robot_id(), ...], #{starl:robot_id() => starl:pose()}) ->
    [starl:robot_id(), ...].
by_direction(Ids, Poses) ->
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
