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
        #{robots := 7, duplicate := +0.0, clock_drift := 0, delay := {20, 20}, loss := +0.0}, Small
    ),
    ?assertEqual([f3, f17, f31], ids(Small)),
    ?assertMatch(#{faults := 3, faults_before := 40, robots := 7, robots_before := 10}, Figures),
    ?assertEqual(1.0, maps:get(time, Small)).

%% A violation of another kind, or of another contract, is not what was to be shrunk.
same_violation_test() ->
    Run = fun(#{faults := Faults} = S) ->
        Violation =
            case {length(Faults), lists:member(f5, ids(S))} of
                {N, _} when N < 3 -> planted(#{contract => other});
                {N, _} when N < 6 -> planted(#{what => other});
                {_, true} -> ?PLANTED;
                {_, false} -> none
            end,
        outcome(S, Violation)
    end,
    {ok, #{scenario := Small}} = shrink(scenario(40, 10), Run),
    ?assertEqual(6, length(ids(Small))),
    ?assert(lists:member(f5, ids(Small))).

%% Neither is a violation of another shape: with other robots, other words in its details, or
%% numbers that lie the other way round. Of each the smallest scenario that was met is told.
same_shape_test() ->
    Passed = fun(Last, K) -> planted(#{robots => [1], details => #{last => Last, round => K}}) end,
    Run = fun(#{faults := Faults} = S) ->
        case length(Faults) of
            N when N >= 20 -> outcome(S, Passed(N, N + 7));
            N when N >= 12 -> outcome(S, Passed(N, N));
            N when N >= 6 -> outcome(S, (Passed(N, N + 7))#{robots := [1, 2]});
            _ -> outcome(S, none)
        end
    end,
    {ok, #{scenario := Small, others := Others}} = shrink(scenario(40, 10), Run),
    ?assert(length(ids(Small)) >= 20),
    Met = [
        {length(F), N, V}
     || #{scenario := #{faults := F, robots := N}, violation := V} <- Others
    ],
    %% the last is that of one robot alone
    ?assertMatch(
        [
            {Two, 2, #{robots := [1, 2]}},
            {Again, 2, #{details := #{last := N, round := N}}},
            {Alone, 1, #{}}
        ] when Two < 12 andalso Again >= 12 andalso Again < 20 andalso Alone >= 20,
        Met
    ).

%% What one robot alone violates is told, and is not what was to be shrunk.
alone_is_no_team_test() ->
    {ok, #{scenario := #{robots := 2}, others := [#{scenario := #{robots := 1}}]}} =
        shrink(scenario(0, 6), needing([], 1)).

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
        {g, 0, 9, partition, [1, 4, 9], #{}},
        {one, 0, 9, isolate, 9, #{}},
        {two, 0, 9, location_swap, {2, 3}, #{}},
        {every, 0, 9, loss, all, #{part => 0.5}}
    ],
    Needs = fun(#{faults := Some, robots := N} = S) ->
        Kinds = [Kind || {_, _, _, Kind, _, _} <- Some],
        Enough = [partition, location_swap, loss] -- Kinds =:= [],
        outcome(
            S,
            case Enough andalso N >= 5 of
                true -> ?PLANTED;
                false -> none
            end
        )
    end,
    {ok, #{scenario := Small}} = shrink((scenario(0, 10))#{faults => Faults}, Needs),
    #{robots := 5, faults := Left} = Small,
    ?assertEqual([{g, [1, 4]}, {two, {2, 3}}, {every, all}], [
        {Id, T}
     || {Id, _, _, _, T, _} <- Left
    ]).

%% A run that breaks down is told as it is, the first one and the one with the faults made explicit.
broken_runs_test() ->
    Broken = {error, {failed, oops}},
    ?assertEqual({error, {trial, {failed, oops}}}, shrink(scenario(3, 3), fun(_) -> Broken end)),
    Counter = counters:new(1, []),
    Second = fun(S) ->
        ok = counters:add(Counter, 1, 1),
        case counters:get(Counter, 1) of
            1 -> outcome(S, ?PLANTED);
            _ -> Broken
        end
    end,
    ?assertEqual({error, {trial, {failed, oops}}}, shrink(scenario(3, 3), Second)),
    Text = fun(Reason) -> lists:flatten(starl_sim_shrink:format_error(Reason)) end,
    ?assertNotEqual(nomatch, string:find(Text({trial, {failed, oops}}), "oops")),
    ?assertEqual("no floor", Text({trial, {start, {scene, "no floor"}}})),
    ?assertNotEqual(nomatch, string:find(Text({not_reproducible, [<<1>>, <<171>>]}), "01, ab;")).

%% Every run is counted and told of, to whoever the one before has named.
every_run_is_told_test() ->
    Runs = counters:new(1, []),
    Needing = needing([3], 2),
    Run = fun(S) ->
        ok = counters:add(Runs, 1, 1),
        Needing(S)
    end,
    Request = #{run => Run, watch => counting(2)},
    {ok, #{figures := #{runs := Told}}} = starl_sim_shrink:shrink(scenario(40, 10), Request),
    ?assertEqual(counters:get(Runs, 1), Told).

%% A watch that has been told of all runs before this one, the first of which are two.
counting(N) ->
    fun(#{runs := Runs}) ->
        ?assertEqual(N, Runs),
        {continue, counting(N + 1)}
    end.

%% The time is that of the run's end from the beginning on, and never longer than it was.
time_of_the_first_run_test_() ->
    Given = scenario(3, 3),
    Watch = fun Stop(_) -> {stop, Stop} end,
    [
        {integer_to_list(EndUs), fun() ->
            Run = fun(S) ->
                {ok, Outcome} = outcome(S, ?PLANTED),
                {ok, Outcome#{end_us := EndUs}}
            end,
            {ok, #{scenario := #{time := Time}}} =
                starl_sim_shrink:shrink(Given, request(Run, #{watch => Watch})),
            ?assertEqual(Seconds, Time)
        end}
     || {EndUs, Seconds} <- [{2500000, 2.5}, {60005000, 60}, {0, 1.0e-6}]
    ].

%% What is smaller ends with its own violation, and it is that which is told.
smaller_run_ends_with_its_violation_test() ->
    Run = fun(#{faults := Faults, time := Time} = S) ->
        At = 1000000 * (1 + length(Faults)),
        outcome(
            S,
            case Time * 1.0e6 >= At of
                true -> planted(#{at_us => At});
                false -> none
            end
        )
    end,
    Watch = fun
        Watch(#{faults := 0}) -> {stop, Watch};
        Watch(_) -> {continue, Watch}
    end,
    {ok, #{scenario := #{time := Time}, violation := #{at_us := At}}} =
        starl_sim_shrink:shrink(scenario(12, 3), request(Run, #{watch => Watch})),
    ?assertEqual({1.0, 1000000}, {Time, At}).

%% A violation that is judged at the end of the run may show in a shorter one: where it happened,
%% or after half of the time, and half of that.
judged_at_the_end_test() ->
    Late = fun(AtUs) ->
        fun(#{time := Time} = S) ->
            EndUs = round(1.0e6 * Time),
            Violation =
                case Time >= 1.0 of
                    true -> planted(#{at_us => AtUs(EndUs)});
                    _ -> none
                end,
            {ok, Outcome} = outcome(S, Violation),
            {ok, Outcome#{end_us := EndUs}}
        end
    end,
    {ok, #{scenario := #{time := Where}}} = shrink(scenario(0, 1), Late(fun(_) -> 1000000 end)),
    ?assertEqual(1.0, Where),
    {ok, #{scenario := #{time := Halved}}} = shrink(scenario(0, 1), Late(fun(End) -> End end)),
    ?assertEqual(60 / 32, Halved).

%% What a later step takes away may let an earlier one go on: there are several rounds.
second_round_test() ->
    Run = fun(#{robots := N} = S) ->
        Needed = N < 5 orelse lists:member(f1, ids(S)),
        outcome(
            S,
            case Needed of
                true -> ?PLANTED;
                false -> none
            end
        )
    end,
    {ok, #{scenario := #{robots := 2, faults := []}}} = shrink(scenario(3, 8), Run).

%% The smallest team that will do, of any size; one robot alone is no team.
smallest_team_test() ->
    [
        begin
            {ok, #{scenario := #{robots := Robots}}} =
                shrink((scenario(0, 1))#{robots := Team}, needing([], Needed)),
            ?assertEqual({Team, max(min(Team, 2), Needed)}, {Team, Robots})
        end
     || {Team, Needed} <- [{1000, 513} | [{T, N} || T <- lists:seq(1, 12), N <- lists:seq(1, T)]]
    ].

%% In a smaller team there is no fault of robots that are gone, and no group without members; the
%% last robot of the team is not gone.
faults_of_nobody_test() ->
    Faults = [
        {one, 0, 9, isolate, 9, #{}},
        {two, 0, 9, location_swap, {2, 9}, #{}},
        {gone, 0, 9, partition, [8, 9], #{}}
    ],
    Stay = [{last, 0, 9, isolate, 4, #{}}, {g, 0, 9, partition, [1, 4, 9], #{}}],
    Run = fun(#{robots := N, faults := Some} = S) ->
        Targets = [starl_run_fault:targets(F) || F <- Some],
        ?assertEqual([], [R || R <- lists:append(Targets), R > N]),
        ?assertNot(lists:member([], Targets)),
        Needed = [last, g] ++ [Id || {Id, _, _, _, _, _} <- Faults, N >= 9],
        Enough = N >= 4 andalso Needed -- ids(S) =:= [],
        outcome(
            S,
            case Enough of
                true -> ?PLANTED;
                false -> none
            end
        )
    end,
    {ok, #{scenario := Small}} = shrink((scenario(0, 10))#{faults => Faults ++ Stay}, Run),
    ?assertMatch(
        #{robots := 4, faults := [{last, _, _, _, 4, _}, {g, _, _, _, [1, 4], _}]}, Small
    ).

%% Whatever blurs the run is taken out, and so is the time in which robots had to converge.
chance_is_taken_out_test() ->
    Blurred = #{
        duplicate => 0.3,
        clock_offset => 7,
        clock_drift => 9,
        heading_error => 0.1,
        distance_error => 0.1,
        position_error => 5.0,
        range => 5000,
        delay => {3, 30},
        converge => 9
    },
    Plain = #{
        duplicate => 0.0,
        clock_offset => 0,
        clock_drift => 0,
        heading_error => 0.0,
        distance_error => 0.0,
        position_error => 0.0,
        range => none,
        delay => {30, 30},
        converge => none
    },
    {ok, #{scenario := Small}} =
        shrink(maps:merge(scenario(0, 2), Blurred), needing([], 1)),
    ?assertEqual(Plain, maps:with(maps:keys(Plain), Small)).

%% Random loss becomes the packets that matter; other losses have faults of their own.
losses_become_drops_test() ->
    Before = (scenario(1, 4))#{loss => 0.3},
    IsLost = fun(N) -> starl_sim_radio:lost({1, 1, 2, N}, Before) end,
    [Kept | _] = [N || N <- lists:seq(1, 200), not starl_sim_radio:lost({1, 2, 1, N}, Before)],
    Lost = [{1000 * N, 1, 2, N} || N <- lists:seq(1, 200), IsLost(N)],
    [Early, Late] = [lists:nth(K, [N || {_, _, _, N} <- Lost]) || K <- [3, 40]],
    Run = fun(#{loss := Loss, faults := Faults, time := Time} = S) ->
        Dropped = [N || {_, _, _, drop, {1, 2}, #{packet := N}} <- Faults],
        %% what a fault has lost is no chance
        ?assertNot(lists:member({2, 1}, [Link || {_, _, _, drop, Link, _} <- Faults])),
        Missing = [Early, Late] -- Dropped,
        Enough =
            lists:member(f1, ids(S)) andalso (Loss > 0 orelse Missing =:= []) andalso
                Time >= 1.0005,
        Violation =
            case Enough of
                true -> planted(#{at_us => 1000500});
                false -> none
            end,
        {ok, (element(2, outcome(S, Violation)))#{lost => [{5, 2, 1, Kept} | Lost]}}
    end,
    {ok, #{scenario := #{loss := +0.0, faults := Left}, figures := #{drops := 2, faults := 3}}} =
        shrink(Before, Run),
    [{f1, _, _, isolate, 1, _} | Drops] = Left,
    %% whenever they are sent: until the end of the run, rounded up to whole milliseconds
    ?assertEqual(
        [{0, 1001, Early}, {0, 1001, Late}],
        [{From, To, N} || {_, From, To, drop, _, #{packet := N}} <- Drops]
    ).

%% Where it spoils the run that a packet is lost whenever it is sent, each is lost only when it
%% was; one to all and one to a single robot are two, even if their numbers are the same.
losses_in_their_moment_test() ->
    Before = (scenario(0, 4))#{loss => 0.3},
    IsLost = fun(N) -> starl_sim_radio:lost({1, 1, 2, N}, Before) end,
    [Both | _] = [N || N <- lists:seq(1, 200), IsLost(N), IsLost({all, N})],
    Lost = [{7300, 1, 2, Both}, {9900, 1, 2, {all, Both}}],
    Run = fun(#{loss := Loss, faults := Faults} = S) ->
        ?assertEqual(length(Faults), length(lists:usort(ids(S)))),
        Spans = [{From, To, N} || {_, From, To, drop, {1, 2}, #{packet := N}} <- Faults],
        Enough = Loss > 0 orelse [{7, 8, Both}, {9, 10, Both}] -- Spans =:= [],
        Violation =
            case Enough of
                true -> ?PLANTED;
                false -> none
            end,
        {ok, (element(2, outcome(S, Violation)))#{lost => Lost}}
    end,
    {ok, #{scenario := #{loss := +0.0, faults := Drops}}} = shrink(Before, Run),
    ?assertEqual(2, length(Drops)).

%% A violation that moves forward takes the end of the run along.
time_ends_with_the_violation_test() ->
    Run = fun(#{faults := Faults, time := Time} = S) ->
        At = 1000000 * (1 + length(Faults)),
        outcome(
            S,
            case Time * 1.0e6 >= At of
                true -> planted(#{at_us => At});
                false -> none
            end
        )
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
minimal_test_() ->
    {timeout, 60, fun() ->
        Prop = ?FORALL(
            {N, Drawn, Robots},
            {range(0, 40), list(range(1, 40)), range(1, 12)},
            starl_platform_ct:safely(fun() ->
                Needed = [I || I <- lists:usort(Drawn), I =< N],
                Run = needing(Needed, Robots),
                {ok, #{scenario := Small}} = shrink(scenario(N, 12), Run),
                #{faults := Faults} = Small,
                Less = [Small#{faults := lists:delete(F, Faults)} || F <- Faults],
                violates(Run(Small)) andalso not lists:any(fun(S) -> violates(Run(S)) end, Less) andalso
                    ids(Small) =:= [id(I) || I <- Needed]
            end)
        ),
        starl_platform_ct:property(Prop, 100)
    end}.

%% -- helpers --------------------------------------------------------------------------------

shrink(Scenario, Run) -> starl_sim_shrink:shrink(Scenario, request(Run, #{})).

request(Run, More) -> maps:merge(#{run => Run, watch => fun on/1}, More).

on(_Figures) -> {continue, fun on/1}.

scenario(Faults, Robots) ->
    {ok, Scenario} = starl_run_scenario:check(
        #{
            app => nobody,
            robots => Robots,
            seed => 1,
            time => 60,
            duplicate => 0.1,
            faults => [{id(N), N, N + 5, isolate, 1, #{}} || N <- lists:seq(1, Faults)]
        },
        []
    ),
    Scenario.

id(N) -> starl_platform_ct:fault_id(f, N).

ids(#{faults := Faults}) -> [element(1, Fault) || Fault <- Faults].

%% Needs these faults and so many robots.
needing(Needed, Robots) ->
    fun(#{robots := N, time := Time} = S) ->
        Missing = [id(I) || I <- Needed] -- ids(S),
        Enough = Missing =:= [] andalso N >= Robots andalso Time >= 1,
        outcome(
            S,
            case Enough of
                true -> ?PLANTED;
                false -> none
            end
        )
    end.

planted(Changes) -> maps:merge(?PLANTED, Changes).

outcome(Scenario, Violation) ->
    Found = [
        maps:merge(#{at_us => 1000000, robots => [], details => #{}}, V)
     || V <- [Violation], V =/= none
    ],
    EndUs = lists:min([round(1.0e6 * maps:get(time, Scenario)) | [At || #{at_us := At} <- Found]]),
    {ok, #{
        scenario => Scenario,
        digest => crypto:hash(md5, term_to_binary(Scenario, [deterministic])),
        ending => time,
        end_us => EndUs,
        events => 1,
        violations => Found,
        lost => []
    }}.

violates({ok, #{violations := Violations}}) -> Violations =/= [].
