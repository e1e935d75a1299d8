%% What the interface of mutual exclusion asks its machine, and what it makes of the answers.
-module(starl_mutex_interface_tests).
-include_lib("eunit/include/eunit.hrl").

-import(starl_blocks_driver, [play/2]).

acquire_test() ->
    Acquire = fun(R) -> starl_mutex:acquire(R, door) end,
    Asked = [{mutex, {acquire, door, 30000000}, infinity}],
    [
        ?assertEqual({Asked, Answer}, play(Acquire, [{answer, Answer}]))
     || Answer <- [{ok, 7}, {error, timeout}]
    ],
    ?assertEqual({Asked, {error, restarted}}, play(Acquire, [restarted])),
    ?assertEqual(
        {[{mutex, {acquire, [b, a], 5000}, infinity}], {ok, [{a, 1}, {b, 2}]}},
        play(fun(R) -> starl_mutex:acquire(R, [b, a], 5) end, [{answer, {ok, [{a, 1}, {b, 2}]}}])
    ).

release_test() ->
    Release = fun(R) -> starl_mutex:release(R, [door]) end,
    Asked = [{mutex, {release, [door]}, infinity}],
    [
        ?assertEqual({Asked, Answer}, play(Release, [{answer, Answer}]))
     || Answer <- [ok, {error, lost}]
    ],
    ?assertEqual({Asked, {error, restarted}}, play(Release, [restarted])).

owner_test() ->
    Owner = fun(R) -> starl_mutex:owner(R, door) end,
    Asked = [{mutex, {owner, door}, infinity}],
    [?assertEqual({Asked, {ok, Who}}, play(Owner, [{answer, Who}])) || Who <- [none, 3]],
    ?assertEqual({Asked, {error, restarted}}, play(Owner, [restarted])).

%% The function runs while the token is held, and not at all where it is not.
with_token_test() ->
    With = fun(R) -> starl_mutex:with_token(R, door, fun(Fence) -> {done, Fence} end) end,
    Asked = [{mutex, {acquire, door, 30000000}, infinity}, {mutex, {release, door}, infinity}],
    Answers = fun(Last) -> [{answer, {ok, 7}}, Last] end,
    ?assertEqual({Asked, {ok, {done, 7}}}, play(With, Answers({answer, ok}))),
    ?assertEqual({Asked, {error, {lost, {done, 7}}}}, play(With, Answers({answer, {error, lost}}))),
    ?assertEqual({Asked, {error, {restarted, {done, 7}}}}, play(With, Answers(restarted))),
    ?assertEqual({[hd(Asked)], {error, timeout}}, play(With, [{answer, {error, timeout}}])).

%% The mistake in a call is told with the function that was called and the argument.
mistakes_test() ->
    R = starl:robot(1, [1, 2]),
    [
        ?assertError({bad_argument, #{function := Function, argument := Argument}}, Call())
     || {Function, Argument, Call} <- [
            {{starl_mutex, acquire, 3}, 'Tokens', fun() -> starl_mutex:acquire(R, [a | b], 5) end},
            {{starl_mutex, acquire, 3}, 'Tokens', fun() -> starl_mutex:acquire(R, [a, [b]]) end},
            {{starl_mutex, acquire, 3}, 'Ms', fun() -> starl_mutex:acquire(R, a, 0) end},
            {{starl_mutex, release, 2}, 'Tokens', fun() -> starl_mutex:release(R, [[a]]) end},
            {{starl_mutex, owner, 2}, 'Token', fun() -> starl_mutex:owner(R, [a]) end},
            {{starl_mutex, with_token, 3}, 'Fun', fun() -> starl_mutex:with_token(R, a, no) end}
        ]
    ].

block_test() ->
    ?assertEqual([{mutex, starl_mutex_tokens, #{}}], starl_mutex:machines(#{})),
    ?assertEqual(
        [{mutex, starl_mutex_tokens, #{lag_ms => 1}}], starl_mutex:machines(#{lag_ms => 1})
    ).

%% The home is where the machines take it to be: of each token one robot, and all have their share.
home_test() ->
    Homes = [{T, starl_mutex:home(T, [4, 5, 6])} || T <- lists:seq(1, 60)],
    ?assertEqual([4, 5, 6], lists:usort([Home || {_, Home} <- Homes])),
    [?assertEqual(Home, asked(T)) || {T, Home} <- Homes].

%% The robot that robot 4 asks for a token.
asked(Token) ->
    {_, Machine} = starl_machine:new(starl_mutex_tokens, #{}, #{
        robot => 4,
        participants => [4, 5, 6],
        name => mutex,
        incarnation => 1,
        now => 0,
        random => rand:seed_s(exsss, 1)
    }),
    Meta = #{now => 0, robot => 4},
    {Actions, _} = starl_machine:step({call, {app, 1}}, {acquire, Token, 1000}, Meta, Machine),
    hd([To || {cast, sap, {send, To, mutex, {request, T, _, _, _}}} <- Actions, T =:= Token]).
