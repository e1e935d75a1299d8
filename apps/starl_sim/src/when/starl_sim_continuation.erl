%% @doc Computes continuations of a run. It repeats the run up to an index of its timeline
%% ({@link starl_sim_timeline}) and continues it with other random draws ({@link starl_sim_branch}).
%%
%% Drawn anew from the index on: the loss, duplication, damage and delay of packets; the errors of
%% drives and positions; what faults lose or delay; and when and where faults begin that have not
%% begun yet. Faults that drop single packets become random loss, as much as the run had. Not drawn
%% anew: the random numbers of machines and applications until they restart, which are part of their
%% states; clocks and their drift; the places at the start.
%%
%% Everything follows from the branch seed: the same seed gives the same continuation.
-module(starl_sim_continuation).

-export([repeat/1, settings/2, plan/4, play/1, facts/2, format_error/1]).

-export_type([run/0, question/0, settings/0, job/0, verdict/0, reason/0, parted/0]).

%% A run that was repeated: the scenario with its drawn faults, and all its events.
-type run() :: #{
    scenario := starl_run_scenario:t(),
    digest := binary(),
    events := non_neg_integer(),
    end_us := starl_sim_queue:time(),
    violation := starl_monitor:violation() | none,
    unjudged := [starl_unjudged:t()],
    %% the fraction of the packets that its continuations lose
    loss := float(),
    timeline := starl_sim_timeline:t()
}.

%% When the run's violation became inevitable; or what the run comes to from this time on.
-type question() :: violation | {at, starl_sim_queue:time()}.

%% The contract that counts as broken, the fraction of the packets that is lost after the index, and
%% the time at which a continuation ends, s. Faults that have not begun do so within this time after
%% the index, or by this time of the run.
-type settings() :: #{
    contract := string() | any,
    loss := number(),
    until_s := number(),
    faults_ahead := {within_ms | by_ms, non_neg_integer()}
}.

%% One continuation, ready to be run.
-type job() :: #{
    scenario := starl_run_scenario:t(),
    branch := starl_sim_branch:t(),
    contract := string() | any,
    chains := #{starl:robot_id() => {pos_integer(), non_neg_integer()}}
}.

%% Whether it breaks the contract, only another one, none, or none as far as it is judged.
-type verdict() :: broken | other | kept | unjudged.

-type reason() ::
    holds
    | {too_long, Events :: pos_integer()}
    | {not_reproducible, [binary(), ...]}
    | {ended, starl_sim_queue:time()}
    | {broken, starl_monitor:violation()}
    | {trial, starl_sim_trial:reason()}.

%% A continuation that does not equal the run up to its index.
-type parted() :: {parted, starl:robot_id(), Event :: pos_integer()}.

%% A continuation ends this part of the time after the violation, or after the end of the run; or at
%% least so long after it, s.
-define(BEYOND, 0.25).
-define(LEAST_BEYOND_VIOLATION_S, 0.1).
-define(LEAST_BEYOND_END_S, 1.0).
%% All events of a run are kept in memory.
-define(MOST_EVENTS, 1000000).
-define(ALL, {1, 1 bsl 40}).

