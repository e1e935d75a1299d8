%% @doc Examines the robot behind a device and says how to fix what is wrong. It reports the line,
%% baud rate, model, firmware, mode, battery and the quality of the stream.
%%
%% The examination changes only the mode of the robot. It drives only for a calibration
%% ({@link starl_create_calibration}).
-module(starl_create_doctor).

-export([examine/2, line/1, problems/1, on_computer/2, priority/1]).

-export_type([options/0, finding/0, key/0]).

%% What is expected. `firmware': a Create 2 is started anew, which tells it.
-type options() :: #{
    model := starl_create_packet:model(),
    baud => pos_integer() | none,
    firmware => boolean(),
    calibrate => none | starl_create_calibration:plan()
}.

-type key() ::
    computer
    | port
    | baud
    | model
    | waits
    | sleep
    | firmware
    | mode
    | dock
    | battery
    | stream
    | distance
    | angle.

%% `problem' comes with what to do.
-type finding() :: {ok | problem, key(), unicode:chardata()}.

-record(exam, {
    probe :: starl_create_probe:t(),
    device :: string(),
    options :: options(),
    model :: starl_create_packet:model(),
    baud :: pos_integer(),
    %% how late its answers may be
    late_ms = 0 :: non_neg_integer(),
    waits = long :: starl_create_script:waits(),
    found = [] :: [finding()]
}).

-define(SENSORS, [35, 34, 21, 22, 23, 24, 25, 26, 7]).
-define(LISTEN_MS, 250).
%% An answer is waited for; only silence takes so long.
-define(PATIENT_MS, 1500).
-define(MORE_MS, 60).
-define(LOST, "the line was lost meanwhile: is the cable firm? Try again").
-define(NO_MODEL,
    "it answered, and now does not: try again, with less other work for this computer"
).
-define(QUALITY_MS, 1000).
%% The lateness of its own waits by which a computer is busy.
-define(BUSY_MS, 30).
-define(LOW, 20).
-define(BANNER_MS, 6000).

%% @doc Examines; gives what it has found, in order, and the profile of the robot if it answers.
-spec examine(Device :: string(), options()) -> {[finding()], map() | none}.
examine(Device, #{model := Model} = Options) ->
    Baud =
        case maps:get(baud, Options, none) of
            none -> usual_baud(Model);
            Given -> Given
        end,
    case starl_create_probe:open(Device, Baud, starl_create_calibration:stop()) of
        {ok, Probe} ->
            Exam = #exam{
                probe = Probe, device = Device, options = Options, model = Model, baud = Baud
            },
            Opened = found({ok, port, [Device, ", opened and locked"]}, Exam),
            Alone = found(priority(starl_create_probe:priority(Probe)), Opened),
            {Findings, Profile} = line_found(Alone, Baud),
            ok = starl_create_probe:close(Probe),
            {on_computer(Findings, starl_create_probe:lateness_ms()), Profile};
        {error, {_Reason, Text}} ->
            {[{problem, port, Text}], none}
    end.

%% @doc May the port program be on time?
-spec priority(starl_create_port:priority()) -> finding().
priority(realtime) ->
    {ok, computer, "the port program has real-time priority"};
priority(_) ->
    {problem, computer, starl_create_advice:line(ordinary_priority)}.

%% @doc Findings by a computer whose own waits end so late: that it is busy comes before what it may have
%% missed.
-spec on_computer([finding()], LateMs :: non_neg_integer()) -> [finding()].
on_computer(Findings, LateMs) when LateMs >= ?BUSY_MS ->
    case [Key || {problem, Key, _} <- Findings, Key =/= computer] of
        [] -> Findings;
        _ -> [{problem, computer, busy(LateMs)} | Findings]
    end;
on_computer(Findings, _LateMs) ->
    Findings.

busy(LateMs) ->
    io_lib:format(
        "it is too busy: its own waits end ~b ms late; what is found below may come from that: give it "
        "less other work, and try again",
        [LateMs]
    ).

%% @doc A finding as a line.
-spec line(finding()) -> unicode:chardata().
line({Kind, Key, Text}) -> io_lib:format("~-9s ~-8s ~ts", [Key, shown(Kind), Text]).

shown(ok) -> "ok";
shown(problem) -> "PROBLEM".

%% @doc Those that are problems.
-spec problems([finding()]) -> [finding()].
problems(Findings) -> [Finding || {problem, _, _} = Finding <- Findings].

