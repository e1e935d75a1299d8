%% @doc The modes of an emulated Create, and their safety.
%% ```
%%               start                safe, full
%%     off ----------------> passive -----------> safe | full
%%      ^                     |   ^                |
%%      +-- stop, reset ------+   +----------------+ start, a demo; cliff, wheel drop, charger (safe)
%% '''
-module(starl_create_modes).

-export([command/2, boot/1, settle/1]).

-type state() :: starl_create_state:t().
-type went() :: {starl_create_state:outs(), state()}.

%% @doc A command changes the mode. Demos, cleaning and docking only do that: it stands.
-spec command(starl_create_command:t(), state()) -> went().
command(reset, State) ->
    boot(State);
command(Command, State) when Command =:= safe; Command =:= control ->
    case is_unsafe(State) of
        true -> {[], State};
        false -> to(safe, State)
    end;
command(full, State) ->
    to(full, State);
command(stop, State) ->
    to(off, State#{streams := false, stream := none});
command(power, State) ->
    {Outs, #{sleep := Sleep} = Next} = to(passive, State),
    {Outs, Next#{sleep := starl_create_sleep:sleep(Sleep), mode := off, streams := false}};
command(_StartOrDemo, State) ->
    to(passive, State).

%% @doc Wakes up, or restarts: a Create 2 reports that.
-spec boot(state()) -> went().
boot(#{now := Now, model := Model, sleep := Sleep} = State) ->
    Fresh = State#{
        sleep := starl_create_sleep:boot(Now, Sleep),
        input := <<>>,
        wait := none,
        stream := none,
        streams := false
    },
    {Outs, Stopped} = to(off, Fresh),
    {Banner, Next} = starl_create_state:send(banner(Model), Stopped),
    {Outs ++ Banner, Next}.

banner(1) ->
    <<>>;
banner(2) ->
    <<"bl-start\r\nSTR730\r\nbootloader id: #x47175347 4C636FFF\r\n",
        "bootloader info rev: #xF000\r\nassembly: 3.2.6\r\n",
        "r3_robot/tags/release-stm32-3.2.6\r\n">>.

to(Mode, #{mode := Mode} = State) -> {[], State};
to(Mode, State) -> starl_create_state:show({mode, Mode}, stopped(State#{mode := Mode})).

stopped(#{mode := Mode, wheels := Wheels} = State) when Mode =:= off; Mode =:= passive ->
    State#{wheels := starl_create_wheels:command({0, 0}, Wheels)};
stopped(State) ->
    State.

%% @doc Checks that the command is safe, or ends the mode; then the body is notified.
-spec settle(state()) -> went().
settle(#{mode := safe} = State) ->
    case is_unsafe(State) of
        true ->
            {Outs, Passive} = to(passive, State),
            {More, Next} = tell(Passive),
            {Outs ++ More, Next};
        false ->
            tell(State)
    end;
settle(State) ->
    tell(State).

tell(#{wheels := Wheels} = State) ->
    case starl_create_wheels:turn(Wheels) of
        {same, Same} -> {[], State#{wheels := Same}};
        {Speeds, Next} -> starl_create_state:show({wheels, Speeds}, State#{wheels := Next})
    end.

is_unsafe(#{battery := Battery, felt := Felt, wheels := Wheels}) ->
    starl_create_battery:is_docked(Battery) orelse
        is_drop(Felt) orelse
        (starl_create_sensors:is_cliff(Felt) andalso is_towards_cliff(Wheels)).

is_drop(Felt) -> maps:get(bumps_drops, Felt, 0) band 2#11100 =/= 0.

%% Forward, or backward on a circle smaller than the robot.
is_towards_cliff(Wheels) ->
    case starl_create_wheels:commanded(Wheels) of
        {L, R} when L == 0, R == 0 -> false;
        {L, R} when L + R > 0 -> true;
        {L, R} -> L + R < 0 andalso abs(R - L) > abs(L + R)
    end.
