%% The geocast by flooding, event by event: what a robot says, to whom, and which timers run.
-module(starl_geocast_steps_tests).
-include_lib("eunit/include/eunit.hrl").

-define(ID, {1, 1, 1}).
-define(AREA, {circle, {0.0, 0.0}, 1000.0}).
-define(LIFETIME, 1000000).
-define(HASH, erlang:phash2({?AREA, news, hello})).

%% Robot 2, whose clock does not drift, and which relays at once.
new() -> new(#{}).

new(Config) ->
    Base = #{
        robot => 2,
        participants => [1, 2, 3],
        name => geocast,
        incarnation => maps:get(incarnation, Config, 1),
        now => maps:get(now, Config, 0),
        random => rand:seed_s(exsss, 1)
    },
    starl_machine:new(
        starl_geocast_flood, maps:merge(#{drift_ppm => 0, jitter_ms => 0}, Config), Base
    ).

started() -> started(#{}).

started(Config) -> element(2, new(Config)).

at(Now, Type, Content, Machine) ->
    {Actions, Next} = starl_machine:step(Type, Content, #{now => Now, robot => 2}, Machine),
    {starl_action:without_latest(Actions), Next}.

message(Now, From, Message, Machine) -> at(Now, cast, {message, From, geocast, Message}, Machine).

parcel(Left, Hops) -> {?ID, ?AREA, news, hello, ?LIFETIME, Left, Hops}.

offered(Now, From, Left, Machine) ->
    message(Now, From, {offer, ?ID, ?LIFETIME, Left, 5}, Machine).

given(Now, From, Asked, Left, Machine) -> given(Now, From, Asked, Left, 5, Machine).

given(Now, From, Asked, Left, Hops, Machine) ->
    message(Now, From, {give, parcel(Left, Hops), [{2, {1, Asked}}]}, Machine).

send(Now, Machine) ->
    at(Now, {call, {app, tag}}, {send, ?AREA, news, hello, ?LIFETIME, 5}, Machine).

question(From, Now) -> starl_sap:datagram(2, From, geocast, {ask, ?ID, {1, Now}}).

timer(Name, Us, What) -> {{timeout, {Name, ?ID}}, Us, What}.

cancelled(Name) -> {{timeout, {Name, ?ID}}, cancel}.

%% Robot 2 holds it from 200 on, until 100 + 900000.
holding() -> holding(started()).

holding(Machine) ->
    {_, Asking} = offered(100, 1, 900000, Machine),
    element(2, given(200, 1, 100, 900000, Asking)).

%% -- the start --------------------------------------------------------------------------------

%% A new SAP knows no listeners; another machine's restart is nothing to the geocast.
listens_test() ->
    Listen = starl_sap:listen(geocast, geocast),
    {Actions, Machine} = new(),
    ?assertEqual([Listen], Actions),
    ?assertEqual({[Listen], Machine}, at(0, info, {restarted, sap}, Machine)),
    ?assertEqual({[], Machine}, at(0, info, {restarted, app}, Machine)),
    {Unknown, _} = at(0, cast, what, Machine),
    ?assertEqual([{trace, {unknown_event, cast, what}}], Unknown).

%% -- sending ----------------------------------------------------------------------------------

%% The source answers at once, holds the message for its lifetime and offers it.
send_test() ->
    Id = {2, 1, 1},
    {Actions, Sent} = send(100, started()),
    ?assertEqual(
        [
            {reply, {app, tag}, ok},
            {trace, {sent, Id, ?AREA, ?LIFETIME, ?HASH}},
            {{timeout, {over, Id}}, ?LIFETIME, over},
            {{timeout, {forget, Id}}, ?LIFETIME + 1, forget},
            {{timeout, {offer, Id}}, 0, again}
        ],
        Actions
    ),
    {[Shout, Again], _} = at(100, {timeout, {offer, Id}}, again, Sent),
    ?assertEqual(starl_sap:shout(geocast, {offer, Id, ?LIFETIME, ?LIFETIME, 5}), Shout),
    ?assertEqual({{timeout, {offer, Id}}, 50000, again}, Again),
    {Second, _} = send(200, Sent),
    ?assertEqual([{2, 1, 2}], [I || {trace, {sent, I, _, _, _}} <- Second]).

%% By a clock that drifts: for a little less, and known for a little more.
send_by_a_drifting_clock_test() ->
    {Actions, _} = send(100, started(#{drift_ppm => 10000})),
    ?assertEqual([990000], [Us || {{timeout, {over, _}}, Us, over} <- Actions]),
    ?assertEqual([1010001], [Us || {{timeout, {forget, _}}, Us, forget} <- Actions]).

full_test() ->
    {_, One} = send(100, started(#{limit => 1})),
    {Actions, _} = send(200, One),
    ?assertEqual([{reply, {app, tag}, {error, full}}], Actions),
    {Asked, _} = offered(200, 1, 900000, One),
    ?assertEqual([{trace, {full, ?ID}}], Asked),
    {Given, _} = given(200, 1, 100, 900000, One),
    ?assertEqual([{trace, {full, ?ID}}, cancelled(ask)], Given).

%% Who sends is inside, too: it asks for its place if it listens.
own_message_test() ->
    {Actions, Sent} = send(100, started(#{listeners => #{news => app}})),
    ?assertMatch([_, {{timeout, check}, 250000, check}], lists:nthtail(5, Actions)),
    {Told, _} = at(200, {reply, {where, 1}}, {ok, {0.0, 0.0, 0.0}}, Sent),
    ?assertEqual(
        [{trace, {delivered, {2, 1, 1}, ?HASH}}, {cast, app, {message, 2, news, hello}}], Told
    ).

%% -- asking -----------------------------------------------------------------------------------

%% Four questions, each waited for twice as long as the one before, then no more.
ask_test() ->
    {First, One} = offered(100, 1, 900000, started()),
    ?assertEqual([question(1, 100), timer(ask, 100000, again)], First),
    Ask = fun(Now, M) -> at(Now, {timeout, {ask, ?ID}}, again, M) end,
    {Second, Two} = Ask(200, One),
    ?assertEqual([question(1, 200), timer(ask, 200000, again)], Second),
    {Third, Three} = Ask(300, Two),
    ?assertEqual([question(1, 300), timer(ask, 400000, again)], Third),
    {Fourth, Four} = Ask(400, Three),
    ?assertEqual([question(1, 400), timer(ask, 800000, again)], Fourth),
    {[], Five} = Ask(500, Four),
    {Anew, _} = offered(600, 3, 900000, Five),
    ?assertEqual([question(3, 600), timer(ask, 100000, again)], Anew).

%% Meanwhile it does not ask others; the next question goes to the one that was heard last.
asks_who_was_heard_last_test() ->
    {_, One} = offered(100, 1, 900000, started()),
    {[], Two} = offered(110, 3, 900000, One),
    {Again, Three} = at(200, {timeout, {ask, ?ID}}, again, Two),
    ?assertEqual([question(3, 200), timer(ask, 200000, again)], Again),
    {[], Four} = offered(210, 1, 900000, Three),
    {Third, _} = at(300, {timeout, {ask, ?ID}}, again, Four),
    ?assertEqual([question(1, 300), timer(ask, 400000, again)], Third).

%% What is not worth it is not asked for; a message that is given to others is as good as an offer.
not_worth_it_test() ->
    ?assertEqual({[], started()}, offered(100, 1, 0, started())),
    {[], _} = offered(300, 3, 900000, holding()),
    {Overheard, _} = message(100, 1, {give, parcel(900000, 5), [{3, {1, 50}}]}, started()),
    ?assertEqual([question(1, 100), timer(ask, 100000, again)], Overheard),
    %% so is one for an earlier life of this robot
    {Earlier, _} = message(100, 1, {give, parcel(900000, 5), [{2, {2, 50}}]}, started()),
    ?assertEqual([question(1, 100), timer(ask, 100000, again)], Earlier).

%% Worth it is what lives and travels on; of a message that is held only what has more left by more than
%% an eighth of the lifetime, or more hops.
what_is_asked_for_test() ->
    Asks = fun(Now, Left, Hops, Machine) ->
        {Actions, _} = message(Now, 3, {offer, ?ID, ?LIFETIME, Left, Hops}, Machine),
        Actions =/= []
    end,
    [
        ?assertEqual({Left, Hops, Is}, {Left, Hops, Asks(100, Left, Hops, started())})
     || {Left, Hops, Is} <- [{1, 1, true}, {0, 1, false}, {-1, 1, false}, {1, 0, false}]
    ],
    %% held until 900100, with four hops left
    [
        ?assertEqual({Left, Hops, Is}, {Left, Hops, Asks(100, Left, Hops, holding())})
     || {Left, Hops, Is} <- [
            {900000 + 125000, 5, false},
            {900000 + 125001, 5, true},
            {1, 6, true},
            {0, 6, false}
        ]
    ],
    ?assert(Asks(500100, 400000 + 125001, 5, holding())).

%% -- taking -----------------------------------------------------------------------------------

%% It lives for what was left, from when it was asked for; with one hop less.
take_test() ->
    {_, Asking} = offered(100, 1, 900000, started()),
    {Actions, Held} = given(200, 1, 100, 900000, Asking),
    ?assertEqual(
        [
            cancelled(ask),
            {trace, {held, ?ID, 1}},
            timer(over, 899900, over),
            timer(forget, ?LIFETIME + 1, forget),
            timer(offer, 0, again)
        ],
        Actions
    ),
    {[Shout, _], _} = at(200, {timeout, {offer, ?ID}}, again, Held),
    ?assertEqual(starl_sap:shout(geocast, {offer, ?ID, ?LIFETIME, 899900, 4}), Shout).

%% A relay waits up to the jitter before its first offer, and not always as long.
jitter_test() ->
    Wait = fun(Id, M) ->
        Parcel = setelement(1, parcel(900000, 5), Id),
        {Actions, Next} = message(200, 1, {give, Parcel, [{2, {1, 100}}]}, M),
        [Us] = [U || {{timeout, {offer, I}}, U, again} <- Actions, I =:= Id],
        {Us, Next}
    end,
    {Waits, _} = lists:mapfoldl(
        Wait, started(#{jitter_ms => 1}), [{1, 1, N} || N <- lists:seq(1, 30)]
    ),
    ?assert(lists:all(fun(Us) -> Us > 0 andalso Us =< 1000 end, Waits)),
    ?assert(length(lists:usort(Waits)) > 1).

%% Of several questions the last one counts; no more is left than the whole lifetime.
answers_test() ->
    Twice = [{2, {1, 100}}, {2, {1, 300}}, {2, {1, 200}}],
    {Last, _} = message(400, 1, {give, parcel(900000, 5), Twice}, started()),
    ?assertEqual([899900], [Us || {{timeout, {over, _}}, Us, over} <- Last]),
    {Whole, _} = given(200, 1, 100, 2 * ?LIFETIME, started()),
    ?assertEqual([?LIFETIME - 100], [Us || {{timeout, {over, _}}, Us, over} <- Whole]).

%% What comes when its time is over is not taken, nor what was over once.
too_late_test() ->
    ?assertEqual({[], started()}, given(1000, 1, 100, 900, started())),
    {[_ | _], _} = given(999, 1, 100, 900, started()),
    {_, Over} = at(900100, {timeout, {over, ?ID}}, over, holding()),
    ?assertEqual({[], Over}, given(900100, 3, 900000, 90000, Over)).

%% A longer deadline counts, and is told; what is worse changes nothing.
prolong_test() ->
    {Better, _} = given(400, 3, 300, 990000, holding()),
    ?assertEqual(
        [cancelled(ask), timer(over, 989900, over), {trace, {held, ?ID, 3}}], Better
    ),
    {Worse, _} = given(400, 3, 300, 800000, holding()),
    ?assertEqual([cancelled(ask), timer(over, 899700, over)], Worse),
    {More, Hops} = given(400, 3, 300, 800000, 9, holding()),
    ?assertEqual(Worse, More),
    {[Shout, _], _} = at(400, {timeout, {offer, ?ID}}, again, Hops),
    ?assertEqual(starl_sap:shout(geocast, {offer, ?ID, ?LIFETIME, 899700, 8}), Shout).

%% When it is over its timers go with it, and it is known until it is forgotten.
over_test() ->
    {Actions, Over} = at(900100, {timeout, {over, ?ID}}, over, holding()),
    ?assertEqual([cancelled(offer), cancelled(give), cancelled(ask)], Actions),
    ?assertEqual({[], Over}, offered(900200, 1, 900000, Over)),
    {[], Forgotten} = at(1000201, {timeout, {forget, ?ID}}, forget, Over),
    ?assertMatch({[_, _], _}, offered(1000202, 1, 900000, Forgotten)).

%% What was asked for when it was over is asked for no more.
over_while_asking_test() ->
    {_, Asking} = offered(300, 3, 2000000, holding()),
    {_, Over} = at(900100, {timeout, {over, ?ID}}, over, Asking),
    {[], _} = at(900200, {timeout, {ask, ?ID}}, again, Over).

%% -- offering and giving ----------------------------------------------------------------------

%% Offered after 50 ms, doubled up to a second.
offers_test() ->
    {_, Sent} = send(0, started(#{longest_ms => 150})),
    Waits = fun(_, {Now, M}) ->
        {[_, {_, Us, again}], Next} = at(Now, {timeout, {offer, {2, 1, 1}}}, again, M),
        {Us, {Now + Us, Next}}
    end,
    {Us, {_, Last}} = lists:mapfoldl(Waits, {0, Sent}, lists:seq(1, 4)),
    ?assertEqual([50000, 100000, 150000, 150000], Us),
    ?assertEqual({[], Last}, at(?LIFETIME, {timeout, {offer, {2, 1, 1}}}, again, Last)).

%% The first question is waited with for others; all are answered with one packet.
give_test() ->
    Ask = fun(Now, From, M) -> message(Now, From, {ask, ?ID, {1, Now}}, M) end,
    {First, One} = Ask(300, 3, holding()),
    ?assertEqual([timer(give, 3000, give)], First),
    {[], Two} = Ask(400, 1, One),
    {Give, Three} = at(3300, {timeout, {give, ?ID}}, give, Two),
    Askers = [{3, {1, 300}}, {1, {1, 400}}],
    ?assertEqual([starl_sap:shout(geocast, {give, parcel(896800, 4), Askers})], Give),
    ?assertEqual({[], Three}, at(3400, {timeout, {give, ?ID}}, give, Three)),
    ?assertEqual({[], started()}, Ask(300, 3, started())).

%% More than fifty are given it with several packets.
give_many_test() ->
    Asked = lists:foldl(
        fun(Robot, M) -> element(2, message(300, Robot, {ask, ?ID, {1, 300}}, M)) end,
        holding(),
        lists:seq(1, 51)
    ),
    {[_, More], Left} = at(3300, {timeout, {give, ?ID}}, give, Asked),
    ?assertEqual(timer(give, 0, give), More),
    ?assertMatch({[_], _}, at(3300, {timeout, {give, ?ID}}, give, Left)).

%% Offered and given is what lives; offered is what travels on.
nothing_is_given_after_its_time_test() ->
    Offer = fun(Now, M) -> element(1, at(Now, {timeout, {offer, ?ID}}, again, M)) end,
    Ask = fun(Now, M) -> message(Now, 3, {ask, ?ID, {1, Now}}, M) end,
    ?assertMatch([_, _], Offer(900099, holding())),
    ?assertEqual([], Offer(900100, holding())),
    ?assertMatch({[_], _}, Ask(900099, holding())),
    ?assertEqual({[], holding()}, Ask(900100, holding())),
    {_, Asked} = Ask(900000, holding()),
    Give = fun(Now) -> element(1, at(Now, {timeout, {give, ?ID}}, give, Asked)) end,
    ?assertMatch([_], Give(900099)),
    ?assertEqual([], Give(900100)),
    {_, Last} = given(200, 1, 100, 900000, 1, started()),
    ?assertEqual([], Offer(300, Last)),
    ?assertEqual({[], Last}, Ask(300, Last)),
    ?assertEqual([], Offer(300, started())).

%% -- delivering -------------------------------------------------------------------------------

listening() -> holding(started(#{listeners => #{news => app}})).

where(N) -> starl_location:pose(2, {where, N}).

check_timer() -> {{timeout, check}, 250000, check}.

place(Now, N, X, Machine) -> at(Now, {reply, {where, N}}, {ok, {X, 0.0, 0.0}}, Machine).

%% A robot asks where it is only while a message waits; each question has its number, and one timer runs.
where_am_i_test() ->
    {_, Asking} = offered(100, 1, 900000, started(#{listeners => #{news => app}})),
    {First, One} = given(200, 1, 100, 900000, Asking),
    ?assertEqual([where(1), check_timer()], lists:nthtail(5, First)),
    {Second, Two} = at(300, cast, {listen, other, door}, One),
    ?assertEqual([where(2)], Second),
    {Third, Three} = at(250200, {timeout, check}, check, Two),
    ?assertEqual([where(3), check_timer()], Third),
    {_, Delivered} = place(250300, 3, 0.0, Three),
    {[], None} = at(500200, {timeout, check}, check, Delivered),
    %% the timer is set anew by what comes then
    {Sent, _} = send(600000, None),
    ?assertEqual([where(4), check_timer()], lists:nthtail(5, Sent)).

%% Delivered is what the robot is surely inside of: by the error of its place.
inside_by_the_error_test() ->
    ?assertMatch({[{trace, {delivered, ?ID, _}}, _], _}, place(300, 1, 998.0, listening())),
    ?assertEqual({[], listening()}, place(300, 1, 998.1, listening())).

%% An answer counts for 0.1 s, to the question that was asked last, and only if it is one.
stale_position_test() ->
    ?assertMatch({[_, _], _}, place(100200, 1, 0.0, listening())),
    ?assertEqual({[], listening()}, place(100201, 1, 0.0, listening())),
    ?assertEqual({[], listening()}, place(300, 2, 0.0, listening())),
    ?assertEqual({[], listening()}, at(300, {reply, {where, 1}}, {error, unknown}, listening())),
    {_, Again} = at(300, cast, {listen, other, door}, listening()),
    ?assertEqual({[], Again}, place(400, 1, 0.0, Again)).

%% A delivery leaves while the position is fresh and the message lives.
a_delivery_has_a_latest_moment_test() ->
    Latest = fun(Now, N, Machine) ->
        Answer = {ok, {0.0, 0.0, 0.0}},
        {Actions, _} =
            starl_machine:step({reply, {where, N}}, Answer, #{now => Now, robot => 2}, Machine),
        [{Until, Mark} || {until, Until, [_, _], Mark} <- Actions]
    end,
    ?assertEqual([{100200, {delivered, ?ID}}], Latest(300, 1, listening())),
    {_, Late} = at(850000, {timeout, check}, check, listening()),
    ?assertEqual([{900099, {delivered, ?ID}}], Latest(850000, 2, Late)).

%% What waits is delivered in the order of its ids, however much it is.
delivered_in_order_test() ->
    Ids = [{1, 1, N} || N <- lists:seq(1, 40)],
    Hold = fun(Id, M) ->
        Give = {give, setelement(1, parcel(900000, 5), Id), [{2, {1, 100}}]},
        element(2, message(200, 1, Give, M))
    end,
    Many = lists:foldl(Hold, started(#{listeners => #{news => app}}), lists:reverse(Ids)),
    {Actions, _} = place(300, 40, 0.0, Many),
    ?assertEqual(Ids, [Id || {trace, {delivered, Id, _}} <- Actions]).

%% Who listens later is asked for its place then, and again from time to time.
listen_test() ->
    {Actions, Listening} = at(300, cast, {listen, news, app}, holding()),
    ?assertMatch([_, {{timeout, check}, 250000, check}], Actions),
    {[_, _], Again} = at(250300, {timeout, check}, check, Listening),
    {Told, _} = at(250400, {reply, {where, 2}}, {ok, {0.0, 0.0, 0.0}}, Again),
    ?assertEqual(
        [{trace, {delivered, ?ID, ?HASH}}, {cast, app, {message, 1, news, hello}}], Told
    ),
    ?assertEqual({[], Again}, at(250400, {reply, {where, 1}}, {ok, {0.0, 0.0, 0.0}}, Again)).

%% A machine that has restarted delivers only what was surely sent after its start: it may have
%% delivered what is older.
after_a_restart_test() ->
    Told = fun(Left) ->
        Second = started(#{incarnation => 2, now => 1000, listeners => #{news => app}}),
        Give = {give, parcel(Left, 5), [{2, {2, 101000}}]},
        {Actions, _} = message(101100, 1, Give, Second),
        [timer || {{timeout, check}, _, _} <- Actions]
    end,
    %% at most 99,999 us old when it was asked for, 100,000 us after the start
    ?assertEqual([timer], Told(?LIFETIME - 99999)),
    ?assertEqual([], Told(?LIFETIME - 100000)).

%% The longest lifetime, and any rest and hops of it, are borne.
the_longest_lifetime_needs_no_timer_that_is_too_long_test() ->
    Day = 24 * 3600 * 1000000,
    Most = 16#3FFFFFFFFFFFFFF,
    [
        ?assertMatch({_, _}, message(5, 3, {offer, ?ID, Day, Left, Hops}, started()))
     || Left <- [Day, -Day], Hops <- [1, Most]
    ].

%% -- what is let in ---------------------------------------------------------------------------

accepts_test() ->
    [?assertEqual({B, true}, {B, starl_geocast_flood:accepts(geocast, B)}) || B <- good()],
    [?assertEqual({B, false}, {B, starl_geocast_flood:accepts(geocast, B)}) || B <- bad()],
    ?assertNot(starl_geocast_flood:accepts(other, hd(good()))),
    ?assertEqual(
        [{trace, {malformed, 3, geocast, none}}], element(1, message(5, 3, none, started()))
    ).

good() ->
    [
        {offer, ?ID, ?LIFETIME, 5, 5},
        {offer, ?ID, 24 * 3600 * 1000000, 5, 5},
        {ask, ?ID, {1, 5}},
        {give, parcel(5, 5), []},
        {give, parcel(5, 5), [{2, {1, 5}}]},
        {give, setelement(2, parcel(5, 5), {rectangle, {0.0, 0.0, 1.0, 1.0}}), []},
        {give, setelement(2, parcel(5, 5), {polygon, [{0.0, 0.0}, {1.0, 0.0}, {1.0, 1.0}]}), []}
    ].

bad() ->
    [
        {offer, ?ID, 0, 5, 5},
        %% a lifetime above a day, which no timer could wait for
        {offer, ?ID, 24 * 3600 * 1000000 + 1, 5, 5},
        {offer, ?ID, 16#3FFFFFFFFFFFFFF, 5, 5},
        {offer, ?ID, ?LIFETIME, 24 * 3600 * 1000000 + 1, 5},
        {give, setelement(5, parcel(5, 5), 24 * 3600 * 1000000 + 1), []},
        {give, parcel(-16#3FFFFFFFFFFFFFF, 5), []},
        {offer, {1, 1}, ?LIFETIME, 5, 5},
        {offer, ?ID, ?LIFETIME, 5.0, 5},
        {offer, ?ID, ?LIFETIME, 5, five},
        {offer, ?ID, ?LIFETIME, 5},
        {ask, ?ID, {0, 5}},
        {ask, ?ID, 5},
        {ask, {1, 0, 1}, {1, 5}},
        {give, parcel(5, 5), none},
        {give, parcel(5, 5), [{2, 5}]},
        {give, setelement(2, parcel(5, 5), {circle, {0.0, 0.0}, -1.0}), []},
        {give, setelement(3, parcel(5, 5), "news"), []},
        {give, setelement(5, parcel(5, 5), 0), []},
        {give, setelement(6, parcel(5, 5), much), []},
        {give, setelement(7, parcel(5, 5), many), []},
        {other, ?ID},
        none
    ].

%% -- the usual configuration ------------------------------------------------------------------

defaults_test() ->
    Base = #{
        robot => 2,
        participants => [1, 2, 3],
        name => geocast,
        incarnation => 1,
        now => 0,
        random => rand:seed_s(exsss, 1)
    },
    {_, Usual} = starl_machine:new(starl_geocast_flood, #{}, Base),
    {Actions, _} = send(0, Usual),
    ?assertEqual([990000], [Us || {{timeout, {over, _}}, Us, over} <- Actions]),
    Full = lists:foldl(fun(_, M) -> element(2, send(0, M)) end, Usual, lists:seq(1, 255)),
    {[{reply, _, ok} | _], Last} = send(0, Full),
    ?assertMatch({[{reply, _, {error, full}}], _}, send(0, Last)).

%% All of them: what is not said is as if these were.
all_defaults_test() ->
    Init = fun(Config) ->
        starl_geocast_flood:init(Config#{
            robot => 2,
            participants => [1, 2, 3],
            incarnation => 1,
            now => 0,
            random => rand:seed_s(exsss, 1)
        })
    end,
    Said = #{
        drift_ppm => 10000,
        position_error_mm => 2.0,
        first_ms => 50,
        longest_ms => 1000,
        jitter_ms => 5,
        ask_ms => 100,
        gather_ms => 3,
        check_ms => 250,
        limit => 256,
        listeners => #{}
    },
    ?assertEqual(Init(Said), Init(#{})).

%% A time of asking that is still to come was not said by this robot: such a message is as one that it has not asked for.
a_question_of_the_future_is_none_test() ->
    [
        begin
            Give = {give, parcel(5, 5), [{2, {1, Us}}]},
            ?assertEqual(
                message(5, 3, {offer, ?ID, ?LIFETIME, 5, 5}, started()),
                message(5, 3, Give, started())
            )
        end
     || Us <- [6, 16#3FFFFFFFFFFFFFF]
    ].
