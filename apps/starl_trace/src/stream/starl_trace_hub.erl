%% @doc Gives the messages of a run to subscribers, each at its own pace.
%% ```
%%   {ok, Hub} = starl_trace_hub:start_link(simulation),
%%   {ok, Sim} = starl_sim:start(Scenario, #{
%%       observe => starl_trace_hub:observer(Hub), packets => true}),
%%   ok = starl_trace_hub:subscribe(Hub, Credits)
%%
%%   receive {starl_trace, Hub, Messages} -> ..., starl_trace_hub:more(Hub, 1) end
%% '''
%% Each delivery, a list of messages in the order of time, costs a credit, which {@link more/2}
%% gives back. A subscriber without credit gets the messages together later. If too many wait, they
%% are dropped: the subscriber gets a message `gap', the scenario and the places of all robots, and
%% the messages from then on. So a slow subscriber neither holds up the run nor fills memory. A new
%% subscriber begins with the scenario and the places of all robots, too.
-module(starl_trace_hub).
-behaviour(gen_server).

-export([start_link/1, observer/1, subscribe/2, unsubscribe/1, more/2, stop/1]).
-export([init/1, handle_call/3, handle_cast/2, handle_info/2]).

%% Events that may wait for the hub; messages that may wait for a subscriber.
-define(WAITING, 5000).
-define(PENDING, 20000).

-record(subscriber, {
    credits :: non_neg_integer(),
    %% lists of messages, the latest first, and their number; messages missed before these
    pending = [] :: [[starl_trace_message:t()]],
    count = 0 :: non_neg_integer(),
    missed = 0 :: non_neg_integer(),
    monitor :: reference()
}).

-record(hub, {
    observer :: starl_observer:t(),
    stream = starl_trace_stream:new() :: starl_trace_stream:t(),
    subscribers = #{} :: #{pid() => #subscriber{}},
    now = 0 :: integer()
}).

%% @doc Starts the hub of a run. A simulation waits for it, a live run does not.
-spec start_link(simulation | live) -> gen_server:start_ret().
start_link(Kind) -> gen_server:start_link(?MODULE, Kind, []).

%% @doc The observer of the run, for its options.
-spec observer(pid()) -> starl_observer:t().
observer(Hub) -> gen_server:call(Hub, observer).

%% @doc The calling process gets the messages from now on: `{starl_trace, Hub, [Message]}'.
-spec subscribe(pid(), Credits :: pos_integer()) -> ok.
subscribe(Hub, Credits) -> gen_server:call(Hub, {subscribe, self(), Credits}).

%% @doc The calling process gets no more messages.
-spec unsubscribe(pid()) -> ok.
unsubscribe(Hub) -> gen_server:call(Hub, {unsubscribe, self()}).

%% @doc The calling process can take so many further deliveries.
-spec more(pid(), Credits :: pos_integer()) -> ok.
more(Hub, Credits) -> gen_server:cast(Hub, {more, self(), Credits}).

%% @doc Ends the hub.
-spec stop(pid()) -> ok.
stop(Hub) -> gen_server:stop(Hub).

-spec init(simulation | live) -> {ok, #hub{}}.
init(simulation) -> {ok, #hub{observer = starl_observer:feed(self(), wait, ?WAITING)}};
init(live) -> {ok, #hub{observer = starl_observer:feed(self(), leave_out, 10 * ?WAITING)}}.

-spec handle_call(term(), gen_server:from(), #hub{}) -> {reply, term(), #hub{}}.
handle_call(observer, _From, #hub{observer = Observer} = Hub) ->
    {reply, Observer, Hub};
handle_call(caught_up, _From, Hub) ->
    {reply, ok, Hub};
handle_call({subscribe, Pid, Credits}, _From, #hub{stream = Stream} = Hub0) ->
    #hub{subscribers = Subscribers} = Hub = without(Pid, Hub0),
    New = #subscriber{credits = Credits, monitor = erlang:monitor(process, Pid)},
    State = starl_trace_stream:state(Stream),
    {reply, ok, Hub#hub{subscribers = Subscribers#{Pid => given(Pid, State, Hub, New)}}};
handle_call({unsubscribe, Pid}, _From, Hub) ->
    {reply, ok, without(Pid, Hub)}.

-spec handle_cast(term(), #hub{}) -> {noreply, #hub{}}.
handle_cast({more, Pid, Credits}, #hub{subscribers = Subscribers} = Hub) ->
    case Subscribers of
        #{Pid := #subscriber{credits = Left} = Known} ->
            Richer = Known#subscriber{credits = Left + Credits},
            {noreply, Hub#hub{subscribers = Subscribers#{Pid := deliver(Pid, Hub, Richer)}}};
        #{} ->
            {noreply, Hub}
    end.

-spec handle_info(term(), #hub{}) -> {noreply, #hub{}}.
handle_info({starl_news, Feed, News}, Hub) ->
    ok = starl_observer:done(News, Feed),
    {noreply, told(News, Hub)};
handle_info({'DOWN', _, process, Pid, _}, Hub) ->
    {noreply, without(Pid, Hub)};
handle_info(_Other, Hub) ->
    {noreply, Hub}.

told({missed, Events}, #hub{now = Now} = Hub) ->
    all([{gap, Now, Events}], Hub);
told(News, #hub{stream = Stream} = Hub) ->
    {Messages, Next} = starl_trace_stream:news(News, Stream),
    all(Messages, Hub#hub{stream = Next}).

all([], Hub) ->
    Hub;
all(Messages, #hub{subscribers = Subscribers} = Hub0) ->
    Hub = Hub0#hub{now = element(2, lists:last(Messages))},
    Given = maps:map(fun(Pid, S) -> given(Pid, Messages, Hub, S) end, Subscribers),
    Hub#hub{subscribers = Given}.

given(_Pid, Messages, _Hub, #subscriber{missed = Missed} = Known) when Missed > 0 ->
    Known#subscriber{missed = Missed + length(Messages)};
given(Pid, Messages, Hub, #subscriber{pending = Pending, count = Count} = Known) ->
    deliver(Pid, Hub, Known#subscriber{
        pending = [Messages | Pending], count = Count + length(Messages)
    }).

deliver(_Pid, _Hub, #subscriber{credits = 0, count = Count} = Known) when Count > ?PENDING ->
    Known#subscriber{pending = [], count = 0, missed = Count};
deliver(_Pid, _Hub, #subscriber{credits = 0} = Known) ->
    Known;
deliver(Pid, #hub{stream = Stream, now = Now}, #subscriber{missed = Missed} = Known) when
    Missed > 0
->
    State = [{gap, Now, Missed} | starl_trace_stream:state(Stream)],
    sent(Pid, Known#subscriber{pending = [State], missed = 0});
deliver(_Pid, _Hub, #subscriber{count = 0} = Known) ->
    Known;
deliver(Pid, _Hub, Known) ->
    sent(Pid, Known).

sent(Pid, #subscriber{pending = Pending, credits = Credits} = Known) ->
    Pid ! {starl_trace, self(), lists:append(lists:reverse(Pending))},
    Known#subscriber{pending = [], count = 0, credits = Credits - 1}.

without(Pid, #hub{subscribers = Subscribers} = Hub) ->
    case maps:take(Pid, Subscribers) of
        {#subscriber{monitor = Monitor}, Left} ->
            true = erlang:demonitor(Monitor, [flush]),
            Hub#hub{subscribers = Left};
        error ->
            Hub
    end.
