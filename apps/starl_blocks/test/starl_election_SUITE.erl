%% The contracts of the two elections (README), in the simulator and machine by machine.
%% starl_election_monitor and starl_election_bully_monitor are the judges.
-module(starl_election_SUITE).
-include_lib("stdlib/include/assert.hrl").
-include_lib("proper/include/proper.hrl").

-export([all/0]).
-export([
    ballots_under_faults/1,
    bully_under_faults/1,
    bully_without_loss/1,
    planted_bugs_are_caught/1,
    bully_highest_are_dead/1,
    bully_leader_dies_when_elected/1,
    bully_one_leader_per_term/1,
    bully_remembers_old_elections/1,
    ballots_incomplete_set_elects_nobody/1,
    ballots_before_the_start_count/1,
    ballots_of_another_election_do_not_count/1,
    ballots_late_one_is_answered/1,
    ballots_awaited_election_is_kept/1,
    bully_challenged_takes_part/1
]).

all() ->
    [
        ballots_under_faults,
        bully_under_faults,
        bully_without_loss,
        planted_bugs_are_caught,
        bully_highest_are_dead,
        bully_leader_dies_when_elected,
        bully_one_leader_per_term,
        bully_remembers_old_elections,
        ballots_incomplete_set_elects_nobody,
        ballots_before_the_start_count,
        ballots_of_another_election_do_not_count,
        ballots_late_one_is_answered,
        ballots_awaited_election_is_kept,
        bully_challenged_takes_part
    ].

-define(PATIENCE_MS, 20000).

%% -- properties -----------------------------------------------------------------------------

ballots_under_faults(_) -> starl_platform_ct:property(prop(ballots, faulty()), 40).

bully_under_faults(_) -> starl_platform_ct:property(prop(bully, faulty()), 40).

%% Also with the highest robots dead from the start, or dying during the election.
bully_without_loss(_) -> starl_platform_ct:property(prop(bully, lossless()), 40).

prop(Block, Generator) ->
    ?FORALL(
        Case,
        Generator,
        starl_platform_ct:safely(fun() ->
            #{violations := Violations} = run(Case, Block),
            ok = starl_platform_ct:tell(Violations),
            Violations =:= []
        end)
    ).

planted_bugs_are_caught(_) ->
    _ = rand:seed(exsss, starl_platform_ct:seed()),
    [
        ?assert(caught(Generator, Bug, 200), Bug)
     || {Generator, Bug} <- [{lossless(), early}, {faulty(), fickle}, {faulty(), incomplete}]
    ].

%% By a violation, not by an exception: that would fail the test case.
caught(_Generator, _Bug, 0) ->
    false;
