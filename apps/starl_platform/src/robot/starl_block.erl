%% @doc The behaviour of a building block. Its callbacks return everything that tools and
%% applications need to know of the block.
%% ```
%%   -module(counting).
%%   -behaviour(starl_block).
%%   -export([options/0, machines/1, monitors/2, contract/0]).
%%
%%   options() -> [].
%%   machines(_Options) -> [{counter, counting_machine, #{}}].
%%   monitors(_Options, _Context) -> [{counting_monitor, #{}}].
%%   contract() -> "nobody counts to ten".
%% '''
%% An application lists its blocks: `blocks() -> [counting, {starl_mutex, #{lease_ms => 2000}}]'.
%% Each entry becomes the block's machines on every robot and the block's contract, as monitors that
%% judge the run ({@link expand/2}). A block may also be a user's own module, which no other module
%% has to know.
%%
%% The optional `check/1' returns one line on why options, each valid by itself, do not go together.
%% Three more callbacks let the tools work with the block. `exercise/0' names a module that uses it
%% ({@link starl_block_exercise}), for `./starl run exercise' and `./starl soak'. `models/0' returns
%% the models that the exhaustive checker explores, for `./starl check'. `benchmark/0' defines the
%% workload of `./starl bench blocks'.
-module(starl_block).

-export([expand/2, is_block/1, can/2, monitors/1, guarantees/1, propositions/1, example/0]).

-export_type([entry/0, options/0, context/0, capability/0]).
-export_type([model_entry/0, team/0, model/0, script/0, place/0, benchmark/0]).

%% An entry of an application's list: a block, a block with options, or a machine outside any block.
-type entry() :: module() | {module(), options()} | starl_robot_sup:machine().

%% Checked options, completed with the defaults of the block's table.
-type options() :: #{atom() => term()}.

%% The team and its surroundings, for monitors.
-type context() :: starl_scene:context().

-type capability() :: exercise | check | bench | history.

%% The table of the block's options.
-callback options() -> [starl_options:option()].
%% Do the options, each of which is right, go together? One line if not.
-callback check(options()) -> ok | {error, unicode:chardata()}.
%% The machines that each robot needs for the block, in start order.
-callback machines(options()) -> [starl_robot_sup:machine()].
%% The contract: the monitors that judge every run with the block.
-callback monitors(options(), context()) -> [{module(), Config :: map()}].
%% The monitors of the block that judge every run, with the block or without: of a service.
-callback everywhere() -> [module()].
%% The guarantee in one line, for lists.
-callback contract() -> string().
%% What it assumes and guarantees, for `./starl blocks --compose'.
-callback guarantees() -> [starl_guarantee:t()].
%% What the paper says of it, for `./starl planted --propositions'.
-callback propositions() -> [starl_guarantee:proposition()].
%% The module that uses the block for `exercise' and `soak'.
-callback exercise() -> module().
%% The models that the checker explores, usually one with the name of the block.
-callback models() -> [model_entry()].
-callback benchmark() -> benchmark().
%% What the block promises its callers, for histories: a module with the behaviour starl_history_model.
-callback history() -> module().

-optional_callbacks([
    check/1,
    everywhere/0,
    guarantees/0,
    propositions/0,
    exercise/0,
    models/0,
    benchmark/0,
    history/0
]).

%% A model: its name, what it covers in a few words, and the model for a team.
-type model_entry() :: {Name :: atom(), Doc :: string(), fun((team()) -> model())}.

%% A robot's place in a checked team, from 1.
-type place() :: pos_integer().

%% A checked team. `clock_us' gives the clock of the robot at a place. `faults' gives the largest
%% number of each fault; `rounds' and `terms' bound executions that would go on for ever.
-type team() :: #{
    robots := [starl:robot_id(), ...],
    faults := #{atom() => non_neg_integer()},
    rounds := pos_integer(),
    terms := pos_integer(),
    clock_us := fun((place()) -> integer())
}.

%% The steps of a robot's application in a model.
%% ```
%%   {call, Machine, Request}           repeated until it succeeds ({ok, _}, or ok)
%%   {try, Machine, Request}            once, with any answer
%%   {start, Machine, Request, Later}   the first step, at once; after a restart, Later instead
%%   {talk, Module, Args}               several calls in turn, see {@link starl_block_talk}
%%   {window, Us}                       reports when this much time has passed
%%   {listen, Type}                     listens to messages, and forgets them
%% '''
-type script() :: [
    {call | 'try', starl_machine:name(), Request :: term()}
    | {start, starl_machine:name(), Request :: term(), Later :: term()}
    | {talk, module(), Args :: term()}
    | {listen, Type :: atom()}
    | {window, Us :: pos_integer()}
].

%% The smallest configuration that shows the behaviour of a block, as a term. All keys but the first
%% three may be left out. `blocks' are the machines, the block's own first; `stands' are services
%% of a robot that stands still, for blocks that ask for positions.
%%
%% Robots: `crash' lists the machines that may crash (default: all of `blocks'); `fixed' lists the
%% places of robots that differ from all others (default: none, all are alike).
%%
%% Timers: those in `timed' fire in the order of time; those in `steps' fire at any moment, like the
%% application's next call; all others fire only when nothing is under way. `rates' are the µs that
%% each robot's clock gains in a tick; `grain' is the largest number of ticks that pass at once
%% (`none': time stands still). A past time in a message is told apart from earlier ones for
%% `horizon_us', a past time in a machine's data for `past_us'. At the places in `waits' the start
%% of a machine matters (default: everywhere).
%%
%% Random draws: `draws' is `same': a robot draws the same each time.
%%
%% Bounds: the checker does not go on after an event for which `beyond' holds; `bounds' says in a few words
%% up to where it goes. A message for
%% which `inert' holds is assumed to change nothing any more; the checker proves that in the end.
%%
%% `sap' is the real machine, over packets, only in a check of SAP itself.
-type model() :: #{
    blocks := [starl_robot_sup:machine()],
    script := fun((place()) -> script()),
    monitor := {module(), Config :: map()},
    sap => real | contract,
    stands => [location | motion],
    crash => [starl_machine:name()],
    fixed => [place()],
    timed => [atom()],
    steps => [atom()],
    rates => tuple(),
    grain => pos_integer() | none,
    horizon_us => pos_integer(),
    past_us => non_neg_integer(),
    waits => [place()],
    draws => free | same,
    beyond => fun((starl_monitor:trace_event()) -> boolean()),
    bounds => string(),
    inert => fun((Type :: atom(), Body :: term()) -> boolean())
}.

