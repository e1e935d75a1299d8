%% The commands of a deployment: those of --dry-run, word for word (fleet_dry_run.txt).
-module(starl_fleet_steps_tests).
-include_lib("eunit/include/eunit.hrl").

-define(GOLDEN, "fleet_dry_run.txt").

%% Whatever a deployment says to a shell is meant: compare, then change the file.
dry_run_test() ->
    Lines = starl_fleet_deploy:dry_run(fleet(), plan(restart)),
    {ok, Golden} = file:read_file(golden()),
    ?assertEqual(
        string:split(Golden, "\n", all),
        [unicode:characters_to_binary(Line) || Line <- Lines] ++ [<<>>]
    ).

golden() ->
    Here = proplists:get_value(source, ?MODULE:module_info(compile)),
    Beside = filename:join(filename:dirname(code:which(?MODULE)), ?GOLDEN),
    hd([F || F <- [Beside, filename:join(filename:dirname(Here), ?GOLDEN)], filelib:is_regular(F)]).

%% A reload starts nothing anew and copies no keys.
reload_test() ->
    ?assertEqual(
        [look, room, copy, check, may_reload, reload, health, tidy],
        [Stage || {Stage, _} <- starl_fleet_steps:deploy(fleet(), plan(reload), [])]
    ).

%% A robot takes its trial time in milliseconds where it reloads, and in seconds where its health is asked for.
the_trial_time_is_told_in_the_unit_of_each_command_test() ->
    Words = fun(Stage) ->
        {_, [{1, Line} | _]} = lists:keyfind(
            Stage, 1, starl_fleet_steps:deploy(fleet(), plan(reload), [])
        ),
        [_, Said] = string:split(Line, "/bin/robot "),
        Said
    end,
    ?assertEqual({"reload switch 5000'", "health 60 5'"}, {Words(reload), Words(health)}).

build_there_test() ->
    Stages = [
        S
     || {S, _} <- starl_fleet_steps:deploy(fleet(), (plan(restart))#{kind => source}, [])
    ],
    ?assertEqual([keys, build, check], lists:sublist(Stages, 4, 3)).

%% A robot names its recordings; each comes with the length that it has said.
fetch_test() ->
    [{1, Asked}, {2, _}] = starl_fleet_steps:recorded(fleet()),
    ?assertEqual(
        "ssh -o BatchMode=yes -o ConnectTimeout=10 -n starl@robot1.lab "
        "'cd starl/lab/robot-1/state/recordings 2>/dev/null && wc -c -- *.mcap 2>/dev/null || true'",
        Asked
    ),
    ?assertEqual(
        "ssh -o BatchMode=yes -o ConnectTimeout=10 -n starl@robot1.lab "
        "'head -c 7 -- starl/lab/robot-1/state/recordings/a.mcap' | head -c 7 >'of all/a.mcap'",
        starl_fleet_steps:copied(1, fleet(), "of all", [{"a.mcap", 7}])
    ).

by_tar_test() ->
    State = {fleet(), plan(restart)},
    ?assertEqual(
        "tar -C /w/_build/1-a -cf - . | ssh -o BatchMode=yes -o ConnectTimeout=10 starl@robot1.lab "
        "'mkdir -p starl/lab/robot-1/releases/1-a && tar -xf - -C starl/lab/robot-1/releases/1-a'",
        starl_fleet_steps:copy_by_tar(copy, 1, State)
    ),
    ?assertEqual(
        "tar -cf - -C /w/keys fleet.key -C /w/keys ca.pem -C /w/keys tls.config "
        "-C /w/keys/robot-1 robot.key -C /w/keys/robot-1 robot.pem | "
        "ssh -o BatchMode=yes -o ConnectTimeout=10 starl@robot1.lab "
        "'tar -xf - -C starl/lab/robot-1/keys'",
        starl_fleet_steps:copy_by_tar(keys, 1, State)
    ).

%% Certificates and a VM with distribution are for that transport alone: another one needs the fleet's key.
only_distribution_has_certificates_test() ->
    Needs = fun(Transport) ->
        Fleet = (fleet())#{transport := Transport},
        {
            starl_fleet_steps:copy_by_tar(keys, 1, {Fleet, plan(restart)}),
            iolist_to_binary(starl_fleet_net:vm_args(Fleet))
        }
    end,
    {Copied, <<>>} = Needs(a_new_one),
    ?assertNotEqual(nomatch, string:find(Copied, " -C /w/keys fleet.key |")),
    [?assertEqual({Copied, <<>>}, Needs(T)) || T <- starl_fleet_adapters:transports() -- [dist]].

%% Words reach the shell as they are.
quoted_test() ->
    Words = ["plain", "it's", "$(reboot)", "a b", "\"", "\\"],
    [
        ?assertEqual(Word ++ "\n", os:cmd("printf '%s\\n' " ++ starl_fleet_steps:quoted(Word)))
     || Word <- Words
    ].

fleet() ->
    {ok, Fleet} = starl_fleet_file:check(
        "/w/f.term",
        #{
            name => "lab",
            app => starl_exercise,
            transport => dist,
            robots => #{
                1 => #{host => "robot1.lab", user => "starl"},
                2 => #{host => "10.0.0.2", ssh => ["-p", "2222", "-i", "my key"]}
            }
        },
        starl_exercise
    ),
    Fleet.

plan(Mode) ->
    #{release => "/w/_build/1-a", keys => "/w/keys", kind => ours, mode => Mode, trial_s => 5}.
