%% @doc Explains a failed command of a deployment in one line: which robot and computer, what is
%% wrong, and what to do. A pure module.
-module(starl_fleet_failure).

-export([line/4, named/3, look/4, clock/4, facts/1, lost_store/2]).

-export_type([facts/0]).

%% What a computer says of itself.
-type facts() :: #{
    machine := string(),
    rsync := boolean(),
    otp := string(),
    free_kb := integer(),
    release := string(),
    store := boolean(),
    time_s := integer()
}.

%% @doc The line on a command that ended with this exit status and this output.
-spec line(starl_fleet_steps:stage() | atom(), starl:robot_id(), starl_fleet_file:robot(), {
    integer() | timeout, string()
}) -> unicode:chardata().
line(Stage, N, Robot, {Status, Said}) -> named(N, Robot, why(Stage, Status, Said, Robot)).

%% @doc A line on a robot.
-spec named(starl:robot_id(), starl_fleet_file:robot(), unicode:chardata()) -> unicode:chardata().
named(N, Robot, Why) ->
    io_lib:format("robot ~b (~ts): ~ts", [N, starl_fleet_steps:target(Robot), Why]).

why(_Stage, timeout, _Said, _Robot) ->
    "no answer for too long; is the network slow, or the computer stuck?";
why(Stage, 255, Said, Robot) ->
    known(Said, by_ssh(Robot), by_any(Robot), Stage);
why(Stage, _Status, Said, Robot) ->
    known(Said, by_any(Robot), by_ssh(Robot), Stage).

%% The first pattern that is found tells.
known(Said, First, Second, Stage) ->
    case [Why || {Pattern, Why} <- First ++ Second, re:run(Said, Pattern) =/= nomatch] of
        [Why | _] -> Why;
        [] -> [doing(Stage), last_line(Said)]
    end.

