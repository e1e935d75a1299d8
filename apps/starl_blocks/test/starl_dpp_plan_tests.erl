-module(starl_dpp_plan_tests).
-include_lib("eunit/include/eunit.hrl").

-define(R, 215.0).
-define(WORLD, {12000.0, 12000.0}).

config(Segments, N) ->
    #{segments => Segments, world => ?WORLD, robots => lists:seq(1, N), tube_radius => ?R}.

new(Segments, N) ->
    {ok, Plan} = starl_dpp_plan:new(config(Segments, N)),
    Plan.

parked(Segments, N) -> park_all(lists:seq(1, N), new(Segments, N)).

park_all(Robots, Plan) ->
    lists:foldl(
        fun(Id, P) -> starl_dpp_plan:standing(Id, starl_dpp_plan:spot(Id, P), P) end,
        Plan,
        Robots
    ).

line() -> {{3000.0, 6000.0}, {5000.0, 6000.0}}.

pens(Path) -> [E || {_, {down, E}} <- Path].

%%% Single steps

empty_picture_is_complete_test() ->
    ?assertMatch({complete, _}, starl_dpp_assign:request(1, parked([], 1))).

nothing_before_all_places_are_known_test() ->
    Plan = park_all([1], new([line()], 2)),
    ?assertEqual([2], starl_dpp_plan:unknown(Plan)),
    ?assertMatch({none, _}, starl_dpp_assign:request(1, Plan)),
    ?assertMatch({[], _}, starl_dpp_assign:resolve([1], Plan)).

