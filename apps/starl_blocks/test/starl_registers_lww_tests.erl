%% The registers, event by event: what a robot answers, stores, traces and sends.
-module(starl_registers_lww_tests).
-include_lib("eunit/include/eunit.hrl").

-define(NOW, 1000).

new(Incarnation, Config) -> new(1, Incarnation, Config).

new(Seed, Incarnation, Config) ->
    starl_machine:new(starl_registers_lww, Config, #{
        robot => 1,
        participants => [1, 2, 3, 4, 5],
        name => registers,
        incarnation => Incarnation,
        random => rand:seed_s(exsss, Seed),
        now => ?NOW
    }).

started() -> started(#{}).

started(Config) -> element(2, new(1, Config)).

step(Type, Content, Machine) -> at(?NOW, Type, Content, Machine).

at(Now, Type, Content, Machine) ->
    starl_machine:step(Type, Content, #{now => Now, robot => 1}, Machine).

call(Request, Machine) -> step({call, {app, x}}, Request, Machine).

hears(From, Body, Machine) -> step(cast, {message, From, registers, Body}, Machine).

after_all(Steps, Machine) -> lists:foldl(fun(Step, M) -> element(2, Step(M)) end, Machine, Steps).

put_(Name, Value) -> fun(M) -> call({put, Name, Value}, M) end.

write(From, Name, Value, Time) ->
    fun(M) -> hears(From, {write, Name, Value, {Time, 0, From}}, M) end.

sent(Actions) -> [{To, Body} || {cast, sap, {send, To, registers, Body}} <- Actions].

traced(Actions) -> [Event || {trace, Event} <- Actions].

answers(Actions) -> [Answer || {reply, {app, x}, Answer} <- Actions].

read(Name, Machine) -> hd(answers(element(1, call({get, Name}, Machine)))).

listening() -> {cast, sap, {listen, registers, registers}}.

ticks(Actions) -> [Us || {{timeout, sync}, Us, sync} <- Actions].

%% -- the start --------------------------------------------------------------------------------

%% The first start knows that there is nothing; the time to the next exchange is drawn, between a
%% half and one and a half of its mean.
first_start_test() ->
    {Actions, Machine} = new(1, #{sync_ms => 4}),
    ?assertMatch([_, {{timeout, sync}, _, sync}], Actions),
    ?assertEqual(listening(), hd(Actions)),
    ?assertEqual({error, unset}, read(x, Machine)),
    {_, Drawn} = lists:foldl(
        fun(_, {M, All}) ->
            {Next, After} = step({timeout, sync}, sync, M),
            {After, ticks(Next) ++ All}
        end,
        {Machine, []},
        lists:seq(1, 2000)
    ),
    ?assertEqual(2000, length(Drawn)),
    ?assert(lists:min(Drawn) > 2000 andalso lists:max(Drawn) =< 6000),
    ?assert(lists:min(Drawn) < 2100 andalso lists:max(Drawn) > 5900),
    ?assert(lists:max(ticks(element(1, new(1, #{})))) > 500000).

%% A restarted machine asks three different others, and answers nobody before one has told.
restart_test() ->
    {Actions, Machine} = new(2, #{recover_ms => 7}),
    ?assertMatch([_, {{timeout, sync}, _, sync}, {{timeout, recover}, 7000, recover} | _], Actions),
    ?assertEqual(listening(), hd(Actions)),
    Asked = sent(Actions),
    ?assertMatch([{_, {digest, []}}, {_, {digest, []}}, {_, {digest, []}}], Asked),
    ?assertEqual(3, length(lists:usort([To || {To, _} <- Asked]))),
    ?assertNot(lists:keymember(1, 1, Asked)),
    {None, Waiting} = call({get, x}, Machine),
    ?assertEqual([], None),
    {_, Both} = step({call, {app, y}}, {put, y, 1}, Waiting),
    %% other messages end no recovery
    {Written, Still} = hears(2, {write, x, a, {5, 0, 2}}, Both),
    ?assertEqual([], [A || {reply, _, _} = A <- Written]),
    {Told, Ready} = hears(3, {entries, [{x, b, {6, 0, 3}}]}, Still),
    ?assertEqual([{app, x}, {app, y}], [To || {reply, To, _} <- Told]),
    ?assertEqual([{ok, b}], answers(Told)),
    ?assert(lists:member({{timeout, recover}, cancel}, Told)),
    ?assertEqual({ok, b}, read(x, Ready)),
    %% those who waited are answered once
    {Again, _} = hears(2, {entries, []}, Ready),
    ?assertEqual([], [A || {reply, _, _} = A <- Again]).

%% Nobody tells: it answers all the same in the end; a team of one asks nobody.
recover_alone_test() ->
    {_, Waiting} = call({get, x}, element(2, new(2, #{}))),
    {Told, Ready} = step({timeout, recover}, recover, Waiting),
    ?assertEqual([{error, unset}], answers(Told)),
    ?assertEqual({error, unset}, read(x, Ready)),
    {Actions, Alone} = starl_machine:new(starl_registers_lww, #{}, #{
        robot => 1,
        participants => [1],
        name => registers,
        incarnation => 2,
        random => rand:seed_s(exsss, 1),
        now => ?NOW
    }),
    ?assertMatch([_, {{timeout, sync}, _, sync}], Actions),
    ?assertEqual({error, unset}, read(x, Alone)),
    ?assertEqual({[], Alone}, step({timeout, sync}, sync, Alone)).

%% With a damaged store its stamps are later than all that the life before may have given.
stamps_after_restart_test() ->
    {_, Machine} = step(
        {timeout, recover}, recover, element(2, new(2, #{ahead_ms => 3, stored => damaged}))
    ),
    {Actions, _} = call({put, x, 1}, Machine),
    ?assertMatch([{put, x, _, {Time, _, 1}} | _] when Time > ?NOW + 3000, traced(Actions)).

others_restart_test() ->
    Machine = started(),
    ?assertEqual({[listening()], Machine}, step(info, {restarted, sap}, Machine)),
    ?assertEqual({[], Machine}, step(info, {restarted, app}, Machine)),
    ?assertMatch({[{trace, {unknown_event, cast, what}}], _}, step(cast, what, Machine)),
    ?assertEqual({[{trace, {malformed, 2, registers, what}}], Machine}, hears(2, what, Machine)).

%% -- reads and writes -------------------------------------------------------------------------

write_test() ->
    {Actions, Machine} = call({put, x, a}, started()),
    Stamp = {?NOW, 0, 1},
    ?assertEqual(
        [
            {store, ?NOW + 1000000},
            {trace, {put, x, erlang:phash2(a), Stamp}},
            {trace, {holds, x, Stamp}},
            {cast, sap, {broadcast, registers, {write, x, a, Stamp}}},
            {reply, {app, x}, ok}
        ],
        Actions
    ),
    {Read, _} = call({get, x}, Machine),
    ?assertEqual([{trace, {got, x, erlang:phash2(a), Stamp}}, {reply, {app, x}, {ok, a}}], Read),
    ?assertEqual(
        [{trace, {got, y, unset}}, {reply, {app, x}, {error, unset}}],
        element(1, call({get, y}, Machine))
    ).

%% An owner alone writes, here and from elsewhere; there is room for so many registers.
refused_test() ->
    Machine = after_all([put_(a, 1)], started(#{owners => #{mine => 2, own => 1}, limit => 3})),
    ?assertEqual([{error, not_owner}], answers(element(1, call({put, mine, 1}, Machine)))),
    ?assertEqual([ok], answers(element(1, call({put, own, 1}, Machine)))),
    {Foreign, Same} = (write(3, mine, 1, 5))(Machine),
    ?assertEqual({[{trace, {refused, mine, 3, not_owner}}], Machine}, {Foreign, Same}),
    ?assertMatch([{holds, mine, _}], traced(element(1, (write(2, mine, 1, 5))(Machine)))),
    Full = after_all([put_(b, 1), put_(c, 1)], Machine),
    ?assertEqual([{error, full}], answers(element(1, call({put, d, 1}, Full)))),
    %% what another one has added is taken all the same
    ?assertMatch([{holds, d, _}], traced(element(1, (write(2, d, 1, 5))(Full)))),
    %% what is there already may be written
    ?assertEqual([ok], answers(element(1, call({put, c, 2}, Full)))).

%% What is later is taken, what is not is not; the own clock is beyond both afterwards.
later_wins_test() ->
    {Taken, Machine} = (write(2, x, b, 7000))(after_all([put_(x, a)], started())),
    ?assertEqual([{trace, {holds, x, {7000, 0, 2}}}], Taken),
    ?assertEqual({[], {ok, b}}, begin
        {Older, Next} = (write(3, x, c, 6999))(Machine),
        {Older, read(x, Next)}
    end),
    %% the very same again is no news
    ?assertMatch({[], _}, (write(2, x, b, 7000))(Machine)),
    {Actions, _} = call({put, x, d}, Machine),
    ?assertMatch([{put, x, _, {7000, 1, 1}} | _], traced(Actions)).

%% A stamp too far ahead is told and left for later; at the edge it is taken.
ahead_test() ->
    Machine = started(#{ahead_ms => 2}),
    Late = {?NOW + 2001, 0, 2},
    ?assertEqual(
        {[{trace, {too_far_ahead, x, Late}}], Machine},
        (write(2, x, b, ?NOW + 2001))(Machine)
    ),
    ?assertEqual(
        [{holds, x, {?NOW + 2000, 0, 2}}],
        traced(element(1, (write(2, x, b, ?NOW + 2000))(Machine)))
    ),
    {Taken, _} = at(?NOW + 1, cast, {message, 2, registers, {write, x, b, Late}}, Machine),
    ?assertEqual([{holds, x, Late}], traced(Taken)),
    Default = started(),
    ?assertMatch([{holds, _, _}], traced(element(1, (write(2, x, b, ?NOW + 10000000))(Default)))),
    ?assertMatch(
        [{too_far_ahead, _, _}],
        traced(element(1, (write(2, x, b, ?NOW + 10000001))(Default)))
    ).

%% Who sends a stamp that no clocks within their bound explain hears that it is refused; one that is only
%% deferred is taken later.
beyond_test() ->
    Machine = started(#{ahead_ms => 1}),
    Sent = fun(Body) -> sent(element(1, hears(3, Body, Machine))) end,
    Deferred = {?NOW + 2001, 0, 2},
    Beyond = {?NOW + 2002, 0, 2},
    ?assertEqual([], Sent({write, x, v, Deferred})),
    ?assertEqual([{3, {beyond, Beyond}}], Sent({write, x, v, Beyond})),
    ?assertEqual([{3, {beyond, Beyond}}], Sent({entries, [{y, v, Deferred}, {x, v, Beyond}]})),
    ?assert(starl_registers_lww:accepts(registers, {beyond, Beyond})),
    ?assertNot(starl_registers_lww:accepts(registers, {beyond, late})).

%% A robot that most of the others refuse writes nothing, until its clock agrees with theirs: then its stamps go
%% back to that clock, with its own values; those of others whose clocks were wrong are forgotten.
denied_test() ->
    Ahead = 3600000000,
    Put = fun(Now, M) -> at(Now, {call, {app, x}}, {put, x, v}, M) end,
    Deny = fun(Now, From, Stamp, M) ->
        at(Now, cast, {message, From, registers, {beyond, Stamp}}, M)
    end,
    {_, Wrong} = at(Ahead, cast, {message, 2, registers, {write, y, w, {Ahead, 0, 2}}}, started()),
    {_, Right} = hears(2, {write, z, w, {?NOW, 0, 2}}, Wrong),
    {Wrote, M0} = Put(Ahead, Right),
    [{put, x, _, Stamp} | _] = traced(Wrote),
    %% two of four others are no majority, and a stamp that this robot has not given counts for nothing
    {[{trace, {denied, 2}}], M1} = Deny(Ahead, 2, Stamp, M0),
    {[{trace, {denied, 3}}], M2} = Deny(Ahead, 3, Stamp, M1),
    {[], M2} = Deny(Ahead, 4, {Ahead + 1, 1, 1}, M2),
    ?assertEqual([ok], answers(element(1, Put(Ahead, M2)))),
    {[{trace, {denied, 4}}], M3} = Deny(Ahead, 4, Stamp, M2),
    ?assertMatch({[{reply, _, {error, refused}}], _}, Put(Ahead, M3)),
    %% its clock is right, and another one still refuses: from now on it writes, and all others read
    {Righted, M4} = Deny(2 * ?NOW, 5, Stamp, M3),
    ?assertMatch(
        [{denied, 5}, {set_right, 2000}, {put, x, _, {2000, 0, 1}}, {holds, x, _}],
        traced(Righted)
    ),
    ?assertMatch([_], [T || {store, T} <- Righted, T < Ahead]),
    ?assertEqual([{ok, v}, {error, unset}, {ok, w}], [read(Name, M4) || Name <- [x, y, z]]),
    ?assertEqual([ok], answers(element(1, Put(2 * ?NOW, M4)))).

%% A clock that is behind is not right: nobody refuses its robot, and its stamps go on growing.
a_clock_that_is_set_back_goes_on_test() ->
    Ahead = 3600000000,
    {_, M} = at(Ahead, {call, {app, x}}, {put, x, v}, started()),
    {Actions, _} = at(?NOW, {call, {app, x}}, {put, x, w}, M),
    ?assertMatch([{put, x, _, {Ahead, 1, 1}} | _], traced(Actions)).

%% A subscriber is told what there is, and each change, with its writer.
subscribe_test() ->
    Told = fun(Writer, Value) ->
        [{cast, app, {message, Writer, register, {x, Value}}}]
    end,
    {None, Early} = step(cast, {subscribe, x, app}, started()),
    ?assertEqual([], None),
    {Written, Machine} = (write(2, x, b, 5))(Early),
    ?assertEqual([{trace, {holds, x, {5, 0, 2}}}] ++ Told(2, b), Written),
    ?assertEqual(Told(2, b), element(1, step(cast, {subscribe, x, app}, Machine))),
    ?assertEqual([{trace, {holds, y, {5, 0, 2}}}], element(1, (write(2, y, b, 5))(Machine))),
    {Own, _} = call({put, x, c}, Machine),
    ?assertEqual(Told(1, c), [A || {cast, app, _} = A <- Own]).

%% -- the exchange -----------------------------------------------------------------------------

entry(Name, Value, Time, Writer) -> {Name, Value, {Time, 0, Writer}}.

stamp(Name, Time, Writer) -> {Name, {Time, 0, Writer}}.

two() -> after_all([write(2, a, 1, 5), write(3, b, 2, 6)], started()).

%% Once in a while one of the others is told a hash of what is here; each has its turn.
sync_test() ->
    {Actions, _} = step({timeout, sync}, sync, two()),
    Hash = erlang:phash2([stamp(a, 5, 2), stamp(b, 6, 3)]),
    ?assertMatch([{_, {sync, Hash}}], sent(Actions)),
    ?assertMatch([_], ticks(Actions)),
    {_, Asked} = lists:foldl(
        fun(_, {M, All}) ->
            {Next, After} = step({timeout, sync}, sync, M),
            {After, [To || {To, _} <- sent(Next)] ++ All}
        end,
        {two(), []},
        lists:seq(1, 100)
    ),
    ?assertEqual([2, 3, 4, 5], lists:usort(Asked)).

%% Equal: nothing to do; else the stamps of what is here.
answer_to_sync_test() ->
    Own = [stamp(a, 5, 2), stamp(b, 6, 3)],
    ?assertEqual([], element(1, hears(2, {sync, erlang:phash2(Own)}, two()))),
    ?assertEqual([{2, {digest, Own}}], sent(element(1, hears(2, {sync, 0}, two())))).

%% What is later here is told, what is later there is asked for, and nothing else.
answer_to_digest_test() ->
    Answer = fun(Theirs) -> sent(element(1, hears(2, {digest, Theirs}, two()))) end,
    [A, B] = [entry(a, 1, 5, 2), entry(b, 2, 6, 3)],
    ?assertEqual([], Answer([stamp(a, 5, 2), stamp(b, 6, 3)])),
    ?assertEqual([{2, {entries, [A]}}], Answer([stamp(a, 4, 2), stamp(b, 6, 3)])),
    ?assertEqual([{2, {entries, [B]}}], Answer([stamp(a, 5, 2)])),
    ?assertEqual(
        [{2, {want, [a, c]}}],
        Answer([stamp(a, 7, 2), stamp(b, 6, 3), stamp(c, 1, 1)])
    ),
    ?assertEqual(
        [{2, {entries, [B]}}, {2, {want, [a]}}],
        Answer([stamp(a, 7, 2), stamp(b, 5, 3)])
    ),
    %% who knows nothing is answered, be it with nothing
    ?assertEqual([{2, {entries, [A, B]}}], Answer([])),
    ?assertEqual([{2, {entries, []}}], sent(element(1, hears(2, {digest, []}, started())))).

%% What is asked for is told as far as it is here; what is told is taken, in its order.
entries_test() ->
    ?assertEqual(
        [{2, {entries, [entry(b, 2, 6, 3)]}}],
        sent(element(1, hears(2, {want, [b, c]}, two())))
    ),
    {Taken, Machine} = hears(
        2, {entries, [entry(a, 9, 4, 4), entry(b, 8, 7, 4), entry(c, 7, 1, 2)]}, two()
    ),
    ?assertEqual([{holds, b, {7, 0, 4}}, {holds, c, {1, 0, 2}}], traced(Taken)),
    ?assertEqual([{ok, 1}, {ok, 8}, {ok, 7}], [read(N, Machine) || N <- [a, b, c]]).

%% Whom it tells does not follow from when it does.
partner_and_time_test() ->
    {_, _, Pairs} = lists:foldl(
        fun(_, {M, [Us], All}) ->
            {Actions, Next} = step({timeout, sync}, sync, M),
            [{To, _}] = sent(Actions),
            {Next, ticks(Actions), [{Us rem 4, To} | All]}
        end,
        begin
            {Actions, Machine} = new(1, #{sync_ms => 4}),
            {Machine, ticks(Actions), []}
        end,
        lists:seq(1, 1000)
    ),
    ?assertEqual(16, length(lists:usort(Pairs))).

%% The same draws in every release of OTP, others in each life: a run has the same digest in all.
draws_for_ever_test() ->
    Drawn = fun(Seed, Life) -> ticks(element(1, new(Seed, Life, #{}))) end,
    ?assertEqual(
        [[1277445], [523220], [1018317], [833371], [718402], [1378990]],
        [Drawn(Seed, Life) || Seed <- [1, 2, 3], Life <- [1, 2]]
    ).

%% It is never sooner than half of the mean, nor later than one and a half, to the microsecond.
sync_bounds_test() ->
    {Actions, Machine} = new(1, #{sync_ms => 1}),
    {_, Drawn} = lists:foldl(
        fun(_, {M, All}) ->
            {Next, After} = step({timeout, sync}, sync, M),
            {After, ticks(Next) ++ All}
        end,
        {Machine, ticks(Actions)},
        lists:seq(1, 10000)
    ),
    ?assertEqual({501, 1500}, {lists:min(Drawn), lists:max(Drawn)}).

%% -- more than a message holds ----------------------------------------------------------------

%% A full robot and one that knows nothing, or half of it, come to agree, whatever the size of names
%% and values: each message that they exchange may travel.
more_than_a_message_holds_test_() ->
    Name = fun(K) -> {K, binary:copy(<<K>>, 980)} end,
    Full = after_all([put_(Name(K), binary:copy(<<K>>, 2000)) || K <- lists:seq(1, 99)], started()),
    Half = after_all(
        [write(3, Name(2 * K), <<"later">>, ?NOW + K) || K <- lists:seq(1, 60)], started()
    ),
    [
        {Who,
            {timeout, 30, fun() ->
                {A, B, Sizes} = exchanged(sync_of(Full), Full, Other, []),
                ?assertEqual(reads(Name, A), reads(Name, B)),
                ?assert(length(Sizes) > 3)
            end}}
     || {Who, Other} <- [{"empty", started()}, {"half", Half}]
    ].

reads(Name, Machine) -> [read(Name(K), Machine) || K <- lists:seq(1, 120)].

sync_of(Machine) ->
    {Actions, _} = step({timeout, sync}, sync, Machine),
    [{sync, _} = Sync] = [Body || {_, Body} <- sent(Actions)],
    [Sync].

%% Hands the messages of one to the other until both are silent.
exchanged([], A, B, Sizes) ->
    {A, B, Sizes};
exchanged(Bodies, A, B, Sizes) ->
    [?assertEqual(ok, starl_payload:check(message, Body)) || Body <- Bodies],
    {Answers, Heard} = lists:foldl(
        fun(Body, {Sent, M}) ->
            {Actions, Next} = hears(2, Body, M),
            {Sent ++ [Answer || {_, Answer} <- sent(Actions)], Next}
        end,
        {[], B},
        Bodies
    ),
    {B1, A1, More} = exchanged(Answers, Heard, A, Sizes ++ Bodies),
    {A1, B1, More}.

%% What the page promises where nothing is said: an exchange a second, a second for the recovery, room
%% for 1024 registers.
defaults_test() ->
    ?assertEqual(ticks(element(1, new(1, #{sync_ms => 1000}))), ticks(element(1, new(1, #{})))),
    Recovery = [Us || {{timeout, recover}, Us, recover} <- element(1, new(2, #{}))],
    ?assertEqual([1000000], Recovery),
    Full = after_all([put_(K, 1) || K <- lists:seq(1, 1023)], started()),
    {Last, Machine} = call({put, 1024, 1}, Full),
    ?assertEqual([ok], answers(Last)),
    ?assertEqual([{error, full}], answers(element(1, call({put, 1025, 1}, Machine)))).
