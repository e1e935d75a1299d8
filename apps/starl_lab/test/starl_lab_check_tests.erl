%% The words of `./starl check': what is refused, and the status of what is done.
-module(starl_lab_check_tests).
-include_lib("eunit/include/eunit.hrl").

check(Args) -> starl_cli_dispatch:run(starl_lab_check, Args).

refused_test_() ->
    [
        ?_assertEqual(2, check(Args))
     || Args <- [
            [],
            ["dpp"],
            ["--robots", "3"],
            ["mutex", "--robots", "9"],
            ["mutex", "--faults", "flood:1"],
            ["mutex", "--depth", "0"],
            ["mutex", "more"]
        ]
    ].

holds_test() ->
    ?assertEqual(0, check(["bully", "--faults", "none", "--quiet"])).

no_symmetry_test() ->
    Args = ["election", "--faults", "none", "--quiet", "--no-symmetry"],
    ?assertEqual(0, check(Args)).

depth_test() ->
    ?assertEqual(0, check(["mutex", "--depth", "5", "--quiet"])).

help_test() ->
    ?assertEqual(0, check(["mutex", "--help"])).
