%% The two promises behind the failover of path planning: who holds one relies on it for less time
%% than who gave it, and no two quorums are without a common robot.
-module(starl_dpp_lease_tests).
-include_lib("eunit/include/eunit.hrl").

-define(S, 1000000).

%% Any two quorums of a team have a robot in common; the whole team is one.
quorums_meet_test() ->
    [
        begin
            Quorums = [Q || Q <- subsets(Team), starl_dpp_lease:quorum(Q, Team)],
            ?assert(lists:member(Team, Quorums)),
            [?assertNotEqual([], ordsets:intersection(A, B)) || A <- Quorums, B <- Quorums]
        end
     || Team <- [[3], [1, 2], [2, 5, 7], [1, 2, 3, 4], [1, 2, 3, 4, 5], [1, 2, 3, 4, 5, 6]]
    ].

%% Half of an even team is enough with its first robot; strangers do not count.
half_a_quorum_test() ->
    ?assert(starl_dpp_lease:quorum([1, 4], [1, 2, 3, 4])),
    ?assertNot(starl_dpp_lease:quorum([2, 4], [1, 2, 3, 4])),
    ?assertNot(starl_dpp_lease:quorum([1, 8, 9], [1, 2, 3, 4])).

%% By clocks that are wrong by the bound, one fast and one slow, and both set by the bound, the
%% holder's back and the giver's forward, the holder's time is over first; just so.
holder_is_first_test() ->
    [
        begin
            Config = #{lease_ms => Ms, drift_ppm => Ppm, jump_ms => Jump},
            %% the holder's clock is slow, the giver's is fast
            Slow = fun(Us) -> Us / (1 - Ppm / 1.0e6) end,
            Fast = fun(Us) -> Us / (1 + Ppm / 1.0e6) end,
            Short = starl_dpp_lease:short_us(Config),
            Long = starl_dpp_lease:long_us(Config),
            Both = fun(Us) -> {Slow(Us + 1000 * Jump), Fast(Long - 1000 * Jump)} end,
            {Held, Given} = Both(Short),
            ?assert(Held =< Given, Config),
            %% no more is taken off than drift makes of the jumps
            ?assert(Given - Held =< 2.5 * Jump * Ppm / 1000 + 5, Config)
        end
     || Ms <- [5000, 10000, 60000],
        Ppm <- [0, 50, 1000, 10000, 100000],
        Jump <- [0, 500, 2000],
        starl_dpp_lease:check(#{lease_ms => Ms, drift_ppm => Ppm, jump_ms => Jump}) =:= ok
    ].

%% What is counted from a robot's stamp is prolonged in time though a beat or its answer is lost: it
%% answers every other beat, and each stamp comes back with the next. No more than a beat a second.
beats_fit_into_a_lease_test() ->
    [
        begin
            Config = #{lease_ms => Ms, drift_ppm => 10000, jump_ms => Jump},
            Beat = starl_dpp_lease:beat_us(Config),
            ?assert(Beat =< ?S),
            ?assert(6 * Beat =< starl_dpp_lease:short_us(Config), Config)
        end
     || {Ms, Jump} <- [{10000, 2000}, {6000, 2000}, {3000, 100}, {2500, 50}, {1000, 10}]
    ],
    ?assertEqual(828855, starl_dpp_lease:beat_us(#{})),
    ?assertEqual(?S, starl_dpp_lease:beat_us(#{lease_ms => 12000})).

%% Votes count from the beat that they answer, not from when they come.
votes_count_from_the_beat_test() ->
    {Seq, L1} = starl_dpp_lease:beat(0, new([1, 2, 3])),
    L2 = voted([1, 2], Seq, L1),
    ?assert(starl_dpp_lease:leads(9 * ?S, L2)),
    ?assertNot(starl_dpp_lease:leads(10 * ?S, L2)),
    {Later, L3} = starl_dpp_lease:beat(8 * ?S, L2),
    L4 = voted([1, 2], Later, L3),
    ?assert(starl_dpp_lease:leads(17 * ?S, L4)),
    ?assertNot(starl_dpp_lease:leads(18 * ?S, L4)).

%% Also one that comes when later beats have been sent.
late_vote_counts_from_its_beat_test() ->
    {First, L1} = starl_dpp_lease:beat(0, new([1, 2, 3])),
    {_, L2} = starl_dpp_lease:beat(4 * ?S, L1),
    L3 = voted([1, 2], First, L2),
    ?assert(starl_dpp_lease:leads(7 * ?S, L3)),
    ?assertNot(starl_dpp_lease:leads(10 * ?S, L3)).

%% The last moment of leading is the last at which a quorum's votes last, whoever's they are.
last_moment_of_leading_test() ->
    {First, L1} = starl_dpp_lease:beat(0, new([1, 2, 3])),
    L2 = voted([1, 2], First, L1),
    {Later, L3} = starl_dpp_lease:beat(4 * ?S, L2),
    [
        begin
            Until = starl_dpp_lease:until(L),
            ?assertEqual(
                {Until, true, false},
                {Last, starl_dpp_lease:leads(Until, L), starl_dpp_lease:leads(Until + 1, L)}
            )
        end
     || {Last, L} <- [
            {10 * ?S - 1, L2},
            {10 * ?S - 1, voted([3], Later, L3)},
            {14 * ?S - 1, voted([2, 3], Later, L3)},
            {14 * ?S - 1, voted([1, 2, 3], Later, L3)}
        ]
    ].

%% A vote that answers no known beat, or none at all, does not count; a late one takes nothing back.
void_votes_test() ->
    {Seq, L1} = starl_dpp_lease:beat(0, new([1])),
    ?assertNot(starl_dpp_lease:leads(1, starl_dpp_lease:voted(1, Seq, false, L1))),
    ?assertNot(starl_dpp_lease:leads(1, starl_dpp_lease:voted(1, Seq + 1, true, L1))),
    {Next, L2} = starl_dpp_lease:beat(5 * ?S, L1),
    L3 = voted([1], Seq, voted([1], Next, L2)),
    ?assert(starl_dpp_lease:leads(14 * ?S, L3)),
    %% the beats of long ago are forgotten
    {_, L4} = starl_dpp_lease:beat(30 * ?S, L3),
    ?assertNot(starl_dpp_lease:leads(30 * ?S, voted([1], Seq, L4))).

%% A robot rests when all leases have ended: that of this coordinator, counted from the latest
%% message heard, and that of earlier ones, counted from when this one began to lead.
rests_test() ->
    L1 = starl_dpp_lease:heard(1, 100, 3 * ?S, new([1, 2])),
    ?assertNot(starl_dpp_lease:rests(1, 99 * ?S, L1)),
    L2 = starl_dpp_lease:since(2 * ?S, L1),
    ?assertNot(starl_dpp_lease:rests(1, 13 * ?S, L2)),
    ?assert(starl_dpp_lease:rests(1, 13 * ?S + 1, L2)),
    ?assertNot(starl_dpp_lease:rests(2, 12 * ?S, L2)),
    ?assert(starl_dpp_lease:rests(2, 12 * ?S + 1, L2)).

%% What is overtaken or doubled gives no new lease.
stamps_ascend_test() ->
    L1 = starl_dpp_lease:heard(1, 100, 3 * ?S, starl_dpp_lease:since(0, new([1]))),
    L2 = starl_dpp_lease:heard(1, 100, 9 * ?S, starl_dpp_lease:heard(1, 90, 9 * ?S, L1)),
    ?assertEqual([{1, 100}], starl_dpp_lease:stamps(L2)),
    ?assert(starl_dpp_lease:rests(1, 13 * ?S + 1, L2)).

%% A stamp lower than one of long ago comes from a clock that stood still and was set back; one that was
%% overtaken, or whose clock was only set back, is no older than clocks are set by.
outlives_test() ->
    New = starl_dpp_lease:new([1, 2], #{lease_ms => 10000, drift_ppm => 0, jump_ms => 2000}),
    L = starl_dpp_lease:heard(1, 100, 3 * ?S, starl_dpp_lease:since(0, New)),
    Outlives = fun(Stamp, Now) -> starl_dpp_lease:outlives(1, Stamp, Now, L) end,
    ?assertEqual([false, true], [Outlives(99, 5 * ?S + Us) || Us <- [0, 1]]),
    ?assertEqual([false, true], [Outlives(100, 13 * ?S + Us) || Us <- [0, 1]]),
    ?assertNot(Outlives(101, 13 * ?S)),
    ?assertNot(starl_dpp_lease:outlives(2, 0, 3 * ?S, L)).

%% A vote is for one robot until its time is over.
vote_test() ->
    {true, V1} = starl_dpp_vote:give(3, 5 * ?S, vote(none)),
    ?assertMatch({false, V1}, starl_dpp_vote:give(4, 14 * ?S, V1)),
    {true, V2} = starl_dpp_vote:give(3, 14 * ?S, V1),
    ?assertNot(starl_dpp_vote:may_claim(4, 16 * ?S, V2)),
    ?assert(starl_dpp_vote:may_claim(4, 24 * ?S, V2)).

%% A store without a term says nothing in a later life: it may be older than the robot's last vote.
%% Holds: An old store gives nothing away again: rounds …: votes
%% Red: 770dd9a, run
no_vote_at_the_start_of_a_later_life_test() ->
    New = fun(Life) -> starl_dpp_vote:new(#{stored => none, now => 0, life => Life}) end,
    Gives = fun(Life) -> element(1, starl_dpp_vote:give(3, 5 * ?S, New(Life))) end,
    ?assertEqual([true, false], [Gives(Life) || Life <- [{0, 1}, {1, 1 bsl 57}]]).

%% Whom it has promised its vote may claim, but for while another leads; that one always may. The
%% promise and the leader are apart.
claims_do_not_disturb_test() ->
    {true, V1} = starl_dpp_vote:give(3, 5 * ?S, vote(none)),
    V2 = starl_dpp_vote:leads(1, 7 * ?S, V1),
    ?assert(starl_dpp_vote:may_claim(3, 7 * ?S, V1)),
    ?assertNot(starl_dpp_vote:may_claim(3, 17 * ?S - 1, V2)),
    ?assert(starl_dpp_vote:may_claim(3, 17 * ?S, V2)),
    ?assertMatch({false, V2}, starl_dpp_vote:give(1, 15 * ?S - 1, V2)),
    {true, V3} = starl_dpp_vote:give(1, 15 * ?S, V2),
    ?assert(starl_dpp_vote:may_claim(1, 16 * ?S, V3)).

%% A machine that has crashed may have voted for anybody just before.
vote_after_a_crash_test() ->
    ?assertNot(starl_dpp_vote:may_claim(3, 10 * ?S - 1, vote({stored, {1, 3, 1}}))),
    ?assert(starl_dpp_vote:may_claim(3, 10 * ?S, vote({stored, {1, 3, 1}}))).

%% All vote again before the first claims, and they claim one after the other.
successors_take_turns_test() ->
    Times = [starl_dpp_vote:missing_us(3, R, {[1, 3, 4, 6], vote(none)}) || R <- [3, 4, 6, 1]],
    ?assertEqual(Times, lists:usort(Times)),
    ?assert(hd(Times) > starl_dpp_lease:long_us(#{})).

%% What the holder relies on, to the microsecond; never nothing.
short_test() ->
    Short = fun(Ms, Ppm, Jump) ->
        starl_dpp_lease:short_us(#{lease_ms => Ms, drift_ppm => Ppm, jump_ms => Jump})
    end,
    ?assertEqual(10000000, Short(10000, 0, 0)),
    ?assertEqual(10000000 * 990000 div 1010000 - 4000000, Short(10000, 10000, 2000)),
    ?assertEqual(999998000, Short(1000000, 1, 0)),
    ?assertEqual([1, 1], [Short(1000, 0, Jump) || Jump <- [500, 2000]]),
    ?assertEqual(Short(10000, 10000, 2000), starl_dpp_lease:short_us(#{})),
    ?assertEqual(
        [2000000, 1000000, 142858, 1],
        [starl_dpp_lease:long_us(#{lease_ms => 2000})] ++
            [
                starl_dpp_lease:beat_us(#{lease_ms => Ms, drift_ppm => 0, jump_ms => Jump})
             || {Ms, Jump} <- [{10000, 0}, {1000, 0}, {1000, 1000}]
            ]
    ).

%% A tenth of a lease must be left to its holder; the line says what to do.
%% Holds: Options that leave a lease nothing are refused
%% Red: 9df004a; told by 39da6b3
options_that_leave_nothing_test() ->
    Check = fun(Ms, Jump) ->
        starl_dpp_lease:check(#{lease_ms => Ms, jump_ms => Jump, drift_ppm => 0})
    end,
    ?assertEqual([ok, ok], [Check(10000, Jump) || Jump <- [0, 4500]]),
    [
        begin
            {error, Line} = Check(10000, Jump),
            ?assertMatch({match, _}, re:run(Line, "^of a lease of 10000 ms .*twice jump_ms"))
        end
     || Jump <- [4501, 5000, 20000]
    ],
    ?assertEqual(ok, starl_dpp_lease:check(#{})).

bounds_test() ->
    ?assertEqual({2000000, 10000}, starl_dpp_lease:bounds(#{})),
    ?assertEqual({7000, 3}, starl_dpp_lease:bounds(#{jump_ms => 7, drift_ppm => 3})).

%% However they are named, and however often.
quorum_in_any_order_test() ->
    Team = [1, 2, 3, 4, 5],
    ?assert(starl_dpp_lease:quorum([5, 2, 4], Team)),
    ?assertNot(starl_dpp_lease:quorum([5, 2, 5, 2], Team)),
    ?assertNot(starl_dpp_lease:quorum([], Team)).

%% Of many robots, in their order.
in_order_test() ->
    Team = lists:seq(1, 40),
    {Seq, L1} = starl_dpp_lease:beat(0, new(Team)),
    Mixed = lists:reverse(Team),
    ?assertEqual(Team, starl_dpp_lease:votes(1, voted(Mixed, Seq, L1))),
    Heard = lists:foldl(fun(R, L) -> starl_dpp_lease:heard(R, 7, 0, L) end, L1, Mixed),
    ?assertEqual([{R, 7} || R <- Team], starl_dpp_lease:stamps(Heard)).

%% A later stamp gives leave anew.
later_stamp_test() ->
    L1 = starl_dpp_lease:heard(1, 100, 3 * ?S, starl_dpp_lease:since(0, new([1]))),
    L2 = starl_dpp_lease:heard(1, 101, 9 * ?S, L1),
    ?assertEqual([{1, 101}], starl_dpp_lease:stamps(L2)),
    ?assertEqual([false, true], [starl_dpp_lease:rests(1, 19 * ?S + Us, L2) || Us <- [0, 1]]).

%% A beat of which a vote would be over when it comes is known no more; one of the same moment is
%% the same beat.
known_beats_test() ->
    {Seq, L1} = starl_dpp_lease:beat(0, new([1])),
    Vote = fun(Now) ->
        {_, L2} = starl_dpp_lease:beat(Now, L1),
        starl_dpp_lease:votes(0, voted([1], Seq, L2))
    end,
    ?assertEqual([[1], []], [Vote(Now) || Now <- [10 * ?S - 1, 10 * ?S]]),
    ?assertEqual({Seq, L1}, starl_dpp_lease:beat(0, L1)).

new(Team) -> starl_dpp_lease:new(Team, #{lease_ms => 10000, drift_ppm => 0, jump_ms => 0}).

vote(Stored) -> starl_dpp_vote:new(#{stored => Stored, now => 0}).

voted(Robots, Seq, Lease) ->
    lists:foldl(fun(R, L) -> starl_dpp_lease:voted(R, Seq, true, L) end, Lease, Robots).

subsets([]) ->
    [[]];
subsets([X | Rest]) ->
    Less = subsets(Rest),
    Less ++ [[X | S] || S <- Less].
