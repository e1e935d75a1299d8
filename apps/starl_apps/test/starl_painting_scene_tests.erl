%% The scene of painting: which picture a name stands for.
-module(starl_painting_scene_tests).
-include_lib("eunit/include/eunit.hrl").

%% In a directory of its own, which has a file and a directory of shipped pictures' names.
names_test_() ->
    {setup, fun enter/0, fun leave/1, [
        {"a shipped picture", ?_assertMatch({ok, _}, scene("house"))},
        {"a directory does not hide it", ?_assertMatch({ok, _}, scene("rocket"))},
        {"a file of its name does", ?_assertMatch({error, _}, scene("lines"))},
        {"a file", ?_assertMatch({ok, _}, scene("my.svg"))},
        {"a file without an ending", ?_assertMatch({ok, _}, scene("mine"))},
        {"a directory is no picture", ?_test(says("it is a directory", scene("results")))},
        {"nothing", ?_test(says("there is no such file; give an SVG", scene("nothing")))},
        {"nearly one", ?_test(says("(did you mean house?)", scene("hous")))},
        {"what ships", ?_test(says("snowflake, text", scene("nothing")))},
        {"no folder of them", ?_test(says("there is no such file", scene("../pictures/house")))},
        {"too much", ?_test(says("allow a larger --tolerance", scene("house", #{segments => 99})))},
        {"short lines", ?_test(sampled())},
        {"no number", ?_test(says("there is no such file", scene("short_lines:x")))},
        {"the tolerance", ?_test(tolerated())}
    ]}.

enter() ->
    {ok, Before} = file:get_cwd(),
    Name =
        "starl_scene_" ++ os:getpid() ++ "_" ++ integer_to_list(erlang:unique_integer([positive])),
    Dir = filename:join([Before, "_build", Name]),
    House = filename:join([code:priv_dir(starl_apps), "pictures", "house.svg"]),
    ok = filelib:ensure_path(Dir),
    ok = file:set_cwd(Dir),
    [{ok, _} = file:copy(House, File) || File <- ["my.svg", "mine"]],
    ok = file:write_file("lines", "no picture"),
    [ok = file:make_dir(Each) || Each <- ["rocket", "results"]],
    {Before, Dir}.

leave({Before, Dir}) ->
    ok = file:set_cwd(Before),
    ok = file:del_dir_r(Dir).

%% A larger tolerance gives fewer lines, which the monitor grants.
tolerated() ->
    {ok, Fine} = scene("curve"),
    {ok, #{monitors := [{_, #{lines := Lines, tolerance_mm := 50.0}}]}} =
        scene("curve", #{tolerance => 50}),
    #{monitors := [{_, #{lines := All, tolerance_mm := 2.0}}]} = Fine,
    ?assert(length(Lines) * 3 < length(All)).

%% Some lines are shorter than what the plan welds together, some longer than the ends that may lack.
sampled() ->
    {ok, #{monitors := [{_, #{lines := Lines}}]} = First} = scene("short_lines:7"),
    Lengths = [starl_geometry:length(Line) || Line <- Lines],
    In = fun(Low, High) -> length([Mm || Mm <- Lengths, Mm >= Low, Mm < High]) end,
    [
        ?assert(In(Low, High) > 3)
     || {Low, High} <- [{0.0, 0.05}, {0.05, 0.5}, {0.5, 4.0}, {4.0, 13.0}]
    ],
    ?assertEqual({ok, First}, scene("short_lines:7")),
    {ok, #{monitors := [{_, #{lines := Others}}]}} = scene("short_lines:8"),
    ?assertNotEqual(Lines, Others).

scene(Picture) -> scene(Picture, #{}).

scene(Picture, Given) ->
    {ok, Options} = starl_options:check(Given#{picture => Picture}, starl_painting:options()),
    starl_painting:scene(#{
        robots => [1, 2],
        world => {10000, 8000},
        seed => 1,
        sap => #{},
        profiles => [starl_chassis:profile(starl_chassis_differential, #{})],
        options => Options
    }).

says(What, {error, Why}) ->
    ?assertNotEqual(nomatch, string:find(unicode:characters_to_list(Why), What)).
