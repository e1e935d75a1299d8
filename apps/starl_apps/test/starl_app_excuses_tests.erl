%% What a fault excuses in the contracts of applications ends: what happens just before the end is excused,
%% what happens just after it is not, and progress is owed again from the heal on.
%%
%% Holds: Excuses of applications' contracts end
%% Red: planted, run: seven bugs
-module(starl_app_excuses_tests).
-include_lib("eunit/include/eunit.hrl").

-define(S, 1000000).
%% Half a minute after a fault of a moment.
-define(FAULT, {1, 0, ?S, fault}).
-define(END, 31).

stands(S, Robot, X) -> starl_team_runs:standing(round(S * ?S), Robot, {X, 0}).

found(Events, Contract) ->
    {Found, _} = starl_team_runs:judged(Events, Contract),
    Found.

%% -- two robots too near to each other ----------------------------------------------------------

%% Robot 2 comes too near to robot 1 at this time, and leaves a second later.
meeting(S) ->
    [stands(0, 1, 0), stands(0, 2, 5000), stands(S, 2, 100), stands(S + 1, 2, 5000)].

crossing(Events, More) -> found(Events, {starl_crossing_monitor, More}).

lane() -> [{[{600.0 * I, 0.0}], none} || I <- lists:seq(0, 20)].

convoy(Events, More) ->
    found(Events, {starl_convoy_monitor, More#{robots => [1, 2], lane => lane()}}).

robots_are_apart_again_half_a_minute_after_a_fault_test_() ->
    [
        {atom_to_list(Name), [
            ?_assertEqual([], Judge(meeting(1), #{faults => [?FAULT]})),
            ?_assertEqual([], Judge(meeting(?END - 0.1), #{faults => [?FAULT]})),
            ?_assertEqual([too_near], Judge(meeting(?END + 0.1), #{faults => [?FAULT]})),
            %% nor before it
            ?_assertEqual(
                [too_near], Judge(meeting(40), #{faults => [{1, 50 * ?S, 51 * ?S, fault}]})
            ),
            %% a fault that is told when it is over excuses as long
            ?_assertEqual([too_near], Judge(meeting(?END + 0.1), #{faults => [?FAULT, ?FAULT]}))
        ]}
     || {Name, Judge} <- [{crossing, fun crossing/2}, {convoy, fun convoy/2}]
    ].

nobody_overtakes_again_half_a_minute_after_a_fault_test() ->
    At = fun(S, Robot) -> {round(S * ?S), Robot, app, {at, 7, 3}} end,
    Overtakes = fun(S) ->
        convoy([At(S, 2), At(S + 0.5, 1), stands(S + 1, 1, 0)], #{faults => [?FAULT]})
    end,
    ?assertEqual([], Overtakes(?END - 1)),
    ?assertEqual([overtaken], Overtakes(?END + 0.1)).

%% -- progress -----------------------------------------------------------------------------------

%% So many seconds after the heal, and after it only, is it overdue.
progress_is_owed_from_the_heal_on_test_() ->
    Late = fun(S) -> [stands(0, 1, 0), stands(S, 1, 0)] end,
    [
        {atom_to_list(What), [
            ?_assertEqual([], Judge(Late(100 + Within), #{healed_us => 100 * ?S})),
            ?_assertEqual([What], Judge(Late(100 + Within + 0.1), #{healed_us => 100 * ?S})),
            ?_assertEqual([], Judge(Late(100 + Within + 0.1), #{healed_us => never}))
        ]}
     || {What, Within, Judge} <- [
            {nobody_passes, 120, fun crossing/2},
            {nobody_moves, 120, fun convoy/2},
            {nobody_leads, 60, fun(Events, More) ->
                Robot = {round(0.1 * ?S), 1, app, {follows, 1, 2}},
                [_, {T, _, _, _}] = Events,
                Again = {T, 1, app, {follows, 1, 2}},
                found([Robot, Again], {starl_follow_monitor, More#{robots => [1, 2]}})
            end},
            {not_formed, 180, fun formation/2}
        ]
    ].

formation(Events, More) ->
    found(Events, {starl_formation_monitor, More#{robots => [1, 2], tolerance_mm => 50}}).

%% -- places of a formation ----------------------------------------------------------------------

in_place(S, Robot, Round, X) ->
    {round(S * ?S), Robot, app, {in_place, Round, {float(X), 0.0}}}.

formed(S, Round) -> {round(S * ?S), 1, app, {formed, Round}}.

%% A wrong position explains a wrong place if the robot had it when it came there, or a second before.
a_wrong_position_explains_the_place_that_it_led_to_test() ->
    Away = [
        stands(0, 1, 100),
        stands(0, 2, 500),
        in_place(10, 1, 1, 100),
        in_place(10, 2, 1, 900),
        formed(11, 1)
    ],
    Until = fun(S) -> formation(Away, #{bodies => [{2, 0, round(S * ?S), position}]}) end,
    ?assertEqual([], Until(9.5)),
    ?assertEqual([not_in_place], Until(8.9)).

%% A store that was damaged explains that a robot is not in its place, until it comes to one of a later round.
a_damaged_store_explains_until_the_robot_comes_to_its_place_test() ->
    Standing = [stands(0, 1, 100), stands(0, 2, 900)],
    Damaged = [
        in_place(1, 1, 1, 100),
        in_place(1, 2, 1, 900),
        {2 * ?S, 2, robot, store_set_back},
        formed(3, 1)
    ],
    ?assertEqual([], formation(Standing ++ Damaged, #{})),
    Back = [in_place(4, 1, 2, 100), in_place(4, 2, 2, 900), formed(5, 2)],
    Next = [in_place(6, 1, 3, 100), formed(7, 3)],
    ?assertEqual([], formation(Standing ++ Damaged ++ Next, #{})),
    ?assertEqual([not_in_place], formation(Standing ++ Damaged ++ Back ++ Next, #{})).

%% -- messages of the swarm ----------------------------------------------------------------------

%% A message is owed that is sent more than five seconds after a fault and more than one before the next.
a_message_is_owed_five_seconds_after_a_fault_test() ->
    Row = [starl_team_runs:standing(0, N, {1500 * N, 0}) || N <- [1, 2, 3, 4]],
    Area = {circle, {5500.0, 0.0}, 1600.0},
    Sent = fun(S, Faults) ->
        Message = {round(S * ?S), 1, geocast, {sent, {1, 1, 1}, Area, 5000000, 7}},
        Config = #{range_mm => 2500, speed => 400, delay_us => 20000, faults => Faults},
        found(Row ++ [Message, stands(30, 1, 1500)], {starl_swarm_monitor, Config})
    end,
    ?assertEqual([], Sent(5.9, [?FAULT])),
    ?assertEqual([not_heard], Sent(6.1, [?FAULT])),
    ?assertEqual([], Sent(9.1, [{1, 10 * ?S, 11 * ?S, fault}])),
    ?assertEqual([not_heard], Sent(8.9, [{1, 10 * ?S, 11 * ?S, fault}])).
