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

judged(Odometry) -> judged(Odometry, 0).

judged(Odometry, Late) -> element(1, judge(Odometry, Late)).

%% 1000 mm at 200 mm/s.
judge(Odometry, Late) ->
    Drive = #{odometry => Odometry, driven => 1000 + 0.2 * Late / 1000, late_us => Late},
    starl_create_calibration:judge(distance, 1000, Drive).

%% Holds: A busy computer is no worn wheel and no loose cable to the doctor's calibration; a robot
%% that does not move is told
%% Red: d7c73771, run: `badarith`, and *look for a worn or slipping wheel*
judge_test() ->
    ?assertEqual(ok, judged(1000.0)),
    ?assertEqual(ok, judged(1019.0)),
    ?assertEqual(ok, judged(981.0)),
    ?assertEqual(problem, judged(1050.0)),
    ?assertEqual(problem, judged(950.0)),
    ?assertEqual(problem, judged(0)),
    %% no wheel is worn where a busy computer has driven farther
    ?assertEqual(ok, judged(1050.0, 250000)),
    {ok, distance, Text} = judge(1050.0, 250000),
    ?assertEqual(
        <<"1000 mm commanded (this computer was 250 ms late, so 1050.0 driven), 1050.0 by its odometry: +0.0 %">>,
        iolist_to_binary(Text)
    ),
    ?assertEqual(problem, judged(1000.0, 250000)),
    {ok, distance, Even} = judge(999.9, 0),
    ?assertEqual(
        <<"1000 mm commanded, 999.9 by its odometry: +0.0 %">>, iolist_to_binary(Even)
    ).

%% Whatever follows it.
a_mistyped_action_is_told_test() ->
    #{subject := Subject, run := Run} = starl_create_console:command(),
    {ok, Action, []} = Subject("dctor", ["/dev/ttyUSB0"]),
    ?assertMatch({error, [_]}, Run(#{subject => Action})).

%% Its wheels are blocked, or nobody answers: there is nothing to reckon with.
a_robot_that_does_not_move_has_no_factors_test() ->
    Port = spawn_link(fun standing/0),
    Port ! {to, self()},
    Plan = #{drive_mm => 1000, drive_mm_s => 500, turn_deg => 0, turn_mm_s => 100},
    ?assertMatch(
        {[{problem, distance, _}], Factors} when Factors =:= #{},
        starl_create_calibration:run(Port, 1, Plan)
    ).

standing() ->
    receive
        {to, Asker} -> standing(Asker)
    end.

standing(Asker) ->
    receive
        {send, <<142, _>>} ->
            Asker ! {data, <<0:16>>};
        {drive_script, Mark, [{_, Us}], _} ->
            Asker ! {sent, Mark, 0},
            Asker ! {ended, Mark, Us}
    end,
    standing(Asker).

%% How much too long a drive was is told; and whether the line or the computer has ended it.
a_drive_tells_what_held_it_up_test() ->
    Drive = fun(Answer) ->
        Self = self(),
        Port = spawn_link(fun() ->
            receive
                {drive_script, Mark, [{<<"go">>, 5000000}], <<"stop">>} ->
                    [Self ! Word || Word <- Answer(Mark)]
            end
        end),
        starl_create_probe:drive(Port, <<"go">>, 5000000, <<"stop">>)
    end,
    ?assertEqual({ok, 0}, Drive(fun(M) -> [{sent, M, 100}, {ended, M, 5000100}] end)),
    ?assertEqual({ok, 250000}, Drive(fun(M) -> [{sent, M, 100}, {ended, M, 5250100}] end)),
    ?assertEqual(
        {interrupted, line}, Drive(fun(M) -> [{sent, M, 100}, {closed, unplugged}] end)
    ),
    ?assertEqual(
        {interrupted, computer}, Drive(fun(M) -> [{sent, M, 1}, {stopped, heartbeat, 9}] end)
    ),
    ?assertEqual({interrupted, computer}, Drive(fun(_) -> [{closed, {program, 137}}] end)).

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
