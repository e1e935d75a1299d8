%% @doc Shows a live run: robots in real time, in this VM or on nodes. The page is behind by the
%% time that facts may take until they are judged. What hands can do here happens at once and is in
%% no scenario: real time does not come again.
-module(starl_view_live).
-behaviour(gen_server).

-export([start_link/1, observer/1, attach/2]).
-export([init/1, handle_call/3, handle_cast/2, handle_info/2]).

-export_type([config/0, hands/0]).

%% `speed': of the run's time.
-type config() :: #{hub := pid(), speed := number()}.

%% What can be done, by its name on the page, with the robots that it is done to; and the status of
%% the run.
-type hands() :: #{
    status := fun(() -> #{now_us := integer(), running := non_neg_integer(), atom() => term()}),
    kill => fun((starl:robot_id()) -> answer()),
    pause => fun((starl:robot_id(), Seconds :: number()) -> answer()),
    lose_store => fun((starl:robot_id()) -> answer()),
    set_back => fun((starl:robot_id()) -> answer()),
    cut => fun((starl:robot_id(), starl:robot_id()) -> answer()),
    freeze => fun((starl:robot_id()) -> answer()),
    heal => fun(() -> answer()),
    stop => fun(() -> answer())
}.

-type answer() :: ok | {error, unicode:chardata()}.

-define(TICK_MS, 50).
%% Facts are judged 1.5 s of the run after they happened, looked at every 200 ms.
-define(BEHIND_US, 1600000).
-define(LOOK_US, 250000).

-record(live, {
    hub :: pid(),
    speed :: number(),
    hands = none :: hands() | none | over,
    robots = 0 :: non_neg_integer(),
    facts = none :: starl_observer:facts() | none,
    now = 0 :: integer()
}).

%% @doc Starts to show a run; its observer comes first, its hands when it has started.
-spec start_link(config()) -> gen_server:start_ret().
start_link(Config) -> gen_server:start_link(?MODULE, Config, []).

%% @doc The observer for the options of the run.
-spec observer(pid()) -> starl_observer:t().
observer(Live) ->
    Hub = gen_server:call(Live, hub),
    Tell = starl_view_hub:observer(Hub, 0),
    fun
        ({What, _} = News) when What =:= begun; What =:= ended ->
            ok = Tell(News),
            gen_server:cast(Live, News);
        (News) ->
            Tell(News)
    end.

%% @doc The run has started.
-spec attach(pid(), hands()) -> ok.
attach(Live, Hands) -> gen_server:call(Live, {attach, Hands}).

-spec init(config()) -> {ok, #live{}}.
init(#{hub := Hub, speed := Speed}) ->
    ok = starl_view_hub:lead(Hub, self()),
    _ = erlang:send_after(?TICK_MS, self(), tick),
    {ok, #live{hub = Hub, speed = Speed}}.

-spec handle_call(hub | {attach, hands()}, gen_server:from(), #live{}) -> {reply, term(), #live{}}.
handle_call(hub, _From, #live{hub = Hub} = Live) ->
    {reply, Hub, Live};
handle_call({attach, Hands}, _From, Live) ->
    {reply, ok, head(Live#live{hands = Hands})}.

-spec handle_cast(starl_observer:news(), #live{}) -> {noreply, #live{}}.
handle_cast({begun, Facts}, Live) ->
    {noreply, head(Live#live{facts = Facts})};
handle_cast({ended, #{ending := Ending, end_us := End}}, #live{hub = Hub, now = Now} = Live) ->
    Last = max(Now, End),
    Clock = #{speed => 1, real => 0, paused => true, running => 0, ending => Ending},
    ok = starl_view_hub:clock(Hub, Clock#{now_us => Last}),
    {noreply, Live#live{hands = over, now = Last}}.

head(#live{facts = none} = Live) ->
    Live;
head(#live{facts = #{robots := Robots} = Facts, hub = Hub, hands = Hands} = Live) ->
    Rows = starl_view_head:rows(Facts, #{kind => live, hands => can(Hands)}),
    ok = starl_view_hub:head(Hub, {Rows, length(Robots)}),
    _ = [ok = starl_view_hub:put(Hub, Row) || Row <- Rows],
    Live#live{robots = length(Robots)}.

can(#{} = Hands) -> lists:sort(maps:keys(maps:remove(status, Hands)));
can(_) -> [].

-spec handle_info(term(), #live{}) -> {noreply, #live{}}.
handle_info(tick, Live) ->
    _ = erlang:send_after(?TICK_MS, self(), tick),
    {noreply, tick(Live)};
handle_info({starl_view, Page, Command}, Live) ->
    {noreply, do(Command, starl_view_hub:asker(Page, Command), Live)};
handle_info(_, Live) ->
    {noreply, Live}.

tick(#live{hands = #{status := Status}} = Live) ->
    try Status() of
        Known -> told(Known, Live)
    catch
        %% it has just ended, and says so itself
        exit:_ -> Live
    end;
tick(Live) ->
    Live.

told(#{now_us := Now, running := Running} = Known, #live{hub = Hub, speed = Speed} = Live) ->
    #live{now = Before} = Live,
    Shown = max(Before, Now - ?BEHIND_US - round(?LOOK_US * Speed)),
    ok = starl_view_hub:clock(Hub, #{
        now_us => Shown,
        speed => Speed,
        real => Speed,
        paused => false,
        running => Running,
        ending =>
            case Known of
                #{ending := Ending} when Ending =/= none -> Ending;
                #{} -> null
            end
    }),
    Live#live{now = Shown}.

do(#{<<"do">> := <<"look">>} = Command, Page, Live) ->
    look(Command, Page, Live);
do(_Command, Page, #live{hands = none} = Live) ->
    answered({error, "not yet"}, none, Page, Live);
do(_Command, Page, #live{hands = over} = Live) ->
    answered({error, "the run is over"}, none, Page, Live);
do(#{<<"do">> := <<"kill">>, <<"robot">> := Robot}, Page, Live) ->
    hand(kill, [Robot], Page, Live);
do(#{<<"do">> := <<"hold">>, <<"robot">> := Robot, <<"seconds">> := Seconds}, Page, Live) when
    is_number(Seconds)
->
    paused(Robot, Seconds, Page, Live);
do(#{<<"do">> := <<"lose_store">>, <<"robot">> := Robot}, Page, Live) ->
    hand(lose_store, [Robot], Page, Live);
do(#{<<"do">> := <<"set_back">>, <<"robot">> := Robot}, Page, Live) ->
    hand(set_back, [Robot], Page, Live);
do(#{<<"do">> := <<"freeze">>, <<"robot">> := Robot}, Page, Live) ->
    hand(freeze, [Robot], Page, Live);
do(#{<<"do">> := <<"cut">>, <<"robots">> := [A, B]}, Page, Live) when A =/= B ->
    hand(cut, [A, B], Page, Live);
do(#{<<"do">> := <<"heal">>}, Page, Live) ->
    hand(heal, [], Page, Live);
do(#{<<"do">> := <<"stop">>}, Page, Live) ->
    hand(stop, [], Page, Live);
do(_Command, Page, Live) ->
    answered({error, "this cannot be done to a live run"}, none, Page, Live).

hand(What, Robots, Page, #live{hands = Hands} = Live) ->
    case Hands of
        #{What := Do} -> hand(What, Robots, fun() -> apply(Do, Robots) end, Page, Live);
        #{} -> hand(What, Robots, none, Page, Live)
    end.

hand(What, Robots, Do, Page, #live{robots = N} = Live) ->
    case lists:all(fun(R) -> is_integer(R) andalso R >= 1 andalso R =< N end, Robots) of
        true when Do =/= none -> answered(Do(), {What, Robots}, Page, Live);
        true -> answered({error, "this cannot be done to this run"}, none, Page, Live);
        false -> answered({error, "there is no such robot"}, none, Page, Live)
    end.

%% The length is of the computer, not of the run.
paused(Robot, Seconds, Page, #live{hands = #{pause := Pause}} = Live) ->
    hand(pause, [Robot], fun() -> Pause(Robot, Seconds) end, Page, Live);
paused(_Robot, _Seconds, Page, Live) ->
    answered({error, "this cannot be done to this run"}, none, Page, Live).

%% The run tells its observers what was done, and so the page.
answered(ok, {What, Robots}, Page, Live) ->
    ok = starl_view_hub:say(Page, yes, done(What, Robots)),
    Live;
answered({error, Why}, _What, Page, Live) ->
    ok = starl_view_hub:say(Page, no, Why),
    Live.

done(heal, []) ->
    "healed";
done(What, Robots) ->
    [
        string:replace(atom_to_list(What), "_", " "),
        [io_lib:format(" ~b", [Robot]) || Robot <- Robots]
    ].

%% A robot is not asked: it may be on another computer, and has other things to do.
look(#{<<"robot">> := Robot}, Page, #live{hub = Hub, now = Now} = Live) when is_integer(Robot) ->
    Last = [
        [T, Machine, starl_view_row:text(Event, 160)]
     || {T, Machine, Event} <- starl_view_hub:events(Hub, Robot)
    ],
    Seen = #{
        result => running, events => length(Last), crashes => [], machines => [], last => Last
    },
    ok = starl_view_hub:tell(Page, [<<"look">>, Now, Robot, Seen]),
    Live;
look(_Command, Page, Live) ->
    answered({error, "there is no such robot"}, none, Page, Live).
