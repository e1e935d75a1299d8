%% @doc An iRobot Create without hardware, of either generation: bytes in; bytes and the speeds of
%% its wheels out. A pure module; time comes in with each call, in microseconds.
%%
%% It keeps to the Open Interface documents: modes and their safety, commands that wait for their
%% missing bytes without limit, the stream each 15 ms, scripts and waits of the Create 1 (it reads
%% nothing while it waits), sleep of the Create 2. What real robots do otherwise are its quirks
%% ({@link starl_create_quirks}). Demos, cleaning and docking only change the mode: it stands.
%% ```
%%               start                safe, full
%%     off ----------------> passive -----------> safe | full
%%      ^                     |   ^                |
%%      +-- stop, reset ------+   +----------------+ start, a demo; cliff, wheel drop, charger (safe)
%% '''
-module(starl_create_emulator).

-export([new/1, hear/3, advance/2, next_due/1, feel/3, line/3]).
-export([mode/1, wheels/1, baud/1, heard/1]).

-export_type([t/0, options/0, out/0, mode/0, sense/0, line/0]).

-type mode() :: off | passive | safe | full.

%% `quirks' as {@link starl_create_quirks:options/0}. `phase_us': the moment of its 15 ms at which
%% it looks at its sensors. `baud': its line, if it is not the usual one. `now_us': the present time.
-type options() :: #{
    model := starl_create_packet:model(),
    quirks => map(),
    axle_mm => number(),
    baud => pos_integer(),
    phase_us => 0..14999,
    charge_mah => number(),
    now_us => integer()
}.

%% What leaves: bytes, when the last has left; new speeds of the wheels, mm/s; what its other outputs
%% show.
-type out() ::
    {bytes, binary()}
    | {wheels, starl_create_wheels:speeds()}
    | {leds, Bits :: byte(), Colour :: byte(), Intensity :: byte()}
    | {outputs, Bits :: byte()}
    | {motors, Bits :: byte()}
    | {mode, mode()}.

%% What its body feels: how the wheels turn if not as told, and readings of sensors, which stay. The
%% charger is plugged in or out.
-type sense() ::
    {turning, starl_create_wheels:speeds()}
    | {readings, starl_create_packet:readings()}
    | {charger, boolean()}.

