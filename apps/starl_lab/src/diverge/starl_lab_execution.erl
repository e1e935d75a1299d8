%% @doc The modes of running a scenario that must all give the same digest. A mode is made of the
%% kind of machines (processes or inline), the number of shards, and the number of schedulers of the
%% VM. On the command line it is written `MODE:SHARDS' or `MODE:SHARDS:SCHEDULERS'.
-module(starl_lab_execution).

-export([usual/0, parse/1, format_error/1, text/1, schedulers/1, apply_to/2]).
-export([digests/1, traced/1]).

-export_type([t/0, outcome/0, reason/0]).

-type t() :: {process | inline, Shards :: pos_integer(), Schedulers :: pos_integer()}.

%% What runs are compared by: the digest of all events, and beside it what each robot traced and
%% the results of the robots; the numbers of events and of violations.
-type outcome() :: #{
    digest := binary(),
    traces := starl_sim_trace_monitor:chains(),
    results := #{starl:robot_id() => term()},
    events := non_neg_integer(),
    violations := non_neg_integer()
}.

-type reason() :: {bad_way, string()} | {one_way, string()}.

-define(MOST, 256).

%% @doc Both modes, one to three shards, one and two schedulers.
-spec usual() -> string().
usual() -> "process:1:1,process:2:2,inline:1:1,inline:3:2".

%% @doc Reads a list of at least two ways, separated by commas. The default is one scheduler.
-spec parse(string()) -> {ok, [t(), ...]} | {error, reason()}.
parse(Text) ->
    Ways = [{Part, way(string:split(Part, ":", all))} || Part <- string:split(Text, ",", all)],
    case [Part || {Part, error} <- Ways] of
        [Part | _] -> {error, {bad_way, Part}};
        [] when length(Ways) < 2 -> {error, {one_way, Text}};
        [] -> {ok, [Way || {_, Way} <- Ways]}
    end.

way([Mode, Shards]) ->
    way([Mode, Shards, "1"]);
way([Mode, Shards, Schedulers]) ->
    Count = {integer, 1, ?MOST},
    Modes = {one_of, [process, inline]},
    Parts = [{Modes, Mode}, {Count, Shards}, {Count, Schedulers}],
    case [starl_options:parse(Type, Text) || {Type, Text} <- Parts] of
        [{ok, M}, {ok, N}, {ok, S}] -> {M, N, S};
        _ -> error
    end;
way(_) ->
    error.

%% @doc One line that states the problem and the remedy.
-spec format_error(reason()) -> unicode:chardata().
format_error({bad_way, Text}) ->
    ["MODE:SHARDS or MODE:SHARDS:SCHEDULERS expected, as in process:1 or inline:3:2, not ", Text];
format_error({one_way, Text}) ->
    ["two ways or more are needed, not only ", Text].

%% @doc A way as written on the command line.
-spec text(t()) -> string().
text({Mode, Shards, Schedulers}) ->
    lists:flatten(io_lib:format("~ts:~b:~b", [Mode, Shards, Schedulers])).

%% @doc The number of schedulers that the VM needs.
-spec schedulers(t()) -> pos_integer().
schedulers({_, _, Schedulers}) -> Schedulers.

%% @doc The scenario, changed to run in this way.
-spec apply_to(starl_run_scenario:t(), t()) -> starl_run_scenario:t().
apply_to(Scenario, {Mode, Shards, _}) -> Scenario#{mode => Mode, shards => Shards}.

%% @doc Runs a scenario in these ways, one after the other. It is called in a VM of its own.
-spec digests({starl_run_scenario:t(), [t()]}) -> [outcome()].
digests({Scenario, Ways}) -> [outcome(apply_to(Scenario, Way)) || Way <- Ways].

outcome(Scenario) ->
    Outcome = run(Scenario, #{}),
    #{digest := Digest, events := Events, violations := Violations, robots := Robots} = Outcome,
    #{monitors := #{starl_sim_trace_monitor := #{chains := Chains}}} = Outcome,
    #{
        digest => Digest,
        traces => Chains,
        results => maps:from_list([{Id, Result} || {Id, #{result := Result}} <- Robots]),
        events => Events,
        violations => length(Violations)
    }.

%% @doc Runs a scenario and gives what one robot traced. It is called in a VM of its own.
-spec traced({starl_run_scenario:t(), starl:robot_id()}) -> [starl_sim_trace_monitor:traced()].
traced({Scenario, Robot}) ->
    #{monitors := #{starl_sim_trace_monitor := #{recorded := Traced}}} =
        run(Scenario, #{record => Robot}),
    Traced.

run(Scenario, Config) ->
    {ok, Sim} = starl_sim:start(Scenario, #{watch => [{starl_sim_trace_monitor, Config}]}),
    #{ending := _} = starl_sim_trial:whole(Sim),
    {Outcome, _} = starl_sim:finish(Sim),
    Outcome.
