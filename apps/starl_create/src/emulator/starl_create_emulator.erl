%% @doc An iRobot Create without hardware, of either generation: bytes in; bytes and the speeds of
%% its wheels out. A pure module; time comes in with each call, in microseconds.
%%
%% It keeps to the Open Interface documents: modes and their safety ({@link starl_create_modes}),
%% commands that wait for their missing bytes without limit, the stream
%% each 15 ms ({@link starl_create_sensors}), scripts and waits of the Create 1 ({@link
%% starl_create_wait}; it reads nothing while it waits), sleep of the Create 2 ({@link
%% starl_create_sleep}). What real robots do otherwise are its quirks ({@link starl_create_quirks}).
-module(starl_create_emulator).

-export([new/1, hear/3, advance/2, next_due/1, feel/3, line/3]).
-export([mode/1, wheels/1, baud/1, heard/1]).

-export_type([t/0, options/0, out/0, mode/0, sense/0, line/0]).

-type mode() :: starl_create_state:mode().
-type options() :: starl_create_state:options().
-type out() :: starl_create_state:out().
-type outs() :: starl_create_state:outs().

%% What its body feels: how the wheels turn if not as told, and readings of sensors, which stay; its
%% bumper, and whether it is in the way of something. The charger is plugged in or out.
-type sense() ::
    {turning, starl_create_wheels:speeds()}
    | {readings, starl_create_packet:readings()}
    | {touches, Bits :: 0..3, IsBlocked :: boolean()}
    | {charger, boolean()}.

