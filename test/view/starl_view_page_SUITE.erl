%% The page under the hands of its user: wheel, fingers, keys and fields, at a desk and on a telephone. The
%% test is the run: it tells the page what happens, and answers as a player does. Where there is no Chromium
%% the suite is skipped with a line.
-module(starl_view_page_SUITE).
-include_lib("stdlib/include/assert.hrl").
-include_lib("common_test/include/ct.hrl").

-export([all/0, suite/0, init_per_suite/1, end_per_suite/1]).
-export([
    the_wheel_zooms_by_how_far_it_turns/1,
    zooming_keeps_few_pictures/1,
    what_is_outside_is_not_drawn/1,
    buttons_zoom/1,
    fingers_pinch/1,
    robots_off_the_floor_are_seen/1,
    news_keep_focus_and_selection/1,
    a_button_does_not_take_the_keys/1,
    an_answer_stands_at_its_form/1,
    a_large_team_is_reachable/1,
    what_is_not_judged_is_said/1,
    what_an_application_draws_is_shown/1,
    a_page_without_its_token_says_so/1
]).

-define(B, starl_view_browser).
-define(MAP, "document.getElementById('map')").

suite() -> [{timetrap, {minutes, 3}}].

all() ->
    [
        the_wheel_zooms_by_how_far_it_turns,
        zooming_keeps_few_pictures,
        what_is_outside_is_not_drawn,
        buttons_zoom,
        fingers_pinch,
        robots_off_the_floor_are_seen,
        news_keep_focus_and_selection,
        a_button_does_not_take_the_keys,
        an_answer_stands_at_its_form,
        a_large_team_is_reachable,
        what_is_not_judged_is_said,
        what_an_application_draws_is_shown,
        a_page_without_its_token_says_so
    ].

init_per_suite(Config) ->
    case ?B:program() of
        {ok, Program} -> [{browser, ?B:lent(Program)} | Config];
        {skip, Why} -> {skip, Why}
    end.

end_per_suite(Config) -> ?B:give_back(?config(browser, Config)).

%% -- zoom -----------------------------------------------------------------------------------

%% A notch of a wheel zooms by about a fifth, one of the many parts that two fingers on a pad send hardly; what
%% is under the pointer stays there; and there are limits.
the_wheel_zooms_by_how_far_it_turns(Config) ->
    shown(grid(16), Config, fun(Browser, _Hub) ->
        {X, Y} = middle(Browser),
        At = {X + 150, Y - 100},
        Fit = scale(Browser),
        Notch = zoomed(-120, 1, At, Browser) / Fit,
        ?assert(Notch > 1.1 andalso Notch < 1.4, Notch),
        Part = zoomed(-4, 1, At, Browser) / (Notch * Fit),
        ?assert(Part > 1.0 andalso Part < 1.02, Part),
        Place = place(At, Browser),
        Most = zoomed(-120, 40, At, Browser),
        %% within a pixel of before
        ?assert(distance(Place, place(At, Browser)) < 1 / Fit),
        ?assertEqual(Most, zoomed(-120, 5, At, Browser)),
        %% three robots have room
        ?assert(Most * 2 * 165 =< 800 / 3),
        Least = zoomed(120, 60, At, Browser),
        ?assertEqual(Least, zoomed(120, 5, At, Browser)),
        ?assert(Least > Fit / 10),
        ?B:eval("starl.floor.move(1e7, 1e7)", Browser),
        ?assert(?B:eval("Math.hypot(starl.floor.view.x, starl.floor.view.y) < 1e5", Browser))
    end).

%% Of the present scale only: 28 notches once kept 745 MB.
zooming_keeps_few_pictures(Config) ->
    shown(grid(16), Config, fun(Browser, _Hub) ->
        At = middle(Browser),
        _ = [zoomed(Notch, 1, At, Browser) || Notch <- lists:duplicate(28, -120)],
        Bytes = pictures(Browser),
        ?assert(Bytes < 4 * 1024 * 1024, Bytes),
        _ = [zoomed(Notch, 1, At, Browser) || Notch <- lists:duplicate(28, 120)],
        ?assert(pictures(Browser) < 4 * 1024 * 1024)
    end).

pictures(Browser) ->
    ?B:eval(
        "[...starl.floor.sprites.values()].reduce((n, s) => n + 4 * s.width * s.height, 0)", Browser
    ).

