%% @doc Operations on the numbered parts of a team's state ({@link starl_check_store}). They return
%% the content of a part, its successor after an event, and its number when robots change places.
%% Every result is computed once per part and remembered.
-module(starl_check_part).

-export([boot/3, event/5, cuts/4, has_aged/2, must_go_on/3, judge_number/2, judge/4, traces/2]).
-export([calls/2, timers/3, is_done/2, condition/2]).
-export([item/2, item_number/2, source/1, receiver/1, age/1, grown_old/3, queue/2, moved_up/2]).
-export([later_robot/4, later_item/4]).
-export([renamed_robot/3, renamed_item/3, renamed_monitor/4]).
-export([own_robot/3, own_event/3, own_happening/3]).

-export_type([ref/0, item/0, age/0, event/0, happening/0]).

-type place() :: starl_check_term:place().
-type store() :: starl_check_store:t().
-type model() :: starl_check_model:t().

%% The number of a part.
-type ref() :: non_neg_integer().

%% Eight robots at most: three bits for the source, three for the receiver, two for the age.
-define(ITEM_BITS, 8).

%% `late': it is counted as slow; `ghost': it is counted as lost, but may still arrive.
-type age() :: fresh | late | ghost.

%% The place of a fresh message in the queue of a robot that stood still while time passed: 0 for what
%% was sent last, a larger number for what was sent before it, with time between.
-type queue() :: non_neg_integer().

-type item() ::
    {message, From :: place(), To :: place(), Type :: atom(), Body :: term(),
        starl_check_sap:ref() | none, age() | {queued, queue()}}
    | {packet, From :: place(), To :: place(), starl_packet:t()}.

%% An event of a robot: the arrival of a message under way, or another event.
-type event() :: ref() | {still, starl_check_robot:cut(), ref()} | starl_check_robot:event().

%% The robot after an event, the messages that it sent in ascending order, all events that it
%% traced, and those of them that the monitor judges.
-type happening() ::
    {Robot :: ref(), Sent :: [ref()], Traces :: ref() | none, Judged :: ref() | none}
    | {broken, starl_monitor:violation()}
    | beyond.

%% @doc The robot at a place after the start of all its machines.
-spec boot(place(), model(), store()) -> happening().
boot(Place, Model, Store) ->
    happening(Place, fun() -> starl_check_robot:boot(Place, Model) end, Model, Store).

%% @doc The robot after an event.
-spec event(place(), Robot :: ref(), event(), model(), store()) -> happening().
event(Place, Number, Event, Model, Store) ->
    starl_check_store:memo(
        {Number, Event},
        fun() -> happen(Place, Number, Event, Model, Store) end,
        Store
    ).

happen(Place, Number, Event, Model, Store) ->
    Robot = starl_check_store:term(Number, Store),
    Happens = fun() -> starl_check_robot:event(robot_event(Event, Model, Store), Robot, Model) end,
    happening(Place, Happens, Model, Store).

%% @doc The moments at which a robot can stand still while it handles an event.
-spec cuts(Robot :: ref(), event(), model(), store()) -> [starl_check_robot:cut()].
cuts(Number, Event, Model, Store) ->
    starl_check_store:memo(
        {cuts, Number, Event},
        fun() ->
            Robot = starl_check_store:term(Number, Store),
            try
                starl_check_robot:cuts(robot_event(Event, Model, Store), Robot, Model)
            catch
                throw:{crashed, _, _} -> []
            end
        end,
        Store
    ).

%% A machine that crashes by itself breaks a contract, as in a simulation.
happening(Place, Happens, Model, Store) ->
    try Happens() of
        Result -> happened(Place, Result, Model, Store)
    catch
        throw:{crashed, Name, Reason} ->
            Id = starl_check_model:id(Place, Model),
            {broken, starl_crash_monitor:violation(0, Id, Name, starl_crash:cause(Reason))}
    end.

