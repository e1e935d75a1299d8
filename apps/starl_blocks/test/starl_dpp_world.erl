%% @doc Robots that drive a plan's assignments in an abstract world, to test and measure the plan.
%%
%% Each robot drives at 500 mm/s and turns on the spot at 180 degrees per second; a request takes
%% 0.08 s. After every step an oracle that shares no code with the plan's own conflict keeping
%% checks that all reservations are at least 2R apart and that every robot is inside its own.
-module(starl_dpp_world).
-export([run/1, disjoint/2]).

-record(robot, {
    at :: starl_geometry:point(),
    heading = 0.0 :: float(),
    leg = 0 :: non_neg_integer(),
    left = [] :: list(),
    index = 0 :: non_neg_integer(),
    state = asking :: asking | moving | waiting | dead
}).
-record(world, {
    plan :: starl_dpp_plan:t(),
    robots :: #{pos_integer() => #robot{}},
    queue = gb_sets:new() :: gb_sets:set(),
    seq = 0 :: non_neg_integer(),
    now = 0.0 :: float(),
    rand :: rand:state(),
    options :: map(),
    inked = [] :: list(),
    end_ink = 0.0 :: float(),
    stats = #{} :: map()
}).

-define(SPEED, 500.0).
-define(OMEGA, 3.14159265).
-define(ASK, 0.08).

