%% @doc `./starl hostile': attacks a team on a cluster by UDP, in one of three ways. One node gets hostile
%% datagrams of every kind ({@link starl_dev_hostile_flood}); then a node is killed again and again, while
%% the robots send each other numbers; or, with `--insider', a robot of the team is the attacker, in the
%% simulator ({@link starl_dev_insider}) and on a cluster ({@link starl_dev_insider_cluster}).
-module(starl_dev_hostile).
-behaviour(starl_cli_command).

-export([command/0]).

%% What a robot's node may have besides what it had early in the attack: atoms, and as many for each
%% module that was loaded since; messages under way.
-define(MOST_ATOMS, 50).
-define(MOST_BYTES, 64_000_000).

%% The longest time of a life after its first acknowledged message, and the pause between two looks.
-define(LIFE_MS, 400).
-define(LOOK_MS, 50).
%% Looks before a robot counts as unheard: two minutes.
-define(LOOKS, 2400).

%% Messages of each block from an attacker on a cluster.
-define(MESSAGES, 100).

-type answer() :: ok | {wrong, [unicode:chardata()]} | {error, [unicode:chardata()]}.

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "hostile",
        synopsis => "attack a robot's node while it paints",
        about => [
            "A team paints a picture, a node for each robot, by UDP. Meanwhile one node gets hostile "
            "datagrams at its port: noise, genuine ones truncated, changed and played again, of other "
            "keys, runs and fleets; and with the right key: compressed bombs, new atoms, absurd fields. "
            "The picture is painted until all datagrams have been sent. It must be complete each time; "
            "no contract may be violated, no machine crash, no robot be unheard after it, and nothing "
            "be taken but absurd packets that are sealed and well formed. Atoms and memory of the node "
            "stay as they are.",
            "With --kills the node of one robot is then killed (SIGKILL) so many times, while all robots "
            "send each other numbers: none may be acknowledged and not delivered, nobody unheard.",
            "With --insider, instead of all this, a robot of the team is the attacker: it has the key, and sends "
            "in its own name all that the machines of each block accept at its extremes: largest numbers, longest "
            "names, most entries. First in the simulator, block by block, then on a cluster by UDP, which is "
            "played without the attack, too. When the attack is over each block must work, again after all robots "
            "have restarted with their stores, and again with a new key; no machine may crash, and "
            "memory stays as it is."
        ],
        flags => fun flags/1,
        statuses => [{0, "borne"}, {3, "not borne"}, {130, "interrupted"}],
        run => fun run/1
    }.

