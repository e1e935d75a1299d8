%% The outcome of a run: what is added up of its robots, and the digest, which tells runs apart and
%% is there only when all robots are known of.
-module(starl_sim_outcome_tests).
-include_lib("eunit/include/eunit.hrl").

%% All that is known of a run is in it; events and packets are those of all robots.
adds_up_test() ->
    End = ending([robot(1, 7), robot(2, 9), robot(3, 4)], 3),
    #{digest := Digest} = Outcome = starl_sim_outcome:new(End, judge()),
    ?assertEqual(
        #{
            ending => done,
            end_us => 5,
            judged_us => 5,
            robots => maps:get(robots, End),
            lost => [],
            events => 20,
            packets => 320,
            violations => [],
            unjudged => [],
            monitors => #{starl_sim_order_monitor => #{trace => []}}
        },
        maps:remove(digest, Outcome)
    ),
    ?assertEqual(16, byte_size(Digest)).

%% What the monitors have found is in it.
violations_test() ->
    Trace = [{9, 1, m, x}, {5, 1, m, x}],
    {violation, Judge} = starl_sim_judge:told(self(), 1, Trace, 1, judge()),
    #{violations := [#{contract := order}]} = starl_sim_outcome:new(
        ending([robot(1, 7)], 1), Judge
    ).

%% The monitors are closed at the end of the run, which is when they say what is missing.
closed_at_the_end_test() ->
    Unfinished = {starl_run_progress_monitor, #{robots => [1], deadline_us => 5}},
    #{violations := Violations} =
        starl_sim_outcome:new(ending([robot(1, 7)], 1), starl_sim_judge:new([Unfinished])),
    ?assertMatch([#{contract := progress, at_us := 5}], Violations).

%% Where nothing can happen any more, those who wait have waited for ever: they are late at their deadline.
%% Holds: A run in which nothing can happen any more is judged to its limit: who waits for ever is
%% late
%% Red: 1b63aeb, run: the planted motion, which waits for the answer to a lost command, is not
%% found in 1,000 seeds
judged_to_the_limit_when_quiet_test() ->
    Unfinished = {starl_run_progress_monitor, #{robots => [1], deadline_us => 9}},
    Close = fun(Ending) ->
        End = (ending([robot(1, 7)], 1))#{ending := Ending},
        starl_sim_outcome:new(End, starl_sim_judge:new([Unfinished]))
    end,
    ?assertMatch(#{violations := [], judged_us := 5}, Close(stopped)),
    ?assertMatch(
        #{violations := [#{at_us := 9}], judged_us := 9, end_us := 5}, Close(quiet)
    ).

%% Two runs have the same digest if the chains of all robots are the same, and only then; whose
%% chain it is counts, the rest of what is known does not.
digest_test() ->
    Robots = [robot(1, 7), robot(2, 9)],
    [{1, Summary}, Second] = Robots,
    ?assertEqual(digest(Robots), digest([{1, Summary#{packets := 0, events := 1}}, Second])),
    Others = [
        [robot(1, 9), robot(2, 7)],
        [robot(1, 7), robot(2, 8)],
        [robot(1, 7), robot(3, 9)],
        [robot(1, 7 + 4294967296 div 2), robot(2, 9)],
        [robot(1, 7)],
        [robot(2, 9)]
    ],
    Digests = [digest(Some) || Some <- [Robots | Others]],
    ?assertEqual(length(Digests), length(lists:usort(Digests))).

%% With the robots of a lost node the digest is gone: part of a run is like no other run.
lost_robots_test() ->
    Robots = [robot(1, 7), robot(2, 9)],
    Outcome = starl_sim_outcome:new((ending(Robots, 3))#{ending := lost}, judge()),
    ?assertMatch(#{digest := <<>>, events := 16, ending := lost}, Outcome).

digest(Robots) ->
    #{digest := Digest} = starl_sim_outcome:new(ending(Robots, length(Robots)), judge()),
    Digest.

ending(Robots, Team) ->
    #{ending => done, end_us => 5, limit_us => 9, robots => Robots, team => Team, lost => []}.

%% It had as many events as its chain says, and a hundred packets more.
robot(Id, Chain) -> {Id, #{chain => Chain, events => Chain, packets => Chain + 100}}.

judge() -> starl_sim_judge:new([{starl_sim_order_monitor, #{}}]).
