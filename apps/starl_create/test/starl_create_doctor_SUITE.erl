%% The doctor and the driving by keys, on an emulated Create behind a pty. The quality of the stream
%% depends on the load of this computer and on its user, and is not held against it.
-module(starl_create_doctor_SUITE).
-include_lib("stdlib/include/assert.hrl").
-compile([export_all, nowarn_export_all]).

-define(AFTER_MS, 30000).

all() -> [{group, robots}].

groups() ->
    [
        {robots, [parallel],
            [
                healthy,
                create_1,
                wrong_baud,
                too_late,
                computer,
                asleep,
                silent,
                docked,
                wrong_model,
                odometry,
                no_device
            ] ++
                [
                    firmware,
                    battery,
                    by_hand,
                    by_hand_refused,
                    cable_pulled,
                    pulled_from_the_doctor,
                    standing
                ]}
    ].

init_per_suite(Config) ->
    case starl_create_program:path() of
        {ok, _} -> Config;
        {error, Reason} -> {skip, lists:flatten(starl_create_program:format_error(Reason))}
    end.

end_per_suite(_) -> ok.

%% -- tests ----------------------------------------------------------------------------------

healthy(_) ->
    {Problems, Profile} = examined(#{model => 2}, #{model => 2}),
    ?assertEqual([], Problems),
    ?assertMatch(#{model := 2, baud := 115200}, Profile).

create_1(_) ->
    {Problems, Profile} = examined(#{model => 1}, #{model => 1}),
    ?assertEqual([], Problems),
    ?assertMatch(#{model := 1, baud := 57600}, Profile),
    %% nothing but an answer in time shows short waits: a computer that is busy may miss them
    {_, Other} = examined(#{model => 1, quirks => #{no_short_waits => true}}, #{model => 1}),
    ?assertNot(is_map_key(short_waits, Other)).

wrong_baud(_) ->
    {Problems, Profile} = examined(#{model => 2, baud => 19200}, #{model => 2}),
    ?assertMatch([{baud, _}], Problems),
    says(baud, "the robot speaks 19200 baud, not 115200; switch it off and on", Problems),
    ?assertMatch(#{baud := 19200}, Profile).

%% A frame that comes when nobody waits for it any more does not show the rate, but that there is a robot.
too_late(_) ->
    Self = self(),
    Frame = starl_create_stream:frame([35], #{mode => 1}, with_header),
    Port = spawn_link(fun() -> answers_too_late(Self, Frame) end),
    {none, Noise, Late} = starl_create_search:all(Port, [115200]),
    Text = unicode:characters_to_list(starl_create_search:silent({Noise, Late})),
    contains("too busy to tell", Text).

%% Without real-time priority legs are cut short; a busy computer is said before what it may have missed.
computer(_) ->
    {ok, computer, _} = starl_create_doctor:priority(realtime),
    [
        begin
            {problem, computer, Text} = starl_create_doctor:priority(Priority),
            contains("LimitRTPRIO=1", Text)
        end
     || Priority <- [raised, ordinary]
    ],
    {Findings, _} = all(#{model => 2}, #{model => 2}),
    ?assertMatch({_, computer, _}, lists:keyfind(computer, 2, Findings)),
    Lost = [{ok, baud, "115200 baud"}, {problem, port, "is the cable firm?"}],
    [{problem, computer, Busy} | Lost] = starl_create_doctor:on_computer(Lost, 340),
    contains("its own waits end 340 ms late", Busy),
    ?assertEqual(Lost, starl_create_doctor:on_computer(Lost, 3)),
    Well = [{ok, baud, "115200 baud"}],
    ?assertEqual(Well, starl_create_doctor:on_computer(Well, 340)).

answers_too_late(To, Frame) ->
    receive
        {send, <<148, _/binary>>} -> To ! {data, binary:copy(Frame, 5)}
    end,
    nothing_more().

nothing_more() ->
    receive
        _ -> nothing_more()
    end.

asleep(_) ->
    {Problems, _} = examined(#{model => 2, quirks => #{asleep => true}}, #{model => 2}),
    ?assertMatch([{sleep, _}], Problems),
    says(sleep, "say --wake dtr", Problems).

silent(_) ->
    Quirks = #{asleep => true, no_wake => true},
    {Problems, none} = examined(#{model => 2, quirks => Quirks}, #{model => 2}),
    says(baud, "press its button", Problems).

%% It is not made to drive there.
docked(_) ->
    {Problems, Profile} = examined(#{model => 2, quirks => #{docked => true}}, #{
        model => 2, calibrate => plan()
    }),
    says(dock, "take it off", Problems),
    says(mode, "Safe does not hold", Problems),
    ?assertNot(is_map_key(distance, Profile)).

wrong_model(_) ->
    {Problems, _} = examined(#{model => 1}, #{model => 2}),
    says(model, "this is a Create 1, not a Create 2 (or Roomba 600); say --model 1", Problems).

odometry(Config) ->
    {Problems, Profile} = driven(#{model => 2, quirks => #{odometry => 1.05}}, #{
        model => 2, calibrate => plan()
    }),
    says(distance, "measure its way with a tape", Problems),
    ?assert(maps:get(distance, Profile) < 0.98),
    File = filename:join(proplists:get_value(priv_dir, Config), "create.term"),
    ok = starl_create_calibration:profile(File, Profile),
    ?assertEqual({ok, [Profile]}, file:consult(File)).

no_device(_) ->
    {[{problem, port, Text}], none} = starl_create_doctor:examine("/dev/ttyNOT", #{model => 2}),
    contains("/dev/ttyNOT: no such file or directory; plug the adapter in", Text).

firmware(_) ->
    {Findings, _} = all(#{model => 2}, #{model => 2, firmware => true}),
    ?assertMatch({ok, firmware, <<"stm32-3.2.6">>}, lists:keyfind(firmware, 2, Findings)).

battery(_) ->
    {Problems, _} = examined(#{model => 2, charge_mah => 200}, #{model => 2}),
    says(battery, "7 %, 12.8 V; charge it first", Problems).

%% A key moves it for its time only.
by_hand(_) ->
    {Create, Name} = robot(#{model => 2, tell => self()}),
    Self = self(),
    Driver = spawn_link(fun() -> Self ! {done, starl_create_by_hand:run(Name, hand())} end),
    Driver ! {keys, <<"w">>},
    wheels(Create, {150, 150}),
    wheels(Create, {0, 0}),
    [Driver ! {keys, <<C>>} || C <- "\e[D"],
    wheels(Create, {-75, 75}),
    Driver ! {keys, <<" ">>},
    wheels(Create, {0, 0}),
    Driver ! {keys, <<"q">>},
    receive
        {done, Result} -> ?assertEqual(ok, Result)
    after ?AFTER_MS -> error(late)
    end.

by_hand_refused(_) ->
    {_, Docked} = robot(#{model => 2, quirks => #{docked => true}}),
    {error, Why} = starl_create_by_hand:run(Docked, hand()),
    contains("take it off its dock", Why),
    {_, Slow} = robot(#{model => 2, baud => 57600}),
    {error, Silent} = starl_create_by_hand:run(Slow, hand()),
    contains("does not answer at 115200 baud; ./starl create doctor", Silent).

%% Pulled while it drives: when it is back, it stands.
cable_pulled(_) ->
    Link = filename:join("/tmp", "starl_doctor_" ++ os:getpid()),
    {ok, Create} = starl_create_emulated:start_link(#{model => 2, tell => self()}),
    {ok, Line} = starl_create_on_pty:start_link(Create, Link),
    Self = self(),
    Options = (hand())#{hold_ms := 100000},
    Driver = spawn_link(fun() -> Self ! {done, starl_create_by_hand:run(Link, Options)} end),
    Driver ! {keys, <<"w">>},
    wheels(Create, {150, 150}),
    {ok, Port} = starl_create_port:start_link(self(), #{}),
    ok = starl_create_on_pty:pull(Line),
    receive
        {done, {ended, Why}} -> contains("the cable is pulled", Why)
    after ?AFTER_MS -> error(late)
    end,
    ok = starl_create_on_pty:put_back(Line),
    Port ! {stop_bytes, starl_create_calibration:stop()},
    opened(Port, Link),
    Port ! close,
    wheels(Create, {0, 0}).

%% What was found without a cable is not said of the robot.
pulled_from_the_doctor(_) ->
    {ok, Create} = starl_create_emulated:start_link(#{model => 2, tell => self()}),
    {ok, Line} = starl_create_on_pty:start_link(Create, none),
    Name = starl_create_on_pty:name(Line),
    Self = self(),
    Examine = fun() -> Self ! {found, starl_create_doctor:examine(Name, #{model => 2})} end,
    _ = spawn_link(Examine),
    %% it sets the mode at last
    receive
        {starl_create, Create, {mode, safe}} -> ok = starl_create_on_pty:pull(Line)
    end,
    receive
        {found, {Findings, none}} ->
            Problems = starl_create_doctor:problems(Findings),
            [{problem, port, Text}] = lists:keydelete(computer, 2, Problems),
            contains("the line was lost meanwhile", Text)
    end.

%% What stops by itself, what stops when told, and what does not; when, is for the table of the bench.
standing(_) ->
    {ok, drives_on} = starl_create_stop_times:measure(pulled, create_2),
    {ok, stood_before} = starl_create_stop_times:measure(put_back, create_1_short),
    [
        ?assertMatch({ok, Us} when is_integer(Us), starl_create_stop_times:measure(Row, Robot))
     || {Row, Robot} <- [
            {put_back, create_2},
            {pulled, create_1},
            {pulled, create_1_short},
            {guardian, create_2},
            {owner, create_1_short}
        ]
    ].

opened(Port, Link) ->
    Port ! {open, Link, 115200},
    receive
        {opened, Link} -> ok;
        {error, {no_device, _}} -> opened(Port, Link)
    after ?AFTER_MS -> error(late)
    end.

%% -- a robot --------------------------------------------------------------------------------

robot(Options) ->
    {ok, Create} = starl_create_emulated:start_link(Options),
    {ok, Line} = starl_create_on_pty:start_link(Create, none),
    {Create, starl_create_on_pty:name(Line)}.

hand() -> #{model => 2, baud => 115200, speed => 150, hold_ms => 200}.

plan() -> #{drive_mm => 400, drive_mm_s => 100, turn_deg => 90, turn_mm_s => 100}.

all(Robot, Options) ->
    {_, Name} = robot(Robot),
    {Findings, Profile} = starl_create_doctor:examine(Name, Options),
    ct:pal("~ts", [[[starl_create_doctor:line(Finding), "\n"] || Finding <- Findings]]),
    {Findings, Profile}.

examined(Robot, Options) -> problems(all(Robot, Options)).

problems({Findings, Profile}) ->
    Problems = starl_create_doctor:problems(Findings),
    {[{Key, Text} || {problem, Key, Text} <- Problems, Key =/= stream, Key =/= computer], Profile}.

%% A drive that a busy computer has cut short is tried again, as the doctor says.
driven(Robot, Options) ->
    {Problems, _} = Examined = examined(Robot, Options),
    case lists:keyfind(distance, 1, Problems) of
        {distance, "the drive was interrupted" ++ _} -> driven(Robot, Options);
        _ -> Examined
    end.

says(Key, Part, Problems) ->
    {Key, Text} = lists:keyfind(Key, 1, Problems),
    contains(Part, Text).

contains(Part, Text) ->
    Flat = unicode:characters_to_list(Text),
    ?assertNotEqual({Part, nomatch, Flat}, {Part, string:find(Flat, Part), Flat}).

wheels(Create, Wanted) ->
    receive
        {starl_create, Create, {wheels, {L, R}}} when {L, R} == Wanted -> ok
    after ?AFTER_MS -> error({late, Wanted, process_info(self(), messages)})
    end.
