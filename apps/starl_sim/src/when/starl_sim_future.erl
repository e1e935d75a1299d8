%% @doc Computes continuations of a run that violates a contract. It repeats the run up to a moment
%% ({@link starl_sim_moments}) and continues it with other random draws ({@link starl_sim_branch}).
%%
%% Drawn anew from the moment on: the loss, duplication, damage and delay of packets; the errors of
%% drives and positions; what faults lose or delay; and when and where faults begin that have not
%% begun yet. Faults that drop single packets become random loss, as much as the run had. Not drawn
%% anew: the random numbers of machines and applications until they restart, which are part of their
%% states; clocks and their drift; the places at the start.
%%
%% Everything follows from the branch seed (`Salt'): the same seed gives the same continuation.
-module(starl_sim_future).

-export([repeat/1, settings/1, plan/4, play/1, facts/2, format_error/1]).

-export_type([run/0, settings/0, job/0, verdict/0, reason/0, parted/0]).

%% A run with a violation: the scenario with its drawn faults, and all its moments.
-type run() :: #{
    scenario := starl_run_scenario:t(),
    digest := binary(),
    events := non_neg_integer(),
    violation := starl_monitor:violation(),
    %% the part of the packets that its futures lose
    loss := float(),
    moments := starl_sim_moments:t()
}.

%% The part of the packets that is lost after the moment, and the time at which a future ends, s.
-type settings() :: #{loss := number(), until_s := number()}.

%% One future, ready to be run.
-type job() :: #{
    scenario := starl_run_scenario:t(),
    branch := starl_sim_branch:t(),
    contract := atom(),
    chains := #{starl:robot_id() => {pos_integer(), non_neg_integer()}}
}.

%% Whether it breaks the same contract, only another one, none, or none as far as it is judged.
-type verdict() :: broken | other | kept | unjudged.

-type reason() ::
    holds
    | {too_long, Events :: pos_integer()}
    | {not_reproducible, [binary(), ...]}
    | {trial, starl_sim_trial:reason()}.

%% A future that is not the run up to its moment.
-type parted() :: {parted, starl:robot_id(), Event :: pos_integer()}.

%% A future ends this part of its time after the violation of the run, or this long, s.
-define(BEYOND, 0.25).
-define(LEAST_BEYOND_S, 0.1).
%% All events of a run are kept in memory.
-define(MOST_EVENTS, 1000000).
-define(ALL, {1, 1 bsl 40}).

%% @doc Runs a scenario twice, with the same digest, and keeps its events.
-spec repeat(starl_run_scenario:t()) -> {ok, run()} | {error, reason()}.
repeat(Scenario) ->
    case starl_sim_trial:run(Scenario) of
        {error, Reason} -> {error, {trial, Reason}};
        {ok, #{violations := []}} -> {error, holds};
        {ok, #{events := N}} when N > ?MOST_EVENTS -> {error, {too_long, N}};
        {ok, Outcome} -> again(Outcome)
    end.

again(#{scenario := Scenario, digest := Digest, violations := [First | _]} = Outcome) ->
    #{faults := Faults} = Scenario,
    case starl_sim_trial:apart(fun() -> recorded(Scenario) end) of
        {ok, {Digest, Packets, Events}} ->
            {ok, #{
                scenario => Scenario,
                digest => Digest,
                events => maps:get(events, Outcome),
                violation => First,
                loss => loss(Scenario, Packets),
                moments => starl_sim_moments:new(Events, Faults)
            }};
        {ok, {Other, _, _}} ->
            {error, {not_reproducible, [Digest, Other]}};
        {error, Reason} ->
            {error, {trial, Reason}}
    end.

recorded(#{robots := Robots} = Scenario) ->
    Ids = lists:seq(1, Robots),
    Sim = started(Scenario, #{record => maps:from_keys(Ids, ?ALL)}),
    _ = starl_sim_trial:whole(Sim),
    Events = maps:from_list([{Id, starl_sim:events(Sim, Id)} || Id <- Ids]),
    {#{digest := Digest, packets := Packets}, _} = starl_sim:finish(Sim),
    {Digest, Packets, Events}.

started(Scenario, Options) ->
    {ok, Sim} = starl_sim:start(Scenario#{mode => inline, shards => 1}, Options),
    Sim.

%% Dropped packets count as random loss.
loss(#{loss := Loss, faults := Faults}, Packets) ->
    Drops = length([Id || {Id, _, _, drop, _, _} <- Faults]),
    max(float(Loss), min(1.0, Drops / max(1, Packets))).

%% @doc The default settings of a run's continuations: they lose as many packets as the run, and end
%% some time after its violation.
-spec settings(run()) -> settings().
settings(#{violation := #{at_us := AtUs}, loss := Loss}) ->
    At = AtUs / 1.0e6,
    #{loss => Loss, until_s => At + max(?LEAST_BEYOND_S, ?BEYOND * At)}.

%% @doc Plans the continuation of this branch seed from a moment of a run.
-spec plan(run(), starl_sim_moments:moment(), Salt :: integer(), settings()) -> job().
plan(#{scenario := Scenario, moments := Moments} = Run, Moment, Salt, Settings) ->
    #{violation := #{contract := Contract, at_us := AtUs}} = Run,
    #{loss := Loss, until_s := Until} = Settings,
    #{faults := Faults, loss := LossBefore, robots := Robots} = Scenario,
    #{robots := Chains, faults := Begun} = starl_sim_moments:before(Moment, Moments),
    After = starl_sim_moments:time_us(Moment, Moments) div 1000,
    Span = {After, max(1, AtUs div 1000)},
    Team = #{robots => Robots, seed => Salt},
    #{
        scenario => Scenario#{
            faults := [ahead(F, Begun, Span, Salt, Team) || F <- Faults],
            loss := Loss,
            time := Until
        },
        branch => #{
            counts => maps:map(fun(_, {N, _}) -> N end, Chains),
            salt => Salt,
            loss => LossBefore,
            faults => Faults
        },
        contract => Contract,
        chains => Chains
    }.

ahead({_, _, _, drop, _, _} = Fault, _Begun, _Span, _Salt, _Team) ->
    Fault;
ahead(Fault, Begun, Span, Salt, Team) ->
    case lists:member(Fault, Begun) of
        true -> Fault;
        false -> starl_run_fault_draw:again(Fault, Span, {Salt, ahead}, Team)
    end.

%% @doc Runs a continuation in the calling process; a failing simulation ends that process, too.
%% Checks that it equals the run up to its moment.
-spec play(job()) -> {ok, verdict(), Digest :: binary()} | {error, parted()}.
play(#{scenario := Scenario, branch := Branch, chains := Chains} = Job) ->
    Sim = started(Scenario, #{
        branch => Branch, record => maps:map(fun(_, {N, _}) -> {N, N} end, Chains)
    }),
    _ = starl_sim_trial:whole(Sim),
    Parted = [Two || {Id, {N, Chain}} <- maps:to_list(Chains), Two <- parted(Id, N, Chain, Sim)],
    {#{digest := Digest} = Outcome, _} = starl_sim:finish(Sim),
    case {Parted, Outcome} of
        {[{Robot, N} | _], _} -> {error, {parted, Robot, N}};
        {[], _} -> {ok, verdict(Outcome, Job), Digest}
    end.

parted(Robot, N, Chain, Sim) ->
    case starl_sim:events(Sim, Robot) of
        [#{n := N, chain := Chain}] -> [];
        _ -> [{Robot, N}]
    end.

verdict(#{violations := Violations, unjudged := Unjudged}, #{contract := Contract}) ->
    case [C || #{contract := C} <- Violations] of
        [] when Unjudged =:= [] -> kept;
        [] ->
            unjudged;
        Broken ->
            case lists:member(Contract, Broken) of
                true -> broken;
                false -> other
            end
    end.

%% @doc The facts that a robot traced at a time of the run, with the fate of each packet that it
%% sent then.
-spec facts(run(), {starl_sim_queue:time(), starl:robot_id()}) ->
    {ok, [{starl_machine:name(), Fact :: term()}]} | {error, {failed, term()}}.
facts(#{scenario := Scenario}, {AtUs, Robot}) ->
    starl_sim_trial:apart(fun() ->
        Self = self(),
        Observer = fun(News) -> told(News, AtUs, Robot, Self) end,
        Sim = started(Scenario, #{observe => Observer, packets => true}),
        #{now_us := _} = starl_sim:run(Sim, (AtUs + 1) / 1.0e6),
        _ = starl_sim:finish(Sim),
        collected([])
    end).

told({judged, Trace, _}, AtUs, Robot, To) ->
    _ = [To ! {fact, Machine, Fact} || {T, R, Machine, Fact} <- Trace, T =:= AtUs, R =:= Robot],
    ok;
told(_Other, _AtUs, _Robot, _To) ->
    ok.

collected(Facts) ->
    receive
        {fact, Machine, Fact} -> collected([{Machine, Fact} | Facts])
    after 0 -> lists:reverse(Facts)
    end.

%% @doc One line on why there are no continuations.
-spec format_error(reason() | parted()) -> unicode:chardata().
format_error(holds) ->
    "the run violates no contract, so there is nothing to ask";
format_error({too_long, Events}) ->
    io_lib:format("the run has ~b events, too many to keep; make it small first: ./starl shrink", [
        Events
    ]);
format_error({parted, Robot, N}) ->
    io_lib:format(
        "a future is not the run up to its moment: event ~b of robot ~b differs; ./starl diverge "
        "tells where two runs part",
        [N, Robot]
    );
format_error(Reason) ->
    starl_sim_shrink:format_error(Reason).
