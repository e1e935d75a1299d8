%% @doc The leases of a coordinator. They bound how long it leads and which robots may still be
%% moving.
%%
%% There are two leases, each for `lease_ms' at most:
%% ```
%%   participant -> coordinator   vote: "I vote for nobody else"       held by the coordinator
%%   coordinator -> participant   drive lease: for an assigned path    held by the participant
%% '''
%% The giver counts the lease from when it gave it. The holder counts from when it sent the message
%% that the lease answers, and subtracts `drift_ppm' and twice `jump_ms':
%% ```
%%   giver    |---------------- lease_ms ----------------|  its clock is set forward: <-- jump_ms
%%   holder |------ short ------|                           its clock is set back:    --> jump_ms
%% '''
%% So the lease always ends at its holder first: for any delay of messages, and for any drift of the
%% two clocks within the bound. This holds even if both clocks are set meanwhile, as when a network
%% comes back with the time.
%%
%% A coordinator leads while a quorum's votes last. Any two quorums have a robot in common, so no
%% two coordinators lead at one time. (Gray and Cheriton, "Leases", 1989. The election by votes
%% follows Ongaro and Ousterhout, "In search of an understandable consensus algorithm", 2014.)
-module(starl_dpp_lease).

-export([options/0, check/1, new/2, short_us/1, long_us/1, bounds/1, limits/1, beat_us/1, quorum/2]).
-export([
    beat/2, voted/4, heard/4, since/2, leads/2, until/1, votes/2, stamps/1, rests/3, outlives/4
]).
-export_type([t/0, config/0, seq/0, stamp/0]).