by_ssh(#{host := Host} = Robot) ->
    Target = starl_fleet_steps:target(Robot),
    [
        {"Could not resolve hostname", [
            "there is no computer ", Host, "; mend host in the fleet file"
        ]},
        {"Connection refused",
            "no ssh server answers there; say on it: apt install openssh-server"},
        {"No route to host|timed out|Network is unreachable|Host is down",
            "it does not answer; is it switched on, and on this network?"},
        {"IDENTIFICATION HAS CHANGED", [
            "its ssh key is another than before; if it was set up anew: ssh-keygen -R ", Host
        ]},
        {"Host key verification failed", [
            "its ssh key is not known here yet; say once: ssh ", Target
        ]},
        {"Identity file .* not accessible", "the ssh key of the fleet file is no file here"},
        {"Permission denied \\(", ["it does not take our ssh key; say once: ssh-copy-id ", Target]},
        {"Connection (closed|reset)", "it closed the connection; see its log of sshd"}
    ].

by_any(Robot) ->
    [
        {"No space left on device|Disk quota exceeded",
            "its disk is full; make room there and deploy again"},
        {"Read-only file system", "its file system is read-only"},
        {"GLIBC_[0-9.]+' not found",
            "its Linux is older than ours (glibc); deploy with --build-there"},
        {"Exec format error|cannot execute binary",
            "its processor is another than ours; deploy with --build-there"},
        {"current/bin/robot: (No such file|not found)", "no release runs there; deploy first"},
        {"rsync: (command )?not found|rsync: not found",
            "rsync is missing; say: apt install rsync"},
        {"mkdir: .*Permission denied|Permission denied", [
            user(Robot), " may not write there; mend home in the fleet file, or the directory"
        ]}
    ].

user(#{user := none}) -> "the user";
user(#{user := User}) -> User.

doing(look) -> "looking at it failed: ";
doing(room) -> "making its directory failed: ";
doing(copy) -> "the copy of the release failed: ";
doing(keys) -> "the copy of the keys failed: ";
doing(build) -> "the build there failed: ";
doing(check) -> "the check of the release failed: ";
doing(may_reload) -> "the reload failed: ";
doing(switch) -> "the start failed: ";
doing(reload) -> "the reload failed: ";
doing(health) -> "it is not well: ";
doing(tidy) -> "the removal of older releases failed: ";
doing(undo) -> "the way back failed: ";
doing(rollback) -> "the way back failed: ";
doing(robot) -> "".

last_line(Said) ->
    case lines(Said) of
        [] -> "without a word";
        Lines -> lists:last(Lines)
    end.

%% Not by string:lexemes/2, for which a carriage return and a line feed are one character.
lines(Said) ->
    Lines = re:split(Said, "[\r\n]+", [{return, list}, unicode]),
    [string:trim(Line) || Line <- Lines, string:trim(Line) =/= ""].

%% @doc What a computer has said of itself.
-spec facts(string()) -> facts() | unknown.
facts(Said) ->
    Words = [string:lexemes(Line, " ") || Line <- lines(Said)],
    Facts = maps:from_list([{Key, Value} || [Key, Value] <- Words]),
    case {Facts, number_of("free", Facts), number_of("time", Facts)} of
        {
            #{
                "machine" := M,
                "rsync" := R,
                "otp" := Otp,
                "release" := Release,
                "store" := Store
            },
            Free,
            Time
        } when is_integer(Free), is_integer(Time) ->
            #{
                machine => M,
                rsync => R =:= "yes",
                otp => Otp,
                free_kb => Free,
                release => Release,
                store => Store =:= "kept",
                time_s => Time
            };
        _ ->
            unknown
    end.

%% A number of at most fifteen digits.
number_of(Key, Facts) ->
    Text = maps:get(Key, Facts, ""),
    case re:run(Text, "^[0-9]{1,15}$", [{capture, none}, dollar_endonly]) of
        match -> list_to_integer(Text);
        nomatch -> none
    end.

%% @doc By how much a computer's clock differs from ours at least, if it is off: it was read between these
%% two of our times. None or one line.
-spec clock(starl:robot_id(), starl_fleet_file:robot(), facts() | unknown, {
    FromS :: integer(), ToS :: integer()
}) -> [unicode:chardata()].
clock(N, Robot, #{time_s := Time}, {_From, To}) when Time - To > 1 ->
    [named(N, Robot, off(Time - To, "ahead of"))];
clock(N, Robot, #{time_s := Time}, {From, _To}) when From - Time > 1 ->
    [named(N, Robot, off(From - Time, "behind"))];
clock(_N, _Robot, _Facts, _Looked) ->
    [].

off(Seconds, Which) ->
    Line =
        "its clock is ~b s ~ts this computer's; set both (NTP or chrony): robots whose clocks differ by "
        "more than 15 s do not hear each other",
    io_lib:format(Line, [Seconds, Which]).

%% @doc Why a release cannot go to a computer, by its facts: none or one line.
-spec look(starl:robot_id(), starl_fleet_file:robot(), facts() | unknown, #{
    kind := starl_fleet_release:kind(), machine := string(), otp := string(), size_kb := integer()
}) -> [unicode:chardata()].
look(N, Robot, unknown, _Ours) ->
    [named(N, Robot, "its shell does not answer as a Linux does")];
look(N, Robot, #{machine := Machine, otp := Otp, free_kb := Free}, Ours) ->
    #{kind := Kind, machine := Own, otp := OurOtp, size_kb := Size} = Ours,
    Whys = processor(Kind, Machine, Own) ++ erlang_there(Kind, Otp, OurOtp) ++ disk(Free, Size),
    [named(N, Robot, Why) || Why <- lists:sublist(Whys, 1)].

%% @doc The line on a robot without a store in a team that has run.
-spec lost_store(starl:robot_id(), starl_fleet_file:robot()) -> unicode:chardata().
lost_store(N, Robot) ->
    named(N, Robot, "it has lost its store, or is new in the team: it knows no promise of its own").

processor(ours, Machine, Own) when Machine =/= Own ->
    Line =
        "its processor is ~ts, ours ~ts; deploy with --build-there or --erlang there "
        "(its own Erlang/OTP)",
    [io_lib:format(Line, [Machine, Own])];
processor(_Kind, _Machine, _Own) ->
    [].

erlang_there(ours, _Otp, _OurOtp) ->
    [];
erlang_there(_Kind, "none", _OurOtp) ->
    ["there is no Erlang/OTP; say on it: apt install erlang"];
erlang_there(Kind, Otp, OurOtp) ->
    case {Kind, number(Otp), number(OurOtp)} of
        {_, There, _} when There < 25 ->
            [["its Erlang/OTP is ", Otp, "; 25 or newer is needed"]];
        {there, There, Here} when There < Here ->
            Line = "its Erlang/OTP ~b is older than ours (~b); deploy with --build-there",
            [io_lib:format(Line, [There, Here])];
        _ ->
            []
    end.

number(Text) ->
    case string:to_integer(Text) of
        {N, _} when is_integer(N) -> N;
        _ -> 0
    end.

disk(Free, Size) when Free < Size ->
    Line = "its disk is full: ~b MB free, the release needs ~b MB; make room there",
    [io_lib:format(Line, [Free div 1024, 1 + Size div 1024])];
disk(_Free, _Size) ->
    [].
