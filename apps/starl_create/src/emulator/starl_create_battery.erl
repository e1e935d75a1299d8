%% @doc The battery of an emulated Create, and its charger: the dock.
-module(starl_create_battery).

-export([new/2, is_docked/1, dock/2, pass/4, readings/3]).

-export_type([t/0, load/0]).

-record(battery, {
    charge_mah :: float(),
    is_docked :: boolean()
}).

-opaque t() :: #battery{}.

%% Do the wheels turn?
-type load() :: standing | driving.

-define(CAPACITY, 2700).

%% @doc A battery with this charge; `usual': nearly full.
-spec new(usual | number(), IsDocked :: boolean()) -> t().
new(usual, IsDocked) -> new(0.9 * ?CAPACITY, IsDocked);
new(Charge, IsDocked) -> #battery{charge_mah = float(Charge), is_docked = IsDocked}.

%% @doc Is the charger plugged in?
-spec is_docked(t()) -> boolean().
is_docked(#battery{is_docked = IsDocked}) -> IsDocked.

%% @doc The charger is plugged in or out.
-spec dock(boolean(), t()) -> t().
dock(IsDocked, Battery) -> Battery#battery{is_docked = IsDocked}.

%% @doc Time passes.
-spec pass(Us :: non_neg_integer(), atom(), load(), t()) -> t().
pass(Us, Mode, Load, #battery{charge_mah = Charge} = Battery) ->
    Used = current_ma(Mode, Load, Battery) * Us / 3.6e9,
    Battery#battery{charge_mah = max(0.0, min(float(?CAPACITY), Charge + Used))}.

%% It charges in Off and Passive only.
current_ma(Mode, _, #battery{is_docked = true}) when Mode =:= off; Mode =:= passive -> 1200;
current_ma(_Mode, standing, _Battery) -> -200;
current_ma(_Mode, driving, _Battery) -> -700.

%% @doc What the sensors show.
-spec readings(atom(), load(), t()) -> starl_create_packet:readings().
readings(Mode, Load, #battery{charge_mah = Charge, is_docked = IsDocked} = Battery) ->
    #{
        charge => round(Charge),
        capacity => ?CAPACITY,
        voltage => round(12500 + 4000 * Charge / ?CAPACITY),
        current => current_ma(Mode, Load, Battery),
        temperature => 25,
        charging_state => state(Mode, Battery),
        charging_sources => source(IsDocked)
    }.

source(true) -> 2;
source(false) -> 0.

%% 0: it does not charge; 2: it does; 3: it is full; 4: it waits.
state(_Mode, #battery{is_docked = false}) -> 0;
state(Mode, _Battery) when Mode =:= safe; Mode =:= full -> 4;
state(_Mode, #battery{charge_mah = Charge}) when Charge >= ?CAPACITY -> 3;
state(_Mode, _Battery) -> 2.
