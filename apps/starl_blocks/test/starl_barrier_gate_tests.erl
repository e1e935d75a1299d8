%% One name of a barrier as one robot sees it: what it learns from each word of the others, when it
%% passes, and what it goes on with when its own counts are known from the others only.
-module(starl_barrier_gate_tests).
-include_lib("eunit/include/eunit.hrl").

-define(G, starl_barrier_gate).
-define(APP, {app, 1}).

%% A robot that has reached round K for the first time, of a team of three.
reached(K) ->
    element(2, ?G:reach({K, K - 1}, ?APP, [2, 3], ?G:recall({K - 1, K - 1, K - 1}, true))).

heard(Words, Gate) ->
    lists:foldl(fun({R, K, Known}, G) -> ?G:hear(R, K, Known, G) end, Gate, Words).

%% -- what is known at first -------------------------------------------------------------------

nothing_is_known_test() ->
    New = ?G:new(true),
    ?assert(?G:is_sure(New)),
    ?assertNot(?G:is_sure(?G:new(false))),
    ?assertEqual({0, 0, 0}, ?G:counts(New)),
    ?assertEqual({0, 0, 0}, ?G:fact(2, New)),
    ?assertEqual({1, 0}, ?G:progress(New)),
    ?assertNot(?G:is_passed(1, New)),
    ?assertEqual({none, [], waits}, {?G:caller(New), ?G:missed(New), ?G:pass(New)}).

%% What was stored is sure. A round that counts as passed has not surely been reached by all; what an
%% earlier version stored does not tell.
recalled_test() ->
    Gate = ?G:recall({4, 3, 2}, true),
    ?assert(?G:is_sure(Gate)),
    ?assertEqual({4, 3, 2}, ?G:counts(Gate)),
    ?assertEqual({4, 0, 2}, ?G:fact(2, Gate)),
    ?assertEqual({4, 2}, ?G:progress(Gate)),
    ?assertEqual(?G:recall({4, 3, 0}, true), ?G:recall({4, 3}, true)),
    ?assertEqual([true, true, false], [?G:is_passed(K, Gate) || K <- [2, 3, 4]]).

%% In a later life the others must confirm what was stored; until then it is stored as it was.
unconfirmed_test() ->
    Gate = ?G:recall({4, 3, 2}, false),
    ?assertNot(?G:is_sure(Gate)),
    ?assertEqual({4, 3, 2}, ?G:counts(Gate)),
    %% another robot knows more: the store was an old one
    Learned = ?G:assure([], [2, 3], ?G:learn(2, 7, 6, 5, Gate)),
    ?assert(?G:is_sure(Learned)),
    ?assertMatch({6, 6, _}, ?G:counts(Learned)).

%% -- the robot's own rounds -------------------------------------------------------------------

%% It has reached a round for the first time once; it waits again for those that it still misses.
reach_test() ->
    {new, First} = ?G:reach({1, 0}, ?APP, [2, 3], ?G:new(true)),
    ?assertEqual({?APP, {1, 0, 0}, [2, 3]}, {?G:caller(First), ?G:counts(First), ?G:missed(First)}),
    Failed = ?G:fail(?G:hear(2, 1, 1, First)),
    ?assertEqual({none, {1, 0, 0}, []}, {?G:caller(Failed), ?G:counts(Failed), ?G:missed(Failed)}),
    ?assertEqual(waits, ?G:pass(Failed)),
    {again, Second} = ?G:reach({1, 0}, {app, 2}, [2, 3], Failed),
    ?assertEqual({{app, 2}, [3]}, {?G:caller(Second), ?G:missed(Second)}),
    ?assertEqual({1, 0}, ?G:progress(Second)).