%% The answer contains a free edge; the whole line, longer than the longest edge, gets painted.
long_line_is_divided_and_assigned_test() ->
    Plan0 = parked([line()], 1),
    #{total := 4, free := 4} = starl_dpp_plan:counts(Plan0),
    {{assign, Path}, Plan1} = starl_dpp_assign:request(1, Plan0),
    ?assertEqual([1, 2, 3, 4], lists:sort(pens(Path))),
    ?assertMatch(#{free := 0, assigned := 4, painted := 0}, starl_dpp_plan:counts(Plan1)),
    Plan2 = starl_dpp_plan:passed(1, length(Path), Plan1),
    ?assertEqual([1, 2, 3, 4], starl_dpp_plan:painted_since(0, Plan2)),
    {End, _} = lists:last(Path),
    ?assertMatch(
        {complete, _}, starl_dpp_assign:request(1, starl_dpp_plan:standing(1, End, Plan2))
    ).

%% Forgetting one's own tube when checking: a robot that stands on the only line, all of it inside
%% its disk, still gets it.
own_reservation_does_not_block_test() ->
    Short = {{6000.0, 6000.0}, {6100.0, 6000.0}},
    Plan = starl_dpp_plan:standing(1, {6050.0, 6010.0}, new([Short], 1)),
    ?assertMatch({{assign, [_ | _]}, _}, starl_dpp_assign:request(1, Plan)).

passed_is_monotone_and_idempotent_test() ->
    {{assign, Path}, Plan0} = starl_dpp_assign:request(1, parked([line()], 1)),
    N = length(Path),
    Plan1 = starl_dpp_plan:passed(1, N - 1, Plan0),
    ?assertEqual(Plan1, starl_dpp_plan:passed(1, N - 1, Plan1)),
    ?assertEqual(Plan1, starl_dpp_plan:passed(1, 1, Plan1)),
    ?assertEqual(3, length(starl_dpp_plan:painted_since(0, Plan1))),
    [{1, Held0}] = starl_dpp_plan:unsafe(Plan0),
    [{1, Held1}] = starl_dpp_plan:unsafe(Plan1),
    ?assertEqual([lists:last(Held0)], Held1),
    Plan2 = starl_dpp_plan:passed(1, N, Plan1),
    ?assertEqual(Plan2, starl_dpp_plan:passed(1, N + 7, Plan2)).

%% A lost or late report of a robot that stands does not free space it is in.
late_passed_of_a_standing_robot_is_ignored_test() ->
    {{assign, [{P, _} | _] = Path}, Plan0} = starl_dpp_assign:request(1, parked([line()], 1)),
    Plan1 = starl_dpp_plan:standing(1, P, Plan0),
    ?assertEqual(Plan1, starl_dpp_plan:passed(1, length(Path), Plan1)),
    ?assertEqual([{1, [{P, P}]}], starl_dpp_plan:unsafe(Plan1)).

%% The robot stays where it is after a lost assignment; its edges come back.
standing_frees_what_is_not_painted_test() ->
    Plan0 = parked([line()], 1),
    {{assign, Path}, Plan1} = starl_dpp_assign:request(1, Plan0),
    Plan2 = starl_dpp_plan:passed(1, length(Path) - 2, Plan1),
    {P, _} = lists:nth(length(Path) - 2, Path),
    Plan3 = starl_dpp_plan:standing(1, P, Plan2),
    ?assertMatch(#{free := 2, assigned := 0, painted := 2}, starl_dpp_plan:counts(Plan3)),
    ?assertMatch({{assign, [_, _]}, _}, starl_dpp_assign:request(1, Plan3)).

moving_robot_gets_nothing_test() ->
    {_, Plan} = starl_dpp_assign:request(1, parked([line()], 1)),
    ?assertMatch({none, _}, starl_dpp_assign:request(1, Plan)),
    ?assertMatch({none, _}, starl_dpp_assign:retreat(1, Plan)).

parked_robot_does_not_retreat_test() ->
    ?assertMatch({none, _}, starl_dpp_assign:retreat(1, parked([line()], 3))).

retreat_ends_on_a_spot_test() ->
    Plan0 = starl_dpp_plan:standing(2, {6000.0, 6000.0}, park_all([1], new([line()], 2))),
    {{assign, Path}, Plan1} = starl_dpp_assign:retreat(2, Plan0),
    {P, up} = lists:last(Path),
    ?assert(starl_dpp_plan:parked(2, starl_dpp_plan:standing(2, P, Plan1))).

%% The nearest spot whose owner is away is as good as the own one, and the two exchange them; both
%% by a retreat and by standing there.
spots_are_exchanged_test() ->
    Plan0 = new([line()], 2),
    Own = starl_dpp_plan:spot(1, Plan0),
    {X, Y} = Other = starl_dpp_plan:spot(2, Plan0),
    Away = starl_dpp_plan:standing(2, {6000.0, 6000.0}, Plan0),
    Near = starl_dpp_plan:standing(1, {(3 * X + 6000.0) / 4, (3 * Y + 6000.0) / 4}, Away),
    {{assign, Path}, Plan1} = starl_dpp_assign:retreat(1, Near),
    ?assertMatch({Other, up}, lists:last(Path)),
    ?assertEqual({Other, Own}, {starl_dpp_plan:spot(1, Plan1), starl_dpp_plan:spot(2, Plan1)}),
    Plan2 = starl_dpp_plan:standing(1, Other, Away),
    ?assert(starl_dpp_plan:parked(1, Plan2)),
    ?assertEqual(Own, starl_dpp_plan:spot(2, Plan2)).

%% A robot beside its line by less than the slack counts as on it, so that its disk does not leave
%% the tube that it had.
standing_beside_the_path_test() ->
    {ok, Plan0} = starl_dpp_plan:new((config([line()], 1))#{slack => 40.0}),
    {{assign, _}, Plan1} = starl_dpp_assign:request(1, park_all([1], Plan0)),
    [{1, Segments}] = starl_dpp_plan:unsafe(Plan1),
    {A, B} = lists:last(Segments),
    {X, Y} = starl_geometry:interpolate(A, B, 0.5),
    [{1, [{Q, Q}]}] = starl_dpp_plan:unsafe(starl_dpp_plan:standing(1, {X, Y + 30.0}, Plan1)),
    ?assert(starl_geometry:distance(Q, {X, Y}) < 1.0e-6),
    [{1, [{F, F}]}] = starl_dpp_plan:unsafe(starl_dpp_plan:standing(1, {X, Y + 50.0}, Plan1)),
    ?assertEqual({X, Y + 50.0}, F).

errors_say_what_to_do_test() ->
    Cases = [
        {no_robots, config([line()], 0)},
        {world_too_small, (config([line()], 4))#{world => {2000.0, 2000.0}}},
        {outside_area, config([{{100.0, 100.0}, {5000.0, 5000.0}}], 1)},
        {too_many_edges, (config([line()], 1))#{edge_length => 0.045}}
    ],
    [
        begin
            {error, Reason} = starl_dpp_plan:new(Config),
            ?assertEqual(Kind, kind(Reason)),
            ?assert(iolist_size(starl_dpp_plan:format_error(Reason)) > 20)
        end
     || {Kind, Config} <- Cases
    ].

kind(Reason) when is_tuple(Reason) -> element(1, Reason);
kind(Reason) -> Reason.

%% A robot that died on the only line keeps its reservation, and that is reported honestly.
dead_robot_makes_unreachable_test() ->
    Short = {{6000.0, 6000.0}, {6100.0, 6000.0}},
    Plan = starl_dpp_plan:standing(2, {6050.0, 6010.0}, park_all([1, 3], new([Short], 3))),
    ?assertNot(starl_dpp_assign:reachable([1, 3], Plan)),
    ?assert(starl_dpp_assign:reachable([1, 2], Plan)),
    ?assertMatch({none, _}, starl_dpp_assign:request(1, Plan)),
    ?assertMatch({[], _}, starl_dpp_assign:resolve([1, 3], Plan)).

%% A deadlock: the one that may paint is shut in by those that wait.
resolve_opens_the_way_test() ->
    Short = {{6000.0, 6000.0}, {6100.0, 6000.0}},
    Plan0 = starl_dpp_plan:standing(1, {6050.0, 6010.0}, park_all([2], new([Short], 2))),
    %% Robot 1 is dead on the line in the first test; here it only waits.
    ?assertMatch({none, _}, starl_dpp_assign:request(2, Plan0)),
    {[{1, Path}], _} = starl_dpp_assign:resolve([1, 2], Plan0),
    ?assertMatch([_ | _], Path).

%% A new coordinator with the same input that learns what is painted and what is held carries on.
rebuilt_plan_carries_on_test_() ->
    [{lists:concat(["seed ", Seed]), {timeout, 60, fun() -> rebuilt(Seed) end}} || Seed <- [1, 2]].

rebuilt(Seed) ->
    Segments = starl_dpp_pictures:picture(lines, Seed),
    Plan0 = parked(Segments, 3),
    {{assign, Path1}, Plan1} = starl_dpp_assign:request(1, Plan0),
    {{assign, Path2}, Plan2} = starl_dpp_assign:request(2, Plan1),
    From1 = starl_dpp_plan:spot(1, Plan0),
    From2 = starl_dpp_plan:spot(2, Plan0),
    [Done | _] = lists:reverse(pens(Path1)),
    New0 = starl_dpp_plan:mark_painted([Done], park_all([3], new(Segments, 3))),
    New1 = starl_dpp_plan:adopt(1, From1, Path1, New0),
    Held = proplists:get_value(2, starl_dpp_plan:unsafe(Plan2)),
    New2 = starl_dpp_plan:adopt(2, From2, [{Q, up} || {_, Q} <- Held], New1),
    ?assertEqual(starl_dpp_plan:unsafe(Plan2), starl_dpp_plan:unsafe(New2)),
    ?assertEqual([Done], starl_dpp_plan:painted_since(0, New2)),
    #{assigned := Assigned} = starl_dpp_plan:counts(New2),
    ?assertEqual(length(pens(Path1)) - 1, Assigned),
    {Answer, New3} = starl_dpp_assign:request(3, New2),
    starl_dpp_world:disjoint(starl_dpp_plan:unsafe(New3), New3),
    ?assertMatch({assign, _}, Answer),
    %% Held by nobody else: robot 2's line was not given away.
    {assign, Path3} = Answer,
    ?assertEqual([], [E || E <- pens(Path3), lists:member(E, pens(Path2))]),
    New4 = starl_dpp_plan:standing(2, From2, New3),
    ?assertMatch(#{assigned := _}, starl_dpp_plan:counts(New4)).

%% Robots that tell a new coordinator where they are may be some mm off the places that they held:
%% their reservations are moved apart, within the slack, and those that are apart stay.
standing_robots_are_moved_apart_test() ->
    Put = fun({Id, P}, Plan) -> starl_dpp_plan:standing(Id, P, Plan) end,
    Places = [{1, {5000.0, 5000.0}}, {2, {5000.0 + 2 * ?R - 9.0, 5000.0}}, {3, {5200.0, 5400.0}}],
    Plan = lists:foldl(Put, new([line()], 3), Places),
    ?assertError(
        {tubes_overlap, _, _, _, _, _},
        starl_dpp_world:disjoint(starl_dpp_plan:unsafe(Plan), Plan)
    ),
    Apart = starl_dpp_plan:apart(Plan),
    starl_dpp_world:disjoint(starl_dpp_plan:unsafe(Apart), Apart),
    [
        begin
            {Reserved, P} = starl_dpp_plan:stands(Id, Apart),
            ?assert(starl_geometry:distance(Reserved, P) < 15.0)
        end
     || {Id, P} <- Places
    ],
    ?assertEqual(Apart, starl_dpp_plan:apart(Apart)).

%% What was painted is known in the order in which it was told, each edge once.
painted_since_test() ->
    Tell = fun starl_dpp_plan:mark_painted/2,
    Plan = lists:foldl(Tell, new([line()], 1), [[3, 2], [2], [1], [3], [4]]),
    ?assertEqual([1, 2, 3, 4], starl_dpp_plan:painted_since(0, Plan)),
    Since = [starl_dpp_plan:painted_since(Known, Plan) || Known <- [0, 2, 3, 4]],
    ?assertEqual([[1, 2, 3, 4], [1, 4], [4], []], Since).

%% Who has made way aside, and stands in the way of free edges again, parks.
idle_robot_makes_way_twice_test() ->
    {ok, Plan0} = starl_dpp_plan:new(config([{{5000.0, 6000.0}, {7000.0, 6000.0}}], 2)),
    Plan1 = starl_dpp_plan:standing(2, starl_dpp_plan:spot(2, Plan0), Plan0),
    Plan2 = starl_dpp_plan:standing(1, {6000.0, 6300.0}, Plan1),
    {{assign, Aside}, Plan3} = starl_dpp_assign:make_way(1, Plan2),
    {End, up} = lists:last(Aside),
    ?assertNot(is_spot(End, Plan3)),
    Plan4 = starl_dpp_plan:standing(1, End, Plan3),
    ?assertMatch({none, _}, starl_dpp_assign:make_way(1, Plan4)),
    Plan5 = starl_dpp_plan:standing(1, {6000.0, 5700.0}, Plan4),
    {{assign, Away}, Plan6} = starl_dpp_assign:make_way(1, Plan5),
    ?assert(is_spot(element(1, lists:last(Away)), Plan6)).

is_spot(Point, Plan) ->
    lists:any(
        fun(Robot) -> starl_geometry:distance(Point, starl_dpp_plan:spot(Robot, Plan)) < 1.0 end, [
            1, 2
        ]
    ).

%%% What each report changes, and what it leaves as it was

graph(Plan) -> starl_dpp_plan:graph(Plan).

heading(Robot, Plan) -> maps:get(heading, starl_dpp_plan:view(Robot, Plan)).

%% The robots may be given in any order, some of them twice; the lines are not kept.
robots_in_any_order_test() ->
    Config = config([line()], 3),
    {ok, Plan} = starl_dpp_plan:new(Config),
    {ok, Mixed} = starl_dpp_plan:new(Config#{robots => [3, 1, 2, 1]}),
    Spots = fun(P) -> [starl_dpp_plan:spot(Robot, P) || Robot <- [1, 2, 3]] end,
    ?assertEqual(Spots(Plan), Spots(Mixed)),
    ?assertEqual([1, 2, 3], starl_dpp_plan:unknown(Mixed)),
    ?assertMatch(#{horizon := 3000.0, slack := +0.0}, starl_dpp_plan:config(Plan)),
    ?assertNot(is_map_key(segments, starl_dpp_plan:config(Plan))).

%% A silent robot holds the place where it was seen, and does no work until it is heard again: that
%% it stands, or that it is on its way.
silent_until_heard_test() ->
    P = {6000.0, 9000.0},
    Plan = starl_dpp_plan:silent(2, P, parked([line()], 3)),
    ?assertEqual([1, 3], starl_dpp_plan:at_work(Plan)),
    ?assertEqual({P, P}, starl_dpp_plan:stands(2, Plan)),
    ?assertEqual([1], starl_dpp_plan:at_work(starl_dpp_plan:silent(3, P, Plan))),
    ?assertEqual([1, 2, 3], starl_dpp_plan:at_work(starl_dpp_plan:standing(2, P, Plan))),
    Moves = starl_dpp_plan:adopt(2, P, [{{6400.0, 9000.0}, up}], Plan),
    ?assertEqual([1, 2, 3], starl_dpp_plan:at_work(Moves)),
    ?assertEqual([1, 3], starl_dpp_plan:at_work(starl_dpp_plan:standing(1, P, Plan))).

%% A robot heads along the line that it drove last, once it has passed its end; one that is stopped
%% on its way along the line that it was on; one that stood, or was adopted at no distance, as before.
heading_test() ->
    Path = [{{4000.0, 9000.0}, up}, {{4000.0, 9500.0}, up}, {{3000.0, 9500.0}, up}],
    Plan = starl_dpp_plan:adopt(1, {3500.0, 9000.0}, Path, parked([line()], 2)),
    Stopped = fun(At, P) -> heading(1, starl_dpp_plan:standing(1, At, P)) end,
    Near = fun(A, B) -> ?assert(abs(A - B) < 1.0e-9) end,
    ?assertEqual(none, heading(1, parked([line()], 2))),
    Near(0.0, Stopped({3700.0, 9000.0}, Plan)),
    Near(math:pi() / 2, Stopped({4000.0, 9200.0}, starl_dpp_plan:passed(1, 1, Plan))),
    Near(math:pi(), Stopped({3000.0, 9500.0}, starl_dpp_plan:passed(1, 3, Plan))),
    End = starl_dpp_plan:standing(1, {3000.0, 9500.0}, starl_dpp_plan:passed(1, 3, Plan)),
    Near(math:pi(), heading(1, starl_dpp_plan:standing(1, {3000.0, 9500.0}, End))),
    At = {3000.0, 9500.0},
    Stays = starl_dpp_plan:adopt(1, At, [{At, up}], End),
    Near(math:pi(), Stopped(At, Stays)),
    Near(math:pi(), Stopped(At, starl_dpp_plan:passed(1, 1, Stays))),
    %% nor does a last way of no length take back what the one before it was
    Back = starl_dpp_plan:adopt(1, At, [{{3500.0, 9500.0}, up}, {{3500.0, 9500.0}, up}], End),
    Near(0.0, Stopped({3500.0, 9500.0}, starl_dpp_plan:passed(1, 1, Back))),
    %% of another robot that says nothing
    Other = starl_dpp_plan:adopt(2, {9000.0, 9000.0}, [{{9000.0, 9500.0}, up}], End),
    Both = starl_dpp_plan:standing(2, {9000.0, 9500.0}, starl_dpp_plan:passed(2, 1, Other)),
    Near(math:pi(), heading(1, Both)),
    Near(math:pi() / 2, heading(2, Both)).

%% Only a way of somebody else counts, and only while it has an end to go to.
others_move_test() ->
    Plan = starl_dpp_plan:adopt(2, {6000.0, 9000.0}, [{{6400.0, 9000.0}, up}], parked([line()], 2)),
    Moves = fun(P) -> [starl_dpp_plan:others_move(Robot, P) || Robot <- [1, 2]] end,
    ?assertEqual([true, false], Moves(Plan)),
    ?assertEqual([false, false], Moves(starl_dpp_plan:passed(2, 1, Plan))),
    ?assertEqual([false, false], Moves(parked([line()], 2))).

%% On its way no robot is parked, even across its spot, and one whose place is unknown is not.
parked_test() ->
    Plan = new([line()], 2),
    Spot = starl_dpp_plan:spot(1, Plan),
    ?assertNot(starl_dpp_plan:parked(1, Plan)),
    ?assert(starl_dpp_plan:parked(1, park_all([1], Plan))),
    ?assertNot(starl_dpp_plan:parked(1, starl_dpp_plan:adopt(1, Spot, [{Spot, up}], Plan))),
    ?assertNot(starl_dpp_plan:parked(1, starl_dpp_plan:standing(1, {6000.0, 9000.0}, Plan))).

%% The edges that others block, without those robots: each robot is told apart.
masks_test() ->
    Near = {5000.0, 6100.0},
    Plan = starl_dpp_plan:standing(1, Near, park_all([2], new([line()], 2))),
    Closed = fun(Without, P) ->
        Mask = starl_dpp_plan:masks(Without, P),
        [E || E <- lists:seq(1, starl_dpp_graph:edges(graph(P))), Mask(E) =/= 0]
    end,
    All = Closed([], Plan),
    ?assertEqual([], Closed([1, 2], Plan)),
    ?assertEqual([], Closed([1], Plan) -- All),
    ?assertEqual(lists:sort(All), lists:sort(Closed([1], Plan) ++ Closed([2], Plan))),
    ?assertEqual([4], [E || E <- Closed([2], Plan), E =< 4]),
    ?assertEqual(1, starl_dpp_plan:blocking(1, Plan)).

%% What moves apart stands there from then on: it counts as there, and has been seen where it was.
%% Robots that are apart are left in peace, to the last bit; the lower number moves first.
apart_test() ->
    A = {5000.0, 5000.0},
    B = {5000.0 + 2 * ?R - 9.0, 5000.0},
    Plan = starl_dpp_plan:standing(2, B, starl_dpp_plan:standing(1, A, new([line()], 2))),
    Apart = starl_dpp_plan:apart(Plan),
    {{X, 5000.0} = Reserved, A} = starl_dpp_plan:stands(1, Apart),
    ?assert(abs(X - 4991.0) < 1.0e-3),
    ?assertEqual({B, B}, starl_dpp_plan:stands(2, Apart)),
    ?assertEqual([{Reserved, Reserved}], starl_dpp_plan:held(1, Apart)),
    ?assertMatch(#{at := Reserved}, starl_dpp_plan:view(1, Apart)),
    Far = starl_dpp_plan:standing(2, {9000.0, 9000.0}, Plan),
    ?assertEqual(Far, starl_dpp_plan:apart(Far)).

%% Also in a big team the lower number of two is the one that moves.
apart_in_order_test() ->
    {ok, Plan} = starl_dpp_plan:new((config([line()], 40))#{world => {20000.0, 20000.0}}),
    Place = fun
        (Id) when Id > 20 -> {800.0 * (Id - 20) + 440.0 * 0.98, 9000.0};
        (Id) -> {800.0 * Id + 2.0, 9000.0}
    end,
    Stand = fun(Id, P) -> starl_dpp_plan:standing(Id, Place(Id), P) end,
    Apart = starl_dpp_plan:apart(lists:foldl(Stand, Plan, lists:seq(1, 40))),
    Moved = [
        Id
     || Id <- lists:seq(1, 40),
        {Reserved, _} <- [starl_dpp_plan:stands(Id, Apart)],
        Reserved =/= Place(Id)
    ],
    ?assertEqual(lists:seq(1, 20), Moved).

%% What a robot has made way for is over when somebody gets work; to park does not count.
yielded_test() ->
    Path = [{{6400.0, 9000.0}, up}],
    Plan = starl_dpp_plan:standing(1, {6000.0, 9000.0}, park_all([2], new([line()], 2))),
    Sent = fun(Why, P) -> starl_dpp_plan:send(1, Path, Why, P) end,
    Yielded = fun(P) -> [starl_dpp_plan:yielded(Robot, P) || Robot <- [1, 2]] end,
    ?assertEqual([false, false], Yielded(Sent(retreat, Plan))),
    Aside = Sent(aside, Plan),
    ?assertEqual([true, false], Yielded(Aside)),
    Back = starl_dpp_plan:standing(1, {6000.0, 9000.0}, Aside),
    ?assertEqual([true, false], Yielded(Sent(retreat, Back))),
    ?assertEqual([false, false], Yielded(Sent(work, Back))).

%% A robot on its way that is adopted anew gives the lines of its former way back, but for those
%% that are painted.
adopted_anew_test() ->
    {{assign, [{P, _} | _] = Path}, Plan} = starl_dpp_assign:request(1, parked([line()], 1)),
    One = starl_dpp_plan:passed(1, length(Path) - 2, Plan),
    ?assertMatch(#{painted := 2, assigned := 2, free := 0}, starl_dpp_plan:counts(One)),
    Away = starl_dpp_plan:adopt(1, P, [{{3000.0, 6500.0}, up}], One),
    ?assertMatch(#{painted := 2, assigned := 0, free := 2}, starl_dpp_plan:counts(Away)),
    %% a painted line on a path is painted, not assigned
    Again = starl_dpp_plan:adopt(1, P, Path, Away),
    ?assertMatch(#{painted := 2, assigned := 2, free := 0}, starl_dpp_plan:counts(Again)).
