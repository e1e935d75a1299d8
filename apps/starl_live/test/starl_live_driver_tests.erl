%% What a live robot's step does to the world: facts first, then what it sends, each to its line; what it hears,
%% its time, its end, and what a start is given.
-module(starl_live_driver_tests).
-include_lib("eunit/include/eunit.hrl").

-import(starl_live_driver_ct, [with_driver/2, dir/0, sent/0, does/2, packet/0, observer/0]).

-define(SCRIPT, {starl_chassis_holonomic, [{100.0, 0.0, 1000}]}).

%% -- what leaves ------------------------------------------------------------------------------------

%% Each to its line, in their order.
actions_go_to_their_ports_test() ->
    with_driver(#{}, fun(Driver, Set) ->
        {Packet, Self} = {packet(), self()},
        ok = Set(7000),
        Now = starl_live_driver:at(Driver),
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
        {[], Stopped} = starl_live_driver:flush(starl_live_driver:stop(Now)),
        ?assertEqual([stop], sent()),
        %% the step is over
        ?assertEqual({[], Stopped}, starl_live_driver:flush(Stopped)),
        ?assertEqual([], sent()),
        [
            ?assertEqual(Self, starl_live_driver:port(L, Driver))
         || L <- [transport, positioning, chassis]
        ],
        ok
    end).

each_port_is_its_own_process_test() ->
    [A, B, C] = [spawn(fun() -> ok end) || _ <- [1, 2, 3]],
    with_driver(#{transport => A, positioning => B, chassis => C}, fun(Driver, _) ->
        ?assertEqual(
            [A, B, C], [starl_live_driver:port(L, Driver) || L <- [transport, positioning, chassis]]
        ),
        ok
    end).

%% A sense of its own is asked in the place of the chassis.
a_sense_of_its_own_is_asked_test() ->
    with_driver(#{senses => #{range => self()}}, fun(Driver, _) ->
        {Sent, [], _} = does([{feel, range, tag}, {feel, bump, tag}], Driver),
        ?assertEqual([{ask, {app, range, tag}}, {feel, bump, {app, bump, tag}}], Sent),
        ok
    end).

%% Facts come before what is sent, as batches with numbers, with the time of the step and of the look.
facts_leave_first_test() ->
    with_driver(#{observe => observer()}, fun(Driver, Set) ->
        ok = Set(5),
        Traced = starl_live_driver:trace(sap, started, starl_live_driver:at(Driver)),
        {[], One} = starl_live_driver:perform({transmit, 2, packet()}, app, Traced),
        Again = starl_live_driver:trace(app, {said, 1}, One),
        ok = Set(9),
        {[], Left} = starl_live_driver:flush(Again),
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
        {[], Bare} = starl_live_driver:flush(starl_live_driver:stop(Left)),
        ?assertEqual([stop], sent()),
        {[], _} = starl_live_driver:flush(starl_live_driver:trace(app, late, Bare)),
        ?assertEqual(
            [
                {starl_traced, 1, self(), {3, 9, [{5, 1, app, late}]}},
                {observed, {judged, [{5, 1, app, late}], []}}
            ],
            sent()
        ),
        ok
    end).

%% A simulation is told each fact at once.
facts_may_be_told_at_once_test() ->
    with_driver(#{tell => at_once}, fun(Driver, _) ->
        Next = starl_live_driver:trace(app, here, Driver),
        ?assertEqual([{starl_traced, 1, self(), {1, 0, [{0, 1, app, here}]}}], sent()),
        ?assertEqual({[], Next}, starl_live_driver:flush(Next)),
        ok
    end).

%% What is recorded can be read, and nothing else is told where nobody listens.
facts_are_recorded_test() ->
    Dir = filename:join("/tmp", "starl-live-driver-record-" ++ os:getpid()),
    ok = filelib:ensure_path(Dir),
    {ok, Record} = starl_live_record:open(Dir),
    with_driver(#{sink => none, record => Record}, fun(Driver, _) ->
        {[], _} = starl_live_driver:flush(starl_live_driver:trace(app, here, Driver)),
        ?assertEqual([], sent()),
        ?assertEqual(
            [{0, 1, app, here}], starl_live_record:read(starl_live_record:file(Record), 0)
        ),
        ok
    end),
    ok = file:del_dir_r(Dir).