%% It passes when each of the others has reached the round and knows that it has, and once.
pass_test() ->
    Waits = reached(5),
    [
        ?assertEqual({Words, waits}, {Words, ?G:pass(heard(Words, Waits))})
     || Words <- [
            [],
            [{2, 5, 5}],
            [{3, 5, 5}],
            [{2, 5, 5}, {3, 5, 4}],
            [{2, 5, 5}, {3, 4, 5}],
            [{2, 5, 5}, {2, 6, 5}]
        ]
    ],
    [
        begin
            {passed, ?APP, 5, Gate} = ?G:pass(heard(Words, Waits)),
            ?assertEqual({{5, 5, 5}, {6, 5}, none}, {
                ?G:counts(Gate), ?G:progress(Gate), ?G:caller(Gate)
            }),
            ?assertMatch({5, _, 5}, ?G:fact(2, Gate)),
            ?assertEqual(waits, ?G:pass(Gate))
        end
     || Words <- [
            [{2, 5, 5}, {3, 5, 5}],
            [{3, 6, 7}, {2, 6, 6}],
            %% in several words, one of each half, and in any order
            [{2, 0, 5}, {3, 5, 0}, {2, 5, 0}, {3, 0, 5}]
        ]
    ].

%% A robot that is alone waits for nobody.
alone_test() ->
    {new, Gate} = ?G:reach({1, 0}, ?APP, [], ?G:new(true)),
    ?assertMatch({passed, ?APP, 1, _}, ?G:pass(Gate)).

%% A word that is late or comes twice makes no count smaller.
counts_grow_test() ->
    Gate = heard([{2, 6, 5}, {3, 5, 5}, {2, 4, 3}, {3, 0, 0}, {2, 6, 5}], reached(5)),
    ?assertMatch({5, 6, _}, ?G:fact(2, Gate)),
    ?assertMatch({5, 5, _}, ?G:fact(3, Gate)),
    ?assertMatch({passed, ?APP, 5, _}, ?G:pass(Gate)),
    %% what was heard before the robot came so far counts as well
    {new, Later} = ?G:reach({6, 5}, ?APP, [2, 3], Gate),
    ?assertEqual([2, 3], ?G:missed(Later)),
    ?assertEqual([3], ?G:missed(?G:hear(2, 0, 6, Later))),
    {again, Same} = ?G:reach({5, 4}, ?APP, [2, 3], ?G:hear(3, 4, 4, Gate)),
    ?assertEqual([], ?G:missed(Same)).

%% Of those that it misses nothing is known of some: it asks only those after a crash.
unheard_test() ->
    ?assertEqual([2, 3], ?G:unheard(reached(5))),
    ?assertEqual([2], ?G:unheard(?G:hear(3, 0, 0, reached(5)))),
    ?assertEqual([], ?G:unheard(?G:fail(reached(5)))).

%% The application knows which round it has not passed: that it was not told does not undo a pass.
resume_test() ->
    Sure = ?G:resume({3, 2}, ?G:recall({3, 3, 3}, true)),
    ?assertEqual(
        {{3, 3}, {3, 3, 3}, true}, {?G:progress(Sure), ?G:counts(Sure), ?G:is_passed(3, Sure)}
    ),
    ?assertEqual({4, 3}, ?G:progress(?G:notified(3, Sure))),
    Known = ?G:resume({3, 1}, ?G:hear(2, 3, 7, ?G:new(false))),
    ?assert(?G:is_sure(Known)),
    ?assertEqual(
        {{3, 1}, {2, 2, 1}, false}, {?G:progress(Known), ?G:counts(Known), ?G:is_passed(3, Known)}
    ),
    ?assert(?G:is_passed(2, Known)).

%% A store that was damaged for a while gives back what it took before: the application knows that
%% it has come further, and no earlier round comes again.
older_counts_test() ->
    Older = ?G:resume({5, 3}, ?G:recall({4, 3, 3}, true)),
    ?assertEqual({{5, 3}, {4, 4, 3}}, {?G:progress(Older), ?G:counts(Older)}),
    {new, There} = ?G:reach({5, 3}, ?APP, [2, 3], Older),
    ?assertEqual({5, 4, 3}, ?G:counts(There)),
    ?assertEqual(
        {7, 6, 3}, ?G:counts(element(2, ?G:reach({7, 3}, ?APP, [2], ?G:recall({4, 3, 3}, true))))
    ).

