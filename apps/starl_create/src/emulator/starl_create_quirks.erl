%% @doc The quirks that an emulated Create may have: reported behaviour of real robots that differs
%% from their documents, or is not in them. One table: names, types, defaults and texts.
-module(starl_create_quirks).

-export([options/0, new/2, check/1]).

-export_type([t/0]).

-type t() :: #{atom() => term()}.

%% @doc The table, as of a command's flags.
-spec options() -> [{atom(), switch | starl_options:type(), term(), string()}].
options() ->
    [
        {checksum, {one_of, [with_header, without_header]}, with_header,
            "does the checksum of a stream's frame include its header byte?"},
        {fraction, {one_of, [kept, lost]}, lost,
            "what is left of a millimetre or a degree when the distance or the angle is read"},
        {yaw_inverted, switch, false, "the angle is positive to the right"},
        {backward_grows, switch, false, "the distance grows when the robot drives backward"},
        {angle_factor, {number, 0.01, 100}, 1.0,
            "the angle is so many times the true one (firmware to 3.4.0: 0.324056)"},
        {odometry, {number, 0.5, 2}, 1.0, "encoders and distance are so many times the true ones"},
        {mode_offset, {integer, 0, 32}, 0, "the mode in the sensors is higher by this"},
        {speed_step, {number, 0, 100}, 0, "the motors know only multiples of this speed, mm/s"},
        {no_short_waits, switch, false,
            "a Create 1's wait for no time ends at once, not at its next look (15 ms)"},
        {burst_ms, {integer, 0, 500}, 0, "bytes arrive in bursts this far apart"},
        {stray_byte, {integer, 0, 100000}, 0,
            "each so many bytes that the robot sends, one that does not belong there"},
        {asleep, switch, false, "it sleeps, until BRC is pulled low"},
        {no_wake, switch, false, "BRC is not connected: it cannot be woken"},
        {wedged, switch, false, "it sends nothing until its battery was taken out"},
        {docked, switch, false, "it stands on its dock: Safe does not hold"},
        {sleep_s, {integer, 1, 100000}, 300, "the time after which a Create 2 falls asleep"}
    ].

%% @doc The quirks of a robot of this generation.
-spec new(map(), starl_create_packet:model()) -> t().
new(Given, Model) ->
    Defaults = maps:from_list([{Key, Default} || {Key, _, Default, _} <- options()]),
    maps:merge(Defaults#{model => Model}, Given).

%% @doc The names that are no quirks.
-spec check(map()) -> [atom()].
check(Given) -> maps:keys(Given) -- [Key || {Key, _, _, _} <- options()].
