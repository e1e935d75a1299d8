%% Every building block keeps its contract under any faults: PropEr draws a block, a
%% team, a radio and a schedule of faults; the monitors judge. What fails is made small by the
%% shrinker, and one command replays it. And the shrinker finds what is planted.
-module(starl_soak_SUITE).
-include_lib("stdlib/include/assert.hrl").
-include_lib("proper/include/proper.hrl").

-export([suite/0, all/0, init_per_suite/1, end_per_suite/1]).
-export([contracts_hold/1, drawn_schedules_are_well_formed/1, planted_bug_is_found_and_shrunk/1]).

%% What holds under all of them. STARL_BLOCKS=bully,barrier and STARL_CASES=5000 ask more.
-define(BLOCKS, [sap, motion, election, bully, mutex, barrier, geocast, registers, counter]).
%% Faults are over by this time, ms; the robots are done so many seconds later.
-define(HEAL_MS, 10000).
-define(CONVERGE_S, 35).
-define(CASES, 60).

suite() -> [{timetrap, {minutes, 5}}].

all() -> [contracts_hold, drawn_schedules_are_well_formed, planted_bug_is_found_and_shrunk].

init_per_suite(Config) -> starl_platform_ct:without_log(Config).

end_per_suite(Config) -> starl_platform_ct:with_log(Config).

contracts_hold(Config) ->
    Blocks = [list_to_existing_atom(B) || B <- string:lexemes(os:getenv("STARL_BLOCKS", ""), ",")],
    Cases = list_to_integer(os:getenv("STARL_CASES", integer_to_list(?CASES))),
    Prop = ?FORALL(
        Scenario,
        scenario(
            case Blocks of
                [] -> ?BLOCKS;
                _ -> Blocks
            end
        ),
        starl_platform_ct:safely(fun() -> holds(starl_exercise, Scenario, Config) end)
    ),
    starl_platform_ct:property(Prop, Cases).

%% The generator makes schedules that a scenario accepts.
drawn_schedules_are_well_formed(_) ->
    Prop = ?FORALL(
        #{robots := N, faults := Faults},
        scenario(?BLOCKS),
        starl_platform_ct:safely(fun() ->
            starl_run_fault:check(Faults) =:= [] andalso
                [R || F <- Faults, R <- starl_run_fault:targets(F), R > N] =:= [] andalso
                lists:all(fun({_, _, To, _, _, _}) -> To =< ?HEAL_MS end, Faults)
        end)
    ),
    starl_platform_ct:property(Prop, 200).

