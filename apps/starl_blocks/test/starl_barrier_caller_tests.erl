%% What becomes of a round when the application that waits for it is gone.
-module(starl_barrier_caller_tests).
-include_lib("eunit/include/eunit.hrl").

%% One that crashed or is not started any more waits for nothing: no timer of its is left.
caller_gone_test() ->
    [
        begin
            {Actions, _} = step(info, {Gone, app}, waiting()),
            ?assertEqual([{{timeout, {patience, a}}, cancel}],
                         [A || {{timeout, {patience, a}}, cancel} = A <- Actions])
        end
     || Gone <- [restarted, given_up]
    ].

waiting() ->
    {_, New} = starl_machine:new(starl_barrier_rounds, #{}, #{
        robot => 1, participants => [1, 2], name => barrier, incarnation => 1,
        stored => none, random => rand:seed_s(exsss, 1), now => 0
    }),
    {Actions, Waiting} = step({call, {app, 1}}, {sync, a, 1, 5000000}, New),
    ?assertMatch([_ | _], [A || {{timeout, {patience, a}}, _, _} = A <- Actions]),
    Waiting.

step(Type, Content, Machine) ->
    starl_machine:step(Type, Content, #{now => 0, robot => 1}, Machine).
