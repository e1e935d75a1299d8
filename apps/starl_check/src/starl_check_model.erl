%% @doc What is checked: for each block its machine, the clients that use it, the monitor that
%% judges, and what may happen.
%%
%% The smallest team and the shortest scripts that show what a block does; README.md tells why
%% they are as they are. The times of the mutex are its defaults: nothing depends on their size,
%% only on their proportions.
-module(starl_check_model).

-export([blocks/0, new/2, machines/2, timer/2, permutations/1, may_be_inert/3]).

-export_type([t/0, block/0, options/0, budgets/0, timer_kind/0]).

-type block() :: sap | election | bully | mutex | barrier | terms | registers | geocast.

%% How often each fault may happen; see {@link starl_check}.
-type budgets() :: #{
    loss => non_neg_integer(),
    crash => non_neg_integer(),
    sap => non_neg_integer(),
    dup => non_neg_integer(),
    late => non_neg_integer(),
    timeout => non_neg_integer(),
    reboot => non_neg_integer(),
    death => non_neg_integer()
}.

%% `machine': another machine in the place of the block's, with what it adds to the
%% configuration: for tests. `crash': which machines may crash. The reductions, each `true' unless
%% said otherwise: `symmetry', robots that differ in nothing but their number
%% are taken for one another; `reduce' ({@link starl_check_reduce}); `leave_out' ({@link
%% starl_check_inert}). `workers': how many processes go into states, by default one a core, where
%% a layer of the search has at least `spread' bytes.
-type options() :: #{
    robots => pos_integer(),
    faults => budgets(),
    machine => {module(), Config :: map()} | {starl_machine:name(), module(), Config :: map()},
    crash => [starl_machine:name()],
    rounds => pos_integer(),
    terms => pos_integer(),
    symmetry => boolean(),
    reduce => boolean(),
    leave_out => boolean(),
    past_us => non_neg_integer(),
    waits => [starl_check_term:place()],
    workers => pos_integer(),
    spread => non_neg_integer()
}.

