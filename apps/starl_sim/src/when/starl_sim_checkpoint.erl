%% @doc Where a run goes on that does not begin at time 0: its robots as data, all at one moment between two
%% windows, and what its monitors have judged by then.
-module(starl_sim_checkpoint).

-export([pieces/1, running/1]).

-export_type([t/0]).

%% `windows': their number up to then, at least one. `past': monitors, ready to go on, from those of the plan.
%% `seed': the seed of all draws from now on, if it is not the scenario's.
-type t() :: #{
    at_us := starl_sim_queue:time(),
    windows := pos_integer(),
    robots := #{starl:robot_id() => starl_sim_robot:snapshot()},
    past := fun(([{module(), map()}]) -> starl_monitor:t()),
    seed => non_neg_integer()
}.

%% @doc The robots' pieces of motion then.
-spec pieces(t()) -> [{starl:robot_id(), starl_trajectory:piece()}].
pieces(#{robots := Robots}) ->
    [
        {Id, starl_sim_platform:piece_of(Body)}
     || {Id, #{body := Body}} <- lists:sort(maps:to_list(Robots))
    ].

%% @doc The number of robots whose application has not ended.
-spec running(t()) -> non_neg_integer().
running(#{robots := Robots}) ->
    length([
        on
     || #{body := #{result := running}, parts := #{condition := Up}} <- maps:values(Robots),
        Up =/= dead
    ]).
