%% @doc What can be chosen for the driver of a Create.
-module(starl_create_options).

-export([options/0, baud/1]).

-export_type([t/0]).

%% `device': what the port opens. `baud': that of the robot (default: as it is delivered). `mode':
%% safe, in which the robot stops by itself at a cliff and when it is lifted, or full. `wake': the
%% line of the port that is wired to BRC. `on_robot': scripts of a Create 1 on the robot. `jitter_ms'
%% (20): how late bytes may be on the line.
-type t() :: #{
    device := term(),
    model := starl_create_packet:model(),
    baud => pos_integer() | none,
    mode => safe | full,
    wake => dtr | rts | none,
    on_robot => boolean(),
    jitter_ms => pos_integer(),
    pen => starl_create_order:pen(),
    stops_at_bumps => boolean()
}.

%% @doc The table of what can be chosen, as of a fleet file.
-spec options() -> [starl_options:option()].
options() ->
    [
        {model, {integer, 1, 2}, 2, "the generation: 1 (Create, 2006) or 2 (Create 2, Roomba 600)"},
        {baud, {optional, {integer, 300, 115200}}, none, "of its line; none: as it is delivered"},
        {mode, {one_of, [safe, full]}, safe, "safe: it stops at cliffs and when it is lifted"},
        {wake, {one_of, [rts, dtr, none]}, rts, "the line of the adapter that is wired to BRC"},
        {on_robot, switch, true, "a Create 1 stops by itself when its computer is gone"},
        {jitter_ms, {integer, 1, 40}, 20,
            "how late bytes may be on its line; less lets it drive faster"}
    ].

%% @doc The baud rate of the robot's line.
-spec baud(t()) -> pos_integer().
baud(#{baud := Baud}) when is_integer(Baud) -> Baud;
baud(#{model := 1}) -> 57600;
baud(#{model := 2}) -> 115200.
