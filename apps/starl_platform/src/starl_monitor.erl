%% @doc Contracts as monitors over trace events, and the runner that feeds them.
%%
%% A monitor is a pure callback module that reads the events of a run one by one and says when
%% the contract it stands for is broken. The same monitor judges simulation runs, property
%% tests, explored interleavings and recordings of real robots.
%%
%% Events reach a monitor in the order of their time (never decreasing); time passes for it
%% with the events it is interested in and at the finish. A violation does not end the
%% monitoring: a caller may stop at the first one or go on and collect them all.
%%
%% The runner dispatches by the name of the machine: an event of a machine that no monitor
%% listens to costs one look-up in a small map.
-module(starl_monitor).

-export([new/1, step/2, finish/2, format_violation/1]).
-export_type([t/0, trace_event/0, violation/0, robot_id/0, state/0, results/0]).

%% A robot's number.
-type robot_id() :: pos_integer().
%% What a machine of a robot did, and when (us).
-type trace_event() ::
    {TimeUs :: integer(), Robot :: robot_id(), Machine :: atom(), Event :: term()}.
%% How a contract was broken: by what, when (us), and which robots take part.
-type violation() :: #{
    contract := atom(),
    what := atom(),
    at_us := integer(),
    robots := [robot_id()],
    details := map()
}.
%% The state of a monitor, private to its module.
-type state() :: term().
%% Figures that a monitor measured, for the report.
-type results() :: #{atom() => term()}.

-callback init(Config :: map()) -> state().
-callback step(trace_event(), state()) -> {ok, state()} | {violation, violation(), state()}.
-callback finish(EndTimeUs :: integer(), state()) ->
    {ok | {violation, [violation(), ...]}, results()}.
%% The machines whose events the monitor wants; without this callback, all.
-callback interests() -> [Machine :: atom()] | all.
%% What decides on the violations to come while no time passes: two states that are alike in this
%% judge alike. For the exhaustive checker; figures and times are left out.
-callback timeless(state()) -> term().
-optional_callbacks([interests/0, timeless/1]).

-record(runner, {
    %% Monitors (their places in `states') to feed, by machine, and for any other machine.
    routes :: #{atom() => [pos_integer()]},
    others :: [pos_integer()],
    modules :: tuple(),
    states :: tuple(),
    %% Violations not returned yet, latest first, and how many more would still be kept.
    violations = [] :: [violation()],
    room :: non_neg_integer()
}).

%% Monitors that run together over one trace.
-opaque t() :: #runner{}.

%% Violations kept by the runner; a broken contract tends to break again and again.
-define(KEPT, 1000).

%% @doc A runner over the given monitors, each module at most once.
-spec new([{module(), Config :: map()}]) -> t().
new(Monitors) ->
    Modules = [Module || {Module, _Config} <- Monitors],
    length(lists:usort(Modules)) =:= length(Modules) orelse error(badarg, [Monitors]),
    Wanted = lists:zip(lists:seq(1, length(Modules)), [interests_of(M) || M <- Modules]),
    Machines = lists:usort(lists:append([Names || {_, Names} <- Wanted, is_list(Names)])),
    #runner{
        routes = maps:from_list([{Name, listeners(Name, Wanted)} || Name <- Machines]),
        others = [I || {I, all} <- Wanted],
        modules = list_to_tuple(Modules),
        states = list_to_tuple([Module:init(Config) || {Module, Config} <- Monitors]),
        room = ?KEPT
    }.

%% @doc Feeds one event or several. All of them are judged by all monitors, also after a
%% violation; the first violation of this call is returned.
-spec step(trace_event() | [trace_event()], t()) -> {ok, t()} | {violation, violation(), t()}.
step(Events, #runner{room = Room} = Runner) when is_list(Events) ->
    answer(Room, lists:foldl(fun dispatch/2, Runner, Events));
step(Event, #runner{room = Room} = Runner) ->
    answer(Room, dispatch(Event, Runner)).

%% @doc Ends the run at `EndTimeUs'. Returns the violations that `step/2' has not returned, in
%% the order found, and what each monitor measured. The runner keeps at most 1000 violations.
-spec finish(EndTimeUs :: integer(), t()) -> {[violation()], #{module() => results()}}.
finish(EndTimeUs, #runner{modules = Modules, states = States, violations = Kept, room = Room}) ->
    Ends = [
        {Module, Module:finish(EndTimeUs, State)}
        || {Module, State} <- lists:zip(tuple_to_list(Modules), tuple_to_list(States))
    ],
    Late = lists:append([Found || {_Module, {{violation, Found}, _Results}} <- Ends]),
    {lists:reverse(Kept, lists:sublist(Late, Room)),
        maps:from_list([{Module, Results} || {Module, {_Verdict, Results}} <- Ends])}.

%% @doc One line: contract, when (s), which robots, what.
-spec format_violation(violation()) -> unicode:chardata().
format_violation(Violation) ->
    #{contract := Contract, what := What, at_us := At, robots := Robots, details := Details} =
        Violation,
    io_lib:format("~ts broken at ~.6f s by ~ts: ~ts~ts", [
        Contract, At / 1.0e6, format_robots(Robots), words(What), format_details(Details)
    ]).

interests_of(Module) ->
    {module, Module} = code:ensure_loaded(Module),
    case erlang:function_exported(Module, interests, 0) of
        true -> Module:interests();
        false -> all
    end.

listeners(Name, Wanted) ->
    [I || {I, Names} <- Wanted, Names =:= all orelse lists:member(Name, Names)].

dispatch({_Time, _Robot, Machine, _Content} = Event, #runner{routes = Routes} = Runner) ->
    case Routes of
        #{Machine := Places} -> feed(Places, Event, Runner);
        #{} -> feed(Runner#runner.others, Event, Runner)
    end.

feed([], _Event, Runner) ->
    Runner;
feed([Place | Places], Event, #runner{modules = Modules, states = States} = Runner) ->
    Module = element(Place, Modules),
    case Module:step(Event, element(Place, States)) of
        {ok, State} ->
            feed(Places, Event, Runner#runner{states = setelement(Place, States, State)});
        {violation, Violation, State} ->
            Fed = Runner#runner{states = setelement(Place, States, State)},
            feed(Places, Event, keep(Violation, Fed))
    end.

keep(_Violation, #runner{room = 0} = Runner) ->
    Runner;
keep(Violation, #runner{violations = Violations, room = Room} = Runner) ->
    Runner#runner{violations = [Violation | Violations], room = Room - 1}.

answer(Room, #runner{room = Room} = Runner) ->
    {ok, Runner};
answer(Before, #runner{violations = Violations, room = Room} = Runner) ->
    {Later, [First | Earlier]} = lists:split(Before - Room - 1, Violations),
    {violation, First, Runner#runner{violations = Later ++ Earlier}}.

format_robots([]) -> "no robot";
format_robots([Robot]) -> io_lib:format("robot ~b", [Robot]);
format_robots(Robots) -> ["robots ", lists:join(", ", [integer_to_list(R) || R <- Robots])].

words(What) ->
    string:replace(atom_to_list(What), "_", " ", all).

format_details(Details) when map_size(Details) =:= 0 ->
    "";
format_details(Details) ->
    Shown = [io_lib:format("~ts ~0tp", [K, V]) || {K, V} <- lists:sort(maps:to_list(Details))],
    [" (", lists:join(", ", Shown), ")"].
