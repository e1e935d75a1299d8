%% Keys, and the judgement of a calibration.
-module(starl_create_hand_tests).
-include_lib("eunit/include/eunit.hrl").

key(Keys) ->
    starl_create_by_hand:key(Keys, #{model => 2, baud => 1, speed => 101, hold_ms => 1}).

keys_test_() ->
    [
        ?_assertEqual({Keys, Act}, {Keys, key(Keys)})
     || {Keys, Act} <- [
            {<<"w">>, {go, 101, 101}},
            {<<"\e[A">>, {go, 101, 101}},
            {<<"s">>, {go, -101, -101}},
            {<<"\e[B">>, {go, -101, -101}},
            {<<"a">>, {go, 50, -50}},
            {<<"\e[D">>, {go, 50, -50}},
            {<<"d">>, {go, -50, 50}},
            {<<"ww\e[C">>, {go, -50, 50}},
            {<<"\e">>, none},
            {<<"\e[">>, none},
            {<<"A">>, stop},
            {<<"w ">>, stop},
            {<<"+">>, {speed, 151}},
            {<<"-">>, {speed, 51}},
            {<<"wq">>, quit}
        ]
    ].

judged(Odometry) -> element(1, starl_create_calibration:judge(distance, 1000, Odometry)).

judge_test() ->
    ?assertEqual(ok, judged(1000.0)),
    ?assertEqual(ok, judged(1019.0)),
    ?assertEqual(ok, judged(981.0)),
    ?assertEqual(problem, judged(1050.0)),
    ?assertEqual(problem, judged(950.0)),
    ?assertEqual(problem, judged(0)).

%% The stop bytes stop the wheels whatever half command came before.
stop_after_half_a_command_test() ->
    [
        begin
            Half = binary:part(<<145, 100:16, 100:16>>, 0, N),
            ?assertEqual(
                {0, 0}, last_speeds(<<Half/binary, (starl_create_calibration:stop())/binary>>)
            )
        end
     || N <- lists:seq(0, 4)
    ].

last_speeds(Bytes) -> last_speeds(Bytes, none).

last_speeds(Bytes, Last) ->
    case starl_create_command:decode(Bytes, 2) of
        {ok, {drive_direct, Right, Left}, Rest} -> last_speeds(Rest, {Right, Left});
        {ok, _, Rest} -> last_speeds(Rest, Last);
        {invalid, _, Rest} -> last_speeds(Rest, Last);
        {unknown, _, Rest} -> last_speeds(Rest, Last);
        more -> Last
    end.

%% Twenty waits of a Create 1 take 300 ms or nothing; what lies between is a busy computer.
waits_are_judged_by_the_time_of_an_answer_test() ->
    Quiet = starl_create_probe:quiet_ms(),
    [
        ?assertEqual({Ms, Waits}, {Ms, starl_create_waits:judge(20, Quiet + Ms)})
     || {Ms, Waits} <- [
            {0, long}, {100, long}, {200, unclear}, {286, short}, {380, short}, {400, unclear}
        ]
    ],
    ?assertEqual(unclear, starl_create_waits:judge(20, none)).

%% A robot that does not wait, asked by a computer that hears every answer late, must not be taken for one that does.
late_answers_show_no_short_waits_test() ->
    Quiet = starl_create_probe:quiet_ms(),
    [
        ?assertEqual({Late, long}, {Late, starl_create_waits:found(fun(_) -> Quiet + Late end)})
     || Late <- lists:seq(0, 890, 5)
    ],
    [
        ?assertEqual(
            {Late, short}, {Late, starl_create_waits:found(fun(N) -> Quiet + 15 * N + Late end)}
        )
     || Late <- lists:seq(0, 85, 5)
    ].
