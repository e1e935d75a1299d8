%% What a request is answered while others are on their way: what a search and the rules of patience
%% come to, whether it was searched or not and however far. And a search that is cut short misses
%% nothing but what is more than 2 m round about before its corners are cut.
-module(starl_dpp_patience_tests).
-include_lib("eunit/include/eunit.hrl").

-define(R, 215.0).

%% In whole runs every answer is that of a search, held against the rules afterwards. Counted are
%% those that found work and left it to others, so that the rules are known to have been at work.
answers_are_those_of_a_search_test_() ->
    [
        {
            lists:concat([Name, ", ", N, " robots, seed ", Seed]),
            {timeout, 30, fun() -> ?assert(left_to_others(Name, N, Seed) > 0) end}
        }
     || {Name, N, Seed} <- [{text, 8, 1}, {grid, 10, 2}, {circles, 10, 3}, {lines, 6, 4}]
    ].

left_to_others(Name, N, Seed) ->
    Count = counters:new(1, []),
    Trace = fun(_Now, Robot, Plan, _Robots) -> compare(Robot, Plan, Count) end,
    Config = config(starl_dpp_pictures:picture(Name, Seed), N),
    _ = starl_dpp_world:run(#{
        plan => Config#{seed => Seed}, seed => Seed, make_way => true, trace => Trace
    }),
    counters:get(Count, 1).

compare(Robot, Plan, Count) ->
    {Answer, _} = starl_dpp_assign:request(Robot, Plan),
    case {answer(Robot, Plan), Answer} of
        {_, complete} ->
            ok;
        {Same, Same} ->
            ok;
        {{left, _}, none} ->
            counters:add(Count, 1, 1);
        %% what was not found is round about
        {{assign, Path}, none} ->
            round_about(Robot, Path, Plan);
        %% the best of all was left to others, or is round about; what was found instead is not left
        {{left, _}, {assign, Other}} ->
            ?assertNot(is_left(Robot, Other, Plan));
        {{assign, Path}, {assign, Other}} ->
            ?assertNot(is_left(Robot, Other, Plan)),
            round_about(Robot, Path, Plan)
    end.

