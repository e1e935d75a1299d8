%% @doc Distributes the rows of a run ({@link starl_view_row}) to all pages. The run reports its
%% events and its time. Each page asks for more when it has handled what it got, so a page that
%% reads slowly, or not at all, costs nothing and holds up nobody.
%% ```
%%   run:    observer/2, put/2 -------> hub                         page's socket
%%           clock/2 ---------------->  | a frame of rows, kept       |
%%                                      |<------ want, Place ---------|   one question at a time
%%                                      |------- frames, Place' ----->|
%%           player <--- command -------|<------ command -------------|
%% '''
%% The frames are kept up to a limit of bytes. A page that has missed some of them, because it came
%% late or was slow, gets the state of the team instead ({@link starl_view_state}) and is notified
%% of that.
-module(starl_view_hub).
-behaviour(gen_server).

-export([
    start_link/1,
    tap/2,
    observer/2,
    head/2,
    put/2,
    fault/3,
    clock/2,
    reset/1,
    lead/2,
    pages/1,
    first_page/1,
    is_attended/1,
    flush/1,
    events/2
]).
-export([join/1, want/2, command/2, asker/2, tell/2, say/3]).
-export([init/1, handle_call/3, handle_cast/2, handle_info/2]).

-export_type([place/0, frames/0, command/0, asker/0]).

%% How far a page has come: the number of its last frame, and of the clock that it was told last.
-type place() :: {Frame :: non_neg_integer(), Clock :: non_neg_integer()}.

%% Rows, separated by commas, and the place after them.
-type frames() :: {frames, iodata(), place()}.

%% What somebody at a page wants, with the page that gets an answer.
-type command() :: {starl_view, Page :: pid(), #{binary() => term()}}.

%% Who gets the answer to a command: a page, and the part of it that has asked, as the command's `of' names
%% it. A command of the program itself has nobody.
-type asker() :: none | {Page :: pid(), Of :: [binary()]}.

-define(MOST_BYTES, 48 * 1024 * 1024).
-define(MOST_PAGES, 200).
%% A page that is loaded anew is away for a moment: so long somebody is still taken to look.
-define(GRACE_MS, 10000).
%% The last events of each robot are kept; of a large team fewer.
-define(EVENTS, 40).
-define(MOST_EVENTS, 20000).
%% The number of rows about messages in a frame, of a team in which everybody talks.
-define(MOST_TALK, 400).

%% What an observer is told, and the pages with it.
-define(IS_NEWS(News),
    (element(1, News) =:= begun orelse element(1, News) =:= judged orelse
        element(1, News) =:= ended orelse element(1, News) =:= fault orelse
        element(1, News) =:= unjudged)
).

-record(hub, {
    frames :: starl_view_frames:t(),
    head = [] :: iodata(),
    %% the rows since the last frame, newest first; how many are about messages, or were left out
    rows = [] :: [starl_view_row:row()],
    talk = 0 :: non_neg_integer(),
    left_out = 0 :: non_neg_integer(),
    state = starl_view_state:new() :: starl_view_state:t(),
    now = 0 :: integer(),
    clock = {0, []} :: {non_neg_integer(), iodata()},
    events = #{} :: #{starl:robot_id() => {non_neg_integer(), [tuple()]}},
    kept_events = ?EVENTS :: pos_integer(),
    %% pages, those of them that wait at a place, and the player
    pages = #{} :: #{pid() => reference()},
    waiting = #{} :: #{pid() => place()},
    %% who waits for the first page, and when the last one has left
    early = [] :: [pid()],
    grace_ms :: non_neg_integer(),
    left = never :: never | integer(),
    leader = none :: pid() | none,
    %% of viewers that speak another protocol
    tap = none :: pid() | none
}).

