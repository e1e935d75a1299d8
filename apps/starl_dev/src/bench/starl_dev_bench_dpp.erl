%% @doc The path-planning benchmark: the time that the coordinator of distributed path planning
%% takes for a request. Robots follow a plan over random lines in an abstract model: each moves at
%% 500 mm/s from waypoint to waypoint, reports each waypoint, and requests a path again at the end.
-module(starl_dev_bench_dpp).
-behaviour(starl_dev_benchmark).

-export([flags/0, run/1]).

-record(robot, {
    at :: starl_geometry:point(),
    path = [] :: [starl_dpp_plan:waypoint()],
    index = 0 :: non_neg_integer()
}).
-record(drive, {
    plan :: starl_dpp_plan:t(),
    robots :: #{starl:robot_id() => #robot{}},
    %% the robots that act next, by time (s); a robot that neither acts nor waits has been told that
    %% all is complete
    queue = gb_sets:new() :: gb_sets:set({float(), starl:robot_id()}),
    waiting = [] :: [starl:robot_id()],
    now = 0.0 :: float(),
    left :: non_neg_integer(),
    times = [] :: [non_neg_integer()]
}).

-define(WORLD, {12000.0, 12000.0}).
%% r_s = 400 mm and r(v) of a Create at full speed.
-define(TRACKING_MM, 12.5).
-define(RADIUS_MM, 212.5).
-define(SPEED, 500.0).
-define(REQUEST_S, 0.08).
-define(LONGEST_MM, 1000.0).
-define(ATTEMPTS, 8).

%% @doc The flags of this benchmark.
-spec flags() -> [starl_cli_flags:flag()].
flags() ->
    [
        {edges, {list, {integer, 10, 40000}}, [2000, 10000], "approximate number of edges"},
        {robots, {integer, 1, 100}, 16, "number of robots that ask"},
        {requests, {integer, 1, 1000000}, 2000, "number of requests"}
    ].

