%% What the barrier's interface asks its machine, and what it makes of the answers.
-module(starl_barrier_interface_tests).
-include_lib("eunit/include/eunit.hrl").

-import(starl_blocks_driver, [play/2]).

%% Which round is next: with half a minute's patience, or so much.
round_test() ->
    Round = fun(R) -> starl_barrier:round(R, gate) end,
    Asked = {barrier, {round, gate}, 30000000},
    ?assertEqual({[Asked], {ok, 3}}, play(Round, [{answer, {3, 2}}])),
    ?assertEqual({[Asked], {error, timeout}}, play(Round, [timeout])),
    ?assertEqual({[Asked], {error, restarted}}, play(Round, [restarted])),
    ?assertEqual(
        {[{barrier, {round, gate}, 7000}], {ok, 3}},
        play(fun(R) -> starl_barrier:round(R, gate, 7) end, [{answer, {3, 2}}])
    ).

%% It waits for the round that is next; the machine knows how long.
sync_test() ->
    Sync = fun(R) -> starl_barrier:sync(R, gate) end,
    Asked = [
        {barrier, {round, gate}, 30000000}, {barrier, {sync, gate, {3, 2}, 30000000}, infinity}
    ],
    [
        ?assertEqual({Asked, Answer}, play(Sync, [{answer, {3, 2}}, {answer, Answer}]))
     || Answer <- [ok, {error, timeout}]
    ],
    ?assertEqual({[hd(Asked)], {error, timeout}}, play(Sync, [timeout])),
    ?assertEqual(
        {[{barrier, {round, gate}, 7000}, {barrier, {sync, gate, {3, 2}, 7000}, infinity}], ok},
        play(fun(R) -> starl_barrier:sync(R, gate, 7) end, [{answer, {3, 2}}, {answer, ok}])
    ).

%% The timeout is that of the whole call: what has passed until the round was known is gone.
%% Holds: The timeout of `starl_barrier:sync/3` is that of the whole call
%% Red: fb2bcdb5, run: *calls broken: no answer* after 80 s of 67
timeout_of_the_whole_call_test() ->
    Sync = fun(R) -> starl_barrier:sync(R, gate, 7000) end,
    Waited = fun(Us) -> [{at, Us, {answer, {3, 2}}}, {answer, {error, timeout}}] end,
    Asked = fun(Us) ->
        [{barrier, {round, gate}, 7000000}, {barrier, {sync, gate, {3, 2}, Us}, infinity}]
    end,
    [
        ?assertEqual({Asked(Left), {error, timeout}}, play(Sync, Waited(Us)))
     || {Us, Left} <- [
            {0, 7000000}, {5000000, 2000000}, {6999000, 1000}, {7000000, 0}, {9000000, 0}
        ]
    ].

%% A new machine is told which round was not passed, as often as need be: a round that was passed
%% just before the crash is not taken for this one.
restarted_test() ->
    Resume = {barrier, {resume, gate, {3, 2}}, infinity},
    {Asked, Answer} = play(
        fun(R) -> starl_barrier:sync(R, gate) end,
        [{answer, {3, 2}}, restarted, restarted, {answer, ok}]
    ),
    ?assertEqual({error, restarted}, Answer),
    ?assertEqual([Resume, Resume], lists:nthtail(2, Asked)).

