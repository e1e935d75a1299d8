%% The shrinker over runs that are a function of the scenario alone: what it takes away, what it
%% keeps, and that it believes nothing that it has not seen twice.
-module(starl_sim_shrink_tests).
-include_lib("proper/include/proper.hrl").
-include_lib("eunit/include/eunit.hrl").

-define(PLANTED, #{contract => planted, what => seen}).

%% The faults that are needed are left, and the robots that they hit; chance is taken out.
takes_away_test() ->
    {ok, Result} = shrink(scenario(40, 10), needing([3, 17, 31], 7)),
    #{scenario := Small, figures := Figures, complete := true} = Result,
    ?assertMatch(
        #{robots := 7, duplicate := 0.0, clock_drift := 0, delay := {20, 20}, loss := 0.0}, Small
    ),
    ?assertEqual([f3, f17, f31], ids(Small)),
    ?assertMatch(#{faults := 3, faults_before := 40, robots := 7, robots_before := 10}, Figures),
    ?assertEqual(1.0, maps:get(time, Small)).

%% A violation of another kind, or of another contract, is not what was to be shrunk.
same_violation_test() ->
    Run = fun(#{faults := Faults} = S) ->
        Violation =
            case {length(Faults), lists:member(f5, ids(S))} of
                {N, _} when N < 3 -> ?PLANTED#{contract => other};
                {N, _} when N < 6 -> ?PLANTED#{what => other};
                {_, true} -> ?PLANTED;
                {_, false} -> none
            end,
        outcome(S, Violation)
    end,
    {ok, #{scenario := Small}} = shrink(scenario(40, 10), Run),
    ?assertEqual(6, length(ids(Small))),
    ?assert(lists:member(f5, ids(Small))).

%% A scenario that cannot be run violates nothing.
what_cannot_run_is_not_smaller_test() ->
    Run = fun
        (#{robots := N}) when N < 4 -> {error, {start, {scene, "too few"}}};
        (S) -> outcome(S, ?PLANTED)
    end,
    {ok, #{scenario := #{robots := 4, faults := []}}} = shrink(scenario(9, 10), Run).

%% Groups lose the members that are gone, faults of one robot go with it.
robots_take_their_faults_along_test() ->
    Faults = [
        {g, 0, 9, partition, [1, 4, 9], #{}}, {one, 0, 9, isolate, 9, #{}},
        {two, 0, 9, location_swap, {2, 3}, #{}}, {every, 0, 9, loss, all, #{part => 0.5}}
    ],
    Needs = fun(#{faults := Some, robots := N} = S) ->
        Kinds = [Kind || {_, _, _, Kind, _, _} <- Some],
        Enough = [partition, location_swap, loss] -- Kinds =:= [],
        outcome(S, case Enough andalso N >= 5 of true -> ?PLANTED; false -> none end)
    end,
    {ok, #{scenario := Small}} = shrink((scenario(0, 10))#{faults => Faults}, Needs),
    #{robots := 5, faults := Left} = Small,
    ?assertEqual([{g, [1, 4]}, {two, {2, 3}}, {every, all}], [{Id, T} || {Id, _, _, _, T, _} <- Left]).

%% Random loss becomes the packets that matter; other losses have faults of their own.
losses_become_drops_test() ->
    Before = (scenario(0, 4))#{loss => 0.3},
    IsLost = fun(N) -> starl_sim_radio:lost({1, 1, 2, N}, Before) end,
    Lost = [{1000 * N, 1, 2, N} || N <- lists:seq(1, 200), IsLost(N)],
    [Early, Late] = [lists:nth(K, [N || {_, _, _, N} <- Lost]) || K <- [3, 40]],
    Run = fun(#{loss := Loss, faults := Faults} = S) ->
        Dropped = [N || {_, _, _, drop, {1, 2}, #{packet := N}} <- Faults],
        Missing = [Early, Late] -- Dropped,
        Violation = case Loss > 0 orelse Missing =:= [] of true -> ?PLANTED; false -> none end,
        {ok, (element(2, outcome(S, Violation)))#{lost => [{5, 2, 1, 7} | Lost]}}
    end,
    {ok, #{scenario := #{loss := 0.0, faults := Drops}, figures := #{drops := 2}}} =
        shrink(Before, Run),
    ?assertEqual([Early, Late], [N || {_, _, _, drop, _, #{packet := N}} <- Drops]).

%% A violation that moves forward takes the end of the run along.
time_ends_with_the_violation_test() ->
    Run = fun(#{faults := Faults, time := Time} = S) ->
        At = 1000000 * (1 + length(Faults)),
        outcome(S, case Time * 1.0e6 >= At of true -> ?PLANTED#{at_us => At}; false -> none end)
    end,
    {ok, #{scenario := #{time := 1.0, faults := []}}} = shrink(scenario(12, 3), Run).

holds_test() ->
    ?assertEqual({error, holds}, shrink(scenario(3, 3), fun(S) -> outcome(S, none) end)).

not_reproducible_test() ->
    Counter = counters:new(1, []),
    Run = fun(S) ->
        ok = counters:add(Counter, 1, 1),
        {ok, Outcome} = outcome(S, ?PLANTED),
        {ok, Outcome#{digest => <<(counters:get(Counter, 1))>>}}
    end,
    ?assertEqual({error, {not_reproducible, [<<1>>, <<2>>]}}, shrink(scenario(3, 3), Run)),
    Known = #{digest => <<"known">>},
    {error, {not_reproducible, [<<"known">>, _]}} =
        starl_sim_shrink:shrink(scenario(3, 3), request(needing([], 1), Known)).

%% Whoever watches may stop it at any run: no further one is made, the smallest is kept.
stopped_test_() ->
    [
        {integer_to_list(Most), fun() ->
            Watch = fun
                Watch(#{runs := Runs}) when Runs >= Most -> {stop, Watch};
                Watch(_) -> {continue, Watch}
            end,
            Request = request(needing([3], 2), #{watch => Watch}),
            {ok, #{scenario := Small, figures := #{runs := Runs}, complete := false}} =
                starl_sim_shrink:shrink(scenario(40, 10), Request),
            ?assertEqual(Most, Runs),
            ?assert(lists:member(f3, ids(Small)))
        end}
     || Most <- [2, 3, 5, 8]
    ].

%% Whatever is needed: the result violates, and does not without any one of its faults.
minimal_test_() -> {timeout, 60, fun() ->
    Prop = ?FORALL({N, Drawn, Robots}, {range(0, 40), list(range(1, 40)), range(1, 12)},
        starl_platform_ct:safely(fun() ->
            Needed = [I || I <- lists:usort(Drawn), I =< N],
            Run = needing(Needed, Robots),
            {ok, #{scenario := Small}} = shrink(scenario(N, 12), Run),
            #{faults := Faults} = Small,
            Less = [Small#{faults := lists:delete(F, Faults)} || F <- Faults],
            violates(Run(Small)) andalso not lists:any(fun(S) -> violates(Run(S)) end, Less)
                andalso ids(Small) =:= [id(I) || I <- Needed]
        end)),
    starl_platform_ct:property(Prop, 100)
end}.

%% -- helpers --------------------------------------------------------------------------------

shrink(Scenario, Run) -> starl_sim_shrink:shrink(Scenario, request(Run, #{})).

request(Run, More) -> maps:merge(#{run => Run, watch => fun on/1}, More).

on(_Figures) -> {continue, fun on/1}.

scenario(Faults, Robots) ->
    {ok, Scenario} = starl_sim_scenario:check(#{
        app => nobody, robots => Robots, seed => 1, time => 60, duplicate => 0.1,
        faults => [{id(N), N, N + 5, isolate, 1, #{}} || N <- lists:seq(1, Faults)]
    }, []),
    Scenario.

id(N) -> starl_platform_ct:fault_id(f, N).

ids(#{faults := Faults}) -> [element(1, Fault) || Fault <- Faults].

%% Needs these faults and so many robots.
needing(Needed, Robots) ->
    fun(#{robots := N, time := Time} = S) ->
        Missing = [id(I) || I <- Needed] -- ids(S),
        Enough = Missing =:= [] andalso N >= Robots andalso Time >= 1,
        outcome(S, case Enough of true -> ?PLANTED; false -> none end)
    end.

outcome(Scenario, Violation) ->
    Found = [maps:merge(#{at_us => 1000000, robots => [], details => #{}}, V)
             || V <- [Violation], V =/= none],
    EndUs = lists:min([round(1.0e6 * maps:get(time, Scenario)) | [At || #{at_us := At} <- Found]]),
    {ok, #{
        scenario => Scenario, digest => crypto:hash(md5, term_to_binary(Scenario, [deterministic])),
        ending => time, end_us => EndUs, events => 1, violations => Found, lost => []
    }}.

violates({ok, #{violations := Violations}}) -> Violations =/= [].
