%% @doc The command `./starl diverge': runs every seed in several modes that must give the same
%% digest. For the first seed with unequal digests it finds the first event that differs.
-module(starl_lab_diverge).

-behaviour(starl_cli_command).

-export([command/0]).
%% Called in the VMs of the jobs.
-export([digests/1, traced/1]).
-export([parse/1]).

-export_type([execution/0, outcome/0, reason/0]).

%% How the machines run, the number of shards, and the number of schedulers of the VM. On the command
%% line it is written `MODE:SHARDS' or `MODE:SHARDS:SCHEDULERS'.
-type execution() :: {
    process | inline, Shards :: pos_integer(), Schedulers :: pos_integer()
}.

%% What runs are compared by: the digest of all events, and beside it what each robot traced and
%% the results of the robots; the numbers of events and of violations.
-type outcome() :: #{
    digest := binary(),
    traces := starl_sim_trace_monitor:chains(),
    results := #{starl:robot_id() => term()},
    events := non_neg_integer(),
    violations := non_neg_integer()
}.

-type reason() :: {bad_way, string()} | {one_way, string()}.

%% Processes and inline, one to three shards, one and two schedulers.
-define(USUAL, "process:1:1,process:2:2,inline:1:1,inline:3:2").
%% The most shards, and schedulers.
-define(MOST, 256).

-type setup() :: #{
    target := starl_cli_target:t(),
    scenario := starl_run_scenario:t(),
    seeds := [non_neg_integer(), ...],
    ways := [execution(), ...],
    jobs := pos_integer()
}.

%% The results of each seed so far, by the position of the way in the list of ways.
-type results() :: #{Seed :: non_neg_integer() => #{pos_integer() => answer()}}.
-type answer() :: outcome() | {crashed, Reason :: term()}.

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "diverge",
        synopsis => "run seeds in several ways that must agree; find where two differ",
        argument => {required, "TARGET", {example, "painting --seeds 1..10"}},
        subject => fun starl_cli_target:subject/2,
        about => [
            "Runs each seed in several ways that must come to the same digest of all events, and to the "
            "same traces and results: with a process for each machine and inline, with the robots "
            "spread over shards, in VMs of more schedulers. Where two differ, the first event that "
            "does is printed from both, and the likely cause. TARGET and all other flags are those of "
            "./starl run."
        ],
        flags => fun flags/1,
        statuses => [
            {0, "no digest differs, nor traces, nor results"},
            {1, "a simulation failed"},
            {3, "a digest, a trace or a result differs"},
            {130, "interrupted"}
        ],
        run => fun run/1
    }.

flags(none) -> [{"Flags", own_flags()}];
flags(#{app := App}) -> [{"Flags", own_flags()}, {hidden, starl_run_scenario:options(App)}].

own_flags() ->
    [
        {seeds, {list, {integer, 0, 1 bsl 32}}, none,
            "the seeds to run; without it that of --seed"},
        {ways, string, ?USUAL,
            "the ways to run each in, MODE:SHARDS or "
            "MODE:SHARDS:SCHEDULERS, with commas between"},
        starl_lab_jobs:at_once()
    ].

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{subject := Target, values := Values} = Call) ->
    {Unsound, Scenario} = starl_cli_target:scenario(
        Target, starl_cli_target:given(Call, own_flags())
    ),
    {Unknown, Ways} = ways(parse(maps:get(ways, Values))),
    case Unsound ++ Unknown of
        [] ->
            probed(#{
                target => Target,
                scenario => Scenario,
                ways => Ways,
                jobs => maps:get(jobs, Values),
                seeds => seeds(maps:get(seeds, Values), Scenario)
            });
        Problems ->
            {error, Problems}
    end.

ways({ok, Ways}) -> {[], Ways};
ways({error, Reason}) -> {[["--ways: ", format_error(Reason)]], []}.

