%% A controller of motion: a robot waits on its line while another is close ahead, and
%% drives slower with a velocity, the nearer the others are.
-module(polite).
-behaviour(starl_controller).
-export([sees_mm/1, waits_us/1, leg/2, velocity/3]).

-define(SEES_MM, 1000).
-define(CLOSE_MM, 450).

sees_mm(_Profile) -> ?SEES_MM.

%% On the way to one goal it waits for 3 s at most, each time for a third of a second.
waits_us(_Profile) -> 3000000.

leg(To, #{pose := {X, Y, _}, near := Near}) ->
    {TX, TY} = To,
    Ahead = fun(#{offset := {OX, OY}}) -> OX * (TX - X) + OY * (TY - Y) > 0 end,
    case [N || #{distance := Mm} = N <- Near, Mm < ?CLOSE_MM, Ahead(N)] of
        [] -> go;
        _ -> {wait, 333000}
    end.

velocity({VX, VY}, _Us, #{near := [#{distance := Mm} | _]}) ->
    Part = max(0.0, min(1.0, (Mm - ?CLOSE_MM) / (?SEES_MM - ?CLOSE_MM))),
    {Part * VX, Part * VY};
velocity(Velocity, _Us, #{near := []}) ->
    Velocity.
