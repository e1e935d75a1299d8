%% @doc Drives a Create: takes control of the robot behind a port, has scripts carried out, and watches
%% its sensors. A pure module: messages of the port and time-outs in, actions out.
%% ```
%%              opened            frames              mode
%%     closed ---------> greeting --------> taking ----------> ready
%%       ^                  ^                 ^                 |  |
%%       |                  |                 +-- left the mode +  |
%%       |                  +--------- no frames for 250 ms -------+
%%       +------- the cable is pulled, in every state
%% '''
%% A robot that rests is in mode Passive, where it sleeps and charges. For a script, the driver
%% takes control again.
%%
%% Its parts: {@link starl_create_greeting} finds and wakes the robot; {@link starl_create_senses}
%% sees events and stalls in the frames; {@link starl_create_odometry} counts;
%% {@link starl_create_drive} carries out scripts. The mode in which the robot is after Start shows
%% whether it counts its modes from 1 or higher.
-module(starl_create_driver).

-export([open/1, drive/3, actuate/4, stop/1, rest/1, close/1, hear/3]).
-export([is_ready/1, odometry/1, condition/1]).

-export_type([t/0, action/0, event/0, condition/0]).

%% What to do: tell the port; start a timer in place of the one of that name; answer a command; tell
%% an observer; write a line.
-type action() ::
    {port, starl_create_word:command()}
    | {timer, starl_create_word:timer(), Ms :: non_neg_integer()}
    | {answer, Mark :: term(), starl_live_chassis:answer()}
    | {event, event()}
    | {say, notice | warning, unicode:chardata()}.

-type event() :: ready | lost | starl_create_senses:event().

%% How the robot is: what the sensors have shown last; `charge' in percent; `priority' of the port
%% program; whether it is under control.
-type condition() :: #{
    control := boolean(),
    charge := 0..100 | unknown,
    priority := starl_create_port:priority() | unknown,
    senses := [starl_create_senses:event()]
}.

-record(driver, {
    options :: starl_create_options:t(),
    model :: starl_create_packet:model(),
    phase = closed :: closed | greeting | taking | ready | resting | leaving,
    %% it is to rest as soon as it is there
    rests = false :: boolean(),
    greeting :: starl_create_greeting:t(),
    said = starl_create_advice:new() :: starl_create_advice:memory(),
    now = 0 :: integer(),
    priority = unknown :: starl_create_port:priority() | unknown,
    parser :: starl_create_stream:t(),
    %% has a time without frames been noticed?
    is_silent = false :: boolean(),
    %% of the robot's modes against the document's
    offset = 0 :: integer(),
    drive :: starl_create_drive:t(),
    %% what it was told last
    pen = up :: starl_create_instructions:position(),
    senses = starl_create_senses:new() :: starl_create_senses:t(),
    odometry :: starl_create_odometry:t()
}).

-opaque t() :: #driver{}.

%% A line that could not be opened is tried again.
-define(REOPEN_MS, 1000).
-define(MODE_MS, 300).
-define(LATER_MS, 1000).
-define(SILENCE_MS, 150).
-define(DOUBT_MS, 100).
-define(ODOMETRY_MS, 200).
%% A robot that leaves its dock is taken afterwards.
-define(LEAVE_MS, 4000).
-define(LEAVE_REF, 0).
%% The heartbeat of the port.
-define(HALTED_US, 250000).

%% @doc A driver that opens its port.
-spec open(starl_create_options:t()) -> {[action()], t()}.
open(#{model := Model} = Options) ->
    Greeting = starl_create_greeting:new(Options),
    Driver = #driver{
        options = Options,
        model = Model,
        greeting = Greeting,
        parser = parser(Model),
        drive = starl_create_drive:new(Options),
        odometry = starl_create_odometry:new(Options)
    },
    {[{port, starl_create_greeting:opening(Greeting)}], Driver}.

parser(Model) -> starl_create_stream:new(starl_create_greeting:ids(Model), Model).

