%% The positions of robots: who asks is answered by number, with a picture that was taken after the
%% question and that is not that of a system which has got stuck; a positioning system that does not
%% answer is asked again, with bounded memory.
-module(starl_location_tests).
-include_lib("eunit/include/eunit.hrl").

-define(HERE, {1.0, 2.0, 0.5}).
%% A source of 13 pictures a second.
-define(PICTURE_US, 77000).

%% Whatever the order in which pictures come.
answers_come_by_number_test() ->
    {[{sense, [1], N}, {state_timeout, 500000, again}], A} = ask(x, {pose, 1}, located_once()),
    {[{sense, [1, 2], K}], B} = ask(y, {pose, 2}, A),
    {[{reply, {app, y}, {ok, ?HERE}}, {state_timeout, 500000, again}], C} =
        located(K, [{1, {1.6, 2.0, 0.5}, 0}, {2, ?HERE, 0}], B),
    ?assertMatch(
        {[{reply, {app, x}, {ok, {1.5, 2.0, 0.5}}}, {state_timeout, cancel}], _},
        located(N, [{1, {1.5, 2.0, 0.5}, 0}], C)
    ).

%% What was not answered is asked again, all of it; an answer that comes twice is nobody's.
no_answer_is_asked_again_test() ->
    {[{sense, [1], N} | _], A} = ask(x, {pose, 1}, located_once()),
    {[{sense, [1, 2], K}], B} = ask(y, {pose, 2}, A),
    {Again, C} = step(state_timeout, again, B),
    ?assertEqual([{sense, [1], N}, {sense, [1, 2], K}, {state_timeout, 500000, again}], Again),
    {_, D} = located(N, [{1, {1.5, 2.0, 0.5}, 0}], C),
    ?assertEqual({[], D}, located(N, [{1, {1.7, 2.0, 0.5}, 0}], D)),
    {_, E} = located(K, [{1, {1.6, 2.0, 0.5}, 0}, {2, ?HERE, 0}], D),
    ?assertEqual({[], E}, located(K, [{1, {1.7, 2.0, 0.5}, 0}], E)).

%% However long the system is silent, and however often it is asked for.
open_questions_are_bounded_test() ->
    {Answers, M} = lists:foldl(
        fun(K, {Replies, Before}) ->
            {Actions, After} = ask(K, {pose, 1}, Before),
            {Replies ++ [R || {reply, _, _} = R <- Actions], After}
        end,
        {[], located_once()},
        lists:seq(1, 1000)
    ),
    ?assertEqual([{reply, {app, K}, {error, unknown}} || K <- lists:seq(1, 980)], Answers),
    {Again, _} = step(state_timeout, again, M),
    ?assertEqual(20, length([S || {sense, _, _} = S <- Again])).

