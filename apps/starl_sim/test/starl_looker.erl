%% An application whose robots stand, and tell who is near: as they ask for it, and among all.
-module(starl_looker).
-behaviour(starl_app).
-export([options/0, init/2, step/2]).

options() -> [{mm, {integer, 1, 100000}, 5000, "how far they look, mm"}].

init(_Robot, #{mm := Mm}) -> Mm.

step(Robot, Mm) ->
    {ok, Near} = starl:neighbours(Robot, Mm),
    {ok, All} = starl:positions(Robot),
    Id = starl:id(Robot),
    #{Id := {X, Y, _}} = All,
    Measured = [
        Other
     || {Other, {OX, OY, _}} <- lists:sort(maps:to_list(All)),
        Other =/= Id,
        starl_geometry:distance({X, Y}, {OX, OY}) =< Mm
    ],
    {done, {lists:sort([Other || #{robot := Other} <- Near]), Measured}}.
