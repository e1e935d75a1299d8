%% The set of planted bugs: building blocks that each fall into a pitfall, to show that the
%% monitors find it under random faults. It is `exercise' with a broken machine in the place of
%% the sound one; `none' is the sound one. `./starl planted' prints them all.
-module(starl_planted).
-behaviour(starl_scene).

-export([bugs/0, breaks/0, wrong/1, scenario/2, sound/1]).
-export([options/0, scene/1, report/2]).

%% Name, block, pitfall.
bugs() ->
    [{Bug, Block, Doc} || {Bug, Block, _, _, _, Doc} <- table()].

%% For each proposition of the paper a bug that breaks it (starl_block:propositions/1), and the violation
%% that it is found as.
breaks() ->
    [
        {election_incomplete, different_leaders},
        {election_ignores, announcement_ignored},
        {election_patient, no_result},
        {election_deaf, not_settled},
        {mutex_impatient_home, two_holders},
        {mutex_queueless, no_grant_in_time},
        {mutex_misnames, owner_not_announced},
        {mutex_unheeding, not_as_promised},
        {barrier_alone, passed_early},
        {barrier_doubting, late_pass},
        {geocast_clocks, too_late},
        {geocast_restart, not_delivered},
        {motion_unlooked, off_line},
        {motion_deaf, not_arrived},
        {dpp_blind_start, tubes_overlap},
        {dpp_farsighted, beyond_horizon},
        {dpp_idle, unanswered}
    ].

%% Name, block, broken machine, its configuration, changes of the scenario, and the pitfall.
table() ->
    lists:append([
        sap(),
        election(),
        bully(),
        mutex(),
        barrier(),
        geocast(),
        registers(),
        counter(),
        motion(),
        dpp(),
        search()
    ]).

sap() ->
    [
        {sap_restarts, sap, starl_sap_planted, #{variant => restarts}, #{},
            "sequence numbers restart with the robot"},
        {sap_forgets, sap, starl_sap_planted, #{variant => forgets}, #{},
            "forgets what it has already taken"},
        {sap_claims, sap, starl_sap_planted, #{variant => claims}, #{},
            "reports as acknowledged what nobody acknowledged"},
        {sap_tireless, sap, starl_sap_planted, #{variant => tireless}, #{},
            "no report after the last retransmission"},
        {sap_leaves_out, sap, starl_sap_planted, #{variant => leaves_out}, #{},
            "the answer to a broadcast leaves out the robots that refused it"},
        {sap_late, sap, starl_sap_planted, #{variant => late}, prompt(),
            "reports an outcome only when a retransmission is due"}
    ].

election() ->
    [
        {election_incomplete, election, starl_election_bug, #{bug => incomplete}, #{},
            "announces a leader from an incomplete set of ballots"},
        {election_deaf, election, starl_election_bug, #{bug => deaf},
            #{random_faults => [], delay => {20, 30}, judge => #{settle_us => 35000}},
            "drops ballots that come before it takes part itself"},
        {election_late, election, starl_election_bug, #{bug => late}, #{},
            "counts a late ballot of an earlier election"},
        {election_ignores, election, starl_election_bug, #{bug => ignores}, link_gone(),
            "does not elect who is announced"},
        {election_patient, election, starl_election_bug, #{bug => patient}, killed(),
            "waits for ever for a ballot that does not come"}
    ].

bully() ->
    [
        {bully_early, bully, starl_election_bug, #{bug => early}, lossless(),
            "makes itself leader before the higher robots can answer"},
        {bully_fickle, bully, starl_election_bug, #{bug => fickle}, #{},
            "takes each leader that is announced"}
    ].

