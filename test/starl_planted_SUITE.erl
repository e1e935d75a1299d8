%% The monitors find every planted bug, in runs that the sound block comes through: what ./starl
%% planted does. A change of a block may leave a planted bug without effect; this tells.
-module(starl_planted_SUITE).
-include_lib("stdlib/include/assert.hrl").

-export([suite/0, all/0, init_per_suite/1, end_per_suite/1]).
-export([every_bug_is_found/1, at_least_one_per_block/1, nothing_is_found_in_the_sound/1]).
-export([every_proposition_has_a_bug/1, what_decides_is_named/1, progress_is_judged/1]).
-export([the_sound_is_not_accused/1, what_is_not_judged_is_said/1]).

%% As many as ./starl planted tries; nearly all are found within ten.
-define(SEEDS, 1000).

suite() -> [{timetrap, {minutes, 10}}].

all() ->
    [
        every_bug_is_found,
        every_proposition_has_a_bug,
        at_least_one_per_block,
        nothing_is_found_in_the_sound,
        what_decides_is_named,
        progress_is_judged,
        the_sound_is_not_accused,
        what_is_not_judged_is_said
    ].

init_per_suite(Config) -> starl_platform_ct:without_log(Config).

end_per_suite(Config) -> starl_platform_ct:with_log(Config).

