%% The line on a run that stands still.
-module(starl_lab_stall_tests).
-include_lib("eunit/include/eunit.hrl").

%% A deep stack is no long line, and its innermost calls are there.
short_test() ->
    Frames = [
        {my_app, list_to_atom("f" ++ integer_to_list(N)), 2, "my_app.erl", N}
     || N <- lists:seq(1, 40)
    ],
    Line = line(8000, loop, [{R, app, Frames} || R <- lists:seq(1, 9)]),
    ?assert(length(Line) < 240),
    [
        ?assertNotEqual({Part, nomatch}, {Part, string:find(Line, Part)})
     || Part <- ["my_app.erl:1: ", "at work for 8 s", "is this an endless loop?", "f3/2", ", ..."]
    ].

%% What has not done much is not called a loop; who else is at work is counted.
slow_test() ->
    Work = [{R, app, [{my_app, step, 2, "my_app.erl", R}]} || R <- lists:seq(1, 5)],
    Line = line(61000, slow, Work),
    ?assertEqual(nomatch, string:find(Line, "endless")),
    ?assertNotEqual(nomatch, string:find(Line, "; 4 more are at work")).

line(Ms, Cause, Work) ->
    unicode:characters_to_list(starl_lab_stall:line(Ms, Cause, Work)).