%% The record is the one that has grown by what was written.
a_record_turns_test() ->
    Dir = filename:join("/tmp", "starl-live-driver-turns-" ++ os:getpid()),
    ok = filelib:ensure_path(Dir),
    {ok, Record} = starl_live_record:open(Dir),
    %% a byte less than it may have
    Grown = setelement(4, Record, 16 * 1024 * 1024 - 1),
    with_driver(#{sink => none, record => Grown}, fun(Driver, _) ->
        Tells = fun(Fact, B) ->
            {[], Next} = starl_live_driver:flush(starl_live_driver:trace(app, Fact, B)),
            Next
        end,
        _ = Tells(second, Tells(first, Driver)),
        File = starl_live_record:file(Record),
        ?assertEqual([true, true], [filelib:is_file(F) || F <- [File, File ++ ".before"]]),
        ?assertEqual([{0, 1, app, second}], starl_live_record:read(File, 1)),
        ok
    end),
    ok = file:del_dir_r(Dir).

%% -- its end ----------------------------------------------------------------------------------------

%% The sink learns of each result once; a result counts more than an end without one.
the_result_is_told_once_test() ->
    with_driver(#{}, fun(Driver, _) ->
        Ended = fun(How, B) ->
            {[], Next} = starl_live_driver:flush(starl_live_driver:ended(How, B)),
            {sent(), Next}
        end,
        {[{starl_ended, 1, Self, given_up}], Gone} = Ended(given_up, Driver),
        ?assertEqual(self(), Self),
        ?assertMatch({[], _}, Ended(given_up, Gone)),
        {[{starl_ended, 1, Self, {done, 7}}, rest], Done} = Ended({done, 7}, Gone),
        ?assertMatch({[], Done}, Ended(given_up, Done)),
        ok
    end).

