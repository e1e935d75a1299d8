%% @doc The WebSocket of a viewer that speaks Foxglove's protocol: Foxglove, Lichtblick. It shows a
%% run, but cannot apply faults. It asks its feed for more when all has been sent, so a viewer that
%% reads nothing gets nothing more.
-module(starl_view_foxglove).
-behaviour(cowboy_websocket).

-export([init/2, upgrade/4, websocket_init/1, websocket_handle/2, websocket_info/2]).

-define(W, starl_view_foxglove_words).
-define(MOST_BYTES, 65536).
-define(MOST_SUBSCRIPTIONS, 1000).

-record(viewer, {
    hub :: pid(),
    feed :: pid(),
    door :: pid(),
    %% the newer version of the protocol has control of time
    version :: binary(),
    subscriptions = #{} :: #{non_neg_integer() => starl_trace_schema:channel()},
    credit = starl_view_credit:new(unlimited) :: starl_view_credit:t()
}).

-spec init(cowboy_req:req(), map()) ->
    {cowboy_websocket, cowboy_req:req(), #viewer{}, cowboy_websocket:opts()}
    | {ok, cowboy_req:req(), map()}.
init(Request, #{hub := Hub, feed := Feed, door := Door, guard := Guard} = State) ->
    Offered = cowboy_req:parse_header(<<"sec-websocket-protocol">>, Request, []),
    case {starl_view_guard:viewer(starl_view_guard:asked(Request), Guard), ?W:chosen(Offered)} of
        {false, _} ->
            Text = <<"this viewer may not look: see the page on viewers\n">>,
            {ok, cowboy_req:reply(403, #{}, Text, Request), State};
        {true, none} ->
            Text = <<"foxglove.sdk.v1 and foxglove.websocket.v1 are spoken here\n">>,
            {ok, cowboy_req:reply(400, #{}, Text, Request), State};
        {true, {ok, Version}} ->
            Chosen = cowboy_req:set_resp_header(<<"sec-websocket-protocol">>, Version, Request),
            %% viewers ping rarely
            Options = #{max_frame_size => ?MOST_BYTES, idle_timeout => infinity},
            Viewer = #viewer{hub = Hub, feed = Feed, door = Door, version = Version},
            {cowboy_websocket, Chosen, Viewer, Options}
    end.

%% @doc Takes over a request that another handler has got: viewers know no path.
-spec upgrade(cowboy_req:req(), cowboy_middleware:env(), module(), map()) ->
    {ok, cowboy_req:req(), cowboy_middleware:env()}.
upgrade(Request, Env, _Handler, State) ->
    case init(Request, State) of
        {cowboy_websocket, Chosen, Viewer, Options} ->
            cowboy_websocket:upgrade(Chosen, Env, ?MODULE, Viewer, Options);
        {ok, Answered, _} ->
            {ok, Answered, Env}
    end.

%% What to send to the viewer.
-type answer() :: {[cow_ws:frame()], #viewer{}}.

-spec websocket_init(#viewer{}) -> answer().
websocket_init(#viewer{feed = Feed, hub = Hub, door = Door} = Viewer) ->
    ok = starl_view_door:knows(Door),
    %% a viewer looks, as a page does; it asks the hub for nothing
    _ = starl_view_hub:join(Hub),
    case starl_view_foxglove_feed:join(Feed) of
        {ok, Session, HasRun, Until} ->
            {offer(Session, Until, Viewer) ++ hint(HasRun), ask(Viewer)};
        full ->
            {[{close, 1013, <<"too many viewers">>}], Viewer}
    end.

hint(true) ->
    [];
hint(false) ->
    Text = "no run goes on yet; a recording is a file, run.mcap, which this viewer opens itself",
    [{text, ?W:status(info, Text)}].

offer(Session, Until, #viewer{version = <<"foxglove.sdk.v1">>}) ->
    [{text, ?W:server_info(Session, Until)}, {text, ?W:advertise()}];
offer(Session, _Until, _Viewer) ->
    [{text, ?W:server_info(Session, none)}, {text, ?W:advertise()}].

-spec websocket_handle(cow_ws:frame() | term(), #viewer{}) ->
    answer().
websocket_handle({text, Text}, Viewer) ->
    command(?W:command(Text), Viewer);
websocket_handle({binary, Bytes}, #viewer{version = <<"foxglove.sdk.v1">>} = Viewer) ->
    controlled(?W:control(Bytes), Viewer);
websocket_handle({binary, _}, Viewer) ->
    bad("nothing is taken from viewers here", Viewer);
websocket_handle(_PingOrPong, Viewer) ->
    {[], Viewer}.

command({subscribe, New, Bad}, #viewer{subscriptions = Known} = Viewer) ->
    {Own, Taken} = lists:partition(fun({Id, _}) -> not is_map_key(Id, Known) end, New),
    All = maps:merge(Known, maps:from_list(Own)),
    case map_size(All) > ?MOST_SUBSCRIPTIONS of
        true -> bad("too many subscriptions", Viewer);
        false -> refused(Bad ++ [Id || {Id, _} <- Taken], changed(All, Viewer))
    end;
command({unsubscribe, Ids, Bad}, #viewer{subscriptions = Known} = Viewer) ->
    Unknown = [Id || Id <- Ids, not is_map_key(Id, Known)],
    refused(Bad ++ Unknown, changed(maps:without(Ids, Known), Viewer));
command({other, Op}, Viewer) ->
    bad([string:slice(Op, 0, 40), " is not offered here"], Viewer);
command(garbage, Viewer) ->
    bad("this is no message of the protocol", Viewer).

controlled(garbage, Viewer) ->
    bad("of bytes only the control of time is taken here", Viewer);
controlled({ok, #{seek := Seek, id := Id} = Control}, #viewer{credit = Credit} = Viewer) ->
    case starl_view_credit:command(erlang:monotonic_time(second), Credit) of
        {ok, Next} ->
            #viewer{hub = Hub, feed = Feed} = Viewer,
            ok = starl_view_hub:command(Hub, order(Control)),
            ok = starl_view_foxglove_feed:controls(Feed, Id, Seek),
            {[], Viewer#viewer{credit = Next}};
        too_many ->
            bad("too many requests", Viewer)
    end.

%% As a page would say it.
order(#{seek := none, play := true, speed := Speed}) ->
    #{<<"do">> => <<"go">>, <<"speed">> => Speed};
order(#{seek := none, play := false}) ->
    #{<<"do">> => <<"pause">>};
order(#{seek := Us, play := Play}) ->
    #{<<"do">> => <<"until">>, <<"at">> => Us / 1.0e6, <<"go">> => Play}.

changed(All, #viewer{feed = Feed} = Viewer) ->
    ok = starl_view_foxglove_feed:channels(Feed, lists:usort(maps:values(All))),
    Viewer#viewer{subscriptions = All}.

refused([], Viewer) -> {[], Viewer};
refused(Bad, Viewer) -> bad(io_lib:format("not understood: ~0tP", [Bad, 20]), Viewer).

bad(Text, #viewer{credit = Credit} = Viewer) ->
    case starl_view_credit:mistake(Credit) of
        {ok, Next} -> {[{text, ?W:status(error, Text)}], Viewer#viewer{credit = Next}};
        shut_out -> {[{close, 1008, <<"too many mistakes">>}], Viewer}
    end.

-spec websocket_info(starl_view_foxglove_feed:message() | term(), #viewer{}) ->
    answer().
websocket_info({playback, Playback}, Viewer) ->
    {[{binary, ?W:playback(Playback)}], Viewer};
websocket_info({session, Session, Until}, Viewer) ->
    Anew = answered(Viewer#viewer{subscriptions = #{}}),
    {[{text, ?W:unadvertise()} | offer(Session, Until, Viewer)], Anew};
websocket_info({updates, Updates, Missed, Now}, Viewer) ->
    Messages = lists:flatmap(fun(Update) -> messages(Update, Viewer) end, Updates),
    {missed(Missed) ++ Messages ++ [{binary, ?W:time(Now)}], answered(Viewer)};
websocket_info(_, Viewer) ->
    {[], Viewer}.

answered(#viewer{credit = Credit} = Viewer) ->
    ask(Viewer#viewer{credit = starl_view_credit:answered(Credit)}).

ask(#viewer{credit = Credit, feed = Feed} = Viewer) ->
    {May, Next} = starl_view_credit:may_ask(Credit),
    _ = May andalso starl_view_foxglove_feed:want(Feed),
    Viewer#viewer{credit = Next}.

messages({Channel, At, Text}, #viewer{subscriptions = Subscriptions}) ->
    [
        {binary, ?W:message(Id, At, Text)}
     || {Id, Subscribed} <- lists:sort(maps:to_list(Subscriptions)), Subscribed =:= Channel
    ].

missed(0) ->
    [];
missed(Missed) ->
    Text = io_lib:format("Send buffer limit reached: ~b messages left out", [Missed]),
    [{text, ?W:status(warning, Text)}].
