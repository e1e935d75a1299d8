%% What can go wrong on a robot's computer, in one line with a way out. The texts are those of OpenSSH 9,
%% rsync 3.2, GNU tar, bash and dash.
-module(starl_fleet_failure_tests).
-include_lib("eunit/include/eunit.hrl").

line_test_() ->
    [
        {Said, ?_assertEqual("robot 2 (starl@r2): " ++ Line, line(Stage, Status, Said))}
     || {Stage, Status, Said, Line} <- [
            {look, 255, "ssh: Could not resolve hostname r2: Name or service not known\r\n",
                "there is no computer r2; mend host in the fleet file"},
            {look, 255, "ssh: connect to host r2 port 22: No route to host\r\n",
                "it does not answer; is it switched on, and on this network?"},
            {look, 255, "ssh: connect to host r2 port 22: Connection timed out",
                "it does not answer; is it switched on, and on this network?"},
            {look, 255, "ssh: connect to host r2 port 22: Connection refused",
                "no ssh server answers there; say on it: apt install openssh-server"},
            {look, 255, "starl@r2: Permission denied (publickey,password).\r\n",
                "it does not take our ssh key; say once: ssh-copy-id starl@r2"},
            {look, 255, "No ED25519 host key is known for r2\r\nHost key verification failed.\r\n",
                "its ssh key is not known here yet; say once: ssh starl@r2"},
            {look, 255,
                "@ WARNING: REMOTE HOST IDENTIFICATION HAS CHANGED! @\nHost key verification failed.",
                "its ssh key is another than before; if it was set up anew: ssh-keygen -R r2"},
            {room, 1, "mkdir: cannot create directory '/opt/starl': Permission denied",
                "starl may not write there; mend home in the fleet file, or the directory"},
            {copy, 11,
                "rsync: write failed on \"/x\": No space left on device (28)\nrsync error: ...",
                "its disk is full; make room there and deploy again"},
            {copy, 2, "tar: ./a: Cannot write: No space left on device\n",
                "its disk is full; make room there and deploy again"},
            {copy, 12, "bash: line 1: rsync: command not found\n",
                "rsync is missing; say: apt install rsync"},
            {check, 1, "beam.smp: /lib/libc.so.6: version `GLIBC_2.36' not found (required by x)",
                "its Linux is older than ours (glibc); deploy with --build-there"},
            {check, 126, "sh: 1: erlexec: Exec format error",
                "its processor is another than ours; deploy with --build-there"},
            {check, 1, "fleet.term: robot 1: no host\n",
                "the check of the release failed: fleet.term: robot 1: no host"},
            {health, 1, "its node does not answer: transport: port 5001: in use\r\n",
                "it is not well: its node does not answer: transport: port 5001: in use"},
            {robot, 127, "bash: line 1: starl/current/bin/robot: No such file or directory",
                "no release runs there; deploy first"},
            {copy, timeout, "",
                "no answer for too long; is the network slow, or the computer stuck?"},
            {switch, 1, "", "the start failed: without a word"}
        ]
    ].

line(Stage, Status, Said) ->
    lists:flatten(starl_fleet_failure:line(Stage, 2, robot(), {Status, Said})).

robot() ->
    #{host => "r2", user => "starl", ssh => [], address => "r2", port => 1, chassis => {none, #{}}}.

%% Other words, such as a warning of ssh's, are passed over.
facts_test() ->
    Said =
        "Warning: Permanently added 'r2' (ED25519) to the list.\r\n"
        "machine aarch64\nrsync no\notp none\nfree 1000\nrelease none\nstore kept\ntime 1700000000\n",
    ?assertEqual(facts(#{}), starl_fleet_failure:facts(Said)),
    ?assertEqual(unknown, starl_fleet_failure:facts("C:\\>")),
    %% a number that is none, or endless, or missing
    [
        ?assertEqual(
            {Bad, unknown},
            {Bad, starl_fleet_failure:facts(re:replace(Said, Good, Bad, [{return, list}]))}
        )
     || {Good, Bad} <- [
            {"free [0-9]+", "free abc"},
            {"free [0-9]+", "free -1"},
            {"free [0-9]+", "free " ++ lists:duplicate(1000, $9)},
            {"time [0-9]+", "time 12x"},
            {"machine", "engine"}
        ]
    ].

facts(More) ->
    Facts = #{
        machine => "aarch64",
        rsync => false,
        otp => "none",
        free_kb => 1000,
        release => "none",
        store => true,
        time_s => 1_700_000_000
    },
    maps:merge(Facts, More).

%% What was read between two of our times is off by what it lies outside of them.
clock_test_() ->
    Clock = fun(From, To) ->
        Lines = starl_fleet_failure:clock(2, robot(), facts(#{}), {From, To}),
        [lists:flatten(Line) || Line <- Lines]
    end,
    At = 1_700_000_000,
    Told = fun(What) ->
        "robot 2 (starl@r2): its clock is " ++ What ++
            " this computer's; set both (NTP or chrony): "
            "robots whose clocks differ by more than 15 s do not hear each other"
    end,
    [
        ?_assertEqual([], Clock(At - 1, At + 9)),
        ?_assertEqual([], Clock(At + 1, At + 9)),
        ?_assertEqual([Told("60 s ahead of")], Clock(At - 70, At - 60)),
        ?_assertEqual([Told("3600 s behind")], Clock(At + 3600, At + 3610))
    ].

%% Another processor is said before anything is copied, with the ways out.
look_test() ->
    ?assertEqual(
        [
            "robot 2 (starl@r2): its processor is aarch64, ours x86_64; deploy with --build-there or "
            "--erlang there (its own Erlang/OTP)"
        ],
        look(facts(#{}), #{})
    ),
    ?assertEqual([], look(facts(#{machine => "x86_64"}), #{})).

disk_test() ->
    ?assertEqual(
        [
            "robot 2 (starl@r2): its disk is full: 0 MB free, the release needs 20 MB; make room there"
        ],
        look(facts(#{machine => "x86_64"}), #{size_kb => 20000})
    ).

erlang_there_test() ->
    ?assertEqual(
        ["robot 2 (starl@r2): there is no Erlang/OTP; say on it: apt install erlang"],
        look(facts(#{}), #{kind => there})
    ),
    ?assertEqual(
        [
            "robot 2 (starl@r2): its Erlang/OTP 25 is older than ours (27); deploy with --build-there"
        ],
        look(facts(#{otp => "25"}), #{kind => there})
    ),
    ?assertEqual([], look(facts(#{otp => "25"}), #{kind => source})),
    ?assertEqual(
        ["robot 2 (starl@r2): its Erlang/OTP is 24; 25 or newer is needed"],
        look(facts(#{otp => "24"}), #{kind => source})
    ).

look(Facts, More) ->
    Ours = maps:merge(#{kind => ours, machine => "x86_64", otp => "27", size_kb => 10}, More),
    [lists:flatten(Line) || Line <- starl_fleet_failure:look(2, robot(), Facts, Ours)].
