%% The record of a run: what is written is read, and what is no record is told in one line.
-module(starl_cli_record_tests).
-include_lib("eunit/include/eunit.hrl").

in_directory(Test) -> starl_cli_vm:in_directory(Test).

record() ->
    Violation = #{
        contract => starl_sap_monitor,
        what => changed,
        at_us => 1200,
        robots => [1, 2],
        details => #{pid => self()}
    },
    Scenario = (starl_cli_flags:defaults(starl_run_scenario:options(starl_painting)))#{
        app => starl_painting, faults => [{a, 1, 2, kill_machine, {2, sap}, #{}}]
    },
    starl_cli_record:make(
        painting,
        Scenario,
        {violation, #{
            digest => <<16#0a, 16#ff>>,
            end_us => 1234567,
            events => 99,
            violations => [Violation],
            robots => [{1, #{result => {done, self()}}}, {2, #{result => running}}]
        }},
        "0123456789ab"
    ).

what_is_written_is_read_test() ->
    in_directory(fun(Dir) ->
        Record = record(),
        ok = starl_cli_record:write(Dir, Record),
        ?assertEqual({ok, Record}, starl_cli_record:read(Dir)),
        ?assertEqual({ok, Record}, starl_cli_record:read(filename:join(Dir, "run.term"))),
        File = filename:join(Dir, "other.term"),
        ok = starl_cli_record:write(File, Record#{app := "/tmp/ä/my_app.erl", violations := []}),
        ?assertMatch({ok, #{app := "/tmp/ä/my_app.erl"}}, starl_cli_record:read(File))
    end).

it_holds_what_a_reader_needs_test() ->
    #{
        app := painting,
        digest := "0aff",
        ending := violation,
        end_us := 1234567,
        events := 99,
        code := "0123456789ab",
        scenario := Scenario,
        options := Options,
        violations := [#{contract := starl_sap_monitor, at_us := 1200, text := Text}]
    } = record(),
    ?assertMatch(#{picture := "house", robots := 4, faults := [_]}, Scenario),
    ?assertMatch(#{picture := "house"}, Options),
    ?assertNot(is_map_key(robots, Options)),
    ?assertNotEqual(nomatch, string:find(Text, "changed")).

%% The digest of a run that hung, that lost a node, or that passed in real time, is empty.
a_record_without_a_digest_is_read_test_() ->
    [
        {atom_to_list(Ending), fun() ->
            in_directory(fun(Dir) ->
                Outcome = #{
                    digest => <<>>, end_us => 9, events => 3, violations => [], robots => []
                },
                Scenario = starl_cli_flags:defaults(starl_run_scenario:options(starl_painting)),
                Record = starl_cli_record:make(
                    painting,
                    Scenario#{app => starl_painting},
                    {Ending, Outcome},
                    "0123456789ab"
                ),
                ok = starl_cli_record:write(Dir, Record),
                ?assertMatch({ok, #{digest := "", ending := Ending}}, starl_cli_record:read(Dir))
            end)
        end}
     || Ending <- [hung, lost, done]
    ].

%% A record of an earlier version has no results, and does not tell its code.
without_results_and_code_test() ->
    in_directory(fun(Dir) ->
        Record = maps:without([results, code], record()),
        ok = starl_cli_record:write(Dir, Record),
        ?assertEqual({ok, Record}, starl_cli_record:read(Dir))
    end).

bad_files_test_() ->
    [
        {Part, fun() ->
            in_directory(fun(Dir) ->
                File = filename:join(Dir, "run.term"),
                ok = file:write_file(File, Text),
                {error, Reason} = starl_cli_record:read(File),
                Line = unicode:characters_to_list(starl_cli_record:format_error(Reason)),
                ?assertNotEqual({nomatch, Line}, {string:find(Line, Part), Line})
            end)
        end}
     || {Part, Text} <- [
            {"no run is recorded here", "#{app => painting}."},
            {"lacks app, scenario, options, ending", "#{digest => \"00\"}."},
            {"not what a run writes: digest, end_us", text(#{digest => 7, end_us => -1})},
            {"not what a run writes: results", text(#{results => [1]})},
            {"run.term:1: ", "#{digest => "},
            {"one map", "[1]."}
        ]
    ].

text(Changes) -> starl_cli_record:text(maps:merge(record(), Changes)).

nothing_there_test() ->
    in_directory(fun(Dir) ->
        ?assertEqual({error, {no_record, Dir}}, starl_cli_record:read(Dir)),
        File = filename:join(Dir, "none"),
        {error, Reason} = starl_cli_record:read(File),
        Line = unicode:characters_to_list(starl_cli_record:format_error(Reason)),
        ?assertNotEqual(nomatch, string:find(Line, "no such file")),
        Closed = filename:join(File, "run.term"),
        ?assertMatch({error, {unwritable, Closed, _}}, starl_cli_record:write(Closed, record()))
    end).
