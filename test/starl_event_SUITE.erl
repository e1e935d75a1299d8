%% No event of a building block or of the platform can be renamed unnoticed, and each is what its
%% machine's type says.
-module(starl_event_SUITE).
-include_lib("stdlib/include/assert.hrl").

-export([suite/0, all/0, groups/0, init_per_suite/1, end_per_suite/1]).
-export([init_per_group/2, end_per_group/2]).
-export([
    vocabularies_are_the_types/1, pages_list_the_events/1, renamed_is_told/1, rare_is_tested/1
]).

%% So many runs of soak of each block.
-define(SEEDS, 10).
-define(BLOCKS, [sap, election, bully, mutex, barrier, geocast, registers, counter, dpp]).

suite() -> [{timetrap, {minutes, 8}}].

all() ->
    [vocabularies_are_the_types, pages_list_the_events, {group, runs}, rare_is_tested].

groups() -> [{runs, [renamed_is_told]}].

init_per_suite(Config) -> starl_platform_ct:without_log(Config).

end_per_suite(Config) -> starl_platform_ct:with_log(Config).

init_per_group(runs, Config) ->
    Asking = starl_event_renamed:instrument(modules()),
    [{asking, Asking} | Config].

end_per_group(runs, Config) ->
    starl_event_renamed:restore(proplists:get_value(asking, Config)).

modules() ->
    lists:append([
        begin
            _ = application:load(App),
            {ok, Modules} = application:get_key(App, modules),
            Modules
        end
     || App <- [starl_platform, starl_run, starl_sim, starl_blocks, starl_apps]
    ]).

%% The machines of a block's runs: where their events are typed, and what the modules that trace
%% them are called.
machines(Block) ->
    Own = own(Block),
    Common = [{starl_event, machine}],
    Whole = fun(_Machine, {Types, Modules}) -> {Types ++ Common, Modules} end,
    maps:merge(platform(), maps:map(Whole, Own)).

own(dpp) ->
    Election = own(election),
    Election#{
        dpp => {[{starl_dpp_participant, event}], "starl_dpp_participant"},
        dpp_coordinator => {[{starl_dpp_coordinator, event}], "starl_dpp"},
        actuator => {[{starl_actuator, event}], "starl_actuator"},
        app => {[{starl_painting, event}, {starl_event, app}], "starl"}
    };
own(Block) ->
    maps:merge(services(), maps:from_list([{name(Block), block(Block)} || Block =/= sap])).

services() ->
    #{
        sap => {[{starl_sap, event}], "starl_sap"},
        location => {[{starl_location, event}], "starl_location"},
        motion => {[{starl_motion, event}], "starl_motion"},
        app => {[{starl_block_exercise, event}, {starl_event, app}], "starl"}
    }.

name(bully) -> election;
name(Block) -> Block.

block(election) -> {[{starl_election_ballots, event}], "starl_election_ballots"};
block(bully) -> {[{starl_election_bully, event}], "starl_election_bully"};
block(mutex) -> {[{starl_mutex_tokens, event}], "starl_mutex"};
block(barrier) -> {[{starl_barrier_rounds, event}], "starl_barrier"};
block(geocast) -> {[{starl_geocast_flood, event}], "starl_geocast"};
block(registers) -> {[{starl_registers_lww, event}], "starl_registers"};
block(counter) -> {[{starl_counter_gossip, event}], "starl_counter"}.

platform() ->
    maps:from_list([
        {Machine, {[{starl_event, Machine}], "starl"}}
     || Machine <- [robot, supervisor, chassis, radio]
    ]).

%% -- the cases ------------------------------------------------------------------------------

