%% @doc The positioning system as a live robot sees it: a behaviour for the sources of positions, and
%% the process that keeps their latest picture.
%%
%% A source shows robots at its own pace. A question is answered with the next picture that shows the
%% robot itself, since an earlier one would show it where it was before it asked ({@link
%% starl_location}); other robots are shown as they were seen last, with their age. A source that is
%% silent answers nothing: the location service asks again.
%% ```
%%     link -- ask(Positioning, Tag, Robots) --> positioning <-- datagrams of the source
%%     link <-- {starl_located, Positioning, Tag, [{Robot, Pose, AgeUs}]} -- positioning
%% '''
-module(starl_live_positioning).
-behaviour(gen_server).

-export([start_link/3, ask/3, figures/1]).
-export([init/1, handle_call/3, handle_cast/2, handle_info/2, terminate/2]).

-export_type([config/0, sighting/0, figures/0, located/0]).

%% What every source is told; each has further keys of its own. `names' are the robots' names in the
%% source, where it uses names.
-type config() :: #{
    robot := starl:robot_id(),
    participants := starl_team:t(),
    clock := starl_live_clock:t(),
    names => #{binary() => starl:robot_id()},
    atom() => term()
}.

%% A robot's pose, and the time at which it was there by the clock of this computer.
-type sighting() :: {starl:robot_id(), starl:pose(), TakenUs :: integer()}.

%% Counters: pictures, and datagrams that were refused, by reason.
-type figures() :: #{atom() => non_neg_integer()}.

%% The answer to a question.
-type located() ::
    {starl_located, Positioning :: pid(), Tag :: term(), [
        {starl:robot_id(), starl:pose(), AgeUs :: non_neg_integer()}
    ]}.

%% The questions that may be open; beyond that the oldest is forgotten.
-define(OPEN, 1000).

%% Opens the source. The process that calls it gets the messages of sockets.
-callback open(config()) -> {ok, State :: term()} | {error, unicode:chardata()}.
%% Handles a message of the process: the robots that it shows.
-callback hear(Message :: term(), State) -> {[sighting()], State} | unknown when State :: term().
%% Asks the source for a picture, where it shows nothing by itself.
-callback ask([starl:robot_id()], State) -> State when State :: term().
%% Its counters.
-callback figures(State :: term()) -> figures().
%% Closes the source.
-callback close(State :: term()) -> ok.
-optional_callbacks([ask/2]).

-record(positioning, {
    module :: module(),
    state :: term(),
    link :: pid(),
    robot :: starl:robot_id(),
    clock :: starl_live_clock:t(),
    %% the latest sighting of each robot
    seen = #{} :: #{starl:robot_id() => {starl:pose(), TakenUs :: integer()}},
    %% open questions, newest first
    asked = [] :: [{Tag :: term(), [starl:robot_id()]}]
}).

%% @doc Opens a source for a robot; answers go to the link.
-spec start_link(module(), config(), Link :: pid()) -> gen_server:start_ret().
start_link(Module, Config, Link) -> gen_server:start_link(?MODULE, {Module, Config, Link}, []).

%% @doc Asks where robots are; answered by the message {@link located()}.
-spec ask(pid(), Tag :: term(), [starl:robot_id()]) -> ok.
ask(Positioning, Tag, Robots) -> gen_server:cast(Positioning, {ask, Tag, Robots}).

%% @doc The source's counters.
-spec figures(pid()) -> figures().
figures(Positioning) -> gen_server:call(Positioning, figures).

-spec init({module(), config(), pid()}) -> {ok, #positioning{}} | {stop, term()}.
init({Module, #{robot := Robot, clock := Clock} = Config, Link}) ->
    process_flag(trap_exit, true),
    logger:set_process_metadata(#{domain => [starl, robot], robot => Robot}),
    case Module:open(Config) of
        {ok, State} ->
            {ok, #positioning{
                module = Module, state = State, link = Link, robot = Robot, clock = Clock
            }};
        {error, Why} ->
            {stop, {shutdown, {positioning, unicode:characters_to_binary(Why)}}}
    end.

-spec handle_call(figures, gen_server:from(), #positioning{}) ->
    {reply, figures(), #positioning{}}.
handle_call(figures, _From, #positioning{module = Module, state = State} = Positioning) ->
    {reply, Module:figures(State), Positioning}.

-spec handle_cast({ask, term(), [starl:robot_id()]}, #positioning{}) -> {noreply, #positioning{}}.
handle_cast({ask, Tag, Robots}, #positioning{asked = Asked} = Positioning) ->
    Open = lists:sublist([{Tag, Robots} | Asked], ?OPEN),
    {noreply, wanted(Robots, Positioning#positioning{asked = Open})}.

wanted(Robots, #positioning{module = Module, state = State} = Positioning) ->
    case erlang:function_exported(Module, ask, 2) of
        true -> Positioning#positioning{state = Module:ask(Robots, State)};
        false -> Positioning
    end.

-spec handle_info(term(), #positioning{}) ->
    {noreply, #positioning{}} | {stop, term(), #positioning{}}.
handle_info({'EXIT', _From, Reason}, Positioning) ->
    {stop, Reason, Positioning};
handle_info(Message, #positioning{module = Module, state = State} = Positioning) ->
    case Module:hear(Message, State) of
        {Sightings, Next} ->
            {noreply, shown(Sightings, Positioning#positioning{state = Next})};
        unknown ->
            {noreply, Positioning}
    end.

-spec terminate(term(), #positioning{}) -> ok.
terminate(_Reason, #positioning{module = Module, state = State}) -> Module:close(State).

shown(Sightings, #positioning{seen = Seen, robot = Self} = Positioning) ->
    Latest = lists:foldl(fun see/2, Seen, Sightings),
    Known = Positioning#positioning{seen = Latest},
    case lists:keymember(Self, 1, Sightings) of
        true -> answer(Known);
        false -> Known
    end.

%% Datagrams may overtake each other.
see({Robot, Pose, Taken}, Seen) ->
    case Seen of
        #{Robot := {_, Later}} when Later > Taken -> Seen;
        #{} -> Seen#{Robot => {Pose, Taken}}
    end.

answer(#positioning{asked = Asked, clock = Clock, link = Link, seen = Seen} = Positioning) ->
    Now = starl_live_clock:now_us(Clock),
    lists:foreach(
        fun({Tag, Robots}) -> Link ! {starl_located, self(), Tag, picture(Robots, Now, Seen)} end,
        lists:reverse(Asked)
    ),
    Positioning#positioning{asked = []}.

picture(Robots, Now, Seen) ->
    [
        {Robot, Pose, max(0, Now - Taken)}
     || Robot <- Robots, #{Robot := {Pose, Taken}} <- [Seen]
    ].
