%% @doc The behaviour of transports, which carry packets between live robots, and the process that
%% holds one end. It is the radio of a live robot. See `doc/transports.md'.
%%
%% A transport may lose, duplicate, delay and reorder packets; SAP expects that. It must never
%% change a packet, and must deliver only packets that robots of the same fleet and run have sent.
%% The process is separate from the robot's link, so hostile traffic costs time here, not there.
%% ```
%%     link -- transmit(Transport, To, Packet) --> transport --> the air
%%     link <-- {starl_heard, Transport, [Packet]} -- transport <-- the air
%% '''
%% What it hears goes through a filter ({@link starl_live_conditions}), which disturbs nothing unless the
%% configuration or {@link set_conditions/2} says otherwise.
%%
%% A packet with a deadline leaves by then, or not at all: `{starl_late, Owner}' notifies the link.
%%
%% Each end reports what it knows of each packet ({@link starl_observer:packet_report()}), if anybody wants
%% it.
-module(starl_live_transport).
-behaviour(gen_server).

-export([start_link/3, transmit/3, transmit/4, figures/1, peers/1, set_conditions/2]).
-export([count/2, count/3, refused/3]).
-export([init/1, handle_call/3, handle_cast/2, handle_info/2, terminate/2, format_status/1]).

-export_type([config/0, figures/0, heard/0, latest/0]).

%% What every transport gets; each has further keys of its own. Only robots of the same fleet and
%% the same run hear each other.
-type config() :: #{
    robot := starl:robot_id(),
    participants := starl_team:t(),
    fleet := unicode:chardata(),
    run := non_neg_integer(),
    air => starl_live_conditions:settings(),
    clock => starl_live_clock:t(),
    tell => starl_live_packet_reports:teller(),
    atom() => term()
}.

%% Counters, for the metrics of the node: packets sent and heard, and those that were refused, by
%% reason.
-type figures() :: #{atom() => non_neg_integer()}.

%% The latest moment of a packet, by the robot's clock, and who is notified if it has passed.
-type latest() :: {Us :: integer(), Owner :: term()}.

%% The message to the link.
-type heard() :: {starl_heard, Transport :: pid(), [starl_packet:t()]}.

%% Opens the robot's end. The process that calls it gets the messages of sockets.
-callback open(config()) -> {ok, State :: term()} | {error, unicode:chardata()}.
%% Puts one packet on the air, for one robot or for all. Returns one line on a packet that cannot be
%% sent at all.
-callback transmit(starl:robot_id() | all, starl_packet:t(), State) ->
    {ok, State} | {refused, unicode:chardata(), State}
when
    State :: term().
%% Handles a message of the process: packets that have arrived, in their order.
-callback hear(Message :: term(), State) -> {[starl_packet:t()], State} | unknown when
    State :: term().
%% Its counters.
-callback figures(State :: term()) -> figures().
%% What it knows of the other robots, if it hears them beat.
-callback peers(State :: term()) -> [starl_live_peers:peer()].
%% Closes the robot's end.
-callback close(State :: term()) -> ok.
-optional_callbacks([peers/1]).

%% The most packets that the filter delays at a time; others are lost.
-define(DELAYED, 10_000).

-record(transport, {
    module :: module(),
    state :: term(),
    link :: pid(),
    clock :: starl_live_clock:t() | none,
    conditions :: starl_live_conditions:t(),
    delayed = 0 :: non_neg_integer(),
    reports :: starl_live_packet_reports:t() | none,
    figures = #{} :: figures(),
    %% the last line on a packet that cannot be sent, which is not said twice: SAP tries again
    said = <<>> :: binary()
}).

%% @doc Opens a robot's end of a transport; packets go to the link.
-spec start_link(module(), config(), Link :: pid()) -> gen_server:start_ret().
start_link(Module, Config, Link) -> gen_server:start_link(?MODULE, {Module, Config, Link}, []).

%% @doc Puts one packet on the air.
-spec transmit(pid(), starl:robot_id() | all, starl_packet:t()) -> ok.
transmit(Transport, To, Packet) -> gen_server:cast(Transport, {transmit, To, Packet}).

%% @doc Puts one packet on the air if its latest moment has not passed.
-spec transmit(pid(), starl:robot_id() | all, starl_packet:t(), latest()) -> ok.
transmit(Transport, To, Packet, Latest) ->
    gen_server:cast(Transport, {transmit, To, Packet, Latest}).

%% @doc The transport's counters.
-spec figures(pid()) -> figures().
figures(Transport) -> gen_server:call(Transport, figures).

%% @doc What the transport knows of the other robots; nothing, if it receives no heartbeats from
%% them.
-spec peers(pid()) -> [starl_live_peers:peer()].
peers(Transport) -> gen_server:call(Transport, peers).

%% @doc Changes these settings of the filter.
-spec set_conditions(pid(), starl_live_conditions:settings()) -> ok | {error, unicode:chardata()}.
set_conditions(Transport, Settings) -> gen_server:call(Transport, {set_conditions, Settings}).

%% -- counters, for the modules of this behaviour --------------------------------------------

%% @doc One more.
-spec count(atom(), figures()) -> figures().
count(Name, Figures) -> count(Name, 1, Figures).

%% @doc So many more.
-spec count(atom(), non_neg_integer(), figures()) -> figures().
count(Name, Number, Figures) ->
    maps:update_with(Name, fun(Before) -> Before + Number end, Number, Figures).

%% @doc One more packet of a robot that was refused, for this reason. What points to a mistake in the
%% set-up is logged when it comes for the first time.
-spec refused(starl_live_codec:refusal(), From :: starl:robot_id(), figures()) -> figures().
refused(unknown_atom, From, Figures) when not is_map_key(unknown_atom, Figures) ->
    Line =
        "a packet of robot ~b bears an atom that is unknown here and is not taken; "
        "is the same code loaded on both computers?",
    logger:warning(#{what => unknown_atom, why => iolist_to_binary(io_lib:format(Line, [From]))}),
    count(unknown_atom, Figures);
refused(Why, _From, Figures) ->
    count(Why, Figures).

%% -- the process ----------------------------------------------------------------------------

-spec init({module(), config(), pid()}) -> {ok, #transport{}} | {stop, term()}.
init({Module, #{robot := Robot} = Config, Link}) ->
    process_flag(trap_exit, true),
    logger:set_process_metadata(#{domain => [starl, robot], robot => Robot}),
    case starl_live_conditions:new(maps:get(air, Config, #{})) of
        {ok, Conditions} -> opened(Module:open(Config), Module, Conditions, Link, Config);
        {error, _} = Error -> opened(Error, Module, none, Link, Config)
    end.

opened({ok, State}, Module, Conditions, Link, Config) ->
    {ok, #transport{
        module = Module,
        state = State,
        link = Link,
        clock = maps:get(clock, Config, none),
        conditions = Conditions,
        reports = starl_live_packet_reports:new(Config)
    }};
opened({error, Why}, _Module, _Air, _Link, _Config) ->
    {stop, {shutdown, {transport, unicode:characters_to_binary(Why)}}}.

-spec handle_call(Question, gen_server:from(), #transport{}) -> {reply, Answer, #transport{}} when
    Question :: figures | peers | {set_conditions, starl_live_conditions:settings()},
    Answer :: figures() | [starl_live_peers:peer()] | ok | {error, unicode:chardata()}.
handle_call(peers, _From, #transport{module = Module, state = State} = Transport) ->
    {reply, starl_callback:call(Module, peers, [State], []), Transport};
handle_call(figures, _From, #transport{module = Module, state = State} = Transport) ->
    {reply, maps:merge(Module:figures(State), Transport#transport.figures), Transport};
handle_call({set_conditions, Settings}, _From, #transport{conditions = Conditions} = Transport) ->
    case starl_live_conditions:set(Settings, Conditions) of
        {ok, Changed} -> {reply, ok, Transport#transport{conditions = Changed}};
        {error, _} = Error -> {reply, Error, Transport}
    end.

-spec handle_cast(Transmit, #transport{}) -> {noreply, #transport{}} when
    Transmit ::
        {transmit, starl:robot_id() | all, starl_packet:t()}
        | {transmit, starl:robot_id() | all, starl_packet:t(), latest()}.
handle_cast({transmit, To, Packet}, Transport) ->
    {noreply, put_on_air(To, Packet, Transport)};
handle_cast(
    {transmit, To, Packet, {Us, Owner}}, #transport{clock = Clock, link = Link} = Transport
) ->
    case starl_live_clock:now_us(Clock) =< Us of
        true ->
            {noreply, put_on_air(To, Packet, Transport)};
        false ->
            Link ! {starl_late, Owner},
            {noreply, counted(late, 1, Transport)}
    end.

put_on_air(To, Packet, #transport{module = Module, state = State} = Transport) ->
    At = starl_live_packet_reports:at_us(Transport#transport.reports),
    case Module:transmit(To, Packet, State) of
        {ok, Next} ->
            ok = starl_live_packet_reports:sent(To, Packet, At, Transport#transport.reports),
            Transport#transport{state = Next};
        {refused, Why, Next} ->
            ok = starl_live_packet_reports:refused(To, Packet, At, Transport#transport.reports),
            Line = unicode:characters_to_binary(Why),
            refuse(Line, Transport#transport{state = Next})
    end.

refuse(Line, #transport{said = Line} = Transport) ->
    counted(refused, 1, Transport);
refuse(Line, Transport) ->
    logger:error(#{what => packet_refused, why => Line}),
    counted(refused, 1, Transport#transport{said = Line}).

-spec handle_info(term(), #transport{}) -> {noreply, #transport{}} | {stop, term(), #transport{}}.
handle_info({'EXIT', _From, Reason}, Transport) ->
    {stop, Reason, Transport};
handle_info({?MODULE, delayed, Packet}, #transport{delayed = Delayed} = Transport) ->
    {noreply, tell([Packet], Transport#transport{delayed = Delayed - 1})};
handle_info(Message, #transport{module = Module, state = State} = Transport) ->
    case Module:hear(Message, State) of
        {Packets, Next} -> {noreply, filter(Packets, Transport#transport{state = Next})};
        unknown -> {noreply, Transport}
    end.

%% The robot hears packets in the order in which they come, but for those that are delayed.
filter(Packets, Transport) ->
    {Heard, Filtered} = lists:foldl(fun pass/2, {[], Transport}, Packets),
    tell(lists:reverse(Heard), Filtered).

pass(Packet, {Heard, #transport{conditions = Conditions, reports = Reports} = Transport}) ->
    From = starl_packet:source(Packet),
    {Delays, Next} = starl_live_conditions:pass(From, Conditions),
    ok = starl_live_packet_reports:came(
        From, Packet, Delays, starl_live_conditions:is_cut(From, Conditions), Reports
    ),
    passed(Packet, Delays, {Heard, Transport#transport{conditions = Next}}).

passed(_Packet, [], {Heard, Transport}) ->
    {Heard, counted(air_lost, 1, Transport)};
passed(Packet, Delays, Before) ->
    lists:foldl(fun(Delay, Through) -> delay(Packet, Delay, Through) end, Before, Delays).

delay(Packet, 0, {Heard, Transport}) ->
    {[Packet | Heard], Transport};
delay(_Packet, _Ms, {Heard, #transport{delayed = ?DELAYED} = Transport}) ->
    {Heard, counted(air_full, 1, Transport)};
delay(Packet, Ms, {Heard, #transport{delayed = Delayed} = Transport}) ->
    _ = erlang:send_after(Ms, self(), {?MODULE, delayed, Packet}),
    {Heard, Transport#transport{delayed = Delayed + 1}}.

tell([], Transport) ->
    Transport;
tell(Packets, #transport{link = Link} = Transport) ->
    Link ! {starl_heard, self(), Packets},
    counted(heard, length(Packets), Transport).

counted(What, Number, #transport{figures = Figures} = Transport) ->
    Transport#transport{figures = count(What, Number, Figures)}.

-spec terminate(term(), #transport{}) -> ok.
terminate(_Reason, #transport{module = Module, state = State}) -> Module:close(State).

%% A report of a crash says nothing of keys.
-spec format_status(gen_server:format_status()) -> gen_server:format_status().
format_status(Status) -> maps:map(fun hidden/2, Status).

hidden(state, #transport{state = _} = Transport) -> Transport#transport{state = hidden};
hidden(_Key, Value) -> Value.