%% @doc Runs a scenario twice, with the same digest, and keeps its events.
-spec repeat(starl_run_scenario:t()) -> {ok, run()} | {error, reason()}.
repeat(Scenario) ->
    case apart(Scenario, fun(_Drawn) -> [] end) of
        {ok, #{outcome := #{events := N}}} when N > ?MOST_EVENTS ->
            {error, {too_long, N}};
        {ok, #{scenario := Drawn, outcome := Outcome}} ->
            Recorded = apart(Drawn, fun(#{robots := Robots}) -> lists:seq(1, Robots) end),
            again(Outcome, Recorded);
        {error, _} = Error ->
            Error
    end.

again(#{digest := Digest} = Outcome, {ok, #{outcome := #{digest := Digest}} = Run}) ->
    #{scenario := #{faults := Faults} = Scenario, recorded := Events} = Run,
    #{violations := Violations, packets := Packets} = Outcome,
    {ok, (maps:with([digest, events, end_us, unjudged], Outcome))#{
        scenario => Scenario,
        violation => hd(Violations ++ [none]),
        loss => loss(Scenario, Packets),
        timeline => starl_sim_timeline:new(Events, Faults)
    }};
again(#{digest := Digest}, {ok, #{outcome := #{digest := Other}}}) ->
    {error, {not_reproducible, [Digest, Other]}};
again(_Outcome, {error, _} = Error) ->
    Error.

%% A run in a process of its own, with the events of the robots that the function names.
apart(Scenario, Record) ->
    case starl_sim_trial:apart(fun() -> once(Scenario, Record(Scenario)) end) of
        {ok, {ok, _} = Ran} -> Ran;
        {ok, {error, Reason}} -> {error, {trial, {start, Reason}}};
        {error, Reason} -> {error, {trial, Reason}}
    end.

once(Scenario, Ids) ->
    case start(Scenario, #{record => maps:from_keys(Ids, ?ALL)}) of
        {ok, Sim} ->
            _ = starl_sim_trial:whole(Sim),
            Events = maps:from_list([{Id, starl_sim:events(Sim, Id)} || Id <- Ids]),
            Drawn = starl_sim:scenario(Sim),
            {Outcome, _Report} = starl_sim:finish(Sim),
            {ok, #{scenario => Drawn, outcome => Outcome, recorded => Events}};
        {error, _} = Error ->
            Error
    end.

start(Scenario, Options) -> starl_sim:start(Scenario#{mode => inline, shards => 1}, Options).

started(Scenario, Options) ->
    {ok, Sim} = start(Scenario, Options),
    Sim.

%% Dropped packets count as random loss.
loss(#{loss := Loss, faults := Faults}, Packets) ->
    Drops = length([Id || {Id, _, _, drop, _, _} <- Faults]),
    max(float(Loss), min(1.0, Drops / max(1, Packets))).

%% @doc The default settings of a run's continuations: they lose as many packets as the run, and end
%% some time after its violation or its end.
-spec settings(run(), question()) -> {ok, settings()} | {error, reason()}.
settings(#{violation := none, unjudged := []}, violation) ->
    {error, holds};
settings(#{violation := none, unjudged := [_ | _] = Parts}, violation) ->
    {error, {trial, {unjudged, Parts}}};
settings(#{violation := #{at_us := AtUs, contract := Contract}, loss := Loss}, violation) ->
    Seconds = AtUs / 1.0e6,
    {ok, #{
        contract => atom_to_list(Contract),
        loss => Loss,
        until_s => Seconds + max(?LEAST_BEYOND_VIOLATION_S, ?BEYOND * Seconds),
        faults_ahead => {within_ms, AtUs div 1000}
    }};
settings(#{violation := #{at_us := Broken} = Violation}, {at, AtUs}) when Broken =< AtUs ->
    {error, {broken, Violation}};
settings(#{end_us := EndUs}, {at, AtUs}) when AtUs > EndUs ->
    {error, {ended, EndUs}};
settings(#{end_us := EndUs, loss := Loss}, {at, AtUs}) ->
    {ok, #{
        contract => any,
        loss => Loss,
        until_s => EndUs / 1.0e6 + max(?LEAST_BEYOND_END_S, ?BEYOND * AtUs / 1.0e6),
        faults_ahead => {by_ms, EndUs div 1000}
    }}.

%% @doc Plans the continuation of this branch seed from an index of a run.
-spec plan(run(), starl_sim_timeline:index(), BranchSeed :: integer(), settings()) -> job().
plan(#{scenario := Scenario, timeline := Timeline}, Index, BranchSeed, Settings) ->
    #{contract := Contract, loss := Loss, until_s := Until, faults_ahead := Ahead} = Settings,
    #{faults := Faults, loss := LossBefore, robots := Robots} = Scenario,
    #{robots := Chains, faults := Begun} = starl_sim_timeline:before(Index, Timeline),
    After = starl_sim_timeline:time_us(Index, Timeline) div 1000,
    Span = {After, max(1, within(Ahead, After))},
    Team = #{robots => Robots, seed => BranchSeed},
    #{
        scenario => Scenario#{
            faults := [ahead(F, Begun, Span, Team) || F <- Faults],
            loss := Loss,
            time := Until
        },
        branch => #{
            counts => maps:map(fun(_, {N, _}) -> N end, Chains),
            branch_seed => BranchSeed,
            loss => LossBefore,
            faults => Faults
        },
        contract => Contract,
        chains => Chains
    }.

within({within_ms, Ms}, _After) -> Ms;
within({by_ms, Ms}, After) -> Ms - After.

ahead({_, _, _, drop, _, _} = Fault, _Begun, _Span, _Team) ->
    Fault;
ahead(Fault, Begun, Span, #{seed := BranchSeed} = Team) ->
    case lists:member(Fault, Begun) of
        true -> Fault;
        false -> starl_run_fault_draw:again(Fault, Span, {BranchSeed, ahead}, Team)
    end.

%% @doc Runs a continuation in the calling process; a failing simulation ends that process, too.
%% Checks that it equals the run up to its index.
-spec play(job()) -> {ok, verdict(), Digest :: binary()} | {error, parted()}.
play(#{scenario := Scenario, branch := Branch, chains := Chains, contract := Contract}) ->
    Sim = started(Scenario, #{
        branch => Branch, record => maps:map(fun(_, {N, _}) -> {N, N} end, Chains)
    }),
    _ = starl_sim_trial:whole(Sim),
    Parted = [Two || {Id, {N, Chain}} <- maps:to_list(Chains), Two <- parted(Id, N, Chain, Sim)],
    {#{violations := Violations, unjudged := Unjudged, digest := Digest}, _} =
        starl_sim:finish(Sim),
    Broken = [atom_to_list(C) || #{contract := C} <- Violations],
    case Parted of
        [{Robot, N} | _] -> {error, {parted, Robot, N}};
        [] -> {ok, verdict(Broken, Unjudged, Contract), Digest}
    end.

parted(Robot, N, Chain, Sim) ->
    case starl_sim:events(Sim, Robot) of
        [#{n := N, chain := Chain}] -> [];
        _ -> [{Robot, N}]
    end.

verdict([], [], _Contract) ->
    kept;
verdict([], _Unjudged, _Contract) ->
    unjudged;
verdict(_Broken, _Unjudged, any) ->
    broken;
verdict(Broken, _Unjudged, Contract) ->
    case lists:member(Contract, Broken) of
        true -> broken;
        false -> other
    end.

%% @doc The facts that a robot traced at a time of the run, with the fate of each packet that it
%% sent then.
-spec facts(run(), {starl_sim_queue:time(), starl:robot_id()}) ->
    {ok, [{starl_machine:name(), Fact :: term()}]} | {error, {failed, term()}}.
facts(#{scenario := Scenario}, {AtUs, Robot}) ->
    starl_sim_trial:apart(fun() ->
        Self = self(),
        Observer = fun(News) -> observe(News, AtUs, Robot, Self) end,
        Sim = started(Scenario, #{observe => Observer, packets => true}),
        #{now_us := _} = starl_sim:run(Sim, (AtUs + 1) / 1.0e6),
        _ = starl_sim:finish(Sim),
        collected([])
    end).

observe({judged, Trace, _}, AtUs, Robot, To) ->
    _ = [To ! {fact, Machine, Fact} || {T, R, Machine, Fact} <- Trace, T =:= AtUs, R =:= Robot],
    ok;
observe(_Other, _AtUs, _Robot, _To) ->
    ok.

collected(Facts) ->
    receive
        {fact, Machine, Fact} -> collected([{Machine, Fact} | Facts])
    after 0 -> lists:reverse(Facts)
    end.

%% @doc One line on why there are no continuations.
-spec format_error(reason() | parted()) -> unicode:chardata().
format_error(holds) ->
    "the run violates no contract, so there is nothing to ask; --at SECONDS continues it from a time";
format_error({too_long, Events}) ->
    io_lib:format(
        "the run has ~b events, more than the ~b that are kept; give it less --time, or make it "
        "small first: ./starl shrink",
        [Events, ?MOST_EVENTS]
    );
format_error({ended, Us}) ->
    io_lib:format("the run ends at ~.3f s; choose an earlier time", [Us / 1.0e6]);
format_error({broken, Violation}) ->
    [starl_violation:format(Violation), ", before that time; choose an earlier one"];
format_error({parted, Robot, N}) ->
    io_lib:format(
        "a continuation differs from the run before its beginning, in event ~b of robot ~b; "
        "./starl diverge finds where two runs part",
        [N, Robot]
    );
format_error(Reason) ->
    starl_sim_shrink:format_error(Reason).
