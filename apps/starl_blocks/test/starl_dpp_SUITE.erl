%% The contract of DPP (DESIGN section 3) held by its machines: reservations are pairwise
%% disjoint whatever is lost, doubled or late; a lost assignment keeps its reservation until the
%% next request clears it; a late Clear frees nothing; crashes of the coordinator and of
%% participants keep all that robots hold.
-module(starl_dpp_SUITE).
-include_lib("stdlib/include/assert.hrl").
-include_lib("proper/include/proper.hrl").

-export([suite/0, all/0, groups/0, init_per_suite/1, end_per_suite/1]).
-export([
    request_certifies_the_place/1, request_without_coordinator/1, answer_is_taken_once/1,
    stale_answers_are_refused/1, lost_answer_is_asked_for_again/1, lost_pose_is_asked_for_again/1,
    ids_ascend_over_a_crash/1, recover_while_standing/1, recover_while_moving/1,
    recover_while_asking/1, recover_after_a_crash_says_nothing/1, earlier_epoch_is_ignored/1,
    painted_goes_with_the_next_request/1, passed_is_told_now_and_then/1,
    nothing_is_assigned_before_all_are_known/1, each_request_is_answered_once/1,
    old_request_is_ignored/1, late_clear_frees_nothing/1, clear_frees_what_is_behind/1,
    lost_assignment_stays_reserved/1, state_of_an_earlier_epoch_is_ignored/1,
    recovered_reservation_is_kept/1, unreachable_unknown_robot_ends/1,
    coordinator_crashes_while_robots_move/1, participant_crashes_while_robots_move/1,
    crashes_at_random/1
]).

-define(CONFIG, #{
    segments => [{{3000.0, 3000.0}, {7000.0, 3000.0}}, {{3000.0, 7000.0}, {7000.0, 7000.0}}],
    world => {10000.0, 10000.0}, tube_radius => 220.0, slack => 10.0, horizon => 2000.0,
    seed => 1, speed => 500.0
}).

suite() -> [{timetrap, {minutes, 2}}].

all() -> [{group, participant}, {group, coordinator}, {group, simulated}].

groups() ->
    [
        {participant, [], [
            request_certifies_the_place, request_without_coordinator, answer_is_taken_once,
            stale_answers_are_refused, lost_answer_is_asked_for_again,
            lost_pose_is_asked_for_again, ids_ascend_over_a_crash, recover_while_standing,
            recover_while_moving, recover_while_asking, recover_after_a_crash_says_nothing,
            earlier_epoch_is_ignored, painted_goes_with_the_next_request,
            passed_is_told_now_and_then
        ]},
        {coordinator, [], [
            nothing_is_assigned_before_all_are_known, each_request_is_answered_once,
            old_request_is_ignored, late_clear_frees_nothing, clear_frees_what_is_behind,
            lost_assignment_stays_reserved, state_of_an_earlier_epoch_is_ignored,
            recovered_reservation_is_kept, unreachable_unknown_robot_ends
        ]},
        {simulated, [], [
            coordinator_crashes_while_robots_move, participant_crashes_while_robots_move,
            crashes_at_random
        ]}
    ].

init_per_suite(Config) ->
    #{level := Level} = logger:get_primary_config(),
    ok = logger:set_primary_config(level, none),
    [{level, Level} | Config].

end_per_suite(Config) -> logger:set_primary_config(level, proplists:get_value(level, Config)).

%% -- the participant ------------------------------------------------------------------------

%% A request says where the robot stands: it is stopped first, then located.
request_certifies_the_place(_) ->
    {Stop, P1} = step({call, {app, 1}}, request, joined()),
    [{call, motion, stop, {halted, N}}] = [A || {call, motion, _, _} = A <- Stop],
    {Look, P2} = step({reply, {halted, N}}, ok, P1),
    ?assertEqual([{call, location, {pose, 1}, {pose, N}}], Look),
    {Ask, _} = step({reply, {pose, N}}, {ok, {1.0, 2.0, 0.0}}, P2),
    ?assertMatch([{call, sap, {send, 4, dpp_request, {{1, _}, {1.0, 2.0}, []}}, _}],
                 [A || {call, sap, _, _} = A <- Ask]).

