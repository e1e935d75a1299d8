%% The contract of the election by randomized ballots (DESIGN section 3): any two robots that
%% elect in the same election elect the same leader; an announcement elects the announced; else
%% failure in bounded time. No loss: all elect the same.
-module(starl_election_SUITE).
-include_lib("stdlib/include/assert.hrl").
-include_lib("proper/include/proper.hrl").

-export([all/0, init_per_suite/1, end_per_suite/1]).
-export([
    contract_under_faults/1, no_loss_all_elect/1, many_elections/1, late_starter/1,
    dead_robot_bounded_failure/1, restart_in_the_middle/1, failed_robot_may_call_again/1,
    early_ballots_are_kept/1, incomplete_ballots_elect_nobody/1, largest_ballot_wins/1,
    earlier_election_does_not_count/1, announcement_elects/1, announcement_before_entering/1,
    duplicates_change_nothing/1, same_ballot_after_a_crash/1, late_ballot_is_told_the_leader/1,
    memory_is_bounded/1, waiting_caller_is_answered/1
]).

all() ->
    [
        contract_under_faults, no_loss_all_elect, many_elections, late_starter,
        dead_robot_bounded_failure, restart_in_the_middle, failed_robot_may_call_again,
        early_ballots_are_kept, incomplete_ballots_elect_nobody, largest_ballot_wins,
        earlier_election_does_not_count, announcement_elects, announcement_before_entering,
        duplicates_change_nothing, same_ballot_after_a_crash, late_ballot_is_told_the_leader,
        memory_is_bounded, waiting_caller_is_answered
    ].

init_per_suite(Config) ->
    #{level := Level} = logger:get_primary_config(),
    ok = logger:set_primary_config(level, none),
    [{level, Level} | Config].

end_per_suite(Config) -> logger:set_primary_config(level, proplists:get_value(level, Config)).

%% -- in the simulator -----------------------------------------------------------------------

%% Safety and bounded time, with loss, duplicates, delays and crashes at any moment; a robot
%% that failed calls again.
contract_under_faults(_) ->
    Prop = ?FORALL(
        {Seed, N, Loss, Duplicate, Kills, Starts},
        {oneof(lists:seq(1, 1000)), oneof([2, 3, 5]), oneof([0.0, 0.2, 0.6, 0.9]),
         oneof([0.0, 0.3]), resize(8, list({oneof(lists:seq(0, 4000, 13)), oneof([1, 2, 3, 4, 5]),
                                            oneof([election, election, sap, app, robot])})),
         vector(5, oneof([0, 1, 30, 500, 4000]))},
        starl_platform_ct:safely(fun() ->
            Script = fun(R) ->
                ok = starl:sleep(R, lists:nth(starl:id(R), Starts)),
                persist(R, first, 4)
            end,
            Faults = [fault(K, T, (R - 1) rem N + 1, M) || {K, {T, R, M}} <- numbered(Kills)],
            {Violations, Results} = elect(N, Script, #{
                seed => Seed, loss => Loss, duplicate => Duplicate, delay => {5, 80},
                faults => Faults
            }),
            Leaders = lists:usort([L || {done, {ok, L}} <- Results]),
            Ended = [R || R <- Results, R =:= running] =:= [],
            Violations =:= [] andalso length(Leaders) =< 1 andalso Ended orelse
                begin
                    io:format("~p~n~p~n", [Violations, Results]),
                    false
                end
        end)
    ),
    starl_platform_ct:property(Prop, 60).

persist(R, Election, Tries) ->
    case starl_election:elect(R, Election, 8000) of
        {ok, Leader} -> {ok, Leader};
        {error, _} when Tries > 1 -> persist(R, Election, Tries - 1);
        {error, Why} -> {error, Why}
    end.

