%% @doc The behaviour of drivers for the chassis and the other actuators of a live robot, and the
%% process that holds such a driver.
%%
%% The process ends with its link. When the link ends, for whatever reason, the chassis stops and
%% the other actuators come to rest (a pen is lifted), since no machine commands them any more.
%% ```
%%     link -- drive, actuate, stop --> chassis --> the drive
%%     link <-- {starl_chassis, Chassis, Mark, Answer} -- chassis <-- the drive
%%     link <-- {starl_chassis, Chassis, sensed, Sense} -- chassis <-- a bumper, a button, ...
%% '''
-module(starl_live_chassis).
-behaviour(gen_server).

-export([start_link/3, drive/4, actuate/4, stop/1, rest/1, condition/1, feel/3, is_late/3]).
-export([init/1, handle_call/3, handle_cast/2, handle_info/2, terminate/2]).

-export_type([config/0, answer/0, output/0, said/0, sense/0]).

%% What every driver gets; each has further keys of its own.
-type config() :: #{
    robot := starl:robot_id(),
    clock := starl_live_clock:t(),
    profile := starl_chassis:profile(),
    atom() => term()
}.

%% The answers of {@link starl_platform}. `HeardUs' is the time at which the chassis heard the
%% command, by the robot's clock.
-type answer() ::
    {driven, HeardUs :: integer()}
    | {stalled, starl_chassis:movement()}
    | {actuated, Device :: atom(), Value :: term()}
    | {not_understood, starl_chassis:commands()}.

%% What a body feels, of its chassis' own: `{bump, left}'.
-type sense() :: {Kind :: atom(), Value :: term()}.

%% What a driver tells: the answer to the command of this mark; what the body has felt; where it was
%% at a time of the robot's clock, if the driver knows that (a world of simulated robots needs it).
-type output() ::
    {Mark :: term(), answer()}
    | {sensed, sense()}
    | {posed, AtUs :: integer(), starl:pose()}.

%% The message to the link: the answer to the command of this mark; or what the body has felt.
-type said() ::
    {starl_chassis, Chassis :: pid(), Mark :: term(), answer()}
    | {starl_chassis, Chassis :: pid(), sensed, sense()}.

%% Opens the connection. The process that calls it gets the messages of ports and sockets.
-callback open(config()) -> {ok, State :: term()} | {error, unicode:chardata()}.
%% Carries out a script in place of the present one ({@link starl_platform}), unless it would begin
%% after this time, by the robot's clock: see {@link is_late/3}.
-callback drive(starl_chassis:script(), UntilUs :: integer(), Mark :: term(), State) ->
    {[output()], State}
when
    State :: term().
%% Sets another actuator, and answers if there is a mark.
-callback actuate(Device :: atom(), Value :: term(), {mark, Mark :: term()} | none, State) ->
    {[output()], State}
when
    State :: term().
%% Everything comes to rest; no script is answered any more.
-callback stop(State) -> State when State :: term().
%% Handles a message of the process.
-callback hear(Message :: term(), State) ->
    {[output()], State} | {stop, Why} | unknown
when
    State :: term(), Why :: unicode:chardata().