request_without_coordinator(_) ->
    {Actions, _} = step({call, {app, 1}}, request, participant(1)),
    ?assertEqual([{reply, {app, 1}, {error, no_coordinator}}], Actions).

answer_is_taken_once(_) ->
    {Id, P} = asking(joined()),
    {Actions, Moving} = answer(4, 1, Id, P),
    ?assertEqual([{reply, {app, 1}, {ok, {Id, path()}}}], replies(Actions)),
    {Again, _} = answer(4, 1, Id, Moving),
    ?assertEqual([{trace, {stale_answer, 4, 1, Id}}], Again).

%% Answers to another request, of an earlier epoch or of another robot are dropped, and traced.
stale_answers_are_refused(_) ->
    {{I, N} = Id, P} = asking(joined()),
    {_, Aware} = step(cast, {message, 4, dpp_recover, 3}, P),
    [
        ?assertMatch({[{trace, {stale_answer, _, _, _}}], _}, answer(Source, Epoch, Which, Aware))
     || {Source, Epoch, Which} <- [
            {4, 3, {I, N - 1}}, {4, 3, {I, N + 1}}, {4, 2, Id}, {3, 3, Id}, {4, 3, {I + 1, N}}
        ]
    ].

lost_answer_is_asked_for_again(_) ->
    {First, P} = asking(joined()),
    {Actions, Again} = step({timeout, again}, request, P),
    [Second] = [Id || {call, sap, {send, 4, dpp_request, {Id, {1.0, 2.0}, []}}, _} <- Actions],
    ?assert(Second > First),
    ?assertMatch({[{trace, {stale_answer, 4, 1, First}}], _}, answer(4, 1, First, Again)),
    {Taken, _} = answer(4, 1, Second, Again),
    ?assertMatch([_], replies(Taken)).

lost_pose_is_asked_for_again(_) ->
    {_, P1} = step({call, {app, 1}}, request, joined()),
    {Actions, _} = step({timeout, look}, look, P1),
    ?assertMatch([{call, motion, stop, {halted, _}}, {{timeout, look}, _, look}], Actions).

ids_ascend_over_a_crash(_) ->
    {First, _} = asking(joined()),
    {Second, _} = asking(joined(2)),
    ?assert(Second > First).

%% A coordinator that starts anew is told where the robot stands, once it is stopped and seen.
recover_while_standing(_) ->
    {Stop, P1} = step(cast, {message, 3, dpp_recover, 1}, participant(1)),
    [{call, motion, stop, {halted, N}}] = [A || {call, motion, _, _} = A <- Stop],
    {_, P2} = step({reply, {halted, N}}, ok, P1),
    {Told, P3} = step({reply, {pose, N}}, {ok, {1.0, 2.0, 0.0}}, P2),
    ?assertMatch([{cast, sap, {send, 3, dpp_state, {1, _, {standing, {1.0, 2.0}}, []}}}],
                 [A || {cast, sap, _} = A <- Told]),
    {Twice, _} = step({reply, {pose, N}}, {ok, {1.0, 2.0, 0.0}}, P3),
    ?assertEqual([], [A || {cast, sap, _} = A <- Twice]).

%% Or what of its path is before it.
recover_while_moving(_) ->
    {Id, P} = asking(joined()),
    {_, Moving} = answer(4, 1, Id, P),
    {_, Passed} = step(cast, {passed, Id, 1, hd(path())}, Moving),
    {Told, _} = step(cast, {message, 4, dpp_recover, 2}, Passed),
    [First | Rest] = path(),
    ?assertEqual(
        [{cast, sap, {send, 4, dpp_state, {2, Id, {moving, 1, element(1, First), Rest}, [7]}}}],
        Told
    ).

%% A robot that asks tells its place and asks anew; an answer of the coordinator before that is
%% refused.
recover_while_asking(_) ->
    {Id, P} = asking(joined()),
    {Told, Aware} = step(cast, {message, 4, dpp_recover, 2}, P),
    ?assertMatch([{cast, sap, {send, 4, dpp_state, {2, Id, {standing, {1.0, 2.0}}, []}}}],
                 [A || {cast, sap, _} = A <- Told]),
    ?assertMatch([_], [A || {{timeout, again}, _, _} = A <- Told]),
    ?assertMatch({[{trace, {stale_answer, _, _, _}}], _}, answer(4, 1, Id, Aware)).

