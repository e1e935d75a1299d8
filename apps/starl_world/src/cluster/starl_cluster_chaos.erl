%% @doc Chaos for a cluster: random faults, drawn from a seed. A pure module.
%%
%% In the first part of the run, two nodes are killed, one of them the leader's. One is halted for a
%% second or two. A link is cut for ten seconds. For five seconds each, the positions of one robot
%% freeze, the disk of one is full, and the senses of one have a fault.
-module(starl_cluster_chaos).

-export([draw/3, cables/3, halts/3, stores/3, full_disks/3, aimed/2]).

-export_type([fault/0]).

%% A random fault. Its target may be the leader at its time. A pause may be in the middle of work. A cable
%% may be pulled in time, before hardware could drive on without it.
-type fault() ::
    starl_run_manual_fault:t()
    | {starl_run_fault:kind(), leader, map(), non_neg_integer()}.

-define(CUT_MS, 10000).
-define(FREEZE_MS, 5000).
-define(FULL_MS, 5000).
-define(SENSE_MS, 5000).
%% The time without a cable, and from one pull to the next.
-define(UNPLUGGED_MS, 1000).
-define(PULL_US, 4000000).
%% From one halt, or lost store, to the next; the length of a halt, of the computer.
-define(HALT_US, 10000000).
-define(HALT_MS, {1000, 2000}).

%% @doc Random faults of these robots between two times of the run, in the order of their times.
-spec draw(Seed :: integer(), [starl:robot_id(), ...], {FromUs, ToUs}) ->
    [{AtUs :: integer(), fault()}]
when
    FromUs :: integer(), ToUs :: integer().
draw(Seed, Robots, {From, To}) ->
    {Times, Random0} = some(4, fun(R) -> between(From, To, R) end, rand:seed_s(exsss, Seed)),
    {Chosen, Random1} = some(4, fun(R) -> one_of(Robots, R) end, Random0),
    {[T1, T2, T3, T4], [A, B, C, D]} = {Times, Chosen},
    {T5, Random2} = between(From, To, Random1),
    {E, Random3} = one_of(Robots, Random2),
    {Halt, Random4} = drawn_halt(E, Random3),
    {T6, Random5} = between(From, To, Random4),
    {F, Random6} = one_of(Robots, Random5),
    {T7, Random7} = between(From, To, Random6),
    {G, Random8} = one_of(Robots, Random7),
    {{_, Kind, Params}, _} = one_of(starl_live_sense_fault:known(), Random8),
    lists:sort(
        [{T5, Halt}, {T1, {reboot, leader, #{}, 0}}, {T2, {reboot, A, #{}, 0}}] ++
            [{T3, Half} || B =/= C, Half <- starl_run_manual_fault:cut(B, C, ?CUT_MS)] ++
            [{T4, {location_frozen, D, #{}, ?FREEZE_MS}}, {T6, full(F)}] ++
            [{T7, {Kind, G, Params#{sense => all}, ?SENSE_MS}}]
    ).

%% @doc This number of pulled cables, one after the other, of random robots. Each is put back a second
%% later. A robot that could drive on without its cable loses it while it stands.
-spec cables(Seed :: integer(), [starl:robot_id(), ...], Times :: non_neg_integer()) ->
    [{AtUs :: integer(), fault()}].
cables(Seed, Robots, Times) ->
    Span = fun(N, R0) ->
        {At, R1} = between(N * ?PULL_US, (N + 1) * ?PULL_US - 2000 * ?UNPLUGGED_MS, R0),
        {Robot, R2} = one_of(Robots, R1),
        {{At, {serial_gone, Robot, #{in_time => true}, ?UNPLUGGED_MS}}, R2}
    end,
    {Faults, _} = lists:mapfoldl(Span, rand:seed_s(exsss, Seed), lists:seq(1, Times)),
    Faults.

%% @doc This number of halts in the middle of a step, one after the other, of random robots.
-spec halts(Seed :: integer(), [starl:robot_id(), ...], Times :: non_neg_integer()) ->
    [{AtUs :: integer(), fault()}].
halts(Seed, Robots, Times) ->
    apart(Seed, Robots, Times, fun drawn_halt/2).

drawn_halt(Robot, Random0) ->
    {Least, Most} = ?HALT_MS,
    {Ms, Random} = between(Least, Most, Random0),
    {{pause, Robot, #{at_work => true}, Ms}, Random}.

%% @doc This number of kills with a store that is lost, or set back, one after the other, of random
%% robots.
-spec stores(Seed :: integer(), [starl:robot_id(), ...], Times :: non_neg_integer()) ->
    [{AtUs :: integer(), fault()}].
stores(Seed, Robots, Times) ->
    apart(Seed, Robots, Times, fun(Robot, Random0) ->
        {Kind, Random} = one_of([store_lost, store_set_back], Random0),
        {{Kind, Robot, #{}, 0}, Random}
    end).

%% @doc This number of disks that are full for five seconds, one after the other, of random robots.
-spec full_disks(Seed :: integer(), [starl:robot_id(), ...], Times :: non_neg_integer()) ->
    [{AtUs :: integer(), fault()}].
full_disks(Seed, Robots, Times) ->
    apart(Seed, Robots, Times, fun(Robot, Random) -> {full(Robot), Random} end).

full(Robot) -> {store_full, Robot, #{}, ?FULL_MS}.

apart(Seed, Robots, Times, Draw) ->
    Fault = fun(N, R0) ->
        {At, R1} = between(N * ?HALT_US, (N + 1) * ?HALT_US - 1, R0),
        {Robot, R2} = one_of(Robots, R1),
        {Drawn, R3} = Draw(Robot, R2),
        {{At, Drawn}, R3}
    end,
    {Faults, _} = lists:mapfoldl(Fault, rand:seed_s(exsss, Seed), lists:seq(1, Times)),
    Faults.

some(N, Draw, Random0) ->
    lists:mapfoldl(fun(_, Random) -> Draw(Random) end, Random0, lists:seq(1, N)).

between(From, To, Random) ->
    {N, Next} = rand:uniform_s(To - From + 1, Random),
    {From + N - 1, Next}.

one_of(Robots, Random) ->
    {N, Next} = rand:uniform_s(length(Robots), Random),
    {lists:nth(N, Robots), Next}.

%% @doc The fault with the number of the present leader; `none' if no robot leads.
-spec aimed(fault(), Leader :: starl:robot_id() | none) -> starl_run_manual_fault:t() | none.
aimed({_, leader, _, _}, none) -> none;
aimed({Kind, leader, Params, Lasts}, Leader) -> {Kind, Leader, Params, Lasts};
aimed(Fault, _Leader) -> Fault.
