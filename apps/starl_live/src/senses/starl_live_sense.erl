%% @doc The behaviour of drivers for a live robot's senses, such as a camera, and the process that
%% holds a driver and its last reading. The senses of the chassis itself are not included.
%%
%% A driver reports each new reading. A question is answered with the last reading, unless it is too
%% old. The process ends with the robot's link. A driver that has lost its device reports this once,
%% and tries again by itself: a robot goes on without a sense.
%% ```
%%     link -- ask --> sense <-- frames, bytes, ... -- a device
%%     link <-- {starl_felt, Sense, Mark, {ok, Reading} | none} -- sense
%% '''
-module(starl_live_sense).
-behaviour(gen_server).

-export([start_link/3, ask/2]).
-export([init/1, handle_call/3, handle_cast/2, handle_info/2, terminate/2]).

-export_type([config/0, felt/0]).

%% What every driver gets; each has further keys of its own. `stale_ms': a reading that is older is
%% none (1000).
-type config() :: #{
    robot := starl:robot_id(),
    clock := starl_live_clock:t(),
    stale_ms => pos_integer(),
    atom() => term()
}.

%% The answer to the question of this mark. `unknown': there is no such sense.
-type felt() :: {ok, Reading :: term()} | none | unknown.

%% Opens the device. The process that calls it gets the messages of ports and sockets.
-callback open(config()) -> {ok, State :: term()} | {error, unicode:chardata()}.
%% Handles a message of the process: a new reading, nothing new, or no message of this driver's.
-callback hear(Message :: term(), State) ->
    {reading, Reading :: term(), State} | {nothing, State} | unknown
when
    State :: term().
%% Closes the device.
-callback close(State :: term()) -> ok.

-define(STALE_MS, 1000).

-record(sense, {
    module :: module(),
    state :: term(),
    link :: pid(),
    stale_ms :: pos_integer(),
    %% the last reading, and when it came, ms of monotonic time
    last = none :: none | {integer(), term()}
}).

%% @doc Opens a sense of a robot; answers go to the link.
-spec start_link(module(), config(), Link :: pid()) -> gen_server:start_ret().
start_link(Module, Config, Link) -> gen_server:start_link(?MODULE, {Module, Config, Link}, []).

%% @doc Asks for the last reading.
-spec ask(pid(), Mark :: term()) -> ok.
ask(Sense, Mark) -> gen_server:cast(Sense, {ask, Mark}).

-spec init({module(), config(), pid()}) -> {ok, #sense{}} | {stop, term()}.
init({Module, #{robot := Robot} = Config, Link}) ->
    process_flag(trap_exit, true),
    logger:set_process_metadata(#{domain => [starl, robot], robot => Robot}),
    case Module:open(Config) of
        {ok, State} ->
            Stale = maps:get(stale_ms, Config, ?STALE_MS),
            {ok, #sense{module = Module, state = State, link = Link, stale_ms = Stale}};
        {error, Why} ->
            {stop, {shutdown, {sense, unicode:characters_to_binary(Why)}}}
    end.

-spec handle_call(term(), gen_server:from(), #sense{}) -> {reply, ok, #sense{}}.
handle_call(_Question, _From, Sense) -> {reply, ok, Sense}.

-spec handle_cast({ask, term()}, #sense{}) -> {noreply, #sense{}}.
handle_cast({ask, Mark}, #sense{link = Link} = Sense) ->
    Link ! {starl_felt, self(), Mark, felt(Sense)},
    {noreply, Sense}.

felt(#sense{last = none}) ->
    none;
felt(#sense{last = {At, Reading}, stale_ms = Stale}) ->
    case erlang:monotonic_time(millisecond) - At =< Stale of
        true -> {ok, Reading};
        false -> none
    end.

-spec handle_info(term(), #sense{}) -> {noreply, #sense{}} | {stop, term(), #sense{}}.
handle_info({'EXIT', Link, Reason}, #sense{link = Link} = Sense) ->
    {stop, Reason, Sense};
handle_info(Message, #sense{module = Module, state = State} = Sense) ->
    case Module:hear(Message, State) of
        unknown ->
            {noreply, Sense};
        {nothing, Next} ->
            {noreply, Sense#sense{state = Next}};
        {reading, Reading, Next} ->
            Last = {erlang:monotonic_time(millisecond), Reading},
            {noreply, Sense#sense{state = Next, last = Last}}
    end.

-spec terminate(term(), #sense{}) -> ok.
terminate(_Reason, #sense{module = Module, state = State}) -> Module:close(State).
