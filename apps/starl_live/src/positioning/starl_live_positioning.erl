%% @doc The behaviour of sources of positions for a live robot, and the process that keeps their
%% latest picture.
%%
%% A source shows robots at its own pace. A question is answered with the first picture that shows
%% the robot itself at the time of the question, or later ({@link starl_location}). For other robots
%% the answer has the last pose seen, with its age. {@link starl_live_poses} decides which poses are
%% believed. Its options are `exact', `speed', `turn', `jump_mm', `jump_rad', `believe_us' and
%% `placing'. It checks for sources that are stuck, so the location service of a live robot gets
%% `exact' positioning.
%%
%% A silent source answers nothing: the location service asks again. If the robot has not been seen
%% for two seconds, one line in the log reports this, with the counters, which show why. A robot
%% does not know its place before it stands well (`placing'); a line of the log says why it does
%% not.
%% ```
%%     link -- ask(Positioning, Tag, Robots) --> positioning <-- datagrams of the source
%%     link <-- {starl_located, Positioning, Tag, [{Robot, Pose, AgeUs}]} -- positioning
%% '''
-module(starl_live_positioning).
-behaviour(gen_server).

-export([start_link/3, ask/3, figures/1]).
-export([init/1, handle_call/3, handle_cast/2, handle_info/2, terminate/2]).

-export_type([config/0, sighting/0, figures/0, located/0]).

%% What every source gets; each has further keys of its own.
-type config() :: #{
    robot := starl:robot_id(),
    participants := starl_team:t(),
    clock := starl_live_clock:t(),
    atom() => term()
}.

%% A robot's pose, and the time at which it was there by the clock of this computer.
-type sighting() :: {starl:robot_id(), starl:pose(), TakenUs :: integer()}.

%% Counters: pictures, and datagrams that were refused, by reason.
-type figures() :: #{atom() => non_neg_integer()}.

%% The answer to a question.
-type located() ::
    {starl_located, Positioning :: pid(), Tag :: term(), starl_live_poses:picture()}.

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
    clock :: starl_live_clock:t(),
    seen :: starl_live_poses:t()
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
    case opened(Module, Config) of
        {ok, State} ->
            Seen = starl_live_poses:new(Config, starl_live_clock:now_us(Clock)),
            {ok, #positioning{
                module = Module, state = State, link = Link, clock = Clock, seen = Seen
            }};
        {error, Why} ->
            {stop, {shutdown, {positioning, unicode:characters_to_binary(Why)}}}
    end.

opened(Module, Config) ->
    case starl_live_poses:options(Config) of
        ok -> Module:open(Config);
        {error, _} = Error -> Error
    end.

-spec handle_call(figures, gen_server:from(), #positioning{}) ->
    {reply, figures(), #positioning{}}.
handle_call(figures, _From, Positioning) ->
    {reply, counters(Positioning), Positioning}.

counters(#positioning{module = Module, state = State, seen = Seen}) ->
    maps:merge(Module:figures(State), starl_live_poses:figures(Seen)).

-spec handle_cast({ask, term(), [starl:robot_id()]}, #positioning{}) -> {noreply, #positioning{}}.
handle_cast({ask, Tag, Robots}, #positioning{clock = Clock, seen = Seen} = Positioning) ->
    Now = starl_live_clock:now_us(Clock),
    {Events, Asked} = starl_live_poses:silence(Now, starl_live_poses:ask(Tag, Robots, Now, Seen)),
    say(Events, Positioning),
    Wanted = starl_live_poses:wanted(Robots, Asked),
    {noreply, wanted(Wanted, Positioning#positioning{seen = Asked})}.

wanted(Robots, #positioning{module = Module, state = State} = Positioning) ->
    Positioning#positioning{state = starl_callback:call(Module, ask, [Robots, State], State)}.

-spec handle_info(term(), #positioning{}) ->
    {noreply, #positioning{}} | {stop, term(), #positioning{}}.
handle_info({'EXIT', _From, Reason}, Positioning) ->
    {stop, Reason, Positioning};
handle_info(Message, #positioning{module = Module, state = State} = Positioning) ->
    case Module:hear(Message, State) of
        {[], Next} -> {noreply, Positioning#positioning{state = Next}};
        {Sightings, Next} -> {noreply, shown(Sightings, Positioning#positioning{state = Next})};
        unknown -> {noreply, Positioning}
    end.

-spec terminate(term(), #positioning{}) -> ok.
terminate(_Reason, #positioning{module = Module, state = State}) -> Module:close(State).

shown(Sightings, #positioning{clock = Clock, link = Link, seen = Seen} = Positioning) ->
    Now = starl_live_clock:now_us(Clock),
    {Answers, Events, Known} = starl_live_poses:show(Sightings, Now, Seen),
    lists:foreach(
        fun({Tag, Picture}) -> Link ! {starl_located, self(), Tag, Picture} end, Answers
    ),
    say(Events, Positioning),
    Positioning#positioning{seen = Known}.

say(Events, Positioning) -> lists:foreach(fun(Event) -> say_one(Event, Positioning) end, Events).

say_one(#{what := badly_placed} = Event, _Positioning) ->
    logger:error(Event, #{report_cb => fun words/1});
say_one(#{what := well_placed} = Event, _Positioning) ->
    logger:notice(Event, #{report_cb => fun words/1});
say_one(Event, Positioning) ->
    logger:warning(Event#{figures => counters(Positioning)}).

words(#{what := badly_placed, why := Line}) -> {"~ts", [Line]};
words(#{what := well_placed}) -> {"it stands well now, and may drive", []}.