%% `lease_ms' (10000): the duration of a lease, and about the time without a coordinator after one
%% has died; `drift_ppm' (10000): the greatest drift of a clock against real time; `jump_ms' (2000):
%% the most by which a clock is set during a lease; far less than half of `lease_ms'.
-type config() :: #{
    lease_ms => pos_integer(),
    drift_ppm => non_neg_integer(),
    jump_ms => non_neg_integer(),
    atom() => term()
}.
%% The name of a beat: the coordinator's clock (us) when it sent the beat.
-type seq() :: integer().
%% A participant's own clock (us) when it sent a message.
-type stamp() :: integer().

-define(BEAT_US, 1000000).
%% The least number of beats that are sent during a lease.
-define(BEATS, 7).

-record(lease, {
    team :: [starl:robot_id()],
    short_us :: pos_integer(),
    long_us :: pos_integer(),
    jump_us :: non_neg_integer(),
    %% the beats of the last lease, latest first
    sent = [] :: [seq()],
    votes = #{} :: #{starl:robot_id() => UntilUs :: integer()},
    heard = #{} :: #{starl:robot_id() => {stamp(), AtUs :: integer()}},
    %% when the coordinator began to lead
    since = none :: integer() | none
}).
-opaque t() :: #lease{}.

%% @doc The options of leases, see {@link config()}.
-spec options() -> [starl_options:option()].
options() ->
    [
        {lease_ms, {integer, 1, 1000000000}, 10000,
            "the duration of a lease: of a vote, and of a robot's permission to drive, ms"},
        {drift_ppm, {integer, 0, 100000}, 10000,
            "no clock is faster or slower than real time by more, ppm"},
        {jump_ms, {integer, 0, 1000000000}, 2000,
            "the most by which a clock is set during a lease, ms; far less than half of a lease"}
    ].

%% @doc Do drift and jumps leave a tenth of a lease to its holder?
-spec check(config()) -> ok | {error, string()}.
check(Config) ->
    {Long, Left} = {long_us(Config), left_us(Config)},
    case 10 * Left >= Long of
        true ->
            ok;
        false ->
            {Jump, Ppm} = bounds(Config),
            Format =
                "of a lease of ~b ms its holder would have ~b ms: twice jump_ms (~b) and a drift of "
                "~b ppm are taken off; take a lease far longer than twice jump_ms",
            Values = [Long div 1000, max(0, Left) div 1000, Jump div 1000, Ppm],
            {error, lists:flatten(io_lib:format(Format, Values))}
    end.

%% @doc No votes yet.
-spec new([starl:robot_id()], config()) -> t().
new(Team, Config) ->
    {Jump, _Ppm} = bounds(Config),
    #lease{team = Team, short_us = short_us(Config), long_us = long_us(Config), jump_us = Jump}.

%% @doc The duration of a lease for its giver (us).
-spec long_us(config()) -> pos_integer().
long_us(Config) -> round(1000 * maps:get(lease_ms, Config, 10000)).

%% @doc The duration of a lease for its holder (us): the shorter one.
-spec short_us(config()) -> pos_integer().
short_us(Config) -> max(1, left_us(Config)).

%% Drift and jumps of both clocks are taken off.
left_us(Config) ->
    {Jump, Ppm} = bounds(Config),
    long_us(Config) * (1000000 - Ppm) div (1000000 + Ppm) - 2 * Jump.

%% @doc What a witness of the own clock allows for; a lease to drive is no longer than its window.
-spec limits(config()) -> starl_dpp_clock_check:limits().
limits(Config) ->
    {Jump, Ppm} = bounds(Config),
    {Jump, Ppm, short_us(Config)}.

%% @doc The bounds on a clock: the most by which it is set (us), and its greatest drift (ppm).
-spec bounds(config()) -> {JumpUs :: non_neg_integer(), Ppm :: non_neg_integer()}.
bounds(Config) ->
    {round(1000 * maps:get(jump_ms, Config, 2000)), maps:get(drift_ppm, Config, 10000)}.

%% @doc The time between two heartbeats (us). It is at most a second, and so short that a few
%% heartbeats may be lost before the lease that they prolong has ended. Participants answer every
%% other heartbeat.
-spec beat_us(config()) -> pos_integer().
beat_us(Config) -> min(?BEAT_US, short_us(Config) div ?BEATS + 1).

%% @doc Are these robots a quorum: more than half of the team, or half of it with its first robot?
-spec quorum([starl:robot_id()], Team :: [starl:robot_id(), ...]) -> boolean().
quorum(Robots, [First | _] = Team) ->
    Voters = ordsets:intersection(lists:usort(Robots), Team),
    case 2 * length(Voters) - length(Team) of
        0 -> hd(Voters) =:= First;
        More -> More > 0
    end.

%% @doc Records a heartbeat that is sent now, and returns its name. Votes will answer it.
-spec beat(Now :: integer(), t()) -> {seq(), t()}.
beat(Now, #lease{sent = Sent, short_us = Short} = Lease) ->
    Recent = [Us || Us <- Sent, Us + Short > Now, Us =/= Now],
    {Now, Lease#lease{sent = [Now | Recent]}}.

%% @doc Records a robot's answer to this heartbeat: its vote. An answer to a heartbeat that is too
%% old does not count.
-spec voted(starl:robot_id(), seq(), Vote :: boolean(), t()) -> t().
voted(Robot, Seq, true, #lease{sent = Sent, votes = Votes, short_us = Short} = Lease) ->
    case lists:member(Seq, Sent) of
        true ->
            Until = max(Seq + Short, maps:get(Robot, Votes, Seq)),
            Lease#lease{votes = Votes#{Robot => Until}};
        false ->
            Lease
    end;
voted(_Robot, _Seq, false, Lease) ->
    Lease.

%% @doc Records the stamp of a message from a robot whose place is known. The next heartbeat will
%% prolong the robot's lease to drive. A message that a later one has overtaken changes nothing.
-spec heard(starl:robot_id(), stamp(), Now :: integer(), t()) -> t().
heard(Robot, Stamp, Now, #lease{heard = Heard} = Lease) ->
    case Heard of
        #{Robot := {Latest, _}} when Latest >= Stamp -> Lease;
        #{} -> Lease#lease{heard = Heard#{Robot => {Stamp, Now}}}
    end.

%% @doc The stamps to be sent with a heartbeat.
-spec stamps(t()) -> [{starl:robot_id(), stamp()}].
stamps(#lease{heard = Heard}) ->
    lists:sort([{Robot, Stamp} || {Robot, {Stamp, _}} <- maps:to_list(Heard)]).

%% @doc The coordinator leads from now on: the drive leases of earlier coordinators have an end.
-spec since(Now :: integer(), t()) -> t().
since(Now, Lease) -> Lease#lease{since = Now}.

%% @doc Does the coordinator lead: do the votes of a quorum last?
-spec leads(Now :: integer(), t()) -> boolean().
leads(Now, #lease{team = Team} = Lease) -> quorum(votes(Now, Lease), Team).

%% @doc The last moment at which the coordinator leads, by the votes that it has now.
-spec until(t()) -> integer().
until(#lease{team = Team, votes = Votes}) ->
    Latest = lists:reverse(lists:keysort(2, maps:to_list(Votes))),
    last_moment(Latest, [], Team).

%% With the votes that end latest, as few as make a quorum.
last_moment([{Robot, Until} | Votes], Robots, Team) ->
    case quorum([Robot | Robots], Team) of
        true when is_integer(Until) -> Until - 1;
        false -> last_moment(Votes, [Robot | Robots], Team)
    end.

%% @doc The robots whose votes last.
-spec votes(Now :: integer(), t()) -> [starl:robot_id()].
votes(Now, #lease{votes = Votes}) ->
    lists:sort([Robot || {Robot, Until} <- maps:to_list(Votes), Until > Now]).

%% @doc Have all drive leases that the robot may have, from this coordinator or an earlier one,
%% ended? Then the robot stands.
-spec rests(starl:robot_id(), Now :: integer(), t()) -> boolean().
rests(_Robot, _Now, #lease{since = none}) ->
    false;
rests(Robot, Now, #lease{heard = Heard, since = Since, long_us = Long}) ->
    {_, At} = maps:get(Robot, Heard, {none, Since}),
    max(At, Since) + Long < Now.

%% @doc Could a lease to drive that the robot counts from this stamp outlast what the coordinator
%% allows for it? It could in two cases. First, all leases of the robot have ended here
%% ({@link rests/3}): the robot's clock may have stopped. Second, the coordinator has known a later
%% stamp for longer than `jump_ms': then the robot's clock was not merely set back.
-spec outlives(starl:robot_id(), stamp(), Now :: integer(), t()) -> boolean().
outlives(Robot, Stamp, Now, #lease{heard = Heard, jump_us = Jump} = Lease) ->
    case Heard of
        #{Robot := {Latest, At}} when Stamp < Latest, Now - At > Jump -> true;
        #{} -> rests(Robot, Now, Lease)
    end.