%% A benchmark of messages: values of `exercise', the figure of its report that counts operations,
%% and the packets per operation in a team of N, with that formula in words.
-type benchmark() :: #{
    workload := #{atom() => term()},
    operations := atom(),
    packets := fun((N :: pos_integer()) -> number()),
    formula := string()
}.

%% The names of machines that every robot has.
%% The number of modules of a similar name that are looked at.
-define(MOST_MEANT, 20).
-define(RESERVED, [sap, location, motion, app]).

%% @doc The machines and the contracts of the blocks that an application lists; or one line on an
%% error in the list.
-spec expand([entry()], context()) ->
    {ok, {[starl_robot_sup:machine()], [{module(), map()}]}} | {error, unicode:chardata()}.
expand(Entries, Context) when is_list(Entries) ->
    expand(Entries, Context, [], []);
expand(Other, _Context) ->
    {error, io_lib:format("a list of building blocks expected, not ~0tP", [Other, 20])}.

expand([], _Context, _Seen, Parts) ->
    Machines = lists:append([M || {_, M, _} <- lists:reverse(Parts)]),
    Monitors = lists:append([J || {_, _, J} <- lists:reverse(Parts)]),
    case {twice([N || {N, _, _} <- Machines] ++ ?RESERVED), twice([J || {J, _} <- Monitors])} of
        {none, none} -> {ok, {Machines, Monitors}};
        {{twice, Name}, _} -> {error, name_twice(Name, Parts)};
        {none, {twice, Monitor}} -> {error, monitor_twice(Monitor)}
    end;
expand([Entry | Entries], Context, Seen, Parts) ->
    case part(Entry, Context) of
        {ok, {Block, _, _} = Part} ->
            case lists:member(Block, Seen) of
                false -> expand(Entries, Context, [Block | Seen], [Part | Parts]);
                true -> {error, io_lib:format("block ~ts is listed twice", [Block])}
            end;
        {error, _} = Error ->
            Error
    end.

part(Block, Context) when is_atom(Block) ->
    part({Block, #{}}, Context);
part({Block, Given}, Context) when is_atom(Block), is_map(Given) ->
    case is_block(Block) of
        true -> checked(Block, starl_options:check(Given, Block:options()), Context);
        false -> {error, io_lib:format("~tp is no building block: ~ts", [Block, why_not(Block)])}
    end;
part({Name, Module, Config} = Machine, _Context) when
    is_atom(Name), is_atom(Module), is_map(Config)
->
    {ok, {{machine, Name}, [Machine], []}};
part(Other, _Context) ->
    {error,
        io_lib:format("a building block is listed as Module or {Module, #{...}}, not as ~0tP", [
            Other, 20
        ])}.

checked(Block, {ok, Options}, Context) ->
    case starl_callback:call(Block, check, [Options], ok) of
        {error, Line} -> {error, ["block ", atom_to_list(Block), ": ", Line]};
        _Right -> {ok, {Block, Block:machines(Options), Block:monitors(Options, Context)}}
    end;
checked(Block, {error, Problems}, _Context) ->
    Lines = lists:join("; ", [starl_options:format_problem(P) || P <- Problems]),
    {error, ["block ", atom_to_list(Block), ": ", Lines]}.

why_not(Module) ->
    case code:ensure_loaded(Module) of
        {module, _} -> "it does not export options/0, machines/1 and monitors/2";
        {error, _} -> ["there is no such module", meant(starl_code:resembling(Module))]
    end.

meant(Modules) ->
    case lists:search(fun is_block/1, lists:sublist(Modules, ?MOST_MEANT)) of
        {value, Block} -> starl_similar:meant([Block], "");
        false -> "; is it compiled, and in the path?"
    end.

twice(Names) ->
    case Names -- lists:usort(Names) of
        [] -> none;
        [Name | _] -> {twice, Name}
    end.

name_twice(Name, Parts) ->
    Blocks = [who(Block) || {Block, Ms, _} <- lists:reverse(Parts), {N, _, _} <- Ms, N =:= Name],
    case lists:member(Name, ?RESERVED) of
        true ->
            io_lib:format("~ts: every robot has a machine ~ts already", [Blocks, Name]);
        false ->
            Who = lists:join(" and ", Blocks),
            io_lib:format("~ts have a machine of the same name, ~ts", [Who, Name])
    end.

who({machine, Name}) -> ["the machine ", atom_to_list(Name)];
who(Block) -> ["block ", atom_to_list(Block)].

monitor_twice(Monitor) ->
    io_lib:format("monitor ~ts is there twice", [Monitor]).

%% @doc Is this module a building block?
-spec is_block(module()) -> boolean().
is_block(Module) ->
    starl_callback:exported(Module, options, 0) andalso starl_callback:exported(Module, machines, 1) andalso
        starl_callback:exported(Module, monitors, 2).

%% @doc Can the block be exercised, checked, measured?
-spec can(capability(), module()) -> boolean().
can(exercise, Block) -> starl_callback:exported(Block, exercise, 0);
can(check, Block) -> starl_callback:exported(Block, models, 0);
can(bench, Block) -> starl_callback:exported(Block, benchmark, 0);
can(history, Block) -> starl_callback:exported(Block, history, 0).

%% @doc The monitors of a block with its default options, in an example team, for lists.
-spec monitors(module()) -> [module()].
monitors(Block) ->
    {ok, Options} = starl_options:check(#{}, Block:options()),
    Own = [Monitor || {Monitor, _} <- Block:monitors(Options, example())],
    Own ++ starl_callback:call(Block, everywhere, [], []).

%% @doc What a block, or an application, says that it assumes and guarantees; nothing, if it does not say.
-spec guarantees(module()) -> {ok, [starl_guarantee:t()]} | {error, unicode:chardata()}.
guarantees(Module) ->
    stated(Module, starl_callback:call(Module, guarantees, [], [])).

%% @doc What the paper says of a block; nothing, if the block does not say.
-spec propositions(module()) -> [starl_guarantee:proposition()].
propositions(Module) -> starl_callback:call(Module, propositions, [], []).

stated(Module, Guarantees) ->
    case starl_guarantee:check(Guarantees) of
        ok -> {ok, Guarantees};
        {error, Why} -> {error, [atom_to_list(Module), ": ", Why]}
    end.

%% @doc An example team, for lists.
-spec example() -> context().
example() ->
    #{
        robots => [1, 2, 3],
        world => {12000, 12000},
        floor => starl_floor:empty({12000, 12000}),
        seed => 1,
        profiles => [starl_chassis:profile(starl_chassis_differential, #{})],
        sap => #{},
        options => #{}
    }.