%% The robot's application is done: it may sleep, and charge. A later script wakes it.
-callback rest(State) -> State when State :: term().
%% Somebody wants to know where the body is: the driver reports it soon (`posed').
-callback look(State) -> State when State :: term().
%% The state of the chassis, for people.
-callback condition(State :: term()) -> map().
%% What a sense of the chassis' own says now ({@link starl_sense}).
-callback feel(starl_sense:kind(), State :: term()) -> starl_live_sense:felt().
-optional_callbacks([rest/1, condition/1, look/1, feel/2]).
%% Closes the connection.
-callback close(State :: term()) -> ok.

%% Whoever asks has no more time, and the chassis may be held up by its connection.
-define(CONDITION_MS, 1000).

-record(chassis, {
    module :: module(),
    state :: term(),
    link :: pid(),
    clock :: starl_live_clock:t()
}).

%% @doc Opens the chassis of a robot; answers go to the link.
-spec start_link(module(), config(), Link :: pid()) -> gen_server:start_ret().
start_link(Module, Config, Link) -> gen_server:start_link(?MODULE, {Module, Config, Link}, []).

%% @doc Gives the chassis a script in place of the present one, to begin by this time at the latest.
-spec drive(pid(), starl_chassis:script(), UntilUs :: integer(), Mark :: term()) -> ok.
drive(Chassis, Script, Until, Mark) -> gen_server:cast(Chassis, {drive, Script, Until, Mark}).

%% @doc Is it too late to begin a script? A script is driven under a lease that may have ended
%% meanwhile: a computer that stalled must not begin it afterwards. The robot treats a script
%% without an answer as lost. It is never too late to stop.
-spec is_late(starl_chassis:script(), UntilUs :: integer(), NowUs :: integer()) -> boolean().
is_late({_Chassis, []}, _Until, _Now) -> false;
is_late(_Script, Until, Now) -> Now > Until.

%% @doc Sets another actuator.
-spec actuate(pid(), Device :: atom(), Value :: term(), {mark, term()} | none) -> ok.
actuate(Chassis, Device, Value, Mark) -> gen_server:cast(Chassis, {actuate, Device, Value, Mark}).

%% @doc Brings everything to rest.
-spec stop(pid()) -> ok.
stop(Chassis) -> gen_server:cast(Chassis, stop).

%% @doc The robot's application is done, and nothing more is to be driven for now.
-spec rest(pid()) -> ok.
rest(Chassis) -> gen_server:cast(Chassis, rest).

%% @doc The state of the chassis; empty if it has nothing to report. Exits if the chassis does not
%% answer in a second.
-spec condition(pid()) -> map().
condition(Chassis) -> gen_server:call(Chassis, condition, ?CONDITION_MS).

%% @doc Asks what a sense of the chassis says; the link gets `{starl_felt, Chassis, Mark, Felt}'
%% ({@link starl_live_sense:felt()}).
-spec feel(pid(), starl_sense:kind(), Mark :: term()) -> ok.
feel(Chassis, Kind, Mark) -> gen_server:cast(Chassis, {feel, Kind, Mark}).

-spec init({module(), config(), pid()}) -> {ok, #chassis{}} | {stop, term()}.
init({Module, #{robot := Robot, clock := Clock} = Config, Link}) ->
    process_flag(trap_exit, true),
    logger:set_process_metadata(#{domain => [starl, robot], robot => Robot}),
    case Module:open(Config) of
        {ok, State} -> {ok, #chassis{module = Module, state = State, link = Link, clock = Clock}};
        {error, Why} -> {stop, {shutdown, {chassis, unicode:characters_to_binary(Why)}}}
    end.

-spec handle_call(term(), gen_server:from(), #chassis{}) -> {reply, ok | map(), #chassis{}}.
handle_call(condition, _From, #chassis{module = Module, state = State} = Chassis) ->
    {reply, starl_callback:call(Module, condition, [State], #{}), Chassis};
handle_call(_Question, _From, Chassis) ->
    {reply, ok, Chassis}.

-spec handle_cast(
    {drive, starl_chassis:script(), integer(), term()}
    | {actuate, atom(), term(), term()}
    | {feel, starl_sense:kind(), term()}
    | stop
    | rest,
    #chassis{}
) -> {noreply, #chassis{}}.
handle_cast({drive, Script, Until, Mark}, #chassis{module = Module, state = State} = Chassis) ->
    case is_late(Script, Until, starl_live_clock:now_us(Chassis#chassis.clock)) of
        true ->
            logger:warning(#{what => late_command, until_us => Until}),
            {noreply, Chassis};
        false ->
            {noreply, said(Module:drive(Script, Until, Mark, State), Chassis)}
    end;
handle_cast({actuate, Device, Value, Mark}, #chassis{module = Module, state = State} = Chassis) ->
    {noreply, said(Module:actuate(Device, Value, Mark, State), Chassis)};
handle_cast({feel, Kind, Mark}, #chassis{module = Module, state = State, link = Link} = Chassis) ->
    Felt = starl_callback:call(Module, feel, [Kind, State], unknown),
    Link ! {starl_felt, self(), Mark, Felt},
    {noreply, Chassis};
handle_cast(rest, #chassis{module = Module, state = State} = Chassis) ->
    {noreply, Chassis#chassis{state = starl_callback:call(Module, rest, [State], State)}};
handle_cast(stop, #chassis{module = Module, state = State} = Chassis) ->
    {noreply, Chassis#chassis{state = Module:stop(State)}}.

-spec handle_info(term(), #chassis{}) -> {noreply, #chassis{}} | {stop, term(), #chassis{}}.
handle_info({'EXIT', Link, Reason}, #chassis{link = Link} = Chassis) ->
    {stop, Reason, Chassis};
handle_info(Message, #chassis{module = Module, state = State} = Chassis) ->
    case Module:hear(Message, State) of
        unknown -> {noreply, Chassis};
        {stop, Why} -> failed(unicode:characters_to_binary(Why), Chassis);
        Heard -> {noreply, said(Heard, Chassis)}
    end.

%% The link ends with it, and the robot starts anew.
failed(Why, Chassis) ->
    Report = #{what => chassis_failed, why => Why},
    logger:error(Report, #{report_cb => fun(#{why := W}) -> {"~ts; the robot starts anew", [W]} end}),
    {stop, {shutdown, {chassis, Why}}, Chassis}.

-spec terminate(term(), #chassis{}) -> ok.
terminate(_Reason, #chassis{module = Module, state = State}) ->
    Module:close(Module:stop(State)).

said({Answers, State}, #chassis{link = Link} = Chassis) ->
    _ = [Link ! {starl_chassis, self(), Mark, Answer} || {Mark, Answer} <- Answers],
    Chassis#chassis{state = State}.
