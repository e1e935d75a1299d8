%% @doc The command `./starl create': emulates an iRobot Create on a pty, diagnoses a real Create,
%% and drives it by keys. It also measures how long the wheels turn after a process was killed.
-module(starl_create_console).
-behaviour(starl_cli_command).

-export([command/0]).

-define(ACTIONS, [
    {"emulate", "an emulated Create on a pty, until Ctrl-C"},
    {"doctor DEVICE", "finds out the state of the robot behind DEVICE, and what to do"},
    {"drive DEVICE", "drives it by keys"},
    {"bench", "the time from a kill to standing wheels, as a table"}
]).

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "create",
        synopsis => "iRobot Create: emulator, doctor, driving by keys",
        argument => {required, "ACTION", {example, "emulate"}},
        subject => fun subject/2,
        about => fun about/1,
        flags => fun flags/1,
        statuses => [
            {0, "done; nothing is wrong"},
            {4, "the doctor found something, or the drive ended early"}
        ],
        run => fun run/1
    }.

about(none) ->
    about_actions();
about({emulate, _}) ->
    about_emulate();
about({doctor, _}) ->
    about_doctor();
about({drive, _}) ->
    [
        "Drives the robot behind DEVICE by keys. It stops when no key is held.",
        {list, "Keys", starl_create_by_hand:keys()}
    ];
about({bench, _}) ->
    about_bench();
about(_Other) ->
    [].

about_actions() ->
    [
        "Works with an iRobot Create, of 2006 (model 1) or 2014 (model 2), at a serial line such as "
        "/dev/ttyUSB0.",
        {list, "Actions", ?ACTIONS},
        "./starl create ACTION --help lists the flags of each; the page is doc/create.md."
    ].

about_emulate() ->
    [
        "Emulates a Create, byte for byte, on a pty, and prints the name of the device; other programs "
        "open it like a real one, at the right baud rate. One robot without walls turns its wheels freely. "
        "Several stand in rows, 500 mm apart, robot 1 first, and look along their row; they bump "
        "against each other, and against the walls of --arena.",
        {list, "Quirks, as in --quirk asleep,odometry=1.05", [
            {atom_to_list(Key), Doc}
         || {Key, _, _, Doc} <- starl_create_quirks:options()
        ]}
    ].

about_doctor() ->
    [
        "Finds out whether the robot behind DEVICE answers, its baud rate, model, mode, battery and the "
        "quality of its stream, and says what to do about what is wrong. It does not move the robot, "
        "except with --calibrate: it then drives 1 m straight and turns 360 degrees to the left, so "
        "give it room. --profile writes what was found to a file."
    ].

about_bench() ->
    [
        "Measures, with an emulated Create behind a pty, the time from just before a kill, or a pull of "
        "its cable, until its body stands: the median and the longest of several. A Create 1 is driven "
        "twice: by the waits of the document, and by short ones, if it has them (see doctor). none: no "
        "bound, it still drives. stands: it has come to rest by itself before."
    ].

flags({emulate, _}) -> [{"Flags", emulate_flags()}];
flags({doctor, _}) -> [{"Flags", doctor_flags()}];
flags({drive, _}) -> [{"Flags", drive_flags()}];
flags({bench, _}) -> [{"Flags", [{times, {integer, 1, 1000}, 10, "measurements of each"}]}];
flags(_Other) -> [].

emulate_flags() ->
    [
        model(),
        {link, {optional, string}, none,
            "a link to the device, which is put there and taken away; of several: %d is the number"},
        {robots, {integer, 1, 100}, 1, "the number of robots, each with its device"},
        {arena, {optional, {size, {number, 500, 100000}}}, none, "walls around this floor, mm"},
        {quirk, {list, string}, [], "names, or NAME=VALUE, divided by commas"},
        {charge, {number, 0, 100}, 90, "charge of its battery, %"},
        {show, switch, false, "prints what it does: its mode, its wheels, its lights"},
        baud()
    ].

doctor_flags() ->
    [
        model(),
        baud(),
        {firmware, switch, false, "starts a Create 2 anew, which tells its release"},
        {calibrate, switch, false, "drives 1 m and turns 360 degrees"},
        {drive_mm, {integer, 0, 10000}, 1000, "the way to drive"},
        {turn_deg, {integer, 0, 3600}, 360, "the angle to turn"},
        {measured_mm, {optional, {number, 1, 20000}}, none, "the way, as you have measured it"},
        {measured_deg, {optional, {number, 1, 7200}}, none, "the turn, as you have measured it"},
        {profile, {optional, string}, none, "writes the profile of the robot to this file"}
    ].

drive_flags() ->
    [
        model(),
        baud(),
        {speed, {integer, 10, 500}, 150, "mm/s"},
        {hold_ms, {integer, 50, 5000}, 600, "how long one key moves it"}
    ].

model() -> {model, {integer, 1, 2}, 2, "1: Create of 2006; 2: Create 2 or Roomba 600"}.

baud() -> {baud, {optional, {integer, 300, 115200}}, none, "its baud rate (1: 57600; 2: 115200)"}.

-spec subject(string(), [string()]) -> {ok, starl_cli_command:subject(), [string()]}.
subject("emulate", Args) -> {ok, {emulate, none}, Args};
subject("bench", Args) -> {ok, {bench, none}, Args};
subject("doctor", Args) -> with_device(doctor, Args);
subject("drive", Args) -> with_device(drive, Args);
subject(Other, [[C | _] | Args]) when C =/= $- -> {ok, {unknown, Other}, Args};
subject(Other, Args) -> {ok, {unknown, Other}, Args}.

with_device(Action, [[C | _] = Device | Args]) when C =/= $- -> {ok, {Action, Device}, Args};
with_device(Action, Args) -> {ok, {Action, none}, Args}.

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{subject := {unknown, Word}}) ->
    Names = [hd(string:lexemes(Name, " ")) || {Name, _} <- ?ACTIONS],
    {error, [["there is no action ", Word, "; there are ", lists:join(", ", Names)]]};
run(#{subject := {Action, none}}) when Action =:= doctor; Action =:= drive ->
    {error, [
        [
            atom_to_list(Action),
            " needs a device, as in ./starl create ",
            atom_to_list(Action),
            " /dev/ttyUSB0"
        ]
    ]};
run(#{subject := {emulate, _}, values := Values}) ->
    case quirks(Values) of
        {ok, Quirks} -> emulate(Quirks, Values);
        {error, _} = Error -> Error
    end;
run(#{subject := {doctor, Device}, values := Values}) ->
    doctor(Device, Values);
run(#{subject := {drive, Device}, values := Values}) ->
    drive(Device, Values);
run(#{subject := {bench, _}, values := #{times := Times}}) ->
    bench(starl_create_stop_times:rows(), Times).

%% -- emulate --------------------------------------------------------------------------------------

quirks(#{quirk := Texts}) ->
    Read = [quirk(unicode:characters_to_list(Text)) || Text <- Texts],
    case [Problem || {error, Problem} <- Read] of
        [] -> {ok, maps:from_list([{Key, Value} || {ok, Key, Value} <- Read])};
        Problems -> {error, Problems}
    end.

quirk(Text) ->
    [Name | Value] = string:split(Text, "="),
    Options = starl_create_quirks:options(),
    case [Option || {Key, _, _, _} = Option <- Options, same(Name, Key)] of
        [Option] -> quirk(Option, Value);
        [] -> {error, ["there is no quirk ", Name, "; ./starl create emulate --help lists all"]}
    end.

same(Name, Key) ->
    lists:flatten(string:replace(Name, "-", "_", all)) =:= atom_to_list(Key).

quirk({Key, switch, _, _}, []) ->
    {ok, Key, true};
quirk({Key, _, _, _}, []) ->
    {error, ["the quirk ", atom_to_list(Key), " needs a value: ", atom_to_list(Key), "=VALUE"]};
quirk({Key, _, _, _} = Option, [Text]) ->
    case starl_cli_flags:parse([starl_cli_flags:flag(Key) ++ "=" ++ Text], [Option]) of
        {ok, #{Key := Value}} -> {ok, Key, Value};
        {error, [Problem | _]} -> {error, ["the quirk ", starl_cli_flags:format_problem(Problem)]}
    end.

emulate(Quirks, #{charge := Charge} = Values) ->
    Baud = maps:filter(fun(_, Value) -> Value =/= none end, maps:with([baud], Values)),
    Told = maps:from_list([{tell, self()} || maps:get(show, Values)]),
    Wanted = maps:merge(maps:with([model, robots, arena, link], Values), maps:merge(Baud, Told)),
    %% one that cannot start must not end this process
    _ = process_flag(trap_exit, true),
    case starl_create_on_ptys:start_link(Wanted#{quirks => Quirks, charge_mah => 27 * Charge}) of
        {ok, _Room, Robots} ->
            _ = [starl_cli_terminal:out("~ts\n", [Device]) || {_, _, Device} <- Robots],
            starl_cli_terminal:warn([emulated(length(Robots)), " Ctrl-C ends it."]),
            ended(Robots);
        {error, Reason} ->
            {error, [starl_create_on_ptys:format_error(Reason)]}
    end.

emulated(1) -> "A Create, emulated.";
emulated(N) -> [integer_to_list(N), " Creates, emulated, in one room."].

ended(Robots) ->
    receive
        {'EXIT', Pid, _} ->
            case lists:keymember(Pid, 2, Robots) of
                true -> 4;
                false -> ended(Robots)
            end;
        {starl_create, Create, Out} ->
            starl_cli_terminal:out("~ts~ts\n", [whose(Create, Robots), shown(Out)]),
            ended(Robots)
    end.

whose(_Create, [_]) -> "";
whose(Create, Robots) -> [[Device, ": "] || {C, _, Device} <- Robots, C =:= Create].

shown({wheels, {Left, Right}}) ->
    io_lib:format("wheels ~b ~b mm/s", [round(Left), round(Right)]);
shown(Out) ->
    [What | Values] = tuple_to_list(Out),
    lists:join($\s, [atom_to_list(What) | [io_lib:format("~w", [Value]) || Value <- Values]]).

%% -- doctor ---------------------------------------------------------------------------------------

doctor(Device, #{model := Model, baud := Baud, firmware := Firmware, profile := File} = Values) ->
    Options = #{model => Model, baud => Baud, firmware => Firmware, calibrate => plan(Values)},
    {Findings, Profile} = starl_create_doctor:examine(Device, Options),
    lists:foreach(fun said/1, Findings),
    written(File, Profile, status(starl_create_doctor:problems(Findings))).

said({_, _, Text} = Finding) ->
    Head = starl_create_doctor:line(setelement(3, Finding, "")),
    Indent = string:length(Head),
    Wrapped = starl_cli_terminal:wrap(Text, Indent, starl_cli_terminal:columns()),
    starl_cli_terminal:out([Head, Wrapped, "\n"]).

plan(#{calibrate := false}) ->
    none;
plan(Values) ->
    Given = maps:with([drive_mm, turn_deg, measured_mm, measured_deg], Values),
    Given#{drive_mm_s => 200, turn_mm_s => 100}.

status([]) -> 0;
status([_ | _]) -> 4.

written(none, _Profile, Status) ->
    Status;
written(_File, none, Status) ->
    Status;
written(File, Profile, Status) ->
    case starl_create_calibration:profile(File, Profile) of
        ok ->
            starl_cli_terminal:out("profile   ~ts\n", [File]),
            Status;
        {error, Posix} ->
            {error, [[File, ": ", file:format_error(Posix)]]}
    end.

%% -- drive ----------------------------------------------------------------------------------------

drive(Device, #{model := Model, baud := Baud} = Values) ->
    Self = self(),
    ok = starl_cli_signal:on_interrupt(fun() -> Self ! quit end),
    case file:open("/dev/tty", [read, raw, binary]) of
        {ok, Terminal} ->
            ok = file:close(Terminal),
            _ = spawn_link(fun() -> keys(Self) end),
            Usual = maps:get(Model, #{1 => 57600, 2 => 115200}),
            Rate =
                case Baud of
                    none -> Usual;
                    _ -> Baud
                end,
            drove(starl_create_by_hand:run(Device, Values#{baud := Rate, ready => fun help/0}));
        {error, _} ->
            {error, ["it is driven by the keys of a terminal, and there is none"]}
    end.

help() ->
    Line = "w s a d or arrows drive, + - change the speed, q ends.",
    starl_cli_terminal:warn(starl_cli_terminal:wrap(Line, 0, starl_cli_terminal:columns())).

%% A file belongs to the process that has opened it. A read of more bytes waits for all of them.
keys(Driver) ->
    {ok, Terminal} = file:open("/dev/tty", [read, raw, binary]),
    keys(Terminal, Driver).

keys(Terminal, Driver) ->
    case file:read(Terminal, 1) of
        {ok, Keys} ->
            Driver ! {keys, Keys},
            keys(Terminal, Driver);
        _ ->
            Driver ! quit
    end.

drove(ok) ->
    0;
drove({ended, Text}) ->
    starl_cli_terminal:complain(["create: ", Text]),
    4;
drove({error, Text}) ->
    {error, [Text]}.

%% -- bench ----------------------------------------------------------------------------------------

bench([{First, _} | _] = Rows, Times) ->
    Robots = starl_create_stop_times:robots(),
    case starl_create_stop_times:measure(First, element(1, hd(Robots))) of
        {ok, _} ->
            bench_head(Robots),
            lists:foreach(fun(Row) -> bench_row(Row, Robots, Times) end, Rows),
            0;
        {error, Text} ->
            {error, [Text]}
    end.

bench_head(Robots) ->
    starl_cli_terminal:out("~-35s~ts\n", [
        "", [io_lib:format("~18ts", [Name]) || {_, Name} <- Robots]
    ]),
    starl_cli_terminal:out("~-35s~ts\n", [
        "ms to standing wheels", ["    median longest" || _ <- Robots]
    ]).

bench_row({Row, Text}, Robots, Times) ->
    starl_cli_terminal:out("~-35s", [Text]),
    lists:foreach(fun({Robot, _}) -> bench_cell(Row, Robot, Times) end, Robots),
    starl_cli_terminal:out("\n").

%% Numbers come before words.
bench_cell(Row, Robot, Times) ->
    All = [starl_create_stop_times:measure(Row, Robot) || _ <- lists:seq(1, Times)],
    Sorted = lists:sort([Standing || {ok, Standing} <- All]),
    Median = lists:nth((Times + 1) div 2, Sorted),
    starl_cli_terminal:out("~10ts~8ts", [shown_ms(Median), shown_ms(lists:last(Sorted))]).

shown_ms(drives_on) -> "none";
shown_ms(stood_before) -> "stands";
shown_ms(Us) -> io_lib:format("~.1f", [Us / 1000]).