round_about(Robot, Path, Plan) ->
    ?assertNotMatch({ok, #{path := Path}}, best(Robot, driven(Robot, Path, Plan) + 2000.0, Plan)).

%% The plain way: search, then ask whether to take it.
answer(Robot, Plan) ->
    case best(Robot, infinity, Plan) of
        none ->
            none;
        {ok, #{path := Path}} ->
            case starl_dpp_plan:others_move(Robot, Plan) andalso is_left(Robot, Path, Plan) of
                true -> {left, Path};
                false -> {assign, Path}
            end
    end.

best(Robot, Reach, Plan) ->
    {_, Really} = starl_dpp_plan:stands(Robot, Plan),
    Settings = maps:with([choice, horizon, overhead_mm, middle], starl_dpp_plan:config(Plan)),
    View = starl_dpp_plan:view(Robot, Plan),
    starl_dpp_choice:best(Really, View, Settings#{reach => Reach}).

is_left(Robot, Path, Plan) ->
    {P, _} = starl_dpp_plan:stands(Robot, Plan),
    case [Q || {Q, up} <- Path] of
        [] -> false;
        Ways -> left(Robot, P, lists:last(Ways), driven(Robot, Path, Plan), Plan)
    end.

driven(Robot, Path, Plan) ->
    {P, _} = starl_dpp_plan:stands(Robot, Plan),
    Points = [P | [Q || {Q, up} <- Path]],
    Pairs = lists:zip(lists:droplast(Points), tl(Points)),
    lists:sum([starl_geometry:distance(A, B) || {A, B} <- Pairs]).

left(Robot, P, Begin, Driven, Plan) ->
    Driven > 1.05 * starl_geometry:distance(P, Begin) + 50.0 orelse
        (Driven > 2000.0 andalso
            lists:any(
                fun({Id, Held}) -> Id =/= Robot andalso way(Held, Begin) + 1000.0 < Driven end,
                starl_dpp_plan:unsafe(Plan)
            )).

way(Held, Target) ->
    {_, End} = lists:last(Held),
    lists:sum([starl_geometry:length(S) || S <- Held]) + starl_geometry:distance(End, Target).

%% Another ends its way 500 mm beside the line: whoever is as far as 2.5 m leaves it to that one,
%% from 1.8 m away it is taken.
near_work_is_taken_test_() ->
    [
        fun() -> ?assertMatch({Answer, _}, {element(1, first(asked(Mm))), Mm}) end
     || {Mm, Answer} <- [{1800.0, assign}, {2500.0, none}]
    ].

first({{assign, _} = Answer, _}) -> Answer;
first({none, _}) -> {none}.

asked(Mm) ->
    {ok, Plan0} = starl_dpp_plan:new(config([{{6000.0, 6000.0}, {7000.0, 6000.0}}], 2)),
    Plan1 = starl_dpp_plan:standing(1, {6000.0 - Mm, 6000.0}, Plan0),
    Plan2 = starl_dpp_plan:adopt(2, {6000.0, 6700.0}, [{{6000.0, 6500.0}, up}], Plan1),
    starl_dpp_assign:request(1, Plan2).

%% As soon as another is nearer by more than a metre; not where it is just that.
just_a_metre_nearer_test_() ->
    [
        fun() -> ?assertEqual({Mm, Answer}, {Mm, element(1, first(asked_beside(standing(Mm))))}) end
     || {Mm, Answer} <- [{1500.0, assign}, {1499.0, none}]
    ].

%% Robot 2 stands so far above the beginning of the line.
standing(Mm) -> fun(Plan) -> starl_dpp_plan:standing(2, {6000.0, 6000.0 + Mm}, Plan) end.

%% Up to 200 free edges are looked at to see how far a robot would go; of more, one is near.
reach_test_() ->
    [
        fun() -> ?assertEqual({N, IsNear}, {N, reach(N) < 20000.0}) end
     || {N, IsNear} <- [{199, true}, {200, true}, {201, false}]
    ].

%% Of a line of so many edges.
reach(N) ->
    End = 3000.0 + 10.0 * N,
    Config = (config([{{3000.0, 6000.0}, {End, 6000.0}}], 1))#{edge_length => 10.0},
    {ok, Plan0} = starl_dpp_plan:new(Config),
    ?assertMatch(#{free := N}, starl_dpp_plan:counts(Plan0)),
    starl_dpp_patience:reach(1, starl_dpp_plan:standing(1, {2000.0, 6000.0}, Plan0)).

%% A robot that stands at the work is left that work, unless it is known to say nothing any more; as
%% soon as it is heard again it is.
the_dead_do_no_work_test_() ->
    Beside = {6000.0, 6500.0},
    Silent = fun(Plan) -> starl_dpp_plan:silent(2, Beside, Plan) end,
    [
        {Name, fun() -> ?assertEqual(Answer, element(1, first(asked_beside(Second)))) end}
     || {Name, Answer, Second} <- [
            {"alive", none, fun(Plan) -> starl_dpp_plan:standing(2, Beside, Plan) end},
            {"dead", assign, Silent},
            {"back", none, fun(Plan) -> starl_dpp_plan:standing(2, Beside, Silent(Plan)) end},
            {"back on its way", none, fun(Plan) ->
                starl_dpp_plan:adopt(2, {6000.0, 6700.0}, [{Beside, up}], Silent(Plan))
            end}
        ]
    ].

asked_beside(Second) ->
    {ok, Plan0} = starl_dpp_plan:new(config([{{6000.0, 6000.0}, {7000.0, 6000.0}}], 3)),
    Plan1 = starl_dpp_plan:standing(1, {3500.0, 6000.0}, Plan0),
    Plan2 = starl_dpp_plan:adopt(3, {9000.0, 2000.0}, [{{9000.0, 1500.0}, up}], Second(Plan1)),
    starl_dpp_assign:request(1, Plan2).

%% Short lines are near, and what hangs together is more elsewhere: the search goes on for it.
more_ink_is_farther_away_test_() ->
    Short = [{{X, 1600.0}, {X + 20.0, 1600.0}} || X <- [1500.0, 1900.0, 2300.0]],
    Long = {{3500.0, 6000.0}, {6000.0, 6000.0}},
    [
        fun() -> ?assertEqual(2500, round(first_ink(Segments))) end
     || Segments <- [[Long | Short], Short ++ [Long]]
    ].

%% What hangs together is painted in one go, also where it is bent.
pieces_hang_together_test() ->
    Corner = {4000.0, 4000.0},
    ?assertEqual(1500, round(first_ink([{{3000.0, 4000.0}, Corner}, {Corner, {4000.0, 4500.0}}]))).

first_ink(Segments) ->
    {ok, Plan0} = starl_dpp_plan:new(config(Segments, 1)),
    Plan = starl_dpp_plan:standing(1, {1500.0, 1500.0}, Plan0),
    {{assign, Path}, _} = starl_dpp_assign:request(1, Plan),
    Edges = [E || {_, {down, E}} <- Path],
    lists:sum([starl_geometry:length(starl_dpp_plan:target(E, Plan)) || E <- Edges]).

config(Segments, N) ->
    #{
        segments => Segments,
        world => {12000.0, 12000.0},
        robots => lists:seq(1, N),
        tube_radius => ?R
    }.

%% How far a robot would go: 1.05 times as far as the farthest end of a line is, and 50 mm; 2 m more
%% for turns. Less where another is before it: no farther than the other has to go, and a metre, but
%% 2 m in any case. Not at all if others are before it everywhere.
how_far_test_() ->
    Near = {{4000.0, 6000.0}, {4400.0, 6000.0}},
    Far = {{7000.0, 6000.0}, {7400.0, 6000.0}},
    Reach = fun(Lines, Rival) ->
        {ok, Plan0} = starl_dpp_plan:new(config(Lines, 2)),
        Plan1 = starl_dpp_plan:standing(1, {3000.0, 6000.0}, Plan0),
        starl_dpp_patience:reach(1, Rival(Plan1))
    end,
    Nobody = fun(Plan) -> starl_dpp_plan:silent(2, {3000.0, 9000.0}, Plan) end,
    At = fun(P) -> fun(Plan) -> starl_dpp_plan:standing(2, P, Plan) end end,
    Is = fun(Mm, Got) -> ?assert(abs(Mm - Got) < 1.0e-6, {Mm, Got}) end,
    [
        fun() -> Is(1.05 * 4400.0 + 50.0 + 2000.0, Reach(Lines, Nobody)) end
     || Lines <- [[Near, Far], [Far, Near], [Far]]
    ] ++
        [
            fun() -> Is(1.05 * 1400.0 + 50.0 + 2000.0, Reach([Near], At({3000.0, 6500.0}))) end,
            %% 3.1 m from the nearer end, which is 4 m away; at the other the rival is first
            fun() -> Is(3100.0 + 1000.0 + 2000.0, Reach([Far], At({7000.0, 9100.0}))) end,
            fun() -> ?assertEqual(none, Reach([Far], At({7200.0, 6500.0}))) end,
            %% half a millimetre before it is before it
            fun() ->
                Line = {{7000.0, 6000.0}, {7008.0, 6000.0}},
                ?assertEqual(none, Reach([Line], At({7000.0, 8999.5}))),
                ?assertNotEqual(none, Reach([Line], At({7000.0, 9012.0})))
            end,
            %% 2 m are driven in any case
            fun() ->
                Is(4000.0, Reach([{{4990.0, 6000.0}, {4998.0, 6000.0}}], At({4994.0, 6440.0})))
            end
        ].

%% Who has all the patience in the world takes every way.
no_patience_test() ->
    Config = config([{{7000.0, 6000.0}, {7400.0, 6000.0}}], 2),
    {ok, Plan0} = starl_dpp_plan:new(Config#{patience => infinity}),
    Plan1 = starl_dpp_plan:standing(2, {7200.0, 6500.0}, Plan0),
    Plan2 = starl_dpp_plan:standing(1, {3000.0, 6000.0}, Plan1),
    ?assertEqual(infinity, starl_dpp_patience:reach(1, Plan2)),
    Job = #{path => [{{7000.0, 6000.0}, up}], travel_mm => 90000.0, ink_mm => 1.0},
    ?assertNot(starl_dpp_patience:waits(1, Job, Plan2)).

%% A way is too long round about if it is more than 1.05 times the straight one and 50 mm; work
%% that begins where the robot stands is never that.
waits_test_() ->
    {ok, Plan0} = starl_dpp_plan:new(config([{{4000.0, 6000.0}, {4400.0, 6000.0}}], 2)),
    Plan1 = starl_dpp_plan:silent(2, {9000.0, 9000.0}, Plan0),
    Plan = starl_dpp_plan:standing(1, {3000.0, 6000.0}, Plan1),
    Waits = fun(Path, Mm) ->
        starl_dpp_patience:waits(1, #{path => Path, travel_mm => Mm, ink_mm => 400.0}, Plan)
    end,
    Way = [{{3500.0, 6000.0}, up}, {{4000.0, 6000.0}, up}, {{4400.0, 6000.0}, {down, 1}}],
    [
        ?_assertNot(Waits(Way, 1100.0)),
        ?_assert(Waits(Way, 1100.1)),
        ?_assertNot(Waits([{{4400.0, 6000.0}, {down, 1}}], 0.0))
    ].
