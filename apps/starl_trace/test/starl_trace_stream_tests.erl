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
        {6, 1, radio, {came, 2, {ping, 3}, 9, 77, {arrives, []}}}
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

%% -- where robots are -----------------------------------------------------------------------------

piece(At, X, V) -> {piece, At, X, 0.0, 0.0, V, 0.0}.

moves(At, Robot, Piece, Poses) ->
    starl_trace_poses:event({At, Robot, chassis, {motion, Piece}}, Poses).

sampled(Until, Poses) ->
    {Samples, Next} = starl_trace_poses:sample(Until, Poses),
    {
        [
            {At, Full, [{R, X} || {R, {X, _, _}, _, _} <- Robots]}
         || {poses, At, #{full := Full, robots := Robots}} <- Samples
        ],
        Next
    }.

%% Twenty times a second those that have changed, and once all; nothing of who stands still, but where it has
%% come to rest.
samples_of_motion_test() ->
    Both = moves(
        0, 1, piece(0, 0.0, 100.0), moves(0, 2, piece(0, 7.0, 0.0), starl_trace_poses:new())
    ),
    {First, Next} = sampled(150001, Both),
    ?assertEqual(
        [
            {0, true, [{1, 0.0}, {2, 7.0}]},
            {50000, false, [{1, 5.0}]},
            {100000, false, [{1, 10.0}]},
            {150000, false, [{1, 15.0}]}
        ],
        First
    ),
    ?assertEqual(200000, starl_trace_poses:due_us(Next)),
    ?assertEqual({[], Next}, sampled(200000, Next)),
    Stops = moves(220000, 1, piece(220000, 22.0, 0.0), Next),
    {Last, Rests} = sampled(3000001, Stops),
    ?assertEqual(
        [{200000, false, [{1, 20.0}]}, {250000, false, [{1, 22.0}]}] ++
            [{1000000 * S, true, [{1, 22.0}, {2, 7.0}]} || S <- [1, 2, 3]],
        Last
    ),
    ?assertEqual(4000000, starl_trace_poses:due_us(Rests)),
    %% who begins to move is shown at the next regular time
    Again = moves(3210000, 2, piece(3210000, 7.0, 10.0), Rests),
    ?assertEqual(3250000, starl_trace_poses:due_us(Again)).

%% A piece counts from its beginning, though it is known before; a new one replaces those that begin later.
a_piece_counts_from_its_beginning_test() ->
    Known = moves(
        0, 1, piece(100000, 50.0, 0.0), moves(0, 1, piece(0, 0.0, 0.0), starl_trace_poses:new())
    ),
    At = fun(Us, Poses) ->
        {poses, Us, #{full := true, robots := [{1, {X, _, _}, _, _}]}} = starl_trace_poses:full(
            Us, Poses
        ),
        X
    end,
    ?assertEqual([0.0, 0.0, 50.0], [At(Us, Known) || Us <- [0, 99999, 100000]]),
    Other = moves(0, 1, piece(100000, 9.0, 0.0), Known),
    ?assertEqual([0.0, 9.0], [At(Us, Other) || Us <- [99999, 100000]]),
    Sooner = moves(0, 1, piece(50000, 3.0, 0.0), Known),
    ?assertEqual([0.0, 3.0, 3.0], [At(Us, Sooner) || Us <- [49999, 50000, 100000]]),
    {_, Later} = starl_trace_poses:sample(200000, Known),
    ?assertEqual(50.0, At(200000, Later)).

%% The pen is part of a place; other events are not.
pens_are_shown_test() ->
    Poses = moves(0, 1, piece(0, 0.0, 0.0), starl_trace_poses:new()),
    Pen = fun(State) ->
        {poses, 0, #{robots := [{1, _, Shown, _}]}} = starl_trace_poses:full(
            0, starl_trace_poses:event({0, 1, chassis, {actuated, pen, State}}, Poses)
        ),
        Shown
    end,
    ?assertEqual([up, down, none], [Pen(State) || State <- [up, down, broken]]),
    Restored = starl_trace_poses:restore(130000, [
        {1, [piece(0, 4.0, 0.0)], down}, {2, [piece(0, 5.0, 0.0)], none}
    ]),
    ?assertEqual(100000, starl_trace_poses:due_us(Restored)),
    ?assertMatch(
        {poses, 130000, #{robots := [{1, {4.0, _, _}, down, _}, {2, {5.0, _, _}, none, _}]}},
        starl_trace_poses:full(130000, Restored)
    ).

%% Also late in a run the next sample is that of the last regular time.
samples_go_on_at_the_last_regular_time_test() ->
    Due = fun(At) -> starl_trace_poses:due_us(starl_trace_poses:restore(At, [])) end,
    ?assertEqual([0, 50000], [Due(At) || At <- [49999, 50000]]),
    ?assertEqual(
        [2_999_950_000, 3_000_000_000], [Due(At) || At <- [2_999_999_999, 3_000_000_000]]
    ).
