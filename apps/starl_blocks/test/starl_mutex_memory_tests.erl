%% The memory of a mutex machine: what a robot of the team makes up is bounded, and the others get their tokens.
-module(starl_mutex_memory_tests).
-include_lib("eunit/include/eunit.hrl").

start(Robot) ->
    {ready, Data, _} = starl_mutex_tokens:init(#{
        robot => Robot,
        participants => [{1, 3}],
        incarnation => 1,
        now => 0,
        stored => none
    }),
    Data.

hears(From, Body, Data) ->
    ?assert(starl_mutex_tokens:accepts(mutex, Body)),
    case
        starl_mutex_tokens:handle_event(cast, {message, From, mutex, Body}, ready, Data, #{now => 0})
    of
        {keep_state, Next, Actions} -> {Next, Actions};
        {keep_state, Next} -> {Next, []};
        keep_state_and_data -> {Data, []}
    end.

many(Body, Count, Data) ->
    lists:foldl(fun(N, D) -> element(1, hears(3, Body(N), D)) end, Data, lists:seq(1, Count)).

%% Tokens that nobody knows are asked for at their home, announced, and looked for; many requests for one.
made_up_test_() ->
    [
        {timeout, 60, fun() -> made_up(Body) end}
     || Body <- [
            fun(N) -> {request, {x, N}, {3, 1}, 0, home} end,
            fun(N) -> {owner, {x, N}, N} end,
            fun(N) -> {request, {x, N}, {3, 1}, 1 bsl 60, home} end,
            fun(N) -> {request, door, {3, N}, 0, home} end
        ]
    ].

made_up(Body) ->
    Attacked = many(Body, 15000, start(1)),
    ?assert(erlang:external_size(Attacked) < 4096 * 130, erlang:external_size(Attacked)),
    {_, Actions} = hears(2, {request, mine, {2, 1}, 0, home}, Attacked),
    ?assertMatch([_], [Fence || {cast, sap, {send, 2, mutex, {token, mine, Fence, _}}} <- Actions]).

%% What no application may call a token is taken from nobody.
too_long_test() ->
    Long = binary:copy(<<0>>, 1001),
    [
        ?assertNot(starl_mutex_tokens:accepts(mutex, Body))
     || Body <- [
            {request, Long, {3, 1}, 0, home},
            {token, Long, 1, []},
            {owner, Long, 1},
            {ask, claim, Long, 1, {1, 1}},
            {return, Long, 1, []},
            {granted, Long, 1, {1, 1}},
            {refused, Long, 1, {1, 1}}
        ]
    ].