mutex() ->
    [
        {mutex_impatient_home, mutex, starl_mutex_planted, #{variant => impatient_home}, #{},
            "grants a token anew before its lease is surely over"},
        {mutex_forgetful_home, mutex, starl_mutex_planted, #{variant => forgetful_home}, #{},
            "a restarted home grants what is still held"},
        {mutex_trusting, mutex, starl_mutex_planted, #{variant => trusting}, #{},
            "holds a token without the home's word: no fencing"},
        {mutex_overstaying, mutex, starl_mutex_planted, #{variant => overstaying, lease_ms => 300},
            #{}, "does not heed the end of its lease"},
        {mutex_untimely, mutex, starl_mutex_planted, #{variant => untimely, lease_ms => 500},
            stands_in_tokens(), "says that it holds a token after it has stood still"},
        {mutex_circles, mutex, starl_mutex_planted, #{variant => circles}, granted(),
            "chases stale owners in circles"},
        {mutex_queueless, mutex, starl_mutex_planted, #{variant => queueless}, queued(),
            "loses the queue of requesters at a hand-over"},
        {mutex_unreleased, mutex, starl_mutex_planted, #{variant => unreleased}, healed(),
            "keeps the tokens of an application that has crashed"},
        {mutex_misnames, mutex, starl_mutex_planted, #{variant => misnames}, #{},
            "announces another token than the one that it owns"},
        {mutex_unheeding, mutex, starl_mutex_planted, #{variant => unheeding}, healed(),
            "does not heed what owners announce"}
    ].

barrier() ->
    [
        {barrier_forgetful, barrier, starl_barrier_planted, #{variant => forgetful}, #{robots => 4},
            "a restarted machine begins with round 1"},
        {barrier_recreated, barrier, starl_barrier_planted, #{variant => recreated}, #{robots => 4},
            "a late duplicate opens the entry of the next round"},
        {barrier_alone, barrier, starl_barrier_planted, #{variant => alone}, #{robots => 4},
            "does not wait for those it has not heard of"},
        {barrier_hasty, barrier, starl_barrier_planted, #{variant => hasty}, #{robots => 4},
            "does not store that it has passed a round"},
        {barrier_careless, barrier, starl_barrier_planted, #{variant => careless},
            #{robots => 3, random_faults => [process, store]},
            "takes a damaged store for one that was never used"},
        {barrier_doubting, barrier, starl_barrier_planted, #{variant => doubting}, #{robots => 4},
            "asks again, though the others have acknowledged"}
    ].

geocast() ->
    [
        {geocast_clocks, geocast, starl_geocast_bug, #{bug => clocks}, #{},
            "compares times of clocks that are not synchronised"},
        {geocast_holds, geocast, starl_geocast_bug, #{bug => holds}, #{},
            "does not deduct the time that a message lies with a relay"},
        {geocast_trusts, geocast, starl_geocast_bug, #{bug => trusts}, #{},
            "counts a lifetime from the answer, not from the question"},
        {geocast_forgets, geocast, starl_geocast_bug, #{bug => forgets}, #{duplicate => 0.3},
            "forgets a message whose copies still travel"},
        {geocast_restart, geocast, starl_geocast_bug, #{bug => restart}, #{},
            "a restarted machine takes itself for a new one"}
    ].

registers() ->
    [
        {registers_restart, registers, starl_registers_bug, #{bug => restart}, #{},
            "the clock of a restarted machine goes back"},
        {registers_last_heard, registers, starl_registers_bug, #{bug => last_heard}, #{},
            "what comes last wins, whatever its stamp"},
        {registers_no_exchange, registers, starl_registers_bug, #{bug => no_exchange},
            #{judge => #{bound_us => 8000000}}, "what a broadcast missed stays missed"}
    ].

counter() ->
    [
        {counter_adds, counter, starl_counter_bug, #{bug => adds}, #{},
            "adds what it hears to what it has"},
        {counter_replaces, counter, starl_counter_bug, #{bug => replaces}, #{},
            "replaces what it has by what it hears"},
        {counter_zero, counter, starl_counter_bug, #{bug => zero}, #{}, "never shows a count"},
        {counter_reborn, counter, starl_counter_bug, #{bug => reborn}, #{final => 2, time => 600},
            "counts anew in the entry of an earlier life"}
    ].

motion() ->
    [
        {motion_unlooked, motion, starl_motion_unlooked_planted, #{}, #{},
            "looks where it stands before the first leg of a drive only"},
        {motion_deaf, motion, starl_motion_deaf_planted, #{},
            #{random_faults => [], time => 200, faults => [commands_lost()]},
            "waits for ever for the answer to a command that was lost"}
    ].

dpp() ->
    [
        {dpp_overstaying, dpp, starl_dpp_planted, "overstaying", cut_off(),
            "drives on when its lease has ended"},
        {dpp_fickle, dpp, starl_dpp_planted, "fickle", #{range => 9000},
            "votes for whoever asks, whatever it has promised"},
        {dpp_untimely, dpp, starl_coordinator_planted, "untimely", stood_still(),
            "assigns after it has stood still, when its votes have ended"},
        {dpp_idle, dpp, starl_coordinator_planted, "idle", #{},
            "takes no more requests than a few"},
        {dpp_newest, dpp, starl_mutant_planted, "newest", {soaked, late_votes()},
            "counts every vote from the newest beat"},
        {dpp_captive, dpp, starl_mutant_planted, "captive", complete(),
            "takes the robot's own tube for an obstacle"},
        {dpp_blind_start, dpp, starl_mutant_planted, "blind_start", #{},
            "does not check the way from the robot to the graph"},
        {dpp_short_edges, dpp, starl_mutant_planted, "short_edges", (complete())#{horizon => 400},
            "never assigns an edge that is longer than H"},
        {dpp_farsighted, dpp, starl_dpp_planted, "farsighted", (complete())#{horizon => 1000},
            "gives a robot more lines than the horizon at a time"},
        {dpp_freed, dpp, starl_coordinator_planted, "freed", #{loss => 0.3, sap => #{limit => 2}},
            "gives free what a lost assignment has reserved"},
        {dpp_hoarding, dpp, starl_mutant_planted, "hoarding", complete(),
            "frees by Clear alone, of which some is lost"},
        {dpp_late_clear, dpp, starl_coordinator_planted, "late_clear", #{loss => 0.3},
            "takes a late Clear for one of the present path"},
        {dpp_crossed, dpp, starl_mutant_planted, "crossed",
            #{picture => "lines", horizon => 100000},
            "takes edges that cross without a common vertex for apart"},
        {dpp_blind, dpp, starl_mutant_planted, "blind",
            #{picture => "hatch", speed => 500, time => 3600},
            "never sees every second line of the picture"},
        {painting_deaf_pen, dpp, starl_actuator_planted, "deaf_pen",
            #{random_faults => [actuator_lost], heal => 200, speed => 500, time => 3600},
            "takes the pen for lowered or raised without its word"}
    ].

search() ->
    [
        {search_middle, search, starl_search_planted, "middle", #{ball => nowhere},
            "looks from places that do not show the middle of rooms"},
        {search_off, search, starl_search_planted, "off", #{},
            "reports the ball 5 m from where it is"},
        {search_blind, search, starl_search_planted, "blind",
            #{ball => nowhere, faults => [{gone, 0, 300000, sense_gone, 1, #{sense => camera}}]},
            "counts what a camera that is gone would have seen"}
    ].

%% Robots may die; nothing else goes wrong, so that the highest must be elected.
lossless() -> #{random_faults => [kill_robot], judge => #{lossless => true}}.

%% A robot dies, and the others' patience ends long before the run.
killed() -> #{random_faults => [], faults => [{dies, 1, 1, kill_robot, 2, #{}}]}.

%% One robot never hears one other.
link_gone() ->
    #{
        random_faults => [],
        faults => [{gone, 0, 3600000, loss, {1, 2}, #{part => 1.0}}]
    }.

%% Nothing is lost: an acknowledgement is there after 40 ms, the first retransmission due after 50.
prompt() -> #{random_faults => [], delay => {5, 20}, judge => #{bound_us => 45000}}.

%% Now one robot, now the other stands still in a step in which it may coordinate, for longer than a
%% lease, which is short.
stood_still() ->
    #{
        random_faults => [],
        robots => 3,
        speed => 500,
        lease => 3000,
        jump => 50,
        faults => [
            {
                list_to_atom("still_" ++ integer_to_list(N)),
                From,
                From + 7000,
                stand_still,
                {1 + N rem 3, dpp_coordinator},
                #{actions => 1 + N rem 2}
            }
         || {N, From} <- lists:enumerate(lists:seq(5000, 140000, 9000))
        ]
    }.

%% Faults that lose no robot, and time after they have healed, in which each request that is made
%% has to be granted.
granted() ->
    #{
        random_faults => [network, kill_machine],
        heal => 10,
        converge => 50,
        work => 40,
        judge => #{granted => true, from_us => 25000000}
    }.

%% The votes of the other robot come later and later, then nothing is heard any more of the one that
%% leads: soak draws such faults, but rarely in this order where a single vote decides.
late_votes() ->
    Late = [
        {list_to_atom("late_" ++ integer_to_list(N)), 4000 * N, 60000, delay, {1, 2}, #{
            extra_ms => 1000
        }}
     || N <- lists:seq(1, 8)
    ],
    #{
        robots => 2,
        lease => 5000,
        jump => 50,
        random_faults => [],
        faults => [{cut, 36000, 60000, one_way_partition, [2], #{}} | Late]
    }.

%% What was promised has to come true when all faults are over.
healed() -> #{final => 2, converge => 2000, time => 7200}.

%% Nothing goes wrong: a request waits for some holds of at most 100 ms, or until the requester asks
%% again, after 3 s, where it came to a robot that has handed the token over. It need not ask twice.
queued() -> #{random_faults => [], hold => 100, judge => #{bound_us => 4500000}}.

%% Commands of one robot to its chassis are lost, now and then.
commands_lost() -> {lost, 1000, 20000, command_lost, 1, #{part => 0.3}}.

%% One robot hears nothing for longer than its lease lasts.
cut_off() -> #{faults => [{cut, 20000, 60000, partition, [2], #{}}]}.

%% Nothing goes wrong, and every line has to be painted.
complete() -> #{speed => 500, time => 3600, judge => #{complete => true}}.

%% What a bug makes wrong, for ./starl planted --when: the classes of faults that it does not bear, the starts
%% after the first, or what its block does. It follows from the pitfall, not from any run.
wrong(Bug) ->
    {Bug, Block, _} = lists:keyfind(Bug, 1, bugs()),
    case lists:member(Bug, restarts()) of
        true ->
            [{fault, process}, {fault, store}, restart];
        false ->
            [{fault, network} || lists:member(Bug, losses())] ++ [{block, machine(Block)}]
    end.

%% Bugs of a machine that starts anew.
restarts() ->
    [
        sap_restarts,
        bully_fickle,
        mutex_forgetful_home,
        barrier_forgetful,
        barrier_hasty,
        barrier_careless,
        geocast_restart,
        registers_restart,
        counter_reborn
    ].

%% Bugs that show when packets are lost, late or come twice.
losses() ->
    [
        sap_forgets,
        sap_claims,
        sap_tireless,
        election_incomplete,
        election_late,
        barrier_recreated,
        barrier_alone,
        geocast_forgets,
        registers_last_heard,
        registers_no_exchange,
        dpp_overstaying
    ].

machine(bully) -> election;
machine(dpp) -> dpp_coordinator;
machine(search) -> app;
machine(Block) -> Block.

%% The run of a bug with a seed, and the same without the bug.
scenario(Bug, Seed) ->
    case lists:keyfind(Bug, 1, table()) of
        %% short leases, and faults that outlast them
        {Bug, dpp, _Machine, Variant, {soaked, Changes}, _Doc} ->
            Soaked = starl_lab_soak:scenario(dpp, none, Seed),
            maps:merge(Soaked#{app := starl_dpp_planted, bug => Variant}, Changes);
        {Bug, Block, _Machine, Config, Changes, _Doc} ->
            maps:merge(run(Bug, Block, Config, Seed), Changes)
    end.

run(_Bug, dpp, Variant, Seed) ->
    #{
        app => starl_dpp_planted,
        bug => Variant,
        picture => "house",
        robots => 5,
        speed => 100,
        time => 400,
        seed => Seed
    };
run(_Bug, search, Variant, Seed) ->
    #{
        app => starl_search_planted,
        bug => Variant,
        floor => "search",
        ball => random,
        robots => 3,
        time => 900,
        seed => Seed
    };
run(Bug, Block, _Config, Seed) ->
    #{
        app => ?MODULE,
        bug => Bug,
        block => Block,
        robots => 6,
        seed => Seed,
        random_faults => [all],
        heal => 25,
        converge => 35,
        time => 60
    }.

sound(#{app := App} = Scenario) when App =:= starl_dpp_planted; App =:= starl_search_planted ->
    Scenario#{bug => "none"};
sound(Scenario) ->
    Scenario#{bug => none}.

%% -- the application ------------------------------------------------------------------------

options() ->
    Names = [none | [Bug || {Bug, _, _} <- bugs()]],
    [
        {bug, {one_of, Names}, none, "which bug"},
        {judge, {term, "a map", fun is_map/1}, #{}, "what the block's monitor asks besides"}
        | starl_exercise:options()
    ].

scene(#{options := #{bug := Bug} = Options} = Context) ->
    Known = Context#{options := maps:without([bug, judge], Options)},
    {ok, Listed} = starl_exercise:scene(Known),
    {ok, judged(Options, planted(lists:keyfind(Bug, 1, table()), expanded(Listed, Known)))}.

expanded(#{blocks := Blocks, monitors := Others} = Scene, Context) ->
    {ok, {Machines, Contracts}} = starl_block:expand(Blocks, Context),
    Scene#{blocks := Machines, monitors := Contracts ++ Others}.

planted(false, Scene) ->
    Scene;
planted({_, sap, Machine, Config, _, _}, #{sap := Sap} = Scene) ->
    Scene#{sap := maps:merge(Sap, Config), sap_machine => Machine};
planted({_, motion, Machine, _, _, _}, Scene) ->
    Scene#{motion_machine => Machine};
planted({_, _, Machine, Config, _, _}, #{blocks := [{Name, _, Sound} | Blocks]} = Scene) ->
    Scene#{blocks := [{Name, Machine, maps:merge(Sound, Config)} | Blocks]}.

judged(#{block := sap, judge := #{bound_us := _} = Judge}, #{monitors := Others} = Scene) ->
    Scene#{monitors := [{starl_sap_prompt_planted, Judge} | Others]};
judged(#{judge := Judge}, #{monitors := [{Monitor, Config} | Others]} = Scene) ->
    Scene#{monitors := [{Monitor, maps:merge(Config, Judge)} | Others]}.

report(Scene, Outcome) -> starl_exercise:report(Scene, Outcome).

%% The same for holders of tokens, whose lease is half a second.
stands_in_tokens() ->
    #{
        random_faults => [],
        robots => 3,
        faults => [
            {
                list_to_atom("still_" ++ integer_to_list(N)),
                From,
                From + 1500,
                stand_still,
                {1 + N rem 3, mutex},
                #{actions => 1 + N rem 4}
            }
         || {N, From} <- lists:enumerate(lists:seq(1000, 40000, 2000))
        ]
    }.