caught(Generator, Bug, Left) ->
    {ok, Case} = proper_gen:pick(Generator),
    #{violations := Violations} = run(Case, {bug, Bug}),
    case [What || #{contract := election, what := What} <- Violations] of
        [] ->
            caught(Generator, Bug, Left - 1);
        [What | _] ->
            ct:log("~p is caught as ~p in case ~b", [Bug, What, 201 - Left]),
            true
    end.

faulty() ->
    ?LET(
        N,
        range(2, 6),
        map([
            {robots, N},
            {seed, seed()},
            {lossless, false},
            {loss, oneof([0.0, 0.2, 0.4])},
            {duplicate, oneof([0.0, 0.3])},
            {delay, oneof([{5, 20}, {2, 100}])},
            {clock_offset, 1000},
            {clock_drift, oneof([0, 50, 900])},
            {range, oneof([none, none, 2500])},
            {faults,
                list(
                    oneof([
                        {moment(), kill_machine, {range(1, N), oneof([sap, election])}},
                        {moment(), kill_robot, range(1, N)}
                    ])
                )}
        ])
    ).

lossless() ->
    ?LET(
        N,
        range(2, 6),
        map([
            {robots, N},
            {seed, seed()},
            {lossless, true},
            {loss, 0.0},
            {duplicate, oneof([0.0, 0.3])},
            {delay, oneof([{5, 20}, {2, 100}])},
            {clock_offset, 1000},
            {clock_drift, oneof([0, 50, 900])},
            {faults, list({moment(), kill_robot, range(1, N)})}
        ])
    ).

map(Pairs) -> ?LET(Drawn, Pairs, maps:from_list(Drawn)).

seed() -> noshrink(integer(1, 100000)).

moment() -> oneof([10, 130, 620, 2500]).

%% Two elections that follow one another, entered at different times.
run(#{robots := N, faults := Faults, lossless := Lossless} = Case, Block) ->
    Team = lists:seq(1, N),
    {Machine, Monitor} = block(Block),
    Bound = #{robots => Team, bound_us => 1100 * ?PATIENCE_MS, lossless => Lossless},
    Around = #{blocks => [Machine], monitors => [{Monitor, Bound}]},
    starl_blocks_script_app:play(fun script/1, Around, (maps:remove(lossless, Case))#{
        faults => planned(Faults), time => 90
    }).

block(ballots) -> {hd(starl_election:machines(#{})), starl_election_monitor};
block(bully) -> {hd(starl_bully:machines(#{})), starl_election_bully_monitor};
block({bug, incomplete}) -> {bug(incomplete), starl_election_monitor};
block({bug, Bug}) -> {bug(Bug), starl_election_bully_monitor}.

bug(Bug) -> {election, starl_election_bug, #{bug => Bug}}.

script(R) ->
    ok = starl:sleep(R, 120 * (starl:id(R) rem 3)),
    First = elect(R, first),
    Second = elect(R, second),
    ok = starl:sleep(R, 3000),
    {First, Second, elect(R, first)}.

%% Whose machine has crashed calls again.
elect(R, Election) ->
    case starl_election:elect(R, Election, ?PATIENCE_MS) of
        {error, restarted} -> elect(R, Election);
        Answer -> Answer
    end.

planned(Faults) ->
    [
        {starl_platform_ct:fault_id(f, K), At, At, Kind, Target, #{}}
     || {K, {At, Kind, Target}} <- lists:zip(lists:seq(1, length(Faults)), Faults)
    ].

%% -- pitfalls -------------------------------------------------------------------------------

bully_highest_are_dead(_) ->
    Case = #{
        robots => 5,
        seed => 1,
        lossless => true,
        loss => 0.0,
        faults => [{1, kill_robot, 4}, {1, kill_robot, 5}]
    },
    #{violations := [], robots := Robots} = run(Case, bully),
    ?assertEqual(
        lists:duplicate(3, {done, {{ok, 3}, {ok, 3}, {ok, 3}}}),
        [Result || {Id, #{result := Result}} <- Robots, Id =< 3]
    ).

%% Found at random and shrunk: only the second highest has elected the leader before that died. The others
%% elected themselves although it had answered them.
bully_leader_dies_when_elected(_) ->
    Case = #{
        robots => 4,
        seed => 1,
        delay => {2, 100},
        clock_offset => 1000,
        lossless => true,
        loss => 0.0,
        faults => [{130, kill_robot, 4}]
    },
    #{violations := [], robots := Robots} = run(Case, bully),
    ?assertEqual(
        lists:duplicate(3, {done, {{ok, 4}, {ok, 3}, {ok, 4}}}),
        [Result || {Id, #{result := Result}} <- Robots, Id =< 3]
    ).

%% Whatever is announced after the first leader: the first one stays.
bully_one_leader_per_term(_) ->
    M1 = start(starl_election_bully, 1, [1, 2, 3]),
    {_, M2} = call(e1, a, M1),
    {A3, M3} = message(3, bully_leader, {e1, 3, majority}, M2),
    {A4, M4} = message(2, bully_leader, {e1, 2, majority}, M3),
    {A5, _} = call(e1, b, M4),
    ?assertEqual([{a, {ok, 3}}], replies(A3)),
    ?assertEqual([], replies(A4)),
    ?assertEqual([{b, {ok, 3}}], replies(A5)).

%% Found at random and shrunk: a robot that has rebooted asks again for an election of long ago.
%% Whoever has forgotten its leader would hold it anew.
bully_remembers_old_elections(_) ->
    M1 = start(starl_election_bully, 1, [1, 2, 3]),
    M2 = lists:foldl(
        fun(N, M) -> element(2, message(3, bully_leader, {N, 3, majority}, M)) end,
        M1,
        lists:seq(1, 500)
    ),
    {Actions, M3} = message(2, bully_leader, {1, 2, majority}, M2),
    ?assertEqual([], [E || {trace, {elected, _, _, _} = E} <- Actions]),
    {Again, _} = call(1, a, M3),
    ?assertEqual([{a, {ok, 3}}], replies(Again)).

%% Announcing from an incomplete ballot set.
ballots_incomplete_set_elects_nobody(_) ->
    M1 = start(starl_election_ballots, 1, [1, 2, 3]),
    {_, M2} = call(e1, a, M1),
    {A3, M3} = message(2, ballot, {e1, {9, 2}}, M2),
    %% a second one from the same robot completes nothing
    {A4, M4} = message(2, ballot, {e1, {9, 2}}, M3),
    {A5, _} = message(3, ballot, {e1, {1 bsl 40, 3}}, M4),
    ?assertEqual([], replies(A3 ++ A4)),
    ?assertEqual([{a, {ok, 3}}], replies(A5)).

%% Dropping ballots that arrive before the local robot has started.
ballots_before_the_start_count(_) ->
    M1 = start(starl_election_ballots, 1, [1, 2, 3]),
    {A2, M2} = message(2, ballot, {e1, {1 bsl 40, 2}}, M1),
    {A3, M3} = message(3, ballot, {e1, {8, 3}}, M2),
    {A4, _} = call(e1, a, M3),
    ?assertEqual([], replies(A2 ++ A3)),
    ?assertEqual([{a, {ok, 2}}], replies(A4)).

%% Ballots of an earlier election counted in a later one.
ballots_of_another_election_do_not_count(_) ->
    M1 = start(starl_election_ballots, 1, [1, 2]),
    {_, M2} = message(2, ballot, {e1, {9, 2}}, M1),
    {A3, M3} = call(e2, a, M2),
    {A4, _} = message(2, ballot, {e2, {1 bsl 40, 2}}, M3),
    ?assertEqual([], replies(A3)),
    ?assertEqual([{a, {ok, 2}}], replies(A4)).

%% A ballot that comes when the election is over here is answered with the leader, whether this
%% robot took part or only heard: else one that has missed the announcement never gets a result.
ballots_late_one_is_answered(_) ->
    M1 = start(starl_election_ballots, 1, [1, 2, 3]),
    {_, M2} = message(2, leader, {e1, 3}, M1),
    {Answer, _} = message(2, ballot, {e1, {9, 2}}, M2),
    ?assertEqual([{2, leader, {e1, 3}}], sent(Answer)),
    {_, M3} = call(e2, a, M1),
    {_, M4} = message(2, ballot, {e2, {1 bsl 40, 2}}, M3),
    {Elected, M5} = message(3, ballot, {e2, {8, 3}}, M4),
    ?assertEqual([{a, {ok, 2}}], replies(Elected)),
    {Again, _} = message(3, ballot, {e2, {8, 3}}, M5),
    ?assertEqual([{3, leader, {e2, 2}}], sent(Again)),
    %% before it is over nobody is answered
    {Early, _} = message(3, ballot, {e2, {8, 3}}, M4),
    ?assertNotEqual([{3, leader, {e2, 2}}], sent(Early)).

%% However many elections are heard of meanwhile, one that is waited for keeps its ballots and its
%% caller; of those that nobody waits for the oldest are forgotten, the latest 64 are not.
ballots_awaited_election_is_kept(_) ->
    M1 = start(starl_election_ballots, 1, [1, 2, 3]),
    {_, M2} = call(waited, a, M1),
    {_, M3} = message(2, ballot, {waited, {1 bsl 40, 2}}, M2),
    Heard = fun(Count) ->
        lists:foldl(
            fun(N, M) -> element(2, message(3, leader, {N, 3}, M)) end, M3, lists:seq(1, Count)
        )
    end,
    {Elected, _} = message(3, ballot, {waited, {8, 3}}, Heard(200)),
    ?assertEqual([{a, {ok, 2}}], replies(Elected)),
    %% nobody waits for the first: it was 64 elections ago, or one more
    {Known, _} = call(1, b, Heard(64)),
    ?assertEqual([{b, {ok, 3}}], replies(Known)),
    {Forgotten, _} = call(1, b, Heard(65)),
    ?assertEqual([], replies(Forgotten)).

%% Who is challenged says that it is alive and challenges those above it itself, though its
%% application has not called; the highest of the team is leader at once.
bully_challenged_takes_part(_) ->
    M1 = start(starl_election_bully, 2, [1, 2, 3, 4]),
    {Actions, M2} = message(1, bully_challenge, e1, M1),
    ?assertEqual(
        [{1, bully_alive, e1}, {3, bully_challenge, e1}, {4, bully_challenge, e1}], sent(Actions)
    ),
    ?assertMatch([_], [Us || {{timeout, {round, e1}}, Us, _} <- Actions]),
    %% it is at it: asked again it answers, and asks nobody anew
    {Again, M3} = message(1, bully_challenge, e1, M2),
    ?assertEqual([{1, bully_alive, e1}], sent(Again)),
    %% nobody above answers: it leads
    {Won, _} = step({timeout, {round, e1}}, over, M3),
    ?assertEqual([{elected, e1, 2, highest}], [E || {trace, {elected, _, _, _} = E} <- Won]),
    {Highest, _} = message(1, bully_challenge, e1, start(starl_election_bully, 4, [1, 2, 3, 4])),
    ?assertEqual([{1, bully_alive, e1}], sent(Highest)),
    ?assertEqual([{elected, e1, 4, highest}], [E || {trace, {elected, _, _, _} = E} <- Highest]).

sent(Actions) -> [{To, Type, Body} || {cast, sap, {send, To, Type, Body}} <- Actions].

start(Module, Self, Team) ->
    {_, Machine} = starl_machine:new(Module, #{}, #{
        robot => Self,
        participants => Team,
        name => election,
        incarnation => 1,
        random => rand:seed_s(exsss, 1),
        team_seed => 1,
        now => 0
    }),
    Machine.

call(Election, Tag, Machine) -> step({call, {app, Tag}}, {elect, Election, 1000000}, Machine).

message(From, Type, Body, Machine) -> step(cast, {message, From, Type, Body}, Machine).

step(Type, Content, Machine) ->
    starl_machine:step(Type, Content, #{now => 0, robot => 1}, Machine).

replies(Actions) -> [{Tag, Answer} || {reply, {app, Tag}, Answer} <- Actions].
