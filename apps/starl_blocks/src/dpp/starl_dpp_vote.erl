%% @doc A participant's vote: whom it has promised to vote for nobody else, and until when; and who
%% leads. Pure.
%%
%% A machine that has crashed has forgotten its promise, so it votes for nobody until that must have
%% ended; what it has stored tells whether it may have voted at all. A promise is to a robot: of the
%% terms that one robot claims only the latest can still be led, for there is one coordinator
%% machine on it.
%%
%% While one leads that is heard, nobody else can win, whoever has the vote. A robot that hears
%% less than others, and claims term after term for it, must not be let disturb the one that leads
%% (Ongaro and Ousterhout, 2014, section 6).
-module(starl_dpp_vote).

-export([new/1, leads/3, may_claim/3, give/3, missing_us/3]).
-export_type([t/0]).

%% The next robot in the row claims so much later.
-define(STAGGER_US, 1500000).
-define(MARGIN_US, 1000000).

-record(vote, {
    long_us :: pos_integer(),
    for = none :: starl:robot_id() | none,
    until :: integer(),
    leader = none :: {starl:robot_id(), UntilUs :: integer()} | none
}).
-opaque t() :: #vote{}.

%% @doc One that has never followed a term has not voted and may do so at once.
-spec new(#{stored := starl_machine:stored(), now := integer(), atom() => term()}) -> t().
new(#{stored := Stored, now := Now} = Config) ->
    Long = starl_dpp_lease:long_us(Config),
    case Stored of
        none -> #vote{long_us = Long, until = Now};
        _ -> #vote{long_us = Long, until = Now + Long}
    end.

%% @doc A robot that leads was heard.
-spec leads(starl:robot_id(), Now :: integer(), t()) -> t().
leads(Robot, Now, #vote{long_us = Long} = Vote) -> Vote#vote{leader = {Robot, Now + Long}}.

%% @doc May the robot claim a term: could it have the vote, and has no other led for a lease?
-spec may_claim(starl:robot_id(), Now :: integer(), t()) -> boolean().
may_claim(Robot, Now, #vote{leader = {Leader, Until}}) when Leader =/= Robot, Now < Until -> false;
may_claim(Robot, Now, Vote) -> may(Robot, Now, Vote).

may(Robot, Now, #vote{for = For, until = Until}) -> For =:= Robot orelse Now >= Until.

%% @doc Votes for this robot, if it may.
-spec give(starl:robot_id(), Now :: integer(), t()) -> {boolean(), t()}.
give(Robot, Now, #vote{long_us = Long} = Vote) ->
    case may(Robot, Now, Vote) of
        true -> {true, Vote#vote{for = Robot, until = Now + Long}};
        false -> {false, Vote}
    end.

%% @doc How long after the last word of the coordinator this robot claims: when all promises have
%% ended, the coordinator's own robot first, then one after the other.
-spec missing_us(Coordinator :: starl:robot_id(), starl:robot_id(), {[starl:robot_id()], t()}) ->
    pos_integer().
missing_us(Coordinator, Self, {Team, #vote{long_us = Long}}) ->
    {Before, From} = lists:splitwith(fun(Robot) -> Robot < Coordinator end, Team),
    Earlier = lists:takewhile(fun(Robot) -> Robot =/= Self end, From ++ Before),
    Long + ?MARGIN_US + ?STAGGER_US * length(Earlier).
