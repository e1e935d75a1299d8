%% @doc What an emulated Create does at each command, and from which mode on.
-module(starl_create_obey).

-export([command/2]).

-type state() :: starl_create_state:t().
-type went() :: {starl_create_state:outs(), state()}.

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

%% @doc Obeys a command, or not, in this mode.
-spec command(starl_create_command:t(), state()) -> went().
command(Command, #{mode := Mode} = State) ->
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
