%% Deployment to two computers that the test makes (starl_fleet_hosts): deploy, upgrade, reload, roll
%% back, and what goes wrong there: each failure is one line that names the robot, and changes nothing.
-module(starl_fleet_hosts_SUITE).
-include_lib("common_test/include/ct.hrl").
-include_lib("stdlib/include/assert.hrl").

-export([all/0, suite/0, init_per_suite/1, end_per_suite/1]).
-export([
    deploys/1,
    deaf/1,
    wrong_clock/1,
    wrong_key/1,
    wrong_port/1,
    another_address/1,
    cloned/1,
    reload_goes_back/1,
    reloads/1,
    goes_back/1,
    rolls_back/1,
    refuses/1,
    over_tls/1,
    unwatched/1,
    stops/1,
    recorded/1
]).

suite() -> [{timetrap, {minutes, 9}}].

%% One story: each case goes on where the one before has ended.
all() ->
    [
        deploys,
        deaf,
        wrong_clock,
        wrong_key,
        wrong_port,
        another_address,
        cloned,
        reload_goes_back,
        reloads,
        goes_back,
        rolls_back,
        refuses,
        over_tls,
        unwatched,
        stops,
        recorded
    ].

init_per_suite(Config) ->
    case starl_fleet_hosts:allowed() of
        yes ->
            Self = self(),
            Dir = "/tmp/starl-fleet-" ++ os:getpid(),
            %% the owner of the sshds outlives this process
            Owner = spawn(fun() -> owner(Dir, Self) end),
            receive
                {Owner, Hosts} -> [{hosts, Hosts}, {owner, Owner} | Config]
            end;
        {no, Why} ->
            {skip, Why}
    end.

owner(Dir, Suite) ->
    Hosts = starl_fleet_hosts:up(Dir),
    Suite ! {self(), Hosts},
    receive
        stop -> starl_fleet_hosts:down(Hosts)
    end.

end_per_suite(Config) ->
    Owner = ?config(owner, Config),
    #{dir := Dir} = ?config(hosts, Config),
    Monitor = erlang:monitor(process, Owner),
    Owner ! stop,
    receive
        {'DOWN', Monitor, process, _, _} -> ok
    end,
    file:del_dir_r(Dir).

%% -- cases ----------------------------------------------------------------------------------