%% Its other line, BRC; the baud rate of the other end (`any': the right one).
-type line() :: {brc, low | high} | {baud, pos_integer() | any}.

-opaque t() :: starl_create_state:t().

%% Bytes that the robot holds without reading them; commands that it reads at one moment.
-define(MOST_INPUT, 2048).
-define(AT_ONCE, 300).

%% The command, what kind it is, and the lowest mode in which it is heard. Commands that are not here
%% (lights of digits, the schedule, the clock, infrared) do nothing that can be seen.
-define(COMMANDS, #{
    reset => {mode, off},
    start => {mode, off},
    control => {mode, passive},
    safe => {mode, passive},
    full => {mode, passive},
    power => {mode, passive},
    stop => {mode, passive},
    spot => {mode, passive},
    clean => {mode, passive},
    max => {mode, passive},
    dock => {mode, passive},
    demo => {mode, passive},
    baud => {line, passive},
    drive => {drive, safe},
    drive_direct => {drive, safe},
    drive_pwm => {drive, safe},
    leds => {show, safe},
    outputs => {show, safe},
    motors => {show, safe},
    song => {panel, passive},
    play => {panel, safe},
    buttons => {panel, passive},
    sensors => {sense, passive},
    query => {sense, passive},
    stream => {sense, passive},
    stream_on => {sense, passive},
    script => {script, passive},
    play_script => {script, passive},
    show_script => {script, passive},
    wait_time => {wait, passive},
    wait_distance => {wait, passive},
    wait_angle => {wait, passive},
    wait_event => {wait, passive}
}).

%% @doc A robot that was just switched on.
-spec new(options()) -> t().
new(Options) -> starl_create_state:new(Options).

%% @doc Its mode.
-spec mode(t()) -> mode().
mode(#{mode := Mode}) -> Mode.

%% @doc The commanded speeds of its wheels.
-spec wheels(t()) -> starl_create_wheels:speeds().
wheels(#{wheels := Wheels}) -> starl_create_wheels:told(Wheels).

%% @doc The baud rate of its line.
-spec baud(t()) -> pos_integer().
baud(#{uart := Uart}) -> starl_create_uart:baud(Uart).

%% @doc The number of valid commands that it has read.
-spec heard(t()) -> non_neg_integer().
heard(#{count := Count}) -> Count.

%% @doc The next time at which something happens by itself.
-spec next_due(t()) -> integer() | none.
next_due(#{streams := false, wait := none}) ->
    none;
next_due(#{now := Now, phase_us := Phase, sleep := Sleep}) ->
    case starl_create_sleep:is_asleep(Sleep) of
        true -> none;
        false -> starl_create_tick:next(Now, Phase)
    end.

%% @doc Lets happen what is due until now. What leaves bears its time.
-spec advance(NowUs :: integer(), t()) -> {outs(), t()}.
advance(Now, State) -> advance(Now, [], State).

advance(Now, Outs, State) ->
    case next_due(State) of
        Due when is_integer(Due), Due =< Now ->
            {New, Next} = tick(starl_create_state:pass(Due, State)),
            advance(Now, [New | Outs], Next);
        _ ->
            {lists:append(lists:reverse(Outs)), starl_create_state:pass(Now, State)}
    end.

tick(State) ->
    {Outs, Ready} = eat(starl_create_wait:look(State)),
    {More, Streamed} = starl_create_sensors:frame(Ready),
    {Outs ++ More, Streamed}.

%% @doc Bytes arrive.
-spec hear(NowUs :: integer(), binary(), t()) -> {outs(), t()}.
hear(Now, Bytes, State) ->
    at(Now, State, fun(Here) -> takes(Bytes, doze(Here)) end).

%% @doc The body feels something.
-spec feel(NowUs :: integer(), sense(), t()) -> {outs(), t()}.
feel(Now, What, State) ->
    at(Now, State, fun(Here) -> starl_create_modes:settle(felt(What, Here)) end).

%% @doc Something happens to its other lines.
-spec line(NowUs :: integer(), line(), t()) -> {outs(), t()}.
line(Now, What, State) ->
    at(Now, State, fun(Here) -> lined(What, doze(Here)) end).

at(Now, State, Fun) ->
    {Outs, Here} = advance(Now, State),
    {More, Next} = Fun(Here),
    {Outs ++ More, Next}.

takes(Bytes, #{now := Now, sleep := Sleep, uart := Uart, input := Input} = State) ->
    case not starl_create_sleep:is_asleep(Sleep) andalso starl_create_uart:hears(Now, Uart) of
        true ->
            Room = max(0, ?MOST_INPUT - byte_size(Input)),
            Taken = binary:part(Bytes, 0, min(Room, byte_size(Bytes))),
            eat(State#{input := <<Input/binary, Taken/binary>>});
        false ->
            {[], State}
    end.

%% It may have fallen asleep meanwhile.
doze(#{now := Now, mode := Mode, sleep := Sleep} = State) ->
    case starl_create_sleep:is_tired(Mode, Now, Sleep) of
        true ->
            Asleep = starl_create_sleep:sleep(Sleep),
            State#{sleep := Asleep, mode := off, streams := false, input := <<>>};
        false ->
            State
    end.

felt({turning, Speeds}, #{wheels := Wheels} = State) ->
    State#{wheels := starl_create_wheels:turning(Speeds, Wheels)};
felt({readings, Readings}, #{felt := Felt} = State) ->
    State#{felt := maps:merge(Felt, Readings)};
felt({touches, Bits, IsBlocked}, #{felt := Felt, wheels := Wheels} = State) ->
    Drops = maps:get(bumps_drops, Felt, 0) band 2#11100,
    State#{
        felt := Felt#{bumps_drops => Drops bor Bits},
        wheels := starl_create_wheels:hold(IsBlocked, Wheels)
    };
felt({charger, IsDocked}, #{battery := Battery} = State) ->
    State#{battery := starl_create_battery:dock(IsDocked, Battery)}.

lined({baud, Baud}, #{uart := Uart} = State) ->
    {[], State#{uart := starl_create_uart:other(Baud, Uart)}};
lined({brc, Level}, #{now := Now, sleep := Sleep, uart := Uart} = State) ->
    case starl_create_sleep:brc(Level, Now, Sleep) of
        {nothing, Next} -> {[], State#{sleep := Next}};
        {boot, Next} -> starl_create_modes:boot(State#{sleep := Next});
        {slow, Next} -> {[], State#{sleep := Next, uart := starl_create_uart:slow(Uart)}}
    end.

%% Reads the commands that are there.
eat(State) ->
    {Outs, Next} = eat(?AT_ONCE, [], State),
    {More, Settled} = starl_create_modes:settle(Next),
    {lists:append(lists:reverse(Outs)) ++ More, Settled}.

eat(_N, Outs, #{wait := Wait} = State) when Wait =/= none -> {Outs, State};
%% A script that plays itself without a wait takes time, too.
eat(0, Outs, State) ->
    {Outs, starl_create_wait:tick(State)};
eat(N, Outs, #{input := Input, model := Model, sleep := Sleep} = State) ->
    case starl_create_sleep:is_asleep(Sleep) orelse starl_create_command:decode(Input, Model) of
        true ->
            {Outs, State};
        more ->
            {Outs, State};
        {ok, Command, Rest} ->
            {New, Next} = obey(Command, read(State#{input := Rest})),
            eat(N - 1, [New | Outs], Next);
        {_InvalidOrUnknown, _Bytes, Rest} ->
            eat(N, Outs, State#{input := Rest})
    end.

read(#{now := Now, count := Count, sleep := Sleep} = State) ->
    State#{count := Count + 1, sleep := starl_create_sleep:command(Now, Sleep)}.

%% -- commands -------------------------------------------------------------------------------

%% What it does at a command, if it hears it in this mode.
obey(Command, #{mode := Mode} = State) ->
    {Kind, Lowest} = maps:get(name(Command), ?COMMANDS, {nothing, passive}),
    case rank(Mode) >= rank(Lowest) of
        true -> does(Kind, Command, State);
        false -> {[], State}
    end.

name(Command) when is_atom(Command) -> Command;
name(Command) -> element(1, Command).

rank(off) -> 0;
rank(passive) -> 1;
rank(safe) -> 2;
rank(full) -> 2.

does(nothing, _Command, State) -> {[], State};
does(mode, Command, State) -> starl_create_modes:command(Command, State);
does(line, {baud, Code}, State) -> {[], rate(Code, State)};
does(drive, Command, State) -> {[], drive(Command, State)};
does(show, Shown, State) -> starl_create_state:show(Shown, State);
does(panel, Command, State) -> {[], panel(Command, State)};
does(sense, Command, State) -> sense(Command, State);
does(script, Command, State) -> script(Command, State);
does(wait, Command, State) -> {[], starl_create_wait:begins(Command, State)}.

rate(Code, #{now := Now, uart := Uart} = State) ->
    State#{uart := starl_create_uart:rate(Code, Now, Uart), input := <<>>}.

drive({drive, V, Radius}, #{wheels := Wheels} = State) ->
    drives(starl_create_wheels:circle(V, Radius, Wheels), V, coded(Radius), State);
drive({drive_direct, Right, Left}, State) ->
    drives({Left, Right}, 0, 0, State);
drive({drive_pwm, Right, Left}, State) ->
    drives({Left * 500 / 255, Right * 500 / 255}, 0, 0, State).

drives(Speeds, V, Radius, #{wheels := Wheels, felt := Felt} = State) ->
    State#{
        wheels := starl_create_wheels:command(Speeds, Wheels),
        felt := Felt#{velocity => V, radius => Radius}
    }.

coded(straight) -> -32768;
coded(clockwise) -> -1;
coded(counterclockwise) -> 1;
coded(Mm) -> Mm.

panel(Command, #{now := Now, panel := Panel} = State) ->
    State#{panel := panel(Command, Now, Panel)}.

panel({song, Number, Notes}, _Now, Panel) -> starl_create_panel:song(Number, Notes, Panel);
panel({play, Number}, Now, Panel) -> starl_create_panel:play(Number, Now, Panel);
panel({buttons, Bits}, Now, Panel) -> starl_create_panel:push(Bits, Now, Panel).

sense({sensors, Id}, State) ->
    starl_create_sensors:answer([Id], State);
sense({query, Ids}, State) ->
    starl_create_sensors:answer(Ids, State);
sense({stream, Ids}, State) ->
    {[], starl_create_sensors:stream(Ids, State)};
sense({stream_on, On}, #{stream := Ids} = State) ->
    {[], State#{streams := On =:= 1 andalso is_list(Ids) andalso Ids =/= []}}.

%% A script that is played stands before what else was sent.
script({script, Script}, State) ->
    {[], State#{script := Script}};
script(play_script, #{script := Script, input := Input} = State) ->
    {[], State#{input := <<Script/binary, Input/binary>>}};
script(show_script, #{script := Script} = State) ->
    starl_create_state:send(<<(byte_size(Script)), Script/binary>>, State#{streams := false}).
