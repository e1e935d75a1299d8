%% Path planning under cuts of the radio in one direction that last: whoever still hears each other and is a
%% majority paints on, the robot that is cut off ends by itself, and nobody is accused. Only lines that come within
%% 2R of where a robot that is cut off stands may be left, and the run names that robot. Many seeds:
%%
%%     show(deaf_leader, [3, 4, 8], lists:seq(1, 50)).
%%
%% Holds: A majority that hears each other paints on under each cut in one direction that lasts:
%% deaf or mute, leader or member, single links
%% Red: 961f67c9, run: 32 of 34 cases
-module(starl_dpp_cut_tests).
-behaviour(starl_monitor).
-include_lib("eunit/include/eunit.hrl").

-export([show/3]).
-export([init/1, step/2, finish/2, interests/0]).

%% The cut begins while the picture is half done, and outlasts the run (s).
-define(CUT_MS, 20000).
-define(TIME_S, 1500).
%% Within this time of the cut all robots have ended, also those that are cut off (s).
-define(WITHIN_S, 700).
%% Nobody claims again and again.
-define(CLAIMS, 8).
%% The least distance of two robots (the default), and the error of the place at which one is seen (mm).
-define(SAFETY_MM, 400).
-define(SEEN_MM, 2).

a_team_whose_leader_hears_nobody_goes_on_test_() -> team(deaf_leader).

a_team_whose_leader_is_not_heard_goes_on_test_() -> team(mute_leader).

a_member_that_is_not_heard_ends_and_the_others_go_on_test_() -> team(mute_member).

a_member_that_hears_nobody_ends_and_the_others_go_on_test_() -> team(deaf_member).

a_member_that_does_not_hear_the_leader_ends_and_the_others_go_on_test_() -> team(not_to_member).

a_member_that_the_leader_does_not_hear_ends_and_the_others_go_on_test_() -> team(not_from_member).

two_deaf_robots_of_five_one_of_which_leads_do_not_stop_the_others_test_() ->
    [{timeout, 60, fun() -> goes_on(two_deaf, 5, Seed) end} || Seed <- [1, 2]].

%% The first robot of two is a majority by itself, the second is none.
a_team_of_two_goes_on_with_its_first_robot_test_() ->
    [
        {timeout, 60, fun() -> goes_on(Cut, 2, Seed) end}
     || Cut <- [deaf_second, mute_second, deaf_first, mute_first], Seed <- [1, 2]
    ].

team(Cut) ->
    [
        {timeout, 60, fun() -> goes_on(Cut, N, Seed) end}
     || {N, Seed} <- [{3, 1}, {4, 2}, {8, 3}]
    ].

%% A robot that is not heard cannot be sent away. The others leave what it stands near, and nothing else; more
%% seeds of the two cuts with which that happens.
what_is_left_is_near_the_robot_that_is_not_heard_test_() ->
    [
        {timeout, 60, fun() -> goes_on(Cut, 4, Seed) end}
     || Cut <- [mute_leader, mute_member], Seed <- [1, 3, 4]
    ].

%% The same for many seeds: what does not go on.
show(Cut, Teams, Seeds) ->
    lists:foreach(
        fun({N, Seed}) ->
            try
                goes_on(Cut, N, Seed)
            catch
                error:{_, Info} -> io:format("~p ~p ~p: ~p~n", [Cut, N, Seed, Info])
            end
        end,
        [{N, Seed} || N <- Teams, Seed <- Seeds]
    ).

