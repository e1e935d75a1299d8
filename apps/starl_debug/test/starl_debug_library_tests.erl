%% The predicates by name: each finds a violation that is planted in a trace, and accuses nobody in
%% the sound trace beside it.
-module(starl_debug_library_tests).

-include_lib("eunit/include/eunit.hrl").

-define(END, 12000000).
-define(AREA, {circle, {0.0, 0.0}, 2000.0}).
-define(IN, {0.0, 0.0}).
-define(OUT, {9000.0, 0.0}).

%% A recording of robots with these events by machine, and these places from times on.
recording(Robots) ->
    States = maps:from_list([
        {R, starl_debug_state:new(R, maps:remove(places, Events), {0, ?END}, exact)}
     || {R, Events} <- Robots
    ]),
    Tracks = maps:from_list([{R, track(Places)} || {R, #{places := Places}} <- Robots]),
    maps:merge(
        starl_debug_truth:recording({0, ?END}, States, Tracks),
        starl_debug_recording:known(States, [
            {starl_geocast_monitor, #{robots => [1, 2], margin_mm => 4.0}}
        ])
    ).

%% It stands at each place until the next, and is there at once.
track(Places) ->
    Ends = [At - 1 || {At, _} <- tl(Places)] ++ [?END],
    Samples = [{{From, P}, {To, P}} || {{From, P}, To} <- lists:zip(Places, Ends)],
    {Track, _} = starl_debug_track:samples(
        lists:append([[A, B] || {A, B} <- Samples]), #{speed => 0.001, error => 0.0}
    ),
    Track.

verdict(Text, Robots) -> verdict(Text, Robots, 0).

verdict(Text, Robots, Sigma) ->
    Recording = recording(Robots),
    {ok, Predicate} = starl_debug:predicate(Text),
    {ok, Formula} = starl_debug:formula(Predicate, Recording),
    Go = fun(_Done) -> continue end,
    maps:get(verdict, starl_debug_check:run(Formula, Recording, #{sigma => Sigma}, Go)).

held(From, To) -> #{mutex => [{From, {acquired, t, 1}}, {To, {released, t, 1}}]}.

too_near_test() ->
    At = fun(X) -> #{places => [{0, {X, 0.0}}]} end,
    ?assertEqual(certainly, verdict("too_near(400 mm)", [{1, At(0.0)}, {2, At(399.0)}])),
    ?assertEqual(never, verdict("too_near(400 mm)", [{1, At(0.0)}, {2, At(401.0)}])).

two_owners_test() ->
    First = {1, held(1000000, 3000000)},
    ?assertEqual(certainly, verdict("two_owners", [First, {2, held(2999000, 5000000)}])),
    ?assertEqual(never, verdict("two_owners", [First, {2, held(3000000, 5000000)}])).

two_coordinators_test() ->
    Leads = fun(From, To) ->
        #{dpp_coordinator => [{From, {leads, 1}}, {To, {stepped_down, 1}}]}
    end,
    First = {1, Leads(1000000, 3000000)},
    ?assertEqual(certainly, verdict("two_coordinators", [First, {2, Leads(2999000, 5000000)}])),
    ?assertEqual(never, verdict("two_coordinators", [First, {2, Leads(3000000, 5000000)}])).

%% Who led an election of before does not rival who leads the next one.
two_leaders_test() ->
    Elected = fun(Election, At) ->
        #{election => [{At, {entered, Election}}, {At + 1000, {elected, Election, 2, ballots}}]}
    end,
    Itself = #{election => [{1000000, {entered, one}}, {1001000, {elected, one, 1, ballots}}]},
    ?assertEqual(certainly, verdict("two_leaders", [{1, Itself}, {2, Elected(one, 1000000)}])),
    ?assertEqual(never, verdict("two_leaders", [{1, Itself}, {2, Elected(two, 2000000)}])).

deadlock_test() ->
    Waits = fun(To) -> #{mutex => [{1000000, {requested, t}}, {To, {acquired, t, 1}}]} end,
    First = {1, Waits(4000000)},
    ?assertEqual(certainly, verdict("deadlock(2 s)", [First, {2, Waits(3100000)}])),
    ?assertEqual(never, verdict("deadlock(2 s)", [First, {2, Waits(2900000)}])),
    %% all are down: nobody waits
    Down = #{robot => [{1000000, down}]},
    ?assertEqual(never, verdict("deadlock(2 s)", [{1, Down}, {2, Down}])),
    ?assertEqual(certainly, verdict("deadlock(2 s)", [First, {2, Down}])).

%% -- states -------------------------------------------------------------------------------------

times(What, Events) ->
    {Set, Set} = starl_debug_state:times(What, starl_debug_state:new(1, Events, {0, 99}, exact)),
    Set.

%% Who waits for a token is not idle; a lease that is lost ends a hold, and so does a death.
states_follow_events_test() ->
    Events = #{
        mutex => [
            {10, {requested, t}},
            {20, {acquired, t, 1}},
            {30, {lease_lost, t, 1}},
            {40, {acquired, t, 2}}
        ],
        robot => [{50, down}, {60, up}]
    },
    ?assertEqual([{10, 19}], times({mode, <<"waiting">>}, Events)),
    ?assertEqual([{0, 9}, {20, 49}, {60, 99}], times({mode, <<"idle">>}, Events)),
    ?assertEqual([{50, 59}], times({mode, <<"down">>}, Events)),
    ?assertEqual([{20, 29}, {40, 49}], times({owner, any}, Events)),
    ?assertEqual([{20, 29}, {40, 49}], times({owner, {token, <<"t">>}}, Events)),
    ?assertEqual([], times({owner, {token, <<"u">>}}, Events)).

%% -- geocast ------------------------------------------------------------------------------------

-define(ID, {1, 1, 1}).
-define(LATE, "late_geocast(2 s)").

%% Robot 1 sends at 3 s; the message lives for so long.
source(LifetimeUs) ->
    {1, #{places => [{0, ?IN}], geocast => [{3000000, {sent, ?ID, ?AREA, LifetimeUs, 7}}]}}.

receiver(Places, Events) -> {2, Events#{places => Places}}.

got(At) -> #{geocast => [{At, {delivered, ?ID, 7}}]}.

a_message_that_never_comes_is_late_test() ->
    Robots = [source(5000000), receiver([{0, ?IN}], #{})],
    ?assertEqual(certainly, verdict(?LATE, Robots)),
    ?assertEqual(certainly, verdict("late_geocast(5 s)", Robots)),
    ?assertEqual(certainly, verdict(?LATE, Robots, 50000)),
    ?assertEqual(certainly, verdict(?LATE, Robots, 300000)).

a_message_that_comes_late_is_late_test() ->
    Robots = fun(At) -> [source(5000000), receiver([{0, ?IN}], got(At))] end,
    ?assertEqual(certainly, verdict(?LATE, Robots(5300000))),
    ?assertEqual(never, verdict(?LATE, Robots(4900000))),
    ?assertEqual(never, verdict("late_geocast(5 s)", Robots(5300000))).

a_message_that_had_ended_before_a_robot_came_is_not_late_test() ->
    Comes = fun(At) -> [source(2000000), receiver([{0, ?OUT}, {At, ?IN}], #{})] end,
    ?assertEqual(never, verdict(?LATE, Comes(6000000))),
    ?assertEqual(never, verdict(?LATE, Comes(3500000))),
    ?assertEqual(certainly, verdict(?LATE, Comes(2500000))).

a_robot_that_leaves_is_owed_nothing_test() ->
    Leaves = fun(At) -> [source(5000000), receiver([{0, ?IN}, {At, ?OUT}], #{})] end,
    ?assertEqual(never, verdict(?LATE, Leaves(4500000))),
    ?assertEqual(certainly, verdict(?LATE, Leaves(5500000))).

a_message_that_lives_shorter_than_that_cannot_be_late_test() ->
    ?assertEqual(never, verdict(?LATE, [source(1999999), receiver([{0, ?IN}], #{})])).

%% So near the border the robot itself does not know that it is inside.
at_the_border_nothing_is_owed_test() ->
    At = fun(X) -> [source(5000000), receiver([{0, {X, 0.0}}], #{})] end,
    ?assertEqual(never, verdict(?LATE, At(1997.0))),
    ?assertEqual(certainly, verdict(?LATE, At(1995.0))).

%% Nor to a robot that began anew, or by a source that did.
who_began_anew_is_owed_nothing_test_() ->
    Cases = [
        {never, #{robot => [{3500000, down}, {3600000, up}]}},
        {never, #{geocast => [{3500000, crashed}]}},
        {never, #{robot => [{2000000, down}, {2500000, up}]}},
        {certainly, #{robot => [{1000000, down}, {1500000, up}]}}
    ],
    {1, Sends} = source(5000000),
    Both = fun(A, B) -> maps:merge_with(fun(_, X, Y) -> lists:sort(X ++ Y) end, A, B) end,
    [
        ?_assertEqual({Verdict, Events}, {verdict(?LATE, Robots), Events})
     || {Verdict, Events} <- Cases,
        Robots <- [
            [{1, Sends}, receiver([{0, ?IN}], Events)],
            [{1, Both(Sends, Events)}, receiver([{0, ?IN}], #{})]
        ]
    ].
