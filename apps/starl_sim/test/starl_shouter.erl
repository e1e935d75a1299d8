%% An application for tests: the first robot shouts numbers, the others count what they hear.
-module(starl_shouter).
-behaviour(starl_app).
-export([options/0, init/2, step/2]).

options() ->
    [
        {shouts, {integer, 0, 10000}, 20, "what the first robot says"},
        {deaf_ms, {integer, 0, 100000}, 0, "so long the others do something else"}
    ].

init(Robot, #{shouts := N, deaf_ms := Ms}) ->
    ok = starl:listen(Robot, number),
    case starl:id(Robot) of
        1 -> {shout, N};
        _ -> {hear, Ms, []}
    end.

step(_Robot, {shout, 0}) ->
    {done, said};
step(Robot, {shout, N}) ->
    ok = starl:shout(Robot, number, N),
    ok = starl:sleep(Robot, 10),
    {continue, {shout, N - 1}};
step(Robot, {hear, Ms, Heard}) ->
    ok = starl:sleep(Robot, Ms),
    case starl:await(Robot, number, 2000) of
        {ok, 1, N} -> {continue, {hear, 0, [N | Heard]}};
        timeout -> {done, {heard, Heard}}
    end.
