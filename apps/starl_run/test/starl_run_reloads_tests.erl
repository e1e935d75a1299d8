%% Reloads of a scenario that cannot be.
-module(starl_run_reloads_tests).
-include_lib("eunit/include/eunit.hrl").

%% The list may have any order: a reload is named by its time.
the_wrong_one_of_several_is_named_test_() ->
    {timeout, 60, fun the_wrong_one_of_several_is_named/0}.

the_wrong_one_of_several_is_named() ->
    Parts = #{app => starl_sim_script_app},
    Refused = fun(Reloads) ->
        {error, Why} = starl_run_reloads:make(#{reloads => Reloads, robots => 2}, Parts),
        lists:flatten(Why)
    end,
    Given = [{9000, all, lists}, {1000, 7, lists}, {3000, 8, lists}],
    ?assertEqual("the reload at 1000 ms: there is no robot 7", Refused(Given)),
    ?assertEqual("the reload at 3000 ms: there is no robot 8", Refused([lists:last(Given)])).