%% @doc Starts a hub; `most_bytes': of the rows that are kept for pages that come later; `grace_ms': see
%% {@link is_attended/1}.
-spec start_link(#{most_bytes => pos_integer(), grace_ms => non_neg_integer()}) ->
    gen_server:start_ret().
start_link(Config) -> gen_server:start_link(?MODULE, Config, []).

%% @doc The feed of viewers that speak Foxglove's protocol gets the news, too.
-spec tap(pid(), Feed :: pid()) -> ok.
tap(Hub, Feed) -> gen_server:call(Hub, {tap, Feed}).

%% @doc The observer of a run, which reports everything to the hub from a time on.
-spec observer(pid(), FromUs :: integer()) -> starl_observer:t().
observer(Hub, FromUs) -> fun(News) -> observed(News, FromUs, Hub) end.

observed({judged, Events, Violations}, FromUs, Hub) ->
    case [Event || Event <- Events, element(1, Event) >= FromUs] of
        [] -> ok;
        New -> told(New, Violations, Hub)
    end;
observed({begun, _}, FromUs, _Hub) when FromUs > 0 ->
    %% the same run goes on
    ok;
observed(BegunOrEnded, _FromUs, Hub) ->
    Hub ! BegunOrEnded,
    ok.

told(Events, Violations, Hub) ->
    Hub ! {judged, Events, Violations},
    ok.

%% @doc The first rows for every page: the facts of the run; and the number of its robots.
-spec head(pid(), {[starl_view_row:row()], Robots :: pos_integer()}) -> ok.
head(Hub, Head) -> gen_server:call(Hub, {head, Head}).

%% @doc Tells a row to all.
-spec put(pid(), starl_view_row:row()) -> ok.
put(Hub, Row) -> gen_server:cast(Hub, {put, Row}).

%% @doc Reports a manual fault to all: a new one, or a known one that now ends at another time.
-spec fault(pid(), NowUs :: integer(), {new | known, starl_run_fault:t()}) -> ok.
fault(Hub, Now, Fault) -> gen_server:cast(Hub, {fault, Now, Fault}).

%% @doc Reports the time of the run: everything until now has been reported. Returns when all
%% reports are handled, so the run is never ahead of the hub.
-spec clock(pid(), #{now_us := integer(), atom() => term()}) -> ok.
clock(Hub, Clock) -> gen_server:call(Hub, {clock, Clock}, infinity).

%% @doc Drops everything but the head, because the run restarts.
-spec reset(pid()) -> ok.
reset(Hub) -> gen_server:call(Hub, reset).

%% @doc From now on this process gets the pages' commands ({@link command()}).
-spec lead(pid(), pid() | none) -> ok.
lead(Hub, Player) -> gen_server:call(Hub, {lead, Player}).

%% @doc The number of pages.
-spec pages(pid()) -> non_neg_integer().
pages(Hub) -> gen_server:call(Hub, pages).

%% @doc Sends the calling process `{first_page, Hub}' as soon as there is a page.
-spec first_page(pid()) -> ok.
first_page(Hub) -> gen_server:call(Hub, first_page).

%% @doc Checks whether anybody watches. A page that has just closed may be reloading, so the answer
%% is yes for some seconds more.
-spec is_attended(pid()) -> boolean().
is_attended(Hub) -> gen_server:call(Hub, is_attended).

%% @doc Waits until the hub has handled all reports.
-spec flush(pid()) -> ok.
flush(Hub) -> gen_server:call(Hub, flush, infinity).

%% @doc The last events of a robot, newest first.
-spec events(pid(), starl:robot_id()) -> [{integer(), starl_machine:name(), Event :: term()}].
events(Hub, Robot) -> gen_server:call(Hub, {events, Robot}).

%% @doc The calling process is a page; gives its place and the rows to begin with.
-spec join(pid()) -> {ok, iodata(), place()} | full.
join(Hub) -> gen_server:call(Hub, join).

%% @doc Asks for the rows after a place; the answer is {@link frames()}, as soon as there is one.
-spec want(pid(), place()) -> ok.
want(Hub, Place) -> gen_server:cast(Hub, {want, self(), Place}).

%% @doc Passes on a command of the page.
-spec command(pid(), #{binary() => term()}) -> ok.
command(Hub, Command) -> gen_server:cast(Hub, {command, self(), Command}).

%% @doc The sender of a command.
-spec asker(Page :: pid() | none, #{binary() => term()}) -> asker().
asker(none, _Command) -> none;
asker(Page, #{<<"of">> := Of}) when is_binary(Of) -> {Page, [Of]};
asker(Page, _Command) -> {Page, []}.

%% @doc Tells a row to the page that has asked, and to no other.
-spec tell(asker(), starl_view_row:row()) -> ok.
tell(none, _Row) ->
    ok;
tell({Page, _Of}, Row) ->
    Page ! {tell, Row},
    ok.

%% @doc Answers a command with words.
-spec say(asker(), yes | no, unicode:chardata()) -> ok.
say(none, _YesOrNo, _Text) ->
    ok;
say({_, Of} = Asker, YesOrNo, Text) ->
    tell(Asker, [atom_to_binary(YesOrNo), unicode:characters_to_binary(Text) | Of]).

-spec init(map()) -> {ok, #hub{}}.
init(Config) ->
    {ok, #hub{
        frames = starl_view_frames:new(maps:get(most_bytes, Config, ?MOST_BYTES)),
        grace_ms = maps:get(grace_ms, Config, ?GRACE_MS)
    }}.

-spec handle_call(term(), gen_server:from(), #hub{}) -> {reply, term(), #hub{}}.
handle_call({clock, Clock}, _From, Hub) ->
    {reply, ok, timed(Clock, Hub)};
handle_call({tap, Feed}, _From, Hub) ->
    {reply, ok, Hub#hub{tap = Feed}};
handle_call({head, {Rows, Robots}}, _From, Hub) ->
    {reply, ok, headed(Rows, Robots, Hub)};
handle_call(reset, _From, #hub{frames = Frames} = Hub) ->
    {reply, ok, Hub#hub{
        frames = starl_view_frames:clear(Frames),
        rows = [[<<"reset">>]],
        talk = 0,
        state = starl_view_state:new(),
        events = #{}
    }};
handle_call({lead, Player}, _From, Hub) ->
    {reply, ok, Hub#hub{leader = Player}};
handle_call(pages, _From, #hub{pages = Pages} = Hub) ->
    {reply, map_size(Pages), Hub};
handle_call(first_page, {Early, _}, #hub{pages = Pages, early = Others} = Hub) ->
    {reply, ok, greeted(map_size(Pages), Hub#hub{early = [Early | Others]})};
handle_call(is_attended, _From, Hub) ->
    {reply, attended(erlang:monotonic_time(millisecond), Hub), Hub};
handle_call(flush, _From, Hub) ->
    {reply, ok, Hub};
handle_call({events, Robot}, _From, #hub{events = Events} = Hub) ->
    {_, Last} = maps:get(Robot, Events, {0, []}),
    {reply, Last, Hub};
handle_call(join, {Page, _}, Hub) ->
    joined(Page, Hub).

timed(#{now_us := Now} = Clock, #hub{clock = {N, _}} = Hub) ->
    Row = starl_json:encode([<<"t">>, Now, maps:remove(now_us, Clock)]),
    Timed = framed(Hub#hub{now = Now, clock = {N + 1, Row}}),
    ok = tapped(fun(Feed) -> starl_view_foxglove_feed:clock(Feed, Clock) end, Hub),
    serve(Timed).

headed(Rows, Robots, #hub{head = Before, pages = Pages} = Hub) ->
    Kept = max(3, min(?EVENTS, ?MOST_EVENTS div Robots)),
    %% a page may be there before the run is
    Early = [Row || Before =:= [], map_size(Pages) > 0, Row <- Rows],
    rows(Early, Hub#hub{head = json(Rows), kept_events = Kept}).

joined(_Page, #hub{pages = Pages} = Hub) when map_size(Pages) >= ?MOST_PAGES ->
    {reply, full, Hub};
joined(Page, #hub{pages = Pages, head = Head} = Hub) ->
    Joined = Hub#hub{pages = Pages#{Page => erlang:monitor(process, Page)}},
    {reply, {ok, Head, {0, 0}}, greeted(1, Joined)}.

greeted(0, Hub) ->
    Hub;
greeted(_Pages, #hub{early = Early} = Hub) ->
    _ = [Pid ! {first_page, self()} || Pid <- Early],
    Hub#hub{early = []}.

attended(_Now, #hub{pages = Pages}) when map_size(Pages) > 0 -> true;
attended(_Now, #hub{left = never}) -> false;
attended(Now, #hub{left = Left, grace_ms = Grace}) -> Now - Left < Grace.

-spec handle_cast(term(), #hub{}) -> {noreply, #hub{}}.
handle_cast({put, Row}, Hub) ->
    {noreply, add(Row, Hub)};
handle_cast({fault, Now, {Is, Fault}}, Hub) ->
    ok = tapped(fun(Feed) -> starl_view_foxglove_feed:fault(Feed, {Is, Fault}) end, Hub),
    {noreply, add(starl_view_row:fault(Now, Fault), Hub)};
handle_cast({want, Page, Place}, #hub{waiting = Waiting} = Hub) ->
    {noreply, answer(Page, Place, Hub#hub{waiting = maps:remove(Page, Waiting)})};
handle_cast({command, _Page, _Command}, #hub{leader = none} = Hub) ->
    {noreply, Hub};
handle_cast({command, Page, Command}, #hub{leader = Leader} = Hub) ->
    Leader ! {starl_view, Page, Command},
    {noreply, Hub}.

-spec handle_info(term(), #hub{}) -> {noreply, #hub{}}.
handle_info({'DOWN', _, process, Page, _}, #hub{pages = Pages, waiting = Waiting} = Hub) ->
    {noreply, Hub#hub{
        pages = maps:remove(Page, Pages),
        waiting = maps:remove(Page, Waiting),
        left = erlang:monotonic_time(millisecond)
    }};
handle_info({starl_trace, _, Messages}, Hub) ->
    {noreply, lists:foldl(fun told/2, Hub, Messages)};
handle_info(News, Hub) when ?IS_NEWS(News) ->
    ok = tapped(fun(Feed) -> starl_view_foxglove_feed:news(Feed, News) end, Hub),
    {noreply, news(News, Hub)};
handle_info(_, Hub) ->
    {noreply, Hub}.

news({begun, _}, Hub) ->
    Hub;
news({judged, Events, Violations}, Hub) ->
    Told = lists:foldl(fun traced/2, Hub, Events),
    rows([starl_view_row:violation(V) || V <- Violations], Told);
news({ended, #{end_us := End} = Ending}, Hub) ->
    told({verdicts, End, {ended, Ending}}, Hub);
news({fault, At, What}, Hub) ->
    told({faults, At, What}, Hub);
news({unjudged, At, Why}, Hub) ->
    told({gap, At, Why}, Hub).

tapped(_Tell, #hub{tap = none}) -> ok;
tapped(Tell, #hub{tap = Feed}) -> Tell(Feed).

traced({T, Robot, Machine, Event}, Hub) -> told({trace, T, {Robot, Machine, Event}}, Hub).

told({trace, T, {Robot, Machine, Event}} = Message, Hub) ->
    rows(starl_view_row:of_message(Message), remember(Robot, {T, Machine, Event}, Hub));
told(Message, Hub) ->
    rows(starl_view_row:of_message(Message), Hub).

rows(Rows, Hub) -> lists:foldl(fun add/2, Hub, Rows).

%% Rows about messages only show traffic: where everybody talks, a part of them does.
add([Kind | _], #hub{talk = Talk, left_out = Out} = Hub) when
    Talk >= ?MOST_TALK, Kind =:= <<"s">>;
    Talk >= ?MOST_TALK, Kind =:= <<"d">>;
    Talk >= ?MOST_TALK, Kind =:= <<"o">>;
    Talk >= ?MOST_TALK, Kind =:= <<"p">>
->
    Hub#hub{left_out = Out + 1};
add([Kind | _] = Row, #hub{rows = Rows, state = State, talk = Talk} = Hub) ->
    More =
        case lists:member(Kind, [<<"s">>, <<"d">>, <<"o">>, <<"p">>]) of
            true -> 1;
            false -> 0
        end,
    Hub#hub{rows = [Row | Rows], state = starl_view_state:add(Row, State), talk = Talk + More}.

remember(Robot, Event, #hub{events = Events, kept_events = Kept} = Hub) ->
    Next =
        case Events of
            #{Robot := {N, Last}} when N < 2 * Kept -> {N + 1, [Event | Last]};
            #{Robot := {_, Last}} -> {Kept, [Event | lists:sublist(Last, Kept - 1)]};
            #{} -> {1, [Event]}
        end,
    Hub#hub{events = Events#{Robot => Next}}.

%% -- frames ---------------------------------------------------------------------------------

framed(#hub{rows = [], left_out = 0} = Hub) ->
    Hub;
framed(#hub{rows = Rows, left_out = Out, now = Now, frames = Frames} = Hub) ->
    More = [[<<"c">>, Now, Out] || Out > 0],
    Frame = iolist_to_binary(json(lists:reverse(Rows, More))),
    Hub#hub{rows = [], talk = 0, left_out = 0, frames = starl_view_frames:add(Frame, Frames)}.

json(Rows) -> lists:join($,, [starl_json:encode(Row) || Row <- Rows]).

serve(#hub{waiting = Waiting} = Hub) ->
    maps:fold(fun answer/3, Hub#hub{waiting = #{}}, Waiting).

answer(Page, {Frame, Clock} = Place, #hub{frames = Frames, clock = {N, Time}} = Hub) ->
    case {Frame < starl_view_frames:last(Frames), Clock < N} of
        {false, false} ->
            Hub#hub{waiting = (Hub#hub.waiting)#{Page => Place}};
        {false, true} ->
            Page ! {frames, Time, {Frame, N}},
            Hub;
        {true, _} ->
            {Rows, Upto} = after_frame(Frame, Hub),
            Page ! {frames, lists:join($,, [Rows, Time]), {Upto, N}},
            Hub
    end.

%% A page that has missed frames begins with the state of now.
after_frame(Frame, #hub{frames = Frames, state = State, now = Now, head = Head}) ->
    case starl_view_frames:later(Frame, Frames) of
        missed ->
            Reset = json([[<<"reset">>]]),
            Gap = json([[<<"gap">>, Now] | starl_view_state:rows(Now, State)]),
            Rows = lists:join($,, [Part || Part <- [Reset, Head, Gap], Part =/= []]),
            {Rows, starl_view_frames:last(Frames)};
        {Parts, Upto} ->
            {lists:join($,, Parts), Upto}
    end.
