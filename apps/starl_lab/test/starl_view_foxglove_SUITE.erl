%% Viewers that speak Foxglove's protocol: they see what the simulation does, on the channels of
%% recordings; what bad ones do harms nobody. The last case is with the official client, from npm:
%% `npm install --prefix _build/node @foxglove/ws-protocol ws'.
-module(starl_view_foxglove_SUITE).
-include_lib("stdlib/include/assert.hrl").
-include_lib("common_test/include/ct.hrl").

-export([all/0, suite/0, init_per_testcase/2, end_per_testcase/2]).
-export([versions/1, who_may_look/1, sees_the_run/1, late_and_again/1]).
-export([garbage/1, one_that_reads_nothing/1, controls_time/1, the_official_client/1]).

-define(C, starl_view_client).
-define(PATIENCE_MS, 20000).
-define(NODE, "_build/node").

suite() -> [{timetrap, {minutes, 3}}].

all() ->
    [
        versions,
        who_may_look,
        sees_the_run,
        late_and_again,
        garbage,
        one_that_reads_nothing,
        controls_time,
        the_official_client
    ].

init_per_testcase(_Case, Config) ->
    {ok, View} = starl_view:start(#{port => 0, most_waiting => 100000}),
    #{port := Port, fragment := Token} = uri_string:parse(
        binary_to_list(starl_view:address(View))
    ),
    [{view, View}, {port, {Port, Token}}, {hub, starl_view:hub(View)} | Config].

end_per_testcase(_Case, Config) -> starl_view:stop(?config(view, Config)).

%% Both versions at the path of the page, as viewers have it, and at one of their own.
versions(Config) ->
    Port = ?config(port, Config),
    Of = fun(Versions) -> [{"Sec-WebSocket-Protocol", Versions}] end,
    [
        begin
            {101, Socket} = ?C:connect(Port, Path, Of(Versions)),
            #{<<"op">> := <<"serverInfo">>} = text(Socket)
        end
     || Path <- ["/", "/foxglove"],
        Versions <- [
            "foxglove.sdk.v1",
            "foxglove.websocket.v1",
            "foxglove.websocket.v1, foxglove.sdk.v1",
            "other, foxglove.sdk.v1"
        ]
    ],
    ?assertMatch({400, _}, ?C:connect(Port, "/", Of("other"))),
    ?assertMatch({400, _}, ?C:connect(Port, "/foxglove", [])),
    {ok, Chosen} = starl_view_foxglove_words:chosen([
        <<"foxglove.websocket.v1">>, <<"foxglove.sdk.v1">>
    ]),
    ?assertEqual(<<"foxglove.sdk.v1">>, Chosen).

%% Programs, and pages of this computer and of Foxglove; nobody under another name.
who_may_look(Config) ->
    Port = ?config(port, Config),
    Own = {"Sec-WebSocket-Protocol", "foxglove.sdk.v1"},
    Status = fun(Headers) -> element(1, ?C:connect(Port, "/", [Own | Headers])) end,
    ?assertEqual(101, Status([])),
    ?assertEqual(101, Status([{"Origin", "https://app.foxglove.dev"}])),
    ?assertEqual(101, Status([{"Origin", "http://localhost:8080"}])),
    ?assertEqual(403, Status([{"Origin", "https://evil.example"}])),
    ?assertEqual(403, Status([{"Origin", "https://localhost.evil.example"}])),
    ?assertEqual(403, Status([{"Origin", "null"}])),
    ?assertEqual(403, Status([{"Host", "evil.example"}])).

%% Frames are where the robots are, at that time; ink is what they drew.
sees_the_run(Config) ->
    {Socket, Topics} = viewer(Config),
    ?assertEqual(
        lists:sort([
            <<"/scenario">>,
            <<"/tf">>,
            <<"/scene">>,
            <<"/log">>,
            <<"/trace">>,
            <<"/packets">>,
            <<"/faults">>,
            <<"/verdicts">>,
            <<"/metrics">>,
            <<"/measures">>,
            <<"/drawings">>
        ]),
        lists:sort(maps:keys(Topics))
    ),
    Ids = maps:from_list([{100 + Id, Topic} || {Topic, #{<<"id">> := Id}} <- maps:to_list(Topics)]),
    ok = subscribe([{100 + Id, Id} || #{<<"id">> := Id} <- maps:values(Topics)], Socket),
    _ = ran(20, Config),
    Seen = until(
        fun
            ({time, T}) -> T >= 20000000;
            (_) -> false
        end,
        Socket,
        []
    ),
    Of = fun(Topic) -> [{T, Json} || {Id, T, Json} <- Seen, maps:get(Id, Ids) =:= Topic] end,
    [?assertNotEqual({Topic, []}, {Topic, Of(Topic)}) || Topic <- maps:values(Ids), has(Topic)],
    [{_, #{<<"application">> := <<"starl_painting">>, <<"robots">> := 3}}] = Of(<<"/scenario">>),
    Truth = truth(20),
    Frames = [
        {T, Frame}
     || {T, #{<<"transforms">> := Frames}} <- Of(<<"/tf">>), Frame <- Frames
    ],
    ?assert(length(Frames) > 500),
    [?assert(is_true(T, Frame, Truth)) || {T, Frame} <- Frames],
    Lines = [
        Line
     || {_, #{<<"entities">> := Entities}} <- Of(<<"/scene">>),
        #{<<"lines">> := Lines} <- Entities,
        Line <- Lines
    ],
    ?assert(length(Lines) > 1).

has(Topic) ->
    not lists:member(Topic, [
        <<"/log">>, <<"/faults">>, <<"/verdicts">>, <<"/measures">>, <<"/drawings">>
    ]).

is_true(T, #{<<"child_frame_id">> := <<"robot ", Id/binary>>, <<"translation">> := At}, Truth) ->
    #{<<"x">> := X, <<"y">> := Y} = At,
    {TX, TY} = position(T, maps:get(binary_to_integer(Id), Truth)),
    abs(1000 * X - TX) =< 1 andalso abs(1000 * Y - TY) =< 1.

%% A viewer that comes late gets the ink that was drawn before; a run that begins anew is another
%% session, and the same viewer goes on with it.
late_and_again(Config) ->
    _ = ran(20, Config),
    {Socket, #{<<"/scene">> := #{<<"id">> := Scene}}} = viewer(Config),
    ok = subscribes([{7, Scene}], Socket),
    IsInk = fun
        ({_, _, #{<<"entities">> := [#{<<"lines">> := [_ | _]}]}}) -> true;
        (_) -> false
    end,
    ?assertMatch([{7, _, _}, _ | _], until(IsInk, Socket, [])),
    _ = ran(2, Config),
    #{<<"op">> := <<"unadvertise">>} = named(<<"unadvertise">>, Socket),
    #{<<"sessionId">> := _} = named(<<"serverInfo">>, Socket),
    ok = subscribes([{8, Scene}], Socket),
    IsNew = fun(Seen) -> element(1, Seen) =:= 8 end,
    ?assertMatch([_ | _], until(IsNew, Socket, [])).

named(Op, Socket) ->
    case text(Socket) of
        #{<<"op">> := Op} = Text -> Text;
        _ -> named(Op, Socket)
    end.

garbage(Config) ->
    {Socket, #{<<"/tf">> := #{<<"id">> := Tf}}} = viewer(Config),
    #{<<"level">> := 0} = text(Socket),
    Bad = [
        "{",
        "[]",
        "{\"op\":1}",
        "{\"op\":\"subscribe\",\"subscriptions\":[{\"id\":-1,\"channelId\":3}]}",
        "{\"op\":\"subscribe\",\"subscriptions\":[{\"id\":1,\"channelId\":99}]}",
        "{\"op\":\"subscribe\",\"subscriptions\":[7]}",
        "{\"op\":\"unsubscribe\",\"subscriptionIds\":[5]}",
        "{\"op\":\"setParameters\",\"parameters\":[]}",
        "{\"op\":\"advertise\",\"channels\":[]}"
    ],
    [
        begin
            ok = ?C:send(Text, Socket),
            ?assertMatch(#{<<"op">> := <<"status">>, <<"level">> := 2}, text(Socket))
        end
     || Text <- Bad
    ],
    ok = ?C:raw([<<1:1, 0:3, 2:4, 1:1, 5:7, 0:32>>, <<1, 2, 3, 4, 5>>], Socket),
    ?assertMatch(#{<<"op">> := <<"status">>}, text(Socket)),
    %% it still sees the run
    ok = subscribe([{1, Tf}], Socket),
    ok = subscribes([{1, Tf}], Socket),
    ?assertMatch(#{<<"op">> := <<"status">>}, text(Socket)),
    _ = ran(2, Config),
    IsFrame = fun
        ({1, _, #{<<"transforms">> := _}}) -> true;
        (_) -> false
    end,
    ?assertMatch([_ | _], until(IsFrame, Socket, [])),
    _ = [?C:send("{", Socket) || _ <- lists:seq(1, 30)],
    ?assertMatch({8, <<1008:16, _/binary>>}, closed(Socket)).

%% Its messages are dropped, memory stays bounded, the run goes on; when it reads again it is told so
%% and gets the state of now.
one_that_reads_nothing(Config) ->
    {Socket, #{<<"/tf">> := #{<<"id">> := Tf}}} = viewer(Config),
    %% more than the system's buffers hold
    ok = subscribe([{Id, Tf} || Id <- lists:seq(1, 300)], Socket),
    Hub = ?config(hub, Config),
    ok = starl_view_hub:clock(Hub, #{now_us => 0}),
    _ = ran(40, Config),
    {_, Feed} = feed(Config),
    true = erlang:garbage_collect(Feed),
    {memory, Bytes} = erlang:process_info(Feed, memory),
    {message_queue_len, Waiting} = erlang:process_info(Feed, message_queue_len),
    ct:pal("~b bytes in the feed", [Bytes]),
    ?assert(Bytes < 20000000),
    ?assert(Waiting < 10),
    Missed = until(
        fun
            ({text, #{<<"message">> := <<"Send buffer limit", _/binary>>}}) -> true;
            (_) -> false
        end,
        Socket,
        []
    ),
    ?assertNotEqual([], Missed),
    ok = starl_view_hub:clock(Hub, #{now_us => 40000001}),
    ?assertNotEqual(
        [],
        until(
            fun
                ({time, T}) -> T > 40000000;
                (_) -> false
            end,
            Socket,
            []
        )
    ).

%% The newer version of the protocol pauses a run, plays it at a speed, and takes it to another time; a
%% viewer that has asked for nothing of that gets no answers, and the older version has none of it.
controls_time(Config) ->
    Hub = ?config(hub, Config),
    Test = self(),
    Player = spawn_link(fun() ->
        {ok, #{sim := Sim}} = starl_lab_player:play(#{
            hub => Hub, scenario => #{app => painting, robots => 2, time => 60}, paused => true
        }),
        ok = starl_sim:close(Sim),
        Test ! {over, self()}
    end),
    ok = pages_know(Hub),
    {Socket, Info} = informed("foxglove.sdk.v1", Config),
    ?assertMatch(
        #{
            <<"capabilities">> := [<<"time">>, <<"playbackControl">>],
            <<"dataEndTime">> := #{<<"sec">> := 60, <<"nsec">> := 0}
        },
        Info
    ),
    {Old, #{<<"capabilities">> := [<<"time">>]}} = informed("foxglove.websocket.v1", Config),
    {Silent, _} = informed("foxglove.sdk.v1", Config),
    %% to another time, where it rests; then back, and on from there at ten times the speed
    ok = control(1, 1.0, 20000000000, <<"a">>, Socket),
    {_, At, _, 1, _} = playback(fun({_, _, _, _, Id}) -> Id =:= <<"a">> end, Socket),
    ?assert(abs(At - 20000000000) =< 20000000),
    ok = control(0, 10.0, none, <<"b">>, Socket),
    {playing, _, 10.0, 0, _} = playback(
        fun({P, _, S, _, _}) -> P =:= playing andalso S > 9 end, Socket
    ),
    Moved = fun
        ({time, T}) -> T > 20500000;
        (_) -> false
    end,
    _ = until(Moved, Socket, []),
    ok = control(1, 1.0, none, <<"c">>, Socket),
    {paused, Later, _, 0, _} = playback(fun({P, _, _, _, _}) -> P =:= paused end, Socket),
    ?assert(Later > 20000000000),
    ok = control(0, 10.0, 5000000000, <<"d">>, Socket),
    {playing, Back, _, 1, _} = playback(fun({_, _, _, _, Id}) -> Id =:= <<"d">> end, Socket),
    ?assert(Back >= 5000000000 andalso Back < 8000000000),
    %% bytes that are no request
    ok = bytes(<<3, 7, 0:32, 2, 0:64, 0:32>>, Socket),
    #{<<"op">> := <<"status">>, <<"level">> := 2} = status_of(Socket),
    ok = starl_lab_player:stop(Player),
    receive
        {over, Player} -> ok
    end,
    [?assertEqual([], played(Other)) || Other <- [Old, Silent]].

%% The run has begun when the feed knows its end.
pages_know(Hub) ->
    {ok, _, Place} = starl_view_hub:join(Hub),
    ok = starl_view_hub:want(Hub, Place),
    receive
        {frames, _, _} -> ok
    end.

informed(Version, Config) ->
    {101, Socket} = ?C:connect(?config(port, Config), "/", [{"Sec-WebSocket-Protocol", Version}]),
    {Socket, text(Socket)}.

control(Command, Speed, Seek, Id, Socket) ->
    {Seeks, Ns} =
        case Seek of
            none -> {0, 0};
            _ -> {1, Seek}
        end,
    Size = byte_size(Id),
    bytes(
        <<3, Command, Speed:32/float-little, Seeks, Ns:64/little, Size:32/little, Id/binary>>,
        Socket
    ).

bytes(Bytes, Socket) ->
    ?C:raw([<<1:1, 0:3, 2:4, 1:1, (byte_size(Bytes)):7, 0:32>>, Bytes], Socket).

playback(Is, Socket) ->
    case ?C:frame(Socket, ?PATIENCE_MS) of
        {2, <<5, Status, Ns:64/little, Speed:32/float-little, Did, N:32/little, Id:N/binary>>} ->
            #{Status := Word} = #{0 => playing, 1 => paused, 3 => ended},
            State = {Word, Ns, Speed, Did, Id},
            case Is(State) of
                true -> State;
                false -> playback(Is, Socket)
            end;
        {_, _} ->
            playback(Is, Socket)
    end.

status_of(Socket) ->
    case text(Socket) of
        #{<<"op">> := <<"status">>} = Status -> Status;
        _ -> status_of(Socket)
    end.

%% What a viewer has been told of the run's pace; all of it is there.
played(Socket) ->
    case ?C:frame(Socket, 0) of
        {2, <<5, _/binary>> = State} -> [State | played(Socket)];
        {error, _} -> [];
        {_, _} -> played(Socket)
    end.

%% The client of npm gets every frame and every line of ink.
the_official_client(Config) ->
    Dir = filename:join(starl_first_hour_ct:root(), ?NODE),
    Modules = filename:join(Dir, "node_modules/@foxglove/ws-protocol"),
    case {os:find_executable("node"), filelib:is_dir(Modules)} of
        {Node, true} when is_list(Node) -> official(Node, Dir, Config);
        _ -> {skip, "no node with @foxglove/ws-protocol in " ++ ?NODE}
    end.

official(Node, Dir, Config) ->
    Script = filename:join(?config(data_dir, Config), "client.mjs"),
    {At, Token} = ?config(port, Config),
    Url = "ws://127.0.0.1:" ++ integer_to_list(At) ++ "/?token=" ++ Token,
    Port = open_port({spawn_executable, Node}, [
        {args, [Script, Url, Dir]}, {line, 10000000}, binary, exit_status
    ]),
    [<<"info">>, <<"starl">>, [<<"time">>]] = line(Port),
    _ = lines(<<"ready">>, Port),
    ok = subscribed(11, Config),
    _ = ran(20, Config),
    Lines = until_time(20000000, Port, []),
    true = port_close(Port),
    Truth = truth(20),
    Frames = [
        {T, Frame}
     || [<<"message">>, <<"/tf">>, <<"foxglove.FrameTransforms">>, T, Json] <- Lines,
        Frame <- maps:get(<<"transforms">>, Json)
    ],
    ?assert(length(Frames) > 500),
    [?assert(is_true(T, Frame, Truth)) || {T, Frame} <- Frames],
    Scenes = [x || [<<"message">>, <<"/scene">>, <<"foxglove.SceneUpdate">>, _, _] <- Lines],
    ?assert(length(Scenes) > 1),
    ?assertEqual([], [Line || [<<"error">> | _] = Line <- Lines]).

%% The subscriptions are a viewer's own affair until they reach the feed.
subscribed(N, Config) ->
    {_, Feed} = feed(Config),
    case [x || V <- maps:values(viewers(sys:get_state(Feed))), length(element(4, V)) =:= N] of
        [_] -> ok;
        [] -> subscribed(N, Config)
    end.

viewers(Feed) -> hd([Map || Map <- tuple_to_list(Feed), is_map(Map)]).

line(Port) ->
    receive
        {Port, {data, {eol, Line}}} ->
            {ok, Words} = starl_json:decode(Line),
            Words
    after ?PATIENCE_MS -> error(silent)
    end.

lines(Kind, Port) ->
    case line(Port) of
        [Kind | _] = Line -> Line;
        _ -> lines(Kind, Port)
    end.

until_time(At, Port, Lines) ->
    case line(Port) of
        [<<"time">>, T] when T >= At -> Lines;
        Line -> until_time(At, Port, [Line | Lines])
    end.

%% -- runs -----------------------------------------------------------------------------------

scenario(Seconds) ->
    #{app => painting, picture => "house", robots => 3, seed => 1, time => Seconds}.

%% A painting that tells the hub; the time is told each second, as a player does.
ran(Seconds, Config) ->
    Hub = ?config(hub, Config),
    {ok, Sim} = starl_sim:start(scenario(Seconds), #{
        observe => starl_view_hub:observer(Hub, 0), packets => true
    }),
    _ = [
        begin
            _ = starl_sim:run(Sim, float(T)),
            ok = starl_view_hub:clock(Hub, #{now_us => T * 1000000})
        end
     || T <- lists:seq(1, Seconds)
    ],
    Done = starl_sim:finish(Sim),
    ok = starl_view_hub:clock(Hub, #{now_us => Seconds * 1000000}),
    Done.

%% The pieces of motion of the same run.
truth(Seconds) ->
    Self = self(),
    {ok, Sim} = starl_sim:start(scenario(Seconds), #{
        observe => fun(News) ->
            Self ! {news, News},
            ok
        end
    }),
    _ = starl_sim:run(Sim, float(Seconds)),
    _ = starl_sim:finish(Sim),
    pieces(#{}).

pieces(Known) ->
    receive
        {news, {judged, Events, _}} ->
            pieces(
                lists:foldl(
                    fun
                        ({_, Id, chassis, {motion, Piece}}, K) ->
                            K#{Id => [Piece | maps:get(Id, K, [])]};
                        (_, K) ->
                            K
                    end,
                    Known,
                    Events
                )
            );
        {news, _} ->
            pieces(Known)
    after 0 -> Known
    end.

position(T, Pieces) ->
    [Piece | _] = [P || P <- Pieces, starl_trajectory:start_us(P) =< T],
    starl_trajectory:position(T, Piece).

%% -- a client -------------------------------------------------------------------------------

viewer(Config) ->
    {101, Socket} = ?C:connect(?config(port, Config), "/", [
        {"Sec-WebSocket-Protocol", "foxglove.sdk.v1"}
    ]),
    #{<<"op">> := <<"serverInfo">>, <<"name">> := <<"starl">>} = text(Socket),
    #{<<"op">> := <<"advertise">>, <<"channels">> := Channels} = text(Socket),
    {Socket, maps:from_list([{Topic, C} || #{<<"topic">> := Topic} = C <- Channels])}.

subscribe(Pairs, Socket) ->
    ok = subscribes(Pairs, Socket),
    %% an unknown word is answered when the subscription is done
    ok = ?C:send("{\"op\":\"done\"}", Socket),
    answered(Socket).

subscribes(Pairs, Socket) ->
    List = [{[{id, Id}, {channelId, Channel}]} || {Id, Channel} <- Pairs],
    ?C:send(starl_json:encode({[{op, <<"subscribe">>}, {subscriptions, List}]}), Socket).

answered(Socket) ->
    case seen(Socket) of
        {text, #{<<"message">> := <<"done is not", _/binary>>}} -> ok;
        {text, #{<<"level">> := 0}} -> answered(Socket);
        {time, _} -> answered(Socket);
        {_, _, _} -> answered(Socket)
    end.

text(Socket) ->
    case seen(Socket) of
        {text, Text} -> Text;
        _ -> text(Socket)
    end.

seen(Socket) ->
    case ?C:frame(Socket, ?PATIENCE_MS) of
        {1, Text} ->
            {ok, Json} = starl_json:decode(Text),
            {text, Json};
        {2, <<1, Id:32/little, Ns:64/little, Text/binary>>} ->
            {ok, Json} = starl_json:decode(Text),
            {Id, Ns div 1000, Json};
        {2, <<2, Ns:64/little>>} ->
            {time, Ns div 1000};
        Other ->
            Other
    end.

%% All messages until one.
until(IsLast, Socket, Seen) ->
    Next = seen(Socket),
    case IsLast(Next) of
        true ->
            lists:reverse(Seen, [Next || tuple_size(Next) =:= 3 orelse element(1, Next) =:= text]);
        false when tuple_size(Next) =:= 3 -> until(IsLast, Socket, [Next | Seen]);
        false ->
            until(IsLast, Socket, Seen)
    end.

closed(Socket) ->
    case seen(Socket) of
        {8, _} = Close -> Close;
        {error, _} = Error -> Error;
        _ -> closed(Socket)
    end.

%% The feed, by the tap of its hub.
feed(Config) ->
    {links, Links} = erlang:process_info(self(), links),
    [Feed] = [
        Pid
     || Pid <- Links ++ element(2, erlang:process_info(?config(hub, Config), links)),
        is_pid(Pid),
        is_feed(Pid)
    ],
    {feed, Feed}.

is_feed(Pid) ->
    case erlang:process_info(Pid, dictionary) of
        {dictionary, Known} ->
            proplists:get_value('$initial_call', Known) =:= {starl_view_foxglove_feed, init, 1};
        undefined ->
            false
    end.
