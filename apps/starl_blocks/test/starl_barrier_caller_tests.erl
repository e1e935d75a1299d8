%% What becomes of a round when the application that waits for it is gone.
-module(starl_barrier_caller_tests).
-include_lib("eunit/include/eunit.hrl").

%% One that crashed or is not started any more waits for nothing: no timer of its is left.
caller_gone_test() ->
    [
        begin
            {Actions, _} = step(info, {Gone, app}, waiting()),
            ?assertEqual(
                [{{timeout, {patience, a}}, cancel}],
                [A || {{timeout, {patience, a}}, cancel} = A <- Actions]
            )
        end
     || Gone <- [restarted, given_up]
    ].

%% Several rounds that it waited for fail in the order of their names, however many those are.
in_order_test() ->
    Names = lists:seq(1, 40),
    Waiting = lists:foldl(
        fun(Name, Machine) ->
            element(2, step({call, {app, Name}}, {sync, Name, {1, 0}, 5000000}, Machine))
        end,
        new(),
        Names
    ),
    {Actions, _} = step(info, {restarted, app}, Waiting),
    ?assertEqual(Names, [Name || {trace, {failed, Name, 1, restarted}} <- Actions]).

waiting() ->
    New = new(),
    {Actions, Waiting} = step({call, {app, 1}}, {sync, a, {1, 0}, 5000000}, New),
    ?assertMatch([_ | _], [A || {{timeout, {patience, a}}, _, _} = A <- Actions]),
    Waiting.

new() ->
    {_, New} = starl_machine:new(starl_barrier_rounds, #{}, #{
        robot => 1,
        participants => [1, 2],
        name => barrier,
        incarnation => 1,
        stored => none,
        random => rand:seed_s(exsss, 1),
        now => 0
    }),
    New.

step(Type, Content, Machine) ->
    starl_machine:step(Type, Content, #{now => 0, robot => 1}, Machine).