%% A fleet comes up; robot 2 has no rsync. Its robots hear each other: they elect one leader.
deploys(Config) ->
    Hosts = ?config(hosts, Config),
    fleet(#{}, Hosts),
    app(first, Hosts),
    {0, _} = sh("\"$starl\" keys fleet.term", Hosts),
    {0, Said} = deploy("--trial 1", Hosts),
    contains("runs on 2 robots", Said),
    {0, Status} = deploy("status", Hosts),
    contains("robot 1 (root@10.77.0.1): loop runs", Status),
    contains("robot 2 (root@10.77.0.2): loop runs", Status).

%% A robot whose ways are gone does not look well; each end of that is one line of its log.
%% Holds: A deaf robot does not look well: status and log say whom it does not hear, and why; so
%% they do of a clock that is off, and all is well when it is set right
%% Red: d018c00: nobody told; the log was empty in the first run of `deaf`
deaf(Config) ->
    Hosts = ?config(hosts, Config),
    ok = both_hear(Hosts),
    ok = starl_fleet_hosts:deafen(1, 2, Hosts),
    ok = until("robot 2 .*, hears 0 of 1 others, has not heard robot 1 for [0-9]+ s", Hosts),
    ok = starl_fleet_hosts:hears(1, 2, Hosts),
    ok = both_hear(Hosts),
    {0, Log} = deploy("logs 2", Hosts),
    ?assertMatch({match, [_]}, re:run(Log, "has not heard robot 1 for 5 s", [global])),
    ?assertMatch({match, [_]}, re:run(Log, "robot 1 is heard again", [global])).

%% A clock that is set wrong while the robot runs, and one that was wrong at its start: told by how much,
%% and all is well when it is set right, without a restart.
wrong_clock(Config) ->
    Hosts = ?config(hosts, Config),
    ok = starl_fleet_hosts:set_clock(2, 60, Hosts),
    ok = until("robot 1 .*has not heard robot 2 .*its clock is (59|60).. s ahead of ours", Hosts),
    _ = starl_fleet_hosts:on(2, "dd if=/dev/zero of=fill bs=1M 2>/dev/null", Hosts),
    {1, Said} = deploy("--trial 1", Hosts),
    told("robot 2 .root@10.77.0.2.: its clock is [56][0-9] s ahead of this computer's", Said),
    _ = starl_fleet_hosts:on(2, "rm fill", Hosts),
    ok = starl_fleet_hosts:set_clock(2, 0, Hosts),
    ok = both_hear(Hosts),
    ok = starl_fleet_hosts:set_clock(2, 3600, Hosts),
    _ = starl_fleet_hosts:on(2, "test/robot-2/current/bin/robot start >/dev/null 2>&1", Hosts),
    ok = until("robot 2 .*has not heard robot 1: its clock is (3599|3600).. s behind ours", Hosts),
    ok = starl_fleet_hosts:set_clock(2, 0, Hosts),
    ok = both_hear(Hosts),
    ok = until("robot 2 .*its program's clock is (3599|3600).. s ahead of its computer's", Hosts),
    _ = starl_fleet_hosts:on(2, "test/robot-2/current/bin/robot start >/dev/null 2>&1", Hosts),
    ok = both_hear(Hosts).

%% The key of another fleet came to robot 2: both say so, and hear each other when it has ours again.
wrong_key(Config) ->
    Hosts = ?config(hosts, Config),
    Key = "test/robot-2/keys/fleet.key",
    Other = lists:flatten(lists:duplicate(32, "a7")),
    _ = starl_fleet_hosts:on(2, "cp -p " ++ Key ++ " kept && echo " ++ Other ++ " >" ++ Key, Hosts),
    _ = starl_fleet_hosts:on(2, "test/robot-2/current/bin/robot start >/dev/null 2>&1", Hosts),
    ok = until("robot 1 .*has not heard robot 2 .*sealed with another key", Hosts),
    _ = starl_fleet_hosts:on(2, "cp -p kept " ++ Key, Hosts),
    _ = starl_fleet_hosts:on(2, "test/robot-2/current/bin/robot start >/dev/null 2>&1", Hosts),
    ok = both_hear(Hosts).

%% Robot 2 has a fleet file with another port, at which nobody is: neither hears the other.
wrong_port(Config) ->
    Hosts = ?config(hosts, Config),
    File = "test/robot-2/current/fleet.term",
    Line =
        "cp -p " ++ File ++ " kept && sed -i \"s/5001/5009/\" " ++ File ++
            " && grep -c 5009 " ++ File,
    ?assertNotEqual("0\n", starl_fleet_hosts:on(2, Line, Hosts)),
    _ = starl_fleet_hosts:on(2, "test/robot-2/current/bin/robot start >/dev/null 2>&1", Hosts),
    ok = until("robot 1 .*has not heard robot 2.*\nrobot 2 .*has not heard robot 1", Hosts),
    _ = starl_fleet_hosts:on(2, "cp -p kept " ++ File, Hosts),
    _ = starl_fleet_hosts:on(2, "test/robot-2/current/bin/robot start >/dev/null 2>&1", Hosts),
    ok = both_hear(Hosts).

%% A lease of DHCP has ended: the robot speaks from another address, and is answered there.
%% Holds: A robot with a new address is answered there, and is one robot
%% Red: d018c00: addresses were read once
another_address(Config) ->
    Hosts = ?config(hosts, Config),
    ok = starl_fleet_hosts:address(2, 22, Hosts),
    ok = until_log(1, "robot 2 is at 10.77.0.22 port 5001 now", Hosts),
    ok = starl_fleet_hosts:address(2, 2, Hosts),
    ok = until_log(1, "robot 2 is at 10.77.0.2 port 5001 now", Hosts),
    ok = both_hear(Hosts).

%% The disk of robot 2 was copied to the administrator's computer, and both are alive: both are told,
%% and the one that has started first is heard.
%% Holds: Of two robots of one number one is heard, and both are told
%% Red: d018c00: both took part
cloned(Config) ->
    #{dir := Dir} = Hosts = ?config(hosts, Config),
    _ = starl_fleet_hosts:on(2, "tar -cf " ++ Dir ++ "/copy.tar test/robot-2", Hosts),
    {0, _} = sh("tar -xf copy.tar && test/robot-2/current/bin/robot start", Hosts),
    Both =
        "10.77.0.2 port 5001 .life [0-9a-f]+. is taken, 10.77.0.100 port 5001 .life [0-9a-f]+. is",
    ok = until("robot 1 .*hears two robots that speak as robot 2: " ++ Both ++ " refused", Hosts),
    {0, _} = sh("test/robot-2/current/bin/robot stop", Hosts),
    ok = until_log(1, "one robot speaks as robot 2 again", Hosts),
    {0, Log} = deploy("logs 1", Hosts),
    ?assertMatch({match, [_]}, re:run(Log, "hears two robots", [global])),
    ok = both_hear(Hosts).

both_hear(Hosts) -> until("(robot [12] .*, hears 1 of 1 others.*\n){2}", Hosts).

%% How long it took until it was told, with the looks themselves, each of which is an ssh to each robot.
until(Pattern, Hosts) ->
    Begun = erlang:monotonic_time(millisecond),
    {ok, Said} = starl_fleet_hosts:until(
        "exec \"$starl\" deploy fleet.term status --watch 1", Pattern, Hosts
    ),
    Ms = erlang:monotonic_time(millisecond) - Begun,
    ct:pal("told after ~.1f s: ~ts~n~ts", [Ms / 1000, Pattern, Said]).

%% A look takes a second or so, on a fast computer half of that. Only what never comes runs out of looks.
-define(LOOKS, 60).

until_log(N, Pattern, Hosts) -> until_log(N, Pattern, ?LOOKS, Hosts).

until_log(N, Pattern, Looks, Hosts) ->
    {_, Said} = deploy("logs " ++ integer_to_list(N), Hosts),
    case re:run(Said, Pattern) of
        {match, _} -> ok;
        nomatch when Looks > 0 -> until_log(N, Pattern, Looks - 1, Hosts);
        nomatch -> error({never, Pattern, Said})
    end.

%% New code that crashes on trial: the robots are back at once, on the release before, and it is told why.
%% Holds: There is one way: a simulation's reload that crashes …: and a fleet's, too
%% Red: planted: its pattern asks for the words of a way back, which d7c73771 does not know
reload_goes_back(Config) ->
    Hosts = ?config(hosts, Config),
    Before = releases(Hosts),
    app(crashing, Hosts),
    {1, Said} = deploy("reload loop --trial 2", Hosts),
    told("robot [12], app .loop.: rolled back: the new code crashed: planted at loop:step/2", Said),
    contains("the robots run release", Said),
    ?assertEqual(Before, releases(Hosts)),
    ok = until("(robot [12] .*: loop runs, .*, hears 1 of 1 others.*\n){2}", Hosts).

%% New code of the application, while the robots run: they go on with their leader.
reloads(Config) ->
    Hosts = ?config(hosts, Config),
    app(second, Hosts),
    {0, _} = deploy("reload loop --trial 1", Hosts),
    ok = both_done(Hosts).

%% A release whose robots crash: all are back on the one before, and told why.
goes_back(Config) ->
    Hosts = ?config(hosts, Config),
    Before = releases(Hosts),
    app(planted, Hosts),
    {1, Said} = deploy("--trial 1", Hosts),
    contains("robot 1 (root@10.77.0.1): it is not well: ", Said),
    contains("planted at loop:step/2", Said),
    contains("the robots run release", Said),
    ?assertEqual(Before, releases(Hosts)).

%% The user goes back to the first release, and forward again.
rolls_back(Config) ->
    Hosts = ?config(hosts, Config),
    Before = releases(Hosts),
    {0, _} = deploy("rollback", Hosts),
    ?assertNotEqual(Before, releases(Hosts)),
    {0, _} = deploy("rollback", Hosts),
    ?assertEqual(Before, releases(Hosts)).

%% What a computer can have: no room, another key of ssh, no power.
refuses(Config) ->
    Hosts = ?config(hosts, Config),
    Before = releases(Hosts),
    _ = starl_fleet_hosts:on(2, "dd if=/dev/zero of=fill bs=1M 2>/dev/null", Hosts),
    refused("its disk is full", Hosts),
    _ = starl_fleet_hosts:on(2, "rm fill", Hosts),
    fleet(#{identity => "other"}, Hosts),
    refused("it does not take our ssh key; say once: ssh-copy-id root@10.77.0.2", Hosts),
    fleet(#{}, Hosts),
    ok = starl_fleet_hosts:unplug(2, Hosts),
    refused("it does not answer; is it switched on", Hosts),
    ok = starl_fleet_hosts:plug(2, Hosts),
    ?assertEqual(Before, releases(Hosts)).

refused(Why, Hosts) ->
    {1, Said} = deploy("--trial 1", Hosts),
    Lines = [Line || "starl: deploy: " ++ Line <- string:lexemes(Said, "\n")],
    ?assertMatch([_, "no robot has changed its release"], Lines),
    contains("robot 2 (root@10.77.0.2): " ++ Why, hd(Lines)).

%% The same by Erlang distribution over TLS: the robots hear each other.
over_tls(Config) ->
    Hosts = ?config(hosts, Config),
    case os:find_executable("openssl") of
        false ->
            {skip, "no openssl here: apt install openssl"};
        _ ->
            fleet(#{transport => dist}, Hosts),
            app(second, Hosts),
            {0, _} = sh("\"$starl\" keys fleet.term", Hosts),
            {0, _} = deploy("--trial 2", Hosts),
            ok = both_done(Hosts)
    end.

%% An election takes its time, during which the robots are well already. Both name one leader.
both_done(Hosts) ->
    until("is done: {second,([12])}.*\n.*is done: {second,\\1}", Hosts).

%% Holds: A node ends when the shell that watches it was killed
%% Red: 4b425d5c: it drives on, and nobody would start it anew
unwatched(Config) ->
    Hosts = ?config(hosts, Config),
    ok = kill_watcher(1, Hosts),
    until("robot 1 .*: the robot.s node does not answer", Hosts),
    %% it answers no more, and ends
    Wait =
        "n=0; while " ++ looks(1) ++
            " >/dev/null && [ $n -lt 300 ]; do n=$((n + 1)); sleep 0.1; done",
    "" = starl_fleet_hosts:on(1, Wait, Hosts),
    ?assertEqual("", nodes_of(1, Hosts)).

kill_watcher(N, Hosts) ->
    Daemon = "test/robot-" ++ integer_to_list(N) ++ "/state/daemon",
    "" = starl_fleet_hosts:on(N, "kill -KILL $(cat " ++ Daemon ++ ")", Hosts),
    ok.

%% The processes of its releases.
nodes_of(N, Hosts) -> starl_fleet_hosts:on(N, looks(N), Hosts).

looks(N) ->
    "pgrep -f -- \"[-]config .*/test/robot-" ++ integer_to_list(N) ++ "/releases/\"".

%% Holds: `deploy F stop' ends a node whose shell was killed, too
%% Red: 4b425d5c: `stopped', and the robot drives on
stops(Config) ->
    Hosts = ?config(hosts, Config),
    ?assertNotEqual("", nodes_of(2, Hosts)),
    ok = kill_watcher(2, Hosts),
    {0, _} = deploy("stop", Hosts),
    ?assertEqual("", nodes_of(2, Hosts)),
    {0, Said} = deploy("status", Hosts),
    contains("robot 2 (root@10.77.0.2): stopped", Said).

%% What the robots have recorded since they were started the last time.
recorded(Config) ->
    Hosts = ?config(hosts, Config),
    {0, Fetched} = deploy("fetch all", Hosts),
    [
        told("robot " ++ N ++ ": [1-9][0-9]* recordings?, .* MB, in all/robot-" ++ N, Fetched)
     || N <- ["1", "2"]
    ],
    {0, _} = sh(
        "for n in 1 2; do cp $(ls -t all/robot-$n/*.mcap | head -n 1) robot-$n; done", Hosts
    ),
    %% their clocks count from 1970: the day is told, and how long it took
    {0, Info} = sh("\"$starl\" info robot-1", Hosts),
    told("time    20..-..-.. ..:..:..\\.... to 20.* UTC, [0-9]{1,4}\\.[0-9]+ s\n", Info),
    {0, Merged} = sh("\"$starl\" merge robot-1 robot-2 --out both.mcap", Hosts),
    told("messages, [0-9]{1,4}\\.[0-9] s\n", Merged),
    {0, Judged} = sh("\"$starl\" judge both.mcap", Hosts),
    told(": loop, [0-9]{1,4}\\.[0-9] s, [1-9][0-9]* events judged\n", Judged),
    contains("not judged: motion: ", Judged),
    contains("no contract is broken", Judged).

told(Pattern, Said) -> ?assertMatch({match, _}, re:run(Said, Pattern), Said).

%% -- the fleet ------------------------------------------------------------------------------

deploy(Words, Hosts) -> sh("\"$starl\" deploy fleet.term " ++ Words, Hosts).

sh(Line, Hosts) ->
    {Status, Said} = starl_fleet_hosts:sh(Line, Hosts),
    ct:log("~ts~n~ts~n~b", [Line, Said, Status]),
    {Status, Said}.

contains(Part, Text) -> starl_first_hour_ct:contains(Part, Text).

releases(Hosts) ->
    {0, Status} = deploy("status", Hosts),
    {match, Releases} = re:run(Status, "release ([^,]+)", [global, {capture, all_but_first, list}]),
    ?assertMatch([_, _], Releases, Status),
    Releases.

%% `identity': that with which robot 2 is reached.
fleet(Changes, #{dir := Dir}) ->
    Robot = fun(N, Id) ->
        #{
            host => "10.77.0." ++ integer_to_list(N),
            user => "root",
            ssh => [
                "-F",
                "/dev/null",
                "-o",
                "ConnectTimeout=3",
                "-i",
                filename:join(Dir, Id),
                "-o",
                "IdentitiesOnly=yes",
                "-o",
                "StrictHostKeyChecking=accept-new",
                "-o",
                "UserKnownHostsFile=" ++ filename:join(Dir, "known")
            ]
        }
    end,
    Fleet = #{
        name => "test",
        app => "loop.erl",
        robots => #{1 => Robot(1, "id"), 2 => Robot(2, maps:get(identity, Changes, "id"))},
        transport => maps:get(transport, Changes, udp),
        home => filename:join(Dir, "disk"),
        service => plain
    },
    ok = file:write_file(filename:join(Dir, "fleet.term"), io_lib:format("~tp.~n", [Fleet])).

%% The robots elect a leader; then their ways part. The planted one crashes at once.
app(Way, #{dir := Dir}) ->
    {First, Then} =
        case Way of
            first -> {"ok", "ok = starl:sleep(Robot, 200), {continue, Led}"};
            second -> {"ok", "_ = starl:id(Robot), {done, {second, Leader}}"};
            crashing -> {"ok", "_ = starl:id(Robot), error(planted)"};
            planted -> {"error(planted)", "_ = starl:id(Robot), {continue, Led}"}
        end,
    ok = file:write_file(filename:join(Dir, "loop.erl"), [
        "-module(loop).\n-behaviour(starl_app).\n-export([blocks/0, init/2, step/2]).\n"
        "blocks() -> [starl_election].\n"
        "init(_Robot, _Options) -> elect.\n"
        "step(Robot, elect) ->\n"
        "    ",
        First,
        ",\n"
        "    case starl_election:elect(Robot, first) of\n"
        "        {ok, Leader} -> {continue, {led_by, Leader}};\n"
        "        {error, _} -> {continue, elect}\n"
        "    end;\n"
        "step(Robot, {led_by, Leader} = Led) ->\n"
        "    _ = {Leader, Led},\n    ",
        Then,
        ".\n"
    ]).
