%% @doc The event queue of a shard: events in the order of their keys, by virtual time.
%%
%% A calendar: events far ahead lie unsorted in buckets of one window each, a bucket is sorted
%% when its time comes, and what is added to the present bucket goes through a pairing heap. So
%% adding costs O(1), and taking little more than the sort.
-module(starl_sim_queue).

-export([new/1, add/2, take/2, next_time/1, size/1]).

-export_type([t/0, event/0, time/0]).

%% Virtual time in microseconds.
-type time() :: non_neg_integer().

%% Events are ordered by (time, robot, class, source robot, source sequence number).
-type event() :: {
    time(),
    starl:robot_id(),
    Class :: non_neg_integer(),
    Source :: starl:robot_id(),
    Seq :: non_neg_integer(),
    Content :: term()
}.

-type heap() :: nil | {event(), [heap()]}.

-record(queue, {
    width :: pos_integer(),
    present = -1 :: integer(),
    sorted = [] :: [event()],
    heap = nil :: heap(),
    buckets = #{} :: #{integer() => [event()]},
    order = gb_sets:new() :: gb_sets:set(integer()),
    size = 0 :: non_neg_integer()
}).

-opaque t() :: #queue{}.

%% @doc An empty queue with buckets of so many microseconds.
-spec new(Width :: pos_integer()) -> t().
new(Width) -> #queue{width = Width}.

%% @doc The number of events in it.
-spec size(t()) -> non_neg_integer().
size(#queue{size = Size}) -> Size.

%% @doc Adds an event.
-spec add(event(), t()) -> t().
add(Event, #queue{width = Width, present = Present, buckets = Buckets, size = Size} = Queue) ->
    case element(1, Event) div Width of
        Index when Index =< Present ->
            Queue#queue{heap = meld({Event, []}, Queue#queue.heap), size = Size + 1};
        Index ->
            case Buckets of
                #{Index := Events} ->
                    Queue#queue{buckets = Buckets#{Index := [Event | Events]}, size = Size + 1};
                #{} ->
                    Queue#queue{
                        buckets = Buckets#{Index => [Event]},
                        order = gb_sets:add_element(Index, Queue#queue.order),
                        size = Size + 1
                    }
            end
    end.

%% @doc Takes the first event before a time.
-spec take(Before :: time(), t()) -> {event(), t()} | none.
take(Before, #queue{sorted = [], heap = nil} = Queue) ->
    case open(Before, Queue) of
        none -> none;
        Opened -> take(Before, Opened)
    end;
take(Before, #queue{sorted = [First | Rest], heap = nil, size = Size} = Queue) ->
    case element(1, First) < Before of
        true -> {First, Queue#queue{sorted = Rest, size = Size - 1}};
        false -> none
    end;
take(Before, #queue{sorted = [First | _], heap = {Top, _}} = Queue) when First < Top ->
    case element(1, First) < Before of
        true -> {First, Queue#queue{sorted = tl(Queue#queue.sorted), size = Queue#queue.size - 1}};
        false -> none
    end;
take(Before, #queue{heap = {Top, Heaps}, size = Size} = Queue) ->
    case element(1, Top) < Before of
        true -> {Top, Queue#queue{heap = meld_pairs(Heaps), size = Size - 1}};
        false -> none
    end.

%% @doc The time of the first event; where that would need a sort, a time not later than it but
%% in the same bucket.
-spec next_time(t()) -> time() | infinity.
next_time(#queue{sorted = [], heap = nil, order = Order, width = Width}) ->
    case gb_sets:is_empty(Order) of
        true -> infinity;
        false -> gb_sets:smallest(Order) * Width
    end;
next_time(#queue{sorted = [], heap = {Top, _}}) -> element(1, Top);
next_time(#queue{sorted = [First | _], heap = nil}) -> element(1, First);
next_time(#queue{sorted = [First | _], heap = {Top, _}}) -> element(1, min(First, Top)).

open(Before, #queue{order = Order, width = Width, buckets = Buckets} = Queue) ->
    case gb_sets:is_empty(Order) of
        true ->
            none;
        false ->
            case gb_sets:take_smallest(Order) of
                {Index, Rest} when Index * Width < Before ->
                    {Events, Others} = maps:take(Index, Buckets),
                    Queue#queue{
                        present = Index,
                        sorted = lists:sort(Events),
                        buckets = Others,
                        order = Rest
                    };
                _ ->
                    none
            end
    end.

meld(Heap, nil) -> Heap;
meld(nil, Heap) -> Heap;
meld({A, As} = HeapA, {B, Bs} = HeapB) ->
    case A < B of
        true -> {A, [HeapB | As]};
        false -> {B, [HeapA | Bs]}
    end.

meld_pairs([]) -> nil;
meld_pairs([Heap]) -> Heap;
meld_pairs([A, B | Rest]) -> meld(meld(A, B), meld_pairs(Rest)).
