%% What a robot's computer says is data: it makes no atoms, and what is no term of ours is none.
-module(starl_fleet_term_tests).
-include_lib("eunit/include/eunit.hrl").

%% What is written is read, after other lines, too.
read_test() ->
    Term = #{
        release => "1-a",
        'odd atom' => {1, -2.5, 1.0e-7},
        text => "a \"quoted\" word\\ \x{e9}",
        bytes => <<"abc">>,
        list => [answers, [], {done, "x"}]
    },
    ?assertEqual(
        {ok, Term}, starl_fleet_term:read(["warning: x\r\n", starl_fleet_term:write(Term)])
    ).

%% A name that this VM does not know is a string, and a million of them are no million atoms.
no_new_atoms_test() ->
    Fresh = "zz" ++ integer_to_list(erlang:unique_integer([positive])) ++ "fresh",
    ?assertEqual({ok, #{app => Fresh}}, starl_fleet_term:read("#{app => " ++ Fresh ++ "}.\n")),
    ?assertEqual({ok, Fresh ++ "!"}, starl_fleet_term:read("'" ++ Fresh ++ "!'.\n")),
    ?assertError(badarg, list_to_existing_atom(Fresh)),
    Before = erlang:system_info(atom_count),
    Names = lists:join(",", [Fresh ++ integer_to_list(N) || N <- lists:seq(1, 1000)]),
    ?assertMatch({ok, [_ | _]}, starl_fleet_term:read(["[", Names, "].\n"])),
    ?assert(erlang:system_info(atom_count) - Before < 100).

%% Variables, calls, comments, characters, other bases, too much: none.
refused_test_() ->
    [
        {Text, ?_assertEqual(none, starl_fleet_term:read(Text))}
     || Text <- [
            "",
            "\n",
            "#{release => X}.",
            "halt().",
            "fun() -> ok end.",
            "$a.",
            "16#ff.",
            "a % b",
            "\"open",
            "'open",
            "#{a => 1",
            "a b.",
            lists:duplicate(200000, $1),
            "\e[31mred."
        ]
    ].
