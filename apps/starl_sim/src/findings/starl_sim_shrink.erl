%% @doc The shrinker: turns a scenario whose run violates a contract into a small one whose run
%% violates the same contract. It knows runs only as a function from a scenario to a verdict.
%%
%% First the run is repeated with its drawn faults made explicit: the digests must be equal.
%% Then, in rounds until nothing changes: the time is cut at the violation; faults are removed
%% by ddmin ({@link starl_sim_ddmin}); robots are removed from the highest id on, together with
%% the faults aimed at them; settings that blur the run are set to zero or none; and random loss
%% becomes a list of faults of kind `drop', one per lost packet, for ddmin as well.
%%
%% A smaller scenario counts only if it violates the same contract in the same way: the violation
%% has the same shape ({@link starl_violation:shape/1}), and a robot of a team is not taken for one
%% that is alone. For each other shape the smallest scenario is reported, too. Each scenario
%% that counts ends with its own violation, so the violation only moves forward and the runs get
%% shorter.
-module(starl_sim_shrink).

-export([shrink/2, format_error/1]).

-export_type([request/0, result/0, watch/0, figures/0, reason/0, met/0]).

%% `run' judges a scenario; `digest' is that of the run to be shrunk, if it is known.
-type request() :: #{
    run := fun((starl_run_scenario:t()) -> starl_sim_trial:verdict()),
    watch := watch(),
    digest => binary() | any
}.

%% Gets the figures after each run; decides whether to go on, and returns its own successor.
-type watch() :: fun((figures()) -> {continue | stop, watch()}).

