-module(starl_callback_tests).
-include_lib("eunit/include/eunit.hrl").

an_exported_function_is_called_test() ->
    ?assertEqual([2, 1], starl_callback:call(lists, reverse, [[1, 2]], none)).

a_missing_function_or_module_gives_the_default_test_() ->
    [
        ?_assertEqual(none, starl_callback:call(Module, reverse, [], none))
     || Module <- [lists, starl_no_such_module]
    ].

%% A module that no test runs.
a_module_is_loaded_first_test() ->
    _ = code:purge(edlin_expand),
    _ = code:delete(edlin_expand),
    ?assert(starl_callback:exported(edlin_expand, module_info, 0)).
