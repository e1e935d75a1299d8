%% @doc Shows a live run: robots in real time, in this VM or on nodes. The page is behind by the
%% time that facts may take until they are judged. Manual faults take effect at once here. The
%% results contain them as a schedule of faults for the simulator, because real time cannot be
%% repeated.
-module(starl_lab_window_live).
-behaviour(gen_server).

-export([start_link/1, observer/1, attach/2]).
-export([init/1, handle_call/3, handle_cast/2, handle_info/2]).

-export_type([config/0]).

%% `speed': of the run's time.
-type config() :: #{hub := pid(), speed := number()}.

-define(TICK_MS, 50).
%% Facts are judged 1.5 s of the run after they happened, looked at every 200 ms.
-define(BEHIND_US, 1600000).
-define(LOOK_US, 250000).

-record(live, {
    hub :: pid(),
    speed :: number(),
    %% its window may be open before it has started
    run = none :: starl_run:t() | none | over,
    robots = 0 :: non_neg_integer(),
    machines = [] :: [starl_machine:name()],
    facts = none :: starl_observer:facts() | none,
    now = 0 :: integer()
}).

%% @doc Starts to show a run; its observer comes first, the run when it has started.
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
-spec attach(pid(), starl_run:t()) -> ok.
attach(Live, Run) -> gen_server:call(Live, {attach, Run}).

-spec init(config()) -> {ok, #live{}}.
init(#{hub := Hub, speed := Speed}) ->
    ok = starl_view_hub:lead(Hub, self()),
    _ = erlang:send_after(?TICK_MS, self(), tick),
    {ok, #live{hub = Hub, speed = Speed}}.

-spec handle_call(hub | {attach, starl_run:t()}, gen_server:from(), #live{}) ->
    {reply, term(), #live{}}.
handle_call(hub, _From, #live{hub = Hub} = Live) ->
    {reply, Hub, Live};
handle_call({attach, Run}, _From, Live) ->
    {reply, ok, head(Live#live{run = Run})}.

-spec handle_cast(starl_observer:news(), #live{}) -> {noreply, #live{}}.
handle_cast({begun, Facts}, Live) ->
    {noreply, head(Live#live{facts = Facts})};
handle_cast({ended, #{ending := Ending, end_us := End}}, #live{hub = Hub, now = Now} = Live) ->
    Last = max(Now, End),
    Clock = #{speed => 1, real => 0, paused => true, running => 0, ending => Ending},
    ok = starl_view_hub:clock(Hub, Clock#{now_us => Last}),
    {noreply, Live#live{run = over, now = Last}}.

head(#live{facts = none} = Live) ->
    Live;
head(#live{facts = #{robots := Robots} = Facts, hub = Hub, run = Run} = Live) ->
    #{machines := Machines} = Facts,
    Rows = starl_view_head:rows(Facts, #{kind => live, kinds => can(Run)}),
    ok = starl_view_hub:head(Hub, {Rows, length(Robots)}),
    _ = [ok = starl_view_hub:put(Hub, Row) || Row <- Rows],
    Live#live{robots = length(Robots), machines = maps:keys(Machines)}.

can(none) -> [];
can(over) -> [];
can(Run) -> starl_lab_window_fault:kinds(starl_run:world(Run)).

-spec handle_info(term(), #live{}) -> {noreply, #live{}}.
handle_info(tick, Live) ->
    _ = erlang:send_after(?TICK_MS, self(), tick),
    {noreply, tick(Live)};
handle_info({starl_view, Page, Command}, Live) ->
    {noreply, do(Command, starl_view_hub:asker(Page, Command), Live)};
handle_info(_, Live) ->
    {noreply, Live}.

tick(#live{run = Run} = Live) when Run =:= none; Run =:= over ->
    Live;
tick(#live{run = Run} = Live) ->
    try starl_run:status(Run) of
        Known -> told(Known, Live)
    catch
        %% it has just ended, and says so itself
        exit:_ -> Live
    end.

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
do(_Command, Page, #live{run = none} = Live) ->
    answered({error, "not yet"}, none, Page, Live);
do(_Command, Page, #live{run = over} = Live) ->
    answered({error, "the run is over"}, none, Page, Live);
do(#{<<"do">> := <<"fault">>} = Command, Page, #live{run = Run} = Live) ->
    #live{robots = N, machines = Machines} = Live,
    World = starl_run:world(Run),
    case
        starl_lab_window_fault:parse(Command, #{world => World, robots => N, machines => Machines})
    of
        {ok, Faults} -> answered(starl_run:inject(Run, Faults), done(Faults), Page, Live);
        {error, _} = Error -> answered(Error, none, Page, Live)
    end;
do(#{<<"do">> := <<"heal">>, <<"id">> := Name}, Page, #live{run = Run} = Live) ->
    answered(starl_run:heal(Run, healed(Name)), "healed", Page, Live);
do(#{<<"do">> := <<"stop">>}, Page, #live{run = Run} = Live) ->
    answered(starl_run:stop(Run), "stop", Page, Live);
do(_Command, Page, Live) ->
    answered({error, "this cannot be done to a live run"}, none, Page, Live).

%% No word of the page becomes an atom.
healed(<<"all">>) ->
    all;
healed(Name) ->
    try
        {fault, binary_to_existing_atom(Name)}
    catch
        error:badarg -> {fault, none}
    end.

%% The run tells its observers what was done, and so the page.
answered(ok, Said, Page, Live) ->
    ok = starl_view_hub:say(Page, yes, Said),
    Live;
answered({error, Why}, _Said, Page, Live) ->
    ok = starl_view_hub:say(Page, no, Why),
    Live.

done([{Kind, _, _, _} | _] = Faults) ->
    Robots = lists:usort(lists:append([starl_run_manual_fault:robots(Fault) || Fault <- Faults])),
    [
        string:replace(atom_to_list(Kind), "_", " ", all),
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
