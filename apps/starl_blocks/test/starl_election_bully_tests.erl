%% The election by the bully algorithm, event by event: what a robot says, to whom, and which
%% timers run.
-module(starl_election_bully_tests).
-include_lib("eunit/include/eunit.hrl").

-define(ANSWER_US, 500000).
-define(PATIENCE_US, 9000000).

%% A robot of four: the actions of its start, and the machine.
new(Self, Config) ->
    starl_machine:new(starl_election_bully, Config, #{
        robot => Self,
        participants => [1, 2, 3, 4],
        name => election,
        incarnation => 1,
        random => rand:seed_s(exsss, 1),
        now => 0
    }).

robot(Self) -> element(2, new(Self, #{})).

step(Type, Content, Machine) ->
    starl_machine:step(Type, Content, #{now => 0, robot => 1}, Machine).

call(Election, Tag, Machine) ->
    step({call, {app, Tag}}, {elect, Election, ?PATIENCE_US}, Machine).

hears(From, Type, Body, Machine) -> step(cast, {message, From, Type, Body}, Machine).

round_over(Machine) -> step({timeout, {round, e}}, over, Machine).

no_patience(Machine) -> step({timeout, {patience, e}}, patience, Machine).

%% The machine after some steps.
after_all(Steps, Machine) -> lists:foldl(fun(Step, M) -> element(2, Step(M)) end, Machine, Steps).

calls() -> fun(M) -> call(e, a, M) end.

alive() -> fun(M) -> hears(3, bully_alive, e, M) end.

challenges(To) ->
    [{{timeout, {round, e}}, ?ANSWER_US, over}] ++
        [{cast, sap, {send, Robot, bully_challenge, e}} || Robot <- To].

elected(Leader, How) ->
    [
        {trace, {elected, e, Leader, How}},
        {{timeout, {round, e}}, cancel},
        {{timeout, {patience, e}}, cancel}
    ].

announces(Leader) -> announces(Leader, few).

announces(Leader, Ground) -> {cast, sap, {broadcast, bully_leader, {e, Leader, Ground}}}.

listening() ->
    [{cast, sap, {listen, T, election}} || T <- [bully_challenge, bully_alive, bully_leader]].

listens_test() ->
    {Actions, Machine} = new(2, #{}),
    ?assertEqual(listening(), Actions),
    ?assertEqual({listening(), Machine}, step(info, {restarted, sap}, Machine)),
    ?assertEqual({[], Machine}, step(info, {restarted, app}, Machine)),
    Unknown = {message, 2, other, what},
    ?assertMatch({[{trace, {malformed, 2, other, what}}], _}, step(cast, Unknown, Machine)),
    ?assertMatch({[{trace, {unknown_event, cast, what}}], _}, step(cast, what, Machine)).

%% Who enters asks those above; the highest has nobody to ask.
enters_test() ->
    {Actions, _} = call(e, a, robot(2)),
    ?assertEqual(
        [{trace, {entered, e}}, {{timeout, {patience, e}}, ?PATIENCE_US, patience}] ++
            challenges([3, 4]),
        Actions
    ),
    {Won, _} = call(e, a, robot(4)),
    ?assertEqual(
        [{trace, {entered, e}}, {{timeout, {patience, e}}, ?PATIENCE_US, patience}] ++
            elected(4, highest) ++ [{reply, {app, a}, {ok, 4}}, announces(4)],
        Won
    ).

%% How long it waits for an answer is for its configuration to say.
answer_ms_test() ->
    {Actions, Machine} = call(e, a, element(2, new(2, #{answer_ms => 7}))),
    ?assertEqual([7000], [Us || {{timeout, {round, e}}, Us, over} <- Actions]),
    {Hoping, _} = hears(3, bully_alive, e, Machine),
    ?assertEqual([{{timeout, {round, e}}, 21000, over}], Hoping).

%% Nobody above answers: it leads.
wins_test() ->
    {Actions, Won} = round_over(after_all([calls()], robot(2))),
    ?assertEqual(elected(2, highest) ++ [{reply, {app, a}, {ok, 2}}, announces(2)], Actions),
    %% that is known from now on, and told to who asks
    ?assertEqual(
        [{trace, {entered, e}}, {trace, {elected, e, 2, known}}, {reply, {app, b}, {ok, 2}}],
        element(1, call(e, b, Won))
    ),
    ?assertMatch(
        {[{cast, sap, {send, 1, bully_leader, {e, 2, heard}}}], _},
        hears(1, bully_challenge, e, Won)
    ),
    [
        ?assertEqual({[], Won}, Step(Won))
     || Step <- [
            fun round_over/1,
            fun no_patience/1,
            alive(),
            fun(M) -> hears(3, bully_leader, {e, 3, heard}, M) end
        ]
    ].

%% Somebody above is alive: three times as long it waits for the announcement, then asks again.
hopes_test() ->
    Asking = after_all([calls()], robot(2)),
    {Actions, Hoping} = hears(3, bully_alive, e, Asking),
    ?assertEqual([{{timeout, {round, e}}, 3 * ?ANSWER_US, over}], Actions),
    %% one that hopes already hopes no longer than that
    ?assertMatch({[], _}, hears(4, bully_alive, e, Hoping)),
    {Again, _} = round_over(Hoping),
    ?assertEqual(challenges([3, 4]), Again),
    {Led, _} = hears(3, bully_leader, {e, 3, few}, Hoping),
    ?assertEqual(elected(3, announcement) ++ [{reply, {app, a}, {ok, 3}}], Led),
    %% in an election that it has not begun there is nothing to hope for
    ?assertMatch({[], _}, hears(3, bully_alive, e, robot(2))).

%% Whose application waits goes on and on; without it four rounds are enough, or as configured.
rounds_test() ->
    Challenged = fun(Machine) ->
        element(2, hears(1, bully_challenge, e, Machine))
    end,
    Rounds = fun(Machine) -> rounds(100, Machine) end,
    ?assertEqual(100, Rounds(after_all([calls()], robot(2)))),
    ?assertEqual(4, Rounds(Challenged(robot(2)))),
    ?assertEqual(2, Rounds(Challenged(element(2, new(2, #{rounds => 2}))))),
    %% a call begins to count anew
    Tired = lists:foldl(
        fun(_, M) -> after_all([alive(), fun round_over/1], M) end,
        Challenged(robot(2)),
        [1, 2, 3, 4]
    ),
    ?assertEqual(100, Rounds(after_all([calls()], Tired))),
    %% and so it is when nobody waits any more
    [
        ?assertEqual(4, Rounds(after_all([calls(), fun no_patience/1], Machine)))
     || Machine <- [robot(2), Tired]
    ].

%% How many rounds of challenges there are, at most so many, when those above only say that they
%% are alive.
rounds(Most, Machine) -> rounds(1, Most, Machine).

rounds(Most, Most, _Machine) ->
    Most;
rounds(N, Most, Machine) ->
    case round_over(after_all([alive()], Machine)) of
        {[], _} ->
            N;
        {[_ | _] = Actions, Next} ->
            ?assertEqual(challenges([3, 4]), Actions),
            rounds(N + 1, Most, Next)
    end.

%% A patience that ends ends the waiting, not the election.
gives_up_test() ->
    Asking = after_all([calls()], robot(2)),
    {Actions, GivenUp} = no_patience(Asking),
    ?assertEqual([{trace, {failed, e, timeout}}, {reply, {app, a}, {error, timeout}}], Actions),
    ?assertEqual({[], GivenUp}, no_patience(GivenUp)),
    ?assertMatch({[], _}, no_patience(robot(2))),
    {Won, _} = round_over(GivenUp),
    ?assertEqual(elected(2, highest) ++ [announces(2)], Won),
    {Led, _} = hears(3, bully_leader, {e, 3, heard}, GivenUp),
    ?assertEqual(elected(3, announcement), Led).

%% 1024 elections are remembered of each robot that has named them, whatever was heard of them; those that the
%% application has entered are its own.
remembers_test_() -> {timeout, 30, fun remembers/0}.

remembers() ->
    Heard = fun(To, M) ->
        after_all(
            [fun(Q) -> hears(3, bully_leader, {N, 3, majority}, Q) end || N <- lists:seq(1, To)], M
        )
    end,
    IsKnown = fun(N, M) ->
        element(1, hears(1, bully_challenge, N, M)) =:=
            [{cast, sap, {send, 1, bully_leader, {N, 3, majority}}}]
    end,
    ?assertEqual([true, true], [IsKnown(N, Heard(1024, robot(2))) || N <- [1, 1024]]),
    More = Heard(1025, robot(2)),
    ?assertEqual([false, true, true], [IsKnown(N, More) || N <- [1, 2, 1025]]),
    Waiting = Heard(1100, after_all([calls()], robot(2))),
    ?assertEqual([false, true, true], [IsKnown(N, Waiting) || N <- [76, 77, 1100]]),
    ?assertEqual([{app, a}], [To || {reply, To, {ok, 2}} <- element(1, round_over(Waiting))]),
    %% no longer waited for it does not go with those of others
    Elected = after_all(
        [calls(), fun(M) -> hears(3, bully_leader, {e, 3, majority}, M) end], robot(2)
    ),
    Over = Heard(1024, Elected),
    ?assertEqual(
        [{trace, {entered, e}}, {trace, {elected, e, 3, known}}, {reply, {app, b}, {ok, 3}}],
        element(1, call(e, b, Over))
    ),
    %% where all are waited for none goes
    Calls = [fun(M) -> call(N, N, M) end || N <- lists:seq(1, 1025)],
    Full = after_all(Calls, robot(2)),
    ?assertEqual(
        [{app, 1}], [
            To
         || {reply, To, _} <- element(1, hears(3, bully_leader, {1, 3, majority}, Full))
        ]
    ),
    %% and none goes for those of another robot, which has room for as many
    Ends = [fun(M) -> hears(3, bully_leader, {N, 3, majority}, M) end || N <- lists:seq(1, 2050)],
    ?assertEqual(
        [true, true, false, true], [IsKnown(N, after_all(Ends, Full)) || N <- [1, 1025, 1026, 1027]]
    ).

%% Nobody outside the team is elected, whoever says so.
stranger_test() ->
    Asking = after_all([calls()], robot(2)),
    [
        ?assertMatch(
            {[{trace, {unknown_event, cast, _}}], Asking},
            hears(3, bully_leader, {e, Stranger, heard}, Asking)
        )
     || Stranger <- [5, 1 bsl 57]
    ].

%% -- who is followed ------------------------------------------------------------------------------

%% A robot that says that it leads is followed when it has answered this one, or a majority has asked it.
heard_by_the_leader_test() ->
    Asking = after_all([calls()], robot(1)),
    Follows = fun(Body, M) ->
        element(1, hears(element(2, Body), bully_leader, Body, M)) =:=
            elected(4, announcement) ++ [{reply, {app, a}, {ok, 4}}]
    end,
    ?assert(Follows({e, 4, heard}, Asking)),
    ?assert(Follows({e, 4, majority}, Asking)),
    ?assertNot(Follows({e, 4, few}, Asking)),
    Answered = fun(From) -> element(2, hears(From, bully_alive, e, Asking)) end,
    ?assert(Follows({e, 4, few}, Answered(4))),
    ?assertNot(Follows({e, 4, few}, Answered(3))),
    %% another robot cannot say whom the leader hears
    {[{{timeout, {round, e}}, _, over}], _} = hears(3, bully_leader, {e, 4, heard}, Asking).

%% A robot that has not taken part asks it, and nobody else; then, without an answer, all above itself.
a_leader_is_asked_whether_it_hears_test() ->
    {Actions, Asked} = hears(4, bully_leader, {e, 4, few}, robot(1)),
    ?assertEqual(challenges([4]), Actions),
    {Again, Asking} = round_over(Asked),
    ?assertEqual(challenges([2, 3, 4]), Again),
    {Won, _} = round_over(Asking),
    ?assertEqual(elected(1, highest) ++ [announces(1)], Won),
    {Led, _} = hears(4, bully_leader, {e, 4, heard}, Asked),
    ?assertEqual(elected(4, announcement), Led),
    %% one that is higher takes part
    {Higher, _} = hears(1, bully_leader, {e, 1, few}, robot(2)),
    ?assertEqual(challenges([3, 4]), Higher).

%% The leader answers all that ask; when a majority has asked it tells all, once.
a_majority_is_told_to_all_test() ->
    {_, Won} = call(e, a, robot(4)),
    {One, First} = hears(1, bully_challenge, e, Won),
    ?assertEqual([{cast, sap, {send, 1, bully_leader, {e, 4, heard}}}], One),
    {[_], First} = hears(1, bully_challenge, e, First),
    {Two, Second} = hears(2, bully_challenge, e, First),
    ?assertEqual([announces(4, majority)], Two),
    {Three, _} = hears(3, bully_challenge, e, Second),
    ?assertEqual([{cast, sap, {send, 3, bully_leader, {e, 4, heard}}}], Three),
    %% what was heard before it led counts, too
    {_, Some} = hears(2, bully_challenge, e, element(2, hears(1, bully_challenge, e, robot(3)))),
    ?assertEqual(elected(3, highest) ++ [announces(3, majority)], element(1, round_over(Some))).

%% What others say of a leader of few is a sign of life, in the first round only; of a leader of most, enough.
passed_on_test() ->
    Asking = after_all([calls()], robot(1)),
    {Hope, Hoping} = hears(3, bully_leader, {e, 4, few}, Asking),
    ?assertEqual([{{timeout, {round, e}}, 3 * ?ANSWER_US, over}], Hope),
    {_, Again} = round_over(Hoping),
    ?assertMatch({[], _}, hears(3, bully_leader, {e, 4, few}, Again)),
    {Led, Knows} = hears(3, bully_leader, {e, 4, majority}, Again),
    ?assertEqual(elected(4, announcement) ++ [{reply, {app, a}, {ok, 4}}], Led),
    Passes = fun(M) -> element(1, hears(2, bully_challenge, e, M)) end,
    ?assertEqual([{cast, sap, {send, 2, bully_leader, {e, 4, majority}}}], Passes(Knows)),
    {_, Few} = hears(4, bully_leader, {e, 4, heard}, Asking),
    ?assertEqual([{cast, sap, {send, 2, bully_leader, {e, 4, few}}}], Passes(Few)),
    {[], Later} = hears(4, bully_leader, {e, 4, majority}, Few),
    ?assertEqual([{cast, sap, {send, 2, bully_leader, {e, 4, majority}}}], Passes(Later)).
