%% The page in a real browser, headless Chromium, on `./starl run painting --view': it shows the robots
%% where the simulation has them; pause, scrub, kill by click, save; the saved scenario ends with the
%% digest of the run. Where there is no Chromium it is skipped with a line.
-module(starl_view_browser_SUITE).
-include_lib("stdlib/include/assert.hrl").
-include_lib("common_test/include/ct.hrl").

-export([all/0, init_per_suite/1, end_per_suite/1, the_page/1]).

-define(B, starl_view_browser).
-define(AT_S, 21).
-define(ROBOTS, 8).

all() -> [the_page].

init_per_suite(Config) ->
    case ?B:program() of
        {ok, Program} -> [{program, Program} | Config];
        {skip, Why} -> {skip, Why}
    end.

end_per_suite(_Config) -> ok.

%% One run and one browser: both take their time to start.
the_page(Config) ->
    Dir = ?config(priv_dir, Config),
    Run = starl(["run", "painting", "--robots", "8", "--picture", "rocket", "--view"], Dir),
    {Url, Said} = until("view: (http://[^\n]+/)\n", Run, ""),
    Browser = ?B:start(?config(program, Config)),
    try
        ok = ?B:open(list_to_binary(Url), Browser),
        computes_motion(Browser),
        shows_where_robots_are(Browser, Dir),
        scrubs(Browser, Dir),
        tells_of_a_robot(Browser, Dir),
        kills_by_click(Browser, Dir),
        saves(Browser),
        to_the_end(Browser, Dir)
    after
        ?B:stop(Browser)
    end,
    Ended = rest(Run, Said),
    Replayed = rest(starl(["run", "by_hand.term"], Dir), ""),
    %% robot 3 is dead, and a part of its lines unpainted, in both
    ?assertEqual({4, digest(Ended)}, {element(1, Replayed), digest(Replayed)}),
    ?assertMatch({4, _}, Ended),
    ?assertNotEqual(digest_of_no_hands(Config), digest(Ended)).

%% The page's closed forms are those of starl_trajectory, for every kind of piece.
computes_motion(Browser) ->
    Pieces = [
        starl_trajectory:standing(5, {1.0, 2.0}, 0.5),
        starl_trajectory:piece(5, {1.0, 2.0}, 0.5, 300.0, 0.0),
        starl_trajectory:piece(5, {1.0, 2.0}, 0.5, 0.0, -1.5),
        starl_trajectory:piece(5, {1.0, 2.0}, 0.5, -300.0, 1.2),
        starl_trajectory:ramp(5, {1.0, 2.0}, 0.5, {10.0, -20.0}, {300.0, 40.0}, 1500000)
    ],
    [computes(Piece, T, Browser) || Piece <- Pieces, T <- [5, 900000, 1500005, 4000000]].

computes(Piece, T, Browser) ->
    [[_, _, _ | Row]] = starl_view_row:of_message({trace, 0, {1, chassis, {motion, Piece}}}),
    Json = starl_view_json:encode(Row),
    Call = [".then(m => m.pose(", Json, ", ", integer_to_list(T), "))"],
    Shown = ?B:eval(["import('/motion.js')" | Call], Browser),
    {X, Y, Heading} = starl_trajectory:pose(T, Piece),
    ?assertMatch([_, _, _], Shown),
    Off = lists:max([abs(A - B) || {A, B} <- lists:zip([X, Y, Heading], Shown)]),
    ?assert(Off < 1.0e-6).

%% Within a millimetre; really they are the same to the last bits.
shows_where_robots_are(Browser, Dir) ->
    ?B:eval(
        "document.getElementById('at').value = '21';"
        "document.getElementById('until').requestSubmit()",
        Browser
    ),
    ok = ?B:await("starl.team.clock.paused && starl.team.now >= 21e6", Browser),
    Time = ?B:eval("starl.team.now", Browser),
    ok = ?B:await(io_lib:format("starl.state.shown === ~w", [Time]), Browser),
    Shown = ?B:eval("starl.poses()", Browser),
    {ok, Sim} = starl_sim:start(#{app => painting, robots => ?ROBOTS, picture => "rocket"}),
    _ = starl_sim:run(Sim, Time / 1.0e6),
    True = [{Id, maps:get(pose, Summary)} || {Id, Summary} <- starl_sim:robots(Sim)],
    ok = starl_sim:close(Sim),
    ?assertEqual(?ROBOTS, map_size(Shown)),
    [near(Pose, maps:get(integer_to_binary(Id), Shown)) || {Id, Pose} <- True],
    %% the table, for those who do not see the picture, says the same
    ?B:eval("document.getElementById('team').open = true", Browser),
    ok = ?B:await("document.querySelectorAll('#robots tr').length === 8", Browser),
    [X, Y] = [
        binary_to_float(
            ?B:eval(
                [
                    "document.querySelector('#robots tr').cells[",
                    N,
                    "].textContent"
                ],
                Browser
            )
        )
     || N <- ["1", "2"]
    ],
    {_, {TrueX, TrueY, _}} = hd(True),
    ?assert(abs(X * 1000 - TrueX) =< 1 andalso abs(Y * 1000 - TrueY) =< 1),
    ?B:eval("document.getElementById('team').open = false", Browser),
    ?B:shot(filename:join(Dir, "1_running.png"), Browser).

near({X, Y, Heading}, [XShown, YShown, HeadingShown]) ->
    ?assert(abs(X - XShown) < 1.0),
    ?assert(abs(Y - YShown) < 1.0),
    ?assert(abs(Heading - HeadingShown) < 1.0e-3).

%% A moment of the past is what it was, and the ink is that of then.
scrubs(Browser, Dir) ->
    Now = ?B:eval("starl.poses()", Browser),
    ?B:eval(
        "const t = document.getElementById('time'); t.value = 9e6;"
        "t.dispatchEvent(new Event('input'))",
        Browser
    ),
    ok = ?B:await(
        "starl.state.shown === 9e6 && document.getElementById('clock').textContent === '9.000 s'",
        Browser
    ),
    Then = ?B:eval("starl.poses()", Browser),
    ?assertNotEqual(Now, Then),
    {ok, Sim} = starl_sim:start(#{app => painting, robots => ?ROBOTS, picture => "rocket"}),
    _ = starl_sim:run(Sim, 9),
    [
        near(maps:get(pose, S), maps:get(integer_to_binary(Id), Then))
     || {Id, S} <- starl_sim:robots(Sim)
    ],
    ok = starl_sim:close(Sim),
    ?B:shot(filename:join(Dir, "2_scrubbed.png"), Browser),
    ?B:eval("starl.live()", Browser),
    ok = ?B:await("starl.state.shown === starl.team.now", Browser).

%% A click on the canvas selects the robot, and its machines are told.
tells_of_a_robot(Browser, Dir) ->
    [X, Y] = ?B:eval(
        "(() => { const p = starl.poses()[3], c = document.getElementById('map')"
        ".getBoundingClientRect(), f = starl.floor;"
        "return [c.x + f.x(p[0]) / f.ratio, c.y + f.y(p[1]) / f.ratio]; })()",
        Browser
    ),
    ok = ?B:click(X, Y, Browser),
    ok = ?B:await("starl.state.selected === 3", Browser),
    ok = ?B:await(
        "[...document.querySelectorAll('#machines summary')].some(s =>"
        "s.textContent.startsWith('sap:'))",
        Browser
    ),
    ?B:eval(
        "document.querySelectorAll('#machines details').forEach(d =>"
        "{ d.open = d.dataset.name === 'dpp'; })",
        Browser
    ),
    ?B:shot(filename:join(Dir, "3_robot.png"), Browser).

kills_by_click(Browser, Dir) ->
    [X, Y] = ?B:eval(
        "(() => { const r = document.getElementById('kill').getBoundingClientRect();"
        "return [r.x + r.width / 2, r.y + r.height / 2]; })()",
        Browser
    ),
    ok = ?B:click(X, Y, Browser),
    ok = ?B:await("starl.team.faults.has('hand_1')", Browser),
    %% pause is a button, and a key
    ok = ?B:await("starl.team.clock.paused", Browser),
    ?B:eval("document.activeElement.blur()", Browser),
    ok = ?B:press(<<" ">>, Browser),
    ok = ?B:await("!starl.team.clock.paused && starl.team.now > 24e6", Browser),
    ?B:eval("document.getElementById('pause').click()", Browser),
    ok = ?B:await("starl.team.clock.paused", Browser),
    Time = ?B:eval("starl.team.now", Browser),
    ?assertEqual(
        <<"died">>, ?B:eval("starl.team.robots.get(3).condition(starl.team.now)", Browser)
    ),
    ?B:shot(filename:join(Dir, "4_killed.png"), Browser),
    ?assertEqual(Time, ?B:eval("starl.team.now", Browser)).

saves(Browser) ->
    ?B:eval("document.getElementById('save').requestSubmit()", Browser),
    ok = ?B:await("document.getElementById('news').textContent.includes('by_hand.term')", Browser),
    %% nothing is written over
    ?B:eval("document.getElementById('save').requestSubmit()", Browser),
    ok = ?B:await("document.getElementById('news').textContent.includes('there already')", Browser).

to_the_end(Browser, Dir) ->
    ?B:eval(
        "const s = document.getElementById('speed'); s.value = 'max';"
        "s.dispatchEvent(new Event('change')); document.getElementById('pause').click()",
        Browser
    ),
    ok = ?B:await("starl.team.clock.ending", Browser),
    ?B:shot(filename:join(Dir, "5_over.png"), Browser).

digest_of_no_hands(Config) ->
    Dir = ?config(priv_dir, Config),
    digest(rest(starl(["run", "painting", "--robots", "8", "--picture", "rocket"], Dir), "")).

%% -- the command line in a VM of its own ----------------------------------------------------

starl(Args, Dir) ->
    Paths = lists:append([["-pa", P] || P <- code:get_path(), filelib:is_dir(P)]),
    Main = "starl_cli:main(init:get_plain_arguments()).",
    open_port({spawn_executable, os:find_executable("erl")}, [
        {args, ["-noshell", "+fnu" | Paths] ++ ["-eval", Main, "-extra" | Args]},
        {cd, Dir},
        exit_status,
        stderr_to_stdout,
        hide
    ]).

until(Pattern, Port, Text) ->
    case re:run(Text, Pattern, [{capture, all_but_first, list}]) of
        {match, [Found]} ->
            {Found, Text};
        nomatch ->
            receive
                {Port, {data, More}} -> until(Pattern, Port, Text ++ More);
                {Port, {exit_status, Status}} -> error({ended, Status, Text})
            end
    end.

rest(Port, Text) ->
    receive
        {Port, {data, More}} -> rest(Port, Text ++ More);
        {Port, {exit_status, Status}} -> {Status, Text}
    end.

digest({_, Text}) ->
    {match, [Digest]} = re:run(Text, "digest ([0-9a-f]{32})", [{capture, all_but_first, list}]),
    Digest.