%% Runs until the picture is complete or nobody can move. Options: plan (what starl_dpp_plan:new
%% wants), at (start places; the spots by default), interrupt (probability per segment), deaths
%% ([{Seconds, Robot}]), make_way, seed, check, trace (a fun called at each request). Answers a map
%% of figures.
run(#{plan := Config} = Options) ->
    {ok, Plan0} = starl_dpp_plan:new(Config),
    Ids = lists:usort(maps:get(robots, Config)),
    At = maps:get(at, Options, maps:from_list([{Id, starl_dpp_plan:spot(Id, Plan0)} || Id <- Ids])),
    Plan = lists:foldl(
        fun(Id, Acc) -> starl_dpp_plan:standing(Id, maps:get(Id, At), Acc) end,
        Plan0,
        Ids
    ),
    World0 = #world{
        plan = Plan,
        options = Options,
        robots = maps:from_list([{Id, #robot{at = maps:get(Id, At)}} || Id <- Ids]),
        rand = rand:seed_s(exsss, maps:get(seed, Options, 1))
    },
    World1 = lists:foldl(fun(Id, W) -> later(0.0, {ask, Id}, W) end, World0, Ids),
    World2 = lists:foldl(
        fun({T, Id}, W) -> later(T, {die, Id}, W) end,
        World1,
        maps:get(deaths, Options, [])
    ),
    figures(loop(World2), length(Ids)).

figures(#world{plan = Plan, end_ink = T, stats = Stats, inked = Inked} = World, N) ->
    Total = maps:get(total, starl_dpp_plan:counts(Plan)),
    Ink = lists:sum([
        starl_geometry:length(starl_dpp_plan:target(E, Plan))
     || E <- lists:seq(1, Total)
    ]),
    honest_ink(Inked, Plan),
    check_all(World),
    Stats#{
        makespan => T,
        ratio => T / max(0.001, Ink / N / ?SPEED),
        ink => Ink,
        plan => Plan,
        counts => starl_dpp_plan:counts(Plan),
        live => [
            Id
         || {Id, #robot{state = S}} <- lists:sort(maps:to_list(World#world.robots)),
            S =/= dead
        ]
    }.

%% Every edge that counts as painted was driven with the pen down, from end to end.
honest_ink(Inked, Plan) ->
    Driven = maps:from_list(Inked),
    [
        case Driven of
            #{E := {P, Q}} ->
                same({P, Q}, {A, B}) orelse error({painted_beside, E, {P, Q}, {A, B}});
            #{} ->
                error({not_painted, E, {A, B}})
        end
     || E <- starl_dpp_plan:painted_since(0, Plan), {A, B} <- [starl_dpp_plan:target(E, Plan)]
    ].

%% In either direction; a robot may begin a few mm beside.
same({P, Q}, {A, B}) ->
    Near = fun(X, Y) -> starl_geometry:distance(X, Y) =< 3.1 end,
    (Near(P, A) andalso Near(Q, B)) orelse (Near(P, B) andalso Near(Q, A)).

%%% Events

loop(#world{queue = Queue} = World) ->
    case gb_sets:is_empty(Queue) of
        true ->
            quiet(World);
        false ->
            {{T, _, Event}, Rest} = gb_sets:take_smallest(Queue),
            loop(event(Event, World#world{queue = Rest, now = T}))
    end.

later(Delay, Event, #world{queue = Queue, seq = Seq, now = Now} = World) ->
    World#world{queue = gb_sets:add({Now + Delay, Seq, Event}, Queue), seq = Seq + 1}.

%% Nobody moves and nobody asks.
quiet(#world{plan = Plan0, robots = Robots} = World) ->
    Waiting = [Id || {Id, #robot{state = waiting}} <- lists:sort(maps:to_list(Robots))],
    #{free := Free} = starl_dpp_plan:counts(Plan0),
    Resolve = fun() -> starl_dpp_assign:resolve(Waiting, Plan0) end,
    case Free > 0 andalso timed(resolve, Resolve, World) of
        false ->
            World;
        {{[], _}, World1} ->
            count(stuck, World1);
        {{Moves, Plan1}, World1} ->
            World2 = lists:foldl(
                fun({Id, Path}, W) -> depart(Id, Path, sent(Path, W)) end,
                count(deadlocks, World1#world{plan = Plan1}),
                Moves
            ),
            loop(World2)
    end.

sent(Path, #world{stats = Stats} = World) ->
    case lists:any(fun({_, Pen}) -> Pen =/= up end, Path) of
        true -> World#world{stats = Stats#{row => 0}};
        false -> retreat(World)
    end.

%% Moves that do not paint must be few between two that do.
retreat(#world{robots = Robots, stats = Stats} = World) ->
    Row = maps:get(row, Stats, 0) + 1,
    Row > 2 * maps:size(Robots) andalso error({unbounded_retreats, Row}),
    count(retreats, World#world{stats = Stats#{row => Row}}).

event({ask, Id}, #world{robots = Robots} = World) ->
    case maps:get(Id, Robots) of
        #robot{state = asking} -> ask(Id, World);
        _ -> World
    end;
event({die, Id}, World) ->
    {_, Robot} = robot(Id, World),
    put_robot(Id, Robot#robot{state = dead}, World);
event({arrive, Id, Leg}, World) ->
    case robot(Id, World) of
        {_, #robot{state = moving, leg = Leg} = Robot} -> arrive(Id, Robot, World);
        _ -> World
    end;
event({halt, Id, Leg, P}, World) ->
    case robot(Id, World) of
        {_, #robot{state = moving, leg = Leg} = Robot} -> stand(Id, P, Robot, World);
        _ -> World
    end.

robot(Id, #world{robots = Robots}) -> {Id, maps:get(Id, Robots)}.

put_robot(Id, Robot, #world{robots = Robots} = World) ->
    World#world{robots = Robots#{Id := Robot}}.

ask(Id, #world{plan = Plan0} = World0) ->
    Trace = maps:get(trace, World0#world.options, fun(_, _, _, _) -> ok end),
    Trace(World0#world.now, Id, Plan0, World0#world.robots),
    case timed(request, fun() -> starl_dpp_assign:request(Id, Plan0) end, World0) of
        {{{assign, Path}, Plan1}, #world{stats = Stats} = World1} ->
            lists:any(fun({_, Pen}) -> Pen =/= up end, Path) orelse error({no_ink, Path}),
            depart(Id, Path, World1#world{plan = Plan1, stats = Stats#{row => 0}});
        {{Nothing, Plan1}, World1} ->
            idle(Id, Nothing, count(Nothing, World1#world{plan = Plan1}))
    end.

idle(Id, none, #world{plan = Plan0, options = #{make_way := true}} = World) ->
    case starl_dpp_assign:make_way(Id, Plan0) of
        {{assign, Path}, Plan1} -> depart(Id, Path, retreat(World#world{plan = Plan1}));
        {none, _} -> wait(Id, World)
    end;
idle(Id, _, World) ->
    wait(Id, World).

wait(Id, World) ->
    {_, Robot} = robot(Id, World),
    put_robot(Id, Robot#robot{state = waiting}, World).

depart(Id, Path, World0) ->
    {_, Robot} = robot(Id, World0),
    World1 = put_robot(Id, Robot#robot{left = Path, index = 0}, World0),
    check(Id, World1),
    drive(Id, World1).

drive(Id, #world{stats = Stats} = World) ->
    {_, #robot{at = P, heading = H, left = [{Q, Pen} | _], leg = Leg0} = Robot} =
        robot(Id, World),
    Out =
        case P =:= Q of
            true -> H;
            false -> starl_geometry:heading(P, Q)
        end,
    Turn = abs(starl_geometry:angle_diff(Out, H)) / ?OMEGA,
    Drive = starl_geometry:distance(P, Q) / ?SPEED,
    T = Turn + Drive,
    Kind =
        case Pen of
            up -> travel_s;
            _ -> paint_s
        end,
    World0 = World#world{stats = add(turn_s, Turn, add(Kind, Drive, Stats))},
    Leg = Leg0 + 1,
    World1 = put_robot(Id, Robot#robot{state = moving, leg = Leg, heading = Out}, World0),
    interrupt(Id, Leg, {P, Q, Turn, T}, later(T, {arrive, Id, Leg}, World1)).

interrupt(Id, Leg, {P, Q, Turn, T}, #world{rand = Rand0, options = Options} = World) ->
    {X, Rand1} = rand:uniform_s(Rand0),
    case X < maps:get(interrupt, Options, 0.0) of
        false ->
            World#world{rand = Rand1};
        true ->
            {F, Rand2} = rand:uniform_s(Rand1),
            {Off, Rand3} = rand:uniform_s(Rand2),
            Slack = maps:get(slack, maps:get(plan, Options), 0.0),
            Place = aside(starl_geometry:interpolate(P, Q, F), P, Q, (2.0 * Off - 1.0) * Slack),
            later(Turn + F * (T - Turn), {halt, Id, Leg, Place}, World#world{rand = Rand3})
    end.

aside({X, Y}, P, Q, Off) ->
    A = starl_geometry:heading(P, Q),
    {X - Off * math:sin(A), Y + Off * math:cos(A)}.

arrive(Id, #robot{at = P, left = [{Q, Pen} | Left], index = I} = Robot, World0) ->
    #world{plan = Plan0} = World0,
    {Plan1, World1} = timed(passed, fun() -> starl_dpp_plan:passed(Id, I + 1, Plan0) end, World0),
    %% Repeated and late reports change nothing.
    Plan1 = starl_dpp_plan:passed(Id, I + 1, Plan1),
    World2 = ink(Pen, {P, Q}, World1#world{plan = Plan1}),
    Robot1 = Robot#robot{at = Q, left = Left, index = I + 1},
    World3 = wake(put_robot(Id, Robot1, World2)),
    case Left of
        [] -> stand(Id, Q, Robot1, World3);
        _ -> drive(Id, World3)
    end.

ink({down, E}, Segment, #world{inked = Inked, now = Now, stats = Stats} = World) ->
    Log = [{Now, starl_geometry:length(Segment)} | maps:get(log, Stats, [])],
    World#world{inked = [{E, Segment} | Inked], end_ink = Now, stats = Stats#{log => Log}};
ink(up, _Segment, World) ->
    World.

stand(Id, P, Robot, #world{plan = Plan} = World0) ->
    World1 = put_robot(
        Id,
        Robot#robot{at = P, left = [], state = asking},
        World0#world{plan = starl_dpp_plan:standing(Id, P, Plan)}
    ),
    check(Id, World1),
    later(?ASK, {ask, Id}, wake(World1)).

wake(#world{robots = Robots} = World) ->
    Waiting = [Id || {Id, #robot{state = waiting}} <- lists:sort(maps:to_list(Robots))],
    lists:foldl(
        fun(Id, W) ->
            {_, Robot} = robot(Id, W),
            later(?ASK, {ask, Id}, put_robot(Id, Robot#robot{state = asking}, W))
        end,
        World,
        Waiting
    ).

%%% Oracle

check(Id, #world{plan = Plan, robots = Robots, options = Options} = World) ->
    maps:get(check, Options, true) andalso
        begin
            All = starl_dpp_plan:unsafe(Plan),
            {Id, Own} = lists:keyfind(Id, 1, All),
            [disjoint_pair({Id, Own}, Other, Plan) || {Other_, _} = Other <- All, Other_ =/= Id],
            #robot{at = At} = maps:get(Id, Robots),
            Slack = maps:get(slack, maps:get(plan, Options), 0.0),
            D = lists:min([starl_geometry:point_segment(At, S) || S <- Own]),
            D =< Slack + 0.01 orelse error({outside_own_tube, Id, At, Own})
        end,
    World.

check_all(#world{plan = Plan}) ->
    disjoint(starl_dpp_plan:unsafe(Plan), Plan).

disjoint(All, Plan) ->
    [disjoint_pair(A, B, Plan) || {I, _} = A <- All, {J, _} = B <- All, I < J],
    true.

disjoint_pair({I, As}, {J, Bs}, Plan) ->
    R = starl_dpp_graph:radius(starl_dpp_plan:graph(Plan)),
    D = lists:min([dist(A, B) || A <- As, B <- Bs]),
    D >= 2.0 * R - 1.0e-6 orelse error({tubes_overlap, I, J, D, As, Bs}).

%% The distance of segments by a different way than the library's: ternary search over the convex
%% distance from a point to a segment.
dist({A, B}, T) ->
    case boxes_apart({A, B}, T) of
        D when D > 1000.0 -> D;
        _ -> ternary(A, B, T, 0.0, 1.0, 60)
    end.

boxes_apart({{AX, AY}, {BX, BY}}, {{CX, CY}, {DX, DY}}) ->
    max(
        max(min(CX, DX) - max(AX, BX), min(AX, BX) - max(CX, DX)),
        max(min(CY, DY) - max(AY, BY), min(AY, BY) - max(CY, DY))
    ).

ternary(A, B, T, Lo, Hi, 0) ->
    starl_geometry:point_segment(starl_geometry:interpolate(A, B, (Lo + Hi) / 2), T);
ternary(A, B, T, Lo, Hi, N) ->
    M1 = Lo + (Hi - Lo) * 0.45,
    M2 = Lo + (Hi - Lo) * 0.55,
    D1 = starl_geometry:point_segment2(starl_geometry:interpolate(A, B, M1), T),
    D2 = starl_geometry:point_segment2(starl_geometry:interpolate(A, B, M2), T),
    case D1 =< D2 of
        true -> ternary(A, B, T, Lo, M2, N - 1);
        false -> ternary(A, B, T, M1, Hi, N - 1)
    end.

%%% Figures

add(Key, X, Stats) -> maps:update_with(Key, fun(Y) -> X + Y end, X, Stats).

count(Key, #world{stats = Stats} = World) ->
    World#world{stats = maps:update_with(Key, fun(N) -> N + 1 end, 1, Stats)}.

timed(Key, Fun, #world{} = World) ->
    {Us, Result} = timer:tc(Fun),
    Stats = maps:update_with({us, Key}, fun(L) -> [Us | L] end, [Us], World#world.stats),
    {Result, World#world{stats = Stats}}.
