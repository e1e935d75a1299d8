%% Computers with networks of their own on one machine, made of network namespaces: a hub with a bridge
%% (0), and a wire to each computer. Nothing of the machine's own network is touched.
-module(starl_namespaces).

-export([allowed/2, tool/1, up/3, down/2, name/2, run/1, deafen/4, hears/4]).

%% Why there can be none here, or not with these tools; `yes' otherwise.
allowed(Tools, Install) ->
    Missing = [Tool || Tool <- ["ip" | Tools], tool(Tool) =:= false],
    case {string:trim(os:cmd("id -u")), Missing} of
        {"0", []} -> namespaces();
        {"0", _} -> {no, "no " ++ string:join(Missing, ", ") ++ " here: " ++ Install};
        {_, _} -> {no, "only root can make network namespaces"}
    end.

tool(Name) -> os:find_executable(Name, os:getenv("PATH", "") ++ ":/usr/sbin:/sbin").

namespaces() ->
    Name = "starl-try-" ++ os:getpid(),
    Said = os:cmd("ip netns add " ++ Name ++ " && ip netns del " ++ Name),
    case Said of
        "" -> yes;
        _ -> {no, "this machine allows no network namespaces: " ++ string:trim(Said)}
    end.

%% Computer N of the network "10.77.0." has the address 10.77.0.N, the hub 10.77.0.100.
up(Tag, Network, Numbers) ->
    Hub = name(Tag, 0),
    run(["ip netns add ", Hub]),
    run(["ip -n ", Hub, " link add br0 type bridge"]),
    run(["ip -n ", Hub, " addr add ", Network, "100/24 dev br0"]),
    run(["ip -n ", Hub, " link set br0 up"]),
    lists:foreach(fun(N) -> computer(Tag, Network, N) end, Numbers).

computer(Tag, Network, N) ->
    [Host, Hub, Line] = [name(Tag, N), name(Tag, 0), "v" ++ integer_to_list(N)],
    run(["ip netns add ", Host]),
    run(["ip -n ", Host, " link set lo up"]),
    run(["ip -n ", Hub, " link add ", Line, " type veth peer name eth0 netns ", Host]),
    run(["ip -n ", Hub, " link set ", Line, " master br0 up"]),
    run(["ip -n ", Host, " link set eth0 address ", card(N)]),
    run(["ip -n ", Host, " addr add ", Network, integer_to_list(N), "/24 dev eth0"]),
    run(["ip -n ", Host, " link set eth0 up"]).

card(N) -> io_lib:format("02:00:00:00:00:~2.16.0b", [N]).

%% Ends everything that runs there, too.
down(Tag, Numbers) ->
    Ends = [
        ["for p in $(ip netns pids ", T, "); do kill -9 $p; done; ip netns del ", T, "; "]
     || N <- Numbers ++ [0], T <- [name(Tag, N)]
    ],
    _ = os:cmd(lists:flatten(Ends)),
    ok.

%% The namespace of a computer.
name(Tag, N) -> Tag ++ "-" ++ integer_to_list(N).

%% `To' does not hear `From' any more, which does not know it: its frames go to a card that is not there.
deafen(Tag, Network, From, To) -> reaches(Tag, Network, From, To, card(99)).

%% `To' hears `From' again.
hears(Tag, Network, From, To) -> reaches(Tag, Network, From, To, card(To)).

reaches(Tag, Network, From, To, Card) ->
    Address = [Network, integer_to_list(To)],
    run([
        ["ip -n ", name(Tag, From), " neigh replace ", Address],
        [" lladdr ", Card, " dev eth0 nud permanent"]
    ]).

run(Line) ->
    case os:cmd(lists:flatten(["PATH=$PATH:/usr/sbin:/sbin; (", Line, ") 2>&1"])) of
        "" -> ok;
        Said -> error({lists:flatten(Line), Said})
    end.
