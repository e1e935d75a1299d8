%% The positions of robots: who asks is answered in turn, and a positioning system that does not
%% answer is asked again, with bounded memory.
-module(starl_location_tests).
-include_lib("eunit/include/eunit.hrl").

-define(HERE, {1.0, 2.0, 0.5}).

answers_come_in_turn_test() ->
    {[{sense, [1]}, {state_timeout, 500000, again}], A} = ask(x, {pose, 1}, located_once()),
    {[{sense, [1, 2]}], B} = ask(y, {pose, 2}, A),
    {[{reply, {app, x}, {ok, {1.5, 2.0, 0.5}}}, {state_timeout, 500000, again}], C} =
        located([{1, {1.5, 2.0, 0.5}}], B),
    ?assertMatch(
        {[{reply, {app, y}, {ok, ?HERE}}, {state_timeout, cancel}], _},
        located([{1, {1.6, 2.0, 0.5}}, {2, ?HERE}], C)
    ).

%% What was not answered is asked again, all of it; an answer that comes twice is nobody's.
no_answer_is_asked_again_test() ->
    {_, A} = ask(x, {pose, 1}, located_once()),
    {_, B} = ask(y, {pose, 2}, A),
    {Again, C} = step(state_timeout, again, B),
    ?assertEqual([{sense, [1]}, {sense, [1, 2]}, {state_timeout, 500000, again}], Again),
    {_, D} = located([{1, {1.5, 2.0, 0.5}}], C),
    {_, E} = located([{1, {1.6, 2.0, 0.5}}, {2, ?HERE}], D),
    ?assertEqual({[], E}, located([{1, {1.7, 2.0, 0.5}}], E)).

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
    ?assertEqual(20, length([S || {sense, _} = S <- Again])).

%% It has seen itself before, so that it believes the next picture.
located_once() ->
    {_, M} = starl_machine:new(starl_location, #{}, #{
        robot => 1, participants => [1, 2], name => location, incarnation => 1,
        random => rand:seed_s(exsss, 1), now => 0
    }),
    {_, A} = ask(first, {pose, 1}, M),
    {_, B} = located([{1, {0.5, 2.0, 0.5}}], A),
    {[{reply, {app, first}, {ok, _}}, {state_timeout, cancel}], C} =
        located([{1, {0.6, 2.0, 0.5}}], B),
    C.

ask(Tag, Question, M) -> step({call, {app, Tag}}, Question, M).

located(Poses, M) -> step(info, {located, Poses}, M).

step(Type, Content, M) -> starl_machine:step(Type, Content, #{now => 0, robot => 1}, M).
