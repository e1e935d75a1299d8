%% @doc The world of a simulation: the data that all its robots share, and the random draws of each
%% robot.
-module(starl_sim_world).

-export([base/4, recorded/2, faults/3, clock/2]).

-export_type([t/0]).

%% The seed, the radio, the clocks and the chassis' errors, and the
%% faults of each class; faults of the serial line are among those of actuation.
%% `sight' knows the pieces of motion that all robots were in when the window began.
%% `record' names the robots and events to record; `packets': each packet is traced.
%% After a branch ({@link starl_sim_branch}) `team_seed' is the seed that all robots knew from the
%% beginning.
-type t() :: #{
    seed := integer(),
    team_seed => integer(),
    branch => starl_sim_branch:planted(),
    team := starl_team:t(),
    clock := {OffsetUs :: non_neg_integer(), DriftPpb :: non_neg_integer()},
    sight => starl_sim_sight:t(),
    loss := float(),
    duplicate := float(),
    delay_us := {Min :: pos_integer(), Max :: pos_integer()},
    range_mm := float() | infinity,
    %% the part of the packets that each wall in their way takes
    wall_loss => float(),
    %% the deviation of the loss on the way between two places, dB
    shadowing => float(),
    %% the delay of a command on its way to the chassis
    latency_us => {Min :: non_neg_integer(), Max :: non_neg_integer()},
    profiles := starl_chassis:profiles(),
    %% bodies are solid
    walls => starl_walls:t(),
    %% what stands in the way for a time, if anything does
    obstacles => starl_obstacles:t(),
    %% what the senses see on the floor, and their measures
    senses => starl_sim_senses:t(),
    network := [starl_run_fault:compiled()],
    clocks := [starl_run_fault:compiled()],
    location := [starl_run_fault:compiled()],
    sense => [starl_run_fault:compiled()],
    actuation := [starl_run_fault:compiled()],
    store := [starl_run_fault:compiled()],
    record => #{starl:robot_id() => starl_sim_ledger:range()},
    packets => boolean(),
    %% the machines of whose calls histories are kept
    histories => [starl_machine:name()],
    %% the reloads by number, if there are any, and the modules of a robot's machines
    reloads => #{pos_integer() => starl_run_reloads:t()},
    parts => #{starl_machine:name() => module()}
}.

%% @doc The start configuration of a machine, as far as it is the world's.
-spec base(starl:robot_id(), starl_machine:name(), Incarnation :: pos_integer(), t()) -> map().
base(Id, Name, Incarnation, #{team := Team} = World) ->
    #{
        robot => Id,
        participants => Team,
        name => Name,
        incarnation => Incarnation,
        random => random(Id, Name, Incarnation, World),
        team_seed => team_seed(World),
        histories => maps:get(histories, World, [])
    }.

%% A restart begins another stream: a robot that has started anew does not know how far it had got.
%% The first one is the same in all branches of a run: what its applications are about to do is how
%% a run begins, as the places of its robots, and no event of it.
random(Id, Name, 1, World) ->
    stream({team_seed(World), Id, Name});
random(Id, Name, Incarnation, #{seed := Seed}) ->
    stream({Seed, Id, Name, Incarnation}).

stream(Key) -> rand:seed_s(exsss, erlang:phash2(Key, 1 bsl 32)).

team_seed(#{seed := Seed} = World) -> maps:get(team_seed, World, Seed).

%% @doc The events of a robot that are to be recorded.
-spec recorded(starl:robot_id(), t()) -> starl_sim_ledger:range() | none.
recorded(Id, World) -> maps:get(Id, maps:get(record, World, #{}), none).

%% @doc The faults of a class that strike a robot.
-spec faults(starl:robot_id(), clocks | store, t()) -> [starl_run_fault:compiled()].
faults(Id, Class, World) -> [F || F <- maps:get(Class, World), starl_run_fault:hits(Id, F)].

%% @doc The clock of a robot. Clocks do not change with a branch.
-spec clock(starl:robot_id(), t()) -> starl_sim_clock:t().
clock(Id, #{clock := {OffsetUs, DriftPpb}} = World) ->
    Seed = team_seed(World),
    Offset = round(starl_run_draw:signed({Seed, Id, offset}) * OffsetUs),
    Drift = round(starl_run_draw:signed({Seed, Id, drift}) * DriftPpb),
    starl_sim_clock:new(Offset, Drift, faults(Id, clocks, World)).
