%% The runner: who is fed, what happens after a violation, and how one is put in words.
-module(starl_monitor_tests).
-behaviour(starl_monitor).
-include_lib("eunit/include/eunit.hrl").

-export([init/1, step/2, broken/2, finish/2, interests/0, vocabulary/0]).

%% A monitor of its own: counts events of machine `counted', objects to the event `bad' and to
%% all of machine `app'.
init(#{start := N}) -> N.

interests() -> [counted, app].

%% It answers for a machine that it does not listen to.
vocabulary() -> #{door => [{open, 0}, {knock, 1}, {knock, 2}]}.

step({T, Robot, counted, bad}, N) -> {violation, objection(T, Robot), N + 1};
step({T, Robot, app, _Event}, N) -> {violation, objection(T, Robot), N + 1};
step({_T, _Robot, counted, _Event}, N) -> {ok, N + 1}.

%% A broken assumption counts as it is long.
broken({_, From, To, _}, N) -> N + To - From.

finish(End, N) when N > 100 -> {{violation, [objection(End, 1)]}, #{seen => N}};
finish(_End, N) -> {ok, #{seen => N}}.

objection(T, Robot) ->
    #{contract => test, what => bad_event, at_us => T, robots => [Robot], details => #{n => 1}}.

feeds_only_what_is_wanted_test() ->
    M0 = starl_monitor:new([{?MODULE, #{start => 0}}]),
    {ok, M1} = starl_monitor:step([{1, 1, counted, a}, {2, 1, other, bad}, {3, 2, counted, b}], M0),
    {ok, M2} = starl_monitor:step({4, 2, counted, c}, M1),
    ?assertEqual({[], #{?MODULE => #{seen => 3}}}, starl_monitor:finish(5, M2)).

%% A broken assumption is told to the monitors that want to know.
tells_of_broken_assumptions_test() ->
    M0 = starl_monitor:new([{?MODULE, #{start => 0}}, {starl_crash_monitor, #{excused => []}}]),
    M1 = starl_monitor:broken({2, 10, 17, pause}, M0),
    ?assertMatch({[], #{?MODULE := #{seen := 7}}}, starl_monitor:finish(20, M1)).

runs_several_monitors_test() ->
    M0 = starl_monitor:new([{?MODULE, #{start => 0}}, {starl_sap_monitor, #{bound_us => 10}}]),
    {violation, #{contract := sap}, M1} =
        starl_monitor:step({1, 1, sap, {delivered, {2, 1, 1}, t, 0}}, M0),
    {violation, #{contract := test}, M2} = starl_monitor:step({1, 1, counted, bad}, M1),
    ?assertMatch({[], #{starl_sap_monitor := #{}, ?MODULE := #{}}}, starl_monitor:finish(2, M2)).

%% A report of a run whose computer stood still needs figures: what was measured until then is kept, and
%% nothing that comes later is judged.
%% Holds: A run whose computer stood still has its report, with the figures until then
%% Red: 6abd1405, run: a crash without a report in 2 of 6 runs
who_is_blinded_keeps_what_it_measured_test() ->
    M0 = starl_monitor:guarded([{?MODULE, #{start => 99}}, {starl_crash_monitor, #{excused => []}}]),
    {ok, M1} = starl_monitor:step([{1, 1, counted, a}, {2, 1, counted, b}], M0),
    Why = {stood_still, 1, 3},
    M2 = starl_monitor:blinded(Why, M1),
    ?assertEqual(M2, starl_monitor:blinded({stood_still, 2, 4}, M2)),
    {ok, M3} = starl_monitor:step({5, 1, counted, bad}, M2),
    ?assertMatch(
        {[], #{?MODULE := #{seen := 101}, starl_crash_monitor := #{}}, [
            #{from_us := 2, monitors := ["tests"], why := Why}
        ]},
        starl_monitor:close(9, M3)
    ).

%% All events of a batch are judged; the first violation is returned, the others at the finish.
goes_on_after_a_violation_test() ->
    M0 = starl_monitor:new([{?MODULE, #{start => 100}}]),
    Events = [{1, 7, counted, bad}, {2, 8, counted, bad}, {3, 8, counted, a}],
    {violation, First, M1} = starl_monitor:step(Events, M0),
    ?assertEqual(objection(1, 7), First),
    ?assertMatch({ok, _}, starl_monitor:step([], M1)),
    ?assertEqual(
        {[objection(2, 8), objection(9, 1)], #{?MODULE => #{seen => 103}}},
        starl_monitor:finish(9, M1)
    ).

keeps_a_thousand_test() ->
    M0 = starl_monitor:new([{?MODULE, #{start => 100}}]),
    {violation, _, M1} = starl_monitor:step(lists:duplicate(2000, {1, 7, counted, bad}), M0),
    {Found, _} = starl_monitor:finish(9, M1),
    ?assertEqual(999, length(Found)).

a_module_runs_once_test() ->
    Twice = [{?MODULE, #{start => 0}}, {?MODULE, #{start => 1}}],
    ?assertError(badarg, starl_monitor:new(Twice)).

formats_one_line_test() ->
    Line = unicode:characters_to_list(
        starl_violation:format((objection(1_500_000, 7))#{robots => [7, 12]})
    ),
    ?assertEqual("test broken at 1.500000 s by robots 7, 12: bad event (n 1)", Line).

%% Violations have one shape whatever their numbers, times and robots are, but not with other words,
%% with one robot and two, or where of two figures the other one is larger.
violations_of_one_kind_have_one_shape_test() ->
    V = fun(Robots, Details) ->
        #{contract => c, what => w, at_us => 1, robots => Robots, details => Details}
    end,
    Shape = fun(Robots, Details) -> starl_violation:shape(V(Robots, Details)) end,
    Plain = Shape([1], #{name => {token, 1}, last => 3, round => 7}),
    ?assertEqual(Plain, Shape([9], #{name => {token, 2}, last => 30, round => 31.5})),
    Later = (V([2], #{name => {token, 1}, last => 3, round => 7}))#{at_us := 99},
    ?assertEqual(Plain, starl_violation:shape(Later)),
    [
        ?assertNotEqual({Robots, Details, Plain}, {Robots, Details, Shape(Robots, Details)})
     || {Robots, Details} <- [
            {[1, 2], #{name => {token, 1}, last => 3, round => 7}},
            {[1], #{name => {token, 1}, last => 7, round => 3}},
            {[1], #{name => {token, 1}, last => 3, round => 3}},
            {[1], #{name => {door, 1}, last => 3, round => 7}},
            {[1], #{name => token, last => 3, round => 7}},
            {[1], #{name => {token, 1}, last => 3}}
        ]
    ],
    %% equal is neither less nor more
    ?assertNotEqual(Shape([1], #{last => 3, round => 3}), Shape([1], #{last => 7, round => 3})),
    ?assertNotEqual(Shape([1], #{stack => [{m, f}]}), Shape([1], #{stack => [{m, g}]})),
    ?assertEqual(Shape([1], #{all => [1, 2, 3]}), Shape([1], #{all => [5]})),
    ?assertEqual(Shape([1], #{all => [1, 2 | 3]}), Shape([1], #{all => [4 | 5]})),
    ?assertNotEqual(Shape([1], #{all => [1 | 3]}), Shape([1], #{all => [1 | c]})),
    ?assertEqual(Shape([1], #{per => #{1 => 5, 2 => 6}}), Shape([1], #{per => #{7 => 8}})),
    ?assertEqual(Shape([1], #{all => <<1>>}), Shape([1], #{all => <<"longer">>})),
    ?assertEqual(Shape([1, 2, 3], #{}), Shape([1, 2, 3, 4, 5], #{})),
    %% which of two terms is larger says nothing
    ?assertEqual(
        Shape([1], #{first => {a, 1}, second => {a, 2}}),
        Shape([1], #{first => {a, 2}, second => {a, 1}})
    ),
    Other = (V([1], #{name => {token, 1}, last => 3, round => 7}))#{what := other},
    ?assertNotEqual(Plain, starl_violation:shape(Other)).

%% Of none, of one and of two robots; without details there are no brackets; numbers of all kinds.
formats_robots_and_details_test() ->
    Line = fun(Robots, Details) ->
        V = (objection(2_000_000, 7))#{robots := Robots, details := Details},
        unicode:characters_to_list(starl_violation:format(V))
    end,
    ?assertEqual("test broken at 2.000000 s by no robot: bad event", Line([], #{})),
    ?assertEqual("test broken at 2.000000 s by robot 7: bad event", Line([7], #{})),
    ?assertEqual(
        "test broken at 2.000000 s by robots 1, 2: bad event (a 1, b {x,2})",
        Line([1, 2], #{b => {x, 2}, a => 1})
    ).

%% Of one call the violation of the earliest event comes first, whichever monitor found it.
first_of_several_monitors_test() ->
    M0 = starl_monitor:new([{?MODULE, #{start => 0}}, {starl_sap_monitor, #{bound_us => 10}}]),
    Sap = {1, 1, sap, {delivered, {2, 1, 1}, t, 0}},
    Own = {2, 1, counted, bad},
    {violation, #{contract := sap}, M1} = starl_monitor:step([Sap, Own], M0),
    ?assertMatch({[#{contract := test}], _}, starl_monitor:finish(3, M1)),
    {violation, #{contract := test}, M2} = starl_monitor:step([Own, setelement(1, Sap, 2)], M0),
    ?assertMatch({[#{contract := sap}], _}, starl_monitor:finish(3, M2)),
    Three = [Own, Own, Own],
    {violation, #{contract := test}, M4} = starl_monitor:step(Three ++ [setelement(1, Sap, 2)], M0),
    ?assertMatch(
        {[#{contract := test}, #{contract := test}, #{contract := sap}], _},
        starl_monitor:finish(3, M4)
    ),
    %% of one event, that of the monitor that was named first
    Read = {1, 2, app, {read, 1, {app, a}, 5}},
    {violation, #{contract := test}, M5} = starl_monitor:step(Read, M0),
    ?assertMatch({[#{contract := sap}], _}, starl_monitor:finish(3, M5)),
    Turned = starl_monitor:new([{starl_sap_monitor, #{bound_us => 10}}, {?MODULE, #{start => 0}}]),
    {violation, #{contract := sap}, M6} = starl_monitor:step(Read, Turned),
    ?assertMatch({[#{contract := test}], _}, starl_monitor:finish(3, M6)),
    %% of one time, likewise
    {ok, M3} = starl_monitor:step([{1, 1, sap, {sent, {1, 1, 1}, [2], t, 0}}], M0),
    Late = {50, 1, counted, bad},
    ?assertMatch({violation, #{contract := test}, _}, starl_monitor:step(Late, M3)).

unknown(T, Robot, Machine, Event) ->
    #{
        contract => Machine,
        what => unknown_event,
        at_us => T,
        robots => [Robot],
        details => #{event => Event}
    }.

%% An event that its machine does not trace is a violation, whoever listens, by its name and by how
%% many parts it has; the platform's events are known of every machine that somebody answers for.
unknown_event_test() ->
    M = starl_monitor:new([{?MODULE, #{start => 0}}]),
    Known =
        [
            {1, 1, door, E}
         || E <- [
                open,
                {knock, 1},
                {knock, 1, 2},
                crashed,
                store_damaged,
                {unknown_event, info, x},
                {malformed, 2, t, x},
                {unknown_machine, door}
            ]
        ] ++ [{1, 1, robot, up}, {1, 1, chassis, {actuated, pen, down}}, {1, 1, counted, what}],
    ?assertMatch({ok, _}, starl_monitor:step(Known, M)),
    [
        ?assertMatch(
            {Machine, Event, {violation, #{}, _}},
            {Machine, Event, starl_monitor:step({1, 1, Machine, Event}, M)}
        )
     || {Machine, Event} <- [
            {door, opened},
            {door, {open}},
            {door, {knock}},
            {door, {knock, 1, 2, 3}},
            {door, {}},
            {door, "open"},
            {door, {crashed}},
            {door, {done, x}},
            {door, {started, 1}},
            {robot, {up, 1}},
            {robot, dead},
            {robot, crashed},
            {chassis, {moves, 1}},
            {radio, {sent, 2, 1}},
            {supervisor, {started, door}},
            {location, open},
            {motion, open}
        ]
    ],
    {violation, V, _} = starl_monitor:step({7, 2, door, {opened, 1}}, M),
    ?assertEqual(unknown(7, 2, door, {opened, 1}), V),
    ?assertEqual(
        "door broken at 0.000007 s by robot 2: unknown event (event {opened,1})",
        unicode:characters_to_list(starl_violation:format(V))
    ).

%% It is told once for each machine and name, before what monitors say of the same event.
unknown_event_is_told_once_test() ->
    M0 = starl_monitor:new([{?MODULE, #{start => 0}}, {starl_sap_monitor, #{bound_us => 10}}]),
    Events = [{1, 1, door, shut}, {2, 2, door, shut}, {3, 1, sap, shut}, {4, 1, counted, bad}],
    {violation, First, M1} = starl_monitor:step(Events, M0),
    ?assertEqual(unknown(1, 1, door, shut), First),
    {ok, M2} = starl_monitor:step({5, 1, door, shut}, M1),
    {violation, Longer, M3} = starl_monitor:step({6, 1, door, {shut, 1}}, M2),
    ?assertEqual(unknown(6, 1, door, {shut, 1}), Longer),
    {Late, _} = starl_monitor:finish(9, M3),
    ?assertEqual([unknown(3, 1, sap, shut), objection(4, 1)], Late).

%% What applications trace is theirs, unless a monitor answers for them.
what_applications_trace_is_theirs_test() ->
    M = starl_monitor:new([{starl_sap_monitor, #{bound_us => 10}}]),
    ?assertMatch({ok, _}, starl_monitor:step({1, 1, app, {anything, 1}}, M)).

%% A thousand are kept, of all calls together; those returned at once count too.
keeps_a_thousand_of_all_calls_test() ->
    M0 = starl_monitor:new([{?MODULE, #{start => 101}}]),
    Feed = fun(N, M) ->
        {violation, #{}, Next} = starl_monitor:step(lists:duplicate(N, {1, 7, counted, bad}), M),
        Next
    end,
    Kept = fun(M) -> length(element(1, starl_monitor:finish(9, M))) end,
    ?assertEqual(10, Kept(Feed(10, M0))),
    ?assertEqual(998, Kept(Feed(500, Feed(500, M0)))),
    ?assertEqual(998, Kept(Feed(501, Feed(500, M0)))),
    ?assertEqual(998, Kept(Feed(1, Feed(500, Feed(600, M0))))).

%% A contract asks for the classes of faults that can hold up what it speaks of.
healed_by_class_test() ->
    Ends = #{network => 5, actuation => 70, process => 9},
    Known = #{healed_us => 70, ends => Ends, core => #{rest => [], healed_us => 9, ends => #{}}},
    ?assertEqual(9, starl_monitor:healed_us([network, clock, process], Known)),
    ?assertEqual(70, starl_monitor:healed_us([actuation], Known)),
    ?assertEqual(0, starl_monitor:healed_us([store], Known)),
    ?assertEqual(
        never, starl_monitor:healed_us([network, clock], Known#{ends := #{network => never}})
    ),
    ?assertEqual(0, starl_monitor:core_healed_us([actuation], Known)),
    %% without the classes the end of all faults counts
    ?assertEqual(70, starl_monitor:healed_us([store], maps:remove(ends, Known))).
