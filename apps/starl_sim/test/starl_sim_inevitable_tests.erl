%% The search for the step of a fraction, over continuations that are a function of index and number.
-module(starl_sim_inevitable_tests).
-include_lib("eunit/include/eunit.hrl").

%% Of the continuations from index 700 on nearly all break the contract, before it few.
the_event_at_the_step_is_found_test() ->
    #{step := Step, complete := true, others := []} = search(step(700, 10, 95)),
    ?assertEqual({699, 700}, Step).

%% A low step needs more continuations.
a_low_step_is_found_test() ->
    #{step := Step, curve := Curve} = search(step(333, 20, 60)),
    ?assertEqual({332, 333}, Step),
    ?assertEqual([100], lists:usort([maps:get(draws, tally(M, Curve)) || M <- [332, 333]])).

%% Luck lowers the fraction for a while: the largest rise is named, and the other one, too.
a_fraction_that_falls_in_between_test() ->
    Fraction = fun
        (M) when M < 100 -> 5;
        (M) when M < 480 -> 70;
        (M) when M < 620 -> 5;
        (_) -> 100
    end,
    #{step := Step, others := Others} = search(Fraction),
    ?assertEqual({619, 620}, Step),
    ?assertMatch([{Low, High}] when Low < 100 andalso High >= 100, Others).

%% In its first continuations the fraction seems to rise most where it does not; that ends no search.
%% Holds: A rise of the fraction that was chance hides no other
%% Red: d3ad7b5b, run: no event
a_rise_by_chance_hides_no_other_test() ->
    Broken = fun
        (M, K) when M >= 900, K =< 20 -> K =< 18;
        (M, K) when M >= 900 -> K =< 62;
        (M, K) when M >= 333 -> K rem 5 < 3;
        (_, K) -> K rem 20 < 7
    end,
    Ask = fun(Questions) ->
        {done, [
            {M, tally_by(From, To, fun(K) -> Broken(M, K) end)}
         || {M, {From, To}} <- Questions
        ]}
    end,
    #{step := Step, complete := true, curve := Curve} = search_by(Ask),
    ?assertEqual({332, 333}, Step),
    ?assertMatch(#{draws := 100, broken := 60}, tally(900, Curve)).

%% The fraction rises at one event and falls soon afterwards: the rise between the indices of the grid is
%% lower than that at the event.
a_rise_that_is_lost_soon_test() ->
    Fraction = fun
        (M) when M < 540 -> 15;
        (M) when M < 550 -> 90;
        (_) -> 60
    end,
    #{step := Step, complete := true} = search_by(fun(Q) -> answers(Q, Fraction) end),
    ?assertEqual({539, 540}, Step).

%% What is the same everywhere has no step, however often it breaks.
no_step_test() ->
    [
        ?assertMatch({Percent, #{step := none, complete := true}}, {
            Percent, search(fun(_) -> Percent end)
        })
     || Percent <- [0, 50, 100]
    ].

%% The numbers of the continuations go on where they ended, and none is run twice.
no_continuation_is_run_twice_test() ->
    Self = self(),
    Ask = fun(Questions) ->
        _ = [Self ! {ran, M, K} || {M, {From, To}} <- Questions, K <- lists:seq(From, To)],
        {done, [{M, tally(From, To, step(M, 333, 20, 60))} || {M, {From, To}} <- Questions]}
    end,
    #{curve := Curve} = search_by(Ask),
    Ran = lists:sort(ran()),
    ?assertEqual(Ran, lists:usort(Ran)),
    ?assertEqual(
        Ran, [{M, K} || {M, #{draws := N}} <- Curve, K <- lists:seq(1, N)]
    ).

%% Interrupted in the grid or in the halving: what is known is told.
stopped_test() ->
    ?assertMatch(
        #{complete := false, step := none, curve := []}, search_by(fun(_) -> {stopped, []} end)
    ),
    Fraction = step(700, 10, 95),
    Once = fun
        ([_, _ | _] = Questions) -> answers(Questions, Fraction);
        (_) -> {stopped, []}
    end,
    #{complete := false, step := {Low, High}} = search_by(Once),
    ?assert(Low < 700 andalso High >= 700).

%% Indices that are even in events, and others that come nearer and nearer to the last one.
grid_test() ->
    Events = [
        #{n => N, at_us => 1000 * N, chain => 0, machine => m, type => info, content => none}
     || N <- lists:seq(1, 1000)
    ],
    Timeline = starl_sim_timeline:new(#{1 => Events}, []),
    ?assertEqual(
        [0, 200, 400, 600, 700, 750, 800], starl_sim_inevitable:grid(8, 800, Timeline)
    ).

%% -- helpers --------------------------------------------------------------------------------

step(At, Below, Above) -> fun(M) -> step(M, At, Below, Above) end.

step(M, At, Below, _Above) when M < At -> Below;
step(_M, _At, _Below, Above) -> Above.

search(Fraction) -> search_by(fun(Questions) -> answers(Questions, Fraction) end).

search_by(Ask) ->
    starl_sim_inevitable:search(#{grid => lists:seq(0, 1000, 100), draws => 20, ask => Ask}).

answers(Questions, Fraction) ->
    {done, [{M, tally(From, To, Fraction(M))} || {M, {From, To}} <- Questions]}.

%% The K-th continuation breaks the contract or not, the same at each index with the same fraction.
tally(From, To, Percent) -> tally_by(From, To, fun(K) -> 37 * K rem 100 < Percent end).

tally_by(From, To, Breaks) ->
    #{
        draws => To - From + 1,
        broken => length([K || K <- lists:seq(From, To), Breaks(K)]),
        other => 0,
        unjudged => 0,
        digests => [<<>>]
    }.

tally(Index, Curve) ->
    {_, Tally} = lists:keyfind(Index, 1, Curve),
    Tally.

ran() ->
    receive
        {ran, M, K} -> [{M, K} | ran()]
    after 0 -> []
    end.
