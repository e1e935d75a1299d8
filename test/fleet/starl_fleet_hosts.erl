%% Two computers and an administrator's on one machine, made of network namespaces: each of the two has
%% its own network, its own sshd, its own disk and its own clock. Nothing of the machine's own network is
%% touched.
-module(starl_fleet_hosts).

-define(NETWORK, "10.77.0.").

-export([allowed/0, up/1, down/1, on/3, sh/2, until/3, unplug/2, plug/2]).
-export([deafen/3, hears/3, address/3, set_clock/3]).

%% Why there can be no such computers here; `yes' otherwise.
allowed() ->
    starl_namespaces:allowed(
        ["sshd", "ssh", "ssh-keygen", "rsync", "unshare", "cc"],
        "apt install iproute2 openssh-server rsync gcc"
    ).

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
    Source = filename:join(filename:dirname(?FILE), "starl_fleet_clock.c"),
    run(["cc -shared -fPIC -O2 -o ", library(Dir), " ", Source]),
    ok = starl_namespaces:up(Tag, ?NETWORK, [1, 2]),
    Hosts = #{tag => Tag, dir => Dir},
    Hosts#{ports => [sshd(N, Hosts) || N <- [1, 2]]}.

sshd(Dir) ->
    [
        ["HostKey ", Dir, "/host\n"],
        ["AuthorizedKeysFile ", Dir, "/id.pub\n"],
        "PidFile none\nUsePAM no\nStrictModes no\nPermitRootLogin prohibit-password\n",
        ["SetEnv ", lists:join(" ", clock(Dir)), "\n"]
    ].

%% The environment of programs whose clock can be set.
clock(Dir) -> ["LD_PRELOAD=" ++ library(Dir), "STARL_CLOCK=" ++ Dir ++ "/disk/clock"].

library(Dir) -> filename:join(Dir, "clock.so").

%% Its disk is of its own, since `ip netns exec' gives it its own mounts. The second has no rsync.
sshd(N, #{tag := Tag, dir := Dir}) ->
    Hide = ["mount --bind /dev/null ", starl_namespaces:tool("rsync"), " && "],
    Line = [
        ["mount -t tmpfs -o size=150m tmpfs ", Dir, "/disk && "],
        [Hide || N =:= 2],
        ["echo ready; exec ", starl_namespaces:tool("sshd"), " -D -e -f ", Dir, "/sshd_config"]
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
    "exec ip netns exec " ++ starl_namespaces:name(Tag, N) ++ " sh -c '" ++ Line ++ "'".

%% Ends everything that runs in the namespaces.
down(#{tag := Tag}) -> starl_namespaces:down(Tag, [1, 2]).

%% Runs a line of sh on a computer, as if somebody sat there.
on(N, Line, #{tag := Tag, dir := Dir}) ->
    Pid = "$(ip netns pids " ++ Tag ++ "-" ++ integer_to_list(N) ++ " | sort -n | head -n 1)",
    os:cmd(
        "nsenter -m -n -t " ++ Pid ++ " env " ++
            lists:append(lists:join(" ", clock(Dir))) ++ " sh -c 'cd " ++ Dir ++ "/disk && " ++ Line ++
            "'"
    ).

%% Runs a line of sh on the administrator's computer, in the directory; $starl is the script.
sh(Line, Hosts) -> starl_first_hour_ct:sh(line(Line, Hosts), maps:get(dir, Hosts)).

%% The same, until it has said this.
until(Line, Pattern, Hosts) ->
    starl_first_hour_ct:until(line(Line, Hosts), Pattern, maps:get(dir, Hosts)).

line(Line, #{tag := Tag, dir := Dir}) ->
    ok = file:write_file(filename:join(Dir, "line.sh"), Line),
    "ip netns exec " ++ Tag ++ "-0 sh ./line.sh".

%% The clock of a computer is this far ahead of the others' from now on.
set_clock(N, Seconds, Hosts) ->
    "" = on(N, "echo " ++ integer_to_list(Seconds) ++ " >clock", Hosts),
    ok.

%% One computer does not hear the other any more; it hears it again.
deafen(From, To, #{tag := Tag}) -> starl_namespaces:deafen(Tag, ?NETWORK, From, To).
hears(From, To, #{tag := Tag}) -> starl_namespaces:hears(Tag, ?NETWORK, From, To).

%% A computer has this address instead of its own.
address(N, Last, #{tag := Tag}) ->
    Host = starl_namespaces:name(Tag, N),
    run(["ip -n ", Host, " addr flush dev eth0"]),
    run(["ip -n ", Host, " addr add ", ?NETWORK, integer_to_list(Last), "/24 dev eth0"]).

unplug(N, Hosts) -> wire("down", N, Hosts).
plug(N, Hosts) -> wire("up", N, Hosts).

wire(How, N, #{tag := Tag}) ->
    run(["ip -n ", starl_namespaces:name(Tag, N), " link set eth0 ", How]).

run(Line) -> starl_namespaces:run(Line).