%% An answer to a question of an earlier life is nobody's.
answer_of_an_earlier_life_test() ->
    {[{sense, [1], N} | _], _} = ask(x, {pose, 1}, new(#{}, 1)),
    {_, Later} = ask(y, {pose, 1}, new(#{}, 2)),
    ?assertEqual({[], Later}, located(N, [{1, ?HERE, 0}], Later)).

%% A picture that was taken before the question answers nothing: the system is asked again soon, until
%% it shows a later one.
too_old_a_picture_test() ->
    {[{sense, [1], N} | _], A} = ask(100000, x, {pose, 1}, located_once()),
    {Soon, B} = located(120000, N, [{1, ?HERE, 20001}], A),
    ?assertEqual([{{timeout, moment}, 20000, again}], Soon),
    ?assertEqual({[{sense, [1], N}], B}, step(140000, {timeout, moment}, again, B)),
    ?assertMatch(
        {[{reply, {app, x}, {ok, ?HERE}}, {state_timeout, cancel}], _},
        located(140000, N, [{1, ?HERE, 40000}], B)
    ).

%% The same for another robot's pose, whose own age only has a bound.
others_may_be_older_test() ->
    {[{sense, [1, 2], N} | _], A} = ask(100000, x, {pose, 2}, located_once(#{oldest_us => 300000})),
    There = {7.0, 7.0, 0.0},
    Answer = fun(Own, Other) ->
        {Actions, _} = located(200000, N, [{1, ?HERE, Own}, {2, There, Other}], A),
        [Word || {reply, _, Word} <- Actions]
    end,
    ?assertEqual([], Answer(100001, 0)),
    ?assertEqual([{ok, There}], Answer(100000, 300000)),
    ?assertEqual([{error, unknown}], Answer(100000, 300001)).

%% A clock that was set back is behind the question: a picture after that counts.
clock_set_back_test() ->
    {[{sense, [1], N} | _], A} = ask(5000000, x, {pose, 1}, located_once()),
    {[{{timeout, moment}, _, _}], B} = located(1000000, N, [{1, ?HERE, 0}], A),
    ?assertMatch({[{reply, _, {ok, ?HERE}} | _], _}, located(1020000, N, [{1, ?HERE, 0}], B)).

%% A live source of 13 pictures a second, asked at random moments, whether it answers with its next
%% picture or at once with its last: every question is answered, by a picture that was taken after
%% it, at most two pictures later. Two questions between two pictures get the same one.
live_13_hz_test_() ->
    [
        {lists:flatten(io_lib:format("~p, seed ~b", [How, Seed])), fun() ->
            Asks = asks(Seed),
            Got = play(How, fun measured/1, Asks),
            ?assertEqual(length(Asks), length(Got)),
            Least =
                case How of
                    next -> 0;
                    last -> 1
                end,
            [
                begin
                    {ok, {Taken, _, _}} = Answer,
                    ?assert(Taken >= At),
                    ?assert(Told - At =< (2 + Least) * ?PICTURE_US)
                end
             || {At, Told, Answer} <- Got
            ],
            Poses = [Pose || {_, _, {ok, Pose}} <- Got],
            ?assert(length(lists:usort(Poses)) < length(Poses))
        end}
     || How <- [next, last], Seed <- lists:seq(1, 5)
    ].

%% A source that is stuck from a time on, and shows its last picture as a new one: no question that is
%% asked after that picture was first shown is answered with a pose; all that were asked before it was
%% taken are.
stuck_test_() ->
    Stuck = 30 * ?PICTURE_US,
    Frozen = fun(Taken) -> measured(min(Taken, Stuck)) end,
    [
        {lists:flatten(io_lib:format("~p, seed ~b", [How, Seed])), fun() ->
            Got = play(How, Frozen, asks(Seed)),
            First = lists:min([Told || {_, Told, {ok, Pose}} <- Got, Pose =:= measured(Stuck)]),
            Before = [One || {At, _, _} = One <- Got, At =< Stuck],
            After = [One || {At, _, _} = One <- Got, At > First],
            ?assertEqual([], [A || {_, _, A} <- Before, A =:= {error, unknown}]),
            ?assert(length(After) > 10),
            ?assertEqual([], [A || {_, _, A} <- After, A =/= {error, unknown}])
        end}
     || How <- [next, last], Seed <- lists:seq(1, 5)
    ].

%% A picture that was under way when the next question was asked does not answer that: when it comes
%% again, as a new one, the system is stuck.
picture_under_way_test() ->
    {[{sense, [1], N} | _], A} = ask(0, x, {pose, 1}, located_once()),
    {[{sense, [1], K}], B} = ask(50000, y, {pose, 1}, A),
    {[{reply, {app, x}, {ok, ?HERE}} | _], C} = located(60000, N, [{1, ?HERE, 40000}], B),
    ?assertMatch(
        {[{reply, {app, y}, {error, unknown}} | _], _}, located(70000, K, [{1, ?HERE, 0}], C)
    ).

%% A source that rounds to whole millimetres shows a robot that stands the same pose again and again.
%% It is `exact', and its pictures are believed by their age alone.
whole_millimetres_test() ->
    Rounded = fun(_Taken) -> {10.0, 20.0, 0.0} end,
    Asks = asks(1),
    ?assertEqual(
        [{ok, {10.0, 20.0, 0.0}}],
        lists:usort([A || {_, _, A} <- play(next, Rounded, Asks, located_once(#{exact => true}))])
    ),
    ?assertEqual(
        [{error, unknown}],
        lists:usort([A || {_, _, A} <- tl(play(next, Rounded, Asks, located_once()))])
    ),
    {[{sense, [1], N} | _], M} = ask(100000, x, {pose, 1}, located_once(#{exact => true})),
    ?assertMatch({[{{timeout, moment}, _, _}], _}, located(150000, N, [{1, ?HERE, 50001}], M)).

%% -- a source with a pace of its own --------------------------------------------------------

%% Some eighty questions in six seconds, often several between two pictures.
asks(Seed) ->
    {Times, _} = lists:mapfoldl(
        fun(_, R0) -> rand:uniform_s(6000000, R0) end, rand:seed_s(exsss, Seed), lists:seq(1, 80)
    ),
    lists:usort(Times).

%% No two measurements are equal.
measured(Taken) -> {float(Taken), erlang:phash2(Taken) / 1000, 0.0}.

play(How, Measure, Asks) -> play(How, Measure, Asks, located_once()).

play(How, Measure, Asks, M) ->
    Ended = lists:foldl(
        fun(At, S) -> event(At, {call, {app, At}}, {pose, 1}, until(At, S)) end,
        #{how => How, measure => Measure, machine => M, waits => [], timer => none, got => []},
        Asks
    ),
    #{got := Got} = until(7000000, Ended),
    lists:reverse(Got).

%% What happens next: a picture is taken, or a moment is over.
until(T, #{timer := Timer} = S) ->
    Picture = (maps:get(at, S, 0) div ?PICTURE_US + 1) * ?PICTURE_US,
    case min(Picture, Timer) of
        Next when Next > T -> S#{at => T};
        Timer -> until(T, event(Timer, {timeout, moment}, again, S#{timer := none, at => Timer}));
        Picture -> until(T, picture(Picture, S#{at => Picture}))
    end.

%% Who waits for the next picture gets it.
picture(At, #{waits := Waits} = S) ->
    lists:foldl(fun(N, Before) -> show(At, At, N, Before) end, S#{waits := []}, Waits).

show(At, Taken, N, #{measure := Measure} = S) ->
    event(At, info, {located, N, [{1, Measure(Taken), At - Taken}]}, S).

event(At, Type, Content, #{machine := M} = S) ->
    {Actions, Next} = step(At, Type, Content, M),
    lists:foldl(fun(Action, Before) -> act(Action, At, Before) end, S#{machine := Next}, Actions).

act({sense, _, N}, _At, #{how := next, waits := Waits} = S) ->
    S#{waits := lists:usort([N | Waits])};
act({sense, _, N}, At, #{how := last} = S) ->
    show(At, At div ?PICTURE_US * ?PICTURE_US, N, S);
act({{timeout, moment}, Us, again}, At, S) ->
    S#{timer := At + Us};
act({reply, {app, Asked}, Answer}, At, #{got := Got} = S) ->
    S#{got := [{Asked, At, Answer} | Got]};
act({state_timeout, _, _}, _At, S) ->
    S;
act({state_timeout, cancel}, _At, S) ->
    S.

%% -- helpers --------------------------------------------------------------------------------

%% It has seen itself before, so that it believes the next picture.
%% A waypoint that the application puts hides one of the floor's, and outlives a restart.
a_waypoint_that_was_put_is_kept_test() ->
    Config = #{waypoints => #{dock => {1.0, 1.0}, door => {2.0, 2.0}}},
    {[{store, Kept}, {reply, {app, a}, ok}], A} =
        ask(a, {put_waypoint, dock, {5.0, 5.0}}, new(Config, 1)),
    ?assertMatch({[{reply, _, {ok, {5.0, 5.0}}}], _}, ask(b, {waypoint, dock}, A)),
    Later = new(Config#{stored => {stored, Kept}}, 2),
    All = #{dock => {5.0, 5.0}, door => {2.0, 2.0}},
    ?assertMatch({[{reply, _, {ok, All}}], _}, ask(c, waypoints, Later)).

the_floor_plan_is_told_test() ->
    Floor = starl_floor:empty({3000, 2000}),
    ?assertMatch({[{reply, _, {ok, Floor}}], _}, ask(a, floor, new(#{floor => Floor}, 1))),
    ?assertMatch({[{reply, _, {error, unknown}}], _}, ask(a, floor, new(#{}, 1))).

located_once() -> located_once(#{}).

located_once(Config) ->
    {[{sense, [1], N} | _], A} = ask(first, {pose, 1}, new(Config, 1)),
    case located(N, [{1, {0.5, 2.0, 0.5}, 0}], A) of
        {[{sense, [1], K} | _], B} ->
            {[{reply, {app, first}, {ok, _}}, {state_timeout, cancel}], C} =
                located(K, [{1, {0.6, 2.0, 0.5}, 0}], B),
            C;
        {[{reply, _, {ok, _}} | _], C} when is_map_key(exact, Config) ->
            C
    end.

new(Config, Incarnation) ->
    {_, M} = starl_machine:new(starl_location, Config, #{
        robot => 1,
        participants => [1, 2],
        name => location,
        incarnation => Incarnation,
        random => rand:seed_s(exsss, 1),
        now => 0
    }),
    M.

ask(Tag, Question, M) -> ask(0, Tag, Question, M).

ask(Now, Tag, Question, M) -> step(Now, {call, {app, Tag}}, Question, M).

located(N, Seen, M) -> located(0, N, Seen, M).

located(Now, N, Seen, M) -> step(Now, info, {located, N, Seen}, M).

step(Type, Content, M) -> step(0, Type, Content, M).

step(Now, Type, Content, M) -> starl_machine:step(Type, Content, #{now => Now, robot => 1}, M).

%% -- senses ---------------------------------------------------------------------------------

%% Who asks gets what the sense says; a sense that is silent, or that the robot has not, is an
%% error.
a_sense_is_asked_test() ->
    L = located_once(),
    Ask = {call, {app, x}},
    {[{feel, light, Tag}], A} = step(Ask, {sense, light}, L),
    Answers = [
        {{ok, 0.5}, [{trace, {felt, light}}], {ok, 0.5}},
        {none, [], {error, gone}},
        {unknown, [], {error, unknown}}
    ],
    [
        ?assertEqual({Traced ++ [{reply, {app, x}, Answer}], A}, step(info, {felt, Tag, Felt}, A))
     || {Felt, Traced, Answer} <- Answers
    ].

%% A sense that is watched is looked at in its period, and only news are told.
a_watched_sense_tells_news_test() ->
    {[{{timeout, {watch, light}}, 100, look}], A} = step(
        cast, {subscribe, light, 100}, located_once()
    ),
    {[{feel, light, Tag}, {{timeout, {watch, light}}, 100, look}], A} =
        step({timeout, {watch, light}}, look, A),
    {[{cast, app, {message, 1, sense, {light, 0.5}}}], B} = step(info, {felt, Tag, {ok, 0.5}}, A),
    ?assertEqual({[], B}, step(info, {felt, Tag, {ok, 0.5}}, B)),
    ?assertEqual({[], B}, step(info, {felt, Tag, none}, B)),
    ?assertMatch({[{cast, app, _}], _}, step(info, {felt, Tag, {ok, 0.6}}, B)).