%% A store that is confirmed, or that the application has gone on from, is no outdated one any more.
kept_until_it_is_sure_test() ->
    Old = ?G:learn(2, 7, 6, 5, ?G:recall({4, 3, 2}, false)),
    ?assert(?G:is_outdated(Old)),
    ?assertNot(?G:is_outdated(?G:assure([], [2, 3], Old))),
    ?assertNot(?G:is_outdated(?G:resume({7, 5}, Old))),
    Same = ?G:assure([], [2, 3], ?G:recall({4, 3, 2}, false)),
    ?assertNot(?G:is_outdated(?G:learn(2, 7, 6, 5, Same))),
    ?assertEqual({{7, 3}, {6, 6, 3}}, counted(?G:resume({7, 3}, ?G:recall({4, 3, 3}, true)))).

counted(Gate) -> {?G:progress(Gate), ?G:counts(Gate)}.

%% What a waiting application knows of all is told to another robot whose store is damaged; what the
%% others know counts as well.
resumed_knows_of_all_test() ->
    ?assertEqual({2, 0, 2}, ?G:fact(2, ?G:resume({3, 2}, ?G:new(false)))),
    Learned = ?G:learn(3, 4, 0, 3, ?G:new(false)),
    ?assertEqual({3, 0, 3}, ?G:fact(2, ?G:resume({4, 2}, Learned))).

%% -- what is known from the others only -------------------------------------------------------

%% How far the others have heard of it, or that somebody has passed a round, tells how far it was;
%% one that knows that itself learns nothing of it. It tells nobody before all have answered.
remembers_test() ->
    Learned = fun(Words, Gate) ->
        lists:foldl(fun({R, K, Known, Done}, G) -> ?G:learn(R, K, Known, Done, G) end, Gate, Words)
    end,
    Known = fun(Words, Gate) ->
        {At, _, _} = ?G:counts(?G:assure([], [2, 3], Learned(Words, Gate))),
        At
    end,
    ?assertEqual(3, Known([{2, 3, 3, 1}], ?G:new(false))),
    ?assertEqual(3, Known([{2, 3, 2, 3}], ?G:new(false))),
    ?assertEqual(4, Known([{2, 5, 4, 3}, {3, 4, 2, 1}], ?G:new(false))),
    ?assertEqual(4, Known([{2, 4, 2, 1}, {3, 5, 4, 3}], ?G:new(false))),
    %% who is far ahead has passed rounds that all have reached; a round that only counts as passed has not
    %% been reached by all
    ?assertEqual(0, Known([{2, 5, 0, 0}], ?G:new(false))),
    ?assertEqual(49, Known([{2, 50, 0, 0}], ?G:new(false))),
    %% one that has not reached the first round has heard that this robot has
    ?assertEqual(1, Known([{2, 0, 1, 0}], ?G:new(false))),
    ?assertEqual({1, 1, 1}, ?G:counts(Learned([{2, 5, 4, 3}], ?G:recall({1, 1, 1}, true)))),
    ?assertEqual({0, 5, 1}, ?G:fact(2, ?G:learn(2, 5, 3, 1, ?G:new(false)))).

%% -- numbers that cannot be true --------------------------------------------------------------

