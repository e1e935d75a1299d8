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
    Answer = {ok, maps:merge(Status, More)},
    Robot = #{user => none, host => "a"},
    lists:flatten(starl_cli_fleet_status:line(1, Robot, Answer)).

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
