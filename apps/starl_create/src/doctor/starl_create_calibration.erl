%% @doc Calibrates a Create. The robot drives straight and turns on the spot; its odometry is
%% compared with the command, or with a person's measurement.
%%
%% A difference above the tolerance is measured again, and the smaller difference counts. A busy
%% computer drives for longer than it should. The port program reports by how much, and the longer
%% distance counts as the commanded one.
-module(starl_create_calibration).

-export([run/3, stop/0, judge/3, profile/2]).

-export_type([plan/0, drive/0]).

%% Lengths and speeds. `measured_mm', `measured_deg': what a person has measured.
-type plan() :: #{
    drive_mm := pos_integer(),
    drive_mm_s := pos_integer(),
    turn_deg := non_neg_integer(),
    turn_mm_s := pos_integer(),
    measured_mm => number() | none,
    measured_deg => number() | none
}.

%% A drive that is over: the length that it had by its time, which is longer than commanded if the computer
%% was late, and what the robot's odometry says of it; mm or degrees.
-type drive() :: #{
    driven := number(), late_us := non_neg_integer(), odometry := number()
}.

-define(TOLERANCE, 0.02).
%% The lateness that is not worth a word.
-define(FINE_US, 5000).
-define(SETTLE_MS, 300).

%% @doc Stops the wheels, also if the robot waits for the rest of half a command.
-spec stop() -> binary().
stop() -> <<145, 0:32, 145, 0:32>>.

