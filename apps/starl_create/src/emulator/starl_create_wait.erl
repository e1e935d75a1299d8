%% @doc Waits of an emulated Create 1: for a time, a distance, an angle, or an event. While it waits
%% it reads no command.
-module(starl_create_wait).

-export([tick/1, begins/2, look/1]).

-export_type([t/0]).

-type t() ::
    none
    | {until, Us :: integer()}
    | {distance, beyond()}
    | {angle, beyond()}
    | {event, integer()}.
%% The place, mm or degrees, at which a wait is over, and the direction to it.
-type beyond() :: {up | down, float()}.

-type state() :: starl_create_state:t().

%% Waits for this time.
-spec until(Us :: integer(), state()) -> state().
until(Us, State) -> State#{wait := {until, Us}}.

%% @doc Waits until its next look at the sensors.
-spec tick(state()) -> state().
tick(#{now := Now, phase_us := Phase} = State) -> until(starl_create_tick:next(Now, Phase), State).

%% @doc A wait that was commanded begins.
-spec begins(starl_create_command:t(), state()) -> state().
begins({wait_time, 0}, #{quirks := #{no_short_waits := true}} = State) ->
    State;
begins({wait_time, Tenths}, #{now := Now} = State) ->
    until(Now + Tenths * 100000, State);
begins({wait_distance, Mm}, #{wheels := Wheels} = State) ->
    {Travelled, _} = starl_create_wheels:travelled(Wheels),
    State#{wait := {distance, beyond(Travelled, Mm)}};
begins({wait_angle, Degrees}, #{wheels := Wheels} = State) ->
    {_, Turned} = starl_create_wheels:travelled(Wheels),
    State#{wait := {angle, beyond(Turned, Degrees)}};
begins({wait_event, Event}, State) ->
    State#{wait := {event, Event}}.

beyond(Here, More) when More >= 0 -> {up, Here + More};
beyond(Here, More) -> {down, Here + More}.

%% @doc Looks whether its wait is over: it does so each 15 ms.
-spec look(state()) -> state().
look(#{wait := Wait} = State) ->
    case is_over(Wait, State) of
        true -> State#{wait := none};
        false -> State
    end.

is_over(none, _State) ->
    true;
is_over({until, Us}, #{now := Now}) ->
    Now >= Us;
is_over({distance, Place}, #{wheels := Wheels}) ->
    is_beyond(Place, element(1, starl_create_wheels:travelled(Wheels)));
is_over({angle, Place}, #{wheels := Wheels}) ->
    is_beyond(Place, element(2, starl_create_wheels:travelled(Wheels)));
is_over({event, 22}, #{mode := Mode}) ->
    Mode =:= passive;
is_over({event, Event}, State) when Event < 0 ->
    not is_over({event, -Event}, State);
is_over({event, Event}, State) ->
    is_event(Event, starl_create_sensors:readings(State)).

is_beyond({up, Place}, Here) -> Here >= Place;
is_beyond({down, Place}, Here) -> Here =< Place.

is_event(1, #{bumps_drops := B}) -> B band 2#11100 =/= 0;
is_event(2, #{bumps_drops := B}) -> B band 2#10000 =/= 0;
is_event(3, #{bumps_drops := B}) -> B band 2#01000 =/= 0;
is_event(4, #{bumps_drops := B}) -> B band 2#00100 =/= 0;
is_event(5, #{bumps_drops := B}) -> B band 2#00011 =/= 0;
is_event(6, #{bumps_drops := B}) -> B band 2#00010 =/= 0;
is_event(7, #{bumps_drops := B}) -> B band 2#00001 =/= 0;
is_event(8, #{virtual_wall := X}) -> X =/= 0;
is_event(9, #{wall := X}) -> X =/= 0;
is_event(10, Readings) -> starl_create_sensors:is_cliff(Readings);
is_event(11, #{cliff_left := X}) -> X =/= 0;
is_event(12, #{cliff_front_left := X}) -> X =/= 0;
is_event(13, #{cliff_front_right := X}) -> X =/= 0;
is_event(14, #{cliff_right := X}) -> X =/= 0;
is_event(15, #{charging_sources := X}) -> X band 2 =/= 0;
is_event(16, #{buttons := X}) -> X band 4 =/= 0;
is_event(17, #{buttons := X}) -> X band 1 =/= 0;
is_event(N, #{digital_inputs := X}) when N >= 18, N =< 21 -> X band (1 bsl (N - 18)) =/= 0;
is_event(_, _) -> false.