%% @doc Does it have control of its robot?
-spec is_ready(t()) -> boolean().
is_ready(#driver{phase = Phase}) -> Phase =:= ready.

%% What the sensors have shown last.
-spec readings(t()) -> starl_create_packet:readings().
readings(#driver{senses = Senses}) -> starl_create_senses:readings(Senses).

%% @doc The way (mm) and the turn (rad) since it was opened, as the robot counts them. A Create 1
%% knows its turns to a degree each 0.2 s only.
-spec odometry(t()) -> {Mm :: float(), Radians :: float()}.
odometry(#driver{odometry = Odometry}) -> starl_create_odometry:total(Odometry).

%% @doc How the robot is.
-spec condition(t()) -> condition().
condition(#driver{senses = Senses, priority = Priority} = Driver) ->
    #{
        control => is_ready(Driver),
        charge => starl_create_senses:battery_percent(Senses),
        priority => Priority,
        senses => starl_create_senses:state(Senses)
    }.

%% -- commands -------------------------------------------------------------------------------

%% @doc Runs a script in place of the present one. A robot that is not under control does not get
%% it.
-spec drive(starl_chassis_differential:commands(), Mark :: term(), t()) -> {[action()], t()}.
drive(Commands, Mark, #driver{phase = ready, drive = Drive} = Driver) ->
    drives(starl_create_drive:drive(Commands, Mark, Drive), Driver);
drive([_ | _], _Mark, #driver{rests = true} = Driver) ->
    wake(forget(Driver));
drive(_Commands, _Mark, Driver) ->
    {[], forget(Driver)}.

%% It may be asleep by now.
wake(#driver{phase = resting, is_silent = false} = Driver) ->
    (take(?MODE_MS))(Driver#driver{rests = false});
wake(#driver{phase = resting} = Driver) ->
    greet(Driver#driver{rests = false});
wake(Driver) ->
    {[], Driver#driver{rests = false}}.

drives({Actions, Drive}, Driver) -> told(Actions, Driver#driver{drive = Drive}).

forget(#driver{drive = Drive} = Driver) ->
    Driver#driver{drive = starl_create_drive:forget(Drive)}.

%% @doc Sets the pen. The robot cannot confirm its outputs, so the answer comes as soon as it is
%% known to listen.
-spec actuate(Device :: atom(), Value :: term(), {mark, term()} | none, t()) -> {[action()], t()}.
actuate(pen, Value, Mark, #driver{phase = ready} = Driver) when Value =:= up; Value =:= down ->
    Answer = [{answer, M, {actuated, pen, Value}} || {mark, M} <- [Mark]],
    Word = {send, starl_create_instructions:pen(Value, Driver#driver.options)},
    {[{port, Word} | Answer], Driver#driver{pen = Value}};
actuate(dock, seek, _Mark, #driver{phase = ready, options = Options} = Driver) ->
    rested(starl_create_instructions:seek_dock(Options), Driver);
actuate(dock, leave, _Mark, #driver{phase = Phase, options = Options} = Driver) when
    Phase =:= resting; Phase =:= taking
->
    {Begin, Us, End} = starl_create_instructions:leave_dock(Options),
    Leave = {drive_script, ?LEAVE_REF, [{Begin, Us}], End},
    {[{port, Leave}, {timer, step, ?LEAVE_MS}], Driver#driver{phase = leaving, rests = false}};
actuate(Device, Value, _Mark, #driver{phase = ready, options = Options} = Driver) ->
    case starl_create_instructions:signal(Device, Value, Driver#driver.pen, Options) of
        {ok, Bytes} -> {[{port, {send, Bytes}}], Driver};
        none -> {[], Driver}
    end;
actuate(_Device, _Value, _Mark, Driver) ->
    {[], Driver}.

%% @doc Everything comes to rest.
-spec stop(t()) -> {[action()], t()}.
stop(#driver{phase = closed} = Driver) -> {[], (forget(Driver))#driver{pen = up}};
stop(Driver) -> stand(Driver#driver{pen = up}).

%% The pen as it was told, that is: a line is gone for a moment, and the robot goes on where it stood.
stand(#driver{drive = Drive, pen = Pen} = Driver) ->
    drives(starl_create_drive:stop(Pen, Drive), Driver).

%% @doc There is nothing more to drive for now: it stands, and goes to mode Passive.
-spec rest(t()) -> {[action()], t()}.
rest(#driver{phase = ready, options = Options} = Driver) ->
    {Actions, Stopped} = stop(Driver),
    {More, Rests} = rested(starl_create_instructions:passive(Options), Stopped),
    {Actions ++ More, Rests};
rest(Driver) ->
    {[], Driver#driver{rests = true}}.

%% It is left to itself.
rested(Bytes, Driver) ->
    in_turn([do({port, {send, Bytes}}), lose(resting)], Driver#driver{rests = true}).

%% @doc The last words: the robot stands, and goes to rest.
-spec close(t()) -> [action()].
close(#driver{phase = closed}) ->
    [{port, close}];
close(#driver{options = Options}) ->
    [{port, {send, starl_create_instructions:off(Options)}}, {port, close}].

%% -- messages of the port -------------------------------------------------------------------

%% @doc Handles a message.
-spec hear(starl_create_word:message(), NowUs :: integer(), t()) -> {[action()], t()}.
hear(Message, Now, Driver) -> heard_at(Message, Now, Driver#driver{now = Now}).

heard_at({opened, _Device}, _Now, Driver) ->
    greet(Driver);
heard_at({priority, Priority}, _Now, Driver) ->
    Lines = [{say, notice, starl_create_advice:line(ordinary_priority)} || Priority =/= realtime],
    {Lines, Driver#driver{priority = Priority}};
heard_at({behind, Us}, Now, Driver) ->
    {[], missed(Us, Now, Driver)};
heard_at({data, Bytes}, _Now, #driver{parser = Parser} = Driver) ->
    {Found, Next} = starl_create_stream:parse(Bytes, Parser),
    in_turn([fun(D) -> found(What, D) end || What <- Found], Driver#driver{parser = Next});
heard_at({closed, Reason}, _Now, #driver{greeting = Greeting} = Driver) ->
    Anew = Driver#driver{greeting = starl_create_greeting:anew(Greeting)},
    in_turn([say(warning, {gone, Reason}), lose(closed)], Anew);
heard_at({error, Reason}, _Now, #driver{phase = closed} = Driver) ->
    in_turn([say(warning, {no_line, Reason}), timer(step, ?REOPEN_MS)], Driver);
heard_at({error, Reason}, _Now, Driver) ->
    said(warning, {line_error, Reason}, Driver);
heard_at({timeout, Timer}, _Now, Driver) ->
    due(Timer, Driver);
heard_at({stopped, guardian, _At} = Stopped, _Now, Driver) ->
    halted(Stopped, Driver);
heard_at({stopped, _Why, _At} = Stopped, Now, Driver) ->
    halted(Stopped, missed(?HALTED_US, Now, Driver));
heard_at(OfScript, _Now, #driver{senses = Senses, drive = Drive} = Driver) ->
    drives(starl_create_drive:hear(OfScript, Senses, Drive), Driver).

%% The stop bytes have raised the pen, too.
halted(Stopped, #driver{senses = Senses, drive = Drive} = Driver) ->
    {Actions, Next} = drives(starl_create_drive:hear(Stopped, Senses, Drive), Driver),
    Pen = starl_create_instructions:pen(Driver#driver.pen, Driver#driver.options),
    {[{port, {send, Pen}} || Driver#driver.phase =:= ready] ++ Actions, Next}.

missed(Us, Now, #driver{said = Said} = Driver) ->
    Driver#driver{said = starl_create_advice:late(Us, Now, Said)}.

%% The actions of the driver's parts.
told(Actions, Driver) -> in_turn([tell(Action) || Action <- Actions], Driver).

tell({say, Level, Advice}) -> say(Level, Advice);
tell(Action) -> do(Action).

in_turn(Steps, Driver) ->
    {Actions, Next} = lists:mapfoldl(fun(Step, Before) -> Step(Before) end, Driver, Steps),
    {lists:append(Actions), Next}.

do(Action) -> fun(Driver) -> {[Action], Driver} end.

timer(Name, Ms) -> do({timer, Name, Ms}).

%% It is said once, until things are well again.
say(Level, Advice) -> fun(Driver) -> said(Level, Advice, Driver) end.

said(Level, Advice, #driver{said = Before, now = Now} = Driver) ->
    {Lines, Said} = starl_create_advice:say(Advice, Now, Before),
    {[{say, Level, Line} || Line <- Lines], Driver#driver{said = Said}}.

%% It has no control any more.
lose(Next) ->
    fun(#driver{phase = Phase} = Driver) ->
        {[{event, lost} || Phase =:= ready], (forget(Driver))#driver{phase = Next}}
    end.

%% -- time-outs ------------------------------------------------------------------------------

due(step, Driver) ->
    step_due(Driver);
%% If the computer itself stood still, the frames are there in a moment.
due(silence, #driver{is_silent = false} = Driver) ->
    {[{timer, silence, ?DOUBT_MS}], Driver#driver{is_silent = true}};
due(silence, #driver{phase = Phase} = Driver) when
    Phase =:= ready; Phase =:= taking; Phase =:= leaving
->
    in_turn([say(warning, silent), lose(greeting), fun stand/1, fun greet/1], Driver);
due(silence, Driver) ->
    {[], Driver};
due(rest, #driver{senses = Senses, drive = Drive} = Driver) ->
    drives(starl_create_drive:due(Senses, Drive), Driver);
due(odometry, #driver{model = 1, phase = Phase, odometry = Odometry} = Driver) when
    Phase =:= ready; Phase =:= taking
->
    {Ask, Asked} = starl_create_odometry:ask(Odometry),
    Next = Driver#driver{odometry = Asked},
    {[{port, {send, Ask}}, {timer, odometry, ?ODOMETRY_MS}], Next};
due(odometry, Driver) ->
    {[], Driver}.

step_due(#driver{phase = greeting} = Driver) ->
    greeted(starl_create_greeting:due(Driver#driver.greeting), Driver);
step_due(#driver{phase = closed, greeting = Greeting} = Driver) ->
    {[{port, starl_create_greeting:opening(Greeting)}], Driver};
step_due(#driver{phase = taking, senses = Senses} = Driver) ->
    Advice = {no_control, starl_create_senses:unsafe(Senses)},
    in_turn([say(warning, Advice), take(?LATER_MS)], Driver);
step_due(#driver{phase = leaving} = Driver) ->
    (take(?MODE_MS))(Driver);
step_due(Driver) ->
    {[], Driver}.

%% -- greeting -------------------------------------------------------------------------------

greet(#driver{model = Model, greeting = Greeting, odometry = Odometry} = Driver) ->
    Fresh = Driver#driver{
        phase = greeting,
        is_silent = false,
        odometry = starl_create_odometry:forget(Odometry),
        senses = starl_create_senses:new(),
        parser = parser(Model)
    },
    {Actions, Next} = greeted(starl_create_greeting:opened(Greeting), Fresh),
    Resting = starl_create_instructions:resting(Driver#driver.options),
    {[{port, {stop_bytes, Resting}} | Actions], Next}.

greeted({Actions, Greeting}, Driver) -> told(Actions, Driver#driver{greeting = Greeting}).

%% -- what the robot sends -------------------------------------------------------------------

found({noise, Bytes} = Noise, #driver{odometry = Odometry} = Driver) ->
    heard(Noise, Driver#driver{odometry = starl_create_odometry:answer(Bytes, Odometry)});
found({frame, Readings} = Frame, #driver{phase = greeting, senses = Senses} = Driver) ->
    heard(Frame, Driver#driver{senses = starl_create_senses:see(Readings, Senses)});
found({frame, _Readings}, #driver{phase = closed} = Driver) ->
    {[], Driver};
found({frame, Readings}, Driver) ->
    sensed(Readings, Driver).

heard(Found, #driver{phase = greeting, greeting = Greeting} = Driver) ->
    case starl_create_greeting:hear(Found, Greeting) of
        {found, Next} -> is_there(Driver#driver{greeting = Next});
        Heard -> greeted(Heard, Driver)
    end;
heard(_Found, Driver) ->
    {[], Driver}.

is_there(#driver{model = Model} = Driver) ->
    #{mode := Mode} = readings(Driver),
    Ask = [timer(odometry, ?ODOMETRY_MS) || Model =:= 1],
    Begin =
        case Driver#driver.rests of
            true -> lose(resting);
            false -> take(?MODE_MS)
        end,
    Steps = [Begin] ++ Ask ++ [timer(silence, ?SILENCE_MS)],
    in_turn(Steps, Driver#driver{offset = Mode - 1}).

sensed(Readings, #driver{senses = Before, odometry = Odometry, phase = Phase} = Driver) ->
    Senses = starl_create_senses:see(Readings, Before),
    Counted = starl_create_odometry:count(starl_create_senses:readings(Before), Readings, Odometry),
    Told = Phase =:= ready orelse Phase =:= resting,
    Events = [told_event(Event) || Told, Event <- starl_create_senses:events(Senses)],
    Next = Driver#driver{senses = Senses, odometry = Counted, is_silent = false},
    Steps = [timer(silence, ?SILENCE_MS)] ++ Events ++ [fun judged/1],
    in_turn(Steps, Next).

told_event(Event) ->
    fun(#driver{senses = Senses} = Driver) ->
        {[{event, Event} | low(Event, Senses)], Driver}
    end.

low({battery, low}, Senses) ->
    Percent = starl_create_senses:battery_percent(Senses),
    [{say, warning, starl_create_advice:line({low_battery, Percent})}];
low(_Event, _Senses) ->
    [].

%% -- control --------------------------------------------------------------------------------

take(Ms) ->
    fun(#driver{options = Options} = Driver) ->
        Take = {port, {send, starl_create_instructions:take(Options)}},
        {[Take, {timer, step, Ms}], Driver#driver{phase = taking}}
    end.

%% A robot that streams is at least in Passive, the first mode: its count does not begin higher. The
%% first frames may have been old ones, from before it was started.
judged(#driver{phase = Phase, options = Options, offset = Before} = Driver0) ->
    #{mode := Mode} = readings(Driver0),
    Offset = max(0, min(Before, Mode - 1)),
    #driver{senses = Senses, drive = Drive} = Driver = Driver0#driver{offset = Offset},
    case {starl_create_instructions:is_taken(Mode - Offset, Options), Phase} of
        {true, taking} -> ready(Driver);
        {true, ready} -> drives(starl_create_drive:watch(Senses, Drive), Driver);
        {false, taking} -> {[], Driver};
        {false, ready} -> left(Driver);
        {_, _RestingOrLeaving} -> {[], Driver}
    end.

%% A battery that is low by now is told; a change is told later.
ready(#driver{said = Said, senses = Senses} = Driver) ->
    {WasTold, Well} = starl_create_advice:well(Said),
    Word = [do({say, notice, starl_create_advice:line(under_control)}) || WasTold],
    Low = [told_event(Low) || {battery, low} = Low <- starl_create_senses:state(Senses)],
    Steps = Word ++ [fun stand/1, do({event, ready}) | Low],
    in_turn(Steps, Driver#driver{phase = ready, said = Well}).

%% It has left the mode by itself.
left(#driver{senses = Senses} = Driver) ->
    Advice = {stopped_by_itself, starl_create_senses:unsafe(Senses)},
    in_turn([say(warning, Advice), lose(taking), fun stop/1, take(?LATER_MS)], Driver).