%% Its peers have proved a later life: the store is marked, and the robot ends.
an_outlived_robot_marks_its_store_and_ends_test() ->
    with_driver(#{}, fun(Driver, _) ->
        {ok, Store} = starl_live_store:open(dir()),
        ok = starl_live_store:started(#{sap => 3}, Store),
        {[], Outlived} = starl_live_driver:perform({outlived, 9}, sap, Driver),
        [{Level, Report, _}] = starl_live_log_ct:reports(fun() ->
            ?assertExit({shutdown, outlived}, starl_live_driver:flush(Outlived))
        end),
        ?assertEqual({error, #{what => store_outdated, incarnation => 9}}, {Level, Report}),
        {ok, Later} = starl_live_store:open(dir()),
        ?assertEqual(#{sap => 9}, starl_live_store:starts(Later)),
        ok = file:del_dir_r(dir()),
        ?assertExit({shutdown, {store, <<_/binary>>}}, starl_live_driver:flush(Outlived)),
        ok
    end).

%% -- what is heard ----------------------------------------------------------------------------------

%% The messages of its own ports, and of no others.
messages_of_its_ports_are_events_test() ->
    [Radio, Eyes, Wheels, Range, Other] = [spawn(fun() -> ok end) || _ <- lists:seq(1, 5)],
    Given = #{
        transport => Radio, positioning => Eyes, chassis => Wheels, senses => #{range => Range}
    },
    with_driver(Given, fun(Driver, _) ->
        Hears = fun(Message) -> starl_live_driver:hear(Message, Driver) end,
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
    with_driver(#{observe => observer()}, fun(Driver, Set) ->
        ok = Set(900),
        Located = fun(Seen) ->
            [_] = starl_live_driver:hear({starl_located, self(), {app, here}, Seen}, Driver),
            sent()
        end,
        Seen = [{2, other, 5}, {1, mine, 100}],
        ?assertEqual([{observed, {seen, 800, 1, mine}}], Located(Seen)),
        ?assertEqual([], Located([{2, other, 5}])),
        ok = starl_live_driver:report_start([sap, app], Driver),
        ?assertEqual([{observed, {started, 0, 1, [sap, app]}}], sent()),
        ok
    end).

%% -- its time ---------------------------------------------------------------------------------------

%% A step has the time at which it began, and time does not go back.
a_step_has_one_time_test() ->
    with_driver(#{}, fun(Driver, Set) ->
        ok = Set(50),
        ?assertEqual([0, 50], [starl_live_driver:now_us(Driver), starl_live_driver:present(Driver)]),
        ?assertEqual(0, starl_live_driver:clock(Driver)),
        Later = starl_live_driver:at(Driver),
        ?assertEqual(50, starl_live_driver:clock(Later)),
        ok = Set(40),
        ?assertEqual(50, starl_live_driver:clock(starl_live_driver:at(Later))),
        %% each event of a turn begins a step
        ok = Set(60),
        Handles = fun(Name, Type, Content) ->
            starl_live_driver:clock(starl_live_driver:handles(Name, Type, Content, Later))
        end,
        ?assertEqual(
            [60, 60, 60],
            [Handles(app, boot, x), Handles(app, info, {sensed, x}), Handles(sap, packet, x)]
        ),
        ok
    end).

%% Events and packets are counted; what the body feels is a fact.
events_and_packets_are_counted_test() ->
    with_driver(#{}, fun(Driver, _) ->
        Handles = fun({Name, Type, Content}, B) ->
            starl_live_driver:handles(Name, Type, Content, B)
        end,
        Events = [{app, boot, x}, {sap, boot, x}, {app, info, {sensed, bump}}, {app, packet, x}],
        {Sent, [], Next} = does(
            [{transmit, 2, packet()}, {transmit, all, packet()}],
            lists:foldl(Handles, Driver, Events)
        ),
        ?assertEqual(#{events => 4, packets => 2}, starl_live_driver:figures(Next)),
        ?assertMatch(
            [{starl_traced, 1, _, {1, 0, [{0, 1, chassis, {sensed, bump}}]}} | _], Sent
        ),
        Text = iolist_to_binary(starl_live_counts:text([], starl_live_driver:counts(Next))),
        ?assertMatch({match, _}, re:run(Text, "packets_sent.*shout.* 2\n")),
        ok
    end).

%% A timer's mark is a new one, its time rounded up to a millisecond, and never past.
timers_test() ->
    with_driver(#{}, fun(Driver, Set) ->
        {0, One} = starl_live_driver:plan(app, wake, 1500, hello, Driver),
        {1, Two} = starl_live_driver:plan(app, wake, 2000, again, One),
        ok = Set(9000),
        {2, _} = starl_live_driver:plan(sap, resend, 1000, late, Two),
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

%% Of the timers that run the first counts; one that is due later than now is not due yet. The others are
%% forgotten.
the_first_timer_that_runs_is_due_test() ->
    with_driver(#{}, fun(Driver, Set) ->
        Planned = lists:foldl(
            fun({Mark, Us}, Before) ->
                {Mark, Next} = starl_live_driver:plan(app, Mark, Us, x, Before),
                Next
            end,
            Driver,
            [{0, 500}, {1, 300}, {2, 900}]
        ),
        _ = sent(),
        Due = fun(Running, Now) ->
            ok = Set(Now),
            starl_live_driver:due_us(Running, starl_live_driver:at(Planned))
        end,
        ?assertMatch({300, _}, Due([0, 1, 2], 2000)),
        ?assertMatch({500, _}, Due([0, 2], 2000)),
        ?assertMatch({400, _}, Due([0, 2], 400)),
        ?assertMatch({2000, _}, Due([], 2000)),
        {300, Left} = Due([1], 2000),
        ?assertMatch({300, _}, starl_live_driver:due_us([0, 1, 2], Left)),
        {2000, None} = starl_live_driver:due_us([0, 2], Left),
        %% a mark is never given again
        ?assertMatch({3, _}, starl_live_driver:plan(app, again, 5, x, None)),
        _ = sent(),
        ok
    end).

%% -- its starts -------------------------------------------------------------------------------------

%% A first life has no moment; a later one has its time and a lot, and counts its starts on.
a_later_life_has_a_moment_test() ->
    Random = fun(robot, 5) -> rand:seed_s(exsss, 1) end,
    with_driver(#{random => Random}, fun(Driver, Set) ->
        ok = Set(5000),
        ?assertEqual(first, starl_live_driver:moment(Driver)),
        ok
    end),
    with_driver(#{random => Random, commissioned => false}, fun(Driver, Set) ->
        ok = Set(5000),
        {Lot, _} = rand:uniform_s(starl_robot_machines:lots(), rand:seed_s(exsss, 1)),
        ?assertEqual({5, Lot - 1}, starl_live_driver:moment(Driver)),
        ok
    end).

%% What a machine starts with; an application has the clock itself. What it stores is there at its next start.
a_machine_starts_with_what_it_kept_test() ->
    Random = fun(Name, N) -> {random, Name, N} end,
    with_driver(#{random => Random}, fun(Driver, Set) ->
        ok = Set(70),
        Now = starl_live_driver:at(Driver),
        Base = starl_live_driver:base(sap, 4, Now),
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
                histories => [app, mutex]
            },
            Base
        ),
        #{clock := Clock} = starl_live_driver:base(app, 1, Now),
        ok = Set(90),
        ?assertEqual(90, Clock()),
        {ok, Kept} = starl_live_driver:store(sap, kept, Now),
        ?assertMatch(#{stored := {stored, kept}}, starl_live_driver:base(sap, 5, Kept)),
        ok = file:del_dir_r(dir()),
        ?assertEqual(full, starl_live_driver:store(sap, kept, Now)),
        ok
    end),
    %% in a simulation nobody keeps histories
    with_driver(#{inline => true}, fun(Driver, _) ->
        ?assertMatch(#{histories := []}, starl_live_driver:base(sap, 1, Driver)),
        ok
    end).
