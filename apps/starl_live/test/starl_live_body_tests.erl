%% What a live robot's step does to the world, and when: facts first, then what it sends, each to its line; what
%% came too late; reloads, snapshots, and what a start is given. The lines are the test itself, and its clock shows
%% what the test sets.
-module(starl_live_body_tests).
-include_lib("eunit/include/eunit.hrl").
-behaviour(starl_live_clock).

-export([system_time/2, time_of_day/2, monotonic_time/2, start_timer/4, send_after/3]).
%% This module is also a machine whose calls have a history.
-export([has_history/0]).

-define(SCRIPT, {starl_chassis_holonomic, [{100.0, 0.0, 1000}]}).

has_history() -> true.

%% -- the clock ---------------------------------------------------------------------------------------

system_time(Unit, Time) -> erlang:convert_time_unit(atomics:get(Time, 1), microsecond, Unit).
time_of_day(Unit, Time) -> system_time(Unit, Time).
monotonic_time(Unit, Time) -> system_time(Unit, Time).

start_timer(Ms, Message, [{abs, true}], _Time) ->
    self() ! {timer, Ms, Message},
    make_ref().

send_after(_Ms, _Message, _Time) -> make_ref().

%% -- the body ----------------------------------------------------------------------------------------

%% Calls a test with the body of robot 1 of three, and a function that sets its clock. Its store is in a
%% directory of its own.
with_body(Given, Test) ->
    starl_platform_ct:quietly(fun() ->
        starl_platform_ct:forget(),
        Dir = dir(),
        _ = file:del_dir_r(Dir),
        Time = atomics:new(1, [{signed, true}]),
        Clock = starl_live_clock:on({?MODULE, Time}, starl_live_clock:new(0, 1)),
        case maps:get(commissioned, Given, true) of
            true -> ok = starl_live_store:commission(Dir);
            false -> ok
        end,
        {ok, Store} = starl_live_store:open(Dir),
        Usual = #{
            robot => 1,
            participants => starl_team:new([1, 2, 3]),
            team_seed => 77,
            clock => Clock,
            store => Store,
            transport => self(),
            positioning => self(),
            chassis => self(),
            senses => #{},
            sink => self(),
            record => none,
            parts => #{sap => lists, app => ?MODULE, mutex => ?MODULE}
        },
        Body = starl_live_body:new(maps:merge(Usual, Given)),
        try
            ok = Test(Body, fun(Us) -> atomics:put(Time, 1, Us) end)
        after
            _ = file:del_dir_r(Dir),
            starl_platform_ct:forget()
        end
    end).

%% What the body has sent to the test; tests before this one may have left other messages.
sent() ->
    receive
        {'$gen_cast', Cast} ->
            [Cast | sent()];
        Message when
            element(1, Message) =:= starl_traced;
            element(1, Message) =:= starl_ended;
            element(1, Message) =:= starl_reloaded;
            element(1, Message) =:= observed;
            element(1, Message) =:= timer
        ->
            [Message | sent()]
    after 0 -> []
    end.

