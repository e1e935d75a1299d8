%% Path planning and a robot that has the fleet's key: it says the largest numbers that are taken for messages, then
%% stops, and all robots reboot with what they have stored. The team paints on.
%%
%% Holds: No term that one robot says ends path planning or a team with a leader, across restarts,
%% stores of earlier versions and lost stores
%% Red: 4ca8e259, run: 23 of the first 40; 18 of 30
-module(starl_dpp_insider_tests).
-include_lib("eunit/include/eunit.hrl").

-export([paints/4, draws/1]).

-define(TYPES, [
    dpp_beat,
    dpp_recover,
    dpp_prevote,
    dpp_prevoted,
    dpp_refused,
    dpp_answer,
    dpp_request,
    dpp_passed,
    dpp_state,
    dpp_here
]).
%% When the insider speaks, and when all reboot (ms).
-define(SPEAKS_MS, 8000).
-define(REBOOT_MS, 16000).
-define(TIME_S, 1500).

the_largest_numbers_of_all_messages_end_nothing_test_() ->
    [
        {timeout, 120, fun() -> paints(N, Insider, Seed, ?TYPES) end}
     || {N, Seed} <- [{2, 1}, {3, 2}, {4, 3}], Insider <- lists:seq(1, N)
    ].

%% Also where nobody knows a term yet, or only the insider starts anew, or nobody does.
whenever_it_speaks_and_whoever_reboots_test_() ->
    [
        {timeout, 120, fun() -> goes_on(3, {2, Ms, largest(?TYPES)}, Faults, Seed) end}
     || {Ms, Faults, Seed} <- [
            {0, reboots(3, ?REBOOT_MS), 1},
            {0, [], 2},
            {?SPEAKS_MS, [], 3},
            {?SPEAKS_MS, [lists:nth(2, reboots(3, ?REBOOT_MS))], 4}
        ]
    ].

%% Numbers drawn from the small, the guessed, the believed, and the largest, in many messages. A failure tells its seed.
numbers_of_all_sizes_end_nothing_test_() ->
    [{timeout, 120, fun() -> draws(Seed) end} || Seed <- lists:seq(1, 12)].

%% An earlier version has stored the largest term, everywhere or at one robot: after the update the team paints. So it
%% does when an insider has raised one robot step by step.
a_team_with_a_far_term_in_its_stores_paints_test_() ->
    Nothing = {1, 0, fun(_, _) -> [] end},
    Stored = fun(Term, Robots) ->
        fun(Robot) -> hd([Term || lists:member(Robot, Robots)] ++ [none]) end
    end,
    Far = [starl_dpp_insider:most(), (1 bsl 90) + (1 bsl 65), (1 bsl 90) + (500 bsl 32)],
    [
        {timeout, 120, fun() ->
            goes_on(N, Nothing, Faults, Seed, Stored({Number, 1, 1 bsl 57}, Robots))
        end}
     || {N, Seed} <- [{1, 1}, {2, 2}, {3, 3}, {4, 4}],
        Number <- Far,
        Robots <- lists:usort([[1], [N], lists:seq(1, N)]),
        Faults <- [[]] ++ [reboots(N, ?REBOOT_MS) || Robots =/= [1]]
    ].

%% The largest number that is believed at once is followed; there is always a higher one to claim.
the_largest_number_that_is_believed_ends_nothing_test_() ->
    [
        {timeout, 120, fun() ->
            goes_on(N, {Insider, ?SPEAKS_MS, beats([1])}, reboots(N, ?REBOOT_MS), Seed)
        end}
     || {N, Insider, Seed} <- [{2, 1, 1}, {2, 2, 1}, {3, 3, 2}, {4, 1, 3}]
    ].

%% An insider has raised the term step by step. A robot whose store is lost finds back, in as many messages, also where a
%% team is no more than the two; and so do all that were raised, when the one that was not leads.
a_robot_without_store_finds_back_to_a_raised_term_test_() ->
    Steps = lists:seq(1, 50),
    Lost = fun(Robot) -> {lost, 20000, 22000, store_lost, Robot, #{}} end,
    [
        {timeout, 120, fun() ->
            goes_on(N, {Insider, ?SPEAKS_MS, beats(Steps)}, [Lost(Robot) || Robot <- Robots], Seed)
        end}
     || {N, Insider, Robots, Seed} <- [
            {2, 2, [1], 1}, {2, 1, [1], 2}, {2, 1, [2], 3}, {3, 3, [1], 4}, {4, 1, [2, 3], 5}
        ]
    ].

%% One after the other, each as far above the last as is believed.
beats(Steps) ->
    fun(Self, Team) ->
        [
            [
                {To, dpp_beat, {{(1 bsl 90) + (K bsl 32), Self, 1}, 1, []}}
             || To <- Team -- [Self]
            ]
         || K <- Steps
        ]
    end.

%% The insider sends all messages of these types to each robot.
paints(N, Insider, Seed, Types) ->
    goes_on(N, {Insider, ?SPEAKS_MS, largest(Types)}, reboots(N, ?REBOOT_MS), Seed).

largest(Types) ->
    fun(Self, Team) ->
        [
            [
                {To, Type, Body}
             || {Type, Body} <- starl_dpp_insider:largest(Self, Team),
                lists:member(Type, Types),
                To <- Team -- [Self]
            ]
        ]
    end.

draws(Seed) ->
    _ = rand:seed(exsss, Seed),
    N = 1 + rand:uniform(3),
    Insider = rand:uniform(N),
    SpeaksMs = 500 * rand:uniform(30),
    Waves = rand:uniform(30),
    Drawn = rand:export_seed(),
    Packets = fun(Self, Team) ->
        _ = rand:seed(Drawn),
        [
            [
                starl_dpp_insider:random(To, Self, Team)
             || To <- Team -- [Self], _ <- lists:seq(1, rand:uniform(3))
            ]
         || _ <- lists:seq(1, Waves)
        ]
    end,
    Faults = lists:nth(1 + Seed rem 3, [
        [], reboots(N, ?REBOOT_MS), [{lost, 20000, 21000, store_lost, Insider, #{}}]
    ]),
    goes_on(N, {Insider, SpeaksMs, Packets}, Faults, Seed).

reboots(N, Ms) -> [{reboot, Ms, Ms + 1000, reboot, Robot, #{}} || Robot <- lists:seq(1, N)].

goes_on(N, Attack, Faults, Seed) -> goes_on(N, Attack, Faults, Seed, fun(_) -> none end).

goes_on(N, Attack, Faults, Seed, Stored) ->
    {ok, Sim} = starl_sim:start(#{
        app => starl_dpp_insider,
        attack => Attack,
        stored => Stored,
        robots => N,
        picture => "short_lines:12",
        seed => Seed,
        faults => numbered(Faults),
        time => ?TIME_S
    }),
    #{ending := Ending, now_us := T} = starl_sim:run(Sim),
    {#{violations := Violations, robots := Robots}, #{figures := Figures}} = starl_sim:finish(Sim),
    ?assertEqual(
        {[], done, 1.0, [{done, complete}]},
        {Violations, Ending, proplists:get_value(ink_covered, Figures),
            lists:usort([Result || {_, #{result := Result}} <- Robots])},
        {N, {seed, Seed}, {us, T}}
    ).

numbered(Faults) ->
    [
        setelement(1, Fault, starl_platform_ct:fault_id(fault, K))
     || {K, Fault} <- lists:zip(lists:seq(1, length(Faults)), Faults)
    ].
