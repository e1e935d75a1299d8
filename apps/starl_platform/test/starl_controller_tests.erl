%% Controllers of motion: which there are, and what the wary one says of others in sight.
%%
%% Holds: A wary robot approaches none too fast, waits for who is in its way, no longer than it
%% says, and arrives
%% Red: with a controller that heeds nobody and waits without a bound: eight cases
-module(starl_controller_tests).
-include_lib("eunit/include/eunit.hrl").

-define(SELF, 1).

names_test() ->
    ?assertEqual({ok, none}, starl_controller:named("straight")),
    ?assertEqual({ok, starl_controller_wary}, starl_controller:named("wary")),
    ?assertEqual(
        {ok, starl_controller_wary}, starl_controller:named("x/starl_controller_wary.erl")
    ).

a_wrong_name_is_one_line_test() ->
    Line = fun(Text) ->
        {error, Why} = starl_controller:named(Text),
        lists:flatten(Why)
    end,
    ?assertEqual("there is no controller warry (did you mean wary?)", Line("warry")),
    ?assertEqual(
        "there is no controller best; there are straight, wary, and files of yours (FILE.erl)",
        Line("best")
    ),
    ?assertEqual(
        "a/lists.erl is no controller: it exports no sees_mm/1 (starl_controller)",
        Line("a/lists.erl")
    ).

%% The usual one costs no question that was not there before.
without_a_controller_nobody_is_looked_for_test() ->
    ?assertEqual({pose, ?SELF}, starl_controller:look(?SELF, profile())),
    ?assertEqual({near, 1500}, starl_controller:look(?SELF, wary())),
    Here = poses([{400, 0}]),
    ?assertEqual(go, starl_controller:leg(Here, {3000.0, 0.0}, {?SELF, 0}, profile())),
    ?assertEqual(
        {300.0, 0.0}, starl_controller:velocity({300.0, 0.0}, 500000, {?SELF, Here}, profile())
    ).

waits_for_who_is_in_the_way_test_() ->
    Leg = fun(Others) ->
        starl_controller:leg(poses(Others), {3000.0, 0.0}, {?SELF, 0}, wary())
    end,
    [
        {Who, ?_assertEqual(What, Leg(At))}
     || {Who, What, At} <- [
            {"nobody", go, []},
            {"ahead", {wait, 400000}, [{500, 0}]},
            {"ahead, a little aside", {wait, 400000}, [{500, 250}]},
            {"too far", go, [{800, 0}]},
            {"beside", go, [{300, 400}]},
            {"behind", go, [{-350, 0}]},
            {"one of two", {wait, 400000}, [{-350, 0}, {400, 0}]}
        ]
    ].

%% A robot that waits for ever would not arrive.
waits_no_longer_than_it_says_test() ->
    Wait = fun(Us) ->
        starl_controller:leg(poses([{500, 0}]), {3000.0, 0.0}, {?SELF, Us}, wary())
    end,
    Most = starl_controller_wary:waits_us(wary()),
    ?assertEqual({wait, 300000}, Wait(Most - 300000)),
    ?assertEqual(go, Wait(Most - 100000)),
    ?assertEqual(go, Wait(Most)).

%% Nobody is approached faster than half of the gap in the time of the command, wherever the
%% others are; who is far away changes nothing.
approaches_slowly_test() ->
    ?assertEqual({300.0, 0.0}, drives({300.0, 0.0}, [{1400, 0}])),
    {Ahead, Aside} = drives({300.0, 0.0}, [{500, 0}]),
    ?assert(abs(Ahead - (500 - 360) / 2) < 1.0e-6),
    %% to the right
    ?assert(Aside < -100.0),
    _ = rand:seed(exsss, {1, 2, 3}),
    [
        begin
            Others = [{between(-900, 900), between(-900, 900)} || _ <- lists:seq(1, N)],
            {VX, VY} = drives({between(-400, 400), between(-400, 400)}, Others),
            [
                ?assert((VX * X + VY * Y) / mm(O) =< max(0.0, (mm(O) - 360) / 2) + 1.0e-3, Others)
             || {X, Y} = O <- Others
            ]
        end
     || N <- [1, 2, 3, 5], _ <- lists:seq(1, 100)
    ].

drives(Wish, Others) ->
    starl_controller:velocity(Wish, 1000000, {?SELF, poses(Others)}, wary()).

between(Low, High) -> Low + (High - Low) * rand:uniform().

mm({X, Y}) -> math:sqrt(X * X + Y * Y).

poses(Others) ->
    Placed = [{N, {float(X), float(Y), 0.0}} || {N, {X, Y}} <- lists:enumerate(Others)],
    maps:from_list([{?SELF, {0.0, 0.0, 0.0}} | [{?SELF + N, P} || {N, P} <- Placed]]).

profile() -> starl_chassis:profile(starl_chassis_differential, #{}).

wary() -> starl_chassis:profile(starl_chassis_differential, #{controller => starl_controller_wary}).