%% @doc Measures, prints one line per size, and gives the figures for a file.
-spec run(#{atom() => term()}) -> [starl_dev_benchmark:figures()].
run(#{edges := Sizes, robots := Team, requests := Requests}) ->
    starl_cli_terminal:out("requests to the coordinator, ~b robots\n", [Team]),
    starl_cli_terminal:out("   edges  plan s  requests  median ms    p95 ms    max ms  painted\n"),
    [size(Edges, Team, Requests) || Edges <- Sizes].

size(Edges, Team, Requests) ->
    {Us, Plan} = picture(Edges, Team),
    #{total := Total} = starl_dpp_plan:counts(Plan),
    #drive{times = Times0, plan = End} = drive(started(Plan, Team, Requests)),
    Times = lists:sort(Times0),
    #{painted := Painted} = starl_dpp_plan:counts(End),
    Figures = [
        {edges, Total},
        {robots, Team},
        {plan_s, Us / 1.0e6},
        {requests, length(Times)},
        {median_ms, part(0.5, Times)},
        {p95_ms, part(0.95, Times)},
        {max_ms, part(1.0, Times)},
        {painted, Painted / Total}
    ],
    starl_cli_terminal:out(
        "~8b ~7.2f ~9b ~10.2f ~9.2f ~9.2f ~7.1f %\n",
        [Total, Us / 1.0e6, length(Times)] ++
            [part(P, Times) || P <- [0.5, 0.95, 1.0]] ++ [100 * Painted / Total]
    ),
    Figures.

part(P, Times) -> lists:nth(max(1, ceil(P * length(Times))), Times) / 1000.

%% -- the picture ----------------------------------------------------------------------------

%% Adds or removes lines until the number of edges is about right.
picture(Edges, Team) -> picture(Edges, Team, ceil(Edges / 4), ?ATTEMPTS).

picture(Edges, Team, Lines, Attempts) ->
    case timer:tc(fun() -> plan(lines(Lines), Team) end) of
        {_Us, {error, {too_many_edges, _, _}}} ->
            picture(Edges, Team, scaled(Lines, 0.5), Attempts);
        {Us, {ok, Plan}} ->
            #{total := Total} = starl_dpp_plan:counts(Plan),
            case abs(Total - Edges) * 20 =< Edges orelse Attempts =< 1 of
                true -> {Us, Plan};
                false -> picture(Edges, Team, scaled(Lines, Edges / Total), Attempts - 1)
            end
    end.

scaled(Lines, Factor) -> max(1, round(Lines * math:pow(Factor, 0.6))).

plan(Lines, Team) ->
    starl_dpp_plan:new(#{
        segments => Lines,
        world => ?WORLD,
        robots => lists:seq(1, Team),
        tube_radius => ?RADIUS_MM,
        slack => ?TRACKING_MM,
        horizon => 3000.0,
        seed => 1
    }).

lines(N) -> lines(N, rand:seed_s(exsss, 1)).

lines(0, _Rand) ->
    [];
lines(N, Rand0) ->
    {X, Rand1} = rand:uniform_s(Rand0),
    {Y, Rand2} = rand:uniform_s(Rand1),
    {A, Rand3} = rand:uniform_s(Rand2),
    {L, Rand4} = rand:uniform_s(Rand3),
    From = {inside(12000 * X), inside(12000 * Y)},
    [{From, away(From, 2 * math:pi() * A, ?LONGEST_MM * (0.2 + 0.8 * L))} | lines(N - 1, Rand4)].

away({X, Y}, Angle, Length) ->
    {inside(X + Length * math:cos(Angle)), inside(Y + Length * math:sin(Angle))}.

inside(X) -> max(1100.0, min(10900.0, float(X))).

%% -- driving --------------------------------------------------------------------------------

started(Plan0, Team, Requests) ->
    Ids = lists:seq(1, Team),
    Robots = maps:from_list([{Id, #robot{at = starl_dpp_plan:spot(Id, Plan0)}} || Id <- Ids]),
    Stand = fun(Id, Plan) -> starl_dpp_plan:standing(Id, starl_dpp_plan:spot(Id, Plan0), Plan) end,
    #drive{
        plan = lists:foldl(Stand, Plan0, Ids),
        robots = Robots,
        left = Requests,
        queue = gb_sets:from_list([{0.0, Id} || Id <- Ids])
    }.

drive(#drive{left = 0} = Drive) ->
    Drive;
drive(#drive{queue = Queue} = Drive) ->
    case gb_sets:is_empty(Queue) of
        true ->
            resolve(Drive);
        false ->
            {{Now, Id}, Rest} = gb_sets:take_smallest(Queue),
            drive(act(Id, maps:get(Id, Drive#drive.robots), Drive#drive{queue = Rest, now = Now}))
    end.

act(Id, #robot{path = []}, Drive) -> ask(Id, Drive);
act(Id, Robot, Drive) -> arrive(Id, Robot, Drive).

ask(Id, #drive{plan = Plan, times = Times, left = Left} = Drive) ->
    {Us, {Answer, Next}} = timer:tc(fun() -> answer(Id, Plan) end),
    Asked = Drive#drive{plan = Next, times = [Us | Times], left = Left - 1},
    case Answer of
        {assign, Path} -> depart(Id, Path, Asked);
        none -> Asked#drive{waiting = [Id | Asked#drive.waiting]};
        complete -> Asked
    end.

%% As in the coordinator, a robot without work moves out of the way.
answer(Id, Plan) ->
    case starl_dpp_assign:request(Id, Plan) of
        {none, Next} -> starl_dpp_assign:make_way(Id, Next);
        Answer -> Answer
    end.

depart(Id, Path, #drive{robots = Robots} = Drive) ->
    Robot = maps:get(Id, Robots),
    leg(Id, Robot#robot{path = Path, index = 0}, Drive).

leg(Id, #robot{at = From, path = [{To, _} | _]} = Robot, #drive{robots = Robots} = Drive) ->
    Seconds = starl_geometry:distance(From, To) / ?SPEED,
    later(Seconds, Id, Drive#drive{robots = Robots#{Id := Robot}}).

later(Seconds, Id, #drive{queue = Queue, now = Now} = Drive) ->
    Drive#drive{queue = gb_sets:add({Now + Seconds, Id}, Queue)}.

arrive(Id, #robot{path = [{At, _} | Path], index = Index} = Robot, #drive{plan = Plan} = Drive) ->
    Passed = starl_dpp_plan:passed(Id, Index + 1, Plan),
    Arrived = Robot#robot{at = At, path = Path, index = Index + 1},
    Woken = wake(Drive#drive{plan = Passed}),
    case Path of
        [] -> stand(Id, Arrived, Woken);
        [_ | _] -> leg(Id, Arrived, Woken)
    end.

stand(Id, #robot{at = At} = Robot, #drive{plan = Plan, robots = Robots} = Drive) ->
    Standing = Drive#drive{
        plan = starl_dpp_plan:standing(Id, At, Plan), robots = Robots#{Id := Robot}
    },
    later(?REQUEST_S, Id, Standing).

%% When space becomes free, waiting robots repeat their requests.
wake(#drive{waiting = Waiting} = Drive) ->
    Ask = fun(Id, Acc) -> later(?REQUEST_S, Id, Acc) end,
    lists:foldl(Ask, Drive#drive{waiting = []}, lists:sort(Waiting)).

resolve(#drive{waiting = Waiting, plan = Plan} = Drive) ->
    case starl_dpp_assign:resolve(Waiting, Plan) of
        {[], _} ->
            Drive;
        {Moves, Next} ->
            Ids = [Id || {Id, _} <- Moves],
            Moving = Drive#drive{plan = Next, waiting = Waiting -- Ids},
            drive(lists:foldl(fun({Id, Path}, Acc) -> depart(Id, Path, Acc) end, Moving, Moves))
    end.
