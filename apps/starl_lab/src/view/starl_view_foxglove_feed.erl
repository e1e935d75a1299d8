%% @doc Sends the messages of a run ({@link starl_trace_foxglove}) to viewers that speak Foxglove's
%% protocol, each at its own pace.
%% ```
%%   starl_view_hub               feed                        starl_view_foxglove
%%      judged, clock ------------->|<------- join, channels -------|
%%                                  |<------- want -----------------|   when all is sent
%%                                  |-------- updates ------------->|
%% '''
%% The waiting data of a viewer are bounded. When too much waits, the viewer begins again with the
%% present state, and is notified of that. A viewer that comes late also gets all ink. Data without
%% a subscriber are not encoded, except ink.
-module(starl_view_foxglove_feed).
-behaviour(gen_server).

-export([start_link/1, news/2, fault/2, clock/2, join/1, channels/2, want/1, controls/3]).
-export([init/1, handle_call/3, handle_cast/2, handle_info/2]).

-export_type([message/0, session/0, update/0, joined/0]).

%% A session is a run: when it begins anew, that is another one.
-type session() :: binary().

%% A channel, its time, and its text.
-type update() :: {starl_trace_schema:channel(), AtUs :: integer(), Text :: binary()}.

%% To a viewer: a new run; or what happened, what was left out before, and the time now.
-type message() ::
    {session, session(), UntilUs :: non_neg_integer() | none}
    | {updates, [update()], Missed :: non_neg_integer(), NowUs :: integer()}
    | {playback, starl_view_foxglove_words:playback()}.

%% The session, whether a run goes on, and its end, if viewers may control its time.
-type joined() :: {ok, session(), HasRun :: boolean(), UntilUs :: non_neg_integer() | none} | full.

%% Millionths of a unit are enough for all that is shown.
-define(DECIMALS, 6).
-define(FRAMES_US, 50000).
-define(MOST_VIEWERS, 50).
-define(MOST_WAITING, 4 * 1024 * 1024).
-define(MOST_INK, 16 * 1024 * 1024).
-define(MOST_DRAWINGS, 2000).

-record(viewer, {
    monitor :: reference(),
    wants = false :: boolean(),
    channels = [] :: [starl_trace_schema:channel()],
    %% newest first, with their bytes
    waiting = [] :: [update()],
    bytes = 0 :: non_neg_integer(),
    missed = 0 :: non_neg_integer(),
    control = starl_view_foxglove_control:new() :: starl_view_foxglove_control:t(),
    %% the time that it was told last
    now = -1 :: integer()
}).

-record(feed, {
    session = name() :: session(),
    has_run = false :: boolean(),
    until = none :: non_neg_integer() | none,
    most :: pos_integer(),
    stream = starl_trace_stream:new() :: starl_trace_stream:t(),
    shown = starl_trace_foxglove:new(?FRAMES_US) :: starl_trace_foxglove:t(),
    packets_from = 0 :: integer(),
    now = 0 :: integer(),
    viewers = #{} :: #{pid() => #viewer{}},
    %% bodies and ink, newest first
    scene = [] :: [update()],
    ink = 0 :: non_neg_integer(),
    %% the latest of each key
    drawings = #{} :: #{
        {starl:robot_id(), starl_drawing:key()} =>
            {drawings, AtUs :: integer(), starl_json:value()}
    }
}).

%% @doc Starts a feed; `most_waiting': bytes for one viewer.
-spec start_link(#{most_waiting => pos_integer()}) -> gen_server:start_ret().
start_link(Config) -> gen_server:start_link(?MODULE, Config, []).

%% @doc Tells news of the run.
-spec news(pid(), starl_observer:news()) -> ok.
news(Feed, News) -> gen_server:cast(Feed, {news, News}).

%% @doc Reports a manual fault in a simulation, with its end, or the new end of a known fault.
-spec fault(pid(), {new | known, starl_run_fault:t()}) -> ok.
fault(Feed, {new, {_, FromMs, _, _, _, _} = Fault}) ->
    ok = news(Feed, {fault, 1000 * FromMs, {began, Fault}}),
    fault(Feed, {known, Fault});
fault(Feed, {known, {_, _, ToMs, _, _, _} = Fault}) ->
    news(Feed, {fault, 1000 * ToMs, {ended, Fault}}).

%% @doc Tells the time of the run, when the news before it are handled.
-spec clock(pid(), #{now_us := integer(), atom() => term()}) -> ok.
clock(Feed, Clock) -> gen_server:call(Feed, {clock, Clock}, infinity).

%% @doc Lets the viewer control the time of the run, by this request: from now on it is notified of
%% the progress.
-spec controls(pid(), Id :: binary(), SeekUs :: integer() | none) -> ok.
controls(Feed, Id, Seek) -> gen_server:cast(Feed, {controls, self(), Id, Seek}).

%% @doc The calling process is a viewer.
-spec join(pid()) -> joined().
join(Feed) -> gen_server:call(Feed, join).

%% @doc The channels that the viewer has subscribed to; of those that are new it gets the state.
-spec channels(pid(), [starl_trace_schema:channel()]) -> ok.
channels(Feed, Channels) -> gen_server:cast(Feed, {channels, self(), Channels}).

%% @doc The viewer can take more: it gets one {@link message()}, as soon as there is something.
-spec want(pid()) -> ok.
want(Feed) -> gen_server:cast(Feed, {want, self()}).

-spec init(map()) -> {ok, #feed{}}.
init(Config) -> {ok, #feed{most = maps:get(most_waiting, Config, ?MOST_WAITING)}}.

-spec handle_call({clock, map()} | join, gen_server:from(), #feed{}) ->
    {reply, term(), #feed{}}.
handle_call({clock, #{now_us := Now} = Clock}, _From, Feed) ->
    {reply, ok, played(Clock, served(packets(Feed#feed{now = Now})))};
handle_call(join, _From, #feed{viewers = Viewers} = Feed) when map_size(Viewers) >= ?MOST_VIEWERS ->
    {reply, full, Feed};
handle_call(join, {Pid, _}, #feed{viewers = Viewers} = Feed) ->
    #feed{session = Session, has_run = HasRun, until = Until} = Feed,
    Viewer = #viewer{monitor = erlang:monitor(process, Pid)},
    {reply, {ok, Session, HasRun, Until}, Feed#feed{viewers = Viewers#{Pid => Viewer}}}.

-spec handle_cast(term(), #feed{}) -> {noreply, #feed{}}.
handle_cast({news, {begun, Facts} = News}, Feed) ->
    {noreply, told(News, begun(until(Facts), Feed))};
handle_cast({news, News}, Feed) ->
    {noreply, told(News, Feed)};
handle_cast({want, Pid}, Feed) ->
    {noreply, viewer(Pid, fun(V) -> serve(Pid, Feed, V#viewer{wants = true}) end, Feed)};
handle_cast({controls, Pid, Id, Seek}, Feed) ->
    Asked = fun(#viewer{control = Control} = Viewer) ->
        Viewer#viewer{control = starl_view_foxglove_control:asked(Id, Seek, Control)}
    end,
    {noreply, viewer(Pid, Asked, Feed)};
handle_cast({channels, Pid, Channels}, Feed) ->
    {noreply, viewer(Pid, fun(V) -> subscribed(Pid, Channels, Feed, V) end, Feed)}.

-spec handle_info(term(), #feed{}) -> {noreply, #feed{}}.
handle_info({'DOWN', _, process, Pid, _}, #feed{viewers = Viewers} = Feed) ->
    {noreply, Feed#feed{viewers = maps:remove(Pid, Viewers)}};
handle_info(_, Feed) ->
    {noreply, Feed}.

viewer(Pid, Do, #feed{viewers = Viewers} = Feed) ->
    case Viewers of
        #{Pid := Viewer} -> Feed#feed{viewers = Viewers#{Pid := Do(Viewer)}};
        #{} -> Feed
    end.

%% Real time cannot be controlled.
until(#{kind := simulation, scenario := #{time := Seconds}}) -> round(Seconds * 1.0e6);
until(_) -> none.

%% Another run: viewers forget the one before.
begun(Until, #feed{has_run = false} = Feed) ->
    Feed#feed{has_run = true, until = Until};
begun(Until, #feed{viewers = Viewers, most = Most}) ->
    Session = name(),
    _ = [Pid ! {session, Session, Until} || Pid <- maps:keys(Viewers)],
    New = maps:map(fun(_, Viewer) -> anew(Viewer) end, Viewers),
    #feed{session = Session, has_run = true, until = Until, most = Most, viewers = New}.

anew(#viewer{monitor = Monitor, control = Control}) ->
    #viewer{monitor = Monitor, control = Control}.

%% Viewers that control time are told how it goes.
played(Clock, #feed{viewers = Viewers} = Feed) ->
    Feed#feed{viewers = maps:map(fun(Pid, V) -> played(Pid, Clock, V) end, Viewers)}.

played(Pid, Clock, #viewer{control = Control} = Viewer) ->
    {Told, Next} = starl_view_foxglove_control:clock(Clock, Control),
    _ = Told =/= none andalso (Pid ! {playback, Told}),
    Viewer#viewer{control = Next}.

name() -> binary:encode_hex(crypto:strong_rand_bytes(8)).

%% -- what happens ---------------------------------------------------------------------------

told(News, #feed{stream = Stream} = Feed) ->
    {Messages, Next} = starl_trace_stream:news(News, Stream),
    Wanted = lists:usort(
        lists:append([V#viewer.channels || V <- maps:values(Feed#feed.viewers)])
    ),
    Shown = [Message || Message <- Messages, has(channel(Message), [scene | Wanted])],
    lists:foldl(fun message/2, Feed#feed{stream = Next}, Shown).

%% The only channel of frequent messages; what is rare is always looked at.
channel({poses, _, _}) -> tf;
channel({packets, _, _}) -> packets;
channel({trace, _, {_, app, {measure, _, _}}}) -> measures;
channel({trace, _, {_, app, {draw, _}}}) -> scene;
channel({trace, _, {_, Machine, _}}) when Machine =/= chassis -> trace;
channel(_) -> scene.

message(Message, #feed{shown = Shown} = Feed) ->
    {Updates, Next} = starl_trace_foxglove:message(Message, Shown),
    lists:foldl(fun update/2, drawn(Message, Updates, Feed#feed{shown = Next}), Updates).

%% Who comes later gets the latest drawing of each key.
drawn({trace, _, {Robot, app, {draw, #{key := Key}}}}, [{drawings, At, Json}], Feed) ->
    #feed{drawings = Drawings} = Feed,
    case map_size(Drawings) < ?MOST_DRAWINGS orelse is_map_key({Robot, Key}, Drawings) of
        true -> Feed#feed{drawings = Drawings#{{Robot, Key} => {drawings, At, Json}}};
        false -> Feed
    end;
drawn(_Message, _Updates, Feed) ->
    Feed.

packets(#feed{shown = Shown, packets_from = From, now = Now} = Feed) ->
    {Updates, Next} = starl_trace_foxglove:packets(From, Now, Shown),
    lists:foldl(fun update/2, Feed#feed{shown = Next, packets_from = Now}, Updates).

update({scene, At, Json}, Feed) ->
    Update = {scene, At, text(Json)},
    given(Update, inked(Update, Feed));
update({Channel, At, Json}, #feed{viewers = Viewers} = Feed) ->
    case lists:any(fun(V) -> lists:member(Channel, V#viewer.channels) end, maps:values(Viewers)) of
        true -> given({Channel, At, text(Json)}, Feed);
        false -> Feed
    end.

inked({_, _, Text} = Update, #feed{scene = Scene, ink = Ink} = Feed) when Ink < ?MOST_INK ->
    Feed#feed{scene = [Update | Scene], ink = Ink + byte_size(Text)};
inked(_Update, Feed) ->
    Feed.

text(Json) -> iolist_to_binary(starl_json:encode(Json, ?DECIMALS)).

given(Update, #feed{viewers = Viewers, most = Most} = Feed) ->
    Feed#feed{viewers = maps:map(fun(_, V) -> given(Update, Most, V) end, Viewers)}.

given({Channel, _, Text} = Update, Most, #viewer{channels = Channels, bytes = Bytes} = Viewer) ->
    case lists:member(Channel, Channels) of
        false -> Viewer;
        true when Viewer#viewer.missed > 0 -> Viewer#viewer{missed = Viewer#viewer.missed + 1};
        true when Bytes > Most -> overrun(Viewer);
        true -> waits([Update], byte_size(Text), Viewer)
    end.

%% What waited is gone; the state of now comes instead, when the viewer reads again.
overrun(#viewer{waiting = Waiting} = Viewer) ->
    Viewer#viewer{waiting = [], bytes = 0, missed = 1 + length(Waiting)}.

waits(Updates, Size, #viewer{waiting = Waiting, bytes = Bytes} = Viewer) ->
    Viewer#viewer{waiting = Updates ++ Waiting, bytes = Bytes + Size}.

%% -- viewers --------------------------------------------------------------------------------

subscribed(Pid, Channels, Feed, #viewer{channels = Before, missed = Missed} = Viewer) ->
    Subscribed = Viewer#viewer{channels = Channels},
    case Missed of
        0 ->
            State = state(Channels -- Before, Feed),
            serve(Pid, Feed, waits(lists:reverse(State), size_of(State), Subscribed));
        _ ->
            Subscribed
    end.

size_of(Updates) -> lists:sum([byte_size(Text) || {_, _, Text} <- Updates]).

%% What a viewer must know of these channels to begin with.
state(Channels, #feed{scene = Scene, drawings = Drawings} = Feed) ->
    lists:append([
        [
            {drawings, At, text(Json)}
         || has(drawings, Channels), {_, At, Json} <- lists:keysort(2, maps:values(Drawings))
        ],
        [{scenario, At, text(Json)} || {scenario, At, Json} <- now(Feed), has(scenario, Channels)],
        [{tf, At, text(Json)} || {tf, At, Json} <- now(Feed), has(tf, Channels)],
        [Update || has(scene, Channels), Update <- lists:reverse(Scene)]
    ]).

has(Channel, Channels) -> lists:member(Channel, Channels).

now(#feed{stream = Stream}) ->
    New = starl_trace_foxglove:new(?FRAMES_US),
    lists:append([
        element(1, starl_trace_foxglove:message(Message, New))
     || Message <- starl_trace_stream:state(Stream)
    ]).

served(#feed{viewers = Viewers} = Feed) ->
    Feed#feed{viewers = maps:map(fun(Pid, V) -> serve(Pid, Feed, V) end, Viewers)}.

serve(_Pid, _Feed, #viewer{wants = false} = Viewer) ->
    Viewer;
serve(Pid, #feed{now = Now} = Feed, #viewer{missed = Missed, channels = Channels} = Viewer) when
    Missed > 0
->
    Pid ! {updates, state(Channels, Feed), Missed, Now},
    Viewer#viewer{wants = false, missed = 0, now = Now};
serve(_Pid, #feed{now = Now}, #viewer{waiting = [], now = Now} = Viewer) ->
    Viewer;
serve(Pid, #feed{now = Now}, #viewer{waiting = Waiting} = Viewer) ->
    Pid ! {updates, lists:reverse(Waiting), 0, Now},
    Viewer#viewer{wants = false, waiting = [], bytes = 0, now = Now}.
