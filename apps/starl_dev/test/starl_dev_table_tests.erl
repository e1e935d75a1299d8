%% The acceptance table's judgement, and its random pictures.
-module(starl_dev_table_tests).
-include_lib("eunit/include/eunit.hrl").

result(Changes) ->
    maps:merge(
        #{
            covered => 1.0,
            violations => 0,
            separation => 400.0,
            safe => 400,
            makespan => 10.0,
            ratio => 2.0,
            detour => 1.5,
            deadlocks => 1,
            wall => 0.5,
            digest => <<"00">>
        },
        Changes
    ).

a_row_is_sound_without_a_violation_test_() ->
    [
        ?_assert(starl_dev_table_rows:sound(result(#{}))),
        ?_assert(starl_dev_table_rows:sound(result(#{separation => none}))),
        ?_assertNot(starl_dev_table_rows:sound(result(#{separation => 399.999}))),
        ?_assertNot(starl_dev_table_rows:sound(result(#{covered => 0.9999999}))),
        ?_assertNot(starl_dev_table_rows:sound(result(#{violations => 1}))),
        ?_assertNot(starl_dev_table_rows:sound(failed))
    ].

a_row_tells_the_worst_and_the_median_test() ->
    Row = starl_dev_table_rows:figures([
        result(#{covered => 0.99999, makespan => 30.0}),
        result(#{separation => 399.99}),
        result(#{separation => none, violations => 2})
    ]),
    ?assertEqual(
        ["99.99 %", "2", "399.9", "10.0", "2.00", "1.50", "3"],
        [unicode:characters_to_list(Cell) || Cell <- Row]
    ).

a_failed_run_is_seen_test() ->
    ?assertMatch(["1 failed" | _], starl_dev_table_rows:figures([failed, result(#{})])).

random_pictures_test_() ->
    [
        {
            lists:concat(["segments ", N, ", seed ", Seed]),
            {timeout, 60, fun() -> random_picture(N, Seed) end}
        }
     || {N, Seed} <- [{1, 1}, {5, 2}, {100, 3}, {2000, 4}]
    ].

%% Read by the project's own reader, no more segments than said, and the same for the same seed.
random_picture(N, Seed) ->
    Svg = iolist_to_binary(starl_dev_table_pictures:svg(N, Seed)),
    ?assertEqual(Svg, iolist_to_binary(starl_dev_table_pictures:svg(N, Seed))),
    File = filename:join("/tmp", "starl-random-test-" ++ os:getpid() ++ ".svg"),
    ok = file:write_file(File, Svg),
    Read = starl_picture:read(File, #{area => {0.0, 0.0, 10000.0, 10000.0}, tolerance_mm => 2.0}),
    ok = file:delete(File),
    {ok, Picture} = Read,
    Segments = length(starl_picture:segments(Picture)),
    ?assert(Segments > 0),
    ?assert(Segments =< max(N, 40) * 1.6).

%% A slice has whole rows, the slices together all of them.
a_slice_has_whole_rows_test_() ->
    {timeout, 60, fun() ->
        starl_cli_vm:in_directory(fun(Dir) ->
            Args = [
                "table", "--pictures", "house", "--robots", "1,2", "--loss", "0", "--seeds", "1"
            ],
            Lines = fun(Slice) ->
                File = filename:join(Dir, [hd(Slice) | ".csv"]),
                starl_cli_vm:says(0, "all 1 runs: ", Args ++ ["--slice", Slice, "--out", File]),
                {ok, Text} = file:read_file(File),
                [_Header, Line] = string:lexemes(Text, "\n"),
                binary:part(Line, 0, 10)
            end,
            ?assertEqual([<<"\"house\",1,">>, <<"\"house\",2,">>], [Lines(S) || S <- ["1/2", "2/2"]]),
            starl_cli_vm:says(2, "--slice: 3/2: a slice is K/N", Args ++ ["--slice", "3/2"])
        end)
    end}.
