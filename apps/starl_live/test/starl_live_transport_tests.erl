%% The process at the end of a robot's radio: what it puts on the air, what it tells its link, and its filter. The
%% way of packets is this module, which tells the test.
-module(starl_live_transport_tests).
-include_lib("eunit/include/eunit.hrl").
-behaviour(starl_live_transport).
-behaviour(starl_live_clock).

-export([open/1, transmit/3, hear/2, figures/1, peers/1, close/1]).
-export([system_time/2, time_of_day/2, monotonic_time/2, start_timer/4, send_after/3]).
%% Handles the transport's reports.
-export([log/2]).

%% -- the way -----------------------------------------------------------------------------------------

open(#{fails := Why}) -> {error, Why};
open(#{test := Test}) -> {ok, {Test, 0}}.

transmit(_To, no_packet, {Test, N}) ->
    {refused, "no packet", {Test, N + 1000}};
transmit(_To, {no_packet, Which}, {Test, N}) ->
    {refused, ["no packet ", Which], {Test, N}};
transmit(To, Packet, {Test, N}) ->
    Test ! {on_air, To, Packet},
    {ok, {Test, N + 1}}.

hear({air, Packets}, {Test, N}) -> {Packets, {Test, N + 100}};
hear(_Message, _State) -> unknown.

figures({_Test, N}) -> #{way => N}.
peers({_Test, N}) -> [N].

close({Test, _N}) ->
    Test ! closed,
    ok.

%% -- the clock, which shows one millisecond ----------------------------------------------------------

system_time(Unit, Us) -> erlang:convert_time_unit(Us, microsecond, Unit).
time_of_day(Unit, Us) -> system_time(Unit, Us).
monotonic_time(Unit, Us) -> system_time(Unit, Us).
start_timer(_Ms, _Message, _Options, _Us) -> make_ref().
send_after(_Ms, _Message, _Us) -> make_ref().

clock() -> starl_live_clock:on({?MODULE, 1000}, starl_live_clock:new(0, 1)).

%% -- the tests ---------------------------------------------------------------------------------------

with_transport(Given, Test) -> with_transport(?MODULE, Given, Test).

with_transport(Module, Given, Test) ->
    starl_platform_ct:forget(),
    {ok, Transport} = starl_live_transport:start_link(Module, config(Given), self()),
    try
        ok = Test(Transport)
    after
        unlink(Transport),
        gen_server:stop(Transport)
    end,
    starl_platform_ct:forget().

config(Given) ->
    maps:merge(
        #{
            robot => 1,
            participants => starl_team:new([1, 2, 3]),
            fleet => "tests",
            run => 1,
            clock => clock(),
            test => self()
        },
        Given
    ).

packet(From) -> starl_packet:shout(From, hello, here).

next() ->
    receive
        {on_air, _, _} = Message -> Message;
        {starl_heard, _, _} = Message -> Message;
        {starl_late, _} = Message -> Message;
        {told, _} = Message -> Message;
        {logged, _} = Message -> Message;
        closed -> closed
    end.

%% Its counters and those of the way; what the way knows of others, if it knows.
packets_go_on_the_air_and_come_test() ->
    with_transport(#{}, fun(Transport) ->
        ok = starl_live_transport:transmit(Transport, 2, packet(1)),
        ?assertEqual({on_air, 2, packet(1)}, next()),
        Transport ! {air, [packet(2), packet(3)]},
        ?assertEqual({starl_heard, Transport, [packet(2), packet(3)]}, next()),
        Transport ! nothing_to_it,
        Transport ! {air, []},
        ?assertEqual(#{way => 201, heard => 2}, starl_live_transport:figures(Transport)),
        ?assertEqual([201], starl_live_transport:peers(Transport)),
        ok
    end),
    with_transport(starl_live_local, #{}, fun(Transport) ->
        ?assertEqual([], starl_live_transport:peers(Transport)),
        ok
    end).

%% By its last moment a packet leaves, after it never; then the link is told.
a_late_packet_does_not_leave_test() ->
    with_transport(#{}, fun(Transport) ->
        ok = starl_live_transport:transmit(Transport, 2, packet(1), {1000, owner}),
        ?assertEqual({on_air, 2, packet(1)}, next()),
        ok = starl_live_transport:transmit(Transport, 2, packet(1), {999, owner}),
        ?assertEqual({starl_late, owner}, next()),
        ?assertEqual(#{way => 1, late => 1}, starl_live_transport:figures(Transport)),
        ok
    end).

%% Of a packet that cannot be sent the log has one line, and no second for the same again.
a_refusal_is_said_once_test() ->
    #{level := Level} = logger:get_primary_config(),
    ok = logger:set_primary_config(level, error),
    ok = logger:add_handler(?MODULE, ?MODULE, #{config => #{test => self()}}),
    with_transport(#{}, fun(Transport) ->
        Transmits = fun(Packet) -> ok = starl_live_transport:transmit(Transport, 2, Packet) end,
        [Transmits(P) || P <- [no_packet, no_packet, {no_packet, "b"}, no_packet]],
        ?assertEqual(#{refused => 4, way => 3000}, starl_live_transport:figures(Transport)),
        Lines = [<<"no packet">>, <<"no packet b">>, <<"no packet">>],
        ?assertEqual([{logged, Line} || Line <- Lines], [next() || _ <- Lines]),
        ok
    end),
    ok = logger:remove_handler(?MODULE),
    ok = logger:set_primary_config(level, Level).

log(
    #{
        msg := {report, #{what := packet_refused, why := Why}},
        meta := #{domain := [starl, robot], robot := 1}
    },
    #{config := #{test := Test}}
) ->
    Test ! {logged, Why};
log(_Event, _Handler) ->
    ok.

%% Its filter, from the beginning or later: what is lost, doubled and delayed.
what_it_hears_goes_through_the_air_test() ->
    with_transport(#{air => #{loss => 1}}, fun(Transport) ->
        Transport ! {air, [packet(2), packet(3)]},
        ?assertMatch(#{air_lost := 2}, starl_live_transport:figures(Transport)),
        ok = starl_live_transport:set_conditions(Transport, #{loss => 0, duplicates => 1}),
        Transport ! {air, [packet(2)]},
        ?assertEqual({starl_heard, Transport, [packet(2), packet(2)]}, next()),
        ok = starl_live_transport:set_conditions(Transport, #{duplicates => 0, cut => [2]}),
        Transport ! {air, [packet(2), packet(3)]},
        ?assertEqual({starl_heard, Transport, [packet(3)]}, next()),
        {error, Line} = starl_live_transport:set_conditions(Transport, #{loss => 2}),
        ?assertNotEqual(nomatch, string:find(Line, "loss")),
        ok = starl_live_transport:set_conditions(Transport, #{cut => [], delay_ms => 1}),
        Transport ! {air, [packet(2)]},
        ?assertEqual({starl_heard, Transport, [packet(2)]}, next()),
        ?assertEqual(
            #{way => 400, air_lost => 3, heard => 4}, starl_live_transport:figures(Transport)
        ),
        ok
    end).

%% What one packet meets is not what all others meet.
chance_goes_on_test() ->
    with_transport(#{air => #{loss => 0.5, seed => 1}}, fun(Transport) ->
        _ = [Transport ! {air, [packet(2)]} || _ <- lists:seq(1, 100)],
        #{air_lost := Lost, heard := Heard} = starl_live_transport:figures(Transport),
        ?assertEqual(100, Lost + Heard),
        _ = flushed(),
        ok
    end).

%% No more than 10,000 packets wait at a time; those that were heard make room.
delayed_packets_are_bounded_test() ->
    with_transport(#{air => #{delay_ms => 60_000}}, fun(Transport) ->
        Transport ! {air, lists:duplicate(10_003, packet(2))},
        ?assertEqual(#{way => 100, air_full => 3}, starl_live_transport:figures(Transport)),
        Transport ! {starl_live_transport, delayed, packet(3)},
        ?assertEqual({starl_heard, Transport, [packet(3)]}, next()),
        Transport ! {air, [packet(2), packet(2)]},
        ?assertEqual(
            #{way => 200, air_full => 4, heard => 1}, starl_live_transport:figures(Transport)
        ),
        ok
    end).

%% It ends with its link, or what it is linked to, and closes its end; a mistake is a line.
it_closes_its_end_test() ->
    process_flag(trap_exit, true),
    {ok, Transport} = starl_live_transport:start_link(?MODULE, config(#{}), self()),
    Transport ! {'EXIT', self(), shutdown},
    ?assertEqual(closed, next()),
    receive
        {'EXIT', Transport, Why} -> ?assertEqual(shutdown, Why)
    end,
    %% what it is linked to is not who has started it
    {ok, Other} = starl_live_transport:start_link(?MODULE, config(#{}), self()),
    Other ! {'EXIT', spawn(fun() -> ok end), gone},
    ?assertEqual(closed, next()),
    receive
        {'EXIT', Other, Gone} -> ?assertEqual(gone, Gone)
    end,
    %% a link that crashes takes nothing with it that is not closed
    Test = self(),
    {Link, Monitor} = spawn_monitor(fun() ->
        {ok, _} = starl_live_transport:start_link(?MODULE, config(#{test => Test}), self()),
        exit(crashed)
    end),
    receive
        {'DOWN', Monitor, process, Link, Crashed} -> ?assertEqual(crashed, Crashed)
    end,
    ?assertEqual(closed, next()),
    Fails = fun(Given) ->
        {error, {shutdown, {transport, Line}}} = starl_live_transport:start_link(
            ?MODULE, config(Given), self()
        ),
        Line
    end,
    ?assertEqual(<<"no port">>, Fails(#{fails => ["no ", "port"]})),
    ?assertMatch(<<"air: loss: ", _/binary>>, Fails(#{air => #{loss => 2}})),
    process_flag(trap_exit, false),
    starl_platform_ct:forget().

%% A report of a crash shows no state, which holds the key.
its_state_is_hidden_test() ->
    with_transport(#{}, fun(Transport) ->
        {status, _, _, [_, _, _, _, Misc]} = sys:get_status(Transport),
        Shown = lists:flatten(io_lib:format("~p", [Misc])),
        ?assertNotEqual(nomatch, string:find(Shown, "hidden")),
        ?assertEqual(
            #{reason => x, log => []}, starl_live_transport:format_status(#{reason => x, log => []})
        ),
        ok
    end).

%% -- what each end knows of packets ------------------------------------------------------------------

%% What was sent, and to whom; what came, from whom, and what became of it.
each_packet_is_told_test() ->
    Test = self(),
    Tell = fun(Events) ->
        Test ! {told, Events},
        ok
    end,
    with_transport(#{tell => Tell}, fun(Transport) ->
        Packet = packet(1),
        {Brief, Bytes, Hash} = short(Packet),
        ok = starl_live_transport:transmit(Transport, all, Packet),
        {on_air, all, _} = next(),
        Sent = [{1000, 1, radio, {sent, To, Brief, Bytes, Hash}} || To <- [2, 3]],
        ?assertEqual({told, Sent}, next()),
        ok = starl_live_transport:transmit(Transport, 2, Packet),
        {on_air, 2, _} = next(),
        ?assertEqual({told, [hd(Sent)]}, next()),
        ok = starl_live_transport:transmit(Transport, 2, {no_packet, "b"}),
        ?assertMatch({told, [{1000, 1, radio, {packet, 2, _, _, {lost, refused}}}]}, next()),
        Came = fun(Air) ->
            ok = starl_live_transport:set_conditions(Transport, Air),
            Transport ! {air, [packet(2)]},
            receive
                {told, [{1000, 1, radio, {came, 2, _, _, _, Fate}}]} -> Fate
            end
        end,
        ?assertEqual({lost, chance}, Came(#{loss => 1})),
        ?assertEqual({lost, cut}, Came(#{loss => 0, cut => [2]})),
        {arrives, [{At, intact}]} = Came(#{cut => []}),
        {arrives, [{At2, intact}, {At3, intact}]} = Came(#{
            disturbed => #{2 => [{again, 1, 1}, {late, 1, {5, 5}}]}
        }),
        ?assert(At > 0 andalso At2 >= At + 5000 andalso At3 >= At2),
        %% what is no packet is nobody's
        Transport ! {air, [malformed]},
        _ = starl_live_transport:figures(Transport),
        ?assertEqual([], [Events || {told, Events} <- flushed()]),
        ok
    end).

short(Packet) ->
    {starl_packet:brief(Packet), erlang:external_size(Packet), erlang:phash2(Packet)}.

flushed() ->
    receive
        Message -> [Message | flushed()]
    after 0 -> []
    end.

%% A packet that is heard more than once is told with its times in their order.
what_comes_is_told_in_the_order_of_its_times_test() ->
    Test = self(),
    Tell = fun(Events) ->
        Test ! {told, Events},
        ok
    end,
    starl_platform_ct:forget(),
    Told = starl_live_packet_reports:new(config(#{tell => Tell})),
    ok = starl_live_packet_reports:came(2, packet(2), [5, 0, 1], false, Told),
    {told, [{1000, 1, radio, Came}]} = next(),
    ?assertEqual(
        {arrives, [{1000, intact}, {2000, intact}, {6000, intact}]},
        element(tuple_size(Came), Came)
    ),
    %% and nobody is told who does not want it
    ?assertEqual(none, starl_live_packet_reports:new(config(#{tell => none}))),
    ?assertEqual(none, starl_live_packet_reports:new(config(#{}))).

%% The sink is told if it asked for packets, the observer always; without either nobody is.
who_is_told_of_packets_test() ->
    Test = self(),
    Observer = fun(News) ->
        Test ! {observed, News},
        ok
    end,
    Teller = fun(Spec) -> starl_live_packet_reports:teller(Spec#{robot => 1}) end,
    ?assertEqual(none, Teller(#{sink => none})),
    ?assertEqual(none, Teller(#{sink => self()})),
    ?assertEqual(none, Teller(#{sink => none, packets => true})),
    starl_platform_ct:forget(),
    Told = fun(Spec) ->
        ok = (Teller(Spec))([event]),
        flushed()
    end,
    Observed = {observed, {judged, [event], []}},
    Sunk = {starl_radio, 1, [event]},
    ?assertEqual([Sunk], Told(#{sink => self(), packets => true})),
    ?assertEqual([Observed], Told(#{sink => self(), observe => Observer})),
    ?assertEqual([Observed], Told(#{sink => none, packets => true, observe => Observer})),
    ?assertEqual(
        [Sunk, Observed], Told(#{sink => self(), packets => true, observe => Observer})
    ).

%% -- counters -------------------------------------------------------------------------------------

figures_are_counted_test() ->
    ?assertEqual(
        #{a => 2, b => 5},
        starl_live_transport:count(a, starl_live_transport:count(b, 5, #{a => 1}))
    ).

%% Code that is not loaded would else make a robot deaf without a word.
an_unknown_atom_is_logged_once_test() ->
    Refuse = fun(Why, Figures) -> starl_live_transport:refused(Why, 3, Figures) end,
    Self = self(),
    Lines = starl_live_log_ct:lines(fun() ->
        Self ! {figures, lists:foldl(Refuse, #{}, [term, unknown_atom, unknown_atom])}
    end),
    ?assertMatch([<<"a packet of robot 3 bears an atom that is unknown here", _/binary>>], Lines),
    receive
        {figures, Figures} -> ?assertEqual(#{term => 1, unknown_atom => 2}, Figures)
    end,
    %% at once, not with the second
    ?assertMatch([_], starl_live_log_ct:lines(fun() -> Refuse(unknown_atom, #{}) end)).
