%% @doc The packets that a robot has heard lately, so that none is taken twice.
%%
%% A packet bears its time, and an old one is refused for its age ({@link starl_live_seal}): so only
%% a limited time has to be remembered, in two generations. A packet marks itself alone: none can
%% make others of its sender look old.
%%
%% A generation has room for a limited number. When more come, the older generation is forgotten
%% early, and the packets of its time are refused from then on.
-module(starl_live_replay).

-export([new/2, has/2, floor_ms/1, add/3]).

-export_type([t/0, id/0]).

%% A packet's number, drawn at random from 58 bits.
-type id() :: non_neg_integer().

%% The most packets of a generation.
-define(MOST, 100_000).

-record(replay, {
    keep_ms :: pos_integer(),
    %% the end of the younger generation
    until_ms :: integer(),
    %% what was sent before may have been heard and forgotten
    floor_ms = 0 :: integer(),
    young = #{} :: #{id() => []},
    old = #{} :: #{id() => []}
}).

-opaque t() :: #replay{}.

%% @doc Nothing heard. What is heard is remembered for `KeepMs' at least.
-spec new(KeepMs :: pos_integer(), NowMs :: integer()) -> t().
new(KeepMs, Now) -> #replay{keep_ms = KeepMs, until_ms = Now + KeepMs}.

%% @doc Has this packet been heard?
-spec has(id(), t()) -> boolean().
has(Id, #replay{young = Young, old = Old}) -> is_map_key(Id, Young) orelse is_map_key(Id, Old).

%% @doc The time before which packets must have been sent to be refused, whether known or not.
-spec floor_ms(t()) -> integer().
floor_ms(#replay{floor_ms = Floor}) -> Floor.

%% @doc Remembers a packet.
-spec add(id(), NowMs :: integer(), t()) -> t().
add(Id, Now, #replay{until_ms = Until, young = Young} = Replay) when
    Now < Until, map_size(Young) < ?MOST
->
    Replay#replay{young = Young#{Id => []}};
add(Id, Now, #replay{keep_ms = Keep, young = Young} = Replay) ->
    Replay#replay{
        until_ms = Now + Keep, floor_ms = floor_ms(Now, Replay), young = #{Id => []}, old = Young
    }.

%% The generation that is forgotten ended when the young one began.
floor_ms(Now, #replay{until_ms = Until, keep_ms = Keep, old = Old}) when
    Now < Until, map_size(Old) > 0
->
    Until - Keep;
floor_ms(_Now, #replay{floor_ms = Floor}) ->
    Floor.