%% The mistake in a call is told with the function that was called, before anything is asked.
mistake_test() ->
    Robot = starl:robot(1, [1, 2]),
    [
        ?assertError(
            {bad_argument, #{function := {starl_barrier, Function, 3}, argument := Argument}},
            starl_barrier:Function(Robot, Name, Ms)
        )
     || Function <- [round, sync],
        {Argument, Name, Ms} <- [{'Ms', gate, 0}, {'Name', self(), 7}]
    ].

blocks_test() ->
    ?assertEqual([{barrier, starl_barrier_rounds, #{}}], starl_barrier:machines(#{})),
    Options = #{retry_ms => 7},
    ?assertEqual([{barrier, starl_barrier_rounds, Options}], starl_barrier:machines(Options)).

declared_test() ->
    ?assertMatch(
        [{retry_ms, {integer, 1, 1000000000}, 3000, _}, {names, {integer, 1, 1000000}, 256, _}],
        starl_barrier:options()
    ),
    ?assertEqual(
        [{starl_barrier_monitor, #{robots => [1, 2], retry_us => 7000}}],
        starl_barrier:monitors(#{retry_ms => 7}, #{robots => [1, 2]})
    ),
    ?assertEqual(
        [{together, []}, {once, [store]}, {passed, [alive, {sap, delivered}]}],
        [{Name, Needs} || {Name, _, _, Needs} <- starl_barrier:guarantees()]
    ),
    #{workload := #{turns := 5}, operations := rounds, packets := Packets} = starl_barrier:benchmark(),
    ?assertEqual([1, 25], [Packets(N) || N <- [1, 5]]).

%% -- the exercise -------------------------------------------------------------------------------

exercise_test() ->
    ?assertMatch([{retry, {integer, 10, 1000000}, 3000, _}], starl_barrier_exercise:flags()),
    Use = #{retry => 200},
    ?assertEqual(#{retry_ms => 200}, starl_barrier_exercise:block_options(Use)),
    ?assertEqual(20400, starl_barrier_exercise:within_ms(Use)),
    ?assertEqual(200, starl_barrier_exercise:again_ms(Use)),
    ?assertEqual(
        #{retry => [500, 1000, 3000]}, starl_barrier_exercise:draw(fun(retry, All) -> All end)
    ),
    ?assertEqual([barrier], starl_barrier_exercise:watches()).

%% A round is promised to be passed once all have reached it or a later one, and none has died.
a_round_is_promised_when_all_have_reached_it_test() ->
    Team = #{robots => [1, 2], died => [], healed_us => 0, within_us => 100, reach_us => 0},
    Call = #{what => {sync, gate}, robot => 1, since_us => 5, patience_ms => 9},
    Reached = fun(Events) ->
        lists:foldl(
            fun starl_barrier_exercise:noted/2, starl_barrier_exercise:seen([1, 2]), Events
        )
    end,
    At = fun(T, Robot, Name, K) -> {T, Robot, barrier, {reached, Name, K}} end,
    Due = fun(Events) ->
        case starl_barrier_exercise:promise(Call, Team, Reached(Events)) of
            none -> none;
            {Us, Is} -> {Us, Is(ok), Is({error, timeout})}
        end
    end,
    ?assertEqual({130, true, false}, Due([At(10, 1, gate, 1), At(30, 2, gate, 1)])),
    ?assertEqual({130, true, false}, Due([At(10, 1, gate, 1), At(30, 2, gate, 2)])),
    ?assertEqual(
        {150, true, false},
        Due([At(10, 1, gate, 1), At(20, 2, gate, 1), At(30, 1, gate, 2), At(50, 2, gate, 2)])
    ),
    [
        ?assertEqual({Events, none}, {Events, Due(Events)})
     || Events <- [
            [],
            [At(10, 1, gate, 1)],
            [At(10, 2, gate, 1)],
            [At(10, 1, gate, 2), At(30, 2, gate, 1)],
            [At(10, 1, gate, 1), At(30, 2, other, 1)],
            [At(10, 1, gate, 1), {30, 2, barrier, {passed, gate, 1}}]
        ]
    ],
    ?assertEqual(none, starl_barrier_exercise:promise(Call#{what := other}, Team, #{})).

%% -- the model ----------------------------------------------------------------------------------

model_test() ->
    [{barrier, _, Model}] = starl_barrier:models(),
    #{script := Script, inert := Inert} = Made = Model(#{robots => [4, 5], rounds => 2}),
    ?assertMatch(
        #{
            blocks := [{barrier, starl_barrier_rounds, #{}}],
            crash := [barrier, app],
            monitor := {starl_barrier_monitor, #{robots := [4, 5]}}
        },
        Made
    ),
    ?assertEqual([{talk, starl_barrier_model, {gate, 2}} || _ <- [1, 2]], Script(4)),
    ?assertEqual(
        [true, false, true, false],
        [
            Inert(barrier, {reached, n, 1, 1, false}),
            Inert(barrier, {reached, n, 1, 1, true}),
            Inert(barrier, {told, n, 1, 1}),
            Inert(other, {told, n, 1, 1})
        ]
    ).

%% It asks which round is next and passes it, up to the last; a new machine is told which one it was, and a
%% call that has failed is made again.
the_talk_of_a_round_test() ->
    Gate = {gate, 2},
    ?assertEqual({barrier, {round, gate}, round}, starl_barrier_model:first(Gate)),
    Progress = {2, 1},
    Answered = fun(Mark, Answer) -> starl_barrier_model:answered(Mark, Answer, Gate) end,
    ?assertEqual(
        {call, {barrier, {sync, gate, Progress, 30000000}, {sync, Progress}}},
        Answered(round, Progress)
    ),
    ?assertEqual(over, Answered(round, {3, 2})),
    ?assertEqual(over, Answered({sync, Progress}, ok)),
    ?assertEqual(again, Answered({sync, Progress}, {error, timeout})),
    ?assertEqual(again, Answered({resume, Progress}, ok)),
    ?assertEqual(again, starl_barrier_model:restarted(round, Gate)),
    [
        ?assertEqual(
            {call, {barrier, {resume, gate, Progress}, {resume, Progress}}},
            starl_barrier_model:restarted({Mark, Progress}, Gate)
        )
     || Mark <- [sync, resume]
    ].
