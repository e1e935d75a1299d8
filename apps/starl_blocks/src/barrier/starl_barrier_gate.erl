%% @doc One name of a barrier as one robot sees it: how far the robot has come, how far the
%% others, and what they know of it. Pure; a part of {@link starl_barrier_rounds}.
%%
%% All counts only grow. A gate is <em>unsure</em> while what this robot did before is known only
%% from what the others say.
-module(starl_barrier_gate).

-export([new/1, next/1, is_sure/1, caller/1, counts/1, fact/2]).
-export([resume/2, reach/4, pass/1, missed/1, unheard/1, fail/1]).
-export([hear/4, learn/5, assure/2, recall/2, certain/1]).

-export_type([t/0]).

-type round() :: non_neg_integer().
-type counts() :: #{starl:robot_id() => round()}.

-record(gate, {
    %% false: known only from what the others say
    sure = true :: boolean(),
    at = 0 :: round(),
    passed = 0 :: round(),
    %% the last round that somebody has surely passed: so all have reached it
    done = 0 :: round(),
    reached = #{} :: counts(),
    heard = #{} :: counts(),
    from = none :: starl_machine:from() | none,
    %% while it waits: those that it misses
    awaited = [] :: [starl:robot_id()]
}).

-opaque t() :: #gate{}.

%% @doc A name of which nothing is known; `false': the robot may have been here before.
-spec new(IsSure :: boolean()) -> t().
new(Sure) -> #gate{sure = Sure}.

%% @doc The first round not passed.
-spec next(t()) -> pos_integer().
next(#gate{passed = Passed}) -> Passed + 1.

%% @doc Is it known what this robot did before?
-spec is_sure(t()) -> boolean().
is_sure(#gate{sure = Sure}) -> Sure.

%% @doc Who waits for the round to be passed.
-spec caller(t()) -> starl_machine:from() | none.
caller(#gate{from = From}) -> From.

%% @doc The round that the robot has reached and the one that it has passed.
-spec counts(t()) -> {At :: round(), Passed :: round()}.
counts(#gate{at = At, passed = Passed}) -> {At, Passed}.

%% @doc What another robot may want to know: how far this one has come, how far the other has
%% been heard of, and the last round surely passed.
-spec fact(starl:robot_id(), t()) -> {At :: round(), Reached :: round(), Done :: round()}.
fact(Robot, #gate{at = At, done = Done, reached = Reached}) ->
    {At, maps:get(Robot, Reached, 0), Done}.

%% -- the robot's own rounds -----------------------------------------------------------------

%% @doc The robot says that this is the first round not passed. The caller knows better than the
%% others what it has passed.
-spec resume(pos_integer(), t()) -> t().
resume(Round, #gate{sure = false} = Gate) ->
    Gate#gate{sure = true, at = Round - 1, passed = Round - 1};
resume(_Round, Gate) ->
    Gate.

%% @doc The robot has reached a round, for the first time or again, and waits for the others.
-spec reach(pos_integer(), starl_machine:from(), [starl:robot_id()], t()) -> {new | again, t()}.
reach(Round, From, Others, Gate0) ->
    #gate{at = At} = Gate = resume(Round, Gate0),
    There = Gate#gate{at = Round, from = From},
    Waiting = There#gate{awaited = [Robot || Robot <- Others, is_missed(Robot, There)]},
    case At < Round of
        true -> {new, Waiting};
        false -> {again, Waiting}
    end.

%% @doc Passes, if all have reached the round and know that this robot has.
-spec pass(t()) -> {passed, starl_machine:from(), round(), t()} | waits.
pass(#gate{at = At, from = From, awaited = []} = Gate) when From =/= none ->
    {passed, From, At, Gate#gate{passed = At, done = At, from = none}};
pass(#gate{}) ->
    waits.

%% @doc Those that the robot waits for.
-spec missed(t()) -> [starl:robot_id()].
missed(#gate{awaited = Awaited}) -> Awaited.

%% @doc Those of them of which nothing is known.
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
hear(Robot, Round, Known, #gate{reached = Reached, heard = Heard} = Gate) ->
    Counted = Gate#gate{
        reached = raise(Robot, Round, Reached), heard = raise(Robot, Known, Heard)
    },
    remember(Known, no_longer_missed(Robot, Counted)).

no_longer_missed(Robot, #gate{awaited = Awaited} = Gate) ->
    case is_missed(Robot, Gate) of
        true -> Gate;
        false -> Gate#gate{awaited = lists:delete(Robot, Awaited)}
    end.

raise(Robot, Count, Counts) -> Counts#{Robot => max(Count, maps:get(Robot, Counts, 0))}.

remember(Known, #gate{sure = false, at = At} = Gate) when Known > At -> Gate#gate{at = Known};
remember(_Known, Gate) -> Gate.

%% @doc The same, and it knows that a round has surely been passed by somebody.
-spec learn(starl:robot_id(), round(), Known :: round(), Done :: round(), t()) -> t().
learn(Robot, Round, Known, Done, #gate{done = Before} = Gate) ->
    hear(Robot, Round, Known, remember(Done, Gate#gate{done = max(Done, Before)})).

%% -- after a crash --------------------------------------------------------------------------

%% @doc All that can be known is known. If a witness (that knows its own counts) has not come so
%% far itself, nobody has passed the round that this robot reached; else it counts as passed.
-spec assure(Witnesses :: [starl:robot_id()], t()) -> t().
assure(Witnesses, #gate{sure = false, at = At, reached = Reached} = Gate) ->
    case lists:any(fun(Witness) -> maps:get(Witness, Reached, 0) < At end, Witnesses) of
        true -> Gate#gate{sure = true, passed = At - 1};
        false -> Gate#gate{sure = true, passed = At}
    end;
assure(_Witnesses, Gate) ->
    Gate.

%% @doc The counts that a log has kept, which are exact.
-spec recall({At :: round(), Passed :: round()}, t()) -> t().
recall({At, Passed}, Gate) -> Gate#gate{sure = true, at = At, passed = Passed}.

%% @doc A name that the log does not know has not been used.
-spec certain(t()) -> t().
certain(Gate) -> Gate#gate{sure = true}.
