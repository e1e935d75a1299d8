%% @doc The command `./starl soak': runs a building block, or an application, with many seeds under
%% random faults, on one VM per core. The faults are of all kinds; for path planning, of the kinds
%% that it tolerates. The monitors judge safety all the time and progress after the faults.
-module(starl_lab_soak).

-behaviour(starl_cli_command).

-export([command/0]).
-export([scenario/3, violations/3, targets/0]).
%% Called in the VMs of the jobs.
-export([one/1]).

-export_type([run/0, found/0]).

%% One run: its block, seed and scenario.
-type run() :: {Block :: atom(), Seed :: non_neg_integer(), starl_run_scenario:t()}.

%% The result of a run: its violations, its wall time, and what has happened in it.
-type found() ::
    {ok, [starl_monitor:violation()], Seconds :: float(), starl_lab_soak_sometimes:counts()}
    | {failed, starl_sim_trial:reason()}.

-type plan() :: #{
    blocks := [atom(), ...],
    runs := [run(), ...],
    jobs := pos_integer(),
    %% are teams of all sizes drawn?
    drawn := boolean(),
    shrink := non_neg_integer()
}.

-type own() :: {own, module(), file:filename(), [starl_cli_target:code(), ...]}.

%% The time limit for shrinking one failing run, s.
-define(SHRINK_S, 60).

%% @doc The targets of a soak: the blocks of `exercise', and path planning.
-spec targets() -> [atom(), ...].
targets() -> starl_block_catalogue:able(exercise) ++ [dpp].

