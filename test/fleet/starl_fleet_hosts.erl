%% Two computers and an administrator's on one machine, made of network namespaces: each of the two has
%% its own network, its own sshd and its own disk. Nothing of the machine's own network is touched.
-module(starl_fleet_hosts).

-export([allowed/0, up/1, down/1, on/3, sh/2, unplug/2, plug/2]).

%% Why there can be no such computers here; `yes' otherwise.
allowed() ->
    Missing = [
        Tool
     || Tool <- ["ip", "sshd", "ssh", "ssh-keygen", "rsync", "unshare"], not have(Tool)
    ],
    case {string:trim(os:cmd("id -u")), Missing} of
        {"0", []} ->
            namespaces();
        {"0", _} ->
            {no,
                "no " ++ string:join(Missing, ", ") ++
                    " here: apt install iproute2 openssh-server rsync"};
        {_, _} ->
            {no, "only root can make network namespaces"}
    end.

have(Tool) -> os:find_executable(Tool, path()) =/= false.

path() -> os:getenv("PATH", "") ++ ":/usr/sbin:/sbin".

namespaces() ->
    Name = "starl-try-" ++ os:getpid(),
    Said = os:cmd("ip netns add " ++ Name ++ " && ip netns del " ++ Name),
    case Said of
        "" -> yes;
        _ -> {no, "this machine allows no network namespaces: " ++ string:trim(Said)}
    end.

%% Makes the computers, and the keys of ssh in the directory: `id' is known there, `other' is not.
up(Dir) ->
    Tag = "starl-" ++ os:getpid(),
    ok = filelib:ensure_path(filename:join(Dir, "disk")),
    ok = filelib:ensure_path("/run/sshd"),
    [
        run(["ssh-keygen -q -t ed25519 -N '' -f ", filename:join(Dir, F)])
     || F <- ["id", "other", "host"]
    ],
    ok = file:write_file(filename:join(Dir, "sshd_config"), sshd(Dir)),
    Hub = Tag ++ "-0",
    run(["ip netns add ", Hub]),
    run(["ip -n ", Hub, " link add br0 type bridge"]),
    run(["ip -n ", Hub, " addr add ", address(100), "/24 dev br0"]),
    run(["ip -n ", Hub, " link set br0 up"]),
    Hosts = #{tag => Tag, dir => Dir},
    maps:from_list([{N, host(N, Hosts)} || N <- [1, 2]]),
    Hosts#{ports => [sshd(N, Hosts) || N <- [1, 2]]}.

address(N) -> "10.77.0." ++ integer_to_list(N).

sshd(Dir) ->
    [
        ["HostKey ", Dir, "/host\n"],
        ["AuthorizedKeysFile ", Dir, "/id.pub\n"],
        "PidFile none\nUsePAM no\nStrictModes no\nPermitRootLogin prohibit-password\n"
    ].

host(N, #{tag := Tag}) ->
    Number = integer_to_list(N),
    [Host, Hub, Line] = [Tag ++ "-" ++ Number, Tag ++ "-0", "v" ++ Number],
    run(["ip netns add ", Host]),
    run(["ip -n ", Host, " link set lo up"]),
    run(["ip -n ", Hub, " link add ", Line, " type veth peer name eth0 netns ", Host]),
    run(["ip -n ", Hub, " link set ", Line, " master br0 up"]),
    run(["ip -n ", Host, " addr add ", address(N), "/24 dev eth0"]),
    run(["ip -n ", Host, " link set eth0 up"]).

%% Its disk is of its own, since `ip netns exec' gives it its own mounts. The second has no rsync.
sshd(N, #{tag := Tag, dir := Dir}) ->
    Hide = ["mount --bind /dev/null ", os:find_executable("rsync", path()), " && "],
    Line = [
        ["mount -t tmpfs -o size=150m tmpfs ", Dir, "/disk && "],
        [Hide || N =:= 2],
        ["echo ready; exec ", os:find_executable("sshd", path()), " -D -e -f ", Dir, "/sshd_config"]
    ],
    Port = open_port({spawn_executable, "/bin/sh"}, [
        {args, ["-c", in(Tag, N, lists:flatten(Line))]}, {line, 1000}, stderr_to_stdout, exit_status
    ]),
    listens(Port).

%% sshd says so.
listens(Port) ->
    receive
        {Port, {data, {eol, "Server listening on 0.0.0.0" ++ _}}} -> Port;
        {Port, {data, {eol, _}}} -> listens(Port);
        {Port, {exit_status, Status}} -> error({no_sshd, Status})
    end.

in(Tag, N, Line) ->
    "exec ip netns exec " ++ Tag ++ "-" ++ integer_to_list(N) ++ " sh -c '" ++ Line ++ "'".

%% Ends everything that runs in the namespaces.
down(#{tag := Tag}) ->
    Ends = [
        ["for p in $(ip netns pids ", T, "); do kill -9 $p; done; ip netns del ", T, "; "]
     || N <- [1, 2, 0], T <- [Tag ++ "-" ++ integer_to_list(N)]
    ],
    _ = os:cmd(lists:flatten(Ends)),
    ok.

%% Runs a line of sh on a computer, as if somebody sat there.
on(N, Line, #{tag := Tag, dir := Dir}) ->
    Pid = "$(ip netns pids " ++ Tag ++ "-" ++ integer_to_list(N) ++ " | sort -n | head -n 1)",
    os:cmd("nsenter -m -n -t " ++ Pid ++ " sh -c 'cd " ++ Dir ++ "/disk && " ++ Line ++ "'").

%% Runs a line of sh on the administrator's computer, in the directory; $starl is the script.
sh(Line, #{tag := Tag, dir := Dir}) ->
    ok = file:write_file(filename:join(Dir, "line.sh"), Line),
    starl_first_hour_ct:sh("ip netns exec " ++ Tag ++ "-0 sh ./line.sh", Dir).

unplug(N, Hosts) -> wire("down", N, Hosts).
plug(N, Hosts) -> wire("up", N, Hosts).

wire(How, N, #{tag := Tag}) ->
    run(["ip -n ", Tag, "-", integer_to_list(N), " link set eth0 ", How]).

run(Line) ->
    case os:cmd(lists:flatten(["PATH=$PATH:/usr/sbin:/sbin; (", Line, ") 2>&1"])) of
        "" -> ok;
        Said -> error({lists:flatten(Line), Said})
    end.
