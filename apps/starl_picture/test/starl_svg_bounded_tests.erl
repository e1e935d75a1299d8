%% The bounds on work and memory of the picture reader.
-module(starl_svg_bounded_tests).
-include_lib("eunit/include/eunit.hrl").

within_the_bounds_test() -> ?assertEqual({ok, 3}, starl_svg_bounded:run(fun() -> {ok, 1 + 2} end)).

endless_work_test_() ->
    {timeout, 300, ?_assertEqual({error, too_complex}, starl_svg_bounded:run(fun forever/0))}.

endless_memory_test_() ->
    {timeout, 300,
        ?_assertEqual({error, too_complex}, starl_svg_bounded:run(fun() -> grown([]) end))}.

forever() -> forever().

grown(List) -> grown([lists:seq(1, 1000) | List]).