%% @doc The values of a run of a block that differ from the defaults. The number of robots is drawn
%% if it is `none'.
-spec scenario(atom(), Robots :: pos_integer() | none, Seed :: non_neg_integer()) ->
    #{atom() => term()}.
scenario(Block, Robots, Seed) -> starl_lab_soak_draw:scenario(Block, Robots, Seed).

%% @doc Runs a block once, and judges it by its monitors.
-spec violations(atom(), Robots :: pos_integer() | none, Seed :: non_neg_integer()) ->
    {ok, [starl_monitor:violation()]} | {error, starl_sim_trial:reason()}.
violations(Block, Robots, Seed) ->
    case starl_sim_trial:run(checked(scenario(Block, Robots, Seed))) of
        {ok, #{violations := Violations}} -> {ok, Violations};
        {error, _} = Error -> Error
    end.

-spec command() -> starl_cli_command:command().
command() ->
    #{
        name => "soak",
        synopsis => "use a block under random faults, with many seeds",
        argument => fun argument/0,
        subject => fun subject/2,
        about => fun about/1,
        flags => fun flags/1,
        statuses => [
            {0, "all contracts held"},
            {1, "a simulation failed"},
            {3, "a contract was violated"},
            {4, "in many runs something has not happened that has to happen sometimes"},
            {5, "a run was not judged to its end"},
            {130, "interrupted, with the results so far"}
        ],
        run => fun run/1
    }.

argument() ->
    Others = [{all, "one after the other"}, {live, "the program of real robots"}],
    Applications = [{Name, "an application"} || {Name, _} <- starl_lab_soak_draw:applications()],
    {required, "BLOCK", [{Block, ""} || Block <- targets()] ++ Applications ++ Others}.

about(live) ->
    starl_lab_soak_live:about();
about(_Subject) ->
    [
        "Uses a building block all the time, under random faults of all kinds (path planning: of "
        "those that it bears), with one seed after the other. Drawn with the seed are also the size "
        "of the team, the lengths of faults, leases and the drift of clocks. Faults are over after "
        "25 s of virtual time (path planning: 45 s); then every call has to end as its block "
        "promises. The monitors of all contracts judge. For each way in which a contract is "
        "violated it prints the commands that replay and shrink the first run, and shrinks it. The "
        "answers that the applications get are judged by themselves, too (./starl histories). What "
        "has happened in no run is told: events of the block, and situations that its contract "
        "names; 1,000 runs of teams of all sizes owe all that are not declared to be seldom.",
        [
            "Blocks: ",
            lists:join(", ", [atom_to_list(Block) || Block <- targets() ++ [all]]),
            "; applications: ",
            lists:join(", ", [atom_to_list(Name) || {Name, _} <- starl_lab_soak_draw:applications()]),
            "; or FILE.erl with a block of your own; live: the program of real robots, in virtual time"
        ]
    ].

flags(live) ->
    [{"Flags", starl_lab_soak_live:flags()}];
flags(_Subject) ->
    [
        {"Flags", [
            {seeds, {integer, 1, 10000000}, 100, "number of runs of each block"},
            {from, {integer, 0, 1 bsl 31}, 1, "the first seed"},
            {robots, {optional, {integer, 1, 10000}}, none,
                "robots in the team; none: from 1 to 10, drawn for each run"},
            {shrink, {integer, 0, 1000}, 1, "number of failing runs of each block that are shrunk"},
            starl_lab_slice:flag(),
            starl_lab_jobs:at_once()
        ]}
    ].

-spec run(starl_cli_command:call()) -> starl_cli_command:answer().
run(#{subject := live, values := Values}) ->
    starl_lab_soak_live:run(Values);
run(#{values := #{slice := Text}} = Call) ->
    case starl_lab_slice:read(Text) of
        {ok, Slice} -> sliced(Slice, Call);
        {error, Why} -> {error, [["--slice: ", Why]]}
    end.

sliced(Slice, #{subject := Subject, values := Values}) ->
    {Blocks, Own} =
        case Subject of
            all -> {targets(), none};
            {own, Block, _, _} -> {[Block], Subject};
            Block -> {[Block], none}
        end,
    #{runs := Runs} = Plan = plan(Blocks, Values),
    case starl_lab_slice:part(Slice, Runs) of
        [] -> {error, ["--slice: no run is left for it; take fewer slices or more seeds"]};
        Part -> soak(Plan#{runs := Part}, Own)
    end.

%% @doc Loads a user's block.
-spec subject(string(), [string()]) ->
    {ok, own(), [string()]} | {error, [unicode:chardata(), ...]}.
subject(File, Args) ->
    case starl_cli_source:block(File, exercise) of
        {ok, Block, Codes} -> {ok, {own, Block, File, Codes}, Args};
        {error, _} = Error -> Error
    end.

plan(Blocks, #{seeds := Count, from := From, robots := Robots} = Values) ->
    (maps:with([jobs, shrink], Values))#{
        blocks => Blocks,
        drawn => Robots =:= none,
        runs => [
            {Block, Seed, checked(scenario(Block, Robots, Seed))}
         || Block <- Blocks, Seed <- lists:seq(From, From + Count - 1)
        ]
    }.

checked(#{app := App} = Given) ->
    {ok, Scenario} = starl_run_scenario:check(Given, starl_app:options(App)),
    Scenario.

soak(#{runs := Runs, jobs := Jobs} = Plan, Own) ->
    Use = #{jobs => min(Jobs, length(Runs)), nodes => false},
    Inline = [Scenario#{mode := inline} || {_, _, Scenario} <- Runs],
    case starl_lab_memory:largest(Inline, Use) of
        [] -> soaked(Plan, Own);
        Problems -> {error, Problems}
    end.

-spec soaked(plan(), own() | none) -> starl_cli_terminal:status().
soaked(#{blocks := Blocks, runs := Runs, jobs := Most, shrink := Shrink} = Plan, Own) ->
    ok = starl_cli_log:install(),
    {How, Founds} = starl_lab_jobs:run(
        Runs,
        #{
            work => {?MODULE, one},
            at_once => Most,
            what => "runs",
            each => fun noted/3,
            code => codes(Own)
        },
        []
    ),
    starl_cli_signal:on_interrupt(quit),
    Sorted = lists:sort(Founds),
    starl_lab_soak_report:tell(Blocks, Sorted),
    Owed = starl_lab_soak_report:missed(Blocks, Sorted, maps:get(drawn, Plan)),
    Failing = starl_lab_soak_report:failing(Blocks, Sorted),
    Scenarios = maps:from_list([{{Block, Seed}, Scenario} || {Block, Seed, Scenario} <- Runs]),
    _ = [
        violated(Failed, target(Own, Scenario), Scenario, How =:= done andalso N =< Shrink)
     || {N, {Block, Seed, _, _} = Failed} <- Failing,
        Scenario <- [maps:get({Block, Seed}, Scenarios)]
    ],
    status(How, Owed, Sorted).

noted({Block, Seed, _}, {ok, Found}, Founds) ->
    [{Block, Seed, Found} | Founds];
noted({Block, Seed, _}, {crashed, Reason}, Founds) ->
    [{Block, Seed, {failed, {failed, Reason}}} | Founds].

status(interrupted, _, _) ->
    130;
status(done, Owed, Founds) ->
    Worst = lists:append([
        [3 || {_, _, {ok, [_ | _], _, _}} <- Founds],
        [1 || {_, _, {failed, Reason}} <- Founds, element(1, Reason) =/= unjudged],
        [5 || {_, _, {failed, {unjudged, _}}} <- Founds],
        [4 || owed <- [Owed]]
    ]),
    hd(Worst ++ [0]).

%% Reports the first run with a kind of violation: its commands and a small scenario.
violated({Block, Seed, Violation, Count}, Target, Scenario, Shrunk) ->
    Replay = lists:flatten(unicode:characters_to_list(starl_cli_target:replay(Target, Scenario))),
    starl_cli_terminal:out([
        "\n",
        starl_violation:format(Violation),
        runs(Count),
        "\n",
        "replay: ",
        Replay,
        further(Violation, Replay),
        "\n"
    ]),
    Job = #{target => Target, scenario => Scenario, file => file(Block, Seed)},
    _ = [small(Job#{options => judged(Violation, Target)}) || Shrunk],
    ok.

judged(Violation, Target) ->
    starl_lab_setup:histories(Target, #{judge_histories => is_history(Violation)}).

is_history(#{contract := Contract}) -> Contract =:= history.

%% Other commands judge histories if they are asked to.
further(Violation, Replay) ->
    Shrink = ["\nshrink: ", string:replace(Replay, "./starl run ", "./starl shrink ")],
    case is_history(Violation) of
        true ->
            Judging = " --judge-histories",
            [
                Judging,
                " --record; ./starl histories on its directory shows the calls",
                Shrink,
                Judging
            ];
        false ->
            Shrink
    end.

codes(none) -> [];
codes({own, _, _, Codes}) -> Codes.

target({own, Block, File, Codes}, #{app := App}) ->
    #{
        app => App,
        name => atom_to_list(Block),
        replay => File,
        file => File,
        given => #{block => Block},
        code => Codes
    };
target(none, #{app := App}) ->
    {Name, App} = lists:keyfind(App, 2, starl_cli_target:apps()),
    {ok, Target} = starl_cli_target:resolve(Name),
    Target.

runs(1) -> "";
runs(Count) -> io_lib:format(" (and so in ~b more runs)", [Count - 1]).

file(Block, Seed) ->
    Name = lists:concat(["soak-", Block, "-", Seed, ".term"]),
    starl_cli_out:free(starl_cli_out:usual(Name)).

small(Job) ->
    Answer = starl_lab_shrinker:shrink(Job#{digest => any, seconds => ?SHRINK_S, quiet => false}),
    starl_cli_progress:erase(),
    starl_cli_terminal:out([
        [Line, "\n"]
     || Line <-
            case Answer of
                {ok, Lines, _} -> tl(Lines);
                {error, _, Why} -> [Why]
            end
    ]).

%% @private One run, in the VM of its job.
-spec one(run()) -> found().
one({Block, _Seed, Scenario}) ->
    Begin = erlang:monotonic_time(microsecond),
    Watch = [starl_lab_soak_sometimes:watch(Block)],
    Histories = #{histories => {judged, starl_block_catalogue:histories([Block])}},
    case starl_sim_trial:run(Scenario, fun(_Sim) -> ok end, Watch, Histories) of
        {ok, #{violations := Violations, monitors := Results}} ->
            Us = erlang:monotonic_time(microsecond) - Begin,
            Counts = starl_lab_soak_sometimes:counts(Results),
            {ok, lists:sublist(Violations, 1), Us / 1.0e6, Counts};
        {error, Reason} ->
            {failed, Reason}
    end.
