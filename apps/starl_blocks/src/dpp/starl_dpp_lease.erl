%% @doc The leases of a coordinator: until when it leads, and who may still be on its way.
%%
%% Two promises, each for `lease_ms' at most:
%% ```
%%   participant -> coordinator   a vote: "I vote for nobody else"     held by the coordinator
%%   coordinator -> participant   leave to drive what it was assigned  held by the participant
%% '''
%% The holder of a promise counts from when it sent the message that was answered with it, and
%% `drift_ppm' and `jump_ms' less than the giver, who counts from when it gave it. So the holder's
%% time is over first, however long a message was on its way, however the two clocks drift within
%% the bound, and though one of them is set meanwhile.
%%
%% A coordinator leads while a quorum's votes last. Any two quorums have a robot in common, so no
%% two coordinators lead at one time. (Gray and Cheriton, "Leases", 1989; the election by votes is
%% that of Ongaro and Ousterhout, "In search of an understandable consensus algorithm", 2014.)
-module(starl_dpp_lease).

-export([options/0, new/2, short_us/1, long_us/1, bounds/1, beat_us/1, quorum/2]).
-export([beat/2, voted/4, heard/4, since/2, leads/2, votes/2, stamps/1, rests/3]).
-export_type([t/0, config/0, seq/0, stamp/0]).

%% `lease_ms' (10000): how long a promise lasts, and so, about, how long nobody leads when a
%% coordinator dies; `drift_ppm' (10000): how much clocks may go wrong against real time; `jump_ms'
%% (2000): by how much they may be set during a lease, far less than that.
-type config() :: #{
    lease_ms => pos_integer(), drift_ppm => non_neg_integer(), jump_ms => non_neg_integer(),
    atom() => term()
}.
%% Names a beat of a coordinator: its own clock (us) when it sent it.
-type seq() :: integer().
%% A participant's own clock (us) when it sent a message.
-type stamp() :: integer().

-define(BEAT_US, 1000000).
%% So many beats at least are sent while a promise lasts.
-define(BEATS, 7).

-record(lease, {
    team :: [starl:robot_id()],
    short_us :: pos_integer(),
    long_us :: pos_integer(),
    %% the beats of the last lease, latest first
    sent = [] :: [seq()],
    votes = #{} :: #{starl:robot_id() => UntilUs :: integer()},
    heard = #{} :: #{starl:robot_id() => {stamp(), AtUs :: integer()}},
    %% when it began to lead
    since = none :: integer() | none
}).
-opaque t() :: #lease{}.

%% @doc What of it can be set, see {@link config()}.
-spec options() -> [starl_options:option()].
options() ->
    [
        {lease_ms, {integer, 1, 1000000000}, 10000,
            "how long the coordinator leads by a vote, and a robot drives by a leave, ms"},
        {drift_ppm, {integer, 0, 100000}, 10000,
            "no clock is faster or slower than real time by more, ppm"},
        {jump_ms, {integer, 0, 1000000000}, 2000,
            "by how much clocks may be set meanwhile, ms; far less than a lease"}
    ].

%% @doc No votes yet.
-spec new([starl:robot_id()], config()) -> t().
new(Team, Config) ->
    #lease{team = Team, short_us = short_us(Config), long_us = long_us(Config)}.

%% @doc How long the giver of a promise keeps it.
-spec long_us(config()) -> pos_integer().
long_us(Config) -> round(1000 * maps:get(lease_ms, Config, 10000)).

%% @doc How long its holder relies on it.
-spec short_us(config()) -> pos_integer().
short_us(Config) ->
    Drift = maps:get(drift_ppm, Config, 10000),
    Jump = round(1000 * maps:get(jump_ms, Config, 2000)),
    max(1, long_us(Config) * (1000000 - Drift) div (1000000 + Drift) - Jump).

%% @doc By how much a clock may be set (us), and how much it may drift (ppm).
-spec bounds(config()) -> {JumpUs :: non_neg_integer(), Ppm :: non_neg_integer()}.
bounds(Config) ->
    {round(1000 * maps:get(jump_ms, Config, 2000)), maps:get(drift_ppm, Config, 10000)}.

%% @doc How often a coordinator sends a beat: at most once a second, and often enough that a few may
%% be lost before a promise has ended that they prolong. Participants answer every other one.
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

%% @doc A beat is sent: its name. Votes will answer it.
-spec beat(Now :: integer(), t()) -> {seq(), t()}.
beat(Now, #lease{sent = Sent, short_us = Short} = Lease) ->
    Recent = [Us || Us <- Sent, Us + Short > Now, Us =/= Now],
    {Now, Lease#lease{sent = [Now | Recent]}}.

%% @doc The robot has answered this beat with its vote; one that is too old does not count.
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

%% @doc Of a robot whose place is known a message with this stamp has come: the next beat will
%% give it leave to drive on. Messages that are overtaken by later ones change nothing.
-spec heard(starl:robot_id(), stamp(), Now :: integer(), t()) -> t().
heard(Robot, Stamp, Now, #lease{heard = Heard} = Lease) ->
    case Heard of
        #{Robot := {Latest, _}} when Latest >= Stamp -> Lease;
        #{} -> Lease#lease{heard = Heard#{Robot => {Stamp, Now}}}
    end.

%% @doc The stamps to be sent with a beat.
-spec stamps(t()) -> [{starl:robot_id(), stamp()}].
stamps(#lease{heard = Heard}) ->
    lists:sort([{Robot, Stamp} || {Robot, {Stamp, _}} <- maps:to_list(Heard)]).

%% @doc It leads from now on: what others gave leave for has an end.
-spec since(Now :: integer(), t()) -> t().
since(Now, Lease) -> Lease#lease{since = Now}.

%% @doc Does a quorum's vote last?
-spec leads(Now :: integer(), t()) -> boolean().
leads(Now, #lease{team = Team} = Lease) -> quorum(votes(Now, Lease), Team).

%% @doc Whose votes last.
-spec votes(Now :: integer(), t()) -> [starl:robot_id()].
votes(Now, #lease{votes = Votes}) ->
    lists:sort([Robot || {Robot, Until} <- maps:to_list(Votes), Until > Now]).

%% @doc Has all leave that the robot may have, of this coordinator or an earlier one, ended? Then
%% it stands.
-spec rests(starl:robot_id(), Now :: integer(), t()) -> boolean().
rests(_Robot, _Now, #lease{since = none}) ->
    false;
rests(Robot, Now, #lease{heard = Heard, since = Since, long_us = Long}) ->
    {_, At} = maps:get(Robot, Heard, {none, Since}),
    max(At, Since) + Long < Now.