%% Near one robot the other fifteen cost nothing.
what_is_outside_is_not_drawn(Config) ->
    shown(grid(16), Config, fun(Browser, _Hub) ->
        ?assertEqual(16, drawn(Browser)),
        ?B:eval("starl.floor.zoom(1e9, starl.floor.x(1000), starl.floor.y(1000))", Browser),
        ?B:eval("starl.floor.view.x = starl.floor.view.y = 1000", Browser),
        ?assertEqual(1, drawn(Browser))
    end).

%% The robots that are drawn in a frame: each has a place of its own.
drawn(Browser) ->
    ?B:eval(
        "(() => { let n = 0; const g = starl.floor.context; g.translate = (x, y) => { n++;"
        "CanvasRenderingContext2D.prototype.translate.call(g, x, y); };"
        "starl.floor.draw(starl.state.shown, null); delete g.translate; return n; })()",
        Browser
    ).

buttons_zoom(Config) ->
    shown(grid(4), Config, fun(Browser, _Hub) ->
        Fit = scale(Browser),
        ok = ?B:click("zoom-in", Browser),
        ?assert(scale(Browser) > Fit),
        ok = ?B:click("zoom-out", Browser),
        ok = ?B:click("zoom-out", Browser),
        ?assert(scale(Browser) < Fit),
        ok = ?B:click("zoom-all", Browser),
        ?assertEqual(Fit, scale(Browser))
    end).

%% Two fingers zoom the floor, not the page; one moves it; a tap selects.
fingers_pinch(Config) ->
    telephone(Config, fun(Browser) ->
        shown(grid(4), Browser, fun(_, _Hub) ->
            ?assertEqual(390, ?B:eval("innerWidth", Browser)),
            {X, Y} = middle(Browser),
            Fit = scale(Browser),
            Apart = fun(D) -> [{X - D, Y}, {X + D, Y}] end,
            ok = ?B:touch(touchStart, Apart(30), Browser),
            [ok = ?B:touch(touchMove, Apart(30 + 5 * N), Browser) || N <- lists:seq(1, 12)],
            ok = ?B:touch(touchEnd, [], Browser),
            ok = ?B:await(io_lib:format("starl.floor.view.scale > 2 * ~w", [Fit]), Browser),
            ?assert(scale(Browser) < 4 * Fit),
            ?assertEqual(1, ?B:eval("Math.round(100 * visualViewport.scale) / 100", Browser)),
            ?assertEqual(null, ?B:eval("starl.state.selected", Browser)),
            %% one finger
            Before = place({X, Y}, Browser),
            ok = ?B:touch(touchStart, [{X, Y}], Browser),
            [ok = ?B:touch(touchMove, [{X + 10 * N, Y}], Browser) || N <- lists:seq(1, 6)],
            ok = ?B:touch(touchEnd, [], Browser),
            ?assert(distance(Before, place({X + 60, Y}, Browser)) < 10 / scale(Browser) * 2),
            %% a tap
            ?B:eval("starl.floor.fit()", Browser),
            ok = ?B:touch(touchStart, [robot(3, Browser)], Browser),
            ok = ?B:touch(touchEnd, [], Browser),
            ok = ?B:await("starl.state.selected === 3", Browser)
        end)
    end).

