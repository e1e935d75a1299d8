%% Words that several commands print alike.
-module(starl_lab_phrase_tests).
-include_lib("eunit/include/eunit.hrl").

text(none) -> none;
text(Words) -> unicode:characters_to_list(Words).

%% Neighbours together, in order; two of them are no range.
robots_test_() ->
    [
        ?_assertEqual(Text, text(starl_lab_phrase:robots(Ids)))
     || {Text, Ids} <- [
            {"robot 7", [7]},
            {"robots 1, 2", [2, 1]},
            {"robots 1-3", [3, 1, 2]},
            {"robots 1-4, 7, 9, 10", [1, 2, 3, 4, 7, 9, 10]}
        ]
    ].

-define(OWN, {my_app, step, 2, "my_app.erl", 12}).

crash_test() ->
    Crash = fun(Stack) -> text(starl_lab_phrase:crash({1500000, 3, app, {"badarg", Stack}})) end,
    ?assertEqual("my_app.erl:12: my_app:step/2: badarg (robot 3, 1.500000 s)", Crash([?OWN])),
    ?assertEqual("badarg (robot 3, 1.500000 s)", Crash([])).

waits_test_() ->
    Starl = {starl_mutex, enter, 2, "starl_mutex.erl", 40},
    Inner = {starl_machine, step, 3, "starl_machine.erl", 9},
    [
        ?_assertEqual(Text, text(starl_lab_phrase:waits(Waiting)))
     || {Text, Waiting} <- [
            {none, none},
            {none, {nothing, [?OWN]}},
            {"starl:await(go, stop), my_app.erl:12",
                {{message, [{app, stop}, {app, go}, stop]}, [?OWN]}},
            {"starl:sleep, my_app.erl:12", {time, [?OWN]}},
            {"an answer of its machine mutex, my_app.erl:12", {{answer, mutex}, [?OWN]}},
            %% the outermost call of the library is the one that the application has written
            {"starl_mutex:enter, my_app.erl:12", {time, [Inner, Starl, ?OWN]}},
            {"starl:sleep", {time, []}}
        ]
    ].
