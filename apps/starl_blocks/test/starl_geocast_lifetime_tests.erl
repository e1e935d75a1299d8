%% What is left of a lifetime is never too much, whatever delays and drifts there were, and not
%% less than the way of the questions and the drifts cost.
-module(starl_geocast_lifetime_tests).
-include_lib("eunit/include/eunit.hrl").

-define(L, starl_geocast_lifetime).
-define(PPM, 10000).
-define(LIFETIME, 3000000).

%% A message goes from robot to robot: each asks, after a while of holding it the one before
%% answers, and the answer takes its time. Their clocks are off by minutes and drift.
never_too_long_test() ->
    Seed = erlang:phash2(starl_platform_ct:seed()),
    _ = rand:seed(exsss, Seed),
    [?assertEqual({Seed, N, true}, {Seed, N, chain(5)}) || N <- lists:seq(1, 2000)].

chain(Hops) ->
    Source = clock(),
    Sent = rand:uniform(1000000),
    Deadline = ?L:deadline(Source(Sent), ?LIFETIME, ?PPM),
    hop(Hops, Sent, {Source, Deadline}, Sent + ?LIFETIME, 0).

hop(0, _Now, _Holder, _End, _Lost) ->
    true;
hop(N, Now, {Clock, Deadline}, End, Lost0) ->
    Own = clock(),
    Asked = Now + delay(),
    Answered = Asked + delay(),
    Left = ?L:left(Deadline, Clock(Answered), ?PPM),
    Mine = ?L:deadline(Own(Asked), Left, ?PPM),
    Heard = Answered + delay(),
    Lost = Lost0 + (Answered - Asked),
    %% by the true time at which the own clock shows the deadline
    Over = Heard + max(0, Mine - Own(Heard)) * 1000000 / (1000000 - ?PPM),
    Kept = Mine =< Own(Heard) orelse Over =< End + 2,
    Near = Left =:= 0 orelse Own(End) - Mine =< Lost + N + ?LIFETIME * 4 * ?PPM * 6 div 1000000,
    Kept andalso Near andalso hop(N - 1, Heard, {Own, Mine}, End, Lost).

%% From a true time to what a clock shows.
clock() ->
    Offset = rand:uniform(600000000),
    Ppm = rand:uniform(2 * ?PPM + 1) - ?PPM - 1,
    fun(T) -> Offset + T + T * Ppm div 1000000 end.

delay() -> rand:uniform(lists:nth(rand:uniform(2), [20000, 400000])).

%% The question counts: an answer that was under way for longer than what was left is worth
%% nothing.
old_answer_test() ->
    ?assert(?L:deadline(1000000, 500000, ?PPM) =< 1500000),
    ?assertEqual(0, ?L:left(1500000, 1500001, ?PPM)).

%% Sent after the start only if the greatest age says so.
is_sent_after_test() ->
    ?assert(?L:is_sent_after(0, 1020000, 5000000, 4000000, ?PPM)),
    ?assertNot(?L:is_sent_after(0, 1000000, 5000000, 4000000, ?PPM)),
    ?assertNot(?L:is_sent_after(1020000, 1020000, 5000000, 4999999, ?PPM)).

%% To the microsecond: what is held is held for less, what is told is what that stands for, and an
%% id is known for longer than any clock gives the message.
exact_test() ->
    ?assertEqual(1000 + 990000, ?L:deadline(1000, 1000000, ?PPM)),
    ?assertEqual(1000 + 1000000, ?L:deadline(1000, 1000000, 0)),
    ?assertEqual(1000000, ?L:left(2000000, 1010000, ?PPM)),
    ?assertEqual(2000000, ?L:left(3000000, 1000000, 0)),
    ?assertEqual(0, ?L:left(1000, 1000, ?PPM)),
    ?assertEqual(1010001, ?L:memory_us(1000000, ?PPM)),
    ?assertEqual(1000001, ?L:memory_us(1000000, 0)),
    ?assertEqual(3000001, ?L:memory_us(3000000, 0)).

%% Longer than five packets are under way and two gatherings take, by clocks that drift apart.
least_test() ->
    ?assertEqual(5 * 100 + 2 * 3 + 1, ?L:least_us(100, 3, 0)),
    ?assertEqual(7, ?L:least_us(0, 3, 0)),
    ?assertEqual(50000001, ?L:least_us(10000000, 0, 0)),
    ?assertEqual(50001, ?L:least_us(9600, 0, 10000)).

%% What may have been sent at that very moment was not surely sent after it.
is_sent_after_bounds_test() ->
    ?assert(?L:is_sent_after(500, 1500, 5000, 4001, 0)),
    ?assertNot(?L:is_sent_after(500, 1500, 5000, 4000, 0)),
    ?assert(?L:is_sent_after(0, 1000000, 5000000, 4010001, ?PPM)),
    ?assertNot(?L:is_sent_after(0, 1000000, 5000000, 4010000, ?PPM)).
