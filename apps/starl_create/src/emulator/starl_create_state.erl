%% @doc The state of an emulated Create: its parts, in one map that the modules of the emulator
%% share.
-module(starl_create_state).

-export([new/1, pass/2, load/1, send/2, show/2]).

-export_type([t/0, options/0, out/0, outs/0, mode/0]).

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

-type outs() :: [{AtUs :: integer(), out()}].

%% `input': bytes that have not been read. `stream': packets of its stream; does it stream?
%% `felt': what the body has felt, and which circle was commanded. `count': commands that were read.
-type t() :: #{
    model := starl_create_packet:model(),
    quirks := starl_create_quirks:t(),
    now := integer(),
    phase_us := 0..14999,
    mode := mode(),
    wheels := starl_create_wheels:t(),
    uart := starl_create_uart:t(),
    sleep := starl_create_sleep:t(),
    battery := starl_create_battery:t(),
    panel := starl_create_panel:t(),
    felt := starl_create_packet:readings(),
    stream := none | [starl_create_packet:id()],
    streams := boolean(),
    input := binary(),
    wait := starl_create_wait:t(),
    script := binary(),
    count := non_neg_integer()
}.

%% @doc A robot that was just switched on.
-spec new(options()) -> t().
new(#{model := Model} = Options) ->
    #{docked := IsDocked} = Quirks = starl_create_quirks:new(maps:get(quirks, Options, #{}), Model),
    Axle = maps:get(axle_mm, Options, starl_create_wheels:axle_mm(Model)),
    Now = maps:get(now_us, Options, 0),
    #{
        model => Model,
        quirks => Quirks,
        now => Now,
        phase_us => maps:get(phase_us, Options, 0),
        mode => off,
        wheels => starl_create_wheels:new(Axle, Quirks),
        uart => starl_create_uart:new(Model, maps:get(baud, Options, usual), Quirks, Now),
        sleep => starl_create_sleep:new(Model, Quirks, Now),
        battery => starl_create_battery:new(maps:get(charge_mah, Options, usual), IsDocked),
        panel => starl_create_panel:new(Now),
        felt => #{},
        stream => none,
        streams => false,
        input => <<>>,
        wait => none,
        script => <<>>,
        count => 0
    }.

%% @doc Time passes; nothing happens.
-spec pass(NowUs :: integer(), t()) -> t().
pass(At, #{now := Now} = State) when At =< Now -> State;
pass(At, #{now := Now, mode := Mode, wheels := Wheels, battery := Battery} = State) ->
    Us = At - Now,
    State#{
        now := At,
        wheels := starl_create_wheels:pass(Us, Wheels),
        battery := starl_create_battery:pass(Us, Mode, load(State), Battery)
    }.

%% @doc Checks whether its wheels are commanded to turn.
-spec load(t()) -> starl_create_battery:load().
load(#{wheels := Wheels}) ->
    case starl_create_wheels:told(Wheels) of
        {L, R} when L == 0, R == 0 -> standing;
        _ -> driving
    end.

%% @doc Sends bytes.
-spec send(binary(), t()) -> {outs(), t()}.
send(Bytes, #{now := Now, uart := Uart} = State) ->
    {Outs, Next} = starl_create_uart:send(Now, Bytes, Uart),
    {Outs, State#{uart := Next}}.

%% @doc Shows something at another output.
-spec show(out(), t()) -> {outs(), t()}.
show(Out, #{now := Now} = State) -> {[{Now, Out}], State}.
