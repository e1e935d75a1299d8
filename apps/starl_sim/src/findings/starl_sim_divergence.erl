%% @doc Finds the first event in which two runs differ, although they should be equal.
%%
%% Two runs are compared by the checkpoints of each robot's chain ({@link starl_sim_ledger}): the
%% first difference of a robot lies between its last equal checkpoint and its first different
%% one. Both runs are repeated with the events between the two recorded, for those robots
%% whose first difference may be the earliest of all. A run that depends on something outside the
%% scenario may differ elsewhere each time; then the search goes on from the newer runs.
%% ```
%%   Run = fun(Record) -> starl_sim_divergence:run(Scenario, Record) end,
%%   starl_sim_divergence:find(Run, Run).
%% '''
-module(starl_sim_divergence).

-export([run/2, find/2, find/4]).

-export_type([result/0, ranges/0, runner/0, difference/0, found/0]).

%% The data by which a run is compared, and its recorded events.
-type result() :: #{
    digest := binary(),
    end_us := starl_sim_queue:time(),
    events := non_neg_integer(),
    violations := non_neg_integer(),
    chains := [chain()],
    recorded := #{starl:robot_id() => [starl_sim_ledger:event()]}
}.

%% A robot's final chain, its number of events, and its checkpoints.
-type chain() :: {
    starl:robot_id(),
    Chain :: non_neg_integer(),
    Events :: non_neg_integer(),
    [starl_sim_ledger:checkpoint()]
}.

-type ranges() :: #{starl:robot_id() => starl_sim_ledger:range()}.

%% Runs a scenario in one way, on any node.
-type runner() :: fun((ranges()) -> result()).

%% The N-th event of a robot in both runs, `none' if a run had no such event, and the events
%% before it, which are the same in both.
-type difference() :: #{
    robot := starl:robot_id(),
    n := pos_integer(),
    at_us := starl_sim_queue:time(),
    first := starl_sim_ledger:event() | none,
    second := starl_sim_ledger:event() | none,
    before := [starl_sim_ledger:event()]
}.

%% `gone': the runs differed, but not when repeated. `not_found': they differ elsewhere each time.
-type found() :: {differ, difference()} | gone | not_found.

%% The number of robots recorded at once, and the largest number of repetitions of both runs.
-define(AT_ONCE, 64).
-define(REPEATS, 12).
-define(BEFORE, 3).

%% The place of a robot's first difference, by number and by time.
-record(suspect, {
    id :: starl:robot_id(),
    range :: starl_sim_ledger:range(),
    after_us :: starl_sim_queue:time(),
    until_us :: starl_sim_queue:time() | infinity
}).

%% The state of the search: the robots that were examined, and the earliest difference.
-record(search, {
    first :: runner(),
    second :: runner(),
    covered = [] :: [starl:robot_id()],
    best = none :: difference() | none,
    repeats = ?REPEATS :: non_neg_integer()
}).