%% Pitfall: a participant that has crashed does not know whether its robot drives. It says
%% nothing of its place until a request has stopped the robot.
recover_after_a_crash_says_nothing(_) ->
    {Silent, P} = step(cast, {message, 4, dpp_recover, 2}, participant(2)),
    ?assertEqual([], Silent),
    {_, P1} = step({call, {app, 1}}, {join, 4}, P),
    {Stop, P2} = step({call, {app, 1}}, request, P1),
    [{call, motion, stop, {halted, N}}] = [A || {call, motion, _, _} = A <- Stop],
    {_, P3} = step({reply, {halted, N}}, ok, P2),
    {Ask, _} = step({reply, {pose, N}}, {ok, {1.0, 2.0, 0.0}}, P3),
    ?assertMatch([_], [A || {cast, sap, {send, 4, dpp_state, _}} = A <- Ask]),
    ?assertMatch([_], [A || {call, sap, {send, 4, dpp_request, _}, _} = A <- Ask]).

earlier_epoch_is_ignored(_) ->
    {Id, P} = asking(joined()),
    {_, P2} = answer(4, 5, Id, P),
    ?assertMatch({[], _}, step(cast, {message, 4, dpp_recover, 3}, P2)).

painted_goes_with_the_next_request(_) ->
    {Id, P} = asking(joined()),
    {_, Moving} = answer(4, 1, Id, P),
    {_, Passed} = step(cast, {passed, Id, 1, hd(path())}, Moving),
    {Stop, P1} = step({call, {app, 2}}, request, Passed),
    [{call, motion, stop, {halted, N}}] = [A || {call, motion, _, _} = A <- Stop],
    {_, P2} = step({reply, {halted, N}}, ok, P1),
    {Ask, _} = step({reply, {pose, N}}, {ok, {1.0, 2.0, 0.0}}, P2),
    ?assertMatch([[7]], [Fresh || {call, sap, {send, 4, dpp_request, {_, _, Fresh}}, _} <- Ask]).

passed_is_told_now_and_then(_) ->
    {Id, P} = asking(joined()),
    {_, Moving} = answer(4, 1, Id, P),
    {Near, P1} = step(cast, {passed, Id, 1, {{50.0, 2.0}, up}}, Moving),
    ?assertEqual([], Near),
    {Far, _} = step(cast, {passed, Id, 2, {{900.0, 2.0}, up}}, P1),
    ?assertEqual([{cast, sap, {send, 4, dpp_passed, {Id, 2}}}], Far).

