%% A shout is one packet to all in range: nobody acknowledges it, and what is lost is lost.
-module(starl_shout_tests).
-include_lib("eunit/include/eunit.hrl").

%% What each robot but the first has heard, and how many packets were sent.
played(Scenario) ->
    {ok, Sim} = starl_sim:start(
        maps:merge(#{app => starl_shouter, robots => 3, time => 60}, Scenario)
    ),
    _ = starl_sim:run(Sim),
    {#{violations := [], robots := [{1, _} | Others], packets := Packets}, _} = starl_sim:finish(
        Sim
    ),
    {[lists:sort(Heard) || {_, #{result := {done, {heard, Heard}}}} <- Others], Packets}.

all_hear_all_of_it_in_one_packet_each_test() ->
    All = lists:seq(1, 20),
    ?assertEqual({[All, All], 20}, played(#{})).

who_is_out_of_range_hears_nothing_test() ->
    %% robots stand in a row, two metres apart
    ?assertEqual({[lists:seq(1, 20), []], 20}, played(#{range => 2500})).

what_is_lost_is_not_repeated_test_() ->
    [
        fun() ->
            {[First, Second], 1000} = played(#{shouts => 1000, loss => 0.3, seed => Seed}),
            [?assert(abs(length(Heard) - 700) < 100) || Heard <- [First, Second]],
            ?assertNotEqual(First, Second)
        end
     || Seed <- [1, 2, 3]
    ].

%% Who does not read keeps a thousand, the oldest.
what_finds_no_room_is_dropped_test() ->
    {[First, Second], 1500} = played(#{shouts => 1500, deaf_ms => 20000}),
    ?assertEqual({lists:seq(501, 1500), lists:seq(501, 1500)}, {First, Second}).

an_invalid_argument_is_a_mistake_test() ->
    Robot = starl:robot(1, [1, 2]),
    ?assertError({bad_argument, #{argument := 'Type'}}, starl:shout(Robot, "number", 1)),
    ?assertError({bad_argument, #{argument := 'Body'}}, starl:shout(Robot, number, self())).
