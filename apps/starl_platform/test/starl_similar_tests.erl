-module(starl_similar_tests).
-include_lib("eunit/include/eunit.hrl").

similar_words_come_first_and_others_not_at_all_test_() ->
    [
        ?_assertEqual(Near, starl_similar:words(Text, ["run", "table", "bench", "scenarios"]))
     || {Text, Near} <- [
            {"rnu", ["run"]},
            {"tabel", ["table"]},
            {"scenario", ["scenarios"]},
            %% two of five letters, and three
            {"taxxe", ["table"]},
            {"taxxx", []},
            {"xyzzy", []},
            {"", []}
        ]
    ].

a_mistyped_atom_is_known_test_() ->
    [
        ?_assertEqual(Near, starl_similar:atoms(Name, [robots, loss, delay, duplicate]))
     || {Name, Near} <- [
            {robot, [robots]},
            {los, [loss]},
            {duplciate, [duplicate]},
            {banana, []},
            {"loss", []}
        ]
    ].

the_message_ends_with_the_most_similar_name_test_() ->
    [
        ?_assertEqual(Text, lists:flatten(starl_similar:meant(Near, "; there are more")))
     || {Near, Text} <- [
            {["run", "ran"], " (did you mean run?)"},
            {[loss], " (did you mean loss?)"},
            {[], "; there are more"}
        ]
    ].