every_bug_is_found(_) ->
    Bugs = [Bug || {Bug, _, _} <- starl_planted:bugs()],
    Found = [{Bug, starl_dev_planted_seed:caught({Bug, ?SEEDS})} || Bug <- Bugs],
    ct:pal("~p", [Found]),
    ?assertEqual([], [Bug || {Bug, Other} <- Found, element(1, Other) =/= caught]),
    [
        ?assert(lists:member(Contract, contracts(Bug)), {Bug, Contract})
     || {Bug, {caught, _, #{contract := Contract}, _}} <- Found
    ],
    As = maps:from_list([{Bug, What} || {Bug, {caught, _, #{what := What}, _}} <- Found]),
    [?assertEqual({Bug, What}, {Bug, maps:get(Bug, As)}) || {Bug, What} <- starl_planted:breaks()].

%% What the paper says is a guarantee of a block, judged by a clause, which a bug breaks.
%% Holds: Each proposition has a guarantee, a clause and a planted bug
%% Red: 961f67c9: four empty cells
every_proposition_has_a_bug(_) ->
    Rows = starl_dev_planted_seed:propositions(),
    ct:pal("~p", [Rows]),
    [
        ?assertMatch({_, {_, _, _, _}, [_ | _], [_ | _]}, Row)
     || Row <- Rows
    ],
    Said = [Of || {Of, _, _, _} <- Rows],
    [
        ?assert(lists:any(fun(Of) -> lists:prefix(Paper, Of) end, Said), Paper)
     || Paper <- [
            "Assumption II.1",
            "Proposition 1(a)",
            "Proposition 1(b)",
            "Proposition 2(a)",
            "Proposition 2(b)",
            "Proposition 2(c)",
            "Proposition 3",
            "Proposition 3, δ",
            "Lemma 7",
            "ComputePath(c)"
        ]
    ].

%% The contracts that the block with the bug is to keep.
contracts(Bug) ->
    {Bug, Block, _} = lists:keyfind(Bug, 1, starl_planted:bugs()),
    case Block of
        bully -> [election];
        %% exercised by painting, which path planning must not keep from its end
        dpp -> [dpp, painting];
        _ -> [Block, calls]
    end.

at_least_one_per_block(_) ->
    Blocks = [Block || {_, Block, _} <- starl_planted:bugs()],
    ?assertEqual([], starl_block_catalogue:able(exercise) -- Blocks),
    ?assert(lists:member(dpp, Blocks)).

%% Without a bug the same search ends without a find: it is not the search that is broken.
nothing_is_found_in_the_sound(_) ->
    [
        begin
            Scenario = starl_planted:sound(starl_planted:scenario(Bug, Seed)),
            {ok, #{violations := Violations}} = starl_sim_trial:run(Scenario),
            ?assertEqual({Bug, Seed, []}, {Bug, Seed, Violations})
        end
     || Bug <- [sap_forgets, election_incomplete, bully_early, mutex_forgetful_home],
        Seed <- lists:seq(1, 5)
    ].

%% The restart that the broken barrier does not bear. And a mutex that grants what is held, whatever is
%% drawn: no start of an application is blamed, the run is said to break by itself, and where.
%% Holds: Where the truth is known, the event that `when` names is one that the bug makes wrong,
%% with ten branch seeds of ten; the same seed gives the same curve
%% Red: d3ad7b5b: see the two rows above
what_decides_is_named(_) ->
    {asked, _, [{Restart, true, {Before, 1.0}}], true, _} = asked(barrier_forgetful),
    ?assertMatch({match, _}, re:run(Restart, "a fault begins: {reboot")),
    ?assert(Before < 0.5),
    {asked, _, [{Grant, true, {1.0, 1.0}}], true, _} = asked(mutex_impatient_home),
    ?assertMatch({match, _}, re:run(Grant, "mutex .*: inevitable from the start")).

asked(Bug) -> starl_dev_planted_when:asked({Bug, ?SEEDS, 1}).

%% A block or an application that gets nowhere is found on a radio that loses a third of the packets, and beside a
%% fault that does no harm (./starl planted --progress has all cells), or the run says what it does not judge.
%% Holds: Progress is judged at any loss, and beside faults that cannot hold it up; where it is not
%% judged the run says so
%% Red: 961f67c9: no clause at these losses
progress_is_judged(_) ->
    Bugs = [Bug || {Bug, _, _} <- starl_progress_planted:bugs()],
    Harmless = [Name || {Name, _, Lasting} <- starl_progress_planted:cells(), Lasting =/= none],
    Cells = fun(N) -> ["loss 0.3", lists:nth(1 + N rem length(Harmless), Harmless)] end,
    Tried = [
        {Bug, Cell, Found}
     || {N, Bug} <- lists:enumerate(Bugs),
        {Cell, Found} <- starl_dev_planted_progress:tried(Bug, Cells(N))
    ],
    ct:pal("~p", [Tried]),
    ?assertEqual(2 * length(Bugs), length(Tried)),
    ?assertEqual([], [
        T
     || {_, _, Found} = T <- Tried, not starl_dev_planted_progress:is_right(Found)
    ]),
    %% no more than these go unjudged
    Unjudged = [{Bug, Cell} || {Bug, Cell, {not_judged, _}} <- Tried],
    ?assertEqual([], Unjudged -- unjudged()).

%% Bully promises nothing where packets are lost, relayed messages are few for so many losses, and a robot with a
%% slow wheel need not end.
unjudged() ->
    [
        {bully_mute, "loss 0.3"},
        {follow_mute, "loss 0.3"},
        {swarm_relays_nothing, "loss 0.3"},
        {painting_blind, "slow wheel"},
        {crossing_closed, "slow wheel"}
    ].

%% Without the bugs nobody is accused on such a radio.
the_sound_is_not_accused(_) ->
    Bugs = [sap_deaf, geocast_keeps, mutex_keeps, registers_deaf, counter_deaf, barrier_deaf],
    [
        begin
            Scenario = starl_progress_planted:scenario(Bug, {"", #{loss => Loss}, none}, Seed),
            {ok, #{violations := Violations}} = starl_sim_trial:run(
                starl_progress_planted:sound(Scenario)
            ),
            ?assertEqual({Bug, Loss, Seed, []}, {Bug, Loss, Seed, Violations})
        end
     || Bug <- Bugs, Loss <- [0.3, 0.6], Seed <- lists:seq(1, 10)
    ].

%% A radio that loses more than half keeps no coordinator from losing its lease: path planning says what it cannot judge.
what_is_not_judged_is_said(_) ->
    {ok, #{monitors := Results}} = starl_sim_trial:run(#{
        app => starl_painting, picture => "house", robots => 3, seed => 1, loss => 0.6, time => 30
    }),
    Lines = [lists:flatten(Line) || Line <- starl_monitor:clauses_not_judged(Results)],
    ct:pal("~p", [Lines]),
    ?assert(
        lists:member(
            "not judged: dpp, a free line that can be reached is assigned after a fail-over: the radio loses 60.0 %",
            Lines
        )
    ).
