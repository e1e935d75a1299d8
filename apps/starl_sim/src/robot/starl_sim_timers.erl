%% @doc The timers of a robot that lie in the event queue. Most timers are time-outs: they are
%% restarted long before they are due, and very few ever expire. So a timer that is due no earlier
%% than another event of its name is not put into the queue. It waits, and takes the place of that
%% event when that event comes.
%% ```
%%   start, due at 5    the queue has 5
%%   start, due at 8    the queue has 5; 8 waits
%%   5 comes            is 8 still to come? the queue has 8
%% '''
%% The result is the same as if each start had put its event into the queue, except for the events
%% of timers that no longer run: each event keeps its time and its sequence number.
-module(starl_sim_timers).

-export([new/0, start/2, come/4, waiting/1, due/2]).

-export_type([t/0, timer/0]).

%% A timer that runs, and when it is due.
-type timer() ::
    {starl_machine:name(), starl_robot_timers:timer(), Due :: starl_sim_queue:time() | unknown}.

%% The event of a timer of this name that lies in the queue, by its sequence number; and the event that
%% waits behind it.
-opaque t() :: #{
    starl_machine:name() => #{
        starl_robot_timers:timer() => {Seq :: non_neg_integer(), Due :: integer(), waiting()}
    }
}.

-type waiting() :: starl_sim_queue:event() | none.

%% @doc No timer lies in the queue.
-spec new() -> t().
new() -> #{}.

%% @doc A timer starts whose event comes in a later window than this one: does the event have to be
%% put into the queue?
-spec start(starl_sim_queue:event(), t()) -> {put | waits, t()}.
start({_, Due, _, _, Seq, {timer, Machine, Timer, _}} = Event, Timers) ->
    case Timers of
        #{Machine := #{Timer := {First, FirstDue, _}} = Own} when FirstDue =< Due ->
            {waits, Timers#{Machine := Own#{Timer := {First, FirstDue, Event}}}};
        #{Machine := Own} ->
            {put, Timers#{Machine := Own#{Timer => {Seq, Due, none}}}};
        #{} ->
            {put, Timers#{Machine => #{Timer => {Seq, Due, none}}}}
    end.

%% @doc These events of the robot come in a window that ends then. Returns, in order, those that do come; and those
%% that take the place of one and have to be put into the queue.
-spec come([starl_sim_queue:event()], Until, Running, t()) ->
    {[starl_sim_queue:event()], Later :: [starl_sim_queue:event()], t()}
when
    Until :: starl_sim_queue:time(), Running :: starl_robot_timers:t().
come(Events, Until, Running, Timers) -> come(Events, Until, Running, [], [], Timers).

come([], _Until, _Running, Come, Later, Timers) ->
    {lists:reverse(Come), Later, Timers};
come(
    [{_, _, _, _, Seq, {timer, Machine, Timer, _}} = Event | Events], Until, Running, Come, Later, T
) ->
    {Next, Left} = take(Seq, Machine, Timer, Event, T),
    case runs(Next, Machine, Timer, Running) of
        false ->
            come(Events, Until, Running, Come, Later, Left);
        true when element(2, Next) >= Until ->
            {put, Put} = start(Next, Left),
            come(Events, Until, Running, Come, [Next | Later], Put);
        true when Next =:= Event ->
            come(Events, Until, Running, [Event | Come], Later, Left);
        true ->
            come(lists:merge([Next], Events), Until, Running, Come, Later, Left)
    end;
come([Event | Events], Until, Running, Come, Later, Timers) ->
    come(Events, Until, Running, [Event | Come], Later, Timers).

%% The event that is meant by one that has come: the one that waited behind it, if one did.
take(Seq, Machine, Timer, Event, Timers) ->
    case Timers of
        #{Machine := #{Timer := {Seq, _, none}} = Own} ->
            {Event, Timers#{Machine := maps:remove(Timer, Own)}};
        #{Machine := #{Timer := {Seq, _, Next}} = Own} ->
            {Next, Timers#{Machine := maps:remove(Timer, Own)}};
        #{} ->
            {Event, Timers}
    end.

runs({_, _, _, _, Seq, _}, Machine, Timer, Running) ->
    starl_robot_timers:runs(Machine, Timer, Seq, Running).

%% @doc The events that wait, in no order.
-spec waiting(t()) -> [starl_sim_queue:event()].
waiting(Timers) ->
    [
        Event
     || Own <- maps:values(Timers),
        {_, _, Event} <- maps:values(Own),
        Event =/= none
    ].

%% @doc The timers that run, by machine and name, with the times at which they are due by these planned events.
-spec due([starl_sim_queue:event()], Running :: starl_robot_timers:t()) -> [timer()].
due(Planned, Running) ->
    Due = maps:from_list([{Seq, At} || {_, At, _, _, Seq, Content} <- Planned, is_timer(Content)]),
    [
        {Name, Timer, maps:get(Mark, Due, unknown)}
     || {Name, Timer, Mark} <- starl_robot_timers:to_list(Running)
    ].

is_timer({timer, _, _, _}) -> true;
is_timer({late, Content}) -> is_timer(Content);
is_timer(_) -> false.
