%% ./starl soak, planted and faults: what they print and how they end.
-module(starl_lab_soak_tests).
-include_lib("eunit/include/eunit.hrl").

-import(starl_cli_vm, [says/3, contains/2, narrow/1]).

-define(PATIENCE_S, 60).

commands_test_() ->
    patient([
        {"soak --help", fun() -> says(0, "Usage: ./starl soak BLOCK", ["soak", "--help"]) end},
        {"no block", fun() -> says(2, "starl: soak: name a block", ["soak"]) end},
        {"flag first", fun() -> says(2, "name a block first", ["soak", "--seeds", "3"]) end},
        {"bad block", fun() -> says(2, "there is no block mutx", ["soak", "mutx"]) end},
        {"bad seeds", fun() -> says(2, "soak: --seeds: ", ["soak", "sap", "--seeds", "0"]) end},
        {"planted --help", fun() -> says(0, "Usage: ./starl planted", ["planted", "--help"]) end},
        {"bad bug", fun() -> says(2, "there is no bug x", ["planted", "--bug", "x"]) end},
        {"faults", fun() ->
            Text = says(0, "burst_loss", ["faults"]),
            %% the explanation of a kind is indented farther
            Kinds = [Line || "  " ++ [C | _] = Line <- string:lexemes(Text, "\n"), C =/= $\s],
            ?assertEqual(length(starl_run_fault:kinds()), length(Kinds)),
            contains("range_mm 1..10000000 mm", Text)
        end},
        {"faults --help", fun() -> says(0, "Usage: ./starl faults", ["faults", "--help"]) end},
        {"faults x", fun() -> says(2, "unexpected argument \"x\"", ["faults", "x"]) end}
    ]).

%% A limit of a group is none of its tests'.
patient(Tests) -> [{Title, {timeout, ?PATIENCE_S, Test}} || {Title, Test} <- Tests].

%% A sound block holds: the table has its line, the exit status is 0.
sound_test_() ->
    {timeout, ?PATIENCE_S, fun() ->
        Args = ["soak", "sap", "--seeds", "4", "--from", "7", "--robots", "3", "--jobs", "2"],
        Text = says(0, "seeds/min/core", Args),
        contains("sap              4          0         0", Text),
        narrow(Text)
    end}.

%% So does an application, in teams of all sizes, under faults that it bears.
application_test_() ->
    {timeout, ?PATIENCE_S, fun() ->
        Text = says(0, "seeds/min/core", ["soak", "follow", "--seeds", "4", "--jobs", "2"]),
        contains("follow           4          0         0", Text)
    end}.

