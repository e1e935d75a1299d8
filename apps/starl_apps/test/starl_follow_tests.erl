%% Following a leader: the contract, and runs in which leaders die.
-module(starl_follow_tests).
-include_lib("eunit/include/eunit.hrl").

judged(Events) -> judged(Events, 0).

judged(Events, Healed) ->
    Config = #{robots => [1, 2], healed_us => Healed},
    starl_team_runs:judged(Events, {starl_follow_monitor, Config}).

leads(S, Robot, Term) -> {S * 1000000, Robot, app, {leads, Term}}.

follows(S, Robot, Term, Leader) -> {S * 1000000, Robot, app, {follows, Term, Leader}}.

terms_go_onwards_test() ->
    Kept = [leads(1, 2, 1), follows(1, 1, 1, 2), follows(3, 1, 2, 2), leads(4, 2, 2)],
    ?assertMatch({[], #{leaders := 1, longest_us := 3000000}}, judged(Kept)),
    ?assertMatch({[went_back], _}, judged(Kept ++ [follows(5, 1, 1, 2)])),
    ?assertMatch({[went_back], _}, judged(Kept ++ [leads(5, 1, 1)])),
    %% a new life may begin anew
    ?assertMatch({[], _}, judged(Kept ++ [{4500000, 1, app, crashed}, follows(5, 1, 1, 2)])).

somebody_leads_test() ->
    ?assertMatch({[], _}, judged([leads(1, 2, 1), leads(60, 1, 2)])),
    ?assertMatch({[nobody_leads], _}, judged([leads(1, 2, 1), leads(62, 1, 2)])),
    ?assertMatch({[nobody_leads], #{leaders := 0}}, judged([follows(61, 1, 1, 2)])),
    %% it counts from the end of the faults; when one is done, all are; when all have died, nobody can
    ?assertMatch({[], _}, judged([leads(1, 2, 1), leads(62, 1, 2)], 5000000)),
    Late = follows(100, 1, 1, 2),
    ?assertMatch({[], _}, judged([leads(1, 2, 1), {5000000, 1, app, {done, 1}}, Late])),
    Died = [{T, Robot, robot, {died, killed}} || {T, Robot} <- [{5000000, 1}, {6000000, 2}]],
    ?assertMatch({[], _}, judged([leads(1, 2, 1) | Died] ++ [Late])),
    ?assertMatch({[nobody_leads], _}, judged([leads(1, 2, 1), hd(Died), Late])).

%% A column has no empty place when its leader dies; the robot that comes back is the last one.
a_column_closes_up_test() ->
    Column = fun(Leader) ->
        Ids = lists:delete(Leader, [1, 2, 3, 4, 5]),
        [
            Id
         || {_, Id} <- lists:sort([
                {starl_follow:rank(I, Leader, [1, 2, 3, 4, 5]), I}
             || I <- Ids
            ])
        ]
    end,
    ?assertEqual([4, 3, 2, 1], Column(5)),
    ?assertEqual([3, 2, 1, 5], Column(4)),
    ?assertEqual([2, 1, 5, 4], Column(3)),
    ?assertEqual(1, starl_follow:rank(3, 4, [1, 2, 3, 4, 5])).

follow(More) ->
    Scenario = maps:merge(#{app => starl_follow, time => 200}, More),
    #{report := #{figures := [{leaders, N}, {leaderless_s, S}]}} =
        Outcome = starl_team_runs:both_ways(Scenario),
    {N, S, Outcome}.

%% Each comes to its place in the column, which is as far behind the leader as its rank says.
%% Holds: Followers are in their places while these go on; no place stays empty when a leader dies
%% Red: aiming at the place itself: 200 mm behind it, all the time; ranks that count the dead
column_test_() ->
    {timeout, 120, fun() ->
        {1, Least, #{robots := Robots} = Outcome} = follow(#{robots => 4}),
        ?assert(Least < 5),
        %% once they have come they are in their places, while these go on: most of the time to a few centimetres
        Errors = starl_team_runs:noted(error_mm, Outcome),
        Settled = lists:sort(lists:nthtail(length(Errors) div 2, Errors)),
        ?assert(lists:nth(length(Settled) * 8 div 10, Settled) < 50),
        ?assert(lists:last(Settled) < 200),
        Places = [{X, Y} || {_, #{pose := {X, Y, _}}} <- Robots],
        %% neighbours in the column, about 700 mm apart
        Gaps = [
            starl_geometry:distance(P, Q)
         || {P, Q} <- lists:zip(lists:droplast(Places), tl(Places))
        ],
        ?assert(lists:all(fun(Mm) -> Mm > 350 andalso Mm < 1400 end, Gaps), Gaps)
    end}.

%% Without a leader they are for the silence, and the time of an election.
%% Holds: When a leader dies another one leads; two leaders of a term make no storm of beats
%% Red: a silence that begins no election; a leader that answers each beat at once: the run does
%% not end
fail_over_test_() ->
    [
        {timeout, 120, fun() ->
            {Leaders, Least, _} = follow(More),
            ?assertEqual({Expected, true}, {Leaders, Least < 10})
        end}
     || {Expected, More} <- [
            {2, #{robots => 4, faults => [{f, 20000, 20000, kill_robot, 4, #{}}]}},
            {2, #{robots => 3, loss => 0.2, faults => [{f, 20000, 20000, kill_robot, 3, #{}}]}},
            {3, #{
                robots => 4,
                faults => [
                    {f, 20000, 20000, kill_robot, 4, #{}}, {g, 35000, 35000, kill_robot, 3, #{}}
                ]
            }},
            {1, #{robots => 1}}
        ]
    ].
