%% The messages of a run from its news: here of runs whose time does not begin at 0.
-module(starl_trace_stream_tests).
-include_lib("eunit/include/eunit.hrl").

%% Since 1970, us: the time of a robot on its own.
-define(LATE_US, 1795451471512345).

%% A robot that records itself told, with the first event, a sample for each second since 1970: its
%% recorder took all the memory of its computer and never came to an end.
late_robot_test() ->
    {[{scenario, ?LATE_US, _}], Begun} = news({begun, facts()}, starl_trace_stream:new()),
    {Started, Up} = news({started, ?LATE_US, 1, [app]}, Begun),
    ?assertEqual([], Started),
    {Events, Heard} = news({judged, [{?LATE_US + 100, 1, app, step}], []}, Up),
    ?assertEqual([{trace, ?LATE_US + 100, {1, app, step}}], Events),
    {Places, _} = news({seen, ?LATE_US + 200, 1, {1.0, 2.0, 0.0}}, Heard),
    ?assertMatch([{poses, _, #{robots := [{1, {1.0, 2.0, 0.0}, none, unknown}]}}], Places).

%% The first figures come when a second is over, not before the beginning.
times_never_go_back_test() ->
    {Head, Begun} = news({begun, facts()}, starl_trace_stream:new()),
    Trace = [{?LATE_US + N * 300000, 1, app, step} || N <- lists:seq(0, 9)],
    {Messages, _} = news({judged, Trace, []}, Begun),
    Times = [T || {_, T, _} <- Head ++ Messages],
    ?assertEqual(lists:sort(Times), Times),
    ?assertMatch([_, _, _], [T || {metrics, T, _} <- Messages]).

%% Reading it took as long as writing it.
late_recording_test() ->
    Unique = integer_to_list(erlang:unique_integer([positive])),
    File = filename:join("/tmp", "starl_late_" ++ os:getpid() ++ "_" ++ Unique ++ ".mcap"),
    {ok, Recorder} = starl_trace_recorder:start_link(File, live),
    Observer = starl_trace_recorder:observer(Recorder),
    ok = starl_observer:tell({begun, facts()}, Observer),
    ok = starl_observer:tell({judged, [{?LATE_US + 100, 1, app, step}], []}, Observer),
    {ok, #{until_us := Until}} = starl_trace_recorder:close(Recorder),
    ?assertEqual(?LATE_US + 100, Until),
    {ok, Read, closed} = starl_trace_reader:fold(fun(M, All) -> [M | All] end, [], File),
    ?assertMatch([{trace, _, {1, app, step}}, {scenario, _, _}], Read),
    {ok, Cursor} = starl_trace_reader:start(File, ?LATE_US + 50),
    ?assertMatch(
        {ok, [{scenario, _, _}, {trace, _, {1, app, step}}], _}, starl_trace_reader:next(Cursor)
    ),
    ok = starl_trace_reader:stop(Cursor),
    ok = file:delete(File).

%% Each piece of news becomes messages at its time.
what_is_told_becomes_messages_test() ->
    {_, Begun} = news({begun, (facts())#{begun_us := 0}}, starl_trace_stream:new()),
    Messages = fun(News) -> element(1, news(News, Begun)) end,
    Of = fun(Robot, Machine, Event) -> Messages({judged, [{7, Robot, Machine, Event}], []}) end,
    Packet = {packet, 2, {ping, 1}, 9, {lost, radio}},
    ?assertEqual([{packets, 7, {1, 2, {ping, 1}, 9, {lost, radio}}}], Of(1, radio, Packet)),
    Sent = {sent, 2, {ping, 1}, 9, 77},
    ?assertEqual([{ways, 7, {1, Sent}}], Of(1, radio, Sent)),
    ?assertEqual([{snapshots, 7, {1, {kept, x}}}], Of(1, snapshot, {kept, x})),
    Lines = fun(Robot, Machine, Event) ->
        [{trace, 7, {Robot, Machine, Event}} | Logs] = Of(Robot, Machine, Event),
        [{At, Level, R, lists:flatten(Line)} || {log, At, {Level, R, Line}} <- Logs]
    end,
    [
        ?assertEqual({Event, Line}, {Event, Lines(3, Machine, Event)})
     || {Machine, Event, Line} <- [
            {robot, down, [{7, warning, 3, "goes down"}]},
            {robot, up, [{7, info, 3, "is up again"}]},
            {robot, {died, "of old age"}, [{7, error, 3, "died: of old age"}]},
            {supervisor, {crashed, sap, {"bug", []}}, [{7, error, 3, "sap crashed: bug"}]},
            {supervisor, {given_up, sap}, [{7, error, 3, "sap is not started again"}]},
            {app, {done, 5}, [{7, info, 3, "done"}]},
            {app, down, []},
            {note, up, []}
        ]
    ],
    ?assertEqual([{log, 7, {info, 3, "line"}}], Messages({logged, 7, 3, info, "line"})),
    ?assertEqual([{gap, 7, no_end}], Messages({unjudged, 7, no_end})),
    ?assertEqual([{verdicts, 0, {violation, v}}], Messages({judged, [], [v]})).

%% Events, packets and violations are counted apart, and told each second in which something happens.
a_second_has_its_figures_test() ->
    {_, Begun} = news({begun, (facts())#{begun_us := 0}}, starl_trace_stream:new()),
    Lost = {lost, radio},
    Events = [
        {1, 1, note, said},
        {2, 1, radio, {packet, 2, {ping, 1}, 9, Lost}},
        {3, 1, radio, {packet, 2, {ping, 2}, 9, {arrives, []}}},
        {4, 1, radio, {sent, 2, {ping, 3}, 9, 77}},
        {5, 1, radio, {came, 2, {ping, 3}, 9, 77, Lost}},
        {6, 1, radio, {came, 2, {ping, 3}, 9, 77, {arrives, []}}},
        {7, 1, snapshot, {kept, x}}
    ],
    {_, Told} = news({judged, Events, [v, v]}, Begun),
    Metrics = fun(At) ->
        {Messages, _} = news({judged, [{At, 1, note, said}], []}, Told),
        [{Us, Counts} || {metrics, Us, Counts} <- Messages]
    end,
    Counts = #{events => 1, packets => 3, lost => 2, violations => 2},
    ?assertEqual([], Metrics(1000000)),
    %% the event that ends the second is told with the others, and counted
    ?assertEqual([{1000000, Counts#{events := 2}}], Metrics(1000001)),
    ?assertEqual([{4000000, Counts#{events := 2}}], Metrics(5000000)).

%% Faults begin and end at their times, or when they are told; one that is healed by hand ends once.
faults_are_told_at_their_times_test() ->
    Fault = {f1, 1, 3, loss, all, #{}},
    Endless = {f2, 2, forever, loss, all, #{}},
    Facts = (facts())#{begun_us := 0, scenario := #{faults => [Endless, Fault, odd]}},
    {_, Begun} = news({begun, Facts}, starl_trace_stream:new()),
    Faults = fun(Stream) ->
        {Messages, _} = news({judged, [{9000, 1, note, said}], []}, Stream),
        [{At, What} || {faults, At, What} <- Messages]
    end,
    ?assertEqual(
        [{1000, {began, Fault}}, {2000, {began, Endless}}, {3000, {ended, Fault}}], Faults(Begun)
    ),
    {[], Healed} = news({fault, 1500, {ended, Fault}}, Begun),
    ?assertEqual(
        [{1000, {began, Fault}}, {1500, {ended, Fault}}, {2000, {began, Endless}}], Faults(Healed)
    ),
    {_, Late} = news({judged, [{2500, 1, note, said}], []}, Begun),
    {[], Other} = news({fault, 1500, {began, {f3, 0, 9, loss, all, #{}}}}, Late),
    ?assertMatch([{2500, {began, {f3, _, _, _, _, _}}}, {3000, {ended, Fault}}], Faults(Other)).

%% A robot that starts anew, or whose recording ends, has gone down with its machines.
a_start_ends_the_one_before_test() ->
    {_, Begun} = news({begun, (facts())#{begun_us := 5}}, starl_trace_stream:new()),
    ?assertEqual({[], Begun}, starl_trace_stream:close(Begun)),
    {[], Up} = news({started, 5, 1, [sap, app]}, Begun),
    Down = [
        {trace, 5, {1, robot, down}},
        {log, 5, {warning, 1, "goes down"}},
        {trace, 5, {1, sap, crashed}},
        {trace, 5, {1, app, crashed}}
    ],
    ?assertMatch({Down, _}, news({started, 6, 1, [sap, app]}, Up)),
    {Down, Closed} = starl_trace_stream:close(Up),
    ?assertEqual({[], Closed}, starl_trace_stream:close(Closed)),
    %% the former recording of this robot ended while it was up
    {_, Was} = news({begun, (facts())#{begun_us := 5, was_up => true}}, starl_trace_stream:new()),
    ?assertMatch({Down, _}, news({started, 6, 1, [sap, app]}, Was)).

%% Places that a robot tells come at most every 50 ms; what comes late has the time of the last one.
places_of_a_robot_test() ->
    {_, Begun} = news({begun, (facts())#{begun_us := 0}}, starl_trace_stream:new()),
    {All, _} = lists:mapfoldl(
        fun(At, Stream) -> news({seen, At, 1, {1.0, 2.0, 0.0}}, Stream) end,
        Begun,
        [10, 50009, 50010, 100009, 100010]
    ),
    ?assertEqual(
        [10, 50010, 100010],
        [At || {poses, At, #{full := false}} <- lists:append(All)]
    ),
    {_, Told} = news({logged, 500, 1, info, "a"}, Begun),
    ?assertMatch({[{log, 500, {info, 1, "b"}}], _}, news({logged, 400, 1, info, "b"}, Told)),
    ?assertMatch(
        {[{trace, 500, {1, note, said}}], _}, news({judged, [{400, 1, note, said}], []}, Told)
    ).

%% Who has missed messages begins with the scenario and all places; the next file of a recording with the
%% scenario, which begins now.
a_new_reader_begins_with_the_state_test() ->
    ?assertEqual({[], []}, {
        starl_trace_stream:state(starl_trace_stream:new()),
        starl_trace_stream:head(starl_trace_stream:new())
    }),
    {[Scenario], Begun} = news({begun, (facts())#{was_up => true}}, starl_trace_stream:new()),
    Piece = {piece, ?LATE_US, 1.0, 2.0, 0.0, 0.0, 0.0},
    {_, Moved} = news(
        {judged, [{?LATE_US + 5, 1, chassis, {motion, Piece}}, {?LATE_US + 5, 1, note, said}], []},
        Begun
    ),
    ?assertEqual(
        [
            Scenario,
            {poses, ?LATE_US + 5, #{
                full => true, robots => [{1, {1.0, 2.0, 0.0}, none, {1.0, 2.0, 0.0}}]
            }}
        ],
        starl_trace_stream:state(Moved)
    ),
    [{scenario, Now, Head}] = starl_trace_stream:head(Moved),
    ?assertEqual({?LATE_US + 5, ?LATE_US + 5}, {Now, maps:get(begun_us, Head)}),
    ?assertNot(is_map_key(was_up, Head)),
    ?assertMatch(#{versions := #{starl := [_ | _], otp := [_ | _]}}, Head).

news(News, Stream) -> starl_trace_stream:news(News, Stream).

facts() ->
    #{
        kind => live,
        app => loop,
        scenario => #{app => loop},
        robots => [{1, {0.0, 0.0, 0.0}}],
        monitors => [],
        waypoints => #{},
        machines => #{app => starl_app_proc},
        epoch_us => 0,
        begun_us => ?LATE_US,
        told_by => [1]
    }.
