-module(starl_cli_compose_tests).
-include_lib("eunit/include/eunit.hrl").

%% Each guarantee of another block that one rests on is there.
blocks_rest_on_what_there_is_test() ->
    Parts = [
        begin
            {ok, Guarantees} = starl_block:guarantees(Block),
            ?assertNotEqual([], Guarantees),
            {Name, Guarantees}
        end
     || {Name, Block} <- starl_block_catalogue:known()
    ],
    [
        ?assertEqual({Name, One, holds}, {Name, One, Verdict})
     || {Name, Own} <- starl_guarantee:composed(Parts, []), {One, Verdict} <- Own
    ].

told(App, Kinds) ->
    {ok, Text} = starl_cli_compose:told(#{app => App}, Kinds, 80),
    unicode:characters_to_list(Text).

a_painting_without_faults_may_rely_on_all_test() ->
    ?assertEqual(nomatch, string:find(told(starl_painting, []), "Not while")).

a_clock_that_is_set_reaches_the_painting_test() ->
    [_, Open] = string:split(told(starl_painting, [clock_step]), "Not while"),
    ?assertNotEqual(nomatch, string:find(Open, "tubes that robots hold")),
    ?assertNotEqual(nomatch, string:find(Open, "clock_step")),
    ?assertEqual(nomatch, string:find(Open, "ink lies")).

loss_leaves_a_painting_all_test() ->
    ?assertNotEqual(
        nomatch, string:find(told(starl_painting, [isolate]), "every line is painted\n      needs")
    ),
    [_, Open] = string:split(told(starl_painting, [loss]), "Not while"),
    ?assertEqual(nomatch, string:find(Open, "every line is painted")).

every_application_is_composed_test_() ->
    [
        {timeout, 60, ?_assertMatch([_ | _], told(App, []))}
     || {_, App} <- starl_cli_target:apps()
    ].

an_application_that_says_nothing_is_told_test() ->
    ?assertNotEqual(
        nomatch, string:find(told(starl_exercise, []), "does not say what it guarantees")
    ).
