%% A file of terms is as cheap to read as it is long, whoever wrote it.
-module(starl_terms_tests).
-include_lib("eunit/include/eunit.hrl").

%% What a file holds, and what is wrong in it, is said as file:consult says it.
as_consult_test_() ->
    [
        {timeout, 30,
            ?_test(
                in_file(Text, fun(File) ->
                    ?assertEqual({Text, file:consult(File)}, {Text, starl_terms:consult(File)})
                end)
            )}
     || Text <- [
            "",
            "%% nothing\n",
            "#{a => 1}.",
            "#{a => 1}.\n",
            "%% a\n#{a => [1, 2.5, -3, $x, \"te\\\"xt\", <<1, 2>>, <<\"x\">>]}.\n\n{b, 'C d'}.\nc.\n",
            lists:append(lists:duplicate(900, "{abc, \"def\"}.\n")),
            ["[", lists:join(",\n", lists:duplicate(9000, "a")), "].\n"],
            "\n\n{a, .\n",
            "{a\n",
            "a b.\n",
            "\n\"abc\n",
            "a",
            "A.\n",
            "{f()}.\n",
            "#{a => \"" ++ [252, 8364, 128512] ++ "\"}.\n",
            <<"\"", 255, "\".\n">>
        ]
    ].

no_file_test() ->
    ?assertEqual({error, enoent}, starl_terms:consult("/no/such/file")),
    ?assertEqual({error, eisdir}, starl_terms:consult("/")).

%% A line says what is wrong, before the memory, the time or the atoms are spent.
%% Holds: A file of terms costs what it is long; a pipe or a device is no file
%% Red: 4ca8e259, by hand: 10 GB
bombs_test_() ->
    {timeout, 60, fun() ->
        [
            in_file(Text, fun(File) ->
                Atoms = erlang:system_info(atom_count),
                {error, {Line, starl_terms, Problem}} = starl_terms:consult(File),
                ?assertEqual({What, 2}, {Problem, Line}),
                ?assert(is_list(lists:flatten(starl_terms:format_error(Problem)))),
                ?assert(erlang:system_info(atom_count) - Atoms < 150000)
            end)
         || {What, Text} <- [
                {segment, "\n<<0:80000000000>>.\n"},
                {segment, "\n#{a => <<0/integer-unit:256>>}.\n"},
                {long_word, ["\n[", lists:duplicate(1000000, $9), "].\n"]},
                {long_word, ["\n16#", lists:duplicate(1000000, $f), ".\n"]},
                {deep, ["\n", lists:duplicate(1000000, $[), lists:duplicate(1000000, $]), ".\n"]}
            ]
        ],
        in_file(["\n[", lists:join(",", names(300000)), "].\n"], fun(File) ->
            Atoms = erlang:system_info(atom_count),
            ?assertMatch({error, {_, starl_terms, names}}, starl_terms:consult(File)),
            ?assert(erlang:system_info(atom_count) - Atoms < 150000)
        end),
        in_file(lists:duplicate(starl_terms:most_bytes() + 1, $\n), fun(File) ->
            ?assertEqual({error, {1, starl_terms, too_large}}, starl_terms:consult(File))
        end),
        ?assertEqual({error, {1, starl_terms, too_large}}, starl_terms:consult("/dev/zero"))
    end}.

names(N) -> ["sb_" ++ integer_to_list(I) || I <- lists:seq(1, N)].

in_file(Text, Test) ->
    File = string:trim(os:cmd("mktemp")),
    Bytes =
        case Text of
            <<_/binary>> -> Text;
            _ -> unicode:characters_to_binary(Text)
        end,
    ok = file:write_file(File, Bytes),
    try
        Test(File)
    after
        file:delete(File)
    end.