%% @doc Runs a scenario to its end and records these events; the scenario must be valid.
-spec run(#{app := module(), atom() => term()}, ranges()) -> result().
run(Scenario, Record) ->
    {ok, Sim} = starl_sim:start(Scenario, #{record => Record}),
    #{ending := _} = starl_sim_trial:whole(Sim),
    Recorded = maps:map(fun(Id, _) -> starl_sim:events(Sim, Id) end, Record),
    {#{digest := Digest, end_us := EndUs, events := Events} = Outcome, _} = starl_sim:finish(Sim),
    #{robots := Robots, violations := Violations} = Outcome,
    #{
        digest => Digest,
        end_us => EndUs,
        events => Events,
        violations => length(Violations),
        chains => [chain(Id, Summary) || {Id, Summary} <- Robots],
        recorded => Recorded
    }.

chain(Id, #{chain := Chain, events := Events, checkpoints := Checkpoints}) ->
    {Id, Chain, Events, Checkpoints}.

%% @doc Runs both and finds the first difference.
-spec find(runner(), runner()) -> found() | same.
find(First, Second) ->
    case {First(#{}), Second(#{})} of
        {#{digest := Digest}, #{digest := Digest}} -> same;
        {A, B} -> find(A, B, First, Second)
    end.

%% @doc Finds the first difference of two runs that have come to different results.
-spec find(result(), result(), runner(), runner()) -> found().
find(A, B, First, Second) -> search(A, B, #search{first = First, second = Second}).

search(A, B, #search{covered = Covered, best = Best, repeats = Repeats} = Search) ->
    Left = [
        Suspect
     || #suspect{id = Id, after_us = After} = Suspect <- suspects(A, B),
        not lists:member(Id, Covered),
        After =< time(Best)
    ],
    case Left of
        [] when Best =:= none -> not_found;
        [] -> {differ, Best};
        [_ | _] when Repeats =:= 0, Best =:= none -> not_found;
        [_ | _] when Repeats =:= 0 -> {differ, Best};
        [_ | _] -> repeat(lists:sublist(Left, ?AT_ONCE), A, B, Search)
    end.

%% A difference found in earlier runs counts only if the new runs are the same.
repeat(Suspects, A, B, #search{first = First, second = Second} = Search) ->
    Record = maps:from_list([{Id, Range} || #suspect{id = Id, range = Range} <- Suspects]),
    {NewA, NewB} = {First(Record), Second(Record)},
    Found = earliest([difference(S, NewA, NewB) || S <- Suspects]),
    Ids = maps:keys(Record),
    Next = Search#search{repeats = Search#search.repeats - 1},
    case {digests(NewA, NewB), digests(A, B)} of
        {{Digest, Digest}, _} ->
            gone;
        {Same, Same} ->
            search(NewA, NewB, Next#search{
                covered = Ids ++ Search#search.covered,
                best = earliest([Search#search.best, Found])
            });
        _ when Found =:= none ->
            search(NewA, NewB, Next#search{covered = [], best = none});
        _ ->
            search(NewA, NewB, Next#search{covered = Ids, best = Found})
    end.

digests(#{digest := A}, #{digest := B}) -> {A, B}.

time(none) -> infinity;
time(#{at_us := At}) -> At.

earliest(Found) ->
    case lists:sort([{At, Id, F} || #{at_us := At, robot := Id} = F <- Found]) of
        [] -> none;
        [{_, _, First} | _] -> First
    end.

%% -- by checkpoints -------------------------------------------------------------------------

%% Robots that differ earliest come first.
suspects(#{chains := As}, #{chains := Bs}) ->
    Suspects = [
        suspect(Id, A, B)
     || {{Id, ChainA, EventsA, _} = A, {Id, ChainB, EventsB, _} = B} <- lists:zip(As, Bs),
        {ChainA, EventsA} =/= {ChainB, EventsB}
    ],
    lists:keysort(#suspect.until_us, Suspects).

suspect(Id, {Id, _, EventsA, As}, {Id, _, EventsB, Bs}) ->
    {{Equal, After}, Different} = split(common(As, Bs), {0, 0}),
    {To, Until} =
        case Different of
            none -> {min(EventsA, EventsB) + 1, infinity};
            _ -> Different
        end,
    #suspect{id = Id, range = {Equal + 1, To}, after_us = After, until_us = Until}.

%% Long runs keep fewer checkpoints, but always at numbers that short runs keep, too.
common([{N, _, _} = A | As], [{N, _, _} = B | Bs]) -> [{A, B} | common(As, Bs)];
common([{N, _, _} | As], [{M, _, _} | _] = Bs) when N < M -> common(As, Bs);
common([_ | _] = As, [_ | Bs]) -> common(As, Bs);
common(_, _) -> [].

split([{Same, Same} | Rest], _Last) ->
    {N, At, _} = Same,
    split(Rest, {N, At});
split([{{N, AtA, _}, {N, AtB, _}} | _], Last) ->
    {Last, {N, min(AtA, AtB)}};
split([], Last) ->
    {Last, none}.

%% -- by events ------------------------------------------------------------------------------

%% Recorded events count only if both runs were the same before them.
difference(#suspect{id = Id, range = {From, _}}, A, B) ->
    case at(From - 1, Id, A) =:= at(From - 1, Id, B) of
        true -> differing(recorded(Id, A), recorded(Id, B), Id, From, []);
        false -> none
    end.

at(0, _Id, _Result) ->
    start;
at(N, Id, #{chains := Chains}) ->
    {Id, _, _, Checkpoints} = lists:keyfind(Id, 1, Chains),
    lists:keyfind(N, 1, Checkpoints).

recorded(Id, #{recorded := Recorded}) -> maps:get(Id, Recorded).

%% The chain stands for the event and all events before it.
differing([#{chain := Chain} = Event | As], [#{chain := Chain} | Bs], Id, N, Before) ->
    differing(As, Bs, Id, N + 1, lists:sublist([Event | Before], ?BEFORE));
differing([], [], _Id, _N, _Before) ->
    none;
differing(As, Bs, Id, N, Before) ->
    {A, B} = {first(As), first(Bs)},
    Times = [At || #{at_us := At} <- [A, B]],
    #{
        robot => Id,
        n => N,
        at_us => lists:min(Times),
        first => A,
        second => B,
        before => lists:reverse(Before)
    }.

first([Event | _]) -> Event;
first([]) -> none.