found(Finding, #exam{found = Found} = Exam) -> Exam#exam{found = [Finding | Found]}.

done(#exam{found = Found}, Profile) -> {lists:reverse(Found), Profile}.

usual_baud(1) -> 57600;
usual_baud(2) -> 115200.

%% -- the line ---------------------------------------------------------------------------------

%% At the baud rate that is expected; at any other; after a pulse on BRC.
line_found(Exam, Baud) ->
    case starl_create_search:all(Exam#exam.probe, starl_create_search:bauds(Baud)) of
        {found, Baud, Late} ->
            answers(found({ok, baud, said_baud(Baud)}, Exam#exam{late_ms = Late}));
        {found, Other, Late} ->
            answers(other_baud(Other, Exam#exam{late_ms = Late}));
        {none, Noise, Late} ->
            woken([dtr, rts], Baud, {Noise, Late}, Exam)
    end.

said_baud(Baud) -> [integer_to_list(Baud), " baud"].

other_baud(Other, #exam{baud = Baud} = Exam) ->
    [Is, Was] = [integer_to_list(B) || B <- [Other, Baud]],
    Text =
        case Other of
            19200 -> "; switch it off and on for its usual rate, or say --baud 19200";
            _ -> ["; say --baud ", Is, " (and --model, if it is another model than you think)"]
        end,
    found({problem, baud, ["the robot speaks ", Is, " baud, not ", Was, Text]}, Exam#exam{
        baud = Other
    }).

woken([], _Baud, Heard, Exam) ->
    Silent = fun(E) -> found({problem, baud, starl_create_search:silent(Heard)}, E) end,
    {_, Found} = looked([Silent], Exam),
    done(Found, none);
woken([Line | Lines], Baud, Heard, #exam{probe = Probe, model = Model} = Exam) ->
    ok = starl_create_probe:speed(Probe, Baud),
    ok = starl_create_probe:pulse(Probe, Line),
    case starl_create_search:awake(Probe, lists:usort([Baud, usual_baud(Model)])) of
        {found, Is, Late} -> answers(slept(Line, Exam#exam{baud = Is, late_ms = Late}));
        none -> woken(Lines, Baud, Heard, Exam)
    end.

slept(Line, #exam{baud = Baud} = Exam) ->
    Text = [
        "it slept; a pulse of ",
        string:uppercase(atom_to_list(Line)),
        " on BRC woke it: say --wake ",
        atom_to_list(Line),
        ", so that it is woken and kept awake (a Create 2 sleeps after 5 min without a command)"
    ],
    found({ok, baud, said_baud(Baud)}, found({problem, sleep, Text}, Exam)).

%% -- the robot --------------------------------------------------------------------------------

answers(Exam) ->
    Looks = [fun model/1, fun waits/1, fun quality/1, fun firmware/1, fun sensed/1, fun control/1],
    case looked(Looks, Exam) of
        {lost, Lost} -> done(Lost, none);
        {ok, Looked} -> calibrated(Looked, profile(Looked))
    end.

%% What was found while the cable was pulled says nothing of the robot.
looked([], Exam) ->
    {ok, Exam};
looked([Look | Looks], #exam{probe = Probe} = Exam) ->
    Looked = Look(Exam),
    case starl_create_probe:is_lost(Probe) of
        true -> {lost, found({problem, port, ?LOST}, Exam)};
        false -> looked(Looks, Looked)
    end.

%% Only a Create 2 has encoders; both tell their mode.
model(#exam{probe = Probe, options = #{model := Expected}} = Exam) ->
    ok = starl_create_probe:quiet(Probe, late(Exam)),
    Said = starl_create_probe:said(Probe, <<142, 43, 142, 35>>, ?PATIENT_MS + late(Exam)),
    %% what an unknown packet has left behind
    ok = starl_create_probe:send(Probe, binary:copy(<<128>>, 8)),
    case byte_size(Said) of
        0 ->
            found({problem, model, ?NO_MODEL}, Exam);
        Size ->
            Model = 1 + min(1, Size div 3),
            found(said_model(Model, Expected), Exam#exam{model = Model})
    end.

%% Answers may be as late as the first was, and more.
late(#exam{late_ms = Late}) -> 2 * Late.

ask(Question, Size, #exam{probe = Probe} = Exam) ->
    ok = starl_create_probe:quiet(Probe, late(Exam)),
    starl_create_probe:ask(Probe, Question, Size, ?PATIENT_MS + late(Exam)).

said_model(Model, Model) ->
    {ok, model, name(Model)};
said_model(Model, Expected) ->
    {problem, model, [
        "this is a ",
        name(Model),
        ", not a ",
        name(Expected),
        "; say --model ",
        integer_to_list(Model)
    ]}.

name(1) -> "Create 1";
name(2) -> "Create 2 (or Roomba 600)".

waits(#exam{model = 1, probe = Probe} = Exam) ->
    Waits = starl_create_waits:measure(Probe),
    found({ok, waits, starl_create_waits:line(Waits)}, Exam#exam{waits = Waits});
waits(Exam) ->
    Exam.

quality(#exam{probe = Probe, model = Model} = Exam) ->
    ok = starl_create_probe:send(Probe, [148, length(?SENSORS), ?SENSORS]),
    _ = starl_create_probe:stream(Probe, ?SENSORS, Model, ?MORE_MS + late(Exam)),
    #{frames := Frames, noise := Noise} = starl_create_probe:stream(
        Probe, ?SENSORS, Model, ?QUALITY_MS
    ),
    ok = starl_create_probe:send(Probe, <<150, 0>>),
    found(said_quality(length(Frames), Noise, longest(Frames)), Exam).

longest(Frames) ->
    Times = [At || {At, _} <- Frames],
    Gaps = [B - A || {A, B} <- lists:zip(lists:droplast(["" | Times]), Times), A =/= ""],
    lists:max([0 | Gaps]) div 1000.

said_quality(Frames, Noise, GapMs) ->
    Text = io_lib:format("~b frames a second of 66, ~b bytes of noise, longest gap ~b ms", [
        Frames, Noise, GapMs
    ]),
    case Frames >= 50 andalso Noise < 100 of
        true -> {ok, stream, Text};
        false -> {problem, stream, [Text, "; a shorter cable, common ground, another adapter"]}
    end.

firmware(#exam{model = 2, probe = Probe, options = #{firmware := true}} = Exam) ->
    found({ok, firmware, release(Probe)}, Exam);
firmware(Exam) ->
    Exam.

sensed(#exam{probe = Probe, model = Model} = Exam) ->
    ok = starl_create_probe:send(Probe, [128, 148, length(?SENSORS), ?SENSORS]),
    #{frames := Frames} = starl_create_probe:stream(
        Probe, ?SENSORS, Model, ?LISTEN_MS + late(Exam)
    ),
    ok = starl_create_probe:send(Probe, <<150, 0>>),
    case Frames of
        [] -> Exam;
        _ -> battery(element(2, lists:last(Frames)), docked(element(2, lists:last(Frames)), Exam))
    end.

docked(#{charging_sources := 0}, Exam) ->
    found({ok, dock, "it stands on no charger"}, Exam);
docked(_Readings, Exam) ->
    Text =
        "it stands on its dock or its charger is plugged in, where it does not drive: take it off",
    found({problem, dock, Text}, Exam).

battery(#{voltage := Mv, charge := Charge, capacity := Capacity}, Exam) ->
    Percent = 100 * Charge div max(1, Capacity),
    Text = io_lib:format("~b %, ~.1f V", [Percent, Mv / 1000]),
    case Percent < ?LOW of
        true -> found({problem, battery, [Text, "; charge it first"]}, Exam);
        false -> found({ok, battery, Text}, Exam)
    end.

%% It takes commands to its wheels in this mode only.
control(#exam{probe = Probe} = Exam) ->
    ok = starl_create_probe:send(Probe, <<131>>),
    _ = starl_create_probe:listen(Probe, 60),
    found(said_mode(ask(<<142, 35>>, 1, Exam)), Exam).

profile(#exam{device = Device, baud = Baud, model = Model, waits = Waits}) ->
    Short = maps:from_list([{short_waits, true} || Waits =:= short]),
    Short#{device => Device, model => Model, baud => Baud}.

said_mode({ok, <<2>>}) ->
    {ok, mode, "Safe, it obeys"};
said_mode({ok, <<3>>}) ->
    {ok, mode, "reported one higher than it is, it obeys (some Create 2)"};
said_mode({ok, <<Mode>>}) ->
    {problem, mode, [
        "Safe does not hold, the mode is ",
        integer_to_list(Mode),
        ": is it lifted, at an edge, or charging? Put it on the floor, away from dock and charger"
    ]};
said_mode(none) ->
    {problem, mode, "it does not tell its mode; switch it off and on"}.

calibrated(
    #exam{options = #{calibrate := #{} = Plan}, probe = Probe, model = Model} = Exam, Profile
) ->
    case [Key || {problem, Key, _} <- Exam#exam.found, Key =:= dock orelse Key =:= mode] of
        [] ->
            {Findings, Measured} = starl_create_calibration:run(Probe, Model, Plan),
            done(lists:foldl(fun found/2, Exam, Findings), maps:merge(Profile, Measured));
        _ ->
            done(Exam, Profile)
    end;
calibrated(Exam, Profile) ->
    done(Exam, Profile).

%% A Create 2 that is started anew prints its release among the first bytes.
release(Probe) ->
    _ = starl_create_probe:listen(Probe, 30),
    ok = starl_create_probe:send(Probe, <<7>>),
    Banner = banner(Probe, <<>>, ?BANNER_MS div 100),
    ok = starl_create_probe:send(Probe, <<128>>),
    release_of(Banner).

banner(_Probe, Bytes, 0) ->
    Bytes;
banner(Probe, Bytes, N) ->
    Now = <<Bytes/binary, (starl_create_probe:listen(Probe, 100))/binary>>,
    case re:run(Now, "release-[^\r\n]*\r?\n", [{capture, none}]) of
        match -> Now;
        nomatch -> banner(Probe, Now, N - 1)
    end.

release_of(Banner) ->
    case re:run(Banner, "release-([-.a-z0-9]*)", [{capture, all_but_first, binary}]) of
        {match, [Release]} when is_binary(Release) -> Release;
        nomatch -> "it does not tell its release after a reset"
    end.
