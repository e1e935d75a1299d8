%% What a robot knows of the owners of tokens, and the requests that wait for their tokens.
-module(starl_mutex_owners_tests).
-include_lib("eunit/include/eunit.hrl").

-define(O, starl_mutex_owners).

%% Only a newer owner is news, and sets those going that wait here for the token.
announced_test() ->
    New = ?O:new(),
    ?assertEqual({0, none}, ?O:newest(a, New)),
    Waiting = ?O:wait(b, {{4, 1}, 9}, 3, ?O:wait(a, {{3, 1}, 5}, 3, New)),
    {newer, Early, Told} = ?O:announced(a, 6, 2, Waiting),
    ?assertEqual({[{{3, 1}, 5}], {6, 2}}, {Early, ?O:newest(a, Told)}),
    ?assertEqual({[], Told}, ?O:take_early(a, Told)),
    ?assertMatch({[{4, 1}], _}, ?O:take_early(b, Told)),
    [?assertEqual({F, known}, {F, ?O:announced(a, F, 1, Told)}) || F <- [5, 6]],
    ?assertMatch({newer, [], _}, ?O:announced(a, 7, 1, Told)),
    ?assertEqual({7, 1}, ?O:newest(a, ?O:handed(a, 7, 1, Told))),
    ?assertEqual({0, none}, ?O:newest(b, Told)).

%% Those that wait are served in the order in which they came, one a robot's request, so many.
wait_test() ->
    Wait = fun(Requests, Most) ->
        Owners = lists:foldl(fun(E, O) -> ?O:wait(a, E, Most, O) end, ?O:new(), Requests),
        {newer, Early, _} = ?O:announced(a, 100, 1, Owners),
        {Requested, Left} = ?O:take_early(a, Owners),
        ?assertEqual([Request || {Request, _} <- Early], Requested),
        ?assertEqual({[], Left}, ?O:take_early(a, Left)),
        Early
    end,
    [A, B, C] = [{{R, 1}, 5} || R <- [3, 1, 2]],
    ?assertEqual([A, B, C], Wait([A, B, C], 3)),
    ?assertEqual([A, B], Wait([A, B, C], 2)),
    ?assertEqual([{{3, 1}, 7}, B], Wait([A, B, {{3, 1}, 7}], 3)),
    ?assertEqual([A, B], Wait([A, B, {{3, 1}, 4}], 3)),
    ?assertEqual([A, {{3, 2}, 4}], Wait([A, {{3, 2}, 4}], 3)).