goes_on(Cut, N, Seed) ->
    Led = leader(N, Seed),
    {Faults, Off} = cut(Cut, Led, 1 + Led rem N, lists:seq(1, N)),
    {T, Robots, Ink, #{claims := Claims} = Seen, Violations} = run(N, Seed, Faults, ?TIME_S),
    Ends = [{Id, Result} || {Id, #{result := Result}} <- Robots, not lists:member(Id, Off)],
    Run =
        {Cut, N, {seed, Seed}, {led, Led}, {off, Off}, {ends, Ends}, {ink, Ink}, {claims, Claims},
            T},
    ?assertEqual([], Violations, Run),
    ?assert(T < 1000000 * ?WITHIN_S, Run),
    ?assertEqual(N - length(Off), length(Ends), Run),
    ?assert(Ink > 0.9, Run),
    ?assert(Claims =< ?CLAIMS, Run),
    explained(Ink, Seen, Robots, Off, Run).

%% Whoever stands in the way of lines that are left is cut off, and stands near each of them; there are no others.
explained(Ink, #{left := none}, _Robots, _Off, Run) ->
    ?assertEqual(1.0, Ink, Run);
explained(_Ink, #{left := Left, lines := Lines}, Robots, Off, Run) ->
    #{edges := Edges, in_the_way := Named, cut_off := CutOff} = Left,
    ?assertEqual([], [Id || {Id, _, _} <- Named] -- Off, Run),
    ?assertEqual({0, Edges}, {CutOff, length(lists:usort([L || {_, L} <- Lines]))}, Run),
    ?assertEqual([N || {_, _, N} <- Named], [length(Of) || Of <- by_robot(Named, Lines)], Run),
    Far = [
        {Id, Mm}
     || {Id, Line} <- Lines,
        {_, #{pose := {X, Y, _}}} <- [lists:keyfind(Id, 1, Robots)],
        Mm <- [starl_geometry:point_segment({X, Y}, Line)],
        Mm > near_mm()
    ],
    ?assertEqual([], Far, Run).

by_robot(Named, Lines) -> [[L || {Of, L} <- Lines, Of =:= Id] || {Id, _, _} <- Named].

%% 2R, by the paper: the least distance of two robots, and r(v) of both; and the error of the place.
near_mm() ->
    Profile = starl_chassis:profile(starl_chassis_differential, #{}),
    ?SAFETY_MM + 2 * starl_chassis:tracking_radius(Profile) + ?SEEN_MM.

%% The faults, and the robots that need not paint any more.
cut(deaf_leader, Led, _, Team) -> {[cut(Team -- [Led])], [Led]};
cut(mute_leader, Led, _, _) -> {[cut([Led])], [Led]};
cut(deaf_member, _, Other, Team) -> {[cut(Team -- [Other])], [Other]};
cut(mute_member, _, Other, _) -> {[cut([Other])], [Other]};
cut(not_to_member, Led, Other, _) -> {[link(Led, Other)], [Other]};
cut(not_from_member, Led, Other, _) -> {[link(Other, Led)], [Other]};
cut(two_deaf, Led, Other, Team) -> {[cut(Team -- [Led, Other])], [Led, Other]};
cut(deaf_first, _, _, [1, 2]) -> {[cut([2])], [2]};
cut(mute_first, _, _, [1, 2]) -> {[cut([1])], [2]};
cut(deaf_second, _, _, [1, 2]) -> {[cut([1])], [2]};
cut(mute_second, _, _, [1, 2]) -> {[cut([2])], [2]}.

%% The others hear nothing of these robots.
cut(Group) -> {cut, ?CUT_MS, 1000 * ?TIME_S, one_way_partition, Group, #{}}.

link(From, To) -> {cut, ?CUT_MS, 1000 * ?TIME_S, loss, {From, To}, #{part => 1.0}}.

leader(N, Seed) ->
    {ok, Sim} = starl_sim:start(scenario(N, Seed, [], ?CUT_MS div 1000)),
    _ = starl_sim:run(Sim),
    {#{monitors := #{starl_dpp_monitor := #{coordinators := [Led]}}}, _} = starl_sim:finish(Sim),
    Led.

run(N, Seed, Faults, Time) ->
    {ok, Sim} = starl_sim:start(scenario(N, Seed, Faults, Time), #{watch => [{?MODULE, #{}}]}),
    #{now_us := T} = starl_sim:run(Sim),
    {
        #{
            violations := Violations,
            robots := Robots,
            monitors := #{?MODULE := Seen, starl_dpp_monitor := #{left := Left}}
        },
        #{figures := Figures}
    } = starl_sim:finish(Sim),
    {T, Robots, proplists:get_value(ink_covered, Figures), Seen#{left => Left}, Violations}.

scenario(N, Seed, Faults, Time) ->
    #{
        app => starl_painting,
        robots => N,
        picture => "house",
        seed => Seed,
        faults => Faults,
        time => Time
    }.

%% -- counts the claims, and keeps the lines that are left ---------------------------------------

init(#{}) -> #{claims => 0, lines => []}.

interests() -> [dpp_coordinator].

step({_, _, dpp_coordinator, {claims, _}}, #{claims := N} = Seen) ->
    {ok, Seen#{claims := N + 1}};
step({_, _, dpp_coordinator, {assigned, _, _, _}}, Seen) ->
    {ok, Seen#{lines := []}};
step({_, _, dpp_coordinator, {in_the_way, Robot, Lines}}, #{lines := Known} = Seen) ->
    {ok, Seen#{
        lines := Known ++ [{Robot, Line} || Line <- Lines, not lists:member({Robot, Line}, Known)]
    }};
step(_Event, Seen) ->
    {ok, Seen}.

finish(_EndUs, Seen) -> {ok, Seen}.
