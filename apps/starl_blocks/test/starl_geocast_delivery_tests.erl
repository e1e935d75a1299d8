%% When a robot asks where it is, and what it delivers then.
-module(starl_geocast_delivery_tests).
-include_lib("eunit/include/eunit.hrl").

-define(ID, {1, 1, 1}).
-define(AREA, {circle, {0.0, 0.0}, 1000.0}).
-define(CHECK, 250000).

%% Robot 2 listens to news; what is told of its place may be 2 mm off.
new() ->
    starl_geocast_delivery:new(2, #{
        position_error_mm => 2.0, check_us => ?CHECK, listeners => #{news => app}
    }).

held(Type) ->
    Parcel = {?ID, ?AREA, Type, hello, 5000000, 5000000, 5},
    starl_geocast_store:hold(Parcel, 5000000, true, 50, starl_geocast_store:new(9, 0)).

where(N) -> starl_location:pose(2, {where, N}).

timer() -> {{timeout, check}, ?CHECK, check}.

located(N, Answer, Now, Delivery) ->
    starl_geocast_delivery:located(N, Answer, Now, held(news), Delivery).

at(X) -> {ok, {X, 0.0, 0.0}}.

%% Only while something waits; each question has its number, and one timer runs.
check_test() ->
    ?assertEqual(
        {[], new()}, starl_geocast_delivery:check(10, starl_geocast_store:new(9, 0), new())
    ),
    ?assertEqual({[], new()}, starl_geocast_delivery:check(10, held(other), new())),
    {First, One} = starl_geocast_delivery:check(10, held(news), new()),
    ?assertEqual([where(1), timer()], First),
    {Second, Two} = starl_geocast_delivery:check(20, held(news), One),
    ?assertEqual([where(2)], Second),
    {Third, _} = starl_geocast_delivery:check_again(30, held(news), Two),
    ?assertEqual([where(3), timer()], Third).

%% When the timer has run out and nothing waits, it is set anew by what comes then.
check_again_test() ->
    {_, One} = starl_geocast_delivery:check(10, held(news), new()),
    {[], None} = starl_geocast_delivery:check_again(30, starl_geocast_store:new(9, 0), One),
    {Actions, _} = starl_geocast_delivery:check(40, held(news), None),
    ?assertEqual([where(2), timer()], Actions).

%% Who listens later has what waits for it then.
listen_test() ->
    Later = starl_geocast_delivery:listen(other, door, new()),
    {[_, _], Asked} = starl_geocast_delivery:check(10, held(other), Later),
    {Actions, _} = starl_geocast_delivery:located(1, at(0.0), 20, held(other), Asked),
    ?assertMatch([{until, _, [_, {cast, door, {message, 1, other, hello}}], _}], Actions).

%% Delivered is what the robot is surely inside of: by the error of its place.
located_test() ->
    {_, Asked} = starl_geocast_delivery:check(10, held(news), new()),
    Traced = {trace, {delivered, ?ID, erlang:phash2({?AREA, news, hello})}},
    {Actions, Store} = located(1, at(998.0), 20, Asked),
    ?assertEqual(
        [{until, 100010, [Traced, {cast, app, {message, 1, news, hello}}], {delivered, ?ID}}],
        Actions
    ),
    ?assertEqual([], starl_geocast_store:waiting(20, #{news => app}, Store)),
    {[], Left} = located(1, at(998.1), 20, Asked),
    ?assertEqual(held(news), Left).

%% An answer counts for 0.1 s, to the question that was asked last, and only if it is one.
stale_test() ->
    {_, Asked} = starl_geocast_delivery:check(10, held(news), new()),
    ?assertMatch({[_], _}, located(1, at(0.0), 100010, Asked)),
    ?assertEqual(stale, located(1, at(0.0), 100011, Asked)),
    ?assertEqual(stale, located(1, {error, unknown}, 20, Asked)),
    ?assertEqual(stale, located(2, at(0.0), 20, Asked)),
    {_, Again} = starl_geocast_delivery:check(30, held(news), Asked),
    ?assertEqual(stale, located(1, at(0.0), 40, Again)),
    ?assertMatch({[_], _}, located(2, at(0.0), 100030, Again)).

%% A delivery leaves while the message lives, too.
deadline_test() ->
    Held = starl_geocast_store:hold(
        {?ID, ?AREA, news, hello, 50000, 50000, 5}, 50000, true, 1000, starl_geocast_store:new(9, 0)
    ),
    {_, Asked} = starl_geocast_delivery:check(10, Held, new()),
    {[{until, Until, _, _}], _} = starl_geocast_delivery:located(1, at(0.0), 20, Held, Asked),
    ?assertEqual(49999, Until).
