%% @doc The settings of path planning, with their defaults.
-module(starl_dpp_settings).

-export([complete/1, options/0]).
-export_type([t/0]).

-type t() :: #{
    segments := [starl_geometry:segment()],
    world := starl_roadmap:world(),
    robots := [pos_integer()],
    tube_radius := float(),
    slack => float(),
    horizon => float(),
    edge_length => float(),
    leg => float(),
    turn_mm => float(),
    overhead_mm => float(),
    middle => float(),
    patience => {Factor :: float(), Mm :: float()} | infinity,
    choice => starl_dpp_rule:name(),
    ways => starl_dpp_floor:t() | none,
    seed => integer()
}.
%% `slack' (0): the distance from its path within which a robot counts as on it, the paper's r(v);
%% must not be more than the tube radius allows for. `horizon' (3000): paint per assignment.
%% `edge_length' (500): longest target edge. `leg' (500): longest segment without paint; the space
%% behind a waypoint is free for others. `turn_mm' (160): mm driven in the time of turning one
%% radian. `overhead_mm' (100): mm driven in the time of a request. `middle' (0.7): the weight of a
%% line that is begun in its middle. `patience' ({1.05, 50}): factor F and length M; while others
%% move, a request is answered `none' rather than with a way around them longer than F times the
%% straight way plus M; `infinity' takes every way. `choice' (ink): the rule that chooses what a robot paints
%% next. `ways' (none): the roadmap of a floor with walls.
%% `seed' (1): of the roadmap's points.

%% @doc The settings with all defaults filled in.
-spec complete(t()) -> t().
complete(Settings) -> maps:merge(defaults(), Settings).

defaults() ->
    Required = [segments, world, tube_radius],
    maps:from_list([
        {Key, Default}
     || {Key, _, Default, _} <- options(), not lists:member(Key, Required)
    ]).

%% @doc The same as a table.
-spec options() -> [starl_options:option()].
options() ->
    Mm = {number, 0, 1.0e9},
    [
        {segments, {term, "a list of lines {{X1, Y1}, {X2, Y2}}", fun is_list/1}, [],
            "the target edges: what is to be painted, mm"},
        {world, {size, {number, 1000, 1000000}}, {12000.0, 12000.0}, "size of the floor, mm"},
        {tube_radius, Mm, 365.0, "the radius of the tubes that robots hold, mm"},
        {slack, Mm, 0.0, "the most by which a robot may be off its path, the paper's r(v), mm"},
        {horizon, Mm, 3000.0, "length of the lines that a robot gets at a time, mm"},
        {edge_length, Mm, 500.0, "the longest target edge, mm"},
        {leg, Mm, 500.0, "the longest segment without paint, mm"},
        {turn_mm, Mm, 160.0, "mm driven in the time of turning one radian"},
        {overhead_mm, Mm, 100.0, "mm driven in the time of a request"},
        {middle, {number, 0, 1}, 0.7, "the weight of a line that is begun in its middle"},
        {patience, {term, "{Factor, Mm}, or infinity", fun is_patience/1}, {1.05, 50.0},
            "the longest way round others, against the straight one"},
        {choice, {term, choices(), fun starl_dpp_rule:is_rule/1}, ink,
            "the rule that chooses what a robot paints next"},
        {ways, {term, "the ways of a floor with walls, or none", fun is_ways/1}, none,
            "where robots drive on a floor with walls"},
        {seed, {integer, 0, 1 bsl 64}, 1, "where the points of the roadmap fall"}
    ].

choices() ->
    Names = lists:join(", ", [atom_to_list(Name) || Name <- starl_dpp_rule:names()]),
    lists:append(Names) ++ ", or a module of yours (behaviour starl_dpp_rule)".

is_ways(Ways) -> Ways =:= none orelse starl_dpp_floor:is_ways(Ways).

is_patience({Factor, Mm}) -> is_number(Factor) andalso is_number(Mm);
is_patience(Patience) -> Patience =:= infinity.