%% Its other line, BRC; the baud rate of the other end (`any': the right one); its battery is taken
%% out and put back.
-type line() :: {brc, low | high} | {baud, pos_integer() | any} | power_cycle.

-record(create, {
    model :: starl_create_packet:model(),
    quirks :: starl_create_quirks:t(),
    now = 0 :: integer(),
    phase_us :: 0..14999,
    mode = off :: mode(),
    asleep :: boolean(),
    wedged :: boolean(),
    wheels :: starl_create_wheels:t(),
    %% bytes that have not been read
    input = <<>> :: binary(),
    wait = none :: wait(),
    script = <<>> :: binary(),
    songs = #{} :: #{byte() => non_neg_integer()},
    song = {0, 0} :: {Number :: byte(), EndsUs :: integer()},
    stream = none :: none | [starl_create_packet:id()],
    streams = false :: boolean(),
    %% what the body has felt; the buttons pushed by command, until then
    felt = #{} :: starl_create_packet:readings(),
    pushed = {0, 0} :: {byte(), integer()},
    is_docked :: boolean(),
    charge_mah :: float(),
    %% the line: both ends' baud rates, when the robot's bytes have left it, and their number
    baud :: pos_integer(),
    other = any :: pos_integer() | any,
    deaf_until = 0 :: integer(),
    free_at = 0 :: integer(),
    sent = 0 :: non_neg_integer(),
    %% when it heard the last command; BRC
    heard_at = 0 :: integer(),
    brc = high :: high | {low, integer()},
    booted_at = 0 :: integer(),
    pulses = 0 :: non_neg_integer(),
    count = 0 :: non_neg_integer()
}).

-opaque t() :: #create{}.

-type wait() ::
    none
    | {until, Us :: integer()}
    | {distance, beyond()}
    | {angle, beyond()}
    | {event, integer()}.
%% The place, mm or degrees, at which a wait is over, and the direction to it.
-type beyond() :: {up | down, float()}.

-define(TICK_US, 15000).
%% Bytes that the robot holds without reading them; commands that it reads at one moment.
-define(MOST_INPUT, 2048).
-define(AT_ONCE, 300).
%% After a change of the baud rate it hears nothing for this time.
-define(BAUD_US, 100000).
-define(BUTTON_US, 166667).
%% Three pulses of BRC within this time after power-on: 19200 baud. A pulse: at least this long.
-define(BOOT_US, 2000000).
-define(PULSE_US, 20000).
-define(CAPACITY, 2700).

%% @doc A robot that was just switched on.
-spec new(options()) -> t().
new(#{model := Model} = Options) ->
    Quirks = starl_create_quirks:new(maps:get(quirks, Options, #{}), Model),
    Axle = maps:get(axle_mm, Options, starl_create_wheels:axle_mm(Model)),
    Now = maps:get(now_us, Options, 0),
    #{asleep := Asleep, wedged := Wedged, docked := Docked} = Quirks,
    #create{
        model = Model,
        quirks = Quirks,
        now = Now,
        song = {0, Now},
        pushed = {0, Now},
        deaf_until = Now,
        free_at = Now,
        heard_at = Now,
        booted_at = Now,
        phase_us = maps:get(phase_us, Options, 0),
        asleep = Asleep,
        wedged = Wedged,
        is_docked = Docked,
        wheels = starl_create_wheels:new(Axle, Quirks),
        charge_mah = float(maps:get(charge_mah, Options, 0.9 * ?CAPACITY)),
        baud = maps:get(baud, Options, usual_baud(Model))
    }.

usual_baud(1) -> 57600;
usual_baud(2) -> 115200.

%% @doc Its mode.
-spec mode(t()) -> mode().
mode(#create{mode = Mode}) -> Mode.

%% @doc The speeds that its wheels are told.
-spec wheels(t()) -> starl_create_wheels:speeds().
wheels(#create{wheels = Wheels}) -> starl_create_wheels:told(Wheels).

%% @doc The baud rate of its line.
-spec baud(t()) -> pos_integer().
baud(#create{baud = Baud}) -> Baud.

%% @doc The number of valid commands that it has read.
-spec heard(t()) -> non_neg_integer().
heard(#create{count = Count}) -> Count.

%% @doc The next time at which something happens by itself.
-spec next_due(t()) -> integer() | none.
next_due(#create{streams = false, wait = none, input = <<>>}) -> none;
next_due(#create{streams = false, wait = none}) -> none;
next_due(#create{asleep = true}) -> none;
next_due(#create{now = Now, phase_us = Phase}) -> tick_after(Now, Phase).

%% Times may be negative.
tick_after(Now, Phase) -> floor_div(Now - Phase, ?TICK_US) * ?TICK_US + ?TICK_US + Phase.

floor_div(A, B) when A >= 0 -> A div B;
floor_div(A, B) -> -((-A + B - 1) div B).

%% @doc Lets happen what is due until now. What leaves bears its time.
-spec advance(NowUs :: integer(), t()) -> {[{AtUs :: integer(), out()}], t()}.
advance(Now, Create) -> advance(Now, [], Create).

advance(Now, Outs, Create) ->
    case next_due(Create) of
        Due when is_integer(Due), Due =< Now ->
            {New, Next} = tick(pass(Due, Create)),
            advance(Now, [New | Outs], Next);
        _ ->
            {lists:append(lists:reverse(Outs)), pass(Now, Create)}
    end.

pass(At, #create{now = Now} = Create) when At =< Now -> Create;
pass(At, #create{now = Now, wheels = Wheels, charge_mah = Charge} = Create) ->
    Us = At - Now,
    Used = current_ma(Create) * Us / 3.6e9,
    Create#create{
        now = At,
        wheels = starl_create_wheels:pass(Us, Wheels),
        charge_mah = max(0.0, min(float(?CAPACITY), Charge + Used))
    }.

current_ma(#create{is_docked = true, mode = Mode}) when Mode =:= off; Mode =:= passive -> 1200;
current_ma(#create{wheels = Wheels}) ->
    case starl_create_wheels:told(Wheels) of
        {L, R} when L == 0, R == 0 -> -200;
        _ -> -700
    end.

tick(Create) ->
    {Outs, Ready} = eat(waited(Create)),
    {More, Streamed} = streamed(Ready),
    {Outs ++ More, Streamed}.

%% @doc Bytes arrive.
-spec hear(NowUs :: integer(), binary(), t()) -> {[{integer(), out()}], t()}.
hear(Now, Bytes, Create) ->
    {Outs, Here} = advance(Now, Create),
    {More, Next} = heard(Bytes, fell_asleep(Here)),
    {Outs ++ More, Next}.

heard(_Bytes, #create{asleep = true} = Create) ->
    {[], Create};
heard(_Bytes, #create{now = Now, deaf_until = Until} = Create) when Now < Until ->
    {[], Create};
%% Bytes at another baud rate are framing errors.
heard(_Bytes, #create{other = Other, baud = Baud} = Create) when Other =/= any, Other =/= Baud ->
    {[], Create};
heard(Bytes, #create{input = Input} = Create) ->
    Room = max(0, ?MOST_INPUT - byte_size(Input)),
    Taken = binary:part(Bytes, 0, min(Room, byte_size(Bytes))),
    eat(Create#create{input = <<Input/binary, Taken/binary>>}).

fell_asleep(#create{model = 2, mode = Mode, asleep = false} = Create) when
    Mode =:= passive; Mode =:= off
->
    #create{now = Now, heard_at = Heard, quirks = #{sleep_s := Seconds}} = Create,
    case Now - Heard >= Seconds * 1000000 of
        true -> Create#create{asleep = true, mode = off, streams = false, input = <<>>};
        false -> Create
    end;
fell_asleep(Create) ->
    Create.

%% @doc The body feels something.
-spec feel(NowUs :: integer(), sense(), t()) -> {[{integer(), out()}], t()}.
feel(Now, What, Create) ->
    {Outs, Here} = advance(Now, Create),
    {More, Next} = settled(felt(What, Here)),
    {Outs ++ More, Next}.

felt({turning, Speeds}, #create{wheels = Wheels} = Create) ->
    Create#create{wheels = starl_create_wheels:turning(Speeds, Wheels)};
felt({readings, Readings}, #create{felt = Felt} = Create) ->
    Create#create{felt = maps:merge(Felt, Readings)};
felt({charger, IsDocked}, Create) ->
    Create#create{is_docked = IsDocked}.

%% @doc Something happens to its other lines.
-spec line(NowUs :: integer(), line(), t()) -> {[{integer(), out()}], t()}.
line(Now, What, Create) ->
    {Outs, Here} = advance(Now, Create),
    {More, Next} = lined(What, fell_asleep(Here)),
    {Outs ++ More, Next}.

lined({baud, Baud}, Create) ->
    {[], Create#create{other = Baud}};
lined(power_cycle, Create) ->
    boot(Create#create{wedged = false, baud = usual_baud(Create#create.model)});
lined({brc, _}, #create{quirks = #{no_wake := true}} = Create) ->
    {[], Create};
lined({brc, low}, #create{now = Now} = Create) ->
    {[], Create#create{brc = {low, Now}}};
lined({brc, high}, #create{now = Now, brc = {low, Since}} = Create) when Now - Since >= ?PULSE_US ->
    pulsed(Create#create{brc = high});
lined({brc, high}, Create) ->
    {[], Create#create{brc = high}}.

pulsed(#create{asleep = true} = Create) ->
    boot(Create);
pulsed(#create{now = Now, booted_at = Booted, pulses = N} = Create) when
    Now - Booted < ?BOOT_US, N >= 2
->
    {[], Create#create{baud = 19200, pulses = 0, heard_at = Now}};
pulsed(#create{now = Now, pulses = N} = Create) ->
    {[], Create#create{pulses = N + 1, heard_at = Now}}.

%% It wakes up, or starts anew.
boot(#create{now = Now, model = Model} = Create) ->
    Fresh = Create#create{
        asleep = false,
        booted_at = Now,
        heard_at = Now,
        pulses = 0,
        input = <<>>,
        wait = none,
        stream = none,
        streams = false
    },
    {Outs, Stopped} = to_mode(off, Fresh),
    {Banner, Next} = emit(banner(Model), Stopped),
    {Outs ++ Banner, Next}.

banner(1) ->
    <<>>;
banner(2) ->
    <<"bl-start\r\nSTR730\r\nbootloader id: #x47175347 4C636FFF\r\n",
        "bootloader info rev: #xF000\r\nassembly: 3.2.6\r\n",
        "r3_robot/tags/release-stm32-3.2.6\r\n">>.

%% -- reading commands -----------------------------------------------------------------------

eat(Create) ->
    {Outs, Next} = eat(?AT_ONCE, [], Create),
    {More, Settled} = settled(Next),
    {lists:append(lists:reverse(Outs)) ++ More, Settled}.

eat(_N, Outs, #create{wait = Wait} = Create) when Wait =/= none -> {Outs, Create};
eat(_N, Outs, #create{asleep = true} = Create) ->
    {Outs, Create};
%% A script that plays itself without a wait takes time, too.
eat(0, Outs, #create{now = Now, phase_us = Phase} = Create) ->
    {Outs, Create#create{wait = {until, tick_after(Now, Phase)}}};
eat(N, Outs, #create{input = Input, model = Model, count = Count, now = Now} = Create) ->
    case starl_create_command:decode(Input, Model) of
        more ->
            {Outs, Create};
        {ok, Command, Rest} ->
            Read = Create#create{input = Rest, heard_at = Now},
            {New, Next} = obeys(Command, Read#create{count = Count + 1}),
            eat(N - 1, [New | Outs], Next);
        {invalid, _Bytes, Rest} ->
            eat(N, Outs, Create#create{input = Rest});
        {unknown, _Byte, Rest} ->
            eat(N, Outs, Create#create{input = Rest})
    end.

%% Off, it only hears Start and Reset.
obeys(reset, Create) ->
    boot(Create);
obeys(start, Create) ->
    to_mode(passive, Create#create{});
obeys(_Command, #create{mode = off} = Create) ->
    {[], Create};
obeys(Command, #create{mode = Mode} = Create) ->
    case needs_control(Command) andalso Mode =:= passive of
        true -> {[], Create};
        false -> does(Command, Create)
    end.

%% The actuators.
needs_control({Name, _, _}) when Name =:= drive; Name =:= drive_direct; Name =:= drive_pwm -> true;
needs_control({Name, _}) when Name =:= motors; Name =:= outputs; Name =:= play; Name =:= send_ir ->
    true;
needs_control({leds, _, _, _}) ->
    true;
needs_control({pwm_motors, _, _, _}) ->
    true;
needs_control({scheduling_leds, _, _}) ->
    true;
needs_control({digits, _, _, _, _}) ->
    true;
needs_control({digits_raw, _, _, _, _}) ->
    true;
needs_control(_) ->
    false.

does(Command, Create) when Command =:= safe; Command =:= control ->
    case is_unsafe(Create) of
        true -> {[], Create};
        false -> to_mode(safe, Create)
    end;
does(full, Create) ->
    to_mode(full, Create);
does(stop, Create) ->
    to_mode(off, Create#create{streams = false, stream = none});
does(power, Create) ->
    {Outs, Next} = to_mode(passive, Create),
    {Outs, Next#create{asleep = true, mode = off, streams = false}};
does({demo, -1}, Create) ->
    to_mode(passive, Create);
does(Command, Create) when
    Command =:= spot; Command =:= clean; Command =:= max; Command =:= dock
->
    to_mode(passive, Create);
does({demo, _}, Create) ->
    to_mode(passive, Create);
does({baud, Code}, #create{now = Now} = Create) ->
    {[], Create#create{baud = rate(Code), deaf_until = Now + ?BAUD_US, input = <<>>}};
does({drive, V, Radius}, #create{wheels = Wheels} = Create) ->
    drives(starl_create_wheels:circle(V, Radius, Wheels), {V, coded(Radius)}, Create);
does({drive_direct, Right, Left}, Create) ->
    drives({Left, Right}, none, Create);
does({drive_pwm, Right, Left}, Create) ->
    drives({Left * 500 / 255, Right * 500 / 255}, none, Create);
does({leds, Bits, Colour, Intensity}, Create) ->
    out({leds, Bits, Colour, Intensity}, Create);
does({outputs, Bits}, Create) ->
    out({outputs, Bits}, Create);
does({motors, Bits}, Create) ->
    out({motors, Bits}, Create);
does({song, Number, Notes}, #create{songs = Songs} = Create) ->
    Us = lists:sum([Duration * 1000000 div 64 || {_, Duration} <- Notes]),
    {[], Create#create{songs = Songs#{Number => Us}}};
does({play, Number}, #create{now = Now, songs = Songs, song = {_, Ends}} = Create) ->
    case Songs of
        #{Number := Us} when Now >= Ends -> {[], Create#create{song = {Number, Now + Us}}};
        #{} -> {[], Create}
    end;
does({buttons, Bits}, #create{now = Now} = Create) ->
    {[], Create#create{pushed = {Bits, Now + ?BUTTON_US}}};
does({sensors, Id}, Create) ->
    answer([Id], Create);
does({query, Ids}, Create) ->
    answer(Ids, Create);
does({stream, Ids}, #create{model = Model} = Create) ->
    case lists:all(fun(Id) -> starl_create_packet:known(Id, Model) end, Ids) of
        true -> {[], Create#create{stream = Ids, streams = Ids =/= []}};
        false -> {[], Create}
    end;
does({stream_on, On}, #create{stream = Ids} = Create) ->
    {[], Create#create{streams = On =:= 1 andalso is_list(Ids) andalso Ids =/= []}};
does({script, Script}, Create) ->
    {[], Create#create{script = Script}};
does(play_script, #create{script = Script, input = Input} = Create) ->
    {[], Create#create{input = <<Script/binary, Input/binary>>}};
does(show_script, #create{script = Script} = Create) ->
    emit(<<(byte_size(Script)), Script/binary>>, Create#create{streams = false});
does({wait_time, Tenths}, #create{now = Now} = Create) ->
    {[], Create#create{wait = {until, Now + Tenths * 100000}}};
does({wait_distance, Mm}, #create{wheels = Wheels} = Create) ->
    {Travelled, _} = starl_create_wheels:travelled(Wheels),
    {[], Create#create{wait = {distance, way(Travelled, Mm)}}};
does({wait_angle, Degrees}, #create{wheels = Wheels} = Create) ->
    {_, Turned} = starl_create_wheels:travelled(Wheels),
    {[], Create#create{wait = {angle, way(Turned, Degrees)}}};
does({wait_event, Event}, Create) ->
    {[], Create#create{wait = {event, Event}}};
%% Lights of digits, the schedule, the clock, infrared: nothing to be seen.
does(_Other, Create) ->
    {[], Create}.

%% The place at which a wait is over, and in which direction it lies.
way(Here, More) when More >= 0 -> {up, Here + More};
way(Here, More) -> {down, Here + More}.

rate(Code) ->
    element(
        Code + 1,
        {300, 600, 1200, 2400, 4800, 9600, 14400, 19200, 28800, 38400, 57600, 115200}
    ).

coded(straight) -> -32768;
coded(clockwise) -> -1;
coded(counterclockwise) -> 1;
coded(Mm) -> Mm.

drives(Speeds, Circle, #create{wheels = Wheels, felt = Felt} = Create) ->
    Asked =
        case Circle of
            none -> #{velocity => 0, radius => 0};
            {V, Radius} -> #{velocity => V, radius => Radius}
        end,
    {[], Create#create{
        wheels = starl_create_wheels:command(Speeds, Wheels), felt = maps:merge(Felt, Asked)
    }}.

out(Out, #create{now = Now} = Create) -> {[{Now, Out}], Create}.

%% -- modes and safety -----------------------------------------------------------------------

to_mode(Mode, #create{mode = Mode} = Create) ->
    {[], Create};
to_mode(Mode, #create{now = Now, wheels = Wheels} = Create) ->
    Next = Create#create{mode = Mode},
    Stopped =
        case Mode =:= off orelse Mode =:= passive of
            true -> Next#create{wheels = starl_create_wheels:command({0, 0}, Wheels)};
            false -> Next
        end,
    {[{Now, {mode, Mode}}], Stopped}.

%% What has been commanded is safe, or the mode ends; then the body is told.
settled(#create{mode = safe} = Create) ->
    case is_unsafe(Create) of
        true ->
            {Outs, Passive} = to_mode(passive, Create),
            {More, Next} = told(Passive),
            {Outs ++ More, Next};
        false ->
            told(Create)
    end;
settled(Create) ->
    told(Create).

told(#create{now = Now, wheels = Wheels} = Create) ->
    case starl_create_wheels:turn(Wheels, Now) of
        {same, Same} -> {[], Create#create{wheels = Same}};
        {Speeds, Next} -> {[{Now, {wheels, Speeds}}], Create#create{wheels = Next}}
    end.

is_unsafe(#create{is_docked = true}) ->
    true;
is_unsafe(#create{felt = Felt, wheels = Wheels}) ->
    Drops = maps:get(bumps_drops, Felt, 0) band 2#11100,
    Drops =/= 0 orelse (is_cliff(Felt) andalso is_towards_cliff(Wheels)).

is_cliff(Felt) ->
    lists:any(
        fun(Name) -> maps:get(Name, Felt, 0) =/= 0 end,
        [cliff_left, cliff_front_left, cliff_front_right, cliff_right]
    ).

%% Forward, or backward on a circle smaller than the robot.
is_towards_cliff(Wheels) ->
    case starl_create_wheels:commanded(Wheels) of
        {L, R} when L == 0, R == 0 -> false;
        {L, R} when L + R > 0 -> true;
        {L, R} -> L + R < 0 andalso abs(R - L) > abs(L + R)
    end.

%% -- waits ----------------------------------------------------------------------------------

%% A wait ends at one of its looks at the sensors, each 15 ms.
waited(#create{wait = none} = Create) ->
    Create;
waited(#create{wait = Wait} = Create) ->
    case is_over(Wait, Create) of
        true -> Create#create{wait = none};
        false -> Create
    end.

is_over({until, Us}, #create{now = Now}) ->
    Now >= Us;
is_over({distance, Place}, #create{wheels = Wheels}) ->
    is_beyond(Place, element(1, starl_create_wheels:travelled(Wheels)));
is_over({angle, Place}, #create{wheels = Wheels}) ->
    is_beyond(Place, element(2, starl_create_wheels:travelled(Wheels)));
is_over({event, Event}, Create) when Event < 0 ->
    not is_event(-Event, readings(Create), Create);
is_over({event, Event}, Create) ->
    is_event(Event, readings(Create), Create).

is_beyond({up, Place}, Here) -> Here >= Place;
is_beyond({down, Place}, Here) -> Here =< Place.

is_event(1, #{bumps_drops := B}, _) -> B band 2#11100 =/= 0;
is_event(2, #{bumps_drops := B}, _) -> B band 2#10000 =/= 0;
is_event(3, #{bumps_drops := B}, _) -> B band 2#01000 =/= 0;
is_event(4, #{bumps_drops := B}, _) -> B band 2#00100 =/= 0;
is_event(5, #{bumps_drops := B}, _) -> B band 2#00011 =/= 0;
is_event(6, #{bumps_drops := B}, _) -> B band 2#00010 =/= 0;
is_event(7, #{bumps_drops := B}, _) -> B band 2#00001 =/= 0;
is_event(8, #{virtual_wall := X}, _) -> X =/= 0;
is_event(9, #{wall := X}, _) -> X =/= 0;
is_event(10, Readings, _) -> is_cliff(Readings);
is_event(11, #{cliff_left := X}, _) -> X =/= 0;
is_event(12, #{cliff_front_left := X}, _) -> X =/= 0;
is_event(13, #{cliff_front_right := X}, _) -> X =/= 0;
is_event(14, #{cliff_right := X}, _) -> X =/= 0;
is_event(15, #{charging_sources := X}, _) -> X band 2 =/= 0;
is_event(16, #{buttons := X}, _) -> X band 4 =/= 0;
is_event(17, #{buttons := X}, _) -> X band 1 =/= 0;
is_event(N, #{digital_inputs := X}, _) when N >= 18, N =< 21 -> X band (1 bsl (N - 18)) =/= 0;
is_event(22, _, #create{mode = Mode}) -> Mode =:= passive;
is_event(_, _, _) -> false.

%% -- sensors --------------------------------------------------------------------------------

%% Nothing is answered if there is a packet that the generation does not have.
answer(Ids, #create{model = Model} = Create) ->
    case lists:all(fun(Id) -> starl_create_packet:known(Id, Model) end, Ids) of
        true -> emit(starl_create_packet:encode_all(Ids, readings(Create)), was_read(Ids, Create));
        false -> {[], Create}
    end.

was_read(Ids, #create{wheels = Wheels} = Create) ->
    Members = lists:append([starl_create_packet:members(Id) || Id <- Ids]),
    Names = [starl_create_packet:name(Id) || Id <- Members],
    Create#create{wheels = starl_create_wheels:read(Names, Wheels)}.

streamed(#create{streams = false} = Create) ->
    {[], Create};
streamed(#create{stream = Ids, quirks = #{checksum := Checksum}} = Create) ->
    Frame = starl_create_stream:frame(Ids, readings(Create), Checksum),
    emit(Frame, was_read(Ids, Create)).

readings(#create{now = Now, model = Model, wheels = Wheels, felt = Felt} = Create) ->
    #create{charge_mah = Charge, song = {Song, Ends}, stream = Stream, pushed = Pushed} = Create,
    Own = #{
        ir_omni => no_ir(Model),
        mode => coded_mode(Create),
        charge => round(Charge),
        capacity => ?CAPACITY,
        voltage => round(12500 + 4000 * Charge / ?CAPACITY),
        current => round(current_ma(Create)),
        temperature => 25,
        charging_state => charging(Create),
        charging_sources => bit(2, Create#create.is_docked),
        song => Song,
        song_playing => bit(1, Now < Ends),
        stream_packets => stream_packets(Stream),
        buttons => pushed(Now, Pushed),
        digital_inputs => inputs(Model),
        cliff_left_signal => 1500,
        cliff_front_left_signal => 1500,
        cliff_front_right_signal => 1500,
        cliff_right_signal => 1500
    },
    Docked =
        case Create#create.is_docked of
            true -> (maps:map(fun(_, _) -> 0 end, maps:with(cliff_signals(), Own)));
            false -> #{}
        end,
    lists:foldl(
        fun(Map, Before) -> maps:merge(Before, Map) end,
        maps:from_list([{starl_create_packet:name(Id), 0} || Id <- lists:seq(7, 58)]),
        [Own, Docked, starl_create_wheels:readings(Wheels), Felt]
    ).

cliff_signals() ->
    [cliff_left_signal, cliff_front_left_signal, cliff_front_right_signal, cliff_right_signal].

no_ir(1) -> 255;
no_ir(2) -> 0.

%% Inputs that are not connected are high.
inputs(1) -> 2#01111;
inputs(2) -> 0.

bit(Bit, true) -> Bit;
bit(_Bit, false) -> 0.

stream_packets(none) -> 0;
stream_packets(Ids) -> length(Ids).

pushed(Now, {Bits, Until}) when Now < Until -> Bits;
pushed(_Now, _Pushed) -> 0.

coded_mode(#create{mode = Mode, quirks = #{mode_offset := Offset}}) ->
    Offset + maps:get(Mode, #{off => 0, passive => 1, safe => 2, full => 3}).

charging(#create{is_docked = false}) -> 0;
charging(#create{mode = Mode}) when Mode =:= safe; Mode =:= full -> 4;
charging(#create{charge_mah = Charge}) when Charge >= ?CAPACITY -> 3;
charging(_Create) -> 2.

%% -- sending --------------------------------------------------------------------------------

emit(<<>>, Create) ->
    {[], Create};
emit(_Bytes, #create{wedged = true} = Create) ->
    {[], Create};
emit(Bytes0, #create{now = Now, free_at = Free, baud = Baud, sent = Sent} = Create) ->
    Bytes = garbled(strayed(Bytes0, Create), Create),
    Us = byte_size(Bytes) * 10000000 div Baud,
    Leaves = burst(max(Now, Free) + Us, Create),
    Next = Create#create{free_at = max(Now, Free) + Us, sent = Sent + byte_size(Bytes)},
    case max(Now, Free) - Now > ?TICK_US of
        %% too much for the line: the bytes are lost
        true -> {[], Create};
        false -> {[{Leaves, {bytes, Bytes}}], Next}
    end.

burst(At, #create{quirks = #{burst_ms := 0}}) -> At;
burst(At, #create{quirks = #{burst_ms := Ms}}) -> (floor_div(At, 1000 * Ms) + 1) * 1000 * Ms.

strayed(Bytes, #create{quirks = #{stray_byte := 0}}) ->
    Bytes;
strayed(Bytes, #create{quirks = #{stray_byte := Each}, sent = Sent}) ->
    case (Sent rem Each) + byte_size(Bytes) >= Each of
        true -> <<Bytes/binary, (erlang:phash2(Sent, 256))>>;
        false -> Bytes
    end.

%% The other end reads at another rate.
garbled(Bytes, #create{other = Other, baud = Baud}) when Other =:= any; Other =:= Baud -> Bytes;
garbled(Bytes, #create{sent = Sent}) ->
    <<
        <<(erlang:phash2({Sent, N, Byte}, 256))>>
     || {N, Byte} <- lists:zip(lists:seq(1, byte_size(Bytes)), binary_to_list(Bytes))
    >>.
