%% What is reserved closes just those edges that come nearer than 2R to it (Lemma 7), through any
%% history of reservations, and what a robot has passed closes nothing any more. All is held against
%% the plain geometry.
-module(starl_dpp_unsafe_tests).
-include_lib("eunit/include/eunit.hrl").

-define(R, 215.0).
-define(NEAR, (2.0 * ?R + 1.0e-6)).

closes_what_is_near_test_() ->
    [{timeout, 30, fun() -> closes_what_is_near(Seed) end} || Seed <- lists:seq(1, 8)].

closes_what_is_near(Seed) ->
    Graph = graph(),
    Robots = [1, 2, 3, 4],
    Empty = starl_dpp_unsafe:new(Robots, Graph),
    Step = fun(I, {Held, Unsafe0, Rand0}) ->
        {Robot, Rand1} = rand:uniform_s(4, Rand0),
        {Now, Unsafe, Rand2} = change(Robot, maps:get(Robot, Held, []), Unsafe0, Rand1),
        Next = Held#{Robot => Now},
        agree(Next, Unsafe, Graph, {seed, Seed, step, I}),
        {Next, Unsafe, Rand2}
    end,
    lists:foldl(Step, {#{}, Empty, rand:seed_s(exsss, Seed)}, lists:seq(1, 25)).

%% Another reservation, or the first segments of the present one are given up.
change(Robot, Held, Unsafe, Rand0) ->
    {X, Rand1} = rand:uniform_s(Rand0),
    case Held of
        [_ | _] when X < 0.5 ->
            N = trunc(X * 2.0 * (length(Held) + 1)),
            Kept = lists:nthtail(min(N, length(Held) - 1), Held),
            {Kept, starl_dpp_unsafe:drop(Robot, N, Unsafe), Rand1};
        _ ->
            {Path, Rand2} = path(Rand1),
            {Path, starl_dpp_unsafe:set(Robot, Path, Unsafe), Rand2}
    end.

agree(Held, Unsafe, Graph, What) ->
    Edges = lists:seq(1, starl_dpp_graph:edges(Graph)),
    Masks = starl_dpp_unsafe:masks(Unsafe),
    Robots = lists:sort(maps:keys(Held)),
    Closed = [{Robot, closed(maps:get(Robot, Held), Edges, Graph)} || Robot <- Robots],
    [
        begin
            Bit = starl_dpp_unsafe:bit(Robot, Unsafe),
            Masked = [E || E <- Edges, starl_dpp_array:get(E, Masks) band Bit =/= 0],
            ?assertEqual({What, Robot, Near}, {What, Robot, Masked}),
            ?assertEqual(
                {What, Robot, Near},
                {What, Robot, lists:sort(starl_dpp_unsafe:blocks(Robot, Unsafe))}
            ),
            Own = maps:get(Robot, Held),
            ?assertEqual({What, Own}, {What, starl_dpp_unsafe:held(Robot, Unsafe)}),
            {_, End} = lists:last(Own),
            ?assertEqual(
                {lists:sum([starl_geometry:length(S) || S <- Own]), End},
                starl_dpp_unsafe:rest(Robot, Unsafe)
            )
        end
     || {Robot, Near} <- Closed
    ],
    ?assertEqual({What, maps:to_list(Held)}, {What, starl_dpp_unsafe:all(Unsafe)}).

closed(Held, Edges, Graph) ->
    [
        E
     || E <- Edges,
        lists:any(
            fun(S) ->
                starl_geometry:segment_segment(S, starl_dpp_graph:segment(E, Graph)) < ?NEAR
            end,
            Held
        )
    ].

%% A line is clear if it stays 2R from all that the others hold; for a robot that is nearer than
%% that to another already, if it comes no nearer to that one.
clear_of_the_others_test_() ->
    [fun() -> clear_of_the_others(Seed) end || Seed <- lists:seq(1, 20)].

clear_of_the_others(Seed) ->
    {Paths, Rand} = paths(4, rand:seed_s(exsss, Seed)),
    [[{P, _} | _] | Others] = Paths,
    Unsafe = lists:foldl(
        fun({Robot, Path}, Acc) -> starl_dpp_unsafe:set(Robot, Path, Acc) end,
        starl_dpp_unsafe:new([1, 2, 3, 4], graph()),
        [{1, [{P, P}]} | lists:zip([2, 3, 4], Others)]
    ),
    {Lines, _} = path(20, P, Rand),
    Obstacles = starl_dpp_unsafe:others(1, Unsafe),
    [
        ?assertEqual(
            {Seed, Line, is_clear(Line, P, Others)},
            {Seed, Line, starl_dpp_unsafe:clear(Line, Obstacles)}
        )
     || Line <- Lines
    ].

is_clear(Line, P, Others) ->
    lists:all(
        fun(Held) ->
            Now = lists:min([starl_geometry:point_segment(P, S) || S <- Held]),
            Least =
                case Now < ?NEAR of
                    true -> Now - 1.0e-6;
                    false -> ?NEAR
                end,
            lists:all(fun(S) -> starl_geometry:segment_segment(S, Line) >= Least end, Held)
        end,
        Others
    ).

%% Who stands too near to another moves straight away from the nearest one until it is far enough;
%% who is far enough stays.
away_test() ->
    Stand = fun(P) -> [{P, P}] end,
    Unsafe = lists:foldl(
        fun({Robot, P}, Acc) -> starl_dpp_unsafe:set(Robot, Stand(P), Acc) end,
        starl_dpp_unsafe:new([1, 2, 3, 4], graph()),
        [{2, {8000.0, 8000.0}}, {3, {4000.0, 4000.0}}, {4, {4000.0, 4700.0}}]
    ),
    Away = fun(P) -> starl_dpp_unsafe:away(1, P, Unsafe) end,
    ?assertEqual({4000.0, 3500.0}, Away({4000.0, 3500.0})),
    {X, Y} = Away({4000.0, 3600.0}),
    ?assertEqual(4000.0, X),
    ?assert(abs(Y - (4000.0 - ?NEAR)) < 1.0e-5).

%% Also for a robot whose own place is not known.
others_of_the_unknown_test() ->
    Unsafe = starl_dpp_unsafe:set(
        2, [{{4000.0, 4000.0}, {4000.0, 4000.0}}], starl_dpp_unsafe:new([1, 2], graph())
    ),
    Clear = fun(X) ->
        starl_dpp_unsafe:clear(
            {{X, 3000.0}, {X, 5000.0}}, starl_dpp_unsafe:others(1, Unsafe)
        )
    end,
    ?assertEqual([true, false, false, true], [
        Clear(4000.0 + D)
     || D <- [-431.0, -429.0, 429.0, 431.0]
    ]),
    ?assertEqual([1], starl_dpp_unsafe:unknown(Unsafe)),
    ?assertEqual([], starl_dpp_unsafe:held(1, Unsafe)),
    ?assertEqual([], starl_dpp_unsafe:others(2, Unsafe)).

%% Where a stopped robot counts as standing: the nearest point that it held, up to the slack away.
nominal_test() ->
    Held = [{{0.0, 0.0}, {100.0, 0.0}}, {{100.0, 0.0}, {100.0, 100.0}}],
    ?assertEqual({50.0, 0.0}, starl_dpp_unsafe:nominal({50.0, 9.0}, Held, 9.0)),
    ?assertEqual({50.0, 9.1}, starl_dpp_unsafe:nominal({50.0, 9.1}, Held, 9.0)),
    ?assertEqual({100.0, 40.0}, starl_dpp_unsafe:nominal({97.0, 40.0}, Held, 9.0)),
    ?assertEqual({100.0, 100.0}, starl_dpp_unsafe:nominal({100.0, 105.0}, Held, 9.0)),
    ?assertEqual({1.0, 1.0}, starl_dpp_unsafe:nominal({1.0, 1.0}, [], 9.0)).

%% -- what is drawn --------------------------------------------------------------------------

%% What is closed keeps all away until it is opened: then no edge and no segment is closed any more, but for those that
%% robots hold.
what_was_closed_is_open_again_test() ->
    Wall = [{{2500.0, 3000.0}, {5500.0, 3000.0}}],
    Held = starl_dpp_unsafe:set(
        1, [{{2500.0, 3200.0}, {2600.0, 3200.0}}], starl_dpp_unsafe:new([1, 2], graph())
    ),
    Twice = starl_dpp_unsafe:close(
        [{{5000.0, 5000.0}, {5000.0, 5100.0}}], 300.0, starl_dpp_unsafe:close(Wall, 300.0, Held)
    ),
    Masks = fun(Unsafe) ->
        Masks = starl_dpp_unsafe:masks(Unsafe),
        [starl_dpp_array:get(E, Masks) || E <- lists:seq(1, starl_dpp_graph:edges(graph()))]
    end,
    Clear = fun(Unsafe) ->
        starl_dpp_unsafe:clear(
            {{5000.0, 2000.0}, {5000.0, 4000.0}}, starl_dpp_unsafe:others(2, Unsafe)
        )
    end,
    ?assert(Masks(Twice) =/= Masks(Held)),
    ?assertEqual([true, false], [Clear(Held), Clear(Twice)]),
    Open = starl_dpp_unsafe:open(Twice),
    ?assertEqual(Masks(Held), Masks(Open)),
    ?assert(Clear(Open)),
    ?assertEqual(starl_dpp_unsafe:all(Held), starl_dpp_unsafe:all(Open)).

graph() ->
    {ok, Plan} = starl_dpp_plan:new(#{
        segments => [{{X, 2000.0}, {X + 900.0, 6500.0}} || X <- [2000.0, 3000.0, 3100.0, 5000.0]],
        world => {9000.0, 9000.0},
        robots => [1, 2, 3, 4],
        tube_radius => ?R
    }),
    starl_dpp_plan:graph(Plan).

paths(0, Rand) ->
    {[], Rand};
paths(N, Rand0) ->
    {Path, Rand1} = path(Rand0),
    {Paths, Rand2} = paths(N - 1, Rand1),
    {[Path | Paths], Rand2}.

%% A point, or up to twelve segments, some of them short.
path(Rand0) ->
    {X, Rand1} = rand:uniform_s(Rand0),
    {Y, Rand2} = rand:uniform_s(Rand1),
    {N, Rand3} = rand:uniform_s(13, Rand2),
    From = {1500.0 + 6000.0 * X, 1500.0 + 6000.0 * Y},
    case N of
        13 -> {[{From, From}], Rand3};
        _ -> path(N, From, Rand3)
    end.

path(0, _From, Rand) ->
    {[], Rand};
path(N, {X, Y} = From, Rand0) ->
    {A, Rand1} = rand:uniform_s(Rand0),
    {B, Rand2} = rand:uniform_s(Rand1),
    Mm =
        case A < 0.3 of
            true -> 60.0;
            false -> 500.0
        end,
    To = {X + Mm * math:cos(6.3 * B), Y + Mm * math:sin(6.3 * B)},
    {Path, Rand3} = path(N - 1, To, Rand2),
    {[{From, To} | Path], Rand3}.
