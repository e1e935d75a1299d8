%% @doc The table of the building blocks, and of other parts of a robot's program, for mutation
%% testing. It lists the sources and the tests of each.
%%
%% Sources and tests are wildcards, so a new module of a block needs no entry. A test that does not
%% call a mutated function is not run against it, so a superfluous test costs little.
-module(starl_mutate_block).

-export([names/0, sources/2, units/3]).

-export_type([name/0, unit/0, layer/0]).

-type name() ::
    sap
    | election
    | bully
    | mutex
    | barrier
    | geocast
    | registers
    | counter
    | dpp
    | motion
    | link
    | transports
    | reload
    | trace
    | monitors
    | all.

%% A test that may catch a mutant: an EUnit module, a run of `soak' or of `soak live', a small search of the
%% checker, a test case of Common Test.
-type unit() ::
    {unit, module()}
    | {soak, Block :: atom(), Robots :: pos_integer(), Seed :: non_neg_integer()}
    | {soak, live(), Seed :: non_neg_integer()}
    | {check, starl_check_model:block(), Robots :: pos_integer(), starl_check_model:budgets()}
    | {suite, module(), starl_mutate_suite:path()}.

-type live() :: {live, starl_virtual_run:part()}.

-type layer() :: unit | soak | check | suite.

-type block() :: #{
    sources := [string()],
    unit := [string()],
    suite := [string()],
    soak := [atom() | live()],
    check := [{starl_check_model:block(), pos_integer(), starl_check_model:budgets()}]
}.

%% The sizes of the soaked teams, in turn: most violations appear in small teams.
-define(TEAMS, [2, 3, 5, 10]).

%% The tests of what every block may declare: its guarantees, its history, its monitors.
-define(DECLARED, ["starl_block_*", "starl_cli_compose_*"]).

%% @doc All blocks, `monitors' and `all'.
-spec names() -> [name(), ...].
names() -> maps:keys(blocks()) ++ [monitors, all].

-spec block(name()) -> block().
block(all) -> lists:foldl(fun both/2, block(monitors), maps:values(blocks()));
block(monitors) -> monitors();
block(Name) -> maps:get(Name, blocks()).

both(One, Other) ->
    maps:map(fun(Key, Some) -> lists:usort(Some ++ maps:get(Key, Other)) end, One).

-spec blocks() -> #{name() => block()}.
blocks() ->
    #{
        sap => sap(),
        election => election(),
        bully => bully(),
        mutex => mutex(),
        barrier => barrier(),
        geocast => geocast(),
        registers => registers(),
        counter => counter(),
        dpp => dpp(),
        motion => motion(),
        link => link(),
        transports => transports(),
        reload => reload(),
        trace => trace()
    }.

