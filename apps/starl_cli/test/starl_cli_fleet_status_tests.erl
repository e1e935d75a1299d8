%% The line on a robot of a fleet.
-module(starl_cli_fleet_status_tests).
-include_lib("eunit/include/eunit.hrl").

line(More) ->
    Status = #{
        release => "1",
        app => line_up,
        started => erlang:system_time(second),
        link => answers,
        result => running,
        crashes => 0
    },
    said(starl_fleet_term:write(maps:merge(Status, More))).

said(Text) ->
    Robot = #{user => none, host => "a"},
    lists:flatten(starl_cli_fleet_status:line(1, Robot, unicode:characters_to_list(Text))).

a_chassis_that_tells_nothing_is_not_told_of_test() ->
    ?assertMatch({_, _}, binary:match(list_to_binary(line(#{})), <<" s\n">>)).

the_body_is_told_of_test() ->
    Chassis = #{
        control => false,
        charge => 12,
        priority => raised,
        senses => [{bump, left}, {drop, 0}, {cliff, [left]}, {docked, true}, {battery, low}]
    },
    Line = line(#{chassis => Chassis}),
    [
        ?assertNotEqual({Part, nomatch}, {Part, string:find(Line, Part)})
     || Part <- [
            "not under control",
            "battery 12 %",
            "low battery",
            "on its dock",
            "bump left",
            "at a cliff",
            "LimitRTPRIO=1"
        ]
    ],
    ?assertEqual(nomatch, string:find(Line, "hangs")).

%% ssh, or a shell, warned of something first.
an_answer_after_a_warning_test() ->
    Status = #{
        release => "1", app => a, started => 0, link => answers, result => running, crashes => 0
    },
    Text = ["Warning: added 'a' to the known hosts.\r\n", starl_fleet_term:write(Status)],
    ?assertNotEqual(nomatch, string:find(said(Text), "a runs, release 1, ")).

what_is_not_known_is_shown_test() ->
    Line = said("bash: cannot set locale\n{no"),
    ?assertNotEqual(nomatch, string:find(Line, "nothing that we know: \"bash: cannot")),
    ?assertNotEqual(nomatch, string:find(said(""), "nothing that we know: []")).
