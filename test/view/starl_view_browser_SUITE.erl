%% Every window in a real browser, headless Chromium: the page shows the robots where the simulation has
%% them, and hands do what they say. Of a simulation, a recording, a run that is done again, live robots,
%% a cluster, and a film. One browser and one page serve all. Where there is no Chromium the suite is
%% skipped with a line.
-module(starl_view_browser_SUITE).
-include_lib("stdlib/include/assert.hrl").
-include_lib("common_test/include/ct.hrl").

-export([all/0, suite/0, init_per_suite/1, end_per_suite/1]).
-export([
    simulation/1, reload/1, measures/1, recording/1, late/1, replay/1, film/1, live/1, cluster/1
]).

-define(B, starl_view_browser).
-define(AT_S, 21).
-define(ROBOTS, 8).
%% The run that is recorded, filmed, and done again.
-define(RECORDED, #{app => painting, robots => 2, picture => "house", faults => ?FAULTS}).
-define(FAULTS, [{cut, 20000, 26000, isolate, 1, #{}}, {dies, 60000, 60000, kill_robot, 2, #{}}]).

suite() -> [{timetrap, {minutes, 5}}].

all() -> [simulation, reload, measures, recording, late, replay, film, live, cluster].

init_per_suite(Config) ->
    case ?B:program() of
        {ok, Program} -> [{browser, ?B:lent(Program)} | recorded(Config)];
        {skip, Why} -> {skip, Why}
    end.

end_per_suite(Config) -> ?B:give_back(?config(browser, Config)).

browse(Config, Do) -> ?B:borrow(?config(browser, Config), Do).

%% A run with a partition and a death, on record.
recorded(Config) ->
    Dir = ?config(priv_dir, Config),
    Scenario = io_lib:format("~tp.~n", [?RECORDED]),
    ok = file:write_file(filename:join(Dir, "faulty.term"), Scenario),
    Args = ["run", "faulty.term", "--record", "--out", "recorded"],
    {Status, Text} = rest(starl(Args, Dir), ""),
    ?assert(lists:member(Status, [0, 4]), Text),
    Config.

%% -- a simulation ---------------------------------------------------------------------------

simulation(Config) ->
    Dir = ?config(priv_dir, Config),
    Run = starl(
        ["run", "painting", "--robots", "8", "--picture", "rocket", "--view", "--no-open"], Dir
    ),
    {Url, Said} = until("view: (http://[^\n]+)\n", Run, ""),
    browse(Config, fun(Browser) ->
        ok = ?B:open(Url, Browser),
        computes_motion(Browser),
        shows_where_robots_are(Browser, Dir),
        scrubs(Browser, Dir),
        tells_of_a_robot(Browser, Dir),
        lends_hands(Browser),
        kills_by_click(Browser, Dir),
        saves(Browser),
        to_the_end(Browser, Dir),
        ok = ?B:visit("about:blank", Browser)
    end),
    Ended = closed(Run, Said),
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
    Json = starl_json:encode(Row),
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
    True = places(rocket(), Time),
    ?assertEqual(?ROBOTS, map_size(Shown)),
    near_all(True, Shown),
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

rocket() -> #{app => painting, robots => ?ROBOTS, picture => "rocket"}.

%% Where the simulation has its robots.
places(Scenario, Us) ->
    {ok, Sim} = starl_sim:start(Scenario),
    _ = starl_sim:run(Sim, Us / 1.0e6),
    Places = [{Id, maps:get(pose, Summary)} || {Id, Summary} <- starl_sim:robots(Sim)],
    ok = starl_sim:close(Sim),
    Places.

near_all(True, Shown) ->
    [near(Pose, maps:get(integer_to_binary(Id), Shown)) || {Id, Pose} <- True].

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
    near_all(places(rocket(), 9000000), Then),
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
        "{ d.open = d.dataset.key === 'dpp'; })",
        Browser
    ),
    ?B:shot(filename:join(Dir, "3_robot.png"), Browser).

%% Each button beside the robot, and the form of all faults: each begins now, as a fault of the scenario.
lends_hands(Browser) ->
    Before = ?B:eval("starl.team.now", Browser),
    Buttons = [
        {"freeze", 1}, {"reboot", 2}, {"cut", 3}, {"hold", 5}, {"isolate", 6}, {"kill-machine", 7}
    ],
    [handed(Button, N, Browser) || {Button, N} <- Buttons],
    ?B:eval(
        "document.getElementById('kind').value = 'loss';"
        "document.getElementById('kind').dispatchEvent(new Event('change'));"
        "document.getElementById('target').value = 'all'",
        Browser
    ),
    handed("do-fault", 8, Browser),
    Kinds = ?B:eval("[...starl.team.faults.values()].map(f => f.kind)", Browser),
    ?assertEqual(
        [
            <<"isolate">>,
            <<"kill_machine">>,
            <<"location_frozen">>,
            <<"loss">>,
            <<"pause">>,
            <<"reboot">>
        ],
        lists:usort(Kinds)
    ),
    %% what lasts is healed at once; the run is where it was
    ok = ?B:click("heal", Browser),
    ok = ?B:await(
        "[...starl.team.faults.values()].every(f => f.to <= starl.team.now + 2e6)", Browser
    ),
    ?assertEqual(Before, ?B:eval("starl.team.now", Browser)).

handed(Button, N, Browser) ->
    ok = ?B:click(Button, Browser),
    ok = ?B:await(io_lib:format("starl.team.faults.has('manual_~b')", [N]), Browser).

kills_by_click(Browser, Dir) ->
    ok = handed("kill", 9, Browser),
    %% pause is a button, and a key
    ok = ?B:await("starl.team.clock.paused", Browser),
    ?B:eval("document.activeElement.blur()", Browser),
    ok = ?B:press(<<" ">>, Browser),
    ok = ?B:await("!starl.team.clock.paused && starl.team.now > 26e6", Browser),
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
    ok = ?B:await(
        "document.getElementById('save-said').textContent.includes('by_hand.term')", Browser
    ),
    %% nothing is written over
    ?B:eval("document.getElementById('save').requestSubmit()", Browser),
    ok = ?B:await(
        "document.getElementById('save-said').textContent.includes('there already')", Browser
    ).

to_the_end(Browser, Dir) ->
    ?B:eval(
        "const s = document.getElementById('speed'); s.value = 'max';"
        "s.dispatchEvent(new Event('change')); document.getElementById('pause').click()",
        Browser
    ),
    ok = ?B:await("starl.team.clock.ending", Browser),
    ?B:shot(filename:join(Dir, "5_over.png"), Browser).

%% The window opens the user's browser, the run waits for its page; its results are written when it ends, the page
%% can be loaded anew after that, and Ctrl-C closes the window without a change to the answer.
reload(Config) ->
    Dir = ?config(priv_dir, Config),
    Opened = desktop(Dir),
    Env = [{"DISPLAY", ":0"}, {"WAYLAND_DISPLAY", false}, {"WSL_DISTRO_NAME", false}],
    Path = {"PATH", filename:join(Dir, "bin") ++ ":" ++ os:getenv("PATH")},
    Args = ["run", "painting", "--robots", "2", "--picture", "lines", "--view", "--pace", "100"],
    Run = starl(Args ++ ["--out", "reloaded"], Dir, [Path | Env]),
    {Url, Said} = until("view: (http://[^\n]+)\n", Run, ""),
    %% by a page of the user's own: the arguments of programs are no secret
    {0, Page} = rest(Opened, ""),
    ?assertNotEqual(nomatch, string:find(Page, "0;url=" ++ Url ++ "\"")),
    {_, Waits} = until("(waiting for a browser)", Run, Said),
    ?assertEqual(nomatch, re:run(Waits, "digest")),
    Ends = "starl.team.clock.ending === 'done'",
    browse(Config, fun(Browser) ->
        ok = ?B:open(Url, Browser),
        ok = ?B:await(Ends, Browser)
    end),
    {_, Told} = until("(the run is over)", Run, Waits),
    ?assert(filelib:is_regular(filename:join([Dir, "reloaded", "report.json"]))),
    browse(Config, fun(Browser) ->
        ok = ?B:visit("about:blank", Browser),
        ok = ?B:open(Url, Browser),
        ok = ?B:await(Ends, Browser),
        ?B:eval("starl.select(1)", Browser),
        ok = ?B:await("document.querySelectorAll('#machines details').length > 1", Browser)
    end),
    Closed = closed(Run, Told),
    ?assertMatch({0, _}, Closed),
    ?assertEqual(digest({0, Told}), digest(Closed)),
    %% one line, however often the page comes
    ?assertMatch({match, [_]}, re:run(element(2, Closed), "the run is over", [global])).

%% What applications measure is drawn, and told; a page that comes later knows it, too. An application that
%% measures nothing has no curves.
%% Holds: What is measured reaches table, plot, figures and viewers …: and the window, as curves
%% and in words, also of a page that comes later
%% Red: a page without rows of measures
measures(Config) ->
    Dir = ?config(priv_dir, Config),
    Run = starl(["run", "formation", "--robots", "4", "--view", "--no-open", "--pace", "100"], Dir),
    {Url, Said} = until("view: (http://[^\n]+)\n", Run, ""),
    browse(Config, fun(Browser) ->
        ok = ?B:open(Url, Browser),
        ok = ?B:await("starl.team.clock.ending", Browser),
        ?B:eval("starl.select(2)", Browser),
        shows_measures(Browser),
        ?B:eval("document.getElementById('measures').scrollIntoView()", Browser),
        ?B:shot(filename:join(Dir, "6_measures.png"), Browser),
        Values = ?B:eval(values(), Browser),
        ok = ?B:visit("about:blank", Browser),
        ok = ?B:open(Url, Browser),
        ok = ?B:await("starl.team.measured.length", Browser),
        shows_measures(Browser),
        %% the latest value of each is there, however many are left out
        ?assertEqual(Values, ?B:eval(values(), Browser)),
        ok = ?B:visit("about:blank", Browser)
    end),
    ?assertMatch({0, _}, closed(Run, Said)).

values() ->
    "starl.team.measured.map(key => [key, [...starl.team.robots.values()].map(robot => "
    "(robot.measures.get(key) ?? []).at(-1))])".

shows_measures(Browser) ->
    ok = ?B:await("document.getElementById('measured').textContent.includes('median')", Browser),
    Drawn = ?B:eval(
        "(canvas => new Set(new Uint32Array(canvas.getContext('2d').getImageData(0, 0, canvas.width, "
        "canvas.height).data.buffer)).size)(document.getElementById('curves'))",
        Browser
    ),
    %% the colours of four robots, at least
    ?assert(Drawn > 4),
    ?assertEqual(
        ?B:eval("starl.team.measured", Browser),
        ?B:eval("[...document.getElementById('measure').options].map(o => o.value)", Browser)
    ).

%% A desktop, whose program for addresses says what the page has that it was given.
desktop(Dir) ->
    Bin = filename:join(Dir, "bin"),
    ok = filelib:ensure_path(Bin),
    Fifo = filename:join(Dir, "opened"),
    [] = os:cmd("mkfifo " ++ Fifo),
    Program = filename:join(Bin, "xdg-open"),
    ok = file:write_file(Program, ["#!/bin/sh\ncat \"$1\" > ", Fifo, "\n"]),
    ok = file:change_mode(Program, 8#755),
    open_port({spawn_executable, os:find_executable("cat")}, [{args, [Fifo]}, exit_status]).

%% -- a recording ----------------------------------------------------------------------------

%% Any moment can be looked at, forwards and backwards, and it plays at a speed.
recording(Config) ->
    Dir = ?config(priv_dir, Config),
    File = filename:join([Dir, "recorded", "run.mcap"]),
    View = starl(["view", "recorded", "--no-open"], Dir),
    {Url, _} = until("view: (http://[^\n]+)\n", View, ""),
    browse(Config, fun(Browser) ->
        ok = ?B:open(Url, Browser),
        ok = ?B:await("starl.team.clock.ending", Browser),
        ?assert(
            ?B:eval("document.getElementById('measures').classList.contains('absent')", Browser)
        ),
        [moment(Us, Browser) || Us <- [30000000, 75500000, 12345000, 62000000]],
        %% no packet is left out
        ?assertEqual(packets(File), ?B:eval("starl.team.packets.length", Browser)),
        %% robot 2 has died a moment ago
        ?assertEqual(
            <<"died">>, ?B:eval("starl.team.robots.get(2).condition(starl.state.shown)", Browser)
        ),
        ?assertEqual(
            [<<"cut">>, <<"dies">>], ?B:eval("[...starl.team.faults.keys()].sort()", Browser)
        ),
        plays(Browser),
        told_by_the_trace(File, Browser),
        bounded(Browser),
        in_parts(File, Browser),
        ok = ?B:visit("about:blank", Browser)
    end),
    ended(View).

%% What a robot on its own has recorded counts from 1970, and nobody has judged it.
late(Config) ->
    Dir = ?config(priv_dir, Config),
    Begun = 1795451471512000,
    {ok, Recorder} = starl_trace_recorder:start_link(filename:join(Dir, "late.mcap"), live),
    Observer = starl_trace_recorder:observer(Recorder),
    {ok, Planned} = starl_sim:plan(#{app => painting, robots => 1}, #{}),
    Facts = (starl_run_plan:facts(Planned, []))#{
        kind := live, epoch_us => 0, begun_us => Begun, told_by => [1]
    },
    Second = fun(S) -> Begun + S * 1000000 end,
    Tell = fun(News) -> ok = starl_observer:tell(News, Observer) end,
    Tell({begun, Facts}),
    [Tell({seen, Second(S), 1, {1000.0 + 100 * S, 2000.0, 0.0}}) || S <- [1, 2, 3, 10]],
    {ok, _} = starl_trace_recorder:close(Recorder),
    View = starl(["view", "late.mcap", "--no-open"], Dir),
    {Url, _} = until("view: (http://[^\n]+)\n", View, ""),
    browse(Config, fun(Browser) ->
        ok = ?B:open(Url, Browser),
        ok = ?B:await("starl.team.clock.ending", Browser),
        ?assertEqual(Begun, ?B:eval("starl.team.from", Browser)),
        ?B:eval(io_lib:format("starl.scrub(~b)", [Second(2) + 500000]), Browser),
        ok = ?B:await(
            "document.getElementById('clock').textContent === '2026-11-23 16:31:14.012 UTC'",
            Browser
        ),
        ?assertMatch(#{<<"1">> := [X | _]} when X == 1200, ?B:eval("starl.poses()", Browser)),
        ?assertEqual(
            [<<"dpp not judged">>],
            ?B:eval(
                "[...document.querySelectorAll('#lights span')].map(l => l.textContent)"
                ".filter(t => t.startsWith('dpp'))",
                Browser
            )
        ),
        ok = ?B:visit("about:blank", Browser)
    end),
    ended(View).

%% A robot's machines as their trace told them last: in the beginning nobody has led.
told_by_the_trace(File, Browser) ->
    ?B:eval("starl.scrub(40e6); starl.select(1)", Browser),
    ok = ?B:await("starl.seen?.at === 40e6", Browser),
    ?assertEqual(told(1, 40000000, File), ?B:eval("starl.seen.machines.map(m => m.name)", Browser)),
    ok = ?B:await(
        "document.getElementById('machines').textContent.startsWith('As told by the trace')",
        Browser
    ),
    ?assert(?B:eval("starl.seen.machines.every(m => m.at <= 40e6)", Browser)),
    ?assert(?B:eval("starl.seen.packets.every(p => p[1] === 1 || p[2] === 1)", Browser)),
    %% the motion that it has now is the last that was told
    ?assert(
        ?B:eval(
            "starl.seen.machines.find(m => m.name === 'chassis').at >="
            "starl.team.robots.get(1).motions.filter(m => m[0] <= 40e6).pop()[0]",
            Browser
        )
    ).

packets(File) ->
    Count = fun(Message, N) ->
        N + length([p || [<<"p">> | _] <- starl_view_row:of_message(Message)])
    end,
    {ok, Packets, closed} = starl_trace_reader:fold(Count, 0, File),
    Packets.

%% The machines of a robot that have told anything until then.
told(Robot, Us, File) ->
    {ok, Told, closed} = starl_trace_reader:fold(
        fun
            ({trace, T, {Id, Machine, _}}, Names) when Id =:= Robot, T =< Us -> [Machine | Names];
            (_, Names) -> Names
        end,
        [],
        File
    ),
    [atom_to_binary(Machine) || Machine <- lists:usort(Told)].

%% Of a longer recording the page has a part at a time: any moment is as of the whole, forwards and
%% backwards, and it plays on from part to part.
in_parts(File, Browser) ->
    {ok, View} = starl_view:start(#{port => 0, host => "127.0.0.1"}),
    {ok, closed} = starl_view_recording:load(File, starl_view:hub(View), #{section_rows => 100}),
    ok = ?B:open(starl_view:address(View), Browser),
    ok = ?B:await("starl.team.clock.ending", Browser),
    End = ?B:eval("starl.team.until", Browser),
    ?assert(?B:eval("starl.team.now", Browser) < 30000000),
    [part(Us, End, Browser) || Us <- [30000000, 75500000, 12345000, 62000000]],
    ?assert(?B:eval("starl.team.robots.get(2).condition(62e6) === 'died'", Browser)),
    ?assertEqual(
        [<<"cut">>, <<"dies">>], ?B:eval("[...starl.team.faults.keys()].sort()", Browser)
    ),
    ?B:eval(
        "starl.scrub(5e6); var s = document.getElementById('speed'); s.value = '50';"
        "s.dispatchEvent(new Event('change')); document.getElementById('pause').click()",
        Browser
    ),
    ok = ?B:await("starl.state.shown === starl.team.until", Browser),
    ok = starl_view:stop(View).

part(Us, End, Browser) ->
    ?B:eval(io_lib:format("starl.scrub(~b)", [Us]), Browser),
    ok = ?B:await(
        io_lib:format("starl.team.begin <= ~b && ~b <= starl.team.now", [Us, Us]), Browser
    ),
    near_all(places(?RECORDED, Us), ?B:eval("starl.poses()", Browser)),
    ?assertEqual(Us, ?B:eval("starl.state.shown", Browser)),
    [Begin, Now, Until] = ?B:eval("[starl.team.begin, starl.team.now, starl.team.until]", Browser),
    ?assertEqual(End, Until),
    %% the time line has all of it
    ?assertEqual(1, ?B:eval("starl.team.marks.filter(m => m[1] === 'died').length", Browser)),
    ?assert(Now - Begin < End div 2).

moment(Us, Browser) ->
    ?B:eval(io_lib:format("starl.scrub(~b)", [Us]), Browser),
    near_all(places(?RECORDED, Us), ?B:eval("starl.poses()", Browser)).

%% In a time of the browser's frames, so much of the recording.
plays(Browser) ->
    Played = fun(Speed) ->
        ?B:eval(
            [
                "starl.scrub(5e6); var s = document.getElementById('speed'); s.value = '",
                Speed,
                "'; s.dispatchEvent(new Event('change'));"
                "document.getElementById('pause').click(); var begun = starl.state.playing"
            ],
            Browser
        ),
        ok = ?B:await("starl.state.shown > 5.2e6", Browser),
        Rate = ?B:eval("(starl.state.shown - 5e6) / 1000 / (starl.state.playing - begun)", Browser),
        ?B:eval("document.getElementById('pause').click()", Browser),
        Rate
    end,
    [?assert(abs(Played(S) / list_to_integer(S) - 1) < 1.0e-6) || S <- ["50", "1"]].

%% A page left open over night: the messages of 12 hours of eight robots, which drive, paint, hold tubes,
%% talk and fail. What it keeps is bounded, and the present is still right.
bounded(Browser) ->
    Script =
        "import('/model.js').then(({ Team }) => { const team = new Team();"
        "for (let s = 0; s < 43200; s++) { for (let r = 1; r <= 8; r++) { const t = s * 1e6 + r;"
        "team.take(['m', t, r, 0, t, s, r, 0, 300, 0]);"
        "team.take(['m', t + 5e5, r, 0, t + 5e5, s, r, 1, 0, 1]);"
        "team.take(['a', t, r, 'pen', s % 2 ? 'up' : 'down']);"
        "team.take(['r', t, r, [[0, 0, s, 1]]]);"
        "team.take(['s', t, r, `${r}.1.${s}`, [1], 'x']);"
        "team.take(['p', t, r, 1 + r % 8, 'x', 40, 'arrives', t + 1e4]);"
        "if (s % 60 === r) { team.take(['x', t, r, 'robot', 'down']); team.take(['x', t, r, 'robot', 'up']);"
        "team.take(['f', t, `f${s}`, s, s + 1, 'loss', 'all', '']);"
        "team.take(['v', t, 'c', `broken ${s}`, [r]]); } }"
        "team.take(['t', s * 1e6, {}]); }"
        "const sum = f => [...team.robots.values()].reduce((n, r) => n + f(r), 0);"
        "return { told: sum(r => r.motions.length + r.pen.length + r.held.length + r.conditions.length),"
        "packets: team.packets.length, sent: team.sent.size, marks: team.marks.length,"
        "faults: team.faults.size, violations: team.violations.length,"
        "pose: team.robots.get(3).pose(43199.25e6), down: team.robots.get(3).isDown(43199.25e6) }; })",
    Kept = ?B:eval(Script, Browser),
    Most = #{
        told => 600000,
        packets => 120000,
        sent => 20000,
        marks => 7000,
        faults => 2000,
        violations => 2000
    },
    [
        ?assert(maps:get(atom_to_binary(Key), Kept) =< N, {Key, Kept})
     || {Key, N} <- maps:to_list(Most)
    ],
    #{<<"pose">> := [X, _, _], <<"down">> := false} = Kept,
    ?assert(abs(X - (43199 + 75)) < 1).

%% Ctrl-C, as ./starl passes it on: a run that is over closes its window.
closed(Port, Said) ->
    case erlang:port_info(Port, os_pid) of
        {os_pid, Pid} -> os:cmd("kill -USR1 " ++ integer_to_list(Pid));
        %% nobody has looked for too long
        undefined -> ok
    end,
    rest(Port, Said).

ended(Port) ->
    {os_pid, Pid} = erlang:port_info(Port, os_pid),
    _ = os:cmd("kill -TERM " ++ integer_to_list(Pid)),
    rest(Port, "").

%% -- a run that is done again ---------------------------------------------------------------

%% It begins where it was to stop, and steps: to the next event of a robot, and by windows.
replay(Config) ->
    Dir = ?config(priv_dir, Config),
    Replay = starl(["replay", "recorded", "--view", "--no-open", "--until", "1:40"], Dir),
    {Url, Said} = until("view: (http://[^\n]+)\n", Replay, ""),
    browse(Config, fun(Browser) ->
        ok = ?B:open(Url, Browser),
        ok = ?B:await("starl.team.clock.paused && starl.team.now > 0", Browser),
        ?B:eval("starl.select(1)", Browser),
        ?assertEqual(40, events(Browser)),
        ok = ?B:click("step", Browser),
        ?assertEqual(41, events(41, Browser)),
        At = ?B:eval("starl.team.now", Browser),
        ?B:eval("starl.select(null)", Browser),
        ok = ?B:click("step", Browser),
        ok = ?B:await(
            io_lib:format("starl.team.now > ~w && starl.team.clock.paused", [At]), Browser
        ),
        ?B:eval(
            "document.getElementById('at').value = '30';"
            "document.getElementById('until').requestSubmit()",
            Browser
        ),
        ok = ?B:await("starl.team.clock.paused && starl.state.shown === 30e6", Browser),
        near_all(places(?RECORDED, 30000000), ?B:eval("starl.poses()", Browser)),
        to_the_end(Browser, Dir),
        ok = ?B:visit("about:blank", Browser)
    end),
    {Status, Text} = closed(Replay, Said),
    ?assertMatch({0, {match, _}}, {Status, re:run(Text, "same digest|digest")}).

events(Browser) -> events(40, Browser).

events(N, Browser) ->
    ok = ?B:await(
        io_lib:format(
            "document.querySelector('#machines p').textContent.startsWith('~b events')", [N]
        ),
        Browser
    ),
    N.

%% -- a film ---------------------------------------------------------------------------------

%% At three instants the robots of the animated picture stand where the simulation had them.
film(Config) ->
    Dir = ?config(priv_dir, Config),
    {0, _} = rest(starl(["film", "recorded", "--out", "film.svg", "--seconds", "20"], Dir), ""),
    {ok, Sim} = starl_sim:start(?RECORDED),
    #{now_us := End} = starl_sim:run(Sim),
    ok = starl_sim:close(Sim),
    browse(Config, fun(Browser) ->
        ok = ?B:visit(["file://", filename:absname("film.svg", Dir)], Browser),
        ?B:eval("document.documentElement.pauseAnimations()", Browser),
        [filmed(Us, End, Browser) || Us <- [20000000, 58000000, End * 4 div 5 div 5000 * 5000]],
        ok = ?B:visit("about:blank", Browser)
    end).

filmed(Us, End, Browser) ->
    Shown = ?B:eval(
        io_lib:format(
            "(() => { const svg = document.documentElement; svg.setCurrentTime(~w);"
            "const world = svg.viewBox.baseVal;"
            "return [...svg.querySelectorAll('g > animateTransform[type=translate]:not([calcMode])')]"
            ".map(a => { const m = svg.getCTM().inverse().multiply(a.parentNode.getCTM());"
            "return [m.e - world.x, 12000 - (m.f - world.y)]; }); })()",
            [20 * Us / End]
        ),
        Browser
    ),
    True = places(?RECORDED, Us),
    ?assertEqual(length(True), length(Shown)),
    [
        ?assert(abs(X - XShown) < 9 andalso abs(Y - YShown) < 9, {Us, {X, Y}, {XShown, YShown}})
     || {{_, {X, Y, _}}, [XShown, YShown]} <- lists:zip(True, Shown)
    ].

%% -- live robots ----------------------------------------------------------------------------

%% They move. Positions are frozen, a link is cut, all is healed; a robot that was killed starts anew.
live(Config) ->
    Dir = ?config(priv_dir, Config),
    Args = [
        "run",
        "painting",
        "--robots",
        "2",
        "--picture",
        "lines",
        "--live",
        "--view",
        "--no-open",
        "--pace",
        "4"
    ],
    Run = starl(Args, Dir),
    {Url, Said} = until("view: (http://[^\n]+)\n", Run, ""),
    browse(Config, fun(Browser) ->
        ok = ?B:open(Url, Browser),
        moves(2, Browser),
        lends_live_hands(Browser),
        stops(Browser)
    end),
    ?assertMatch({130, _}, closed(Run, Said)).

%% The same on nodes: a click kills that of a robot.
cluster(Config) ->
    Dir = ?config(priv_dir, Config),
    Args = [
        "cluster",
        "painting",
        "--robots",
        "2",
        "--picture",
        "lines",
        "--view",
        "--no-open",
        "--speed",
        "4"
    ],
    Run = starl(Args, Dir),
    {Url, Said} = until("view: (http://[^\n]+)\n", Run, ""),
    browse(Config, fun(Browser) ->
        ok = ?B:open(Url, Browser),
        moves(2, Browser),
        lends_live_hands(Browser),
        stops(Browser)
    end),
    {Status, Text} = closed(Run, Said),
    ?assertEqual(130, Status, Text).

lends_live_hands(Browser) ->
    ?B:eval("starl.select(2)", Browser),
    ok = ?B:click("cut", Browser),
    lasts(<<"loss">>, Browser),
    ok = ?B:click("freeze", Browser),
    lasts(<<"location_frozen">>, Browser),
    heals(Browser),
    ok = ?B:click("kill", Browser),
    ok = ?B:await(
        "starl.team.robots.get(2).conditions.map(c => c[1]).join().endsWith('down,up')", Browser
    ),
    ?assert(?B:eval("[...starl.team.faults.values()].some(f => f.kind === 'reboot')", Browser)).

%% The robots appear, and go away from where they stood.
moves(N, Browser) ->
    ok = ?B:await(io_lib:format("Object.keys(starl.poses()).length === ~b", [N]), Browser),
    ok = ?B:await(
        "starl.team.run.kinds.length > 0 && starl.team.run.spots.some(([id, x, y]) => {"
        "const p = starl.poses()[id]; return Math.hypot(p[0] - x, p[1] - y) > 100; })",
        Browser
    ).

lasts(Kind, Browser) ->
    ok = ?B:await(
        ["[...starl.team.faults.values()].some(f => f.kind === '", Kind, "' && f.to > 9e11)"],
        Browser
    ).

heals(Browser) ->
    ok = ?B:click("heal", Browser),
    ok = ?B:await("[...starl.team.faults.values()].every(f => f.to < 9e11)", Browser).

%% The window stays when its run has ended.
stops(Browser) ->
    ?B:eval("starl.send({ do: 'stop' })", Browser),
    ok = ?B:await("starl.team.clock.ending === 'stopped'", Browser),
    ok = ?B:visit("about:blank", Browser).

%% -------------------------------------------------------------------------------------------

digest_of_no_hands(Config) ->
    Dir = ?config(priv_dir, Config),
    digest(rest(starl(["run", "painting", "--robots", "8", "--picture", "rocket"], Dir), "")).

%% -- the command line in a VM of its own ----------------------------------------------------

starl(Args, Dir) -> starl(Args, Dir, []).

starl(Args, Dir, Env) ->
    Paths = lists:append([["-pa", P] || P <- code:get_path(), filelib:is_dir(P)]),
    Main = "starl_cli:main(init:get_plain_arguments()).",
    open_port({spawn_executable, os:find_executable("erl")}, [
        {args, ["-noshell", "+fnu" | Paths] ++ ["-eval", Main, "-extra" | Args]},
        {cd, Dir},
        {env, Env},
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
