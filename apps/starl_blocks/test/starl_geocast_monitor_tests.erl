%% The contract of the geocast, clause by clause: traces that keep it, traces that break it, and
%% what is excused where an assumption is broken, just inside of it and not just outside; and
%% the areas. Robot 1 stands at the origin, robot 2 drives along the x axis at 1000 mm/s from
%% x = 5000 on, away; the area reaches to x = 1000.
-module(starl_geocast_monitor_tests).
-include_lib("eunit/include/eunit.hrl").

-define(ID, {1, 1, 1}).
-define(AREA, {circle, {0.0, 0.0}, 1000.0}).

judge(Events) -> judge(Events, true).

judge(Events, Progress) -> judge(Events, Progress, []).

judge(Events, Progress, Broken) -> judge(Events, Progress, Broken, #{}).

judge(Events, Progress, Broken, More) ->
    Config = More#{robots => [1, 2], progress => Progress, broken => Broken, drift_ppm => 0},
    Moves = [
        {0, 1, chassis, {motion, {piece, 0, 0.0, 0.0, 0.0, 0.0, 0.0}}},
        {0, 2, chassis, {motion, {piece, 0, 5000.0, 0.0, 0.0, 1000.0, 0.0}}}
    ],
    M0 = starl_monitor:new([{starl_geocast_monitor, Config}]),
    {Found, M} = lists:foldl(
        fun(Event, {Acc, Monitor}) ->
            case starl_monitor:step(Event, Monitor) of
                {ok, Next} -> {Acc, Next};
                {violation, V, Next} -> {Acc ++ [V], Next}
            end
        end,
        {[], M0},
        Moves ++ lists:flatten(Events)
    ),
    {Late, _} = starl_monitor:finish(100000000, M),
    [What || #{what := What} <- Found ++ Late].

sent() -> {10, 1, geocast, {sent, ?ID, ?AREA, 1000000, 77}}.
delivered(T, Robot) -> {T, Robot, geocast, {delivered, ?ID, 77}}.
held(T, Robot, From) -> {T, Robot, geocast, {held, ?ID, From}}.
crashed(T, Robot) -> {T, Robot, geocast, crashed}.

kept_test() -> ?assertEqual([], judge([sent(), delivered(20, 1)])).
at_the_very_end_test() -> ?assertEqual([], judge([sent(), delivered(1000010, 1)])).
too_late_test() -> ?assertEqual([too_late], judge([sent(), delivered(1000011, 1)], false)).
twice_test() -> ?assertEqual([delivered_twice], judge([sent(), delivered(2, 1), delivered(3, 1)])).
changed_test() ->
    ?assertEqual([changed], judge([sent(), {20, 1, geocast, {delivered, ?ID, 78}}])).
never_sent_test() -> ?assertEqual([never_sent], judge([delivered(2, 1)])).
outside_test() -> ?assertEqual([outside], judge([sent(), delivered(20, 1), delivered(30, 2)])).
%% Who was inside until shortly before the end may get it at the very end.
left_before_the_end_test() ->
    Back = {500, 2, chassis, {motion, {piece, 500, 500.0, 0.0, 0.0, 0.0, 0.0}}},
    Away = {600000, 2, chassis, {motion, {piece, 600000, 5000.0, 0.0, 0.0, 0.0, 0.0}}},
    ?assertEqual([], judge([sent(), Back, Away, delivered(1000010, 2)], false)).

%% It is told of a window by the first event after it.
told_at_the_next_event_test() ->
    M0 = starl_geocast_monitor:init(#{robots => [1], progress => true, drift_ppm => 0}),
    Here = {0, 1, chassis, {motion, {piece, 0, 0.0, 0.0, 0.0, 0.0, 0.0}}},
    {ok, M1} = starl_geocast_monitor:step(Here, M0),
    {ok, M2} = starl_geocast_monitor:step(sent(), M1),
    Next = fun(T) -> starl_geocast_monitor:step({T, 1, robot, up}, M2) end,
    ?assertMatch({ok, _}, Next(1000010)),
    ?assertMatch({violation, #{what := not_delivered, at_us := 1000010}, _}, Next(1000011)).

%% Who is not said to listen delivers nothing outside either.
stranger_outside_test() ->
    Stands = {0, 3, chassis, {motion, {piece, 0, 5000.0, 0.0, 0.0, 0.0, 0.0}}},
    ?assertEqual([outside], judge([Stands, sent(), delivered(20, 1), delivered(30, 3)])).
not_delivered_test() -> ?assertEqual([not_delivered], judge([sent()])).
safety_only_test() -> ?assertEqual([], judge([sent()], false)).
crashed_in_the_window_test() -> ?assertEqual([], judge([sent(), crashed(500, 1)])).
crashed_long_before_test() ->
    Sent = {9000000, 1, geocast, {sent, ?ID, ?AREA, 1000000, 77}},
    ?assertEqual([not_delivered], judge([crashed(5, 1), Sent])).
twice_after_a_restart_test() ->
    ?assertEqual(
        [delivered_twice],
        judge([sent(), delivered(20, 1), crashed(30, 1), delivered(40, 1)])
    ).
died_test() -> ?assertEqual([], judge([sent(), {500, 1, robot, {died, killed}}])).

%% Inside for an instant between two events: no violation; and no debt for who leaves again.
comes_by_test() ->
    Back = {100, 2, chassis, {motion, {piece, 100, 1200.0, 0.0, 0.0, -1000.0, 0.0}}},
    Away = {500000, 2, chassis, {motion, {piece, 500000, 5000.0, 0.0, 0.0, 0.0, 0.0}}},
    ?assertEqual([], judge([sent(), delivered(20, 1), Back, Away])),
    ?assertEqual([], judge([sent(), delivered(20, 1), Back, delivered(400000, 2), Away])).

%% One that lives for less than two waits for others that ask for it is owed to nobody.
least_test() ->
    Lives = fun(Us) -> judge([{10, 1, geocast, {sent, ?ID, ?AREA, Us, 77}}]) end,
    ?assertEqual([[], [not_delivered]], [Lives(Us) || Us <- [6000, 6001]]).

%% The end of the window belongs to it.
comes_at_the_end_test() ->
    Comes = fun(T) -> {T, 2, chassis, {motion, {piece, T, 0.0, 0.0, 0.0, 0.0, 0.0}}} end,
    [
        ?assertEqual(Found, judge([sent(), delivered(20, 1), delivered(30, 2), Comes(T)]))
     || {T, Found} <- [{1000010, []}, {1000011, [outside]}]
    ].

%% -- excused ----------------------------------------------------------------------------------

-define(END, 1000010).

lost(Robot, At, Us) -> {Robot, At, At, {clock, -Us}}.
gained(Robot, At, Us) -> {Robot, At, At, {clock, Us}}.

%% The message goes from 1 over 3 to 2, which drives into the area late; 4 has it, too.
chain() -> [sent(), held(200, 3, 1), held(300, 4, 1), held(400, 2, 3)].

back() -> {500, 2, chassis, {motion, {piece, 500, 500.0, 0.0, 0.0, 0.0, 0.0}}}.

%% Late by what the clocks on the way have lost, each while the deadline was in its hands.
late_test() ->
    Late = fun(Us) -> [chain(), back(), delivered(?END + Us, 2)] end,
    ?assertEqual([too_late], judge(Late(1), false)),
    [
        begin
            ?assertEqual({Window, []}, {Window, judge(Late(50), false, [Window])}),
            ?assertEqual({Window, [too_late]}, {Window, judge(Late(51), false, [Window])})
        end
     || Window <- [
            lost(1, 10, 50),
            lost(1, 200, 50),
            lost(3, 10, 50),
            lost(3, 400, 50),
            lost(2, 200, 50),
            lost(2, ?END, 50),
            lost(all, 600, 50),
            {3, 350, 450, {clock, -100}}
        ]
    ],
    [
        ?assertEqual({Window, [too_late]}, {Window, judge(Late(50), false, [Window])})
     || Window <- [
            lost(1, 201, 50),
            lost(3, 401, 50),
            lost(2, 199, 50),
            lost(4, 350, 50),
            gained(3, 300, 50),
            lost(3, 9, 50),
            lost(2, ?END + 51, 50),
            lost(5, 300, 50),
            {3, 300, 300, position},
            {2, 0, 2 * ?END, pause}
        ]
    ],
    Both = [lost(1, 100, 30), lost(2, 500, 20)],
    ?assertEqual([], judge(Late(50), false, Both)),
    ?assertEqual([too_late], judge(Late(51), false, Both)).

%% One that is late and excused must be inside then, or have been a moment ago.
late_elsewhere_test() ->
    Slow = [lost(2, 600, 2000000)],
    Away = fun(T) -> {T, 2, chassis, {motion, {piece, T, 5000.0, 0.0, 0.0, 0.0, 0.0}}} end,
    Late = fun(T) -> [chain(), back(), Away(?END), delivered(T, 2)] end,
    ?assertEqual([], judge(Late(?END + 99999), false, Slow)),
    ?assertEqual([outside], judge(Late(?END + 100000), false, Slow)),
    Swapped = {2, ?END, ?END + 2, position},
    ?assertEqual([], judge(Late(?END + 100001), false, [Swapped | Slow])),
    ?assertEqual([outside], judge(Late(?END + 100002), false, [Swapped | Slow])).

%% Once more after a restart: sent before it by no more than clocks explain.
twice_test_() ->
    Twice = [
        sent(),
        delivered(20, 1),
        held(25, 3, 1),
        crashed(30, 1),
        held(40, 1, 3),
        delivered(50, 1)
    ],
    Judge = fun(Windows) -> judge(Twice, false, Windows) end,
    [
        ?_assertEqual([delivered_twice], Judge([])),
        %% the robot's own clock since the restart; it was sent 20 before that
        ?_assertEqual([], Judge([gained(1, 30, 20)])),
        ?_assertEqual([], Judge([gained(1, 50, 20)])),
        ?_assertEqual([delivered_twice], Judge([gained(1, 30, 19)])),
        ?_assertEqual([delivered_twice], Judge([gained(1, 29, 20)])),
        ?_assertEqual([delivered_twice], Judge([gained(1, 51, 20)])),
        ?_assertEqual([delivered_twice], Judge([lost(1, 35, 20)])),
        ?_assertEqual([delivered_twice], Judge([gained(3, 35, 20)])),
        %% the clock of the one that it has it from
        ?_assertEqual([], Judge([lost(3, 40, 20)])),
        ?_assertEqual([delivered_twice], Judge([lost(3, 41, 20)])),
        ?_assertEqual([delivered_twice], Judge([lost(3, 40, 19)])),
        ?_assertEqual([], Judge([lost(3, 35, 11), gained(1, 35, 9)])),
        %% its own, as long as it gave the message to the others
        ?_assertEqual([], Judge([lost(1, 25, 20)])),
        ?_assertEqual([delivered_twice], Judge([lost(1, 26, 20)])),
        %% without a restart in between nothing is an excuse
        ?_assertEqual(
            [delivered_twice],
            judge(
                [sent(), crashed(15, 1), delivered(20, 1), delivered(50, 1)],
                false,
                [lost(all, 35, 1000), gained(all, 35, 1000)]
            )
        )
    ].

%% A robot outside that was told a wrong position when it was delivered.
outside_excused_test() ->
    Judge = fun(Window) -> judge([sent(), delivered(200000, 2)], false, [Window]) end,
    [
        ?assertEqual({Window, Found}, {Window, Judge(Window)})
     || {Window, Found} <- [
            {{2, 200000, 300000, position}, []},
            {{2, 0, 100001, position}, []},
            {{all, 0, 300000, position}, []},
            {{2, 0, 100000, position}, [outside]},
            {{2, 200001, 300000, position}, [outside]},
            {{1, 0, 300000, position}, [outside]},
            {{2, 0, 300000, pause}, [outside]},
            {{2, 0, 300000, {clock, -300000}}, [outside]}
        ]
    ].

%% Clocks drift by 1 %, unless it is said otherwise: so long it takes to make up for what was lost.
usual_drift_test() ->
    Late = fun(Us) ->
        Config = #{robots => [1], broken => [lost(1, 100, 990000)]},
        M0 = starl_monitor:new([{starl_geocast_monitor, Config}]),
        Here = {0, 1, chassis, {motion, {piece, 0, 0.0, 0.0, 0.0, 0.0, 0.0}}},
        starl_monitor:step([Here, sent(), delivered(?END + Us, 1)], M0)
    end,
    ?assertMatch({ok, _}, Late(1000000)),
    ?assertMatch({violation, #{what := too_late}, _}, Late(1000001)).

%% Each delivery needs its own excuse.
outside_twice_test() ->
    Twice = [sent(), delivered(200000, 2), crashed(300000, 2), delivered(400000, 2)],
    Judge = fun(To) -> judge(Twice, false, [{2, 150000, To, position}]) end,
    ?assertEqual([delivered_twice], Judge(500000)),
    ?assertEqual([delivered_twice, outside], Judge(250000)).

%% The clauses that hold under every fault.
always_test() ->
    Broken = [{all, 0, 2 * ?END, W} || W <- [pause, {clock, -?END}, {clock, ?END}, position]],
    ?assertEqual([never_sent], judge([delivered(2, 1)], false, Broken)),
    Twice = [sent(), delivered(20, 1), delivered(30, 1)],
    ?assertEqual([delivered_twice], judge(Twice, false, Broken)),
    ?assertEqual([changed], judge([sent(), {20, 1, geocast, {delivered, ?ID, 78}}], false, Broken)).

%% Owed, unless somebody's assumption is broken meanwhile.
progress_excused_test() ->
    ?assertEqual([not_delivered], judge([sent()], true, [{3, 0, 9, pause}])),
    ?assertEqual([not_delivered], judge([sent()], true, [gained(3, ?END + 1, 5)])),
    ?assertEqual([], judge([sent()], true, [gained(3, ?END, 5)])).

%% Nothing is owed of a message that ends before packets could carry it, or was sent too early.
lives_long_enough_test() ->
    Judge = fun(Config) -> judge([sent()], true, [], Config) end,
    %% five delays and twice the gathering, and more
    ?assertEqual([not_delivered], Judge(#{delay_us => 198799})),
    ?assertEqual([], Judge(#{delay_us => 198800})),
    ?assertEqual([not_delivered], Judge(#{healed_us => 10})),
    ?assertEqual([], Judge(#{healed_us => 11})),
    ?assertEqual([], Judge(#{healed_us => never})).

%% A robot delivers what was surely sent after its machine began: not as long as its clock, that
%% was set back, shows less than then; and nothing is owed so shortly after a reboot, either.
sent_after_the_beginning_test() ->
    Sent = fun(T) -> {T, 1, geocast, {sent, ?ID, ?AREA, 1000000, 77}} end,
    Got = fun(T) -> {T + 20, 1, geocast, {delivered, ?ID, 77}} end,
    Here = {2, 2, chassis, {motion, {piece, 2, 500.0, 0.0, 0.0, 0.0, 0.0}}},
    Judge = fun(Began, T, Windows) -> judge([Here, Began, Sent(T), Got(T)], true, Windows) end,
    Up = {5, 2, robot, up},
    ?assertEqual([], Judge(Up, 1000005, [])),
    ?assertEqual([not_delivered], Judge(Up, 1000006, [])),
    Crashed = crashed(5, 2),
    Back = [lost(2, 700, 300)],
    ?assertEqual([], Judge(Crashed, 1000305, Back)),
    ?assertEqual([not_delivered], Judge(Crashed, 1000306, Back)),
    %% what the clock lost before, or another one, or gained, makes no difference
    [
        ?assertEqual({Other, [not_delivered]}, {Other, Judge(Crashed, 1000100, [Other])})
     || Other <- [lost(2, 4, 300), lost(1, 700, 300), gained(2, 700, 300)]
    ],
    %% the source's clock has no say in it
    ?assertEqual([not_delivered], Judge(crashed(5, 1), 1000100, [lost(1, 700, 300)])).

%% -- what is told -----------------------------------------------------------------------------

%% The violations in full but for the contract, and the results.
told(Events, Config) ->
    Moves = [
        {0, 1, chassis, {motion, {piece, 0, 0.0, 0.0, 0.0, 0.0, 0.0}}},
        {0, 2, chassis, {motion, {piece, 0, 5000.0, 0.0, 0.0, 1000.0, 0.0}}}
    ],
    Known = maps:merge(#{robots => [1, 2], progress => true, drift_ppm => 0}, Config),
    M0 = starl_monitor:new([{starl_geocast_monitor, Known}]),
    {Found, M} = lists:foldl(
        fun(Event, {Acc, Monitor}) ->
            case starl_monitor:step(Event, Monitor) of
                {ok, Next} -> {Acc, Next};
                {violation, V, Next} -> {Acc ++ [V], Next}
            end
        end,
        {[], M0},
        Moves ++ lists:flatten(Events)
    ),
    {Late, #{starl_geocast_monitor := Results}} = starl_monitor:finish(100000000, M),
    {[in_full(Violation) || Violation <- Found ++ Late], Results}.

in_full(#{contract := geocast, what := What, at_us := At, robots := Robots, details := Details}) ->
    {What, At, Robots, Details}.

told(Events) -> element(1, told(Events, #{progress => false})).

%% What broke, when, at which robot, and of which message.
violations_in_full_test() ->
    Of = #{id => ?ID},
    ?assertEqual([{never_sent, 7, [2], Of}], told([delivered(7, 2)])),
    Twice = [sent(), delivered(20, 1), delivered(30, 1)],
    ?assertEqual([{delivered_twice, 30, [1], Of}], told(Twice)),
    ?assertEqual([{changed, 20, [1], Of}], told([sent(), {20, 1, geocast, {delivered, ?ID, 78}}])),
    ?assertEqual(
        [{too_late, ?END + 3, [1], Of#{late_us => 3}}], told([sent(), delivered(?END + 3, 1)])
    ),
    ?assertEqual([{outside, 30, [2], Of}], told([sent(), delivered(30, 2)])),
    ?assertMatch({[{not_delivered, ?END, [1], Of}], _}, told([sent()], #{})).

%% Each delivery counts once per robot; what was owed to whom, and the longest time that one took.
results_test() ->
    Results = fun(Events) -> element(2, told(Events, #{})) end,
    None = #{sent => 0, delivered => 0, owed => 0, latency_us => 0},
    ?assertEqual(None, Results([])),
    ?assertEqual(None#{sent => 1, owed => 1}, Results([sent()])),
    Met = None#{sent => 1, delivered => 1, owed => 1, latency_us => 20},
    ?assertEqual(Met, Results([sent(), delivered(30, 1)])),
    Near = {5, 2, chassis, {motion, {piece, 5, 500.0, 0.0, 0.0, 0.0, 0.0}}},
    Second = {50, 2, geocast, {sent, {2, 1, 1}, ?AREA, 1000000, 77}},
    ?assertEqual(
        #{sent => 2, delivered => 3, owed => 4, latency_us => 90},
        Results([
            Near,
            sent(),
            delivered(30, 2),
            Second,
            delivered(100, 1),
            {60 + 60, 1, geocast, {delivered, {2, 1, 1}, 77}}
        ])
    ).

%% -- what is owed -----------------------------------------------------------------------------

owed(Events) -> owed(Events, #{}).

owed(Events, Config) ->
    {_, #{owed := Owed}} = told(Events, Config),
    Owed.

%% What was sent before the last fault was over is owed to nobody.
healed_test() ->
    ?assertEqual(1, owed([sent()], #{healed_us => 10})),
    ?assertEqual(0, owed([sent()], #{healed_us => 11})),
    ?assertEqual(0, owed([sent()], #{healed_us => never})).

%% At the border by the margin, during the whole window.
margin_test() ->
    At = fun(X) -> {5, 2, chassis, {motion, {piece, 5, X, 0.0, 0.0, 0.0, 0.0}}} end,
    ?assertEqual(2, owed([At(996.0), sent()])),
    ?assertEqual(1, owed([At(997.0), sent()])),
    ?assertEqual(2, owed([At(997.0), sent()], #{margin_mm => 2.0})),
    ?assertEqual(1, owed([At(1010.0), sent()])),
    Leaves = {?END - 1, 2, chassis, {motion, {piece, ?END - 1, 5000.0, 0.0, 0.0, 0.0, 0.0}}},
    ?assertEqual(1, owed([At(500.0), sent(), Leaves])),
    Comes = fun(T) -> {T, 2, chassis, {motion, {piece, T, 500.0, 0.0, 0.0, 0.0, 0.0}}} end,
    ?assertEqual(1, owed([sent(), Comes(11)])),
    ?assertEqual(2, owed([Comes(10), sent()])),
    Gone = {?END + 1, 2, chassis, {motion, {piece, ?END + 1, 5000.0, 0.0, 0.0, 0.0, 0.0}}},
    ?assertEqual(2, owed([At(500.0), sent(), Gone])),
    %% also where it was said before that it would begin
    ?assertEqual(2, owed([At(500.0), sent(), setelement(1, Gone, 500000)])).

%% A robot whose place is not known is owed nothing, and is not outside either.
unknown_place_test() ->
    ?assertEqual(1, owed([sent()], #{robots => [1, 3]})),
    ?assertEqual([], told([sent(), delivered(20, 3)])).

%% The machine of the robot, or of the source, crashed up to the grace before, or in the window.
crashes_test() ->
    Sent = {2000000, 1, geocast, {sent, ?ID, ?AREA, 1000000, 77}},
    Near = {5, 2, chassis, {motion, {piece, 5, 500.0, 0.0, 0.0, 0.0, 0.0}}},
    Crash = fun(T, Robot) -> owed([Near, crashed(T, Robot), Sent]) end,
    ?assertEqual(2, Crash(999999, 2)),
    ?assertEqual(1, Crash(1000000, 2)),
    ?assertEqual(1, Crash(1999999, 2)),
    ?assertEqual(2, Crash(999999, 1)),
    ?assertEqual(0, Crash(1000000, 1)),
    ?assertEqual(1, owed([Near, Sent, crashed(3000000, 2)])),
    ?assertEqual(2, owed([Near, Sent, crashed(3000001, 2)])),
    ?assertEqual(2, owed([Near, crashed(1999990, 2), Sent], #{grace_us => 9})),
    ?assertEqual(1, owed([Near, crashed(1999990, 2), Sent], #{grace_us => 10})).

%% Who died is owed nothing, and owes nothing, whenever it was.
deaths_test() ->
    Near = {5, 2, chassis, {motion, {piece, 5, 500.0, 0.0, 0.0, 0.0, 0.0}}},
    Died = fun(Robot) -> {9, Robot, robot, {died, killed}} end,
    ?assertEqual(2, owed([Near, sent()])),
    ?assertEqual(1, owed([Near, Died(2), sent()])),
    ?assertEqual(0, owed([Near, Died(1), sent()])),
    ?assertEqual(2, owed([Near, Died(3), sent()])).

%% Windows end on their own, each for its message; what lay before them is not needed any more.
two_messages_test() ->
    Second = {500000, 1, geocast, {sent, {1, 1, 2}, ?AREA, 200000, 78}},
    {Told, #{owed := 2}} = told([sent(), Second], #{}),
    ?assertEqual(
        [
            {not_delivered, 700000, [1], #{id => {1, 1, 2}}},
            {not_delivered, ?END, [1], #{id => ?ID}}
        ],
        Told
    ).

%% -- areas ----------------------------------------------------------------------------------

%% A notch is cut into the square from above: (5, 8) lies in the notch.
notched() ->
    {polygon, [{0.0, 0.0}, {10.0, 0.0}, {10.0, 10.0}, {5.0, 5.0}, {0.0, 10.0}]}.

depth_test_() ->
    [
        ?_assert(abs(Depth - starl_geocast_area:depth(Point, Area)) < 1.0e-9)
     || {Point, Area, Depth} <- [
            {{0.0, 0.0}, {circle, {3.0, 4.0}, 6.0}, 1.0},
            {{0.0, 0.0}, {circle, {3.0, 4.0}, 4.0}, -1.0},
            {{2.0, 5.0}, {rectangle, {0.0, 0.0, 10.0, 10.0}}, 2.0},
            {{-3.0, -4.0}, {rectangle, {0.0, 0.0, 10.0, 10.0}}, -5.0},
            {{5.0, 2.0}, notched(), 2.0},
            {{5.0, 8.0}, notched(), -3 / math:sqrt(2)},
            %% on the height of a corner, inside and outside
            {{9.0, 5.0}, notched(), 1.0},
            {{-1.0, 5.0}, notched(), -1.0},
            {{12.0, 10.0}, notched(), -2.0}
        ]
    ].

border_belongs_test() ->
    ?assert(starl_geocast_area:inside({10.0, 5.0}, notched())),
    ?assert(starl_geocast_area:inside({10.0, 5.0}, {rectangle, {0.0, 0.0, 10.0, 10.0}})),
    ?assertNot(starl_geocast_area:inside({10.001, 5.0}, {rectangle, {0.0, 0.0, 10.0, 10.0}})).

%% A straight path that cuts a corner of the notch, and an arc that leaves and comes back.
every_instant_test() ->
    Across = starl_trajectory:piece(0, {1.0, 8.0}, 0.0, 8.0, 0.0),
    ?assertNot(starl_geocast_area:keeps_inside(Across, 0, 1000000, notched(), 0.0)),
    ?assert(starl_geocast_area:keeps_inside(Across, 0, 50000, notched(), 0.0)),
    Turn = starl_trajectory:piece(0, {100.0, 0.0}, math:pi() / 2, 200.0 * math:pi(), 2 * math:pi()),
    Disc = {circle, {0.0, 0.0}, 100.1},
    ?assert(starl_geocast_area:keeps_inside(Turn, 0, 1000000, Disc, 0.0)),
    ?assertNot(starl_geocast_area:keeps_inside(Turn, 0, 1000000, Disc, 1.0)),
    ?assert(starl_geocast_area:keeps_outside(Turn, 0, 1000000, {circle, {0.0, 0.0}, 99.0})),
    ?assertNot(starl_geocast_area:keeps_outside(Turn, 0, 1000000, {circle, {-100.0, 0.0}, 1.0})).

check_test_() ->
    [
        ?_assertEqual({error, Reason}, starl_geocast_area:check(Area))
     || {Area, Reason} <- [
            {{circle, {0.0, 0.0}, -1.0}, negative_radius},
            {{rectangle, {1.0, 0.0, 0.0, 1.0}}, upside_down},
            {{polygon, [{0.0, 0.0}]}, too_few_points},
            {{polygon, [{0, 0}, {1, 1}, {2, 2}]}, not_an_area},
            {nonsense, not_an_area}
        ]
    ] ++ [?_assertEqual(ok, starl_geocast_area:check(notched()))].

%% Events of its machines that the contract says nothing of are none of its business.
other_events_test() ->
    M = starl_geocast_monitor:init(#{robots => [1], progress => true, drift_ppm => 0}),
    [
        ?assertEqual({ok, M}, starl_geocast_monitor:step({0, 1, Machine, Event}, M))
     || {Machine, Event} <- [{geocast, {malformed, 2}}, {robot, {started, geocast}}]
    ].

%% -- a radio that loses packets ---------------------------------------------------------------

%% Robot 2 stands inside from the beginning; the N-th message of robot 1 lives one second; who has each.
lossy(Loss, Messages) ->
    Stands = {1, 2, chassis, {motion, {piece, 1, 500.0, 0.0, 0.0, 0.0, 0.0}}},
    Events = [
        message(10000000 * N, {1, 1, N}, Has)
     || {N, Has} <- lists:enumerate(Messages)
    ],
    Config = #{robots => [1, 2], progress => true, drift_ppm => 0, loss => Loss},
    Here = {0, 1, chassis, {motion, {piece, 0, 0.0, 0.0, 0.0, 0.0, 0.0}}},
    M0 = starl_monitor:new([{starl_geocast_monitor, Config}]),
    {Found, M} = lists:foldl(
        fun(Event, {Acc, Monitor}) ->
            case starl_monitor:step(Event, Monitor) of
                {ok, Next} -> {Acc, Next};
                {violation, #{what := What}, Next} -> {Acc ++ [What], Next}
            end
        end,
        {[], M0},
        [Here, Stands | lists:append(Events)]
    ),
    {Late, #{starl_geocast_monitor := Results}} = starl_monitor:finish(90000000000, M),
    {Found ++ [What || #{what := What} <- Late], maps:is_key(unjudged, Results)}.

message(T, Id, Has) ->
    Own = [
        {T, 1, geocast, {sent, Id, ?AREA, 1000000, 77}},
        {T + 1, 1, geocast, {delivered, Id, 77}}
    ],
    Held = {T + 500, 2, geocast, {held, Id, 1}},
    case Has of
        nothing -> Own;
        held -> Own ++ [Held];
        full -> Own ++ [{T + 500, 2, geocast, {full, Id}}];
        all -> Own ++ [Held, {T + 501, 2, geocast, {delivered, Id, 77}}]
    end.

%% One second: offers at 0, 50, 150, 350 and 750 ms, each of which leads to nothing with 1 - 0.9^3, 1 - 0.7^3, and so on.
rows_of_missed_messages_test() ->
    Missed = fun(N) -> lists:duplicate(N, nothing) end,
    ?assertEqual({[not_delivered], false}, lossy(0, Missed(1))),
    ?assertEqual({[], true}, lossy(0.1, Missed(3))),
    ?assertEqual({[not_delivered], false}, lossy(0.1, Missed(4))),
    ?assertEqual({[], true}, lossy(0.3, Missed(9))),
    ?assertEqual({[not_delivered], false}, lossy(0.3, Missed(10))),
    %% its own messages tell nothing of what robot 1 hears, another message of robot 1 ends the row
    ?assertEqual({[], false}, lossy(0.3, Missed(9) ++ [all] ++ Missed(9))).

%% Chance takes nothing that a robot has; who is full has no row.
what_a_robot_has_test() ->
    ?assertEqual({[not_delivered], false}, lossy(0.3, [held])),
    ?assertEqual({[], false}, lossy(0.3, lists:duplicate(50, full))).

lifetimes_test() ->
    Offers = fun(Us) -> starl_geocast_lifetime:offers(Us, 10000, {50000, 1000000}) end,
    ?assertEqual([0, 1, 1, 2, 3], [Offers(Us) || Us <- [39999, 40000, 89999, 90000, 190000]]),
    ?assertEqual(1.0, starl_geocast_lifetime:missed(0.3, 0)),
    ?assertEqual(0.0, starl_geocast_lifetime:missed(0, 1)),
    ?assert(abs(starl_geocast_lifetime:missed(0.5, 2) - 0.875 * 0.875) < 1.0e-9).
