%% @doc A branch of a run: it equals the run up to an index of its timeline, and has other random
%% draws from then on.
%%
%% All draws of the world are hashes of the seed and their place ({@link starl_run_draw}). So each
%% robot gets another seed just after its last event before the index, and the robots' clocks,
%% machines, packets under way and motions stay what they are. An ordinary run has no branch, and no
%% part of it asks for one at an event.
%%
%% Faults that drop single packets stand for random loss. They hold up to the index; after it
%% packets are lost at random again.
-module(starl_sim_branch).

-export([plant/2, of_robot/2]).

-export_type([t/0, planted/0]).

%% `counts': the number of each robot's events before the index, none for a robot that is missing.
%% `branch_seed': makes another seed of the seed; `none' keeps it. `loss' and `faults': those of the
%% run up to the index.
-type t() :: #{
    counts := #{starl:robot_id() => non_neg_integer()},
    branch_seed := integer() | none,
    loss := number(),
    faults := [starl_run_fault:t()]
}.

%% In a world: the counts, and the values of the world from the index on.
-type planted() :: {#{starl:robot_id() => non_neg_integer()}, Later :: map()}.

%% @doc The world of a run that branches: it begins with the radio of the run before.
-spec plant(t() | none, starl_sim_world:t()) -> starl_sim_world:t().
plant(none, World) ->
    World;
plant(#{counts := Counts, branch_seed := BranchSeed, loss := Loss, faults := Faults}, World) ->
    #{seed := Seed, loss := LossLater, network := NetworkLater} = World,
    Later = #{
        seed => later_seed(Seed, BranchSeed),
        team_seed => Seed,
        loss => LossLater,
        network => [F || F <- NetworkLater, element(4, F) =/= drop]
    },
    World#{
        loss := float(Loss),
        network := [
            starl_run_fault:compile(F)
         || F <- Faults, starl_run_fault:class(F) =:= network
        ],
        branch => {Counts, Later}
    }.

later_seed(Seed, none) -> Seed;
later_seed(Seed, BranchSeed) -> erlang:phash2({Seed, BranchSeed}, 1 bsl 32).

%% @doc When a robot turns off, and what changes in its world then.
-spec of_robot(starl:robot_id(), starl_sim_world:t()) ->
    {Events :: non_neg_integer(), Later :: map()} | none.
of_robot(Robot, #{branch := {Counts, Later}}) -> {maps:get(Robot, Counts, 0), Later};
of_robot(_Robot, #{}) -> none.
