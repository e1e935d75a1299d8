%% @doc Orders the recorded messages of several robots, each by its own clock, so that no packet
%% arrives before it was sent. A pure module.
%%
%% Clocks alone cannot order messages that are closer than their difference. With one clock 15 ms
%% behind, answers come before their questions. Packets can: what a robot does after a packet has
%% come happens after what its sender did before. So each message gets its own time, or the earliest
%% time after all messages that it must follow:
%% ```
%%     robot 1   --- sends at 100.000 -------------          100.000
%%                                     \
%%     robot 2   ----- hears at 99.990, answers at 99.995    100.000001, 100.000001
%% '''
%% The times of a robot are never set back, and are moved by no more than the clocks differ. If the
%% same packet was sent several times, the first counts: it is surely earlier than each that came.
%%
%% A packet may lack its sending although it came when the sender's recording had ended. Then the
%% sender's computer lost its power: the last moment was not written. This makes a gap.
-module(starl_trace_order).

-export([new/0, take/3, close/1, clocks/1, moved/1]).

-export_type([t/0, source/0, clock/0]).

%% Whose clock it is.
-type source() :: world | [starl:robot_id(), ...].

%% The packets from a robot to another came before they were sent, by so much on average.
-type clock() :: {link(), Us :: pos_integer()}.

-type link() :: {From :: starl:robot_id(), To :: starl:robot_id()}.

-type key() :: {From :: starl:robot_id(), To :: starl:robot_id(), Hash :: integer()}.

-record(order, {
    %% the messages of each source that wait, by its own times
    queues = #{} :: #{source() => queue:queue(starl_trace_message:t())},
    %% the sources whose first message may be next, by the earliest time that it can have; and those whose
    %% first message is a packet that must be sent before
    ready = gb_sets:new() :: gb_sets:set({AtUs :: integer(), source()}),
    blocked = #{} :: #{source() => {key(), AtUs :: integer()}},
    %% the latest time that each source has got, and that any has
    shown = #{} :: #{source() => integer()},
    now = none :: integer() | none,
    %% the latest time that was read, by any clock
    read = none :: integer() | none,
    %% when packets were sent first, by the clocks of their senders, and in the common order; and those that
    %% came and were not seen to be sent
    sent = #{} :: #{key() => integer()},
    left = #{} :: #{key() => integer()},
    strange = #{} :: #{key() => integer()},
    recent = queue:new() :: queue:queue({integer(), key()}),
    early = #{} :: #{link() => {Late :: integer(), Early :: integer(), SumUs :: integer()}},
    moved = #{} :: #{starl:robot_id() => Us :: pos_integer()}
}).

-opaque t() :: #order{}.

%% Clocks that are farther apart than this cannot be helped. Messages wait until all are known of so much later.
-define(APART_US, 1000000).
-define(AHEAD_US, 2500000).
%% Nobody sends the same packet again after this time.
-define(REPEATED_US, 60000000).
%% A recording is flushed so often.
-define(FLUSHED_US, 1000000).

%% @doc Nothing has been recorded.
-spec new() -> t().
new() -> #order{}.

%% @doc Takes messages of one source, in the order of its times; about in the order of time of all
%% sources. Returns those whose place is known.
-spec take(source(), [starl_trace_message:t()], t()) -> {[starl_trace_message:t()], t()}.
take(_Source, [], Order) ->
    {[], Order};
take(Source, Messages, Order) ->
    #order{read = Read} = Next = lists:foldl(fun(M, O) -> read(Source, M, O) end, Order, Messages),
    placed(Read - ?AHEAD_US, [], forgotten(Next)).

%% @doc Returns all that is left.
-spec close(t()) -> {[starl_trace_message:t()], t()}.
close(Order) -> placed(infinity, [], Order).

%% @doc The links on which most packets came before they were sent, by the clocks of both ends.
-spec clocks(t()) -> [clock()].
clocks(#order{early = Early}) ->
    lists:sort([
        {Link, max(1, Sum div N)}
     || {Link, {Late, N, Sum}} <- maps:to_list(Early), N > Late
    ]).

%% @doc The robots whose times were moved, and by how much at most.
-spec moved(t()) -> [{starl:robot_id(), Us :: pos_integer()}].
moved(#order{moved = Moved}) -> lists:sort(maps:to_list(Moved)).

%% -- reading --------------------------------------------------------------------------------

read(Source, {_, At, _} = Message, #order{queues = Queues, read = Read} = Order) ->
    Before = maps:get(Source, Queues, queue:new()),
    Next = packet(Message, Order#order{
        queues = Queues#{Source => queue:in(Message, Before)}, read = later(Read, At)
    }),
    case queue:is_empty(Before) of
        true -> first(Source, Next);
        false -> Next
    end.

later(none, At) -> At;
later(Last, At) -> max(Last, At).

packet({ways, At, {From, {sent, To, _, _, Hash}}}, #order{sent = Sent, strange = Strange} = Order) ->
    Key = {From, To, Hash},
    case Sent of
        #{Key := _} ->
            Order;
        #{} ->
            recent(At, Key, Order#order{
                sent = Sent#{Key => At}, strange = maps:remove(Key, Strange)
            })
    end;
packet({ways, At, {To, {came, From, _, _, Hash, _}}}, #order{strange = Strange} = Order) ->
    Key = {From, To, Hash},
    case is_map_key(Key, Order#order.sent) orelse is_map_key(Key, Strange) of
        true -> Order;
        false -> recent(At, Key, Order#order{strange = Strange#{Key => At}})
    end;
packet(_Message, Order) ->
    Order.

recent(At, Key, #order{recent = Recent} = Order) ->
    Order#order{recent = queue:in({At, Key}, Recent)}.

forgotten(#order{recent = Recent, read = Read} = Order) ->
    case queue:peek(Recent) of
        {value, {At, Key}} when At < Read - ?REPEATED_US ->
            #order{sent = Sent, left = Left, strange = Strange} = Order,
            forgotten(Order#order{
                recent = queue:drop(Recent),
                sent = maps:remove(Key, Sent),
                left = maps:remove(Key, Left),
                strange = maps:remove(Key, Strange)
            });
        _ ->
            Order
    end.

%% -- placing --------------------------------------------------------------------------------

%% The first message of a source may be next, not before the one before it.
first(Source, #order{queues = Queues, ready = Ready, shown = Shown} = Order) ->
    case queue:peek(maps:get(Source, Queues)) of
        {value, {_, At, _}} ->
            Earliest = max(At, maps:get(Source, Shown, At)),
            Order#order{ready = gb_sets:add_element({Earliest, Source}, Ready)};
        empty ->
            Order
    end.

%% All messages up to that time, by their own clocks, and those before them.
placed(Until, Placed, #order{ready = Ready, queues = Queues} = Order) ->
    case gb_sets:is_empty(Ready) orelse gb_sets:take_smallest(Ready) of
        true ->
            unblocked(Until, Placed, Order);
        {{Earliest, Source}, Left} ->
            {value, {_, At, _} = Message} = queue:peek(maps:get(Source, Queues)),
            case At =< Until of
                %% an atom is larger than any number
                true -> next(Earliest, Source, Message, Until, Placed, Order#order{ready = Left});
                false -> unblocked(Until, Placed, Order)
            end
    end.

next(Earliest, Source, Message, Until, Placed, #order{ready = Ready, blocked = Blocked} = Order) ->
    case follows(Message, Order) of
        {sent_at, Sent} when Sent + 1 > Earliest ->
            placed(Until, Placed, Order#order{
                ready = gb_sets:add_element({Sent + 1, Source}, Ready)
            });
        {not_yet, Key} ->
            placed(Until, Placed, Order#order{blocked = Blocked#{Source => {Key, Earliest}}});
        _ ->
            {Put, Next} = put_next(Earliest, Source, Message, Order),
            placed(Until, Put ++ Placed, first(Source, Next))
    end.

%% A packet follows the first that was sent with its content, if clocks are anywhere near.
follows({ways, At, {To, {came, From, _, _, Hash, _}}}, #order{sent = Sent, left = Left}) ->
    Key = {From, To, Hash},
    case {Sent, Left} of
        {#{Key := Then}, _} when Then > At + ?APART_US -> nothing;
        {_, #{Key := Then}} when Then > At + ?APART_US -> nothing;
        {_, #{Key := Then}} -> {sent_at, Then};
        {#{Key := _}, _} -> {not_yet, Key};
        _ -> nothing
    end;
follows(_Message, _Order) ->
    nothing.

put_next(Earliest, Source, {Topic, Own, What} = Message, #order{queues = Queues} = Order) ->
    At = later(Order#order.now, Earliest),
    Left = queue:drop(maps:get(Source, Queues)),
    Next = counted(
        Message,
        has_left(Message, At, Order#order{
            queues = Queues#{Source := Left},
            shown = (Order#order.shown)#{Source => At},
            now = At,
            moved = moved(Source, At - Own, Order#order.moved)
        })
    ),
    {[{Topic, At, by(At - Own, What)} | gap(Message, At, Order)], Next}.

moved([Robot], Us, Moved) when Us > 0 ->
    maps:update_with(Robot, fun(Most) -> max(Most, Us) end, Us, Moved);
moved(_Source, _Us, Moved) ->
    Moved.

%% Times within a message move with it.
by(0, What) ->
    What;
by(Us, {Robot, {came, From, Brief, Bytes, Hash, {arrives, Copies}}}) ->
    Arrives = {arrives, [{At + Us, How} || {At, How} <- Copies]},
    {Robot, {came, From, Brief, Bytes, Hash, Arrives}};
by(Us, {Robot, robot, {late, From, To}}) ->
    {Robot, robot, {late, From + Us, To + Us}};
by(_Us, What) ->
    What.

%% A packet has left: who waits for that may be next.
has_left({ways, _, {From, {sent, To, _, _, Hash}}}, At, #order{left = Left} = Order) when
    not is_map_key({From, To, Hash}, Left)
->
    #order{blocked = Blocked, ready = Ready} = Order,
    Key = {From, To, Hash},
    Waiting = [
        {max(Earliest, At + 1), S}
     || {S, {K, Earliest}} <- maps:to_list(Blocked), K =:= Key
    ],
    Order#order{
        left = Left#{Key => At},
        blocked = maps:without([S || {_, S} <- Waiting], Blocked),
        ready = lists:foldl(fun gb_sets:add_element/2, Ready, Waiting)
    };
has_left(_Message, _At, Order) ->
    Order.

%% Who waits for something that waits for it waits no longer: one of the packets is not the one that was sent.
unblocked(Until, Placed, #order{blocked = Blocked, ready = Ready} = Order) ->
    Long = [
        {At, Source}
     || {Source, {_, At}} <- maps:to_list(Blocked),
        Until =:= infinity orelse At < Until - 3 * ?AHEAD_US
    ],
    case lists:sort(Long) of
        [] ->
            {lists:reverse(Placed), Order};
        [{At, Source} | _] ->
            {Key, At} = maps:get(Source, Blocked),
            placed(Until, Placed, Order#order{
                sent = maps:remove(Key, Order#order.sent),
                blocked = maps:remove(Source, Blocked),
                ready = gb_sets:add_element({At, Source}, Ready)
            })
    end.

%% -- what packets tell ----------------------------------------------------------------------

counted({ways, At, {To, {came, From, _, _, Hash, _}}}, #order{sent = Sent, early = Early} = Order) ->
    case Sent of
        #{{From, To, Hash} := Then} ->
            {Late, N, Sum} = maps:get({From, To}, Early, {0, 0, 0}),
            Counted =
                case At < Then of
                    true -> {Late, N + 1, Sum + Then - At};
                    false -> {Late + 1, N, Sum}
                end,
            Order#order{early = Early#{{From, To} => Counted}};
        #{} ->
            Order
    end;
counted(_Message, Order) ->
    Order.

%% A robot goes down that was heard later than it has told.
gap({trace, Own, {Robot, robot, down}}, At, #order{strange = Strange}) ->
    Heard = [
        x
     || {{From, _, _}, Then} <- maps:to_list(Strange),
        From =:= Robot,
        %% what was sent before that is known
        Then >= Own - ?APART_US - ?FLUSHED_US,
        Then =< Own + ?AHEAD_US - ?APART_US
    ],
    [{gap, At, {lost_power, Robot}} || Heard =/= []];
gap(_Message, _At, _Order) ->
    [].
