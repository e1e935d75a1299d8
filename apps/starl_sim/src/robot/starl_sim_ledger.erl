%% @doc Records checkpoints of one robot's digest chain, so that two runs can be compared part by
%% part. A checkpoint is kept at every 1,000th event. The ledger also records the events in a range,
%% if the caller asks for one.
%%
%% The robot calls its ledger only at the events that {@link note/3} asks for. All other events cost
%% one comparison of two numbers.
-module(starl_sim_ledger).

-export([new/1, note/3, checkpoints/1, events/1]).

-export_type([t/0, checkpoint/0, event/0, range/0]).

%% The chain after the N-th event, and the time of that event (us).
-type checkpoint() :: {N :: pos_integer(), AtUs :: non_neg_integer(), Chain :: non_neg_integer()}.

%% The events to record: from the first number to the second.
-type range() :: {From :: pos_integer(), To :: pos_integer()}.

%% One event of a robot: its number, its time (us), its content, and the chain after it.
-type event() :: #{
    n := pos_integer(),
    at_us := non_neg_integer(),
    machine := starl_machine:name(),
    type := starl_machine:event_type() | boot,
    content := term(),
    chain := non_neg_integer()
}.

-define(EVERY, 1000).
%% Above this number of checkpoints, every other one is dropped.
-define(MOST, 512).

-record(ledger, {
    every = ?EVERY :: pos_integer(),
    %% newest first, and their number
    checkpoints = [] :: [checkpoint()],
    count = 0 :: non_neg_integer(),
    range = none :: range() | none,
    events = [] :: [event()]
}).

-opaque t() :: #ledger{}.

%% @doc An empty ledger that records these events, and the number of the first event to note.
-spec new(range() | none) -> {Next :: pos_integer(), t()}.
new(Range) ->
    Ledger = #ledger{range = Range},
    {next(0, Ledger), Ledger}.

%% @doc Notes an event; returns the number of the next one to note.
-spec note(starl_sim_queue:time(), event(), t()) -> {Next :: pos_integer(), t()}.
note(AtUs, #{n := N, chain := Chain} = Event, Ledger) ->
    Noted = check({N, AtUs, Chain}, recorded(Event, Ledger)),
    {next(N, Noted), Noted}.

%% @doc The checkpoints, ascending. In a long run their distance is 1,000 times a power
%% of two, so two ledgers always have numbers in common.
-spec checkpoints(t()) -> [checkpoint()].
checkpoints(#ledger{checkpoints = Checkpoints}) -> lists:reverse(Checkpoints).

%% @doc The recorded events, ascending.
-spec events(t()) -> [event()].
events(#ledger{events = Events}) -> lists:reverse(Events).

recorded(#{n := N} = Event, #ledger{range = {From, To}, events = Events} = Ledger) when
    N >= From, N =< To
->
    Ledger#ledger{events = [Event | Events]};
recorded(_Event, Ledger) ->
    Ledger.

check({N, _, _} = New, #ledger{every = Every, checkpoints = Old, count = Count} = Ledger) when
    N rem Every =:= 0
->
    thin(Ledger#ledger{checkpoints = [New | Old], count = Count + 1});
check(_New, Ledger) ->
    Ledger.

thin(#ledger{count = Count, every = Every, checkpoints = Checkpoints} = Ledger) when
    Count > ?MOST
->
    Kept = [C || {N, _, _} = C <- Checkpoints, N rem (2 * Every) =:= 0],
    Ledger#ledger{every = 2 * Every, checkpoints = Kept, count = length(Kept)};
thin(Ledger) ->
    Ledger.

next(N, #ledger{every = Every, range = none}) -> due(N, Every);
next(N, #ledger{range = {From, _}, every = Every}) when N < From -> min(From, due(N, Every));
next(N, #ledger{range = {_, To}}) when N < To -> N + 1;
next(N, #ledger{every = Every}) -> due(N, Every).

due(N, Every) -> (N div Every + 1) * Every.
