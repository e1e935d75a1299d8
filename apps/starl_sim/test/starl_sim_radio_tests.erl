%% The radio: rates as asked for, and stateless draws.
-module(starl_sim_radio_tests).
-include_lib("eunit/include/eunit.hrl").

-define(N, 20000).

%% The part that is lost is within five standard deviations of what was asked for.
loss_rate_test_() ->
    [
        ?_assert(
            near(Loss, [
                starl_sim_radio:lost(way(N), world(#{loss => Loss}))
             || N <- lists:seq(1, ?N)
            ])
        )
     || Loss <- [0.0, 0.01, 0.2, 0.4, 0.9, 1.0]
    ].

duplicate_rate_test_() ->
    [
        ?_assert(
            near(Part, [
                length(starl_sim_radio:delays(way(N), world(#{duplicate => Part}))) =:= 2
             || N <- lists:seq(1, ?N)
            ])
        )
     || Part <- [0.0, 0.1, 0.5, 1.0]
    ].

near(Rate, Draws) ->
    Hits = length([hit || true <- Draws]),
    abs(Hits - Rate * ?N) =< 5 * math:sqrt(?N * Rate * (1 - Rate)).

%% Every delay within the bounds comes up, none outside; both copies are drawn apart.
delays_test() ->
    Delays = lists:append([
        starl_sim_radio:delays(way(N), world(#{duplicate => 1.0, delay_us => {5000, 9000}}))
     || N <- lists:seq(1, 500)
    ]),
    ?assertEqual([5000, 6000, 7000, 8000, 9000], lists:usort(Delays)),
    Fine = [
        hd(starl_sim_radio:delays(way(N), world(#{delay_us => {5500, 9000}})))
     || N <- lists:seq(1, 500)
    ],
    ?assert(lists:min(Fine) >= 5500 andalso lists:max(Fine) =< 9000),
    ?assert(length(lists:usort(Fine)) > 100),
    ?assertEqual([7000], starl_sim_radio:delays(way(1), world(#{delay_us => {7000, 7000}}))).

%% Links are independent of each other: losses of one say nothing of another's.
links_are_independent_test() ->
    Lost = fun(From, To) ->
        [starl_sim_radio:lost({1, From, To, N}, world(#{loss => 0.5})) || N <- lists:seq(1, ?N)]
    end,
    Agree = fun(A, B) -> near(0.5, [X =:= Y || {X, Y} <- lists:zip(A, B)]) end,
    ?assert(Agree(Lost(1, 2), Lost(2, 1))),
    ?assert(Agree(Lost(1, 2), Lost(1, 3))),
    ?assert(Agree(Lost(1, 2), tl(Lost(1, 2)) ++ [true])).

%% What becomes of a packet depends on its link and number alone: other settings, and packets
%% that are taken away, shift no other draw.
stateless_test() ->
    Low = [N || N <- lists:seq(1, ?N), starl_sim_radio:lost(way(N), world(#{loss => 0.1}))],
    High = [N || N <- lists:seq(1, ?N), starl_sim_radio:lost(way(N), world(#{loss => 0.3}))],
    ?assertEqual([], Low -- High),
    Plain = [starl_sim_radio:delays(way(N), world(#{})) || N <- lists:seq(1, 100)],
    Doubled = [
        starl_sim_radio:delays(way(N), world(#{duplicate => 0.5, loss => 0.5}))
     || N <- lists:seq(1, 100)
    ],
    ?assertEqual([hd(D) || D <- Plain], [hd(D) || D <- Doubled]).

%% Another seed, another network.
seeds_test() ->
    Draw = fun(Seed) ->
        [starl_sim_radio:lost({Seed, 1, 2, N}, world(#{loss => 0.5})) || N <- lists:seq(1, 100)]
    end,
    ?assertEqual(Draw(1), Draw(1)),
    ?assertNotEqual(Draw(1), Draw(2)).

way(N) -> {1, 1, 2, N}.

world(Given) -> maps:merge(#{loss => 0.0, duplicate => 0.0, delay_us => {5000, 20000}}, Given).
