%% @doc The event queue of a shard, a calendar queue. Events lie unsorted in buckets of one window
%% each, and a bucket is sorted when its time comes. So adding an event costs O(1), and taking a
%% window costs one sort. The buckets of the next windows form a wheel; later buckets are in a map.
-module(starl_sim_queue).
-include_lib("starl_platform/include/starl_robot_order.hrl").

-export([new/1, add/2, add_all/2, take_window/2, next_time/1, size/1, of_robot/2]).
-export([delayed/2]).

-export_type([t/0, event/0, time/0, hold/0, window/0]).

%% The beginning and the end of a window.
-type window() :: {From :: time(), Until :: time()}.

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

%% What holds up a robot that is paused, or slow: no event is handled before `UntilUs', nor earlier than `LagUs'
%% after its arrival.
-type hold() :: {UntilUs :: time(), LagUs :: non_neg_integer()}.

%% The number of windows in the wheel: most timers, and the legs that robots drive, end within them.
%% The wheel has rows, since a tuple is copied whenever one of its elements is set.
-define(ROWS, 8).
-define(ROW, 16).
-define(WHEEL, (?ROWS * ?ROW)).

-record(queue, {
    width :: pos_integer(),
    %% the first window of the wheel; window I lies at place I rem WHEEL
    base = 0 :: non_neg_integer(),
    wheel = erlang:make_tuple(?ROWS, erlang:make_tuple(?ROW, [])) :: wheel(),
    far = #{} :: #{non_neg_integer() => [event()]},
    order = gb_sets:new() :: gb_sets:set(non_neg_integer()),
    %% the first of them; an atom is larger than any number
    nearest = none :: non_neg_integer() | none,
    size = 0 :: non_neg_integer()
}).

-opaque t() :: #queue{}.

-type wheel() :: tuple().

