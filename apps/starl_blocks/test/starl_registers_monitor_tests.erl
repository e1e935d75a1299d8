%% The contract of the shared registers, clause by clause; and the hybrid logical clock.
-module(starl_registers_monitor_tests).
-include_lib("eunit/include/eunit.hrl").

judge(Events) ->
    Config = #{robots => [1, 2], owners => #{mine => 1}, bound_us => 1000},
    M0 = starl_monitor:new([{starl_registers_monitor, Config}]),
    {Found, M} = lists:foldl(
        fun({T, Robot, What}, {Acc, Monitor}) ->
            Machine =
                case What of
                    {died, _} -> robot;
                    _ -> registers
                end,
            case starl_monitor:step({T, Robot, Machine, What}, Monitor) of
                {ok, Next} -> {Acc, Next};
                {violation, V, Next} -> {Acc ++ [V], Next}
            end
        end,
        {[], M0},
        Events
    ),
    {Late, _} = starl_monitor:finish(9000, M),
    [What || #{what := What} <- Found ++ Late].

s(T, Robot) -> {T, 0, Robot}.
put(T, Robot, Name) -> {T, Robot, {put, Name, T, s(T, Robot)}}.
holds(T, Robot, Name, Stamp) -> {T, Robot, {holds, Name, Stamp}}.
got(T, Robot, Name, Hash, Stamp) -> {T, Robot, {got, Name, Hash, Stamp}}.
agreed(Name, Stamp) -> [holds(900, 1, Name, Stamp), holds(900, 2, Name, Stamp)].

kept_test() ->
    ?assertEqual([], judge([put(5, 1, x), got(6, 2, x, 5, s(5, 1)) | agreed(x, s(5, 1))])).
never_written_test() ->
    ?assertEqual(
        [never_written, never_written],
        judge([
            put(5, 1, x),
            got(6, 2, x, 4, s(5, 1)),
            got(7, 1, x, 5, s(6, 1))
            | agreed(x, s(5, 1))
        ])
    ).
read_goes_back_test() ->
    Writes = [put(5, 1, x), put(6, 2, x), got(7, 1, x, 6, s(6, 2))],
    ?assertEqual(
        [read_goes_back], judge(Writes ++ [got(8, 1, x, 5, s(5, 1)) | agreed(x, s(6, 2))])
    ),
    ?assertEqual([read_goes_back], judge(Writes ++ [{8, 1, {got, x, unset}} | agreed(x, s(6, 2))])),
    ?assertEqual([], judge(Writes ++ [got(8, 2, x, 5, s(5, 1)) | agreed(x, s(6, 2))])),
    ?assertEqual(
        [], judge(Writes ++ [{8, 1, crashed}, {9, 1, {got, x, unset}} | agreed(x, s(6, 2))])
    ).
stamp_goes_back_test() ->
    Late = {7, 1, {put, x, 7, s(4, 1)}},
    ?assertEqual(
        [stamp_goes_back], judge([put(5, 1, x), {6, 1, crashed}, Late | agreed(x, s(5, 1))])
    ).
stamp_of_another_test() ->
    ?assertEqual([stamp_of_another], judge([{7, 1, {put, x, 7, s(4, 2)}} | agreed(x, s(4, 2))])).
not_owner_test() -> ?assertEqual([not_owner], judge([put(5, 2, mine) | agreed(mine, s(5, 2))])).
no_agreement_test() ->
    Writes = [put(5, 1, x), holds(5, 1, x, s(5, 1))],
    ?assertEqual([no_agreement], judge(Writes)),
    ?assertEqual([no_agreement], judge(Writes ++ [holds(2000, 2, x, s(5, 1))])),
    ?assertEqual([], judge(Writes ++ [{8, 2, {died, k}}])).

%% When each was broken, by which robots, and of which register; and the results.
in_full(Events) -> in_full(Events, 9000, #{}).

in_full(Events, End, Extra) ->
    Config = maps:merge(#{robots => [1, 2], owners => #{mine => 1}, bound_us => 1000}, Extra),
    M0 = starl_monitor:new([{starl_registers_monitor, Config}]),
    {Found, M} = lists:foldl(
        fun({T, Robot, What}, {Acc, Monitor}) ->
            Machine =
                case What of
                    {died, _} -> robot;
                    _ -> registers
                end,
            case starl_monitor:step({T, Robot, Machine, What}, Monitor) of
                {ok, Next} -> {Acc, Next};
                {violation, V, Next} -> {Acc ++ [V], Next}
            end
        end,
        {[], M0},
        Events
    ),
    {Late, #{starl_registers_monitor := Results}} = starl_monitor:finish(End, M),
    {
        [
            {What, T, R, D}
         || #{
                contract := registers,
                what := What,
                at_us := T,
                robots := R,
                details := D
            } <- Found ++ Late
        ],
        Results
    }.

told_test() ->
    Told = fun(Events) -> element(1, in_full(Events)) end,
    X = #{name => x},
    Held = agreed(x, s(5, 1)),
    ?assertEqual(
        [{never_written, 6, [2], X#{stamp => s(5, 1)}}],
        Told([put(5, 1, x), got(6, 2, x, 4, s(5, 1)) | Held])
    ),
    Two = [put(5, 1, x), put(6, 2, x), got(7, 1, x, 6, s(6, 2))],
    Both = agreed(x, s(6, 2)),
    ?assertEqual([{read_goes_back, 8, [1], X}], Told(Two ++ [got(8, 1, x, 5, s(5, 1)) | Both])),
    ?assertEqual([{read_goes_back, 8, [1], X}], Told(Two ++ [{8, 1, {got, x, unset}} | Both])),
    Back = [put(5, 1, x), {7, 1, {put, x, 7, s(4, 1)}} | Held],
    ?assertEqual([{stamp_goes_back, 7, [1], X#{stamp => s(4, 1)}}], Told(Back)),
    ?assertEqual(
        [{stamp_goes_back, 7, [1], X#{stamp => s(5, 1)}}],
        Told([put(5, 1, x), {7, 1, {put, x, 7, s(5, 1)}} | Held])
    ),
    ?assertEqual(
        [{stamp_of_another, 7, [1], X}],
        Told([{7, 1, {put, x, 7, s(4, 2)}} | agreed(x, s(4, 2))])
    ),
    ?assertEqual(
        [{not_owner, 5, [2], #{name => mine}}],
        Told([put(5, 2, mine) | agreed(mine, s(5, 2))])
    ),
    ?assertEqual(
        [{no_agreement, 1005, [1, 2], X}],
        Told([put(5, 1, x), holds(5, 1, x, s(5, 1))])
    ),
    %% what was due first is told first, whatever its name
    ?assertEqual(
        [{no_agreement, 1005, [1, 2], X}, {no_agreement, 1006, [1, 2], #{name => a}}],
        Told([
            put(5, 1, x),
            holds(5, 1, x, s(5, 1)),
            put(6, 1, a),
            holds(6, 1, a, s(6, 1))
        ])
    ).

%% A damaged store excuses stamps that go back, a crash alone does not; reads begin anew after both.
damaged_test() ->
    Late = {7, 1, {put, x, 7, s(4, 1)}},
    ?assertEqual([], judge([put(5, 1, x), {6, 1, store_damaged}, Late | agreed(x, s(5, 1))])),
    ?assertEqual(
        [stamp_goes_back],
        judge([put(5, 1, x), {6, 2, store_damaged}, Late | agreed(x, s(5, 1))])
    ).

registers_results_test() ->
    None = #{writes => 0, reads => 0, agreements => 0, sometimes => #{clocks_apart => 0}},
    ?assertEqual({[], None}, in_full([])),
    Events = [
        put(5, 1, x),
        put(6, 1, y),
        got(7, 2, x, 5, s(5, 1)),
        {8, 2, {got, z, unset}}
        | agreed(x, s(5, 1)) ++ agreed(y, s(6, 1))
    ],
    ?assertEqual({[], None#{writes := 2, reads := 1, agreements := 2}}, in_full(Events)),
    ?assertEqual(
        {[], None#{writes := 2, reads := 1, agreements := 1}},
        in_full(Events, 1006, #{})
    ),
    ?assertEqual({[], None#{writes := 2, reads := 1}}, in_full(Events, 1005, #{})).

%% What was due is judged once, whatever happens later.
judged_once_test() ->
    Written = [put(5, 1, x), holds(5, 1, x, s(5, 1))],
    Later = [{T, 2, {got, z, unset}} || T <- [2000, 3000, 4000]],
    {Found, Results} = in_full(Written ++ Later),
    ?assertMatch([{no_agreement, 1005, [1, 2], _}], Found),
    ?assertMatch(#{agreements := 1}, Results).

%% The time runs from the last write of the register, the last crash or death, and the heal.
due_test() ->
    Due = fun(Events, Extra) ->
        {Told, _} = in_full(Events, 99000, Extra),
        [T || {no_agreement, T, _, _} <- Told]
    end,
    Written = [put(5, 1, x), holds(5, 1, x, s(5, 1))],
    ?assertEqual([1005], Due(Written, #{})),
    ?assertEqual([1009], Due(Written ++ [{9, 2, crashed}], #{})),
    ?assertEqual([1009], Due(Written ++ [{9, 3, {died, k}}], #{})),
    ?assertEqual([1005], Due(Written ++ [{9, 3, store_damaged}], #{})),
    %% what follows a damaged store has to wait for the slowest clock
    Apart = #{apart_us => 100},
    ?assertEqual([1104], Due([{4, 3, store_damaged} | Written], Apart)),
    ?assertEqual([1104], Due([{4, 3, store_damaged} | Written] ++ [{9, 2, crashed}], Apart)),
    ?assertEqual([1005], Due(Written ++ [{9, 3, store_damaged}], Apart)),
    ?assertEqual([1005], Due(Written, Apart)),
    ?assertEqual([1005], Due([{5, 3, store_damaged} | Written], #{})),
    ?assertEqual([1005], Due(Written ++ [put(9, 1, y) | agreed(y, s(9, 1))], #{})),
    ?assertEqual([3000], Due(Written, #{healed_us => 2000})),
    ?assertEqual([1005], Due(Written, #{healed_us => 5})),
    ?assertEqual([], Due(Written, #{healed_us => never})),
    ?assertEqual([25], Due(Written, #{within_us => 20})),
    %% a copy that came at the last moment is in time, and one that a crash has cost is missing
    ?assertEqual([], Due(Written ++ [holds(1005, 2, x, s(5, 1))], #{})),
    ?assertEqual([1005], Due(Written ++ [holds(1006, 2, x, s(5, 1))], #{})),
    ?assertEqual([1020], Due(Written ++ [holds(9, 2, x, s(5, 1)), {20, 2, crashed}], #{})).

%% A robot whose clock faults have set too far back is excused of the write that it refuses, and of nothing else.
%% Holds: A robot whose clock faults have set too far back is excused of the write that it refuses,
%% nobody else is, and of nothing else
%% Red: d7c73771, run: `no agreement` (seed 9700053)
clocks_apart_test() ->
    Freeze = {2, 0, 3000, {clock, -3000}},
    Refuses = fun(Robot, Stamp) -> {900, Robot, {too_far_ahead, x, Stamp}} end,
    Written = [put(5, 1, x), holds(5, 1, x, s(5, 1))],
    Apart = #{apart_us => 2900, broken => [Freeze], healed_us => 3000},
    Told = fun(Events, More) ->
        {Found, #{sometimes := #{clocks_apart := N}}} = in_full(
            Events, 9000, maps:merge(Apart, More)
        ),
        {[What || {What, _, _, _} <- Found], N}
    end,
    Refused = Written ++ [Refuses(2, s(5, 1))],
    ?assertEqual({[], 1}, Told(Refused, #{})),
    %% the clock is near enough, or not the robot's, or the clock that is far ahead is
    ?assertEqual({[no_agreement], 0}, Told(Refused, #{apart_us => 3000})),
    ?assertEqual({[no_agreement], 0}, Told(Refused, #{broken => [setelement(1, Freeze, 1)]})),
    ?assertEqual({[], 1}, Told(Refused, #{broken => [{1, 7, 7, {clock, 3000}}]})),
    %% one that was set forward has shown later times than it shows now
    Back = [{1, 7, 7, {clock, 4500}}, {1, 3000, 3000, {clock, -4500}}],
    ?assertEqual({[], 1}, Told(Refused, #{broken => Back})),
    %% an older copy of it, from a third robot, may come after it
    ?assertEqual({[], 1}, Told(Refused ++ [Refuses(2, s(4, 1))], #{})),
    %% it has not refused the write, but another, or has lost it since
    ?assertEqual({[no_agreement], 0}, Told(Written, #{})),
    ?assertEqual({[no_agreement], 0}, Told(Written ++ [Refuses(2, s(4, 1))], #{})),
    %% the others must agree, and whoever has no fault
    Three = #{robots => [1, 2, 3]},
    ?assertEqual({[no_agreement], 0}, Told(Refused, Three)),
    ?assertEqual({[], 1}, Told(Refused ++ [holds(900, 3, x, s(5, 1))], Three)),
    %% what clocks may differ by without any fault counts, too: both are off, and both have drifted for 4 ms
    [
        ?assertEqual(
            Expected,
            Told(Refused, #{apart_us => 3100, clocks => #{offset_us => Us, drift_ppm => Ppm}})
        )
     || {Expected, Us, Ppm} <- [
            {{[], 1}, 51, 0},
            {{[no_agreement], 0}, 50, 0},
            {{[], 1}, 0, 12630},
            {{[no_agreement], 0}, 0, 12500},
            {{[], 1}, 50, 125}
        ]
    ].

%% A clock that was ahead by more than twice the bound, and is right again, excuses nobody.
a_clock_that_was_wrong_excuses_nobody_once_it_is_right_test() ->
    Refused = [
        put(5, 1, x), holds(5, 1, x, s(5, 1)), {900, 2, {too_far_ahead, x, s(5, 1)}}
    ],
    Told = fun(Us) ->
        Windows = [{1, 2, 2, {clock, Us}}, {1, 500, 500, {clock, -Us}}],
        {Found, _} = in_full(Refused, 9000, #{apart_us => 1500, broken => Windows, healed_us => 500}),
        [What || {What, _, _, _} <- Found]
    end,
    ?assertEqual([], Told(3500)),
    ?assertEqual([no_agreement], Told(100000)).

%% A robot sets its stamps back to its clock if one of them was beyond it by more than twice the bound, and not otherwise.
set_right_test() ->
    Set = fun(Time, Stamp) ->
        Events = [
            {5, 1, {put, x, 5, s(Time, 1)}},
            {5, 1, {holds, x, s(Time, 1)}},
            got(6, 1, x, 5, s(Time, 1)),
            {7, 1, {set_right, 7}},
            {7, 1, {put, x, 5, s(Stamp, 1)}},
            got(8, 1, x, 5, s(Stamp, 1))
        ],
        {Found, _} = in_full(Events ++ agreed(x, s(Stamp, 1)), 9000, #{apart_us => 1000000}),
        [What || {What, _, _, _} <- Found]
    end,
    ?assertEqual([], Set(3600000000, 7)),
    ?assertEqual([], Set(1000008, 7)),
    ?assertEqual([set_right_without_cause], Set(1000007, 7)).

%% What a live run tells of a fault when it is over excuses as what was known from the beginning does, and robots have
%% their time from then on.
a_window_that_is_told_when_it_is_over_excuses_too_test() ->
    Told = fun(Windows, Events) ->
        Config = #{robots => [1, 2], bound_us => 1000, apart_us => 2900},
        Begun = starl_monitor:new([{starl_registers_monitor, Config}]),
        Step = fun({T, Robot, What}, M) ->
            {ok, Next} = starl_monitor:step({T, Robot, registers, What}, M),
            Next
        end,
        Seen = lists:foldl(Step, Begun, [put(5, 1, x), holds(5, 1, x, s(5, 1))]),
        Broken = lists:foldl(fun starl_monitor:broken/2, Seen, Windows),
        {Found, #{starl_registers_monitor := #{sometimes := #{clocks_apart := N}}}} =
            starl_monitor:finish(9000, lists:foldl(Step, Broken, Events)),
        {[{What, At} || #{what := What, at_us := At} <- Found], N}
    end,
    Refused = [{900, 2, {too_far_ahead, x, s(5, 1)}}],
    Freeze = {2, 0, 3000, {clock, -3000}},
    ?assertEqual({[{no_agreement, 1005}], 0}, Told([], Refused)),
    ?assertEqual({[], 1}, Told([Freeze], Refused)),
    %% of a fault that sets no clock apart they have the time
    Other = {2, 0, 3000, fault},
    ?assertEqual({[{no_agreement, 4000}], 0}, Told([Other], Refused)),
    ?assertEqual({[], 0}, Told([Other], [holds(4000, 2, x, s(5, 1))])).

%% -- the clock ------------------------------------------------------------------------------

stamps_grow_test() ->
    {A, C1} = starl_hlc:stamp(100, starl_hlc:new(1, 1000)),
    {B, C2} = starl_hlc:stamp(90, C1),
    C3 = starl_hlc:observe({500, 7, 2}, 95, C2),
    {C, C4} = starl_hlc:stamp(101, C3),
    {D, _} = starl_hlc:stamp(600, C4),
    ?assertEqual([{100, 0, 1}, {100, 1, 1}, {500, 8, 1}, {600, 0, 1}], [A, B, C, D]).

%% Whatever a clock admitted before: after a restart its stamps are later, twice in a moment, too.
restart_test() ->
    Ahead = {1100, 5, 2},
    ?assert(starl_hlc:admits(Ahead, 100, starl_hlc:new(1, 1000))),
    ?assertNot(starl_hlc:admits({1101, 0, 2}, 100, starl_hlc:new(1, 1000))),
    {A, _} = starl_hlc:stamp(100, starl_hlc:observe(Ahead, 100, starl_hlc:new(1, 1000))),
    {B, _} = starl_hlc:stamp(100, starl_hlc:after_restart(1, 1000, 100, 2)),
    {C, _} = starl_hlc:stamp(100, starl_hlc:after_restart(1, 1000, 100, 3)),
    ?assert(A < B andalso B < C).

%% What the machine may trace, and with how much.
vocabulary_test() ->
    #{registers := Events} = starl_registers_monitor:vocabulary(),
    ?assertEqual(
        [
            {denied, 1},
            {got, 2},
            {got, 3},
            {holds, 2},
            {put, 3},
            {refused, 3},
            {set_right, 1},
            {too_far_ahead, 2}
        ],
        lists:sort(Events)
    ).

%% Events of its machines that the contract says nothing of are none of its business.
other_events_test() ->
    M = starl_registers_monitor:init(#{robots => [1, 2], owners => #{}, bound_us => 1000}),
    [
        ?assertEqual({ok, M}, starl_registers_monitor:step({0, 1, Machine, Event}, M))
     || {Machine, Event} <- [{registers, {malformed, 2}}, {robot, {started, registers}}]
    ].

%% -- the bound of a run -----------------------------------------------------------------------

%% Agreement takes longer on a radio that loses packets, and a wheel does not prolong it.
bound_by_loss_test() ->
    Told = fun(Loss) ->
        starl_registers_monitor:context(
            #{
                broken => [],
                clocks => #{offset_us => 0, drift_ppm => 0},
                healed_us => 70,
                ends => #{actuation => 70, process => 9},
                slack_us => 0,
                sap => #{limit => 6},
                loss => Loss,
                delay_us => 20000
            },
            #{robots => [1, 2], within_us => 20000000}
        )
    end,
    #{within_us := Sound, healed_us := 9} = Told(0),
    #{within_us := Lossy, healed_us := 9} = Told(0.3),
    ?assertEqual(20060000, Sound),
    ?assert(Lossy > 2 * Sound andalso Lossy < 20 * Sound).

%% Copies that differ when a run ends before the bound are not judged, which is said.
not_yet_is_said_test() ->
    Unjudged = fun(Events, End) ->
        M0 = starl_monitor:new([{starl_registers_monitor, #{robots => [1, 2], bound_us => 1000}}]),
        Step = fun({T, Robot, What}, M) ->
            element(2, starl_monitor:step({T, Robot, registers, What}, M))
        end,
        Last = lists:foldl(Step, M0, Events),
        {Found, #{starl_registers_monitor := Results}} = starl_monitor:finish(End, Last),
        {length(Found), length(maps:get(unjudged, Results, []))}
    end,
    Put = [put(5, 1, x), holds(5, 1, x, s(5, 1))],
    ?assertEqual({0, 1}, Unjudged(Put, 900)),
    ?assertEqual({1, 0}, Unjudged(Put, 1900)),
    ?assertEqual({0, 0}, Unjudged(Put ++ [holds(9, 2, x, s(5, 1))], 900)).
