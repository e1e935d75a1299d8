%% What the barrier machine says to the others, asks them and answers, its timers, and what becomes
%% of its callers: event by event.
-module(starl_barrier_words_tests).
-include_lib("eunit/include/eunit.hrl").

-define(US, 5000000).

new(Incarnation, Stored) -> new(Incarnation, Stored, #{}).

new(Incarnation, Stored, Config) ->
    starl_machine:new(starl_barrier_rounds, maps:without([team], Config), #{
        robot => 1,
        participants => starl_team:new(maps:get(team, Config, [1, 2, 3])),
        name => barrier,
        incarnation => Incarnation,
        stored => Stored,
        random => rand:seed_s(exsss, 1),
        now => 0
    }).

start(Incarnation, Stored) -> element(2, new(Incarnation, Stored)).

step(Type, Content, Machine) -> starl_machine:step(Type, Content, #{now => 0, robot => 1}, Machine).

call(Caller, Request, Machine) -> step({call, {Caller, 1}}, Request, Machine).

sync(Name, K, Machine) -> call(app, {sync, Name, {K, K - 1}, ?US}, Machine).

hears(From, Message, Machine) -> step(cast, {message, From, barrier, Message}, Machine).

waiting() -> element(2, sync(gate, 1, start(1, none))).

%% Robot `From' has reached the round, and knows that this one has.
there(From, K, Machine) -> hears(From, {reached, gate, K, K, false}, Machine).

sent(Actions) -> lists:sort([{To, Body} || {cast, sap, {send, To, barrier, Body}} <- Actions]).

timers(Actions) -> lists:sort([{Timer, Us} || {{timeout, Timer}, Us, _} <- Actions]).

cancelled(Actions) -> lists:sort([Timer || {{timeout, Timer}, cancel} <- Actions]).

traces(Actions) -> [Event || {trace, Event} <- Actions].

answers(Actions) -> [{Caller, Answer} || {reply, {Caller, 1}, Answer} <- Actions].

%% The rounds that callers are told.
rounds(Actions) -> [{Caller, Round} || {Caller, {Round, _All}} <- answers(Actions)].

stored(Actions) -> [Term || {store, Term} <- Actions].

listening() -> {cast, sap, {listen, barrier, barrier}}.

%% -- reaching a round -------------------------------------------------------------------------

%% It says once to all that it has reached the round, and asks again later; of a first life nothing
%% was ever told that it could ask for.
announces_test() ->
    {Actions, Machine} = sync(gate, 1, start(1, none)),
    ?assertEqual([{reached, gate, 1}], traces(Actions)),
    ?assertEqual([{complete, #{gate => {1, 0, 0}}}], stored(Actions)),
    Said = {broadcast, barrier, {reached, gate, 1, 0, false}},
    ?assertEqual([{Said, {announced, gate, 1}}], [{S, Tag} || {call, sap, S, Tag} <- Actions]),
    ?assertEqual([{{again, gate}, 3000000}, {{patience, gate}, ?US}], timers(Actions)),
    ?assertEqual([], sent(Actions)),
    ?assertEqual([], answers(Actions)),
    {Other, _} = sync(other, 1, Machine),
    ?assertEqual([{complete, #{gate => {1, 0, 0}, other => {1, 0, 0}}}], stored(Other)).

%% After a crash those of which it knows nothing are asked at once.
asks_what_is_forgotten_test() ->
    Again = start(2, {stored, {complete, #{gate => {1, 1, 1}}}}),
    {All, _} = sync(gate, 2, Again),
    ?assertEqual([{R, {reached, gate, 2, 0, true}} || R <- [2, 3]], sent(All)),
    {_, Heard} = hears(2, {reached, gate, 1, 1, false}, Again),
    {One, _} = sync(gate, 2, Heard),
    ?assertEqual([{3, {reached, gate, 2, 0, true}}], sent(One)).

%% Those that it misses are asked again and again, and told what it has heard of them; one that is
%% not missed is left alone.
asks_again_test() ->
    {_, Knows} = hears(2, {reached, gate, 1, 0, false}, waiting()),
    {_, Misses} = there(3, 1, Knows),
    {Actions, _} = step({timeout, {again, gate}}, again, Misses),
    ?assertEqual([{2, {reached, gate, 1, 1, true}}], sent(Actions)),
    ?assertEqual([{{again, gate}, 3000000}], timers(Actions)),
    {Often, Machine} = new(1, none, #{retry_ms => 7}),
    ?assertEqual([listening()], Often),
    {Reached, Waits} = sync(gate, 1, Machine),
    ?assertEqual([{{again, gate}, 7000}, {{patience, gate}, ?US}], timers(Reached)),
    ?assertEqual([{{again, gate}, 7000}], timers(again(Waits))),
    %% nobody waits for it
    ?assertEqual([], again(start(1, none))).

again(Machine) -> element(1, step({timeout, {again, gate}}, again, Machine)).

%% -- a later life -----------------------------------------------------------------------------

later(Stored) -> new(1 bsl 57, Stored, #{life => {4, 1 bsl 57}}).

who() -> {who, 1 bsl 57}.

%% Robot `From' has reached round `K', knows that this one has reached `Known', and that all have
%% reached `All'.
tells(From, K, Known, All, Machine) ->
    hears(From, {told, 1 bsl 57, true, [{gate, K, Known, All}]}, Machine).

turn(Machine) -> call(app, {round, gate}, Machine).

%% The robot may have lived since its store was written: all others confirm its counts before the
%% application learns its round. What they do not know any more contradicts nothing.
%% Holds: An old store gives nothing away again: rounds
%% Red: e32dfbb, run; live: 305a414, run
a_later_life_is_confirmed_by_all_test() ->
    {Actions, Machine} = later({stored, {complete, #{gate => {3, 2, 2}}}}),
    ?assertEqual([{2, who()}, {3, who()}], sent(Actions)),
    {Waits, Asking} = turn(Machine),
    ?assertEqual([], answers(Waits)),
    {[], One} = tells(2, 3, 3, 2, Asking),
    {Confirmed, Settled} = tells(3, 0, 0, 0, One),
    ?assertEqual([{app, 3}], rounds(Confirmed)),
    ?assertEqual([], traces(Confirmed)),
    ?assertEqual([], traces(element(1, sync(gate, 3, Settled)))).

%% One that knows a later round has heard it from this robot: its store is an old one. If that one
%% has reached the round, too, it counts as passed.
a_later_round_outdates_the_store_test() ->
    {_, Machine} = later({stored, {complete, #{gate => {3, 2, 2}}}}),
    {_, Asking} = turn(Machine),
    {[], One} = tells(2, 5, 5, 4, Asking),
    {Found, Settled} = tells(3, 5, 3, 2, One),
    ?assertEqual([store_damaged], traces(Found)),
    ?assertEqual([{app, 6}], rounds(Found)),
    ?assertMatch([{complete, #{gate := {6, 5, _}}}], stored(element(1, sync(gate, 6, Settled)))).

%% A name that the store does not know of, too.
a_name_outdates_the_store_test() ->
    {_, Machine} = later({stored, {complete, #{}}}),
    {_, Asking} = turn(Machine),
    {[], One} = tells(2, 2, 2, 1, Asking),
    {Found, _} = tells(3, 2, 2, 1, One),
    ?assertEqual([{app, 3}], rounds(Found)).

%% What is stored before the others have answered keeps the counts that are not confirmed yet.
nothing_is_dropped_while_unconfirmed_test() ->
    {_, Machine} = later({stored, {complete, #{gate => {3, 2, 2}, other => {7, 7, 7}}}}),
    {Reached, _} = sync(gate, 3, Machine),
    ?assertEqual([], stored(Reached)),
    {Next, _} = sync(gate, 4, Machine),
    ?assertMatch([{complete, #{gate := {4, 3, _}, other := {7, 7, 7}}}], stored(Next)).

%% -- announcements ----------------------------------------------------------------------------

%% The outcome of the announcement says who knows; the others are asked.
announced_test() ->
    [
        begin
            {[], Told} = step({reply, {announced, gate, 1}}, Outcome, waiting()),
            {[], Both} = hears(2, {reached, gate, 1, 0, false}, Told),
            {Last, Machine} = hears(3, {reached, gate, 1, 0, false}, Both),
            ?assertEqual({Outcome, Asked =:= []}, {Outcome, traces(Last) =:= [{passed, gate, 1}]}),
            ?assertEqual({Outcome, Asked}, {Outcome, [To || {To, _} <- sent(again(Machine))]})
        end
     || {Outcome, Asked} <- [
            {ok, []},
            {{error, {lost, [3]}}, [3]},
            {{error, {lost, [2, 3]}}, [2, 3]},
            {{error, overload}, [2, 3]}
        ]
    ].

%% The outcome of an earlier round's announcement says nothing of this one, and what passes last
%% may be the outcome itself.
announced_last_test() ->
    {_, One} = hears(2, {reached, gate, 1, 0, false}, waiting()),
    {_, Both} = hears(3, {reached, gate, 1, 0, false}, One),
    ?assertMatch({[], _}, step({reply, {announced, gate, 0}}, ok, Both)),
    ?assertMatch({[], _}, step({reply, {announced, other, 1}}, ok, Both)),
    {Passed, _} = step({reply, {announced, gate, 1}}, ok, Both),
    ?assertEqual([{app, ok}], answers(Passed)).

%% It passes once: no timer is left, and the next word changes nothing.
passes_once_test() ->
    {[], One} = there(2, 1, waiting()),
    {Passed, Machine} = there(3, 1, One),
    ?assertEqual([{complete, #{gate => {1, 1, 1}}}], stored(Passed)),
    ?assertEqual([{passed, gate, 1}], traces(Passed)),
    ?assertEqual([{app, ok}], answers(Passed)),
    ?assertEqual([{again, gate}, {patience, gate}], cancelled(Passed)),
    ?assertEqual([], element(1, there(3, 1, Machine))),
    ?assertEqual([], again(Machine)),
    ?assertEqual([], element(1, step({timeout, {patience, gate}}, patience, Machine))),
    ?assertEqual([{app, {2, 1}}], answers(element(1, call(app, {round, gate}, Machine)))).

%% -- patience ---------------------------------------------------------------------------------

%% A call that failed may be made again: the robot has still reached the round, stores and announces
%% nothing anew, and asks at once those that it misses.
gives_up_test() ->
    {Failed, Machine} = step({timeout, {patience, gate}}, patience, waiting()),
    ?assertEqual([{failed, gate, 1, timeout}], traces(Failed)),
    ?assertEqual([{app, {error, timeout}}], answers(Failed)),
    ?assertEqual([{again, gate}, {patience, gate}], cancelled(Failed)),
    {[], Deaf} = there(2, 1, Machine),
    {[], All} = there(3, 1, Deaf),
    ?assertEqual([], again(All)),
    {Again, _} = sync(gate, 1, Deaf),
    ?assertEqual([{3, {reached, gate, 1, 0, true}}], sent(Again)),
    ?assertEqual([{{again, gate}, 3000000}, {{patience, gate}, ?US}], timers(Again)),
    ?assertEqual({[], []}, {stored(Again), traces(Again)}),
    %% meanwhile all have reached it
    {Passed, _} = sync(gate, 1, All),
    ?assertEqual([{passed, gate, 1}], traces(Passed)),
    ?assertEqual([{app, ok}], answers(Passed)).

%% A machine that has crashed waits for nothing; the others that wait go on, and so do those that
%% wait for another name.
caller_gone_test() ->
    {_, Two} = call(other, {sync, next, {1, 0}, ?US}, waiting()),
    {_, Three} = sync(last, 1, Two),
    {Actions, Machine} = step(info, {restarted, app}, Three),
    Failed = [{failed, Name, 1, restarted} || Name <- [gate, last]],
    ?assertEqual(Failed, lists:sort(traces(Actions))),
    ?assertEqual([{app, {error, restarted}}, {app, {error, restarted}}], answers(Actions)),
    ?assertEqual(
        lists:sort([{T, Name} || T <- [again, patience], Name <- [gate, last]]), cancelled(Actions)
    ),
    ?assertEqual({[], Machine}, step(info, {restarted, app}, Machine)),
    {Late, _} = step(info, {given_up, other}, Machine),
    ?assertEqual([{failed, next, 1, restarted}], traces(Late)).

%% -- what the others ask ----------------------------------------------------------------------

%% Who asks is told how far this robot is, and how far it has heard of the asker; who does not is
%% not answered, or two robots would answer each other for ever.
reports_test() ->
    {Actions, Machine} = hears(2, {reached, gate, 1, 0, true}, waiting()),
    ?assertEqual([{2, {reached, gate, 1, 1, false}}], sent(Actions)),
    ?assertEqual([], element(1, hears(2, {reached, gate, 1, 0, false}, Machine))),
    {Far, _} = hears(3, {reached, gate, 4, 0, true}, start(1, none)),
    ?assertEqual([{3, {reached, gate, 0, 4, false}}], sent(Far)),
    %% also by the word that makes it pass
    {Passed, _} = hears(3, {reached, gate, 1, 1, true}, element(2, there(2, 1, waiting()))),
    ?assertEqual([{3, {reached, gate, 1, 1, false}}], sent(Passed)),
    ?assertEqual([{app, ok}], answers(Passed)).

%% One whose store is damaged is told all: of each name the own count, its count, and what has
%% surely been passed; and whether this robot knows its own counts.
tells_test() ->
    Machine = start(2, {stored, {complete, #{b => {3, 2, 2}, a => {1, 1, 1}}}}),
    {_, Heard} = hears(2, {reached, b, 4, 0, false}, Machine),
    Told = fun(From, M) -> sent(element(1, hears(From, {who, 7}, M))) end,
    ?assertEqual([{2, {told, 7, true, [{a, 1, 0, 1}, {b, 3, 4, 2}]}}], Told(2, Heard)),
    ?assertEqual([{3, {told, 7, true, [{a, 1, 0, 1}, {b, 3, 0, 2}]}}], Told(3, Heard)),
    ?assertEqual([{2, {told, 7, false, []}}], Told(2, start(2, damaged))).

%% -- a damaged store --------------------------------------------------------------------------

%% All others are asked, again and again until they have told; a robot that is alone has nobody to
%% ask and begins anew.
asks_all_test() ->
    {Actions, Machine} = new(2, damaged),
    ?assert(lists:member(listening(), Actions)),
    ?assertEqual([{2, {who, 2}}, {3, {who, 2}}], sent(Actions)),
    ?assertEqual([{untold, 3000000}], timers(Actions)),
    {_, One} = hears(2, {told, 2, true, []}, Machine),
    {Again, _} = step({timeout, untold}, again, One),
    ?assertEqual([{3, {who, 2}}], sent(Again)),
    ?assertEqual([{untold, 3000000}], timers(Again)),
    {_, Both} = hears(3, {told, 2, true, []}, One),
    ?assertEqual([], element(1, step({timeout, untold}, again, Both))),
    {[_], Alone} = new(2, damaged, #{team => [1]}),
    ?assertEqual([{app, {1, 0}}], answers(element(1, call(app, {round, gate}, Alone)))).

%% An answer to an earlier life's question is none, as this life's crash may be after it.
told_earlier_test() ->
    Machine = start(3, damaged),
    ?assertEqual({[], Machine}, hears(2, {told, 2, true, [{gate, 5, 5, 5}]}, Machine)).

%% What one has told for sure is no longer sure once it has told otherwise; it is asked once more
%% if it answers twice, and nothing is told twice.
told_twice_test() ->
    Next = fun(Words) ->
        {_, Asked} = call(app, {round, gate}, start(2, damaged)),
        {Last, _} = lists:foldl(
            fun({From, Sure, At}, {_, M}) ->
                hears(From, {told, 2, Sure, [{gate, At, 4, 1}]}, M)
            end,
            {[], Asked},
            Words
        ),
        rounds(Last)
    end,
    ?assertEqual([{app, 4}], Next([{2, true, 3}, {3, true, 4}])),
    ?assertEqual([{app, 5}], Next([{2, true, 3}, {2, false, 3}, {3, true, 4}])),
    ?assertEqual([{app, 4}], Next([{2, false, 3}, {2, true, 3}, {3, true, 4}])),
    ?assertEqual([], Next([{2, true, 4}, {3, true, 4}, {3, true, 4}])),
    ?assertEqual([], Next([{2, true, 4}, {2, true, 4}])).

%% All that ask for a round before it is known are answered when it is, once each; those that have
%% crashed meanwhile are not.
asked_meanwhile_test() ->
    Ask = fun(Caller, Name, M) ->
        {[], Asked} = call(Caller, {round, Name}, M),
        Asked
    end,
    Asked = Ask(other, gate, Ask(app, side, Ask(app, gate, start(2, damaged)))),
    {[], One} = hears(2, {told, 2, true, [{gate, 2, 2, 1}]}, Asked),
    Tell = fun(M) -> rounds(element(1, hears(3, {told, 2, true, [{gate, 2, 2, 1}]}, M))) end,
    ?assertEqual([{app, 1}, {app, 3}, {other, 3}], lists:sort(Tell(One))),
    ?assertEqual([{other, 3}], Tell(element(2, step(info, {restarted, app}, One)))),
    ?assertEqual(
        [{app, 1}, {app, 3}], lists:sort(Tell(element(2, step(info, {given_up, other}, One))))
    ).

%% Many that ask are answered in the order of the names that they ask for.
answers_in_order_test() ->
    Names = lists:seq(1, 40),
    Asked = lists:foldl(
        fun(Name, M) -> element(2, step({call, {app, Name}}, {round, Name}, M)) end,
        start(2, damaged),
        Names
    ),
    {_, One} = hears(2, {told, 2, true, []}, Asked),
    {Actions, _} = hears(3, {told, 2, true, []}, One),
    ?assertEqual([{Name, 1} || Name <- Names], [{N, K} || {reply, {app, N}, {K, 0}} <- Actions]).

%% Where only some have told, what is stored says so: the next life asks again.
partial_test() ->
    {_, Resumed} = call(app, {resume, gate, {4, 3}}, start(2, damaged)),
    {Reached, _} = sync(gate, 4, Resumed),
    ?assertEqual([{partial, #{gate => {4, 3, 3}}}], stored(Reached)),
    {Asks, Partial} = new(3, {stored, {partial, #{gate => {4, 3, 3}}}}),
    ?assertEqual([{2, {who, 3}}, {3, {who, 3}}], sent(Asks)),
    ?assertEqual([{app, {4, 3}}], answers(element(1, call(app, {round, gate}, Partial)))),
    {_, One} = hears(2, {told, 3, true, []}, Partial),
    {_, Both} = hears(3, {told, 3, true, []}, One),
    ?assertEqual(
        [{complete, #{gate => {4, 3, 3}, new => {1, 0, 0}}}], stored(element(1, sync(new, 1, Both)))
    ).

%% -- everything else --------------------------------------------------------------------------

%% A new SAP knows no listeners; of other machines' restarts nothing follows.
others_restart_test() ->
    Machine = waiting(),
    ?assertEqual({[listening()], Machine}, step(info, {restarted, sap}, Machine)),
    ?assertEqual({[], Machine}, step(info, {restarted, other}, Machine)),
    ?assertMatch({[{trace, {unknown_event, cast, what}}], _}, step(cast, what, Machine)),
    ?assertMatch({[{trace, {unknown_event, info, _}}], _}, step(info, {born, app}, Machine)).

%% What no barrier says is not taken, at the edge of each count.
malformed_test() ->
    Machine = waiting(),
    [
        ?assertEqual({[{trace, {malformed, 2, barrier, Body}}], Machine}, hears(2, Body, Machine))
     || Body <- [
            what,
            {},
            {reached, gate, -1, 0, false},
            {reached, gate, 0, -1, false},
            {reached, gate, 1, 1, yes},
            {reached, gate, 1, 1},
            {who, 0},
            {who, me},
            {told, 0, true, []},
            {told, 1, yes, []},
            {told, 1, true, all},
            {told, 1, true, [{gate, 1, 1}]},
            {told, 1, true, [{gate, -1, 0, 0}]},
            {told, 1, true, [{gate, 0, -1, 0}]},
            {told, 1, true, [{gate, 0, 0, -1}]}
        ]
    ],
    [
        ?assertEqual([], [T || {malformed, T, _, _} <- traces(element(1, hears(2, B, Machine)))])
     || B <- [
            {reached, gate, 0, 0, false},
            {who, 1},
            {told, 1, false, [{gate, 0, 0, 0}]},
            {told, 9, true, []}
        ]
    ].
