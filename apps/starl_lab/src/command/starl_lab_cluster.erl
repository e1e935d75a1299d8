%% @doc The command `./starl cluster': runs an application with a node for each robot, and sends
%% commands to a running cluster.
-module(starl_lab_cluster).
-behaviour(starl_cli_command).

-export([command/0]).

%% The part of a run in which chaos begins.
-define(CHAOS_US, {5000000, 45000000}).

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "cluster",
        synopsis => "a node for each robot, in real time",
        argument => {required, "TARGET", {example, "painting"}},
        subject => fun subject/2,
        about => fun about/1,
        flags => fun flags/1,
        statuses => maps:get(statuses, starl_lab_run:command()),
        run => fun run/1
    }.

about(none) ->
    [
        "Runs the robots of TARGET (as of ./starl run) in real time: an Erlang node, a process of "
        "the operating system, for each, in a simulated world. A node that ends or hangs is started "
        "anew, and its robot rejoins.",
        {list, "While it runs, from another terminal", meanwhile()},
        "./starl cluster TARGET --help lists the flags of TARGET."
    ];
about(_Subject) ->
    [].

meanwhile() ->
    [
        {"cluster status", "the time, the robots, their nodes"},
        {"cluster kill N", "kills the node of robot N; it is started anew"},
        {"cluster pause N SECONDS", "the node of robot N stands still for a time, then goes on"},
        {"cluster lose-store N", "kills the node of robot N; it is started anew without its store"},
        {"cluster set-back N",
            "kills the node of robot N; it is started anew with its store as it was before its "
            "last start"},
        {"cluster cut N M", "robots N and M do not hear each other"},
        {"cluster freeze N", "robot N gets no new positions"},
        {"cluster fill N",
            "the disk of robot N is full: its store and recording cannot be written"},
        {"cluster unplug N", "the cable of robot N's Create is pulled"},
        {"cluster sense N SENSE HOW",
            "a sense of robot N, or all, is gone, frozen, noisy, wrong, or well again"},
        {"cluster heal",
            "undoes all cuts, freezes, pauses and faults of senses, clears the disks, puts all cables back"},
        {"cluster reload CODE",
            "new code for all robots: an application, FILE.erl or a module; what fails within 5 s "
            "is rolled back everywhere"},
        {"cluster stop", "ends the run"}
    ].

flags(none) ->
    [];
flags({control, _}) ->
    [{"Flags", [{pid, {optional, {integer, 1, 1 bsl 31}}, none, "of several clusters, this one"}]}];
flags(#{app := App, name := Name}) ->
    Own = [{["Flags of ", Name], starl_app:options(App)}],
    [Group || {_, [_ | _]} = Group <- Own] ++
        [
            {"Flags of the cluster", own()},
            {"Flags of every simulation", lists:keydelete(speed, 1, starl_run_scenario:options())},
            {"Other flags", other()}
        ].

own() ->
    [
        transport(),
        {speed, {number, 0.01, 100}, 1, "how many times as fast as real time"},
        {metrics, {optional, {integer, 1, 65000}}, none,
            "robot N serves http://127.0.0.1:PORT/metrics for Prometheus, PORT being this plus N"}
        | disturbances() ++ [runs()] ++ lists:keydelete(pace, 1, starl_lab_live:flags()) ++
            lists:keydelete(record, 1, starl_lab_recording:flags()) ++ starl_lab_window:flags()
    ].

transport() ->
    Transports = starl_world_setup:transports(),
    Texts = [atom_to_list(Name) ++ ": " ++ Text || {Name, Text} <- Transports],
    {transport, {one_of, [Name || {Name, _} <- Transports]}, dist,
        lists:append(lists:join("; ", Texts))}.

runs() -> {runs, {integer, 1, 1000}, 1, "runs, one after the other, each with the next seed"}.

disturbances() ->
    [
        {chaos, switch, false,
            "kills two nodes, the leader's among them, halts one, cuts a link, freezes the positions "
            "of a robot, fills the disk of one and takes or spoils the senses of one for a while, at "
            "times drawn from the seed"},
        {unplug, {integer, 0, 1000}, 0,
            "pulls the cable of a Create and puts it back a second later, so many times, every 4 s; "
            "that of a Create 2, which would drive on, when it stands"},
        {halts, {integer, 0, 1000}, 0,
            "halts a node in the middle of what it does for 1 to 2 s of the computer, so many times, "
            "every 10 s of the run"},
        {lost_stores, {integer, 0, 1000}, 0,
            "kills a node, which is started anew without its store, or with an old one, so many "
            "times, every 10 s of the run"},
        {full_disks, {integer, 0, 1000}, 0,
            "fills the disk of a robot for 5 s of the run, so many times, every 10 s"}
    ].

other() ->
    Wanted = [out, overwrite, quiet],
    [Flag || Flag <- starl_lab_setup:own_flags(), lists:member(element(1, Flag), Wanted)].

-spec subject(string(), [string()]) ->
    {ok, starl_cli_command:subject(), [string()]} | {error, [unicode:chardata(), ...]}.
subject(Word, Args) ->
    case starl_cluster_command:words(Word) of
        none ->
            starl_cli_target:subject(Word, Args);
        Arity ->
            {Words, Rest} = lists:split(min(Arity, length(Args)), Args),
            {ok, {control, [Word | [path(W) || W <- Words]]}, Rest}
    end.

%% The cluster may run in another directory.
path(Word) ->
    case filename:extension(Word) of
        ".erl" -> filename:absname(Word);
        _ -> Word
    end.

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{subject := {control, Words}, values := #{pid := Pid}}) ->
    case starl_cluster_command:ask(Words, Pid) of
        {ok, Text} ->
            starl_cli_terminal:out(Text),
            0;
        {error, Why} ->
            {error, [Why]}
    end;
run(#{values := #{runs := Runs} = Values} = Call) ->
    %% the flags of the cluster are no values of the scenario
    Own = [Key || {Key, _, _, _} <- own()],
    Given = maps:without(Own, maps:get(given, Call)),
    Checked = Call#{given := Given, values := Values#{print_scenario => false}},
    case starl_lab_setup:check(Checked) of
        {ok, Setup} -> runs({1, Runs}, 0, Setup, Values);
        {error, _} = Error -> Error
    end.

%% The first problem ends the runs.
runs({N, Runs}, Status, _Setup, _Values) when N > Runs; Status =/= 0 ->
    Status;
runs({N, Runs}, 0, #{scenario := #{seed := Seed} = Scenario} = Setup, Values) ->
    #{transport := Transport, speed := Speed} = Values,
    Live = {nodes, Transport, chaos(Scenario, Values) ++ drawn(Scenario, Values)},
    Own = out({N, Runs}, Values, Setup),
    case starl_lab_live:run(Live, Own, Values#{pace => Speed}) of
        {error, _} = Error ->
            Error;
        Status ->
            Next = Setup#{scenario := Scenario#{seed := Seed + 1}},
            runs({N + 1, Runs}, Status, Next, Values)
    end.

%% Of several runs each has a directory of its own, in that of `--out'.
out({_N, 1}, _Values, Setup) ->
    Setup;
out(_Which, #{out := none}, Setup) ->
    Setup;
out({N, _Runs}, #{out := Dir}, #{target := #{name := Name}} = Setup) ->
    case starl_cli_out:plan(filename:join(Dir, integer_to_list(N)), Name) of
        {ok, Plan} -> Setup#{out := Plan};
        {error, _} -> Setup
    end.

chaos(_Scenario, #{chaos := false}) ->
    [];
chaos(#{robots := Robots, seed := Seed}, #{chaos := true}) ->
    starl_cluster_chaos:draw(Seed, lists:seq(1, Robots), ?CHAOS_US).

drawn(#{robots := Robots, seed := Seed}, Values) ->
    #{unplug := Cables, halts := Halts, lost_stores := Stores, full_disks := Full} = Values,
    Ids = lists:seq(1, Robots),
    starl_cluster_chaos:cables(Seed, Ids, Cables) ++
        starl_cluster_chaos:halts(Seed, Ids, Halts) ++
        starl_cluster_chaos:stores(Seed, Ids, Stores) ++
        starl_cluster_chaos:full_disks(Seed, Ids, Full).
