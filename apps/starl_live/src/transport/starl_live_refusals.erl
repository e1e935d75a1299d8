%% @doc Counts the refused datagrams of a robot, or of an unknown sender, by reason, with the time
%% of the last. A pure module, a part of {@link starl_live_peers}.
-module(starl_live_refusals).

-export([new/0, add/3, state/2, latest/2]).

-export_type([t/0, reason/0, state/0]).

%% Why a datagram was refused: {@link starl_live_seal:refusal()}, or those of its contents.
-type reason() :: starl_live_seal:refusal() | former | clone | unproved | atom().

%% By reason: the number of refusals, how long ago the last one was, and by how much the sender's clock was
%% ahead then.
-type state() :: #{
    atom() => #{count := pos_integer(), ago_ms := integer(), ahead_ms => integer()}
}.

%% What was refused within this time may be why a robot is silent.
-define(RECENT_MS, 10_000).
%% A reason that has not come up for this time is new.
-define(AGAIN_MS, 600_000).
%% The largest difference of clocks that is reported: centuries.
-define(MOST_AHEAD_MS, 10_000_000_000_000).
%% Reasons that are usual, or somebody else's business: they are counted only.
-define(USUAL, [address, replay, former, clone, unproved]).

-record(refusals, {
    count = 0 :: non_neg_integer(),
    last_ms :: integer(),
    ahead_ms = none :: integer() | none
}).

-opaque t() :: #{atom() => #refusals{}}.

%% @doc None yet.
-spec new() -> t().
new() -> #{}.

%% @doc One more. Is it news, a reason that is new and not usual?
-spec add(reason(), NowMs :: integer(), t()) -> {IsNews :: boolean(), t()}.
add(Reason, Now, Refused) ->
    Name = name(Reason),
    Before = maps:get(Name, Refused, #refusals{last_ms = Now - ?AGAIN_MS}),
    #refusals{count = Count, last_ms = Last} = Before,
    After = Before#refusals{count = Count + 1, last_ms = Now, ahead_ms = ahead(Reason)},
    {Now - Last >= ?AGAIN_MS andalso not is_usual(Name), Refused#{Name => After}}.

name({clock, _Ahead}) -> clock;
name(Reason) -> Reason.

%% An absurd time takes no more room than another.
ahead({clock, Ahead}) -> max(-?MOST_AHEAD_MS, min(?MOST_AHEAD_MS, Ahead));
ahead(_Reason) -> none.

is_usual(Name) -> lists:member(Name, ?USUAL).

%% @doc All of them.
-spec state(NowMs :: integer(), t()) -> state().
state(Now, Refused) -> maps:map(fun(_, Each) -> shown(Now, Each) end, Refused).

shown(Now, #refusals{count = Count, last_ms = Last, ahead_ms = Ahead}) ->
    Shown = #{count => Count, ago_ms => Now - Last},
    case Ahead of
        none -> Shown;
        _ -> Shown#{ahead_ms => Ahead}
    end.

%% @doc The latest reason within the last seconds that is not usual.
-spec latest(NowMs :: integer(), t()) -> reason() | none.
latest(Now, Refused) ->
    Recent = [
        {Last, reason(Name, Ahead)}
     || {Name, #refusals{last_ms = Last, ahead_ms = Ahead}} <- maps:to_list(Refused),
        Now - Last < ?RECENT_MS,
        not is_usual(Name)
    ],
    case lists:reverse(lists:sort(Recent)) of
        [{_, Reason} | _] -> Reason;
        [] -> none
    end.

reason(clock, Ahead) -> {clock, Ahead};
reason(Name, _Ahead) -> Name.