%% What a monitor names is what the machine's type has, no more and no less.
vocabularies_are_the_types(_) ->
    [
        ?assertEqual({Machine, typed(Types)}, {Machine, lists:sort(Names)})
     || {Machine, Types, Names} <- vocabularies()
    ],
    %% what the platform traces in any machine's name is known of each
    Known = starl_event:known([#{door => [], app => []}]),
    Whole = fun(Machine) ->
        [Name || Name <- typed([machine, app]), starl_event:is_known(Machine, event(Name), Known)]
    end,
    ?assertEqual(typed([machine]), Whole(door)),
    ?assertEqual(typed([machine, app]), Whole(app)),
    ?assertEqual(typed([machine]), Whole(motion)).

vocabularies() ->
    Platform = maps:to_list(maps:without([location, motion, actuator], starl_event:platform())),
    [{Machine, [Machine], Names} || {Machine, Names} <- Platform] ++
        [
            {Machine, [{Module, event}], Names}
         || {Monitor, Typed} <- monitors(),
            {Machine, Names} <- maps:to_list(Monitor:vocabulary()),
            {Of, Module} <- Typed,
            Of =:= Machine
        ].

monitors() ->
    [
        {starl_sap_monitor, [{sap, starl_sap}]},
        {starl_motion_monitor, [{motion, starl_motion}]},
        {starl_election_monitor, [{election, starl_election_ballots}]},
        {starl_election_bully_monitor, [{election, starl_election_bully}]},
        {starl_mutex_monitor, [{mutex, starl_mutex_tokens}]},
        {starl_barrier_monitor, [{barrier, starl_barrier_rounds}]},
        {starl_geocast_monitor, [{geocast, starl_geocast_flood}]},
        {starl_registers_monitor, [{registers, starl_registers_lww}]},
        {starl_counter_monitor, [{counter, starl_counter_gossip}]},
        {starl_dpp_monitor, [
            {dpp, starl_dpp_participant}, {dpp_coordinator, starl_dpp_coordinator}
        ]},
        {starl_exercise_monitor, [{app, starl_block_exercise}]},
        {starl_painting_monitor, [{app, starl_painting}]}
    ].

typed(Types) ->
    lists:usort(
        lists:append([
            case Type of
                {Module, Of} -> starl_event_type:names(Module, Of);
                _ -> starl_event_type:names(starl_event, Type)
            end
         || Type <- Types
        ])
    ).

event({Tag, 0}) -> Tag;
event({Tag, Size}) -> list_to_tuple([Tag | lists:duplicate(Size, x)]).

%% Each event stands in the table of its page.
pages_list_the_events(_) ->
    [
        ?assertEqual({Type, Name, true}, {Type, Name, is_listed(Name, page(Type))})
     || {_, Types, Names} <- vocabularies(),
        Type <- [type_of(Types)],
        Type =/= starl_block_exercise,
        Name <- Names
    ].

is_listed({Tag, 0}, Page) ->
    is_in(io_lib:format("`~s`", [Tag]), Page);
is_listed({Tag, Size}, Page) ->
    Commas = lists:duplicate(Size, "[^`]*,"),
    is_in(io_lib:format("`{~s~ts[^`]*}`", [Tag, Commas]), Page).

is_in(Expression, Page) -> re:run(Page, Expression, [{capture, none}]) =:= match.

page(Type) ->
    Root = hd(string:split(code:which(?MODULE), "/_build/")),
    [File] = [
        F
     || F <- filelib:wildcard(filename:join(Root, "apps/*/doc/*.md")),
        filename:basename(F, ".md") =:= page_of(Type)
    ],
    {ok, Page} = file:read_file(File),
    Page.

page_of(Type) ->
    case string:lexemes(atom_to_list(Type), "_") of
        [_] -> "robot";
        [_, Block | _] -> Block
    end.

%% All that runs of soak trace is of the types; each event that they trace, under another name in
%% the run in which it came first, is told by that name; and what they do not trace a test makes.
renamed_is_told(_) ->
    Traced = [
        {Block, Event, Seed}
     || Block <- ?BLOCKS, {Event, Seed} <- lists:sort(maps:to_list(traced(Block)))
    ],
    Told = [
        renamed(Block, Machine, Name, Seed)
     || {Block, {Machine, Name}, Seed} <- Traced, judged(Block, Machine)
    ],
    ct:pal("~b events of runs were told under another name", [length(Told)]),
    All = [{type_of(Types), Name} || {_, Types, Names} <- vocabularies(), Name <- Names],
    Seen = [
        {type_of(element(1, maps:get(Machine, machines(Block)))), Name}
     || {Block, {Machine, Name}, _} <- Traced
    ],
    ?assertEqual([], (All -- Seen) -- [{Type, Name} || {Type, Name, _} <- rare()]).

%% The first is its own.
type_of([{Module, event} | _]) -> Module;
type_of([{starl_event, Type} | _]) -> Type;
type_of([Type]) -> Type.

%% The names of what the runs of a block trace, by the first seed.
traced(Block) ->
    lists:foldl(fun(Seed, Traced) -> traced(Block, Seed, Traced) end, #{}, lists:seq(1, ?SEEDS)).

traced(Block, Seed, Traced) ->
    Types = maps:map(fun(_, {Types, _}) -> Types end, machines(Block)),
    #{violations := Violations, monitors := #{starl_event_recorder := Recorded}} =
        run(Block, Seed, [{starl_event_recorder, #{types => Types}}]),
    #{seen := Seen, wrong := Wrong} = Recorded,
    ?assertEqual({Block, Seed, [], []}, {Block, Seed, Violations, Wrong}),
    maps:merge(maps:from_list([{Event, Seed} || Event <- Seen]), Traced).

run(Block, Seed, Watch) ->
    Scenario = starl_lab_soak:scenario(Block, none, Seed),
    {ok, Sim} = starl_sim:start(Scenario#{mode => inline, shards => 1}, #{watch => Watch}),
    _ = starl_sim:run(Sim),
    {Outcome, _} = starl_sim:finish(Sim),
    Outcome.

renamed(Block, Machine, {Tag, Size} = Name, Seed) ->
    #{Machine := {_, Modules}} = machines(Block),
    ok = starl_event_renamed:rename(tracing(Name, Modules), Name),
    #{violations := Violations} = run(Block, Seed, []),
    ok = starl_event_renamed:rename(none),
    Told = [
        Event
     || #{contract := Of, what := unknown_event, details := #{event := Event}} <-
            Violations,
        Of =:= Machine
    ],
    ?assertMatch({Block, Machine, Tag, Seed, [_]}, {Block, Machine, Tag, Seed, Told}),
    [Event] = Told,
    ?assertEqual(event({renamed, Size}), blank(Event)),
    {Block, Machine, Name, Seed}.

blank(Event) when is_tuple(Event) -> event({element(1, Event), tuple_size(Event) - 1});
blank(Event) -> Event.

%% What any machine may trace is not traced by its own modules.
tracing(Name, Modules) ->
    case lists:member(Name, typed([machine])) of
        true -> "starl";
        false -> Modules
    end.

%% What stands for path planning and the others is judged in their own runs.
judged(sap, _Machine) -> true;
judged(dpp, Machine) -> lists:member(Machine, [dpp, dpp_coordinator, app]);
judged(Block, Machine) -> Machine =:= name(Block).

%% What does not come in those runs has a test that makes it, and is told under another name, too.
rare_is_tested(_) ->
    [
        ?assert(erlang:function_exported(Module, Test, Arity), {Module, Test})
     || {_, _, {Module, Test, Arity}} <- rare(), {module, _} <- [code:ensure_loaded(Module)]
    ],
    [
        begin
            Is = [is_known(Machine, N, Names) || N <- [Name, {renamed, Size}]],
            ?assertEqual({Machine, Name, [true, false]}, {Machine, Name, Is})
        end
     || {Machine, _, Names} <- vocabularies(), {_, Size} = Name <- Names
    ].

is_known(Machine, Name, Names) ->
    starl_event:is_known(Machine, event(Name), starl_event:known([#{Machine => Names}])).

%% These come in no run of the first of soak: a test of the machine makes them.
rare() ->
    [
        {robot, {late, 2}, {starl_live_link_tests, a_computer_that_is_late_is_told_of_test, 0}},
        {supervisor, {crashed, 2}, {starl_sim_crash_tests, machine_crashed_test, 0}},
        {supervisor, {given_up, 1}, {starl_sim_crash_tests, block_given_up_test, 0}},
        {chassis, {not_understood, 1}, {starl_sim_holonomic_SUITE, another_chassis_script, 1}},
        {chassis, {sensed, 1}, {starl_create_senses_SUITE, a_button_is_felt, 1}},
        {starl_motion, {velocity, 2},
            {starl_velocity_tests, a_velocity_and_its_end_are_traced_test, 0}},
        {starl_motion, {velocity_over, 1},
            {starl_velocity_tests, a_velocity_and_its_end_are_traced_test, 0}},
        {starl_sap, {overload, 1}, {starl_sap_tests, a_full_window_is_an_overload_test, 0}},
        {starl_sap, {full, 2}, {starl_sap_tests, not_taken_test, 0}},
        {starl_sap, {unclaimed_full, 2}, {starl_sap_tests, not_taken_test, 0}},
        {starl_sap, {unheard, 2},
            {starl_sap_tests, a_datagram_without_a_listener_is_traced_test, 0}},
        {starl_sap, {dropped, 2}, {starl_sap_tests, usual_window_test, 0}},
        {starl_sap, {listener_refused, 3}, {starl_sap_tests, second_listener_test, 0}},
        {starl_election_bully, {failed, 2}, {starl_election_bully_tests, gives_up_test, 0}},
        {starl_geocast_flood, {full, 1}, {starl_geocast_steps_tests, full_test, 0}},
        {starl_registers_lww, {too_far_ahead, 2}, {starl_registers_lww_tests, ahead_test, 0}},
        {starl_registers_lww, {refused, 3}, {starl_registers_lww_tests, refused_test, 0}},
        {starl_registers_lww, {denied, 1}, {starl_registers_lww_tests, denied_test, 0}},
        {starl_registers_lww, {set_right, 1}, {starl_registers_lww_tests, denied_test, 0}},
        {starl_dpp_participant, {stale_answer, 3},
            {starl_dpp_participant_SUITE, answer_is_taken_once, 1}},
        {starl_dpp_participant, {blocked, 1},
            {starl_dpp_participant_SUITE, what_is_in_the_way_is_told, 1}},
        {starl_dpp_participant, {doubted, 2},
            {starl_dpp_follower_tests, a_term_too_far_above_is_not_followed_test, 0}},
        {starl_dpp_coordinator, {doubted, 2},
            {starl_dpp_doubt_tests, a_claim_finds_above_a_raised_robot_test, 0}},
        {starl_dpp_coordinator, {closed, 1},
            {starl_dpp_dispatcher_tests, a_closed_way_is_tried_again_test, 0}},
        {starl_dpp_coordinator, {reopened, 0},
            {starl_dpp_dispatcher_tests, a_closed_way_is_tried_again_test, 0}},
        {starl_dpp_coordinator, {deadlock_resolved, 1},
            {starl_dpp_dispatcher_tests, deadlock_is_counted_test, 0}},
        {starl_dpp_coordinator, {in_the_way, 2},
            {starl_dpp_dispatcher_tests, a_silent_robot_in_the_way_is_named_test, 0}},
        {starl_dpp_coordinator, {unreachable, 1},
            {starl_dpp_coordinator_SUITE, unreachable_unknown_robot_ends, 1}},
        {starl_dpp_coordinator, {malformed, 2},
            {starl_dpp_dispatcher_tests, stray_lines_are_traced_test, 0}}
    ].
