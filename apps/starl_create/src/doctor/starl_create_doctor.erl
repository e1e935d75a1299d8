%% @doc Finds out the state of the robot behind a device: its line, baud rate, model, firmware, mode,
%% battery and the quality of its stream; and what to do about what is not as it should be.
%%
%% It moves nothing but the mode, unless it is to calibrate ({@link starl_create_calibration}).
-module(starl_create_doctor).

-export([examine/2, line/1, problems/1]).

-export_type([options/0, finding/0, key/0]).

%% What is expected. `firmware': a Create 2 is started anew, which tells it.
-type options() :: #{
    model := starl_create_packet:model(),
    baud => pos_integer() | none,
    firmware => boolean(),
    calibrate => none | starl_create_calibration:plan()
}.

-type key() ::
    port
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
    waits = long :: starl_create_script:waits(),
    found = [] :: [finding()]
}).

-define(OTHER_BAUDS, [115200, 57600, 19200, 38400, 9600, 28800, 14400, 4800, 2400]).
-define(SENSORS, [35, 34, 21, 22, 23, 24, 25, 26, 7]).
%% A frame each 15 ms.
-define(LISTEN_MS, 250).
-define(QUALITY_MS, 1000).
%% A robot that was woken starts for this time.
-define(WAKE_MS, 2500).
-define(LOW, 20).

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
            Found = line_found(found({ok, port, [Device, ", opened and locked"]}, Exam), Baud),
            ok = starl_create_probe:close(Probe),
            Found;
        {error, {_Reason, Text}} ->
            {[{problem, port, Text}], none}
    end.

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
    case at([Baud | ?OTHER_BAUDS -- [Baud]], Exam, 0) of
        {found, Baud} -> answers(found({ok, baud, said_baud(Baud)}, Exam));
        {found, Other} -> answers(other_baud(Other, Exam));
        {none, Noise} -> woken([dtr, rts], Baud, Noise, Exam)
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

at([], _Exam, Noise) ->
    {none, Noise};
at([Baud | Bauds], #exam{probe = Probe} = Exam, Noise) ->
    ok = starl_create_probe:speed(Probe, Baud),
    #{frames := Frames, noise := New, bytes := Bytes} = mode_stream(Probe),
    case Frames of
        [_ | _] -> {found, Baud};
        [] -> at(Bauds, Exam, Noise + max(New, Bytes))
    end.

%% Start completes and flushes half a command; a frame with a checksum is no accident.
mode_stream(Probe) ->
    ok = starl_create_probe:send(Probe, binary:copy(<<128>>, 8)),
    _ = starl_create_probe:listen(Probe, 40),
    ok = starl_create_probe:send(Probe, <<148, 1, 35>>),
    Heard = starl_create_probe:stream(Probe, [35], 1, ?LISTEN_MS),
    ok = starl_create_probe:send(Probe, <<150, 0>>),
    Heard.

woken([], _Baud, Noise, Exam) ->
    done(found({problem, baud, silent(Noise)}, Exam), none);
woken([Line | Lines], Baud, Noise, #exam{probe = Probe, model = Model} = Exam) ->
    ok = starl_create_probe:speed(Probe, Baud),
    ok = starl_create_probe:pulse(Probe, Line),
    case awake(Exam, lists:usort([Baud, usual_baud(Model)]), ?WAKE_MS div ?LISTEN_MS) of
        {found, Is} -> answers(slept(Line, Exam#exam{baud = Is}));
        none -> woken(Lines, Baud, Noise, Exam)
    end.

awake(_Exam, _Bauds, 0) ->
    none;
awake(Exam, Bauds, N) ->
    case at(Bauds, Exam, 0) of
        {found, _} = Found -> Found;
        {none, _} -> awake(Exam, Bauds, max(0, N - length(Bauds)))
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

silent(0) ->
    "it says nothing at any baud rate, nor after pulses of DTR and RTS: press its button (Clean, Power); "
    "check TXD, RXD, GND, and that BRC is wired; if it stays silent, take its battery out and put it back";
silent(_) ->
    "it says what makes sense at no baud rate: check GND and the level (TTL, 5 V, not RS-232); switch it off "
    "and on, which brings its usual rate back".

%% -- the robot --------------------------------------------------------------------------------

answers(Exam) -> control(sensed(firmware(quality(waits(model(Exam)))))).

%% Only a Create 2 has encoders.
model(#exam{probe = Probe, options = #{model := Expected}} = Exam) ->
    Model =
        case starl_create_probe:ask(Probe, <<142, 43>>, 2, 300) of
            {ok, _} -> 2;
            none -> 1
        end,
    %% what an unknown packet has left behind
    ok = starl_create_probe:send(Probe, binary:copy(<<128>>, 8)),
    found(said_model(Model, Expected), Exam#exam{model = Model}).

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
    _ = starl_create_probe:stream(Probe, ?SENSORS, Model, 60),
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
    found({ok, firmware, starl_create_release:read(Probe)}, Exam);
firmware(Exam) ->
    Exam.

sensed(#exam{probe = Probe, model = Model} = Exam) ->
    ok = starl_create_probe:send(Probe, [128, 148, length(?SENSORS), ?SENSORS]),
    #{frames := Frames} = starl_create_probe:stream(Probe, ?SENSORS, Model, ?LISTEN_MS),
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
    Ready = found(said_mode(starl_create_probe:ask(Probe, <<142, 35>>, 1, 300)), Exam),
    calibrated(Ready, profile(Exam)).

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
