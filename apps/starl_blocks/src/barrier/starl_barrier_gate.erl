%% @doc The state of one barrier name at one robot. It holds the rounds that this robot and the
%% others have reached, and what the others know of this robot's round. Pure; a part of
%% {@link starl_barrier_rounds}.
%%
%% All counts only grow, and none exceeds the truth. So a robot never seems to have come further
%% than it has. A gate is <em>unsure</em> while this robot knows its earlier rounds from the others
%% only, or while its stored counts may be older than its last life.
%%
%% <em>What is believed.</em> A robot passes a round when all have reached it. So no robot is more
%% than one round ahead of another, and nobody has heard of a round that this robot has not reached.
%% A higher count in a message is cut to a few rounds ahead, since this robot's count may be behind
%% after a damage. An unsure gate keeps what each robot claims until all have answered. It then goes
%% on at most one round after the round that most of the others say they have reached themselves. In
%% a team of two there is only the claim of the other robot. It is followed up to a number that
%% leaves half of all numbers for later rounds.
-module(starl_barrier_gate).

-export([new/1, recall/2, progress/1, is_sure/1, caller/1, counts/1, fact/2]).
-export([resume/2, is_passed/2, notified/2, reach/4, pass/1, missed/1, unheard/1, fail/1]).
-export([hear/4, learn/5, assure/3, is_outdated/1]).

-export_type([t/0, progress/0, stored/0]).

-type round() :: non_neg_integer().
-type counts() :: #{starl:robot_id() => round()}.

%% The first round that the application has not passed, and the last that all have surely reached.
%% A waiting application keeps it, should the machine crash.
-type progress() :: {pos_integer(), All :: round()}.

%% The robot's own counts: the rounds that it has reached and passed, and the last that all have
%% surely reached.
-type stored() :: {At :: round(), Passed :: round(), All :: round()}.

%% What another robot says: the round that it has reached itself, and one that this robot has reached.
-type claim() :: {Own :: round(), Mine :: round()}.

%% So many rounds may another robot be ahead.
-define(LEAP, 16).
%% No further is a count believed that only others know. A message may hold twice as much.
-define(FARTHEST, 1 bsl 58).

-record(gate, {
    %% false: known from the others only, or not confirmed by them yet
    sure = true :: boolean(),
    %% while it is not: the stored counts
    kept = none :: stored() | none,
    at = 0 :: round(),
    passed = 0 :: round(),
    %% the last round that the application has passed, as far as it knows
    notified = 0 :: round(),
    %% the last round that all robots have surely reached
    all = 0 :: round(),
    reached = #{} :: counts(),
    heard = #{} :: counts(),
    %% while it is unsure
    claims = #{} :: #{starl:robot_id() => claim()},
    from = none :: starl_machine:from() | none,
    %% while it waits: the robots that it misses
    awaited = [] :: [starl:robot_id()]
}).

-opaque t() :: #gate{}.

%% @doc A name of which nothing is known; `false': the robot may have been here before.
-spec new(IsSure :: boolean()) -> t().
new(Sure) -> #gate{sure = Sure}.

%% @doc A name of which these counts were stored; `false': the others must confirm them. A round that
%% counted as passed after a damage need not have been reached by all. Earlier versions stored two
%% counts.
-spec recall(stored() | {At :: round(), Passed :: round()}, IsSure :: boolean()) -> t().
recall({At, Passed}, IsSure) ->
    recall({At, Passed, 0}, IsSure);
recall({At, Passed, All}, true) ->
    #gate{at = At, passed = Passed, notified = Passed, all = All};
recall({_, _, _} = Counts, false) ->
    (recall(Counts, true))#gate{sure = false, kept = Counts}.

