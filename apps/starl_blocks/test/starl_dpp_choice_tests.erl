%% The job that is chosen is the one with the most ink per distance of all there are: what is not
%% looked at, since it cannot win, would not have won.
-module(starl_dpp_choice_tests).
-include_lib("eunit/include/eunit.hrl").

%% More than any chain has here.
-define(HORIZON, 9000.0).

the_best_of_all_test_() ->
    [{timeout, 30, fun() -> the_best_of_all(Seed) end} || Seed <- lists:seq(1, 50)].

the_best_of_all(Seed) ->
    {View, At} = drawn(rand:seed_s(exsss, Seed)),
    ?assertEqual({Seed, plain(View)}, {Seed, painted(At, View, ?HORIZON)}).

%% The edges that the job paints.
painted(At, View, Horizon) ->
    Settings = #{
        horizon => Horizon, choice => ink, overhead_mm => 100.0, middle => 0.7, reach => infinity
    },
    case starl_dpp_choice:best(At, View, Settings) of
        {ok, #{path := Path}} -> [E || {_, {down, E}} <- Path];
        none -> none
    end.

%% The edge on which the horizon is passed is the last one.
up_to_the_horizon_test() ->
    At = {2000.0, 5000.0},
    {ok, Plan0} = starl_dpp_plan:new((config([{At, {3000.0, 5000.0}}]))#{edge_length => 100.0}),
    Plan1 = starl_dpp_plan:standing(2, {7000.0, 7000.0}, Plan0),
    View = starl_dpp_plan:view(1, starl_dpp_plan:standing(1, At, Plan1)),
    [
        ?assertEqual({Horizon, N}, {Horizon, length(painted(At, View, Horizon))})
     || {Horizon, N} <- [{50.0, 1}, {450.0, 5}, {1500.0, 10}]
    ].

%% Lines are begun at no more than 40 places, the nearest ones: of those the best is taken, though a
%% line farther away has more ink for what it costs. As many are tried if the first line alone has
%% as much ink as is painted in one go.
as_many_tries_test() ->
    At = {2000.0, 5000.0},
    Short = fun(N) ->
        [{{2000.0 + 10.0 * I, 5200.0}, {2000.0 + 10.0 * I, 5210.0}} || I <- lists:seq(1, N)]
    end,
    Long = {{6000.0, 5000.0}, {6000.0, 7000.0}},
    Ink = fun(N, Horizon) ->
        {ok, Plan0} = starl_dpp_plan:new(config([Long | Short(N)])),
        Plan1 = starl_dpp_plan:standing(2, {7400.0, 2000.0}, Plan0),
        Plan = starl_dpp_plan:standing(1, At, Plan1),
        Edges = painted(At, starl_dpp_plan:view(1, Plan), Horizon),
        round(lists:sum([starl_geometry:length(starl_dpp_plan:target(E, Plan)) || E <- Edges]))
    end,
    ?assertEqual([2000, 10], [Ink(19, ?HORIZON), Ink(20, ?HORIZON)]),
    ?assertEqual([1000, 10], [Ink(N, 900.0) || N <- [19, 20]]).

%% A line that is farther away, but longer, wins by however little it has more ink for what it
%% costs. One of 1 m, 100 mm away, and one of 2 m, some 300 mm away in the other direction: with
%% 100 mm for an assignment both have 5/6 at just 300 mm.
won_by_a_hair_test_() ->
    [
        ?_assertEqual({Away, Ink}, {Away, ink_of_two(Away)})
     || {Away, Ink} <- [{299.0, 2000}, {299.9995, 2000}, {300.0005, 1000}, {301.0, 1000}]
    ].

ink_of_two(Away) ->
    At = {5000.0, 5000.0},
    Near = {{5100.0, 5000.0}, {6100.0, 5000.0}},
    Far = {{5000.0 - Away, 5000.0}, {3000.0 - Away, 5000.0}},
    {ok, Plan0} = starl_dpp_plan:new(config([Near, Far])),
    Plan1 = starl_dpp_plan:standing(2, {7400.0, 2000.0}, Plan0),
    Plan = starl_dpp_plan:standing(1, At, Plan1),
    Edges = painted(At, starl_dpp_plan:view(1, Plan), ?HORIZON),
    round(lists:sum([starl_geometry:length(starl_dpp_plan:target(E, Plan)) || E <- Edges])).

%% All that hangs together counts, on both sides of the line that was drawn first: 1.2 m 300 mm away
%% win against half a metre 100 mm away.
drawn_from_the_middle_test() ->
    At = {5000.0, 5000.0},
    Line = fun(From, To) -> {{From, 5000.0}, {To, 5000.0}} end,
    Lines = [
        Line(4300.0, 3900.0), Line(4700.0, 4300.0), Line(3900.0, 3500.0), Line(5100.0, 5600.0)
    ],
    {ok, Plan0} = starl_dpp_plan:new(config(Lines)),
    Plan1 = starl_dpp_plan:standing(2, {7400.0, 2000.0}, Plan0),
    Plan = starl_dpp_plan:standing(1, At, Plan1),
    Edges = painted(At, starl_dpp_plan:view(1, Plan), ?HORIZON),
    ?assertEqual(3, length(Edges)).

%% Beyond the horizon the line on which it is passed counts, too: of 1.8 m instead of one it is worth
%% to turn for. A line of half a metre is 100 mm ahead, another begins 250 mm away and leads across.
line_beyond_the_horizon_test() ->
    At = {5000.0, 5000.0},
    Lines = [{{5100.0, 5000.0}, {5600.0, 5000.0}}, {{4750.0, 5000.0}, {4750.0, 6800.0}}],
    {ok, Plan0} = starl_dpp_plan:new((config(Lines))#{edge_length => 900.0}),
    Plan1 = starl_dpp_plan:standing(2, {7400.0, 2000.0}, Plan0),
    Plan = starl_dpp_plan:standing(1, At, Plan1),
    Edges = painted(At, starl_dpp_plan:view(1, Plan), 1000.0),
    ?assertEqual([900, 900], [
        round(starl_geometry:length(starl_dpp_plan:target(E, Plan)))
     || E <- Edges
    ]).

%% A robot that stands more than 3 mm beside the place that it counts as on drives there first.
beside_the_line_test_() ->
    At = {5000.0, 5000.0},
    {ok, Plan0} = starl_dpp_plan:new(config([{At, {5400.0, 5000.0}}])),
    Plan1 = starl_dpp_plan:standing(2, {7400.0, 2000.0}, Plan0),
    View = starl_dpp_plan:view(1, starl_dpp_plan:standing(1, At, Plan1)),
    Settings = #{
        horizon => ?HORIZON, choice => ink, overhead_mm => 100.0, middle => 0.7, reach => infinity
    },
    [
        fun() ->
            {ok, #{path := Path} = Job} = starl_dpp_choice:best(
                {5000.0 + Off, 5000.0}, View, Settings
            ),
            ?assertEqual(Begins ++ [{{5400.0, 5000.0}, {down, 1}}], Path),
            ?assertMatch(#{ink_mm := 400.0, travel_mm := +0.0}, Job)
        end
     || {Off, Begins} <- [{0.0, []}, {3.0, []}, {3.1, [{At, up}]}, {-3.1, [{At, up}]}]
    ].

%% What is driven with the pen up is counted to where the line begins.
travel_is_counted_test() ->
    {ok, Plan0} = starl_dpp_plan:new(config([{{5000.0, 5000.0}, {5400.0, 5000.0}}])),
    Plan1 = starl_dpp_plan:standing(2, {7400.0, 2000.0}, Plan0),
    At = {4000.0, 5000.0},
    View = starl_dpp_plan:view(1, starl_dpp_plan:standing(1, At, Plan1)),
    Settings = #{
        horizon => ?HORIZON, choice => ink, overhead_mm => 100.0, middle => 0.7, reach => infinity
    },
    {ok, #{path := Path, travel_mm := Mm}} = starl_dpp_choice:best(At, View, Settings),
    ?assertEqual([4500.0, 5000.0, 5400.0], [X || {{X, _}, _} <- Path]),
    ?assert(abs(Mm - 1000.0) < 1.0e-6).

%% Farther than the reach nothing is looked for.
reach_test_() ->
    {ok, Plan0} = starl_dpp_plan:new(config([{{5000.0, 5000.0}, {5400.0, 5000.0}}])),
    Plan1 = starl_dpp_plan:standing(2, {7400.0, 2000.0}, Plan0),
    At = {2000.0, 5000.0},
    View = starl_dpp_plan:view(1, starl_dpp_plan:standing(1, At, Plan1)),
    Settings = #{horizon => ?HORIZON, choice => ink, overhead_mm => 100.0, middle => 0.7},
    Best = fun(Reach) -> starl_dpp_choice:best(At, View, Settings#{reach => Reach}) end,
    [
        ?_assertMatch({ok, _}, Best(infinity)),
        ?_assertMatch({ok, _}, Best(4500.0)),
        ?_assertEqual(none, Best(2000.0))
    ].

%% Both ends of each free line that is not closed, until told to stop.
fold_begins_test() ->
    Lines = [{{3000.0, 3000.0}, {3400.0, 3000.0}}, {{5000.0, 5000.0}, {5400.0, 5000.0}}],
    {ok, Plan0} = starl_dpp_plan:new(config(Lines)),
    Plan1 = starl_dpp_plan:standing(1, {2000.0, 7000.0}, Plan0),
    Begins = fun(Fun, Other) ->
        View = starl_dpp_plan:view(1, starl_dpp_plan:standing(2, Other, Plan1)),
        lists:sort(starl_dpp_choice:fold_begins(Fun, [], View))
    end,
    All = fun(P, Acc) -> {continue, [P | Acc]} end,
    Ends = [P || {A, B} <- Lines, P <- [A, B]],
    ?assertEqual(lists:sort(Ends), Begins(All, {7400.0, 2000.0})),
    ?assertEqual(lists:nthtail(2, Ends), Begins(All, {3200.0, 3200.0})),
    Some = fun(N) ->
        fun
            (P, Acc) when length(Acc) =:= N - 1 -> {stop, [P | Acc]};
            (P, Acc) -> {continue, [P | Acc]}
        end
    end,
    [?assertEqual(N, length(Begins(Some(N), {7400.0, 2000.0}))) || N <- [1, 2, 3, 4]].

%% Every chain from every vertex that can be reached.
plain(#{robot := Robot} = View) ->
    Space = starl_dpp_route:space([Robot], View),
    Starts = starl_dpp_route:starts(
        starl_dpp_route:nearby(View), starl_dpp_route:obstacles(View), View
    ),
    Visit = fun(V, Cost, Heading, Acc) -> {continue, infinity, [{V, Cost, Heading} | Acc]} end,
    {_, Visited} = starl_dpp_search:run(Starts, Space, Visit, []),
    Chains = [
        {score(V, Cost, Chain, View), [E || {E, _, _} <- Chain]}
     || {V, Cost, In} <- lists:reverse(Visited),
        Step <- open(V, [], Space, View),
        Chain <- [chain(Step, In, [], Space, View)]
    ],
    case Chains of
        [] -> none;
        [First | Rest] -> element(2, lists:foldl(fun better/2, First, Rest))
    end.

better({Score, _} = Chain, {Best, _}) when Score > Best -> Chain;
better(_Chain, Best) -> Best.

score(V, Cost, Chain, #{free := Free}) ->
    Middle =
        case length(starl_dpp_free:steps(V, Free)) rem 2 of
            0 -> 0.7;
            1 -> 1.0
        end,
    Ink = lists:sum([Mm || {_, Mm, _} <- Chain]),
    Middle * Ink / (Cost + Ink + lists:sum([Turn || {_, _, Turn} <- Chain]) + 100.0).

%% Straight on along open lines.
chain({E, W, Length, Out}, In, Used, #{turn_mm := TurnMm} = Space, View) ->
    Link = {E, Length, starl_dpp_search:turn(In, Out, TurnMm)},
    Next = [
        {starl_dpp_search:turn(Out, Heading, TurnMm), Step}
     || {_, _, _, Heading} = Step <- open(W, [E | Used], Space, View)
    ],
    case lists:sort(Next) of
        [{_, Step} | _] -> [Link | chain(Step, Out, [E | Used], Space, View)];
        [] -> [Link]
    end.

open(V, Used, #{masks := Masks, own := Own}, #{free := Free, graph := Graph}) ->
    [
        Step
     || {E, _, _, _} = Step <- starl_dpp_graph:lines(V, Graph),
        starl_dpp_free:has(E, Free),
        starl_dpp_array:get(E, Masks) band (bnot Own) =:= 0,
        not lists:member(E, Used)
    ].

%% Up to nine lines, some of which cross, some of whose parts are taken, and a robot among them.
%% They have no more ends than a search tries.
drawn(Rand0) ->
    {[N, X, Y, P, Q | Numbers], _} = draws(60, Rand0),
    Segments = lists:sublist(lines(Numbers), 3 + trunc(6.9 * N)),
    {ok, Plan0} = starl_dpp_plan:new((config(Segments))#{edge_length => 900.0}),
    At = {2000.0 + 5000.0 * X, 2000.0 + 5000.0 * Y},
    Plan1 = starl_dpp_plan:standing(2, {2000.0 + 5000.0 * P, 2000.0 + 5000.0 * Q}, Plan0),
    Taken = [
        E
     || E <- lists:seq(1, maps:get(total, starl_dpp_plan:counts(Plan0))),
        lists:nth(E, Numbers ++ Numbers) < 0.2
    ],
    Plan = starl_dpp_plan:mark_painted(Taken, starl_dpp_plan:standing(1, At, Plan1)),
    {starl_dpp_plan:view(1, Plan), At}.

config(Segments) ->
    #{
        segments => Segments, world => {9000.0, 9000.0}, robots => [1, 2], tube_radius => 215.0
    }.

lines([X, Y, A, B | Numbers]) ->
    From = {2000.0 + 5000.0 * X, 2000.0 + 5000.0 * Y},
    [{From, away(From, 6.3 * A, 200.0 + 1400.0 * B)} | lines(Numbers)];
lines(_) ->
    [].

away({X, Y}, Angle, Mm) ->
    {inside(X + Mm * math:cos(Angle)), inside(Y + Mm * math:sin(Angle))}.

inside(X) -> max(1500.0, min(7500.0, X)).

draws(N, Rand) -> lists:mapfoldl(fun(_, R) -> rand:uniform_s(R) end, Rand, lists:seq(1, N)).