%% @doc An empty queue with buckets of `Width' microseconds.
-spec new(Width :: pos_integer()) -> t().
new(Width) -> #queue{width = Width}.

%% @doc The number of events in the queue.
-spec size(t()) -> non_neg_integer().
size(#queue{size = Size}) -> Size.

%% @doc Adds an event; if its window is over, it falls into the first window that is not.
-spec add(event(), t()) -> t().
add(Event, #queue{size = Size} = Queue) ->
    enter(index(Event, Queue), [Event], Queue#queue{size = Size + 1}).

%% @doc Adds many events, grouped by their few windows, since the wheel is copied
%% at each change.
-spec add_all([event()], t()) -> t().
add_all([], Queue) ->
    Queue;
add_all([Event], Queue) ->
    add(Event, Queue);
add_all(Events, #queue{size = Size} = Queue) ->
    Buckets = lists:foldl(fun(Event, Acc) -> group(Event, Queue, Acc) end, #{}, Events),
    maps:fold(fun enter/3, Queue#queue{size = Size + length(Events)}, Buckets).

%% @doc Takes the events of the first window, if it ends no later than the given time; ordered by
%% robot, then in the robot's order.
-spec take_window(Until :: time(), t()) -> {[event()], t()}.
take_window(Until, #queue{width = Width} = Queue) ->
    case first(Queue) of
        Index when is_integer(Index), (Index + 1) * Width =< Until ->
            #queue{wheel = Wheel, size = Size} = Turned = turn(Index, Queue),
            Events = bucket(Index, Wheel),
            Left = Turned#queue{
                wheel = set_bucket(Index, [], Wheel), size = Size - length(Events)
            },
            {in_order(Events), turn(Index + 1, Left)};
        _ ->
            {[], Queue}
    end.

%% @doc The beginning of the first window that has an event.
-spec next_time(t()) -> time() | infinity.
next_time(#queue{width = Width} = Queue) ->
    case first(Queue) of
        none -> infinity;
        Index -> Index * Width
    end.

%% @doc The events of a robot, in no order. It looks at all events, so this is for people only.
-spec of_robot(starl:robot_id(), t()) -> [event()].
of_robot(Robot, #queue{wheel = Wheel, far = Far}) ->
    Rows = [tuple_to_list(Row) || Row <- tuple_to_list(Wheel)],
    Buckets = lists:append(Rows) ++ maps:values(Far),
    [Event || Bucket <- Buckets, Event <- Bucket, element(1, Event) =:= Robot].

%% -- internals ------------------------------------------------------------------------------

bucket(Index, Wheel) -> element(Index rem ?ROW + 1, element(row(Index), Wheel)).

set_bucket(Index, Events, Wheel) ->
    Row = row(Index),
    setelement(Row, Wheel, setelement(Index rem ?ROW + 1, element(Row, Wheel), Events)).

add_bucket(Index, Events, Wheel) ->
    set_bucket(Index, Events ++ bucket(Index, Wheel), Wheel).

row(Index) -> Index div ?ROW rem ?ROWS + 1.

index(Event, #queue{width = Width, base = Base}) -> max(Base, element(2, Event) div Width).

group(Event, Queue, Buckets) ->
    Index = index(Event, Queue),
    case Buckets of
        #{Index := Events} -> Buckets#{Index := [Event | Events]};
        #{} -> Buckets#{Index => [Event]}
    end.

enter(Index, Events, #queue{base = Base, wheel = Wheel} = Queue) when Index < Base + ?WHEEL ->
    Queue#queue{wheel = add_bucket(Index, Events, Wheel)};
enter(Index, Events, #queue{far = Far, order = Order, nearest = Nearest} = Queue) ->
    case Far of
        #{Index := Others} ->
            Queue#queue{far = Far#{Index := Events ++ Others}};
        #{} ->
            Queue#queue{
                far = Far#{Index => Events},
                order = gb_sets:insert(Index, Order),
                nearest = min(Index, Nearest)
            }
    end.

%% Sorts by robot first, then by the rest of the key: comparing numbers is much faster than
%% comparing tuples.
in_order(Events) -> each_robot(lists:keysort(1, Events)).

each_robot([{Robot, _, _, _, _, _} = Event, {Robot, _, _, _, _, _} = Next | Events]) ->
    {Own, Rest} = split(Robot, Events, [Next, Event]),
    lists:sort(Own) ++ each_robot(Rest);
each_robot([Event | Events]) ->
    [Event | each_robot(Events)];
each_robot([]) ->
    [].

split(Robot, [{Robot, _, _, _, _, _} = Event | Events], Own) ->
    split(Robot, Events, [Event | Own]);
split(_Robot, Events, Own) ->
    {Own, Events}.

%% The first window that has an event.
-spec first(t()) -> non_neg_integer() | none.
first(#queue{size = 0}) -> none;
first(#queue{base = Base} = Queue) -> first(Base, Base + ?WHEEL, Queue).

first(End, End, #queue{nearest = Nearest}) ->
    true = is_integer(Nearest),
    Nearest;
first(Index, End, #queue{wheel = Wheel} = Queue) ->
    case bucket(Index, Wheel) of
        [] -> first(Index + 1, End, Queue);
        [_ | _] -> Index
    end.

%% Moves the wheel to a later window, and the events that come within its reach into it.
turn(Base, #queue{nearest = Nearest} = Queue) when Nearest >= Base + ?WHEEL ->
    Queue#queue{base = Base};
turn(Base, #queue{nearest = Index, order = Order, far = Far, wheel = Wheel} = Queue) ->
    {Events, Rest} = maps:take(Index, Far),
    {Index, Later} = gb_sets:take_smallest(Order),
    turn(Base, Queue#queue{
        wheel = add_bucket(Index, Events, Wheel),
        far = Rest,
        order = Later,
        nearest = smallest(Later)
    }).

smallest(Order) ->
    case gb_sets:is_empty(Order) of
        true -> none;
        false -> gb_sets:smallest(Order)
    end.

%% @doc Splits the events of a robot that is held up into delayed ones, at their new times, and those that are
%% not delayed. The faults themselves strike on time.
-spec delayed([event()], hold()) ->
    {Late :: [event()], Ready :: [event()]}.
delayed(Events, Hold) ->
    {Late, Ready} = lists:partition(fun(Event) -> held(Event, Hold) =/= Event end, Events),
    {[held(Event, Hold) || Event <- Late], Ready}.

held({_, _, ?CLASS_WORLD, _, _, _} = Event, _Hold) ->
    Event;
held({Id, Time, Class, Source, Seq, {late, _} = Content}, {Until, _Lag}) ->
    {Id, max(Time, Until), Class, Source, Seq, Content};
held({Id, Time, Class, Source, Seq, Content}, {Until, 0}) ->
    {Id, max(Time, Until), Class, Source, Seq, Content};
held({Id, Time, Class, Source, Seq, Content}, {Until, Lag}) ->
    {Id, max(Time + Lag, Until), Class, Source, Seq, {late, Content}}.
