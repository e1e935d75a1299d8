%% @doc Chaos for a cluster: what happens to its nodes and links, drawn from a seed. A pure module.
%%
%% Of a team of five two nodes are killed, that of the leader among them; one is halted for a second or
%% two; a link is cut for ten seconds; one robot's positions freeze for five; the disk of one is full for
%% five; the senses of one have a fault for five. All within the first part of the run.
-module(starl_cluster_chaos).

-export([draw/3, cables/3, halts/3, stores/3, full_disks/3, targets/2]).

-export_type([act/0]).

%% An act, with robots by number; or the leader of that moment.
-type act() ::
    {kill | lose_store | set_back, robot()}
    | {pause_at_work, robot(), Seconds :: number()}
    | {cut, robot(), robot()}
    | {mend, robot(), robot()}
    | {unplug_in_time, robot()}
    | {plug, robot()}
    | {freeze, robot()}
    | {thaw, robot()}
    | {fill, robot()}
    | {clear, robot()}
    | {sense, robot(), all, starl_live_sense_fault:fault() | well}.

-type robot() :: starl:robot_id() | leader.

-define(CUT_US, 10000000).
-define(FREEZE_US, 5000000).
-define(FULL_US, 5000000).
-define(SENSE_US, 5000000).
%% The time without a cable, and from one pull to the next.
-define(UNPLUGGED_US, 1000000).
-define(PULL_US, 4000000).
%% From one halt, or lost store, to the next; the length of a halt, of the computer.
-define(HALT_US, 10000000).
-define(HALT_MS, {1000, 2000}).

%% @doc The acts for these robots, between two times of the run, in the order of their time.
-spec draw(Seed :: integer(), [starl:robot_id(), ...], {FromUs, ToUs}) ->
    [{AtUs :: integer(), act()}]
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
    {{_, Fault}, _} = one_of(starl_live_sense_fault:known(), Random8),
    lists:sort(
        [{T5, Halt}, {T1, {kill, leader}}, {T2, {kill, A}}] ++
            lists:append([[{T3, {cut, B, C}}, {T3 + ?CUT_US, {mend, B, C}}] || B =/= C]) ++
            [{T4, {freeze, D}}, {T4 + ?FREEZE_US, {thaw, D}}] ++
            full({T6, F}) ++
            [{T7, {sense, G, all, Fault}}, {T7 + ?SENSE_US, {sense, G, all, well}}]
    ).

%% @doc So many pulled cables, one after the other, of robots that are drawn; each is put back a second
%% later. What could drive on without its cable is pulled when it stands.
-spec cables(Seed :: integer(), [starl:robot_id(), ...], Times :: non_neg_integer()) ->
    [{AtUs :: integer(), act()}].
cables(Seed, Robots, Times) ->
    Span = fun(N, R0) ->
        {At, R1} = between(N * ?PULL_US, (N + 1) * ?PULL_US - 2 * ?UNPLUGGED_US, R0),
        {Robot, R2} = one_of(Robots, R1),
        {[{At, {unplug_in_time, Robot}}, {At + ?UNPLUGGED_US, {plug, Robot}}], R2}
    end,
    {Acts, _} = lists:mapfoldl(Span, rand:seed_s(exsss, Seed), lists:seq(1, Times)),
    lists:append(Acts).

%% @doc So many halts in the middle of a step, one after the other, of robots that are drawn.
-spec halts(Seed :: integer(), [starl:robot_id(), ...], Times :: non_neg_integer()) ->
    [{AtUs :: integer(), act()}].
halts(Seed, Robots, Times) ->
    apart(Seed, Robots, Times, fun drawn_halt/2).

drawn_halt(Robot, Random0) ->
    {Least, Most} = ?HALT_MS,
    {Ms, Random} = between(Least, Most, Random0),
    {{pause_at_work, Robot, Ms / 1000}, Random}.

%% @doc So many stores that are lost, or set back, with a kill of the node, one after the other, of
%% robots that are drawn.
-spec stores(Seed :: integer(), [starl:robot_id(), ...], Times :: non_neg_integer()) ->
    [{AtUs :: integer(), act()}].
stores(Seed, Robots, Times) ->
    apart(Seed, Robots, Times, fun(Robot, Random0) ->
        {What, Random} = one_of([lose_store, set_back], Random0),
        {{What, Robot}, Random}
    end).

%% @doc So many disks that are full for five seconds, one after the other, of robots that are drawn.
-spec full_disks(Seed :: integer(), [starl:robot_id(), ...], Times :: non_neg_integer()) ->
    [{AtUs :: integer(), act()}].
full_disks(Seed, Robots, Times) ->
    Filled = apart(Seed, Robots, Times, fun(Robot, Random) -> {Robot, Random} end),
    lists:sort(lists:append([full(Each) || Each <- Filled])).

full({At, Robot}) -> [{At, {fill, Robot}}, {At + ?FULL_US, {clear, Robot}}].

apart(Seed, Robots, Times, Draw) ->
    Act = fun(N, R0) ->
        {At, R1} = between(N * ?HALT_US, (N + 1) * ?HALT_US - 1, R0),
        {Robot, R2} = one_of(Robots, R1),
        {Drawn, R3} = Draw(Robot, R2),
        {{At, Drawn}, R3}
    end,
    {Acts, _} = lists:mapfoldl(Act, rand:seed_s(exsss, Seed), lists:seq(1, Times)),
    Acts.

some(N, Draw, Random0) ->
    lists:mapfoldl(fun(_, Random) -> Draw(Random) end, Random0, lists:seq(1, N)).

between(From, To, Random) ->
    {N, Next} = rand:uniform_s(To - From + 1, Random),
    {From + N - 1, Next}.

one_of(Robots, Random) ->
    {N, Next} = rand:uniform_s(length(Robots), Random),
    {lists:nth(N, Robots), Next}.

%% @doc The act with the present leader's number; `none' if nobody leads.
-spec targets(act(), Leader :: starl:robot_id() | none) -> act() | none.
targets({kill, leader}, none) -> none;
targets({kill, leader}, Leader) -> {kill, Leader};
targets(Act, _Leader) -> Act.