participant(Incarnation) ->
    {_, P} = starl_machine:new(starl_dpp_participant, #{}, base(1, dpp, Incarnation)),
    P.

joined() -> joined(1).

joined(Incarnation) ->
    {[{reply, _, ok}], P} = step({call, {app, 0}}, {join, 4}, participant(Incarnation)),
    P.

%% A participant that waits for an answer, and its request.
asking(P0) ->
    {Stop, P1} = step({call, {app, 1}}, request, P0),
    [{call, motion, stop, {halted, N}}] = [A || {call, motion, _, _} = A <- Stop],
    {_, P2} = step({reply, {halted, N}}, ok, P1),
    {Ask, P3} = step({reply, {pose, N}}, {ok, {1.0, 2.0, 0.0}}, P2),
    [Id] = [Id || {call, sap, {send, 4, dpp_request, {Id, _, _}}, _} <- Ask],
    {Id, P3}.

answer(Source, Epoch, Id, P) ->
    step(cast, {message, Source, dpp_answer, {Epoch, Id, {assign, path()}}}, P).

path() -> [{{100.0, 2.0}, {down, 7}}, {{300.0, 2.0}, up}, {{900.0, 2.0}, {down, 8}}].

replies(Actions) -> [A || {reply, _, _} = A <- Actions].

%% -- the coordinator ------------------------------------------------------------------------

nothing_is_assigned_before_all_are_known(_) ->
    {First, C1} = ask(1, 1, spot(1), coordinator(1)),
    ?assert(lists:member({cast, sap, {broadcast, dpp_recover, 1}}, First)),
    ?assertEqual([], answers(First)),
    {Second, _} = ask(2, 1, spot(2), C1),
    ?assertMatch([{2, {assign, _}} | _], answers(Second)).

%% Each request gets one answer; a doubled request gets no second one.
each_request_is_answered_once(_) ->
    {_, Id, _, C} = assigned(),
    {Again, _} = request(2, Id, spot(2), C),
    ?assertEqual([], Again).

old_request_is_ignored(_) ->
    {_, {I, N}, Held, C} = assigned(),
    {Old, C1} = request(2, {I, N - 1}, spot(2), C),
    ?assertEqual([], Old),
    ?assertEqual(Held, held(2, C1)).

%% Pitfall: a late or doubled Clear of an earlier path frees space of the present one.
late_clear_frees_nothing(_) ->
    {_, {I, N}, Held, C} = assigned(),
    {Late, C1} = step(cast, {message, 2, dpp_passed, {{I, N - 1}, 1}}, C),
    ?assertEqual([], Late),
    ?assertEqual(Held, held(2, C1)).

clear_frees_what_is_behind(_) ->
    {_, Id, Held, C} = assigned(),
    {_, C1} = step(cast, {message, 2, dpp_passed, {Id, 1}}, C),
    Left = held(2, C1),
    ?assertNotEqual(Held, Left),
    {_, C2} = step(cast, {message, 2, dpp_passed, {Id, 1}}, C1),
    ?assertEqual(Left, held(2, C2)).

%% Pitfall: the assignment is lost, the reservation stays; the robot's next request clears it.
lost_assignment_stays_reserved(_) ->
    {_, {I, N}, Held, C} = assigned(),
    {Lost, C1} = step({reply, {answered, 2}}, {error, lost}, C),
    ?assert(lists:member({trace, {silent, 2}}, Lost)),
    ?assertEqual(Held, held(2, C1)),
    {Next, C2} = request(2, {I, N + 5}, spot(2), C1),
    ?assertMatch([{2, {assign, _}} | _], answers(Next)),
    ?assertMatch([_ | _], held(2, C2)).

state_of_an_earlier_epoch_is_ignored(_) ->
    {_, C1} = ask(1, 1, spot(1), coordinator(2)),
    {Late, _} = step(cast, {message, 2, dpp_state, {1, {1, 9}, {standing, spot(2)}, []}}, C1),
    ?assertEqual([], Late).

%% What a robot says that it holds is its reservation with the new coordinator, too.
recovered_reservation_is_kept(_) ->
    {[{2, {assign, Path}} | _], Id, Held, _} = assigned(),
    {_, C1} = ask(1, 1, spot(1), coordinator(2)),
    State = {2, Id, {moving, 0, spot(2), Path}, []},
    {_, C2} = step(cast, {message, 2, dpp_state, State}, C1),
    ?assertEqual(Held, held(2, C2)),
    %% and a doubled report changes nothing
    {Twice, _} = step(cast, {message, 2, dpp_state, State}, C2),
    ?assertEqual([], Twice).

%% A robot that is dead before its place is known does not stop the others for ever: who waits
%% gets an answer in bounded time.
unreachable_unknown_robot_ends(_) ->
    {First, C1} = ask(1, 1, spot(1), coordinator(1)),
    ?assertMatch([_ | _], run_timers(timers(First), 0, C1)).

%% The answers given within ten minutes in which nothing is heard of anybody.
run_timers(_Timers, Us, _C) when Us > 600000000 -> [];
run_timers(Timers, _Us, C) ->
    case lists:sort([{Due, Name, Content} || {Name, {Due, Content}} <- maps:to_list(Timers)]) of
        [] ->
            [];
        [{Due, Name, Content} | _] ->
            {Actions, Next} = step({timeout, Name}, Content, C),
            Left = maps:merge(maps:remove(Name, Timers),
                              maps:map(fun(_, {D, X}) -> {D + Due, X} end, timers(Actions))),
            answers(Actions) ++ run_timers(Left, Due, Next)
    end.

timers(Actions) -> maps:from_list([{Name, {Us, X}} || {{timeout, Name}, Us, X} <- Actions]).

coordinator(Epoch) ->
    {_, C} = starl_machine:new(starl_dpp_coordinator, ?CONFIG, base(1, dpp_coordinator, Epoch)),
    C.

%% Both robots are known; robot 2 has an assignment: the answers, its request, what it holds.
assigned() ->
    {_, C1} = ask(1, 1, spot(1), coordinator(1)),
    {Actions, C2} = ask(2, 5, spot(2), C1),
    [{2, {assign, _}} | _] = Answers = answers(Actions),
    {Answers, {1, 5}, held(2, C2), C2}.

ask(Robot, N, At, C) -> request(Robot, {1, N}, At, C).

request(Robot, Id, At, C) -> step(cast, {message, Robot, dpp_request, {Id, At, []}}, C).

answers(Actions) -> [{R, A} || {call, sap, {send, R, dpp_answer, {_, _, A}}, _} <- Actions].

%% What the plan inside the coordinator holds for a robot: by the trace of the next report.
held(Robot, C) ->
    Plans = [P || P <- tuple_to_list(starl_machine:data(C)), is_tuple(P), element(1, P) =:= plan],
    [Plan] = Plans,
    {Robot, Segments} = lists:keyfind(Robot, 1, starl_dpp_plan:unsafe(Plan)),
    Segments.

spot(Robot) ->
    {ok, Plan} = starl_dpp_plan:new((maps:remove(speed, ?CONFIG))#{robots => [1, 2]}),
    starl_dpp_plan:spot(Robot, Plan).

base(Robot, Name, Incarnation) ->
    #{
        robot => Robot, participants => [1, 2], name => Name, incarnation => Incarnation,
        random => rand:seed_s(exsss, 1), now => 0
    }.

step(Type, Content, M) -> starl_machine:step(Type, Content, #{now => 0, robot => 1}, M).

%% -- in the simulator: the monitors judge ---------------------------------------------------

%% The coordinator of every robot is killed at every three seconds of a run with loss.
coordinator_crashes_while_robots_move(_) ->
    [
        paints(Seed, 0.3, [{T + Seed * 500, R, dpp_coordinator} || T <- lists:seq(2000, 90000, 6000),
                                                        R <- [1, 2, 3, 4]])
     || Seed <- [1, 2, 3]
    ].

%% Likewise the participants, while their applications drive on.
participant_crashes_while_robots_move(_) ->
    [
        paints(Seed, 0.3, [{T + 700 * R, R, dpp} || T <- lists:seq(2000, 90000, 7000), R <- [1, 2, 3, 4]])
     || Seed <- [1, 2, 3]
    ].

crashes_at_random(_) ->
    Prop = ?FORALL(
        {Seed, Loss, Kills},
        {oneof(lists:seq(1, 1000)), oneof([0.0, 0.2, 0.4]),
         resize(30, list({oneof(lists:seq(0, 90000, 17)), oneof([1, 2, 3, 4]),
                          oneof([dpp, dpp_coordinator])}))},
        starl_platform_ct:safely(fun() -> paints(Seed, Loss, Kills) end)
    ),
    starl_platform_ct:property(Prop, 20).

paints(Seed, Loss, Kills) ->
    Faults = [
        {list_to_atom("fault" ++ integer_to_list(K)), T, T, kill_machine, {R, M}, #{}}
     || {K, {T, R, M}} <- lists:zip(lists:seq(1, length(Kills)), Kills)
    ],
    {ok, Sim} = starl_sim:start(#{
        app => starl_painting, robots => 4, picture => "house", seed => Seed, loss => Loss,
        duplicate => 0.2, delay => {5, 80}, faults => Faults, time => 5000
    }),
    #{ending := Ending} = starl_sim:run(Sim),
    {#{violations := Violations, robots := Robots}, #{figures := Figures}} = starl_sim:finish(Sim),
    ?assertEqual(
        {[], done, 1.0, [{done, complete}]},
        {Violations, Ending, proplists:get_value(ink_covered, Figures),
         lists:usort([S || {_, #{result := S}} <- Robots])},
        {Seed, Loss, Kills}
    ),
    true.