telephone(Config, Do) ->
    ?B:borrow(?config(browser, Config), fun(Browser) ->
        ok = ?B:emulate(#{telephone => true}, Browser),
        try
            Do(Browser)
        after
            ok = ?B:emulate(#{telephone => false}, Browser)
        end
    end).

%% Robots that have left the floor are in the picture, or an arrow at its edge names them; and it is said.
robots_off_the_floor_are_seen(Config) ->
    Team = [{1, 3000, 3000}, {2, -11000, 3000}, {3, 3000, 90000}],
    shown(Team, Config, fun(Browser, _Hub) ->
        [X, Width] = ?B:eval("[starl.floor.x(-11000), starl.floor.w]", Browser),
        ?assert(X > 0 andalso X < Width, X),
        ?assertEqual([<<"3">>], named(Browser)),
        ok = ?B:await(
            "document.getElementById('figures').textContent.endsWith('off the floor: 2, 3')",
            Browser
        )
    end).

%% The numbers that are written on the floor; robots are too small there for theirs.
named(Browser) ->
    Names = ?B:eval(
        "(() => { const said = [], g = starl.floor.context; g.fillText = text => said.push(String(text));"
        "starl.floor.draw(starl.state.shown, null); delete g.fillText; return said; })()",
        Browser
    ),
    lists:sort(Names).

%% -- focus ----------------------------------------------------------------------------------

%% A robot's machines, the lights, the list of faults and the table are told again and again: what has the focus
%% keeps it, what is selected and opened stays so.
news_keep_focus_and_selection(Config) ->
    shown(grid(3), Config, fun(Browser, Hub) ->
        ?B:eval("starl.select(2)", Browser),
        ok = look(<<"first">>, Hub, Browser),
        %% a long word is broken at the panel's edge
        ?assert(
            ?B:eval(
                "(a => a.scrollWidth <= a.clientWidth)(document.querySelector('aside'))", Browser
            )
        ),
        ?B:eval(
            "var summary = document.querySelector('#machines summary'); summary.focus();"
            "summary.parentNode.open = true; var text = document.querySelector('#machines .timers li');"
            "getSelection().selectAllChildren(text)",
            Browser
        ),
        ok = look(<<"second">>, Hub, Browser),
        ?assert(?B:eval("document.activeElement === summary", Browser)),
        ?assert(?B:eval("summary.isConnected && summary.parentNode.open", Browser)),
        ?assertEqual(<<"timer tick">>, ?B:eval("String(getSelection())", Browser)),
        %% the table
        ?B:eval("document.getElementById('team').open = true", Browser),
        ok = ?B:await("document.querySelectorAll('#robots tr').length === 3", Browser),
        ?B:eval(
            "var row = document.querySelectorAll('#robots button')[1]; row.focus();"
            "var cell = row.closest('tr').cells[1], x = cell.textContent;",
            Browser
        ),
        ok = moved(Hub),
        ok = ?B:await(
            "document.querySelectorAll('#robots tr')[1].cells[1].textContent !== x", Browser
        ),
        ?assert(?B:eval("document.activeElement === row", Browser)),
        %% the list of faults
        ok = told([fault(<<"one">>)], 3000000, Hub),
        ok = ?B:await("document.querySelectorAll('#faults button').length === 1", Browser),
        ?B:eval("var heal = document.querySelector('#faults button'); heal.focus()", Browser),
        ok = told([fault(<<"two">>)], 4000000, Hub),
        ok = ?B:await("document.querySelectorAll('#faults button').length === 2", Browser),
        ?assert(?B:eval("document.activeElement === heal", Browser))
    end).

fault(Id) -> [<<"f">>, 3000000, Id, 2000, 900000000, <<"isolate">>, <<"1">>, <<>>].

moved(Hub) -> told([motion({2, 7500, 7500}, 2000000)], 2500000, Hub).

%% What a player says to `look'.
look(State, Hub, Browser) ->
    ok = starl_view_hub:lead(Hub, self()),
    ok = ?B:eval("starl.send({ do: 'look', robot: 2 }), 'ok'", Browser) =:= <<"ok">> andalso ok,
    receive
        {starl_view, Page, #{<<"do">> := <<"look">>}} ->
            Machine = #{
                name => <<"sap">>,
                module => <<"starl_sap">>,
                state => State,
                data => <<"data of ", State/binary>>,
                timers => [[<<"tick">>, null]]
            },
            Seen = #{
                events => 1,
                result => binary:copy(<<"0.335">>, 40),
                crashes => [],
                machines => [Machine],
                last => []
            },
            Page ! {tell, [<<"look">>, 1000000, 2, Seen]}
    end,
    ok = starl_view_hub:lead(Hub, none),
    ?B:await(
        [
            "document.querySelector('#machines summary').textContent === 'sap: ",
            State,
            "'"
        ],
        Browser
    ).

%% -- verdicts -------------------------------------------------------------------------------

%% A contract that is not judged is neither kept nor broken: its light says so from then on, with the reason in
%% words; a page that comes later is told, too.
what_is_not_judged_is_said(Config) ->
    shown(grid(2), Config, fun(Browser, Hub) ->
        Lights =
            "[...document.querySelectorAll('#lights span')].map(l => l.textContent).join()",
        Shows = fun(Text) -> ?B:await([Lights, " === '", Text, "'"], Browser) end,
        ok = Shows("motion kept,sap kept"),
        ok = told([[<<"u">>, 2000000, [<<"sap">>], <<"sap: a mistake">>]], 3000000, Hub),
        ok = Shows("motion kept,sap not judged from 2.000 s on"),
        Hub ! {unjudged, 3500000, {stood_still, 1000000, 3500000}},
        ok = told([], 4000000, Hub),
        ok = Shows("motion not judged from 3.500 s on,sap not judged from 2.000 s on"),
        ?assertMatch(
            [
                <<"sap: a mistake">>,
                <<"not judged any further: the computer stood still", _/binary>>
            ],
            ?B:eval("[...document.querySelectorAll('#broken li')].map(l => l.textContent)", Browser)
        ),
        ?B:eval("starl.scrub(2.5e6)", Browser),
        ok = Shows("motion kept,sap not judged from 2.000 s on"),
        ?B:eval("location.reload()", Browser),
        Shows("motion not judged from 3.500 s on,sap not judged from 2.000 s on")
    end).

%% A drawing is there from when it is drawn until its life ends or another one of its key takes its place; a
%% page that comes later shows it, too.
what_an_application_draws_is_shown(Config) ->
    shown(grid(2), Config, fun(Browser, Hub) ->
        %% the colour of a place of the floor, after the next frame
        Pixel =
            "[...starl.floor.context.getImageData(starl.floor.x(5000), starl.floor.y(5000), 1, 1).data].join()",
        Bare = ?B:eval(Pixel, Browser),
        Square = fun(At, Robot, Key, Life, Points) ->
            {trace, At,
                {Robot, app,
                    {draw, #{
                        key => Key,
                        kind => area,
                        points => Points,
                        text => <<>>,
                        life_us => Life,
                        colour => red
                    }}}}
        end,
        Points = [{4000, 4000}, {6000, 4000}, {6000, 6000}, {4000, 6000}],
        Rows = fun(Message) -> starl_view_row:of_message(Message) end,
        Is = fun(Sign) -> ?B:await([Pixel, Sign, "'", Bare, "'"], Browser) end,
        ok = told(Rows(Square(2000000, 1, a, 500000, Points)), 2100000, Hub),
        ok = Is(" !== "),
        ok = told([], 3000000, Hub),
        ok = Is(" === "),
        ok = told(Rows(Square(3000000, 1, {b, 1}, infinity, Points)), 3500000, Hub),
        ok = Is(" !== "),
        ?B:eval("location.reload()", Browser),
        ok = ?B:await("window.starl && starl.floor.view && true", Browser),
        ok = Is(" !== "),
        ok = told(Rows(Square(4000000, 1, {b, 1}, infinity, [])), 4500000, Hub),
        Is(" === ")
    end).

%% After a click keys work as before, and space does not press the button again; a button that the keyboard has
%% reached has its space; a field takes what is typed.
a_button_does_not_take_the_keys(Config) ->
    shown(grid(3), Config, fun(Browser, _Hub) ->
        ok = ?B:click("zoom-in", Browser),
        Near = scale(Browser),
        ok = ?B:press(<<"n">>, Browser),
        ?assertEqual(1, ?B:eval("starl.state.selected", Browser)),
        ok = ?B:press(<<" ">>, Browser),
        ?assertEqual(Near, scale(Browser)),
        ?B:eval("document.getElementById('zoom-out').focus()", Browser),
        ok = ?B:press(<<"n">>, Browser),
        ?assertEqual(2, ?B:eval("starl.state.selected", Browser)),
        ok = ?B:press(<<" ">>, Browser),
        ?assert(scale(Browser) < Near),
        ?B:eval("document.getElementById('name').focus()", Browser),
        ok = ?B:press(<<"n">>, Browser),
        ?assertEqual(2, ?B:eval("starl.state.selected", Browser)),
        ok = ?B:press(<<"Escape">>, Browser),
        ok = ?B:press(<<"n">>, Browser),
        ?assertEqual(3, ?B:eval("starl.state.selected", Browser))
    end).

%% What cannot be done is said where it was asked, also if the form is at the edge of the panel, until the next
%% try.
an_answer_stands_at_its_form(Config) ->
    shown(grid(3), Config, fun(Browser, Hub) ->
        ok = starl_view_hub:lead(Hub, self()),
        ok = ?B:emulate(#{width => 1000, height => 420}, Browser),
        ?B:eval("starl.select(1); document.getElementById('target').value = '99'", Browser),
        ok = ?B:click("do-fault", Browser),
        receive
            {starl_view, Page, #{<<"do">> := <<"fault">>} = Command} ->
                Asker = starl_view_hub:asker(Page, Command),
                ok = starl_view_hub:say(Asker, no, <<"this target is not possible here">>)
        end,
        ok = ?B:await(
            "document.getElementById('fault-said').textContent === 'this target is not possible here'",
            Browser
        ),
        ?assertEqual(<<>>, ?B:eval("document.getElementById('news').textContent", Browser)),
        %% it is brought into view; a panel scrolls by whole pixels
        ok = ?B:await(
            "(() => { const form = document.getElementById('fault').getBoundingClientRect(),"
            "said = document.getElementById('fault-said').getBoundingClientRect(),"
            "panel = document.querySelector('aside').getBoundingClientRect();"
            "return said.height > 0 && Math.abs(said.top - form.bottom) < 40 &&"
            "said.bottom < panel.bottom + 1; })()",
            Browser
        ),
        ok = ?B:emulate(#{telephone => false}, Browser),
        ?B:eval("document.getElementById('target').focus()", Browser),
        ok = ?B:press(<<"1">>, Browser),
        ok = ?B:await("document.getElementById('fault-said').textContent === ''", Browser)
    end).

%% Who has typed a part of the address is told what is missing; with the rest the page is there, without being
%% loaded anew by hand.
%% Holds: A page opened without its token says what is missing, and is there as soon as the token
%% is typed
%% Red: d7c73771, with its page, run: *the server has ended, or cannot be reached*
a_page_without_its_token_says_so(Config) ->
    ?B:borrow(?config(browser, Config), fun(Browser) ->
        {ok, View} = starl_view:start(#{port => 0, host => "0.0.0.0"}),
        #{port := Port, fragment := Token} = uri_string:parse(starl_view:address(View)),
        ok = starl_view_hub:head(starl_view:hub(View), {[[<<"run">>, run(grid(2))]], 2}),
        try
            ok = ?B:visit(["http://127.0.0.1:", integer_to_list(Port), "/"], Browser),
            ok = ?B:await(
                "document.getElementById('news').textContent.includes('the token behind #')",
                Browser
            ),
            ?B:eval(["location.hash = '", Token, "'"], Browser),
            ok = ?B:await("window.starl && starl.team.run", Browser),
            ?assertEqual(<<>>, ?B:eval("document.getElementById('news').textContent", Browser))
        after
            ok = ?B:visit("about:blank", Browser),
            ok = starl_view:stop(View)
        end
    end).

%% -- large teams ----------------------------------------------------------------------------

%% 450 robots, 40 of which talk: the chart has 12 columns and the table 200 rows, which is said; all others can
%% be reached.
a_large_team_is_reachable(Config) ->
    shown(grid(450), Config, fun(Browser, Hub) ->
        Talk = [
            [<<"p">>, 900000, R, R + 1, <<"ack">>, 9, <<"arrives">>, 950000]
         || R <- lists:seq(1, 39)
        ],
        ok = told(Talk, 1000001, Hub),
        says("columns-said", "12 of 40 robots", Browser),
        ok = ?B:click("columns-on", Browser),
        ok = ?B:await("starl.state.column === 13", Browser),
        ok = ?B:click("columns-on", Browser),
        ok = ?B:await("starl.state.column === 25", Browser),
        ok = ?B:click("columns-on", Browser),
        ok = ?B:await("document.getElementById('columns-on').disabled", Browser),
        ?B:eval("document.getElementById('team').open = true", Browser),
        says("rows-said", "1 to 200 of 450 robots", Browser),
        ok = ?B:click("rows-on", Browser),
        ok = ?B:click("rows-on", Browser),
        says("rows-said", "401 to 450 of 450 robots", Browser),
        ?assert(
            ?B:eval("document.querySelector('#robots tr[data-key=\"450\"]') !== null", Browser)
        ),
        ?assert(?B:eval("document.getElementById('rows-on').disabled", Browser))
    end).

says(Id, Text, Browser) ->
    ok = ?B:await(
        unicode:characters_to_binary(
            ["document.getElementById('", Id, "').textContent.trim() === '", Text, "'"]
        ),
        Browser
    ).

%% -- the page of a run ----------------------------------------------------------------------

%% Robots as rows and columns, 1.5 m apart; the first stands at 1 m, 1 m.
grid(N) ->
    Side = ceil(math:sqrt(N)),
    [
        {Id, 1000 + 1500 * ((Id - 1) rem Side), 1000 + 1500 * ((Id - 1) div Side)}
     || Id <- lists:seq(1, N)
    ].

shown(Team, Config, Do) when is_list(Config) ->
    ?B:borrow(?config(browser, Config), fun(Browser) -> shown(Team, Browser, Do) end);
shown(Team, Browser, Do) ->
    {ok, View} = starl_view:start(#{port => 0}),
    Hub = starl_view:hub(View),
    ok = starl_view_hub:head(Hub, {[[<<"run">>, run(Team)]], length(Team)}),
    ok = told([motion(Robot, 0) || Robot <- Team], 1000000, Hub),
    try
        ok = ?B:open(starl_view:address(View), Browser),
        ok = ?B:await("starl.state.shown === 1e6 && starl.floor.view", Browser),
        Do(Browser, Hub)
    after
        ok = ?B:visit("about:blank", Browser),
        ok = starl_view:stop(View)
    end.

run(Team) ->
    #{
        app => <<"grid">>,
        seed => 1,
        kind => simulation,
        robots => [Id || {Id, _, _} <- Team],
        radius => 165,
        world => floor_of(length(Team)),
        range => null,
        limit => 100,
        machines => [<<"sap">>],
        contracts => [<<"motion">>, <<"sap">>],
        kinds => [[<<"isolate">>, <<"robots">>, [], <<"no packets">>]],
        spots => [[Id, X, Y] || {Id, X, Y} <- Team],
        waypoints => [],
        tube => null,
        lines => []
    }.

floor_of(N) when N =< 64 -> [12000, 12000];
floor_of(_) -> [34000, 34000].

motion({Id, X, Y}, At) -> [<<"m">>, At, Id, 0, At, X, Y, 0, 0, 0].

told(Rows, Now, Hub) ->
    ok = lists:foreach(fun(Row) -> ok = starl_view_hub:put(Hub, Row) end, Rows),
    starl_view_hub:clock(Hub, #{
        now_us => Now, speed => 1, real => 0, paused => true, ending => null
    }).

scale(Browser) -> ?B:eval("starl.floor.view.scale", Browser).

%% The middle of the floor's picture on the page.
middle(Browser) ->
    [X, Y] = ?B:eval(
        ["(r => [r.x + r.width / 2, r.y + r.height / 2])(", ?MAP, ".getBoundingClientRect())"],
        Browser
    ),
    {X, Y}.

%% Where a robot is on the page.
robot(Id, Browser) ->
    [X, Y] = ?B:eval(
        io_lib:format(
            "(() => { const p = starl.poses()[~b], c = ~ts.getBoundingClientRect(), f = starl.floor;"
            "return [c.x + f.x(p[0]) / f.ratio, c.y + f.y(p[1]) / f.ratio]; })()",
            [Id, ?MAP]
        ),
        Browser
    ),
    {X, Y}.

%% The place of the floor that is shown at a place of the page.
place({X, Y}, Browser) ->
    [Mx, My] = ?B:eval(
        io_lib:format(
            "(c => starl.floor.place(~w - c.x, ~w - c.y))(~ts.getBoundingClientRect())", [
                X, Y, ?MAP
            ]
        ),
        Browser
    ),
    {Mx, My}.

distance({X1, Y1}, {X2, Y2}) -> math:sqrt((X1 - X2) * (X1 - X2) + (Y1 - Y2) * (Y1 - Y2)).

%% The scale after turns of the wheel, each of which is drawn.
zoomed(Pixels, Times, At, Browser) ->
    ?B:eval(
        "window.counts ??= (addEventListener('wheel', () => turns++, { passive: true }), true);"
        "var turns = 0",
        Browser
    ),
    [ok = ?B:wheel(At, Pixels, Browser) || _ <- lists:seq(1, Times)],
    ok = ?B:await(io_lib:format("turns === ~b", [Times]), Browser),
    ?B:eval("starl.floor.draw(starl.state.shown, null)", Browser),
    scale(Browser).