-define(MOST, 16#7FFFFFFFFFFFFFF).

%% Nobody is far ahead, and nobody has heard of a round that this robot has not reached: of a lie the
%% others hear nothing, and it lets few rounds pass.
cut_to_what_can_be_test() ->
    Gate = ?G:learn(2, ?MOST, ?MOST, ?MOST, reached(5)),
    ?assertEqual({5, 4, 4}, ?G:counts(?G:fail(?G:learn(2, 1, 1, 4, reached(5))))),
    ?assertEqual({5, 4, 5}, ?G:counts(Gate)),
    ?assertMatch({5, Ahead, 5} when Ahead < 50, ?G:fact(2, Gate)),
    {passed, ?APP, 5, Passed} = ?G:pass(?G:hear(3, 5, 5, Gate)),
    {new, Next} = ?G:reach({6, 5}, ?APP, [2, 3], Passed),
    %% what it claimed to have heard it has not
    ?assertEqual([2, 3], ?G:missed(Next)),
    ?assertEqual([2, 3], ?G:missed(element(2, ?G:reach({99, 98}, ?APP, [2, 3], Passed)))).

%% The word of one of two, or of three, does not move a robot that was asked how far it was.
one_of_several_lies_test() ->
    [
        ?assertMatch(
            {At, _, Whole} when At =< 6 andalso Whole =< At,
            ?G:counts(
                ?G:assure(Witnesses, Others, lists:foldl(fun(F, G) -> F(G) end, Gate, Order))
            )
        )
     || Gate <- [?G:new(false), ?G:recall({5, 5, 4}, false), ?G:recall({3, 2, 2}, false)],
        Others <- [[2, 3], [2, 3, 4]],
        Witnesses <- [[], [4], Others],
        Own <- [0, 1, ?MOST],
        Mine <- [0, ?MOST],
        All <- [0, ?MOST],
        Lie <- [fun(G) -> ?G:learn(4, Own, Mine, All, ?G:hear(4, Own, Mine, G)) end],
        Truth <- [
            fun(G) ->
                lists:foldl(
                    fun(R, Acc) -> ?G:learn(R, 5, 5, 4, Acc) end, G, lists:delete(4, Others)
                )
            end
        ],
        Order <- [[Lie, Truth], [Truth, Lie]]
    ],
    %% nor does it take back what is stored
    Low = ?G:learn(3, 5, 5, 5, ?G:learn(2, 1, 0, 0, ?G:recall({5, 5, 5}, false))),
    ?assertEqual({5, 5, 5}, ?G:counts(?G:assure([2, 3], [2, 3], Low))).

%% In a team of two the other's word is all there is; there are always later rounds.
two_test() ->
    Raised = ?G:assure([2], [2], ?G:learn(2, ?MOST, ?MOST, ?MOST, ?G:recall({5, 5, 5}, false))),
    {At, At, At} = ?G:counts(Raised),
    ?assert(At =< ?MOST div 2 + 1),
    %% when it says the truth again it comes as far, and they go on together
    Found = ?G:assure([], [2], ?G:learn(2, At + 3, 0, At + 2, ?G:recall({6, 6, 6}, false))),
    ?assertMatch({At, _, _}, ?G:counts(Found)).

%% Where one that knows its own counts is not so far, nobody has passed the round; else it counts as
%% passed. One that it has not heard of a name has reached nothing; one that is unsure says nothing.
assure_test() ->
    Gate = heard([{2, 3, 4}, {3, 4, 4}], ?G:new(false)),
    [
        begin
            Sure = ?G:assure(Witnesses, [2, 3], Gate),
            ?assert(?G:is_sure(Sure)),
            ?assertEqual({Witnesses, Passed}, {Witnesses, element(2, ?G:counts(Sure))}),
            ?assertEqual({Passed + 1, 0}, ?G:progress(Sure))
        end
     || {Witnesses, Passed} <- [{[2, 3], 3}, {[2], 3}, {[3], 4}, {[], 4}]
    ],
    ?assertEqual({1, 0}, ?G:progress(?G:assure([2, 3], [2, 3], ?G:new(false)))),
    %% also in the first round
    First = ?G:hear(3, 1, 1, ?G:new(false)),
    ?assertEqual(
        [{1, 0}, {2, 0}], [?G:progress(?G:assure([Witness], [2, 3], First)) || Witness <- [2, 3]]
    ),
    %% all others know that they have reached it: so all have
    ?assertEqual({2, 1}, ?G:progress(?G:assure([3], [3], First))),
    ?assertEqual({2, 1}, ?G:progress(?G:assure([3, 2], [2, 3], ?G:hear(2, 1, 1, First)))),
    %% who knows it from its store keeps to that
    Stored = heard([{2, 5, 5}, {3, 5, 5}], ?G:recall({5, 4, 4}, true)),
    ?assertEqual(Stored, ?G:assure([2, 3], [2, 3], Stored)).
