%% The coordinator's decisions one by one: who gets work, who parks or steps aside, who is told that
%% all is done, and what is still in reach of those that live.
-module(starl_dpp_assign_tests).
-include_lib("eunit/include/eunit.hrl").

-define(R, 215.0).
-define(A, starl_dpp_assign).
-define(P, starl_dpp_plan).

config(Lines, N) ->
    #{
        segments => Lines,
        world => {12000.0, 12000.0},
        robots => lists:seq(1, N),
        tube_radius => ?R
    }.

new(Lines, N) ->
    {ok, Plan} = ?P:new(config(Lines, N)),
    Plan.

%% A line of one edge, and one far from it.
short() -> {{6000.0, 6000.0}, {6100.0, 6000.0}}.
far() -> {{9000.0, 3000.0}, {9100.0, 3000.0}}.

%% These robots stand on their spots.
parked(Robots, Plan) -> stand([{Robot, ?P:spot(Robot, Plan)} || Robot <- Robots], Plan).

stand(Places, Plan) ->
    lists:foldl(fun({Robot, At}, P) -> ?P:standing(Robot, At, P) end, Plan, Places).

%% The robot is on its way, with nothing to paint.
moves(Robot, Plan) -> ?P:adopt(Robot, {4000.0, 9000.0}, [{{4500.0, 9000.0}, up}], Plan).

pens({{assign, Path}, _}) -> [E || {_, {down, E}} <- Path];
pens({Answer, _}) -> Answer.

ending({{assign, Path}, _}) -> element(1, lists:last(Path)).

%%% Requests

%% What is refused or complete leaves the plan as it was.
same(Answer, Plan, Asked) -> ?assertEqual({Answer, Plan}, Asked).

%% When all is painted every robot is told so, wherever it and the others are.
complete_test() ->
    Plan = ?P:mark_painted([1], new([short()], 3)),
    same(complete, Plan, ?A:request(1, Plan)),
    Known = moves(2, parked([1, 3], Plan)),
    [same(complete, Known, ?A:request(Robot, Known)) || Robot <- [1, 2, 3]].

%% Not while the last line is with another, which may yet fail.
assigned_is_not_complete_test() ->
    {{assign, _}, Plan} = ?A:request(1, parked([1, 2], new([short()], 2))),
    same(none, Plan, ?A:request(2, Plan)),
    Failed = parked([1], Plan),
    ?assertEqual([1], pens(?A:request(2, Failed))).

%% Who is on its way has its path; work is for those that stand, once all places are known.
standing_robots_only_test() ->
    Plan = parked([2], moves(1, new([short(), far()], 2))),
    same(none, Plan, ?A:request(1, Plan)),
    Unknown = parked([1, 2], new([short()], 3)),
    same(none, Unknown, ?A:request(1, Unknown)),
    ?assertEqual([1], pens(?A:request(1, parked([3], Unknown)))).