%% @doc The application's progress with this name.
-spec progress(t()) -> progress().
progress(#gate{notified = Notified, all = All}) -> {Notified + 1, All}.

%% @doc Is it known what this robot did before?
-spec is_sure(t()) -> boolean().
is_sure(#gate{sure = Sure}) -> Sure.

%% @doc The caller that waits for the round to be passed.
-spec caller(t()) -> starl_machine:from() | none.
caller(#gate{from = From}) -> From.

%% @doc The counts to store; `none': there are none while the gate is unsure.
-spec counts(t()) -> stored() | none.
counts(#gate{sure = false, kept = Kept}) -> Kept;
counts(#gate{at = At, passed = Passed, all = All}) -> {At, Passed, All}.

%% @doc The counts to send to another robot. They are the round that this robot has reached, the
%% other's round as it is known here, and the last round that all have surely reached.
-spec fact(starl:robot_id(), t()) -> {At :: round(), Reached :: round(), All :: round()}.
fact(Robot, #gate{at = At, all = All, reached = Reached}) ->
    {At, maps:get(Robot, Reached, 0), All}.

%% -- the robot's own rounds -----------------------------------------------------------------

%% @doc The application reports the first round that it has not passed. It knows better than the
%% others, and better than a store that was damaged for a while and then returns older terms. But it
%% does not know of a round that was passed just before a crash.
-spec resume(progress(), t()) -> t().
resume({Round, All}, #gate{sure = false, kept = none, all = Known} = Gate) ->
    Before = Round - 1,
    settled(Gate#gate{at = Before, passed = Before, notified = Before, all = max(All, Known)});
resume({Round, _All}, #gate{at = At, passed = Passed} = Gate) ->
    Before = Round - 1,
    settled(Gate#gate{at = max(At, Before), passed = max(Passed, Before), notified = Before}).

%% From now on the robot's own counts are known: no other one is far ahead of them.
settled(#gate{sure = true} = Gate) ->
    Gate;
settled(#gate{at = At, all = All, reached = Reached, heard = Heard} = Gate) ->
    Gate#gate{
        sure = true,
        kept = none,
        claims = #{},
        all = min(All, At),
        reached = maps:map(fun(_, Round) -> min(Round, At + ?LEAP) end, Reached),
        heard = maps:map(fun(_, Round) -> min(Round, At) end, Heard)
    }.

%% @doc Has the robot passed this round although its application has not been notified?
-spec is_passed(pos_integer(), t()) -> boolean().
is_passed(Round, #gate{passed = Passed}) -> Round =< Passed.

%% @doc The application is notified that it has passed a round.
-spec notified(pos_integer(), t()) -> t().
notified(Round, Gate) -> Gate#gate{notified = Round}.

%% @doc The robot has reached a round, for the first time or again, and waits for the others.
-spec reach(progress(), starl_machine:from(), [starl:robot_id()], t()) -> {new | again, t()}.
reach({Round, _} = Progress, From, Others, Gate0) ->
    #gate{at = At} = Gate = resume(Progress, Gate0),
    There = Gate#gate{at = Round, from = From},
    Waiting = There#gate{awaited = [Robot || Robot <- Others, is_missed(Robot, There)]},
    case At < Round of
        true -> {new, Waiting};
        false -> {again, Waiting}
    end.

%% @doc Passes, if all have reached the round and know that this robot has.
-spec pass(t()) -> {passed, starl_machine:from(), round(), t()} | waits.
pass(#gate{at = At, from = From, awaited = []} = Gate) when From =/= none ->
    {passed, From, At, Gate#gate{passed = At, notified = At, all = At, from = none}};
pass(#gate{}) ->
    waits.

%% @doc The robots that this one waits for.
-spec missed(t()) -> [starl:robot_id()].
missed(#gate{awaited = Awaited}) -> Awaited.

%% @doc Those of them whose count is not known.
-spec unheard(t()) -> [starl:robot_id()].
unheard(#gate{awaited = Awaited, reached = Reached}) ->
    [Robot || Robot <- Awaited, not is_map_key(Robot, Reached)].

%% Has it not reached the round, or may it not know that this robot has?
is_missed(Robot, #gate{at = At, reached = Reached, heard = Heard}) ->
    maps:get(Robot, Reached, 0) < At orelse maps:get(Robot, Heard, 0) < At.

%% @doc The robot waits no longer. It has reached the round all the same.
-spec fail(t()) -> t().
fail(Gate) -> Gate#gate{from = none, awaited = []}.

%% -- the others -----------------------------------------------------------------------------

%% @doc A robot has reached a round, and knows that this robot has reached one.
-spec hear(starl:robot_id(), round(), Known :: round(), t()) -> t().
hear(Robot, Round, Known, #gate{sure = true, at = At} = Gate) ->
    no_longer_missed(Robot, heard(Robot, min(Round, At + ?LEAP), min(Known, At), Gate));
hear(Robot, Round, Known, Gate) ->
    heard(Robot, Round, Known, claimed(Robot, Round, Known, Gate)).

heard(Robot, Round, Known, #gate{reached = Reached, heard = Heard} = Gate) ->
    Gate#gate{reached = raise(Robot, Round, Reached), heard = raise(Robot, Known, Heard)}.

claimed(Robot, Round, Mine, #gate{claims = Claims} = Gate) ->
    {Before, Earlier} = maps:get(Robot, Claims, {0, 0}),
    Gate#gate{claims = Claims#{Robot => {max(Round, Before), max(Mine, Earlier)}}}.

no_longer_missed(Robot, #gate{awaited = Awaited} = Gate) ->
    case is_missed(Robot, Gate) of
        true -> Gate;
        false -> Gate#gate{awaited = lists:delete(Robot, Awaited)}
    end.

raise(Robot, Count, Counts) -> Counts#{Robot => max(Count, maps:get(Robot, Counts, 0))}.

%% @doc The same, and it knows that all have surely reached a round.
-spec learn(starl:robot_id(), round(), Known :: round(), All :: round(), t()) -> t().
learn(Robot, Round, Known, All, #gate{sure = true, at = At, all = Before} = Gate) ->
    hear(Robot, Round, Known, Gate#gate{all = max(min(All, At), Before)});
learn(Robot, Round, Known, All, #gate{all = Before} = Gate) ->
    Learned = Gate#gate{all = max(All, Before)},
    hear(Robot, Round, Known, claimed(Robot, Round, All, Learned)).

%% -- after a damaged store ------------------------------------------------------------------

%% @doc The others have sent all that they know. If a witness (a robot that knows its own counts)
%% has not reached this robot's round, no robot has passed the round. Else it counts as passed; if
%% all others are witnesses, all have surely reached it.
-spec assure(Witnesses :: [starl:robot_id()], Others :: [starl:robot_id()], t()) -> t().
assure(Witnesses, Others, #gate{sure = false, at = At} = Gate) ->
    case Gate#gate.kept =:= none orelse is_outdated(Gate) of
        true -> judge(Witnesses, Others, Gate#gate{at = max(At, believed(Gate))});
        false -> settled(Gate)
    end;
assure(_Witnesses, _Others, Gate) ->
    Gate.

%% @doc Do the others know a later round of this robot than its store? Then the store is that of an
%% earlier time, or was damaged.
-spec is_outdated(t()) -> boolean().
is_outdated(#gate{kept = none}) -> false;
is_outdated(#gate{kept = {Before, _, _}} = Gate) -> believed(Gate) > Before.

%% The round that this robot has reached, by what the others claim. A robot that is far ahead has passed
%% rounds that all had reached.
believed(#gate{at = At, claims = Claims}) ->
    Claimed = maps:values(Claims),
    Mine = lists:max([At | [min(Known, Own + 1) || {Own, Known} <- Claimed]]),
    Passed = [Own - 1 || {Own, _} <- Claimed, Own - 1 > Mine + ?LEAP],
    Most = 1 + middle([Own || {Own, _} <- Claimed]),
    lists:min([lists:max([Mine | Passed]), Most, ?FARTHEST]).

%% The middle of the rounds, the lower one of two. One who has lost its store may say 0.
middle(Rounds) ->
    case lists:sort([Round || Round <- Rounds, Round > 0]) of
        [] -> 0;
        Sorted -> lists:nth((length(Sorted) + 1) div 2, Sorted)
    end.

judge(Witnesses, Others, #gate{at = At, all = All, reached = Reached} = Gate) ->
    Behind = lists:any(fun(Witness) -> maps:get(Witness, Reached, 0) < At end, Witnesses),
    case {Behind, Others -- Witnesses} of
        {true, _} -> assured(At - 1, min(All, At - 1), Gate);
        {false, []} -> assured(At, At, Gate);
        {false, [_ | _]} -> assured(At, All, Gate)
    end.

assured(Passed, All, Gate) ->
    settled(Gate#gate{passed = Passed, notified = Passed, all = All}).
