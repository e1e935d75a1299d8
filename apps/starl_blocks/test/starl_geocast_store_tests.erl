%% The geocasts that a robot knows: which are worth asking for, what is offered and given.
-module(starl_geocast_store_tests).
-include_lib("eunit/include/eunit.hrl").

-define(ID, {1, 1, 1}).
-define(AREA, {circle, {0.0, 0.0}, 1000.0}).
-define(LIFETIME, 8000).

new() -> starl_geocast_store:new(2, 0).

parcel(Id, Left, Hops) -> {Id, ?AREA, news, hello, ?LIFETIME, Left, Hops}.

%% Held until 1000, with five hops left, offered again after 50.
held() -> held(?ID, new()).

held(Id, Store) -> starl_geocast_store:hold(parcel(Id, 900, 5), 1000, true, 50, Store).

offer(Left, Hops) -> {?ID, ?LIFETIME, Left, Hops}.

is_worth(Left, Hops, Now, Store) -> starl_geocast_store:is_worth(offer(Left, Hops), Now, Store).

%% -- what is known ----------------------------------------------------------------------------

look_test() ->
    ?assertEqual(unknown, starl_geocast_store:look(?ID, new())),
    ?assertEqual(held, starl_geocast_store:look(?ID, held())),
    Over = starl_geocast_store:over(?ID, held()),
    ?assertEqual(over, starl_geocast_store:look(?ID, Over)),
    ?assertEqual(unknown, starl_geocast_store:look(?ID, starl_geocast_store:forget(?ID, Over))),
    ?assertEqual(new(), starl_geocast_store:over(?ID, new())).

%% So many messages are known, and those that are go on being taken.
limit_test() ->
    One = held(),
    ?assert(starl_geocast_store:takes({1, 1, 2}, One)),
    Two = held({1, 1, 2}, One),
    ?assertNot(starl_geocast_store:takes({1, 1, 3}, Two)),
    ?assert(starl_geocast_store:takes(?ID, Two)),
    Over = starl_geocast_store:over(?ID, Two),
    ?assertNot(starl_geocast_store:takes({1, 1, 3}, Over)),
    ?assert(starl_geocast_store:takes({1, 1, 3}, starl_geocast_store:forget(?ID, Over))).

%% -- what is worth asking for -----------------------------------------------------------------

%% The unknown, if it lives and travels on.
unknown_is_worth_test() ->
    ?assert(is_worth(1, 1, 0, new())),
    ?assertNot(is_worth(0, 1, 0, new())),
    ?assertNot(is_worth(-1, 1, 0, new())),
    ?assertNot(is_worth(1, 0, 0, new())).

%% What is held only if it has more left by more than an eighth of the lifetime, or more hops.
held_is_worth_test() ->
    ?assertNot(is_worth(900 + 1000, 5, 100, held())),
    ?assert(is_worth(900 + 1001, 5, 100, held())),
    ?assertNot(is_worth(1900, 6, 100, held())),
    ?assert(is_worth(1900, 7, 100, held())),
    ?assert(is_worth(1, 7, 100, held())),
    ?assertNot(is_worth(0, 7, 100, held())),
    ?assertNot(is_worth(500 + 1000, 5, 500, held())),
    ?assert(is_worth(500 + 1001, 5, 500, held())).

over_is_worth_nothing_test() ->
    ?assertNot(is_worth(7000, 30, 0, starl_geocast_store:over(?ID, held()))).

%% -- prolonging -------------------------------------------------------------------------------

%% The longer deadline counts, and the more hops, each for itself.
prolong_test() ->
    Prolonged = fun(Until, Hops) ->
        {U, IsTheirs, Store} = starl_geocast_store:prolong(?ID, Until, Hops, held()),
        {{_, _, Left, H}, _, _} = starl_geocast_store:offer(?ID, 100, 1000, Store),
        {U, IsTheirs, Left, H}
    end,
    ?assertEqual({1500, true, 1400, 5}, Prolonged(1500, 3)),
    ?assertEqual({1000, false, 900, 9}, Prolonged(500, 9)),
    ?assertEqual({1000, false, 900, 5}, Prolonged(1000, 5)).

%% -- offering ---------------------------------------------------------------------------------

%% The wait doubles up to the longest.
offer_test() ->
    {Offer, 50, S1} = starl_geocast_store:offer(?ID, 100, 150, held()),
    ?assertEqual(offer(900, 5), Offer),
    {_, 100, S2} = starl_geocast_store:offer(?ID, 150, 150, S1),
    {{_, _, 750, _}, 150, S3} = starl_geocast_store:offer(?ID, 250, 150, S2),
    ?assertMatch({_, 150, _}, starl_geocast_store:offer(?ID, 400, 150, S3)).

