%% @doc The event queue of a shard, a calendar: events lie unsorted in buckets of one window
%% each, and a bucket is sorted when its time comes. So adding costs O(1), and taking no more
%% than the sort.
-module(starl_sim_queue).

-export([new/1, add/2, take_window/2, next_time/1, size/1]).

-export_type([t/0, event/0, time/0]).

%% Virtual time in microseconds.
-type time() :: non_neg_integer().

%% The events of a robot are ordered by (time, class, source robot, source sequence number).
-type event() :: {
    starl:robot_id(),
    time(),
    Class :: non_neg_integer(),
    Source :: non_neg_integer(),
    Seq :: non_neg_integer(),
    Content :: term()
}.

-record(queue, {
    width :: pos_integer(),
    buckets = #{} :: #{integer() => [event()]},
    order = gb_sets:new() :: gb_sets:set(non_neg_integer()),
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
add(Event, #queue{width = Width, buckets = Buckets, order = Order, size = Size} = Queue) ->
    Index = element(2, Event) div Width,
    case Buckets of
        #{Index := Events} ->
            Queue#queue{buckets = Buckets#{Index := [Event | Events]}, size = Size + 1};
        #{} ->
            Queue#queue{
                buckets = Buckets#{Index => [Event]},
                order = gb_sets:add_element(Index, Order),
                size = Size + 1
            }
    end.

%% @doc Takes the events of the first window, by robot and then in the robot's order, if it ends
%% not later than this.
-spec take_window(Until :: time(), t()) -> {[event()], t()}.
take_window(Until, #queue{order = Order, width = Width, buckets = Buckets} = Queue) ->
    case gb_sets:is_empty(Order) orelse (gb_sets:smallest(Order) + 1) * Width > Until of
        true ->
            {[], Queue};
        false ->
            {Index, Rest} = gb_sets:take_smallest(Order),
            {Events, Others} = maps:take(Index, Buckets),
            Left = Queue#queue.size - length(Events),
            {lists:sort(Events), Queue#queue{buckets = Others, order = Rest, size = Left}}
    end.

%% @doc When the first window that has an event begins.
-spec next_time(t()) -> time() | infinity.
next_time(#queue{order = Order, width = Width}) ->
    case gb_sets:is_empty(Order) of
        true -> infinity;
        false -> times(gb_sets:smallest(Order), Width)
    end.

times(Index, Width) when is_integer(Index) -> Index * Width.
