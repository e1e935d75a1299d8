-module(starl_contact_tests).
-include_lib("eunit/include/eunit.hrl").

-define(R, 165.0).
%% The bound of a contract of bodies and walls.
-define(DEEP_MM, 0.1).

a_robot_that_drives_to_a_wall_stops_at_its_face_test() ->
    Piece = starl_trajectory:piece(0, {0.0, 0.0}, 0.0, 500.0, 0.0),
    Wall = {{1165.0, -500.0}, {1165.0, 500.0}},
    {At, 7} = starl_contact:wall(Piece, ?R, [{7, Wall}], 0, 10000000),
    ?assert(At =< 2000000 andalso At > 1999990).

a_robot_that_touches_may_leave_and_slide_but_not_press_test() ->
    Wall = [{1, {{165.0, -500.0}, {165.0, 500.0}}}],
    At = fun(Heading) ->
        Piece = starl_trajectory:piece(0, {0.0, 0.0}, Heading, 500.0, 0.0),
        starl_contact:wall(Piece, ?R, Wall, 0, 500000)
    end,
    ?assertEqual({0, 1}, At(0.0)),
    ?assertEqual({0, 1}, At(1.0)),
    ?assertEqual(none, At(math:pi() / 2)),
    ?assertEqual(none, At(math:pi())).

a_robot_that_stands_in_a_wall_may_get_out_test() ->
    Wall = [{1, {{100.0, -500.0}, {100.0, 500.0}}}],
    Out = starl_trajectory:piece(0, {0.0, 0.0}, math:pi(), 500.0, 0.0),
    In = starl_trajectory:piece(0, {0.0, 0.0}, 0.0, 500.0, 0.0),
    ?assertEqual(none, starl_contact:wall(Out, ?R, Wall, 0, 1000000)),
    ?assertEqual({0, 1}, starl_contact:wall(In, ?R, Wall, 0, 1000000)).

%% Pressing on an arc against a wall that it touches is a contact now, not a lap later.
a_robot_that_presses_on_an_arc_is_held_test() ->
    Wall = [{1, {{165.0, -500.0}, {165.0, 500.0}}}],
    Press = starl_trajectory:piece(0, {0.0, 0.0}, 0.0, 200.0, 1.0),
    ?assertEqual({0, 1}, starl_contact:wall(Press, ?R, Wall, 0, 10000000)),
    %% one that leaves comes back after its lap
    Leave = starl_trajectory:piece(0, {0.0, 0.0}, 0.75 * math:pi(), 200.0, 1.0),
    {At, 1} = starl_contact:wall(Leave, ?R, Wall, 0, 10000000),
    ?assert(At > 4000000).

two_that_drive_at_each_other_meet_in_the_middle_test() ->
    A = starl_trajectory:piece(0, {0.0, 0.0}, 0.0, 500.0, 0.0),
    B = starl_trajectory:piece(0, {1330.0, 0.0}, math:pi(), 500.0, 0.0),
    At = starl_contact:bodies(A, B, 330.0, 0, 5000000),
    ?assert(At =< 1000000 andalso At > 999990),
    ?assert(starl_contact:towards({1330.0, 0.0}, 0, A)),
    ?assertNot(starl_contact:towards({-1330.0, 0.0}, 0, A)).

%% A path strays by 0.005 mm from its chord, and the body counts as thicker by that: twice 0.005; a
%% micrometre before it; rounded down to a microsecond, at less than 1.3 m/s.
-define(EARLY, 2 * 0.005 + 0.001 + 0.0013).

%% Random drives against random walls, compared with many looks at the distance: no contact is
%% missed, and none is told too early.
contacts_agree_with_dense_looks_test_() ->
    {timeout, 60, fun() -> tries(600, seed(), fun wall_case/1) end}.

meetings_agree_with_dense_looks_test_() ->
    {timeout, 60, fun() -> tries(200, seed(), fun pair_case/1) end}.

seed() ->
    case os:getenv("STARL_SEED") of
        false -> erlang:phash2(make_ref(), 1 bsl 27);
        Text -> list_to_integer(Text)
    end.

tries(N, Seed, Case) ->
    _ = rand:seed(exsss, Seed),
    lists:foreach(
        fun(K) ->
            case Case(rand:seed_s(exsss, {Seed, K, 0})) of
                ok -> ok;
                Why -> error({Why, {'STARL_SEED', Seed}, {case_number, K}})
            end
        end,
        lists:seq(1, N)
    ).

wall_case(State0) ->
    {Piece, State1} = piece(State0),
    {[X, Y, L, A], _} = draws([{-900, 900}, {-900, 900}, {0, 800}, {-3.2, 3.2}], State1),
    Wall = {{X, Y}, {X + L * math:cos(A), Y + L * math:sin(A)}},
    Until = 3000000,
    Away = fun(T) -> starl_geometry:point_segment(starl_trajectory:position(T, Piece), Wall) end,
    %% where it begins in the wall, leaving it is another matter
    case Away(0) > ?R of
        false ->
            ok;
        true ->
            judged(starl_contact:wall(Piece, ?R, [{1, Wall}], 0, Until), Away, ?R, ?EARLY, Until)
    end.

pair_case(State0) ->
    {A, State1} = piece(State0),
    {B, State2} = piece(State1),
    {[X, Y], _} = draws([{-1500, 1500}, {-1500, 1500}], State2),
    Far = setelement(4, setelement(3, B, X), Y),
    Away = fun(T) ->
        starl_geometry:distance(
            starl_trajectory:position(T, A), starl_trajectory:position(T, Far)
        )
    end,
    Until = 3000000,
    case {Away(0) > 2 * ?R, starl_contact:bodies(A, Far, 2 * ?R, 0, Until)} of
        {false, _} -> ok;
        {true, none} -> judged(none, Away, 2 * ?R, 0.05, Until);
        {true, At} -> judged({At, 1}, Away, 2 * ?R, 0.05, Until)
    end.

judged(Contact, Away, R, Early, Until) ->
    Last =
        case Contact of
            {At, 1} -> At;
            none -> Until
        end,
    Least = lists:min([Away(I * Last div 600) || I <- lists:seq(0, 600)]),
    IsSound = Least >= R,
    IsDue = Contact =:= none orelse Away(Last) =< R + Early,
    case {IsSound, IsDue} of
        {true, true} -> ok;
        {false, _} -> {missed, R - Least};
        {_, false} -> {early, Away(Last) - R}
    end.

piece(State0) ->
    {[Kind, Heading, V, W], State1} = draws([{0, 3}, {-3.2, 3.2}, {-500, 500}, {-4, 4}], State0),
    {[X0, Y0, X1, Y1, S], State2} = draws(
        [{-500, 500}, {-500, 500}, {-350, 350}, {-350, 350}, {0, 0.5}], State1
    ),
    case trunc(Kind) of
        0 ->
            {starl_trajectory:piece(0, {0.0, 0.0}, Heading, V, 0.0), State2};
        1 ->
            {starl_trajectory:piece(0, {0.0, 0.0}, Heading, V, W), State2};
        _ ->
            Us = trunc(1.0e6 * S),
            {starl_trajectory:ramp(0, {0.0, 0.0}, Heading, {X0, Y0}, {X1, Y1}, Us), State2}
    end.

draws(Ranges, State) ->
    lists:mapfoldl(
        fun({Low, High}, S) ->
            {U, Next} = rand:uniform_s(S),
            {Low + U * (High - Low), Next}
        end,
        State,
        Ranges
    ).