%% @doc Drives and turns; gives what was found, and the factors of the profile: true length by odometry
%% (`distance', `angle') and, as a tape has shown, by what was commanded (`drive', `turn').
-spec run(starl_create_probe:t(), starl_create_packet:model(), plan()) ->
    {[starl_create_doctor:finding()], map()}.
run(Probe, Model, #{drive_mm := Mm, turn_deg := Degrees} = Plan) ->
    Straight = [{distance, Mm} || Mm > 0],
    Turn = [{angle, Degrees} || Degrees > 0],
    Results = [result(What, Length, Probe, Model, Plan) || {What, Length} <- Straight ++ Turn],
    {
        [Finding || {Finding, _} <- Results],
        maps:from_list(lists:append([Factors || {_, Factors} <- Results]))
    }.

result(What, Length, Probe, Model, Plan) ->
    case measure(What, Length, Probe, Model, Plan) of
        {interrupted, Why} ->
            {{problem, What, "the drive was interrupted" ++ cause(Why)}, []};
        First ->
            Best = again(judge(What, Length, First), What, Length, Probe, Model, Plan, First),
            {judge(What, Length, Best), factors(What, Best, Plan)}
    end.

cause(line) ->
    "; is the cable firm? Try again";
cause(computer) ->
    ": this computer, or its port program, stood still; give it less other work and try again".

again({ok, _, _}, _What, _Length, _Probe, _Model, _Plan, First) ->
    First;
again({problem, _, _}, What, Length, Probe, Model, Plan, First) ->
    case measure(What, Length, Probe, Model, Plan) of
        {interrupted, _} -> First;
        Second -> nearer(First, Second)
    end.

nearer(A, B) ->
    case off(A) =< off(B) of
        true -> A;
        false -> B
    end.

off(#{driven := Driven, odometry := Odometry}) -> abs(Odometry - Driven).

%% @doc Is the odometry as commanded?
-spec judge(distance | angle, Commanded :: pos_integer(), drive()) ->
    starl_create_doctor:finding().
judge(What, Commanded, #{driven := Driven, odometry := Odometry} = Drive) ->
    Off = 100 * (Odometry / Driven - 1),
    Text = io_lib:format("~b ~ts commanded~ts, ~.1f by its odometry: ~ts~.1f %", [
        Commanded, unit(What), late(Drive), float(Odometry), sign(round(10 * Off)), abs(Off)
    ]),
    case abs(Off) > 100 * ?TOLERANCE of
        true -> {problem, What, [Text, remedy(What)]};
        false -> {ok, What, Text}
    end.

late(#{late_us := Late}) when Late < ?FINE_US -> "";
late(#{late_us := Late, driven := Driven}) ->
    io_lib:format(" (this computer was ~b ms late, so ~.1f driven)", [Late div 1000, Driven]).

sign(Off) when Off < 0 -> "-";
sign(_) -> "+".

unit(distance) -> "mm";
unit(angle) -> "degrees".

remedy(distance) ->
    "; measure its way with a tape and say --measured-mm; look for a worn or slipping wheel";
remedy(angle) ->
    "; measure its turn and say --measured-deg; look for a dragging caster or carpet".

%% What a person has measured counts for more than what was commanded. A robot that has not moved has none.
factors(_What, #{odometry := Odometry}, _Plan) when Odometry == 0 ->
    [];
factors(What, #{driven := Driven, odometry := Odometry}, Plan) ->
    True = measured(What, Plan, Driven),
    [{What, True / Odometry}, {by_command(What), True / Driven}].

by_command(distance) -> drive;
by_command(angle) -> turn.

measured(distance, #{measured_mm := Mm}, _) when is_number(Mm) -> Mm;
measured(angle, #{measured_deg := Degrees}, _) when is_number(Degrees) -> Degrees;
measured(_, _, Driven) -> Driven.

%% Odometry before and after, at rest.
measure(What, Length, Probe, Model, Plan) ->
    _ = odometry(What, Probe, Model),
    Before = odometry(What, Probe, Model),
    {Go, Us} = go(What, Model, Plan),
    case starl_create_probe:drive(Probe, Go, Us, stop()) of
        {ok, Late} ->
            _ = starl_create_probe:listen(Probe, ?SETTLE_MS),
            #{
                driven => Length * (Us + Late) / Us,
                late_us => Late,
                odometry => way(What, Before, odometry(What, Probe, Model))
            };
        {interrupted, _} = Interrupted ->
            Interrupted
    end.

go(distance, _Model, #{drive_mm := Mm, drive_mm_s := Speed}) ->
    {<<145, Speed:16, Speed:16>>, Mm * 1000000 div Speed};
go(angle, Model, #{turn_deg := Degrees, turn_mm_s := Speed}) ->
    Arc = starl_create_wheels:axle_mm(Model) * math:pi() * Degrees / 360,
    {<<145, Speed:16, (-Speed):16>>, round(Arc * 1000000 / Speed)}.

%% Encoders of a Create 2; of a Create 1 what it has counted since it was last asked.
odometry(_What, Probe, 2) ->
    [Left, Right] = [ask(Probe, Id) || Id <- [43, 44]],
    {counts, Left, Right};
odometry(distance, Probe, 1) ->
    {since, ask(Probe, 19)};
odometry(angle, Probe, 1) ->
    {since, ask(Probe, 20)}.

ask(Probe, Id) ->
    case starl_create_probe:ask(Probe, <<142, Id>>, 2, 500) of
        {ok, <<Value:16/signed>>} -> Value;
        none -> 0
    end.

way(_What, {since, _}, {since, Way}) ->
    Way;
way(What, {counts, L0, R0}, {counts, L1, R1}) ->
    Mm = starl_create_wheels:mm_per_count(),
    {Left, Right} = {wrapped(L1 - L0) * Mm, wrapped(R1 - R0) * Mm},
    case What of
        distance -> (Left + Right) / 2;
        angle -> (Right - Left) / starl_create_wheels:axle_mm(2) * 180 / math:pi()
    end.

wrapped(Counts) -> ((Counts + 32768) band 16#FFFF) - 32768.

%% @doc Writes the profile of a robot.
-spec profile(file:filename(), map()) -> ok | {error, file:posix()}.
profile(File, Profile) ->
    Text = [
        "%% An iRobot Create as ./starl create doctor found it. distance, angle: the true length by\n"
        "%% what its odometry says; drive, turn: by what it was told.\n",
        io_lib:format("~tp.~n", [Profile])
    ],
    file:write_file(File, unicode:characters_to_binary(Text)).
