%% @doc The radio of a live robot: a behaviour for the ways in which packets travel between robots,
%% and the process that holds one end.
%%
%% A transport may lose, double, delay and reorder packets; SAP expects that. It must never change a
%% packet, and must deliver only packets that robots of the same fleet and run have sent. The process
%% stands apart from the robot's link: hostile traffic costs time here, not there.
%% ```
%%     link -- transmit(Transport, To, Packet) --> transport --> the air
%%     link <-- {starl_heard, Transport, [Packet]} -- transport <-- the air
%% '''
-module(starl_live_transport).
-behaviour(gen_server).

-export([start_link/3, transmit/3, figures/1]).
-export([init/1, handle_call/3, handle_cast/2, handle_info/2, terminate/2]).

-export_type([config/0, figures/0, heard/0]).

%% What every transport is told; each has further keys of its own.
-type config() :: #{
    robot := starl:robot_id(),
    participants := starl_team:t(),
    atom() => term()
}.

%% Counters, for the metrics of the node: packets sent and heard, and those that were refused, by
%% reason.
-type figures() :: #{atom() => non_neg_integer()}.

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
%% Closes the robot's end.
-callback close(State :: term()) -> ok.

-record(transport, {
    module :: module(),
    state :: term(),
    link :: pid(),
    robot :: starl:robot_id()
}).

%% @doc Opens a robot's end of a transport; packets go to the link.
-spec start_link(module(), config(), Link :: pid()) -> gen_server:start_ret().
start_link(Module, Config, Link) -> gen_server:start_link(?MODULE, {Module, Config, Link}, []).

%% @doc Puts one packet on the air.
-spec transmit(pid(), starl:robot_id() | all, starl_packet:t()) -> ok.
transmit(Transport, To, Packet) -> gen_server:cast(Transport, {transmit, To, Packet}).

%% @doc The transport's counters.
-spec figures(pid()) -> figures().
figures(Transport) -> gen_server:call(Transport, figures).

-spec init({module(), config(), pid()}) -> {ok, #transport{}} | {stop, term()}.
init({Module, #{robot := Robot} = Config, Link}) ->
    process_flag(trap_exit, true),
    logger:set_process_metadata(#{domain => [starl, robot], robot => Robot}),
    case Module:open(Config) of
        {ok, State} ->
            {ok, #transport{module = Module, state = State, link = Link, robot = Robot}};
        {error, Why} ->
            {stop, {shutdown, {transport, unicode:characters_to_binary(Why)}}}
    end.

-spec handle_call(figures, gen_server:from(), #transport{}) -> {reply, figures(), #transport{}}.
handle_call(figures, _From, #transport{module = Module, state = State} = Transport) ->
    {reply, Module:figures(State), Transport}.

-spec handle_cast({transmit, starl:robot_id() | all, starl_packet:t()}, #transport{}) ->
    {noreply, #transport{}}.
handle_cast({transmit, To, Packet}, #transport{module = Module, state = State} = Transport) ->
    case Module:transmit(To, Packet, State) of
        {ok, Next} ->
            {noreply, Transport#transport{state = Next}};
        {refused, Why, Next} ->
            logger:error(#{what => packet_refused, why => unicode:characters_to_binary(Why)}),
            {noreply, Transport#transport{state = Next}}
    end.

-spec handle_info(term(), #transport{}) -> {noreply, #transport{}} | {stop, term(), #transport{}}.
handle_info({'EXIT', _From, Reason}, Transport) ->
    {stop, Reason, Transport};
handle_info(Message, #transport{module = Module, state = State, link = Link} = Transport) ->
    case Module:hear(Message, State) of
        {[], Next} ->
            {noreply, Transport#transport{state = Next}};
        {Packets, Next} ->
            Link ! {starl_heard, self(), Packets},
            {noreply, Transport#transport{state = Next}};
        unknown ->
            {noreply, Transport}
    end.

-spec terminate(term(), #transport{}) -> ok.
terminate(_Reason, #transport{module = Module, state = State}) -> Module:close(State).
