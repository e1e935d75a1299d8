%% @doc `./starl hostile': attacks a team that paints on a cluster by UDP. One node gets hostile datagrams of every
%% kind, or a node is killed again and again.
-module(starl_dev_hostile).
-behaviour(starl_cli_command).

-export([command/0]).

%% What a robot's node may have besides what it had early in the attack: atoms, and as many for each
%% module that was loaded since; messages under way.
-define(MOST_ATOMS, 50).
-define(MOST_BYTES, 64_000_000).

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
    status(starl_dev_insider_report:run(Values));
run(#{values := #{packets := Packets, kills := Kills} = Values}) ->
    ok = starl_cli_log:install(),
    _ = process_flag(trap_exit, true),
    ok = code:ensure_modules_loaded(modules()),
    case rounds(Packets, 1, Values) of
        ok when Kills > 0 -> status(starl_dev_hostile_kills:run(Values));
        Answer -> status(Answer)
    end.

status(ok) ->
    0;
status({wrong, Lines}) ->
    starl_cli_terminal:out([["WRONG: ", Line, "\n"] || Line <- Lines]),
    3;
status({error, _} = Error) ->
    Error.

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
    case starl_dev_hostile_run:with_dir(fun(Dir) -> painted(Dir, Left, Round, Values) end) of
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
    Facts = starl_dev_hostile_run:facts(Dir, lists:seq(1, Robots)),
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
    told(Seen),
    judged(Seen).

%% -- words ----------------------------------------------------------------------------------

told(#{victim := Victim, ms := Ms, flood := Flood, outcome := #{end_us := Us}} = Seen) ->
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

%% -- judging --------------------------------------------------------------------------------

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