%% The same property over a block with a bug fails, and what is left of the failing case is a
%% scenario file that violates the same contract, and no longer does without any one of its faults.
%% How few they are is chance: a lease that runs out by random loss takes every packet that would have
%% renewed it. So that is asked of cases that are always the same.
planted_bug_is_found_and_shrunk(Config) ->
    {Violation, Drawn} = planted(starl_platform_ct:seed(), Config),
    ?assertEqual([], needless(starl_violation:shape(Violation), Drawn)),
    [
        begin
            %% random loss that matters has become the packets that are lost
            Is = fun(Fault) -> element(4, Fault) =:= drop end,
            {Lost, Struck} = lists:partition(Is, Faults),
            ?assert(length(Struck) =< 3, Faults),
            ?assert(length(Lost) =< 3, Faults)
        end
     || Seed <- [1, 2, 7], {_, #{faults := Faults}} <- [planted(Seed, Config)]
    ].

%% The violation that is shrunk, the first of its run, and the scenario that is left.
planted(Seed, Config) ->
    {Scenario, Violation, Tries} = first_failing(scenario([mutex]), Seed, 1),
    Before = length(maps:get(faults, Scenario)),
    {ok, Lines, complete} = shrink(starl_planted, Scenario, Config),
    {ok, [#{faults := Faults} = Small]} = file:consult(file(Config)),
    ct:pal("case ~b, ~b faults, left: ~p~n~ts", [Tries, Before, Faults, lists:join("\n", Lines)]),
    ?assert(string:find(lists:last(Lines), "./starl run ") =/= nomatch),
    {Violation, Small}.

%% The faults without which the run still violates the same contract in the same way. What is left
%% may violate others as well, before it, too.
needless(Shape, #{faults := Faults} = Small) ->
    Shapes = fun(Some) ->
        [starl_violation:shape(V) || V <- judged(starl_planted, Small#{faults := Some})]
    end,
    ?assert(lists:member(Shape, Shapes(Faults))),
    [Fault || Fault <- Faults, lists:member(Shape, Shapes(lists:delete(Fault, Faults)))].

%% A home that begins anew grants what is still held: a crash or two are enough.
first_failing(_Generator, _Seed, 300) ->
    error(not_found);
first_failing(Generator, Seed, N) ->
    %% PropEr forgets the seed with each pick, and would take one from the clock
    _ = rand:seed(exsss, erlang:phash2({Seed, N})),
    {ok, Drawn} = proper_gen:pick(Generator, 20),
    Scenario = Drawn#{bug => mutex_forgetful_home},
    case judged(starl_planted, Scenario) of
        [] -> first_failing(Generator, Seed, N + 1);
        [First | _] -> {Scenario, First, N}
    end.

%% -- generators -----------------------------------------------------------------------------

%% PropEr does not shrink these: the shrinker knows better how.
scenario(Blocks) ->
    proper_types:noshrink(
        ?LET(
            {Block, N},
            {oneof(Blocks), oneof([3, 4, 6, 8])},
            ?LET(
                {Seed, Loss, Duplicate, Delay, Range, Faults},
                {
                    noshrink(integer(1, 100000)),
                    oneof([0.0, 0.0, 0.2]),
                    oneof([0.0, 0.2]),
                    oneof([{5, 20}, {2, 100}]),
                    oneof([none, none, 6000]),
                    faults(Block, N)
                },
                #{
                    block => Block,
                    robots => N,
                    seed => Seed,
                    loss => Loss,
                    duplicate => Duplicate,
                    delay => Delay,
                    range => Range,
                    faults => named(Faults),
                    work => 12,
                    heal => ?HEAL_MS div 1000,
                    time => ?HEAL_MS div 1000 + ?CONVERGE_S
                }
            )
        )
    ).

%% The blocks are used on an empty floor.
faults(Block, N) ->
    Kinds = [Spec || {_, _, Shape, _, _} = Spec <- starl_run_fault:kinds(), Shape =/= floor],
    resize(12, list(?LET(Spec, oneof(Kinds), fault(Spec, Block, N)))).

fault({Kind, _, Shape, Params, _}, Block, N) ->
    ?LET(
        {{From, Span}, Target, Values},
        {{int(0, ?HEAL_MS - 1), oneof([1, 50, 500, 3000])}, target(Shape, Block, N), [
            {Key, value(Type, Range)}
         || {Key, Type, Range} <- Params
        ]},
        {From, min(?HEAL_MS, From + Span), Kind, Target, maps:from_list(Values)}
    ).

named(Faults) ->
    [
        {starl_platform_ct:fault_id(lists:concat([Kind, "_"]), I), From, To, Kind, Target, Params}
     || {I, {From, To, Kind, Target, Params}} <- lists:enumerate(Faults)
    ].

target(robots, _, N) -> oneof([all, robot(N)]);
target(robot, _, N) -> robot(N);
target(machine, Block, N) -> {robot(N), oneof([sap, location, motion, app, machine(Block)])};
target(link, _, N) -> oneof([all, robot(N), {robot(N), robot(N)}]);
target(group, _, N) -> ?LET(Group, non_empty(list(robot(N))), lists:usort(Group));
target(two, _, N) -> ?LET(A, robot(N), {A, 1 + A rem N}).

machine(bully) -> election;
machine(Block) -> Block.

robot(N) -> oneof(lists:seq(1, N)).

value({one_of, Atoms}, _) -> oneof(Atoms);
value({integer, _, _}, {Low, High}) -> int(Low, High);
value({number, _, _}, {Low, High}) -> float(float(Low), float(High)).

%% PropEr's range/2 keeps to small numbers.
int(Low, High) -> ?LET(X, float(0.0, 1.0), Low + round(X * (High - Low))).

%% -- runs -----------------------------------------------------------------------------------

holds(App, Scenario, Config) ->
    case judged(App, Scenario) of
        [] ->
            true;
        [First | _] ->
            ok = starl_platform_ct:tell([First]),
            tell(shrink(App, Scenario, Config)),
            false
    end.

judged(App, Scenario) ->
    {ok, #{violations := Violations}} = starl_sim_trial:run(Scenario#{app => App}),
    Violations.

tell({ok, Lines, _}) -> ct:log("~ts", [lists:join("\n", Lines)]);
tell({error, _, Why}) -> ct:log("~ts", [Why]).

shrink(App, Given, Config) ->
    {ok, Scenario} = starl_run_scenario:check(Given#{app => App}, starl_app:options(App)),
    starl_lab_shrinker:shrink(#{
        target => target(App),
        scenario => Scenario,
        file => file(Config),
        digest => any,
        seconds => 60,
        quiet => true
    }).

file(Config) -> filename:join(proplists:get_value(priv_dir, Config), "small.term").

target(starl_exercise) -> named_target("exercise", starl_exercise);
target(App) -> named_target(atom_to_list(App), App).

named_target(Name, App) -> #{app => App, name => Name, replay => Name, file => Name, given => #{}}.