fault(K, T, R, robot) -> {label(K), T, T, kill_robot, R, #{}};
fault(K, T, R, Machine) -> {label(K), T, T, kill_machine, {R, Machine}, #{}}.

label(K) -> list_to_atom("fault" ++ integer_to_list(K)).

numbered(List) -> lists:zip(lists:seq(1, length(List)), List).

%% Progress: no loss, then all elect the same.
no_loss_all_elect(_) ->
    [
        begin
            {[], Results} = elect(N, fun(R) -> starl_election:elect(R, e) end, #{seed => Seed}),
            ?assertMatch([{done, {ok, L}}] when is_integer(L), lists:usort(Results))
        end
     || N <- [1, 2, 8, 16], Seed <- [1, 2, 3]
    ].

%% One after the other; over many of them everybody leads (the ballots are random).
many_elections(_) ->
    {[], Results} = elect(4, fun(R) ->
        [element(2, {ok, _} = starl_election:elect(R, {e, K})) || K <- lists:seq(1, 100)]
    end, #{loss => 0.1}),
    [{done, Leaders}] = lists:usort(Results),
    ?assertEqual([1, 2, 3, 4], lists:usort(Leaders)),
    [?assert(length([L || L <- Leaders, L =:= R]) > 8) || R <- [1, 2, 3, 4]].

%% Ballots that come before the local robot has started are kept.
late_starter(_) ->
    {[], Results} = elect(3, fun(R) ->
        ok = starl:sleep(R, 20000 * (starl:id(R) - 1)),
        starl_election:elect(R, e, 60000)
    end, #{}),
    ?assertMatch([{done, {ok, _}}], lists:usort(Results)).

dead_robot_bounded_failure(_) ->
    {[], Results} = elect(3, fun(R) ->
        ok = starl:sleep(R, 10),
        Before = starl:now(R),
        Answer = starl_election:elect(R, e, 5000),
        {Answer, starl:now(R) - Before}
    end, #{faults => [fault(1, 0, 2, robot)]}),
    ?assertMatch([{done, {{error, timeout}, 5000}}, died, {done, {{error, timeout}, 5000}}], Results).

%% The election machine crashes at every moment of an election: in the end all agree.
restart_in_the_middle(_) ->
    [
        begin
            {[], Results} = elect(3, fun(R) -> persist(R, e, 4) end,
                #{delay => {5, 40}, loss => 0.2, faults => [fault(1, T, 2, election)]}),
            ?assertMatch({T, [{done, {ok, _}}]}, {T, lists:usort(Results)})
        end
     || T <- lists:seq(0, 200, 10)
    ].

failed_robot_may_call_again(_) ->
    {[], Results} = elect(2, fun(R) ->
        ok = starl:sleep(R, 10000 * (starl:id(R) - 1)),
        First = starl_election:elect(R, e, 2000),
        {First, persist(R, e, 4)}
    end, #{}),
    ?assertMatch([{done, {{error, timeout}, {ok, L}}}, {done, {{ok, L}, {ok, L}}}], Results).

elect(N, Script, Scenario) ->
    Around = #{
        blocks => [{election, starl_election_ballots, #{}}],
        monitors => [{starl_election_monitor, #{
            robots => lists:seq(1, N), bound_us => 61000000, complete => true
        }}]
    },
    {ok, Sim} = starl_sim:start(maps:merge(#{
        app => starl_sim_script_app, robots => N, script => Script, around => Around, time => 1000
    }, Scenario)),
    starl_sim:run(Sim),
    {#{violations := Violations, robots := Robots}, _} = starl_sim:finish(Sim),
    {Violations, [Result || {_, #{result := Result}} <- Robots]}.

%% -- the machine alone ----------------------------------------------------------------------

early_ballots_are_kept(_) ->
    {[], M1} = hear(2, {e, {900000, 2}}, new(3)),
    {[], M2} = hear(3, {e, {5, 3}}, M1),
    {Actions, _} = enter(e, M2),
    ?assertMatch([{ok, _}], answers(Actions)).

%% Pitfall: announcing a leader from an incomplete ballot set.
incomplete_ballots_elect_nobody(_) ->
    {Entered, M1} = enter(e, new(3)),
    ?assertEqual([], answers(Entered)),
    {Heard, M2} = hear(2, {e, {5, 2}}, M1),
    ?assertEqual([], Heard),
    {Again, M3} = hear(2, {e, {5, 2}}, M2),
    ?assertEqual([], Again),
    {Elected, _} = hear(3, {e, {5, 3}}, M3),
    ?assertMatch([{ok, _}], answers(Elected)).

%% Ties go to the larger robot.
largest_ballot_wins(_) ->
    {_, M1} = enter(e, new(3)),
    {_, M2} = hear(2, {e, {1 bsl 31, 2}}, M1),
    {Elected, _} = hear(3, {e, {1 bsl 31, 3}}, M2),
    ?assertEqual([{ok, 3}], answers(Elected)),
    ?assert(lists:member({cast, sap, {broadcast, leader, {e, 3}}}, Elected)).

%% Pitfall: ballots of an earlier election counted in a later one.
earlier_election_does_not_count(_) ->
    {_, M1} = hear(2, {e1, {5, 2}}, new(3)),
    {_, M2} = hear(3, {e1, {5, 3}}, M1),
    {Entered, M3} = enter(e2, M2),
    ?assertEqual([], answers(Entered)),
    {Heard, _} = hear(2, {e2, {5, 2}}, M3),
    ?assertEqual([], answers(Heard)).

announcement_elects(_) ->
    {_, M1} = enter(e, new(3)),
    {Actions, M2} = announce(2, {e, 3}, M1),
    ?assertEqual([{ok, 3}], answers(Actions)),
    ?assert(lists:member({trace, {elected, e, 3, announcement}}, Actions)),
    {Second, _} = announce(2, {e, 2}, M2),
    ?assertEqual([], Second).

announcement_before_entering(_) ->
    {_, M1} = announce(2, {e, 3}, new(3)),
    {Actions, _} = enter(e, M1),
    ?assertEqual([{ok, 3}], answers(Actions)).

duplicates_change_nothing(_) ->
    {_, M1} = enter(e, new(2)),
    {Elected, M2} = hear(2, {e, {5, 2}}, M1),
    [{ok, Leader}] = answers(Elected),
    {Late, _} = hear(2, {e, {1 bsl 31, 2}}, M2),
    ?assertEqual([{cast, sap, {send, 2, leader, {e, Leader}}}], Late).

%% A robot casts one ballot per election, also over a crash.
same_ballot_after_a_crash(_) ->
    Ballots = [
        [B || {trace, {ballot, e, B}} <- element(1, enter(e, new(3, Incarnation)))]
     || Incarnation <- [1, 2]
    ],
    ?assertMatch([[B], [B]], Ballots).

late_ballot_is_told_the_leader(_) ->
    {_, M1} = announce(2, {e, 3}, new(3)),
    {Actions, _} = hear(2, {e, {5, 2}}, M1),
    ?assertEqual([{cast, sap, {send, 2, leader, {e, 3}}}], Actions).

memory_is_bounded(_) ->
    After = fun(N) ->
        M = lists:foldl(
            fun(K, M) -> element(2, hear(2, {{e, K}, {5, 2}}, M)) end, new(3), lists:seq(1, N)
        ),
        erts_debug:flat_size(starl_machine:data(M))
    end,
    ?assert(After(1000) < After(100) * 1.1).

%% However many other elections are heard of meanwhile, who waits is answered in bounded time.
waiting_caller_is_answered(_) ->
    {_, M1} = enter(e, new(3)),
    M2 = lists:foldl(
        fun(K, M) -> element(2, hear(2, {{other, K}, {5, 2}}, M)) end, M1, lists:seq(1, 100)
    ),
    {Actions, _} = starl_machine:step({timeout, {patience, e}}, patience, meta(), M2),
    ?assertEqual([{error, timeout}], answers(Actions)).

new(N) -> new(N, 1).

new(N, Incarnation) ->
    {_, Machine} = starl_machine:new(starl_election_ballots, #{}, #{
        robot => 1, participants => lists:seq(1, N), name => election,
        incarnation => Incarnation, random => rand:seed_s(exsss, 1), now => 0
    }),
    Machine.

enter(Election, M) ->
    starl_machine:step({call, {app, tag}}, {elect, Election, 1000000}, meta(), M).

hear(From, Ballot, M) -> starl_machine:step(cast, {message, From, ballot, Ballot}, meta(), M).

announce(From, Leader, M) -> starl_machine:step(cast, {message, From, leader, Leader}, meta(), M).

meta() -> #{now => 0, robot => 1}.

answers(Actions) -> [Answer || {reply, {app, tag}, Answer} <- Actions].
