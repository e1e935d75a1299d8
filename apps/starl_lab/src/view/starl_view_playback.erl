%% @doc The state of a recording during playback: the state of the team at the present time, and the
%% latest trace entries of each machine. A pure module. Its size does not grow with the recording.
%% Two playbacks at different times share equal data, so many can be kept.
-module(starl_view_playback).

-export([new/0, add/2, now_us/1, count/1, ending/1, rows/1, said/1, watch/2, look/3]).

-export_type([t/0]).

-define(MOST_EVENTS, 40).
-define(MOST_PACKETS, 12).

-record(past, {
    state = starl_view_state:new() :: starl_view_state:t(),
    now = 0 :: integer(),
    %% the rows so far
    count = 0 :: non_neg_integer(),
    ending = null :: atom(),
    %% the robots whose motion is recorded in closed form
    moving = #{} :: #{starl:robot_id() => []},
    modules = #{} :: #{starl_machine:name() => module()},
    told = #{} :: #{
        starl:robot_id() => #{starl_machine:name() => {At :: integer(), Event :: term()}}
    },
    %% the robot that is looked at; its last events and packets, newest first
    watched = none :: starl:robot_id() | none,
    events = [] :: [[starl_json:value()]],
    packets = [] :: [starl_view_row:row()]
}).

-opaque t() :: #past{}.

%% @doc Nothing has been read.
-spec new() -> t().
new() -> #past{}.

%% @doc A message more: the rows of it.
-spec add(starl_trace_message:t(), t()) -> {[starl_view_row:row()], t()}.
add({scenario, _, #{machines := Modules}}, Past) ->
    {[], Past#past{modules = Modules}};
add({poses, T, #{robots := Poses}}, #past{moving = Moving} = Past) ->
    %% of real robots only positions are known
    Jumps = [
        {trace, T, {Id, chassis, {motion, starl_trajectory:standing(T, {X, Y}, Heading)}}}
     || {Id, {X, Y, Heading}, _, _} <- Poses, not is_map_key(Id, Moving)
    ],
    added(T, [Row || Jump <- Jumps, Row <- starl_view_row:of_message(Jump)], Past);
add({trace, T, {Id, Machine, Event}} = Message, #past{told = Told} = Past) ->
    Own = maps:get(Id, Told, #{}),
    Next = Past#past{
        told = Told#{Id => Own#{Machine => {T, Event}}}, moving = moving(Id, Event, Past)
    },
    added(T, starl_view_row:of_message(Message), event(Id, [T, Machine, Event], Next));
add({verdicts, T, {ended, #{ending := Ending}}} = Message, Past) ->
    added(T, starl_view_row:of_message(Message), Past#past{ending = Ending});
add(Message, Past) ->
    added(element(2, Message), starl_view_row:of_message(Message), Past).

moving(Id, {motion, _}, #past{moving = Moving}) -> Moving#{Id => []};
moving(_Id, _Event, #past{moving = Moving}) -> Moving.

event(Id, Event, #past{watched = Id, events = Events} = Past) ->
    Past#past{events = lists:sublist([Event | Events], ?MOST_EVENTS)};
event(_Id, _Event, Past) ->
    Past.

added(T, Rows, #past{now = Now, count = Count} = Past) ->
    Next = Past#past{now = max(T, Now), count = Count + length(Rows)},
    {Rows, lists:foldl(fun kept/2, Next, Rows)}.

kept([<<"p">>, _, From, To | _] = Row, #past{watched = Id, packets = Packets} = Past) when
    From =:= Id; To =:= Id
->
    Past#past{packets = lists:sublist([Row | Packets], ?MOST_PACKETS)};
kept(Row, #past{state = State} = Past) ->
    Past#past{state = starl_view_state:add(Row, State)}.

%% @doc The time that has been reached.
-spec now_us(t()) -> integer().
now_us(#past{now = Now}) -> Now.

%% @doc The number of rows so far.
-spec count(t()) -> non_neg_integer().
count(#past{count = Count}) -> Count.

%% @doc How the run has ended, if it has.
-spec ending(t()) -> atom().
ending(#past{ending = Ending}) -> Ending.

%% @doc The rows that describe the state to a page that knows nothing.
-spec rows(t()) -> [starl_view_row:row()].
rows(#past{state = State, now = Now}) -> starl_view_state:rows(Now, State).

%% @doc The faults, crashes and broken contracts so far, as far as they are kept.
-spec said(t()) -> [starl_view_row:row()].
said(#past{state = State}) -> starl_view_state:said(State).

%% @doc From now on the events and packets of this robot are kept, too.
-spec watch(starl:robot_id(), t()) -> t().
watch(Id, Past) -> Past#past{watched = Id, events = [], packets = []}.

%% @doc A robot as texts for the page, from its trace. Recordings contain no states, timers or
%% inboxes, so the texts do not either.
-spec look(starl:robot_id(), integer(), t()) -> #{atom() => starl_json:value()}.
look(Id, At, #past{told = Told, modules = Modules, events = Events, packets = Packets}) ->
    Machines = lists:sort(maps:to_list(maps:get(Id, Told, #{}))),
    #{
        told => true,
        at => At,
        machines => [
            #{
                name => Name,
                module => maps:get(Name, Modules, null),
                state => starl_view_row:text(Event, 400),
                at => T
            }
         || {Name, {T, Event}} <- Machines
        ],
        packets => [tl(Row) || Row <- Packets],
        last => [[T, Name, starl_view_row:text(Event, 160)] || [T, Name, Event] <- Events]
    }.
