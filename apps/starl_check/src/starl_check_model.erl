%% @doc The models that the checker explores. A block declares a model ({@link
%% starl_block:model()}): its machine, the scripts of its clients and its monitor. This module
%% completes it with the defaults, the faults and the checker's own machines. doc/checking.md
%% explains the models.
-module(starl_check_model).

-export([
    blocks/0,
    terms/0,
    new/2,
    check/2,
    machines/2,
    timer/2,
    permutations/1,
    may_be_inert/3,
    told_apart/1,
    id/2,
    vocabulary/0
]).

-export_type([t/0, block/0, options/0, budgets/0, timer_kind/0, fact/0]).

%% What only a checked robot tells, as machine `robot': it stands still within a step, and goes on with it.
-type fact() :: stands | goes_on.

%% The name of a model: normally that of the block.
-type block() :: atom().

%% The number of times that each fault may happen; see {@link starl_check}.
-type budgets() :: #{
    loss => non_neg_integer(),
    crash => non_neg_integer(),
    sap => non_neg_integer(),
    dup => non_neg_integer(),
    late => non_neg_integer(),
    timeout => non_neg_integer(),
    reboot => non_neg_integer(),
    death => non_neg_integer(),
    still => non_neg_integer()
}.

%% `machine': a replacement of the block's machine, with additions to its configuration, for tests.
%% `crash': the machines that may crash. The reductions, by default `true': `symmetry', robots that
%% differ only in their number are treated as alike; `reduce' ({@link starl_check_reduce});
%% `leave_out' ({@link starl_check_inert}). `workers': the number of processes that expand states,
%% by default one per core; they are used for layers of the search of at least `spread' bytes.
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

%% `sap': the real one over packets, or its contract; `crash': the machines that may crash; `timed':
%% the timers whose order matters; `steps': the timers that fire at any moment, like the client's
%% (all other timers fire when nothing is under way); `rates': µs that each robot's clock gains in a
%% tick; `grain': time passes to the next timed timer, or by at most this number of ticks;
%% `horizon_us': past times in messages are distinguished up to this age; `past_us': the same for
%% times in a machine's data; `waits': the places where the start time of a machine matters
%% (elsewhere it is long ago); `fixed': the places of robots that are unlike all others;
%% `draws': with `same' a robot draws the same number each time; `beyond': states after such an event are not expanded, which `bounds' says in
%% words; `known': the events that may be traced.
-type t() :: #{
    block := block(),
    %% what it is made of
    given := {starl_block:model_entry(), options()},
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
    draws := free | same,
    beyond := fun((starl_monitor:trace_event()) -> boolean()),
    bounds := string(),
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

%% The default number of µs that a clock gains in a tick.
-define(FAST, 101).
%% For fewer bytes of states several cores do not pay.
-define(SPREAD, 100000).
-define(NO_FAULTS, #{
    loss => 0,
    crash => 0,
    sap => 0,
    dup => 0,
    late => 0,
    timeout => 0,
    reboot => 0,
    death => 0,
    still => 0
}).

%% @doc The models of the shipped blocks, and the property checked of each.
-spec blocks() -> [{block(), string()}].
blocks() -> [{Name, Doc} || {Name, Doc, _} <- starl_block_catalogue:models()].

%% @doc The number of consecutive terms that are followed, if no other is asked for.
-spec terms() -> pos_integer().
terms() -> 3.

%% @doc The model of a shipped block or of a user's block.
-spec new(block() | starl_block:model_entry(), options()) -> t().
new({_Name, _Doc, _Make} = Entry, Options) ->
    Model = made(Entry, Options),
    case permutations(Model) of
        [] -> made(Entry, Options#{symmetry => false});
        [_ | _] -> Model
    end;
new(Name, Options) ->
    new(lists:keyfind(Name, 1, starl_block_catalogue:models()), Options).

%% @doc Checks what a user's model asks for, before there is a model: its monitor.
-spec check(block() | starl_block:model_entry(), options()) -> ok | {error, unicode:chardata()}.
check({Name, _Doc, Make}, Options) ->
    #{monitor := Monitor, blocks := Blocks} = Make(team(common(Name, Options))),
    starl_check_judge:check(Monitor, [Machine || {Machine, _, _} <- Blocks]);
check(_Shipped, _Options) ->
    ok.

%% @doc The same model for a search that exchanges no robots: they have their own numbers, from 1.
-spec told_apart(t()) -> t().
told_apart(#{given := {Entry, Options}} = Model) ->
    maps:merge(new(Entry, Options#{symmetry => false}), maps:with([leave_out, workers], Model)).

%% @doc The facts that only a checked robot tells, as a monitor lists those of its machines.
-spec vocabulary() -> starl_event:vocabulary().
vocabulary() -> #{robot => [{stands, 0}, {goes_on, 0}]}.

%% @doc The number of the robot at a place.
-spec id(starl_check_term:place(), t()) -> starl:robot_id().
id(Place, #{ids := Ids}) -> lists:nth(Place, Ids).

made({Name, _Doc, Make} = Entry, Options) ->
    Common = common(Name, Options),
    Given = Make(team(Common)),
    Model = maps:merge(complete(Given, Common), maps:with([past_us, waits], Options)),
    Crash = maps:get(crash, Options, maps:get(crash, Model)),
    #{monitor := {Monitor, _}} = Model,
    Known = starl_monitor:known([?MODULE, Monitor]),
    Judged = Model#{crash := Crash, known => Known, given => {Entry, Options}},
    with_machine(maps:find(machine, Options), Judged).

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
    Symmetry = maps:get(symmetry, Options, true),
    Ids = ids(lists:seq(1, Robots), Symmetry),
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
        draws => free,
        beyond => fun(_) -> false end,
        bounds => "",
        inert => fun(_, _) -> false end,
        rounds => maps:get(rounds, Options, 2),
        terms => maps:get(terms, Options, terms()),
        symmetry => Symmetry,
        reduce => maps:get(reduce, Options, true),
        leave_out => maps:get(leave_out, Options, true),
        workers => maps:get(workers, Options, erlang:system_info(schedulers_online)),
        spread => maps:get(spread, Options, ?SPREAD)
    }.

ids(Places, true) -> [starl_check_term:id(Place) || Place <- Places];
ids(Places, false) -> Places.

%% If SAP itself is checked, its crashes are those of the block's machine.
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

%% Adds the defaults, the body and the checker's own machines.
complete(Given, #{ids := Ids} = Common) ->
    #{blocks := Blocks} = Given,
    Names = [Name || {Name, _, _} <- Blocks],
    Body = [{Name, starl_check_body, #{}} || Name <- maps:get(stands, Given, [])],
    Model = maps:merge(Common#{crash => Names, fixed => []}, maps:remove(stands, Given)),
    Model#{blocks := Blocks ++ Body, waits => maps:get(waits, Given, places(Ids))}.

%% @doc Whether a message of this kind may be inert: once its arrival changes nothing, it never
%% will. The block declares this; {@link starl_check_inert} proves it.
-spec may_be_inert(Type :: atom(), Body :: term(), t()) -> boolean().
may_be_inert(Type, Body, #{inert := IsInert}) -> IsInert(Type, Body).

places(Ids) -> lists:seq(1, length(Ids)).

%% @doc The machines of the robot at a place, in the order of their start.
-spec machines(starl_check_term:place(), t()) -> [{starl_machine:name(), module(), map()}].
machines(Place, #{blocks := Blocks, script := Script}) ->
    Blocks ++ [{app, starl_check_client, #{script => Script(Place)}}].

%% @doc The kind of a timer: of the client (`step'), ordered by time (`timed'), the end of a call's
%% patience, or a timer that may fire at any time.
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

%% @doc The permutations of the team that map every robot to an alike one, without the identity.
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