%% The size now and at the beginning: faults, `drop's of single packets among them, and robots.
-type figures() :: #{
    runs := non_neg_integer(),
    faults := non_neg_integer(),
    faults_before := non_neg_integer(),
    drops := non_neg_integer(),
    robots := pos_integer(),
    robots_before := pos_integer()
}.

%% The smallest scenario found, its violation, and whether the search was completed.
-type result() :: #{
    scenario := starl_run_scenario:t(),
    violation := starl_monitor:violation(),
    digest := binary(),
    figures := figures(),
    complete := boolean(),
    others := [met()]
}.

%% Another violation that a smaller scenario showed: another cause, found on the way.
-type met() :: #{scenario := starl_run_scenario:t(), violation := starl_monitor:violation()}.

-type shape() :: {alone | team, starl_violation:shape()}.

-type reason() ::
    holds
    | {not_reproducible, Seen :: [binary(), ...]}
    | {trial, starl_sim_trial:reason()}.

-record(search, {
    run :: fun((starl_run_scenario:t()) -> starl_sim_trial:verdict()),
    watch :: watch(),
    %% the smallest so far, with the outcome of its run
    best :: starl_run_scenario:t(),
    outcome :: starl_sim_trial:outcome(),
    violation :: starl_monitor:violation(),
    shape :: shape(),
    others = #{} :: #{shape() => met()},
    runs :: non_neg_integer(),
    faults_before :: non_neg_integer(),
    robots_before :: pos_integer(),
    %% the ids of the faults that stand for random loss
    drops = [] :: [atom()],
    stopped = false :: boolean()
}).

%% Further rounds have never helped.
-define(ROUNDS, 4).
%% The number of halvings of the time, for a violation that shows only at the end of a run.
-define(HALVINGS, 5).
%% The most other causes to report.
-define(OTHERS, 5).
%% Values that remove randomness from a run.
-define(PLAIN, [
    {duplicate, 0.0},
    {clock_offset, 0},
    {clock_drift, 0},
    {heading_error, 0.0},
    {distance_error, 0.0},
    {position_error, 0.0},
    {range, none},
    {wall_loss, 0.0},
    {shadowing, 0.0}
]).

%% @doc The smallest scenario found whose run has the violation of this scenario's run.
-spec shrink(starl_run_scenario:t(), request()) -> {ok, result()} | {error, reason()}.
shrink(Scenario, #{run := Run} = Request) ->
    case {Run(Scenario), maps:get(digest, Request, any)} of
        {{error, Reason}, _} ->
            {error, {trial, Reason}};
        {{ok, #{digest := Seen}}, Known} when is_binary(Known), Known =/= Seen ->
            {error, {not_reproducible, [Known, Seen]}};
        {{ok, #{violations := []}}, _} ->
            {error, holds};
        {{ok, Outcome}, _} ->
            explicit(Outcome, Request)
    end.

%% The outcome's scenario holds the drawn faults; with them it must be the same run.
explicit(#{scenario := Scenario, digest := Digest} = Outcome, #{run := Run} = Request) ->
    case Run(Scenario) of
        {ok, #{digest := Digest}} -> begin_with(Outcome, Request);
        {ok, #{digest := Other}} -> {error, {not_reproducible, [Digest, Other]}};
        {error, Reason} -> {error, {trial, Reason}}
    end.

begin_with(#{scenario := Scenario, violations := [First | _]} = Outcome, Request) ->
    #{faults := Faults, robots := Robots} = Scenario,
    Search = #search{
        run = maps:get(run, Request),
        watch = maps:get(watch, Request),
        best = ending_with(Outcome, Scenario),
        outcome = Outcome,
        violation = First,
        shape = shape(First, Scenario),
        runs = 2,
        faults_before = length(Faults),
        robots_before = Robots
    },
    {ok, result(rounds(?ROUNDS, told(Search)))}.

rounds(0, Search) ->
    Search;
rounds(N, #search{best = Before} = Search) ->
    Steps = [fun horizon/1, fun faults/1, fun robots/1, fun plain/1, fun losses/1],
    case lists:foldl(fun(Step, S) -> Step(S) end, Search, Steps) of
        #search{best = Before} = Done -> Done;
        Smaller -> rounds(N - 1, Smaller)
    end.

result(#search{best = Best, violation = Violation, outcome = #{digest := Digest}} = Search) ->
    #{
        scenario => Best,
        violation => Violation,
        digest => Digest,
        figures => figures(Search),
        complete => not Search#search.stopped,
        others => others(Search)
    }.

others(#search{others = Others}) ->
    lists:sublist(lists:sort(fun is_smaller/2, maps:values(Others)), ?OTHERS).

figures(#search{best = #{faults := Faults, robots := Robots}, drops = Drops} = Search) ->
    #{
        runs => Search#search.runs,
        faults => length(Faults),
        faults_before => Search#search.faults_before,
        drops => length([Id || {Id, _, _, _, _, _} <- Faults, lists:member(Id, Drops)]),
        robots => Robots,
        robots_before => Search#search.robots_before
    }.

%% -- one run --------------------------------------------------------------------------------

%% Does a smaller scenario still have the violation? If so, it becomes the best one.
attempt(_Candidate, #search{stopped = true} = Search) ->
    {false, Search};
attempt(Candidate, #search{run = Run, runs = Runs} = Search) ->
    Counted = Search#search{runs = Runs + 1},
    case Run(Candidate) of
        %% a scenario that cannot be run violates nothing
        {error, _} -> {false, told(Counted)};
        {ok, Outcome} -> found(Outcome, ending_with(Outcome, Candidate), Counted)
    end.

found(#{violations := Violations} = Outcome, Smaller, #search{shape = Shape} = Search) ->
    case [V || V <- Violations, shape(V, Smaller) =:= Shape] of
        [First | _] ->
            {true, told(Search#search{best = Smaller, outcome = Outcome, violation = First})};
        [] ->
            {false, told(lists:foldl(fun(V, S) -> met(V, Smaller, S) end, Search, Violations))}
    end.

shape(Violation, #{robots := 1}) -> {alone, starl_violation:shape(Violation)};
shape(Violation, #{robots := _}) -> {team, starl_violation:shape(Violation)}.

%% Keeps the smallest scenario of each other shape.
met(Violation, Scenario, #search{others = Others} = Search) ->
    Shape = shape(Violation, Scenario),
    Met = #{scenario => Scenario, violation => Violation},
    case Others of
        #{Shape := Known} ->
            case is_smaller(Known, Met) of
                true -> Search;
                false -> Search#search{others = Others#{Shape := Met}}
            end;
        #{} ->
            Search#search{others = Others#{Shape => Met}}
    end.

is_smaller(#{scenario := A}, #{scenario := B}) -> extent(A) =< extent(B).

extent(#{faults := Faults, robots := Robots, time := Time}) -> {length(Faults), Robots, Time}.

%% The time after the end of the run is not needed.
ending_with(#{end_us := EndUs}, #{time := Time} = Scenario) ->
    Scenario#{time := min(Time, max(1, EndUs) / 1.0e6)}.

told(#search{watch = Watch} = Search) ->
    case Watch(figures(Search)) of
        {continue, Next} -> Search#search{watch = Next};
        {stop, Next} -> Search#search{watch = Next, stopped = true}
    end.

tried(Candidate, Search) ->
    {_, Next} = attempt(Candidate, Search),
    Next.

%% -- the steps ------------------------------------------------------------------------------

%% A violation that shows at once has ended the run already; others are judged at its end, which
%% may be moved forward.
horizon(#search{best = #{time := Time} = Best, violation = #{at_us := At}} = Search) ->
    case max(1, At) / 1.0e6 of
        Earlier when Earlier < Time -> halve(?HALVINGS, tried(Best#{time := Earlier}, Search));
        _ -> halve(?HALVINGS, Search)
    end.

halve(0, Search) ->
    Search;
halve(N, #search{best = #{time := Time} = Best} = Search) ->
    case attempt(Best#{time := Time / 2}, Search) of
        {true, Next} -> halve(N - 1, Next);
        {false, Next} -> Next
    end.

faults(#search{best = #{faults := Faults}} = Search) -> minimize(Faults, [], Search).

%% The fewest of these faults that still suffice, besides those that stay.
minimize(Faults, Stay, Search) ->
    Test = fun(Some, #search{best = Best} = S) ->
        attempt(Best#{faults := Stay ++ Some}, S)
    end,
    {_, Next} = starl_sim_ddmin:minimize(Faults, Test, Search),
    Next.

%% The smallest teams are tried first, since they are fastest: 1, 2, 4, ... robots, then between the
%% last two.
robots(#search{best = #{robots := Robots}} = Search) -> grow(1, Robots, Search).

grow(N, Robots, Search) when N >= Robots -> between(N div 2, Robots, Search);
grow(N, Robots, Search) ->
    case attempt(with_robots(N, Search), Search) of
        {true, Next} -> between(N div 2, N, Next);
        {false, Next} -> grow(2 * N, Robots, Next)
    end.

between(TooFew, Enough, Search) when Enough - TooFew =< 1 -> Search;
between(TooFew, Enough, Search) ->
    Middle = (TooFew + Enough) div 2,
    case attempt(with_robots(Middle, Search), Search) of
        {true, Next} -> between(TooFew, Middle, Next);
        {false, Next} -> between(Middle, Enough, Next)
    end.

with_robots(N, #search{best = #{faults := Faults} = Best}) ->
    Best#{robots := N, faults := [Fault || F <- Faults, Fault <- within(N, F)]}.

%% The fault in a team of N, if it hits any robot there.
within(N, {Id, From, To, Kind, Group, Params}) when is_list(Group) ->
    [{Id, From, To, Kind, Some, Params} || Some <- [[R || R <- Group, R =< N]], Some =/= []];
within(N, Fault) ->
    [Fault || lists:all(fun(R) -> R =< N end, starl_run_fault:targets(Fault))].

plain(#search{best = #{delay := {Min, Max}, converge := Converge}} = Search) ->
    Other = [{delay, {Max, Max}} || Min < Max] ++ [{converge, none} || Converge =/= none],
    lists:foldl(fun settle/2, Search, ?PLAIN ++ Other).

settle({Key, Value}, #search{best = Best} = Search) ->
    case Best of
        #{Key := Known} when Known == Value -> Search;
        #{} -> tried(Best#{Key := Value}, Search)
    end.

%% Random loss as faults: the N-th packet of a link is lost at any time. (A packet to
%% one robot and one to all may have the same number: if the loss of both changes the outcome, each
%% fault holds only in the millisecond in which its packet was lost.)
losses(#search{best = #{loss := Loss}} = Search) when Loss == 0 -> Search;
losses(#search{best = #{faults := Faults} = Best} = Search) ->
    Lost = lost(Search),
    Ways = [[drop(L, Span) || L <- Lost] || Span <- [{0, span_ms(Best)}, own]],
    Explicit = [{Drops, Best#{loss := 0.0, faults := Faults ++ Drops}} || Drops <- Ways],
    case first(Explicit, Search) of
        {Drops, Next} ->
            Ids = [element(1, Drop) || Drop <- Drops],
            minimize(Drops, Faults, Next#search{drops = Ids ++ Next#search.drops});
        Next ->
            Next
    end.

first([], Search) ->
    Search;
first([{Drops, Candidate} | Others], Search) ->
    case attempt(Candidate, Search) of
        {true, Next} -> {Drops, Next};
        {false, Next} -> first(Others, Next)
    end.

%% The packets lost without any fault, each once.
lost(#search{best = #{seed := Seed} = Best, outcome = #{lost := Lost}}) ->
    [L || {_, From, To, N} = L <- Lost, starl_sim_radio:lost({Seed, From, To, N}, Best)].

drop({Us, From, To, Number}, Span) ->
    {Name, N} = numbered(Number),
    Id = list_to_atom(lists:concat(["lost_", From, "_", To, "_", Name, N])),
    {FromMs, ToMs} = span(Span, Us div 1000),
    {Id, FromMs, ToMs, drop, {From, To}, #{packet => N}}.

numbered({all, N}) -> {"all_", N};
numbered(N) -> {"", N}.

span(own, Ms) -> {Ms, Ms + 1};
span(Span, _Ms) -> Span.

span_ms(#{time := Seconds}) -> ceil(1000 * Seconds).

%% @doc One line on why a run cannot be shrunk.
-spec format_error(reason()) -> unicode:chardata().
format_error(holds) ->
    "the run violates no contract, so there is nothing to shrink";
format_error({not_reproducible, Digests}) ->
    Texts = [string:lowercase(binary:encode_hex(Digest)) || Digest <- Digests],
    [
        "the run is not reproducible: its digests are ",
        lists:join(", ", Texts),
        "; ./starl diverge tells where two runs part"
    ];
format_error({trial, {start, Reason}}) ->
    starl_sim:format_error(Reason);
format_error({trial, {unjudged, [Part | _]}}) ->
    starl_unjudged:format(Part);
format_error({trial, {failed, {hung, Hang}}}) ->
    starl_sim_watchdog:format_hang(Hang);
format_error({trial, {failed, Reason}}) ->
    io_lib:format("the simulation failed: ~0tP", [Reason, 15]).
