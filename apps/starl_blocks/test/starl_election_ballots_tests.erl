%% The election by ballots, event by event: what a robot says, to whom, and which timers run.
-module(starl_election_ballots_tests).
-include_lib("eunit/include/eunit.hrl").

-define(AGAIN_US, 3000000).
-define(PATIENCE_US, 9000000).

%% Robot 1 of three: the actions of its start, and the machine.
new() -> new(1).

new(Seed) -> new(Seed, 1).

new(Seed, Life) ->
    starl_machine:new(starl_election_ballots, #{}, #{
        robot => 1,
        participants => [1, 2, 3],
        name => election,
        incarnation => Life,
        random => rand:seed_s(exsss, Life),
        team_seed => Seed,
        now => 0
    }).

started() -> element(2, new()).

step(Type, Content, Machine) ->
    starl_machine:step(Type, Content, #{now => 0, robot => 1}, Machine).

call(Election, Tag, Machine) ->
    step({call, {app, Tag}}, {elect, Election, ?PATIENCE_US}, Machine).

%% Ballots of others are larger than any that is drawn.
ballot(From, Election, Machine) ->
    step(cast, {message, From, ballot, {Election, {1 bsl 40, From}}}, Machine).

leader(Leader, Election, Machine) ->
    step(cast, {message, Leader, leader, {Election, Leader}}, Machine).

all(Steps, Machine) -> lists:foldl(fun(Step, M) -> element(2, Step(M)) end, Machine, Steps).

calls(Election) -> fun(M) -> call(Election, a, M) end.

hears(From, Election) -> fun(M) -> ballot(From, Election, M) end.

is_led(Leader, Election) -> fun(M) -> leader(Leader, Election, M) end.

cancelled(Election) ->
    [{{timeout, {again, Election}}, cancel}, {{timeout, {patience, Election}}, cancel}].

listening() -> [{cast, sap, {listen, T, election}} || T <- [ballot, leader]].

%% A new SAP knows no listeners; that another machine is new is nothing to an election.
listens_test() ->
    {Actions, Machine} = new(),
    ?assertEqual(listening(), Actions),
    ?assertEqual({listening(), Machine}, step(info, {restarted, sap}, Machine)),
    ?assertEqual({[], Machine}, step(info, {restarted, app}, Machine)).

unknown_test() ->
    Unknown = {message, 2, other, what},
    ?assertMatch({[{trace, {malformed, 2, other, what}}], _}, step(cast, Unknown, started())),
    ?assertMatch({[{trace, {unknown_event, cast, what}}], _}, step(cast, what, started())).

%% Nobody outside the team is elected, whoever says so; a ballot is its sender's own.
stranger_test() ->
    Asking = all([calls(e)], started()),
    [
        ?assertMatch({[{trace, {unknown_event, cast, _}}], Asking}, step(cast, Message, Asking))
     || Message <- [
            {message, 2, leader, {e, 4}},
            {message, 2, leader, {e, 1 bsl 57}},
            {message, 2, ballot, {e, {1 bsl 57, 4}}},
            {message, 2, ballot, {e, {1 bsl 57, 3}}}
        ]
    ].

%% Who takes part casts a ballot to all, asks again in a while, and has no patience for ever.
takes_part_test() ->
    {Actions, _} = call(e, a, started()),
    [Drawn] = [B || {trace, {ballot, e, B}} <- Actions],
    ?assertEqual(
        [
            {trace, {entered, e}},
            {trace, {ballot, e, Drawn}},
            {cast, sap, {broadcast, ballot, {e, Drawn}}},
            {{timeout, {again, e}}, ?AGAIN_US, again},
            {{timeout, {patience, e}}, ?PATIENCE_US, patience}
        ],
        Actions
    ),
    ?assertMatch({N, 1} when N >= 0, Drawn).

%% A restart begins another stream of random numbers; the ballot is the one of the life before.
%% Holds: A ballot is the same in every life
%% Red: 305a414, run: `second ballot` in each run; on three computers two leaders
the_same_ballot_in_every_life_test() ->
    Cast = fun(Life) -> element(1, call(e, a, element(2, new(1, Life)))) end,
    ?assertEqual(Cast(1), Cast(2)),
    ?assertEqual(Cast(1), Cast(1 bsl 41)).

%% The same ballot in the same election; others in others, and of another seed.
draws_test() ->
    Drawn = fun(Seed, Election) ->
        {Actions, _} = call(Election, a, element(2, new(Seed))),
        [B || {trace, {ballot, _, B}} <- Actions]
    end,
    ?assertEqual(Drawn(1, e), Drawn(1, e)),
    ?assertEqual(
        30, length(lists:usort([Drawn(S, {e, N}) || S <- [1, 2, 3], N <- lists:seq(1, 10)]))
    ).

%% Ballots are 30 bits wide, and every bit is drawn: two alike are rare.
draws_wide_test() ->
    Drawn = [
        N
     || E <- lists:seq(1, 40),
        {trace, {ballot, _, {N, 1}}} <- element(1, call(E, a, started()))
    ],
    ?assertEqual((1 bsl 30) - 1, lists:foldl(fun(N, Bits) -> N bor Bits end, 0, Drawn)).

%% The same ballot in every release of OTP: a run has the same digest in all of them.
draws_for_ever_test() ->
    Drawn = fun(Seed) ->
        {Actions, _} = call({again, 7}, a, element(2, new(Seed))),
        [N || {trace, {ballot, _, {N, 1}}} <- Actions]
    end,
    ?assertEqual(
        [[390004006], [782505261], [448165103], [1071871010]], [Drawn(S) || S <- [1, 2, 3, 4]]
    ).

%% With the last ballot the largest wins; all are told, the caller last but for them.
elects_test() ->
    Machine = all([calls(e), hears(2, e)], started()),
    {Actions, Elected} = ballot(3, e, Machine),
    ?assertEqual(
        [{trace, {elected, e, 3, all_ballots}}] ++ cancelled(e) ++
            [{reply, {app, a}, {ok, 3}}, {cast, sap, {broadcast, leader, {e, 3}}}],
        Actions
    ),
    ?assertEqual([{reply, {app, b}, {ok, 3}}], element(1, call(e, b, Elected))),
    %% later announcements change nothing
    ?assertEqual({[], Elected}, leader(2, e, Elected)).

%% The own ballot may be the last one that was missing.
elects_when_it_takes_part_test() ->
    {Heard, Machine} = ballot(3, e, all([hears(2, e)], started())),
    ?assertEqual([], Heard),
    {Actions, _} = call(e, a, Machine),
    ?assertMatch(
        [
            {trace, {entered, e}},
            {trace, {ballot, e, _}},
            {cast, sap, {broadcast, ballot, _}}
            | _
        ],
        Actions
    ),
    ?assertEqual(
        [{reply, {app, a}, {ok, 3}}, {cast, sap, {broadcast, leader, {e, 3}}}],
        lists:nthtail(length(Actions) - 2, Actions)
    ).

%% All ballots are here, and nobody waits: a robot that does not take part elects nobody.
does_not_elect_for_nobody_test() ->
    {Actions, Machine} = ballot(3, e, all([hears(1, e), hears(2, e)], started())),
    ?assertEqual([], Actions),
    {Failed, GivenUp} = step({timeout, {patience, e}}, patience, all([calls(e)], started())),
    ?assertMatch([_, _, _], Failed),
    ?assertMatch({[], _}, ballot(3, e, all([hears(2, e)], GivenUp))),
    ?assertEqual({[], Machine}, step({timeout, {patience, e}}, patience, Machine)).

%% An announcement elects, whether the robot takes part or not.
announced_test() ->
    {Actions, _} = leader(2, e, all([calls(e)], started())),
    ?assertEqual(
        [{trace, {elected, e, 2, announcement}}] ++ cancelled(e) ++ [{reply, {app, a}, {ok, 2}}],
        Actions
    ),
    {Unasked, Known} = leader(2, e, started()),
    ?assertEqual([{trace, {elected, e, 2, announcement}}] ++ cancelled(e), Unasked),
    ?assertEqual([{reply, {app, a}, {ok, 2}}], element(1, call(e, a, Known))).

%% Who has no result yet sends its ballot to each other robot, and goes on.
asks_again_test() ->
    {Actions, Machine} = call(e, a, started()),
    [Drawn] = [B || {trace, {ballot, e, B}} <- Actions],
    ?assertEqual(
        {
            [{{timeout, {again, e}}, ?AGAIN_US, again}] ++
                [{cast, sap, {send, To, ballot, {e, Drawn}}} || To <- [2, 3]],
            Machine
        },
        step({timeout, {again, e}}, again, Machine)
    ),
    %% a timer that was under way when the result came, or the patience ended, does nothing
    Over = [
        all([is_led(2, e)], Machine),
        element(2, step({timeout, {patience, e}}, patience, Machine)),
        started()
    ],
    [?assertEqual({[], M}, step({timeout, {again, e}}, again, M)) || M <- Over].

%% Without a result in time the caller is told, once, and may call again.
gives_up_test() ->
    Machine = all([calls(e), hears(2, e)], started()),
    {Actions, GivenUp} = step({timeout, {patience, e}}, patience, Machine),
    ?assertEqual(
        [
            {trace, {failed, e, timeout}},
            {{timeout, {again, e}}, cancel},
            {reply, {app, a}, {error, timeout}}
        ],
        Actions
    ),
    ?assertEqual({[], GivenUp}, step({timeout, {patience, e}}, patience, GivenUp)),
    Elected = all([is_led(3, e)], Machine),
    ?assertEqual({[], Elected}, step({timeout, {patience, e}}, patience, Elected)),
    %% what was heard before counts still
    {Again, _} = ballot(3, e, all([fun(M) -> call(e, b, M) end], GivenUp)),
    ?assertEqual([{reply, {app, b}, {ok, 3}}], [A || {reply, _, _} = A <- Again]).

%% 64 elections are remembered of each robot that has named them, whatever was heard of them, and those that
%% somebody waits for.
remembers_test() ->
    Heard = fun(From, To, M) -> all([is_led(3, N) || N <- lists:seq(From, To)], M) end,
    Leaders = fun(M) ->
        [N || N <- lists:seq(1, 200), element(1, call(N, b, M)) =:= [{reply, {app, b}, {ok, 3}}]]
    end,
    ?assertEqual(lists:seq(1, 64), Leaders(Heard(1, 64, started()))),
    ?assertEqual(lists:seq(2, 65), Leaders(Heard(1, 65, started()))),
    ?assertEqual(lists:seq(37, 100), Leaders(Heard(1, 100, started()))),
    %% two that are waited for stay, beside the latest
    Waiting = Heard(1, 100, all([calls(x), hears(2, x), calls(y)], started())),
    ?assertEqual(lists:seq(37, 100), Leaders(Waiting)),
    ?assertMatch([_, _, _, {reply, {app, a}, {ok, 3}}, _], element(1, ballot(3, x, Waiting))),
    ?assertMatch([_, _, _, {reply, {app, a}, {ok, 2}}], element(1, leader(2, y, Waiting))),
    %% no longer waited for they go with the next ones of the application, not with those of others
    Over = Heard(101, 200, all([is_led(3, x), is_led(3, y)], Waiting)),
    ?assertEqual([{reply, {app, b}, {ok, 3}}], element(1, call(x, b, Over))),
    Own = all(
        lists:append([[calls({own, N}), is_led(3, {own, N})] || N <- lists:seq(1, 64)]), Over
    ),
    ?assertMatch([{trace, {entered, x}} | _], element(1, call(x, b, Own))),
    %% what is forgotten leaves nothing behind
    ?assert(words(Heard(1, 1000, started())) < 2 * words(Heard(1, 64, started()))).

words(Machine) -> erts_debug:flat_size(starl_machine:data(Machine)).
