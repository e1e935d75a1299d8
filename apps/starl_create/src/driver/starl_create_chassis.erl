%% @doc The chassis of a live robot that is an iRobot Create: runs {@link starl_create_driver} with
%% a port and real time.
%%
%% Its configuration, besides that of every chassis: `create', the driver's options
%% ({@link starl_create_options:configured/1}); `port', the module that opens the line and its
%% options, by default {@link starl_create_port} ({@link starl_create_pipe} has the same messages);
%% `events': a process that gets all reports of the driver to an observer, as `{starl_create, Robot,
%% Event}'.
-module(starl_create_chassis).
-behaviour(starl_live_chassis).

-export([open/1, drive/4, actuate/4, stop/1, hear/2, close/1, rest/1, condition/1, feel/2]).

-record(chassis, {
    robot :: starl:robot_id(),
    clock :: starl_live_clock:t(),
    port :: pid(),
    driver :: starl_create_driver:t(),
    events :: pid() | none,
    timers = #{} :: #{atom() => {reference(), DueMs :: integer()}}
}).

-spec open(map()) -> {ok, #chassis{}} | {error, unicode:chardata()}.
open(#{create := Given} = Config) ->
    case starl_create_options:configured(Given) of
        {ok, Options} -> opened(Options, Config);
        {error, Reason} -> {error, ["the Create: ", starl_create_options:format_error(Reason)]}
    end.

opened(Create, #{robot := Robot, clock := Clock} = Config) ->
    {Module, Options} = maps:get(port, Config, {starl_create_port, #{}}),
    case Module:start_link(self(), Options) of
        {ok, Port} ->
            {Actions, Driver} = starl_create_driver:open(Create),
            Chassis = #chassis{
                robot = Robot,
                clock = Clock,
                port = Port,
                driver = Driver,
                events = maps:get(events, Config, none)
            },
            {[], Opened} = done(Actions, Chassis),
            {ok, Opened};
        {error, Reason} ->
            {error, io_lib:format("the port of the Create: ~0tp", [Reason])}
    end.

-spec drive(starl_chassis:script(), integer(), Mark, #chassis{}) ->
    {[{Mark, starl_live_chassis:answer()} | {sensed, starl_live_chassis:sense()}], #chassis{}}
when
    Mark :: term().
drive({starl_chassis_differential, Commands}, _Until, Mark, #chassis{driver = Driver} = Chassis) ->
    went(starl_create_driver:drive(Commands, Mark, Driver), Chassis);
drive({_Other, Commands}, _Until, Mark, Chassis) ->
    {[{Mark, {not_understood, Commands}}], Chassis}.

-spec actuate(atom(), term(), {mark, Mark} | none, #chassis{}) ->
    {[{Mark, starl_live_chassis:answer()} | {sensed, starl_live_chassis:sense()}], #chassis{}}
when
    Mark :: term().
actuate(Device, Value, Mark, #chassis{driver = Driver} = Chassis) ->
    went(starl_create_driver:actuate(Device, Value, Mark, Driver), Chassis).

-spec stop(#chassis{}) -> #chassis{}.
stop(#chassis{driver = Driver} = Chassis) ->
    {[], Stopped} = went(starl_create_driver:stop(Driver), Chassis),
    Stopped.

-spec hear(term(), #chassis{}) ->
    {
        [{Mark :: term(), starl_live_chassis:answer()} | {sensed, starl_live_chassis:sense()}],
        #chassis{}
    }
    | {stop, unicode:chardata()}
    | unknown.
hear({'EXIT', Port, Reason}, #chassis{port = Port}) ->
    {stop, io_lib:format("the port of the Create has ended: ~0tp", [Reason])};
hear({timeout, Ref, Timer}, #chassis{timers = Timers} = Chassis) ->
    case Timers of
        #{Timer := {Ref, Due}} -> timed_out(Timer, Due, Chassis);
        #{} -> {[], Chassis}
    end;
hear(Message, #chassis{clock = Clock} = Chassis) ->
    case starl_create_word:is_message(Message) of
        plain ->
            told(Message, Chassis);
        timed ->
            {Word, Ref, At} = Message,
            System = At + erlang:time_offset(microsecond),
            told({Word, Ref, starl_live_clock:at_us(System, Clock)}, Chassis);
        false ->
            unknown
    end.

%% A computer that is busy learns it by its own timers.
timed_out(Timer, Due, Chassis) ->
    Behind = 1000 * max(1, erlang:monotonic_time(millisecond) - Due),
    {[], Next} = told({behind, Behind}, Chassis),
    told({timeout, Timer}, Next).

told(Message, #chassis{driver = Driver, clock = Clock} = Chassis) ->
    Now = starl_live_clock:now_us(Clock),
    went(starl_create_driver:hear(Message, Now, Driver), Chassis).

-spec rest(#chassis{}) -> #chassis{}.
rest(#chassis{driver = Driver} = Chassis) ->
    {[], Rests} = went(starl_create_driver:rest(Driver), Chassis),
    Rests.

-spec condition(#chassis{}) -> starl_create_driver:condition().
condition(#chassis{driver = Driver}) -> starl_create_driver:condition(Driver).

%% The bumper and the battery, as the last frame of the stream tells.
-spec feel(starl_sense:kind(), #chassis{}) -> starl_live_sense:felt().
feel(Kind, #chassis{driver = Driver}) when Kind =:= bump; Kind =:= battery ->
    case starl_create_driver:condition(Driver) of
        #{control := false} -> none;
        Condition -> felt(Kind, Condition)
    end;
feel(_Kind, #chassis{}) ->
    unknown.

felt(bump, #{senses := Senses}) ->
    case lists:keyfind(bump, 1, Senses) of
        {bump, Side} -> {ok, Side};
        false -> none
    end;
felt(battery, #{charge := unknown}) ->
    none;
felt(battery, #{charge := Percent}) ->
    {ok, Percent / 100}.

-spec close(#chassis{}) -> ok.
close(#chassis{driver = Driver} = Chassis) ->
    {[], _} = done(starl_create_driver:close(Driver), Chassis),
    ok.

went({Actions, Driver}, Chassis) -> done(Actions, Chassis#chassis{driver = Driver}).

done(Actions, Chassis) ->
    {Answers, Next} = lists:mapfoldl(fun act/2, Chassis, Actions),
    {lists:append(Answers), Next}.

act({port, Word}, #chassis{port = Port} = Chassis) ->
    Port ! Word,
    {[], Chassis};
act({timer, Name, Ms}, #chassis{timers = Timers} = Chassis) ->
    _ = [erlang:cancel_timer(Old) || #{Name := {Old, _}} <- [Timers]],
    Due = erlang:monotonic_time(millisecond) + Ms,
    Ref = erlang:start_timer(Due, self(), Name, [{abs, true}]),
    {[], Chassis#chassis{timers = Timers#{Name => {Ref, Due}}}};
act({answer, Mark, Answer}, Chassis) ->
    {[{Mark, Answer}], Chassis};
act({event, Event}, #chassis{robot = Robot, events = Events} = Chassis) ->
    _ = is_pid(Events) andalso (Events ! {starl_create, Robot, Event}),
    logger:info(#{what => create_event, event => Event}),
    {[{sensed, Event} || is_tuple(Event)], Chassis};
act({say, Level, Line}, Chassis) ->
    Why = unicode:characters_to_binary(Line),
    logger:log(Level, #{what => create, why => Why}, #{report_cb => fun words/1}),
    {[], Chassis}.

%% In a log, where the robot's number stands before it.
words(#{why := Why}) -> {"its Create: ~ts", [Why]}.
