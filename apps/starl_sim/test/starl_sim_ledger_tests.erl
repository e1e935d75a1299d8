%% What is kept of a robot's events: few checkpoints that two runs have in common, and exactly
%% the events that were asked for.
-module(starl_sim_ledger_tests).
-include_lib("eunit/include/eunit.hrl").

%% Plays so many events into a ledger as a robot does: it looks only at those that are named.
play(Count, Range) -> play(1, Count, starl_sim_ledger:new(Range), 0).

play(N, Count, {_, Ledger}, Looks) when N > Count ->
    {Ledger, Looks};
play(N, Count, {N, Ledger}, Looks) ->
    play(N + 1, Count, starl_sim_ledger:note(N * 10, event(N), Ledger), Looks + 1);
play(N, Count, {Next, _} = Noted, Looks) when Next > N ->
    play(N + 1, Count, Noted, Looks).

event(N) ->
    #{n => N, at_us => N * 10, machine => app, type => cast, content => N, chain => N * 7}.

checkpoints(Count) ->
    {Ledger, _} = play(Count, none),
    starl_sim_ledger:checkpoints(Ledger).

numbers(Checkpoints) -> [N || {N, _, _} <- Checkpoints].

every_thousandth_event_test() ->
    ?assertEqual([], checkpoints(999)),
    ?assertEqual([{1000, 10000, 7000}], checkpoints(1000)),
    ?assertEqual([1000, 2000, 3000], numbers(checkpoints(3999))).

%% Bounded, however long the run; whatever two lengths, many numbers are common to both.
thinned_out_test_() ->
    {timeout, 60, fun() ->
        Long = [numbers(checkpoints(Count)) || Count <- [512000, 513000, 1500000, 3000000]],
        [?assert(length(Ns) =< 512 andalso length(Ns) >= 256) || Ns <- Long],
        [[First | _] = Sparse | _] = lists:reverse(Long),
        ?assertEqual(Sparse, lists:seq(First, lists:last(Sparse), First)),
        [?assert(length([N || N <- Ns, lists:member(N, Sparse)]) > 60) || Ns <- Long]
    end}.

records_what_was_asked_for_test_() ->
    [
        fun() ->
            {Ledger, _} = play(3500, {From, To}),
            Recorded = [N || #{n := N} <- starl_sim_ledger:events(Ledger)],
            ?assertEqual(lists:seq(From, min(To, 3500)), Recorded),
            ?assertEqual([1000, 2000, 3000], numbers(starl_sim_ledger:checkpoints(Ledger)))
        end
     || {From, To} <- [{1, 1}, {1, 1000}, {999, 1001}, {1000, 1000}, {1001, 2000}, {3400, 9999}]
    ].

%% At no cost: without a recording only checkpoints are looked at.
looks_at_few_test() ->
    ?assertMatch({_, 10}, play(10999, none)),
    ?assertMatch({_, 15}, play(10999, {2001, 2005})).
