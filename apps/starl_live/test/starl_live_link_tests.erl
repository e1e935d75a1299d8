%% The link of a live robot: what it takes of its ports, by which clock its machines live, and what it tells.
-module(starl_live_link_tests).
-include_lib("eunit/include/eunit.hrl").

-import(starl_live_link_ct, [
    with_link/2, with_link/3,
    set/3,
    hears/2,
    took/2,
    hung/1,
    app_hangs/1,
    handled/0,
    next/0,
    sap/0,
    heard/0
]).

-define(MOST_WAITING, 10000).
-define(SCRIPT, {starl_chassis_holonomic, [{100.0, 0.0, 1000}]}).

%% -- its ports --------------------------------------------------------------------------------------

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

%% New code, or its taking back, waits behind the events that had come before it, and before those that come later.
a_reload_waits_for_its_turn_test_() ->
    Order = #{number => 1, versions => #{starl_live_link_ct => starl_live_link_ct}, trial_us => 0},
    [
        {Name, fun() ->
            with_link(1, fun(Link, _Times) ->
                {Sap, _} = sap(),
                ok = hung(Link),
                _ = [hears(N, Link) || N <- [1, 2, 3]],
                ok = Reload(Link),
                _ = [hears(N, Link) || N <- [4, 5]],
                %% all of this has come to the link
                _ = starl_live_link:figures(Link),
                Sap ! go_on,
                Heard = [told(Message) || Message <- heard_until({took, 5})],
                ?assertEqual([1, 2, 3] ++ News ++ [4], [H || H <- Heard, H =/= other]),
                ok
            end)
        end}
     || {Name, Reload, News} <- [
            {"new code", fun(Link) -> starl_live_link:reload(Link, Order, self()) end, [
                {sap, taken}
            ]},
            {"a mark", fun(Link) -> starl_live_link:mark(Link, mark) end, [marked]}
        ]
    ].

told({took, N, _}) -> N;
%% the application works beside the link
told({starl_reloaded, 1, sap, #{outcome := Outcome}}) -> {sap, Outcome};
told({starl_marked, 1, _, mark}) -> marked;
told(_) -> other.

heard_until({took, N}) ->
    case next() of
        {took, N, _} -> [];
        Message -> [Message | heard_until({took, N})]
    end;
heard_until(What) ->
    case next() of
        Message when element(1, Message) =:= What -> [];
        Message -> [Message | heard_until(What)]
    end.

%% Faults lie between the sense and whoever asked, for as long as they hold: for those of the chassis, too.
%% Holds: A fault lies between a sense, also one of the chassis, and who asked, as long as it holds
%% Red: the sense's own word passed on
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
%% Holds: What was late is told to its machine before anything that waits, on a real robot, too
%% Red: d018c00, run: `not held` in 1 of 200 halts
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
%% Holds: What was late is told to its machine before …: and in its order: what was in time when it
%% was done, and has not left yet, before what was late at once; no hold is lost of which nobody
%% has heard
%% Red: d7c73771, run: the later one first; live: `not held` in 1 of 200 halts on a quiet machine
late_is_told_in_order_test() ->
    with_link(1, fun(Link, Times) ->
        ok = atomics:put(Times, 3, 5000),
        Link ! {starl_heard, self(), [{say, 1, 2, 1000, 9000}, meanwhile]},
        ?assertMatch({took, {say, 1, 2, 1000, 9000}, _}, handled()),
        ?assertEqual([{late, 1}, {late, 2}], [handled(), handled()]),
        ?assertMatch({took, meanwhile, _}, handled()),
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

%% -- its clock --------------------------------------------------------------------------------------

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

%% A timer that is not handled more than 0.2 s after it was due tells of the computer, before anything else is
%% handled: one fact of all that was due in that time.
%% Holds: What a computer explains that was late by more than 0.2 s is excused, live and in the
%% recording, and told
%% Red: edd902e7, run: `held too long` in 1 of 200 halts on a busy computer; measured where a timer
%% arrives, 2 of 100 at load 20; as it is, none of 100 at load 25; the recording's case seen red
%% with a look of one second ahead
a_computer_that_is_late_is_told_of_test() ->
    with_link(1, #{sink => self()}, fun(Link, Times) ->
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

%% -- what it tells ----------------------------------------------------------------------------------

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
            ?assertEqual(self(), starl_live_link:port(Link, L))
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

dir() -> starl_live_robot_ct:dir() ++ "-first".
