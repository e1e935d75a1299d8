%% @doc What path planning must be told, and the defaults of what it need not.
-module(starl_dpp_settings).

-export([complete/1]).
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
    seed => integer()
}.
%% `slack' (0): how far from its path a robot may stand and still count as on it, the paper's
%% r(v); must not be more than the tube radius allows for. `horizon' (3000): paint per assignment.
%% `edge_length' (500): longest target edge. `leg' (500): longest segment without paint; what is
%% behind a waypoint is free for others. `turn_mm' (160): mm driven in the time of turning one
%% radian. `overhead_mm' (100): mm driven in the time of a request. `middle' (0.7): how much a line
%% counts that is begun in its middle. `patience' ({1.05, 50}): while others move, a request is
%% answered `none' rather than with a way around them that is longer than this times the straight
%% way and so many mm; `infinity' takes every way. `seed' (1): where the roadmap's points fall.

%% @doc The settings with all defaults filled in.
-spec complete(t()) -> t().
complete(Settings) -> maps:merge(defaults(), Settings).

defaults() ->
    #{slack => 0.0, horizon => 3000.0, edge_length => 500.0, leg => 500.0, turn_mm => 160.0,
      overhead_mm => 100.0, middle => 0.7, patience => {1.05, 50.0}, seed => 1}.
