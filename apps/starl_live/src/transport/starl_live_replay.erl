%% @doc Remembers the packets that a robot has heard lately, so that it takes none twice.
%%
%% A packet carries its time, and an old packet is refused for its age ({@link starl_live_seal}). So
%% only a limited time has to be remembered, in two generations. A packet marks itself alone: none
%% can make others of its sender look old.
%%
%% A generation has room for a limited number. When more come, the older generation is forgotten
%% early, and the packets of its time are refused until they are too old anyway.
%%
%% Generations end by monotonic time, whatever the computer's clock is set to meanwhile.
-module(starl_live_replay).

-export([new/2, has/2, may_have/3, add/4]).

-export_type([t/0, id/0]).

%% A packet's number, drawn at random from 58 bits.
-type id() :: non_neg_integer().

%% The most packets of a generation.
-define(MOST, 100_000).

-record(replay, {
    keep_ms :: pos_integer(),
    %% the end of the younger generation
    until_ms :: integer(),
    %% what was sent by then may have been heard and forgotten; how long that matters
    floor = none :: none | {LatestMs :: integer(), UntilMs :: integer()},
    young = #{} :: #{id() => []},
    old = #{} :: #{id() => []},
    %% the latest time of sending in each generation
    young_ms = 0 :: integer(),
    old_ms = 0 :: integer()
}).

-opaque t() :: #replay{}.

%% @doc Nothing heard. What is heard is remembered for `KeepMs' at least.
-spec new(KeepMs :: pos_integer(), NowMs :: integer()) -> t().
new(KeepMs, Now) -> #replay{keep_ms = KeepMs, until_ms = Now + KeepMs}.

%% @doc Has this packet been heard?
-spec has(id(), t()) -> boolean().
has(Id, #replay{young = Young, old = Old}) -> is_map_key(Id, Young) orelse is_map_key(Id, Old).

%% @doc May a packet that was sent at this time of its sender have been heard and forgotten?
-spec may_have(SentMs :: integer(), NowMs :: integer(), t()) -> boolean().
may_have(Sent, Now, #replay{floor = {Latest, Until}}) -> Now < Until andalso Sent =< Latest;
may_have(_Sent, _Now, #replay{floor = none}) -> false.

%% @doc Remembers a packet that was sent at this time of its sender.
-spec add(id(), SentMs :: integer(), NowMs :: integer(), t()) -> t().
add(Id, Sent, Now, #replay{until_ms = Until, young = Young, young_ms = Latest} = Replay) when
    Now < Until, map_size(Young) < ?MOST
->
    Replay#replay{young = Young#{Id => []}, young_ms = max(Latest, Sent)};
add(Id, Sent, Now, #replay{keep_ms = Keep, young = Young, young_ms = Latest} = Replay) ->
    Replay#replay{
        until_ms = Now + Keep,
        floor = floored(Now, Replay),
        young = #{Id => []},
        young_ms = Sent,
        old = Young,
        old_ms = Latest
    }.

%% The generation that is forgotten early is too old after the time for which all are kept; so are those that were
%% forgotten before it. When a generation has had its time, all of these are too old.
floored(Now, #replay{until_ms = Until, keep_ms = Keep, old = Old, old_ms = Latest, floor = Floor}) when
    Now < Until, map_size(Old) > 0
->
    {lists:max([Latest | [Before || {Before, _} <- [Floor]]]), Now + Keep};
floored(_Now, _Replay) ->
    none.
