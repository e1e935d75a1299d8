%% Robots that flock as birds do: each looks at its neighbours and drives along the sum of four
%% vectors, five times a second.
-module(flock).
-behaviour(starl_app).
-export([options/0, monitors/1, init/2, step/2, report/2]).

-define(CENTRE, {6000, 6000}).

options() ->
    [
        {spacing, {number, 400, 5000}, 1000, "neighbours keep about this far apart, mm"},
        {flight, {integer, 1, 3600}, 30, "the duration of the flight, s"}
    ].

monitors(_Context) -> [{flock_monitor, #{least_mm => 330}}].

init(Robot, #{spacing := Spacing, flight := Seconds}) ->
    Angle = 2 * math:pi() * starl:random(Robot),
    #{
        spacing => Spacing,
        until => starl:now(Robot) + 1000 * Seconds,
        way => {math:cos(Angle), math:sin(Angle)}
    }.

step(Robot, #{until := Until, way := Way} = Flight) ->
    case {starl:now(Robot) >= Until, starl:position(Robot), starl:neighbours(Robot, 2500)} of
        {true, _, _} ->
            starl:stop(Robot),
            {done, Way};
        {false, {ok, {X, Y, _}}, {ok, Near}} ->
            Next = unit(sum([Way, home({X, Y}) | rules(Near, Flight)])),
            starl:velocity(Robot, times(300, Next), 600),
            [starl:trace(Robot, {nearest, Mm}) || #{distance := Mm} <- lists:sublist(Near, 1)],
            starl:sleep(Robot, 200),
            {continue, Flight#{way := Next}};
        {false, _, _} ->
            %% no position: the robot stops by itself after 600 ms
            starl:sleep(Robot, 200),
            {continue, Flight}
    end.

%% The robots' own figures: 1 when all drive the same way, near 0 when each has its own.
report(_Scene, #{robots := Robots, monitors := #{flock_monitor := #{nearest_mm := Nearest}}}) ->
    Ways = [Way || {_, #{result := {done, Way}}} <- Robots],
    #{
        figures => [
            {polarisation, size_of(sum(Ways)) / max(1, length(Ways))},
            {nearest_mm, Nearest}
        ],
        formats => #{
            polarisation => #{label => "polarisation", plotted => true},
            nearest_mm => #{decimals => 1, rounded => down}
        }
    }.

%% Towards neighbours that are too far, away from those that are too near, and along with all.
rules(Near, #{spacing := Spacing}) ->
    [times(pull(Mm, Spacing) / Mm, Offset) || #{distance := Mm, offset := Offset} <- Near] ++
        [times(0.5, {math:cos(H), math:sin(H)}) || #{pose := {_, _, H}} <- Near].

pull(Mm, Spacing) -> max(-5.0, 0.3 * (1 - math:pow(Spacing / Mm, 3))).

%% Back to the middle of the floor, the stronger the farther away.
home({X, Y}) ->
    {CX, CY} = ?CENTRE,
    Away = size_of({CX - X, CY - Y}),
    times(math:pow(Away / 4000, 4) / max(1, Away), {CX - X, CY - Y}).

sum(Vectors) -> {lists:sum([X || {X, _} <- Vectors]), lists:sum([Y || {_, Y} <- Vectors])}.

times(Factor, {X, Y}) -> {Factor * X, Factor * Y}.

unit(Vector) -> times(1 / max(1.0e-6, size_of(Vector)), Vector).

size_of({X, Y}) -> math:sqrt(X * X + Y * Y).
