%% The judge: windows in their order, whole, and each fact at its place.
-module(starl_sim_judge_tests).
-behaviour(starl_monitor).
-include_lib("eunit/include/eunit.hrl").

-export([init/1, step/2, finish/2]).

%% A window is judged when all shards have told of it and those before it are judged.
waits_for_all_and_the_order_test() ->
    {[A, B] = Shards, Judge0} = two_shards(),
    {ok, Judge1} = starl_sim_judge:told(A, 2, [{30, 1, m, x}], 2, Judge0),
    {ok, Judge2} = starl_sim_judge:told(B, 2, [], 2, Judge1),
    {ok, Judge3} = starl_sim_judge:told(B, 1, [{10, 2, m, x}], 2, Judge2),
    ?assertEqual({0, 0, [A]}, {
        starl_sim_judge:judged(Judge3),
        starl_sim_judge:seen(Judge3),
        starl_sim_judge:missing(Shards, Judge3)
    }),
    {ok, Judge4} = starl_sim_judge:told(A, 1, [{5, 1, m, x}], 2, Judge3),
    ?assertEqual({2, 30, [A, B]}, {
        starl_sim_judge:judged(Judge4),
        starl_sim_judge:seen(Judge4),
        starl_sim_judge:missing(Shards, Judge4)
    }).

%% The monitors see one trace in the order of time, then robot, whoever told first.
one_trace_test() ->
    First = [{5, 1, m, x}, {9, 1, m, x}, {9, 1, m, y}],
    Second = [{5, 2, m, x}, {7, 2, m, x}, {9, 2, m, x}],
    Whole = [{5, 1, m, x}, {5, 2, m, x}, {7, 2, m, x}, {9, 1, m, x}, {9, 1, m, y}, {9, 2, m, x}],
    {[A, B], Judge0} = two_shards(),
    [
        begin
            {ok, Judge1} = starl_sim_judge:told(S1, 1, T1, 2, Judge0),
            {ok, Judge2} = starl_sim_judge:told(S2, 1, T2, 2, Judge1),
            {[], #{starl_sim_order_monitor := #{trace := Seen}}, []} = starl_sim_judge:close(
                9, Judge2
            ),
            ?assertEqual(Whole, Seen)
        end
     || {S1, T1, S2, T2} <- [{A, First, B, Second}, {B, Second, A, First}]
    ].

%% A violation is told when it is found, once, and stays.
violation_test() ->
    Judge0 = starl_sim_judge:new([{starl_sim_order_monitor, #{}}]),
    {violation, Judge1} = starl_sim_judge:told(self(), 1, [{9, 1, m, x}, {5, 1, m, x}], 1, Judge0),
    ?assertNot(starl_sim_judge:is_sound(Judge1)),
    {ok, Judge2} = starl_sim_judge:told(self(), 2, [{11, 1, m, x}], 1, Judge1),
    ?assertNot(starl_sim_judge:is_sound(Judge2)),
    ?assertMatch({[_], _, []}, starl_sim_judge:close(11, Judge2)).

%% All violations stay, in the order in which they were found, and those of the finish follow.
all_violations_test() ->
    Judge0 = starl_sim_judge:new([{starl_sim_order_monitor, #{}}, {?MODULE, #{}}]),
    {violation, Judge1} = starl_sim_judge:told(self(), 1, [{9, 1, m, x}, {5, 1, m, x}], 1, Judge0),
    {violation, Judge2} = starl_sim_judge:told(self(), 2, [{8, 1, m, x}], 1, Judge1),
    {Violations, Results, []} = starl_sim_judge:close(20, Judge2),
    ?assertEqual(
        [{time_runs_backwards, 5}, {time_runs_backwards, 8}, {late, 20}],
        [{What, At} || #{what := What, at_us := At} <- Violations]
    ),
    ?assertEqual([starl_sim_judge_tests, starl_sim_order_monitor], lists:sort(maps:keys(Results))).

%% What was seen last is the last event of a window; one without events changes nothing.
seen_test() ->
    Judge0 = starl_sim_judge:new([]),
    {ok, Judge1} = starl_sim_judge:told(self(), 1, [{5, 1, m, x}, {9, 1, m, x}], 1, Judge0),
    ?assertEqual(9, starl_sim_judge:seen(Judge1)),
    {ok, Judge2} = starl_sim_judge:told(self(), 2, [], 1, Judge1),
    ?assertEqual({2, 9}, {starl_sim_judge:judged(Judge2), starl_sim_judge:seen(Judge2)}).

%% A monitor that finds something only in the end.
init(#{}) -> none.

step(_Event, State) -> {ok, State}.

finish(End, none) ->
    {
        {violation, [#{contract => late, what => late, at_us => End, robots => [], details => #{}}]},
        #{}
    }.

two_shards() ->
    Judge = starl_sim_judge:new([{starl_sim_order_monitor, #{}}]),
    ?assert(starl_sim_judge:is_sound(Judge)),
    {[self(), whereis(init)], Judge}.
