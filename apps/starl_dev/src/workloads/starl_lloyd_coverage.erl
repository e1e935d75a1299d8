%% @doc The coverage workload (Lloyd's algorithm): robots that begin crowded in a corner spread evenly over the
%% floor. Twice a second each looks at its neighbours (`starl:neighbours/2') and drives towards the middle of the part of
%% its surroundings that is nearer to it than to any of them, its Voronoi cell. Nothing is sent.
-module(starl_lloyd_coverage).
-behaviour(starl_app).
-behaviour(starl_scene).

-export([options/0, scene/1, init/2, step/2, report/2]).
-export([middle/4]).

%% How far it looks, and the floor that each robot has in the end (mm); a cell is taken at points so far
%% apart, up to half of the look.
-define(SEES_MM, 2000).
-define(SHARE_MM, 800).
-define(SAMPLE_MM, 200).
-define(SPEED, 200).
-define(ROUND_MS, 500).

%% `seen': at all looks together.
-type state() :: #{
    side := float(),
    left := non_neg_integer(),
    first := float() | none,
    last := float(),
    seen := non_neg_integer()
}.

-spec options() -> [starl_options:option()].
options() ->
    [
        {rounds, {integer, 1, 1000000}, 40, "looks of each robot"},
        {begins, {one_of, [corner, everywhere]}, corner, "where the robots begin"}
    ].

%% @doc All begin in the lower left quarter of a square floor, or evenly everywhere: then teams of every size have one
%% density from the beginning.
-spec scene(starl_scene:context()) -> {ok, starl_scene:t()}.
scene(#{robots := Ids, options := #{rounds := Rounds, begins := Begins}}) ->
    Row = ceil(math:sqrt(length(Ids))),
    Side = float(?SHARE_MM * Row),
    Part = part(Begins),
    Place = fun(K) -> (K + 0.5) * Side * Part / Row end,
    {ok, #{
        app => {sequential, ?MODULE, {Side, Rounds}},
        poses => maps:from_list([
            {Id, {Place(K rem Row), Place(K div Row), 0.0}}
         || {K, Id} <- lists:enumerate(0, Ids)
        ])
    }}.

part(corner) -> 0.5;
part(everywhere) -> 1.0.

-spec init(starl:robot(), {Side :: float(), Rounds :: pos_integer()}) -> state().
init(_Robot, {Side, Rounds}) ->
    #{side => Side, left => Rounds, first => none, last => 0.0, seen => 0}.

-spec step(starl:robot(), state()) ->
    {continue, state()} | {done, {float() | none, float(), non_neg_integer()}}.
step(Robot, #{left := 0, first := First, last := Last, seen := Seen}) ->
    _ = starl:stop(Robot),
    {done, {First, Last, Seen}};
step(Robot, #{side := Side, left := Left} = State) ->
    Next =
        case {starl:position(Robot), starl:neighbours(Robot, ?SEES_MM)} of
            {{ok, {X, Y, _}}, {ok, Near}} ->
                {CX, CY} = middle({X, Y}, [O || #{offset := O} <- Near], ?SEES_MM / 2, Side),
                Mm = starl_geometry:distance({X, Y}, {CX, CY}),
                Part = ?SPEED / max(float(?SPEED), Mm),
                _ = starl:velocity(Robot, {Part * (CX - X), Part * (CY - Y)}, 3 * ?ROUND_MS),
                told(Mm, length(Near), State);
            _Unknown ->
                State
        end,
    ok = starl:sleep(Robot, ?ROUND_MS),
    {continue, Next#{left := Left - 1}}.

told(Mm, N, #{first := none} = State) -> told(Mm, N, State#{first := Mm});
told(Mm, N, #{seen := Seen} = State) -> State#{last := Mm, seen := Seen + N}.

%% @doc The middle of the part of the floor, up to this distance, that is nearer to a place than to any of these
%% others, which are given by their offsets.
-spec middle(starl_geometry:point(), [starl_geometry:point()], Reach :: number(), Side :: number()) ->
    starl_geometry:point().
middle({X, Y}, Others, Reach, Side) ->
    N = trunc(Reach / ?SAMPLE_MM),
    Steps = [I * ?SAMPLE_MM || I <- lists:seq(-N, N)],
    Own = [
        {DX, DY}
     || DX <- Steps,
        X + DX >= 0,
        X + DX =< Side,
        DY <- Steps,
        Y + DY >= 0,
        Y + DY =< Side,
        DX * DX + DY * DY =< Reach * Reach,
        is_own(DX, DY, Others)
    ],
    %% its own place is always its own
    Count = length(Own),
    {X + lists:sum([DX || {DX, _} <- Own]) / Count, Y + lists:sum([DY || {_, DY} <- Own]) / Count}.

is_own(DX, DY, [{OX, OY} | Others]) ->
    2 * (DX * OX + DY * OY) =< OX * OX + OY * OY andalso is_own(DX, DY, Others);
is_own(_DX, _DY, []) ->
    true.

%% @doc The mean distance of a robot from the middle of its cell at its first and at its last look (mm), how many
%% others a look shows, and the part of the robots that is in the emptiest quarter of the floor.
-spec report(starl_scene:t(), starl_scene:outcome()) -> starl_scene:report().
report(#{app := {_, _, {Side, Rounds}}}, #{robots := Robots}) ->
    Own = [Ends || {_, #{result := {done, {First, _, _} = Ends}}} <- Robots, First =/= none],
    N = max(1, length(Own)),
    Half = Side / 2,
    Quarters = [{X > Half, Y > Half} || {_, #{pose := {X, Y, _}}} <- Robots],
    Least = lists:min([
        length([Q || Q <- Quarters, Q =:= {Right, Up}])
     || Right <- [false, true], Up <- [false, true]
    ]),
    #{
        figures => [
            {first_mm, lists:sum([First || {First, _, _} <- Own]) / N},
            {last_mm, lists:sum([Last || {_, Last, _} <- Own]) / N},
            {seen, lists:sum([Seen || {_, _, Seen} <- Own]) / N / Rounds},
            {emptiest_quarter, Least / length(Robots)}
        ]
    }.