happened(Place, {_, Traces, _} = Result, #{beyond := IsBeyond, known := Known} = Model, Store) ->
    case {unknown(Traces, Known), lists:any(IsBeyond, Traces)} of
        {[Event | _], _} -> {broken, starl_event:violation(Event)};
        {[], true} -> beyond;
        {[], false} -> within(Place, Result, Model, Store)
    end.

unknown(Traces, Known) ->
    [T || {_, _, Name, Event} = T <- Traces, not starl_event:is_known(Name, Event, Known)].

within(Place, {Sent, Traces, Robot}, #{monitor := {Module, _}}, Store) ->
    Items = [item_number(new_item(Place, One), Store) || One <- Sent],
    Wanted = Module:interests(),
    Judged = [T || {_, _, Name, _} = T <- Traces, lists:member(Name, Wanted)],
    {
        starl_check_store:number(Robot, Robot, Store),
        lists:sort(Items),
        unless_empty(Traces, Store),
        unless_empty(Judged, Store)
    }.

unless_empty([], _Store) -> none;
unless_empty(Traces, Store) -> starl_check_store:number(Traces, Traces, Store).

robot_event({still, Cut, Event}, Model, Store) ->
    {still, Cut, robot_event(Event, Model, Store)};
robot_event(I, Model, Store) when is_integer(I) ->
    case item(I, Store) of
        {packet, _, _, Packet} ->
            {packet, Packet};
        {message, From, _, Type, Body, _, _} ->
            {message, starl_check_model:id(From, Model), Type, Body}
    end;
robot_event(Event, _Model, _Store) ->
    Event.

new_item(From, {packet, To, Packet}) ->
    {packet, From, starl_check_term:number(To), Packet};
new_item(From, {message, To, Type, Body, Ref}) ->
    {message, From, starl_check_term:number(To), Type, Body, Ref, fresh}.

%% @doc The traced events of a number.
-spec traces(ref() | none, store()) -> [starl_monitor:trace_event()].
traces(none, _Store) -> [];
traces(Number, Store) -> starl_check_store:term(Number, Store).

%% -- the monitor ----------------------------------------------------------------------------

%% @doc The number of a monitor's state. States that judge all later events alike have one number.
-spec judge_number({module(), starl_monitor:state()}, store()) -> ref().
judge_number({Module, Judge}, Store) ->
    starl_check_store:number({Module, starl_check_judge:timeless(Module, Judge)}, Judge, Store).

%% @doc The monitor after it has judged the events.
-spec judge(Judged :: ref() | none, Monitor :: ref(), model(), store()) ->
    ref() | {violation, starl_monitor:violation()}.
judge(none, Monitor, _Model, _Store) ->
    Monitor;
judge(Judged, Monitor, #{monitor := {Module, _}}, Store) ->
    starl_check_store:memo(
        {judge, Monitor, Judged},
        fun() ->
            Judge = starl_check_store:term(Monitor, Store),
            verdict(starl_check_store:term(Judged, Store), Module, Judge, Store)
        end,
        Store
    ).

verdict(Traces, Module, Judge, Store) ->
    case starl_check_judge:read(Traces, Module, Judge) of
        {ok, Next} -> judge_number({Module, Next}, Store);
        {violation, _} = Violation -> Violation
    end.

%% -- the content of a part ------------------------------------------------------------------

%% @doc The calls of a robot's SAP that wait for an answer.
-spec calls(Robot :: ref(), store()) -> [starl_check_sap:call()].
calls(Number, Store) ->
    of_robot(calls, Number, fun starl_check_robot:calls/1, Store).

%% @doc The running timers of a robot, with their deadlines and kinds.
-spec timers(Robot :: ref(), model(), store()) ->
    [{starl_check_robot:timer(), starl_check_robot:due(), starl_check_model:timer_kind()}].
timers(Number, Model, Store) ->
    Compute = fun(Robot) ->
        [
            {Key, Due, starl_check_model:timer(Key, Model)}
         || {Key, Due} <- starl_check_robot:timers(Robot)
        ]
    end,
    of_robot(timers, Number, Compute, Store).

%% @doc Whether a robot's application has ended.
-spec is_done(Robot :: ref(), store()) -> boolean().
is_done(Number, Store) ->
    of_robot(done, Number, fun starl_check_robot:is_done/1, Store).

%% @doc Whether time has passed since a robot began to stand still.
-spec has_aged(Robot :: ref(), store()) -> boolean().
has_aged(Number, Store) ->
    of_robot(has_aged, Number, fun starl_check_robot:has_aged/1, Store).

%% @doc Whether a robot has stood still for as long as one does here.
-spec must_go_on(Robot :: ref(), model(), store()) -> boolean().
must_go_on(Number, Model, Store) ->
    Compute = fun(Robot) -> starl_check_robot:must_go_on(Robot, Model) end,
    of_robot(must_go_on, Number, Compute, Store).

%% @doc The condition of a robot: up, standing still within a step, down or dead.
-spec condition(Robot :: ref(), store()) -> starl_check_robot:condition().
condition(Number, Store) ->
    of_robot(condition, Number, fun starl_check_robot:condition/1, Store).

of_robot(What, Number, Compute, Store) ->
    starl_check_store:memo(
        {What, Number}, fun() -> Compute(starl_check_store:term(Number, Store)) end, Store
    ).

%% @doc The message of a number.
-spec item(ref(), store()) -> item().
item(I, Store) -> starl_check_store:term(I bsr ?ITEM_BITS, Store).

%% @doc The number of a message. It encodes the source, the receiver and the age.
-spec item_number(item(), store()) -> ref().
item_number(Item, Store) ->
    Number = starl_check_store:number(Item, Item, Store),
    {From, To, Age} =
        case Item of
            {packet, F, T, _} -> {F, T, 3};
            {message, F, T, _, _, _, fresh} -> {F, T, 0};
            {message, F, T, _, _, _, {queued, _}} -> {F, T, 0};
            {message, F, T, _, _, _, late} -> {F, T, 1};
            {message, F, T, _, _, _, ghost} -> {F, T, 2}
        end,
    Number bsl ?ITEM_BITS bor ((From - 1) bsl 5) bor ((To - 1) bsl 2) bor Age.

%% @doc The source of a message.
-spec source(ref()) -> place().
source(I) -> (I bsr 5) band 7 + 1.

%% @doc The receiver of a message.
-spec receiver(ref()) -> place().
receiver(I) -> (I bsr 2) band 7 + 1.

%% @doc The age of a message. Packets have none: they are lost and slow at will.
-spec age(ref()) -> age() | packet.
age(I) -> element(I band 3 + 1, {fresh, late, ghost, packet}).

%% @doc The message, counted as slow or as lost.
-spec grown_old(ref(), late | ghost, store()) -> ref().
grown_old(I, Age, Store) ->
    item_number(setelement(7, item(I, Store), Age), Store).

%% @doc The place of a message in its receiver's queue; `none' if it is not fresh.
-spec queue(ref(), store()) -> queue() | none.
queue(I, Store) ->
    case item(I, Store) of
        {message, _, _, _, _, _, fresh} -> 0;
        {message, _, _, _, _, _, {queued, N}} -> N;
        _ -> none
    end.

%% @doc The message, one place further up in its receiver's queue.
-spec moved_up(ref(), store()) -> ref().
moved_up(I, Store) ->
    case queue(I, Store) of
        none -> I;
        N -> item_number(setelement(7, item(I, Store), {queued, N + 1}), Store)
    end.

%% -- time -----------------------------------------------------------------------------------

%% @doc A robot after this number of ticks.
-spec later_robot(ref(), Ticks :: pos_integer(), model(), store()) -> ref().
later_robot(Number, Ticks, Model, Store) ->
    starl_check_store:memo(
        {later, Number, Ticks},
        fun() ->
            Robot = starl_check_robot:shift(Ticks, starl_check_store:term(Number, Store), Model),
            starl_check_store:number(Robot, Robot, Store)
        end,
        Store
    ).

%% @doc A message after this number of ticks: the times in it lie further back.
-spec later_item(ref(), Ticks :: pos_integer(), model(), store()) -> ref().
later_item(I, Ticks, #{rates := Rates, horizon_us := Horizon}, Store) ->
    starl_check_store:memo(
        {later_item, I, Ticks},
        fun() ->
            item_number(starl_check_term:shift(item(I, Store), Ticks, Rates, Horizon), Store)
        end,
        Store
    ).

%% -- robots that change places --------------------------------------------------------------

%% @doc The number of a robot's state when robots change places.
-spec renamed_robot(starl_check_term:permutation(), ref(), store()) -> ref().
renamed_robot(Permutation, Number, Store) ->
    Rename = fun(Robot) ->
        Renamed = starl_check_robot:rename(Robot, Permutation),
        starl_check_store:number(Renamed, Renamed, Store)
    end,
    renamed(Permutation, Number, Rename, Store).

%% @doc The same for a message.
-spec renamed_item(starl_check_term:permutation(), ref(), store()) -> ref().
renamed_item(Permutation, I, Store) ->
    Rename = fun(Item) -> item_number(rename_item(Permutation, Item), Store) end,
    starl_check_store:memo(
        {renamed, Permutation, I, item}, fun() -> Rename(item(I, Store)) end, Store
    ).

%% @doc The same for the monitor.
-spec renamed_monitor(starl_check_term:permutation(), ref(), module(), store()) -> ref().
renamed_monitor(Permutation, Number, Module, Store) ->
    Rename = fun(Judge) ->
        judge_number({Module, starl_check_term:rename(Judge, Permutation)}, Store)
    end,
    renamed(Permutation, Number, Rename, Store).

renamed(Permutation, Number, Rename, Store) ->
    starl_check_store:memo(
        {renamed, Permutation, Number},
        fun() -> Rename(starl_check_store:term(Number, Store)) end,
        Store
    ).

rename_item(Permutation, {packet, From, To, Packet}) ->
    {New, NewTo} = {element(From, Permutation), element(To, Permutation)},
    {packet, New, NewTo, starl_check_term:rename(Packet, Permutation)};
rename_item(Permutation, {message, From, To, Type, Body, Ref, Age}) ->
    {New, NewTo} = {element(From, Permutation), element(To, Permutation)},
    {message, New, NewTo, Type, starl_check_term:rename(Body, Permutation), Ref, Age}.

%% -- robots under their own numbers --------------------------------------------------------

%% @doc The number, in the store `Own', of a robot's state in which each robot has its own number.
-spec own_robot(ref(), store(), Own :: store()) -> ref().
own_robot(Number, Store, Own) ->
    Robot = starl_check_robot:own(starl_check_store:term(Number, Store)),
    starl_check_store:number(Robot, Robot, Own).

%% @doc The same for an event of a robot.
-spec own_event(event(), store(), Own :: store()) -> event().
own_event({still, Cut, Event}, Store, Own) -> {still, Cut, own_event(Event, Store, Own)};
own_event(I, Store, Own) when is_integer(I) -> own_item(I, Store, Own);
own_event(Event, _Store, _Own) -> starl_check_term:own(Event).

%% @doc The same for what follows from an event.
-spec own_happening(happening(), store(), Own :: store()) -> happening().
own_happening({Robot, Sent, Traces, Judged}, Store, Own) ->
    {
        own_robot(Robot, Store, Own),
        lists:sort([own_item(I, Store, Own) || I <- Sent]),
        own_traces(Traces, Store, Own),
        own_traces(Judged, Store, Own)
    };
own_happening(beyond, _Store, _Own) ->
    beyond;
own_happening({broken, Violation}, _Store, _Own) ->
    {broken, starl_check_term:own(Violation)}.

own_traces(none, _Store, _Own) -> none;
own_traces(Number, Store, Own) -> unless_empty(starl_check_term:own(traces(Number, Store)), Own).

own_item(I, Store, Own) -> item_number(own_item(item(I, Store)), Own).

%% Sender and receiver are places.
own_item({packet, From, To, Packet}) ->
    {packet, From, To, starl_check_term:own(Packet)};
own_item({message, From, To, Type, Body, Ref, Age}) ->
    {message, From, To, Type, starl_check_term:own(Body), Ref, Age}.
