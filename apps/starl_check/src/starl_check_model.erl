%% @doc What is checked: the model that a block declares ({@link starl_block:model()}: its machine,
%% the scripts of its clients, the monitor that judges), completed, and what may happen.
%% README.md tells why the models are as they are.
-module(starl_check_model).

-export([blocks/0, new/2, machines/2, timer/2, permutations/1, may_be_inert/3]).

-export_type([t/0, block/0, options/0, budgets/0, timer_kind/0]).

%% The name of a model: as a rule that of the block.
-type block() :: atom().

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
    script := fun((starl_check_term:place()) -> starl_block:script()),
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
    inert := fun((Type :: atom(), Body :: term()) -> boolean()),
    rounds := pos_integer(),
    terms := pos_integer(),
    symmetry := boolean(),
    reduce := boolean(),
    leave_out := boolean(),
    workers := pos_integer(),
    spread := non_neg_integer()
}.

-type timer_kind() :: step | timed | patience | free.

%% µs that a clock gains in a tick, where the model does not say.
-define(FAST, 101).
%% So many terms in a row are followed.
-define(TERMS, 3).
%% It does not pay to spread fewer bytes of states over several cores.
-define(SPREAD, 100000).
-define(NO_FAULTS, #{
    loss => 0, crash => 0, sap => 0, dup => 0, late => 0, timeout => 0, reboot => 0, death => 0
}).

%% @doc The models of the blocks that ship, and what is checked of each.
-spec blocks() -> [{block(), string()}].
blocks() -> [{Name, Doc} || {Name, Doc, _} <- starl_blocks:models()].

%% @doc The model of a block that ships, or of one of the user's own.
-spec new(block() | starl_block:model_entry(), options()) -> t().
new({Name, _Doc, Make}, Options) ->
    Common = common(Name, Options),
    Given = Make(team(Common)),
    Model = maps:merge(complete(Given, Common), maps:with([past_us, waits], Options)),
    Crash = maps:get(crash, Options, maps:get(crash, Model)),
    #{monitor := {Monitor, _}} = Model,
    Judged = Model#{crash := Crash, known => starl_monitor:known([Monitor])},
    with_machine(maps:find(machine, Options), Judged);
new(Name, Options) ->
    new(lists:keyfind(Name, 1, starl_blocks:models()), Options).

team(#{ids := Ids, faults := Faults, rounds := Rounds, terms := Terms}) ->
    #{
        robots => Ids,
        faults => Faults,
        rounds => Rounds,
        terms => Terms,
        clock_us => fun starl_check_term:now/1
    }.

common(Block, Options) ->
    Robots = maps:get(robots, Options, 3),
    Ids = [starl_check_term:id(Place) || Place <- lists:seq(1, Robots)],
    #{
        block => Block,
        ids => Ids,
        faults => faults(Block, maps:merge(?NO_FAULTS, maps:get(faults, Options, #{}))),
        sap => contract,
        timed => [],
        steps => [],
        rates => erlang:make_tuple(Robots, ?FAST),
        grain => none,
        horizon_us => 1,
        past_us => 0,
        same_random => false,
        draws => free,
        beyond => fun(_) -> false end,
        inert => fun(_, _) -> false end,
        rounds => maps:get(rounds, Options, 2),
        terms => maps:get(terms, Options, ?TERMS),
        symmetry => maps:get(symmetry, Options, true),
        reduce => maps:get(reduce, Options, true),
        leave_out => maps:get(leave_out, Options, true),
        workers => maps:get(workers, Options, erlang:system_info(schedulers_online)),
        spread => maps:get(spread, Options, ?SPREAD)
    }.

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

%% What the block has left out, and the body and the checker's own machines.
complete(Given, #{ids := Ids} = Common) ->
    #{blocks := Blocks} = Given,
    Names = [Name || {Name, _, _} <- Blocks],
    Body = [{Name, starl_check_body, #{}} || Name <- maps:get(stands, Given, [])],
    Model = maps:merge(Common#{crash => Names, fixed => []}, maps:remove(stands, Given)),
    Model#{blocks := Blocks ++ Body, waits => maps:get(waits, Given, places(Ids))}.

%% @doc Is a message of this kind worth a try as one that changes nothing for ever once it changes
%% nothing? The block says; {@link starl_check_inert} proves it.
-spec may_be_inert(Type :: atom(), Body :: term(), t()) -> boolean().
may_be_inert(Type, Body, #{inert := IsInert}) -> IsInert(Type, Body).

places(Ids) -> lists:seq(1, length(Ids)).

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
