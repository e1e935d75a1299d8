%% A sweep as jobs of Slurm, with daemons of this suite's own: their sockets, ports, keys and files lie in
%% a directory of its own, and a Slurm of this computer's is not asked. Each daemon ends with its port.
-module(starl_slurm_SUITE).
-include_lib("stdlib/include/assert.hrl").
-include_lib("common_test/include/ct.hrl").

-compile([export_all, nowarn_export_all]).

-define(SWEEP, "$starl sweep painting --picture house --robots 1..2 --seeds 3").

suite() -> [{timetrap, {minutes, 15}}].

all() -> [slices_are_jobs_and_what_is_missing_is_submitted_again].

init_per_suite(Config) ->
    Programs = ["munged", "slurmctld", "slurmd", "sbatch", "scancel", "scontrol"],
    Missing = [P || P <- Programs, program(P) =:= false],
    case {Missing, os:cmd("id -u")} of
        {[], "0\n"} ->
            %% A socket's name is short.
            Dir = string:trim(os:cmd("mktemp -d")),
            [{dir, Dir}, {daemons, daemons(Dir)} | Config];
        {[], _} ->
            {skip, "slurmd needs root"};
        {[P | _], _} ->
            {skip, "no " ++ P ++ " (packages slurmctld, slurmd, slurm-client, munge)"}
    end.

%% What runs a job outlives the daemon of its node: first the jobs end, then the daemons.
end_per_suite(Config) ->
    Dir = ?config(dir, Config),
    {0, _} = sh("scancel --user=root", Dir),
    ok = idle(Dir),
    lists:foreach(fun stopped/1, lists:reverse(?config(daemons, Config))),
    ok = file:del_dir_r(Dir).

idle(Dir) ->
    case sh("squeue --noheader", Dir) of
        {0, ""} -> ok;
        {0, _} -> idle(Dir)
    end.

%% One slice is cancelled before the partition begins to run jobs.
slices_are_jobs_and_what_is_missing_is_submitted_again(Config) ->
    Dir = ?config(dir, Config),
    {0, _} = sh(?SWEEP " --out one", Dir),
    {0, Told} = sh(?SWEEP " --out study --slurm 3", Dir),
    {match, [Array, Join]} = re:run(
        Told, "job (\\d+) makes 3 slices; job (\\d+) joins", [{capture, all_but_first, list}]
    ),
    {0, _} = sh("scancel " ++ Array ++ "_2", Dir),
    {0, _} = sh("scontrol update partition=main state=up", Dir),
    ok = ended(Join, Dir),
    Log = read("study/join.log", Dir),
    starl_first_hour_ct:contains("2 of 6 runs are missing", Log),
    {match, [Again]} = re:run(Log, "or submit them: (sbatch --array=2 .*)", [
        {capture, all_but_first, list}
    ]),
    {0, Second} = sh(string:replace(Again, "sbatch", "sbatch --parsable"), Dir),
    ok = ended(string:trim(Second), Dir),
    {0, _} = sh("$starl join study", Dir),
    ?assertEqual(read("one/runs.csv", Dir), read("study/runs.csv", Dir)),
    ?assertEqual(read("one/summary.csv", Dir), read("study/summary.csv", Dir)).

%% Another job, behind that one, opens a pipe: its end is told, not looked for.
ended(Job, Dir) ->
    {0, _} = sh(
        "rm -f pipe && mkfifo pipe && sbatch --parsable --output=/dev/null"
        " --dependency=afterany:" ++ Job ++ " --wrap 'echo ended >pipe' && cat pipe",
        Dir
    ),
    ok.

read(Name, Dir) ->
    {ok, Text} = file:read_file(filename:join(Dir, Name)),
    Text.

sh(Line, Dir) ->
    starl_first_hour_ct:sh(Line, Dir, [{"SLURM_CONF", filename:join(Dir, "slurm.conf")}]).

%% -- daemons --------------------------------------------------------------------------------