flags(_Subject) ->
    [
        {"Flags", [
            {packets, {integer, 0, 1000000000}, 1000000, "hostile datagrams; 0: none"},
            {kills, {integer, 0, 1000}, 0, "kills of a node"},
            {insider, switch, false, "a robot of the team attacks"},
            {block, {one_of, [all | starl_dev_insider:blocks()]}, all,
                "with --insider: one block, in the simulator alone"},
            {apart, switch, false, "with --block: each kind of message apart"},
            {robots, {integer, 3, 20}, 3, "the size of the team"},
            {picture, string, "lines", "a shipped picture"},
            {speed, {number, 0.1, 20}, 4, "how many times as fast as real time"},
            {seed, {integer, 0, 1 bsl 32}, 1, "of the datagrams, the robot and the kills"}
        ]}
    ].

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{values := #{insider := true} = Values}) ->
    ok = starl_cli_log:install(),
    _ = process_flag(trap_exit, true),
    status(insider(Values));
run(#{values := #{packets := Packets, kills := Kills} = Values}) ->
    ok = starl_cli_log:install(),
    _ = process_flag(trap_exit, true),
    ok = code:ensure_modules_loaded(modules()),
    case rounds(Packets, 1, Values) of
        ok when Kills > 0 -> status(kills(Values));
        Answer -> status(Answer)
    end.

-spec status(answer()) -> starl_cli_command:answer().
status(ok) ->
    0;
status({wrong, Lines}) ->
    starl_cli_terminal:out([["WRONG: ", Line, "\n"] || Line <- Lines]),
    3;
status({error, _} = Error) ->
    Error.

%% -- hostile datagrams ----------------------------------------------------------------------

%% All atoms that a node needs in these datagrams, and the code that it runs.
modules() ->
    [
        starl_dev_hostile_packets,
        starl_dev_hostile_absurd,
        starl_dev_hostile_flood,
        starl_hostile_painting,
        starl_hostile_traffic
    ].

%% The picture is painted again until all datagrams have been sent.
rounds(0, _Round, _Values) ->
    ok;
rounds(Left, Round, Values) ->
    case with_dir(fun(Dir) -> painted(Dir, Left, Round, Values) end) of
        {ok, Sent} -> rounds(Left - Sent, Round + 1, Values);
        Problem -> Problem
    end.

painted(Dir, Left, Round, #{robots := Robots, picture := Name, speed := Speed, seed := Seed}) ->
    Picture = filename:join([code:priv_dir(starl_apps), "pictures", Name ++ ".svg"]),
    Scenario = #{
        app => starl_hostile_painting, robots => Robots, picture => Picture, seed => Seed + Round
    },
    Options = #{dir => Dir, transport => udp, speed => Speed, log => fun starl_cli_log:node/3},
    case starl_world_run:start(Scenario, Options) of
        {ok, Cluster} ->
            Victim = 1 + (Seed + Round) rem Robots,
            attacked(Cluster, Victim, Dir, Left, Seed + Round);
        {error, Reason} ->
            {error, [starl_world_run:format_error(Reason)]}
    end.

packets(Victim, Robots, Node, Line, Seed) ->
    starl_dev_hostile_packets:new(#{
        line => Line,
        robot => Victim,
        participants => lists:seq(1, Robots),
        lives => starl_dev_hostile_flood:lives(Node),
        kinds =>
            starl_dev_hostile_packets:outsiders() ++ starl_dev_hostile_packets:insiders() ++
            [absurd, shaped],
        seed => Seed
    }).

attacked(Cluster, Victim, Dir, Left, Seed) ->
    #{robots := Robots} = starl_world_run:scenario(Cluster),
    {ok, #{node := Node, transport := {_, Line}}} = starl_world_run:place(Cluster, Victim),
    #{peers := #{Victim := {_, Port}}} = Line,
    Packets = packets(Victim, Robots, Node, Line, Seed),
    Begun = erlang:monotonic_time(millisecond),
    Flood = starl_dev_hostile_flood:start(#{node => Node, port => Port, packets => Packets}, Left),
    starl_cli_signal:on_interrupt(fun() -> spawn(fun() -> starl_world_run:stop(Cluster) end) end),
    Ending = starl_world_run:await(Cluster),
    Flooded = starl_dev_hostile_flood:finish(Flood),
    #{restarts := Restarts} = starl_world_run:status(Cluster),
    {Outcome, Report} = starl_world_run:finish(Cluster),
    Facts = facts(Dir, lists:seq(1, Robots)),
    Seen = #{
        victim => Victim,
        ms => erlang:monotonic_time(millisecond) - Begun,
        ending => Ending,
        flood => Flooded,
        restarts => lists:sum(maps:values(Restarts)),
        outcome => Outcome,
        report => Report,
        facts => Facts
    },
    printed(Seen),
    judged(Seen).

printed(#{victim := Victim, ms := Ms, flood := Flood, outcome := #{end_us := Us}} = Seen) ->
    #{sent := Sent, figures := Figures, before := Before, later := Later} = Flood,
    #{monitors := #{starl_sap_monitor := Sap}} = maps:get(outcome, Seen),
    {Atoms, Bytes, _} = Later,
    {NewAtoms, NewBytes, Modules} = growth(Before, Later),
    starl_cli_terminal:out(
        "robot ~b: ~b hostile datagrams in ~.1f s (~.1f s of the run), ~b refused, ~b packets heard\n"
        "  sent: ~ts\n  refused: ~ts\n  absurd packets dropped by its machines: ~b\n",
        [Victim, total(Sent), Ms / 1000, Us / 1.0e6] ++
            [total(refusals(Figures)), maps:get(heard, Figures, 0)] ++
            [listed(Sent), listed(refusals(Figures))] ++
            [length([x || {_, _, _, {dropped, _, _}} <- own(Seen)])]
    ),
    Loaded = lists:join(" ", [atom_to_list(Module) || Module <- Modules]),
    starl_cli_terminal:out(
        "  atoms ~b, ~b new (loaded meanwhile: ~ts); memory ~.1f MB, ~.1f more\n"
        "  messages of the team: ~b sent, ~b acknowledged, ~b lost\n",
        [Atoms, NewAtoms, Loaded, Bytes / 1.0e6, NewBytes / 1.0e6] ++
            [maps:get(Key, Sap) || Key <- [sent, acknowledged, lost]]
    ).

total(Counts) -> lists:sum(maps:values(Counts)).

listed(Counts) ->
    lists:join(", ", [io_lib:format("~ts ~b", [What, N]) || {What, N} <- maps:to_list(Counts)]).

refusals(Figures) ->
    maps:without([sent, datagrams, heard, air_lost, air_full, send_error, socket_error], Figures).

own(#{victim := Victim, facts := Facts}) -> maps:get(Victim, Facts).

judged(#{flood := #{sent := Sent}} = Seen) ->
    case [Line || {false, Line} <- checks(Seen)] of
        [] -> {ok, total(Sent)};
        Lines -> {wrong, Lines}
    end.

checks(#{ending := Ending, outcome := Outcome, report := Report, facts := Facts} = Seen) ->
    #{flood := #{before := Before, later := Later, genuine := Genuine}} = Seen,
    #{violations := Violations, robots := Robots} = Outcome,
    Marked = [x || {_, _, _, {unheard, _, Type}} <- own(Seen), is_mark(Type)],
    Crashed = [F || {_, _, _, crashed} = F <- lists:append(maps:values(Facts))],
    Unheard = [R || {_, #{result := Result}} = R <- Robots, Result =/= {done, complete}],
    {Atoms, Bytes, Modules} = growth(Before, Later),
    [
        {Ending =:= done, io_lib:format("the run ended: ~ts", [Ending])},
        {maps:get(complete, Report, false), "the picture is not complete"},
        {Violations =:= [], [starl_violation:format(V) || V <- Violations]},
        {Unheard =:= [], io_lib:format("robots and their results: ~0tp", [results(Unheard)])},
        {Crashed =:= [], io_lib:format("crashed: ~0tp", [Crashed])},
        {maps:get(restarts, Seen) =:= 0, "a node has ended"},
        {
            length(Marked) =< Genuine,
            io_lib:format("~b packets taken, ~b were genuine", [length(Marked), Genuine])
        },
        {Atoms =< ?MOST_ATOMS * length([robot | Modules]), io_lib:format("~b new atoms", [Atoms])},
        {Bytes =< ?MOST_BYTES, io_lib:format("~b more bytes of memory", [Bytes])}
    ].

is_mark(Type) -> Type =:= starl_dev_hostile_packets:mark().

results(Robots) -> [{Id, Result} || {Id, #{result := Result}} <- Robots].

growth(none, _Later) ->
    {0, 0, []};
growth({Atoms, Bytes, Modules}, {MoreAtoms, MoreBytes, MoreModules}) ->
    {MoreAtoms - Atoms, MoreBytes - Bytes, MoreModules -- Modules}.

%% -- kills ----------------------------------------------------------------------------------

%% Kills the node of one robot at random instants. The monitor of SAP judges whether a message was
%% acknowledged and not delivered. Afterwards every robot must be acknowledged by every other.
-spec kills(#{kills := pos_integer(), robots := pos_integer(), seed := integer(), atom() => term()}) ->
    answer().
kills(Values) ->
    %% the cases tell Dialyzer which of the results of `with_dir' these are
    case with_dir(fun(Dir) -> kills(Dir, Values) end) of
        ok -> ok;
        {wrong, _} = Wrong -> Wrong;
        {error, _} = Error -> Error
    end.

kills(Dir, #{robots := Robots, seed := Seed, speed := Speed} = Values) ->
    Scenario = #{app => starl_hostile_traffic, robots => Robots, seed => Seed, time => 40000},
    Options = #{dir => Dir, transport => udp, speed => Speed, log => fun starl_cli_log:node/3},
    case starl_world_run:start(Scenario, Options) of
        {ok, Cluster} -> killed(Cluster, Dir, Values);
        {error, Reason} -> {error, [starl_world_run:format_error(Reason)]}
    end.

killed(Cluster, Dir, #{robots := Robots, kills := Kills, seed := Seed}) ->
    Victim = 1 + Seed rem Robots,
    Begun = erlang:monotonic_time(millisecond),
    starl_cli_signal:on_interrupt(fun() -> spawn(fun() -> starl_world_run:stop(Cluster) end) end),
    Kill = fun(N, Unheard) -> Unheard orelse kill(Cluster, Victim, Dir, N, Seed) end,
    Unheard = lists:foldl(Kill, false, lists:seq(1, Kills)),
    Deaf = [{From, To} || not Unheard, {From, To} <- pairs(Robots), not hears(From, To, Dir)],
    #{now_us := Us, restarts := #{Victim := Restarts}} = starl_world_run:status(Cluster),
    ok = starl_world_run:stop(Cluster),
    {#{violations := Violations, monitors := #{starl_sap_monitor := Sap}}, _} =
        starl_world_run:finish(Cluster),
    starl_cli_terminal:out(
        "robot ~b: killed and started anew ~b times in ~.1f s (~.1f s of the run)\n"
        "  messages: ~b sent, ~b delivered, ~b acknowledged, ~b lost; violations: ~b\n",
        [Victim, Restarts, (erlang:monotonic_time(millisecond) - Begun) / 1000, Us / 1.0e6] ++
            [maps:get(Key, Sap) || Key <- [sent, delivered, acknowledged, lost]] ++
            [length(Violations)]
    ),
    wrong([
        {not Unheard, io_lib:format("robot ~b is not heard any more", [Victim])},
        {Deaf =:= [], io_lib:format("not acknowledged (from, to): ~0tp", [Deaf])},
        {Violations =:= [], [starl_violation:format(V) || V <- Violations]}
    ]).

wrong(Checks) ->
    case [Line || {false, Line} <- Checks] of
        [] -> ok;
        Lines -> {wrong, Lines}
    end.

pairs(Robots) ->
    Ids = lists:seq(1, Robots),
    [{From, To} || From <- Ids, To <- Ids, From =/= To].

%% Kills the node some time after its present life has had a message acknowledged. True: it has none
%% for minutes.
kill(Cluster, Victim, Dir, N, Seed) ->
    case looks(?LOOKS, fun() -> is_heard(Victim, N, Dir) end) of
        true ->
            {Ms, _} = rand:uniform_s(?LIFE_MS, rand:seed_s(exsss, {Seed, N, Victim})),
            ok = pause(Ms),
            ok = starl_world_run:inject(Cluster, [{reboot, Victim, #{}, 0}]),
            starl_cli_progress:note(io_lib:format("kill ~b", [N])),
            false;
        false ->
            true
    end.

%% In its Nth life the robot has heard and been heard.
is_heard(Robot, N, Dir) ->
    {Lives, Facts} = last_facts(Dir, Robot),
    Lives >= N andalso
        lists:any(fun is_acknowledged/1, Facts) andalso lists:any(fun is_delivered/1, Facts).

is_acknowledged({_, _, sap, {outcome, _, _, acknowledged}}) -> true;
is_acknowledged(_) -> false.

is_delivered({_, _, sap, {delivered, _, _, _}}) -> true;
is_delivered(_) -> false.

%% Acknowledged from now on. Robots that were not killed have one long life.
hears(From, To, Dir) ->
    {_, Before} = last_facts(Dir, From),
    Last = lists:max([0 | acknowledged(To, Before)]),
    looks(?LOOKS, fun() ->
        {_, Facts} = last_facts(Dir, From),
        lists:any(fun(At) -> At > Last end, acknowledged(To, Facts))
    end).

acknowledged(By, Facts) -> [At || {At, _, sap, {outcome, _, R, acknowledged}} <- Facts, R =:= By].

looks(0, _Seen) ->
    false;
looks(Left, Seen) ->
    Seen() orelse
        begin
            ok = pause(?LOOK_MS),
            looks(Left - 1, Seen)
        end.

pause(Ms) ->
    receive
    after Ms -> ok
    end.

%% -- a robot of the team --------------------------------------------------------------------

%% Attacks all blocks, or one.
-spec insider(#{atom() => term()}) -> answer().
insider(#{block := all, seed := Seed} = Values) ->
    starl_cli_terminal:out(["In the simulator, seed ", integer_to_list(Seed), ":\n"]),
    Wrong = simulated(starl_dev_insider:blocks(), Values),
    starl_cli_terminal:out("\nOn a cluster, by UDP:\n"),
    verdict(Wrong ++ on_cluster(Values));
insider(#{block := Block, apart := false} = Values) ->
    verdict(simulated([Block], Values));
insider(#{block := Block, apart := true} = Values) ->
    verdict(apart(Block, Values)).

verdict([]) -> ok;
verdict(Wrong) -> {wrong, Wrong}.

simulated(Blocks, Values) ->
    starl_cli_terminal:out(starl_dev_insider:header()),
    lists:append([
        row(atom_to_list(Block), starl_dev_insider:run(Block, Options))
     || Block <- Blocks, Options <- starl_dev_insider:runs(of_insider(Values))
    ]).

apart(Block, Values) ->
    Options = of_insider(Values),
    starl_cli_terminal:out(starl_dev_insider:header()),
    lists:append([
        row(io_lib:format("~0tp", [Kind]), starl_dev_insider:run(Block, Options#{only => [Kind]}))
     || Kind <- starl_dev_insider:kinds(Block, Options),
        ok =:= starl_cli_terminal:out(io_lib:format("~0tp~n", [Kind]))
    ]).

row(What, Row) ->
    starl_cli_terminal:out(starl_dev_insider:format(Row)),
    [["the simulator: ", What] || not starl_dev_insider:is_borne(Row)].

of_insider(#{robots := Robots, seed := Seed}) -> #{robots => max(4, Robots), seed => Seed}.

on_cluster(#{speed := Speed} = Values) ->
    Options = (of_insider(Values))#{
        speed => Speed, messages => ?MESSAGES, log => fun starl_cli_log:node/3
    },
    lists:append([
        team(Team, Options#{attack => Attack})
     || Team <- starl_dev_insider_cluster:teams(), Attack <- [false, true]
    ]).

team(Team, Options) ->
    Row = with_dir(fun(Dir) ->
        starl_dev_insider_cluster:run(Team, Options, Dir)
    end),
    starl_cli_terminal:out(starl_dev_insider_cluster:format(Row)),
    Names = lists:join(", ", [atom_to_list(Block) || Block <- Team]),
    [["the cluster: ", Names] || not starl_dev_insider_cluster:is_borne(Row)].

%% -- the directory of a cluster -------------------------------------------------------------

%% Does something with a directory that is gone afterwards.
-spec with_dir(fun((file:filename()) -> Result)) -> Result.
with_dir(Do) ->
    ok = starl_private_dir:clean("hostile"),
    {ok, Dir} = starl_private_dir:new("hostile"),
    try
        Do(Dir)
    after
        starl_private_dir:remove(Dir)
    end.

%% The facts of these robots, of all their lives.
-spec facts(file:filename(), [starl:robot_id()]) ->
    #{starl:robot_id() => [starl_monitor:trace_event()]}.
facts(Dir, Robots) ->
    maps:from_list([{R, lists:append([read(File) || File <- files(Dir, R)])} || R <- Robots]).

%% The facts of a robot's last life.
-spec last_facts(file:filename(), starl:robot_id()) ->
    {Lives :: non_neg_integer(), [starl_monitor:trace_event()]}.
last_facts(Dir, Robot) ->
    case files(Dir, Robot) of
        [] -> {0, []};
        Files -> {length(Files), read(lists:last(Files))}
    end.

files(Dir, Robot) ->
    starl_live_record:starts(filename:join(Dir, "robot-" ++ integer_to_list(Robot))).

read(File) -> starl_live_record:read(File, 0).
