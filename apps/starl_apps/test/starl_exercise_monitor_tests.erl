%% What each call of `exercise' is promised after the heal, by traces that keep it and traces that
%% do not. The heal is at 100 s; what is promised is true within 20 s.
-module(starl_exercise_monitor_tests).
-include_lib("eunit/include/eunit.hrl").

-define(S, 1000000).

judge(Events) -> judge(Events, #{}).

judge(Events, Changes) ->
    Config = maps:merge(
        #{
            exercise => starl_sap_block,
            robots => [1, 2, 3],
            healed_us => 100 * ?S,
            within_us => 20 * ?S,
            margin_us => 5 * ?S,
            bound_us => 50 * ?S
        },
        Changes
    ),
    {Found, Last} = lists:foldl(
        fun({Seconds, Robot, Machine, Event}, {Broken, State}) ->
            case starl_monitor:step({Seconds * ?S, Robot, Machine, Event}, State) of
                {ok, Next} -> {Broken, Next};
                {violation, #{contract := calls} = V, Next} -> {Broken ++ [V], Next}
            end
        end,
        {[], starl_monitor:new([{starl_exercise_monitor, Config}])},
        Events
    ),
    {Late, _} = starl_monitor:finish(400 * ?S, Last),
    [What || #{what := What} <- Found ++ Late].

%% Robot 1 calls at a time and is answered at another.
call(What, Since, Outcome, At) -> call(What, none, Since, Outcome, At).

call(What, Ms, Since, Outcome, At) ->
    [{Since, 1, app, {call, What, Ms}}, {At, 1, app, {answer, Outcome}}].

%% How many calls were promised something, when they ended.
calls_that_were_promised_something_are_counted_test() ->
    Config = #{
        exercise => starl_sap_block,
        robots => [1, 2, 3],
        healed_us => 100 * ?S,
        within_us => 20 * ?S,
        margin_us => 5 * ?S,
        bound_us => 50 * ?S
    },
    Judged = fun(Events) ->
        M0 = starl_monitor:new([{starl_exercise_monitor, Config}]),
        {ok, M} = starl_monitor:step([setelement(1, E, element(1, E) * ?S) || E <- Events], M0),
        {[], #{starl_exercise_monitor := #{judged := N}}} = starl_monitor:finish(400 * ?S, M),
        N
    end,
    Sent = call({send, 2}, 110, ok, 111),
    ?assertEqual(0, Judged([])),
    ?assertEqual(1, Judged(Sent)),
    ?assertEqual(2, Judged(Sent ++ call({send, 3}, 112, ok, 113))),
    ?assertEqual(0, Judged([{9, 2, robot, {died, killed}} | Sent])).

%% A robot that is cut off for ever is promised nothing, and the others what they are when it has died.
%% Holds: A majority that heals gets on, whatever the others do for ever
%% Red: d018c00: faults until the end of the run excuse everybody
quiet_core_test() ->
    Rest = #{rest => [2]},
    ?assertEqual([not_as_promised], judge(call({send, 3}, 110, {error, lost}, 111), Rest)),
    ?assertEqual([no_answer], judge([{110, 1, app, {call, {send, 3}, none}}], Rest)),
    ?assertEqual([], judge(call({send, 2}, 110, {error, lost}, 111), Rest)),
    ?assertEqual([not_as_promised], judge(call({send, 2}, 110, {error, lost}, 111))),
    [Asks, _] = call({send, 3}, 110, {error, lost}, 111),
    ?assertEqual([], judge([setelement(2, Asks, 2)], Rest)),
    %% the time of the heal is the core's
    Known = #{
        broken => [],
        healed_us => 7200 * ?S,
        core => #{rest => [2], healed_us => 100 * ?S},
        slack_us => 0,
        delay_us => 0
    },
    ?assertMatch(
        #{rest := [2], healed_us := 100000000},
        starl_exercise_monitor:context(Known, #{
            exercise => starl_sap_block,
            bound_us => 1,
            within_us => 1,
            margin_us => 1,
            robots => [1, 2, 3]
        })
    ).

%% What can hold up a call: no wheel holds up a message, no radio a drive.
held_up_by_class_test() ->
    Ends = #{network => 5, actuation => 7, clock => 3},
    Healed = fun(Exercise) ->
        Known = #{
            broken => [],
            healed_us => 7,
            ends => Ends,
            slack_us => 0,
            sap => #{limit => 2},
            loss => 0.3,
            delay_us => 0
        },
        starl_exercise_monitor:context(Known, #{
            exercise => Exercise,
            use => #{exercise => Exercise},
            bound_us => 1,
            within_us => 1,
            margin_us => 1,
            robots => [1, 2, 3]
        })
    end,
    ?assertMatch(#{healed_us := 7, within_us := 1}, Healed(starl_motion_block)),
    %% SAP may give up a message, which this exercise does not send again: that is said
    ?assertMatch(#{healed_us := never, lossy := 0.3}, Healed(starl_sap_block)).

%% A call on a radio that loses too much is not judged, and the results say so.
lossy_is_said_test() ->
    Config = #{
        exercise => starl_sap_block,
        robots => [1, 2],
        within_us => 1,
        margin_us => 1,
        bound_us => 1
    },
    Finish = fun(More) ->
        {ok, Results} = starl_exercise_monitor:finish(
            100, starl_exercise_monitor:init(maps:merge(Config, More))
        ),
        maps:get(unjudged, Results, [])
    end,
    ?assertEqual([], Finish(#{healed_us => 50})),
    ?assertMatch([{_, "a fault lasts until the end"}], Finish(#{healed_us => 100})),
    [{_, Why}] = Finish(#{healed_us => never, lossy => 0.25}),
    ?assertEqual("the radio loses 25.0 %", lists:flatten(Why)).

%% What is told of a call: when it ended, whose it was, since when, and how it came out.
a_broken_promise_tells_of_its_call_test() ->
    Config = #{
        exercise => starl_sap_block,
        robots => [1, 2, 3],
        healed_us => 100 * ?S,
        within_us => 20 * ?S,
        margin_us => 5 * ?S,
        bound_us => 50 * ?S
    },
    Told = fun(Events) ->
        M0 = starl_monitor:new([{starl_exercise_monitor, Config}]),
        Feed = [setelement(1, E, element(1, E) * ?S) || E <- Events],
        Found =
            case starl_monitor:step(Feed, M0) of
                {ok, M} -> element(1, starl_monitor:finish(400 * ?S, M));
                {violation, V, _} -> [V]
            end,
        [{W, T, R, D} || #{what := W, at_us := T, robots := R, details := D} <- Found]
    end,
    Of = #{call => {send, 2}, since_us => 110 * ?S},
    Lost = {error, lost},
    ?assertEqual(
        [{not_as_promised, 111 * ?S, [1], Of#{outcome => Lost}}],
        Told(call({send, 2}, 110, Lost, 111))
    ),
    ?assertEqual(
        [{too_late, 131 * ?S, [1], Of#{outcome => ok}}], Told(call({send, 2}, 110, ok, 131))
    ),
    ?assertEqual([{no_answer, 130 * ?S, [1], Of}], Told([hd(call({send, 2}, 110, ok, 131))])),
    %% the patience by a clock that is slow by two in a hundred, and the margin, or the bound
    [
        ?assertMatch(
            [{no_answer, Ends, [1], #{since_us := Since}}] when Since =:= At * ?S,
            Told([{At, 1, app, {call, {elect, x}, 8000}}])
        )
     || {At, Ends} <- [{110, 123_160_000}, {1, 59_160_000}]
    ].

%% A message to a robot that is down while it is sent may be lost; not one before that, or after.
%% Holds: A message to a robot that is down meanwhile may be lost, and no other
%% Red: 520627f, run
down_receiver_test() ->
    Down = {112, 2, robot, down},
    Started = {114, 2, sap, {started, 2}},
    Send = fun(Since, At) -> call({send, 2}, Since, {error, lost}, At) end,
    Order = fun lists:sort/1,
    [
        ?assertEqual({Events, What}, {Events, judge(Order(Events))})
     || {Events, What} <- [
            {[Down, Started | Send(111, 113)], []},
            {[Down, Started | Send(113, 115)], []},
            {[Down, Started | Send(111, 116)], []},
            {[Down | Send(150, 152)], []},
            {[Down, Started | Send(110, 111)], [not_as_promised]},
            {[Down, Started | Send(120, 121)], [not_as_promised]},
            {[setelement(2, Down, 3), Started | Send(111, 113)], [not_as_promised]}
        ]
    ],
    All = fun(Lost) -> call(broadcast, 111, {error, {lost, Lost}}, 113) end,
    ?assertEqual([], judge(Order([Down | All([2])]))),
    ?assertEqual([not_as_promised], judge(Order([Down | All([2, 3])]))).

%% -- what is the same of all calls ------------------------------------------------------------

%% Before the heal any answer will do; later, only the promised one, in time.
after_the_heal_test() ->
    Send = {send, 2},
    ?assertEqual([], judge(call(Send, 10, {error, lost}, 20))),
    ?assertEqual([], judge(call(Send, 99, {error, lost}, 101))),
    ?assertEqual([], judge(call(Send, 110, ok, 111))),
    ?assertEqual([not_as_promised], judge(call(Send, 110, {error, lost}, 111))),
    ?assertEqual([too_late], judge(call(Send, 110, ok, 131))),
    ?assertEqual([], judge(call(Send, 110, ok, 130))),
    %% one that waits at the heal has as long from then on
    ?assertEqual([], judge(call(Send, 50, ok, 120))),
    ?assertEqual([too_late], judge(call(Send, 50, ok, 121))).

%% A robot that has just restarted is not found out at once.
a_robot_that_has_just_restarted_may_not_be_known_test() ->
    ?assertEqual([], judge(call({send, 2}, 104, {error, restarted}, 105))),
    ?assertEqual([not_as_promised], judge(call({send, 2}, 105, {error, restarted}, 106))).

%% Whoever sends first after a restart, its own or the receiver's, may find that out instead, once.
finds_out_test() ->
    Kind = #{exercise => starl_sap_block},
    Started = fun(T, Robot, N) -> {T, Robot, sap, {started, N}} end,
    Acked = fun(T) -> {T, 1, sap, {outcome, {1, 1, 1}, 2, acknowledged}} end,
    [
        begin
            ?assertEqual([], judge([Again | refused(110)], Kind)),
            ?assertEqual([not_as_promised], judge([Again] ++ refused(110) ++ refused(112), Kind)),
            ?assertEqual([not_as_promised], judge([Again, Acked(60) | refused(110)], Kind)),
            %% that may have been under way
            ?assertEqual([], judge([Acked(54), Again | refused(110)], Kind)),
            ?assertEqual([], judge([Acked(40), Again | refused(110)], Kind))
        end
     || Again <- [Started(50, 1, 2), Started(50, 2, 2)]
    ],
    %% neither a first start, nor another robot's, nor a loss
    ?assertEqual([not_as_promised], judge([Started(50, 2, 1) | refused(110)], Kind)),
    ?assertEqual([not_as_promised], judge([Started(50, 3, 2) | refused(110)], Kind)),
    Lost = call({send, 2}, 110, {error, lost}, 111),
    ?assertEqual([not_as_promised], judge([Started(50, 2, 2) | Lost], Kind)).

%% A send that is refused by the next incarnation of its receiver.
refused(T) -> refused({send, 2}, T, {error, restarted}).

refused(What, T, Outcome) ->
    [Call, Answer] = call(What, T, Outcome, T + 1),
    [Call, {T + 1, 1, sap, {outcome, {1, 1, 9}, 2, restarted}}, Answer].

%% A broadcast names those that it did not reach.
broadcast_finds_out_test() ->
    Kind = #{exercise => starl_sap_block},
    Again = {50, 2, sap, {started, 2}},
    Refused = fun(T, Robots) -> refused(broadcast, T, {error, {lost, Robots}}) end,
    ?assertEqual([], judge([Again | Refused(110, [2])], Kind)),
    ?assertEqual([not_as_promised], judge([Again | Refused(110, [2, 3])], Kind)),
    ?assertEqual([not_as_promised], judge([Again] ++ Refused(110, [2]) ++ Refused(112, [2]), Kind)),
    %% who was missed was not met
    Missed = call(broadcast, 60, {error, {lost, [2]}}, 70),
    ?assertEqual([], judge([Again] ++ Missed ++ Refused(110, [2]), Kind)).

%% A caller that waits no longer than it will may go away empty-handed.
a_caller_that_waits_no_longer_may_go_without_test() ->
    Kind = #{exercise => starl_mutex_exercise},
    Acquire = {acquire, a},
    ?assertEqual([], judge(call(Acquire, 8000, 110, {error, timeout}, 118), Kind)),
    ?assertEqual([not_as_promised], judge(call(Acquire, 30000, 110, {error, timeout}, 140), Kind)).

no_answer_test() ->
    %% by a clock that is slow by two in a hundred
    Elects = fun(At) ->
        judge(call({elect, x}, 1000000, 10, {error, timeout}, At), #{bound_us => 2 * ?S})
    end,
    ?assertEqual([[], [no_answer]], [Elects(1032), Elects(1033)]),
    ?assertEqual([no_answer], judge([{110, 1, app, {call, {send, 2}, none}}])),
    %% nothing is promised, but it ends
    ?assertEqual([no_answer], judge([{110, 1, app, {call, {elect, x}, 8000}}])),
    ?assertEqual([no_answer], judge(call({elect, x}, 8000, 110, {error, timeout}, 124))),
    ?assertEqual([], judge(call({elect, x}, 8000, 110, {error, timeout}, 123))),
    %% under faults and after them
    ?assertEqual([no_answer], judge(call({elect, x}, 8000, 1, {error, timeout}, 60))),
    ?assertEqual([], judge(call({elect, x}, 8000, 1, {error, timeout}, 59))).

%% Where nothing heals, calls end all the same.
never_healed_test() ->
    Never = #{healed_us => never},
    ?assertEqual([], judge(call({send, 2}, 110, {error, lost}, 111), Never)),
    ?assertEqual([], judge([{110, 1, app, {call, {send, 2}, none}}], Never)),
    ?assertEqual([no_answer], judge([{110, 1, app, {call, {elect, x}, 8000}}], Never)).

%% With the application goes its call; an answer that belongs to none means nothing.
with_the_application_goes_its_call_test() ->
    Call = {110, 1, app, {call, {send, 2}, none}},
    ?assertEqual([], judge([Call, {111, 1, app, crashed}])),
    ?assertEqual([], judge([Call, {111, 1, robot, {died, killed}}])),
    ?assertEqual([no_answer], judge([Call, {111, 2, app, crashed}, {111, 1, sap, crashed}])),
    ?assertEqual([], judge([{111, 1, app, {answer, ok}}])).

%% -- what is promised of each -----------------------------------------------------------------

a_message_to_a_robot_alive_is_not_lost_test() ->
    Dead = {50, 3, robot, {died, killed}},
    ?assertEqual([], judge([Dead | call({send, 3}, 110, {error, lost}, 111)])),
    ?assertEqual([not_as_promised], judge([Dead | call({send, 2}, 110, {error, lost}, 111)])),
    ?assertEqual([], judge([Dead | call(broadcast, 110, {error, {lost, [3]}}, 111)])),
    ?assertEqual([not_as_promised], judge(call(broadcast, 110, {error, {lost, [3]}}, 111))),
    ?assertEqual([], judge(call(broadcast, 110, ok, 111))).

%% The home of a token that anybody has asked for must live: who waits for it holds others.
the_home_of_a_token_must_live_test() ->
    Home = starl_mutex:home(a, [1, 2, 3]),
    Other = starl_mutex:home(b, [1, 2, 3]),
    ?assertNotEqual(Home, Other),
    Dead = {50, Other, robot, {died, killed}},
    Late = call({acquire, a}, 90000, 110, {error, timeout}, 200),
    ?assertEqual([not_as_promised], mutex(Late)),
    ?assertEqual([], mutex([{50, Home, robot, {died, killed}} | Late])),
    ?assertEqual([not_as_promised], mutex([Dead | Late])),
    ?assertEqual(
        [],
        mutex([
            Dead,
            {60, 2, app, {call, {acquire, [a, b]}, 9000}},
            {69, 2, app, {answer, {error, timeout}}}
            | Late
        ])
    ),
    ?assertEqual([], mutex(call({acquire, a}, 90000, 110, {ok, 7}, 111))).

%% What was asked for after the heal is not lost any more; of what was asked for before, a part may have
%% been held, and its lease been at an end, when the rest came.
a_token_asked_for_after_the_heal_is_not_lost_test() ->
    Held = fun(At) -> call({acquire, a}, 9000, At, {ok, 7}, At + 1) end,
    Lost = call({release, a}, 110, {error, lost}, 110),
    ?assertEqual([not_as_promised], mutex(Held(105) ++ Lost)),
    ?assertEqual([], mutex(Held(90) ++ Lost)),
    Slow = fun(At) -> call({acquire, [a, b]}, 90000, At, {ok, [{a, 7}, {b, 8}]}, 105) end,
    Part = call({release, [a, b]}, 110, {error, lost}, 110),
    ?assertEqual([], mutex(Slow(99) ++ Part)),
    ?assertEqual([not_as_promised], mutex(Slow(101) ++ Part)),
    ?assertEqual([], mutex(Held(105) ++ call({release, a}, 110, ok, 110))).

%% All know the owner that has announced itself last, once the announcement has arrived (the paper's
%% Proposition 2(c)).
the_owner_of_a_token_is_known_test() ->
    Fence = 5 bsl 8,
    Home = starl_mutex:home(a, [1, 2, 3]),
    Granted = fun(At, N) -> {At, Home, mutex, {granted, a, N bsl 8, 2}} end,
    Announced = fun(At, N) ->
        {At, 2, sap, {sent, {2, 1, N}, [1, 3], mutex, erlang:phash2({owner, a, N bsl 8})}}
    end,
    Asks = fun(Events, Outcome) ->
        mutex([Granted(105, 5), Announced(106, 5)] ++ Events ++ call({owner, a}, 130, Outcome, 130))
    end,
    ?assertEqual([], Asks([], {ok, 2})),
    [?assertEqual([not_as_promised], Asks([], {ok, Other})) || Other <- [none, 1, 3]],
    %% not while another announcement is due or under way, nor if its owner has died
    [
        ?assertEqual({Event, []}, {Event, Asks([Event], {ok, 3})})
     || Event <- [
            Granted(107, 6),
            {107, 2, mutex, {handed_over, a, 6 bsl 8, 3}},
            {107, 2, robot, {died, killed}}
        ]
    ],
    ?assertEqual([], Asks([Granted(107, 6), Announced(130, 6)], {ok, 3})),
    ?assertEqual([not_as_promised], Asks([Granted(107, 6), Announced(108, 6)], {ok, 3})),
    ?assertEqual([not_as_promised], Asks([{107, 2, mutex, {handed_over, a, Fence, 3}}], {ok, 3})),
    %% what was announced before the heal may have been lost
    Before = [Granted(98, 5), Announced(99, 5)] ++ call({owner, a}, 130, {ok, none}, 130),
    ?assertEqual([], mutex(Before)).

mutex(Events) -> judge(Events, #{exercise => starl_mutex_exercise}).

%% All robots that have to take part do, and none has died: then all elect.
all_elect_where_nobody_has_died_test() ->
    Kind = #{exercise => starl_election_exercise},
    E = {final, 1},
    In = fun(Robot, At) -> {At, Robot, app, {call, {elect, E}, 90000}} end,
    Out = fun(Outcome, At) -> {At, 1, app, {answer, Outcome}} end,
    Others = [{130, R, app, {answer, {ok, 3}}} || R <- [2, 3]],
    All = [In(1, 105), In(2, 110), In(3, 120)],
    ?assertEqual([not_as_promised], judge(All ++ Others ++ [Out({error, timeout}, 195)], Kind)),
    ?assertEqual([too_late], judge(All ++ Others ++ [Out({ok, 3}, 141)], Kind)),
    ?assertEqual([], judge(All ++ Others ++ [Out({ok, 3}, 140)], Kind)),
    Two = [In(1, 105), In(2, 110)],
    Gone = [{130, 2, app, {answer, {ok, 2}}}, Out({error, timeout}, 195)],
    ?assertEqual([], judge(Two ++ Gone, Kind)),
    %% one that takes no part any more, one whose machine has forgotten, a dead one
    ?assertEqual([], judge(All ++ [{121, 3, app, crashed}] ++ Gone, Kind)),
    ?assertEqual([], judge(All ++ [{121, 3, app, {answer, {error, timeout}}}] ++ Gone, Kind)),
    ?assertEqual(
        [],
        judge(
            All ++ [{121, 3, election, crashed}] ++ Others ++
                [Out({error, timeout}, 195)],
            Kind
        )
    ),
    ?assertEqual([], judge(All ++ [{121, 3, robot, {died, killed}}] ++ Gone, Kind)),
    %% during the work everybody comes and goes
    ?assertEqual([], judge(call({elect, {term, 2}}, 90000, 110, {error, timeout}, 200), Kind)).

the_highest_alive_is_elected_test() ->
    Kind = #{exercise => starl_bully_exercise},
    Elect = fun(Since, Outcome) -> call({elect, x}, 90000, Since, Outcome, Since + 10) end,
    Dead = {50, 3, robot, {died, killed}},
    ?assertEqual([], judge(Elect(110, {ok, 3}), Kind)),
    ?assertEqual([not_as_promised], judge(Elect(110, {ok, 2}), Kind)),
    ?assertEqual([not_as_promised], judge([Dead | Elect(110, {ok, 3})], Kind)),
    ?assertEqual([], judge([Dead | Elect(110, {ok, 2})], Kind)),
    %% one that began under faults may have ended with another leader
    Early = {90, 2, app, {call, {elect, x}, 8000}},
    ?assertEqual([], judge([Early, {91, 2, app, {answer, {ok, 2}}} | Elect(110, {ok, 2})], Kind)),
    Late = call({elect, x}, 90000, 110, {error, timeout}, 200),
    ?assertEqual([not_as_promised], judge([Early, {91, 2, app, {answer, {ok, 2}}} | Late], Kind)).

%% All have reached the round, and nobody has died.
all_pass_what_all_have_reached_test() ->
    Kind = #{exercise => starl_barrier_exercise},
    At = fun(Robot, K, Seconds) -> {Seconds, Robot, barrier, {reached, final, K}} end,
    Late = fun(Reached) ->
        [{105, 1, app, {call, {sync, final}, 90000}}] ++ Reached ++
            [{195, 1, app, {answer, {error, timeout}}}]
    end,
    All = [At(1, 4, 105), At(2, 5, 110), At(3, 4, 115)],
    ?assertEqual([not_as_promised], judge(Late(All), Kind)),
    ?assertEqual([], judge(Late([At(1, 4, 105), At(2, 5, 110), At(3, 3, 115)]), Kind)),
    ?assertEqual([], judge(Late(tl(All)), Kind)),
    ?assertEqual([], judge(Late([{50, 3, robot, {died, killed}} | All]), Kind)).

what_was_put_is_learnt_test() ->
    Kind = #{exercise => starl_registers_exercise},
    Put = [{106, 2, app, {call, {put, {final, 2}}, none}}, {107, 2, app, {answer, ok}}],
    Late = call({learn, {final, 2}}, 90000, 108, {error, timeout}, 199),
    ?assertEqual([not_as_promised], judge(Put ++ Late, Kind)),
    ?assertEqual([], judge(Late, Kind)),
    ?assertEqual([], judge(Put ++ [{107, 2, registers, crashed}] ++ Late, Kind)),
    ?assertEqual([not_as_promised], judge(Put ++ [{107, 3, registers, crashed}] ++ Late, Kind)),
    %% who dies may have told nobody
    ?assertEqual([], judge(Put ++ [{107, 2, robot, {died, killed}}] ++ Late, Kind)),
    %% clocks 60 s apart admit what follows a damaged store 60 s later at the latest
    Damaged = fun(At) ->
        judge([{At, 3, registers, store_damaged} | Put] ++ Late, Kind#{apart_us => 60 * ?S})
    end,
    ?assertEqual([not_as_promised], Damaged(106)),
    ?assertEqual([], Damaged(119)),
    ?assertEqual([not_as_promised], Damaged(118)),
    [
        begin
            ?assertEqual([], judge(call({What, 1}, 110, {error, any}, 111), Kind)),
            ?assertEqual(
                [not_as_promised], judge(call({What, 1}, 110, {error, restarted}, 111), Kind)
            )
        end
     || What <- [put, get, geocast]
    ].

%% A halt that is told when it is over is a heal: what is promised from then on counts from its end.
%% Holds: Monitors excuse what a halt of a node explains, and only that
%% Red: 5e00ce9; told by 1ba2a6d
a_halt_that_is_over_is_a_heal_test() ->
    Config = #{
        exercise => starl_sap_block,
        robots => [1, 2, 3],
        healed_us => 0,
        within_us => 20,
        margin_us => 5,
        bound_us => 50
    },
    Known = #{broken => [{1, 100, 130, pause}], healed_us => 130, delay_us => 0, slack_us => 0},
    M = starl_exercise_monitor,
    ?assertEqual(
        M:init(M:context(Known, maps:remove(healed_us, Config))),
        M:broken({1, 100, 130, pause}, M:init(Config))
    ),
    Never = M:init(Config#{healed_us := never, broken => [{1, 100, 130, pause}]}),
    ?assertEqual(Never, M:broken({1, 100, 130, pause}, M:init(Config#{healed_us := never}))).

%% It is told of each machine once: its own two, and those that the exercise watches.
each_machine_is_asked_for_once_test() ->
    Interests = fun(Exercise) ->
        starl_exercise_monitor:interests(
            starl_exercise_monitor:init(#{
                exercise => Exercise,
                robots => [1],
                healed_us => 0,
                within_us => 1,
                margin_us => 1,
                bound_us => 1
            })
        )
    end,
    Exercises = [
        starl_sap_block, starl_barrier_exercise, starl_mutex_exercise, starl_geocast_exercise
    ],
    [
        ?assertEqual(
            {Exercise, lists:usort([app, robot | starl_block_exercise:watches(Exercise)])},
            {Exercise, Interests(Exercise)}
        )
     || Exercise <- Exercises
    ].