applications_are_drawn_test_() ->
    {timeout, ?PATIENCE_S, fun() ->
        Known = starl_lab_soak_draw:applications(),
        Names = [search, formation, follow, swarm, crossing, convoy],
        ?assertEqual([], Names -- [Name || {Name, _} <- Known]),
        Drawn = fun(Name) -> [starl_lab_soak:scenario(Name, none, S) || S <- lists:seq(1, 50)] end,
        [
            ?assertEqual(proplists:get_value(Name, Known), App)
         || Name <- Names, #{app := App} <- Drawn(Name)
        ],
        Faults = fun(Name) -> lists:usort([F || #{random_faults := F} <- Drawn(Name)]) end,
        ?assert(lists:member([all], Faults(formation))),
        %% what rests on path planning gets what that bears
        ?assertNot(
            lists:any(fun(F) -> F =:= [all] orelse lists:member(location, F) end, Faults(search))
        ),
        Sizes = [N || #{robots := N} <- Drawn(swarm)],
        ?assertEqual({1, 10}, {lists:min(Sizes), lists:max(Sizes)})
    end}.

%% Ways are closed and opened again only where there are walls: in a part of the runs of path planning.
%% Holds: Soak closes ways and opens them again for path planning
%% Red: e923e723, run: no run had walls
path_planning_has_walls_in_some_runs_test() ->
    Drawn = [starl_lab_soak:scenario(dpp, none, Seed) || Seed <- lists:seq(1, 200)],
    Walls = [Faults || #{floor := _, random_faults := Faults} <- Drawn],
    ?assert(length(Walls) > 30 andalso length(Walls) < 70),
    ?assert(lists:all(fun(Faults) -> lists:member(floor, Faults) end, Walls)).

%% In some runs of every block and application the radio of a minority stays cut in one direction until the end,
%% or one link does, from any time on.
cuts_that_last_are_drawn_for_all_test_() ->
    Names = [dpp, bully, mutex, barrier, registers, search, formation, follow, swarm, convoy],
    patient([{atom_to_list(Name), fun() -> cuts(Name) end} || Name <- Names]).

cuts(Name) ->
    Drawn = [starl_lab_soak:scenario(Name, 5, Seed) || Seed <- lists:seq(1, 200)],
    Cuts = [Cut || #{faults := Faults} <- Drawn, Cut <- Faults],
    ?assertEqual([deaf, link, mute], lists:usort([Id || {Id, _, _, _, _, _} <- Cuts]) -- slow()),
    [?assert(To >= 1000 * T) || #{faults := [{_, _, To, _, _, _} | _], time := T} <- Drawn],
    Begins = [From || {_, From, _, _, _, _} <- Cuts],
    ?assert(lists:min(Begins) < 10000 andalso lists:max(Begins) > 15000),
    Muted = [Group || {mute, _, _, _, Group, _} <- Cuts],
    ?assert(length(lists:usort(lists:append(Muted))) > 2).

slow() -> [slow_1, slow_2, slow_3, slow_4].

%% What a few runs have not had is told, and not owed.
sometimes_test_() ->
    {timeout, ?PATIENCE_S, fun() ->
        Text = says(0, "sap has never had: ", ["soak", "sap", "--seeds", "1", "--robots", "1"]),
        narrow(Text)
    end}.

%% The program of real robots: each part has its line, and the lines of the program that ran are counted.
live_test_() ->
    {timeout, ?PATIENCE_S, fun() ->
        Args = ["soak", "live", "--part", "store", "--seeds", "4", "--jobs", "2", "--cover"],
        Text = says(0, "seeds/min/core", Args),
        contains("store              4          0         0", Text),
        contains("starl_live_store", Text),
        narrow(Text)
    end}.

%% More than the machine has: 256 VMs, each with 10,000 robots.
too_large_test_() ->
    {timeout, ?PATIENCE_S, fun() ->
        Args = ["soak", "mutex", "--robots", "10000", "--seeds", "256", "--jobs", "256"],
        case starl_lab_memory:available() of
            Bytes when Bytes < 190_000_000_000 -> says(2, "in each of 256 runs at once", Args);
            _ -> ok
        end
    end}.

%% The broken blocks of the tests are compiled, run and found.
planted_test_() ->
    {timeout, ?PATIENCE_S, fun() ->
        Args = ["planted", "--bug", "sap_forgets,mutex_impatient_home", "--jobs", "2"],
        Text = says(0, "2 of 2 found", Args),
        narrow(Text),
        contains("sap: duplicate delivery", Text),
        contains("mutex: two holders", Text)
    end}.

%% With too few seeds a bug is not found, which is told.
planted_not_found_test_() ->
    {timeout, ?PATIENCE_S, fun() ->
        says(4, "NOT FOUND", ["planted", "--bug", "registers_no_exchange", "--seeds", "1"])
    end}.

%% Of each way in which a contract is violated the first seed, and how many there are.
failing_test() ->
    V = fun(Contract, What) ->
        #{contract => Contract, what => What, at_us => 1, robots => [], details => #{}}
    end,
    Founds = [
        {mutex, 9, {ok, [V(mutex, two_holders)], 0.1, #{}}},
        {mutex, 3, {ok, [], 0.1, #{}}},
        {mutex, 7, {ok, [V(mutex, two_holders)], 0.1, #{}}},
        {mutex, 4, {failed, {failed, crash}}},
        {mutex, 5, {ok, [V(sap, outcome_overdue)], 0.1, #{}}},
        {barrier, 8, {ok, [V(barrier, passed_early)], 0.1, #{}}}
    ],
    ?assertEqual(
        [{1, mutex, 5, sap, 1}, {2, mutex, 7, mutex, 2}, {1, barrier, 8, barrier, 1}],
        [
            {N, Block, Seed, Contract, Count}
         || {N, {Block, Seed, #{contract := Contract}, Count}} <-
                starl_lab_soak_report:failing([mutex, barrier], lists:sort(Founds))
        ]
    ).

%% Many runs owe what has to happen sometimes, if their teams are of all sizes.
owed_test() ->
    Founds = [{mutex, Seed, {ok, [], 0.1, #{}}} || Seed <- lists:seq(1, 1000)],
    Missed = fun(Runs, AreDrawn) ->
        starl_lab_soak_report:missed([mutex], Runs, AreDrawn)
    end,
    ?assertEqual(owed, Missed(Founds, true)),
    ?assertEqual(none, Missed(Founds, false)),
    ?assertEqual(none, Missed(tl(Founds), true)).

%% What a soak runs is what the printed command runs, with all that was drawn.
scenario_test_() ->
    {timeout, ?PATIENCE_S, fun replayed/0}.

replayed() ->
    [
        begin
            #{app := App} = Given = starl_lab_soak:scenario(Block, Robots, Seed),
            {ok, Scenario} = starl_run_scenario:check(Given, starl_app:options(App)),
            {Name, App} = lists:keyfind(App, 2, starl_cli_target:apps()),
            {ok, Target} = starl_cli_target:resolve(Name),
            Replay = unicode:characters_to_list(starl_cli_target:replay(Target, Scenario)),
            ["./starl", "run" | Args] = words(lists:flatten(Replay)),
            {ok, Call} = starl_cli_dispatch:read(starl_lab_run:command(), Args),
            {ok, #{scenario := Again}} = starl_lab_setup:check(Call),
            ?assertEqual({Block, Seed, Scenario}, {Block, Seed, Again})
        end
     || Block <- starl_lab_soak:targets(), {Robots, Seed} <- [{6, 1}, {none, 2}, {none, 3}]
    ].

%% As a shell reads it; a word in quotes has spaces.
words(Line) ->
    lists:append([
        case N rem 2 of
            0 -> [Part];
            1 -> string:lexemes(Part, " ")
        end
     || {N, Part} <- lists:enumerate(string:split(Line, "'", all))
    ]).

%% Teams of all sizes are drawn, faults that outlast leases, leases of several lengths, holds longer
%% than a lease, clocks near the bound of their drift; the same for the same seed.
drawn_test_() ->
    {timeout, ?PATIENCE_S, fun drawn/0}.

drawn() ->
    Drawn = fun(Block, Key, Robots) ->
        lists:usort([
            maps:get(Key, starl_lab_soak:scenario(Block, Robots, Seed), none)
         || Seed <- lists:seq(1, 200)
        ])
    end,
    [
        begin
            ?assertEqual(lists:seq(1, 10), Drawn(Block, robots, none)),
            ?assertEqual([3], Drawn(Block, robots, 3)),
            ?assertMatch([_, Heal] when Heal >= 25, Drawn(Block, longest_fault, none)),
            ?assertEqual([9999, none], Drawn(Block, clock_drift, none))
        end
     || Block <- starl_lab_soak:targets()
    ],
    ?assertEqual([500, 1000, 2000, 4000], Drawn(mutex, lease, none)),
    ?assertEqual([3, 6, 1024], Drawn(registers, limit, none)),
    ?assert(length(Drawn(dpp, lease, none)) > 100),
    Longer = [
        Seed
     || Seed <- lists:seq(1, 200),
        #{hold := Hold, lease := Lease} <- [starl_lab_soak:scenario(mutex, none, Seed)],
        Hold > Lease
    ],
    ?assert(length(Longer) > 50).

%% In a share of the runs a minority stays for ever so that it hears nothing, is not heard, misses a link, or is slow.
quiet_cores_test() ->
    Quiet = [
        {Robots, Faults}
     || Seed <- lists:seq(1, 300),
        #{robots := Robots, faults := [_ | _] = Faults} <-
            [starl_lab_soak:scenario(sap, none, Seed)]
    ],
    ?assert(length(Quiet) > 30 andalso length(Quiet) < 90),
    Kinds = [element(1, hd(Faults)) || {_, Faults} <- Quiet],
    ?assertEqual([deaf, link, mute, slow_1], lists:usort(Kinds)),
    [
        begin
            Team = lists:seq(1, Robots),
            {Rest, []} = starl_run_assumption:core(Faults, Team, 7200000000),
            ?assert(Rest =/= [] andalso 2 * length(Rest) < Robots)
        end
     || {Robots, Faults} <- Quiet
    ].

%% Where clocks are near the bound no fault lets one drift further.
drift_within_its_bound_test() ->
    [
        ?assertNot(lists:member(clock_drift, [Kind || W <- What, Kind <- kinds(W)]))
     || Block <- starl_lab_soak:targets(),
        Seed <- lists:seq(1, 50),
        #{clock_drift := 9999, random_faults := What} <-
            [starl_lab_soak:scenario(Block, none, Seed)]
    ].

kinds(What) -> [Kind || {Kind, _, _, _, _} <- starl_run_fault:kinds_of(What)].

%% The soak of each block has robots that hear nobody, are heard by nobody, or miss one link in one direction, until the
%% end: the robot with the highest number, the lowest, and others.
one_way_cuts_that_last_are_drawn_for_each_block_test_() ->
    {timeout, 120, fun one_way_cuts_that_last/0}.

one_way_cuts_that_last() ->
    [
        begin
            Cuts = lists:usort([
                {cut(Fault, N), place(Robot, N)}
             || Seed <- lists:seq(1, 600),
                #{robots := N, faults := Faults} <- [
                    starl_lab_soak_draw:scenario(Block, none, Seed)
                ],
                Fault <- Faults,
                cut(Fault, N) =/= other,
                Robot <- cut_off(Fault, N)
            ]),
            All = [
                {Cut, Place}
             || Cut <- [deaf, link, mute], Place <- [highest, lowest, other]
            ],
            ?assertEqual({Block, All}, {Block, Cuts})
        end
     || Block <- [bully, election, mutex, barrier, registers, counter, geocast, sap]
    ].

cut({_, _, _, loss, {_, _}, #{part := 1.0}}, _N) -> link;
cut({_, _, _, one_way_partition, Group, _}, N) when 2 * length(Group) < N -> mute;
cut({_, _, _, one_way_partition, _Group, _}, _N) -> deaf;
cut(_Other, _N) -> other.

cut_off({_, _, _, loss, {A, B}, _}, _N) -> [A, B];
cut_off({_, _, _, one_way_partition, Group, _}, N) when 2 * length(Group) < N -> Group;
cut_off({_, _, _, one_way_partition, Group, _}, N) -> lists:seq(1, N) -- Group.

place(N, N) -> highest;
place(1, _N) -> lowest;
place(_Robot, _N) -> other.
