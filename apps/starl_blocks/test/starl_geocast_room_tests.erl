%% What a robot of the team may tell of geocasts is bounded: a message that could not be passed on is not taken, nor one
%% of a robot that is not in the team; not too many are asked for at a time.
-module(starl_geocast_room_tests).
-include_lib("eunit/include/eunit.hrl").

-define(CIRCLE, {circle, {0.0, 0.0}, 10.0}).

start() ->
    {_, Machine} = starl_machine:new(starl_geocast_flood, #{}, #{
        robot => 1,
        participants => [{1, 3}],
        name => geocast,
        incarnation => 1,
        random => rand:seed_s(exsss, 1),
        now => 0
    }),
    Machine.

hears(Body, Machine) ->
    ?assert(starl_geocast_flood:accepts(geocast, Body)),
    starl_machine:step(cast, {message, 3, geocast, Body}, #{now => 0, robot => 1}, Machine).

give(Source, Body) ->
    {give, {{Source, 1, 1}, ?CIRCLE, news, Body, 1000000, 1000000, 3}, [{1, {1, 0}}]}.

bodies_test() ->
    ?assert(starl_geocast_flood:accepts(geocast, give(3, binary:copy(<<0>>, 49990)))),
    ?assertNot(starl_geocast_flood:accepts(geocast, give(3, binary:copy(<<0>>, 50001)))).

strangers_test() ->
    Machine = start(),
    ?assertEqual({[], Machine}, hears(give(4, x), Machine)),
    ?assertEqual({[], Machine}, hears({offer, {4, 1, 1}, 1000000, 1000000, 3}, Machine)),
    ?assertMatch({[_ | _], _}, hears(give(3, x), Machine)).

many_offers_test() ->
    Offered = lists:foldl(
        fun(N, M) -> element(2, hears({offer, {2, 1, N}, 1000000, 1000000, 3}, M)) end,
        start(),
        lists:seq(1, 20000)
    ),
    ?assert(erts_debug:flat_size(Offered) < 4096 * 20, erts_debug:flat_size(Offered)),
    ?assertMatch({[_ | _], _}, hears(give(3, x), Offered)).
