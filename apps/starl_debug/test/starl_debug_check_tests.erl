%% Answers for recordings that are made here: who held a token when, by whose clock.
-module(starl_debug_check_tests).

-include_lib("eunit/include/eunit.hrl").

-define(END, 10000000).

%% A recording of robots that held token `t' at these times (us).
recording(Holds) ->
    Events = fun(Times) ->
        lists:append([[{A, {acquired, t, 1}}, {B, {released, t, 1}}] || {A, B} <- Times])
    end,
    States = maps:from_list([
        {R, starl_debug_state:new(R, #{mutex => Events(Times)}, {0, ?END}, exact)}
     || {R, Times} <- Holds
    ]),
    starl_debug_truth:recording({0, ?END}, States, #{}).

answer(Text, Holds, Options) ->
    Recording = recording(Holds),
    {ok, Predicate} = starl_debug:predicate(Text),
    {ok, Formula} = starl_debug:formula(Predicate, Recording),
    {Formula, Recording,
        starl_debug_check:run(Formula, Recording, Options, fun(_) -> continue end)}.

verdict(Text, Holds, Sigma) ->
    {_, _, #{verdict := Verdict}} = answer(Text, Holds, #{sigma => Sigma}),
    Verdict.

%% Two owners for 30 ms.
-define(TWO, [{1, [{1000000, 3030000}]}, {2, [{3000000, 5000000}]}]).

two_owners_are_certain_within_their_overlap_test() ->
    ?assertEqual(certainly, verdict("two_owners", ?TWO, 5000)),
    ?assertEqual(certainly, verdict("two_owners", ?TWO, 29000)),
    ?assertEqual(possibly, verdict("two_owners", ?TWO, 50000)).

the_error_at_which_it_changes_is_the_overlap_test() ->
    {Formula, Recording, #{verdict := possibly}} = answer("two_owners", ?TWO, #{sigma => 50000}),
    #{smaller := {until, certainly, Us}, perfect_clocks := certainly} =
        starl_debug_sigma:explain(Formula, Recording, #{sigma => 50000}, possibly),
    ?assert(abs(Us - 30000) < 1500).

owners_with_a_gap_are_possible_beyond_it_test() ->
    Gap = [{1, [{1000000, 3000000}]}, {2, [{3020000, 5000000}]}],
    ?assertEqual(never, verdict("two_owners", Gap, 15000)),
    ?assertEqual(possibly, verdict("two_owners", Gap, 50000)).

%% One of the two holds of robot 2 meets that of robot 1, whatever the clocks, but none always does.
several_moments_together_are_certain_test() ->
    Holds = [{1, [{4990000, 5020000}]}, {2, [{4000000, 5000000}, {5010000, 6000000}]}],
    ?assertEqual(certainly, verdict("two_owners", Holds, 100000)),
    Wider = [{1, [{5001000, 5009000}]}, {2, [{4000000, 5000000}, {5010000, 6000000}]}],
    ?assertEqual(possibly, verdict("two_owners", Wider, 100000)).

a_count_of_three_test() ->
    Holds = [{R, [{1000000 * R, 4000000}]} || R <- [1, 2, 3]],
    ?assertEqual(certainly, verdict("count(r: owner(r, t)) >= 3", Holds, 50000)),
    ?assertEqual(never, verdict("count(r: owner(r, t)) > 3", Holds, 50000)).

%% -- places -------------------------------------------------------------------------------------

%% Two robots with these samples of their places, each off by as much at most (mm).
placed(Text, Places, Error, Options) ->
    States = maps:from_list([
        {R, starl_debug_state:new(R, #{}, {0, ?END}, exact)}
     || {R, _} <- Places
    ]),
    Tracks = maps:from_list([
        {R, element(1, starl_debug_track:samples(Samples, #{speed => 501, error => Error}))}
     || {R, Samples} <- Places
    ]),
    Recording = starl_debug_truth:recording({0, ?END}, States, Tracks),
    {ok, Predicate} = starl_debug:predicate(Text),
    {ok, Formula} = starl_debug:formula(Predicate, Recording),
    Go = fun(_Done) -> continue end,
    maps:get(verdict, starl_debug_check:run(Formula, Recording, Options, Go)).

dense(From, To, Place) -> [{T, Place(T / 1.0e6)} || T <- lists:seq(From, To, 2000)].

%% One drives 300 mm behind the other, both at 500 mm/s: by the error of the second clock that is more
%% or less.
the_error_of_each_clock_counts_for_its_own_robot_test() ->
    Drive = fun(Behind) -> dense(0, 4000000, fun(S) -> {500.0 * S - Behind, 0.0} end) end,
    Verdict = fun(Text, Sigma) ->
        Options = #{sigma => Sigma, drift_ppm => 0, from => 1000000, until => 1999999},
        placed(Text, [{1, Drive(0.0)}, {2, Drive(300.0)}], 0.0, Options)
    end,
    ?assertEqual(possibly, Verdict("dist(r1.pos, r2.pos) < 270 mm", 100000)),
    ?assertEqual(never, Verdict("dist(r1.pos, r2.pos) < 270 mm", 40000)),
    ?assertEqual(possibly, Verdict("dist(r1.pos, r2.pos) > 330 mm", 100000)),
    ?assertEqual(never, Verdict("dist(r1.pos, r2.pos) > 330 mm", 40000)),
    ?assertEqual(possibly, Verdict("dist(r1.pos, r2.pos) < 330 mm", 100000)),
    ?assertEqual(certainly, Verdict("dist(r1.pos, r2.pos) < 330 mm", 40000)).

%% Where the recording of the second robot ends, its place is known for some of the clocks only.
behind_the_end_of_a_track_nothing_is_certain_test() ->
    Stands = fun(T) -> dense(0, T, fun(_) -> {0.0, 0.0} end) end,
    Comes = dense(0, 6000000, fun(S) -> {max(0.0, 500.0 * (5.0 - S)), 0.0} end),
    Verdict = fun(End) ->
        placed("dist(r1.pos, r2.pos) < 20 mm", [{1, Comes}, {2, Stands(End)}], 0.0, #{
            sigma => 100000
        })
    end,
    ?assertEqual(certainly, Verdict(6000000)),
    ?assertEqual(possibly, Verdict(5000000)).

%% Between two samples a robot that stands may be off by what a sample is, and by what it can have driven.
a_place_is_known_with_its_error_test() ->
    Samples = [{0, {0.0, 0.0}}, {1000000, {100.0, 0.0}}, {2000000, {100.0, 0.0}}],
    {Track, 0} = starl_debug_track:samples(Samples, #{speed => 0, error => 50.0}),
    ?assertEqual([{{25.0, 0.0}, 50.0}, {{100.0, 0.0}, 50.0}], [
        starl_debug_track:place(Track, T)
     || T <- [250000, 3000000]
    ]),
    {Faster, 0} = starl_debug_track:samples(Samples, #{speed => 200, error => 50.0}),
    ?assertEqual({{100.0, 0.0}, 150.0}, starl_debug_track:place(Faster, 1500000)).

%% A robot at (300, 700) mm; in each direction it is inside or outside.
areas_and_coordinates_test_() ->
    Stands = [{T, {300.0, 700.0}} || T <- lists:seq(0, 2000000, 2000)],
    [
        ?_assertEqual(
            {Text, Verdict}, {Text, placed(Text, [{1, Stands}], 1.0, #{sigma => 0})}
        )
     || {Verdict, Text} <- [
            {certainly, "inside(r1, rectangle(200 mm, 600 mm, 400 mm, 800 mm))"},
            {never, "inside(r1, rectangle(310 mm, 600 mm, 400 mm, 800 mm))"},
            {never, "inside(r1, rectangle(200 mm, 600 mm, 290 mm, 800 mm))"},
            {never, "inside(r1, rectangle(200 mm, 710 mm, 400 mm, 800 mm))"},
            {never, "inside(r1, rectangle(200 mm, 600 mm, 400 mm, 690 mm))"},
            {certainly, "inside(r1, circle(300 mm, 600 mm, 110 mm))"},
            {never, "inside(r1, circle(300 mm, 600 mm, 90 mm))"},
            {certainly, "r1.x < 310 mm and r1.x > 290 mm"},
            {never, "r1.x < 290 mm or r1.x > 310 mm"},
            {certainly, "r1.y < 710 mm and r1.y > 690 mm"},
            {never, "r1.y < 690 mm or r1.y > 710 mm"},
            {certainly, "dist(r1.pos, point(300 mm, 600 mm)) < 110 mm"},
            {never, "dist(point(300 mm, 600 mm), r1.pos) < 90 mm"}
        ]
    ].

the_error_of_places_counts_test_() ->
    Stands = fun(X) -> dense(0, 2000000, fun(_) -> {X, 0.0} end) end,
    Cases = [
        {"dist(r1.pos, r2.pos) < ~b mm", [
            {180, never}, {240, possibly}, {380, possibly}, {420, certainly}
        ]},
        {"dist(r1.pos, r2.pos) > ~b mm", [
            {420, never}, {380, possibly}, {220, possibly}, {180, certainly}
        ]},
        {"r2.x < ~b mm", [{240, never}, {260, possibly}, {340, possibly}, {360, certainly}]},
        {"r2.x > ~b mm", [{360, never}, {340, possibly}, {260, possibly}, {240, certainly}]}
    ],
    [
        ?_assertEqual(
            {Text, Mm, Verdict},
            {Text, Mm,
                placed(io_lib:format(Text, [Mm]), [{1, Stands(0.0)}, {2, Stands(300.0)}], 50.0, #{
                    sigma => 0
                })}
        )
     || {Text, Answers} <- Cases, {Mm, Verdict} <- Answers
    ].

%% -- counts and clocks --------------------------------------------------------------------------

%% Each comparison with each number, for each number of robots that hold it.
counts_are_compared_as_numbers_test() ->
    Operators = #{
        "<" => fun erlang:'<'/2,
        "<=" => fun erlang:'=<'/2,
        ">" => fun erlang:'>'/2,
        ">=" => fun erlang:'>='/2,
        "=" => fun erlang:'=:='/2,
        "!=" => fun erlang:'=/='/2
    },
    [
        begin
            Holds = [{R, [{0, ?END + 9} || R =< Held]} || R <- [1, 2, 3]],
            Text = io_lib:format("count(r: owner(r, t)) ~s ~b", [Sign, N]),
            Expected = maps:get(Is(Held, N), #{true => certainly, false => never}),
            ?assertEqual({Held, Sign, N, Expected}, {Held, Sign, N, verdict(Text, Holds, 1000)})
        end
     || {Sign, Is} <- maps:to_list(Operators), N <- lists:seq(0, 4), Held <- [0, 1, 2, 3]
    ].

%% The second clock is ahead by -10 to 10 ms. One hold of both is there if it is behind, one if it
%% is ahead, so at each error there is one. But what is ahead at the one may be behind at the other, if the
%% clocks run apart by more than the two have in common.
clocks_that_run_apart_leave_nothing_certain_test() ->
    Holds = [
        {1, [{1100000, 1110000}, {1900000, 1910000}]},
        {2, [{1085000, 1100500}, {1909500, 1925000}]}
    ],
    Verdict = fun(Ppm) ->
        {_, _, #{verdict := V}} = answer("two_owners", Holds, #{sigma => 10000, drift_ppm => Ppm}),
        V
    end,
    ?assertEqual(certainly, Verdict(0)),
    ?assertEqual(possibly, Verdict(1000)).

%% It is true for one error and false for another: nothing is left to decide.
what_depends_on_the_clocks_is_not_open_test() ->
    {_, _, #{verdict := possibly, open := Open}} = answer("two_owners", ?TWO, #{sigma => 50000}),
    ?assertEqual([], Open).

%% Robot 2 holds it when robot 1 does, for errors up to 0; for none of the others.
what_is_refuted_for_some_clocks_is_not_certain_test() ->
    Part = fun(R) -> {local, R, {state, {owner, any}}} end,
    Facts = #{
        states => #{},
        tracks => #{},
        drift_ppm => 0,
        locals => #{Part(1) => {[{100, 110}], [{100, 110}]}, Part(2) => {[{50, 100}], [{50, 100}]}}
    },
    Limits = #{drift => 0, fine => 1, looks => 100},
    When = {{0, 200}, #{1 => {0, 0}, 2 => {-4, 4}}},
    ?assertMatch(
        #{verdict := possibly, is_shown := true, is_open := false},
        starl_debug_search:decide({'and', [Part(1), Part(2)]}, When, Facts, Limits)
    ).

what_lasts_test() ->
    ?assertEqual(certainly, verdict("(owner(r1, t) and owner(r2, t)) for 20 ms", ?TWO, 1000)),
    ?assertEqual(never, verdict("(owner(r1, t) and owner(r2, t)) for 40 ms", ?TWO, 1000)).

%% A gap of half a second is enough, of two robots as of one.
what_does_not_last_test() ->
    Text = "not ((owner(r1, t) or owner(r2, t)) for 1 s)",
    Second = {2, [{5500000, ?END + 9}]},
    ?assertEqual(certainly, verdict(Text, [{1, [{0, 5000000}]}, Second], 1000)),
    ?assertEqual(never, verdict(Text, [{1, [{0, 5600000}]}, Second], 1000)),
    ?assertEqual(
        certainly, verdict("not (owner(r1, t) for 1 s)", [{1, [{0, 5000000}, {5500000, ?END}]}], 0)
    ).

a_stopped_check_says_until_when_test() ->
    Recording = recording(?TWO),
    {ok, Predicate} = starl_debug:predicate("two_owners"),
    {ok, Formula} = starl_debug:formula(Predicate, Recording),
    Look = fun
        (Done) when Done > 0.15 -> stop;
        (_) -> continue
    end,
    #{verdict := never, is_whole := false, until := Until} =
        starl_debug_check:run(Formula, Recording, #{sigma => 5000}, Look),
    ?assert(Until < 3000000).

only_the_time_that_is_asked_for_test() ->
    {_, _, #{verdict := never, is_whole := true}} =
        answer("two_owners", ?TWO, #{sigma => 5000, from => 4000000}).

a_robot_that_tells_does_not_know_when_it_died_test() ->
    Events = #{mutex => [{1000000, {acquired, t, 1}}], robot => [{2000000, down}, {6000000, up}]},
    State = starl_debug_state:new(1, Events, {0, ?END}, told),
    {May, Must} = starl_debug_state:times({owner, any}, State),
    ?assertEqual([{1000000, 5999999}], May),
    ?assertEqual([{1000000, 1999999}], Must).

messages_bound_the_clocks_test() ->
    %% robot 2's clock is 100 ms ahead; packets take 5 ms
    Packets = lists:append([
        [{packet, 1, 2, T, T + 105000}, {packet, 2, 1, T + 100000, T + 5000}]
     || T <- lists:seq(0, ?END - 200000, 500000)
    ]),
    Recording = (recording(?TWO))#{packets := Packets},
    {ok, Bounds} = starl_debug_envelope:from_packets(Recording, 10),
    [
        begin
            {Least, Most} = starl_debug_envelope:offset(1, 2, Slice, Bounds),
            ?assert(Least =< 100000 andalso Least >= 94000),
            ?assert(Most >= 100000 andalso Most =< 106000)
        end
     || %% what is looked at may begin before the recording and end behind it
        Slice <- [{2000000, 2999999}, {-5000000, 999999}, {9500000, ?END + 1200000}]
    ].

%% Which of two packets with one number came is not known: the first may have.
of_two_packets_with_one_number_the_first_counts_test() ->
    Recording = (recording(?TWO))#{
        packets := [
            {sent, 1, 2, 7, 1000000}, {sent, 1, 2, 7, 3000000}, {came, 1, 2, 7, 3005000}
        ]
    },
    {ok, Bounds} = starl_debug_envelope:from_packets(Recording, 10),
    {_, Most} = starl_debug_envelope:offset(1, 2, {2000000, 2000001}, Bounds),
    ?assert(Most >= 2005000).

%% A motion that is told later takes the place of those that begin after it.
a_later_motion_replaces_what_was_to_come_test() ->
    Piece = fun(At, V) -> {piece, At, 0.0, 0.0, 0.0, V, 0.0} end,
    Track = starl_debug_track:motions([Piece(0, 0.0), Piece(500, 9.0), Piece(100, 0.0)], 2000000),
    {{X, _}, _} = starl_debug_track:place(Track, 1900000),
    ?assertEqual(0.0, X).

messages_that_contradict_are_told_test() ->
    Recording = (recording(?TWO))#{
        packets := [{packet, 1, 2, 1000, 500}, {packet, 2, 1, 1000, 600}]
    },
    {error, Line} = starl_debug_envelope:from_packets(Recording, 10),
    ?assertMatch({match, _}, re:run(Line, "robots 1, 2 contradict")).