%% Offered is what lives and travels on.
offer_of_nothing_test() ->
    ?assertMatch({_, _, _}, starl_geocast_store:offer(?ID, 999, 150, held())),
    ?assertEqual(none, starl_geocast_store:offer(?ID, 1000, 150, held())),
    ?assertEqual(none, starl_geocast_store:offer(?ID, 100, 150, new())),
    ?assertEqual(
        none, starl_geocast_store:offer(?ID, 100, 150, starl_geocast_store:over(?ID, held()))
    ),
    Last = starl_geocast_store:hold(parcel(?ID, 900, 0), 1000, true, 50, new()),
    ?assertEqual(none, starl_geocast_store:offer(?ID, 100, 150, Last)),
    One = starl_geocast_store:hold(parcel(?ID, 900, 1), 1000, true, 50, new()),
    ?assertMatch({_, _, _}, starl_geocast_store:offer(?ID, 100, 150, One)).

%% -- asking and giving ------------------------------------------------------------------------

asker(N) -> {N, {1, 10 * N}}.

asked(Askers, Store) ->
    lists:foldl(
        fun(N, S) -> element(2, starl_geocast_store:ask(?ID, asker(N), 100, S)) end, Store, Askers
    ).

%% The first one that asks is told so; all are given it, in the order in which they asked.
ask_and_give_test() ->
    {true, One} = starl_geocast_store:ask(?ID, asker(3), 100, held()),
    {false, Two} = starl_geocast_store:ask(?ID, asker(2), 110, One),
    {Parcel, Askers, false, Given} = starl_geocast_store:give(?ID, 120, Two),
    ?assertEqual(parcel(?ID, 880, 5), Parcel),
    ?assertEqual([asker(3), asker(2)], Askers),
    ?assertEqual(none, starl_geocast_store:give(?ID, 130, Given)),
    ?assertMatch({true, _}, starl_geocast_store:ask(?ID, asker(3), 140, Given)).

%% Fifty are given it at once, the others with the next packet.
at_once_test() ->
    Askers = fun(Ns) -> [asker(N) || N <- Ns] end,
    {_, Fifty, false, _} = starl_geocast_store:give(?ID, 200, asked(lists:seq(1, 50), held())),
    ?assertEqual(Askers(lists:seq(1, 50)), Fifty),
    {_, First, true, Left} = starl_geocast_store:give(?ID, 200, asked(lists:seq(1, 51), held())),
    ?assertEqual(Fifty, First),
    ?assertMatch({_, [_], false, _}, starl_geocast_store:give(?ID, 200, Left)).

%% Nothing is given after the deadline, nor to be carried no farther.
nothing_to_give_test() ->
    ?assertEqual(none, starl_geocast_store:ask(?ID, asker(2), 1000, held())),
    ?assertMatch({true, _}, starl_geocast_store:ask(?ID, asker(2), 999, held())),
    ?assertEqual(none, starl_geocast_store:ask(?ID, asker(2), 100, new())),
    Last = starl_geocast_store:hold(parcel(?ID, 900, 0), 1000, true, 50, new()),
    ?assertEqual(none, starl_geocast_store:ask(?ID, asker(2), 100, Last)),
    Asked = asked([2], held()),
    ?assertEqual(none, starl_geocast_store:give(?ID, 1000, Asked)),
    ?assertMatch({_, _, _, _}, starl_geocast_store:give(?ID, 999, Asked)),
    ?assertEqual(none, starl_geocast_store:give(?ID, 100, held())).

%% -- delivering -------------------------------------------------------------------------------

waiting(Now, Store) ->
    [Id || {Id, ?AREA, news, hello} <- starl_geocast_store:waiting(Now, #{news => app}, Store)].

%% What lives, is listened to, is for the own robot, and has not been delivered.
waiting_test() ->
    Two = held({1, 1, 2}, held()),
    ?assertEqual([?ID, {1, 1, 2}], waiting(100, Two)),
    ?assertEqual([?ID, {1, 1, 2}], waiting(999, Two)),
    ?assertEqual([], waiting(1000, Two)),
    ?assertEqual([], starl_geocast_store:waiting(100, #{other => app}, Two)),
    ?assertEqual([{1, 1, 2}], waiting(100, starl_geocast_store:delivered([?ID], Two))),
    ?assertEqual([{1, 1, 2}], waiting(100, starl_geocast_store:over(?ID, Two))),
    Passing = starl_geocast_store:hold(parcel(?ID, 900, 5), 1000, false, 50, new()),
    ?assertEqual([], waiting(100, Passing)),
    %% in their order, however many
    Ids = [{1, 1, N} || N <- lists:seq(1, 40)],
    Many = lists:foldl(fun held/2, starl_geocast_store:new(100, 0), Ids),
    ?assertEqual(Ids, waiting(100, Many)).

%% What was forgotten meanwhile is not delivered again.
delivered_once_test() ->
    Delivered = starl_geocast_store:delivered([?ID], held()),
    ?assertEqual([], waiting(100, held(?ID, starl_geocast_store:forget(?ID, Delivered)))),
    ?assertEqual([{1, 1, 2}], waiting(100, held({1, 1, 2}, Delivered))).
