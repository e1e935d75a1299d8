%% The program that shows a page on the user's display, if there is one.
-module(starl_lab_browser_tests).
-include_lib("eunit/include/eunit.hrl").

a_display_opens_the_page_test() ->
    ?assertEqual({ok, "/bin/xdg-open"}, program({unix, linux}, #{"DISPLAY" => ":0"})),
    ?assertEqual(
        {ok, "/bin/xdg-open"}, program({unix, linux}, #{"WAYLAND_DISPLAY" => "wayland-0"})
    ),
    ?assertEqual({ok, "/bin/wslview"}, program({unix, linux}, #{"WSL_DISTRO_NAME" => "Debian"})),
    ?assertEqual({ok, "/bin/open"}, program({unix, darwin}, #{})).

without_a_display_nothing_is_opened_test() ->
    ?assertEqual(none, program({unix, linux}, #{})),
    ?assertEqual(none, program({unix, linux}, #{"DISPLAY" => ""})),
    ?assertEqual(none, program({unix, darwin}, #{"SSH_CONNECTION" => "10.0.0.1 1 10.0.0.2 22"})).

without_its_program_nothing_is_opened_test() ->
    Env = fun(Name) -> maps:get(Name, #{"DISPLAY" => ":0"}, false) end,
    ?assertEqual(none, starl_lab_browser:program(Env, {{unix, linux}, fun(_) -> false end})).

program(Os, Set) ->
    Env = fun(Name) -> maps:get(Name, Set, false) end,
    starl_lab_browser:program(Env, {Os, fun(Program) -> "/bin/" ++ Program end}).
