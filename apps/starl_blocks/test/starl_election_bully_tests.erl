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

announces(Leader) -> {cast, sap, {broadcast, bully_leader, {e, Leader}}}.

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
    ?assertEqual(
        {[{cast, sap, {send, 1, bully_leader, {e, 2}}}], Won},
        hears(1, bully_challenge, e, Won)
    ),
    [
        ?assertEqual({[], Won}, Step(Won))
     || Step <- [
            fun round_over/1,
            fun no_patience/1,
            alive(),
            fun(M) -> hears(3, bully_leader, {e, 3}, M) end
        ]
    ].

%% Somebody above is alive: three times as long it waits for the announcement, then asks again.
hopes_test() ->
    Asking = after_all([calls()], robot(2)),
    {Actions, Hoping} = hears(3, bully_alive, e, Asking),
    ?assertEqual([{{timeout, {round, e}}, 3 * ?ANSWER_US, over}], Actions),
    %% one that hopes already hopes no longer than that
    ?assertEqual({[], Hoping}, hears(4, bully_alive, e, Hoping)),
    {Again, _} = round_over(Hoping),
    ?assertEqual(challenges([3, 4]), Again),
    {Led, _} = hears(3, bully_leader, {e, 3}, Hoping),
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
    {Led, _} = hears(3, bully_leader, {e, 3}, GivenUp),
    ?assertEqual(elected(3, announcement), Led).

%% 1024 elections are remembered, whatever was heard of them, and those that somebody waits for.
remembers_test_() -> {timeout, 30, fun remembers/0}.

remembers() ->
    Heard = fun(To, M) ->
        after_all(
            [fun(Q) -> hears(3, bully_leader, {N, 3}, Q) end || N <- lists:seq(1, To)], M
        )
    end,
    IsKnown = fun(N, M) ->
        element(1, hears(1, bully_challenge, N, M)) =:=
            [{cast, sap, {send, 1, bully_leader, {N, 3}}}]
    end,
    ?assertEqual([true, true], [IsKnown(N, Heard(1024, robot(2))) || N <- [1, 1024]]),
    More = Heard(1025, robot(2)),
    ?assertEqual([false, true, true], [IsKnown(N, More) || N <- [1, 2, 1025]]),
    Waiting = Heard(1100, after_all([calls()], robot(2))),
    ?assertEqual([false, true, true], [IsKnown(N, Waiting) || N <- [77, 78, 1100]]),
    ?assertEqual([{app, a}], [To || {reply, To, {ok, 2}} <- element(1, round_over(Waiting))]),
    %% no longer waited for it goes with the next ones
    Elected = after_all([calls(), fun(M) -> hears(3, bully_leader, {e, 3}, M) end], robot(2)),
    Over = Heard(1024, Elected),
    ?assertMatch([{trace, {entered, e}}, {{timeout, _}, _, _} | _], element(1, call(e, b, Over))),
    %% where all are waited for none goes
    Calls = [fun(M) -> call(N, N, M) end || N <- lists:seq(1, 1025)],
    Full = after_all(Calls, robot(2)),
    ?assertEqual(
        [{app, 1}], [To || {reply, To, _} <- element(1, hears(3, bully_leader, {1, 3}, Full))]
    ),
    %% but they all go later, the latest, too
    Ends = [fun(M) -> hears(3, bully_leader, {N, 3}, M) end || N <- lists:seq(1, 2050)],
    ?assertEqual(
        [false, false, true], [IsKnown(N, after_all(Ends, Full)) || N <- [1, 1025, 1026]]
    ).

%% Nobody outside the team is elected, whoever says so.
stranger_test() ->
    Asking = after_all([calls()], robot(2)),
    [
        ?assertMatch(
            {[{trace, {unknown_event, cast, _}}], Asking},
            hears(3, bully_leader, {e, Stranger}, Asking)
        )
     || Stranger <- [5, 1 bsl 57]
    ].
