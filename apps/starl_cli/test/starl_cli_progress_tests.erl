%% The progress line fits every window and never runs over its bounds.
-module(starl_cli_progress_tests).
-include_lib("eunit/include/eunit.hrl").

line(Part, Count, Width) ->
    starl_cli_progress:line(Part, Count, ["painting 12.5 s", "", "3.0 x real time"], Width).

fits_every_window_test() ->
    Over = [
        {Width, Part, Count}
     || Width <- lists:seq(0, 100),
        Part <- [unknown, 0.0, 0.5, 1.0, 7.0],
        Count <- [0, 13, 999],
        length(line(Part, Count, Width)) > Width
    ],
    ?assertEqual([], Over).

%% The more room, the more is told.
tells_what_fits_test() ->
    ?assertEqual("painting 12", line(unknown, 0, 11)),
    ?assertEqual("painting 12.5 s", line(unknown, 0, 20)),
    ?assertEqual("[==   ] painting 12.5 s", line(0.4, 0, 23)),
    ?assertEqual("painting 12.5 s, 3.0 x real time", line(0.4, 0, 33)).

the_mark_goes_to_and_fro_test() ->
    Places = [string:str(line(unknown, K, 79), "<=>") || K <- lists:seq(0, 200)],
    ?assertEqual(2, lists:min(Places)),
    ?assert(lists:max(Places) > 20),
    Steps = [abs(A - B) || {A, B} <- lists:zip(lists:droplast(Places), tl(Places))],
    ?assert(lists:max(Steps) =< 1).

quiet_draws_nothing_test() ->
    Quiet = starl_cli_progress:new(quiet),
    ?assertEqual(Quiet, starl_cli_progress:show(Quiet, unknown, fun() -> error(drawn) end)).