%% What a step of machine `app' with these actions sends, and what was late.
does(Actions, Body) ->
    Next = lists:foldl(
        fun(Action, B) ->
            {[], Done} = starl_live_body:perform(Action, app, B),
            Done
        end,
        Body,
        Actions
    ),
    {Late, Flushed} = starl_live_body:flush(Next),
    {sent(), Late, Flushed}.

packet() -> starl_packet:shout(1, hello, here).

%% -- what leaves -------------------------------------------------------------------------------------

%% Each to its line, in their order.
actions_go_to_their_lines_test() ->
    with_body(#{}, fun(Body, Set) ->
        {Packet, Self} = {packet(), self()},
        ok = Set(7000),
        Now = starl_live_body:at(Body),
        {Sent, [], _} = does(
            [
                {transmit, 2, Packet},
                {transmit, all, Packet},
                {sense, [2], here},
                {sense, {near, 500}, near},
                {feel, bump, tag},
                {drive, ?SCRIPT, 5},
                {actuate, pen, down},
                {actuate, pen, up, 6}
            ],
            Now
        ),
        ?assertEqual(
            [
                {transmit, 2, Packet},
                {transmit, all, Packet},
                {ask, {app, here}, [2]},
                {ask, {app, near}, [1, 2, 3]},
                {feel, bump, {app, bump, tag}},
                {drive, ?SCRIPT, 507000, {app, 5}},
                {actuate, pen, down, none},
                {actuate, pen, up, {mark, {app, 6}}}
            ],
            Sent
        ),
        {[], Stopped} = starl_live_body:flush(starl_live_body:stop(Now)),
        ?assertEqual([stop], sent()),
        %% the step is over
        ?assertEqual({[], Stopped}, starl_live_body:flush(Stopped)),
        ?assertEqual([], sent()),
        [
            ?assertEqual(Self, starl_live_body:line(L, Body))
         || L <- [transport, positioning, chassis]
        ],
        ok
    end).

each_line_is_its_own_process_test() ->
    [A, B, C] = [spawn(fun() -> ok end) || _ <- [1, 2, 3]],
    with_body(#{transport => A, positioning => B, chassis => C}, fun(Body, _) ->
        ?assertEqual(
            [A, B, C], [starl_live_body:line(L, Body) || L <- [transport, positioning, chassis]]
        ),
        ok
    end).

%% A sense of its own is asked in the place of the chassis.
a_sense_of_its_own_is_asked_test() ->
    with_body(#{senses => #{range => self()}}, fun(Body, _) ->
        {Sent, [], _} = does([{feel, range, tag}, {feel, bump, tag}], Body),
        ?assertEqual([{ask, {app, range, tag}}, {feel, bump, {app, bump, tag}}], Sent),
        ok
    end).

%% Facts come before what is sent, as batches with numbers, with the time of the step and of the look.
facts_leave_first_test() ->
    Observer = fun(News) ->
        (whereis_test()) ! {observed, News},
        ok
    end,
    with_test(fun() ->
        with_body(#{observe => Observer}, fun(Body, Set) ->
            ok = Set(5),
            Traced = starl_live_body:trace(sap, started, starl_live_body:at(Body)),
            {[], One} = starl_live_body:perform({transmit, 2, packet()}, app, Traced),
            Again = starl_live_body:trace(app, {said, 1}, One),
            ok = Set(9),
            {[], Left} = starl_live_body:flush(Again),
            Facts = [{5, 1, sap, started}, {5, 1, app, {said, 1}}],
            ?assertEqual(
                [
                    {starl_traced, 1, self(), {1, 9, Facts}},
                    {observed, {judged, Facts, []}},
                    {transmit, 2, packet()}
                ],
                sent()
            ),
            %% the next batch; without facts there is none, but it counts
            {[], Bare} = starl_live_body:flush(starl_live_body:stop(Left)),
            ?assertEqual([stop], sent()),
            {[], _} = starl_live_body:flush(starl_live_body:trace(app, late, Bare)),
            ?assertEqual(
                [
                    {starl_traced, 1, self(), {3, 9, [{5, 1, app, late}]}},
                    {observed, {judged, [{5, 1, app, late}], []}}
                ],
                sent()
            ),
            ok
        end)
    end).

%% The observer is a function: it tells this process.
with_test(Fun) ->
    true = register(?MODULE, self()),
    try
        Fun()
    after
        unregister(?MODULE)
    end.

whereis_test() -> whereis(?MODULE).

%% A simulation is told each fact at once.
facts_may_be_told_at_once_test() ->
    with_body(#{tell => at_once}, fun(Body, _) ->
        Next = starl_live_body:trace(app, here, Body),
        ?assertEqual([{starl_traced, 1, self(), {1, 0, [{0, 1, app, here}]}}], sent()),
        ?assertEqual({[], Next}, starl_live_body:flush(Next)),
        ok
    end).

%% What is recorded can be read, and nothing else is told where nobody listens.
facts_are_recorded_test() ->
    Dir = filename:join("/tmp", "starl-live-body-record-" ++ os:getpid()),
    ok = filelib:ensure_path(Dir),
    {ok, Record} = starl_live_record:open(Dir),
    with_body(#{sink => none, record => Record}, fun(Body, _) ->
        {[], _} = starl_live_body:flush(starl_live_body:trace(app, here, Body)),
        ?assertEqual([], sent()),
        ?assertEqual(
            [{0, 1, app, here}], starl_live_record:read(starl_live_record:file(Record), 0)
        ),
        ok
    end),
    ok = file:del_dir_r(Dir).

%% The record is the one that has grown by what was written.
a_record_turns_test() ->
    Dir = filename:join("/tmp", "starl-live-body-turns-" ++ os:getpid()),
    ok = filelib:ensure_path(Dir),
    {ok, Record} = starl_live_record:open(Dir),
    %% a byte less than it may have
    Grown = setelement(4, Record, 16 * 1024 * 1024 - 1),
    with_body(#{sink => none, record => Grown}, fun(Body, _) ->
        Tells = fun(Fact, B) ->
            {[], Next} = starl_live_body:flush(starl_live_body:trace(app, Fact, B)),
            Next
        end,
        _ = Tells(second, Tells(first, Body)),
        File = starl_live_record:file(Record),
        ?assertEqual([true, true], [filelib:is_file(F) || F <- [File, File ++ ".before"]]),
        ?assertEqual([{0, 1, app, second}], starl_live_record:read(File, 1)),
        ok
    end),
    ok = file:del_dir_r(Dir).

%% -- what is late ------------------------------------------------------------------------------------

%% What has a latest moment leaves by then or not at all; then its machine learns of it, once, in the order of the
%% step. The radio and the chassis are told the moment, and look once more.
what_is_late_does_not_leave_test() ->
    with_body(#{}, fun(Body, Set) ->
        Until = fun(Us) ->
            [
                {until, Us, {trace, {said, Us}}, a},
                {until, Us, {transmit, 2, packet()}, b},
                {until, Us, {drive, ?SCRIPT, 5}, c},
                {until, Us, {actuate, pen, down}, d}
            ]
        end,
        ok = Set(100),
        Self = self(),
        ?assertMatch(
            {
                [
                    {starl_traced, 1, Self, {1, 100, [{0, 1, app, {said, 100}}]}},
                    {transmit, 2, _, {100, {app, b}}},
                    {drive, ?SCRIPT, 100, {app, 5}},
                    {actuate, pen, down, none}
                ],
                [],
                _
            },
            does(Until(100), Body)
        ),
        {[], Late, After} = does(Until(99), Body),
        ?assertEqual([{app, info, {late, Mark}} || Mark <- [a, b, c, d]], Late),
        ?assertMatch({[stop], [], _}, does_stop(After)),
        %% a script is begun within half a second of its step, whatever its latest moment
        ?assertMatch({[{drive, ?SCRIPT, 500000, _}], [], _}, does([lasts(600000)], Body)),
        ?assertMatch({[{drive, ?SCRIPT, 400000, _}], [], _}, does([lasts(400000)], Body)),
        ok
    end).

lasts(Us) -> {until, Us, {drive, ?SCRIPT, 5}, c}.

does_stop(Body) ->
    {Late, Next} = starl_live_body:flush(starl_live_body:stop(Body)),
    {sent(), Late, Next}.

%% Two things of one order that are late are told once.
an_owner_learns_of_it_once_test() ->
    with_body(#{}, fun(Body, Set) ->
        ok = Set(100),
        Said = [{until, 1, {trace, {said, N}}, a} || N <- [1, 2]],
        ?assertMatch({[], [{app, info, {late, a}}], _}, does(Said, Body)),
        ok
    end).

%% Facts of two orders are late in their order, and before what was to be sent.
owners_learn_of_it_in_the_order_of_the_step_test() ->
    with_body(#{}, fun(Body, Set) ->
        ok = Set(100),
        Late = [
            {until, 1, {actuate, pen, down}, c},
            {until, 1, {trace, {said, 1}}, a},
            {until, 100, {trace, {said, 2}}, in_time},
            {until, 1, {trace, {said, 3}}, b}
        ],
        ?assertMatch(
            {
                [{starl_traced, 1, _, {1, 100, [{0, 1, app, {said, 2}}]}}],
                [{app, info, {late, a}}, {app, info, {late, b}}, {app, info, {late, c}}],
                _
            },
            does(Late, Body)
        ),
        ok
    end).

%% The log has a warning of each thing that was late, whether it was known at its step or when it was to leave.
what_is_late_is_logged_test() ->
    with_body(#{}, fun(Body, Set) ->
        ok = Set(100),
        Logged = fun(Do) ->
            [{Level, Report} || {Level, Report, _} <- starl_live_log_ct:reports(Do)]
        end,
        Late = {warning, #{what => late, machine => app}},
        ?assertEqual(
            [Late, Late],
            Logged(fun() ->
                does([{until, 1, {trace, x}, a}, {until, 1, {actuate, pen, down}, b}], Body)
            end)
        ),
        ?assertEqual([Late], Logged(fun() -> starl_live_body:trace(app, late, Body) end)),
        ?assertEqual([], Logged(fun() -> starl_live_body:trace(app, {said, 1}, Body) end)),
        ?assertEqual([], Logged(fun() -> does([{until, 100, {trace, x}, a}], Body) end)),
        ok
    end).

%% Facts are counted when they are traced, whenever they leave.
facts_are_counted_test() ->
    with_body(#{}, fun(Body, _) ->
        Traced = lists:foldl(
            fun({Name, Fact}, B) -> starl_live_body:trace(Name, Fact, B) end,
            Body,
            [{app, crashed}, {app, crashed}, {mutex, late}]
        ),
        {[], Sent} = starl_live_body:perform(
            {until, 9, {trace, {leased, token, 1, 8000}}, a}, app, Traced
        ),
        Counts = starl_live_body:counts(Sent),
        Text = iolist_to_binary(starl_live_counts:text([], Counts)),
        [
            ?assertMatch({match, _}, re:run(Text, Line))
         || Line <- [
                "\nstarl_restarts_total{machine=\"app\"} 2\n",
                "\nstarl_late_total{machine=\"mutex\"} 1\n"
            ]
        ],
        ?assertMatch([{lease_seconds, [{token, token}], _}], starl_live_counts:leases(0, Counts)),
        ok
    end).

%% The end of a lease is known from the last moment of a shout.
a_lease_ends_at_its_latest_moment_test() ->
    with_body(#{}, fun(Body, _) ->
        {_, [], Next} = does([{until, 9000, {transmit, all, packet()}, a}], Body),
        ?assertMatch(
            [{_, _, Seconds}] when Seconds == 0.008,
            starl_live_counts:leases(1000, starl_live_body:counts(Next))
        ),
        {_, [], Bare} = does([{until, 9000, {actuate, pen, down}, a}], Body),
        ?assertEqual([], starl_live_counts:leases(1000, starl_live_body:counts(Bare))),
        ok
    end).

%% -- its end -----------------------------------------------------------------------------------------

%% The sink learns of each result once; a result counts more than an end without one.
the_result_is_told_once_test() ->
    with_body(#{}, fun(Body, _) ->
        Ended = fun(How, B) ->
            {[], Next} = starl_live_body:flush(starl_live_body:ended(How, B)),
            {sent(), Next}
        end,
        {[{starl_ended, 1, Self, given_up}], Gone} = Ended(given_up, Body),
        ?assertEqual(self(), Self),
        ?assertMatch({[], _}, Ended(given_up, Gone)),
        {[{starl_ended, 1, Self, {done, 7}}, rest], Done} = Ended({done, 7}, Gone),
        ?assertMatch({[], Done}, Ended(given_up, Done)),
        ok
    end).

%% Its peers have proved a later life: the store is marked, and the robot ends.
an_outlived_robot_marks_its_store_and_ends_test() ->
    with_body(#{}, fun(Body, _) ->
        {ok, Store} = starl_live_store:open(dir()),
        ok = starl_live_store:started(#{sap => 3}, Store),
        {[], Outlived} = starl_live_body:perform({outlived, 9}, sap, Body),
        [{Level, Report, _}] = starl_live_log_ct:reports(fun() ->
            ?assertExit({shutdown, outlived}, starl_live_body:flush(Outlived))
        end),
        ?assertEqual({error, #{what => store_outdated, incarnation => 9}}, {Level, Report}),
        {ok, Later} = starl_live_store:open(dir()),
        ?assertEqual(#{sap => 9}, starl_live_store:starts(Later)),
        ok = file:del_dir_r(dir()),
        ?assertExit({shutdown, {store, <<_/binary>>}}, starl_live_body:flush(Outlived)),
        ok
    end).

dir() -> starl_live_robot_ct:dir() ++ "-body".

%% -- what is heard -----------------------------------------------------------------------------------

%% The messages of its own lines, and of no others.
messages_of_its_lines_are_events_test() ->
    [Radio, Eyes, Wheels, Range, Other] = [spawn(fun() -> ok end) || _ <- lists:seq(1, 5)],
    Given = #{
        transport => Radio, positioning => Eyes, chassis => Wheels, senses => #{range => Range}
    },
    with_body(Given, fun(Body, _) ->
        Hears = fun(Message) -> starl_live_body:hear(Message, Body) end,
        Mark = {app, 5},
        [
            ?assertEqual({Message, Events}, {Message, Hears(Message)})
         || {Events, Message} <- [
                {[{sap, packet, a}, {sap, packet, b}], {starl_heard, Radio, [a, b]}},
                {unknown, {starl_heard, Other, [a]}},
                {[{app, info, {located, here, []}}], {starl_located, Eyes, {app, here}, []}},
                {unknown, {starl_located, Other, {app, here}, []}},
                {[{app, info, {sensed, bump}}], {starl_chassis, Wheels, sensed, bump}},
                {unknown, {starl_chassis, Other, sensed, bump}},
                {[{app, info, {driven, 5, 70}}], {starl_chassis, Wheels, Mark, {driven, 70}}},
                {[{app, info, {stalled, 5, x}}], {starl_chassis, Wheels, Mark, {stalled, x}}},
                {
                    [{app, info, {actuated, 5, pen, up}}],
                    {starl_chassis, Wheels, Mark, {actuated, pen, up}}
                },
                {[], {starl_chassis, Wheels, Mark, {not_understood, []}}},
                {unknown, {starl_chassis, Other, Mark, {driven, 70}}},
                {[{app, info, {felt, t, 3}}], {starl_felt, Wheels, {app, bump, t}, 3}},
                {[{app, info, {felt, t, 3}}], {starl_felt, Range, {app, range, t}, 3}},
                {unknown, {starl_felt, Other, {app, range, t}, 3}},
                {unknown, hello}
            ]
        ],
        ok
    end).

%% The observer of this node learns where the robot was seen, at the time of the picture.
its_own_place_is_observed_test() ->
    Observer = fun(News) ->
        (whereis_test()) ! {observed, News},
        ok
    end,
    with_test(fun() ->
        with_body(#{observe => Observer}, fun(Body, Set) ->
            ok = Set(900),
            Located = fun(Seen) ->
                [_] = starl_live_body:hear({starl_located, self(), {app, here}, Seen}, Body),
                sent()
            end,
            Seen = [{2, other, 5}, {1, mine, 100}],
            ?assertEqual([{observed, {seen, 800, 1, mine}}], Located(Seen)),
            ?assertEqual([], Located([{2, other, 5}])),
            ok = starl_live_body:tell_start([sap, app], Body),
            ?assertEqual([{observed, {started, 0, 1, [sap, app]}}], sent()),
            ok
        end)
    end).

%% -- its time ----------------------------------------------------------------------------------------

%% A step has the time at which it began, and time does not go back.
a_step_has_one_time_test() ->
    with_body(#{}, fun(Body, Set) ->
        ok = Set(50),
        ?assertEqual([0, 50], [starl_live_body:now_us(Body), starl_live_body:present(Body)]),
        ?assertEqual(0, starl_live_body:clock(Body)),
        Later = starl_live_body:at(Body),
        ?assertEqual(50, starl_live_body:clock(Later)),
        ok = Set(40),
        ?assertEqual(50, starl_live_body:clock(starl_live_body:at(Later))),
        %% each event of a turn begins a step
        ok = Set(60),
        Handles = fun(Name, Type, Content) ->
            starl_live_body:clock(starl_live_body:handles(Name, Type, Content, Later))
        end,
        ?assertEqual(
            [60, 60, 60],
            [Handles(app, boot, x), Handles(app, info, {sensed, x}), Handles(sap, packet, x)]
        ),
        ok
    end).

%% Events and packets are counted; what the body feels is a fact.
events_and_packets_are_counted_test() ->
    with_body(#{}, fun(Body, _) ->
        Handles = fun({Name, Type, Content}, B) ->
            starl_live_body:handles(Name, Type, Content, B)
        end,
        Events = [{app, boot, x}, {sap, boot, x}, {app, info, {sensed, bump}}, {app, packet, x}],
        {Sent, [], Next} = does(
            [{transmit, 2, packet()}, {transmit, all, packet()}], lists:foldl(Handles, Body, Events)
        ),
        ?assertEqual(#{events => 4, packets => 2}, starl_live_body:figures(Next)),
        ?assertMatch(
            [{starl_traced, 1, _, {1, 0, [{0, 1, chassis, {sensed, bump}}]}} | _], Sent
        ),
        Text = iolist_to_binary(starl_live_counts:text([], starl_live_body:counts(Next))),
        ?assertMatch({match, _}, re:run(Text, "packets_sent.*shout.* 2\n")),
        ok
    end).

%% A timer's mark is a new one, its time rounded up to a millisecond, and never past.
timers_test() ->
    with_body(#{}, fun(Body, Set) ->
        {0, One} = starl_live_body:plan(app, wake, 1500, hello, Body),
        {1, Two} = starl_live_body:plan(app, wake, 2000, again, One),
        ok = Set(9000),
        {2, _} = starl_live_body:plan(sap, resend, 1000, late, Two),
        ?assertEqual(
            [
                {timer, 2, {starl_timer, app, wake, 0, hello}},
                {timer, 2, {starl_timer, app, wake, 1, again}},
                {timer, 9, {starl_timer, sap, resend, 2, late}}
            ],
            sent()
        ),
        ok
    end).

%% -- its starts --------------------------------------------------------------------------------------

%% A first life has no moment; a later one has its time and a lot, and counts its starts on.
a_later_life_has_a_moment_test() ->
    Random = fun(robot, 5) -> rand:seed_s(exsss, 1) end,
    with_body(#{random => Random}, fun(Body, Set) ->
        ok = Set(5000),
        ?assertEqual(first, starl_live_body:moment(Body)),
        ok
    end),
    with_body(#{random => Random, commissioned => false}, fun(Body, Set) ->
        ok = Set(5000),
        {Lot, _} = rand:uniform_s(starl_robot_machines:lots(), rand:seed_s(exsss, 1)),
        ?assertEqual({5, Lot - 1}, starl_live_body:moment(Body)),
        ok
    end).

%% What a machine starts with; an application has the clock itself. What it stores is there at its next start.
a_machine_starts_with_what_it_kept_test() ->
    Random = fun(Name, N) -> {random, Name, N} end,
    with_body(#{random => Random}, fun(Body, Set) ->
        ok = Set(70),
        Now = starl_live_body:at(Body),
        Base = starl_live_body:base(sap, 4, Now),
        ?assertEqual(
            #{
                robot => 1,
                participants => starl_team:new([1, 2, 3]),
                name => sap,
                incarnation => 4,
                stored => none,
                random => {random, sap, 4},
                team_seed => 77,
                now => 70,
                histories => [app, mutex],
                snapshots => false
            },
            Base
        ),
        #{clock := Clock} = starl_live_body:base(app, 1, Now),
        ok = Set(90),
        ?assertEqual(90, Clock()),
        {ok, Kept} = starl_live_body:store(sap, kept, Now),
        ?assertMatch(#{stored := {stored, kept}}, starl_live_body:base(sap, 5, Kept)),
        ok = file:del_dir_r(dir()),
        ?assertEqual(full, starl_live_body:store(sap, kept, Now)),
        ok
    end),
    %% in a simulation nobody keeps histories
    with_body(#{inline => true}, fun(Body, _) ->
        ?assertMatch(#{histories := []}, starl_live_body:base(sap, 1, Body)),
        ok
    end).

%% -- new code ----------------------------------------------------------------------------------------

-define(ORDER, #{number => 1, versions => #{?MODULE => new}, trial_us => 1000}).

%% Machines of this module get words; what they tell is a fact, and goes to who asked.
a_reload_is_told_to_who_asked_test() ->
    with_body(#{}, fun(Body, _) ->
        Switch = #{number => 1, module => new, trial_us => 1000},
        Words = [{app, {take, Switch}}, {mutex, {take, Switch}}],
        {Words, Asked} = starl_live_body:reload(?ORDER, self(), Body),
        Told = #{number => 1, outcome => taken, module => new, tell => nobody},
        {[], One} = starl_live_body:perform({reloaded, Told}, app, Asked),
        {Restarts, _} = starl_live_body:perform({reloaded, Told#{tell := others}}, app, Asked),
        ?assertEqual([{To, info, {restarted, app}} || To <- [mutex, sap]], Restarts),
        {[], _} = starl_live_body:flush(One),
        ?assertEqual(
            [
                {starl_traced, 1, self(), {1, 0, [{0, 1, app, {reloaded, 1, taken}}]}},
                {starl_reloaded, 1, app, Told}
            ],
            sent()
        ),
        %% a machine that is gone takes none, and has none to give back
        {Take, Back} = {{take, Switch}, {back, 1, 2}},
        {[], _} = starl_live_body:flush(starl_live_body:gone(mutex, Take, Asked)),
        Done = #{number => 1, outcome => done, module => new, tell => nobody},
        ?assertMatch([{starl_traced, _, _, _}, {starl_reloaded, 1, mutex, Done}], sent()),
        ?assertEqual(Asked, starl_live_body:gone(mutex, Back, Asked)),
        {BackWords, _} = starl_live_body:take_back(1, 2, Asked),
        ?assertEqual([{app, Back}, {mutex, Back}], BackWords),
        ok
    end).

%% What a machine runs now is what it starts with, and that is logged. A word that it has heeded is not given to its
%% successor again.
what_a_machine_tells_of_a_reload_is_known_test() ->
    with_body(#{}, fun(Body, _) ->
        Switch = #{number => 1, module => lists, trial_us => 1000},
        {_, Asked} = starl_live_body:reload(?ORDER#{versions => #{?MODULE => lists}}, self(), Body),
        Lineage = starl_lineage:take(Switch#{kept => none}, 0, starl_lineage:new(?MODULE)),
        Told = starl_reload:told(1, taken, nobody, Lineage),
        Code = fun(B) ->
            #{code := Runs} = starl_live_body:base(app, 1, B),
            starl_lineage:code(Runs)
        end,
        Self = self(),
        Reports = starl_live_log_ct:reports(fun() ->
            {[], Next} = starl_live_body:perform({reloaded, Told}, app, Asked),
            Self ! {heeds, Next}
        end),
        Heeds =
            receive
                {heeds, Next} -> Next
            end,
        ?assertMatch(
            [
                {notice,
                    #{what := reload, outcome := <<"robot 1, app (lists): runs the new code">>}, _}
            ],
            Reports
        ),
        ?assertEqual([?MODULE, lists], [Code(Asked), Code(Heeds)]),
        {[], _} = starl_live_body:flush(starl_live_body:handles(app, boot, x, Heeds)),
        ?assertEqual([taken], [How || {starl_reloaded, 1, app, #{outcome := How}} <- sent()]),
        ok
    end).

%% Nobody is told of what nobody asked for.
a_reload_that_nobody_asked_for_test() ->
    with_body(#{sink => none}, fun(Body, _) ->
        Told = #{number => 1, outcome => taken, module => new, tell => nobody},
        {[], [], _} = does([{reloaded, Told}], Body),
        ok
    end).

%% A machine starts with the code that it has not taken yet, which is on trial then; if it crashes on trial, that is
%% told, and otherwise it is not.
a_crash_on_trial_is_told_test() ->
    with_body(#{}, fun(Body, _) ->
        {_, Asked} = starl_live_body:reload(?ORDER, self(), Body),
        ?assertNot(is_map_key(code, starl_live_body:base(sap, 1, Asked))),
        ?assert(is_map_key(code, starl_live_body:base(app, 1, Asked))),
        {[], Booted} = starl_live_body:flush(starl_live_body:handles(app, boot, x, Asked)),
        ?assertMatch(
            [{starl_traced, _, _, _}, {starl_reloaded, 1, app, #{outcome := taken}}], sent()
        ),
        Cause = starl_crash:cause({badarg, []}),
        Fallen = fun(Name, Why) ->
            {[], _} = starl_live_body:flush(starl_live_body:fallen(Name, Why, Booted)),
            [Outcome || {starl_reloaded, 1, app, #{outcome := Outcome}} <- sent()]
        end,
        ?assertEqual([{crashed, Cause}], Fallen(app, Cause)),
        %% it is taken once
        {[], _} = starl_live_body:flush(starl_live_body:handles(app, boot, x, Booted)),
        ?assertEqual([], [How || {starl_reloaded, _, _, #{outcome := How}} <- sent()]),
        %% unless it has failed elsewhere before
        {_, Back} = starl_live_body:take_back(1, 2, Asked),
        {[], _} = starl_live_body:flush(starl_live_body:handles(app, boot, x, Back)),
        ?assertEqual([{back, 2}], [How || {starl_reloaded, _, _, #{outcome := How}} <- sent()]),
        ?assertEqual([], Fallen(sap, Cause)),
        ?assertEqual([], Fallen(app, none)),
        ok
    end).

%% -- snapshots ---------------------------------------------------------------------------------------

%% From the first snapshot on all that comes is told, too. A snapshot has what the machines stored, the last
%% script, and the timers that still run; one that failed is followed by no inputs.
what_comes_after_a_snapshot_is_told_test() ->
    with_body(#{snapshots_us => 1000}, fun(Body0, _) ->
        ?assertMatch(#{snapshots := true}, starl_live_body:base(sap, 1, Body0)),
        {ok, Body1} = starl_live_body:store(app, kept, Body0),
        {_, [], Body2} = does([{drive, ?SCRIPT, 5}], starl_live_body:input(acts, Body1)),
        {0, Body3} = starl_live_body:plan(app, gone, 10, x, Body2),
        {1, Body} = starl_live_body:plan(app, wake, 20, hello, Body3),
        [{timer, _, _}, {timer, _, _}] = sent(),
        Parts = #{timers => [{app, wake, 1}]},
        {[], Told} = starl_live_body:flush(starl_live_body:snapshot({ok, {machines, Parts}}, Body)),
        [{starl_traced, 1, _, {_, 0, [{0, 1, snapshot, {ok, Bytes}}]}}] = sent(),
        {ok, {live, Snapshot}} = starl_snapshot:of_term(binary_to_term(Bytes)),
        ?assertEqual(
            #{
                at_us => 0,
                machines => machines,
                parts => Parts,
                dues => #{1 => {20, app, wake, hello}},
                marks => 2,
                stored => #{app => kept},
                script => {0, ?SCRIPT, {app, 5}},
                result => running
            },
            Snapshot
        ),
        Inputs = fun(B) ->
            {[], _} = starl_live_body:flush(starl_live_body:input(acts, B)),
            [
                Input
             || {starl_traced, 1, _, {_, _, Facts}} <- sent(), {0, 1, snapshot, Input} <- Facts
            ]
        end,
        ?assertEqual([{input, {0, acts}}], Inputs(Told)),
        {[], Failed} = starl_live_body:flush(starl_live_body:snapshot({error, at_work}, Told)),
        ?assertMatch([{starl_traced, 1, _, {_, 0, [{0, 1, snapshot, {error, at_work}}]}}], sent()),
        ?assertEqual([], Inputs(Failed)),
        ok
    end),
    with_body(#{}, fun(Body, _) ->
        ?assertMatch(#{snapshots := false}, starl_live_body:base(sap, 1, Body)),
        ?assertEqual(Body, starl_live_body:input(acts, Body)),
        ok
    end).

%% What a simulation needs of a step: a machine that starts is something else; others have handled an event.
a_step_is_an_input_test() ->
    with_body(#{snapshots_us => 1000}, fun(Body, _) ->
        Kept = starl_live_body:snapshot({ok, {machines, #{timers => []}}}, Body),
        {[], Told} = starl_live_body:flush(Kept),
        _ = sent(),
        Inputs = fun(Name, Type, Content) ->
            Next = starl_live_body:handles(Name, Type, Content, Told),
            {[], _} = starl_live_body:flush(Next),
            [{starl_traced, 1, _, {_, _, Facts}}] = sent(),
            [Input || {0, 1, snapshot, {input, {0, Input}}} <- Facts]
        end,
        ?assertEqual([{other, boot}], Inputs(app, boot, x)),
        ?assertEqual([now], Inputs(app, info, {sensed, bump})),
        ?assertEqual([now], Inputs(sap, packet, x)),
        ok
    end).
