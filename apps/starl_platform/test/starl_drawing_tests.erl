%% What applications draw: shapes that are none are refused with what is expected, and a drawing is seen until its
%% life ends or another one of its key takes its place.
%%
%% Holds: A drawing is seen until its life ends or another one of its key takes its place, in film,
%% recording and window
%% Red: the later end taken for the earlier; a film, and a page, that draws none
-module(starl_drawing_tests).
-include_lib("eunit/include/eunit.hrl").

new(Shape) -> starl_drawing:new(Shape).

shapes_test() ->
    {ok, Line} = new(#{key => way, line => [{0, 0}, {1, 2.5}], seconds => 0.5, colour => red}),
    ?assertEqual(
        #{
            key => way,
            kind => line,
            points => [{0, 0}, {1, 2.5}],
            text => <<>>,
            life_us => 500000,
            colour => red
        },
        Line
    ),
    {ok, Text} = new(#{key => {word, 3}, text => ["ä", <<"b">>], at => {5, 6}}),
    ?assertMatch(
        #{kind := text, text := <<"äb"/utf8>>, points := [{5, 6}], life_us := infinity}, Text
    ),
    ?assertMatch({ok, #{kind := area}}, new(#{key => a, area => starl_drawing:circle({0, 0}, 5)})),
    ?assertMatch({ok, #{points := []}}, new(#{key => a, points => []})).

mistakes_test_() ->
    [
        ?_assertMatch({_, {error, _}}, {Shape, new(Shape)})
     || Shape <- [
            way,
            #{},
            #{key => "way", points => []},
            #{key => {a, b}, points => []},
            #{key => a},
            #{key => a, points => [], line => []},
            #{key => a, points => [], size => 3},
            #{key => a, points => [{0}]},
            #{key => a, points => [{0, infinity}]},
            #{key => a, points => [{0, 1.0e10}]},
            #{key => a, points => [{0, 0} | {1, 1}]},
            #{key => a, points => lists:duplicate(1001, {0, 0})},
            #{key => a, points => [], seconds => 0},
            #{key => a, points => [], seconds => forever},
            #{key => a, points => [], colour => pink},
            #{key => a, text => "no place"},
            #{key => a, text => [x], at => {0, 0}},
            #{key => a, text => lists:duplicate(201, $a), at => {0, 0}},
            #{key => a, text => "a", at => here}
        ]
    ].

drawn(Key, Points, Life) -> drawn(Key, Points, Life, #{}).

drawn(Key, Points, Life, More) ->
    Seconds = maps:from_list([{seconds, Life} || Life =/= infinity]),
    {ok, Drawing} = new(maps:merge(maps:merge(#{key => Key, points => Points}, Seconds), More)),
    Drawing.

seen(Traced, Until) ->
    [
        {From, To, Robot, Key}
     || {From, To, Robot, #{key := Key}} <- starl_drawing:shown(Traced, Until)
    ].

seen_until_its_life_ends_test() ->
    Short = drawn(a, [{0, 0}], 2),
    ?assertEqual([{1, 2000001, 1, a}], seen([{1, 1, Short}], 9000000)),
    ?assertEqual([{1, 1000, 1, a}], seen([{1, 1, Short}], 1000)),
    ?assertEqual([{1, 9000000, 1, b}], seen([{1, 1, drawn(b, [{0, 0}], infinity)}], 9000000)).

seen_until_another_takes_its_place_test() ->
    Long = drawn(a, [{0, 0}], infinity),
    %% of another key, and of another robot: both stay
    Others = [{5, 1, drawn({a, 1}, [{0, 0}], infinity)}, {6, 2, Long}],
    ?assertEqual(
        [{1, 7, 1, a}, {5, 10, 1, {a, 1}}, {6, 10, 2, a}, {7, 10, 1, a}],
        seen([{1, 1, Long}] ++ Others ++ [{7, 1, Long}], 10)
    ),
    %% one whose life has ended before is not seen longer
    ?assertEqual(
        [{1, 1000001, 1, a}, {5000000, 6000000, 1, a}],
        seen([{1, 1, drawn(a, [{0, 0}], 1)}, {5000000, 1, Long}], 6000000)
    ),
    %% no points: nothing is there any more
    ?assertEqual([{1, 7, 1, a}], seen([{1, 1, Long}, {7, 1, drawn(a, [], infinity)}], 10)).
