%% What comes from elsewhere does nothing to a terminal.
%%
%% Holds: Nothing that is printed moves the cursor or colours the terminal
%% Red: 961f67c9: no such place
-module(starl_cli_terminal_printable_tests).
-include_lib("eunit/include/eunit.hrl").

control_characters_are_replaced_test_() ->
    [
        ?_assertEqual(Shown, starl_cli_terminal:printable(Text))
     || {Text, Shown} <- [
            {"a\tb\n\x{e9}", "a\tb\n\x{e9}"},
            {["a", <<"\x{e9}"/utf8>>], "a\x{e9}"},
            {"\e]0;title\x{7}", "\x{fffd}]0;title\x{fffd}"},
            {"done\rcomplete", "done\x{fffd}complete"},
            {"\x{9b}31m", "\x{fffd}31m"},
            {"\x{202e}txt", "\x{fffd}txt"},
            {"a\x{200f}\x{200e}\x{61c}b", "a\x{fffd}\x{fffd}\x{fffd}b"},
            {"\x{7f}", "\x{fffd}"}
        ]
    ].

%% Bytes that are no text are replaced, and the text after them is kept.
bytes_that_are_no_text_test() ->
    ?assertEqual("a\x{fffd}b", starl_cli_terminal:printable(<<"a", 255, "b">>)),
    ?assertEqual("x\x{fffd}", starl_cli_terminal:printable(["x", <<16#c3>>])).
