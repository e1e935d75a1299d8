%% Who waits for tokens in vain, and why.
-module(starl_mutex_waits_tests).
-include_lib("eunit/include/eunit.hrl").

%% What is held at the end of its robot's application is kept, whoever asks before or after.
an_ended_robot_keeps_its_token_test() ->
    ?assertEqual(
        #{kept => [#{robot => 1, token => door, asked => [2, 3]}], circles => []},
        waits([
            acquired(1, door),
            requested(2, door),
            {5, 2, mutex, {failed, door, timeout}},
            {6, 1, app, {done, x}},
            requested(3, door)
        ])
    ).

%% Who has released it, lost it, or started its machine anew keeps nothing; nor does a robot at work.
no_token_is_kept_test() ->
    Ends = [
        [{5, 1, mutex, {released, door, 1}}, {6, 1, app, {done, x}}],
        [{5, 1, app, {done, x}}, {6, 1, mutex, {lease_lost, door, 1}}],
        [{5, 1, app, {done, x}}, {6, 1, mutex, crashed}],
        [{5, 1, app, {done, x}}, {6, 1, robot, {died, killed}}],
        [{5, 1, app, {done, x}}, {6, 2, mutex, {acquired, door, 2}}],
        []
    ],
    [
        ?assertEqual(#{kept => [], circles => []}, waits([acquired(1, door) | End]))
     || End <- Ends
    ].

%% A robot at work that holds a token for longer than another one's patience keeps it, too: since then.
a_robot_at_work_keeps_its_token_test() ->
    Failed = fun(T, Robot) -> {T, Robot, mutex, {failed, door, timeout}} end,
    Kept = fun(Events) ->
        #{kept := Kept} = waits([acquired(1, door), requested(2, door) | Events]),
        Kept
    end,
    ?assertEqual(
        [#{robot => 1, token => door, asked => [2], since_us => 1}], Kept([Failed(5, 2)])
    ),
    ?assertEqual([], Kept([])),
    ?assertEqual([], Kept([Failed(5, 2), {6, 1, mutex, {released, door, 1}}])),
    %% of the hold before that says nothing
    ?assertEqual([], Kept([Failed(5, 2), {6, 3, mutex, {acquired, door, 2}}])).

%% Two robots, three robots, and one that asks for its own; each circle is told once.
circles_test() ->
    Holds = [acquired(1, a), acquired(2, b), acquired(3, c)],
    Circle = fun(Asks) ->
        #{circles := Circles} = waits(Holds ++ [requested(R, Token) || {R, Token} <- Asks]),
        Circles
    end,
    ?assertEqual([#{at_us => 2, waits => [{1, a}, {2, b}]}], Circle([{1, b}, {2, a}])),
    ?assertEqual(
        [#{at_us => 2, waits => [{1, a}, {2, b}, {3, c}]}], Circle([{1, b}, {2, c}, {3, a}])
    ),
    ?assertEqual([#{at_us => 2, waits => [{1, a}]}], Circle([{1, a}, {1, a}])),
    ?assertEqual([], Circle([{1, b}, {2, c}])),
    ?assertEqual([], Circle([{1, d}, {2, d}])).

%% Who has given up waits for nobody.
no_circle_after_a_failure_test() ->
    ?assertMatch(
        #{circles := []},
        waits([
            acquired(1, a),
            acquired(2, b),
            requested(1, b),
            {2, 1, mutex, {failed, b, timeout}},
            requested(2, a)
        ])
    ).

acquired(Robot, Token) -> {1, Robot, mutex, {acquired, Token, 1}}.

requested(Robot, Token) -> {2, Robot, mutex, {requested, Token}}.

waits(Events) ->
    Step = fun(Event, State) ->
        {ok, Next} = starl_mutex_waits:step(Event, State),
        Next
    end,
    {ok, Waits} = starl_mutex_waits:finish(
        9, lists:foldl(Step, starl_mutex_waits:init(#{}), Events)
    ),
    Waits.
