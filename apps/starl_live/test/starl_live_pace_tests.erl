-module(starl_live_pace_tests).
-include_lib("eunit/include/eunit.hrl").

%% 10 bytes a millisecond, 100 at once.
filled(Items) ->
    lists:foldl(
        fun(Item, Pace) ->
            {ok, Next} = starl_live_pace:put(Item, 50, Pace),
            Next
        end,
        starl_live_pace:new(10, 100, 0),
        Items
    ).

a_burst_goes_at_once_and_the_rest_in_turn_test() ->
    {Now, Wait, Rest} = starl_live_pace:take(0, filled([a, b, c, d, e])),
    ?assertEqual([a, b, c], Now),
    ?assertEqual(5, Wait),
    {None, 1, Sooner} = starl_live_pace:take(4999, Rest),
    ?assertEqual([], None),
    {[d], 5, Later} = starl_live_pace:take(5000, Sooner),
    ?assertMatch({[e], infinity, _}, starl_live_pace:take(10_000, Later)).

a_pause_saves_no_more_than_a_burst_test() ->
    {_, _, Empty} = starl_live_pace:take(0, filled([])),
    {ok, One} = starl_live_pace:put(a, 50, Empty),
    Many = lists:foldl(
        fun(Item, Pace) ->
            {ok, Next} = starl_live_pace:put(Item, 50, Pace),
            Next
        end,
        One,
        [b, c, d]
    ),
    ?assertMatch({[a, b, c], 5, _}, starl_live_pace:take(1_000_000_000, Many)).

%% Over any time no more leaves than burst, rate, and one item.
rate_is_kept_test() ->
    Pace = filled(lists:seq(1, 1000)),
    {Taken, _} = lists:foldl(
        fun(Us, {Sum, Before}) ->
            {Items, _, Next} = starl_live_pace:take(Us, Before),
            {Sum + length(Items), Next}
        end,
        {0, Pace},
        lists:seq(0, 1_000_000, 700)
    ),
    ?assert(Taken * 50 =< 100 + 10 * 1000 + 50),
    ?assert(Taken * 50 >= 10 * 1000).

the_queue_is_bounded_test() ->
    Pace = starl_live_pace:new(10, 100, 0),
    {ok, Full} = starl_live_pace:put(a, 1_000_000, Pace),
    ?assertEqual(full, starl_live_pace:put(b, 1, Full)).
