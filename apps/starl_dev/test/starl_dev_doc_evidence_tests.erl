-module(starl_dev_doc_evidence_tests).
-include_lib("eunit/include/eunit.hrl").

a_tag_belongs_to_what_stands_below_it_test() ->
    Source =
        "%% A module.\n%%\n%% Holds: All of it.\n-module(m).\n\n"
        "%% Why.\n%% Holds: A robot that is deaf\n%% leads nobody.\n%% Red: abc, run:\n%% `deaf'\n"
        "%% Holds: Once more.\ndeaf_test_() ->\n    ok.\n\n%% Holds: of nothing\n\nother(X) -> X.\n",
    ?assertEqual(
        [
            #{test => all, holds => "All of it.", red => ""},
            #{
                test => "deaf",
                holds => "A robot that is deaf leads nobody.",
                red => "abc, run: `deaf'"
            },
            #{test => "deaf", holds => "Once more.", red => ""}
        ],
        starl_dev_doc_evidence:tags(Source)
    ).
