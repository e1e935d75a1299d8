%% Every argument that an application can get wrong, of the API and of the blocks, is its own error
%% at the call, which names function, argument and what was given.
%%
%% Holds: A wrong key, value or shape is one line at the call
%% Red: any atom taken for a key
-module(starl_caller_tests).
-include_lib("eunit/include/eunit.hrl").

-define(R, (starl:robot(1, [1, 2]))).

mistakes() -> of_robots() ++ of_blocks().

of_robots() ->
    [
        {'Ms', 0.5, fun(X) -> starl:sleep(?R, X) end},
        {'Key', "error", fun(X) -> starl:measure(?R, X, 1) end},
        {'Key', 'Error', fun(X) -> starl:measure(?R, X, 1) end},
        {'Key', '', fun(X) -> starl:measure(?R, X, 1) end},
        {'Key', 'a,b', fun(X) -> starl:measure(?R, X, 1) end},
        {'Value', infinity, fun(X) -> starl:measure(?R, error_mm, X) end},
        {'Value', 1.0e16, fun(X) -> starl:measure(?R, error_mm, X) end},
        {'Value', 1 bsl 2000, fun(X) -> starl:measure(?R, error_mm, X) end},
        {'Shape', nothing, fun(X) -> starl:draw(?R, X) end},
        {'Shape', #{key => a, line => [{1}]}, fun(X) -> starl:draw(?R, X) end},
        {'Items', [], fun(X) -> starl:choice(?R, X) end},
        {'Items', {1, 2}, fun(X) -> starl:choice(?R, X) end},
        {'Items', [a | b], fun(X) -> starl:shuffle(?R, X) end},
        {'Mean', nan, fun(X) -> starl:normal(?R, X, 1) end},
        {'Deviation', -1, fun(X) -> starl:normal(?R, 0, X) end},
        {'Ms', -5, fun(X) -> starl:sleep(?R, X) end},
        {'Ms', infinity, fun(X) -> starl:sleep(?R, X) end},
        {'Ms', 1 bsl 60, fun(X) -> starl:sleep(?R, X) end},
        {'To', north, fun(X) -> starl:send(?R, X, a, b) end},
        {'To', 0, fun(X) -> starl:send(?R, X, a, b) end},
        {'Type', "a", fun(X) -> starl:send(?R, 2, X, b) end},
        {'To', 2.0, fun(X) -> starl:post(?R, X, a, b) end},
        {'Type', {a}, fun(X) -> starl:post(?R, 2, X, b) end},
        {'Type', 1, fun(X) -> starl:broadcast(?R, X, b) end},
        {'Type', <<"a">>, fun(X) -> starl:listen(?R, X) end},
        {'Type', [a, b], fun(X) -> starl:await(?R, X) end},
        {'Type', [a], fun(X) -> starl:await(?R, X, 5) end},
        {'Ms', infinity, fun(X) -> starl:await(?R, a, X) end},
        {'Ms', 1.0, fun(X) -> starl:await(?R, a, X) end},
        {'Id', all, fun(X) -> starl:position(?R, X) end},
        {'Id', -1, fun(X) -> starl:position(?R, X) end},
        {'Name', "dock", fun(X) -> starl:waypoint(?R, X) end},
        {'Goal', {north, 1.0}, fun(X) -> starl:go_to(?R, X) end},
        {'Goal', {1.0, 1 bsl 2000}, fun(X) -> starl:go_to(?R, X) end},
        {'Goal', {1.0, 2.0, 3.0}, fun(X) -> starl:go_to(?R, X) end},
        {'Goal', "dock", fun(X) -> starl:go_to(?R, X) end},
        {'Device', "pen", fun(X) -> starl:actuate(?R, X, down) end},
        {'Name', "sap", fun(X) -> starl:call(?R, X, x, infinity) end},
        {'Ms', 0, fun(X) -> starl:call(?R, sap, x, X) end},
        {'Ms', 0.5, fun(X) -> starl:call(?R, sap, x, X) end}
    ].

of_blocks() ->
    [
        {'Ms', 0, fun(X) -> starl_election:elect(?R, a, X) end},
        {'Ms', infinity, fun(X) -> starl_election:elect(?R, a, X) end},
        {'Ms', -1, fun(X) -> starl_mutex:acquire(?R, a, X) end},
        {'Tokens', [a | b], fun(X) -> starl_mutex:acquire(?R, X, 5) end},
        {'Tokens', [a, [b]], fun(X) -> starl_mutex:acquire(?R, X) end},
        {'Tokens', [a | b], fun(X) -> starl_mutex:release(?R, X) end},
        {'Token', [a], fun(X) -> starl_mutex:owner(?R, X) end},
        {'Fun', none, fun(X) -> starl_mutex:with_token(?R, a, X) end},
        {'Ms', 2.5, fun(X) -> starl_barrier:sync(?R, a, X) end},
        {'Area', everywhere, fun(X) -> starl_geocast:send(?R, X, a, b, #{}) end},
        {'Area', {circle, {0, 0}, 1}, fun(X) -> starl_geocast:send(?R, X, a, b, #{}) end},
        {'Area', {circle, {0.0, 0.0}, 1.0e300}, fun(X) -> starl_geocast:send(?R, X, a, b, #{}) end},
        {'Area', {polygon, [{0.0, 0.0} | x]}, fun(X) -> starl_geocast:send(?R, X, a, b, #{}) end},
        {'Type', "a", fun(X) -> starl_geocast:send(?R, area(), X, b, #{}) end},
        {'Options', [], fun(X) -> starl_geocast:send(?R, area(), a, b, X) end},
        {'Options', #{life => 1}, fun(X) -> starl_geocast:send(?R, area(), a, b, X) end},
        {lifetime_ms, 0, fun(X) -> starl_geocast:send(?R, area(), a, b, #{lifetime_ms => X}) end},
        {hops, 1.5, fun(X) -> starl_geocast:send(?R, area(), a, b, #{hops => X}) end},
        {'Type', "a", fun(X) -> starl_geocast:listen(?R, X) end},
        {'Coordinator', 7, fun(X) -> starl_dpp:join(?R, X) end},
        {'Coordinator', me, fun(X) -> starl_dpp:join(?R, X) end},
        {'Path', complete, fun(X) -> starl_dpp:lines(X) end},
        {'Path', {error, restarted}, fun(X) -> starl_dpp:drive(?R, X, 1) end},
        {'N', 0, fun(X) -> starl_dpp:drive(?R, path(), X) end},
        {'N', 2, fun(X) -> starl_dpp:drive(?R, path(), X) end},
        {'N', 2, fun(X) -> starl_dpp:face(?R, path(), X) end}
    ].

area() -> {circle, {0.0, 0.0}, 1.0}.

path() -> {{1, 1}, {0.0, 0.0}, [{{0.0, 0.0}, up}]}.

mistakes_test_() ->
    [
        {lists:flatten(io_lib:format("~tp ~tp", [Fun, Given])), fun() ->
            ?assertError(
                {bad_argument, #{
                    function := {_, _, _},
                    argument := Argument,
                    given := Given,
                    expected := [_ | _],
                    application := none
                }},
                Fun(Given)
            )
        end}
     || {Argument, Given, Fun} <- mistakes()
    ].

%% Terms that another robot, or this one after a reboot, could not get, in every argument that takes a
%% term. The term itself is not given: it may be of any size.
payloads() ->
    [
        {'Body', fun(X) -> starl:send(?R, 2, a, X) end},
        {'Body', fun(X) -> starl:post(?R, 2, a, X) end},
        {'Body', fun(X) -> starl:broadcast(?R, a, X) end},
        {'Term', fun(X) -> starl:store(?R, X) end},
        {'Body', fun(X) -> starl_geocast:send(?R, area(), a, X, #{}) end},
        {'Name', fun(X) -> starl_registers:put(?R, X, 1) end},
        {'Value', fun(X) -> starl_registers:put(?R, x, X) end},
        {'Name', fun(X) -> starl_registers:get(?R, X) end},
        {'Name', fun(X) -> starl_registers:subscribe(?R, X) end},
        {'Name', fun(X) -> starl_barrier:sync(?R, X) end},
        {'Name', fun(X) -> starl_barrier:round(?R, X) end},
        {'Election', fun(X) -> starl_election:elect(?R, X) end},
        {'Tokens', fun(X) -> starl_mutex:acquire(?R, X) end},
        {'Tokens', fun(X) -> starl_mutex:acquire(?R, [a, X]) end},
        {'Tokens', fun(X) -> starl_mutex:release(?R, X) end},
        {'Token', fun(X) -> starl_mutex:owner(?R, X) end},
        {'Tokens', fun(X) -> starl_mutex:with_token(?R, X, fun(_) -> ok end) end}
    ].

payloads_test_() ->
    Odd = [
        {{holds, pid}, {a, self()}},
        {{holds, function}, #{a => fun() -> ok end}},
        {{holds, reference}, make_ref()},
        {too_large, binary:copy(<<0>>, 10_000_001)}
    ],
    [
        {lists:flatten(io_lib:format("~tp ~tp", [Fun, Why])), fun() ->
            ?assertError(
                {bad_argument, #{
                    function := {_, _, _},
                    argument := Argument,
                    given := Why,
                    why := [_ | _],
                    expected := [_ | _],
                    application := none
                }},
                Fun(Given)
            )
        end}
     || {Argument, Fun} <- payloads(), {Why, Given} <- Odd
    ].

%% A right call from elsewhere is told so.
outside_of_an_application_test() ->
    ?assertError({not_in_an_application, _}, starl:sleep(?R, 5)),
    ?assertError({not_in_an_application, _}, starl:now(?R)).