%% The work is taken at once: nobody else gets it, and the robot holds its way.
work_is_taken_test() ->
    {{assign, Path}, Plan} = ?A:request(1, parked([1, 2], new([short(), far()], 2))),
    [First] = [E || {_, {down, E}} <- Path],
    ?assertMatch(#{free := 1, assigned := 1, painted := 0}, ?P:counts(Plan)),
    [{_, Held}] = [H || {1, _} = H <- ?P:unsafe(Plan)],
    ?assertEqual([Q || {Q, _} <- Path], [Q || {_, Q} <- Held]),
    ?assertEqual([3 - First], pens(?A:request(2, Plan))).

%%% Parking

%% A robot that is away parks; not one that is parked, as near as that may be, nor one on its way,
%% nor before all places are known.
retreat_test() ->
    Away = stand([{1, {6000.0, 9000.0}}], parked([2], new([short()], 2))),
    Spot = ending(?A:retreat(1, Away)),
    ?assert(lists:member(Spot, [?P:spot(Robot, Away) || Robot <- [1, 2]])),
    {X, Y} = ?P:spot(1, Away),
    Beside = stand([{1, {X, Y + 5.0}}], Away),
    same(none, Beside, ?A:retreat(1, Beside)),
    Moving = moves(1, Away),
    same(none, Moving, ?A:retreat(1, Moving)),
    Unknown = stand([{1, {6000.0, 9000.0}}], new([short()], 2)),
    same(none, Unknown, ?A:retreat(1, Unknown)).

%% The spot of one that is away is as good as the own one; that of one that is parked is not.
nearest_spot_test() ->
    Plan = new([short()], 3),
    [{X, Y}, Second, {X3, Y3}] = [?P:spot(Robot, Plan) || Robot <- [1, 2, 3]],
    Near = {0.8 * X3 + 1200.0, 0.8 * Y3 + 1200.0},
    Away = {3, {6000.0, 9000.0}},
    Exchanged = ?A:retreat(1, stand([{1, Near}, {2, Second}, Away], Plan)),
    ?assertEqual({X3, Y3}, ending(Exchanged)),
    {_, Left} = Exchanged,
    ?assertEqual([{X3, Y3}, Second, {X, Y}], [?P:spot(Robot, Left) || Robot <- [1, 2, 3]]),
    Own = ?A:retreat(1, stand([{1, Near}, {2, Second}, {3, {X3, Y3}}], Plan)),
    ?assertEqual({X, Y}, ending(Own)),
    %% its own one, if that is nearest
    OwnNear = {0.8 * X + 1200.0, 0.8 * Y + 1200.0},
    ?assertEqual({X, Y}, ending(?A:retreat(1, stand([{1, OwnNear}, {2, Second}, Away], Plan)))).

%%% Making way

%% Who closes free lines goes to where it closes none, which is no parking spot, and no farther than
%% need be; who closes none stays.
make_way_test() ->
    Plan = stand([{1, {6050.0, 6200.0}}], parked([2], new([short()], 2))),
    ?assertEqual(1, ?P:blocking(1, Plan)),
    {{assign, Path}, Next} = Made = ?A:make_way(1, Plan),
    ?assertEqual([], pens(Made)),
    {P, up} = lists:last(Path),
    ?assert(starl_geometry:point_segment(P, short()) >= 2 * ?R),
    ?assert(starl_geometry:point_segment(P, short()) < 6 * ?R),
    ?assertNot(?P:parked(1, ?P:standing(1, P, Next))),
    Clear = stand([{1, {6050.0, 6440.0}}], Plan),
    same(none, Clear, ?A:make_way(1, Clear)),
    Painted = ?P:mark_painted([1], Plan),
    same(none, Painted, ?A:make_way(1, Painted)).

%% Nor does one that is on its way, though its way closes lines; nor one while a place is unknown.
make_way_only_standing_test() ->
    Plan = parked([2], new([short()], 2)),
    Moving = ?P:adopt(1, {6050.0, 6200.0}, [{{6050.0, 6300.0}, up}], Plan),
    ?assertEqual(1, ?P:blocking(1, Moving)),
    same(none, Moving, ?A:make_way(1, Moving)),
    Unknown = stand([{1, {6050.0, 6200.0}}], new([short()], 2)),
    same(none, Unknown, ?A:make_way(1, Unknown)).

%% Once aside, then to a parking spot; work for anybody, the robot itself or another, ends that.
make_way_in_turn_test() ->
    At = {1, {6050.0, 6200.0}},
    Plan = stand([At], parked([2], new([short(), far()], 2))),
    {_, Aside} = ?A:make_way(1, Plan),
    Back = stand([At], Aside),
    Parks = ending(?A:make_way(1, Back)),
    ?assert(lists:member(Parks, [?P:spot(Robot, Plan) || Robot <- [1, 2]])),
    {{assign, _}, Works} = ?A:request(2, Back),
    Again = ending(?A:make_way(1, Works)),
    ?assertNot(lists:member(Again, [?P:spot(Robot, Plan) || Robot <- [1, 2]])).

%%% Deadlocks

%% Robots that wait get the work that they were refused out of patience, each beside the paths of
%% those before it; in the order of the robots, however they are given, and each once.
resolve_grants_test() ->
    Plan = parked([1, 2], new([short(), far()], 2)),
    {Moves, Next} = ?A:resolve([1, 2], Plan),
    ?assertEqual([1, 2], [Robot || {Robot, _} <- Moves]),
    ?assertEqual([1, 2], lists:sort([E || {_, Path} <- Moves, {_, {down, E}} <- Path])),
    starl_dpp_world:disjoint(?P:unsafe(Next), Next),
    ?assertEqual({Moves, Next}, ?A:resolve([2, 1, 2], Plan)).

%% One that is on its way waits for nothing; nothing is resolved while a place is unknown.
resolve_standing_test() ->
    Plan = parked([2], moves(1, new([short()], 2))),
    ?assertMatch({[{2, _}], _}, ?A:resolve([1, 2], Plan)),
    ?assertEqual({[], Plan}, ?A:resolve([1], Plan)),
    Unknown = parked([1, 2], new([short()], 3)),
    ?assertEqual({[], Unknown}, ?A:resolve([1, 2], Unknown)).

%% Two stand too near to the line to let the other paint it: the one that is nearer to it stays, the
%% other goes off its way to the line and along it, not to a parking spot.
resolve_clears_the_way_test() ->
    [
        begin
            Plan = stand([{1, {X1, 6000.0}}, {3, {X3, 6000.0}}], parked([2], new([short()], 3))),
            {[{Goes, Path}], Next} = ?A:resolve([1, 2, 3], Plan),
            {P, up} = lists:last(Path),
            ?assert(starl_geometry:point_segment(P, {{From, 6000.0}, {To, 6000.0}}) > 2 * ?R),
            ?assert(starl_geometry:point_segment(P, short()) < 6 * ?R),
            starl_dpp_world:disjoint(?P:unsafe(Next), Next),
            %% once more it would have to park
            {[{Goes, Parks}], _} = ?A:resolve([1, 2, 3], stand([{Goes, at(Goes, Plan)}], Next)),
            ?assert(lists:member(element(1, lists:last(Parks)), spots(Plan)))
        end
     || {X1, X3, Goes, From, To} <- [
            {5800.0, 6310.0, 3, 5800.0, 6100.0}, {5790.0, 6300.0, 1, 6000.0, 6300.0}
        ]
    ].

at(Robot, Plan) ->
    {P, _} = ?P:stands(Robot, Plan),
    P.

spots(Plan) -> [?P:spot(Robot, Plan) || {Robot, _} <- ?P:spots(Plan)].

%% Nobody could paint anything if the others were away, because of one that does not wait: the
%% outermost of those that can parks, one alone; who is parked already goes nowhere.
resolve_parks_the_outermost_test() ->
    Dead = stand([{4, {6050.0, 6010.0}}], new([short()], 4)),
    Inside = {1, {6000.0, 9000.0}},
    Outside = {2, {10800.0, 6000.0}},
    Crowd = stand([Inside, Outside], parked([3], Dead)),
    {[{2, Path}], _} = ?A:resolve([1, 2, 3], Crowd),
    ?assert(lists:member(element(1, lists:last(Path)), spots(Crowd))),
    {[{1, _}], _} = ?A:resolve([1, 2, 3], parked([2], Crowd)),
    ?assertMatch({[], _}, ?A:resolve([1, 2, 3], parked([1, 2], Crowd))).

%% The one that is nearest to a line cannot get there, and nobody of those that wait is in its way:
%% dead robots are. Of the others the outermost that can parks first.
resolve_without_blockers_test() ->
    Line = {{6900.0, 6000.0}, {6900.0, 6100.0}},
    Around = fun(Robot, Min, Max, Plan) ->
        Path = [{{Max, Min}, up}, {{Max, Max}, up}, {{Min, Max}, up}, {{Min, Min + 100.0}, up}],
        Held = ?P:adopt(Robot, {Min, Min}, Path, Plan),
        ?assertEqual(0, ?P:blocking(Robot, Held)),
        Held
    end,
    Shut = Around(4, 5000.0, 7400.0, Around(3, 5550.0, 6450.0, new([Line], 4))),
    Plan = stand([{1, {6000.0, 6000.0}}, {2, {9000.0, 9000.0}}], Shut),
    {[{2, Path}], _} = ?A:resolve([1, 2], Plan),
    ?assert(lists:member(element(1, lists:last(Path)), spots(Plan))).

%%% What is in reach

%% Of several lines one in reach is enough.
reachable_test() ->
    Plan = stand([{2, {6050.0, 6010.0}}], parked([1, 3], new([short(), far()], 3))),
    ?assert(?A:reachable([1, 3], Plan)),
    Done = ?P:mark_painted([2], Plan),
    ?assertNot(?A:reachable([1, 3], Done)),
    ?assert(?A:reachable([1, 2, 3], Done)),
    ?assertNot(?A:reachable([], Done)),
    ?assertNot(?A:reachable([1, 2, 3], ?P:mark_painted([1, 2], Plan))).

%% A dead robot that stands at one end of a line closes all of it.
one_end_is_closed_test() ->
    Line = {{6000.0, 6000.0}, {6495.0, 6000.0}},
    Dead = fun(At) -> stand([{2, At}], parked([1], new([Line], 2))) end,
    ?assertMatch(#{total := 1}, ?P:counts(Dead({6500.0, 6000.0}))),
    [
        ?assertNot(?A:reachable([1], Dead(At)))
     || At <- [{6500.0, 6000.0}, {5995.0, 6000.0}]
    ],
    ?assert(?A:reachable([1], Dead({6495.0 + 2 * ?R + 1.0, 6000.0}))).

%% A dead robot that held a way all around the line closes it, though it is far from it.
all_around_test() ->
    {X0, Y0, X1, Y1} = {4500.0, 4500.0, 7600.0, 7500.0},
    Around = [{{X1, Y0}, up}, {{X1, Y1}, up}, {{X0, Y1}, up}, {{X0, Y0 + 100.0}, up}],
    Plan = ?P:adopt(2, {X0, Y0}, Around, parked([1], new([short()], 2))),
    ?assertEqual(0, ?P:blocking(2, Plan)),
    ?assertNot(?A:reachable([1], Plan)),
    ?assert(?A:reachable([1, 2], Plan)).

%% The live robots come from their own spots: who is shut in there reaches nothing, though a way
%% leads from the spot of a dead one.
shut_in_on_its_spot_test() ->
    {X, Y} = ?P:spot(1, new([short()], 2)),
    Plan = parked([1], new([short()], 2)),
    Before = {X, Y + 2 * ?R + 30.0},
    ?assertEqual(?R, Y),
    ?assertNot(?A:reachable([1], stand([{2, Before}], Plan))),
    ?assert(?A:reachable([1], parked([2], Plan))).
