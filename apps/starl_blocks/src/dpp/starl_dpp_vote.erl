%% @doc A participant's vote: the robot that has it, and until when. It also holds the robot that
%% leads. Pure.
%%
%% A vote is a promise to vote for no other robot. A machine that has crashed has forgotten its
%% promise, so it votes for nobody until the promise must have ended. In the robot's first life its
%% store shows whether it may have voted at all; in a later life the store may be too old to show
%% it. The promise is to a robot, not to a term: a robot has one coordinator machine, which can lead
%% only in the latest of the terms that it has claimed.
%%
%% A participant that hears a leading coordinator lets no other robot claim, even one that has its
%% vote. A robot that hears less than others, and therefore claims term after term, must not disturb
%% the coordinator that leads (Ongaro and Ousterhout, 2014, section 6).
-module(starl_dpp_vote).

-export([new/1, leads/3, may_claim/3, give/3, missing_us/3, last_claim_us/2]).
-export_type([t/0]).

%% The time between the claims of two robots that follow each other in the row.
-define(STAGGER_US, 1500000).
-define(MARGIN_US, 1000000).

-record(vote, {
    long_us :: pos_integer(),
    for = none :: starl:robot_id() | none,
    until :: integer(),
    leader = none :: {starl:robot_id(), UntilUs :: integer()} | none
}).
-opaque t() :: #vote{}.

%% @doc A participant that has surely never followed a term has not voted, and may vote at once.
-spec new(#{stored := starl_machine:stored(), now := integer(), atom() => term()}) -> t().
new(#{stored := Stored, now := Now} = Config) ->
    Long = starl_dpp_lease:long_us(Config),
    case {Stored, maps:get(life, Config, {0, 1})} of
        {none, {0, 1}} -> #vote{long_us = Long, until = Now};
        _ -> #vote{long_us = Long, until = Now + Long}
    end.

%% @doc Enters that a robot that leads was heard.
-spec leads(starl:robot_id(), Now :: integer(), t()) -> t().
leads(Robot, Now, #vote{long_us = Long} = Vote) -> Vote#vote{leader = {Robot, Now + Long}}.

%% @doc May the robot claim a term: could it have the vote, and was no other leader heard for a
%% lease?
-spec may_claim(starl:robot_id(), Now :: integer(), t()) -> boolean().
may_claim(Robot, Now, #vote{leader = {Leader, Until}}) when Leader =/= Robot, Now < Until -> false;
may_claim(Robot, Now, Vote) -> may(Robot, Now, Vote).

may(Robot, Now, #vote{for = For, until = Until}) -> For =:= Robot orelse Now >= Until.

%% @doc Votes for this robot, if the participant may.
-spec give(starl:robot_id(), Now :: integer(), t()) -> {boolean(), t()}.
give(Robot, Now, #vote{long_us = Long} = Vote) ->
    case may(Robot, Now, Vote) of
        true -> {true, Vote#vote{for = Robot, until = Now + Long}};
        false -> {false, Vote}
    end.

%% @doc The time from the coordinator's last message to this robot's claim (us): when all promises
%% have ended, the coordinator's own robot claims first, then the others one after the other.
-spec missing_us(Coordinator :: starl:robot_id(), starl:robot_id(), {[starl:robot_id()], t()}) ->
    pos_integer().
missing_us(Coordinator, Self, {Team, #vote{long_us = Long}}) ->
    {Before, From} = lists:splitwith(fun(Robot) -> Robot < Coordinator end, Team),
    Earlier = lists:takewhile(fun(Robot) -> Robot =/= Self end, From ++ Before),
    claim_us(length(Earlier), Long).

%% @doc The time after which the last robot of a team of this size claims.
-spec last_claim_us(Robots :: pos_integer(), LeaseUs :: pos_integer()) -> pos_integer().
last_claim_us(Robots, Long) -> claim_us(Robots - 1, Long).

claim_us(Earlier, Long) ->
    case Long + ?MARGIN_US + ?STAGGER_US * Earlier of
        Us when is_integer(Us) -> Us
    end.
