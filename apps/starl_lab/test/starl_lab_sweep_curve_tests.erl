%% Measures over time in a sweep: of a run, as text, of several runs, as table and plot.
%%
%% Holds: Measures over time: runs of unlike length come together exactly; joined slices give the
%% same bytes
%% Red: values that are not kept until the next; the shorter step for all; each second value of the
%% wrong ones
-module(starl_lab_sweep_curve_tests).
-include_lib("eunit/include/eunit.hrl").

-define(S, 1000000).

%% Two robots: each has its last value until the end; before the first value there is none.
a_robot_has_its_last_value_test() ->
    Values = [
        {150000, 1, mm, 10},
        {150000, 1, other, 99},
        {250000, 2, mm, 20.5},
        {300000, 1, mm, 30}
    ],
    ?assertEqual(
        {100, [none, none, {10.0, 10, 10}, {25.25, 20.5, 30}, {25.25, 20.5, 30}]},
        rounded(starl_lab_sweep_curve:of_run(mm, Values, 400000))
    ).

rounded({Step, Values}) ->
    {Step, [
        case V of
            none -> none;
            {Median, Least, Most} -> {float(Median), Least, Most}
        end
     || V <- Values
    ]}.

%% At most a hundred steps, each a power of two of the shortest.
long_runs_have_long_steps_test() ->
    [
        ?assertMatch({Step, _}, starl_lab_sweep_curve:of_run(mm, [], Seconds * ?S))
     || {Seconds, Step} <- [{1, 100}, {9, 100}, {10, 200}, {25, 400}, {3600, 51200}]
    ],
    {_, Values} = starl_lab_sweep_curve:of_run(mm, [], 3600 * ?S),
    ?assert(length(Values) =< 100).

text_and_back_test() ->
    Seed = erlang:unique_integer([positive]),
    _ = rand:seed(exsss, Seed),
    [
        begin
            Curve =
                {100 bsl rand:uniform(10), [
                    lists:nth(rand:uniform(2), [none, {drawn(), drawn(), drawn()}])
                 || _ <- lists:seq(1, rand:uniform(20))
                ]},
            Text = starl_lab_sweep_curve:text(Curve),
            ?assertEqual({seed, Seed, {ok, Curve}}, {
                seed, Seed, starl_lab_sweep_curve:parse(Text)
            })
        end
     || _ <- lists:seq(1, 200)
    ],
    [?assertEqual(none, starl_lab_sweep_curve:parse(T)) || T <- ["", "x", "0.1 1/2", "0.1 a/b/c"]].

%% Numbers of as many digits as a text has.
drawn() ->
    case rand:uniform(3) of
        1 -> rand:uniform(100000) - 50000;
        2 -> (rand:uniform(10000000) - 5000000) / 100;
        3 -> rand:uniform() / 1000
    end.

%% A short and a long run come together in the longer steps, whatever the order; a run that has ended
%% counts no more.
unlike_runs_come_together_test() ->
    Short = {100, [{N, N, N} || N <- [0, 1, 2, 3, 4]]},
    Long = {200, [none, {10, 9, 11}, {20, 19, 21}, {30, 29, 31}]},
    Merged = [
        {0, 1, {0, 0, 0}},
        {200, 2, {6.0, 2, 11}},
        {400, 2, {12.0, 4, 21}},
        {600, 1, {30, 29, 31}}
    ],
    ?assertEqual(Merged, starl_lab_sweep_curve:merge([Short, Long])),
    ?assertEqual(Merged, starl_lab_sweep_curve:merge([Long, Short])),
    ?assertEqual([], starl_lab_sweep_curve:merge([])).

table_and_plot_test() ->
    Curves = [
        {["app", N], "robots " ++ N, mm, "distance, mm", [
            {0, 2, {1, 0, 3}}, {100, 1, {2.5, 2, 3}}
        ]}
     || N <- ["2", "4", "6", "8", "10", "12", "14", "16", "18"]
    ],
    Text = unicode:characters_to_list(starl_lab_sweep_curve:csv(["app", "robots"], Curves)),
    ?assertMatch(
        [
            "app,robots,measure,time_s,runs,median,least,most",
            "app,2,mm,0.0,2,1,0,3",
            "app,2,mm,0.1,1,2.5,2,3"
            | _
        ],
        string:lexemes(Text, "\n")
    ),
    Svg = unicode:characters_to_list(starl_lab_sweep_curve:svg(Curves)),
    %% of nine points eight have a curve, the first and the last among them
    ?assertEqual(9, length(string:split(Svg, "<polyline", all))),
    ?assertEqual(9, length(string:split(Svg, "<polygon", all))),
    [
        ?assertNotEqual({Part, nomatch}, {Part, string:find(Svg, Part)})
     || Part <- ["distance, mm: median and range, 8 of 9 curves", ">robots 2<", ">robots 18<"]
    ].
