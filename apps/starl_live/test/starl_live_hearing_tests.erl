%% What a robot says of the others in its ears, in words.
-module(starl_live_hearing_tests).
-include_lib("eunit/include/eunit.hrl").

%% Handles the reports of news.
-export([log/2]).

-define(AT, {{10, 0, 0, 2}, 5001}).

peer() ->
    #{
        robot => 2,
        is_silent => false,
        heard_ms => 0,
        address => ?AT,
        life => 7,
        refused => #{},
        why => none
    }.

complaint(Given) ->
    case starl_live_hearing:complaint(maps:merge(peer(), Given)) of
        none -> none;
        Line -> lists:flatten(Line)
    end.

%% Each reason has words of its own; one that has none is that of a malformed packet.
reasons_have_words_test_() ->
    [
        ?_assertEqual("has not heard robot 2" ++ Words, complaint(#{heard_ms => never, why => Why}))
     || {Why, Words} <- [
            {none, ""},
            {{clock, 0}, ": its clock is 0.0 s ahead of ours"},
            {{clock, 1500}, ": its clock is 1.5 s ahead of ours"},
            {{clock, -1500}, ": its clock is 1.5 s behind ours"},
            {{unsent, enetunreach}, ": nothing can be sent to it: network is unreachable"},
            {{unnamed, nxdomain}, ": its name is not found: non-existing domain"},
            {seal, ": its datagrams are sealed with another key"},
            {fleet, ": its datagrams are another fleet's"},
            {run, ": its datagrams are of another run; does it run the same release?"},
            {version, ": its datagrams have another format; does it run another StarL?"},
            {stranger, ": it is no robot of the team"},
            {length, ": its datagrams have a wrong length"},
            {not_connected, ": its node is not connected"},
            {clone, ": another robot of its number is heard"},
            {fragment, ": its packets are malformed (fragment)"}
        ]
    ].

complaints_test_() ->
    Silent = #{is_silent => true, heard_ms => 61_999},
    [
        ?_assertEqual(none, complaint(#{})),
        ?_assertEqual(none, complaint(#{why => seal})),
        ?_assertEqual("has not heard robot 2 for 61 s", complaint(Silent)),
        ?_assertEqual(
            "has not heard robot 2 for 61 s: its datagrams are another fleet's",
            complaint(Silent#{why => fleet})
        ),
        ?_assertEqual(
            "hears two robots that speak as robot 2: 10.0.0.2 port 5001 (life 7) is taken, "
            "an unknown address (life ff) is refused",
            complaint(#{twin => {255, none}})
        )
    ].

%% What is well again, or elsewhere, is a notice; what is wrong is a warning.
news_test_() ->
    News = [
        {warning, {silent, 2, (peer())#{heard_ms => never}}, "the robot has not heard robot 2"},
        {notice, {back, 2, never}, "robot 2 is heard"},
        {notice, {back, 2, 1500}, "robot 2 is heard again, after 1.5 s"},
        {warning, {refused, 2, fleet},
            "datagrams of robot 2 are refused: its datagrams are another fleet's"},
        {warning, {refused, ?AT, stranger},
            "datagrams from 10.0.0.2 port 5001 are refused: it is no robot of the team"},
        {notice, {moved, 2, ?AT}, "robot 2 is at 10.0.0.2 port 5001 now"},
        {warning, {twice, 2, {7, ?AT}, {8, none}},
            "the robot hears two robots that speak as robot 2: 10.0.0.2 port 5001 (life 7) is taken, "
            "an unknown address (life 8) is refused"},
        {notice, {once, 2}, "one robot speaks as robot 2 again"},
        {warning, {unnamed, 2, "robot-2", nxdomain},
            "robot 2: the name \"robot-2\" is not found: non-existing domain; it is looked up again"}
    ],
    [
        ?_assertEqual(Words, lists:flatten(starl_live_hearing:format_news(One)))
     || {_, One, Words} <- News
    ] ++
        [
            ?_assertEqual(
                [{L, element(1, One), list_to_binary(W)} || {L, One, W} <- News], logged(News)
            )
        ].

logged(News) ->
    #{level := Level} = logger:get_primary_config(),
    ok = logger:set_primary_config(level, notice),
    ok = logger:add_handler(?MODULE, ?MODULE, #{config => #{test => self()}}),
    ok = starl_live_hearing:log([One || {_, One, _} <- News]),
    ok = logger:remove_handler(?MODULE),
    ok = logger:set_primary_config(level, Level),
    lines().

lines() ->
    receive
        {logged, Line} -> [Line | lines()]
    after 0 -> []
    end.

log(#{level := Level, msg := {report, #{what := What, why := Why}}}, #{config := #{test := Test}}) ->
    Test ! {logged, {Level, What, Why}};
log(_Event, _Handler) ->
    ok.

%% Modules of tests share a process: those after this one find nothing of it.
nothing_is_left_test() -> starl_platform_ct:forget().
