%% @doc Bounds the rate at which a robot sends bytes: a token bucket with a bounded queue. A burst
%% goes out at once; anything beyond it waits.
-module(starl_live_pace).

-export([new/3, put/3, take/2]).

-export_type([t/1]).

%% The most bytes that wait.
-define(WAITING, 1_000_000).

-record(pace, {
    %% bytes per millisecond
    rate :: pos_integer(),
    burst :: pos_integer(),
    %% what may go out at once, in bytes; less than 0 after a large item
    tokens :: float(),
    at_us :: integer(),
    queue = queue:new() :: queue:queue({Item :: term(), Bytes :: pos_integer()}),
    waiting = 0 :: non_neg_integer()
}).

-opaque t(_Item) :: #pace{}.

%% @doc Nothing waits. `Rate' is in bytes per millisecond, `Burst' in bytes.
-spec new(Rate :: pos_integer(), Burst :: pos_integer(), NowUs :: integer()) -> t(_Item).
new(Rate, Burst, Now) ->
    #pace{rate = Rate, burst = Burst, tokens = float(Burst), at_us = Now}.

%% @doc Lets an item wait for its turn.
-spec put(Item, Bytes :: pos_integer(), t(Item)) -> {ok, t(Item)} | full.
put(_Item, Bytes, #pace{waiting = Waiting}) when Waiting + Bytes > ?WAITING ->
    full;
put(Item, Bytes, #pace{queue = Queue, waiting = Waiting} = Pace) ->
    {ok, Pace#pace{queue = queue:in({Item, Bytes}, Queue), waiting = Waiting + Bytes}}.

%% @doc The items whose turn has come, in their order, and the time to wait for the next one.
-spec take(NowUs :: integer(), t(Item)) ->
    {[Item], WaitMs :: pos_integer() | infinity, t(Item)}.
take(Now, #pace{rate = Rate, burst = Burst, tokens = Tokens, at_us = At} = Pace) ->
    Gained = max(0, Now - At) * Rate / 1000,
    taken([], Pace#pace{tokens = min(float(Burst), Tokens + Gained), at_us = max(At, Now)}).

taken(Items, #pace{waiting = 0} = Pace) ->
    {lists:reverse(Items), infinity, Pace};
taken(Items, #pace{tokens = Tokens, rate = Rate} = Pace) when Tokens < 0 ->
    {lists:reverse(Items), ceil(-Tokens / Rate), Pace};
taken(Items, #pace{tokens = Tokens, queue = Queue, waiting = Waiting} = Pace) ->
    {{value, {Item, Bytes}}, Rest} = queue:out(Queue),
    taken([Item | Items], Pace#pace{
        tokens = Tokens - Bytes, queue = Rest, waiting = Waiting - Bytes
    }).