sap() ->
    #{
        sources => [
            "apps/starl_platform/src/services/starl_{sap,packet}*.erl",
            "apps/starl_platform/src/contracts/starl_sap_*.erl"
        ],
        unit => ["starl_sap_*", "starl_packet_*"],
        suite => ["starl_sap_SUITE"],
        soak => [sap],
        check => [{sap, 2, #{crash => 1}}, {sap, 2, #{dup => 1}}, {sap, 2, #{loss => 1}}]
    }.

election() ->
    #{
        sources => [
            "apps/starl_blocks/src/election/starl_election.erl",
            "apps/starl_blocks/src/election/starl_election_{ballots,monitor}*.erl"
        ],
        unit => ["starl_election_*"],
        suite => ["starl_election_SUITE"],
        soak => [election],
        check => [{election, 2, #{loss => 1, crash => 1}}, {election, 3, #{late => 1}}]
    }.

bully() ->
    #{
        sources => [
            "apps/starl_blocks/src/election/starl_election.erl",
            "apps/starl_blocks/src/election/starl_election_bully*.erl"
        ],
        unit => ["starl_election_*"],
        suite => ["starl_election_SUITE"],
        soak => [bully],
        check => [{bully, 2, #{loss => 1, crash => 1, sap => 1}}, {bully, 3, #{loss => 1}}]
    }.

mutex() ->
    #{
        sources => ["apps/starl_blocks/src/mutex/*.erl"],
        unit => ["starl_mutex_*"],
        suite => ["starl_mutex_SUITE"],
        soak => [mutex],
        check => [{mutex, 2, #{loss => 1}}, {mutex, 2, #{crash => 1}}, {mutex, 3, #{}}]
    }.

barrier() ->
    #{
        sources => ["apps/starl_blocks/src/barrier/*.erl"],
        unit => ["starl_barrier_*"],
        suite => ["starl_barrier_SUITE"],
        soak => [barrier],
        check => [
            {barrier, 2, #{loss => 1}},
            {barrier, 2, #{timeout => 1}},
            {barrier, 2, #{sap => 1}},
            {barrier, 2, #{crash => 1}}
        ]
    }.

geocast() ->
    #{
        sources => ["apps/starl_blocks/src/geocast/*.erl"],
        unit => ["starl_geocast_*"],
        suite => ["starl_geocast_SUITE"],
        soak => [geocast],
        check => [{geocast, 2, #{late => 1}}, {geocast, 2, #{crash => 1}}]
    }.

registers() ->
    #{
        sources => ["apps/starl_blocks/src/registers/*.erl"],
        unit => ["starl_registers_*", "starl_hlc_*"],
        suite => ["starl_registers_SUITE"],
        soak => [registers],
        check => [{registers, 2, #{}}, {registers, 2, #{crash => 1}}]
    }.

counter() ->
    #{
        sources => ["apps/starl_blocks/src/counter/*.erl"],
        unit => ["starl_counter_{monitor,gossip,block}_*"],
        suite => [],
        soak => [counter],
        check => [{counter, 2, #{}}, {counter, 2, #{loss => 1, crash => 1}}]
    }.

dpp() ->
    #{
        sources => ["apps/starl_blocks/src/dpp/*.erl"],
        unit => ["starl_dpp_*", "starl_planar_*", "starl_roadmap_*", "starl_term_*"],
        suite => ["starl_dpp_*_SUITE"],
        soak => [dpp],
        check => [{terms, 3, #{}}, {terms, 3, #{death => 1}}]
    }.

motion() ->
    #{
        sources => [
            "apps/starl_platform/src/chassis/*.erl",
            "apps/starl_platform/src/services/starl_{motion,actuator}*.erl",
            "apps/starl_platform/src/contracts/starl_motion_monitor.erl"
        ],
        unit => [
            "starl_{motion,velocity,trajectory,actuator,chassis,differential,holonomic}_*",
            "starl_{action,block,contact,controller,machine,robot}_*",
            "starl_sim_{chassis,crash,vehicle,velocity,watchdog}_*"
        ],
        suite => ["starl_{motion,ramp,holonomic,sim_motion,sim_holonomic}_SUITE"],
        soak => [motion],
        check => []
    }.

link() ->
    #{
        sources => ["apps/starl_live/src/link/*.erl"],
        unit => [
            "starl_live_{link,body,chassis,clock,disk,record,store,timers,watch}_*",
            "starl_live_{exec,log,own}_*",
            "starl_{fleet_node,virtual,world_store}_*"
        ],
        suite => [],
        soak => [{live, Part} || Part <- [store, sap, mutex, registers]],
        check => []
    }.

transports() ->
    #{
        sources => ["apps/starl_live/src/transport/*.erl"],
        unit => [
            "starl_live_{air,codec,dist,figures,fragment,frame,hearing,key,local,pace,packet}_*",
            "starl_live_{peers,refusals,replay,seal,transport,udp}_*",
            "starl_{fleet_node,world_transport}_*"
        ],
        suite => ["starl_live_{transport,udp}_SUITE"],
        soak => [{live, radio}],
        check => []
    }.

reload() ->
    #{
        sources => ["apps/starl_platform/src/reload/*.erl"],
        unit => ["starl_{reload,lineage,version}_*"],
        suite => [],
        soak => [],
        check => []
    }.

trace() ->
    #{
        sources => [
            "apps/starl_trace/src/recording/*.erl",
            "apps/starl_trace/src/mcap/*.erl",
            "apps/starl_trace/src/stream/*.erl"
        ],
        unit => ["starl_{trace,mcap,storage}_*"],
        suite => ["starl_{trace,recording}_SUITE"],
        soak => [],
        check => []
    }.

-spec monitors() -> block().
monitors() ->
    #{
        sources => monitor_sources(),
        unit => [
            "starl_*_monitor_*",
            "starl_monitor_*",
            "starl_separation_*",
            "starl_assumption_*",
            "starl_sap_*",
            "starl_sim_judge_*",
            "starl_run_assumption_*",
            "starl_sim_outcome_*"
        ],
        suite => [
            "starl_{sap,election,mutex,barrier,geocast,registers}_SUITE",
            "starl_exercise_SUITE",
            "starl_planted_SUITE"
        ],
        soak => [
            Block
         || #{soak := Soaked} <- maps:values(blocks()), Block <- Soaked, is_atom(Block)
        ],
        check => lists:append([Checked || #{check := Checked} <- maps:values(blocks())])
    }.

monitor_sources() ->
    [
        "apps/*/src/**/starl_*_monitor.erl",
        "apps/starl_platform/src/contracts/starl_{monitor,separation,assumption}.erl",
        "apps/starl_platform/src/contracts/starl_sap_monitor_{alarms,sources}.erl",
        "apps/starl_platform/src/services/starl_sap_numbers.erl",
        "apps/starl_sim/src/*/starl_sim_judge.erl",
        "apps/starl_run/src/*/starl_run_assumption.erl"
    ].

%% @doc The sources of a block, below the root of a checkout.
-spec sources(name(), file:filename()) -> [file:filename()].
sources(Name, Root) ->
    #{sources := Patterns} = block(Name),
    Files = [File || Pattern <- Patterns, File <- filelib:wildcard(Pattern, Root)],
    lists:usort(Files).

%% @doc The tests of a block: those among these modules, `Seeds' runs of `soak' for each of its
%% blocks, and its searches.
-spec units(name(), [module()], Seeds :: non_neg_integer()) -> [unit()].
units(Name, Tests, Seeds) ->
    #{unit := Units, suite := Suites, soak := Soaked, check := Checked} = block(Name),
    [{unit, Test} || Test <- matching(?DECLARED ++ Units, "_tests", Tests)] ++
        [soaked(Block, Seed) || Seed <- lists:seq(1, Seeds), Block <- Soaked] ++
        [{check, Block, Robots, Faults} || {Block, Robots, Faults} <- Checked] ++
        [
            {suite, Suite, Path}
         || Suite <- matching(Suites, "_SUITE", Tests), Path <- starl_mutate_suite:paths(Suite)
        ].

soaked({live, _} = Live, Seed) -> {soak, Live, Seed};
soaked(Block, Seed) -> {soak, Block, robots(Seed), Seed}.

robots(Seed) -> lists:nth(1 + Seed rem length(?TEAMS), ?TEAMS).

matching(Patterns, Suffix, Modules) ->
    Expressions = [expression(Pattern) || Pattern <- Patterns],
    [
        Module
     || Module <- Modules,
        Name <- [atom_to_list(Module)],
        lists:suffix(Suffix, Name),
        lists:any(fun(E) -> re:run(Name, E, [{capture, none}]) =:= match end, Expressions)
    ].

%% Translates the stars and braces of a wildcard to a regular expression.
expression(Pattern) -> "^" ++ lists:flatmap(fun letter/1, Pattern) ++ "$".

letter($*) -> ".*";
letter(${) -> "(";
letter($,) -> "|";
letter($}) -> ")";
letter(C) -> [C].