%% `sap': real, over packets, or as its contract says; `crash': which machines may crash; `timed':
%% the timers whose order matters, `steps' those that fire at any moment, as the client's do, the
%% others when nothing is under way; `rates': µs that each robot's
%% clock gains in a tick; `grain': time passes to the next timed timer or by so many ticks;
%% `horizon_us': how long a time in a message that is over is still told from an earlier one,
%% `past_us': one in a machine's data; `waits': the places where it matters when a machine began,
%% elsewhere that is long ago; `fixed': the places of robots that are unlike all others;
%% `same_random': all robots draw the same; `draws': a robot draws the `same' each time;
%% `beyond': what would come after one of these events is
%% not gone into; `known': what may be traced.
-type t() :: #{
    block := block(),
    ids := [starl:robot_id()],
    faults := budgets(),
    sap := real | contract,
    blocks := [{starl_machine:name(), module(), Config :: map()}],
    script := fun((starl_check_term:place()) -> starl_check_client:script()),
    crash := [starl_machine:name()],
    monitor := {module(), Config :: map()},
    known := starl_event:known(),
    timed := [atom()],
    steps := [atom()],
    rates := tuple(),
    grain := pos_integer() | none,
    horizon_us := pos_integer(),
    past_us := non_neg_integer(),
    waits := [starl_check_term:place()],
    fixed := [starl_check_term:place()],
    same_random := boolean(),
    draws := free | same,
    beyond := fun((starl_monitor:trace_event()) -> boolean()),
    rounds := pos_integer(),
    terms := pos_integer(),
    symmetry := boolean(),
    reduce := boolean(),
    leave_out := boolean(),
    workers := pos_integer(),
    spread := non_neg_integer()
}.

-type timer_kind() :: step | timed | patience | free.

%% µs that a clock gains in a tick; the ratio of the slowest to the fastest is the default bound
%% on drift, 10000 ppm.
-define(SLOW, 99).
-define(FAST, 101).
-define(TOKEN, door).
-define(LEASE_US, 8000000).
%% A message's lifetime, and a part of it that is told from the next.
-define(CAST_US, 400000).
-define(CAST_TICK_US, 50000).
%% As many make about a second.
-define(TICKS, 10000).
-define(TERM_LEASE_US, 4000000).
%% So many terms in a row are followed.
-define(TERMS, 3).
%% It does not pay to spread fewer bytes of states over several cores.
-define(SPREAD, 100000).

%% @doc All blocks, and what is checked of each.
-spec blocks() -> [{block(), string()}].
blocks() ->
    [
        {sap, "reliable messages, packet by packet"},
        {election, "election by randomized ballots"},
        {bully, "election by the bully algorithm"},
        {mutex, "mutual exclusion, with leases and drifting clocks"},
        {barrier, "barrier, two rounds"},
        {terms, "path planning: votes, leases and terms of coordinators, with drifting clocks"},
        {registers, "shared registers: two writers of one register, and who reads it"},
        {geocast, "a message to an area and its lifetime, with drifting clocks"}
    ].

%% @doc The model of a block.
-spec new(block(), options()) -> t().
new(Block, Options) ->
    Robots = maps:get(robots, Options, 3),
    Ids = [starl_check_term:id(Place) || Place <- lists:seq(1, Robots)],
    None = #{
        loss => 0,
        crash => 0,
        sap => 0,
        dup => 0,
        late => 0,
        timeout => 0,
        reboot => 0,
        death => 0
    },
    Faults = faults(Block, maps:merge(None, maps:get(faults, Options, #{}))),
    Common = #{
        block => Block,
        ids => Ids,
        faults => Faults,
        sap => contract,
        timed => [],
        steps => [],
        rates => erlang:make_tuple(Robots, ?FAST),
        grain => none,
        horizon_us => 1,
        past_us => 0,
        waits => places(Ids),
        fixed => [],
        same_random => false,
        draws => free,
        beyond => fun(_) -> false end,
        rounds => maps:get(rounds, Options, 2),
        terms => maps:get(terms, Options, ?TERMS),
        symmetry => maps:get(symmetry, Options, true),
        reduce => maps:get(reduce, Options, true),
        leave_out => maps:get(leave_out, Options, true),
        workers => maps:get(workers, Options, erlang:system_info(schedulers_online)),
        spread => maps:get(spread, Options, ?SPREAD)
    },
    Told = maps:with([past_us, waits], Options),
    Model = maps:merge(maps:merge(Common, block(Block, Common)), Told),
    Crash = maps:get(crash, Options, maps:get(crash, Model)),
    #{monitor := {Monitor, _}} = Model,
    Judged = Model#{crash := Crash, known => starl_monitor:known([Monitor])},
    with_machine(maps:find(machine, Options), Judged).

%% Where SAP is what is checked, its crashes are those of the block's machine.
faults(sap, #{crash := Crash, sap := Sap} = Faults) -> Faults#{crash := Crash + Sap, sap := 0};
faults(_Block, Faults) -> Faults.

with_machine(error, Model) ->
    Model;
with_machine({ok, {Name, Module, Extra}}, #{blocks := Blocks} = Model) ->
    {Name, _, Config} = lists:keyfind(Name, 1, Blocks),
    Planted = {Name, Module, maps:merge(Config, Extra)},
    Model#{blocks := lists:keyreplace(Name, 1, Blocks, Planted)};
with_machine({ok, {Module, Extra}}, #{blocks := [{Name, _, Config} | Rest]} = Model) ->
    Model#{blocks := [{Name, Module, maps:merge(Config, Extra)} | Rest]}.

%% The first robot sends to the second, the second to all; one retransmission.
block(sap, #{ids := Ids}) ->
    #{
        sap => real,
        blocks => [{sap, starl_sap, #{limit => 1}}],
        script => fun(Place) -> sap_script(Place, Ids) end,
        crash => [sap],
        monitor => {starl_sap_monitor, #{bound_us => 1}},
        fixed => places(Ids)
    };
%% Only the largest ballot of a complete set counts, so nothing but the place of its robot could
%% make a difference, and every place is as good as the last: all draw the same ballot here, the
%% robot's number decides, and all robots but the last are alike.
block(election, #{ids := Ids}) ->
    #{
        same_random => true,
        blocks => [{election, starl_election_ballots, #{}}],
        script => fun(_) -> [{call, election, {elect, first, 30000000}}] end,
        crash => [election, app],
        monitor => {starl_election_monitor, #{robots => Ids, bound_us => 1}},
        fixed => [length(Ids)]
    };
block(bully, #{ids := Ids, faults := Faults}) ->
    Lossless = lists:sum(maps:values(Faults)) =:= 0,
    Judge = #{robots => Ids, bound_us => 1, lossless => Lossless},
    #{
        blocks => [{election, starl_election_bully, #{}}],
        script => fun(_) -> [{call, election, {elect, first, 30000000}}] end,
        crash => [election, app],
        monitor => {starl_election_bully_monitor, Judge},
        fixed => places(Ids)
    };
%% The home's clock is fast, all others slow: so a holder's lease lasts longest and the home's
%% shortest, the only two that are held against each other. The home's own client wants nothing:
%% what it asks of its own machine needs no message.
block(mutex, #{ids := Ids}) ->
    Home = erlang:phash2(?TOKEN, length(Ids)) + 1,
    Slow = erlang:make_tuple(length(Ids), ?SLOW),
    #{
        blocks => [{mutex, starl_mutex_tokens, #{}}],
        script => fun(Place) -> [{hold, ?TOKEN} || Place =/= Home] end,
        crash => [mutex, app],
        monitor => {starl_mutex_monitor, #{}},
        timed => [lease, home],
        rates => setelement(Home, Slow, ?FAST),
        grain => ?LEASE_US div (2 * ?SLOW) + 1,
        %% at most a lease is added to the time that a message carries before it is compared with
        %% the present. A machine keeps ends of leases, which are compared as they are: one that
        %% is over is over, however long
        horizon_us => ?LEASE_US,
        %% a machine that starts anew waits as the home that it is, which only one robot is
        waits => [Home],
        fixed => [Home]
    };
block(barrier, #{ids := Ids, rounds := Rounds}) ->
    #{
        blocks => starl_barrier:blocks(),
        script => fun(_) -> [{sync, gate, Rounds} || _ <- lists:seq(1, Rounds)] end,
        crash => [barrier, app],
        monitor => {starl_barrier_monitor, #{robots => Ids}}
    };
%% Time stands still, so only the counts of stamps decide, and robots' clocks are as far apart as
%% their numbers. All draw the same again and again, so each exchanges with one other robot.
block(registers, #{ids := Ids}) ->
    Ahead = starl_check_term:now(8) div 1000,
    #{
        blocks => [{registers, starl_registers_lww, #{ahead_ms => Ahead}}],
        script => fun(Place) -> register_script(Place) end,
        crash => [registers],
        monitor => {starl_registers_monitor, #{robots => Ids}},
        fixed => places(Ids),
        draws => same
    };
%% The source's clock is taken for the true one; of the others the second is slow, so it holds what
%% it has for longest, the rest are fast.
block(geocast, #{ids := Ids}) ->
    Config = #{
        jitter_ms => 0,
        gather_ms => 0,
        check_ms => ?CAST_US div 2000,
        listeners => #{note => app}
    },
    #{
        blocks => [
            {geocast, starl_geocast_flood, Config}, {location, starl_check_body, #{}}
        ],
        script => fun(Place) -> geocast_script(Place) end,
        crash => [geocast],
        monitor => {starl_check_casts, #{robots => Ids, lifetime_us => ?CAST_US}},
        timed => [offer, give, ask, over, forget, check, window],
        rates => list_to_tuple([geocast_rate(Place) || Place <- places(Ids)]),
        grain => 2,
        horizon_us => 2 * ?CAST_US,
        past_us => 2 * ?CAST_US,
        fixed => places(Ids)
    };
%% The last robot is named as the first coordinator, and after a restart the first one: by its
%% place in the team and by its number a robot comes before another or after it, so no two are
%% alike. The lease is as short as the beats allow, so that its end is near.
block(terms, #{ids := Ids, terms := Terms}) ->
    Lease = #{lease_ms => ?TERM_LEASE_US div 1000, jump_ms => 0},
    #{
        blocks => [
            {dpp, starl_dpp_participant, Lease},
            {dpp_coordinator, starl_dpp_coordinator, Lease#{serve => starl_check_service}},
            {motion, starl_check_body, #{}},
            {location, starl_check_body, #{}}
        ],
        script => fun(_) -> [{join, lists:last(Ids), hd(Ids)}] end,
        crash => [dpp, dpp_coordinator],
        monitor => {starl_check_terms, #{tube_radius => 200.0, r_s => 330.0}},
        timed => [beat, recover, claim, missing, again, look, leave],
        steps => [serve],
        beyond => fun(Event) -> claims_more(Event, Terms) end,
        %% the clock of the first coordinator is slow, so that its votes last longest, and those of
        %% the robots that give them are fast; a tick is about a second
        rates => setelement(
            length(Ids), erlang:make_tuple(length(Ids), ?TICKS * ?FAST), ?TICKS * ?SLOW
        ),
        grain => 1,
        horizon_us => ?TERM_LEASE_US + 1,
        past_us => ?TERM_LEASE_US + 1,
        fixed => places(Ids)
    }.

%% @doc Is a message of this kind worth a try as one that changes nothing for ever once it changes
%% nothing? {@link starl_check_inert} proves it. Whoever has a leader keeps it; the fence of the
%% owner known only grows; so do the counts of a barrier.
-spec may_be_inert(Type :: atom(), Body :: term(), t()) -> boolean().
may_be_inert(leader, {_, _}, #{block := election}) -> true;
may_be_inert(bully_leader, {_, _}, #{block := bully}) -> true;
may_be_inert(mutex, {owner, _, _}, #{block := mutex}) -> true;
may_be_inert(barrier, {reached, _, _, _, false}, #{block := barrier}) -> true;
may_be_inert(barrier, {told, _, _, _}, #{block := barrier}) -> true;
may_be_inert(_Type, _Body, _Model) -> false.

%% Who is alone claims in vain for ever.
claims_more({_, _, dpp_coordinator, {claims, {N, _, _}}}, Terms) -> N > Terms;
claims_more(_Event, _Terms) -> false.

places(Ids) -> lists:seq(1, length(Ids)).

register_script(1) -> [{'try', registers, {put, x, a}}, {'try', registers, {put, x, b}}];
register_script(2) -> [{'try', registers, {put, x, c}} | gets(2)];
register_script(_) -> gets(1).

gets(Count) -> lists:duplicate(Count, {'try', registers, {get, x}}).

%% Everybody is inside.
geocast_script(1) ->
    Area = {circle, {0.0, 0.0}, 1.0e6},
    [{'try', geocast, {send, Area, note, hello, ?CAST_US, 8}}, {window, ?CAST_US}];
geocast_script(_) ->
    [].

geocast_rate(1) -> ?CAST_TICK_US;
geocast_rate(2) -> ?CAST_TICK_US * ?SLOW div 100;
geocast_rate(_) -> ?CAST_TICK_US * ?FAST div 100.

sap_script(1, [_, To | _]) ->
    [{listen, note}, {'try', sap, {send, To, note, a}}, {'try', sap, {send, To, note, b}}];
sap_script(2, _Ids) ->
    [{listen, note}, {'try', sap, {broadcast, note, c}}];
sap_script(_, _Ids) ->
    [{listen, note}].

%% @doc The machines of the robot at a place, in the order in which they start.
-spec machines(starl_check_term:place(), t()) -> [{starl_machine:name(), module(), map()}].
machines(Place, #{blocks := Blocks, script := Script}) ->
    Blocks ++ [{app, starl_check_client, #{script => Script(Place)}}].

%% @doc What kind of timer this is: of the client (`step'), ordered by time (`timed'), the end of
%% a call's patience, or one that may fire at any time.
-spec timer(starl_check_robot:timer(), t()) -> timer_kind().
timer({app, window}, _Model) ->
    timed;
timer({app, _}, _Model) ->
    step;
timer({_, Timer}, #{timed := Timed, steps := Steps}) ->
    Tag = tag(Timer),
    case {lists:member(Tag, Timed), lists:member(Tag, Steps)} of
        {true, _} -> timed;
        {false, true} -> step;
        _ when Tag =:= patience -> patience;
        _ -> free
    end.

tag(Timer) when is_tuple(Timer) -> element(1, Timer);
tag(Timer) -> Timer.

%% @doc The permutations of the team that map every robot to one like itself, without the one
%% that changes nothing.
-spec permutations(t()) -> [starl_check_term:permutation()].
permutations(#{symmetry := false}) ->
    [];
permutations(#{ids := Ids, fixed := Fixed}) ->
    Places = places(Ids),
    Free = Places -- Fixed,
    Maps = [maps:from_list(lists:zip(Free, To)) || To <- arrangements(Free), To =/= Free],
    [list_to_tuple([maps:get(Place, Map, Place) || Place <- Places]) || Map <- Maps].

arrangements([]) -> [[]];
arrangements(List) -> [[E | Rest] || E <- List, Rest <- arrangements(List -- [E])].