seeds(none, #{seed := Seed}) -> [Seed];
seeds(Seeds, _Scenario) -> lists:usort(Seeds).

%% @private Reads a list of at least two ways, separated by commas. The default is one scheduler.
-spec parse(string()) -> {ok, [execution(), ...]} | {error, reason()}.
parse(Text) ->
    Ways = [{Part, way(string:split(Part, ":", all))} || Part <- string:split(Text, ",", all)],
    case [Part || {Part, error} <- Ways] of
        [Part | _] -> {error, {bad_way, Part}};
        [] when length(Ways) < 2 -> {error, {one_way, Text}};
        [] -> {ok, [Way || {_, Way} <- Ways]}
    end.

way([Mode, Shards]) ->
    way([Mode, Shards, "1"]);
way([Mode, Shards, Schedulers]) ->
    Count = {integer, 1, ?MOST},
    Modes = {one_of, [process, inline]},
    Parts = [{Modes, Mode}, {Count, Shards}, {Count, Schedulers}],
    case [starl_options:parse(Type, Text) || {Type, Text} <- Parts] of
        [{ok, M}, {ok, N}, {ok, S}] -> {M, N, S};
        _ -> error
    end;
way(_) ->
    error.

format_error({bad_way, Text}) ->
    ["MODE:SHARDS or MODE:SHARDS:SCHEDULERS expected, as in process:1 or inline:3:2, not ", Text];
format_error({one_way, Text}) ->
    ["two ways or more are needed, not only ", Text].

text({Mode, Shards, Schedulers}) ->
    lists:flatten(io_lib:format("~ts:~b:~b", [Mode, Shards, Schedulers])).

%% -- all seeds, in all ways -----------------------------------------------------------------

%% One seed is tried first: a scenario that starts with one seed starts with all.
-spec probed(setup()) -> starl_cli_command:answer().
probed(#{scenario := Scenario, seeds := [Seed | _]} = Setup) ->
    case starl_lab_jobs:set_up(Scenario#{seed => Seed}) of
        {ok, _} -> all(Setup);
        {error, Why} -> {error, [Why]}
    end.

%% Runs all ways in VMs with the number of schedulers that they need, one number after the other.
all(#{ways := Ways} = Setup) ->
    Begin = erlang:monotonic_time(millisecond),
    Numbered = lists:zip(lists:seq(1, length(Ways)), Ways),
    Sizes = lists:usort([Schedulers || {_, _, Schedulers} <- Ways]),
    Group = fun(Size, Acc) ->
        Same = [P || {_, {_, _, Schedulers}} = P <- Numbered, Schedulers =:= Size],
        group({Size, Same}, Acc, Setup)
    end,
    {How, Results} = lists:foldl(Group, {done, #{}}, Sizes),
    told(How, Results, erlang:monotonic_time(millisecond) - Begin, Setup).

group(_Group, {interrupted, _} = Acc, _Setup) ->
    Acc;
group({Schedulers, Numbered}, {done, Results}, Setup) ->
    #{scenario := Scenario, seeds := Seeds, jobs := Jobs, target := Target} = Setup,
    {Places, Ways} = lists:unzip(Numbered),
    Names = lists:join(", ", [text(Way) || Way <- Ways]),
    Plan = #{
        work => {?MODULE, digests},
        at_once => max(1, Jobs div Schedulers),
        schedulers => Schedulers,
        what => lists:flatten(["seeds, ", Names]),
        code => maps:get(code, Target, []),
        each => fun({#{seed := Seed}, _}, Answer, Acc) -> add(Seed, Places, Answer, Acc) end
    },
    starl_lab_jobs:run([{Scenario#{seed => Seed}, Ways} || Seed <- Seeds], Plan, Results).

-spec add(non_neg_integer(), [pos_integer()], {ok, [term()]} | {crashed, term()}, results()) ->
    results().
add(Seed, Places, {ok, Outcomes}, Results) ->
    merge(Seed, maps:from_list(lists:zip(Places, Outcomes)), Results);
add(Seed, Places, {crashed, Reason}, Results) ->
    merge(Seed, maps:from_list([{Place, {crashed, Reason}} || Place <- Places]), Results).

merge(Seed, New, Results) -> Results#{Seed => maps:merge(maps:get(Seed, Results, #{}), New)}.

%% -- results --------------------------------------------------------------------------------

told(How, Results, Ms, #{ways := Ways} = Setup) ->
    Runs = lists:sum([map_size(Answers) || Answers <- maps:values(Results)]),
    Differ = [S || {S, Answers} <- lists:sort(maps:to_list(Results)), differ(Answers)],
    Violated = length([S || {S, #{1 := #{violations := V}}} <- maps:to_list(Results), V > 0]),
    starl_cli_terminal:out([
        [["interrupted: "] || How =:= interrupted],
        io_lib:format("~b seed~ts, ~b ways: ~ts~n", [
            map_size(Results), plural(map_size(Results)), length(Ways), verdict(Differ, Results)
        ]),
        io_lib:format("  ~b runs in ~.1f s, ~b a minute~n", [
            Runs, Ms / 1000, Runs * 60000 div max(1, Ms)
        ]),
        [io_lib:format("  ~b of the seeds violate a contract~n", [Violated]) || Violated > 0]
    ]),
    status(How, Differ, Results, Setup).

verdict([], _Results) ->
    "no digest differs, nor traces, nor results";
verdict(Seeds, Results) ->
    Digests = [S || S <- Seeds, differ(fun digest/1, maps:get(S, Results))],
    What =
        case Digests of
            [] -> "TRACES OR RESULTS";
            _ -> "DIGESTS"
        end,
    Of =
        case Seeds of
            [_] -> "one seed";
            _ -> io_lib:format("~b seeds", [length(Seeds)])
        end,
    ["DIFFERENT ", What, " of ", Of].

plural(1) -> "";
plural(_) -> "s".

%% A failed run counts as different.
differ(Answers) -> differ(fun known/1, Answers).

differ(By, Answers) -> length(lists:usort([By(A) || A <- maps:values(Answers)])) > 1.

known({crashed, _}) -> crashed;
known(Outcome) -> maps:with([digest, traces, results], Outcome).

digest({crashed, _}) -> crashed;
digest(#{digest := Digest}) -> Digest.

status(_How, [Seed | _], Results, Setup) ->
    locate(Seed, lists:sort(maps:to_list(maps:get(Seed, Results))), Setup),
    3;
status(How, [], Results, _Setup) ->
    Crashed = [R || Answers <- maps:values(Results), {crashed, R} <- maps:values(Answers)],
    case Crashed of
        [Reason | _] ->
            starl_cli_terminal:complain(io_lib:format("the simulation failed: ~0tP", [Reason, 15])),
            1;
        [] when How =:= interrupted -> 130;
        [] ->
            0
    end.

%% -- the first different event --------------------------------------------------------------

locate(Seed, [{_, First} | Others], #{scenario := Scenario, ways := Ways} = Setup) ->
    [{Place, Other} | _] = [{P, A} || {P, A} <- Others, known(A) =/= known(First)],
    {A, B} = {hd(Ways), lists:nth(Place, Ways)},
    starl_cli_terminal:out(
        io_lib:format("seed ~b, ~ts and ~ts: ", [
            Seed, text(A), text(B)
        ])
    ),
    case [Reason || {crashed, Reason} <- [First, Other]] of
        [Reason | _] ->
            starl_cli_terminal:out("one of them failed: ~0tP~n", [Reason, 15]);
        [] ->
            differ(
                digest(First) =/= digest(Other),
                {First, Other},
                Scenario#{seed => Seed},
                {A, B},
                Setup
            )
    end.

differ(true, _Outcomes, Scenario, Ways, Setup) ->
    find(Scenario, Ways, Setup),
    likely(Setup);
differ(false, Outcomes, Scenario, Ways, Setup) ->
    beside(Outcomes, Scenario, Ways, Setup),
    likely(Setup).

%% The events are equal; what a program makes of them is not.
beside(
    {#{traces := First, results := R1}, #{traces := Second, results := R2}}, Scenario, Ways, Setup
) ->
    case
        [Id || Id <- lists:sort(maps:keys(First)), maps:find(Id, First) =/= maps:find(Id, Second)]
    of
        [Robot | _] ->
            starl_cli_terminal:out(traces(Robot, Scenario, Ways, Setup));
        [] ->
            [Robot | _] = [Id || {Id, R} <- lists:sort(maps:to_list(R1)), maps:get(Id, R2) =/= R],
            Shown = [Robot, maps:get(Robot, R1), maps:get(Robot, R2)],
            starl_cli_terminal:out("the results of robot ~b differ:\n  ~0tP\n  ~0tP\n", [
                hd(Shown), lists:nth(2, Shown), 30, lists:nth(3, Shown), 30
            ])
    end.

%% What a robot traces if it is run this way, in a VM of its own.
traced(Robot, Scenario, {_, _, Schedulers} = Way, Codes) ->
    Vm = starl_lab_jobs:vm(Schedulers, Codes),
    Full = apply_to(Scenario, Way),
    Traced = peer:call(Vm, ?MODULE, traced, [{Full, Robot}], infinity),
    peer:stop(Vm),
    Traced.

traces(Robot, Scenario, {A, B}, #{target := Target}) ->
    Codes = maps:get(code, Target, []),
    [First, Second] = [traced(Robot, Scenario, Way, Codes) || Way <- [A, B]],
    [
        io_lib:format("the events are equal; what robot ~b traces is not~n", [Robot]),
        case parted(First, Second) of
            none ->
                "run again, they no longer differ\n";
            {One, Other} ->
                [
                    text(A),
                    ":\n",
                    trace(One),
                    text(B),
                    ":\n",
                    trace(Other)
                ]
        end
    ].

%% The first traces that differ.
parted([Same | First], [Same | Second]) -> parted(First, Second);
parted([], []) -> none;
parted(First, Second) -> {head(First), head(Second)}.

head([Traced | _]) -> Traced;
head([]) -> none.

trace(none) ->
    "  no more\n";
trace({T, Machine, Event}) ->
    io_lib:format("  ~.6f s  ~tp traces ~0tP~n", [T / 1.0e6, Machine, Event, 30]).

%% Calls whose values are not the robot's.
likely(#{target := Target}) ->
    Calls = lists:append([
        starl_cli_lint:calls(Beam)
     || Beam <- starl_cli_target:beams(Target)
    ]),
    Lines = [["likely cause: ", starl_cli_lint:text(Call), "\n"] || Call <- Calls],
    starl_cli_terminal:out(Lines).

%% Successive runs in one VM differ in their pids, references and times.
find(Scenario, {A, B} = Ways, #{target := Target} = Setup) ->
    starl_cli_signal:on_interrupt(quit),
    Codes = maps:get(code, Target, []),
    Vms = maps:from_list([
        {Size, starl_lab_jobs:vm(Size, Codes)}
     || Size <- lists:usort([Schedulers || {_, _, Schedulers} <- [A, B]])
    ]),
    Runner = fun({_, _, Schedulers} = Way) ->
        Vm = maps:get(Schedulers, Vms),
        Full = apply_to(Scenario, Way),
        fun(Record) -> peer:call(Vm, starl_sim_divergence, run, [Full, Record], infinity) end
    end,
    Answer = starl_sim_divergence:find(Runner(A), Runner(B)),
    _ = [peer:stop(Vm) || Vm <- maps:values(Vms)],
    starl_cli_terminal:out(found(Answer, Ways, Scenario, Setup)).

found({differ, #{robot := Robot, n := N} = Difference}, {A, B}, Scenario, #{target := Target}) ->
    #{at_us := AtUs, first := First, second := Second, before := Before} = Difference,
    {Mode, Shards, _} = A,
    Run = Scenario#{mode => Mode, shards => Shards},
    Command = starl_cli_target:command_line("replay", Target, Run),
    [
        io_lib:format("the first difference is event ~b of robot ~b, at ~.6f s~n", [
            N, Robot, AtUs / 1.0e6
        ]),
        [["before it, in both:\n", [event(E) || E <- Before]] || Before =/= []],
        [text(A), ":\n", event(First)],
        [text(B), ":\n", event(Second)],
        [
            [
                "look: ",
                Command,
                io_lib:format(" --until ~b:~b --inspect ~b~n", [Robot, N - 1, Robot])
            ]
         || N > 1
        ]
    ];
found(not_found, _Ways, _Scenario, _Setup) ->
    "they differ elsewhere each time they are run again\n";
found(_SameOrGone, _Ways, _Scenario, _Setup) ->
    "run again, they no longer differ: what they hang on is not in the scenario\n".

event(none) ->
    "  no such event: the run ended before\n";
event(#{n := N, at_us := AtUs, machine := Machine, type := Type, content := Content}) ->
    Width = starl_cli_terminal:columns(),
    [
        io_lib:format("  ~b  ~.6f s  ~tp~n", [N, AtUs / 1.0e6, Machine]),
        "    type    ",
        starl_lab_inspect:term(Type, 12, Width),
        "\n",
        "    content ",
        starl_lab_inspect:term(Content, 12, Width),
        "\n"
    ].

%% -- in a VM of its own ---------------------------------------------------------------------

%% @private Runs a scenario in these ways, one after the other.
-spec digests({starl_run_scenario:t(), [execution()]}) -> [outcome()].
digests({Scenario, Ways}) -> [outcome(apply_to(Scenario, Way)) || Way <- Ways].

outcome(Scenario) ->
    Outcome = simulate(Scenario, #{}),
    #{digest := Digest, events := Events, violations := Violations, robots := Robots} = Outcome,
    #{monitors := #{starl_sim_trace_monitor := #{chains := Chains}}} = Outcome,
    #{
        digest => Digest,
        traces => Chains,
        results => maps:from_list([{Id, Result} || {Id, #{result := Result}} <- Robots]),
        events => Events,
        violations => length(Violations)
    }.

%% @private Runs a scenario and returns what one robot traced.
-spec traced({starl_run_scenario:t(), starl:robot_id()}) -> [starl_sim_trace_monitor:traced()].
traced({Scenario, Robot}) ->
    #{monitors := #{starl_sim_trace_monitor := #{recorded := Traced}}} =
        simulate(Scenario, #{record => Robot}),
    Traced.

simulate(Scenario, Config) ->
    {ok, Sim} = starl_sim:start(Scenario, #{watch => [{starl_sim_trace_monitor, Config}]}),
    #{ending := _} = starl_sim_trial:whole(Sim),
    {Outcome, _} = starl_sim:finish(Sim),
    Outcome.

%% The scenario, changed to run in this way.
apply_to(Scenario, {Mode, Shards, _}) -> Scenario#{mode => Mode, shards => Shards}.
