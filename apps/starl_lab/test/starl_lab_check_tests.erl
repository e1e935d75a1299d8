%% The words of `./starl check': what is refused, and the status of what is done.
-module(starl_lab_check_tests).
-include_lib("eunit/include/eunit.hrl").

check(Args) -> starl_cli_dispatch:run(starl_lab_check:command(), Args).

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
            ["terms", "--terms", "0"],
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

%% The verdict says up to where a model goes that has no end.
terms_test() ->
    ?assertNotEqual(
        nomatch, string:find(told(["--terms", "2"]), "2 robots, no faults, up to term 2: ")
    ),
    ?assertNotEqual(nomatch, string:find(told([]), "up to term 3: ")).

told(More) ->
    {0, Told} = starl_cli_said:said(
        ["check", "terms", "--robots", "2", "--faults", "none", "--quiet" | More]
    ),
    Told.

help_test() ->
    ?assertEqual(0, check(["mutex", "--help"])).
