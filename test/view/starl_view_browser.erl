%% A browser for tests: headless Chromium by the DevTools protocol, over a pipe (its descriptors 3 and
%% 4), so no other program is needed. A condition is awaited within the page, at each of its frames.
-module(starl_view_browser).

-export([program/0, start/1, start/2, stop/1, lent/1, borrow/2, give_back/1]).
-export([open/2, visit/2, eval/2, await/2]).
-export([click/2, click/3, press/2, wheel/3, touch/3, shot/2, emulate/2]).

-record(browser, {port :: port(), session = none :: binary() | none, dir :: string()}).

-define(PATIENCE_MS, 30000).

%% The path of Chromium, or one line on why the test is skipped.
program() ->
    Found = [
        P
     || Name <- ["chromium", "chromium-browser", "google-chrome"],
        P <- [os:find_executable(Name)],
        is_list(P)
    ],
    case Found of
        [Program | _] -> {ok, Program};
        [] -> {skip, "no chromium here (Debian: apt-get install chromium): the page is not tested"}
    end.

start(Program) -> start(Program, #{}).

start(Program, Options) ->
    Dir = filename:join(
        "/tmp",
        "starl-browser-" ++ os:getpid() ++
            integer_to_list(erlang:unique_integer([positive]))
    ),
    Size = maps:get(size, Options, "1280,800"),
    Args =
        [
            "--headless=new",
            "--no-sandbox",
            "--disable-gpu",
            "--disable-dev-shm-usage",
            "--mute-audio",
            "--no-first-run",
            "--disable-extensions",
            "--disable-background-networking",
            "--hide-scrollbars",
            "--force-color-profile=srgb",
            "--remote-debugging-pipe",
            "--user-data-dir=" ++ Dir,
            "--window-size=" ++ Size,
            "about:blank"
        ] ++
            [A || A <- maps:get(args, Options, [])],
    %% its own words would come among the tests'; its arguments are its own
    Port = open_port({spawn_executable, "/bin/sh"}, [
        {args, ["-c", "exec \"$0\" \"$@\" 2>/dev/null >/dev/null", Program | Args]},
        nouse_stdio,
        binary,
        stream,
        exit_status
    ]),
    Browser = #browser{port = Port, dir = Dir},
    {#{<<"targetInfos">> := Infos}, _} = call(<<"Target.getTargets">>, #{}, Browser),
    [#{<<"targetId">> := Target} | _] = [I || #{<<"type">> := <<"page">>} = I <- Infos],
    {#{<<"sessionId">> := Session}, _} =
        call(<<"Target.attachToTarget">>, #{targetId => Target, flatten => true}, Browser),
    Attached = Browser#browser{session = Session},
    _ = call(<<"Page.enable">>, #{}, Attached),
    _ = call(<<"Page.setLifecycleEventsEnabled">>, #{enabled => true}, Attached),
    _ = call(<<"Runtime.enable">>, #{}, Attached),
    _ = call(<<"Log.enable">>, #{}, Attached),
    Attached.

stop(#browser{port = Port, dir = Dir} = Browser) ->
    _ = call(<<"Browser.close">>, #{}, Browser#browser{session = none}),
    receive
        {Port, {exit_status, _}} -> ok
    after 5000 -> ok
    end,
    _ = erlang:port_info(Port) =/= undefined andalso port_close(Port),
    file:del_dir_r(Dir).

%% A port belongs to a process, and each test is one of its own: one browser is lent to all of a suite.
lent(Program) ->
    Suite = self(),
    Lender = spawn(fun() ->
        Browser = start(Program),
        Suite ! {self(), ready},
        lend(Browser)
    end),
    receive
        {Lender, ready} -> Lender
    end.

lend(Browser) ->
    receive
        {do, From, Do} ->
            Answer =
                try
                    {done, Do(Browser)}
                catch
                    Class:Reason:Stack -> {failed, Class, Reason, Stack}
                end,
            From ! {self(), Answer},
            lend(Browser);
        {give_back, From} ->
            _ = stop(Browser),
            From ! {given_back, self()}
    end.

%% Does something with the browser that is lent, in its process.
borrow(Lender, Do) ->
    Lender ! {do, self(), Do},
    receive
        {Lender, {done, Value}} -> Value;
        {Lender, {failed, Class, Reason, Stack}} -> erlang:raise(Class, Reason, Stack)
    end.

give_back(Lender) ->
    Lender ! {give_back, self()},
    receive
        {given_back, Lender} -> ok
    end.

%% The page of a window, when it knows the run.
open(Url, Browser) ->
    ok = visit(Url, Browser),
    await(<<"window.starl && starl.team.run && starl.team.clock.speed !== undefined">>, Browser).

%% Any page.
visit(Url, Browser) ->
    {#{<<"loaderId">> := Loader}, _} =
        call(<<"Page.navigate">>, #{url => iolist_to_binary(Url)}, Browser),
    loaded = answer({loaded, Loader}, Browser#browser.port),
    ok.

%% Another size, a telephone, or colours: `#{width, height}', `#{telephone}', `#{dark}'.
emulate(#{width := Width, height := Height}, Browser) ->
    Size = #{width => Width, height => Height, deviceScaleFactor => 1, mobile => false},
    _ = call(<<"Emulation.setDeviceMetricsOverride">>, Size, Browser),
    ok;
emulate(#{telephone := true}, Browser) ->
    Size = #{width => 390, height => 844, deviceScaleFactor => 2, mobile => true},
    _ = call(<<"Emulation.setDeviceMetricsOverride">>, Size, Browser),
    _ = call(<<"Emulation.setTouchEmulationEnabled">>, #{enabled => true}, Browser),
    ok;
emulate(#{telephone := false}, Browser) ->
    _ = call(<<"Emulation.clearDeviceMetricsOverride">>, #{}, Browser),
    _ = call(<<"Emulation.setTouchEmulationEnabled">>, #{enabled => false}, Browser),
    ok;
emulate(#{dark := Dark}, Browser) ->
    Value =
        case Dark of
            true -> dark;
            false -> light
        end,
    Features = [#{name => <<"prefers-color-scheme">>, value => Value}],
    _ = call(<<"Emulation.setEmulatedMedia">>, #{features => Features}, Browser),
    ok.

%% The value of an expression.
eval(Expression, Browser) ->
    Params = #{
        expression => iolist_to_binary(Expression), returnByValue => true, awaitPromise => true
    },
    case call(<<"Runtime.evaluate">>, Params, Browser) of
        {#{<<"exceptionDetails">> := Details}, _} -> error({page, Details});
        {#{<<"result">> := Result}, _} -> maps:get(<<"value">>, Result, undefined)
    end.

%% Waits, frame by frame, until an expression is true. A page that is just being left takes the
%% question with it: it is asked again of the next one, a few times.
await(Condition, Browser) -> await(Condition, 3, Browser).

await(Condition, Again, Browser) ->
    Script = [
        "new Promise((yes, no) => { const late = performance.now() + 25000;",
        "const look = () => { let is = false; try { is = ",
        Condition,
        "; } catch (e) { is = false; }",
        "if (is) yes(true); else if (performance.now() > late) yes(false);",
        "else setTimeout(look, 10); }; look(); })"
    ],
    try eval(Script, Browser) of
        true -> ok;
        Other -> error({never, iolist_to_binary(Condition), Other})
    catch
        error:{devtools, #{<<"message">> := <<"Inspected target navigated or closed">>}} when
            Again > 0
        ->
            await(Condition, Again - 1, Browser)
    end.

%% A click of the mouse on an element, which must be there to be hit.
click(Id, Browser) ->
    Element = ["document.getElementById('", Id, "')"],
    ok = await([Element, " && !", Element, ".disabled"], Browser),
    [X, Y, Hit] = eval(
        [
            "(() => { const e = ",
            Element,
            "; e.scrollIntoView({ block: 'nearest' });"
            "const r = e.getBoundingClientRect(), x = r.x + r.width / 2, y = r.y + r.height / 2;"
            "return [x, y, e.contains(document.elementFromPoint(x, y))]; })()"
        ],
        Browser
    ),
    Hit orelse error({hidden, Id}),
    click(X, Y, Browser).

%% A click of the mouse on the page.
click(X, Y, Browser) ->
    [
        call(
            <<"Input.dispatchMouseEvent">>,
            #{
                type => Type,
                x => X,
                y => Y,
                button => left,
                clickCount => 1,
                buttons =>
                    case Type of
                        mousePressed -> 1;
                        _ -> 0
                    end
            },
            Browser
        )
     || Type <- [mouseMoved, mousePressed, mouseReleased]
    ],
    ok.

%% The wheel at a place of the page, or two fingers on a pad, which send many small turns.
wheel({X, Y}, Pixels, Browser) ->
    Turn = #{type => mouseWheel, x => X, y => Y, deltaX => 0, deltaY => Pixels},
    _ = call(<<"Input.dispatchMouseEvent">>, Turn, Browser),
    ok.

%% Fingers come down (`touchStart'), move (`touchMove') or are lifted (`touchEnd', none is left).
touch(Type, Places, Browser) ->
    Points = [#{x => X, y => Y, id => Id} || {Id, {X, Y}} <- lists:enumerate(Places)],
    _ = call(<<"Input.dispatchTouchEvent">>, #{type => Type, touchPoints => Points}, Browser),
    ok.

%% A key.
press(Key, Browser) ->
    [
        call(<<"Input.dispatchKeyEvent">>, key(Type, Key), Browser)
     || Type <- [keyDown, keyUp]
    ],
    ok.

%% Keys with a name write nothing.
key(Type, Key) when byte_size(Key) > 1 -> #{type => Type, key => Key};
key(Type, Key) -> #{type => Type, key => Key, text => Key}.

shot(File, Browser) ->
    {#{<<"data">> := Data}, _} = call(<<"Page.captureScreenshot">>, #{format => png}, Browser),
    ok = filelib:ensure_dir(File),
    ok = file:write_file(File, base64:decode(Data)).

call(Method, Params, #browser{port = Port, session = Session} = Browser) ->
    Id = erlang:unique_integer([positive]),
    Message = #{id => Id, method => Method, params => Params},
    Full =
        case Session of
            none -> Message;
            _ -> Message#{sessionId => Session}
        end,
    true = port_command(Port, [starl_json:encode(Full), 0]),
    {answer(Id, Port), Browser}.

%% A page that complains is broken; that its server has ended is no fault of its own.
logged(#{<<"entry">> := #{<<"level">> := <<"error">>, <<"source">> := Source} = Entry}) when
    Source =/= <<"network">>
->
    error({page, Entry});
logged(_) ->
    ok.

answer(Id, Port) ->
    Rest =
        case get({rest, Port}) of
            undefined -> <<>>;
            Left -> Left
        end,
    answer(Id, Port, Rest).

answer(Id, Port, Rest) ->
    case binary:split(Rest, <<0>>) of
        [Text, More] ->
            case starl_json:decode(Text) of
                {ok, #{<<"id">> := Id, <<"result">> := Result}} ->
                    _ = put({rest, Port}, More),
                    Result;
                {ok, #{<<"id">> := Id, <<"error">> := Error}} ->
                    error({devtools, Error});
                {ok, #{
                    <<"method">> := <<"Page.lifecycleEvent">>,
                    <<"params">> := #{<<"name">> := <<"load">>, <<"loaderId">> := Loader}
                }} when Id =:= {loaded, Loader} ->
                    _ = put({rest, Port}, More),
                    loaded;
                {ok, #{<<"method">> := <<"Runtime.exceptionThrown">>, <<"params">> := P}} ->
                    error({page, P});
                {ok, #{<<"method">> := <<"Log.entryAdded">>, <<"params">> := P}} ->
                    _ = put({rest, Port}, More),
                    logged(P),
                    answer(Id, Port);
                {ok, _} ->
                    answer(Id, Port, More)
            end;
        [Part] ->
            receive
                {Port, {data, Data}} -> answer(Id, Port, <<Part/binary, Data/binary>>);
                {Port, {exit_status, Status}} -> error({browser_ended, Status})
            after ?PATIENCE_MS -> error(browser_silent)
            end
    end.