daemons(Dir) ->
    [ok = file:make_dir(filename:join(Dir, Name)) || Name <- ["state", "spool"]],
    In = fun(Name) -> filename:join(Dir, Name) end,
    ok = file:write_file(In("key"), crypto:strong_rand_bytes(64)),
    ok = file:change_mode(In("key"), 8#600),
    ok = file:write_file(In("slurm.conf"), conf(Dir)),
    Munged = daemon(
        "munged",
        ["--foreground", "--force"] ++
            [
                "--" ++ Option ++ "=" ++ In(File)
             || {Option, File} <- [
                    {"key-file", "key"},
                    {"socket", "munge.socket"},
                    {"pid-file", "munged.pid"},
                    {"log-file", "munged.log"},
                    {"seed-file", "munged.seed"}
                ]
            ],
        Dir
    ),
    Slurmctld = daemon("slurmctld", ["-D"], Dir),
    ok = answers(Dir),
    [Munged, Slurmctld, daemon("slurmd", ["-D", "-N", host()], Dir)].

conf(Dir) ->
    [C, D] = free_ports(2),
    Lines = [
        {"ClusterName", "one"},
        {"SlurmctldHost", host() ++ "(127.0.0.1)"},
        {"SlurmUser", "root"},
        {"SlurmdUser", "root"},
        {"AuthType", "auth/munge"},
        {"AuthInfo", "socket=" ++ filename:join(Dir, "munge.socket")},
        {"CredType", "cred/munge"},
        {"StateSaveLocation", filename:join(Dir, "state")},
        {"SlurmdSpoolDir", filename:join(Dir, "spool")},
        {"SlurmctldPidFile", filename:join(Dir, "slurmctld.pid")},
        {"SlurmdPidFile", filename:join(Dir, "slurmd.pid")},
        {"SlurmctldPort", integer_to_list(C)},
        {"SlurmdPort", integer_to_list(D)},
        {"ProctrackType", "proctrack/linuxproc"},
        {"TaskPlugin", "task/none"},
        {"JobAcctGatherType", "jobacct_gather/none"},
        {"AccountingStorageType", "accounting_storage/none"},
        {"MpiDefault", "none"},
        {"SelectType", "select/cons_tres"},
        {"SelectTypeParameters", "CR_Core"},
        {"ReturnToService", "2"},
        {"SchedulerParameters", "batch_sched_delay=0"},
        {"NodeName", host() ++ " NodeAddr=127.0.0.1 CPUs=2 State=UNKNOWN"},
        {"PartitionName", "main Nodes=ALL Default=YES MaxTime=INFINITE State=DOWN"}
    ],
    [[Key, $=, Value, $\n] || {Key, Value} <- Lines].

free_ports(N) ->
    Sockets = [
        Socket
     || _ <- lists:seq(1, N), {ok, Socket} <- [gen_tcp:listen(0, [{ip, {127, 0, 0, 1}}])]
    ],
    Ports = [Port || Socket <- Sockets, {ok, Port} <- [inet:port(Socket)]],
    [ok = gen_tcp:close(Socket) || Socket <- Sockets],
    Ports.

host() ->
    {ok, Name} = inet:gethostname(),
    hd(string:split(Name, ".")).

%% Each question waits for an answer for some seconds.
answers(Dir) ->
    case sh("scontrol ping", Dir) of
        {0, Text} ->
            case string:find(Text, "is UP") of
                nomatch -> answers(Dir);
                _ -> ok
            end;
        _ ->
            answers(Dir)
    end.

%% A process that holds a daemon: when it is told to stop, or dies with its VM, the shell's standard input
%% ends, and the daemon with it.
daemon(Name, Args, Dir) ->
    Self = self(),
    {Pid, Monitor} = spawn_monitor(fun() ->
        Port = open_port({spawn_executable, os:find_executable("sh")}, [
            {args, [
                "-c",
                "log=$1; shift; \"$@\" >$log 2>&1 </dev/null & read -r end; kill $!; wait",
                "sh",
                Name ++ ".log",
                program(Name)
                | Args
            ]},
            {cd, Dir},
            {env, [{"SLURM_CONF", filename:join(Dir, "slurm.conf")}]},
            exit_status
        ]),
        Self ! {self(), begun},
        receive
            stop -> Port ! {self(), {command, "\n"}}
        end,
        receive
            {Port, {exit_status, _}} -> ok
        end
    end),
    receive
        {Pid, begun} ->
            true = demonitor(Monitor, [flush]),
            Pid;
        {'DOWN', Monitor, process, Pid, Why} ->
            error({Name, Why})
    end.

stopped(Pid) ->
    Monitor = monitor(process, Pid),
    Pid ! stop,
    receive
        {'DOWN', Monitor, process, Pid, _} -> ok
    end.

program(Name) ->
    os:find_executable(Name, os:getenv("PATH") ++ ":/usr/sbin:/sbin").
