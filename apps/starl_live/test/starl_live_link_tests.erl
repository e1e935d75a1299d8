%% The link of a live robot: what it takes of its lines, by which clock its machines live, and when it
%% kills one. Here its lines are the test, its clock shows what the test sets, and its machines are this
%% module.
-module(starl_live_link_tests).
-include_lib("eunit/include/eunit.hrl").
-behaviour(starl_machine).
-behaviour(starl_live_clock).

-export([init/1, handle_event/5]).
-export([log/2]).
-export([system_time/2, time_of_day/2, monotonic_time/2, start_timer/4, send_after/3]).

-define(MOST_WAITING, 10000).
-define(SCRIPT, {starl_chassis_holonomic, [{100.0, 0.0, 1000}]}).

%% -- the machine -----------------------------------------------------------------------------------

init(#{test := Test, name := Name, incarnation := N}) ->
    Test ! {starts, Name, self(), N},
    {up, Test, [{actuate, light, on} || Name =:= app]}.

%% It does what a packet asks for, and tells the test by its clock.
handle_event(packet, hang, up, Test, _Meta) ->
    Test ! {hangs, self()},
    receive
        go_on -> {keep_state, Test, []}
    end;
handle_event(packet, Packet, up, Test, #{now := Now}) ->
    Test ! {took, Packet, Now},
    {keep_state, Test, done(Packet)};
handle_event(info, {located, hang, _Seen}, up, Test, Meta) ->
    handle_event(packet, hang, up, Test, Meta);
handle_event(info, {located, crash, _Seen}, up, _Test, _Meta) ->
    error(planted);
handle_event(info, {located, Tag, Seen}, up, Test, #{now := Now}) ->
    Test ! {located, Tag, Seen, Now},
    {keep_state, Test, []};
handle_event(info, {felt, _, _} = Felt, up, Test, _Meta) ->
    Test ! Felt,
    keep_state_and_data;
handle_event(info, {late, _} = Late, up, Test, _Meta) ->
    Test ! Late,
    keep_state_and_data;
handle_event({timeout, _}, Content, up, Test, _Meta) ->
    Test ! {wakes, Content},
    keep_state_and_data;
handle_event(info, _, up, _Test, _Meta) ->
    keep_state_and_data.

done({wake, Us}) ->
    done({wake, wake, Us});
done({wake, Name, Us}) ->
    [{{timeout, Name}, Us, wake}];
done({drive, Mark}) ->
    [{drive, ?SCRIPT, Mark}];
done({feel, Kind, Tag}) ->
    [{feel, Kind, Tag}];
done({say, Mark, Until, Us}) ->
    [{until, Until, [{trace, {said, Mark}}], Mark}, {{timeout, wake}, Us, wake}];
done({say, First, Then, Until, Us}) ->
    done({say, First, Until, Us}) ++ [{until, Until, [{trace, {said, Then}}], Then}];
done({drive, Mark, Until}) ->
    [{until, Until, [{drive, ?SCRIPT, Mark}], Mark}];
done(_Packet) ->
    [].

%% -- the clock: system time and monotonic time, which the test sets -----------------------------------

system_time(Unit, {Times, _Test}) -> in(Unit, atomics:get(Times, 1)).

time_of_day(Unit, Computer) -> system_time(Unit, Computer).

monotonic_time(Unit, {Times, _Test}) -> in(Unit, atomics:get(Times, 2)).

in(Unit, Us) -> erlang:convert_time_unit(Us, microsecond, Unit).

%% The computer stands still here for as long as the test says.
start_timer(Ms, snapshot, [{abs, true}], {_Times, Test}) ->
    Test ! {snapshot_at, Ms},
    make_ref();
start_timer(Ms, Message, [{abs, true}], {Times, Test}) ->
    Test ! {timer, Ms, Message},
    ok = atomics:add(Times, 1, atomics:exchange(Times, 3, 0)),
    make_ref().

send_after(Ms, watch, {_Times, Test}) ->
    Test ! {watch_in, Ms},
    make_ref().

clock(SystemUs, MonotonicUs, Pace) ->
    Times = atomics:new(3, [{signed, true}]),
    ok = set(SystemUs, MonotonicUs, Times),
    {Times, starl_live_clock:on({?MODULE, {Times, self()}}, starl_live_clock:new(0, Pace))}.

set(SystemUs, MonotonicUs, Times) ->
    ok = atomics:put(Times, 1, SystemUs),
    atomics:put(Times, 2, MonotonicUs).

%% -- the robot ---------------------------------------------------------------------------------------

%% Calls the test with the link of a robot whose machines have all started, and with the clock's times.
with_link(Pace, Test) ->
    with_link(Pace, #{}, Test).

%% ... of a robot with these keys in the place of the usual ones.
with_link(Pace, Given, Test) ->
    starl_platform_ct:quietly(fun() -> linked(Pace, Given, Test) end).

linked(Pace, Given, Test) ->
    process_flag(trap_exit, true),
    Dir = starl_live_robot_ct:dir() ++ "-link",
    _ = file:del_dir_r(Dir),
    {Times, Clock} = clock(0, 0, Pace),
    Usual = #{
        robot => 1,
        tree => tree(self()),
        team_seed => 1,
        profile => #{},
        clock => Clock,
        dir => Dir,
        transport => self(),
        positioning => self(),
        chassis => self(),
        sink => none
    },
    {ok, Robot} = starl_live_robot:start_link(maps:merge(Usual, Given)),
    receive
        {'$gen_cast', {actuate, light, on, none}} -> ok
    end,
    try
        ok = Test(starl_live_robot:link(Robot), Times)
    after
        exit(Robot, shutdown),
        receive
            {'EXIT', Robot, _} -> ok
        end,
        _ = file:del_dir_r(Dir),
        starl_platform_ct:forget()
    end.

tree(Test) ->
    #{
        participants => starl_team:new([1, 2]),
        services => [{sap, ?MODULE, #{test => Test}}],
        blocks => [],
        app => {machine, ?MODULE, #{test => Test}}
    }.

hears(Packet, Link) -> Link ! {starl_heard, self(), [Packet]}.

%% A packet, and the time at which it was taken.
took(Packet, Link) ->
    _ = hears(Packet, Link),
    receive
        {took, Packet, Now} -> Now
    end.

hung(Link) ->
    _ = hears(hang, Link),
    receive
        {hangs, _} -> ok
    end.

%% What the machine has handled next.
handled() ->
    receive
        {took, _, _} = Took -> Took;
        {late, _} = Late -> Late
    end.

next() ->
    receive
        {starts, app, _, _} -> next();
        {watch_in, _} -> next();
        Message -> Message
    end.

sap() ->
    receive
        {starts, sap, Pid, N} -> {Pid, N}
    end.

%% -- its lines ---------------------------------------------------------------------------------------

%% While a machine is at work so many packets wait, and no more; what is no packet waits all the same.
flood_is_bounded_test() ->
    with_link(1, fun(Link, _Times) ->
        {Sap, _} = sap(),
        ok = hung(Link),
        _ = [hears(N, Link) || N <- lists:seq(1, ?MOST_WAITING + 500)],
        Link ! {starl_located, self(), {sap, here}, []},
        {Gauges, _} = starl_live_link:metrics(Link),
        ?assertEqual([?MOST_WAITING + 2], [N || {queue_events, _, N} <- Gauges]),
        Sap ! go_on,
        Taken = [N || {took, N, _} <- heard_until(located)],
        ?assertEqual(lists:seq(1, ?MOST_WAITING + 1), Taken),
        %% there is room again
        ?assertEqual(0, took(again, Link)),
        ok
    end).

heard_until(What) ->
    case next() of
        Message when element(1, Message) =:= What -> [];
        Message -> [Message | heard_until(What)]
    end.

%% Faults lie between the sense and whoever asked, for as long as they hold: for those of the chassis, too.
a_fault_of_a_sense_lies_between_it_and_who_asked_test() ->
    with_link(1, fun(Link, _Times) ->
        Told = fun(Reading) ->
            0 = took({feel, bump, tag}, Link),
            receive
                {'$gen_cast', {feel, bump, Mark}} -> Link ! {starl_felt, self(), Mark, Reading}
            end,
            receive
                {felt, tag, Felt} -> Felt
            end
        end,
        ?assertEqual({ok, left}, Told({ok, left})),
        ok = starl_live_link:sense_faults(Link, #{bump => gone}),
        ?assertEqual(none, Told({ok, left})),
        ok = starl_live_link:sense_faults(Link, #{all => frozen}),
        ?assertEqual({ok, left}, Told({ok, right})),
        ?assertEqual(unknown, Told(unknown)),
        ok = starl_live_link:sense_faults(Link, #{}),
        ?assertEqual({ok, right}, Told({ok, right})),
        ok
    end).

%% A script must begin half a second after the step that wants it, or by its own latest moment if that
%% comes first: the chassis begins none later.
stale_script_test() ->
    with_link(1, fun(Link, Times) ->
        ok = set(7_000_000, 0, Times),
        Until = fun(Packet) ->
            7_000_000 = took(Packet, Link),
            receive
                {'$gen_cast', {drive, ?SCRIPT, Us, {sap, Mark}}} -> {Mark, Us}
            end
        end,
        ?assertEqual({1, 7_500_000}, Until({drive, 1})),
        ?assertEqual({2, 7_500_000}, Until({drive, 2, 8_000_000})),
        ?assertEqual({3, 7_200_000}, Until({drive, 3, 7_200_000})),
        ok
    end).

%% The computer stands still after a step, and then what rests on a lease is late: its machine learns of
%% it before it handles what has come meanwhile. (A mutex gave back a hold of which nobody had heard.)
late_is_told_first_test() ->
    with_link(1, fun(Link, Times) ->
        ok = atomics:put(Times, 3, 5000),
        Link ! {starl_heard, self(), [{say, 1, 1000, 9000}, meanwhile]},
        ?assertMatch({took, {say, 1, 1000, 9000}, _}, handled()),
        ?assertEqual({late, 1}, handled()),
        ?assertMatch({took, meanwhile, _}, handled()),
        %% in time
        [hears(Packet, Link) || Packet <- [{say, 2, 1_000_000, 9000}, after_it]],
        ?assertMatch({took, {say, 2, _, _}, _}, handled()),
        ?assertMatch({took, after_it, _}, handled()),
        ok
    end).

%% The computer stands still within a step, between two things that rest on a lease: the first was in time when it
%% was done, but has not left yet. So it is late as well, and its machine learns of both in their order. (A mutex
%% that learned of its answer alone lost holds of which nobody had heard.)
late_is_told_in_order_test() ->
    with_link(1, fun(Link, Times) ->
        ok = atomics:put(Times, 3, 5000),
        Link ! {starl_heard, self(), [{say, 1, 2, 1000, 9000}, meanwhile]},
        ?assertMatch({took, {say, 1, 2, 1000, 9000}, _}, handled()),
        ?assertEqual([{late, 1}, {late, 2}], [handled(), handled()]),
        ?assertMatch({took, meanwhile, _}, handled()),
        ok
    end).

%% -- its clock ---------------------------------------------------------------------------------------

%% The time of the robot's machines does not go back when its computer's does.
time_does_not_go_back_test() ->
    with_link(1, fun(Link, Times) ->
        At = fun(Us) ->
            ok = set(Us, 0, Times),
            took({at, Us}, Link)
        end,
        ?assertEqual([5, 5, 5, 6], [At(Us) || Us <- [5, 3, -2, 6]]),
        ok
    end).

%% A timer never rings before its time: it is rounded up to a millisecond, at any pace.
timers_are_rounded_up_test() ->
    Rings = fun(Pace, Us, Monotonic) ->
        with_link(Pace, fun(Link, Times) ->
            ok = set(0, Monotonic, Times),
            0 = took({wake, Us}, Link),
            receive
                {timer, Ms, _} ->
                    ?assertEqual({Us, (Monotonic + ceil(Us / Pace) + 999) div 1000}, {Us, Ms})
            end,
            ok
        end)
    end,
    [Rings(1, Us, 250) || Us <- [1, 750, 751, 1500, 1750]],
    [Rings(2, Us, 3000) || Us <- [1, 2000, 2002, 3999]].

%% A timer that is not handled more than 0.2 s after it was due tells of the computer, before anything else is
%% handled: one fact of all that was due in that time.
a_computer_that_is_late_is_told_of_test() ->
    starl_platform_ct:quietly(fun() ->
        linked(1, #{sink => self()}, fun(Link, Times) ->
            Rings = fun(Us, At) ->
                First = timer({wake, Us}, Link),
                Second = timer({wake, again, Us}, Link),
                ok = set(At, 0, Times),
                _ = [Link ! {timeout, make_ref(), Timer} || Timer <- [First, Second]],
                At = took(sync, Link),
                facts()
            end,
            ?assertEqual([], Rings(10_000, 210_000)),
            ?assertEqual([{late, 220_000, 420_001}], Rings(10_000, 420_001)),
            ?assertEqual([], Rings(10_000, 630_001)),
            ?assertEqual([{late, 640_001, 1_630_001}], Rings(10_000, 1_630_001)),
            %% what comes before it is handled late, too; a timer that does not run any more is not late
            Waits = timer({wake, 10_000}, Link),
            ok = set(1_840_002, 0, Times),
            1_840_002 = took(before_it, Link),
            ?assertEqual([{late, 1_640_001, 1_840_002}], facts()),
            Again = timer({wake, 500_000}, Link),
            ok = set(2_240_002, 0, Times),
            _ = [Link ! {timeout, make_ref(), Timer} || Timer <- [Waits, Again]],
            2_240_002 = took(sync, Link),
            ?assertEqual([], facts()),
            ok
        end)
    end).

timer(Packet, Link) ->
    _ = took(Packet, Link),
    receive
        {timer, _, Timer} -> Timer
    end.

facts() ->
    receive
        {starl_traced, 1, _Link, {_, _, Facts}} ->
            [Late || {_, 1, robot, {late, _, _} = Late} <- Facts] ++ facts()
    after 0 -> []
    end.

%% -- a machine that hangs ----------------------------------------------------------------------------

%% One that has not answered from one watch to the next is killed, and starts anew. One that has answered
%% meanwhile has its time anew, though it is at work again.
hung_machine_is_killed_test() ->
    with_link(1, fun(Link, _Times) ->
        {Sap, First} = sap(),
        Monitor = monitor(process, Sap),
        ok = hung(Link),
        Link ! watch,
        Sap ! go_on,
        ok = hung(Link),
        Link ! watch,
        _ = starl_live_link:metrics(Link),
        ?assert(is_process_alive(Sap)),
        Link ! watch,
        receive
            {'DOWN', Monitor, process, Sap, Why} -> ?assertEqual(killed, Why)
        end,
        ?assertMatch({_, N} when N =:= First + 1, sap()),
        ?assertEqual(0, took(again, Link)),
        ok
    end).

%% An application may take its time, but of one step that takes very long the log has one line, with its
%% place; a step after that has its time anew.
long_step_is_told_once_test() ->
    with_link(1, fun(Link, _Times) ->
        Watches = fun(N) ->
            logged(fun() ->
                _ = [Link ! watch || _ <- lists:seq(1, N)],
                starl_live_link:metrics(Link)
            end)
        end,
        Seconds = fun() ->
            {Gauges, _} = starl_live_link:metrics(Link),
            [N] = [N || {step_seconds, [], N} <- Gauges],
            N
        end,
        App = app_hangs(Link),
        ?assertEqual(0, Seconds()),
        ?assertEqual([], Watches(2)),
        ?assertEqual(5, Seconds()),
        [Line] = Watches(8),
        ?assertEqual(45, Seconds()),
        ?assertMatch(
            {match, _},
            re:run(
                Line,
                "^in one step for 10 s at starl_live_link_tests.erl:[0-9]+; an endless loop\\?$"
            )
        ),
        App ! go_on,
        App = app_hangs(Link),
        ?assertEqual([], Watches(2)),
        ?assertMatch([_], Watches(1)),
        ?assert(is_process_alive(App)),
        App ! go_on,
        ok
    end).

%% A node's log has one line for a crash, and none of OTP's reports of the same.
crash_is_told_once_test() ->
    with_link(1, fun(Link, _Times) ->
        receive
            {starts, app, _, _} -> ok
        end,
        Handler = #{
            config => #{robot => 1, sink => self()},
            formatter => {logger_formatter, #{single_line => true, template => [msg]}},
            filter_default => log,
            filters => [{again, {fun starl_live_log:again/2, []}}]
        },
        while_logging(starl_live_log, Handler, fun() ->
            Link ! {starl_located, self(), {app, crash}, []},
            receive
                {starts, app, _, _} -> starl_live_link:metrics(Link)
            end
        end),
        [Line] = node_lines(),
        ?assertMatch({match, _}, re:run(Line, "^app crashed: planted at starl_live_link_tests:")),
        ok
    end).

node_lines() ->
    receive
        {starl_log, 1, error, Line} -> [Line | node_lines()]
    after 0 -> []
    end.

app_hangs(Link) ->
    Link ! {starl_located, self(), {app, hang}, []},
    receive
        {hangs, Pid} -> Pid
    end.

%% The errors that are logged meanwhile, in words.
logged(Fun) ->
    while_logging(?MODULE, #{config => #{test => self()}}, Fun),
    lines().

while_logging(Module, Handler, Fun) ->
    #{level := Level} = logger:get_primary_config(),
    ok = logger:set_primary_config(level, error),
    ok = logger:add_handler(?MODULE, Module, Handler),
    _ = Fun(),
    ok = logger:remove_handler(?MODULE),
    ok = logger:set_primary_config(level, Level).

lines() ->
    receive
        {logged, Line} -> [Line | lines()]
    after 0 -> []
    end.

log(#{msg := {report, Report}, meta := #{report_cb := Words}}, #{config := #{test := Test}}) ->
    {Format, Terms} = Words(Report),
    Test ! {logged, unicode:characters_to_binary(io_lib:format(Format, Terms))};
log(_Event, _Config) ->
    ok.

%% One that is at rest is left alone, however often it is looked at.
resting_machine_is_left_alone_test() ->
    with_link(1, fun(Link, _Times) ->
        {Sap, _} = sap(),
        _ = [Link ! watch || _ <- lists:seq(1, 3)],
        ?assertEqual(0, took(here, Link)),
        ?assert(is_process_alive(Sap)),
        ok
    end).

%% It looks every five seconds.
it_watches_every_five_seconds_test() ->
    with_link(1, fun(Link, _Times) ->
        Watch = fun() ->
            receive
                {watch_in, Ms} -> Ms
            end
        end,
        ?assertEqual(5000, Watch()),
        Link ! watch,
        ?assertEqual(5000, Watch()),
        ok
    end).

%% A machine that is killed by hand starts anew; of one that is not there nothing becomes.
kill_test() ->
    with_link(1, fun(Link, _Times) ->
        {Sap, First} = sap(),
        Monitor = monitor(process, Sap),
        ok = starl_live_link:kill(Link, nobody),
        ok = starl_live_link:kill(Link, sap),
        receive
            {'DOWN', Monitor, process, Sap, Why} -> ?assertEqual(killed, Why)
        end,
        ?assertMatch({_, N} when N =:= First + 1, sap()),
        ?assertEqual(0, took(again, Link)),
        ok
    end).

%% What is no word to it changes nothing.
unknown_messages_are_left_alone_test() ->
    with_link(1, fun(Link, _Times) ->
        ok = gen_server:cast(Link, hello),
        Link ! hello,
        Link ! {starl_heard, Link, [not_of_its_radio]},
        Link ! {starl_done, x, self(), []},
        Link ! {'DOWN', make_ref(), process, self(), x},
        Link ! {timeout, make_ref(), {starl_timer, sap, {timeout, wake}, 99, 0, wake}},
        ?assertEqual(0, took(here, Link)),
        ?assertEqual([], [What || {wakes, _} = What <- heard()]),
        ok
    end).

heard() ->
    receive
        Message -> [Message | heard()]
    after 0 -> []
    end.

%% A timer's event comes once, with the mark that it was planned with.
a_timer_rings_once_test() ->
    with_link(1, fun(Link, _Times) ->
        Ring = {timeout, make_ref(), timer({wake, 10}, Link)},
        Link ! Ring,
        receive
            {wakes, wake} -> ok
        end,
        Link ! Ring,
        ?assertEqual(0, took(here, Link)),
        ?assertEqual([], [What || {wakes, _} = What <- heard()]),
        ok
    end).

%% -- what it tells -----------------------------------------------------------------------------------

%% Who asks learns of its machines, their starts and its queues, its counters and its lines.
it_answers_who_asks_test() ->
    with_link(1, fun(Link, _Times) ->
        ?assertMatch(#{sap := _, app := _}, starl_live_link:inspect(Link)),
        ?assertEqual(2, map_size(starl_live_link:inspect(Link))),
        #{events := Before} = starl_live_link:figures(Link),
        ?assert(Before >= 2),
        0 = took(here, Link),
        ?assertEqual(#{events => Before + 1, packets => 0}, starl_live_link:figures(Link)),
        [
            ?assertEqual(self(), starl_live_link:line(Link, L))
         || L <- [transport, positioning, chassis]
        ],
        {Gauges, _Counts} = starl_live_link:metrics(Link),
        ?assertEqual(
            [
                {queue_application, [], 0},
                {queue_events, [], 0},
                {step_seconds, [], 0}
            ],
            lists:sort([Gauge || {Name, _, _} = Gauge <- Gauges, Name =/= starts])
        ),
        {_, Incarnation} = sap(),
        ?assertMatch([Incarnation], [N || {starts, [{machine, sap}], N} <- Gauges]),
        ok
    end).

%% The orders of an application that is at work wait for it.
orders_wait_for_the_application_test() ->
    with_link(1, fun(Link, _Times) ->
        App = app_hangs(Link),
        [Link ! {starl_located, self(), {app, N}, []} || N <- [1, 2]],
        0 = took(here, Link),
        {Gauges, _} = starl_live_link:metrics(Link),
        ?assertMatch([2], [N || {queue_application, [], N} <- Gauges]),
        ?assertEqual([], [N || {located, N, _, _} <- heard()]),
        App ! go_on,
        Next = fun() ->
            receive
                {located, N, [], _} -> N
            end
        end,
        ?assertEqual([1, 2], [Next(), Next()]),
        ok
    end).

%% The sink learns that it starts, with its machines, and then all facts, of which a record is kept if it is asked
%% for. A robot that has run before comes up.
the_sink_learns_of_its_starts_test() ->
    with_link(1, #{sink => self(), record => true}, fun(Link, _Times) ->
        receive
            {starl_started, 1, Link, {Names, File}} ->
                ?assertEqual([app, sap], lists:sort(Names)),
                ?assert(starl_live_record:is_record(filename:basename(File)))
        end,
        receive
            {starl_traced, 1, Link, {1, _, Facts}} ->
                ?assertEqual([up], [What || {_, 1, robot, What} <- Facts])
        end,
        ok
    end).

%% Without a file the sink learns of none; a robot that was commissioned has never run, and comes up when it starts
%% anew.
a_first_life_does_not_come_up_test() ->
    ok = starl_live_store:commission(dir()),
    with_link(1, #{sink => self(), dir => dir()}, fun(Link, _Times) ->
        receive
            {starl_started, 1, Link, {_, File}} -> ?assertEqual(none, File)
        end,
        exit(Link, kill),
        Again =
            receive
                {starl_started, 1, Next, _} -> Next
            end,
        receive
            {starl_traced, 1, Again, {1, _, Facts}} ->
                ?assertEqual([up], [What || {_, 1, robot, What} <- Facts])
        end,
        Firsts = [Fact || {starl_traced, 1, L, {_, _, Some}} <- heard(), L =:= Link, Fact <- Some],
        ?assertEqual([], [What || {_, 1, robot, What} <- Firsts]),
        ok
    end),
    file:del_dir_r(dir()).

dir() -> starl_live_robot_ct:dir() ++ "-first".

%% A store that cannot be opened ends it, with a line.
without_a_store_it_does_not_start_test() ->
    process_flag(trap_exit, true),
    starl_platform_ct:quietly(fun() ->
        File = dir() ++ "-file",
        ok = file:write_file(File, "no directory"),
        {error, {shutdown, {store, Line}}} = starl_live_link:start_link(#{robot => 1, dir => File}),
        ?assertNotEqual(nomatch, string:find(Line, File)),
        ok = file:delete(File)
    end),
    process_flag(trap_exit, false),
    starl_platform_ct:forget().

%% -- snapshots ---------------------------------------------------------------------------------------

%% They are due at whole multiples of their period of the run's clock. A robot whose application computes tells
%% none; once it has told one, each event that comes is told.
snapshots_are_told_at_their_times_test() ->
    %% a process is no data, its name is
    true = register(?MODULE, self()),
    Given = #{sink => self(), snapshots_us => 300_000, tree => tree(?MODULE)},
    with_link(1, Given, fun(Link, Times) ->
        Due = fun() ->
            receive
                {snapshot_at, Ms} -> Ms
            end
        end,
        Told = fun() ->
            Link ! {timeout, make_ref(), snapshot},
            told_snapshot()
        end,
        ?assertEqual(300, Due()),
        ok = set(650_000, 10_000, Times),
        ?assertMatch({ok, _}, Told()),
        %% 250 ms later, by the computer's monotonic time
        ?assertEqual(260, Due()),
        650_000 = took(here, Link),
        ?assertEqual([{event, sap, packet, here}, now], inputs(Link)),
        App = app_hangs(Link),
        ?assertEqual({error, at_work}, Told()),
        App ! go_on,
        650_000 = took(again, Link),
        ?assertNot(lists:member({event, sap, packet, again}, inputs(Link))),
        ok
    end),
    true = unregister(?MODULE).

told_snapshot() ->
    receive
        {starl_traced, 1, _, {_, _, Facts}} ->
            case [Told || {_, 1, snapshot, {How, _} = Told} <- Facts, How =/= input] of
                [Told] -> Told;
                [] -> told_snapshot()
            end
    end.

%% The inputs that it has told so far.
inputs(Link) ->
    _ = starl_live_link:metrics(Link),
    [
        Input
     || {starl_traced, 1, _, {_, _, Facts}} <- heard(),
        {_, 1, snapshot, {input, {_, Input}}} <- Facts
    ].

%% A robot whose snapshots nobody wants tells none.
no_snapshots_test() ->
    with_link(1, fun(Link, _Times) ->
        0 = took(here, Link),
        ?assertEqual([], [Ms || {snapshot_at, Ms} <- heard()]),
        ok
    end).
